"""What is counted of a plan, and every kind of failure, worked out by hand on plans without motions."""

from __future__ import annotations

from dataclasses import replace

import pytest
from bare_plans import failed, move, plan

from planning import episodes
from planning.episodes import KINDS, SENSED, Episode, failure, in_general
from planning.io.plan_documents import plan_from_json, plan_to_json
from planning.plan import PLACE_OUT_OF_REACH, Blocked, Move


def test_the_names_in_reports() -> None:
    assert KINDS == ("selection", "pick", "region", "place", "retrieve", "look", "verify", "moves", "unsolvable", "scene")
    assert SENSED == ", sensed"


@pytest.mark.parametrize(
    ("why", "words"),
    [
        (Blocked("approach", "camera", "box_3"), "camera would touch another object (approach)"),
        (Blocked("lift", "forearm", "ceiling"), "forearm would touch the ceiling (lift)"),
        (Blocked("transfer", "can_1", "left"), "the object would touch the left wall (transfer)"),
        (Blocked("grasp", "hand", "can_1"), "hand would touch the object itself (grasp)"),
        (Blocked("transit", "wrist", "unknown_7"), "wrist would touch unseen space (transit)"),
        (Blocked("ik", "hand", None, detail="the grasp is out of reach"), "ik: the grasp is out of reach"),
        (Blocked("grasp", detail="box_12 stands on can_1 and goes first"), "grasp: an object stands on an object and goes first"),
        (Blocked("unsolvable", "wrist", "can_5", detail="none of box_9 can be picked"), "it is proved that no picks help"),
        (Blocked("select"), "select"),
        (Blocked("look", None, "box_3", detail="nothing but box_3 was seen"), "look: nothing but an object was seen"),
        (Blocked("look", "camera", None, detail="it is dark"), "look: it is dark"),
    ],
)
def test_reasons_count_alike_in_all_scenes(why: Blocked, words: str) -> None:
    assert in_general(why, "can_1") == words


# ----------------------------------------------------------------------------------------------------------------------- one plan's figures


def test_what_is_counted_of_a_success() -> None:
    e = Episode.of(
        plan("0-7", "local", "region", moves=[failed("ik"), move(), failed("lift"), move(False), move(stage="grasp")], verified=False)
    )
    assert (e.scene, e.policy, e.rule, e.success, e.verified) == ("0-7", "local", "region", True, False)
    assert (e.moved, e.planning_time_s, e.motion_time_s, e.hand_travel_m, e.value) == (2, 0.5, 2.0, 3.0, -4.0)
    assert e.whole_time_s == 2.5
    assert (e.reason, e.kind, e.blocked, e.stopped) == (None, None, ("ik", "lift"), ("ik", "lift"))


def test_what_is_counted_of_a_failure() -> None:
    e = Episode.of(plan(success=False, reason=Blocked("transfer", "arm", "can"), moves=[failed("grasp")]))
    assert (e.success, e.reason, e.kind) == (False, "transfer", "pick")
    assert Episode.of(plan(success=False)).reason == "unknown"
    after_all = Episode.of(plan(success=True, reason=Blocked("lift")))
    assert (after_all.reason, after_all.kept_in) == (None, None)


# ------------------------------------------------------------------------------------------------------------------------ why a plan failed


@pytest.mark.parametrize("stage", ["verify", "look", "scene", "moves", "unsolvable"])
def test_a_refused_plan_and_a_target_that_was_not_found_go_first(stage: str) -> None:
    assert failure(plan(success=False, reason=Blocked(stage), moves=[failed("ik")])) == stage


@pytest.mark.parametrize(
    ("stage", "kind"),
    [
        *((stage, "pick") for stage in ("ik", "grasp", "transit", "approach", "lift")),
        *((stage, "place") for stage in ("transfer", "lower", "release", "retreat")),
        ("region", "region"),
        ("select", "selection"),
        ("place", "selection"),
        ("whatever", "selection"),
    ],
)
def test_the_kind_of_an_attempt(stage: str, kind: str) -> None:
    assert failure(plan(success=False, moves=[failed(stage)])) == kind
    assert failure(plan(success=False, moves=[failed(stage, detail="x")], reason=Blocked("ik"))) == kind
    assert failure(plan(success=False, moves=[failed(stage, detail=PLACE_OUT_OF_REACH)])) == ("region" if stage == "region" else "place")


def test_the_furthest_attempt_counts() -> None:
    in_order = [failed("select"), failed("ik"), failed("region"), failed("lower")]
    for n, kind in enumerate(("selection", "pick", "region", "place")):
        assert failure(plan(success=False, moves=in_order[: n + 1])) == kind
        assert failure(plan(success=False, moves=in_order[n::-1])) == kind


def test_attempts_before_the_last_move_do_not_count() -> None:
    """They were made in another state."""
    assert failure(plan(success=False, moves=[failed("lower"), move(), failed("ik")])) == "pick"
    assert failure(plan(success=False, moves=[failed("ik"), move()])) == "selection"
    assert failure(plan(success=False, moves=[move(), failed("ik"), move(False)])) == "pick"
    assert failure(plan(success=False, moves=[failed("ik")])) == "pick"


@pytest.mark.parametrize(
    ("rule", "moves", "steps"),
    [
        ("deep", [], 0),
        ("deep", [move()] * 4, 4),
        ("deep", [move()] * 5, 5),
        ("deep", [failed("ik")] * 9 + [move()] * 5, 5),
        ("deep", [failed("ik")] * 9 + [move()] * 4, 4),
        ("strict", [failed("ik")] * 2 + [move()] * 2, 4),
        ("strict", [failed("ik")] * 2 + [move()] * 3, 5),
        ("region", [failed("ik", "a"), failed("ik", "a"), move(name="a"), *[move()] * 3], 4),
        ("region", [failed("ik", "a"), failed("ik", "a"), move(name="a"), *[move()] * 4], 5),
        ("region", [failed("ik", "a"), failed("ik", "b"), failed("ik", "b"), move(name="c"), move(), move()], 5),
        ("region", [failed("ik", "a"), failed("ik", "b"), move(name="b"), move(), move()], 4),
        ("region", [failed("ik", "a"), failed("ik", "a"), failed("ik", "a")], 1),
        ("region", [move(), failed("ik", "b"), failed("ik", "c"), failed("ik", "a"), move(name="z")], 5),
    ],
)
def test_the_steps_that_a_plan_took(rule: str, moves: list[Move], steps: int) -> None:
    """A lost step is one attempt (strict), or the attempts on one object (region); an object that is moved in the end has lost none."""
    assert episodes._steps(plan(rule=rule, moves=moves)) == steps
    if moves and moves[-1].done:
        assert failure(plan(rule=rule, success=False, moves=moves)) == ("retrieve" if steps >= 5 else "selection")


def test_moves_beyond_the_limit_count_too() -> None:
    assert failure(plan(success=False, moves=[move()] * 6)) == "retrieve"


@pytest.mark.parametrize(("allowed", "kind"), [(0, "retrieve"), (2, "retrieve"), (3, "selection"), (9, "selection")])
def test_all_moves_were_made_is_said_of_those_that_were_allowed(allowed: int, kind: str) -> None:
    """Through a file, too, which says how many, where they are not five."""
    made = replace(plan(success=False, moves=[move()] * min(allowed, 2)), max_moves=allowed)
    assert failure(made) == kind
    assert failure(plan_from_json(plan_to_json(made))) == kind
    assert ("max_moves" in plan_to_json(made)) == (allowed != 5)
    assert "max_moves" not in plan_to_json(replace(made, max_moves=5))
