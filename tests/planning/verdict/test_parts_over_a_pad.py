"""Parts of a body that are nowhere near a pad are left out, and nothing that is said of a touch changes by that."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.transforms import rotation_about, transform
from planning.verdict import pads
from planning.verdict.hand import Pad
from planning.verdict.polyhedra import Window, from_points


@pytest.mark.parametrize("seed", range(4))
def test_a_touch_is_the_same_with_all_parts_and_with_those_over_the_pad(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng, touched = np.random.default_rng(seed), 0
    window = Window(np.array([[-0.01, -0.008], [0.01, -0.008], [0.012, 0.008], [-0.01, 0.008]]))
    pad = Pad("pad", 1, 0, np.eye(4), window)
    body = tuple(from_points(rng.normal(scale=0.012, size=(9, 3)) + rng.normal(scale=0.03, size=3)) for _ in range(20))
    usual = pads._over
    for _ in range(30):
        axis = rng.normal(size=3)
        T = transform(rotation_about(axis / np.linalg.norm(axis), rng.uniform(0, 3)), rng.normal(scale=0.03, size=3))
        few = pads.touch(pad, np.eye(4), body, T)
        assert len(usual(body, T, window)) < len(body)
        with monkeypatch.context() as m:
            m.setattr(pads, "_over", lambda body, *_: [(-np.inf, i) for i in range(len(body))])
            all_parts = pads.touch(pad, np.eye(4), body, T)
        assert (few is None) == (all_parts is None)
        if few is not None and all_parts is not None:
            touched += 1
            assert (few.gap_m, few.width_m) == (all_parts.gap_m, pytest.approx(all_parts.width_m, abs=1e-12))
            np.testing.assert_array_equal(few.normal, all_parts.normal)
    assert touched > 5
