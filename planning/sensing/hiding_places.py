"""Where something that nobody has seen could be: the unseen space that is large enough, and that no body's own hidden side.

Behind every object there is a wedge that no view shows, and along every edge a voxel that no ray clears whole. Taken for solid, these keep
the hand from almost everything; but no object fits into most of them. An object is said to be no slimmer than `smallest_m`: it is the union
of balls' neighbourhoods, each ball of that diameter and wholly in space that nobody has seen, outside of all bodies and inside the cabinet.
What no such ball reaches holds no object. All rounding is towards more space for it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from kinematics.scene import Body, object_box
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, apply, inverse
from perception.mapping.voxels import FREE, Voxels
from planning.sensing.unknown_space import BODY_MARGIN_M, unknown_mask

SMALLEST_M = 0.04
"""Nothing in a cabinet is slimmer than this, if nobody says better, or something slimmer was seen."""
VOXEL_M = 0.005
"""Of the map in which hiding places are sought: the space that no ray clears whole is as wide as a voxel or two."""
CORNER = np.sqrt(3.0) / 2
"""From the middle of a cube to its corners, in edges: no point of a box is further from the middle of some cube in it."""
COMPLETE = 0.7
"""A body of whose top so much was seen is known whole: it is upright, and has no hidden side that reaches further."""


def hiding_places(voxels: Voxels, bodies: Sequence[Body], complete: Collection[str], smallest_m: float) -> NDArray[np.bool_]:
    """The unknown voxels (X, Y, Z) in which there may be something that nobody has seen.

    complete: the bodies that are known whole. Around the others all unknown space counts, as it may be theirs.
    smallest_m: every unseen object is at least as wide, as deep and as high; 0 leaves all unknown space.
    """
    unknown = unknown_mask(voxels, bodies)
    if smallest_m <= 0:
        return unknown
    closed = voxels.state != FREE
    grown = ndimage.binary_dilation(
        _middles(voxels, closed, bodies, smallest_m),
        np.ones((3, 3, 3)),
        iterations=int(np.ceil(CORNER * smallest_m / voxels.step.min())) + 1,
        mask=closed,
    )
    for body in bodies:
        if body.name not in complete:
            grown |= voxels.touched(body, smallest_m)
    return np.asarray(unknown & grown)


def smallest(bodies: Sequence[Body], given_m: float) -> float:
    """How slim an unseen object may be: as the slimmest that was seen, and no more than `given_m`."""
    return min([given_m, *(float(_extent(b).min()) for b in bodies)])


def _middles(voxels: Voxels, closed: NDArray[np.bool_], bodies: Sequence[Body], smallest_m: float) -> NDArray[np.bool_]:
    """The voxels (X, Y, Z) in which the middle of a ball of that diameter may lie, of which nothing is in free space, a body or a wall.

    closed (X, Y, Z): what is not known to be free.
    """
    step = voxels.step
    least = smallest_m / 2 - float(np.linalg.norm(step)) / 2  # the ball's middle may be at a voxel's corner
    rows = np.argwhere(closed)
    points = apply(voxels.T_world_grid, (rows + 0.5) * step)
    for body in bodies:
        clear = _distance(body, points) >= least - BODY_MARGIN_M
        rows, points = rows[clear], points[clear]
    pad, offsets = _ball(step, least + float(step.min()) / 2)
    room = np.pad(closed, pad)  # beyond the grid are the walls
    strides = np.array([room.shape[1] * room.shape[2], room.shape[2], 1])
    left, flat = (rows + pad) @ strides, room.ravel()
    for shift in offsets @ strides:
        left = left[flat[left + shift]]
    out = np.zeros(flat.shape, bool)
    out[left] = True
    return np.asarray(out.reshape(room.shape)[pad:-pad, pad:-pad, pad:-pad])


def _ball(step: Array, radius_m: float) -> tuple[int, NDArray[np.int64]]:
    """The neighbours (N, 3) of a voxel whose middles are nearer to its own than a radius, nearest first; and a bound on their indices."""
    bound = max(int(np.ceil(radius_m / float(step.min()))), 1)
    offsets = np.argwhere(np.ones([2 * bound + 1] * 3, bool)) - bound
    away = np.linalg.norm(offsets * step, axis=1)
    nearest = np.argsort(away, kind="stable")
    return bound, offsets[nearest[: np.count_nonzero(away < radius_m)]]


def _extent(body: Body) -> Array:
    """Width, depth and height (3,) of an upright body in its own frame; of the box around other shapes."""
    return 2 * body.shape.half if isinstance(body.shape, (Box, Cylinder)) else object_box(body)[3:]


def _distance(body: Body, points: Array) -> Array:
    """How far (N,) points (N, 3) in the world are from a body, at most 0 inside; from no more than its box, for other shapes."""
    if isinstance(body.shape, Cylinder):
        local = apply(inverse(body.T_world_body), points)
        off = np.stack([np.hypot(local[:, 0], local[:, 1]) - body.shape.radius_m, np.abs(local[:, 2]) - body.shape.height_m / 2], -1)
    elif isinstance(body.shape, Box):
        off = np.abs(apply(inverse(body.T_world_body), points)) - body.shape.half
    else:
        return np.full(len(points), np.inf)  # not known to fill anything: it keeps nothing out
    return np.asarray(np.linalg.norm(np.maximum(off, 0.0), axis=1) + np.minimum(off.max(1), 0.0))
