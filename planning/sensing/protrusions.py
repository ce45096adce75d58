"""What protrudes from the cabinet's open front: the map ends there, and the arm passes by before anything is known of objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.scene import Body, Cabinet
from kinematics.transforms import apply, inverse, transform
from perception.frames import Frame
from perception.mapping.voxels import unknown_voxels
from perception.objects.prepared_frames import FRONT_M, WALL_MARGIN_M, arm_of, pinhole_of
from perception.pixels import in_cabinet

FEWEST = 3
"""What fewer pixels show in a voxel may be noise."""


class Protrusions:
    """The space up to FRONT_M before the front, in voxels, and where the pictures of one look show something there."""

    def __init__(self, cabinet: Cabinet, noise_1m_m: float) -> None:
        T = cabinet.T_world_cabinet @ transform(p=[-FRONT_M, 0.0, 0.0])
        self._voxels = unknown_voxels(Cabinet(np.array([FRONT_M, *cabinet.size_m[1:]]), T, cabinet.wall_m))
        self._pixels = np.zeros(self._voxels.state.shape, np.int64)
        self._noise_1m_m = noise_1m_m

    def add(self, frame: Frame) -> None:
        """Note what a picture shows there, the robot apart."""
        before = self._voxels.cabinet
        T_before_camera = inverse(before.T_world_cabinet) @ frame.T_world_camera
        depth = np.ascontiguousarray(frame.depth, np.float32)
        there, points = in_cabinet(
            depth, arm_of(frame), *pinhole_of(frame), T_before_camera, before.size_m, 0.0, WALL_MARGIN_M, self._noise_1m_m
        )  # fmt: skip
        np.add.at(self._pixels, tuple(self._voxels.index(apply(before.T_world_cabinet, points[there].astype(float))).T), 1)

    def boxes(self, bodies: Sequence[Body], margin_m: float) -> tuple[Body, ...]:
        """Obstacles around it, called front_0, front_1, …; what lies within margin_m of known bodies is theirs."""
        shown = self._pixels >= FEWEST
        for body in bodies:
            shown &= ~self._voxels.touched(body, margin_m)
        return self._voxels.boxes(shown, "front")
