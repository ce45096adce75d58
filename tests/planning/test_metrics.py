"""Table I from plans: every column, pairs and headlines, worked out by hand on plans without motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bare_plans import episode, failed, plan

from planning.episodes import SENSED, Episode
from planning.metrics import MEASURES, PAPER, SHARES, PaperRow, headlines, pairs, rows, rule_rank
from planning.plan import Blocked, Fault, Motion, Move, Unsolvable
from planning.statistics import Difference, Share, Spread, bootstrap, mcnemar, newcombe, quantiles, wilson

# ------------------------------------------------------------------------------------------------------------------ bounds, proofs, reasons


def test_moves_are_held_against_the_bound_that_any_planner_knows() -> None:
    """Three scenes: b's bound is 2, c's is proved by another planner to have none; a planner that knows no bound is judged by theirs."""
    proof = Unsolvable(("box_1",), ())
    knows = [episode("a", "search", least_moves=1), episode("b", "search", moved=2, least_moves=2)]
    knows += [episode("c", "search", success=False, moved=0, unsolvable=proof)]
    other = [episode("a", "random", moved=3), episode("b", "random", moved=2, least_moves=1), episode("c", "random", success=False)]
    random, search = rows([*other, *knows])
    assert (search.least, search.at_least, search.proved) == ((3, 3, 2), 2, 1)
    assert (random.least, random.at_least, random.proved) == ((5, 3, 2), 1, 1)
    many = Episode.of(plan("a", "search", success=False, reason=Blocked("moves"), least_moves=6))
    assert [row.proved for row in rows([many, episode("a", success=False)])] == [1, 1]
    (alone,) = rows([episode("a", moved=3), episode("c", success=False)])
    assert (alone.least, alone.at_least, alone.proved) == ((0, 0, 0), 0, 0)
    (free,) = rows([episode("a", moved=0, least_moves=0)])  # nothing to be held against
    assert (free.least, free.at_least) == ((0, 0, 0), 0)


def test_what_is_proved_and_yet_solved_counts_as_solved() -> None:
    """A search with few grasps may prove what is not so."""
    wrong = episode("a", "search", success=False, unsolvable=Unsolvable(("box_1",), ()))
    assert [(row.policy, row.proved) for row in rows([wrong, episode("a")])] == [("random", 0), ("search", 1)]


def motion(stage: str, clearance_m: float | None) -> Motion:
    return Motion(stage, ("j",), np.zeros((1, 1)), np.zeros(1), clearance_m=clearance_m)


def test_the_clearance_of_a_plan_is_its_motions_least_and_that_of_its_free_ones_apart() -> None:
    """A lift at 1 mm counts for all motions and not for the free ones; failures and what nobody measured count for neither."""
    near = [motion("transit", 0.006), motion("lift", 0.001), motion("transfer", 0.0042)]
    far = [motion("transit", 0.009), motion("release", None)]
    plans = [replace(plan(str(i)), motions=tuple(m)) for i, m in enumerate((far, near, [motion("transit", None)]))]
    plans.append(replace(plan("f", success=False, reason=Blocked("lift")), motions=tuple(near)))
    (row,) = rows(Episode.of(p) for p in plans)
    assert row.clearance_m == (0.001, 0.009)
    assert row.free_clearance_m == (0.0042, 0.009)


def test_the_most_frequent_reason_comes_first() -> None:
    def stopped(body: str) -> Move:
        return Move("can_1", 0, np.eye(4), np.eye(4), False, Blocked("approach", "camera", body))

    far = Move("can_1", 0, np.eye(4), np.eye(4), False, Blocked("ik"))
    plans = [plan(success=False, reason=Blocked("approach", "camera", "box_1"), moves=[far, stopped("box_1"), stopped("can_2")])]
    (row,) = rows([Episode.of(p) for p in plans])
    assert dict(row.kept_in) == {"camera would touch another object (approach)": 1}
    assert list(row.stopped.items()) == [("camera would touch another object (approach)", 2), ("ik", 1)]


def test_what_the_fingers_pushed_is_counted_and_no_other_note() -> None:
    """One object each, with an amount: pairs of links that an SRDF switches off, and what falls over, are notes of other kinds."""
    notes = (
        Fault("grasp", ("a",), "", 0.003), Fault("grasp", ("b",), "", 0.001), Fault("look", (), "", 0.04),
        Fault("grasp", ("hand", "arm"), "", 0.002), Fault("grasp", ("c",), "falls over", None),
    )  # fmt: skip
    (row,) = rows([Episode.of(plan("s", notes=notes)), Episode.of(plan("t")), Episode.of(plan("u", success=False, notes=notes[:1]))])
    assert (row.pushed_m, row.pushing) == ((0.001, 0.003, 0.003), 2)


def test_the_names_in_reports() -> None:
    measures = ("moved", "planning_time_s", "motion_time_s", "relocation_travel_m", "hand_travel_m", "duration_s", "value")
    assert measures == MEASURES
    assert set(MEASURES) <= set(Episode.__dataclass_fields__)
    assert SHARES == (0.1, 0.5, 0.9, 0.95)
    assert sorted(["zzz", "strict", "deep", "aaa", "region"], key=rule_rank) == ["deep", "region", "strict", "aaa", "zzz"]


# ------------------------------------------------------------------------------------------------------------------------------------- rows


def test_a_row_by_hand() -> None:
    """Four scenes, one of them planned twice; times of 1, 2, 3 s (solved), 9 and 8 s (failed)."""
    episodes = [
        episode("b", moved=3, planning_time_s=1.0, motion_time_s=2.0, hand_travel_m=2.0, value=-3.0, verified=False),
        episode("a", moved=1, planning_time_s=0.75, motion_time_s=0.25, hand_travel_m=1.0, value=-1.0),
        episode("c", moved=1, planning_time_s=0.5, motion_time_s=1.5, hand_travel_m=3.0, value=-5.0),
        episode("d", success=False, moved=5, planning_time_s=4.0, motion_time_s=5.0, hand_travel_m=4.0, value=-7.0, verified=False),
        Episode.of(plan("d", success=False, moves=[failed("lower"), failed("ik")], reason=Blocked("grasp"), planning_time_s=3.0)),
    ]
    (row,) = rows(episodes, {"a": 4, "b": 6, "c": 4, "d": 6, "elsewhere": 9})
    assert (row.policy, row.rule) == ("random", "deep")
    assert row.success == wilson(3, 5)
    assert row.over_successes["moved"] == Spread(pytest.approx(5 / 3), pytest.approx((4 / 3) ** 0.5), 3)
    assert row.over_all["moved"] == Spread(2.0, 2.0, 5)
    assert row.over_successes["hand_travel_m"] == Spread(2.0, 1.0, 3)
    assert row.over_successes["value"] == Spread(-3.0, 2.0, 3)
    assert row.over_all["planning_time_s"] == Spread(pytest.approx(1.85), pytest.approx(np.std([0.75, 1, 0.5, 4, 3], ddof=1)), 5)
    assert row.over_all["motion_time_s"].n == 5  # type: ignore[union-attr]
    assert set(row.over_successes) == set(row.over_all) == set(MEASURES)
    assert list(row.by_moves.items()) == [(1, 2), (3, 1)]
    assert list(row.by_objects.items()) == [(4, wilson(2, 2)), (6, wilson(1, 3))]
    assert row.failures == {"place": 1, "retrieve": 1}
    assert list(row.failures) == ["place", "retrieve"]
    assert row.failed_at == {"transfer": 1, "grasp": 1}
    assert row.blocked_at == {"lower": 1, "ik": 1}
    assert row.planning_s == quantiles([0.75, 1.0, 0.5, 4.0, 3.0], SHARES)
    assert row.whole_s == quantiles([1.0, 3.0, 2.0], SHARES)
    assert row.solved_s == (1.0, 2.0, 3.0)
    assert (row.unverified, row.repeated) == (1, 1)


def test_the_most_frequent_reasons_stand_first() -> None:
    reasons = ["lift", "ik", "ik", "grasp", "ik", "grasp"]
    episodes = [Episode.of(plan(f"{i}", success=False, reason=Blocked(r), moves=[failed(r)])) for i, r in enumerate(reasons)]
    (row,) = rows(episodes)
    assert list(row.failed_at.items()) == list(row.blocked_at.items()) == [("ik", 3), ("grasp", 2), ("lift", 1)]
    assert row.over_successes["moved"] is None
    assert (row.by_objects, row.solved_s, row.whole_s, row.by_moves) == ({}, (), (), {})


def test_scenes_whose_objects_are_not_known_are_left_out_of_that_column() -> None:
    (row,) = rows([episode("a"), episode("b", success=False), episode("c", success=False)], {"b": 5, "c": 5})
    assert row.by_objects == {5: wilson(0, 2)}
    assert row.success == wilson(1, 3)
    (row,) = rows([episode("a"), episode("b")], {"b": 5})
    assert row.by_objects == {5: wilson(1, 1)}


def test_rows_stand_rule_by_rule_in_the_order_of_table_1() -> None:
    """Planners and rules that the paper does not have come after those that it has, by name."""
    policies = ("zebra", "search", "rrt", "rpnet-only", "osnet-only", "neural", "local", "random")
    names = [(p, r) for p in policies for r in ("wild", "strict", "odd", "region", "deep")]
    found = [(row.policy, row.rule) for row in rows(episode("a", p, r) for p, r in names)]
    in_order = ["random", "local", "neural", "osnet-only", "rpnet-only", "rrt", "search", "zebra"]
    assert found == [(p, r) for r in ("deep", "region", "strict", "odd", "wild") for p in in_order]
    assert rows([]) == []


# ------------------------------------------------------------------------------------------------------------------------- pairs, headlines


def test_a_pair_by_hand() -> None:
    """Fourteen scenes that both tried: both solved 2, one alone 4 and 3, none 5; travel differs by 1 and by 2 m where both solved."""
    scenes = "abcdefghijklmn"
    mine = [episode(s, "neural", success=s in "abcdef", hand_travel_m=3.0) for s in scenes]
    other = [episode(s, "random", success=s in "abghi", hand_travel_m=2.0 if s == "a" else 1.0, value=-4.5) for s in reversed(scenes)]
    (pair,) = pairs([*mine, *other])
    assert (pair.a, pair.b) == (("neural", "deep"), ("random", "deep"))
    assert (pair.both, pair.only_a, pair.only_b, pair.neither) == (2, 4, 3, 5)
    assert pair.success == newcombe(2, 4, 3, 5)
    assert pair.p == mcnemar(4, 3)
    assert set(pair.measures) == set(MEASURES)
    assert pair.measures["hand_travel_m"] == bootstrap([1.0, 2.0])
    assert pair.measures["value"] == Difference(0.5, 0.5, 0.5, 2)
    assert pair.measures["moved"] == Difference(0.0, 0.0, 0.0, 2)


def test_only_scenes_that_each_tried_once_are_compared() -> None:
    mine = [episode(s, "neural") for s in "abbc"]
    other = [episode(s, "random") for s in "abccx"]
    (pair,) = pairs([*mine, *other])
    assert pair.success.n == 1
    assert pairs([episode("a", "neural"), episode("b", "random")]) == []
    assert pairs([episode("a", "neural"), episode("a", "random"), episode("a", "random")]) == []
    assert pairs([]) == []


def test_planners_are_compared_that_differ_in_policy_or_in_rule_but_not_in_both() -> None:
    names = [("random", "deep"), ("local", "deep"), ("random", "strict"), ("local", "strict"), ("local", "region")]
    found = [(p.a, p.b) for p in pairs(episode("a", *name) for name in names)]
    assert found == [
        (("local", "deep"), ("random", "deep")),
        (("random", "strict"), ("random", "deep")),
        (("local", "region"), ("local", "deep")),
        (("local", "strict"), ("local", "deep")),
        (("local", "strict"), ("local", "region")),
        (("local", "strict"), ("random", "strict")),
    ]


def test_headlines_are_our_planner_over_the_baselines_under_one_rule() -> None:
    names = [(p, r) for r in ("deep", "strict") for p in ("random", "local", "neural", "osnet-only", "search")]
    episodes = [episode(s, p, r, success=p == "neural" or s in "ab" or (p, s) == ("local", "c")) for p, r in names for s in "abcd"]
    found = headlines(pairs(episodes))
    assert [(h.rule, h.first, h.second) for h in found] == [
        (rule, "neural", other) for rule in ("deep", "strict") for other in ("random", "local")
    ]
    d = newcombe(2, 2, 0, 0)
    assert found[0].points == Difference(pytest.approx(50.0), pytest.approx(100 * d.low), pytest.approx(100 * d.high), 4)
    assert found[1].points.mean == pytest.approx(25.0)
    assert [(h.first, h.second) for h in headlines(pairs(episodes), "search", ["osnet-only"])] == [("search", "osnet-only")] * 2
    assert headlines(pairs(episodes), "random") == []


# -------------------------------------------------------------------------------------------------------------------------------- the paper

TABLE_1 = """
random      45  1.689 0.962  0.001 0.001  1.97  1.204
local       55  1.745 0.976  3.307 1.669  1.62  0.734
neural      72  1.722 0.803  0.014 0.006  1.647 0.856
osnet-only  71  1.662 0.903  2.987 1.636  2.074 1.185
rpnet-only  47  1.638 0.783  0.010 0.005  1.808 0.913
rrt         71  1.69  0.897  8.957 7.735  1.575 0.836
"""


def test_the_papers_table() -> None:
    """Success of 100, then mean and standard deviation of objects moved, planning time and hand travel over the successes."""
    printed = [line.split() for line in TABLE_1.strip().splitlines()]
    assert [row.policy for row in PAPER] == [p[0] for p in printed]
    for row, (_, k, *figures) in zip(PAPER, printed):
        assert row.success == wilson(int(k), 100)
        means, sds = [float(f) for f in figures[::2]], [float(f) for f in figures[1::2]]
        assert [row.moved, row.planning_time_s, row.relocation_travel_m] == [Spread(m, s, int(k)) for m, s in zip(means, sds)]
        assert row.printed == (row.policy != "rrt")
    assert isinstance(PAPER[0].success, Share)


def test_the_papers_measures_by_name() -> None:
    row = PAPER[2]
    assert row.spreads() == {
        "moved": row.moved, "planning_time_s": row.planning_time_s, "motion_time_s": None,
        "relocation_travel_m": row.relocation_travel_m, "hand_travel_m": None, "duration_s": None, "value": None,
    }  # fmt: skip
    assert PaperRow("x", row.success, row.moved, row.moved, row.moved).printed


def test_plans_after_sensing_are_a_planner_of_their_own() -> None:
    look = Motion("look", ("j",), np.zeros((1, 1)), np.zeros(1))
    sensed = Episode.of(replace(plan("a", "local"), motions=(look,)))
    found = rows([sensed, episode("a", "local"), episode("a", "search")])
    assert [row.policy for row in found] == ["local", f"local{SENSED}", "search"]
    assert [row.repeated for row in found] == [0, 0, 0]
