"""What nobody has seen of a cabinet, as obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Body, Scene
from kinematics.shapes import Box
from kinematics.transforms import transform


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


def unseen_space(scene: Scene) -> tuple[Body, ...]:
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
