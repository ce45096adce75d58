"""Sphere covers: balls whose union provably contains a convex solid, and that reach at most `excess_m` beyond it.

How tight. Every ball has its centre c inside the solid and the radius depth(c) + excess, where depth(c) is the distance from c to the
solid's surface. So no ball reaches further out than `excess_m`, and the same ball less `excess_m` lies inside the solid: the
outer balls prove that a part is free, the inner ones (`inner_radii`) that it touches.

Why contained. The hull is cut into tetrahedra, a fan from an inner point to its triangles. A ball is convex, so a tetrahedron whose four
corners lie in one ball is covered; any other is bisected at its longest edge; a corner that lies in no ball is a counterexample and
becomes a new sample of the set cover. When no tetrahedron is left the whole solid is covered, its surface *and* its interior: a cover of
the surface alone would miss a small body that sits wholly inside. Boxes and cylinders have a grid instead: a cell whose corners all
lie in one ball is covered, and the cells fill the solid.

Coarse and fine. `Levels` binds two covers together by the same proof: every leaf lies in one coarse ball i and one fine ball j, and i
lists j. If coarse ball i misses a body, so do all the leaves in it; otherwise only the fine balls that i lists need a look.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics import cache
from kinematics.jit.cache_files import njit
from kinematics.jit.decorators import copy_rows, jit_inline
from kinematics.shapes import CYLINDER_SIDES, box_corners
from kinematics.transforms import Array, apply

Int = NDArray[np.int64]
Bits = NDArray[np.uint64]
COARSE_M, FINE_M = 0.020, 0.005
SHIPPED = Path(__file__).with_name("covers.npz")
"""The covers of the named robots' hulls: `make covers` makes them."""
OnStep = Callable[[str], None]

_ALGORITHM = "cover-5"  # part of the cache's key: change it whenever another result may come out
_SLACK = 0.03  # samples are covered by balls this share of the excess smaller, so that the bisection ends
_ROUNDING_M = 1e-9  # balls are this much smaller in proofs: qhull's planes and float64 are better than that for anything in a room
_GAMMAS = (0.08, 0.25, 0.5, 0.75, 1.0)
_CANDIDATES = 900  # surface points that candidate balls are made from
_GAPS = 250  # counterexamples a round
_DEEPEST = 400  # tetrahedra that wait in the bisection, at most
_FRESH_ROUNDS = 10  # so often the set cover starts afresh with the new samples; later rounds only add to it


class Cover(NamedTuple):
    """S balls that contain a solid and reach at most excess_m beyond it: centres (S, 3), radii (S,), metres, in the solid's frame."""

    centres: Array
    radii: Array
    excess_m: float

    def inner_radii(self) -> Array:
        """Radii (S,) of the balls about the same centres that lie inside the solid; zero where there is none."""
        return np.maximum(self.radii - self.excess_m - _ROUNDING_M, 0.0)


class Levels(NamedTuple):
    """Two covers of one solid. Coarse ball i lists fine balls child[start[i]:start[i + 1]]: the solid is the union of pieces of which
    each lies in a coarse ball and in a fine ball that it lists."""

    coarse: Cover
    fine: Cover
    start: Int
    child: Int


def cover(vertices: Array, excess_m: float, *, on_step: OnStep | None = None) -> Cover:
    """Balls that contain the convex hull of vertices (V, 3), in metres, and reach at most excess_m beyond it.

    on_step hears one line a round. Raises: ValueError when the hull has no volume or excess_m is not positive.
    """
    if not excess_m > 0:
        raise ValueError(f"excess_m: {excess_m} is not positive")
    solid = _hull(vertices)
    slack = _SLACK * excess_m
    samples, normals = _surface(solid, excess_m)
    some = _spread(len(samples), _CANDIDATES)
    centres, radii = _candidates(solid, samples[some], normals[some], excess_m, slack)
    c, r, pruned, none = centres, radii, False, np.zeros(0, np.int64)
    unproved = np.ones(len(solid.fan), np.bool_)
    for turn in range(1000):
        if turn < _FRESH_ROUNDS:
            chosen = _set_cover(centres, radii - slack, samples, none)
            c, r = centres[chosen], radii[chosen]
        if turn < _FRESH_ROUNDS:
            unproved[:] = True  # other balls. As long as balls are only added, what is proved stays proved
        gaps = _counterexamples(solid.fan, c, r - _ROUNDING_M, slack / 4, _GAPS, unproved)
        if on_step is not None:
            on_step(f"round {turn + 1}: {len(r)} balls, {len(gaps)} gaps")
        if len(gaps) == 0 and (pruned or turn < _FRESH_ROUNDS):
            return Cover(c, r, excess_m)
        if len(gaps) == 0:
            needed = _set_cover(c, r - slack, samples, np.arange(len(r)))
            c, r, pruned = c[needed], r[needed], True
            unproved[:] = True
            continue
        samples = np.concatenate([samples, gaps])
        nearest = np.argmin(solid.planes[:, 3] - gaps @ solid.planes[:, :3].T, 1)
        more, more_r = _candidates(solid, gaps, solid.planes[nearest, :3], excess_m, slack)
        if turn + 1 < _FRESH_ROUNDS:
            centres, radii = np.concatenate([centres, more]), np.concatenate([radii, more_r])
        else:
            chosen = _set_cover(more, more_r - slack, gaps, none)
            c, r = np.concatenate([c, more[chosen]]), np.concatenate([r, more_r[chosen]])
    raise RuntimeError("the cover did not close")  # each round covers at least one gap with slack: it can't take so many


def uncovered(vertices: Array, balls: Cover) -> Array:
    """Points (N, 3) of the hull of vertices (V, 3) that lie in no ball, at most 400: none is the proof that the balls contain it."""
    fan = _hull(vertices).fan
    return _counterexamples(fan, balls.centres, balls.radii, 1e-6, 400, np.ones(len(fan), np.bool_))


def levels(vertices: Array, coarse_m: float = COARSE_M, fine_m: float = FINE_M, *, on_step: OnStep | None = None) -> Levels:
    """A coarse and a fine cover of the hull of vertices (V, 3), from those that ship or the disk cache if these hold them.

    The vertices are taken to 0.1 nm, so that a hull is the same hull on every CPU: that is a tenth of what the proof leaves for rounding.
    Raises: ValueError as `cover` does.
    """
    points = _rounded(vertices)
    name = _name(points, coarse_m, fine_m)
    known = cache.shipped(SHIPPED, name) or cache.load(name)
    if known is None:
        known = _derived(points, coarse_m, fine_m, on_step)
        cache.store(name, known)
    c, f = known["coarse"].astype(float), known["fine"].astype(float)
    start, child = known["start"].astype(np.int64), known["child"].astype(np.int64)
    return Levels(Cover(c[:, :3], c[:, 3], coarse_m), Cover(f[:, :3], f[:, 3], fine_m), start, child)


def derived(vertices: Array) -> tuple[str, dict[str, NDArray[np.generic]]]:
    """The levels of a hull of vertices (V, 3) as arrays, and the name that `levels` finds them under. Raises: as `cover` does."""
    points = _rounded(vertices)
    return _name(points, COARSE_M, FINE_M), _derived(points, COARSE_M, FINE_M, None)


def _rounded(vertices: Array) -> Array:
    return np.ascontiguousarray(np.round(np.asarray(vertices, float), 10) + 0.0)


def _name(points: Array, coarse_m: float, fine_m: float) -> str:
    return "spheres-" + cache.key(_ALGORITHM, points.tobytes(), f"{coarse_m!r} {fine_m!r}")


def _derived(points: Array, coarse_m: float, fine_m: float, on_step: OnStep | None) -> dict[str, NDArray[np.generic]]:
    a, b = _by_size(cover(points, coarse_m, on_step=on_step)), cover(points, fine_m, on_step=on_step)
    start, child = _csr(_links(_hull(points).fan, a.centres, a.radii - _ROUNDING_M, b.centres, b.radii - _ROUNDING_M))
    return {"coarse": np.c_[a.centres, a.radii], "fine": np.c_[b.centres, b.radii], "start": start, "child": child}


def moved(balls: Levels, T: Array) -> Levels:
    """The same levels in another frame: T (4, 4) maps the old frame's points to the new one's."""
    a, b = balls.coarse, balls.fine
    return balls._replace(coarse=a._replace(centres=apply(T, a.centres)), fine=b._replace(centres=apply(T, b.centres)))


@lru_cache(maxsize=256)
def box_levels(size_m: tuple[float, float, float], coarse_m: float = COARSE_M, fine_m: float = FINE_M) -> Levels:
    """Levels of a cuboid about the origin with edges size_m along x, y, z. A millisecond or two; kept in memory."""
    a, b = _by_size(box_cover(size_m, coarse_m)), box_cover(size_m, fine_m)
    half = np.array(size_m, float) / 2
    octant = _hull(box_corners(half / 2) + half / 2).fan
    linked = _links(octant, a.centres, a.radii - _ROUNDING_M, b.centres, b.radii - _ROUNDING_M) > 0
    for axis in range(3):  # the balls of one octant are mirrored to the others, and so are their links
        linked |= linked[np.ix_(_twins(a.centres, axis), _twins(b.centres, axis))]
    return Levels(a, b, *_csr(linked))


@lru_cache(maxsize=256)
def cylinder_levels(radius_m: float, height_m: float, coarse_m: float = COARSE_M, fine_m: float = FINE_M) -> Levels:
    """Levels of a cylinder about z through the origin. A millisecond or two; kept in memory."""
    a, b = _by_size(cylinder_cover(radius_m, height_m, coarse_m)), cylinder_cover(radius_m, height_m, fine_m)
    far = np.linalg.norm(a.centres[:, None] - b.centres, axis=2)
    return Levels(a, b, *_csr(far <= a.radii[:, None] + b.radii))  # every point's coarse ball meets its fine one


# The hull and its samples


class _Solid(NamedTuple):
    """planes (F, 4): outward unit normal n and offset, inside is n·x <= offset; fan (T, 4, 3): tetrahedra that fill the hull;
    triangles (T, 3, 3) and normals (T, 3) of its surface."""

    planes: Array
    fan: Array
    triangles: Array
    normals: Array


def _hull(vertices: Array) -> _Solid:
    from scipy.spatial import ConvexHull, QhullError

    points = np.asarray(vertices, float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"vertices: expected finite (V, 3), got shape {points.shape}")
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as e:
        raise ValueError("vertices: their hull has no volume") from e
    normals = hull.equations[:, :3]
    planes = np.unique(np.round(np.c_[normals, -hull.equations[:, 3]], 12), axis=0)
    triangles = points[hull.simplices]
    middle = points[hull.vertices].mean(0)
    fan = np.concatenate([np.repeat(middle[None, None], len(triangles), 0), triangles], 1)
    return _Solid(planes.astype(float), fan, triangles, normals)


def _surface(solid: _Solid, excess_m: float) -> tuple[Array, Array]:
    """Points (N, 3) spread over the surface, one per square of the excess or so, and every corner; outward directions (N, 3)."""
    rng = np.random.default_rng(0)
    t = solid.triangles
    area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1) / 2
    n = int(np.clip(area.sum() / excess_m**2, 200, 10000))
    face = rng.choice(len(t), n, p=area / area.sum())
    u = rng.random((n, 2))
    u[u.sum(1) > 1] = 1 - u[u.sum(1) > 1]
    spread = t[face, 0] + u[:, :1] * (t[face, 1] - t[face, 0]) + u[:, 1:] * (t[face, 2] - t[face, 0])
    corners, where = np.unique(t.reshape(-1, 3), axis=0, return_inverse=True)
    outward = np.zeros_like(corners)
    np.add.at(outward, where.ravel(), np.repeat(solid.normals * np.sqrt(area)[:, None], 3, 0))
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    return np.concatenate([spread, corners]), np.concatenate([solid.normals[face], outward])


def _spread(n: int, most: int) -> Int:
    """At most `most` indices out of n, evenly spread."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(np.int64))


def _candidates(solid: _Solid, points: Array, outward: Array, excess_m: float, slack: float) -> tuple[Array, Array]:
    """Balls that hold one of the points (N, 3) with slack: centres (C, 3) on the lines inwards, radii (C,) depth + excess.

    On the line x - t·d the depth is min_j D_j + t d·n_j, so the ball about that point still reaches x while t <= depth + excess - slack:
    up to t = min_j (D_j + excess - slack) / (1 - d·n_j). Centres are taken at several parts of the way.
    """
    return _line_balls(points, np.ascontiguousarray(outward), solid.planes, excess_m, slack, np.array(_GAMMAS))


@njit(cache=True, nogil=True)
def _line_balls(points: Array, outward: Array, planes: Array, excess: float, slack: float, gammas: Array) -> tuple[Array, Array]:
    n, m = points.shape[0], gammas.shape[0]
    centres, radii = np.empty((n * m, 3)), np.empty(n * m)
    for i in range(n):
        x, y, z = points[i]
        dx, dy, dz = outward[i]
        reach = 1e9
        for j in range(planes.shape[0]):
            along = 1.0 - (dx * planes[j, 0] + dy * planes[j, 1] + dz * planes[j, 2])
            gap = planes[j, 3] - (x * planes[j, 0] + y * planes[j, 1] + z * planes[j, 2]) + excess - slack
            if gap < reach * along:
                reach = gap / along
        for g in range(m):
            t = gammas[g] * max(reach, 0.0) * (1 - 1e-9)
            a, b, c = x - t * dx, y - t * dy, z - t * dz
            depth = 1e9
            for j in range(planes.shape[0]):
                depth = min(depth, planes[j, 3] - (a * planes[j, 0] + b * planes[j, 1] + c * planes[j, 2]))
            if depth < 0.0:  # the line has left a sharp corner: a ball about the point itself always will do
                a, b, c, depth = x, y, z, 0.0
            k = i * m + g
            centres[k, 0], centres[k, 1], centres[k, 2] = a, b, c
            radii[k] = depth + excess
    return centres, radii


@njit(cache=True, nogil=True)
def _set_cover(centres: Array, radii: Array, samples: Array, fixed: Int) -> Int:
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
    return _weighted(holds, n, np.ones(n_balls), fixed)[0]


@njit(cache=True, nogil=True)
def _weighted(holds: Bits, n: int, weights: Array, fixed: Int) -> tuple[Int, int]:
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


# The proof


@jit_inline
def _holds(c: Array, rr: float, x: float, y: float, z: float) -> bool:
    return bool((x - c[0]) ** 2 + (y - c[1]) ** 2 + (z - c[2]) ** 2 <= rr)


@jit_inline
def _one_ball(T: Array, centres: Array, rr: Array, n: int, first: int) -> int:
    """One of the first n balls that holds the tetrahedron T (4, 3), or -1. `first` is tried first: neighbours often share it."""
    for k in range(n):
        i = k + first
        if i >= n:
            i -= n
        if (
            _holds(centres[i], rr[i], T[0, 0], T[0, 1], T[0, 2])
            and _holds(centres[i], rr[i], T[1, 0], T[1, 1], T[1, 2])
            and _holds(centres[i], rr[i], T[2, 0], T[2, 1], T[2, 2])
            and _holds(centres[i], rr[i], T[3, 0], T[3, 1], T[3, 2])
        ):
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


@njit(cache=True, nogil=True)
def _counterexamples(fan: Array, centres: Array, radii: Array, smallest: float, most: int, open_: NDArray[np.bool_]) -> Array:
    """Corners of the bisection that lie in no ball (N, 3), at most `most`, and three a tetrahedron of the fan.

    A tetrahedron shorter than `smallest` that no ball holds counts as a counterexample too, so the search ends. Only the tetrahedra
    that are open_ (T,) are looked at; what is proved is closed. Nothing found: all proved.
    """
    found = np.empty((most, 3))
    n = 0
    stack = np.empty((_DEEPEST, 4, 3))
    near, rr = np.empty_like(centres), np.empty_like(radii)
    for root in range(fan.shape[0]):
        if not open_[root]:
            continue
        near_n = _nearby(fan[root], centres, radii, near, rr)
        mine, top, last = 0, 0, 0
        copy_rows(fan[root], stack[0])
        for i in range(4):
            if mine == 0 and not _in_some(fan[root, i], near, rr, near_n):
                found[n] = fan[root, i]
                n += 1
                mine += 1
        while top >= 0 and mine < 3 and n < most:
            i = _one_ball(stack[top], near, rr, near_n, last)
            if i >= 0:
                last = i
                top -= 1
                continue
            a, b, long = _longest(stack[top])
            middle = (stack[top, a] + stack[top, b]) / 2
            if long < smallest * smallest or not _in_some(middle, near, rr, near_n):
                found[n] = middle
                n += 1
                mine += 1
                top -= 1
            else:
                _split(stack, top, a, b)
                top += 1
        if n == most:
            break
        open_[root] = mine > 0
    return found[:n].copy()


@njit(cache=True, nogil=True)
def _nearby(T: Array, centres: Array, radii: Array, near: Array, rr: Array) -> int:
    """Copy the balls that meet a ball around the tetrahedron T (4, 3) to near, their squared radii to rr; and how many they are."""
    x, y, z = T[:, 0].mean(), T[:, 1].mean(), T[:, 2].mean()
    reach = 0.0
    for i in range(4):
        reach = max(reach, np.sqrt((T[i, 0] - x) ** 2 + (T[i, 1] - y) ** 2 + (T[i, 2] - z) ** 2))
    n = 0
    for i in range(radii.shape[0]):
        if _holds(centres[i], (radii[i] + reach) ** 2, x, y, z):
            near[n] = centres[i]
            rr[n] = radii[i] * radii[i]
            n += 1
    return n


@jit_inline
def _in_some(p: Array, centres: Array, rr: Array, n: int) -> bool:
    for i in range(n):  # noqa: SIM110
        if _holds(centres[i], rr[i], p[0], p[1], p[2]):
            return True
    return False


@njit(cache=True, nogil=True)
def _links(fan: Array, coarse: Array, coarse_r: Array, fine: Array, fine_r: Array) -> NDArray[np.uint8]:
    """Which coarse ball lists which fine ball (C, F): the same bisection, until a leaf lies in one of each; pairs at hand are preferred."""
    A, B = coarse_r.shape[0], fine_r.shape[0]
    linked = np.zeros((A, B), np.uint8)
    stack, near_a, near_b = np.empty((_DEEPEST, 4, 3)), np.empty((_DEEPEST, A), np.int64), np.empty((_DEEPEST, B), np.int64)
    many, in_a, all_ = np.zeros((2, _DEEPEST), np.int64), np.empty(A, np.int64), np.arange(max(A, B))
    for root in range(fan.shape[0]):
        copy_rows(fan[root], stack[0])
        many[0, 0] = _reaching(stack[0], coarse, coarse_r, all_, A, near_a[0])
        many[1, 0] = _reaching(stack[0], fine, fine_r, all_, B, near_b[0])
        _link(stack, coarse, coarse_r, fine, fine_r, near_a, near_b, many, in_a, linked)
    return linked


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
    x = (T[0, 0] + T[1, 0] + T[2, 0] + T[3, 0]) / 4
    y = (T[0, 1] + T[1, 1] + T[2, 1] + T[3, 1]) / 4
    z = (T[0, 2] + T[1, 2] + T[2, 2] + T[3, 2]) / 4
    reach = 0.0
    for i in range(4):
        reach = max(reach, np.sqrt((T[i, 0] - x) ** 2 + (T[i, 1] - y) ** 2 + (T[i, 2] - z) ** 2))
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


def _by_size(balls: Cover) -> Cover:
    order = np.argsort(-balls.radii, kind="stable")
    return Cover(balls.centres[order], balls.radii[order], balls.excess_m)


def _csr(linked: NDArray[np.uint8] | NDArray[np.bool_]) -> tuple[Int, Int]:
    """Row starts (C + 1,) and column indices of a 0-1 matrix (C, F)."""
    return np.concatenate([[0], np.cumsum(linked.sum(1, dtype=np.int64))]).astype(np.int64), np.nonzero(linked)[1].astype(np.int64)


# Boxes and cylinders: a weighted set cover of grid cells, in one octant and mirrored


def _twins(centres: Array, axis: int) -> Int:
    """The index of each ball's mirror image, of balls that are symmetric about the plane across an axis."""
    mirrored = centres.copy()
    mirrored[:, axis] *= -1
    twins = np.empty(len(centres), np.int64)
    twins[np.lexsort(mirrored.T)] = np.lexsort(centres.T)
    return twins


def box_cover(size_m: tuple[float, float, float], excess_m: float) -> Cover:
    """Balls that contain the cuboid about the origin with edges size_m and reach at most excess_m beyond it."""
    half = np.array(size_m, float) / 2
    if not (half > 0).all() or not excess_m > 0:
        raise ValueError(f"a box of {size_m} m with {excess_m} m of excess: all must be positive")
    step = excess_m
    while True:
        far, spots = zip(*(_axis(h, step) for h in half), strict=True)
        centres = np.stack(np.meshgrid(*spots, indexing="ij"), -1).reshape(-1, 3)
        radii = (half - centres).min(1) + excess_m
        weights = 2.0 ** (centres > 0).sum(1)
        holds = _cells_held(far[0], far[1], far[2], radii - _SLACK * excess_m)
        chosen, left = _weighted(holds, far[0].shape[1] * far[1].shape[1] * far[2].shape[1], weights, np.zeros(0, np.int64))
        if left == 0:
            c, r = _mirrored(centres[chosen], radii[chosen])
            return Cover(c, r, excess_m)
        step /= 2


def cylinder_cover(radius_m: float, height_m: float, excess_m: float) -> Cover:
    """Balls that contain the cylinder about z (and the prism of `shapes.prism` around it) and reach at most excess_m beyond it."""
    if not min(radius_m, height_m, excess_m) > 0:
        raise ValueError(f"a cylinder of {radius_m} × {height_m} m with {excess_m} m of excess: all must be positive")
    outer, h = radius_m / np.cos(np.pi / CYLINDER_SIDES), height_m / 2
    step = excess_m
    most = 8 + 4 * outer / excess_m  # balls in the ring that holds the rim: each takes about a step of it
    rings = np.unique(np.concatenate([[1], np.geomspace(3, most, 14).astype(np.int64)]))
    while True:
        cells, (spots, heights) = [_edges(outer, step), _edges(h, step)], (_spots(radius_m, step), _spots(h, step))
        rho, z, n = (g.ravel() for g in np.meshgrid(spots, heights, rings, indexing="ij"))
        fits = (n > 1) | (rho == 0)
        rho, z, n = rho[fits], z[fits], n[fits]
        radii = np.minimum(radius_m - rho, h - z) + excess_m
        r = cells[0]
        flat = r[None] ** 2 + rho[:, None] ** 2 - 2 * r[None] * (rho * np.cos(np.pi / n))[:, None]
        flat = np.maximum(flat[:, :-1], flat[:, 1:])
        tall = (cells[1][None] - z[:, None]) ** 2
        tall = np.maximum(tall[:, :-1], tall[:, 1:])
        holds = (flat[:, :, None] + tall[:, None, :] <= ((radii - _SLACK * excess_m) ** 2)[:, None, None]).reshape(len(rho), -1)
        chosen, left = _weighted(_packed(holds), holds.shape[1], n * (1.0 + (z > 0)), np.zeros(0, np.int64))
        if left == 0:
            rows = []
            for i in chosen:
                angle = 2 * np.pi * (np.arange(n[i]) + 0.5 * (i % 2)) / n[i]
                rows += [
                    np.c_[rho[i] * np.cos(angle), rho[i] * np.sin(angle), np.full(n[i], s * z[i]), np.full(n[i], radii[i])]
                    for s in ((1, -1) if z[i] > 0 else (1,))
                ]
            balls = np.concatenate(rows)
            return Cover(balls[:, :3].copy(), balls[:, 3].copy(), excess_m)
        step /= 2


def _edges(h: float, step: float) -> Array:
    """Cell edges over [0, h], not wider than 0.6 step."""
    return np.linspace(0, h, max(1, int(np.ceil(h / (0.6 * step)))) + 1)


def _spots(h: float, step: float) -> Array:
    """Coordinates in [0, h] for centres: counted from the surface inwards, and 0."""
    deep = np.concatenate([np.arange(0.5, 2.5, 0.5), np.arange(3.0, max(h / step, 3.0))])
    inner = h - step * deep
    return np.concatenate([[0.0], inner[inner > 0.1 * step]])


def _axis(h: float, step: float) -> tuple[Array, Array]:
    """For one axis: the squared distance (spots, cells) from a centre's coordinate to the far side of each cell; and the spots."""
    edges, spots = _edges(h, step), _spots(h, step)
    d = (edges[None] - spots[:, None]) ** 2
    return np.maximum(d[:, :-1], d[:, 1:]), spots


@njit(cache=True, nogil=True)
def _cells_held(fx: Array, fy: Array, fz: Array, radii: Array) -> Bits:
    """Whether ball (i, j, k) of the lattice holds cell (u, v, w), as (balls, words of 64 cells)."""
    nx, ny, nz = fx.shape[1], fy.shape[1], fz.shape[1]
    holds, one = np.zeros((radii.shape[0], nx * ny * nz // 64 + 1), np.uint64), np.uint64(1)
    for k in range(fz.shape[0]):
        middle = int(np.argmin(fz[k]))  # away from it the cells' far sides are only ever further
        for i in range(fx.shape[0]):
            for j in range(fy.shape[0]):
                ball = (i * fy.shape[0] + j) * fz.shape[0] + k
                rr = radii[ball] ** 2 if radii[ball] > 0 else -1.0
                for u in range(nx):
                    for v in range(ny):
                        left = rr - fx[i, u] - fy[j, v]
                        if fz[k, middle] > left:
                            continue
                        first, last = middle, middle
                        while first > 0 and fz[k, first - 1] <= left:
                            first -= 1
                        while last + 1 < nz and fz[k, last + 1] <= left:
                            last += 1
                        at = (u * ny + v) * nz
                        for cell in range(at + first, at + last + 1):
                            holds[ball, cell >> 6] |= one << np.uint64(cell & 63)
    return holds


def _packed(holds: NDArray[np.bool_]) -> Bits:
    """Rows of flags as rows of words, at least one, of 64 flags each."""
    room = np.zeros((len(holds), 8 * (holds.shape[1] // 64 + 1)), np.uint8)
    packed = np.packbits(holds, axis=1, bitorder="little")
    room[:, : packed.shape[1]] = packed
    return room.view(np.uint64)


def _mirrored(centres: Array, radii: Array) -> tuple[Array, Array]:
    """The balls of the octant x, y, z >= 0 in all octants, once where they lie on a plane between two."""
    balls = np.c_[centres, radii]
    for axis in range(3):
        twin = balls[balls[:, axis] > 0].copy()
        twin[:, axis] *= -1
        balls = np.concatenate([balls, twin])
    return balls[:, :3].copy(), balls[:, 3].copy()
