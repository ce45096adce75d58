"""Seen solids settled for planning: bodies that only noise makes overlap are parted by millimetres, and what is stacked stands exactly.

Two boxes that touch come out of noisy pixels a little into one another, and no motion planner can lift what is in something else. So each
gives way by half of the overlap, on the side where they meet, and what carries something by all of it; deeper overlaps, of solids that are
rough hulls, stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.scene import Body, object_box
from kinematics.shapes import Box, Cylinder, is_level
from kinematics.transforms import Array, transform

MOST_M = 0.012
"""Overlaps up to this are noise: side by side each body gives way by half."""
STACK_M = 0.02
"""What stands on something begins at most this far above or below its top."""
LOWEST_M = 0.015
"""Nothing that begins lower above the floor is stacked."""
GAP_M = 0.0007
"""Bodies that were parted are so far from one another, less than any voxel."""
CORNERS, SQUARE = 32, np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]])
LEAST_M = 0.004


def settled(bodies: Sequence[Body], floor_z: float) -> tuple[Body, ...]:
    """The same upright bodies, in the world, with overlaps of noise taken away. floor_z: the height of the cabinet's floor."""
    out = list(bodies)
    for i in range(len(out)):
        for j in range(len(out)):
            if i != j and stands_on(out[i], out[j], floor_z):
                out[i], out[j] = _stacked(out[i], out[j])
    for i in range(len(out)):
        for j in range(i):
            out[i], out[j] = _parted(out[i], out[j])
    return tuple(out)


def stands_on(upper: Body, lower: Body, floor_z: float) -> bool:
    """Whether one upright body stands on another: it begins off the floor, at the other's top, and lies over it."""
    (bottom, top), (base, level) = _heights(upper), _heights(lower)
    if bottom < floor_z + LOWEST_M or not base + LEAST_M < bottom < top or abs(bottom - level) > STACK_M:
        return False
    return _overlap(upper, lower)[0] > LEAST_M


def _heights(body: Body) -> tuple[float, float]:
    box = object_box(body)
    return float(box[2] - box[5] / 2), float(box[2] + box[5] / 2)


def _stacked(upper: Body, lower: Body) -> tuple[Body, Body]:
    """The two with the lower one's top GAP_M below the upper one's bottom, or the upper one reaching down to it: pixels where they meet are
    the lower one's sooner than the upper one's, and what is carried must not be thought shorter than it is."""
    bottom, level = _heights(upper)[0], _heights(lower)[1]
    if bottom > level + GAP_M:
        return _with_ends(upper, level + GAP_M, None), lower
    return upper, _with_ends(lower, None, bottom - GAP_M)


def _with_ends(body: Body, bottom: float | None, top: float | None) -> Body:
    """An upright body with another bottom or top; at least LEAST_M high. A cylinder that lies is moved to its bottom, and keeps its top."""
    low, high = _heights(body)
    if isinstance(body.shape, Cylinder) and is_level(body.T_world_body):
        return body if bottom is None else replace(body, T_world_body=transform(p=[0.0, 0.0, bottom - low]) @ body.T_world_body)
    low, high = low if bottom is None else bottom, high if top is None else top
    height = max(high - low, LEAST_M)
    if isinstance(body.shape, Box):
        shape: Box | Cylinder = Box(np.array([*body.shape.size_m[:2], height]))
    elif isinstance(body.shape, Cylinder):
        shape = Cylinder(body.shape.radius_m, height)
    else:
        return body
    T = body.T_world_body.copy()
    T[2, 3] = low + height / 2
    return replace(body, shape=shape, T_world_body=T)


def _outline(body: Body) -> Array:
    """The corners (K, 2) of an upright body seen from above, counter-clockwise; the box around others than boxes and cylinders."""
    R, p = body.T_world_body[:2, :2], body.T_world_body[:2, 3]
    if isinstance(body.shape, Cylinder) and is_level(body.T_world_body):
        axis = body.T_world_body[:2, 2] / np.linalg.norm(body.T_world_body[:2, 2])
        half_m = [body.shape.height_m / 2, body.shape.radius_m]
        return np.asarray(p + SQUARE * half_m @ np.array([axis, [-axis[1], axis[0]]]))
    if isinstance(body.shape, Cylinder):
        angle = (np.arange(CORNERS) + 0.5) * 2 * np.pi / CORNERS
        return np.asarray(p + body.shape.radius_m / np.cos(np.pi / CORNERS) * np.column_stack([np.cos(angle), np.sin(angle)]))
    if isinstance(body.shape, Box):
        return np.asarray(p + (SQUARE * body.shape.half[:2]) @ R.T)
    box = object_box(body)
    return np.asarray(box[:2] + SQUARE * box[3:5] / 2)


def _overlap(a: Body, b: Body) -> tuple[float, Array]:
    """How deep two upright bodies are in one another as seen from above, negative when apart, and the direction (2,) from b to a in which
    they part soonest (separating axes).
    """
    corners = _outline(a), _outline(b)
    least, direction = np.inf, np.zeros(2)
    for outline in corners:
        edges = np.roll(outline, -1, axis=0) - outline
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.maximum(np.linalg.norm(edges, axis=1, keepdims=True), 1e-12)
        for sign in (1.0, -1.0):
            n = sign * normals
            depth = (corners[1] @ n.T).max(0) - (corners[0] @ n.T).min(0)
            k = int(np.argmin(depth))
            if depth[k] < least:
                least, direction = float(depth[k]), n[k]
    return least, direction


def _parted(a: Body, b: Body) -> tuple[Body, Body]:
    """Two bodies side by side, each less wide by half of what they overlap; unchanged when they don't, or by more than MOST_M."""
    (bottom_a, top_a), (bottom_b, top_b) = _heights(a), _heights(b)
    if min(top_a, top_b) <= max(bottom_a, bottom_b):
        return a, b
    depth, direction = _overlap(a, b)
    if not -GAP_M < depth < MOST_M:
        return a, b
    by = (depth + GAP_M) / 2
    return _less(a, -direction, by), _less(b, direction, by)


def _less(body: Body, side: Array, by: float) -> Body:
    """An upright body that reaches less far, by so many metres, in the direction `side` (2,); the other side stays where it is. So does a
    cylinder that lies, by its end or by its side, which makes it lower as well."""
    T = body.T_world_body.copy()
    if isinstance(body.shape, Cylinder) and is_level(body.T_world_body):
        along = float(T[:2, 2] @ side)
        if abs(along) > 0.5**0.5:
            step = min(by / abs(along), body.shape.height_m - LEAST_M)
            T[:3, 3] -= np.sign(along) * step / 2 * T[:3, 2]
            return replace(body, shape=Cylinder(body.shape.radius_m, body.shape.height_m - step), T_world_body=T)
        narrower = min(by / (1 - along**2) ** 0.5 / 2, body.shape.radius_m - LEAST_M / 2)
        across = side - along * T[:2, 2]
        T[:3, 3] -= narrower * np.array([*across / np.linalg.norm(across), 1.0])
        return replace(body, shape=Cylinder(body.shape.radius_m - narrower, body.shape.height_m), T_world_body=T)
    if isinstance(body.shape, Cylinder):
        if body.shape.radius_m - by / 2 < LEAST_M / 2:
            return body
        T[:2, 3] -= side * by / 2
        return replace(body, shape=Cylinder(body.shape.radius_m - by / 2, body.shape.height_m), T_world_body=T)
    if not isinstance(body.shape, Box):
        return body
    local = T[:2, :2].T @ side
    axis = int(np.argmax(np.abs(local)))
    step = min(by / abs(local[axis]), float(body.shape.size_m[axis]) - LEAST_M)
    if step <= 0:
        return body
    size = np.array(body.shape.size_m, float)
    size[axis] -= step
    shift = np.zeros(3)
    shift[axis] = -np.sign(local[axis]) * step / 2
    return replace(body, shape=Box(size), T_world_body=T @ transform(p=shift))
