"""What nobody has seen of a cabinet, as obstacles: by a map and the bodies that were seen, or as a scene's observation says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Body, Scene
from kinematics.shapes import Box
from kinematics.transforms import transform
from perception.mapping.voxels import FREE, UNKNOWN, Voxels

BODY_MARGIN_M = 0.003  # a voxel this near to an object is the object's
SKIN_M = 0.012  # and one this near to it is its skin, if it borders on free space: see `unknown_space`
NEAR_M = 0.04  # around objects the map counts voxel by voxel, further off in blocks of two


def unknown_space(voxels: Voxels, bodies: Sequence[Body], blocks: int = 2) -> tuple[Body, ...]:
    """What no motion may enter besides `bodies`: boxes around all space that is not known to be free and that no body explains.

    The one voxel between free space and a body that was seen is the body's skin, not unknown space: a voxel that the body's edge passes
    close by can't be seen whole from anywhere, for on one side there is the body itself.
    blocks: away from the bodies voxels are counted in cubes of so many, which makes fewer boxes, never smaller ones.
    """
    return voxels.boxes(grown_to_blocks(voxels, unknown_mask(voxels, bodies), bodies, blocks))


def grown_to_blocks(voxels: Voxels, which: NDArray[np.bool_], bodies: Sequence[Body], blocks: int) -> NDArray[np.bool_]:
    """The marked voxels (X, Y, Z), and away from the bodies all of every cube of so many voxels of which some are: fewer boxes fill it."""
    if blocks < 2:
        return which
    near = np.zeros(which.shape, bool)
    for body in bodies:
        near |= voxels.touched(body, NEAR_M)
    return np.asarray(which | (_in_blocks(which & ~near, blocks) & ~near))


def unknown_mask(voxels: Voxels, bodies: Sequence[Body]) -> NDArray[np.bool_]:
    """The voxels (X, Y, Z) that may hold what nobody has seen: not free, no body's own and not its skin."""
    return np.asarray(voxels.blocked(bodies, BODY_MARGIN_M) & ~skin(voxels, bodies))


def skin(voxels: Voxels, bodies: Sequence[Body]) -> NDArray[np.bool_]:
    """The unknown voxels within SKIN_M of a body that have a free neighbour."""
    near = np.zeros(voxels.state.shape, bool)
    for body in bodies:
        near |= voxels.touched(body, SKIN_M)
    free = np.pad(voxels.state == FREE, 1)
    beside = np.zeros(voxels.state.shape, bool)
    for axis in range(3):
        for shift in (-1, 1):
            beside |= np.roll(free, shift, axis)[1:-1, 1:-1, 1:-1]
    return np.asarray(near & beside & (voxels.state == UNKNOWN))


def _in_blocks(which: NDArray[np.bool_], k: int) -> NDArray[np.bool_]:
    """All of every k × k × k block of which some voxel is marked."""
    blocks = [-(-n // k) for n in which.shape]
    padded = np.zeros([n * k for n in blocks], bool)
    padded[tuple(slice(n) for n in which.shape)] = which
    some = padded.reshape(blocks[0], k, blocks[1], k, blocks[2], k).any((1, 3, 5))
    grown = some.repeat(k, 0).repeat(k, 1).repeat(k, 2)
    return np.asarray(grown[tuple(slice(n) for n in which.shape)])


def unknown_cells(scene: Scene) -> tuple[tuple[int, int, int], NDArray[np.int64]] | None:
    """What a scene's observation says that nobody has seen: how many cells the cabinet has along x, y and z, and boxes (N, 6) of them, the
    first cell and the one after the last along each; None when it says nothing of it.
    """
    views: Any = scene.observation["views"] if scene.observation else []
    unknown = views[-1].get("unknown") if views else None
    if unknown is None:
        return None
    x, y, z = (int(n) for n in unknown["cells"])
    return (x, y, z), np.array(unknown["boxes"], np.int64).reshape(-1, 6)


def unknown_boxes(scene: Scene) -> tuple[Body, ...]:
    """The boxes that fill what nobody has seen of a scene's cabinet, as its observation says: obstacles called unknown_0, unknown_1, …"""
    unknown = unknown_cells(scene)
    if unknown is None:
        return ()
    cells, boxes = unknown
    size = np.asarray(scene.cabinet.size_m, float)
    step = size / np.array(cells, float)
    origin = np.array([0.0, -size[1] / 2, 0.0])
    out = []
    for i, row in enumerate(boxes):
        low, high = origin + step * row[:3], origin + step * row[3:]
        out.append(Body(f"unknown_{i}", Box(high - low), scene.cabinet.T_world_cabinet @ transform(p=(low + high) / 2)))
    return tuple(out)
