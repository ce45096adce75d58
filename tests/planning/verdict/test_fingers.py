"""When fingers close and open, and where they may be meanwhile, on an arm whose every joint is known by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from toy_arm import HAND, course, hand_at, splined

from kinematics.scene import Body, Cabinet, Held, RobotRef, Scene
from kinematics.shapes import Box
from planning.verdict.course import Course
from planning.verdict.faults import Settings
from planning.verdict.fingers import any_opening, arm_moves, grip_faults
from planning.verdict.ledger import keep

OPEN, SHUT = (0, 0, 0, 0, 0.03), (0, 0, 0, 0, 0.02)
THERE_SHUT, THERE_OPEN = (0.5, 0, 0, 0, 0.02), (0.5, 0, 0, 0, 0.03)
HELD = Held("a", np.eye(4))
SCENE = Scene(
    "s", RobotRef(np.eye(4), "toy"), Cabinet(np.ones(3), np.eye(4), 0.03), (Body("a", Box(np.full(3, 0.04)), hand_at(OPEN)),), "a", None
)


def gripped(*run: Course) -> list[tuple[str, str]]:
    numbered = [replace(c, number=n) for n, c in enumerate(run)]
    ledger = keep(HAND, SCENE, numbered, Settings())
    found = grip_faults(HAND, numbered, ledger)
    assert all(f.bodies == ("hand", "a") for f in found)
    return [(f.stage, f.detail) for f in found]


def never_closed(motion: int) -> tuple[str, str]:
    return "grasp", f"motion {motion} holds a, and no motion before it closes the hand on it while the arm stands"


def never_opened(motion: int) -> tuple[str, str]:
    return "release", f"motion {motion} is the last to hold a, and no motion then opens the hand while the arm stands"


CLOSES, CARRIES, OPENS = course(OPEN, SHUT), course(SHUT, THERE_SHUT, held=HELD), course(THERE_SHUT, THERE_OPEN)


def test_the_hand_closes_on_what_it_takes_and_opens_to_let_go() -> None:
    assert gripped(CLOSES, CARRIES, OPENS) == gripped(CLOSES, CARRIES) == gripped(CLOSES) == []
    waits = course(SHUT, SHUT)
    assert gripped(CLOSES, waits, CARRIES, course(THERE_SHUT), OPENS) == []
    smooth = replace(splined(SHUT, THERE_SHUT), held=HELD)
    assert gripped(splined(OPEN, SHUT), smooth, splined(THERE_SHUT, THERE_OPEN)) == []


def test_who_holds_without_closing() -> None:
    for before in ([], [waits := course(SHUT, SHUT)], [waits, waits], [course((0, 0, 0, 0, 0.01), SHUT)], [course(THERE_SHUT, SHUT)]):
        assert gripped(*before, CARRIES, OPENS) == [never_closed(len(before))]
    assert gripped(CLOSES, course(SHUT, THERE_SHUT, SHUT), CARRIES, OPENS) == [never_closed(2)]  # that was before the arm went


def test_fingers_that_come_back_to_where_they_were_neither_close_nor_open() -> None:
    assert gripped(course(SHUT, (0, 0, 0, 0, 0.015), SHUT), CARRIES, OPENS) == [never_closed(1)]
    assert gripped(CLOSES, CARRIES, course(THERE_SHUT, THERE_OPEN, THERE_SHUT)) == [never_opened(1)]


def test_a_micrometre_is_no_motion() -> None:
    for far, moves in ((1e-6, False), (1.5e-6, True)):
        assert arm_moves(HAND, course((0,), (far,))) == moves
        assert bool(any_opening(HAND, course((0,), (0.5, 0, 0, 0, far)))) == moves
        opens = course((0.5, 0, 0, 0, 0), (0.5, 0, 0, 0, far))
        assert gripped(CLOSES, CARRIES, opens) == ([] if moves else [never_opened(1)])


def test_who_lets_go_without_opening() -> None:
    stays, closes = course(THERE_SHUT, THERE_SHUT), course(THERE_SHUT, (0.5, 0, 0, 0, 0.01))
    for after in ([stays], [closes], [course(THERE_SHUT, SHUT)], [stays, course(THERE_SHUT, SHUT), course(SHUT, OPEN)]):
        assert gripped(CLOSES, CARRIES, *after) == [never_opened(1)]


def test_neither_closes_nor_opens_while_the_arm_moves() -> None:
    """For the gripper, which is told apart from the arm, may be early or late."""
    assert gripped(course((0.1, 0, 0, 0, 0.03), SHUT), CARRIES, OPENS) == [never_closed(1)]
    assert gripped(CLOSES, CARRIES, course(THERE_SHUT, (0.6, 0, 0, 0, 0.03))) == [never_opened(1)]


def test_fingers_beside_the_arm_are_looked_at_wherever_they_may_be() -> None:
    """From 60 to 40 mm, 4 mm from look to look; the clearance is said of the time in which they move."""
    for still in (course(OPEN, SHUT), course(SHUT, THERE_SHUT), course(OPEN)):
        assert any_opening(HAND, still) == ()
    for make in (course, splined):
        way = replace(make(OPEN, THERE_SHUT, (0.7, 0, 0, 0, 0.02), (0.8, 0, 0, 0, 0.02)), clearance_m=0.1, number=3)
        found = any_opening(HAND, way)
        assert np.allclose([value for value, _ in found], np.repeat(np.linspace(0.02, 0.03, 6), 2))
        for k, (value, some) in enumerate(found):
            assert (some.q[:, 4] == value).all()
            assert len(some.t_s) == len(some.q)
            assert np.allclose([x[4] for x in some.reach], value)
            first, last = ((0, 1), (1, 3))[k % 2]
            assert np.array_equal(some.q[:, :4], way.q[first : last + 1, :4])
            assert (some.clearance_m, some.number) == ((0.1, None)[k % 2], 3)
            middle = way.at(np.array([first + 0.3]))[0]
            assert np.allclose(some.at(np.array([0.3]))[0][:4], middle[:4])
    narrows = replace(HAND, values=HAND.values[::-1])  # the larger its joint's value, as of many a gripper
    assert len(any_opening(narrows, course(OPEN, THERE_SHUT))) == 6
    whole = any_opening(HAND, course(OPEN, THERE_SHUT))
    assert [some.q.shape for _, some in whole] == [(2, 5)] * 6
    soon = any_opening(HAND, course(OPEN, THERE_SHUT, (0.7, 0, 0, 0, 0.02)))
    assert [some.q[:, 0].tolist() for _, some in soon] == [[0.0, 0.5], [0.5, 0.7]] * 6
    beats = splined(*[(x, 0, 0, 0, 0.02) for x in (0.0, 0.1, 0.2)], qd=np.array([[0.0] * 5, [0.1, 0, 0, 0, 0.01], [0.0] * 5]))
    assert {some.q.shape for _, some in any_opening(HAND, beats)} == {(3, 5)}  # between the rows alone: all along, for all that one knows
    swings = course((0, 0, 0, 0, 0.02), (0.1, 0, 0, 0, 0.0215), (0.2, 0, 0, 0, 0.02))
    assert [round(value, 5) for value, _ in any_opening(HAND, swings)] == [0.02, 0.0215]
