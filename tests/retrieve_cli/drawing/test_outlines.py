"""The lines of a picture lie where they should."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.scene import Body, Cabinet
from kinematics.shapes import Cylinder
from kinematics.transforms import rotation_about, transform
from retrieve_cli.drawing.outlines import ring

CABINET = Cabinet(np.array([0.5, 0.6, 1.0]), transform(rotation_about([0.0, 0.0, 1.0], 0.4), [0.4, 0.1, 0.2]), 0.02)


@pytest.mark.parametrize(("foot", "height"), [(0.0, 0.0015), (0.0007, 0.0015), (0.48, 0.4815)])
def test_the_targets_ring_is_on_what_it_stands_on(foot: float, height: float) -> None:
    """The cabinet's floor, also where it was lifted a little off it, or a board."""
    can = Body("can", Cylinder(0.03, 0.1), CABINET.T_world_cabinet @ transform(p=[0.2, 0.1, foot + 0.05]))
    T, radius = ring(CABINET, can)
    np.testing.assert_allclose(np.linalg.inv(CABINET.T_world_cabinet) @ T, transform(p=[0.2, 0.1, height]), atol=1e-4)
    assert radius == pytest.approx(0.042, abs=1e-3)
