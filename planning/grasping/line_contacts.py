"""Where a line enters and leaves a shape, or each stretch of it that lies inside: a hole parts a ring's two."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from kinematics.transforms import Array, inverse
from planning.grasping.through_parts import PARALLEL, Int, through_parts

AXES = np.eye(3)
GAP_M = 0.005
"""Into a narrower gap no finger fits: what is on both sides of it is one stretch."""


@dataclass(frozen=True, eq=False)
class Contact:
    """Where a line enters and leaves a shape: distances (m) along it from its origin, and the outward normals (3,)."""

    enter: float
    leave: float
    enter_normal: Array
    leave_normal: Array


def line_contacts(shape: Shape, T: Array, origin: Array, direction: Array) -> Contact | None:
    """Cross a shape at pose T (4, 4) with the line origin + s · direction (world, unit direction); None when it misses."""
    through = _crossings(shape, T, origin, direction)
    if not through:
        return None
    first = last = through[0]
    if len(through) > 1:
        first, last = min(through, key=lambda h: h.enter), max(through, key=lambda h: h.leave)
    return Contact(first.enter, last.leave, T[:3, :3] @ first.enter_normal, T[:3, :3] @ last.leave_normal)


def line_stretches(shape: Shape, T: Array, origin: Array, direction: Array) -> list[Contact]:
    """The same for each stretch of the line inside the shape, in the line's order; parts less than GAP_M apart along it are one."""
    found = list[Contact]()
    for hit in sorted(_crossings(shape, T, origin, direction), key=lambda h: h.enter):
        hit = replace(hit, enter_normal=T[:3, :3] @ hit.enter_normal, leave_normal=T[:3, :3] @ hit.leave_normal)
        if not found or hit.enter > found[-1].leave + GAP_M:
            found.append(hit)
        elif hit.leave > found[-1].leave:
            found[-1] = replace(found[-1], leave=hit.leave, leave_normal=hit.leave_normal)
    return found


def stretch_at(shape: Shape, T: Array, origin: Array, direction: Array, s: float = 0.0) -> Contact | None:
    """The stretch that `s` lies in, or no further than GAP_M beside; all as one where it lies in a hole; None when the line misses."""
    for hit in line_stretches(shape, T, origin, direction):
        if hit.enter - GAP_M <= s <= hit.leave + GAP_M:
            return hit
    return line_contacts(shape, T, origin, direction)


def _crossings(shape: Shape, T: Array, origin: Array, direction: Array) -> list[Contact]:
    """Where the line enters and leaves each part that it meets; the normals in the shape's frame."""
    T_object = _inverse(T.tobytes())
    o, d = T_object[:3, :3] @ origin + T_object[:3, 3], T_object[:3, :3] @ direction
    match shape:
        case Box():
            hits = [_through_box(shape.half, o, d)]
        case Cylinder():
            hits = [_through_cylinder(shape, o, d)]
        case ConvexMesh():
            return _through_parts(*planes_of_parts(shape), o, d)
    return [h for h in hits if h is not None]


@lru_cache(maxsize=64)
def _inverse(T: bytes) -> Array:
    """Of a pose, for the many lines that cross a shape there."""
    return inverse(np.frombuffer(T).reshape(4, 4))


@lru_cache(maxsize=64)
def planes_of_parts(shape: ConvexMesh) -> tuple[Array, Int]:
    """The planes (H, 4) of all parts, one part's after the other's, where each part's begin, and how many there are (P + 1,)."""
    from kinematics.meshes.cutting import planes_of  # brings scipy, which scenes without meshes do not need

    planes = [planes_of(part) for part in shape.parts]
    return np.ascontiguousarray(np.concatenate(planes)), np.cumsum([0, *(len(rows) for rows in planes)])


def _through_box(half: Array, o: Array, d: Array) -> Contact | None:
    """As `_through_parts`, for a cuboid about the origin: one axis after the other."""
    enter, leave, first, last = -np.inf, np.inf, (0, 0.0), (0, 0.0)
    for axis, (h, at, speed) in enumerate(zip(half.tolist(), o.tolist(), d.tolist())):
        if abs(speed) < PARALLEL:
            if abs(at) > h:
                return None
            continue
        sign = 1.0 if speed > 0 else -1.0
        s_in, s_out = (-sign * h - at) / speed, (sign * h - at) / speed
        if s_in > enter:
            enter, first = s_in, (axis, -sign)
        if s_out < leave:
            leave, last = s_out, (axis, sign)
    return Contact(enter, leave, first[1] * AXES[first[0]], last[1] * AXES[last[0]]) if enter < leave else None


def _through_parts(planes: Array, starts: Int, o: Array, d: Array) -> list[Contact]:
    """Where a line goes through convex parts, of which `planes_of_parts` tells."""
    stretches, by = np.empty((len(starts) - 1, 2)), np.empty((len(starts) - 1, 2), np.int64)
    through_parts(planes, starts, o, d, stretches, by)
    met = np.flatnonzero(stretches[:, 0] < stretches[:, 1])
    found = zip(stretches[met].tolist(), by[met].tolist())
    return [Contact(enter, leave, planes[i, :3], planes[j, :3]) for (enter, leave), (i, j) in found]


def _through_cylinder(shape: Cylinder, o: Array, d: Array) -> Contact | None:
    caps = _through_box(np.array([np.inf, np.inf, shape.height_m / 2]), o, d)
    if caps is None:
        return None
    a, b, c = d[0] ** 2 + d[1] ** 2, o[0] * d[0] + o[1] * d[1], o[0] ** 2 + o[1] ** 2 - shape.radius_m**2
    if a < 1e-12:
        return caps if c < 0 else None
    root = b * b - a * c
    if root <= 0:
        return None
    enter, leave = (-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a

    def side(s: float) -> Array:
        p = (o + s * d) * [1.0, 1.0, 0.0]
        return np.asarray(p / np.linalg.norm(p))

    first = (caps.enter, caps.enter_normal) if caps.enter > enter else (enter, side(enter))
    last = (caps.leave, caps.leave_normal) if caps.leave < leave else (leave, side(leave))
    return Contact(first[0], last[0], first[1], last[1]) if first[0] < last[0] else None
