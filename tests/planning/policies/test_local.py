"""The local baseline: rankings on lines whose contacts are written down, then a real line of the toy arm before boxes that it runs into.

Region 4 i + j of `fakes.observation` has its centre at (0.05 + 0.1 i, −0.15 + 0.1 j).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import TOY
from fakes import observation

from kinematics.collision.robot_model import RobotCollisionModel
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import Grasp
from kinematics.transforms import Array, transform
from perception.observation import Observation
from planning.grasping.finger_grasps import open_width
from planning.policies.local import SAMPLES, Line, Lines, make_local_object, make_local_region
from planning.policies.regions import free_regions

RNG = np.random.default_rng(0)
SIZE = (0.06, 0.06, 0.12)


class WrittenLines:
    """Stands for `Lines`: where a line touches a box is written down; each question is noted."""

    def __init__(self, first_touch: Callable[[Array], int | None]) -> None:
        self._first_touch, self.asked, self.about = first_touch, list[Array](), list[Observation]()

    def of(self, seen: Observation) -> WrittenLines:
        self.about.append(seen)
        return self

    def first_touch(self, box: Array) -> int | None:
        self.asked.append(np.array(box))
        return self._first_touch(box)


def seen_with(**places: tuple[float, float, float]) -> Observation:
    return observation({**{name: (*p, *SIZE) for name, p in places.items()}, "target": (0.35, 0.15, 0.06, *SIZE)})


# ------------------------------------------------------------------------------------------------------------------------------- rankings


def test_objects_are_moved_in_the_order_in_which_the_line_meets_them() -> None:
    """None that it does not meet, never the target; those that are met at once in the order of their names."""
    seen = seen_with(
        far=(0.3, 0, 0.06), off=(0.2, 0, 0.06), near=(0.1, 0, 0.06), b=(0.25, 0, 0.06), a=(0.25, 0.1, 0.06), c=(0.25, 0.15, 0.06)
    )
    met = {0.3: 9, 0.2: None, 0.1: 0, 0.25: 5, 0.35: 1}
    lines = WrittenLines(lambda box: met[round(float(box[0]), 2)])
    assert make_local_object(lines)(seen, RNG) == ["near", "a", "b", "c", "far"]  # type: ignore[arg-type]
    assert lines.about == [seen]
    assert [tuple(box) for box in lines.asked] == [tuple(seen.boxes[n]) for n in ("far", "off", "near", "b", "a", "c")]


def test_a_line_that_is_free_moves_nothing() -> None:
    assert make_local_object(WrittenLines(lambda box: None))(seen_with(a=(0.1, 0, 0.06)), RNG) == []  # type: ignore[arg-type]


def test_the_nearest_free_region_off_the_line_comes_first() -> None:
    """By the distance in the plane from where the object stands; of those that are as far the lower number."""
    seen = seen_with(moved=(0.16, 0.04, 0.5), other=(0.05, 0.05, 0.06))
    lines = WrittenLines(lambda box: 3 if abs(box[0] - 0.25) < 0.01 else None)  # the third row is in the way
    ranked = make_local_region(lines)(seen, "moved", RNG)  # type: ignore[arg-type]
    free = free_regions(seen, "moved").tolist()
    assert 2 not in free  # the other stands there
    assert 15 not in free  # the target
    assert sorted(ranked) == [i for i in free if i // 4 != 2]
    distance = [float(np.hypot(*(seen.regions[i, :2] - (0.16, 0.04)))) for i in ranked]
    assert distance == sorted(distance)
    assert ranked[:3] == [6, 5, 7]
    assert all(type(i) is int for i in ranked)
    assert lines.about == [seen]


def test_regions_as_far_as_one_another_stay_in_their_order() -> None:
    seen = seen_with(moved=(0.2, 0.0, 0.06))
    lines = WrittenLines(lambda box: None)
    assert make_local_region(lines)(seen, "moved", RNG)[:4] == [5, 6, 9, 10]  # type: ignore[arg-type]
    seen = observation({"moved": (0.2, 0.0, 0.06, *SIZE)}, n=8)
    assert make_local_region(lines)(seen, "moved", RNG)[:12] == [27, 28, 35, 36, 19, 20, 26, 29, 34, 37, 43, 44]  # type: ignore[arg-type]


def test_the_line_is_asked_about_the_object_as_it_would_stand() -> None:
    """Over the region's centre, in its own size and at its own height."""
    seen = seen_with(moved=(0.15, 0.05, 0.13))
    lines = WrittenLines(lambda box: None)
    ranked = make_local_region(lines)(seen, "moved", RNG)  # type: ignore[arg-type]
    assert [tuple(box[:2]) for box in lines.asked] == [tuple(seen.regions[i, :2]) for i in ranked]
    for box in lines.asked:
        assert box[2] == pytest.approx(0.13)
        assert tuple(box[3:]) == SIZE


def test_a_line_is_made_once_for_an_observation(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[Any, Observation]] = []
    monkeypatch.setattr("planning.policies.local.Line", lambda motions, seen: made.append((motions, seen)) or f"line {len(made)}")
    lines, first, second = Lines("motions"), seen_with(), seen_with()  # type: ignore[arg-type]
    assert [lines.of(s) for s in (first, first, second, second, first)] == ["line 1", "line 1", "line 2", "line 2", "line 3"]
    assert made == [("motions", first), ("motions", second), ("motions", first)]


# ---------------------------------------------------------------------------------------------------------------------------- a real line


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Turns about z, lifts, and reaches out: at turn 0 its hand looks along x."""
    file = tmp_path_factory.mktemp("toy") / "toy.urdf"
    file.write_text(TOY)
    return load(str(file), "tcp", "grip")


@pytest.fixture(scope="module")
def arm(toy: Robot) -> RobotCollisionModel:
    return RobotCollisionModel(toy, np.eye(4))


HOME = np.array([0.0, 0.1, 0.1])


def line(
    toy: Robot, arm: RobotCollisionModel, *goals: tuple[float, float, float], width_m: float = 0.03, home: Array = HOME
) -> tuple[Line, list[Array]]:
    """The line from home to the nearest of some goals (turn, up, out), and what inverse kinematics was asked."""
    asked: list[Array] = []

    def ik(T_world_hand: Array) -> list[Array]:
        asked.append(T_world_hand)
        return [np.array(g) for g in goals]

    motions = SimpleNamespace(robot=toy, cell=SimpleNamespace(arm=arm, home_arm=home, ik=ik))
    seen = replace(seen_with(), grasp=Grasp(transform(p=[0.5, 0.0, 0.2]), width_m))
    return Line(motions, seen), asked  # type: ignore[arg-type]


def hand_at(toy: Robot, q: Array, opened: float) -> Array:
    return np.asarray(toy.link_poses(toy.with_arm(q, opened))["tcp"][:3, 3])


def box(centre: Array | list[float], edge: float = 0.02) -> Array:
    return np.array([*centre, edge, edge, edge])


def test_a_line_leads_straight_to_the_nearest_solution(toy: Robot, arm: RobotCollisionModel) -> None:
    """The nearest by the joint that must turn furthest; from home, in 64 samples, both ends among them."""
    assert SAMPLES == 64
    found, asked = line(toy, arm, (1.0, 0.1, 0.1), (0.6, 0.2, 0.3), (-0.7, 0.1, 0.1))
    assert found.samples.shape == (64, 3)
    assert np.array_equal(found.samples[0], HOME)
    assert found.samples[-1] == pytest.approx([0.6, 0.2, 0.3])
    assert np.allclose(np.diff(found.samples, axis=0), (np.array([0.6, 0.2, 0.3]) - HOME) / 63)
    from_elsewhere, _ = line(toy, arm, (-0.4, 0.1, 0.1), (1.2, 0.1, 0.1), home=np.array([0.5, 0.1, 0.1]))
    assert from_elsewhere.samples[[0, -1], 0].tolist() == [0.5, 1.2]
    (T,) = asked
    assert T[:3, 3].tolist() == [0.5, 0.0, 0.2]


def test_a_grasp_out_of_reach_has_no_line_and_nothing_is_in_its_way(toy: Robot, arm: RobotCollisionModel) -> None:
    found, _ = line(toy, arm)
    assert found.samples.shape == (0, 3)
    assert found.first_touch(box(hand_at(toy, HOME, 0.0), 0.5)) is None


def test_where_the_line_first_touches_a_box(toy: Robot, arm: RobotCollisionModel) -> None:
    """The hand swings by 1.2 rad through small boxes on its way: each is touched before the hand's middle is in it, not much earlier."""
    found, _ = line(toy, arm, (1.2, 0.1, 0.1))
    assert found.first_touch(box(hand_at(toy, HOME, 0.0) - np.array([0.08, 0.0, 0.0]))) == 0  # in the palm
    assert found.first_touch(box(hand_at(toy, HOME, 0.0))) == 3  # between the open fingers, of which one comes to it
    last = -1
    for share in (0.4, 0.6, 0.8, 1.0):
        at = found.first_touch(box(hand_at(toy, HOME + share * (found.samples[-1] - HOME), 0.0)))
        assert at is not None
        assert last < at <= 63 * share
        assert at > 63 * share - 25  # half the hand's width and the box's, seen from the turning axis: 0.4 rad
        last = at
    assert found.first_touch(box(hand_at(toy, np.array([-1.0, 0.1, 0.1]), 0.0))) is None
    assert found.first_touch(box([0.0, 0.0, 1.0])) is None
    assert found.first_touch(box([0.0, 0.0, 1.0], 1.12)) == 0  # its lower face is at 0.44, the post reaches up to 0.45
    assert found.first_touch(box([0.0, 0.0, 1.0], 1.08)) is None


def test_answers_do_not_hang_on_what_was_asked_before(toy: Robot, arm: RobotCollisionModel) -> None:
    found, _ = line(toy, arm, (1.2, 0.1, 0.1))
    rng = np.random.default_rng(3)
    boxes = []
    for turn, reach, z in rng.uniform((-0.5, 0.25, 0.15), (1.7, 0.45, 0.27), (30, 3)):
        boxes.append(np.array([reach * np.cos(turn), reach * np.sin(turn), z, *rng.uniform(0.01, 0.08, 3)]))
    answers = [found.first_touch(b) for b in boxes]
    assert [line(toy, arm, (1.2, 0.1, 0.1))[0].first_touch(b) for b in reversed(boxes)] == answers[::-1]
    assert sum(a is not None for a in answers) > 5
    assert sum(a is None for a in answers) > 5


def test_a_flat_and_a_long_box_are_themselves(toy: Robot, arm: RobotCollisionModel) -> None:
    """Each edge counts along its own axis: a plank beside the hand's way touches only when it is turned towards it."""
    found, _ = line(toy, arm, (0.2, 0.1, 0.1))
    x, y, z = hand_at(toy, HOME, 0.0)
    for edges, touched in (((0.02, 0.02, 0.6), True), ((0.02, 0.6, 0.02), False), ((0.6, 0.02, 0.02), False)):
        assert (found.first_touch(np.array([x, y, z + 0.25, *edges])) is not None) == touched
    for edges, touched in (((0.02, 0.02, 0.6), False), ((0.02, 0.6, 0.02), True), ((0.6, 0.02, 0.02), False)):
        assert (found.first_touch(np.array([x, y - 0.25, z, *edges])) is not None) == touched


def test_the_fingers_are_as_wide_as_before_the_grasp(toy: Robot, arm: RobotCollisionModel) -> None:
    """They open by a clearance on both sides of what x_g takes: a box beside a finger is touched when they open further."""
    narrow, wide = line(toy, arm, (0.0, 0.1, 0.1), width_m=0.01)[0], line(toy, arm, (0.0, 0.1, 0.1), width_m=0.05)[0]
    tips, edge = hand_at(toy, HOME, 0.0), 0.01
    outer = open_width(0.05, toy.opening) / 2 + 0.01  # a finger is 1 cm thick
    for beside in (outer - 0.004, -outer + 0.004):
        crumb = box(tips + np.array([0.0, beside, 0.0]), edge)
        assert wide.first_touch(crumb) == 0
        assert narrow.first_touch(crumb) is None
        assert wide.first_touch(box(tips + np.array([0.0, beside + np.sign(beside) * 0.012, 0.0]), edge)) is None


def test_the_two_halves_on_a_real_line(toy: Robot, arm: RobotCollisionModel) -> None:
    """Two boxes on the swing and one off it: the nearer to home goes first, to the nearest region off the swing."""
    goal = (1.2, 0.1, 0.1)
    motions = SimpleNamespace(robot=toy, cell=SimpleNamespace(arm=arm, home_arm=HOME, ik=lambda T: [np.array(goal)]))
    places = {name: hand_at(toy, np.array([turn, 0.1, 0.1]), 0.0) for name, turn in (("late", 1.1), ("early", 0.5), ("off", -1.2))}
    seen = observation(
        {**{n: (*p, 0.02, 0.02, 0.02) for n, p in places.items()}, "target": (*hand_at(toy, np.array(goal), 0.0), 0.02, 0.02, 0.02)}
    )
    lines = Lines(motions)  # type: ignore[arg-type]
    assert make_local_object(lines)(seen, RNG) == ["early", "late"]
    ranked = make_local_region(lines)(seen, "early", RNG)
    real = lines.of(seen)
    for i in free_regions(seen, "early"):
        there = np.array([*seen.regions[i, :2], places["early"][2], 0.02, 0.02, 0.02])
        assert (int(i) in ranked) == (real.first_touch(there) is None)
    assert ranked
