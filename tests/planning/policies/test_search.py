"""The search for moves, in worlds in which every answer is written down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from fakes import observation
from looking_ahead import IN_ORDER, SOME, rng
from written_world import WrittenWorld, at_first

from kinematics.scene import Cabinet, State
from kinematics.transforms import transform
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Choice
from planning.plan import Blocked
from planning.policies.regions import nearest_regions
from planning.policies.search import Effort, Preferences, Search


def solve(world: WrittenWorld, *, most: int = 5, effort: Effort = SOME, preferences: Preferences = IN_ORDER) -> list[Choice]:
    """The moves that a search finds, having been carried out: the target can be taken after them."""
    state = world.start()
    steps = Search(world, preferences, effort, most, rng()).run(state)
    for step in steps:
        done = world.relocate(state, *step.choice, rng())
        assert isinstance(done, Done)
        state = done.after
    assert not steps or isinstance(world.retrieve_target(state, rng()), Done)
    return [step.choice for step in steps]


def test_a_chain_of_blockers_is_undone_from_its_end() -> None:
    moves = solve(WrittenWorld("abc", at_first({"t": ["a"], "a": ["b"], "b": [""], "c": [""]})))
    assert [name for name, _ in moves] == ["b", "a"]


def test_no_more_moves_are_made_than_the_relaxed_plan_has() -> None:
    world = WrittenWorld("abcxy", at_first({"t": ["a", "xy"], "a": ["b"], "b": ["c"], "c": [""], "x": [""], "y": [""]}))
    assert sorted(name for name, _ in solve(world)) == ["x", "y"]


def test_an_object_is_not_put_where_it_is_in_the_way_again() -> None:
    def blocking(name: str, regions: Mapping[str, int]) -> Sequence[str]:
        return ["a" if regions["a"] < 10 else ""] if name == "t" else [""]

    world = WrittenWorld("a", blocking)
    assert solve(world) == [("a", 10)]
    assert world.tried[0] == ("a", 10)  # all others are not even tried


def test_roomy_places_come_first_for_some_tries() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), tight=lambda choice: choice[1] < 3)
    assert solve(world) == [("a", 3)]
    assert world.tried[:4] == [("a", region) for region in range(4)]


def test_where_all_places_are_tight_the_first_will_do() -> None:
    """After so many tries as a search is choosy; a search that is not takes it at once."""
    for choosy in (0, 2, 4):
        world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), tight=lambda choice: True)
        assert solve(world, effort=replace(SOME, choosy=choosy)) == [("a", 0)]
        assert len(set(world.tried)) == 1 + choosy


def test_a_search_is_choosy_for_four_tries_unless_told_otherwise() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), tight=lambda choice: choice[1] < 7)
    assert solve(world, effort=Effort(attempts=200)) == [("a", 0)]
    assert set(world.tried) == {("a", region) for region in range(5)}


def test_a_tight_place_is_better_than_one_more_move() -> None:
    """Moves keep their number: where a can be put into no roomy place, it is not b that goes as well."""
    world = WrittenWorld("ab", at_first({"t": ["a", "b"], "a": [""], "b": ["a"]}), tight=lambda choice: choice[0] == "a")
    assert len(solve(world)) == 1


def test_tight_places_that_were_found_are_used_though_the_attempts_are_used_up() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), tight=lambda choice: True)
    assert solve(world, effort=Effort(attempts=1)) == [("a", 0)]


def test_where_the_arm_does_not_get_to_a_target_that_is_laid_free_the_search_goes_on_from_there() -> None:
    """b must go, too, and can't before a has gone."""
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": [""], "b": ["a"]}))
    world.reached = lambda name, regions: name != "t" or regions["b"] != -1
    assert [name for name, _ in solve(world)] == ["a", "b"]


def test_what_must_be_moved_twice_is() -> None:
    """a can't go far at once; where it goes first it is in the way still."""

    def blocking(name: str, regions: Mapping[str, int]) -> Sequence[str]:
        return ["a" if regions["a"] != 15 else ""] if name == "t" else [""]

    class Stepwise(WrittenWorld):
        def relocate(self, state: State, name: str, region: int, rng: np.random.Generator) -> object:  # type: ignore[override]
            if region == 15 and self.regions_of(state.poses)["a"] != 3:
                self.can = lambda choice: False
            done = super().relocate(state, name, region, rng)
            self.can = lambda choice: True
            return done

    assert solve(Stepwise("a", blocking)) == [("a", 3), ("a", 15)]


def test_where_the_arm_does_not_get_to_an_object_another_goes_first() -> None:
    ways = {"t": ["a"], "a": [""], "b": [""]}
    world = WrittenWorld("ab", at_first(ways), reached=lambda name, regions: name != "a" or regions["b"] != -1)
    moves = solve(world)
    assert [name for name, _ in moves] == ["b", "a"]
    assert sum(name == "a" for name, _ in world.tried) <= 3  # another region would not have helped


def test_where_the_arm_does_not_get_to_the_target_something_is_moved_out_of_its_way() -> None:
    world = WrittenWorld("ab", at_first({"t": [""], "a": [""], "b": [""]}), reached=lambda name, regions: name != "t" or regions["b"] != -1)
    assert [name for name, _ in solve(world)] == ["b"]


def test_fifty_failed_moves_weigh_as_much_as_one_more() -> None:
    assert 1 / SOME.step_back == 50


def test_every_object_that_can_be_picked_may_make_room_the_cheapest_first() -> None:
    """Nothing is statically in the way, and yet the arm does not get to the target: all others are tried in turn, to every region; d can't
    be picked."""
    world = WrittenWorld("abcd", at_first({"t": [""], "a": [""], "b": [""], "c": [""], "d": ["a"]}), can=lambda choice: False)
    world.reached = lambda name, regions: name != "t"
    costs = Preferences(lambda seen: {"a": 2.0, "b": 1.0, "c": 3.0, "d": 0.0}.__getitem__, IN_ORDER.regions)
    assert solve(world, preferences=costs) == []
    assert world.tried == [(name, region) for region in range(16) for name in "bac"]


def test_what_can_go_first_in_a_plan_makes_room_before_all_others() -> None:
    """Where the plan's first object finds no place at which the plan gets on, it still goes anywhere before others, though it is costly."""

    def blocking(name: str, regions: Mapping[str, int]) -> Sequence[str]:
        return ["b"] if name == "t" else [""]

    expensive = Preferences(lambda seen: {"a": 0.0, "b": 1.0}.__getitem__, IN_ORDER.regions)
    world = WrittenWorld("ab", blocking, can=lambda choice: False)
    assert solve(world, preferences=expensive) == []
    assert world.tried == [(name, region) for region in range(16) for name in "ba"]


def test_what_the_arm_does_not_get_to_is_no_detour() -> None:
    """Nor is it asked about again; what is out of reach is found out by one failure."""
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": [""], "b": [""]}), can=lambda choice: False)
    world.reached = lambda name, regions: name != "a"
    assert solve(world) == []
    assert world.tried == [("a", 0), *(("b", region) for region in range(16))]


def test_where_nothing_else_can_go_first_the_search_ends() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), reached=lambda name, regions: name != "a")
    assert solve(world) == []
    assert world.tried == [("a", 0)]


def test_a_detour_counts_as_a_move() -> None:
    """With one move left, b can't make room for a, which the arm does not get to: only a is tried, and once."""
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": [""], "b": [""]}), reached=lambda name, regions: name != "a")
    assert solve(world, most=1) == []
    assert world.tried == [("a", 0)]


def test_the_target_is_only_tried_where_its_relaxed_plan_is_empty() -> None:
    looks: list[dict[str, int]] = []

    class Watched(WrittenWorld):
        def retrieve_target(self, state: State, rng: np.random.Generator) -> Done | Blocked:
            looks.append(self.regions_of(state.poses))
            return super().retrieve_target(state, rng)

    world = Watched("ab", at_first({"t": ["a"], "a": ["b"], "b": [""]}))
    assert Search(world, IN_ORDER, SOME, 5, rng()).run(world.start())
    assert len(looks) == 1
    assert -1 not in looks[0].values()  # both were moved


@pytest.mark.parametrize(("most", "found"), [(2, True), (1, False)])
def test_no_search_goes_beyond_the_moves_that_are_left(most: int, found: bool) -> None:
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": ["b"], "b": [""]}))
    assert bool(solve(world, most=most)) == found
    assert found or not world.tried


def test_a_search_ends_with_its_attempts() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), can=lambda choice: False)
    assert solve(world, effort=Effort(attempts=7)) == []
    assert len(world.tried) == 7


def test_cheap_objects_and_good_regions_are_tried_first() -> None:
    ways = {"t": ["a", "b"], "a": [""], "b": [""]}
    backwards = Preferences(lambda seen: {"a": 1.0, "b": 0.5}.__getitem__, lambda seen, name, rng: [12, 3])
    assert solve(WrittenWorld("ab", at_first(ways)), preferences=backwards) == [("b", 12)]


def test_a_state_whose_moves_fail_steps_back_behind_those_that_look_as_good() -> None:
    """Only first moves can be made. A deeper state is preferred as long as it ranks the same; each move that is tried costs it a little."""
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    world.can = lambda choice: set(world.regions_of(world.state.poses).values()) == {-1}
    assert solve(world, effort=Effort(attempts=9)) == []
    assert world.tried == [("a", 0), ("b", 0), ("b", 1), ("b", 0), ("a", 0), ("a", 1), ("b", 2), ("a", 2), ("a", 1)]


def test_nearest_regions_are_in_front_and_of_those_as_near_the_first() -> None:
    """169 regions on a grid around the object, its coordinates exact in binary, so that many are equally near."""
    grid = [(i / 8, k / 8) for i in range(-6, 7) for k in range(-6, 7)]
    seen = observation({"a": [0.125, 0.25, 0.5, 0.01, 0.01, 0.01]})
    seen = replace(
        seen,
        cabinet=Cabinet(np.array([2.0, 2.0, 1.0]), transform(p=[-1.0, 0.0, 0.0]), 0.03),
        regions=np.array([[x, y, 0.0, float((x, y) != (0, 0.125))] for x, y in grid]),
    )
    in_order = sorted(range(len(grid)), key=lambda i: ((grid[i][0] - 0.125) ** 2 + (grid[i][1] - 0.25) ** 2, i))
    assert nearest_regions(seen, "a", rng()) == [i for i in in_order if grid[i] != (0, 0.125)]
