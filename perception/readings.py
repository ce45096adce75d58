"""What the files of a recording may have meant instead: poses, axes, units and images as other programs have them.

Each reading is what is often told in the place of BOP's poses (world to camera, OpenCV's axes, millimetres). Of a recording that can't be
of its cabinet, the one by which it would is the likely cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kinematics.scene import Cabinet
from kinematics.transforms import Array, inverse, rotation_from_wxyz, transform, wxyz_from_rotation
from perception.frames import Frame

NEAREST_M = 0.05
"""No depth camera measures what is nearer, so a reading by which all is nearer is none."""
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
T_BODY_OPTICAL = transform(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))
"""Pose of the optical axes (z ahead, x right) in a ROS camera's body (x ahead, y left, z up)."""
FACTORS = (1000.0, 10.0, 5.0, 4.0, 0.25, 0.2, 0.125, 0.1, 0.001)
"""By how much depths are too small or too great, as a rule: metres for millimetres, steps of 0.1, 0.2 and 0.25 mm, three bits of a player's
number (Kinect)."""

Change = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Sample:
    """Some of a frame's pixels. rays (N, 3): their directions in the camera, z = 1; depth (N,): z in metres; T_world_camera (4, 4)."""

    rays: Array
    depth: Array
    T_world_camera: Array

    @property
    def points(self) -> Array:
        """In the world (N, 3)."""
        return (self.depth[:, None] * self.rays) @ self.T_world_camera[:3, :3].T + self.T_world_camera[:3, 3]


def sample(frame: Frame, every_px: int) -> Sample:
    """What one in every_px columns and rows of a frame measured, but for the robot."""
    shown = frame.depth[::every_px, ::every_px] > 0
    if frame.arm is not None:
        shown &= ~frame.arm[::every_px, ::every_px]
    v, u = (every_px * i for i in np.nonzero(shown))
    k = frame.intrinsics
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(len(u))], -1)
    return Sample(rays, frame.depth[v, u].astype(float), frame.T_world_camera)


def plausible(samples: list[Sample]) -> bool:
    """Whether a depth camera may have measured them."""
    depths = np.concatenate([s.depth for s in samples])
    return len(depths) > 0 and float(np.median(depths)) > NEAREST_M


def other_readings(samples: list[Sample], cabinet: Cabinet, T_world_base: Array) -> list[tuple[str, list[Sample]]]:
    """What the files may have meant instead, in words with the remedy, and what they would show then."""

    def posed(change: Change) -> list[Sample]:
        return [replace(s, T_world_camera=change(s.T_world_camera)) for s in samples]

    readings = [(cause, posed(change)) for cause, change in _poses(cabinet, T_world_base)]
    for factor in FACTORS:
        scaled = [replace(s, depth=s.depth * factor) for s in samples]
        readings.append((f"depth_scale is wrong by a factor of {factor:g}: it is the millimetres of one step", scaled))
    mirrored = [replace(s, rays=s.rays * [-1.0, 1.0, 1.0]) for s in samples]
    readings.append(("the images are mirrored, left and right exchanged", mirrored))
    along = [replace(s, depth=s.depth / np.linalg.norm(s.rays, axis=1)) for s in samples]
    readings.append(("the depths are distances from the camera: they must be z, along the optical axis", along))
    return [(cause, other) for cause, other in readings if plausible(other)]


def _poses(cabinet: Cabinet, T_world_base: Array) -> list[tuple[str, Change]]:
    """Other readings of the poses: what was done wrong, and what undoes it in a T_world_camera."""
    must = "must be world to camera"
    inverted = "the pose is the camera's in the world"
    opengl = "the camera's axes are OpenGL's (y up, z backwards): its y and z axes must be turned round, x right, y down, z ahead"
    rows = "(the second and third row of cam_R_w2c and cam_t_w2c, with the other sign)"
    ros = "the camera's axes are its body's in ROS (x ahead, y left, z up): they must be its optical frame's, x right, y down, z ahead"
    poses: list[tuple[str, Change]] = [
        (f"{inverted}: cam_R_w2c and cam_t_w2c {must}", inverse),
        ("the pose's translation is in metres: cam_t_w2c must be in millimetres", _in_metres),
        (f"{inverted}, and in metres: cam_t_w2c {must}, in millimetres", lambda T: inverse(_in_metres(T))),
        (f"{opengl} {rows}", lambda T: T @ OPENGL),
        (f"{opengl}, and cam_R_w2c and cam_t_w2c {must}", lambda T: inverse(T) @ OPENGL),
        (ros, lambda T: T @ T_BODY_OPTICAL),
        (f"{ros}, and cam_R_w2c and cam_t_w2c {must}", lambda T: inverse(T) @ T_BODY_OPTICAL),
        (f"cam_R_w2c is the camera's rotation in the world: it {must}, its transpose", _transposed_in_camera),
        ("cam_t_w2c is where the camera is in the world: it must be -R times that, the world's origin in the camera", _camera_position),
        ("the camera's rotation in the world is transposed (its columns told as rows)", _transposed_in_world),
    ]
    for order, shift in (("x, y, z, w and were read as w, x, y, z", 1), ("w, x, y, z and were read as x, y, z, w", -1)):
        quaternions = f"the poses come from quaternions that say {order}"
        poses.append((quaternions, _reordered(shift)))
        poses.append((quaternions, _reordered(shift, of_w2c=True)))
    for degrees, R in ((180, [[-1, 0], [0, -1]]), (90, [[0, -1], [1, 0]]), (-90, [[0, 1], [-1, 0]])):
        turn = np.eye(4)
        turn[:2, :2] = R
        cause = f"the images are turned by {abs(degrees)}° against the poses: turn either about the optical axis"
        poses.append((cause, _times(np.eye(4), turn)))
    world = "frame: they must be in the scene's world"
    poses.append((f"the poses are in the robot's base {world} (robot.T_world_base)", _times(T_world_base, np.eye(4))))
    poses.append((f"the poses are in the cabinet's {world}", _times(cabinet.T_world_cabinet, np.eye(4))))
    return poses


def _times(before: Array, after: Array) -> Change:
    return lambda T: before @ T @ after


def _in_metres(T_world_camera: Array) -> Array:
    w2c = inverse(T_world_camera)
    return inverse(transform(w2c[:3, :3], 1000.0 * w2c[:3, 3]))


def _transposed_in_camera(T_world_camera: Array) -> Array:
    w2c = inverse(T_world_camera)
    return inverse(transform(w2c[:3, :3].T, w2c[:3, 3]))


def _camera_position(T_world_camera: Array) -> Array:
    w2c = inverse(T_world_camera)
    return transform(T_world_camera[:3, :3], w2c[:3, 3])


def _transposed_in_world(T_world_camera: Array) -> Array:
    return transform(T_world_camera[:3, :3].T, T_world_camera[:3, 3])


def _reordered(shift: int, *, of_w2c: bool = False) -> Change:
    """The pose, or its inverse, with the four numbers of its quaternion in another order: so many places further on."""

    def change(T: Array) -> Array:
        return transform(rotation_from_wxyz(np.roll(wxyz_from_rotation(T[:3, :3]), shift)), T[:3, 3])

    return (lambda T: inverse(change(inverse(T)))) if of_w2c else change
