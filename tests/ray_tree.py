"""Single rays through a tree of boxes: another way to find what `perception.rendering.raycast` draws, to check it against.

The leaves of the tree are primitives: solids without faces, and faces.
"""

from __future__ import annotations

import numpy as np

from kinematics.collision.geometry import BOX, CYLINDER
from kinematics.jit.decorators import njit
from kinematics.transforms import Array
from perception.rendering.draw_solids import FAR, TINY
from perception.rendering.normals import owner
from perception.rendering.surfaces import Ids, Int, Surfaces


def cast_rays(s: Surfaces, origins: Array, directions: Array) -> tuple[Array, Ids]:
    """Where rays from origins (N, 3) along directions (N, 3), of any length, in the world, first meet a surface.

    Returns t (N,), in lengths of the direction, inf where a ray meets nothing, and the id (N,) of what it meets, -1 for nothing. The tree
    is built anew in each call: ask for many rays at once.
    """
    directions = np.ascontiguousarray(np.broadcast_to(directions, np.shape(origins)), float)
    t, primitive = np.full(len(origins), np.inf), np.full(len(origins), -1, np.int32)
    corners = _corners_in_world(s)
    low, high, leaf = _boxes(s, corners)
    if len(leaf):
        tree = _build_tree(low, high)
        _cast(s, corners, leaf, *tree, np.ascontiguousarray(origins, float), directions, t, primitive)
    return t, _ids_of(s, primitive)


def inside(s: Surfaces, point: Array) -> list[int]:
    """The ids of the solids that hold a point (3,) of the world; of a mesh by its winding number, so it should be closed."""
    found = []
    for k in range(len(s.kind)):
        p = (np.asarray(point, float) - s.T[k, :3, 3]) @ s.T[k, :3, :3]
        if s.kind[k] == BOX:
            held = bool((np.abs(p) < s.half[k]).all())
        elif s.kind[k] == CYLINDER:
            held = bool(np.hypot(p[0], p[1]) < s.half[k, 0] and abs(p[2]) < s.half[k, 2])
        else:
            held = abs(_winding(s.vertices[s.faces[s.first_face[k] : s.first_face[k + 1]]] - p)) > 0.5
        if held and int(s.id[k]) not in found:
            found.append(int(s.id[k]))
    return found


def _winding(corners: Array) -> float:
    """How often triangles (F, 3, 3) wind around the origin (van Oosterom and Strackee's solid angle over 4π)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.einsum("fi,fi->f", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("fi,fi->f", x, y) for x, y in ((a, b), (b, c), (c, a)))
    return float(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2 * np.pi))


@njit(cache=True, nogil=True)
def _corners_in_world(s: Surfaces) -> Array:
    """The faces' corners (F, 3, 3) in the world."""
    corners = np.empty((s.faces.shape[0], 3, 3))
    for k in range(s.kind.shape[0]):
        for f in range(s.first_face[k], s.first_face[k + 1]):
            for c in range(3):
                p = s.vertices[s.faces[f, c]]
                for r in range(3):
                    corners[f, c, r] = s.T[k, r, 0] * p[0] + s.T[k, r, 1] * p[1] + s.T[k, r, 2] * p[2] + s.T[k, r, 3]
    return corners


@njit(cache=True, nogil=True)
def _boxes(s: Surfaces, corners: Array) -> tuple[Array, Array, Int]:
    """Lower and upper corners (L, 3) of every primitive, and which primitive (L,) it is."""
    solids = 0
    for k in range(s.kind.shape[0]):
        solids += 1 if s.kind[k] == BOX or s.kind[k] == CYLINDER else 0
    n = solids + corners.shape[0]
    low, high, leaf = np.empty((n, 3)), np.empty((n, 3)), np.empty(n, np.int64)
    i = 0
    for k in range(s.kind.shape[0]):
        if s.kind[k] == BOX or s.kind[k] == CYLINDER:
            for r in range(3):
                reach = abs(s.T[k, r, 0]) * s.half[k, 0] + abs(s.T[k, r, 1]) * s.half[k, 1] + abs(s.T[k, r, 2]) * s.half[k, 2]
                low[i, r], high[i, r] = s.T[k, r, 3] - reach, s.T[k, r, 3] + reach
            leaf[i] = k
            i += 1
    for f in range(corners.shape[0]):
        for r in range(3):
            low[i, r] = min(min(corners[f, 0, r], corners[f, 1, r]), corners[f, 2, r])
            high[i, r] = max(max(corners[f, 0, r], corners[f, 1, r]), corners[f, 2, r])
        leaf[i] = s.kind.shape[0] + f
        i += 1
    return low, high, leaf


@njit(cache=True, nogil=True)
def _build_tree(low: Array, high: Array) -> tuple[Int, Array, Int]:
    """A binary tree of boxes, split in the middle of the longest side of the centres' box.

    Returns the order (L,) of the leaves; per node its lower and upper corner (M, 6); and (M, 2): the first leaf and how many, or, with
    the count negated, minus the place of the second child; the first child is the next node.
    """
    n = low.shape[0]
    order = np.arange(n)
    box, link = np.empty((2 * n, 6)), np.zeros((2 * n, 2), np.int64)
    stack = np.empty((64, 3), np.int64)
    stack[0] = np.array([0, n, -1])
    depth, nodes = 1, 0
    while depth > 0:
        depth -= 1
        first, last, parent = stack[depth, 0], stack[depth, 1], stack[depth, 2]
        node = nodes
        nodes += 1
        if parent >= 0:
            link[parent, 1] = -node
        axis, middle = _measure(low, high, order, first, last, box[node])
        link[node, 0], link[node, 1] = first, last - first
        if last - first <= 4 or depth > 60:
            continue
        split = first
        for i in range(first, last):
            if low[order[i], axis] + high[order[i], axis] < middle:
                order[i], order[split] = order[split], order[i]
                split += 1
        if split in (first, last):
            split = (first + last) // 2
        stack[depth, 0], stack[depth, 1], stack[depth, 2] = split, last, node
        stack[depth + 1, 0], stack[depth + 1, 1], stack[depth + 1, 2] = first, split, -1
        depth += 2
    return order, box[:nodes], link[:nodes]


@njit(cache=True, nogil=True)
def _measure(low: Array, high: Array, order: Int, first: int, last: int, box: Array) -> tuple[int, float]:
    """The box around some leaves, written into (6,); the longest axis of their centres, and twice the middle of it."""
    box[:3], box[3:] = FAR, -FAR
    centre_low, centre_high = np.full(3, FAR), np.full(3, -FAR)
    for i in range(first, last):
        for r in range(3):
            a, b = low[order[i], r], high[order[i], r]
            box[r], box[3 + r] = min(box[r], a), max(box[3 + r], b)
            centre_low[r], centre_high[r] = min(centre_low[r], a + b), max(centre_high[r], a + b)
    axis = int(np.argmax(centre_high - centre_low))
    return axis, (centre_low[axis] + centre_high[axis]) / 2


@njit(cache=True, nogil=True)
def _cast(
    s: Surfaces, corners: Array, leaf: Int, order: Int, box: Array, link: Int, origins: Array, directions: Array, t: Array, primitive: Ids
) -> None:
    stack = np.empty(128, np.int64)
    slow = np.empty(3)
    for i in range(origins.shape[0]):
        o, d = origins[i], directions[i]
        for r in range(3):
            slow[r] = 1.0 / d[r] if abs(d[r]) > 1e-300 else FAR
        best, found = np.inf, -1
        stack[0] = 0
        depth = 1
        while depth > 0:
            depth -= 1
            node = stack[depth]
            if not _meets(box[node], o, slow, best):
                continue
            if link[node, 1] < 0:
                stack[depth], stack[depth + 1] = -link[node, 1], node + 1
                depth += 2
                continue
            for j in range(link[node, 0], link[node, 0] + link[node, 1]):
                k = leaf[order[j]]
                if k >= s.kind.shape[0]:
                    hit = _ray_triangle(corners[k - s.kind.shape[0]], o, d)
                elif s.kind[k] == BOX:
                    hit = _ray_box(s.T[k], s.half[k], o, d)
                else:
                    hit = _ray_cylinder(s.T[k], s.half[k], o, d)
                if hit < best:
                    best, found = hit, k
        t[i], primitive[i] = best, found


@njit(cache=True, nogil=True)
def _meets(box: Array, o: Array, slow: Array, best: float) -> bool:
    enter, leave = 0.0, best
    for r in range(3):
        a, b = (box[r] - o[r]) * slow[r], (box[3 + r] - o[r]) * slow[r]
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return enter <= leave * (1.0 + 1e-12) + 1e-12


@njit(cache=True, nogil=True)
def _ray_triangle(corner: Array, o: Array, d: Array) -> float:
    """t > 0, or inf (Möller and Trumbore)."""
    ax, ay, az = corner[1, 0] - corner[0, 0], corner[1, 1] - corner[0, 1], corner[1, 2] - corner[0, 2]
    bx, by, bz = corner[2, 0] - corner[0, 0], corner[2, 1] - corner[0, 1], corner[2, 2] - corner[0, 2]
    px, py, pz = d[1] * bz - d[2] * by, d[2] * bx - d[0] * bz, d[0] * by - d[1] * bx
    det = ax * px + ay * py + az * pz
    if det == 0.0:
        return np.inf
    sx, sy, sz = o[0] - corner[0, 0], o[1] - corner[0, 1], o[2] - corner[0, 2]
    u = (sx * px + sy * py + sz * pz) / det
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (d[0] * qx + d[1] * qy + d[2] * qz) / det
    t = (bx * qx + by * qy + bz * qz) / det
    return t if u >= -TINY and v >= -TINY and u + v <= 1.0 + TINY and t > 0.0 else np.inf


@njit(cache=True, nogil=True, inline="always")
def _in_frame(T: Array, o: Array, d: Array, axis: int) -> tuple[float, float]:
    """One coordinate of a ray's origin and direction in the frame T."""
    along = T[0, axis] * (o[0] - T[0, 3]) + T[1, axis] * (o[1] - T[1, 3]) + T[2, axis] * (o[2] - T[2, 3])
    return along, T[0, axis] * d[0] + T[1, axis] * d[1] + T[2, axis] * d[2]


@njit(cache=True, nogil=True)
def _ray_slab(o: float, d: float, half: float) -> tuple[float, float]:
    if d == 0.0:
        return (-np.inf, np.inf) if abs(o) <= half else (np.inf, -np.inf)
    a, b = (-half - o) / d, (half - o) / d
    return min(a, b), max(a, b)


@njit(cache=True, nogil=True)
def _first(enter: float, leave: float) -> float:
    """Where a ray first meets the surface of what it is in from `enter` to `leave`."""
    if enter > leave or leave <= 0.0:
        return np.inf
    return enter if enter > 0.0 else leave


@njit(cache=True, nogil=True)
def _ray_box(T: Array, half: Array, o: Array, d: Array) -> float:
    enter, leave = -np.inf, np.inf
    for axis in range(3):
        along, rate = _in_frame(T, o, d, axis)
        a, b = _ray_slab(along, rate, half[axis])
        enter, leave = max(enter, a), min(leave, b)
    return _first(enter, leave)


@njit(cache=True, nogil=True)
def _ray_cylinder(T: Array, half: Array, o: Array, d: Array) -> float:
    ox, dx = _in_frame(T, o, d, 0)
    oy, dy = _in_frame(T, o, d, 1)
    oz, dz = _in_frame(T, o, d, 2)
    enter, leave = _ray_slab(oz, dz, half[2])
    a, b = dx * dx + dy * dy, ox * dx + oy * dy
    across = ox * dy - oy * dx
    root2 = half[0] * half[0] * a - across * across
    if a == 0.0:
        return _first(enter, leave) if ox * ox + oy * oy <= half[0] * half[0] else np.inf
    if root2 < 0.0:
        return np.inf
    root = np.sqrt(root2)
    return _first(max(enter, (-b - root) / a), min(leave, (root - b) / a))


@njit(cache=True, nogil=True)
def _ids_of(s: Surfaces, primitive: Ids) -> Ids:
    ids = np.full(primitive.shape[0], -1, np.int32)
    for i in range(primitive.shape[0]):
        if primitive[i] >= 0:
            ids[i] = s.id[owner(s, primitive[i])]
    return ids
