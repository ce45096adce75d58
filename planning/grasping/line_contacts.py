"""Where a line enters and leaves a shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from kinematics.transforms import Array, inverse

PARALLEL = 1e-12
"""A direction with no more of a normal in it does not meet the plane."""
AXES = np.eye(3)


@dataclass(frozen=True, eq=False)
class Contact:
    """Where a line enters and leaves a shape: distances (m) along it from its origin, and the outward normals (3,)."""

    enter: float
    leave: float
    enter_normal: Array
    leave_normal: Array


def line_contacts(shape: Shape, T: Array, origin: Array, direction: Array) -> Contact | None:
    """Cross a shape at pose T (4, 4) with the line origin + s · direction (world, unit direction); None when it misses."""
    T_object = _inverse(T.tobytes())
    o, d = T_object[:3, :3] @ origin + T_object[:3, 3], T_object[:3, :3] @ direction
    match shape:
        case Box():
            hits = [_through_box(shape.half, o, d)]
        case Cylinder():
            hits = [_through_cylinder(shape, o, d)]
        case ConvexMesh():
            hits = [_through_planes(rows[:, :3], rows[:, 3], o, d) for rows in _planes(shape)]
    through = [h for h in hits if h is not None]
    if not through:
        return None
    first = last = through[0]
    if len(through) > 1:
        first, last = min(through, key=lambda h: h.enter), max(through, key=lambda h: h.leave)
    return Contact(first.enter, last.leave, T[:3, :3] @ first.enter_normal, T[:3, :3] @ last.leave_normal)


@lru_cache(maxsize=64)
def _inverse(T: bytes) -> Array:
    """Of a pose, for the many lines that cross a shape there."""
    return inverse(np.frombuffer(T).reshape(4, 4))


@lru_cache(maxsize=64)
def _planes(shape: ConvexMesh) -> tuple[Array, ...]:
    """The planes (H, 4) of each part."""
    from kinematics.meshes.cutting import planes_of  # brings scipy, which scenes without meshes do not need

    return tuple(planes_of(part) for part in shape.parts)


def _through_box(half: Array, o: Array, d: Array) -> Contact | None:
    """As `_through_planes`, for a cuboid about the origin: one axis after the other."""
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


def _through_planes(normals: Array, offsets: Array, o: Array, d: Array) -> Contact | None:
    speed, gap = normals @ d, offsets - normals @ o
    along = np.abs(speed) < PARALLEL
    if np.any(along & (gap < 0)):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        s = gap / speed
    entering, leaving = np.where(~along & (speed < 0), s, -np.inf), np.where(~along & (speed > 0), s, np.inf)
    i, j = int(np.argmax(entering)), int(np.argmin(leaving))
    return Contact(float(entering[i]), float(leaving[j]), normals[i], normals[j]) if entering[i] < leaving[j] else None


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
