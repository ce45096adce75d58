"""What nobody has seen of a cabinet, as obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinematics.scene import Body, Scene
from kinematics.shapes import Box
from kinematics.transforms import transform


def unseen_space(scene: Scene) -> tuple[Body, ...]:
    """The boxes that fill what nobody has seen of a scene's cabinet, as its observation says: obstacles called unknown_0, unknown_1, …"""
    views: Any = scene.observation["views"] if scene.observation else []
    unknown = views[-1].get("unknown") if views else None
    if unknown is None:
        return ()
    size = np.asarray(scene.cabinet.size_m, float)
    step = size / np.array(unknown["cells"], float)
    origin = np.array([0.0, -size[1] / 2, 0.0])
    out = []
    for i, row in enumerate(unknown["boxes"]):
        low, high = origin + step * row[:3], origin + step * row[3:]
        out.append(Body(f"unknown_{i}", Box(high - low), scene.cabinet.T_world_cabinet @ transform(p=(low + high) / 2)))
    return tuple(out)
