"""Weighted set cover, greedy: few balls that hold all samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.cache_files import njit
from kinematics.jit.decorators import jit_inline
from kinematics.transforms import Array

Int = NDArray[np.int64]
Bits = NDArray[np.uint64]


@njit(cache=True, nogil=True)
def set_cover(centres: Array, radii: Array, samples: Array, fixed: Int) -> Int:
    """Indices of balls that hold every sample that some ball holds, the fixed ones among them."""
    n_balls, n = radii.shape[0], samples.shape[0]
    x, y, z = samples[:, 0].copy(), samples[:, 1].copy(), samples[:, 2].copy()
    holds, some = np.zeros((n_balls, n // 64 + 1), np.uint64), np.empty(n, np.bool_)
    for i in range(n_balls):
        a, b, c, rr = centres[i, 0], centres[i, 1], centres[i, 2], radii[i] * radii[i]
        for s in range(n):
            some[s] = (x[s] - a) * (x[s] - a) + (y[s] - b) * (y[s] - b) + (z[s] - c) * (z[s] - c) <= rr
        for s in range(n):
            if some[s]:
                holds[i, s >> 6] |= np.uint64(1) << np.uint64(s & 63)
    return weighted_set_cover(holds, n, np.ones(n_balls), fixed)[0]


@njit(cache=True, nogil=True)
def weighted_set_cover(holds: Bits, n: int, weights: Array, fixed: Int) -> tuple[Int, int]:
    """Greedy weighted set cover of the n columns of holds (balls, words of 64 columns), the fixed rows first, less the rows that nobody
    needs; and how many columns no row holds. A row's gain only ever falls, so only rows that might still win are counted again."""
    n_balls, n_words = holds.shape
    bare = np.full(n_words, np.uint64(0xFFFFFFFFFFFFFFFF), np.uint64)
    gain = np.empty(n_balls, np.int64)
    for i in range(n_balls):
        gain[i] = _common(holds[i], bare)
    chosen, m, left = np.empty(n_balls + 1, np.int64), 0, n
    while left > 0 or m < fixed.shape[0]:
        best, value = -1, 0.0
        if m < fixed.shape[0]:
            best = fixed[m]
        else:
            first = int(np.argmax(gain / weights))
            gain[first] = _common(holds[first], bare)
            if gain[first] > 0:
                best, value = first, gain[first] / weights[first]
            for i in range(n_balls):
                if gain[i] > value * weights[i]:
                    gain[i] = _common(holds[i], bare)
                    if gain[i] > value * weights[i]:
                        best, value = i, gain[i] / weights[i]
            if best < 0:
                break
        chosen[m] = best
        m += 1
        left -= _common(holds[best], bare)
        for s in range(n_words):
            bare[s] &= ~holds[best, s]
    later = np.zeros((m + 1, n_words), np.uint64)  # what the rows from t on hold
    for t in range(m - 1, -1, -1):
        for s in range(n_words):
            later[t, s] = later[t + 1, s] | holds[chosen[t], s]
    held, kept = np.zeros(n_words, np.uint64), 0
    for t in range(m):
        needed = False
        for s in range(n_words):
            needed = needed or holds[chosen[t], s] & ~(held[s] | later[t + 1, s]) != 0
        if needed:
            for s in range(n_words):
                held[s] |= holds[chosen[t], s]
            chosen[kept] = chosen[t]
            kept += 1
    return chosen[:kept].copy(), left


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
