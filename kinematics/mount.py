"""What a robot stands on: a plane through its base's origin, that only the links fixed to the world may touch."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from kinematics.scene import Body, Scene
from kinematics.shapes import Box
from kinematics.transforms import cross, transform

MOUNT = "mount"
REACH_M, THICK_M = 3.0, 0.5
"""How far the mount extends to each side, and how thick it is: no arm gets around it."""


@lru_cache(maxsize=8)
def standing_still(scene: Scene) -> tuple[Body, ...]:
    """All that the arm has to keep away from and that never moves: the cabinet's walls, the obstacles, and the mount."""
    under = mount(scene)
    return scene.fixtures() if under is None else (*scene.fixtures(), under)


@lru_cache(maxsize=8)
def mount(scene: Scene) -> Body | None:
    """The mount as a box under the base's plane; None where there is none: for a robot of one's own, unless the scene's robot says so, and
    for a named one whose scene says that it has none (`mount`).

    Where the cabinet's inner space lies lower than the plane, the box ends at the cabinet's front, so as not to cut it.
    """
    ref = scene.robot
    if not (ref.name is not None if ref.mount is None else ref.mount):
        return None
    T_base, T_cabinet = ref.T_world_base, scene.cabinet.T_world_cabinet
    up, ahead = T_base[:3, 2], T_cabinet[:3, 0]
    ahead = ahead - (ahead @ up) * up
    x = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-6 else T_base[:3, 0]
    (dx, dy, dz), least, most = scene.cabinet.size_m, -REACH_M, REACH_M
    corners = np.array([[a, b, c] for a in (0.0, dx) for b in (-dy / 2, dy / 2) for c in (0.0, dz)])
    seen = corners @ T_cabinet[:3, :3].T + T_cabinet[:3, 3] - T_base[:3, 3]
    if (seen @ up).min() < 0:
        most = float(min(most, (seen @ x).min()))
    if most - least < 1e-3:
        return None
    R = np.stack([x, cross(up, x), up], -1)
    centre = T_base[:3, 3] + (least + most) / 2 * x - THICK_M / 2 * up
    return Body(MOUNT, Box(np.array([most - least, 2 * REACH_M, THICK_M])), transform(R, centre))
