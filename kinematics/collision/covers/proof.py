"""The proof that balls contain a solid: tetrahedra that fill it are bisected until each lies in one ball.

Why contained. The hull is cut into tetrahedra, a fan from an inner point to its triangles. A ball is convex, so a tetrahedron whose four
corners lie in one ball is covered; any other is bisected at its longest edge; a corner that lies in no ball is a counterexample and
becomes a new sample of the set cover. When no tetrahedron is left the whole solid is covered, its surface *and* its interior: a cover of
the surface alone would miss a small body that sits wholly inside. Boxes and cylinders have a grid instead: a cell whose corners all
lie in one ball is covered, and the cells fill the solid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import copy_row, copy_rows, jit_entry, jit_inline
from kinematics.transforms import Array

Int = NDArray[np.int64]

_DEEPEST = 400  # tetrahedra that wait in the bisection, at most


@jit_inline
def _holds(c: Array, rr: float, x: float, y: float, z: float) -> bool:
    return bool((x - c[0]) ** 2 + (y - c[1]) ** 2 + (z - c[2]) ** 2 <= rr)


@jit_inline
def _one_ball(T: Array, centres: Array, radii: Array, some: Int, many: int, first: int) -> int:
    """A ball that holds the tetrahedron T (4, 3): `first`, which neighbours often share, or one of some, `many` indices; or -1."""
    if _all_in(T, centres[first], radii[first] * radii[first]):
        return first
    for k in range(many):
        i: int = some[k]
        if _all_in(T, centres[i], radii[i] * radii[i]):
            return i
    return -1


@jit_inline
def _longest(T: Array) -> tuple[int, int, float]:
    a, b, best = 0, 1, -1.0
    for i in range(4):
        for j in range(i + 1, 4):
            d = (T[i, 0] - T[j, 0]) ** 2 + (T[i, 1] - T[j, 1]) ** 2 + (T[i, 2] - T[j, 2]) ** 2
            if d > best:
                a, b, best = i, j, d
    return a, b, best


@jit_inline
def _split(stack: Array, top: int, a: int, b: int) -> None:
    """Replace the tetrahedron stack[top] by its halves, at top and top + 1."""
    for r in range(3):
        middle = (stack[top, a, r] + stack[top, b, r]) / 2
        for i in range(4):
            stack[top + 1, i, r] = stack[top, i, r]
        stack[top, a, r] = middle
        stack[top + 1, b, r] = middle


def counterexamples(fan: Array, centres: Array, radii: Array, smallest: float, most: int, open_: NDArray[np.bool_]) -> Array:
    """Corners of the bisection that lie in no ball (N, 3), at most `most`, and three a tetrahedron of the fan.

    A tetrahedron shorter than `smallest` that no ball holds counts as a counterexample too, so the search ends. Only the tetrahedra
    that are open_ (T,) are looked at; what is proved is closed. Nothing found: all proved.
    """
    found = np.empty((most, 3))
    near, all_ = np.empty((_DEEPEST, len(radii)), np.int64), np.arange(len(radii))
    memory = np.empty((_DEEPEST, 4, 3)), near, np.zeros(_DEEPEST, np.int64), all_
    return found[: _find(np.ascontiguousarray(fan), centres, radii, smallest, open_, *memory, found)].copy()


@jit_entry
def _find(
    fan: Array, centres: Array, radii: Array, smallest: float, open_: NDArray[np.bool_], stack: Array, near: Int, many: Int, all_: Int,
    found: Array,
) -> int:  # fmt: skip
    """Fill in what is found; returns how many. Each tetrahedron stack[k] comes with the balls that reach it, the first many[k] of near[k]:
    its halves are reached by no others."""
    n, most = 0, found.shape[0]
    for root in range(fan.shape[0]):
        if not open_[root]:
            continue
        many[0] = _reaching(fan[root], centres, radii, all_, radii.shape[0], near[0])
        mine, top, last = 0, 0, 0
        copy_rows(fan[root], stack[0])
        for i in range(4):
            if mine == 0 and not _in_some(fan[root, i], centres, radii, near[0], many[0]):
                copy_row(fan[root, i], found[n])
                n += 1
                mine += 1
        while top >= 0 and mine < 3 and n < most:
            i = _one_ball(stack[top], centres, radii, near[top], many[top], last)
            if i >= 0:
                last = i
                top -= 1
                continue
            a, b, long = _longest(stack[top])
            for r in range(3):
                found[n, r] = (stack[top, a, r] + stack[top, b, r]) / 2
            if long < smallest * smallest or not _in_some(found[n], centres, radii, near[top], many[top]):
                n += 1
                mine += 1
                top -= 1
                continue
            _split(stack, top, a, b)
            for half in (top + 1, top):
                many[half] = _reaching(stack[half], centres, radii, near[top], many[top], near[half])
            top += 1
        if n == most:
            break
        open_[root] = mine > 0
    return n


@jit_inline
def _around(T: Array) -> tuple[float, float, float, float]:
    """The middle of a tetrahedron (4, 3), and how far its corners are from there at most."""
    x = (T[0, 0] + T[1, 0] + T[2, 0] + T[3, 0]) / 4
    y = (T[0, 1] + T[1, 1] + T[2, 1] + T[3, 1]) / 4
    z = (T[0, 2] + T[1, 2] + T[2, 2] + T[3, 2]) / 4
    reach = 0.0
    for i in range(4):
        reach = max(reach, np.sqrt((T[i, 0] - x) ** 2 + (T[i, 1] - y) ** 2 + (T[i, 2] - z) ** 2))
    return x, y, z, reach


@jit_inline
def _in_some(p: Array, centres: Array, radii: Array, some: Int, many: int) -> bool:
    for k in range(many):
        i = some[k]
        if _holds(centres[i], radii[i] * radii[i], p[0], p[1], p[2]):
            return True
    return False


def links(fan: Array, coarse: Array, coarse_r: Array, fine: Array, fine_r: Array) -> NDArray[np.uint8]:
    """Which coarse ball lists which fine ball (C, F): the same bisection, until a leaf lies in one of each; pairs at hand are preferred."""
    A, B = len(coarse_r), len(fine_r)
    linked = np.zeros((A, B), np.uint8)
    stack, near_a, near_b = np.empty((_DEEPEST, 4, 3)), np.empty((_DEEPEST, A), np.int64), np.empty((_DEEPEST, B), np.int64)
    many, in_a, all_ = np.zeros((2, _DEEPEST), np.int64), np.empty(A, np.int64), np.arange(max(A, B))
    _link_all(np.ascontiguousarray(fan), coarse, coarse_r, fine, fine_r, stack, near_a, near_b, many, in_a, all_, linked)
    return linked


@jit_entry
def _link_all(
    fan: Array, coarse: Array, coarse_r: Array, fine: Array, fine_r: Array, stack: Array, near_a: Int, near_b: Int, many: Int, in_a: Int,
    all_: Int, linked: NDArray[np.uint8],
) -> None:  # fmt: skip
    for root in range(fan.shape[0]):
        copy_rows(fan[root], stack[0])
        many[0, 0] = _reaching(stack[0], coarse, coarse_r, all_, coarse_r.shape[0], near_a[0])
        many[1, 0] = _reaching(stack[0], fine, fine_r, all_, fine_r.shape[0], near_b[0])
        _link(stack, coarse, coarse_r, fine, fine_r, near_a, near_b, many, in_a, linked)


@jit_inline
def _link(
    stack: Array, coarse: Array, coarse_r: Array, fine: Array, fine_r: Array, near_a: Int, near_b: Int, many: Int, in_a: Int,
    linked: NDArray[np.uint8],
) -> None:  # fmt: skip
    """The bisection of stack[0]. Each tetrahedron stack[k] comes with the balls that reach it, the first many[:, k] of near_a[k] and
    near_b[k]: its halves are reached by no others."""
    top = 0
    while top >= 0:
        T = stack[top]
        n_a = 0
        for k in range(many[0, top]):
            i = near_a[top, k]
            if _all_in(T, coarse[i], coarse_r[i] * coarse_r[i]):
                in_a[n_a] = i
                n_a += 1
        fresh, known = -1, False
        if n_a > 0:
            for m in range(many[1, top]):
                j = near_b[top, m]
                if _all_in(T, fine[j], fine_r[j] * fine_r[j]):
                    for k in range(n_a):
                        known = known or linked[in_a[k], j] > 0
                    if known:
                        break
                    fresh = j
        if known or fresh >= 0:
            if not known:
                linked[in_a[0], fresh] = 1
            top -= 1
            continue
        a, b, _ = _longest(T)
        _split(stack, top, a, b)
        for half in (top + 1, top):
            many[0, half] = _reaching(stack[half], coarse, coarse_r, near_a[top], many[0, top], near_a[half])
            many[1, half] = _reaching(stack[half], fine, fine_r, near_b[top], many[1, top], near_b[half])
        top += 1


@jit_inline
def _reaching(T: Array, centres: Array, radii: Array, some: Int, many: int, out: Int) -> int:
    """Of some balls, `many` indices, those that reach the ball around a tetrahedron's middle: their indices, and how many."""
    x, y, z, reach = _around(T)
    n = 0
    for k in range(many):
        i = some[k]
        if _holds(centres[i], (radii[i] + reach) ** 2, x, y, z):
            out[n] = i
            n += 1
    return n


@jit_inline
def _all_in(T: Array, c: Array, rr: float) -> bool:
    for i in range(4):  # noqa: SIM110
        if not _holds(c, rr, T[i, 0], T[i, 1], T[i, 2]):
            return False
    return True
