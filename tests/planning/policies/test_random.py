"""The random baseline: every order of objects and of free regions, one as likely as another, and nothing but the generator decides."""

from __future__ import annotations

from collections import Counter

import numpy as np
from fakes import observation

from planning.policies.random import random_object, random_region
from planning.policies.regions import free_regions

SEEN = observation({"target": (0.35, 0, 0.06, 0.06, 0.06, 0.12), "a": (0.05, 0.15, 0.06, 0.06, 0.06, 0.12),
                    "b": (0.15, -0.15, 0.06, 0.06, 0.06, 0.12), "c": (0.25, 0.15, 0.06, 0.06, 0.06, 0.12)}, unseen=[8])  # fmt: skip


def test_all_orders_of_the_objects_are_drawn_equally_often() -> None:
    """Six orders of three objects, never the target: 600 draws, each order 100 ± 4.4 σ times."""
    orders = Counter(tuple(random_object(SEEN, np.random.default_rng(seed))) for seed in range(600))
    assert set(orders) == {("a", "b", "c"), ("a", "c", "b"), ("b", "a", "c"), ("b", "c", "a"), ("c", "a", "b"), ("c", "b", "a")}
    assert all(60 <= n <= 140 for n in orders.values())


def test_regions_are_the_free_ones_each_once_and_any_may_be_first() -> None:
    free = free_regions(SEEN, "a").tolist()
    firsts = Counter[int]()
    for seed in range(400):
        drawn = random_region(SEEN, "a", np.random.default_rng(seed))
        assert sorted(drawn) == free
        assert all(type(i) is int for i in drawn)
        firsts[drawn[0]] += 1
    assert set(firsts) == set(free)
    assert max(firsts.values()) < 3 * 400 / len(free)


def test_the_generator_alone_decides() -> None:
    """The same state of the generator, the same answer; and it moves on with each answer."""
    one, other = np.random.default_rng(7), np.random.default_rng(7)
    drawn = [(random_object(SEEN, one), random_region(SEEN, "b", one)) for _ in range(5)]
    assert drawn == [(random_object(SEEN, other), random_region(SEEN, "b", other)) for _ in range(5)]
    assert len({tuple(regions) for _, regions in drawn}) > 1


def test_the_draw_is_numpys_permutation() -> None:
    """Plans of seeds that were published stay what they are."""
    names, free = SEEN.movable, free_regions(SEEN, "c")
    assert list(random_object(SEEN, np.random.default_rng(3))) == [names[i] for i in np.random.default_rng(3).permutation(len(names))]
    assert list(random_region(SEEN, "c", np.random.default_rng(3))) == np.random.default_rng(3).permutation(free).tolist()
