"""Where a cabinet may stand beside what is fixed to an arm's base, and what is put into it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.shapes import box_corners
from kinematics.transforms import Array
from planning.fitting import BESIDE_M, _is_beside, _of_one_kind
from planning.scene_generation import load_spec

SPEC = load_spec("paper")


def block(size: tuple[float, float, float], at: tuple[float, float, float]) -> Array:
    return box_corners(np.array(size) / 2) + np.array(at)


def test_a_cabinet_stands_within_a_frame_that_is_fixed_to_the_base() -> None:
    """Posts on both sides and a beam above, all of which reach further ahead than its front."""
    depth, width, height = SPEC.cabinet_size_m
    aside, above = width / 2 + SPEC.cabinet_wall_m + 2 * BESIDE_M, 0.1 + height + SPEC.cabinet_wall_m + 2 * BESIDE_M
    frame = [block((2.0, 0.02, 2.0), (0.5, s * (aside + 0.01), 0.5)) for s in (1, -1)] + [block((2.0, 2.0, 0.02), (0.5, 0.0, above + 0.01))]
    assert _is_beside(SPEC, (0.3, 0.1), frame)
    assert not _is_beside(SPEC, (0.3, 0.1 + 1.5 * BESIDE_M), frame)
    assert not _is_beside(SPEC, (0.3, 0.1), [*frame, block((0.02, 0.02, 0.3), (0.3 + depth / 2, 0.0, 0.2))])
    assert _is_beside(SPEC, (0.3, 0.1), [])


@pytest.mark.parametrize("boxes", [True, False])
def test_objects_of_one_kind_alone(boxes: bool) -> None:
    """A spec of household objects keeps those of the kind; one that has none of it keeps what it has."""
    assert _of_one_kind(SPEC, boxes=boxes).objects_box_share == float(boxes)
    lab = load_spec("lab-s")
    kinds = {len(kind.size_m) for kind in lab.objects_household}
    assert kinds == {2, 3}
    assert {len(kind.size_m) for kind in _of_one_kind(lab, boxes=boxes).objects_household} == {3 if boxes else 2}
    only = replace(lab, objects_household=tuple(kind for kind in lab.objects_household if len(kind.size_m) == (2 if boxes else 3)))
    assert _of_one_kind(only, boxes=boxes).objects_household == only.objects_household
