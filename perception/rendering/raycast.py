"""Depth and instance images of boxes, cylinders, convex hulls and triangle meshes.

Images are drawn, not traced: the inverse depth w = 1 / z at which a pixel's ray meets a plane is affine in the pixel's column and row. So
a box is a few affine functions, a cylinder two and a square root, a triangle four (Olano and Greer, "Triangle scan conversion using 2D
homogeneous coordinates", 1997), and a buffer keeps the largest w. This is as exact as tracing rays, needs no division per pixel, no tree
and no near plane, and the compiler turns it into vector code.

Surfaces have two sides, as in Embree: a camera inside a solid sees that solid's far side from within, never a side behind itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.geometry import BOX, CYLINDER, HULL
from kinematics.doors import checked
from kinematics.jit.decorators import njit
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from kinematics.transforms import Array, inverse
from perception.camera import Intrinsics

Int = NDArray[np.int64]
Ids = NDArray[np.int32]
MESH = 3
"""Any triangles, beside the convex kinds of `kinematics.collision.geometry`."""
FAR = 1e30
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles: vertices (V, 3) in metres, faces (F, 3) rows of vertices; they need neither be closed nor face one way."""

    vertices: Array
    faces: Int


class Surfaces(NamedTuple):
    """S posed solids: kind (S,) BOX, CYLINDER, HULL or MESH; T (S, 4, 4) in the world; half (S, 3) as in `Solids`; id (S,), what an image
    calls them. Solid s has the faces[first_face[s]:first_face[s + 1]] (·, 3), rows of vertices (V, 3), which are in its own frame and of
    which vertices[first_vertex[s]:first_vertex[s + 1]] are its own. A hull's faces turn counter-clockwise outwards.
    """

    kind: Int
    T: Array
    half: Array
    id: Ids
    first_vertex: Int
    vertices: Array
    first_face: Int
    faces: Int


class View(NamedTuple):
    """What a camera sees. depth (H, W): z in metres, 0 where nothing is; instance (H, W): the solid's id, -1 where nothing is;
    normals (H, W, 3): unit, towards the camera, in the world, zero where nothing is; None if not asked for.
    """

    depth: NDArray[np.float32]
    instance: Ids
    normals: NDArray[np.float32] | None


def surfaces(shapes: Sequence[Shape | Mesh | Array], T: Array) -> Surfaces:
    """Pack shapes at their poses T (B, 4, 4); an array (V, 3) stands for the convex hull of its points. The id is the shape's place."""
    rows: list[tuple[int, int, Array, Array, Int]] = []
    no_points, no_faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    for i, shape in enumerate(shapes):
        match shape:
            case Box():
                rows.append((i, BOX, shape.half, no_points, no_faces))
            case Cylinder():
                rows.append((i, CYLINDER, shape.half, no_points, no_faces))
            case ConvexMesh():
                rows += [(i, HULL, np.zeros(3), *hull_faces(part)) for part in shape.parts]
            case Mesh():
                rows.append((i, MESH, np.zeros(3), np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int64)))
            case _:
                rows.append((i, HULL, np.zeros(3), *hull_faces(shape)))
    return _pack(rows, checked("T", np.asarray(T, float).reshape(-1, 4, 4), len(shapes), 4, 4))


def join(*several: Surfaces) -> Surfaces:
    """All in one. The ids of each follow on those of the one before: b's begin at a's greatest + 1."""
    vertices, faces, solids = 0, 0, 0
    ids, first_vertex, first_face, rows = [], [np.zeros(1, np.int64)], [np.zeros(1, np.int64)], []
    for s in several:
        ids.append(s.id + np.int32(solids))
        rows.append(s.faces + vertices)
        first_vertex.append(s.first_vertex[1:] + vertices)
        first_face.append(s.first_face[1:] + faces)
        vertices, faces, solids = vertices + len(s.vertices), faces + len(s.faces), solids + int(s.id.max(initial=-1)) + 1
    return Surfaces(
        np.concatenate([s.kind for s in several]),
        np.concatenate([s.T for s in several]),
        np.concatenate([s.half for s in several]),
        np.concatenate(ids),
        np.concatenate(first_vertex),
        np.concatenate([s.vertices for s in several]),
        np.concatenate(first_face),
        np.concatenate(rows),
    )


def moved(s: Surfaces, T: Array) -> Surfaces:
    """The same shapes, the one with id i at T[i]; T is (B, 4, 4). Nothing is packed or triangulated again."""
    return s._replace(T=np.ascontiguousarray(T[s.id], float))


def raycast(s: Surfaces, T_world_camera: Array, intrinsics: Intrinsics, *, normals: bool = False) -> View:
    """What a pinhole camera at T_world_camera (4, 4) sees of the solids. Depth is 0 and the instance -1 where there is nothing."""
    T_world_camera = checked("T_world_camera", T_world_camera, 4, 4)
    w, primitive = inverse_depth(s, T_world_camera, intrinsics)
    shape = (intrinsics.height, intrinsics.width)
    depth, instance = np.empty(shape, np.float32), np.empty(shape, np.int32)
    _finish(s, w, primitive, depth, instance)
    facing = np.zeros((*shape, 3), np.float32) if normals else None
    if facing is not None:
        camera = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
        _normals(s, np.ascontiguousarray(T_world_camera, float), *camera, w, primitive, np.zeros((0, 3, 3)), facing)
    return View(depth, instance, facing)


def inverse_depth(s: Surfaces, T_world_camera: Array, intrinsics: Intrinsics) -> tuple[Array, Ids]:
    """The image as it is drawn: 1 / depth (H, W), 0 where nothing is; and the primitive (H, W) that is seen: solid k of the S, or S + the
    row of the face, or -1.
    """
    w = np.zeros((intrinsics.height, intrinsics.width))
    primitive = np.full(w.shape, -1, np.int32)
    _draw(s, inverse(T_world_camera), intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, w, primitive)
    return w, primitive


def hull_faces(points: Array) -> tuple[Array, Int]:
    """The corners (V, 3) of the convex hull of points and its triangles (F, 3), counter-clockwise seen from outside."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(np.asarray(points, float))
    place = np.full(len(points), -1, np.int64)
    place[hull.vertices] = np.arange(len(hull.vertices))
    corners = hull.points[hull.simplices]
    turn = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    wrong = np.einsum("fi,fi->f", turn, hull.equations[:, :3]) < 0
    faces = place[hull.simplices]
    faces[wrong] = faces[wrong][:, ::-1]
    return np.ascontiguousarray(hull.points[hull.vertices]), faces


def _pack(rows: list[tuple[int, int, Array, Array, Int]], T: Array) -> Surfaces:
    ids = np.array([r[0] for r in rows], np.int32)
    first_vertex = np.concatenate([[0], np.cumsum([len(r[3]) for r in rows])]).astype(np.int64)
    first_face = np.concatenate([[0], np.cumsum([len(r[4]) for r in rows])]).astype(np.int64)
    return Surfaces(
        np.array([r[1] for r in rows], np.int64),
        np.ascontiguousarray(T[ids]),
        np.array([r[2] for r in rows]).reshape(-1, 3),
        ids,
        first_vertex,
        np.concatenate([np.zeros((0, 3)), *(r[3] for r in rows)]),
        first_face,
        np.concatenate([np.zeros((0, 3), np.int64), *(r[4] + v for r, v in zip(rows, first_vertex))]),
    )


# Drawing. `P` is a solid's pose in the camera frame; a plane of the solid keeps the ray where g ≤ s·w, with g affine in the pixel and s the
# plane's distance from the camera: an upper bound of w where the camera is beyond the plane, a lower one where it is on the solid's side.


@njit(cache=True, nogil=True)
def _draw(s: Surfaces, T_camera_world: Array, fx: float, fy: float, cx: float, cy: float, w: Array, primitive: Ids) -> None:
    P = np.empty((3, 4))
    most = 0
    for k in range(s.kind.shape[0]):
        most = max(most, s.first_vertex[k + 1] - s.first_vertex[k])
    camera_vertices = np.empty((most, 6))
    for k in range(s.kind.shape[0]):
        for r in range(3):
            for c in range(4):
                P[r, c] = T_camera_world[r, 0] * s.T[k, 0, c] + T_camera_world[r, 1] * s.T[k, 1, c] + T_camera_world[r, 2] * s.T[k, 2, c]
            P[r, 3] += T_camera_world[r, 3]
        if s.kind[k] == BOX:
            _draw_box(P, s.half[k], np.int32(k), fx, fy, cx, cy, w, primitive)
        elif s.kind[k] == CYLINDER:
            _draw_cylinder(P, s.half[k], np.int32(k), fx, fy, cx, cy, w, primitive)
        else:
            _draw_triangles(s, k, P, camera_vertices, fx, fy, cx, cy, w, primitive)


@njit(cache=True, nogil=True)
def _bounds(P: Array, half: Array, fx: float, fy: float, cx: float, cy: float, width: int, height: int) -> tuple[int, int, int, int]:
    """First and last column and row that a cuboid may cover; empty (first > last) when it is behind the camera or out of view."""
    u0, u1, v0, v1, behind = FAR, -FAR, FAR, -FAR, 0
    for i in range(8):
        x = half[0] if i & 1 else -half[0]
        y = half[1] if i & 2 else -half[1]
        z = half[2] if i & 4 else -half[2]
        depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
        if depth < 1e-6:
            behind += 1
        else:
            u = fx * (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / depth + cx
            v = fy * (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / depth + cy
            u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
    if behind == 8:
        return 0, -1, 0, -1
    if behind > 0:
        return 0, width - 1, 0, height - 1
    return _clamp(u0, u1, v0, v1, width, height)


@njit(cache=True, nogil=True)
def _clamp(u0: float, u1: float, v0: float, v1: float, width: int, height: int) -> tuple[int, int, int, int]:
    return (
        int(np.ceil(min(max(u0, 0.0), float(width)))),
        int(np.floor(max(min(u1, width - 1.0), -1.0))),
        int(np.ceil(min(max(v0, 0.0), float(height)))),
        int(np.floor(max(min(v1, height - 1.0), -1.0))),
    )


@njit(cache=True, nogil=True)
def _slab(P: Array, half: float, axis: int, fx: float, fy: float, cx: float, cy: float, planes: Array) -> None:
    """The two planes ± of one axis: rows [a, b, c, s] of planes (2, 4), with g / |s| = a·u + b·v + c and s = +1 lower, -1 upper bound."""
    o = -(P[0, axis] * P[0, 3] + P[1, axis] * P[1, 3] + P[2, axis] * P[2, 3])
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        s = half - sign * o
        if s >= 0.0 and s < TINY:
            s = TINY
        planes[side, 0] = sign * P[0, axis] / fx / s
        planes[side, 1] = sign * P[1, axis] / fy / s
        planes[side, 2] = sign * P[2, axis] / s - planes[side, 0] * cx - planes[side, 1] * cy
        planes[side, 3] = 1.0 if s > 0.0 else -1.0


@njit(cache=True, nogil=True)
def _draw_box(P: Array, half: Array, k: np.int32, fx: float, fy: float, cx: float, cy: float, w: Array, primitive: Ids) -> None:
    height, width = w.shape
    planes, upper, lower = np.empty((2, 4)), np.empty((6, 3)), np.empty((6, 3))
    n_upper, n_lower = 0, 0
    for axis in range(3):
        _slab(P, half[axis], axis, fx, fy, cx, cy, planes)
        for side in range(2):
            if planes[side, 3] < 0.0:
                upper[n_upper] = planes[side, :3]
                n_upper += 1
            else:
                lower[n_lower] = planes[side, :3]
                n_lower += 1
    if n_upper == 0:
        _fill_from_within(lower, k, w, primitive)
        return
    _, _, v0, v1 = _bounds(P, half, fx, fy, cx, cy, width, height)
    for i in range(n_upper, 3):
        upper[i] = upper[0]
    # The row is covered where every upper bound is positive and above every lower one: an interval of columns, found by its ends.
    conditions = np.empty((n_upper * (n_lower + 1), 4))
    n = 0
    for i in range(n_upper):
        for j in range(n_lower + 1):
            for c in range(3):
                conditions[n, c] = upper[i, c] - (lower[j, c] if j < n_lower else 0.0)
            conditions[n, 3] = -1.0 / conditions[n, 0] if abs(conditions[n, 0]) > 1e-300 else 0.0
            n += 1
    a0, a1, a2 = upper[0, 0], upper[1, 0], upper[2, 0]
    for v in range(v0, v1 + 1):
        first, last = 0.0, width - 1.0
        for i in range(n):
            rest = conditions[i, 1] * v + conditions[i, 2]
            if conditions[i, 0] > 0.0:
                first = max(first, rest * conditions[i, 3])
            elif conditions[i, 0] < 0.0:
                last = min(last, rest * conditions[i, 3])
            elif rest < 0.0:
                last = -1.0
        if last < first:
            continue
        b0 = upper[0, 1] * v + upper[0, 2]
        b1 = upper[1, 1] * v + upper[1, 2]
        b2 = upper[2, 1] * v + upper[2, 2]
        row, row_primitive = w[v], primitive[v]
        for u in range(int(np.ceil(first)), int(last) + 1):
            near = min(min(a0 * u + b0, a1 * u + b1), a2 * u + b2)
            seen = near > row[u]
            row[u] = near if seen else row[u]
            row_primitive[u] = k if seen else row_primitive[u]


@njit(cache=True, nogil=True)
def _fill_from_within(lower: Array, k: np.int32, w: Array, primitive: Ids) -> None:
    """A box around the camera: the whole image sees its far planes."""
    for v in range(w.shape[0]):
        row, row_primitive = w[v], primitive[v]
        for u in range(w.shape[1]):
            far = 0.0
            for i in range(6):
                far = max(far, lower[i, 0] * u + (lower[i, 1] * v + lower[i, 2]))
            seen = far > row[u]
            row[u] = far if seen else row[u]
            row_primitive[u] = k if seen else row_primitive[u]


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_cylinder(P: Array, half: Array, k: np.int32, fx: float, fy: float, cx: float, cy: float, w: Array, primitive: Ids) -> None:
    """With o the camera and d the ray across the axis, the side keeps the ray where c·w² + 2b·w + a ≤ 0: a = d·d, b = o·d, c = o·o - r²."""
    height, width = w.shape
    u0, u1, v0, v1 = _bounds(P, half, fx, fy, cx, cy, width, height)
    caps = np.empty((2, 4))
    _slab(P, half[2], 2, fx, fy, cx, cy, caps)
    ox = -(P[0, 0] * P[0, 3] + P[1, 0] * P[1, 3] + P[2, 0] * P[2, 3])
    oy = -(P[0, 1] * P[0, 3] + P[1, 1] * P[1, 3] + P[2, 1] * P[2, 3])
    c = ox * ox + oy * oy - half[0] * half[0]
    if abs(c) < TINY:
        c = TINY if c >= 0.0 else -TINY
    outside = c > 0.0
    within = not outside and caps[0, 3] > 0.0 and caps[1, 3] > 0.0
    rr, by_c = half[0] * half[0], 1.0 / c
    ax, ay, dx, dy = P[0, 0] / fx, P[0, 1] / fx, P[1, 0] / fy, P[1, 1] / fy
    top, floor = np.zeros(3), np.zeros((2, 3))  # what bounds w from above: at most one cap; from below: at most both
    top[2] = FAR
    for i in range(2):
        if caps[i, 3] < 0.0:
            top[:] = caps[i, :3]
        else:
            floor[i] = caps[i, :3]
    ta, fa, ga = top[0], floor[0, 0], floor[1, 0]
    for v in range(v0, v1 + 1):
        x0 = dx * (v - cy) + P[2, 0] - ax * cx
        y0 = dy * (v - cy) + P[2, 1] - ay * cx
        t0, f0, g0 = top[1] * v + top[2], floor[0, 1] * v + floor[0, 2], floor[1, 1] * v + floor[1, 2]
        row, row_primitive = w[v], primitive[v]
        for u in range(u0, u1 + 1):
            x, y = ax * u + x0, ay * u + y0
            across = ox * y - oy * x
            b = ox * x + oy * y
            a = x * x + y * y
            root2 = rr * a - across * across
            root = np.sqrt(max(root2, 0.0))
            high = ta * u + t0
            low = max(max(fa * u + f0, ga * u + g0), 0.0)
            high = min(high, (root - b) * by_c) if outside else high
            low = max(low, -(b + root) * by_c if b > 0.0 else a / max(root - b, 1e-300))  # two forms of one root, each where it is exact
            near = low if within else high
            seen = (root2 >= 0.0) & (low <= high) & (near > row[u])
            row[u] = near if seen else row[u]
            row_primitive[u] = k if seen else row_primitive[u]


@njit(cache=True, nogil=True)
def _draw_triangles(s: Surfaces, k: int, P: Array, p: Array, fx: float, fy: float, cx: float, cy: float, w: Array, primitive: Ids) -> None:
    """With corners p_i in the camera frame the ray d meets the triangle where every e_i = (p_j × p_k)·d has the sign of det(p_0, p_1, p_2);
    there w = n·d / n·p_0. Both triangles at an edge compute the same e_i but for its sign, so no ray slips through between them.
    """
    height, width = w.shape
    start, base = s.first_vertex[k], s.kind.shape[0]
    in_front = True
    for i in range(s.first_vertex[k + 1] - start):
        x, y, z = s.vertices[start + i, 0], s.vertices[start + i, 1], s.vertices[start + i, 2]
        for r in range(3):
            p[i, r] = P[r, 0] * x + P[r, 1] * y + P[r, 2] * z + P[r, 3]
        if p[i, 2] > 1e-6:
            p[i, 5] = 1.0 / p[i, 2]
            p[i, 3] = fx * p[i, 0] * p[i, 5] + cx
            p[i, 4] = fy * p[i, 1] * p[i, 5] + cy
        else:
            in_front = False
    front_only = False
    if s.kind[k] == HULL:  # from outside its back faces are hidden; from inside there are only back faces
        for f in range(s.first_face[k], s.first_face[k + 1]):
            if _facing(p, s.faces[f, 0] - start, s.faces[f, 1] - start, s.faces[f, 2] - start) < 0.0:
                front_only = True
                break
    for f in range(s.first_face[k], s.first_face[k + 1]):
        i0, i1, i2 = s.faces[f, 0] - start, s.faces[f, 1] - start, s.faces[f, 2] - start
        whole = in_front or (p[i0, 2] > 1e-6 and p[i1, 2] > 1e-6 and p[i2, 2] > 1e-6)
        if whole:
            u_low, u_high = min(min(p[i0, 3], p[i1, 3]), p[i2, 3]), max(max(p[i0, 3], p[i1, 3]), p[i2, 3])
            v_low, v_high = min(min(p[i0, 4], p[i1, 4]), p[i2, 4]), max(max(p[i0, 4], p[i1, 4]), p[i2, 4])
            w_low, w_high = min(min(p[i0, 5], p[i1, 5]), p[i2, 5]), max(max(p[i0, 5], p[i1, 5]), p[i2, 5])
        elif p[i0, 2] <= 0.0 and p[i1, 2] <= 0.0 and p[i2, 2] <= 0.0:
            continue
        else:
            u_low, u_high, v_low, v_high, w_low, w_high = 0.0, float(width), 0.0, float(height), 0.0, FAR
        u0, u1, v0, v1 = _clamp(u_low, u_high, v_low, v_high, width, height)
        if u0 > u1 or v0 > v1:
            continue
        x0, y0, z0 = p[i0, 0], p[i0, 1], p[i0, 2]
        x1, y1, z1 = p[i1, 0], p[i1, 1], p[i1, 2]
        x2, y2, z2 = p[i2, 0], p[i2, 1], p[i2, 2]
        nx = (y1 - y0) * (z2 - z0) - (z1 - z0) * (y2 - y0)
        ny = (z1 - z0) * (x2 - x0) - (x1 - x0) * (z2 - z0)
        nz = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
        det = nx * x0 + ny * y0 + nz * z0
        if det == 0.0 or (front_only and det > 0.0):
            continue
        sign, by_det = 1.0 if det > 0.0 else -1.0, 1.0 / det
        e0a, e0b, e0c = _edge(x1, y1, z1, x2, y2, z2, sign, fx, fy, cx, cy)
        e1a, e1b, e1c = _edge(x2, y2, z2, x0, y0, z0, sign, fx, fy, cx, cy)
        e2a, e2b, e2c = _edge(x0, y0, z0, x1, y1, z1, sign, fx, fy, cx, cy)
        wa, wb = nx * by_det / fx, ny * by_det / fy
        wc = nz * by_det - wa * cx - wb * cy
        name = np.int32(base + f)
        for v in range(v0, v1 + 1):
            r0, r1, r2, rw = e0b * v + e0c, e1b * v + e1c, e2b * v + e2c, wb * v + wc
            first, last = u0, u1
            if u1 - u0 > 16:  # above all where a corner is behind the camera, and nothing is known of the columns
                first, last = _inside(e0a, r0, first, last)
                first, last = _inside(e1a, r1, first, last)
                first, last = _inside(e2a, r2, first, last)
            row, row_primitive = w[v], primitive[v]
            for u in range(first, last + 1):
                least = min(min(e0a * u + r0, e1a * u + r1), e2a * u + r2)
                near = min(max(wa * u + rw, w_low), w_high)
                seen = (least >= 0.0) & (near > row[u])
                row[u] = near if seen else row[u]
                row_primitive[u] = name if seen else row_primitive[u]


@njit(cache=True, nogil=True, inline="always")
def _inside(a: float, rest: float, first: int, last: int) -> tuple[int, int]:
    """The columns first to last without those, but for one, where a·u + rest < 0."""
    if a == 0.0:
        return (first, last) if rest >= 0.0 else (1, 0)
    at = min(max(-rest / a, -1.0), 1e6)
    return (max(first, int(at) - 1), last) if a > 0.0 else (first, min(last, int(at) + 1))


@njit(cache=True, nogil=True, inline="always")
def _edge(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, sign: float, fx: float, fy: float, cx: float, cy: float
) -> tuple[float, float, float]:
    """The plane through the camera and the edge from a to b, as a·u + b·v + c in pixels."""
    ea = sign * (ay * bz - az * by) / fx
    eb = sign * (az * bx - ax * bz) / fy
    return ea, eb, sign * (ax * by - ay * bx) - ea * cx - eb * cy


@njit(cache=True, nogil=True)
def _facing(p: Array, i0: int, i1: int, i2: int) -> float:
    """Negative when the camera at the origin is on the outer side of a triangle."""
    ax, ay, az = p[i1, 0] - p[i0, 0], p[i1, 1] - p[i0, 1], p[i1, 2] - p[i0, 2]
    bx, by, bz = p[i2, 0] - p[i0, 0], p[i2, 1] - p[i0, 1], p[i2, 2] - p[i0, 2]
    return float((ay * bz - az * by) * p[i0, 0] + (az * bx - ax * bz) * p[i0, 1] + (ax * by - ay * bx) * p[i0, 2])


@njit(cache=True, nogil=True)
def _owner(s: Surfaces, primitive: int) -> int:
    """The solid behind a primitive."""
    n = s.kind.shape[0]
    if primitive < n:
        return primitive
    low, high = 0, n
    while high - low > 1:
        middle = (low + high) // 2
        if s.first_face[middle] <= primitive - n:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def _finish(s: Surfaces, w: Array, primitive: Ids, depth: NDArray[np.float32], instance: Ids) -> None:
    """Inverse depth to depth, primitives to ids."""
    n = s.kind.shape[0]
    name = np.empty(1 + n + s.faces.shape[0], np.int32)
    name[0] = -1
    for k in range(n):
        name[1 + k] = s.id[k]
        for f in range(s.first_face[k], s.first_face[k + 1]):
            name[1 + n + f] = s.id[k]
    nothing, one = np.float32(0.0), np.float32(1.0)
    for v in range(w.shape[0]):
        row, row_depth, row_primitive, row_instance = w[v], depth[v], primitive[v], instance[v]
        for u in range(w.shape[1]):
            near = np.float32(row[u])
            row_depth[u] = one / near if near > nothing else nothing
            row_instance[u] = name[row_primitive[u] + 1]


@njit(cache=True, nogil=True)
def _normals(
    s: Surfaces,
    T_world_camera: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    w: Array,
    primitive: Ids,
    corner_normals: Array,
    normals: NDArray[np.float32],
) -> None:
    """Normals (H, W, 3) at what is seen. corner_normals (F, 3, 3), in the solids' frames, are blended over each face; none: flat faces."""
    n, last, k = s.kind.shape[0], np.int32(-1), 0
    for v in range(w.shape[0]):
        for u in range(w.shape[1]):
            i = primitive[v, u]
            if i < 0:
                continue
            if i != last:
                last, k = i, _owner(s, i)
            T, half = s.T[k], s.half[k]
            x, y, z = (u - cx) / fx, (v - cy) / fy, 1.0 / w[v, u]
            dx = T_world_camera[0, 0] * x + T_world_camera[0, 1] * y + T_world_camera[0, 2]
            dy = T_world_camera[1, 0] * x + T_world_camera[1, 1] * y + T_world_camera[1, 2]
            dz = T_world_camera[2, 0] * x + T_world_camera[2, 1] * y + T_world_camera[2, 2]
            px = T_world_camera[0, 3] + dx * z - T[0, 3]
            py = T_world_camera[1, 3] + dy * z - T[1, 3]
            pz = T_world_camera[2, 3] + dz * z - T[2, 3]
            qx = T[0, 0] * px + T[1, 0] * py + T[2, 0] * pz
            qy = T[0, 1] * px + T[1, 1] * py + T[2, 1] * pz
            qz = T[0, 2] * px + T[1, 2] * py + T[2, 2] * pz
            if s.kind[k] == BOX:
                nx, ny, nz = _box_normal(half, qx, qy, qz)
            elif s.kind[k] == CYLINDER:
                nx, ny, nz = _cylinder_normal(half, qx, qy, qz)
            else:
                nx, ny, nz = _face_normal(s, i - n, qx, qy, qz, corner_normals[:0])
            mx = T[0, 0] * nx + T[0, 1] * ny + T[0, 2] * nz
            my = T[1, 0] * nx + T[1, 1] * ny + T[1, 2] * nz
            mz = T[2, 0] * nx + T[2, 1] * ny + T[2, 2] * nz
            sign = -1.0 if mx * dx + my * dy + mz * dz > 0.0 else 1.0
            if i >= n and corner_normals.shape[0] > 0:  # which side is seen is for the face to say, not for its blended normal
                nx, ny, nz = _face_normal(s, i - n, qx, qy, qz, corner_normals)
                mx = T[0, 0] * nx + T[0, 1] * ny + T[0, 2] * nz
                my = T[1, 0] * nx + T[1, 1] * ny + T[1, 2] * nz
                mz = T[2, 0] * nx + T[2, 1] * ny + T[2, 2] * nz
            normals[v, u, 0], normals[v, u, 1], normals[v, u, 2] = sign * mx, sign * my, sign * mz


@njit(cache=True, nogil=True)
def _box_normal(half: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    gx, gy, gz = abs(abs(x) - half[0]), abs(abs(y) - half[1]), abs(abs(z) - half[2])
    if gx <= gy and gx <= gz:
        return np.copysign(1.0, x), 0.0, 0.0
    if gy <= gz:
        return 0.0, np.copysign(1.0, y), 0.0
    return 0.0, 0.0, np.copysign(1.0, z)


@njit(cache=True, nogil=True)
def _cylinder_normal(half: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    r = np.sqrt(x * x + y * y)
    if abs(abs(z) - half[2]) < abs(r - half[0]):
        return 0.0, 0.0, np.copysign(1.0, z)
    return x / r, y / r, 0.0


@njit(cache=True, nogil=True)
def _face_normal(s: Surfaces, f: int, x: float, y: float, z: float, corner_normals: Array) -> tuple[float, float, float]:
    a, b, c = s.vertices[s.faces[f, 0]], s.vertices[s.faces[f, 1]], s.vertices[s.faces[f, 2]]
    ax, ay, az, bx, by, bz = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    if corner_normals.shape[0] > 0:
        m = corner_normals[f]
        px, py, pz = x - a[0], y - a[1], z - a[2]
        area = max(nx * nx + ny * ny + nz * nz, 1e-300)
        l1 = ((py * bz - pz * by) * nx + (pz * bx - px * bz) * ny + (px * by - py * bx) * nz) / area
        l2 = ((ay * pz - az * py) * nx + (az * px - ax * pz) * ny + (ax * py - ay * px) * nz) / area
        l1, l2 = min(max(l1, 0.0), 1.0), min(max(l2, 0.0), 1.0)
        l0 = max(1.0 - l1 - l2, 0.0)
        nx = l0 * m[0, 0] + l1 * m[1, 0] + l2 * m[2, 0]
        ny = l0 * m[0, 1] + l1 * m[1, 1] + l2 * m[2, 1]
        nz = l0 * m[0, 2] + l1 * m[1, 2] + l2 * m[2, 2]
    length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
    return nx / length, ny / length, nz / length
