"""The glance: what alone is in the way is proposed before anything is tried."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from looking_ahead import IN_ORDER, SOME, asked, look, no_proof, rng
from written_world import WrittenWorld, at_first

from perception.observation import Observation, observe
from planning.policies.lookahead import Lookahead
from planning.policies.search import Preferences


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


def test_two_blockers_are_not_for_a_glance() -> None:
    world = WrittenWorld("ab", at_first({"t": ["ab"], "a": [""], "b": [""]}))
    first = asked(look(world, glance=True), world)
    assert len(first) == 1
    assert world.tried
    stuck = WrittenWorld("ab", at_first({"t": ["ab"], "a": ["b"], "b": ["a"]}))
    policy = look(stuck, glance=True)
    assert asked(policy, stuck) == []
    assert policy.outlook.least_moves is None  # one would be too few, and no number would do


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
