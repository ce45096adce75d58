"""Means, shares, quantiles and paired differences, each with its 95 % interval, from few numbers and for shares near 0 and 1 as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb, sqrt

import numpy as np
from numpy.typing import NDArray

Z_95 = 1.959963984540054
RESAMPLES = 4000


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation (of the sample; None when n < 2) of n values."""

    mean: float
    sd: float | None
    n: int


@dataclass(frozen=True)
class Share:
    """k of n, with the 95 % Wilson interval: low and high as shares."""

    k: int
    n: int
    low: float
    high: float


@dataclass(frozen=True)
class Difference:
    """The mean of a − b over n scenes, with its 95 % interval."""

    mean: float
    low: float
    high: float
    n: int


def wilson(k: int, n: int) -> Share:
    """The share k / n with its 95 % Wilson score interval (E. B. Wilson, JASA 22, 1927); [0, 1] when n = 0."""
    if n == 0:
        return Share(0, 0, 0.0, 1.0)
    p, zz = k / n, Z_95**2
    centre, half = (p + zz / (2 * n)) / (1 + zz / n), Z_95 * sqrt(p * (1 - p) / n + zz / (4 * n * n)) / (1 + zz / n)
    return Share(k, n, 0.0 if k == 0 else centre - half, 1.0 if k == n else centre + half)


def spread(values: Sequence[float]) -> Spread | None:
    """Mean and sample standard deviation; None of nothing."""
    if not values:
        return None
    return Spread(float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else None, len(values))


def quantiles(values: Sequence[float], shares: Sequence[float]) -> tuple[float, ...]:
    """The values below which each share of them lies, between two of them in proportion; () of nothing."""
    return tuple(float(q) for q in np.quantile(values, shares)) if values else ()


def newcombe(both: int, only_a: int, only_b: int, neither: int) -> Difference:
    """The difference of two paired shares with its 95 % interval: method 10 of R. G. Newcombe, Statistics in Medicine 17, 1998.

    It joins the Wilson intervals of both shares by their correlation, and holds for few scenes and for shares near 0 and 1.
    """
    n = both + only_a + only_b + neither
    a, b = wilson(both + only_a, n), wilson(both + only_b, n)
    pa, pb = a.k / n, b.k / n
    product = a.k * (n - a.k) * b.k * (n - b.k)
    excess = both * neither - only_a * only_b
    phi = 0.0 if product == 0 else (max(excess - n / 2, 0) if excess > 0 else excess) / sqrt(product)
    below, above = (pa - a.low, b.high - pb), (a.high - pa, pb - b.low)
    low, high = (sqrt(max(x * x - 2 * phi * x * y + y * y, 0.0)) for x, y in (below, above))
    return Difference(pa - pb, pa - pb - low, pa - pb + high, n)


def mcnemar(only_a: int, only_b: int) -> float:
    """How likely a split of the scenes that just one planner solved would be at least so uneven by chance: exact, two-sided."""
    n = only_a + only_b
    return min(1.0, sum(comb(n, i) for i in range(min(only_a, only_b) + 1)) / 2 ** (n - 1)) if n else 1.0


def bootstrap(differences: Sequence[float]) -> Difference | None:
    """Percentile bootstrap of the mean, with a fixed seed: the same plans give the same report. None of fewer than two."""
    n = len(differences)
    if n < 2:
        return None
    values = np.array(differences, float)
    low, high = np.quantile(values[_resamples(n)].mean(1), [0.025, 0.975])
    return Difference(float(values.mean()), float(low), float(high), n)


@lru_cache(maxsize=1)
def _resamples(n: int) -> NDArray[np.int64]:
    """(RESAMPLES, n) indices, the same for every measure of a pair."""
    return np.random.default_rng(0).integers(n, size=(RESAMPLES, n))
