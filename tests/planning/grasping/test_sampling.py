"""How many grasps are sampled: all of the usual ones are among the dense ones, and a proof that there is none asks those."""

from __future__ import annotations

import numpy as np
import pytest

from planning.grasping.sampling import DENSE, DENSEST, USUAL, Sampling


def test_the_numbers() -> None:
    assert Sampling() == USUAL
    assert (USUAL.yaws, USUAL.backs_m, USUAL.heights) == (12, (0.0,), (0.6, 0.85))
    assert (DENSE.yaws, DENSE.backs_m, DENSE.heights) == (36, (0.0, 0.01, 0.02, np.inf), (0.0, 0.3, 0.45, 0.6, 0.72, 0.85, 0.95, 1.0))
    assert np.degrees(DENSE.pitches["diagonal"]) == pytest.approx([30, 45, 60])
    assert (DENSE.rooms_m, DENSEST.rooms_m, USUAL.rooms_m) == ((0.005, 0.001), (0.005, 0.001), (0.005,))


def test_the_densest_leave_no_gap_of_more_than_3_mm() -> None:
    """In heights, on things as tall as 18 cm; 5 mm in depth, 7.5° in pitch. All dense ones are among them."""
    heights = np.unique(DENSEST.heights)
    assert (heights[0], heights[-1]) == (0.0, 1.0)
    assert 0.18 * np.diff(heights).max() == pytest.approx(0.003)
    assert DENSEST.backs_m[:-1] == pytest.approx([0.0, 0.005, 0.01, 0.015, 0.02])
    assert DENSEST.backs_m[-1] == np.inf
    assert np.degrees(DENSEST.pitches["diagonal"]) == pytest.approx([30, 37.5, 45, 52.5, 60])
    assert set(DENSE.heights) <= set(DENSEST.heights)
    assert set(DENSE.backs_m) <= {round(back, 9) for back in DENSEST.backs_m}
    assert DENSEST.yaws == 36
    assert DENSEST.pitches.keys() == USUAL.pitches.keys()
    assert len(DENSEST.heights) * len(DENSEST.backs_m) * 5 >= 10 * len(DENSE.heights) * len(DENSE.backs_m) * 3


def test_the_usual_grasps_are_among_the_dense_ones() -> None:
    assert DENSE.yaws % USUAL.yaws == 0
    assert set(USUAL.backs_m) < set(DENSE.backs_m)
    assert set(USUAL.heights) < set(DENSE.heights)
    assert DENSE.pitches.keys() == USUAL.pitches.keys()
    for kind, pitches in USUAL.pitches.items():
        assert set(pitches) <= set(DENSE.pitches[kind])
