"""How much the look ahead asks: quick, thorough and exhaustive looks, and how they share the attempts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from looking_ahead import IN_ORDER, SOME, asked, look, no_proof, proved
from written_world import WrittenWorld, at_first

from perception.observation import observe
from planning.policies.lookahead import NEAREST, VARIED_SHARE, Lookahead
from planning.policies.search import Effort


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


VARIED_16 = round(VARIED_SHARE * 16)
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
    at_last = [region for _, region in world.tried[6 + 3 + 4 + VARIED_16 :]]
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


def test_where_only_the_exhaustive_look_holds_out_hope_of_a_last_search_there_is_but_the_varied_one() -> None:
    can_go = at_first({"t": ["a"], "a": [""]})
    world = WrittenWorld("a", at_first({"t": ["a"], "a": []}), can=lambda choice: False, finest=can_go)
    asked(Lookahead(world, NEAR_AND_LIKELY, Effort(attempts=9, last=16), no_proof, most=1), world)
    assert len(world.tried) == 9 + 4 + VARIED_16


def test_where_nothing_natural_does_picks_unlike_one_another_are_tried_before_many_attempts_are_made() -> None:
    """Of the regions of a's move, the nearest alone: as many attempts as a tenth of the last search's."""
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), can=lambda choice: False, can_varied=lambda choice: choice[1] > 0)
    ((name, region),) = asked(Lookahead(world, NEAR_AND_LIKELY, Effort(attempts=9, last=16), no_proof, most=1), world)
    assert name == "a"
    assert region > 0
    assert len(world.tried) <= 6 + 3 + 4 + VARIED_16
    world.tried.clear()
    assert asked(Lookahead(world, NEAR_AND_LIKELY, Effort(attempts=9), no_proof, most=1), world) == []  # of quick policies nothing is left


def test_with_no_other_order_of_regions_nothing_is_tried_once_more() -> None:
    world = WrittenWorld("a", at_first({"t": ["a"], "a": [""]}), can=lambda choice: False)
    assert asked(Lookahead(world, IN_ORDER, Effort(attempts=9), no_proof, most=5), world) == []
    assert len(world.tried) == 9


def test_likelier_places_do_not_make_a_plan_shorter() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    assert asked(Lookahead(world, NEAR_AND_LIKELY, SOME, no_proof, most=1), world) == []
    assert not world.tried
