"""How many grasps are sampled: all of the usual ones are among the dense ones, and a proof that there is none asks those."""

from __future__ import annotations

import numpy as np
import pytest

from planning.grasping.sampling import DENSE, USUAL, Sampling


def test_the_numbers() -> None:
    assert Sampling() == USUAL
    assert (USUAL.yaws, USUAL.backs_m, USUAL.heights) == (12, (0.0,), (0.6, 0.85))
    assert (DENSE.yaws, DENSE.backs_m, DENSE.heights) == (36, (0.0, 0.01, 0.02, np.inf), (0.0, 0.3, 0.45, 0.6, 0.72, 0.85, 0.95, 1.0))
    assert np.degrees(DENSE.pitches["diagonal"]) == pytest.approx([30, 45, 60])


def test_the_usual_grasps_are_among_the_dense_ones() -> None:
    assert DENSE.yaws % USUAL.yaws == 0
    assert set(USUAL.backs_m) < set(DENSE.backs_m)
    assert set(USUAL.heights) < set(DENSE.heights)
    assert DENSE.pitches.keys() == USUAL.pitches.keys()
    for kind, pitches in USUAL.pitches.items():
        assert set(pitches) <= set(DENSE.pitches[kind])
