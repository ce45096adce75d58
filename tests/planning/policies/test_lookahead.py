"""The policies that look ahead: what they hand out, guess and prove, in worlds in which every answer is written down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from looking_ahead import IN_ORDER, SOME, asked, look, no_proof, proved
from written_world import WrittenWorld, at_first

from kinematics.scene import State
from perception.observation import observe
from planning.plan import Outlook
from planning.policies.lookahead import NEAREST, VARIED_SHARE, Lookahead
from planning.policies.search import Effort, Preferences
from planning.policies.unsolvable import Finding


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
    expensive = Preferences(lambda seen: {"a": 2.0, "b": 1.0, "c": 0.0}.__getitem__, IN_ORDER.regions)
    assert [name for name, _ in asked(Lookahead(world, expensive, SOME, no_proof, most=5), world)] == [*"b" * 12, *"a" * 12]
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
    """As the exhaustive look: with all attempts, and of a last search only what is made with picks unlike one another."""
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
    assert len(world.tried) == 9 + round(VARIED_SHARE * 16)


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


def test_moves_that_were_made_are_no_longer_left() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    policy = look(world, most=2)
    assert len(asked(policy, world)) == 1
    world.state = world.start()  # it came about that nothing changed, and two moves are needed still
    assert asked(policy, world) == []


def test_what_is_too_many_moves_for_quick_grasps_may_be_fewer_for_many() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}), finer=at_first({"t": ["b"], "a": [""], "b": [""]}))
    assert [name for name, _ in asked(look(world, most=1), world)] == ["b"]


def test_with_moves_to_come_nothing_is_guessed_though_there_is_unseen_space() -> None:
    ways = at_first({"t": ["a"], "a": [""], "b": [""]})
    world = WrittenWorld("ab", ways, seen=ways)
    assert asked(look(world), world) == [("a", 0)]


def test_preferences_of_the_shipped_policies_name_every_object() -> None:
    world = WrittenWorld("ab", at_first({}))
    seen = observe(world.scene, world.state)
    assert [NEAREST.objects(seen)(name) for name in seen.movable] == [0.0, 0.0]
