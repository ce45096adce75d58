"""Where lines go through convex parts, compiled: for one line each part's stretch, for many the whole stretch of each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array

PARALLEL = 1e-12
"""A direction with no more of a normal in it does not meet the plane."""
Int = NDArray[np.int64]


@jit_inline
def _stretch(planes: Array, begin: int, end: int, o: Array, d: Array) -> tuple[float, float, int, int]:
    """Where the line o + s · d enters and leaves the part within planes (H, 4), n · x <= planes[:, 3], from number `begin` to `end`, and by
    which of them; it enters no earlier than it leaves where it misses."""
    enter, leave, first, last = -np.inf, np.inf, begin, begin
    for h in range(begin, end):
        speed = planes[h, 0] * d[0] + planes[h, 1] * d[1] + planes[h, 2] * d[2]
        gap = planes[h, 3] - (planes[h, 0] * o[0] + planes[h, 1] * o[1] + planes[h, 2] * o[2])
        if abs(speed) < PARALLEL:
            if gap < 0.0:
                return np.inf, -np.inf, begin, begin
            continue
        s = gap / speed
        if speed < 0.0:
            if s > enter:
                enter, first = s, h
        elif s < leave:
            leave, last = s, h
        if enter >= leave:
            break
    return enter, leave, first, last


@jit_entry
def through_parts(planes: Array, starts: Int, o: Array, d: Array, stretches: Array, by: Int) -> None:
    """Where the line o + s · d enters and leaves each part, stretches (P, 2), and by which planes, by (P, 2). planes (H, 4): of all parts,
    one part's after the other's; starts (P + 1,): where each part's begin, and how many there are."""
    for p in range(len(starts) - 1):
        enter, leave, first, last = _stretch(planes, starts[p], starts[p + 1], o, d)
        stretches[p, 0], stretches[p, 1], by[p, 0], by[p, 1] = enter, leave, first, last


@jit_entry
def through_all(planes: Array, starts: Int, o: Array, d: Array, met: Array) -> None:
    """Where lines o + s · d, both (L, 3), first enter any part and last leave any, and the cosines there between them and the surface's
    normals, the first inwards: met (L, 4); a line that misses all enters no earlier than it leaves."""
    for i in range(len(o)):
        met[i, 0], met[i, 1], met[i, 2], met[i, 3] = np.inf, -np.inf, 0.0, 0.0
        for p in range(len(starts) - 1):
            enter, leave, first, last = _stretch(planes, starts[p], starts[p + 1], o[i], d[i])
            if enter >= leave:
                continue
            if enter < met[i, 0]:
                met[i, 0] = enter
                met[i, 2] = -(planes[first, 0] * d[i, 0] + planes[first, 1] * d[i, 1] + planes[first, 2] * d[i, 2])
            if leave > met[i, 1]:
                met[i, 1] = leave
                met[i, 3] = planes[last, 0] * d[i, 0] + planes[last, 1] * d[i, 1] + planes[last, 2] * d[i, 2]
