"""Where a line enters and leaves a shape, or each stretch of it that lies inside: a hole parts a ring's two."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from kinematics.transforms import Array, inverse

PARALLEL = 1e-12
"""A direction with no more of a normal in it does not meet the plane."""
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
            return _through_parts(*_planes(shape), o, d)
    return [h for h in hits if h is not None]


@lru_cache(maxsize=64)
def _inverse(T: bytes) -> Array:
    """Of a pose, for the many lines that cross a shape there."""
    return inverse(np.frombuffer(T).reshape(4, 4))


@lru_cache(maxsize=64)
def _planes(shape: ConvexMesh) -> tuple[Array, NDArray[np.int64]]:
    """The planes (H, 4) of all parts, one part's after the other's, and where each part's begin (P,)."""
    from kinematics.meshes.cutting import planes_of  # brings scipy, which scenes without meshes do not need

    planes = [planes_of(part) for part in shape.parts]
    return np.concatenate(planes), np.cumsum([0, *(len(rows) for rows in planes[:-1])])


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


def _through_parts(planes: Array, starts: NDArray[np.int64], o: Array, d: Array) -> list[Contact]:
    """Where a line goes through convex parts, of which `_planes` tells."""
    normals = planes[:, :3]
    speed, gap = normals @ d, planes[:, 3] - normals @ o
    along = np.abs(speed) < PARALLEL
    with np.errstate(divide="ignore", invalid="ignore"):
        s = gap / speed
    entering, leaving = np.where(~along & (speed < 0), s, -np.inf), np.where(~along & (speed > 0), s, np.inf)
    met = np.maximum.reduceat(entering, starts) < np.minimum.reduceat(leaving, starts)
    met &= ~np.logical_or.reduceat(along & (gap < 0), starts)
    found = list[Contact]()
    for first, end in zip(starts[met], np.append(starts[1:], len(planes))[met]):
        i, j = first + int(np.argmax(entering[first:end])), first + int(np.argmin(leaving[first:end]))
        found.append(Contact(float(entering[i]), float(leaving[j]), normals[i], normals[j]))
    return found


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
