"""Seen solids settled for planning: noise's overlaps go, deep ones stay, stacked things stand exactly."""

from __future__ import annotations

import numpy as np
import pytest
from photographs import box, can, lifted

from kinematics.collision.fcl_solids import overlapping
from kinematics.scene import object_box
from perception.objects.settle import settled, stands_on

PAIRS = {
    "boxes": (box("a", 0.3, 0.0, [0.06, 0.06, 0.1], 0.2), box("b", 0.3, 0.06, [0.06, 0.06, 0.12], 0.1)),
    "box and can": (box("a", 0.3, 0.0, [0.06, 0.06, 0.1], 0.4), can("b", 0.36, 0.0)),
    "cans": (can("a", 0.3, 0.0), can("b", 0.33, 0.05)),
    "a stack, 18 mm in one another": (lifted(can("a", 0.3, 0.0), 0.062), box("b", 0.3, 0.0, [0.1, 0.1, 0.08])),
    "a stack": (lifted(box("a", 0.3, 0.0, [0.06, 0.06, 0.1]), 0.075), box("b", 0.3, 0.0, [0.1, 0.1, 0.08], 0.3)),
}


@pytest.mark.parametrize("case", PAIRS)
def test_small_overlaps_go_and_little_is_lost(case: str) -> None:
    before = PAIRS[case]
    assert overlapping(before, 0.001)
    after = settled(before, 0.0)
    assert not overlapping(after, 0.0)
    for a, b in zip(before, after):
        old, new = object_box(a), object_box(b)
        assert (new[3:] <= old[3:] + 1e-9).all()
        assert np.abs(new - old).max() < (0.02 if "stack" in case else 0.012)
    if "stack" in case:  # what is carried stays as high as it is
        assert after[0] is before[0]


def test_what_is_apart_or_deep_in_one_another_stays() -> None:
    apart = (can("a", 0.3, 0.0), can("b", 0.3, 0.1))
    deep = (box("a", 0.3, 0.0, [0.1, 0.1, 0.1]), box("b", 0.34, 0.04, [0.1, 0.1, 0.1]))
    for pair in (apart, deep):
        assert all(a is b for a, b in zip(pair, settled(pair, 0.0)))


def test_a_gap_under_what_is_carried_is_closed() -> None:
    upper, lower = settled((lifted(can("a", 0.3, 0.0), 0.092), box("b", 0.3, 0.0, [0.1, 0.1, 0.08])), 0.0)
    assert object_box(upper)[2] - object_box(upper)[5] / 2 == pytest.approx(0.08, abs=1e-3)
    assert object_box(upper)[2] + object_box(upper)[5] / 2 == pytest.approx(0.242)
    assert object_box(lower)[5] == pytest.approx(0.08)


def test_only_what_lies_over_something_stands_on_it() -> None:
    lower = box("low", 0.3, 0.0, [0.1, 0.1, 0.08])
    assert stands_on(lifted(can("a", 0.3, 0.02), 0.085), lower, 0.0)
    assert not stands_on(lower, lifted(can("a", 0.3, 0.02), 0.085), 0.0)
    assert not stands_on(lifted(can("a", 0.4, 0.02), 0.085), lower, 0.0)
    assert not stands_on(can("a", 0.3, 0.02), lower, 0.0)
    assert not stands_on(lifted(can("a", 0.3, 0.02), 0.15), lower, 0.0)
