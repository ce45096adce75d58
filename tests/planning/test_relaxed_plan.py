"""Relaxed plans on obstructions that are written down by hand, and against a search through all orders on random ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
import pytest

from planning.relaxed_plan import (
    MOST_SETS,
    Names,
    RelaxedPlan,
    gets_shorter,
    relaxed_plan,
    relaxed_plans,
    shortest_plans,
    still_holds,
    stuck_set,
)


class Written:
    """Obstructions from a table: for each object, what blocks each of its ways ("" for a free one; no way at all: an empty list)."""

    def __init__(self, ways: Mapping[str, Sequence[str]]) -> None:
        self.ways = {name: [frozenset(way) for way in ways] for name, ways in ways.items()}

    def free(self, name: str, standing: Names) -> bool:
        return any(not way & standing for way in self.ways[name])

    def blockers(self, name: str, standing: Names) -> Collection[Names]:
        here = {way & standing for way in self.ways[name]}
        return {way for way in here if not any(other < way for other in here)}

    @property
    def standing(self) -> Names:
        return frozenset(self.ways) - {"t"}


def order(ways: Mapping[str, Sequence[str]], **more: object) -> tuple[str, ...] | None:
    written = Written(ways)
    plan = next(relaxed_plans(written, "t", written.standing, **more), None)  # type: ignore[arg-type]
    return None if plan is None else plan.order


def test_nothing_has_to_go_where_a_way_is_free() -> None:
    assert order({"t": ["a", ""], "a": [""]}) == ()


def test_what_blocks_what_blocks_the_target_goes_first() -> None:
    assert order({"t": ["a"], "a": ["b"], "b": [""], "c": [""]}) == ("b", "a")


def test_the_way_with_fewer_blockers_in_all_is_taken_though_it_has_more_at_once() -> None:
    assert order({"t": ["a", "xy"], "a": ["b"], "b": ["c"], "c": [""], "x": [""], "y": [""]}) == ("x", "y")


def test_a_way_around_is_found_where_two_block_each_other() -> None:
    assert order({"t": ["a"], "a": ["b", "c"], "b": ["a"], "c": [""]}) == ("c", "a")


def test_objects_that_block_each_other_are_stuck() -> None:
    ways = {"t": ["a"], "a": ["b"], "b": ["a"], "c": ["a", ""]}
    assert order(ways) is None
    written = Written(ways)
    assert stuck_set(written, written.standing) == {"a", "b"}


def test_a_target_without_a_way_has_no_plan_though_all_can_go() -> None:
    written = Written({"t": [], "a": [""]})
    assert relaxed_plan(written, "t", written.standing) is None
    assert stuck_set(written, written.standing) == frozenset()


def test_no_plan_is_longer_than_asked_for() -> None:
    ways = {"t": ["a"], "a": ["b"], "b": ["c"], "c": [""]}
    assert order(ways, most=3) == ("c", "b", "a")
    assert order(ways, most=2) is None


def test_what_can_not_go_first_waits_for_another() -> None:
    ways = {"t": ["a"], "a": [""], "b": ["c"], "c": [""]}
    assert order(ways, not_first=frozenset("a")) == ("c", "a")
    assert order({"t": ["a"], "a": [""]}, not_first=frozenset("a")) is None


def test_costs_decide_between_plans_of_one_length_only() -> None:
    ways = {"t": ["a", "b", "cd"], "a": [""], "b": [""], "c": [""], "d": [""]}
    assert order(ways, cost=lambda name: {"a": 2.0, "b": 1.0}.get(name, 0.0)) == ("b",)


def test_all_shortest_plans_and_what_can_go_first_in_them() -> None:
    written = Written({"t": ["ab", "bc", "abc"], "a": [""], "b": ["a", "c"], "c": [""]})
    plans = shortest_plans(relaxed_plans(written, "t", written.standing))
    assert [(set(plan.order), plan.firsts) for plan in plans] == [({"a", "b"}, ("a",)), ({"b", "c"}, ("c",))]


def test_names_decide_between_plans_that_cost_the_same() -> None:
    assert order({"t": ["bc", "ad"], "a": [""], "b": [""], "c": [""], "d": [""]}) == ("a", "d")


def test_a_question_ends_after_its_sets() -> None:
    ways = {"t": ["a", "b"], "a": [], "b": [""]}
    assert order(ways, most_sets=1) is None
    assert order(ways, most_sets=2) == ("b",)


def test_an_order_holds_while_each_can_go_in_its_turn_and_the_target_at_last() -> None:
    written = Written({"t": ["ab"], "a": ["b"], "b": [""], "c": ["a"]})
    for names, holds in (("ba", True), ("ab", False), ("b", False), ("bac", True), ("", False)):
        assert still_holds(written, "t", written.standing, names) == holds


@pytest.mark.parametrize(
    ("name", "there", "shorter"),
    [
        ("a", {"t": ["b"], "a": [""], "b": [""]}, True),  # the rest of the plan holds
        ("a", {"t": ["ab"], "a": [""], "b": [""]}, False),  # as before
        ("a", {"t": ["c", "ab"], "a": [""], "b": ["a"]}, True),  # another plan is shorter
        ("a", {"t": ["ac"], "a": [""], "b": [""]}, False),  # another is as long
        ("c", {"t": [""], "a": [""], "b": [""]}, False),  # c does not go first in any plan
    ],
)
def test_a_move_makes_a_plan_shorter(name: str, there: Mapping[str, Sequence[str]], shorter: bool) -> None:
    before = Written({"t": ["ab"], "a": [""], "b": [""], "c": [""]})
    plans = shortest_plans(relaxed_plans(before, "t", before.standing))
    assert gets_shorter(Written({**there, "c": [""]}), "t", before.standing, plans, name) is shorter


def test_a_plan_of_one_gets_shorter_where_the_target_is_free() -> None:
    before = Written({"t": ["a"], "a": [""]})
    plans = shortest_plans(relaxed_plans(before, "t", before.standing))
    for way, shorter in (("", True), ("a", False)):
        assert gets_shorter(Written({"t": [way], "a": [""]}), "t", before.standing, plans, "a") is shorter


@pytest.mark.parametrize("seed", range(60))
def test_the_shortest_of_all_orders_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = "abcdefg"[: int(rng.integers(2, 8))]
    ways = {name: ["".join(o for o in names if o != name and rng.random() < 0.3) for _ in range(rng.integers(0, 4))] for name in names}
    ways["t"] = ["".join(o for o in names if rng.random() < 0.4) for _ in range(rng.integers(1, 4))]
    not_first = frozenset(n for n in names if rng.random() < 0.2)
    written = Written(ways)
    plan = next(relaxed_plans(written, "t", written.standing, not_first=not_first), None)
    assert (None if plan is None else plan.length) == breadth_first(written, not_first)
    here = written.standing
    for i, name in enumerate(plan.order if plan else ()):
        assert written.free(name, here - {name})
        assert i > 0 or name not in not_first
        here -= {name}
    assert plan is None or written.free("t", here)
    if not not_first:
        assert (plan is None) == (not written.free("t", stuck_set(written, written.standing)))


def breadth_first(written: Written, not_first: Names) -> int | None:
    queue, seen = deque([(0, written.standing)]), {written.standing}
    while queue:
        gone, here = queue.popleft()
        if written.free("t", here):
            return gone
        for name in here:
            after = here - {name}
            if after not in seen and written.free(name, after) and (gone > 0 or name not in not_first):
                seen.add(after)
                queue.append((gone + 1, after))
    return None


def test_of_what_can_go_first_the_cheapest_does() -> None:
    ways = {"t": ["ab"], "a": [""], "b": [""]}
    (plan,) = relaxed_plans(Written(ways), "t", frozenset("ab"), cost={"a": 2.0, "b": 1.0}.__getitem__)
    assert (plan.order, plan.firsts) == (("b", "a"), ("b", "a"))
    (plan,) = relaxed_plans(Written(ways), "t", frozenset("ab"))
    assert plan.order == ("a", "b")


def test_nothing_waits_for_others_that_only_what_stands_aside_does_not_get_to() -> None:
    """x waits for y alone; that the arm does not get to w, which is in nobody's way, makes no plan with v."""
    written = Written({"t": ["x"], "x": ["y"], "y": [""], "w": [""], "v": [""]})
    assert [plan.order for plan in relaxed_plans(written, "t", written.standing, not_first=frozenset("w"))] == [("y", "x")]


def test_shortest_plans_ask_for_one_that_is_longer_and_no_more() -> None:
    def plans() -> Iterator[RelaxedPlan]:
        yield from (RelaxedPlan(tuple(order), tuple(order)) for order in ("a", "b", "cd"))
        raise AssertionError("nobody needs another")

    assert [plan.order for plan in shortest_plans(plans())] == [("a",), ("b",)]


def test_the_numbers_of_relaxed_plans() -> None:
    assert MOST_SETS == 20_000
