"""A still of a few pixels that has everything in it: drawing it compiles all that drawing needs."""

from __future__ import annotations

import numpy as np

from kinematics.shapes import Box, Cylinder, Shape, box_corners
from kinematics.transforms import Array
from perception.camera import look_at, pinhole
from perception.rendering.lighting import Studio
from perception.rendering.polylines import Polyline
from perception.rendering.raycast import raycast
from perception.rendering.shading import Image, Item, shade
from perception.rendering.surfaces import Mesh, surfaces

FACES = np.array([[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7]], np.int64)


def tiny_still() -> Image:
    """A box, a cylinder, a hull and a mesh on the ground, behind glass, with two lines."""
    corners = box_corners(np.array([0.1, 0.1, 0.1]))
    grey = (0.5, 0.5, 0.5)
    shapes: tuple[Shape | Mesh | Array, ...] = (Box(np.full(3, 0.2)), Cylinder(0.1, 0.2), corners, Mesh(corners, FACES))
    items = [Item(shape, _at(0.4 * i), grey) for i, shape in enumerate(shapes)]
    items.append(Item(Box(np.array([0.02, 2.0, 0.4])), _at(0.6, -0.5), grey, alpha=0.2, gloss=0.0))
    ends = np.array([[0.0, 0.0, 0.3], [1.0, 0.2, 0.3], [1.2, 0.2, 0.4]])
    lines = [Polyline(ends, grey), Polyline(ends, np.full((3, 3), 0.5))]
    studio = Studio(ground_z=-0.1, key_lights=12, sky_lights=12)
    camera, T_world_camera = pinhole(32, 24, 1.0), look_at(np.array([-2.0, -0.5, 1.0]), np.array([0.6, 0.0, 0.0]))
    raycast(surfaces(shapes, np.array([i.T_world_item for i in items[:4]])), T_world_camera, camera)  # by which a camera's place is chosen
    return shade(items, T_world_camera, camera, lines, studio=studio)


def _at(x: float, y: float = 0.0) -> Array:
    T = np.eye(4)
    T[:2, 3] = x, y
    return T
