"""Where what keeps the target in is not got to: no long search, and the reason in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from looking_ahead import IN_ORDER, asked, no_proof
from written_world import WrittenWorld, at_first

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Scene
from kinematics.shapes import Cylinder
from kinematics.transforms import transform
from planning.motion.pick_place import Motions
from planning.policies.hopeless import why_hopeless
from planning.policies.lookahead import Lookahead
from planning.policies.search import Effort

ATTEMPTS = Effort(attempts=9, last=16)


def never(*names: str) -> Callable[[str, Mapping[str, int]], bool]:
    """The arm gets to all but some."""
    return lambda name, regions: name not in names


def world_of(names: str, ways: Mapping[str, list[str]], **more: object) -> WrittenWorld:
    """A world whose thorough look knows no other ways than the quick one."""
    return WrittenWorld(names, at_first(ways), finer=at_first(ways), **more)  # type: ignore[arg-type]


def why(world: WrittenWorld) -> str | None:
    return why_hopeless((world.thorough, world.varied), world.state)


def test_what_the_arm_does_not_get_to_though_it_stands_alone_keeps_the_target_in() -> None:
    world = world_of("ab", {"t": ["ab"], "a": [""], "b": [""]}, reached=never("a"))
    assert why(world) == "no way was found for the arm to get to a even if nothing else but t stood there"


def test_there_is_hope_where_the_arm_gets_to_it_once_others_are_gone() -> None:
    world = world_of("ab", {"t": ["a"], "a": [""], "b": [""]}, reached=lambda name, regions: name != "a" or "b" not in regions)
    assert why(world) is None


def test_there_is_hope_where_another_way_to_the_target_is_blocked_by_what_is_got_to() -> None:
    world = world_of("ab", {"t": ["a", "b"], "a": [""], "b": [""]}, reached=never("a"))
    assert why(world) is None


def test_those_are_named_that_keep_it_in_alone() -> None:
    """Of several that the arm does not get to; where none does it alone, all of them."""
    ways = {"a": [""], "b": [""], "c": [""]}
    alone = world_of("cba", {"t": ["ab", "ac"], **ways}, reached=never("a", "b", "c"))
    assert why(alone) == "no way was found for the arm to get to a even if nothing else but t stood there"
    each = world_of("cba", {"t": ["cab"], **ways}, reached=never("a", "b", "c"))
    assert why(each) == "no way was found for the arm to get to a or to b or to c even if nothing else but t stood there"
    together = world_of("cba", {"t": ["a", "c", "b"], **ways}, reached=never("a", "b", "c"))
    assert why(together) == "no way was found for the arm to get to a or to b or to c even if nothing else but t stood there"


def test_what_is_behind_something_that_stays_stays_too() -> None:
    """b would be got to, were it not for a, which blocks one way to the target, as b does the other: none of them does it alone."""
    world = world_of("ab", {"t": ["a", "b"], "a": [""], "b": ["a"]}, reached=never("a"))
    assert why(world) == "no way was found for the arm to get to a or to b even if nothing else but t stood there"


def test_a_target_that_is_not_got_to_alone_is_what_the_reason_says() -> None:
    world = world_of("a", {"t": ["a"], "a": [""]}, reached=never("t"))
    assert why(world) == "no way was found for the arm to get to t even if nothing else stood there"


def test_one_look_that_gets_to_it_is_enough() -> None:
    world = world_of("a", {"t": ["a"], "a": [""]}, reached=never("a"))
    assert why_hopeless((world, replace(world, reached=never())), world.state) is None


@pytest.mark.parametrize("unseen", [False, True])
def test_no_slower_look_is_taken_where_there_is_no_hope_but_where_unseen_space_may_be_why(unseen: bool) -> None:
    ways = {"t": ["a"], "a": [""]}
    world = world_of("a", ways, reached=never("a"), seen=at_first(ways) if unseen else None)
    policy = Lookahead(world, IN_ORDER, ATTEMPTS, no_proof, most=5)
    asked(policy, world)
    quickly = [choice for choice in world.tried if choice[0] == "a"]
    assert len(quickly) <= 1 or unseen  # the first attempt tells the search that a is out of reach
    assert (policy.outlook.undecided is None) == unseen


def test_no_search_follows_where_an_exhaustive_look_alone_holds_out_hope_and_the_arm_does_not_get_there() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": []}), finest=at_first({"t": ["a"], "a": [""]}), reached=never("a"))
    policy = Lookahead(world, IN_ORDER, ATTEMPTS, no_proof, most=5)
    assert asked(policy, world) == []
    assert world.tried == []
    assert policy.outlook.undecided is not None


@pytest.mark.parametrize(("x_m", "gets_to"), [(0.85, False), (0.5, True)])
def test_in_a_low_cabinet_close_before_the_arm_hands_deep_inside_stand_where_no_path_leads(ur5e: Robot, x_m: float, gets_to: bool) -> None:
    cabinet = Cabinet(np.array([0.67, 0.9, 0.4]), transform(p=[0.3, 0.0, 0.1]), 0.03)
    can, target = (
        Body(name, Cylinder(0.031, 0.094), transform(p=[x, y, 0.147])) for name, x, y in (("can", x_m, 0.106), ("target", 0.69, -0.29))
    )
    scene = Scene("low", to_ref(ur5e), cabinet, (can, target), "target", None)
    motions = Motions(ur5e, scene)
    state = motions.start()
    assert motions.picks(state, "can")[0]
    assert motions.gets_to(state, "can", np.random.default_rng(0)) == gets_to
