"""Frames: what a camera has recorded, one image at a time, wherever it came from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array
from perception.camera import Depth, Intrinsics


@dataclass(frozen=True, eq=False)
class Frame:
    """One view of a scene.

    depth (H, W): z in metres, 0 where nothing was measured. instance (H, W): which object a pixel shows, -1 for none; None when nobody has
    told objects apart. names: the object that an instance number means. T_world_camera (4, 4): see `perception.camera` for the axes.
    arm (H, W): pixels of the robot itself; None when there are none.
    """

    depth: Depth
    instance: NDArray[np.int32] | None
    names: tuple[str, ...]
    intrinsics: Intrinsics
    T_world_camera: Array
    arm: NDArray[np.bool_] | None = None
