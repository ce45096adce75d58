"""How far apart two convex solids are: GJK (Gilbert, Johnson and Keerthi 1988) with a certified lower bound.

Every support plane that GJK meets proves a distance, whatever rounding did to the simplex that led there. So the number that comes back
is never too large: "separated" is certain, and a stall in a degenerate case (coplanar faces, repeated vertices, deep overlap) costs
tightness at worst, never truth.

The first solid is a polyhedron, vertices[:, a0:a1] of one shared array (3, N) in its own frame; the second a BOX or CYLINDER with
half sizes (3,), or a HULL, vertices[:, b0:b1]. Vertices lie by coordinate because the support scan then runs over contiguous memory.
vertex_groups.py sorts large hulls for a quicker search.

`work` (8, 4) is scratch: rows 0–2 the first solid's frame in the second's, rows 3–6 the simplex, row 7 the direction from the second solid
to the first (in the second's frame), where the search starts, and in its place the normal of the plane that proves the bound, with the
bound in column 3 when there is one. A kept row 7 warm-starts the next query of the pair; zeros mean no idea.
"""

from __future__ import annotations

import numpy as np

from kinematics.collision.geometry import BOX, CYLINDER
from kinematics.collision.vertex_groups import GROUP
from kinematics.jit.decorators import jit_entry, jit_inline, njit
from kinematics.transforms import Array

MOST_STEPS = 48
"""Steps of GJK after which the bound reached so far is the answer; polyhedra need about 6, cylinders to full precision about 15."""
TIGHT = 0.05
"""The tolerance that holds at least where it must be told whether a distance exceeds `low`."""
TOUCHING_M = 1e-10
"""Distances below this are called 0."""


def make_work() -> Array:
    """Scratch (8, 4) for the functions below."""
    return np.zeros((8, 4))


@njit(cache=True, nogil=True)
def distance(vertices: Array, a0: int, a1: int, T_a: Array, kind: int, half: Array, b0: int, b1: int, T_b: Array, work: Array) -> float:
    """The distance in metres between a polyhedron at T_a (4, 4) and a solid at T_b (4, 4), to 1e-9 relative; 0 when they touch."""
    relative(T_a, T_b, work)
    return float(gjk(vertices, np.empty((4, 0)), a0, a1, kind, half[0], half[1], half[2], b0, b1, work, 0.0, np.inf, 1e-9))


@jit_entry
def relative(T_a: Array, T_b: Array, work: Array) -> None:
    """Write the frame T_a (4, 4) as seen from T_b (4, 4) into rows 0–2 of work."""
    x, y, z = T_a[0, 3] - T_b[0, 3], T_a[1, 3] - T_b[1, 3], T_a[2, 3] - T_b[2, 3]
    for r in range(np.uint64(3)):
        a, b, c = T_b[0, r], T_b[1, r], T_b[2, r]
        work[r, 0] = a * T_a[0, 0] + b * T_a[1, 0] + c * T_a[2, 0]
        work[r, 1] = a * T_a[0, 1] + b * T_a[1, 1] + c * T_a[2, 1]
        work[r, 2] = a * T_a[0, 2] + b * T_a[1, 2] + c * T_a[2, 2]
        work[r, 3] = a * x + b * y + c * z


@jit_entry
def box_gap(boxes: Array, a: int, b: int, work: Array) -> float:
    """A cheap lower bound of the distance of two boxes, rows a and b of boxes (·, ≥ 6): half sizes, then centres, each along the axes of
    its own frame; the frames are related by rows 0–2 of work.

    Each box in turn is widened to one along the other's axes; the distance of two such boxes is exact.
    """
    i, j = np.uint64(a), np.uint64(b)
    x, y, z = boxes[i, 3], boxes[i, 4], boxes[i, 5]
    c0 = work[0, 0] * x + work[0, 1] * y + work[0, 2] * z + work[0, 3] - boxes[j, 3]
    c1 = work[1, 0] * x + work[1, 1] * y + work[1, 2] * z + work[1, 3] - boxes[j, 4]
    c2 = work[2, 0] * x + work[2, 1] * y + work[2, 2] * z + work[2, 3] - boxes[j, 5]
    ax, ay, az = boxes[i, 0], boxes[i, 1], boxes[i, 2]
    bx, by, bz = boxes[j, 0], boxes[j, 1], boxes[j, 2]
    in_b = in_a = 0.0
    x = abs(c0) - bx - abs(work[0, 0]) * ax - abs(work[0, 1]) * ay - abs(work[0, 2]) * az
    in_b += max(x, 0.0) ** 2
    x = abs(c1) - by - abs(work[1, 0]) * ax - abs(work[1, 1]) * ay - abs(work[1, 2]) * az
    in_b += max(x, 0.0) ** 2
    x = abs(c2) - bz - abs(work[2, 0]) * ax - abs(work[2, 1]) * ay - abs(work[2, 2]) * az
    in_b += max(x, 0.0) ** 2
    x = abs(work[0, 0] * c0 + work[1, 0] * c1 + work[2, 0] * c2) - ax
    x -= abs(work[0, 0]) * bx + abs(work[1, 0]) * by + abs(work[2, 0]) * bz
    in_a += max(x, 0.0) ** 2
    x = abs(work[0, 1] * c0 + work[1, 1] * c1 + work[2, 1] * c2) - ay
    x -= abs(work[0, 1]) * bx + abs(work[1, 1]) * by + abs(work[2, 1]) * bz
    in_a += max(x, 0.0) ** 2
    x = abs(work[0, 2] * c0 + work[1, 2] * c1 + work[2, 2] * c2) - az
    x -= abs(work[0, 2]) * bx + abs(work[1, 2]) * by + abs(work[2, 2]) * bz
    in_a += max(x, 0.0) ** 2
    return float(np.sqrt(max(in_a, in_b)))


@jit_inline
def gjk(
    vertices: Array,
    groups: Array,
    a0: int,
    a1: int,
    kind: int,
    hx: float,
    hy: float,
    hz: float,
    b0: int,
    b1: int,
    work: Array,
    low: float,
    high: float,
    tolerance: float,
) -> float:
    """A certified lower bound of the distance in metres, 0 when the solids touch. hx, hy, hz: the second solid's half sizes. It stops as
    soon as the distance is known

    - to be at least `high`: the bound returned is ≥ high;
    - to be at most `low`, or within the relative tolerance: the bound returned is the best so far. Whether it exceeds `low` is told to
      5 % even when the tolerance is wider.
    """
    R = work
    vx, vy, vz = work[7, 0], work[7, 1], work[7, 2]
    if vx * vx + vy * vy + vz * vz == 0.0:
        vx, vy, vz = work[0, 3], work[1, 3], work[2, 3]
        if vx * vx + vy * vy + vz * vz == 0.0:
            vx = 1.0
    n, bound, upper = 0, 0.0, 1e300
    for _ in range(MOST_STEPS):
        # the vertex of the first solid furthest along -v, placed in the second's frame
        i = support(
            vertices,
            groups,
            a0,
            a1,
            -(R[0, 0] * vx + R[1, 0] * vy + R[2, 0] * vz),
            -(R[0, 1] * vx + R[1, 1] * vy + R[2, 1] * vz),
            -(R[0, 2] * vx + R[1, 2] * vy + R[2, 2] * vz),
        )
        u = np.uint64(i)
        x, y, z = vertices[0, u], vertices[1, u], vertices[2, u]
        wx = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + R[0, 3]
        wy = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + R[1, 3]
        wz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + R[2, 3]
        # minus the point of the second solid furthest along v
        if kind == BOX:
            wx -= hx if vx > 0 else -hx
            wy -= hy if vy > 0 else -hy
            wz -= hz if vz > 0 else -hz
        elif kind == CYLINDER:
            r = np.sqrt(vx * vx + vy * vy)
            if r > 0:
                wx -= hx * vx / r
                wy -= hx * vy / r
            wz -= hz if vz > 0 else -hz
        else:
            u = np.uint64(support(vertices, groups, b0, b1, vx, vy, vz))
            wx -= vertices[0, u]
            wy -= vertices[1, u]
            wz -= vertices[2, u]
        length = np.sqrt(vx * vx + vy * vy + vz * vz)
        plane = (vx * wx + vy * wy + vz * wz) / length - 1e-13  # every point of the difference lies beyond it
        if plane > bound:
            bound = plane
            work[7, 0], work[7, 1], work[7, 2], work[7, 3] = vx, vy, vz, bound
            if bound >= high:
                return float(bound)
        if upper <= low or upper - bound <= (tolerance if bound > low else min(tolerance, TIGHT)) * upper:
            return float(bound)
        row = np.uint64(3 + n)
        work[row, 0], work[row, 1], work[row, 2] = wx, wy, wz
        n, vx, vy, vz = _nearest(work, n + 1)
        length = np.sqrt(vx * vx + vy * vy + vz * vz)
        if length <= TOUCHING_M:
            return 0.0
        if length >= upper:  # no progress: rounding has the last word
            return float(bound)
        upper = length
    return float(bound)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def support(vertices: Array, groups: Array, start: int, stop: int, x: float, y: float, z: float) -> int:
    """The index in [start, stop) of the vertex furthest along (x, y, z).

    With groups (4, N / GROUP), balls around GROUP vertices each in the order of `grouped`, large hulls are searched only where a ball
    reaches further than the best vertex so far: twice as quick as the scan for 700 vertices. groups (4, 0): a plain scan.
    """
    X, Y, Z, W, one = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(1)  # unsigned: no look for negative indices
    best, at = -1e300, np.uint64(start)
    if stop - start <= 4 * GROUP or groups.shape[1] == 0:
        for i in range(np.uint64(start), np.uint64(stop)):
            d = vertices[X, i] * x + vertices[Y, i] * y + vertices[Z, i] * z
            at = np.uint64(i) if d > best else at
            best = d if d > best else best
        return int(at)
    size = np.sqrt(x * x + y * y + z * z)
    first, last, width = np.uint64(start // GROUP), np.uint64(stop // GROUP), np.uint64(GROUP)
    top, g = -1e300, first
    for k in range(first, last):
        d = groups[X, k] * x + groups[Y, k] * y + groups[Z, k] * z + groups[W, k] * size
        g = np.uint64(k) if d > top else g
        top = d if d > top else top
    for i in range(g * width, (g + one) * width):
        d = vertices[X, i] * x + vertices[Y, i] * y + vertices[Z, i] * z
        at = np.uint64(i) if d > best else at
        best = d if d > best else best
    for k in range(first, last):
        if groups[X, k] * x + groups[Y, k] * y + groups[Z, k] * z + groups[W, k] * size > best:
            for i in range(k * width, (k + one) * width):
                d = vertices[X, i] * x + vertices[Y, i] * y + vertices[Z, i] * z
                at = np.uint64(i) if d > best else at
                best = d if d > best else best
    return int(at)


@jit_inline
def _nearest(work: Array, n: int) -> tuple[int, float, float, float]:
    """The point nearest to the origin in the simplex of n ≤ 4 points; keeps, in place, the points that carry it, and says how many.

    A tetrahedron that holds the origin gives (4, 0, 0, 0).
    """
    mask, x, y, z = 1, work[3, 0], work[3, 1], work[3, 2]
    if n == 2:
        mask, x, y, z = _on_segment(work, 0, 1)
    elif n == 3:
        mask, x, y, z = _on_triangle(work, 0, 1, 2)
    elif n == 4:
        # the last point is new: what is nearest lies on one of its three faces, or inside
        least, mask = np.inf, 15
        x = y = z = 0.0
        for k in range(3):
            i, j = (1 if k == 0 else 0), (1 if k == 2 else 2)
            if not _beyond(work, i, j, k):
                m, px, py, pz = _on_triangle(work, i, j, 3)
                d = px * px + py * py + pz * pz
                if d < least:
                    least, mask, x, y, z = d, m, px, py, pz
    kept = 0
    for i in range(n):
        if mask >> i & 1:
            to, row = np.uint64(3 + kept), np.uint64(3 + i)
            work[to, 0], work[to, 1], work[to, 2] = work[row, 0], work[row, 1], work[row, 2]
            kept += 1
    return kept, x, y, z


@jit_inline
def _beyond(work: Array, i: int, j: int, k: int) -> bool:
    """Whether the origin is on the same side of the face (i, j, 3) as point k, for certain: a flat tetrahedron never says so."""
    ri, rj, rk = np.uint64(3 + i), np.uint64(3 + j), np.uint64(3 + k)
    ux, uy, uz = work[rj, 0] - work[ri, 0], work[rj, 1] - work[ri, 1], work[rj, 2] - work[ri, 2]
    wx, wy, wz = work[6, 0] - work[ri, 0], work[6, 1] - work[ri, 1], work[6, 2] - work[ri, 2]
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    height = nx * (work[rk, 0] - work[ri, 0]) + ny * (work[rk, 1] - work[ri, 1]) + nz * (work[rk, 2] - work[ri, 2])
    side = -(nx * work[ri, 0] + ny * work[ri, 1] + nz * work[ri, 2])
    return bool(side * height > 0.0 and height * height > TOUCHING_M * TOUCHING_M * (nx * nx + ny * ny + nz * nz))


@jit_inline
def _on_triangle(work: Array, i: int, j: int, k: int) -> tuple[int, float, float, float]:
    """The point of a triangle nearest to the origin, and a bit mask of the corners that carry it."""
    ri, rj, rk = np.uint64(3 + i), np.uint64(3 + j), np.uint64(3 + k)
    ax, ay, az = work[ri, 0], work[ri, 1], work[ri, 2]
    bx, by, bz = work[rj, 0], work[rj, 1], work[rj, 2]
    cx, cy, cz = work[rk, 0], work[rk, 1], work[rk, 2]
    ux, uy, uz = bx - ax, by - ay, bz - az
    wx, wy, wz = cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    nn = nx * nx + ny * ny + nz * nz
    flat = nn <= 1e-20 * (ux * ux + uy * uy + uz * uz) * (wx * wx + wy * wy + wz * wz)
    # signed areas seen from the origin: negative where it lies outside of an edge
    over_a = nx * (by * cz - bz * cy) + ny * (bz * cx - bx * cz) + nz * (bx * cy - by * cx)
    over_b = nx * (cy * az - cz * ay) + ny * (cz * ax - cx * az) + nz * (cx * ay - cy * ax)
    over_c = nx * (ay * bz - az * by) + ny * (az * bx - ax * bz) + nz * (ax * by - ay * bx)
    if not flat and over_a > 0.0 and over_b > 0.0 and over_c > 0.0:
        s = (nx * ax + ny * ay + nz * az) / nn
        return (1 << i) | (1 << j) | (1 << k), nx * s, ny * s, nz * s
    least, mask = np.inf, 0
    x = y = z = 0.0
    for e in range(3):
        if flat or (over_a if e == 0 else (over_b if e == 1 else over_c)) <= 0.0:
            m, px, py, pz = _on_segment(work, j if e == 0 else i, j if e == 2 else k)
            d = px * px + py * py + pz * pz
            if d < least:
                least, mask, x, y, z = d, m, px, py, pz
    return mask, x, y, z


@jit_inline
def _on_segment(work: Array, i: int, j: int) -> tuple[int, float, float, float]:
    """The point of a segment nearest to the origin, and a bit mask of the ends that carry it."""
    ri, rj = np.uint64(3 + i), np.uint64(3 + j)
    ax, ay, az = work[ri, 0], work[ri, 1], work[ri, 2]
    ux, uy, uz = work[rj, 0] - ax, work[rj, 1] - ay, work[rj, 2] - az
    uu = ux * ux + uy * uy + uz * uz
    t = -(ax * ux + ay * uy + az * uz)
    if t <= 0.0 or uu == 0.0:
        return 1 << i, ax, ay, az
    if t >= uu:
        return 1 << j, work[rj, 0], work[rj, 1], work[rj, 2]
    t /= uu
    return (1 << i) | (1 << j), ax + t * ux, ay + t * uy, az + t * uz
