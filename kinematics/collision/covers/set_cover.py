"""Weighted set cover, greedy: few balls that hold all samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array

Int = NDArray[np.int64]
Bits = NDArray[np.uint64]


SPARE_M = 1e-12
"""Samples that are so much further from a ball's centre than its radius, along one axis, are not in it, whatever is rounded."""


class Held:
    """Which balls hold which samples, while more of both come: what is known of the earlier ones is not asked again."""

    def __init__(self) -> None:
        self._balls = np.empty((0, 4))
        self._blocks = list[Array]()
        self._holds = np.empty((0, 0), np.uint64)
        self._n = 0

    def add(self, centres: Array, radii: Array, samples: Array) -> None:
        """More balls, centres (B, 3) and radii (B,), and more samples (N, 3), which begin a word of their own."""
        balls, block = np.c_[centres, radii], _along(samples)
        left = [np.concatenate([_holding(balls, known) for known in self._blocks], 1)] if self._blocks else []
        old = np.concatenate([self._holds, _holding(self._balls, block)], 1)
        new = np.concatenate([*left, _holding(balls, block)], 1)
        self._holds, self._balls = np.concatenate([old, new]), np.concatenate([self._balls, balls])
        self._blocks.append(block)
        self._n += len(samples)

    def cover(self) -> Int:
        """Indices of few balls that hold every sample that some ball holds."""
        return weighted_set_cover(self._holds, self._n, np.ones(len(self._balls)), np.zeros(0, np.int64))[0]


def set_cover(centres: Array, radii: Array, samples: Array, fixed: Int) -> Int:
    """Indices of balls that hold every sample that some ball holds, the fixed ones among them."""
    return weighted_set_cover(_holding(np.c_[centres, radii], _along(samples)), len(samples), np.ones(len(radii)), fixed)[0]


def _along(samples: Array) -> Array:
    """Samples (N, 3) in a row along the axis on which they are furthest apart, so that a ball has only those between two to look at."""
    return samples[np.argsort(samples[:, np.ptp(samples, axis=0).argmax()])]


def _holding(balls: Array, samples: Array) -> Bits:
    """Which of balls (B, 4), centre and radius, holds which sample of `_along` (N, 3): words of 64 samples (B, N // 64 + 1)."""
    axis, centres, radii = int(np.ptp(samples, axis=0).argmax()), balls[:, :3].copy(), balls[:, 3].copy()
    first = np.searchsorted(samples[:, axis], centres[:, axis] - radii - SPARE_M)
    last = np.searchsorted(samples[:, axis], centres[:, axis] + radii + SPARE_M)
    holds = np.zeros((len(balls), len(samples) // 64 + 1), np.uint64)
    _samples_held(centres, radii, np.ascontiguousarray(samples.T), first, last, np.empty(len(samples), np.bool_), holds)
    return holds


@jit_entry
def _samples_held(centres: Array, radii: Array, samples: Array, first: Int, last: Int, some: NDArray[np.bool_], holds: Bits) -> None:
    """Set in holds (balls, words of 64 samples) which ball holds which sample, of samples (3, N), and of them first[i]:last[i] alone; some
    (N,): memory."""
    x, y, z = samples[0], samples[1], samples[2]
    for i in range(radii.shape[0]):
        a, b, c, rr = centres[i, 0], centres[i, 1], centres[i, 2], radii[i] * radii[i]
        for s in range(first[i], last[i]):
            some[s] = (x[s] - a) * (x[s] - a) + (y[s] - b) * (y[s] - b) + (z[s] - c) * (z[s] - c) <= rr
        for s in range(first[i], last[i]):
            if some[s]:
                holds[i, s >> 6] |= np.uint64(1) << np.uint64(s & 63)


def weighted_set_cover(holds: Bits, n: int, weights: Array, fixed: Int) -> tuple[Int, int]:
    """Greedy weighted set cover of the n columns of holds (balls, words of 64 columns), the fixed rows first, less the rows that nobody
    needs; and how many columns no row holds."""
    n_balls, n_words = holds.shape
    chosen, bare = np.empty(n_balls + 1, np.int64), np.full(n_words, 0xFFFFFFFFFFFFFFFF, np.uint64)
    m, left = _choose(holds, n, weights, fixed, np.empty(n_balls, np.int64), bare, chosen)
    kept = _keep_needed(holds, chosen, m, np.zeros((m + 1, n_words), np.uint64), np.zeros(n_words, np.uint64))
    return chosen[:kept].copy(), left


@jit_entry
def _choose(holds: Bits, n: int, weights: Array, fixed: Int, gain: Int, bare: Bits, chosen: Int) -> tuple[int, int]:
    """Fill in the rows chosen; returns how many, and how many columns are left. A row's gain only ever falls, so only rows that might still
    win are counted again. gain (balls,), bare (words,) all ones: memory."""
    for i in range(holds.shape[0]):
        gain[i] = _common(holds[i], bare)
    m, left = 0, n
    while left > 0 or m < fixed.shape[0]:
        best = fixed[m] if m < fixed.shape[0] else _best_row(holds, weights, gain, bare)
        if best < 0:
            break
        chosen[m] = best
        m += 1
        left -= _common(holds[best], bare)
        for s in range(bare.shape[0]):
            bare[s] &= ~holds[best, s]
    return m, left


@jit_inline
def _best_row(holds: Bits, weights: Array, gain: Int, bare: Bits) -> int:
    """The row that gains most for its weight, -1 when none gains anything."""
    first = 0
    for i in range(1, gain.shape[0]):
        if gain[i] / weights[i] > gain[first] / weights[first]:
            first = i
    gain[first] = _common(holds[first], bare)
    best, value = -1, 0.0
    if gain[first] > 0:
        best, value = first, gain[first] / weights[first]
    for i in range(gain.shape[0]):
        if gain[i] > value * weights[i]:
            gain[i] = _common(holds[i], bare)
            if gain[i] > value * weights[i]:
                best, value = i, gain[i] / weights[i]
    return best


@jit_entry
def _keep_needed(holds: Bits, chosen: Int, m: int, later: Bits, held: Bits) -> int:
    """Move the rows that are needed, of the first m chosen, to the front; returns how many. later (m + 1, words), held (words,): zeros."""
    n_words = held.shape[0]
    for t in range(m - 1, -1, -1):  # what the rows from t on hold
        for s in range(n_words):
            later[t, s] = later[t + 1, s] | holds[chosen[t], s]
    kept = 0
    for t in range(m):
        needed = False
        for s in range(n_words):
            needed = needed or holds[chosen[t], s] & ~(held[s] | later[t + 1, s]) != 0
        if needed:
            for s in range(n_words):
                held[s] |= holds[chosen[t], s]
            chosen[kept] = chosen[t]
            kept += 1
    return kept


@jit_inline
def _common(a: Bits, b: Bits) -> int:
    """How many bits two rows have in common."""
    ones, twos, fours = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333), np.uint64(0x0F0F0F0F0F0F0F0F)
    n = np.uint64(0)
    for s in range(a.shape[0]):
        x = a[s] & b[s]
        x -= (x >> np.uint64(1)) & ones
        x = (x & twos) + ((x >> np.uint64(2)) & twos)
        x = (x + (x >> np.uint64(4))) & fours
        n += (x * np.uint64(0x0101010101010101)) >> np.uint64(56)
    return int(n)
