"""Where frames come from: a camera is a function of its pose and of the robot's configuration. Here the synthetic one, of a known scene.

A real camera takes its place by being such a function: it takes a picture, and `robot_pixels` tells which of it is the robot itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import Array, apply, inverse
from perception.camera import DepthNoise, Intrinsics, realsense_d435i
from perception.frames import Frame
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import Surfaces, join, moved, surfaces

Camera = Callable[[Array, Array], Frame]
"""T_world_camera (4, 4) and the robot's configuration q (J,) to a frame."""

RANGE_M = (0.17, 3.0)  # a D435i measures nothing nearer or further
ARM_SLACK_M = 0.01
ROUNDING_M = 1e-6
DEFAULT = realsense_d435i(640, 360)


def synthetic_camera(
    robot: Robot,
    scene: Scene,
    poses: Mapping[str, Array],
    *,
    intrinsics: Intrinsics = DEFAULT,
    noise: DepthNoise | None = None,
    rng: np.random.Generator | None = None,
) -> Camera:
    """A camera that sees a scene's objects at poses, the cabinet, the obstacles and the robot's own links. noise: needs `rng`."""
    fixtures = scene.fixtures()
    bodies = [b for b in scene.objects if b.name in poses]
    names = tuple(b.name for b in bodies)
    T = np.array([*(w.T_world_body for w in fixtures), *(poses[n] for n in names)])
    still = surfaces([*(w.shape for w in fixtures), *(b.shape for b in bodies)], T)
    if noise is not None and rng is None:
        raise ValueError("noise needs a random generator")

    def look(T_world_camera: Array, q: Array) -> Frame:
        own = robot_surfaces(robot, scene.robot.T_world_base, q, T_world_camera, intrinsics)
        view = raycast(join(still, *own), T_world_camera, intrinsics)
        instance = view.instance - len(fixtures)
        arm = instance >= len(names)
        depth = view.depth
        if noise is not None and rng is not None:
            depth = noise.apply(depth, rng)
        depth = np.where((depth < RANGE_M[0]) | (depth > RANGE_M[1]), np.float32(0), depth)
        instance = np.where((instance >= 0) & ~arm & (depth > 0), instance, -1).astype(np.int32)
        return Frame(depth, instance, names, intrinsics, T_world_camera, arm, q)

    return look


def robot_surfaces(robot: Robot, T_world_base: Array, q: Array, T_world_camera: Array, intrinsics: Intrinsics) -> list[Surfaces]:
    """The robot's link hulls at q (J,) that may be in a picture, without the camera's own housing.

    Most links are behind the camera in the hand or beside what it sees, and those take longest to draw: so they are left out beforehand.
    """
    poses, links = robot.link_poses(q), _packed(robot)
    T_camera_base = inverse(T_world_camera) @ T_world_base
    out = []
    balls = np.array([ball for _, _, ball in links])
    middles = (T_camera_base @ np.array([poses[link] for _, link, _ in links]) @ balls[:, [0, 1, 2, 3], None])[:, :3, 0]
    sides = _sides(intrinsics)
    near = (middles @ sides.T + balls[:, 4:] * np.linalg.norm(sides, axis=1) > -ROUNDING_M).all(1)
    for packed, link, _ in compress(links, near):
        if _may_show(apply(T_camera_base @ poses[link], packed.vertices), intrinsics):
            out.append(moved(packed, (T_world_base @ poses[link])[None]))
    return out


def _may_show(points: Array, camera: Intrinsics) -> bool:
    """Whether the hull of points (N, 3) of the camera's frame may be in its picture: not all are beyond one side of what it sees."""
    return bool((_sides(camera) @ points.T > 0).any(1).all())


def _sides(camera: Intrinsics) -> Array:
    """What a camera sees, in its frame: the points whose products with these (5, 3) are above 0."""
    left, right, above, below = camera.cx + 1, camera.width - camera.cx, camera.cy + 1, camera.height - camera.cy
    return np.array([[0, 0, 1], [camera.fx, 0, left], [-camera.fx, 0, right], [0, camera.fy, above], [0, -camera.fy, below]], float)


def robot_depth(robot: Robot, T_world_base: Array, q: Array, T_world_camera: Array, intrinsics: Intrinsics) -> NDArray[np.float32]:
    """How far (H, W) the robot's own links are in the picture, 0 where they are not."""
    shown = robot_surfaces(robot, T_world_base, q, T_world_camera, intrinsics)
    if not shown:
        return np.zeros((intrinsics.height, intrinsics.width), np.float32)
    return raycast(join(*shown), T_world_camera, intrinsics).depth


def robot_pixels(robot: Robot, T_world_base: Array, q: Array, frame: Frame) -> NDArray[np.bool_]:
    """Which pixels (H, W) of a real frame show the robot: those no further than its links would be, and their neighbours."""
    own = robot_depth(robot, T_world_base, q, frame.T_world_camera, frame.intrinsics)
    hit = (own > 0) & (frame.depth <= own + ARM_SLACK_M)
    grown = hit.copy()
    grown[1:] |= hit[:-1]
    grown[:-1] |= hit[1:]
    grown[:, 1:] |= hit[:, :-1]
    grown[:, :-1] |= hit[:, 1:]
    return grown


def marked(robot: Robot, T_world_base: Array, frames: Sequence[Frame]) -> tuple[Frame, ...]:
    """The frames with the robot's own pixels marked, where nobody has marked them and it is known how the robot stood.

    Raises: ValueError when a frame's q is not of this robot.
    """
    out = []
    for i, frame in enumerate(frames):
        if frame.q is not None and len(frame.q) != len(robot.joint_names):
            raise ValueError(f"frame {i}: robot_q has {len(frame.q)} numbers, {robot.name} has {len(robot.joint_names)} actuated joints")
        if frame.arm is None and frame.q is not None:
            frame = replace(frame, arm=robot_pixels(robot, T_world_base, frame.q, frame))
        out.append(frame)
    return tuple(out)


@lru_cache(maxsize=8)
def _packed(robot: Robot) -> tuple[tuple[Surfaces, str, Array], ...]:
    """Each link hull by itself, its link, and a ball around it: its middle as (x, y, z, 1) in the link's frame, and its radius."""
    out = []
    for hull in robot.hulls:
        if hull.link != "camera":
            middle = (hull.vertices.min(0) + hull.vertices.max(0)) / 2
            reach = float(np.linalg.norm(hull.vertices - middle, axis=1).max())
            out.append((surfaces([hull.vertices], np.eye(4)[None]), hull.link, np.array([*middle, 1.0, reach])))
    return tuple(out)
