"""Make a path quicker: random changes that save time, compiled, every edge certified.

What is tried: waypoints left out, moved at random or towards the chord beside them, corners cut, stretches gone straight. How long a
polyline takes is estimated (smoothing/estimates.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import copy_row, jit_entry, jit_inline
from kinematics.transforms import Array
from planning.motion.search.edges import Memory, Task, connects_from_ends
from planning.motion.search.trees import uniform
from planning.motion.smoothing.blending import Corners
from planning.motion.smoothing.estimates import Limits, room_for, seconds

_ROOM = 16  # waypoints that cut corners may add


@dataclass(frozen=True)
class QuickenSettings:
    """How a path is made quicker. tries: how many changes are tried. wander_s: how far a waypoint is moved at first, in seconds at full
    speed. gain_s: what a change has to save."""

    tries: int = 100
    wander_s: float = 0.15
    gain_s: float = 1e-3


DEFAULTS = QuickenSettings()


def quicken(
    task: Task, clear: Task, path: Array, limits: Limits, near_m: float, seed: int, memory: Memory, settings: QuickenSettings = DEFAULTS
) -> Array:
    """A path (K', A) with the ends of `path` (K, A) that takes less time, or the path itself. It keeps what the clear task asks for, near_m
    from its ends what the other does, if it did before.

    limits: of velocity, acceleration and jerk (A,). The memory is ready for the task. The same arguments give the same path.
    """
    room = np.concatenate([path, np.zeros((_ROOM, path.shape[1]))])
    rng, work = np.array([seed % 2**64], np.uint64), np.empty((2, path.shape[1]))
    s = settings
    n = _quicken(task, clear, room, len(path), room_for(room, limits), near_m, rng, s.tries, s.wander_s, s.gain_s, memory, work)
    return room[:n].copy()


@jit_entry
def _quicken(
    task: Task, clear: Task, path: Array, n: int, changed: Corners, near_m: float, rng: NDArray[np.uint64], tries: int, wander_s: float,
    gain_s: float, memory: Memory, work: Array,
) -> int:  # fmt: skip
    """Change path[:n] in place; how many waypoints it has now. Scratch: changed, the path with the change that is tried; work (2, A)."""
    new, velocity = changed.q, changed.velocity
    for k in range(n):
        copy_row(path[k], new[k])
    best = seconds(changed, n)
    for turn in range(tries):
        if n < 3:
            break
        kind, i = uniform(rng), 1 + int(uniform(rng) * (n - 2))
        for k in range(n):
            copy_row(path[k], new[k])
        m, first, last = n, i - 1, i  # the edges first … last are new
        if kind < 0.25:
            _leave_out(new, n, i)
            m, last = n - 1, i - 1
        elif kind < 0.5:
            _towards_chord(path, i, velocity, uniform(rng), new)
        elif kind < 0.65:
            wander = wander_s * (1.0 - turn / tries)
            for j in range(velocity.shape[0]):
                new[i, j] += (2.0 * uniform(rng) - 1.0) * wander * velocity[j]
                new[i, j] = min(max(new[i, j], task.exact.chain.lower[j]), task.exact.chain.upper[j])
        elif kind < 0.8:
            if n == path.shape[0]:
                continue
            _cut_corner(path, n, i, uniform(rng), uniform(rng), new)
            m, first = n + 1, i
        else:
            m, first = _go_straight(path, n, velocity, uniform(rng), uniform(rng), new)
            last = first
            if m == 0:
                continue
        now = seconds(changed, m)
        if now > best - gain_s:
            continue
        free = True
        for k in range(first, last + 1):
            ends = (1 if k == 0 else 0) + (2 if k + 1 == m - 1 else 0)
            if not connects_from_ends(task, clear, new[k], new[k + 1], ends, near_m, work, memory):
                free = False
                break
        if free:
            n, best = m, now
            for k in range(n):
                copy_row(new[k], path[k])
    return n


@jit_inline
def _piece(a: Array, b: Array, velocity: Array) -> float:
    took = 0.0
    for j in range(velocity.shape[0]):
        took = max(took, abs(b[j] - a[j]) / velocity[j])
    return took


@jit_inline
def _leave_out(path: Array, n: int, i: int) -> None:
    """Leave out waypoint i of path[:n]."""
    for k in range(i + 1, n):
        copy_row(path[k], path[k - 1])


@jit_inline
def _towards_chord(path: Array, i: int, velocity: Array, share: float, new: Array) -> None:
    """Move waypoint i by a share of its way to the chord between its neighbours, where it would be in time."""
    before, behind = _piece(path[i - 1], path[i], velocity), _piece(path[i], path[i + 1], velocity)
    along = before / max(1e-12, before + behind)
    for j in range(velocity.shape[0]):
        new[i, j] += share * (path[i - 1, j] + along * (path[i + 1, j] - path[i - 1, j]) - path[i, j])


@jit_inline
def _cut_corner(path: Array, n: int, i: int, before: float, behind: float, new: Array) -> None:
    """Put two points in the place of waypoint i, on both sides of it."""
    for k in range(n - 1, i, -1):
        copy_row(path[k], new[k + 1])
    for j in range(path.shape[1]):
        new[i, j] = path[i, j] + 0.7 * before * (path[i - 1, j] - path[i, j])
        new[i + 1, j] = path[i, j] + 0.7 * behind * (path[i + 1, j] - path[i, j])


@jit_inline
def _go_straight(path: Array, n: int, velocity: Array, u: float, v: float, new: Array) -> tuple[int, int]:
    """Go straight between two points of the path: how many waypoints there are then, 0 when both lie on one piece; and the new edge."""
    total = 0.0
    for k in range(n - 1):
        total += _piece(path[k], path[k + 1], velocity)
    low, high = min(u, v) * total, max(u, v) * total
    a, at_a = _locate(path, n, velocity, low)
    b, at_b = _locate(path, n, velocity, high)
    if a == b:
        return 0, 0
    m = a + 1
    if at_a > 0.0:
        for j in range(path.shape[1]):
            new[m, j] = path[a, j] + at_a * (path[a + 1, j] - path[a, j])
        m += 1
    edge = m - 1
    if at_b < 1.0:
        if m + n - b > new.shape[0]:
            return 0, 0
        for j in range(path.shape[1]):
            new[m, j] = path[b, j] + at_b * (path[b + 1, j] - path[b, j])
        m += 1
    for k in range(b + 1, n):
        if m == new.shape[0]:
            return 0, 0
        copy_row(path[k], new[m])
        m += 1
    return m, edge


@jit_inline
def _locate(path: Array, n: int, velocity: Array, at: float) -> tuple[int, float]:
    """The piece of path[:n] that is reached after some seconds at full speed, and how far along it, in [0, 1]."""
    for k in range(n - 1):
        took = _piece(path[k], path[k + 1], velocity)
        if at <= took and took > 0.0:
            return k, at / took
        at -= took
    return n - 2, 1.0
