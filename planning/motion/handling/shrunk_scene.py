"""A scene with shrunk obstacles: all that stands, and the walls, are further from any point by so much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.scene import Body, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import transform
from planning.grasping.sampling import DIAGONAL
from planning.motion.handling.neighbourhoods import least_room_m

LEFT_M = 0.002
"""What is looked at smaller is still as thick as this, or thicker."""


def thinnest_m(scene: Scene) -> float:
    """How thick the thinnest is of all that stands in a scene, and of its walls; 0 where there is a mesh."""
    bodies = (*scene.objects, *scene.obstacles)
    solid = (2 * float(b.shape.half.min()) if isinstance(b.shape, (Box, Cylinder)) else 0.0 for b in bodies)
    return min(scene.cabinet.wall_m, *solid)


def thinnest_allowed_m(scene: Scene) -> float:
    """What is thinner can't be made smaller by the least room that a proof looks at, and something be left of it."""
    return 2 * least_room_m(pitched=DIAGONAL in scene.approaches) + LEFT_M


def most_room_m(scene: Scene) -> float:
    """By how much everything can be made smaller, and something be left of it."""
    return (thinnest_m(scene) - LEFT_M) / 2


def can_be_shrunk(scene: Scene) -> bool:
    """Whether all that stands in a scene can be made smaller: boxes and cylinders, no plate, no thin wall."""
    return thinnest_m(scene) >= thinnest_allowed_m(scene)


def shrunk(scene: Scene, by_m: float) -> Scene:
    """A scene in which objects, obstacles and walls are shrunk: further from any point by so much."""
    cabinet = scene.cabinet
    larger = replace(
        cabinet,
        size_m=cabinet.size_m + np.array([0.0, 2 * by_m, 2 * by_m]),
        T_world_cabinet=cabinet.T_world_cabinet @ transform(p=[by_m, 0.0, -by_m]),
        wall_m=cabinet.wall_m - 2 * by_m,  # for links beside, above and below it, too
    )
    objects, obstacles = (tuple(_smaller(body, by_m) for body in bodies) for bodies in (scene.objects, scene.obstacles))
    return replace(scene, cabinet=larger, objects=objects, obstacles=obstacles)


def _smaller(body: Body, by_m: float) -> Body:
    match body.shape:
        case Box(size_m):
            return replace(body, shape=Box(np.asarray(size_m) - 2 * by_m))
        case Cylinder(radius_m, height_m):
            return replace(body, shape=Cylinder(radius_m - by_m, height_m - 2 * by_m))
    raise ValueError(f"{body.name} is a mesh, and can't be made smaller")
