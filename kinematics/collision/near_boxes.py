"""Which pairs of solids boxes do not prove apart, at many configurations: what FCL is left to be asked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.transforms import Array


@jit_entry
def near_pairs_along(
    boxes: Array, T: Array, T_standing: Array, places: Int, rows: Int, which: Int, first: NDArray[np.bool_],
    always: Int, always_start: Int, once: Int, once_start: Int, said: Int, made: Int, around: Array, work: Array, ask: Int,
) -> int:  # fmt: skip
    """Fill in rows (n, i, j) of `ask`, n rising: pairs that no axis of the world or of their boxes separates at the n-th configuration, and
    return how many there are.

    boxes (S, 2, 3): middle and half edges of each solid's in its own frame. Configuration n is row rows[n] (N,) of all, belongs to stretch
    which[n] and may be its first one. T (N, L + 1, 4, 4): poses of the L links and of what is held. places (·, S): see `Verdict._places`.
    Pairs (i, j): always (·, 2) and once (·, 2) by stretches, said (·, 3) by the rows that they name, these rising.
    Scratch: around (S, 2, 3), boxes along the world's axes around the solids; made (S,), for where they stood then, at first -1; work (3,).
    """
    count, next_said, links = 0, 0, T.shape[1] - 1
    for n in range(rows.shape[0]):
        s, end_said = which[n], next_said
        while end_said < said.shape[0] and said[end_said, 0] == rows[n]:
            end_said += 1
        listed = always_start[s + 1] - always_start[s]
        started = listed + (once_start[s + 1] - once_start[s] if first[n] else 0)
        for k in range(started + end_said - next_said):
            if k < listed:
                pair = always[always_start[s] + k]
            elif k < started:
                pair = once[once_start[s] + k - listed]
            else:
                pair = said[next_said + k - started, 1:]
            for x in range(2):  # the box around each of the two, if it is not known
                i = pair[x]
                place = places[s, i]
                now = 2 * place + 1 if place >= 0 else 2 * n
                if made[i] != now:
                    made[i] = now
                    A = T_standing[place] if place >= 0 else T[n, min(i, links)]
                    for r in range(3):
                        around[i, 0, r], around[i, 1, r] = A[r, 3], 0.0
                        for c in range(3):
                            around[i, 0, r] += A[r, c] * boxes[i, 0, c]
                            around[i, 1, r] += abs(A[r, c]) * boxes[i, 1, c]
            i, j, apart = pair[0], pair[1], False
            for r in range(3):
                apart = apart or abs(around[i, 0, r] - around[j, 0, r]) > around[i, 1, r] + around[j, 1, r] + 1e-9
            if apart:
                continue
            A = T_standing[places[s, i]] if places[s, i] >= 0 else T[n, min(i, links)]
            B = T_standing[places[s, j]] if places[s, j] >= 0 else T[n, min(j, links)]
            if not _apart_along_their_axes(boxes[i], A, boxes[j], B, work):
                ask[count, 0], ask[count, 1], ask[count, 2] = n, i, j
                count += 1
        next_said = end_said
    return count


@jit_inline
def _apart_along_their_axes(a: Array, A: Array, b: Array, B: Array, work: Array) -> bool:
    """Whether an axis of one of two boxes separates them. a, b (2, 3): middle and half edges, in frames A, B (4, 4). Scratch: work (3,)."""
    for r in range(3):
        work[r] = A[r, 3] - B[r, 3]
        for c in range(3):
            work[r] += A[r, c] * a[0, c] - B[r, c] * b[0, c]
    for k in range(3):
        in_a, in_b, room_a, room_b = 0.0, 0.0, a[1, k] + 1e-9, b[1, k] + 1e-9
        for r in range(3):
            in_a += A[r, k] * work[r]
            in_b += B[r, k] * work[r]
        for c in range(3):
            along_b, along_a = 0.0, 0.0
            for r in range(3):
                along_b += A[r, k] * B[r, c]
                along_a += B[r, k] * A[r, c]
            room_a += abs(along_b) * b[1, c]
            room_b += abs(along_a) * a[1, c]
        if abs(in_a) > room_a or abs(in_b) > room_b:
            return True
    return False
