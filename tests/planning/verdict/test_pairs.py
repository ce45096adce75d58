"""Which links of a robot of boxes may not touch each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_arm import ARM, URDF
from toy_robot import FINGERS, OPENING, PALM, solid, toy_robot

from kinematics.robots.robot import Robot
from planning.verdict.pairs import link_solids, pairs_of

SMALL = (-0.05, 0.05)
BASE, COLUMN = {"base": solid(SMALL, SMALL, (-1.0, -0.9))}, {"column": solid(SMALL, SMALL, (-0.3, -0.2))}


def named(robot: Robot) -> tuple[set[frozenset[str]], set[frozenset[str]]]:
    """Pairs that are checked and pairs that are switched off."""
    names, pairs = [h.link for h in robot.hulls], pairs_of(robot)
    found = [frozenset((names[i], names[j])) for table in (pairs.checked, pairs.switched_off) for i, j in table]
    assert len(found) == len(set(found))
    return set(found[: len(pairs.checked)]), set(found[len(pairs.checked) :])


def of(*pairs: str) -> set[frozenset[str]]:
    return {frozenset(pair.split("-")) for pair in pairs}


def test_what_is_far_apart_in_the_tree_may_not_touch() -> None:
    """Neighbours may, whatever links without geometry lie between them; the hand's own parts may."""
    robot = toy_robot({**BASE, **COLUMN, **PALM, **FINGERS})
    assert named(robot) == (of("palm-base", "left-base", "right-base", "left-column", "right-column"), set())
    without = toy_robot({**BASE, **PALM, **FINGERS})
    assert named(without) == (of("left-base", "right-base"), set())


def test_what_an_srdf_switches_off_is_told_apart() -> None:
    skip = frozenset(of("palm-base", "left-right", "column-base"))
    checked, off = named(toy_robot({**BASE, **COLUMN, **PALM, **FINGERS}, skip=skip))
    assert off == of("palm-base")
    assert checked == of("left-base", "right-base", "left-column", "right-column")


def test_what_does_not_move_against_each_other_is_not_asked_about() -> None:
    """The tool goes with the palm, the rail's two parts with each other."""
    rail = {"rail": [solid(SMALL, SMALL, (-0.6, -0.5)), solid(SMALL, (0.1, 0.2), (-0.6, -0.5))]}
    robot = toy_robot({**rail, **COLUMN, "hand": solid(SMALL, SMALL, (-0.15, -0.1)), **PALM, **FINGERS})
    checked = [frozenset(robot.hulls[k].link for k in pair) for pair in pairs_of(robot).checked]
    expected = [["column", "left"], ["column", "right"], ["column", "hand"]]  # the palm alone is the column's neighbour
    expected += [pair for pair in (["palm", "rail"], ["left", "rail"], ["rail", "right"], ["hand", "rail"]) for _ in rail["rail"]]
    assert sorted(map(sorted, checked)) == sorted(expected)


def test_what_touches_everywhere_is_a_neighbour_in_all_but_name() -> None:
    everywhere = {"base": solid((-20, 20), (-20, 20), (-20, 20))}
    assert named(toy_robot({**everywhere, **COLUMN, **PALM, **FINGERS}))[0] == of("left-column", "right-column")


def test_what_touches_in_half_of_all_configurations_is_none() -> None:
    """A wall in the way of the palm whenever x > 0.2: of 40 configurations between -2 and 2 that are some, and others are not."""
    half = {"base": solid((0.2, 20), (-20, 20), (-20, 20))}
    robot = toy_robot({**half, **COLUMN, **PALM, **FINGERS})
    assert named(robot)[0] == of("palm-base", "left-base", "right-base", "left-column", "right-column")


def test_a_jaw_and_what_it_closes_on_are_one_hand() -> None:
    """Though no link with geometry joins them, and there are no others."""
    still = solid((-0.011, 0.011), (-0.03, -0.02), (-0.01, 0.04))
    jaw = toy_robot({**COLUMN, "hand": still, "left": FINGERS["left"]}, opening=replace(OPENING, jaw=1), pads=frozenset({"hand", "left"}))
    assert named(jaw)[0] == set()  # both have the column above them


def test_links_are_asked_about_where_their_joints_take_them() -> None:
    """A block where the palm is when all joints are 0; and a tool 5 m from the palm, which turns: it is seldom beyond x = 2.9."""
    block = {"base": solid(SMALL, SMALL, SMALL), **COLUMN, **PALM, **FINGERS}
    assert "palm-base" in {"-".join(sorted(p, reverse=True)) for p in named(toy_robot(block))[0]}
    far = URDF.replace('<child link="hand"/>', '<child link="hand"/><origin xyz="5 0 0"/>')
    fingers = {name: corners + np.array([5.0, 0, 0]) for name, corners in FINGERS.items()}
    wall = {"base": solid((2.9, 20), (-20, 20), (-20, 20)), **COLUMN, "hand": PALM["palm"], **fingers}
    assert frozenset(("hand", "base")) in named(toy_robot(wall, urdf=far))[0]


@pytest.mark.parametrize(("apart", "neighbours"), [(0, True), (1, True), (2, True), (3, False), (5, False)])
def test_in_38_of_40_configurations_is_nearly_always(apart: int, neighbours: bool) -> None:
    """A wall that so many of the sampled positions along x do not reach."""
    q = np.sort(np.random.default_rng(0).uniform(np.maximum(ARM.lower, -np.pi), np.minimum(ARM.upper, np.pi), (40, 5))[:, 0])
    edge = q[apart] - 1e-3 if apart == 0 else (q[apart - 1] + q[apart]) / 2
    tiny = {"palm": solid((-1e-6, 1e-6), (-1e-6, 1e-6), (-1e-6, 1e-6))}
    robot = toy_robot({"base": solid((float(edge), 20), (-20, 20), (-20, 20)), **COLUMN, **tiny, **FINGERS})
    assert (frozenset(("palm", "base")) not in named(robot)[0]) is neighbours


def test_solids_of_some_links_are_the_askers_own() -> None:
    robot = toy_robot({**BASE, **PALM, **FINGERS})
    assert [s.name for s in link_solids(robot)] == ["base", "palm", "left", "right"]
    some = link_solids(robot, {"right", "palm"})
    assert [s.name for s in some] == ["palm", "right"]
    assert some[0] is not link_solids(robot)[1]
