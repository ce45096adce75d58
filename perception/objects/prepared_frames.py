"""Frames made ready for looking at objects: the camera's noise is found and averaged away, walls and the robot are dropped.

Points live in the cabinet's frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Cabinet
from kinematics.transforms import Array, inverse
from perception.camera import Depth
from perception.frames import Frame
from perception.pixels import Bool, in_cabinet, smooth, wall_errors

WALL_MARGIN_M = 0.003
"""What is nearer to a wall than this, and than three standard deviations, is taken for the wall."""
FRONT_M = 0.12
"""How far before the open side what stands in the cabinet is looked at: large things protrude that far, and don't fall."""
SMOOTH_PX = 3
EVERY_PX = 3
"""Noise is measured at every so many columns and rows."""


@dataclass(frozen=True, eq=False)
class PreparedFrames:
    """Frames made ready: depths (H, W) whose noise is averaged away, which pixels show something in the cabinet, their points there.

    T_cabinet_camera: a pose a frame. axial: the standard deviation of the depth at 1 m, in metres, as found in the frames.
    counts: of how many pixels each depth (H, W) is the average.
    """

    frames: tuple[Frame, ...]
    depths: tuple[Depth, ...]
    inside: tuple[Bool, ...]
    points: tuple[NDArray[np.float32], ...]
    T_cabinet_camera: tuple[Array, ...]
    axial: float
    counts: tuple[NDArray[np.uint8], ...]


@dataclass(frozen=True, eq=False)
class ReadyFrame:
    """One frame made ready, see `PreparedFrames`, for noise of `axial` at 1 m."""

    axial: float
    depth: Depth
    inside: Bool
    points: NDArray[np.float32]
    count: NDArray[np.uint8]


def prepare(frames: Sequence[Frame], cabinet: Cabinet, kept: dict[Frame, ReadyFrame] | None = None) -> PreparedFrames:
    """Find the noise, average it away within each instance, and drop the walls and the robot.

    kept: frames that were made ready before, for the same cabinet, and need not be again; afterwards these frames and no others.
    """
    axial, before = axial_noise(frames, cabinet), kept or {}
    ready = [r if (r := before.get(f)) is not None and r.axial == axial else _ready(f, cabinet, axial) for f in frames]
    if kept is not None:
        kept.clear()
        kept.update(zip(frames, ready))
    poses = tuple(inverse(cabinet.T_world_cabinet) @ f.T_world_camera for f in frames)
    depths, inside, points = tuple(r.depth for r in ready), tuple(r.inside for r in ready), tuple(r.points for r in ready)
    return PreparedFrames(tuple(frames), depths, inside, points, poses, axial, tuple(r.count for r in ready))


def _ready(frame: Frame, cabinet: Cabinet, axial: float) -> ReadyFrame:
    size, T = np.asarray(cabinet.size_m, float), inverse(cabinet.T_world_cabinet) @ frame.T_world_camera
    depth, camera, arm = np.ascontiguousarray(frame.depth, np.float32), pinhole_of(frame), arm_of(frame)
    label = np.zeros(depth.shape, np.int32) if frame.instance is None else np.ascontiguousarray(frame.instance, np.int32)
    count = np.ones(depth.shape, np.uint8)
    if axial > 0:
        kept, _ = in_cabinet(depth, arm, *camera, T, size, FRONT_M, WALL_MARGIN_M, axial)
        depth, count = smooth(depth, np.where(kept, label, -1).astype(np.int32), axial, SMOOTH_PX)
    inside, points = in_cabinet(depth, arm, *camera, T, size, FRONT_M, WALL_MARGIN_M, axial)
    return ReadyFrame(axial, depth, inside, points, count)


def axial_noise(frames: Sequence[Frame], cabinet: Cabinet) -> float:
    """The standard deviation of the depth at 1 m, in metres, from how far pixels that show a wall are from it; 0 for clean images.

    It is robust: half of the pixels near a wall may show something else. Without a wall in sight it is the default camera's. Two digits are
    all that is meant, so that another frame rarely changes it.
    """
    size, T_cabinet_world = np.asarray(cabinet.size_m, float), inverse(cabinet.T_world_cabinet)
    errors = [
        wall_errors(
            np.ascontiguousarray(f.depth, np.float32), arm_of(f), *pinhole_of(f), T_cabinet_world @ f.T_world_camera, size, 0.02, EVERY_PX
        )
        for f in frames
    ]
    found = np.concatenate(errors) if errors else np.zeros(0)
    if len(found) < 500:
        return 0.004
    spread = 1.4826 * float(np.median(np.abs(found)))
    return float(f"{spread:.2g}") if spread > 1e-4 else 0.0  # below a tenth of a millimetre it is rounding


def pinhole_of(frame: Frame) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy in pixels."""
    camera = frame.intrinsics
    return camera.fx, camera.fy, camera.cx, camera.cy


def arm_of(frame: Frame) -> Bool:
    """The robot's own pixels (H, W), none where the frame knows of none."""
    return np.zeros(np.shape(frame.depth), bool) if frame.arm is None else np.ascontiguousarray(frame.arm, bool)
