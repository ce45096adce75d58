"""Bodies in a cabinet, and pictures of them: for tests of what is found in views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.scene import Body, Cabinet, object_box
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, rotation_about, transform
from perception.camera import DepthNoise, Intrinsics, look_at, realsense_d435i
from perception.frames import Frame
from perception.objects.segment import iou
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import surfaces

CAMERA = realsense_d435i(320, 240)
CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.3, 0.0, 0.1]), 0.03)
TURNED = replace(CABINET, T_world_cabinet=transform(rotation_about((0, 0, 1), 0.4), [0.25, 0.1, 0.2]))
EYES = (
    (-0.1, -0.35, 0.4),
    (-0.1, 0.35, 0.4),
    (0.02, 0.0, 0.45),
    (-0.05, -0.2, 0.25),
    (-0.05, 0.2, 0.25),
    (0.08, -0.3, 0.45),
    (0.08, 0.3, 0.45),
)


def box(name: str, x: float, y: float, size: Sequence[float], yaw: float = 0.0) -> Body:
    return Body(name, Box(np.array(size)), transform(rotation_about((0, 0, 1), yaw), [x, y, size[2] / 2]))


def can(name: str, x: float, y: float, radius: float = 0.03, height: float = 0.15) -> Body:
    return Body(name, Cylinder(radius, height), transform(p=[x, y, height / 2]))


def lifted(body: Body, by_m: float) -> Body:
    return replace(body, T_world_body=transform(p=[0, 0, by_m]) @ body.T_world_body)


def placed(bodies: Sequence[Body], cabinet: Cabinet) -> list[Body]:
    """Bodies given in the cabinet's frame, in the world."""
    return [replace(b, T_world_body=cabinet.T_world_cabinet @ b.T_world_body) for b in bodies]


def photograph(
    bodies: Sequence[Body],
    cabinet: Cabinet = CABINET,
    noise: DepthNoise | None = None,
    eyes: Sequence[Sequence[float]] = EYES,
    camera: Intrinsics = CAMERA,
) -> list[Frame]:
    """What cameras at `eyes`, in the cabinet's frame, see of bodies in the world."""
    rng = np.random.default_rng(5)
    world = [*bodies, *cabinet.walls()]
    packed = surfaces([b.shape for b in world], np.array([b.T_world_body for b in world]))
    frames = []
    for eye in eyes:
        T = cabinet.T_world_cabinet @ look_at(np.array(eye), np.array([0.35, -eye[1] / 4, 0.05]))
        view = raycast(packed, T, camera)
        depth = view.depth if noise is None else noise.apply(view.depth, rng)
        instance = np.where(view.instance < len(bodies), view.instance, -1).astype(np.int32)
        frames.append(Frame(depth, instance, tuple(b.name for b in bodies), camera, T))
    return frames


def without_masks(frames: Sequence[Frame]) -> list[Frame]:
    return [replace(f, instance=None, names=()) for f in frames]


def best_matches(bodies: Sequence[Body], boxes: dict[str, Array]) -> list[float]:
    return [max((iou(object_box(b), found) for found in boxes.values()), default=0.0) for b in bodies]
