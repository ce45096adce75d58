"""Recorded frames as they are: what a depth camera makes up is dropped, and what can't be of this cabinet is told.

Space is cleared along the rays of a depth image, so a depth that is too great is dangerous: a saturated value (all bits set, dropped by
`perception.frames.read_frames`), one beyond the range of any such camera, and a flying pixel at an edge, which measures neither what is
before the edge nor what is behind it but something between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Cabinet
from kinematics.transforms import Array, apply, inverse, transform
from perception.camera import cloud
from perception.frames import Frame
from perception.pixels import flying_pixels

FARTHEST_M = 10.0
"""No depth camera for arm's length measures further; what says so is no measurement."""
EDGE_M = 0.02
"""A pixel between two surfaces that are further apart, and on neither of them, flies."""
OUTSIDE_M = 0.03
"""What is nearer to the inner space than this is the cabinet's, as poses are not exact."""
EVERY_PX = 7
SOME, MANY = 0.002, 0.2
"""Of the points of a recording that fits, more than the first share are in the cabinet; another reading that holds the second one explains
a recording that does not fit."""
AT_WALL_M, FAR_BETTER = 0.02, 4.0
"""What is so near to a wall shows it. A reading that shows so many times as much of the walls is the right one: with poses that are right
three quarters of the points do, with the same the other way round a hundredth."""


def trusted(frame: Frame) -> Frame:
    """The frame without the depths that are none: beyond FARTHEST_M, and flying pixels at edges; they become 0, nothing measured."""
    depth = np.ascontiguousarray(frame.depth, np.float32)
    depth = np.where((depth > FARTHEST_M) | ~np.isfinite(depth), np.float32(0), depth)
    return replace(frame, depth=np.where(flying_pixels(depth, EDGE_M), np.float32(0), depth))


def misfit(frames: Sequence[Frame], cabinet: Cabinet) -> str | None:
    """Why the frames can't be of this cabinet, with the likely cause; None when they may be.

    They can't when hardly any of what they measured lies inside it. Then the pose the other way round, the camera's axes as OpenGL and
    Blender have them, and other units of depth and of the pose, are tried: a reading that puts much inside the cabinet is the likely cause.
    Nor can they when such a reading shows the cabinet's walls far better.
    """
    if not any((f.depth > 0).any() for f in frames):
        return None if not frames else "no pixel of the frames measured anything: is this a depth image, and its depth_scale right?"
    as_said, others = _fit(frames, cabinet), [(_fit(other, cabinet), cause) for cause, other in _other_readings(frames)]
    if as_said.inside <= SOME:
        found, cause = max(others, key=lambda other: other[0].inside)
        if found.inside > MANY:
            return f"nothing that the frames measured lies inside the cabinet; {cause} ({100 * found.inside:.0f} % of the points would)"
        return (
            "nothing that the frames measured lies inside the cabinet: is the pose world-to-camera, in millimetres, of the scene's own "
            "world, and depth_scale the millimetres of one step?"
        )
    found, cause = max(others, key=lambda other: other[0].at_walls)
    if found.at_walls > max(MANY, FAR_BETTER * as_said.at_walls):
        shares = f"{100 * as_said.at_walls:.0f} % of the points lie at the cabinet's walls, and {100 * found.at_walls:.0f} % would"
        return f"the frames hardly show this cabinet; {cause} ({shares})"
    return None


class _Fit(NamedTuple):
    """The shares of a recording's points that lie in the cabinet or at its walls, and that lie at its walls, seen through its opening."""

    inside: float
    at_walls: float


def _fit(frames: Sequence[Frame], cabinet: Cabinet) -> _Fit:
    """How much of what was measured is of the cabinet: one in EVERY_PX columns and rows is looked at."""
    total = inside = at_walls = 0
    T = inverse(cabinet.T_world_cabinet)
    low = np.array([0.0, -cabinet.size_m[1] / 2, 0.0])
    high = low + cabinet.size_m
    for frame in frames:
        depth = np.zeros_like(frame.depth)
        depth[::EVERY_PX, ::EVERY_PX] = frame.depth[::EVERY_PX, ::EVERY_PX]
        points = apply(T, cloud(depth, frame.intrinsics, frame.T_world_camera))
        total += len(points)
        points = points[((points > low - OUTSIDE_M) & (points < high + OUTSIDE_M)).all(1)]
        inside += len(points)
        near = (np.abs(points - low) < AT_WALL_M) | (np.abs(points - high) < AT_WALL_M)
        near[:, 0] = np.abs(points[:, 0] - high[0]) < AT_WALL_M  # there is no wall in front
        shown = points[near.any(1)]
        at_walls += int(np.count_nonzero(_through_opening((T @ frame.T_world_camera)[:3, 3], shown, low, high)))
    return _Fit(inside / max(total, 1), at_walls / max(total, 1))


def _through_opening(camera: Array, points: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Whether points (N, 3) in the cabinet are seen through its opening, x = 0, or from within it: (N,). All in the cabinet's frame."""
    if ((camera > low) & (camera < high)).all():
        return np.ones(len(points), bool)
    if camera[0] >= 0.0:
        return np.zeros(len(points), bool)
    crossing = camera + (points - camera) * (-camera[0] / np.maximum(points[:, 0] - camera[0], 1e-9))[:, None]
    return np.asarray(((crossing[:, 1:] > low[1:] - OUTSIDE_M) & (crossing[:, 1:] < high[1:] + OUTSIDE_M)).all(1))


def _other_readings(frames: Sequence[Frame]) -> list[tuple[str, list[Frame]]]:
    """What the files may have meant instead, in words, and the frames as they would be then."""

    def posed(change: float, turned: bool = False) -> list[Frame]:
        return [replace(f, T_world_camera=_pose(f.T_world_camera, change, turned)) for f in frames]

    readings = [("the pose is the camera's in the world: cam_R_w2c and cam_t_w2c must be world to camera", posed(1.0, True))]
    readings.append(("the pose's translation is in metres: cam_t_w2c must be in millimetres", posed(1000.0)))
    readings.append(
        ("the pose is the camera's in the world, and in metres: cam_t_w2c must be world to camera, in millimetres", posed(1000.0, True))
    )
    axes = "the camera's axes are OpenGL's (y up, z backwards): its y and z axes must be turned round, x right, y down, z ahead"
    readings.append((f"{axes} (the second and third row of cam_R_w2c and cam_t_w2c, with the other sign)", _turned_round(frames)))
    readings.append((f"{axes}, and cam_R_w2c and cam_t_w2c must be world to camera", _turned_round(posed(1.0, True))))
    for factor in (1000.0, 10.0, 4.0, 0.25, 0.1, 0.001):
        more = [replace(f, depth=(f.depth * np.float32(factor)).astype(np.float32)) for f in frames]
        readings.append((f"depth_scale is wrong by a factor of {factor:g}: it is the millimetres of one step", more))
    return readings


def _turned_round(frames: Sequence[Frame]) -> list[Frame]:
    """The frames with the camera's y and z axes turned round."""
    return [replace(f, T_world_camera=f.T_world_camera @ np.diag([1.0, -1.0, -1.0, 1.0])) for f in frames]


def _pose(T_world_camera: Array, scale: float, turned: bool) -> Array:
    """The pose with the file's translation (world to camera) in another unit; or, `turned`, with the file's pose as the camera's."""
    w2c = inverse(T_world_camera)
    w2c = transform(w2c[:3, :3], scale * w2c[:3, 3])
    return w2c if turned else inverse(w2c)
