"""The columns of Table I: figures worked out by hand, intervals against published examples, and every form of the report as a golden file.

`RETRIEVE_GOLDEN=write pytest tests/retrieve_cli/reporting` writes the golden files anew; read the difference before you commit it.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import documents
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.errors import InputError
from planning import metrics
from planning.episodes import KINDS, Episode, _attempt_kind, failure
from planning.io.plan_documents import plan_from_json
from planning.metrics import PAPER
from planning.plan import PLACE_OUT_OF_REACH, Blocked
from planning.rules import MAX_MOVES
from planning.statistics import Spread, bootstrap, mcnemar, newcombe, quantiles, spread, wilson
from retrieve_cli.report import collect, run
from retrieve_cli.reporting.forms import WRITERS, to_csv, to_html, to_json
from retrieve_cli.reporting.html import LABEL, PLOT, VALUE
from retrieve_cli.reporting.plots import time_axis
from retrieve_cli.reporting.tables import Report, tables

GOLDEN = Path(__file__).resolve().parents[2] / "golden"
TINY = {"random": 4e-16, "local": 0.0}
COUNTS = st.integers(0, 40)
OBJECTS = {f"0-{i:06d}": 4 + i // 2 for i in range(6)}


def episodes() -> list[Episode]:
    """Six scenes: random solves 2 of them, local 4 and, strictly, 1; figures that are easy to average."""
    found = []
    for policy, rule, solved in (("random", "deep", {0, 1}), ("local", "deep", {0, 1, 2, 3}), ("local", "strict", {4})):
        for i in range(6):
            document = documents.plan(f"0-{i:06d}", policy, rule, success=i in solved, moved=1 + i % 3)
            document["reason"] = document["reason"] and {"stage": "ik"}
            if i not in solved and policy == "local":
                document["moves"].append(document["moves"][0])
            document["planning_time_s"] = 0.001 * (1 + i)
            document["hand_travel_m"] = 1.0 + 0.25 * i if policy == "random" else 1.5
            found.append(Episode.of(plan_from_json(document)))
    return found


# Figures --------------------------------------------------------------------------------------------------------------------------------


def test_rows_by_hand() -> None:
    random, local, strict = metrics.rows(episodes())
    assert [(r.policy, r.rule, r.success.k, r.success.n) for r in (random, local, strict)] == [
        ("random", "deep", 2, 6),
        ("local", "deep", 4, 6),
        ("local", "strict", 1, 6),
    ]
    assert random.over_successes["moved"] == Spread(1.5, pytest.approx(0.5**0.5), 2)
    assert random.over_all["moved"] == Spread(2.0, pytest.approx(0.8**0.5), 6)
    assert random.over_successes["hand_travel_m"] == Spread(1.125, pytest.approx(0.03125**0.5), 2)
    assert random.over_all["planning_time_s"] == Spread(pytest.approx(0.0035), pytest.approx(0.0035**0.5 / 10**1.5, rel=1e-3), 6)
    assert strict.over_successes["value"] == Spread(-0.75, None, 1)
    assert local.by_moves == {1: 2, 2: 1, 3: 1}
    assert local.failed_at == {"ik": 2}
    assert local.blocked_at == {"transfer": 8}
    assert local.failures == {"place": 2}
    assert random.failures == {"selection": 4}
    assert local.solved_s == pytest.approx((0.201, 0.202, 0.203, 0.204))
    assert local.planning_s[1] == pytest.approx(0.0035)
    assert (local.unverified, local.repeated) == (0, 0)


def test_what_the_fingers_pushed_has_a_table_of_its_own() -> None:
    first, *others = episodes()
    assert "pushes" not in {t.key for t in tables(Report(metrics.rows([first, *others]), (), (), ()))}
    pushed = metrics.rows([replace(first, pushed_m=(0.0032, 0.001)), *others])
    (table,) = (t for t in tables(Report(pushed, (), (), ())) if t.key == "pushes")
    assert sorted(row[1:] for row in table.rows) == [*[("0", "0", "–", "–")] * 2, ("1", "2", "2.1", "3.2")]


def test_nothing_solved_is_no_error() -> None:
    (row,) = metrics.rows([e for e in episodes() if not e.success and e.policy == "random"])
    assert row.success.k == 0
    assert row.success.low == 0.0
    assert set(row.over_successes.values()) == {None}
    assert "–" in to_html(collect([e for e in episodes() if not e.success]))


def test_pairs_by_hand() -> None:
    pairs = {(p.a, p.b): p for p in metrics.pairs(episodes())}
    assert set(pairs) == {(("local", "deep"), ("random", "deep")), (("local", "strict"), ("local", "deep"))}
    pair = pairs[("local", "deep"), ("random", "deep")]
    assert (pair.both, pair.only_a, pair.only_b, pair.neither) == (2, 2, 0, 2)
    assert pair.success.mean == pytest.approx(1 / 3)
    assert pair.p == 0.5
    travel = pair.measures["hand_travel_m"]
    assert travel is not None
    assert (travel.mean, travel.n) == (pytest.approx(0.375), 2)  # 1.5 − 1.0 and 1.5 − 1.25
    assert travel.low == 0.25
    assert travel.high == 0.5
    assert pairs[("local", "strict"), ("local", "deep")].measures["moved"] is None  # no scene that both solved


def attempt(stage: str, object_name: str = "box_0", *, done: bool = False, detail: str | None = None) -> dict[str, Any]:
    reason = None if done else {"stage": stage, "detail": detail} if detail else {"stage": stage}
    return {**documents.plan()["moves"][0], "object": object_name, "done": done, "reason": reason}


MOVED = attempt("", done=True)


@pytest.mark.parametrize(
    ("rule", "moves", "stage", "kind"),
    [
        ("deep", [], "ik", "selection"),
        ("deep", [MOVED], "ik", "selection"),
        ("deep", [MOVED] * MAX_MOVES, "ik", "retrieve"),
        ("deep", [attempt("region")] * 9 + [MOVED], "ik", "selection"),
        ("strict", [attempt("region")] * (MAX_MOVES - 1) + [MOVED], "ik", "retrieve"),
        ("region", [attempt("region", "a"), attempt("region", "b"), attempt("ik", "b"), MOVED, MOVED, MOVED], "ik", "retrieve"),
        ("region", [attempt("region")] * 9 + [MOVED], "ik", "selection"),
        ("deep", [attempt("approach"), attempt("transit"), attempt("ik", detail="the grasp is out of reach")], "ik", "pick"),
        ("deep", [attempt("grasp"), attempt("region"), attempt("lift")], "ik", "region"),
        ("deep", [attempt("grasp"), attempt("ik", detail=PLACE_OUT_OF_REACH), attempt("region")], "ik", "place"),
        ("deep", [attempt("transfer"), MOVED, attempt("ik")], "ik", "pick"),
        ("strict", [attempt("lower"), attempt("retreat")], "approach", "place"),
        ("deep", [attempt("release")], "verify", "verify"),
        ("deep", [], "look", "look"),
    ],
)
def test_why_a_plan_failed(rule: str, moves: list[dict[str, Any]], stage: str, kind: str) -> None:
    document = documents.plan(rule=rule, success=False)
    document["moves"], document["reason"] = moves, {"stage": stage}
    plan = plan_from_json(document)
    assert failure(plan) == kind
    assert Episode.of(plan).kind == kind
    assert kind in KINDS


def test_every_stage_that_blocks_an_attempt_has_a_kind() -> None:
    """What motion planning says about moves is counted as pick, region or place, never as the policy's fault."""
    from planning.motion.handling import picking, placing

    stages = {*picking.STAGES.values(), *placing.STAGES.values(), "transit", "transfer", "grasp"}
    for stage in stages:
        assert _attempt_kind(Blocked(stage)) in ("pick", "region", "place"), stage


def test_success_by_number_of_objects() -> None:
    row = metrics.rows(episodes(), OBJECTS)[1]
    assert [(n, s.k, s.n) for n, s in row.by_objects.items()] == [(4, 2, 2), (5, 2, 2), (6, 0, 2)]
    assert sum(s.n for s in row.by_objects.values()) == row.success.n
    assert metrics.rows(episodes())[1].by_objects == {}


def test_headlines_are_the_networks_over_the_baselines() -> None:
    found = []
    for policy, solved in (("local", {0, 1}), ("neural", {0, 1, 2, 3}), ("random", {0})):
        for rule in ("strict", "deep"):
            found += [Episode.of(plan_from_json(documents.plan(f"{i}", policy, rule, success=i in solved))) for i in range(6)]
    report = collect(found)
    assert [(h.first, h.second, h.rule) for h in report.headlines] == [
        ("neural", "random", "deep"),
        ("neural", "local", "deep"),
        ("neural", "random", "strict"),
        ("neural", "local", "strict"),
    ]
    points = report.headlines[1].points
    assert (points.mean, points.n) == (pytest.approx(200 / 6), 6)
    assert points.low == pytest.approx(100 * newcombe(2, 2, 0, 2).low)
    assert "neural over local, deep | +33.3 [" in WRITERS[".md"](report)
    assert collect(episodes()).headlines == []


def test_times_on_a_logarithmic_axis() -> None:
    low, high, ticks = time_axis(0.03, 0.4)
    assert (10**low, 10**high) == (pytest.approx(0.02), pytest.approx(0.5))
    assert [word for _, word in ticks] == ["0.02", "0.05", "0.1", "0.2", "0.5"]
    assert [word for _, word in time_axis(0.001, 90)[2]] == ["0.001", "0.01", "0.1", "1", "10", "100"]


@given(st.floats(1e-5, 1e4), st.floats(1, 1e5))
def test_an_axis_holds_its_times(least: float, ratio: float) -> None:
    low, high, ticks = time_axis(least, least * ratio)
    assert 10**low <= least * (1 + 1e-6)
    assert 10**high >= least * ratio * (1 - 1e-6)
    assert low < high
    assert all(low <= at <= high for at, _ in ticks)


def test_quantiles_and_bootstrap_of_little() -> None:
    assert quantiles([], [0.5]) == ()
    assert quantiles([3.0, 1.0, 2.0], [0.5, 1.0]) == (2.0, 3.0)
    assert bootstrap([1.0]) is None
    d = bootstrap([1.0, 1.0, 1.0])
    assert d is not None
    assert (d.low, d.mean, d.high) == (1.0, 1.0, 1.0)


def test_pairs_need_the_same_scenes_once() -> None:
    first, second = documents.plan("a", "random"), documents.plan("b", "local")
    assert metrics.pairs([Episode.of(plan_from_json(d)) for d in (first, second)]) == []
    twice = [Episode.of(plan_from_json(d)) for d in (first, first, documents.plan("a", "local"))]
    assert metrics.pairs(twice) == []
    assert collect(twice).remarks == (["random deep: 1 plans are for scenes already counted; all are counted, but not compared in pairs"])


def test_unverified_successes_are_remarked() -> None:
    document = documents.plan()
    document["verified"] = False
    assert collect([Episode.of(plan_from_json(document))]).remarks == ["random deep: 1 of the successes were not verified"]


def test_wilson_as_published() -> None:
    share = wilson(81, 263)  # Newcombe, Statistics in Medicine 17 (1998) 857–872, table I
    assert (round(share.low, 4), round(share.high, 4)) == (0.2553, 0.3662)
    share = wilson(0, 20)
    assert (share.low, round(share.high, 4)) == (0.0, 0.1611)
    assert (wilson(0, 0).low, wilson(0, 0).high) == (0.0, 1.0)


def test_newcombe_as_published() -> None:
    """Newcombe, Statistics in Medicine 17 (1998) 2635–2650, method 10."""
    d = newcombe(36, 12, 2, 0)
    assert (round(d.mean, 4), round(d.low, 4), round(d.high, 4)) == (0.2, 0.0569, 0.3404)


def test_mcnemar_by_hand() -> None:
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(5, 5) == 1.0
    assert mcnemar(0, 6) == 2 / 64
    assert mcnemar(2, 10) == pytest.approx(2 * (1 + 12 + 66) / 4096)


@given(COUNTS, COUNTS, COUNTS, st.integers(1, 40))
def test_intervals_hold_what_they_should(both: int, only_a: int, only_b: int, neither: int) -> None:
    d, back = newcombe(both, only_a, only_b, neither), newcombe(both, only_b, only_a, neither)
    assert -1 <= d.low <= d.mean <= d.high <= 1
    assert (d.low, d.high) == (pytest.approx(-back.high), pytest.approx(-back.low))
    assert 0 <= mcnemar(only_a, only_b) <= 1
    share = wilson(both, both + neither)
    assert 0 <= share.low <= both / (both + neither) <= share.high <= 1


@given(st.lists(st.floats(-1e6, 1e6), min_size=1))
def test_spread_of_any_values(values: list[float]) -> None:
    s = spread(values)
    assert s is not None
    assert min(values) - 1e-6 <= s.mean <= max(values) + 1e-6
    assert (s.sd is None) == (len(values) == 1)


def test_the_paper() -> None:
    assert [(p.policy, p.success.k) for p in PAPER] == [
        ("random", 45),
        ("local", 55),
        ("neural", 72),
        ("osnet-only", 71),
        ("rpnet-only", 47),
        ("rrt", 71),
    ]
    assert [p.policy for p in PAPER if not p.printed] == ["rrt"]
    assert PAPER[2].planning_time_s == Spread(0.014, 0.006, 72)


# Forms ----------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [e for e in WRITERS if e != ".json"])
def test_golden(ending: str) -> None:
    file = GOLDEN / f"report{ending}"
    text = WRITERS[ending](collect(episodes(), OBJECTS))
    if os.environ.get("RETRIEVE_GOLDEN") == "write":
        file.write_text(text, encoding="utf-8")
    assert text == file.read_text(encoding="utf-8")


def test_csv_has_every_figure_in_full() -> None:
    table = list(csv.DictReader(io.StringIO(to_csv(collect(episodes(), OBJECTS)))))
    assert [(r["source"], r["policy"], r["rule"], r["over"]) for r in table][:3] == [
        ("ours", "random", "deep", "successes"),
        ("ours", "random", "deep", "all"),
        ("ours", "random", "deep", "4 objects"),
    ]
    assert float(table[0]["success"]) == 2 / 6
    assert float(table[0]["whole_time_s_p50"]) == pytest.approx(0.2015)
    assert (table[1]["failed_selection"], table[1]["failed_place"]) == ("4", "0")
    assert (table[2]["solved"], table[2]["scenes"], table[2]["moved_mean"]) == ("2", "2", "")
    assert len(table) == 3 * (2 + 3) + 6
    assert all(set(line) == set(table[0]) for line in table)


def test_json_is_json() -> None:
    document: dict[str, Any] = json.loads(to_json(collect(episodes())))
    assert {"rows", "pairs", "headlines", "paper", "remarks"} == set(document)
    assert document["rows"][0]["over_successes"]["moved"]["mean"] == 1.5


class Page(HTMLParser):
    """What stands in a page: open tags must be closed in order, and nothing may come from outside."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "path"):
            self.open.append(tag)
        self.outside += [f"{k}={v}" for k, v in attrs if k in ("src", "href") or "url(" in (v or "")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        if tag != "path":
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_narrow_window_scrolls_the_drawings_instead_of_shrinking_their_words() -> None:
    html = to_html(collect(episodes(), OBJECTS))
    assert html.count("<svg") >= 2
    assert html.count("<svg") == html.count('<div class="scroll"><svg')
    assert re.search(r"\nsvg \{[^}]*min-width: \d+px", html)
    assert html.count("<table") == html.count('<div class="scroll"><table')
    shades = re.search(r"\n\.scroll \{[^}]*\}", html)
    assert shades is not None
    assert shades[0].count("no-repeat scroll") == 2, "a shade at each side says that there is more"
    assert shades[0].count("no-repeat local") == 2, "and goes where there is none"


def test_the_page_stands_alone_and_escapes() -> None:
    strange = documents.plan(policy="<b>&", rule="deep")
    html = to_html(collect([*episodes(), Episode.of(plan_from_json(strange))], OBJECTS))
    page = Page()
    page.feed(html)
    assert page.open == []
    assert page.outside == []
    assert "<b>& deep" in page.text
    assert "objects in the cabinet" in page.text
    assert "seconds of choosing and motion planning" in page.text
    assert "@import" not in html
    assert "http" not in html


@pytest.mark.parametrize("name", ["local", "a_rather_long_name_of_a_policy_of_ones_own"])
def test_the_chart_has_room_for_its_labels(name: str) -> None:
    """Labels end at x = LABEL - 14 and reach to the left as far as they need."""
    html = to_html(collect([Episode.of(plan_from_json(documents.plan(policy=name, rule="strict")))]))
    left, _, width, _ = map(int, re.findall(r'viewBox="(-?\d+) (-?\d+) (\d+) (\d+)"', html)[0])
    assert left + width == LABEL + PLOT + VALUE
    assert (left == 0) == (name == "local")
    assert LABEL - 14 - left >= 8 * len(f"{name} strict") or left == 0


def test_search_is_the_ceiling_not_the_winner() -> None:
    found = [Episode.of(plan_from_json(documents.plan(f"{i}", p, success=p == "search"))) for i in range(2) for p in ("search", "local")]
    html = to_html(collect(found))
    assert "The planner, <b>local deep</b>, retrieved it in <b>0 of 2</b> scenes" in html
    assert "Search, the ceiling, did so in 2 of 2." in html
    alone = to_html(collect(found[::2]))
    assert "The planner, <b>search deep</b>, retrieved it in <b>2 of 2</b> scenes" in alone
    assert "ceiling" not in alone


def test_tex_escapes() -> None:
    strange = documents.plan(policy="a_b{50%}\\", rule="deep")
    assert r"a\_b\{50\%\}\textbackslash{} deep" in WRITERS[".tex"](collect([Episode.of(plan_from_json(strange))]))


def test_no_difference_is_plain_zero() -> None:
    """Sums of the same ways in another order differ in their last bits."""
    found = [
        Episode.of(plan_from_json({**documents.plan(f"{i}", p), "hand_travel_m": 1.5 + tiny})) for i in range(3) for p, tiny in TINY.items()
    ]
    assert "| +0.00 [+0.00, +0.00] |\n" in WRITERS[".md"](collect(found))


def test_markdown_escapes() -> None:
    assert r"| a\|b deep |" in WRITERS[".md"](collect([Episode.of(plan_from_json(documents.plan(policy="a|b")))]))


# The command ----------------------------------------------------------------------------------------------------------------------------


@pytest.fixture
def plans(tmp_path: Path) -> Path:
    file = tmp_path / "plans.jsonl"
    file.write_text(documents.lines(*(documents.plan(f"0-{i}", success=i < 2) for i in range(4))))
    return file


def test_the_table_on_stdout(plans: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(plans=[plans, plans], scenes=[], out=[], as_json=False)
    out, err = capsys.readouterr()
    for words in ("random deep", "50 [21.5, 78.5]", "4 of 8", "random, paper", "1.689 ± 0.962", "rrt, paper", "moves 4"):
        assert words in out
    assert err == "note: random deep: 4 plans are for scenes already counted; all are counted, but not compared in pairs\n"


@pytest.mark.parametrize("ending", WRITERS)
def test_a_file_by_its_ending(ending: str, plans: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = plans.with_name("report" + ending.upper())
    run(plans=[plans], scenes=[], out=[out], as_json=False)
    assert out.read_text(encoding="utf-8") == WRITERS[ending](
        collect([Episode.of(plan_from_json(json.loads(x))) for x in plans.read_text().splitlines()])
    )
    assert capsys.readouterr() == ("", f"wrote {out}\n")


def test_json_beside_a_file(plans: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(plans=[plans], scenes=[], out=[plans.with_name("r.md"), plans.with_name("r.csv")], as_json=True)
    assert json.loads(capsys.readouterr().out)["rows"][0]["success"]["n"] == 4
    assert plans.with_name("r.md").is_file()
    assert plans.with_name("r.csv").is_file()


def test_an_unknown_ending_is_told_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"r.pdf: the ending says the form, and '.pdf' is not one of .md, .csv, .tex, .html, .json"):
        run(plans=[tmp_path / "missing.jsonl"], scenes=[], out=[Path("r.md"), Path("r.pdf")], as_json=False)


def test_scenes_say_how_many_objects_there_are(plans: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenes = tmp_path / "scenes.jsonl"
    scenes.write_text(documents.lines(*(documents.scene(f"0-{i}") for i in range(4))))
    run(plans=[plans], scenes=[scenes], out=[], as_json=True)
    by_objects = json.loads(capsys.readouterr().out)["rows"][0]["by_objects"]
    assert {n: (s["k"], s["n"]) for n, s in by_objects.items()} == {"3": (2, 4)}
    scenes.write_text(documents.lines(documents.scene("0-0")))
    with pytest.raises(InputError, match=r"plans.jsonl:2: none of the 1 scenes in .*scenes.jsonl is 0-1$"):
        run(plans=[plans], scenes=[scenes], out=[], as_json=True)
    fewer = documents.scene("0-0")
    fewer["objects"] = fewer["objects"][1:]
    scenes.write_text(documents.lines(documents.scene("0-0"), fewer))
    with pytest.raises(InputError, match=r"scenes.jsonl:2: another scene is called 0-0, too"):
        run(plans=[plans], scenes=[scenes], out=[], as_json=True)
    with pytest.raises(InputError, match=r"can't both come from stdin"):
        run(plans=[], scenes=[Path("-")], out=[], as_json=True)
