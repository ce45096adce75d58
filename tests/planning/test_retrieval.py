"""The retrieval loop in a world where every answer is known by hand: the three rules, the limit, failed pairs, the return, travel, times.

Cells: the cabinet of `fakes.scene_of` is 0.4 × 0.4 m with 4 × 4 regions, so that region 4 i + j has its centre at
(0.05 + 0.1 i, −0.15 + 0.1 j).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fakes import BASE, HEIGHT_M, Choice, Clock, FakeMotions, motion, scene_of, stick

from kinematics.transforms import Array, rotation_about, transform
from perception.observation import Observation
from planning import conclusion, stopwatch
from planning.conclusion import conclude, failed, hand_travel, hand_travels, objective, relocating
from planning.plan import Blocked, Fault, Move, Outlook, Plan, Unsolvable
from planning.retrieval import Policy, proposals, retrieve
from planning.rules import MAX_MOVES, Rule
from planning.stopwatch import Stopwatch
from planning.verdict import Settings, Verdict
from retrieve_cli.commands import options

NEVER = frozenset({("never", 0)})


def ordered(**regions: Sequence[int]) -> Policy:
    """Objects and regions always in the order that is written down."""
    return Policy(lambda seen, rng: [n for n in regions if n in seen.boxes], lambda seen, name, rng: regions[name])


@pytest.fixture(autouse=True)
def checked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """The final check and the verdict pass everything here, and note what they were asked."""
    asked: list[tuple[Any, ...]] = []
    monkeypatch.setattr(conclusion, "with_clearances", lambda motions, way: tuple(motions))
    monkeypatch.setattr(conclusion, "replayed", lambda robot, scene, motions: None)
    monkeypatch.setattr(conclusion, "first_touch", lambda *about: asked.append(("verify", *about[:2], tuple(about[2]))))
    monkeypatch.setattr(conclusion, "examine", lambda *about: asked.append(("examine", *about)) or Verdict((), (), True))
    return asked


def plan_with(motions: FakeMotions, policy: Policy, rule: Rule = Rule.DEEP, seed: int = 0, **options: Any) -> Plan:
    return retrieve(motions.scene, policy, motions, name="by-hand", rule=rule, rng=np.random.default_rng(seed), **options)  # type: ignore[arg-type]


def tried(plan: Plan) -> list[tuple[str, int, bool]]:
    return [(m.object, m.region, m.done) for m in plan.moves]


# ------------------------------------------------------------------------------------------------------------------------------- the target


def test_a_free_target_needs_no_move() -> None:
    motions = FakeMotions(scene_of("a"), opens=[frozenset()])
    steps: list[str] = []
    plan = plan_with(motions, ordered(a=[3]), on_step=steps.append)
    assert (plan.success, plan.reason, plan.moves, plan.verified) == (True, None, (), True)
    assert motions.asked == [("target", ())]
    assert [m.stage for m in plan.motions] == ["approach"]
    assert (plan.scene, plan.policy, plan.rule) == ("by-hand", "by-hand", "deep")
    assert steps == ["trying the target target"]


def test_an_arm_that_touches_where_it_stands_tries_nothing() -> None:
    why, steps = Blocked("scene", "arm", "post"), list[str]()
    motions = FakeMotions(scene_of("a"), opens=[frozenset()], at_start=why)
    plan = plan_with(motions, ordered(a=[3]), on_step=steps.append)
    assert (plan.success, plan.reason, plan.moves, plan.motions, plan.verified) == (False, why, (), (), None)
    assert (motions.asked, steps) == ([], [])


def test_deep_is_the_default_and_nobody_need_listen() -> None:
    motions = FakeMotions(scene_of("a"), opens=[frozenset()])
    plan = retrieve(motions.scene, ordered(a=[3]), motions, name="x", rng=np.random.default_rng(0))  # type: ignore[arg-type]
    assert plan.rule == "deep"


def test_one_move_and_then_the_target() -> None:
    scene = scene_of("a", "b")
    motions = FakeMotions(scene, opens=[frozenset({("b", 7)})], possible=lambda made, c: True)
    steps: list[str] = []
    plan = plan_with(motions, ordered(b=[7, 8], a=[1]), on_step=steps.append)
    assert plan.success
    assert plan.reason is None
    assert tried(plan) == [("b", 7, True)]
    (move,) = plan.moves
    assert move.reason is None
    assert np.array_equal(move.T_world_from, scene.poses()["b"])
    assert move.T_world_to[:3, 3] == pytest.approx([0.15, 0.15, HEIGHT_M / 2])
    assert [m.stage for m in plan.motions] == ["transit", "transfer", "approach"]
    assert [float(m.q[0, 0]) for m in plan.motions] == pytest.approx([0.0, 0.4, 1.0])
    assert steps == ["trying the target target", "moved b to region 7", "trying the target target"]


def test_every_question_draws_from_the_same_generator() -> None:
    """Randomness is passed in once, to the policy and to the motions alike."""
    motions = FakeMotions(scene_of("a"), opens=[frozenset({("a", 2)})], possible=lambda made, c: c[1] == 2)
    given: list[np.random.Generator] = []

    def select(seen: Observation, rng: np.random.Generator) -> list[str]:
        given.append(rng)
        return ["a"]

    def place(seen: Observation, name: str, rng: np.random.Generator) -> list[int]:
        given.append(rng)
        return [1, 2]

    rng = np.random.default_rng(0)
    plan = retrieve(motions.scene, Policy(select, place), motions, name="x", rng=rng)  # type: ignore[arg-type]
    assert plan.success
    assert len(given) == 2
    assert all(r is rng for r in (*given, *motions.rngs))


def test_the_policy_sees_the_state_that_moves_have_led_to() -> None:
    """It is asked anew in each state, and both of its halves get the same observation."""
    scene = scene_of("a", "b")
    motions = FakeMotions(scene, opens=[frozenset({("a", 0), ("a", 5)})], possible=lambda made, c: True)
    seen_by: list[tuple[str, Observation]] = []

    def select(seen: Observation, rng: np.random.Generator) -> list[str]:
        seen_by.append(("select", seen))
        return ["a"]

    def place(seen: Observation, name: str, rng: np.random.Generator) -> list[int]:
        seen_by.append((name, seen))
        return [0] if len(seen_by) == 2 else [5]

    plan = plan_with(motions, Policy(select, place))
    assert tried(plan) == [("a", 0, True), ("a", 5, True)]
    assert [who for who, _ in seen_by] == ["select", "a", "select", "a"]
    (_, first), (_, first_again), (_, second), (_, second_again) = seen_by
    assert first is first_again
    assert second is second_again
    assert first.boxes["a"][:2] == pytest.approx([0.25, -0.135])
    assert second.boxes["a"][:2] == pytest.approx([0.05, -0.15])
    assert second.boxes["b"][:2] == pytest.approx([0.25, -0.045])
    assert np.array_equal(plan.moves[1].T_world_from, plan.moves[0].T_world_to)


# -------------------------------------------------------------------------------------------------------------------------------- the rules


def test_the_rules_by_name() -> None:
    assert [str(rule) for rule in Rule] == ["deep", "region", "strict"]
    assert [str(rule) for rule in options.Rule] == ["deep", "region", "strict"]


def test_strict_tries_one_pair_a_step() -> None:
    """The first object's first region that has not failed, or the step is lost; the target is tried after every step."""
    motions = FakeMotions(scene_of("a", "b"), opens=[NEVER])
    plan = plan_with(motions, ordered(a=[1, 2, 3], b=[1, 2, 3]), Rule.STRICT)
    assert motions.tried == [("a", 1), ("a", 2), ("a", 3), ("b", 1), ("b", 2)]  # a's regions are used up after three steps
    assert motions.looks == 6
    assert not plan.success


def test_region_tries_all_regions_of_one_object_a_step() -> None:
    motions = FakeMotions(scene_of("a", "b", "c"), opens=[NEVER])
    plan_with(motions, ordered(a=[1, 2], b=[1, 2, 3], c=[1]), Rule.REGION)
    assert motions.tried == [("a", 1), ("a", 2), ("b", 1), ("b", 2), ("b", 3), ("c", 1)]
    assert [a[0] for a in motions.asked] == [
        "target",
        *["relocate"] * 2,
        "target",
        *["relocate"] * 3,
        "target",
        "relocate",
        *["target"] * 3,
    ]


def test_deep_tries_all_that_the_policy_has_and_then_gives_up() -> None:
    """In one step; another round in the same state would be the same."""
    motions = FakeMotions(scene_of("a", "b"), opens=[NEVER])
    plan = plan_with(motions, ordered(a=[1, 2], b=[3]), Rule.DEEP)
    assert motions.tried == [("a", 1), ("a", 2), ("b", 3)]
    assert motions.looks == 1
    assert not plan.success


@pytest.mark.parametrize(
    ("rule", "moves"),
    [
        (Rule.STRICT, [("a", 1, False), ("a", 2, False), ("b", 1, False), ("b", 2, True)]),
        (Rule.REGION, [("a", 1, False), ("a", 2, False), ("b", 1, False), ("b", 2, True)]),
        (Rule.DEEP, [("a", 1, False), ("a", 2, False), ("b", 1, False), ("b", 2, True)]),
    ],
)
@pytest.mark.parametrize("limit", [1, 2, 4])
def test_what_a_limit_of_moves_leaves_of_each_rule(rule: Rule, moves: list[tuple[str, int, bool]], limit: int) -> None:
    """Only (b, 2) can be carried out, and opens the way: deep gets there in one step, region in two, strict in four."""
    motions = FakeMotions(scene_of("a", "b"), opens=[frozenset({("b", 2)})], possible=lambda made, c: c == ("b", 2))
    plan = plan_with(motions, ordered(a=[1, 2], b=[1, 2]), rule, max_moves=limit)
    needed = {Rule.STRICT: 4, Rule.REGION: 2, Rule.DEEP: 1}[rule]
    assert plan.success == (limit >= needed)
    assert plan.rule == str(rule)
    if plan.success:
        assert tried(plan) == moves


def test_a_move_ends_the_step_under_every_rule() -> None:
    for rule in Rule:
        motions = FakeMotions(scene_of("a", "b"), opens=[frozenset({("a", 1)})], possible=lambda made, c: True)
        assert tried(plan_with(motions, ordered(a=[1, 2], b=[1]), rule)) == [("a", 1, True)]


def test_proposals_leave_out_what_has_failed() -> None:
    """Objects without any region left cost nothing, under every rule."""
    seen, watch, rng = object(), Stopwatch(), np.random.default_rng(0)
    policy = Policy(lambda seen, rng: ["a", "b", "c"], lambda seen, name, rng: {"a": [4], "b": [1, 2, 3], "c": [5, 6]}[name])
    failed = {("a", 4), ("b", 2), ("c", 9)}
    left = {rule: list(proposals(policy, seen, rule, failed, rng, watch)) for rule in Rule}  # type: ignore[arg-type]
    assert left[Rule.STRICT] == [("b", 1)]
    assert left[Rule.REGION] == [("b", 1), ("b", 3)]
    assert left[Rule.DEEP] == [("b", 1), ("b", 3), ("c", 5), ("c", 6)]


def test_what_is_certain_is_proposed_though_it_has_failed() -> None:
    """A policy that tried motions found some for a move that the loop had failed at, with an object that it had found out of reach."""
    motions = FakeMotions(scene_of("a"), opens=[frozenset({("a", 3)})], graspable=lambda made, name: False)
    searched: list[bool] = []

    def select(seen: Observation, rng: np.random.Generator) -> Iterator[str]:
        yield "a"
        searched.append(True)
        motions.possible = lambda made, c: c == ("a", 3)
        yield "a"

    plan = plan_with(motions, Policy(select, lambda seen, name, rng: [3, 4], certain=lambda name, region: bool(searched) and region == 3))
    assert plan.success
    assert tried(plan) == [("a", 3, False), ("a", 3, True)]


@pytest.mark.parametrize(("choosy", "roomy", "made"), [(0, 3, 1), (2, 3, 3), (1, 3, 1), (4, 9, 1)])
def test_a_policy_that_is_choosy_has_roomy_places_tried_first(choosy: int, roomy: int, made: int) -> None:
    """So many proposals more after the first move that is possible but tight, and none for another object."""
    motions = FakeMotions(
        scene_of("a", "b"), opens=[frozenset({("a", region)}) for region in (1, 3)],
        possible=lambda made, c: c in {("a", 1), ("a", 3)}, tight=lambda c: c[1] != roomy,
    )  # fmt: skip
    policy = Policy(lambda seen, rng: ["a", "b"], lambda seen, name, rng: [1, 2, 3], choosy=choosy)
    plan = plan_with(motions, policy)
    assert plan.success
    assert [(m.object, m.region) for m in plan.moves if m.done] == [("a", made)]
    assert all(ask[1] != "b" for ask in motions.asked if ask[0] == "relocate")


def test_a_policy_is_not_choosy_unless_it_says_so() -> None:
    motions = FakeMotions(scene_of("a"), opens=[frozenset({("a", 1)})], possible=lambda made, c: True, tight=lambda c: c[1] == 1)
    assert plan_with(motions, ordered(a=[1, 3])).success
    assert motions.tried == [("a", 1)]


def test_a_move_that_is_certain_is_made_though_it_is_tight() -> None:
    motions = FakeMotions(scene_of("a"), opens=[frozenset({("a", 3)})], possible=lambda made, c: True, tight=lambda c: c[1] == 3)
    policy = Policy(lambda seen, rng: ["a"], lambda seen, name, rng: [3, 4], certain=lambda name, region: region == 3, choosy=4)
    assert tried(plan_with(motions, policy)) == [("a", 3, True)]


def test_regions_are_asked_for_one_object_after_another() -> None:
    """A policy's second half is slow: it is not asked about an object before the ones in front of it were tried."""
    asked: list[str] = []
    policy = Policy(lambda seen, rng: ["a", "b"], lambda seen, name, rng: asked.append(name) or [1])  # type: ignore[func-returns-value]
    ways = proposals(policy, object(), Rule.DEEP, set(), np.random.default_rng(0), Stopwatch())  # type: ignore[arg-type]
    assert next(ways) == ("a", 1)
    assert asked == ["a"]


# -------------------------------------------------------------------------------------------------------------------------------- the limit


@pytest.mark.parametrize("rule", list(Rule))
@pytest.mark.parametrize("limit", [0, 1, 2, 5, 7])
def test_the_limit_counts_moves_that_were_made(rule: Rule, limit: int) -> None:
    """The target is tried once more than there were moves, and no move is made after the last."""
    motions = FakeMotions(scene_of("a"), opens=[NEVER], possible=lambda made, c: c[1] == len(made))
    plan = plan_with(motions, ordered(a=range(16)), rule, max_moves=limit)
    if rule is not Rule.STRICT:
        assert sum(m.done for m in plan.moves) == limit
    assert motions.looks == limit + 1
    assert not plan.success


def test_five_moves_by_default() -> None:
    """As the paper has it; a scene that needs five is solved, one that needs six is not."""
    assert MAX_MOVES == 5
    for needed in (5, 6):
        opens = [frozenset(("a", i) for i in range(needed))]
        motions = FakeMotions(scene_of("a"), opens=opens, possible=lambda made, c: c[1] == len(made))
        plan = plan_with(motions, ordered(a=range(16)))
        assert plan.success == (needed == 5)
        assert sum(m.done for m in plan.moves) == 5


def test_a_policy_that_proposes_nothing() -> None:
    """Deep ends at once; strict and region lose their steps and ask again: a policy may draw its answers."""
    for rule, looks in ((Rule.DEEP, 1), (Rule.REGION, 6), (Rule.STRICT, 6)):
        motions = FakeMotions(scene_of("a"), opens=[NEVER])
        plan = plan_with(motions, ordered(), rule)
        assert (motions.looks, plan.moves, plan.success) == (looks, (), False)


# ----------------------------------------------------------------------------------------------------------------------------- failed pairs


def test_a_failed_pair_is_forgotten_in_a_new_state() -> None:
    """(a, 1) fails at first, works once b has gone to 2."""
    motions = FakeMotions(
        scene_of("a", "b"),
        opens=[frozenset({("b", 2), ("a", 1)})],
        possible=lambda made, c: (c == ("b", 2) and not made) or (c == ("a", 1) and ("b", 2) in made),
    )
    for rule in (Rule.DEEP, Rule.REGION, Rule.STRICT):
        plan = plan_with(motions, ordered(a=[1], b=[2]), rule)
        assert tried(plan) == [("a", 1, False), ("b", 2, True), ("a", 1, True)]
        assert plan.success


def test_a_failed_pair_is_not_proposed_again_in_the_same_state() -> None:
    motions = FakeMotions(scene_of("a"), opens=[NEVER])
    plan_with(motions, ordered(a=[1, 2]), Rule.STRICT)
    assert motions.tried == [("a", 1), ("a", 2)]


def test_the_same_object_may_fail_where_it_is_and_another_region_work() -> None:
    """A failed pair is just that pair: the object's other regions and other objects' same region stay."""
    motions = FakeMotions(scene_of("a", "b"), opens=[frozenset({("b", 1)})], possible=lambda made, c: c == ("b", 1))
    plan = plan_with(motions, ordered(a=[1, 2], b=[1]), Rule.STRICT)
    assert tried(plan) == [("a", 1, False), ("a", 2, False), ("b", 1, True)]


def test_a_failed_attempt_says_what_was_tried_and_why_not() -> None:
    scene = scene_of("a")
    plan = plan_with(FakeMotions(scene, opens=[NEVER]), ordered(a=[6]))
    (attempt,) = plan.moves
    assert (attempt.object, attempt.region, attempt.done) == ("a", 6, False)
    assert attempt.reason == Blocked("transfer", "arm", "a", detail="no way to 6")
    assert np.array_equal(attempt.T_world_from, scene.poses()["a"])
    assert attempt.T_world_to[:3, 3] == pytest.approx([0.15, 0.05, HEIGHT_M / 2])


# ----------------------------------------------------------------------------------------------------------------------------- out of reach


def test_an_object_out_of_reach_is_tried_once_a_step() -> None:
    """Where nothing can take hold of it another region would not help, and only the pair that was tried counts as failed."""
    motions = FakeMotions(scene_of("a", "b"), opens=[NEVER], graspable=lambda made, name: name != "a")
    plan = plan_with(motions, ordered(a=[1, 2, 3], b=[4, 5]), Rule.DEEP)
    assert tried(plan) == [("a", 1, False), ("b", 4, False), ("b", 5, False)]
    motions = FakeMotions(scene_of("a", "b"), opens=[NEVER], graspable=lambda made, name: name != "a")
    plan_with(motions, ordered(a=[1, 2, 3], b=[4, 5]), Rule.REGION)
    assert motions.tried == [("a", 1), ("a", 2), ("a", 3), ("b", 4), ("b", 5)]
    assert [a[0] for a in motions.asked] == [*["target", "relocate"] * 4, "relocate", "target", "target"]


def test_an_object_out_of_reach_may_be_within_it_in_a_new_state() -> None:
    motions = FakeMotions(
        scene_of("a", "b"),
        opens=[frozenset({("b", 4), ("a", 2)})],
        possible=lambda made, c: c == ("b", 4) or (bool(made) and c == ("a", 2)),
        graspable=lambda made, name: bool(made) or name != "a",
    )
    plan = plan_with(motions, ordered(a=[1, 2, 3], b=[4]))
    assert tried(plan) == [("a", 1, False), ("b", 4, True), ("a", 1, False), ("a", 2, True)]
    assert plan.success


def test_objects_within_reach_are_tried_in_every_region() -> None:
    """Objects take turns in the policy's order, even if one of them is out of reach in between."""
    motions = FakeMotions(scene_of("a", "b", "c"), opens=[NEVER], graspable=lambda made, name: name != "b")
    plan_with(motions, ordered(a=[1, 2], b=[1, 2], c=[1, 2]))
    assert motions.tried == [("a", 1), ("a", 2), ("b", 1), ("c", 1), ("c", 2)]


# ---------------------------------------------------------------------------------------------------------------------------------- reasons


def test_the_reason_is_what_blocks_the_target_last() -> None:
    """Not why a move failed: two moves were made, the third found nothing."""
    motions = FakeMotions(scene_of("a"), opens=[NEVER], possible=lambda made, c: c[1] == len(made) < 2)
    plan = plan_with(motions, ordered(a=range(5)))
    assert plan.reason == Blocked("approach", "hand", "can", detail="target blocked after 2 moves")
    assert [m.stage for m in plan.motions] == ["transit", "transfer"] * 2
    assert plan.verified


@pytest.mark.parametrize(
    ("outlook", "limit", "reason"),
    [
        (Outlook(), 1, Blocked("approach", "hand", "can", detail="target blocked after 0 moves")),
        (Outlook(1), 1, Blocked("approach", "hand", "can", detail="target blocked after 0 moves")),
        (Outlook(2), 1, Blocked("moves", "hand", "can", detail="at least 2 moves are needed, 1 are allowed")),
        (
            Outlook(7, Unsolvable(("a", "b"), ("another grasp",))), 1,
            Blocked("unsolvable", "hand", "can", detail="none of a, b can be picked while the others of them stand"),
        ),
        (Outlook(undecided="a is hardly reachable"), 1, Blocked("approach", "hand", "can", detail="a is hardly reachable")),
    ],
)  # fmt: skip
def test_a_policy_that_looks_ahead_knows_why(outlook: Outlook, limit: int, reason: Blocked) -> None:
    """A proof goes before a lower bound beyond the limit, and that before what blocks the target; the plan carries both."""
    policy = replace(ordered(a=[1]), outlook=lambda: outlook)
    plan = plan_with(FakeMotions(scene_of("a", "b"), opens=[NEVER]), policy, max_moves=limit)
    assert plan.reason == reason
    assert (plan.least_moves, plan.unsolvable) == (outlook.least_moves, outlook.unsolvable)


def test_what_is_free_at_once_needs_no_move_whatever_the_policy_says() -> None:
    policy = replace(ordered(a=[1]), outlook=lambda: Outlook(3))
    assert plan_with(FakeMotions(scene_of("a"), opens=[frozenset()]), policy).least_moves == 0
    moved = FakeMotions(scene_of("a"), opens=[frozenset({("a", 1)})], possible=lambda made, c: True)
    made = plan_with(moved, policy)
    assert (made.success, made.least_moves) == (True, 1)  # not 3, which it refutes


def test_what_the_final_check_refuses_is_no_success(monkeypatch: pytest.MonkeyPatch, checked: list[tuple[Any, ...]]) -> None:
    """And the verdict is not asked any more."""
    refused = Blocked("verify", "arm", "floor", 0.002)
    monkeypatch.setattr(conclusion, "first_touch", lambda *_: refused)
    plan = plan_with(FakeMotions(scene_of("a"), opens=[frozenset()]), ordered(a=[3]))
    assert (plan.success, plan.reason, plan.verified, plan.faults) == (False, refused, False, ())
    assert (plan.value, len(plan.motions)) == (0.0, 1)
    assert checked == []


def test_what_the_verdict_refuses_is_no_success(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first fault is the reason; the return is that of a failure."""
    faults = (Fault("grasp", ("pad", "a"), "the pads close on air"), Fault("lift", ("a",), "it falls"))
    notes = (Fault("transit", ("finger", "hand"), "they touch, and may"),)
    monkeypatch.setattr(conclusion, "examine", lambda *_: Verdict(faults, notes, False))
    motions = FakeMotions(scene_of("a"), opens=[frozenset({("a", 13)})], possible=lambda made, c: True)
    plan = plan_with(motions, ordered(a=[13]))
    assert (plan.success, plan.verified, plan.faults, plan.notes) == (False, False, faults, notes)
    assert plan.reason == Blocked("verify", detail="grasp: the pads close on air")
    assert plan.value == pytest.approx(objective(motions.scene, plan.moves, False))
    assert plan.value < -0.1


def test_the_final_check_and_the_verdict_get_the_plan_and_only_if_it_moves(checked: list[tuple[Any, ...]]) -> None:
    """The verdict gets the plan before it is verified, and looks for everything but the contacts, which were judged just now."""
    motions = FakeMotions(scene_of("a"), opens=[frozenset({("a", 1)})], possible=lambda made, c: True)
    plan = plan_with(motions, ordered(a=[1]))
    (verify, verify_robot, verify_scene, way), (examine, its_scene, judged, its_robot, settings) = checked
    assert (verify, verify_robot, verify_scene, way) == ("verify", motions.robot, motions.scene, plan.motions)
    limits = Settings(contact=False, max_tilt_deg=30.0)
    assert (examine, its_scene, its_robot, settings) == ("examine", motions.scene, motions.robot, limits)
    assert (judged.success, judged.moves, judged.motions, judged.value) == (True, plan.moves, plan.motions, plan.value)
    assert (judged.verified, plan.verified) == (None, True)
    checked.clear()
    assert plan_with(FakeMotions(scene_of("a"), opens=[NEVER]), ordered(a=[1])).verified is None
    assert not checked


def test_a_scene_that_cannot_be_meant_has_a_plan_that_says_so() -> None:
    plan = failed("by-hand", "the grasp closes on air", name="n", rule=Rule.STRICT)
    assert (plan.scene, plan.policy, plan.rule, plan.success) == ("by-hand", "n", "strict", False)
    assert plan.reason == Blocked("scene", detail="the grasp closes on air")
    assert (plan.moves, plan.motions, plan.verified, plan.faults) == ((), (), None, ())
    assert (plan.planning_time_s, plan.motion_time_s, plan.hand_travel_m, plan.value) == (0.0, 0.0, 0.0, 0.0)


# ------------------------------------------------------------------------------------------------------------------------------------ times


def test_planning_time_is_the_policys_and_motion_time_the_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Select twice at 1 s, place three times at 0.1 s; 3 looks at the target and 3 tries at 10 s; 4000 s of checks."""
    clock = Clock()
    monkeypatch.setattr(stopwatch, "perf_counter", clock)
    monkeypatch.setattr(conclusion, "first_touch", lambda *_: setattr(clock, "now", clock.now + 1000.0))
    monkeypatch.setattr(conclusion, "examine", lambda *_: setattr(clock, "now", clock.now + 3000.0) or Verdict((), (), True))
    motions = FakeMotions(
        scene_of("a", "b"), opens=[frozenset({("b", 1), ("a", 2)})],
        possible=lambda made, c: c == ("b", 1) or bool(made), clock=clock, seconds=10.0,
    )  # fmt: skip

    def spend(seconds: float, answer: Any) -> Any:
        clock.now += seconds
        return answer

    policy = Policy(lambda seen, rng: spend(1.0, ["a", "b"]), lambda seen, name, rng: spend(0.1, [2] if name == "a" else [1]))
    plan = plan_with(motions, policy)
    assert tried(plan) == [("a", 2, False), ("b", 1, True), ("a", 2, True)]
    assert plan.planning_time_s == pytest.approx(2.3)
    assert plan.motion_time_s == pytest.approx(4060.0)


def test_a_stopwatch_adds_up_its_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(stopwatch, "perf_counter", clock)
    watch = Stopwatch()
    for seconds in (1.0, 2.5):
        with watch:
            clock.now += seconds
        clock.now += 100.0
    assert watch.seconds == pytest.approx(3.5)


# -------------------------------------------------------------------------------------------------------------------- travel and the return


def test_travel_along_an_arc_is_measured_in_chords() -> None:
    """A stick of 2 m turns by 1 rad: 20 chords of 2 · 2 · sin(0.025) m; then by 0.06 rad: two chords; a motion that stands adds nothing."""
    scene, robot = scene_of("a"), stick(2.0)
    arc = 20 * 4 * np.sin(0.025)
    assert hand_travel(robot, scene, [motion("transit", 0.0, 1.0)]) == pytest.approx(arc, rel=1e-12)
    assert hand_travel(robot, scene, [motion("transit", 0.0, 1.0), motion("grasp", 1.0, 1.0)]) == pytest.approx(arc, rel=1e-12)
    there_and_back = [motion("transit", 0.0, 1.0), motion("lift", 1.0, 1.06), motion("transfer", 1.06, 1.0, 0.0)]
    assert hand_travel(robot, scene, there_and_back) == pytest.approx(2 * arc + 2 * 4 * np.sin(0.015) + 2 * 4 * np.sin(0.015), rel=1e-12)
    assert hand_travels(robot, scene, there_and_back) == pytest.approx([arc, 2 * 4 * np.sin(0.015), arc + 2 * 4 * np.sin(0.015)], rel=1e-12)
    slowly = replace(there_and_back[2], t_s=np.array([7.0, 9.0, 12.5]))
    assert hand_travel(robot, scene, [slowly]) == pytest.approx(arc + 2 * 4 * np.sin(0.015), rel=1e-12)
    assert hand_travel(robot, scene, []) == 0.0
    assert hand_travel(robot, scene, [motion("transit", 0.3)]) == 0.0


def test_travel_does_not_hang_on_where_the_base_stands() -> None:
    scene = scene_of("a")
    turned = replace(scene, robot=replace(scene.robot, T_world_base=transform(rotation_about((1, 2, 3), 0.7), [3.0, 2.0, 1.0])))
    way = [motion("transit", 0.0, 0.5)]
    assert hand_travel(stick(), turned, way) == pytest.approx(hand_travel(stick(), scene, way), rel=1e-12)


def test_travel_follows_the_joint_that_turns_furthest() -> None:
    """And a coarser step makes longer chords: here a single one."""
    robot = stick()
    way = replace(motion("transit", 0.0, 1.0), q=np.array([[0.0, 0.0], [0.1, 1.0]]))
    assert hand_travel(robot, scene_of("a"), [way]) == pytest.approx(20 * 2 * np.sin(0.0025), rel=1e-12)
    assert hand_travel(robot, scene_of("a"), [motion("transit", 0.0, -1.0)], 2.0) == pytest.approx(2 * np.sin(0.5), rel=1e-12)


def test_the_papers_travel_ends_before_the_target_is_gone_for_and_counts_no_looks() -> None:
    stages = ("look", "transit", "retreat", "look", "transit", "retreat", "look", "transit", "lift", "transfer")
    counts = relocating([motion(stage, 0.0, 1.0) for stage in stages])
    assert [stage for stage, counted in zip(stages, counts) if counted] == ["transit", "retreat", "transit", "retreat"]
    assert relocating([motion("transit", 0.0, 1.0), motion("lift", 1.0, 2.0)]) == [False, False]
    free = plan_with(FakeMotions(scene_of("a"), opens=[frozenset()]), ordered(a=[1]))
    assert free.relocation_travel_m == 0.0


@pytest.mark.parametrize("rule", list(Rule))
def test_what_kept_the_target_in_is_told_for_every_state(rule: Rule) -> None:
    """Whatever is tried in vain, there is one reason before each move, and one at the end of a failure."""
    opens, works = [frozenset({("a", 3)})], {("a", 3), ("b", 2)}
    motions = FakeMotions(scene_of("a", "b"), opens=opens, possible=lambda made, c: c in works and c not in made)
    plan = plan_with(motions, ordered(b=[1, 2], a=[3]), rule)
    assert len(plan.target_blocked) == sum(move.done for move in plan.moves) + (not plan.success)
    assert any(not move.done for move in plan.moves)


def test_a_plan_carries_the_travel_of_its_motions() -> None:
    motions = FakeMotions(scene_of("a"), opens=[frozenset({("a", 1)})], possible=lambda made, c: True)
    plan = plan_with(motions, ordered(a=[1]))
    assert plan.hand_travel_m == pytest.approx((8 + 12 + 10) * 2 * np.sin(0.025), rel=1e-12)


def move(start: Sequence[float], end: Sequence[float], *, done: bool = True) -> Move:
    T_from, T_to = transform(p=list(start)), transform(p=list(end))
    return Move("a", 0, T_from, T_to, done, None if done else Blocked("lift"))


def from_base(p: Sequence[float]) -> Array:
    return np.asarray(BASE + np.asarray(p))


def test_the_return_by_hand() -> None:
    """Eq. 1: I − Σ (|base → object| + |object → region|): 1 − (5 + 2) − (13 + 1), distances in space; failed attempts cost nothing."""
    scene = scene_of("a")
    first = move(from_base([3.0, 4.0, 0.0]), from_base([3.0, 4.0, 2.0]))
    second = move(from_base([3.0, 4.0, 12.0]), from_base([3.0, 5.0, 12.0]))
    failed = move(from_base([1.0, 0.0, 0.0]), from_base([9.0, 0.0, 0.0]), done=False)
    assert objective(scene, [], True) == 1.0
    assert objective(scene, [], False) == 0.0
    assert objective(scene, [first], True) == pytest.approx(1 - 7)
    assert objective(scene, [first, failed, second], True) == pytest.approx(1 - 7 - 14)
    assert objective(scene, [first, failed, second], False) == pytest.approx(-21)


def test_a_plan_carries_its_return() -> None:
    motions = FakeMotions(scene_of("a"), opens=[frozenset({("a", 13)})], possible=lambda made, c: c[1] == 13)
    plan = plan_with(motions, ordered(a=[1, 13]))
    start = np.array([0.25, -0.135, HEIGHT_M / 2])
    end = np.array([0.35, -0.05, HEIGHT_M / 2])
    assert plan.value == pytest.approx(1 - np.linalg.norm(start - BASE) - np.linalg.norm(end - start))


def test_conclude_says_what_the_loop_found() -> None:
    scene, thinking, moving = scene_of("a"), Stopwatch(), Stopwatch()
    thinking.seconds, moving.seconds = 3.0, 4.0
    why = Blocked("lift", "arm", "a")
    made = [move(from_base([1.0, 0.0, 0.0]), from_base([1.0, 1.0, 0.0]))]
    plan = conclude(stick(), scene, why, made, [], name="n", rule=Rule.REGION, thinking=thinking, moving=moving)
    assert (plan.scene, plan.policy, plan.rule, plan.success, plan.reason) == ("by-hand", "n", "region", False, why)
    assert (plan.moves, plan.motions, plan.verified) == (tuple(made), (), None)
    assert (plan.planning_time_s, plan.motion_time_s, plan.hand_travel_m, plan.value) == (3.0, 4.0, 0.0, -2.0)


def test_where_the_truth_is_not_known_nothing_is_judged_by_the_scene(checked: list[tuple[Any, ...]]) -> None:
    watches = {"thinking": Stopwatch(), "moving": Stopwatch()}
    way = [motion("transit", 0.0, 1.0)]
    plan = conclude(stick(), scene_of("a"), None, [], way, name="n", rule=Rule.DEEP, is_truth=False, **watches)
    assert (plan.success, plan.verified, plan.faults, plan.value) == (True, True, (), 1.0)
    assert not checked


@pytest.mark.parametrize("seed", range(40))
def test_whatever_the_world_the_loop_keeps_its_promises(seed: int) -> None:
    """Random worlds: attempts obey the rule, no pair fails twice in one state, and success means that the target was free."""
    rng = np.random.default_rng(seed)
    names, rule, limit = ("a", "b", "c"), list(Rule)[seed % 3], int(rng.integers(6))
    works = {(made, name, region): rng.random() < 0.4 for made in range(6) for name in names for region in range(5)}
    reach = {(made, name): rng.random() < 0.8 for made in range(6) for name in names}
    motions = FakeMotions(
        scene_of(*names),
        opens=[frozenset({("a", 1)}), frozenset({("b", 2), ("c", 3)})],
        possible=lambda made, c: works[len(made), *c],
        graspable=lambda made, name: reach[len(made), name],
    )
    policy: Policy = Policy(
        lambda seen, rng: [names[i] for i in rng.permutation(3)], lambda seen, name, rng: [int(i) for i in rng.permutation(5)]
    )
    plan = plan_with(motions, policy, rule, seed, max_moves=limit)
    made: list[Choice] = []
    failed: set[Choice] = set()
    for m in plan.moves:
        assert (m.object, m.region) not in failed
        if m.done:
            made, failed = [*made, (m.object, m.region)], set()
        else:
            failed.add((m.object, m.region))
        assert m.done == (m.reason is None)
    assert len(made) <= limit
    assert plan.success == any(needed <= set(made) for needed in motions.opens)
    assert motions.looks <= limit + 1
    if rule is Rule.STRICT:
        assert len(plan.moves) <= limit
