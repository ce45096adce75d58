"""Shorten a path: random shortcuts (Geraerts and Overmars 2007), whole and one coordinate at a time, compiled, every edge certified.

A new edge is taken only when `connects` grants it and the path gets shorter, so the result is never longer than what came in. Lengths are
in metres moved, as in RRT-Connect.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.array_checks import checked
from kinematics.jit.decorators import copy_row, jit_entry, jit_inline
from kinematics.transforms import Array
from planning.motion.search.edges import Memory, Task, connects, make_memory
from planning.motion.search.rrt_connect import Route
from planning.motion.search.trees import uniform, weighted

_ROOM = 64  # waypoints that partial shortcuts may add


@dataclass(frozen=True)
class ShortcutSettings:
    """How a path is shortened. tries: how many shortcuts are tried; patience: 1 / patience of the tries in a row that brought nothing, and
    no more are made; gain: share of the length that a shortcut has to save."""

    tries: int = 100
    patience: int = 3
    gain: float = 5e-4


DEFAULTS = ShortcutSettings()


def shorten(
    task: Task,
    path: Array,
    *,
    settings: ShortcutSettings = DEFAULTS,
    seed: int = 0,
    memory: Memory | None = None,
) -> Route:
    """A path (K', J) with the ends of `path` (K, J), at most as long, from a path whose edges are certified.

    The same arguments give the same path. Raises: ValueError when the shape doesn't fit the task.
    """
    began = time.perf_counter()
    path = checked("path", path, -1, len(task.exact.chain.lower))
    if len(path) < 1:
        raise ValueError(f"path {path.shape} must be (K, {len(task.exact.chain.lower)}) with K > 0")
    memory = make_memory(task) if memory is None else memory
    scratch = memory.exact
    counts = scratch.counts.copy()
    room = np.concatenate([path, np.zeros((_ROOM, path.shape[1]))])
    work = np.empty((len(room) + 2, path.shape[1]))
    rng = np.array([seed % 2**64], np.uint64)
    n = int(_shorten(task, room, len(path), rng, settings.tries, settings.patience, settings.gain, memory, work))
    spent = scratch.counts - counts
    return Route(room[:n].copy(), "", -1, -1, None, settings.tries, int(spent[0]), int(spent[2]), time.perf_counter() - began)


def length(task: Task, path: Array) -> float:
    """The length of a path (K, J) in metres moved."""
    return float(np.linalg.norm(np.diff(path, axis=0) * task.exact.weight, axis=1).sum())


@jit_entry
def _shorten(
    task: Task, path: Array, n: int, rng: NDArray[np.uint64], tries: int, patience: int, gain: float, memory: Memory, work: Array
) -> int:
    """Shorten path[:n] in place; returns how many waypoints it has now. work: scratch, two rows more than the path."""
    n = _leap(task, path, n, memory)
    n_q, weight, misses = path.shape[1], task.exact.weight, 0
    a, b, new = work[0], work[1], work[2:]
    for _ in range(tries):
        if n < 3 or patience * misses > tries:
            break
        misses += 1
        total = 0.0
        for k in range(n - 1):
            total += weighted(weight, path[k], path[k + 1])
        kind = uniform(rng)
        u, v = uniform(rng) * total, uniform(rng) * total
        u, v = min(u, v), max(u, v)
        i, at_u = _locate(path, n, weight, u)
        j, at_v = _locate(path, n, weight, v)
        if kind < 0.3:  # from waypoint to waypoint
            at_u, at_v = 0.0, 1.0
        if j <= i:
            continue
        for c in range(n_q):
            a[c] = path[i, c] + at_u * (path[i + 1, c] - path[i, c])
            b[c] = path[j, c] + at_v * (path[j + 1, c] - path[j, c])
        # the stretch a, waypoints i + 1 … j, b is to become `new`, m points
        old, m = 0.0, 2
        for c in range(n_q):
            new[0, c], new[1, c] = a[c], b[c]
        if kind < 0.7:
            old = weighted(weight, a, path[i + 1]) + weighted(weight, path[j], b)
            for k in range(i + 1, j):
                old += weighted(weight, path[k], path[k + 1])
        else:  # one coordinate goes straight, the others as before
            m = j - i + 2
            only = int(uniform(rng) * n_q)
            for k in range(1, m - 1):
                for c in range(n_q):
                    new[k, c] = path[i + k, c]
            for c in range(n_q):
                new[m - 1, c] = b[c]
            for k in range(m - 1):
                old += weighted(weight, new[k], new[k + 1])
            so_far = 0.0
            for k in range(1, m - 1):
                so_far += weighted(weight, path[i + k - 1] if k > 1 else a, path[i + k])
                new[k, only] = a[only] + (b[only] - a[only]) * min(1.0, so_far / max(old, 1e-300))
        now = 0.0
        for k in range(m - 1):
            now += weighted(weight, new[k], new[k + 1])
        if now > old - gain * total or n - (j - i) + m > path.shape[0]:
            continue
        free = True
        for k in range(m - 1):
            if not connects(task, new[k], new[k + 1], memory):
                free = False
                break
        if free:
            n = _splice(path, n, i, j, new, m)
            misses = 0
    return _prune(task, path, n, memory)


@jit_inline
def _locate(path: Array, n: int, weight: Array, at: float) -> tuple[int, float]:
    """The segment of path[:n] that holds the point at some length from the start, and how far along the segment it is, in [0, 1]."""
    for k in range(n - 1):
        d = weighted(weight, path[k], path[k + 1])
        if at <= d and d > 0.0:
            return k, at / d
        at -= d
    return n - 2, 1.0


@jit_inline
def _splice(path: Array, n: int, i: int, j: int, new: Array, m: int) -> int:
    """Put new[:m] in the place of waypoints i + 1 … j; points that would repeat are left out. Returns the new number of waypoints."""
    first, last = 0, m
    if _same(new[0], path[i]):
        first = 1
    if _same(new[m - 1], path[j + 1]):
        last = m - 1
    shift = (last - first) - (j - i)
    if shift > 0:
        for k in range(n - 1, j, -1):
            copy_row(path[k], path[k + shift])
    else:
        for k in range(j + 1, n):
            copy_row(path[k], path[k + shift])
    for k in range(first, last):
        copy_row(new[k], path[i + 1 + k - first])
    return n + shift


@jit_inline
def _same(a: Array, b: Array) -> bool:
    for c in range(a.shape[0]):  # noqa: SIM110
        if a[c] != b[c]:
            return False
    return True


@jit_inline
def _leap(task: Task, path: Array, n: int, memory: Memory) -> int:
    """Go straight, in place, over as many waypoints as possible: over all of them, over half, a quarter, … down to one."""
    span = n - 1
    while span > 1:
        k = 0
        while k < n - 2:
            j = min(k + span, n - 1)
            if not connects(task, path[k], path[j], memory):
                k = j
                continue
            for i in range(n - j):
                copy_row(path[j + i], path[k + 1 + i])
            n -= j - k - 1
            k += 1
        span //= 2
    return n


@jit_inline
def _prune(task: Task, path: Array, n: int, memory: Memory) -> int:
    """Leave out, in place, every waypoint that the arm can do without."""
    k = 1
    while k < n - 1:
        if connects(task, path[k - 1], path[k + 1], memory):
            for i in range(k, n - 1):
                copy_row(path[i + 1], path[i])
            n -= 1
            k = max(1, k - 1)
        else:
            k += 1
    return n
