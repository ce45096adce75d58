"""The search for moves and the policies that look ahead, in worlds in which every answer is written down."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from fakes import observation
from written_world import WrittenWorld, at_first

from kinematics.scene import Cabinet, State
from kinematics.transforms import transform
from perception.observation import Observation, observe
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Choice
from planning.plan import Blocked, Outlook, Unsolvable
from planning.policies.lookahead import NEAREST, Lookahead
from planning.policies.regions import nearest_regions
from planning.policies.search import Effort, Preferences, Search
from planning.policies.unsolvable import Finding

SOME = Effort(attempts=200)
IN_ORDER = Preferences(lambda seen: lambda name: 0.0, lambda seen, name, rng: range(len(seen.regions)))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


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
    """Where the plan's first object finds no place at which the plan gets on, it still goes anywhere before others, though it is dear."""

    def blocking(name: str, regions: Mapping[str, int]) -> Sequence[str]:
        return ["b"] if name == "t" else [""]

    dear = Preferences(lambda seen: {"a": 0.0, "b": 1.0}.__getitem__, IN_ORDER.regions)
    world = WrittenWorld("ab", blocking, can=lambda choice: False)
    assert solve(world, preferences=dear) == []
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


def proved(state: State) -> Finding:
    return Finding(Unsolvable(("a", "b"), ("another grasp of t",)))


def no_proof(state: State) -> Finding:
    return Finding()


def look(world: WrittenWorld, **more: object) -> Lookahead:
    return Lookahead(world, IN_ORDER, SOME, **{"prove": no_proof, "most": 5, **more})  # type: ignore[arg-type]


def asked(policy: Lookahead, world: WrittenWorld) -> list[Choice]:
    """All that a policy proposes in the world's state."""
    seen: Observation = observe(world.scene, world.state)
    return [(name, region) for name in policy.select(seen, rng()) for region in policy.place(seen, name, rng())]


def test_moves_that_were_found_are_handed_out_one_by_one() -> None:
    world = WrittenWorld("abc", at_first({"t": ["a"], "a": ["b"], "b": [""], "c": [""]}))
    policy = look(world)
    first = asked(policy, world)
    assert [name for name, _ in first] == ["b"]
    assert policy.outlook.least_moves == 2
    searched = len(world.tried)
    foreseen = policy._coming[0].after
    world.state = foreseen
    assert [name for name, _ in asked(policy, world)] == ["a"]
    assert len(world.tried) == searched  # nothing was sought again


def test_the_next_move_that_was_found_is_certain_and_no_other() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    policy = look(world)
    assert not policy.certain("a", 0)
    ((name, region),) = asked(policy, world)
    assert policy.certain(name, region)
    assert not policy.certain(name, region + 1)
    assert not policy.certain("ab".replace(name, ""), region)


def test_a_state_that_was_not_foreseen_is_thought_about_anew() -> None:
    world = WrittenWorld("abc", at_first({"t": ["a"], "a": ["b"], "b": [""], "c": [""]}))
    policy = look(world)
    asked(policy, world)
    world.state = world.start()
    assert [name for name, _ in asked(policy, world)] == ["b"]
    assert policy.outlook.least_moves == 2  # of the first state


def test_where_unseen_space_is_in_every_way_that_is_proposed_which_would_help_if_it_were_free() -> None:
    """What stops the attempts says where to look next; c would not help, and where everything was seen, nothing is proposed."""
    stuck = at_first({"t": ["ab"], "a": ["b"], "b": ["a"], "c": [""]})
    assert asked(look(WrittenWorld("abc", stuck)), WrittenWorld("abc", stuck)) == []
    world = WrittenWorld("abc", stuck, seen=at_first({"t": ["ab"], "a": [""], "b": [""], "c": [""]}))
    assert [name for name, _ in asked(look(world), world)] == [*"a" * 12, *"b" * 12]
    dear = Preferences(lambda seen: {"a": 2.0, "b": 1.0, "c": 0.0}.__getitem__, IN_ORDER.regions)
    assert [name for name, _ in asked(Lookahead(world, dear, SOME, no_proof, most=5), world)] == [*"b" * 12, *"a" * 12]
    one_first = WrittenWorld("abc", stuck, seen=at_first({"t": ["a"], "a": ["b"], "b": [""], "c": [""]}))
    assert {name for name, _ in asked(look(one_first), one_first)} == {"b"}


def test_what_is_guessed_is_put_where_the_way_gets_shorter() -> None:
    def seen(name: str, regions: Mapping[str, int]) -> Sequence[str]:
        return ["a" if regions["a"] < 10 else ""] if name == "t" else [""]

    world = WrittenWorld("a", at_first({"t": [], "a": []}), seen=seen)
    assert asked(look(world), world) == [("a", region) for region in range(10, 16)]


def test_nothing_is_guessed_where_free_space_would_not_help_but_hands_between_others_are_sought() -> None:
    """A look at the hands that a proof is missed by takes its time, and is not worth it where unseen space is why there is no hope."""
    stuck, asked_for = at_first({"t": ["a"], "a": ["b"], "b": ["a"]}), list[State]()

    def prove(state: State) -> Finding:
        asked_for.append(state)
        return Finding(hope=WrittenWorld("ab", at_first({"t": ["a"], "a": ["b"], "b": [""]})))  # type: ignore[arg-type]

    world = WrittenWorld("ab", stuck, seen=stuck)
    assert asked(look(world), world) == []
    assert [name for name, _ in asked(look(world, prove=prove), world)] == ["b"]
    assert len(asked_for) == 1
    world.seen = at_first({"t": ["a"], "a": [""], "b": [""]})
    assert {name for name, _ in asked(look(world, prove=prove), world)} == {"a"}
    assert len(asked_for) == 1


def test_where_the_quick_look_finds_no_way_a_thorough_one_does() -> None:
    stuck = at_first({"t": ["a"], "a": ["b"], "b": ["a"]})
    world = WrittenWorld("ab", stuck, finer=at_first({"t": ["a"], "a": ["b"], "b": ["a", ""]}))
    assert [name for name, _ in asked(look(world, prove=proved), world)] == ["b"]


def test_where_a_thorough_look_finds_no_hope_either_an_exhaustive_one_does() -> None:
    """It is the last, so what it does not find is proved."""
    stuck = at_first({"t": ["a"], "a": ["b"], "b": ["a"]})
    world = WrittenWorld("ab", stuck, finest=at_first({"t": ["a"], "a": ["b"], "b": ["a", ""]}))
    policy = look(world, prove=proved)
    assert [name for name, _ in asked(policy, world)] == ["b"]
    assert policy.outlook.unsolvable is None


def test_an_exhaustive_look_is_not_taken_where_a_way_is_known_that_motions_do_not_find() -> None:
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": [""], "b": [""]}), can=lambda choice: False)
    world.finest = at_first({"t": [""], "a": [""], "b": [""]})
    policy = look(world, prove=proved)
    assert asked(policy, world) == []
    assert policy.outlook.least_moves == 1


def test_both_looks_share_the_attempts_and_the_thorough_one_has_a_third_at_least() -> None:
    """Nothing can be moved: the quick look may use two thirds, and where it has nothing to try, the thorough one has all."""
    both = at_first({"t": ["ab"], "a": [""], "b": [""]})
    for quick, finer, tried in ((both, both, 9), (at_first({"t": ["ab"], "a": ["b"], "b": ["a"]}), both, 9)):
        world = WrittenWorld("ab", quick, can=lambda choice: False, finer=finer)
        policy = Lookahead(world, IN_ORDER, Effort(attempts=9), no_proof, most=5)
        assert asked(policy, world) == []
        assert len(world.tried) == tried
    few = WrittenWorld(
        "ab", both, can=lambda choice: choice == ("a", 2) and len(few.tried) > 6, finer=at_first({"t": ["a"], "a": [""], "b": ["a"]})
    )
    policy = Lookahead(few, IN_ORDER, Effort(attempts=9), no_proof, most=5)
    assert [name for name, _ in asked(policy, few)][:1] == ["a"]
    assert few.tried[-1] == ("a", 2)


def test_a_proof_ends_it_and_is_remembered() -> None:
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": ["b"], "b": ["a"]}))
    policy = look(world, prove=proved)
    assert asked(policy, world) == []
    assert policy.outlook.unsolvable == proved(world.state).unsolvable
    assert not world.tried


def test_what_is_proved_of_objects_that_were_moved_is_no_proof_for_the_scene() -> None:
    wherever = {"t": ["a"], "a": ["b"], "b": ["a"], "c": [""]}
    world = WrittenWorld("abc", lambda name, regions: wherever[name])
    for moved, is_proof in (("c", True), ("a", False)):
        world.state = world.start()
        policy = look(world, prove=no_proof)
        assert asked(policy, world) == []
        poses = world.state.poses
        world.state = State(world.state.q, {**poses, moved: world.place_pose(moved, poses[moved], 2)})
        policy.prove = proved
        asked(policy, world)
        assert (policy.outlook.unsolvable is not None) == is_proof
        if not is_proof:
            assert policy.outlook.undecided == f"{proved(world.state).unsolvable.words}, where they stand after moves"  # type: ignore[union-attr]


def test_hands_that_a_proof_was_missed_by_are_searched_with() -> None:
    """As the exhaustive look: with all attempts, and no last search."""
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": ["b"], "b": ["a"]}))
    with_hand = WrittenWorld("ab", at_first({"t": ["a"], "a": ["b"], "b": [""]}), tried=world.tried)
    policy = look(world, prove=lambda state: Finding(hope=with_hand))  # type: ignore[arg-type]
    assert [name for name, _ in asked(policy, world)] == ["b"]
    assert policy.outlook == Outlook(least_moves=2)
    with_hand.can = lambda choice: False
    world.tried.clear()
    patient = Effort(attempts=9, last=16)
    policy = Lookahead(world, IN_ORDER, patient, lambda state: Finding(hope=with_hand), most=5)  # type: ignore[arg-type]
    assert asked(policy, world) == []
    assert len(world.tried) == 9


def test_hands_that_a_proof_was_missed_by_may_leave_too_many_moves() -> None:
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": ["b"], "b": ["a"]}))
    with_hand = WrittenWorld("ab", at_first({"t": ["a"], "a": ["b"], "b": [""]}), tried=world.tried)
    policy = look(world, prove=lambda state: Finding(hope=with_hand), most=1)  # type: ignore[arg-type]
    assert asked(policy, world) == []
    assert (policy.outlook.least_moves, world.tried) == (2, [])


def test_why_nothing_is_known_is_told() -> None:
    world = WrittenWorld("ab", at_first({"t": ["a"], "a": ["b"], "b": ["a"]}))
    policy = look(world, prove=lambda state: Finding(undecided="too narrow"))
    assert asked(policy, world) == []
    assert policy.outlook == Outlook(undecided="too narrow")


def test_too_many_moves_are_not_begun() -> None:
    world = WrittenWorld("abc", at_first({"t": ["a"], "a": ["b"], "b": ["c"], "c": [""]}))
    policy = look(world, most=2)
    assert asked(policy, world) == []
    assert (policy.outlook.least_moves, world.tried) == (3, [])


def test_a_glance_proposes_what_alone_is_in_the_way_where_it_is_not_and_tries_nothing() -> None:
    def blocking(name: str, regions: Mapping[str, int]) -> Sequence[str]:
        return ["a" if regions["a"] < 14 else "", "bc"] if name == "t" else [""]

    world = WrittenWorld("abc", blocking)
    policy = look(world, glance=True)
    seen = observe(world.scene, world.state)
    names = policy.select(seen, rng())
    name = next(iter(names))
    assert (name, list(policy.place(seen, name, rng()))) == ("a", [14, 15])
    assert not world.tried
    assert policy.outlook.least_moves == 1
    assert [(n, r) for n in names for r in policy.place(seen, n, rng())] == [("a", 14)]  # what a search finds comes last
    assert world.tried


def test_a_glance_proposes_the_cheapest_first() -> None:
    """Each of two objects blocks a way by itself; of those that cost the same the first by name."""
    for costs, order in (({"a": 2.0, "b": 1.0}, ["b", "a"]), ({"a": 1.0, "b": 2.0}, ["a", "b"]), ({"a": 1.0, "b": 1.0}, ["a", "b"])):
        world = WrittenWorld("ab", at_first({"t": ["b", "a"], "a": [""], "b": [""]}))
        preferences = Preferences(lambda seen, costs=costs: costs.__getitem__, IN_ORDER.regions)  # type: ignore[misc]
        policy = Lookahead(world, preferences, SOME, no_proof, most=5, glance=True)
        names = policy.select(observe(world.scene, world.state), rng())
        assert [next(names), next(names)] == order
        assert not world.tried


def test_a_glance_is_not_repeated_where_nothing_changed() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}))
    policy = look(world, glance=True)
    seen = observe(world.scene, world.state)
    next(iter(policy.select(seen, rng())))
    assert not world.tried
    assert asked(policy, world) == [("a", 0)]
    assert world.tried == [("a", 0)]


def test_a_glance_proposes_the_twelve_best_regions() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}))
    policy, seen = look(world, glance=True), observe(world.scene, world.state)
    assert next(iter(policy.select(seen, rng()))) == "a"
    assert list(policy.place(seen, "a", rng())) == list(range(12))


def test_what_was_foreseen_needs_no_glance() -> None:
    """After the first of two moves the other blocker is alone in the way; it goes where the search put it."""
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    policy = look(world, glance=True)
    asked(policy, world)
    world.state, foreseen = policy._coming[0].after, policy._coming[1].choice
    assert asked(policy, world) == [foreseen]


def test_moves_that_were_made_are_no_longer_left() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    policy = look(world, most=2)
    assert len(asked(policy, world)) == 1
    world.state = world.start()  # it came about that nothing changed, and two moves are needed still
    assert asked(policy, world) == []


def test_two_blockers_are_not_for_a_glance() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    first = asked(look(world, glance=True), world)
    assert len(first) == 1
    assert world.tried
    stuck = WrittenWorld("ab", at_first({"t": ["ab"], "a": ["b"], "b": ["a"]}))
    policy = look(stuck, glance=True)
    assert asked(policy, stuck) == []
    assert policy.outlook.least_moves is None  # one would be too few, and no number would do


@pytest.mark.parametrize(("attempts", "quickly"), [(9, 6), (10, 7), (11, 7)])
def test_the_quick_look_has_two_thirds_of_the_attempts(attempts: int, quickly: int) -> None:
    """Rounded. Nothing can be moved. Quickly sampled grasps know a way that b blocks, many more one that a blocks."""
    world = WrittenWorld("ab", at_first({"t": ["b"], "a": ["b"], "b": [""]}), lambda choice: False)
    world.finer = at_first({"t": ["a"], "a": [""], "b": ["a"]})
    assert asked(Lookahead(world, IN_ORDER, Effort(attempts=attempts), no_proof, most=5), world) == []
    assert [name for name, _ in world.tried] == [*"b" * quickly, *"a" * (attempts - quickly)]


def test_an_exhaustive_look_has_all_the_attempts_and_no_more() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": []}), can=lambda choice: False, finest=at_first({"t": ["a"], "a": [""]}))
    assert asked(Lookahead(world, IN_ORDER, Effort(attempts=9), no_proof, most=5), world) == []
    assert world.tried == [("a", region) for region in range(9)]


NEAR_AND_LIKELY = replace(IN_ORDER, regions=lambda seen, name, rng: range(15, -1, -1), nearby=IN_ORDER.regions)


def test_where_near_places_have_not_done_the_likeliest_get_half_as_many_attempts_more() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), can=lambda choice: False)
    policy = Lookahead(world, NEAR_AND_LIKELY, Effort(attempts=9), no_proof, most=5)
    assert asked(policy, world) == []
    assert [region for _, region in world.tried] == [0, 1, 2, 3, 4, 5, 0, 1, 2, 15, 14, 13, 12]
    world.can, world.tried[:] = lambda choice: choice[1] == 12, []
    assert asked(Lookahead(world, NEAR_AND_LIKELY, Effort(attempts=9), no_proof, most=1), world) == [("a", 12)]


def test_the_likeliest_places_are_tried_by_the_look_that_held_out_hope() -> None:
    """Only the exhaustive one knows how a can be picked, and a goes nowhere but to region 12."""
    can_go = at_first({"t": ["a"], "a": [""]})
    world = WrittenWorld("a", at_first({"t": ["a"], "a": []}), can=lambda choice: choice[1] == 12, finest=can_go)
    assert asked(Lookahead(world, NEAR_AND_LIKELY, Effort(attempts=9), no_proof, most=1), world) == [("a", 12)]


def test_at_last_all_free_regions_are_tried_if_so_many_attempts_are_left() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), can=lambda choice: False)
    patient = Effort(attempts=9, last=16)
    assert asked(Lookahead(world, NEAR_AND_LIKELY, patient, no_proof, most=1), world) == []
    at_last = [region for _, region in world.tried[6 + 3 + 4 :]]
    assert len(at_last) == len(set(at_last)) == 14  # but the two where a and the target stand
    world.can, world.tried[:] = lambda choice: choice[1] == 9, []  # neither among the first six nor the last four
    assert asked(Lookahead(world, NEAR_AND_LIKELY, patient, no_proof, most=1), world) == [("a", 9)]


@pytest.mark.parametrize("seed", [1, 2])
def test_the_ceiling_tries_places_at_last_that_are_not_the_nearest(seed: int) -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), can=lambda choice: False)
    policy, seen = Lookahead(world, NEAREST, Effort(attempts=8, last=14), no_proof, most=1), observe(world.scene, world.state)
    list(policy.select(seen, np.random.default_rng(seed)))
    tried = [region for _, region in world.tried]
    nearest, at_last = tried[:-14], tried[-14:]
    assert set(nearest) <= set(at_last)
    assert len(set(at_last)) == 14
    assert at_last[: len(nearest)] != nearest


def test_where_space_is_unseen_a_look_is_better_than_the_last_search() -> None:
    ways = at_first({"t": ["a"], "a": [""]})
    world = WrittenWorld("a", ways, can=lambda choice: False, seen=ways)
    asked(Lookahead(world, NEAR_AND_LIKELY, Effort(attempts=9, last=16), no_proof, most=1), world)
    assert len(world.tried) == 6 + 3 + 4


def test_where_only_the_exhaustive_look_holds_out_hope_there_is_no_last_search() -> None:
    can_go = at_first({"t": ["a"], "a": [""]})
    world = WrittenWorld("a", at_first({"t": ["a"], "a": []}), can=lambda choice: False, finest=can_go)
    asked(Lookahead(world, NEAR_AND_LIKELY, Effort(attempts=9, last=16), no_proof, most=1), world)
    assert len(world.tried) == 9 + 4


def test_with_no_other_order_of_regions_nothing_is_tried_once_more() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), can=lambda choice: False)
    assert asked(Lookahead(world, IN_ORDER, Effort(attempts=9), no_proof, most=5), world) == []
    assert len(world.tried) == 9


def test_likelier_places_do_not_make_a_plan_shorter() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    assert asked(Lookahead(world, NEAR_AND_LIKELY, SOME, no_proof, most=1), world) == []
    assert not world.tried


def test_what_is_too_many_moves_for_quick_grasps_may_be_fewer_for_many() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}), finer=at_first({"t": ["b"], "a": [""], "b": [""]}))
    assert [name for name, _ in asked(look(world, most=1), world)] == ["b"]


def test_with_moves_to_come_nothing_is_guessed_though_there_is_unseen_space() -> None:
    ways = at_first({"t": ["a"], "a": [""], "b": [""]})
    world = WrittenWorld("ab", ways, seen=ways)
    assert asked(look(world), world) == [("a", 0)]


def test_a_glance_asks_roughly() -> None:
    """Roughly only a is in the way, and where it is put in regions 14 and 15 not even roughly; to be exact b is, too."""
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    world.rough = lambda name, regions: ["a" if regions["a"] < 14 else ""]
    policy, seen = look(world, glance=True), observe(world.scene, world.state)
    assert next(iter(policy.select(seen, rng()))) == "a"
    assert list(policy.place(seen, "a", rng())) == [14, 15]
    assert not world.tried


def test_what_stands_alone_in_the_way_is_proposed_whatever_it_costs() -> None:
    """So no network is asked about objects at a glance."""

    def costs(seen: Observation) -> Callable[[str], float]:
        raise AssertionError("nobody is to ask")

    world = WrittenWorld("ab", at_first({"t": ["a"], "a": [""], "b": [""]}))
    policy = Lookahead(world, replace(IN_ORDER, objects=costs), SOME, no_proof, most=5, glance=True)
    assert next(iter(policy.select(observe(world.scene, world.state), rng()))) == "a"


def test_preferences_of_the_shipped_policies_name_every_object() -> None:
    world = WrittenWorld("ab", at_first({}))
    seen = observe(world.scene, world.state)
    assert [NEAREST.objects(seen)(name) for name in seen.movable] == [0.0, 0.0]
