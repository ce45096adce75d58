"""Neighbourhoods of hands: they leave no gaps, and their room is what there may be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from kinematics.robots.robot import Robot
from kinematics.scene import Grasp
from kinematics.transforms import apply, rotation_about, transform
from planning.grasping.finger_grasps import open_width
from planning.grasping.hand_poses import hand_points, level_hand
from planning.grasping.pads import pad_of
from planning.grasping.sampling import DENSEST, DIAGONAL
from planning.motion.handling.neighbourhoods import (
    LEAST_ROOM_M,
    LEAST_TURN_M,
    SQUARE,
    TURN_M,
    Neighbourhood,
    coarsest,
    divided,
    hand_reach_m,
    least_room_m,
    levels_of,
    sampling_of,
)
from planning.motion.search.reaching import APPROACH_M

UP = (0, 0, 1)

TURNED = replace(SQUARE, turn=TURN_M / 0.3, reach_m=0.3)
PITCHED = replace(SQUARE, pitch=TURN_M / 0.25, reach_m=0.3)
BOTH = replace(TURNED, pitch=TURNED.turn)


@pytest.mark.parametrize("first", [SQUARE, TURNED, PITCHED, BOTH], ids=["square", "turned", "pitched", "both"])
def test_some_hands_stand_together_for_all_around_one(first: Neighbourhood) -> None:
    """Whatever hand one stands for, each point of it is no further than the next room from where one of the next hands has it."""
    middle, pads, rng = np.array([0.51, 0.12, 0.3]), np.array([0.0, 0.002, 0.14]), np.random.default_rng(0)
    hand = Grasp(transform(level_hand(np.array([0.6, 0.8, 0.0]), 0.4), [0.40, -0.05, 0.35]), 0.05)
    for around in levels_of(first)[:-1]:
        finer = around.halved()
        parts = np.array([part.T_world_hand for part in divided(hand, around, middle, pads)])
        in_hand = pads + rng.normal(size=(60, 3)) * [0.05, 0.05, 0.1]
        level = apply(hand.T_world_hand, in_hand)[:, :2] - middle[:2]
        near = (np.hypot(*level.T) + around.room_m <= 0.3) & (np.linalg.norm(in_hand - pads, axis=1) <= 0.3)
        in_hand = np.c_[in_hand[near], np.ones(near.sum())]
        assert len(in_hand) > 20
        for share in rng.uniform(-1, 1, (30, 4)):
            moved = transform(p=share[0] * around.ahead_m * np.array([0.6, 0.8, 0.0]) + share[1] * around.up_m * np.array(UP, float))
            turned = transform(p=middle) @ transform(rotation_about(UP, share[2] * around.turn)) @ transform(p=-middle)
            pitched = transform(p=pads) @ transform(rotation_about((0, 1, 0), share[3] * around.pitch)) @ transform(p=-pads)
            there = in_hand @ (turned @ moved @ hand.T_world_hand @ pitched).T
            apart = np.linalg.norm(in_hand @ parts.transpose(0, 2, 1) - there, axis=2).max(1)
            assert apart.min() <= finer.room_m + 1e-12
    assert levels_of(first)[-1].room_m <= LEAST_ROOM_M


KINDS = [(False, False), (True, False), (False, True), (True, True)]


@pytest.mark.parametrize(("turned", "pitched"), KINDS)
@given(share=st.floats(0.0, 1.0), radius_m=st.floats(0.01, 0.06))
@example(share=0.0, radius_m=0.03)
@example(share=1.0, radius_m=0.03)
def test_the_first_neighbourhood_keeps_to_the_room_that_there_may_be(
    ur5e: Robot, turned: bool, pitched: bool, share: float, radius_m: float
) -> None:
    """From the least with which a proof is sought on; and a hand is turned or pitched where that is asked, by more than nothing."""
    least = least_room_m(pitched=pitched)
    most_m = least + share * 0.03
    first = coarsest(ur5e, most_m, radius_m, turned=turned, pitched=pitched)
    assert (first.turn > 0, first.pitch > 0) == (turned, pitched)
    assert first.room_m <= most_m + 1e-12
    if turned or pitched:
        assert first.reach_m == pytest.approx(hand_reach_m(ur5e) + APPROACH_M + radius_m)
    assert SQUARE.moved_m <= first.moved_m <= (2 if turned and pitched else 1) * SQUARE.moved_m + 1e-12
    for angle in (a for a in (first.turn, first.pitch) if a):
        assert LEAST_TURN_M - 1e-12 <= angle * first.reach_m <= TURN_M + 1e-12
        if share == 0.0:
            assert angle * first.reach_m == pytest.approx(LEAST_TURN_M * (1 + pitched) / (turned + pitched))
        if share == 1.0:  # there is room for all
            assert angle * first.reach_m == pytest.approx(TURN_M)
            assert first.moved_m == pytest.approx((2 if turned and pitched else 1) * SQUARE.moved_m)


ANGLES, LENGTHS = st.floats(0.0, 0.2), st.floats(0.0005, 0.01)


@given(around=st.builds(Neighbourhood, LENGTHS, LENGTHS, ANGLES, ANGLES, st.just(0.3), st.just(0.02)))
def test_halves_have_half_of_what_matters_most(around: Neighbourhood) -> None:
    finer = around.halved()
    for name in ("ahead_m", "up_m", "turn", "pitch"):
        assert getattr(finer, name) in (getattr(around, name), getattr(around, name) / 2)
    assert around.room_m / 2 - 1e-12 <= finer.room_m <= around.room_m * 5 / 6 + 1e-12
    assert (finer.reach_m, finer.pad_m) == (around.reach_m, around.pad_m)
    levels = levels_of(around)
    assert levels[0] is around
    assert levels[-1].room_m <= LEAST_ROOM_M < levels[-2].room_m


def test_no_point_of_a_hand_is_further_from_what_it_holds_than_its_reach(ur5e: Robot) -> None:
    """However wide it is open, from any point between its pads; and the reach is hardly more than that."""
    pad, opening, most_m = pad_of(ur5e), ur5e.opening, 0.0
    between = np.array([[x, 0.0, z] for x in (-pad.half_x_m, pad.half_x_m) for z in (pad.low_z_m, pad.high_z_m)])
    for width in np.linspace(0.0, opening.max_m, 9):
        hand = hand_points(ur5e, open_width(width, opening), ur5e.hand_links) - opening.middle(width)
        most_m = max(most_m, float(np.linalg.norm(hand[:, None] - between, axis=2).max()))
    assert most_m <= hand_reach_m(ur5e) <= most_m + 0.01


def test_a_square_hand_is_moved_half_a_step_and_turned_not_at_all() -> None:
    assert (SQUARE.ahead_m, SQUARE.up_m, SQUARE.turn, SQUARE.pitch) == (0.0025, 0.0015, 0.0, 0.0)
    assert SQUARE.room_m == SQUARE.lacks_m == pytest.approx(np.hypot(0.0025, 0.0015))


@given(ahead_m=st.floats(0.0005, 0.01), up_m=st.floats(0.0005, 0.01), turn=st.floats(0.005, 0.2), pitch=st.floats(0.005, 0.2))
def test_the_hands_that_are_sampled_leave_no_gaps(ahead_m: float, up_m: float, turn: float, pitch: float) -> None:
    """Two that are next to each other are no further apart than both stand for; ends are within reach of the first and last."""
    sampling = sampling_of(Neighbourhood(ahead_m, up_m, turn, pitch, 0.3, 0.02))
    assert np.pi / sampling.yaws <= 2 * turn + 1e-12
    assert sampling.steps_m == (2 * ahead_m, 2 * up_m)
    low, high = min(DENSEST.pitches[DIAGONAL]), max(DENSEST.pitches[DIAGONAL])
    pitches = np.array(sampling.pitches[DIAGONAL])
    assert np.diff(pitches).max(initial=0.0) <= 2 * pitch + 1e-12
    assert np.diff(pitches).min(initial=np.inf) > pitch  # and no more are looked at than that asks for
    assert 0 < pitches[0] - low <= pitch + 1e-12
    assert 0 < high - pitches[-1] <= pitch + 1e-12
    assert sampling_of(SQUARE).pitches == DENSEST.pitches


def test_a_pitched_hand_holds_as_far_as_its_pads_are_from_their_middle(ur5e: Robot) -> None:
    """No corner of a pad moves further, pitched about the pads' middle, than a hand can be from holding."""
    first, pad = coarsest(ur5e, 0.02, 0.03, turned=False, pitched=True), pad_of(ur5e)
    corners = np.array([[x, 0.0, z] for x in (-pad.half_x_m, pad.half_x_m) for z in (pad.low_z_m, pad.high_z_m)])
    for angle in (-first.pitch, first.pitch):
        moved = np.linalg.norm(corners @ rotation_about((0, 1, 0), angle).T - corners, axis=1).max()
        assert 0 < moved <= first.lacks_m - first.moved_m
        assert moved > 0.5 * (first.lacks_m - first.moved_m)  # and not for much more
