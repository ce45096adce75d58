"""The lines of a picture: edges and silhouettes of shapes, footprints, rings, and the floor's grid."""

from __future__ import annotations

import numpy as np

from kinematics.scene import Body, Cabinet
from kinematics.shapes import Box, Cylinder, Shape, convex_parts
from kinematics.transforms import Array, apply, inverse
from perception.rendering.colours import Colour

GRID_COLOUR: Colour = (0.66, 0.70, 0.75)
ON_FLOOR_M = 0.003  # what stands no higher above the floor stands on it


def outline(shape: Shape) -> list[Array]:
    """Polylines (N, 3) along a shape's edges, in its own frame."""
    match shape:
        case Box():
            x, y, z = shape.half
            low = np.array([[-x, -y, -z], [x, -y, -z], [x, y, -z], [-x, y, -z], [-x, -y, -z]])
            top = low + np.array([0, 0, 2 * z])
            return [low, top, *(np.stack([a, b]) for a, b in zip(low[:4], top[:4]))]
        case Cylinder():
            return [circle(shape.radius_m) + np.array([0, 0, z]) for z in (-shape.height_m / 2, shape.height_m / 2)]
        case _:
            return [edge for part in convex_parts(shape) for edge in _creases(part)]


def silhouette(body: Body, T_world_camera: Array) -> list[Array]:
    """Closed polylines (N, 3) around a body's convex parts as a camera sees them."""
    from scipy.spatial import ConvexHull

    loops = []
    for part in convex_parts(body.shape):
        points = apply(body.T_world_body, part)
        seen = apply(inverse(T_world_camera), points)
        if (seen[:, 2] > 0.01).all():
            around = ConvexHull(seen[:, :2] / seen[:, 2:]).vertices
            loops.append(points[np.append(around, around[:1])])
    return loops


def _creases(points: Array) -> list[Array]:
    """The edges (2, 3) of a convex hull where its faces meet at more than 30°."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    edges = []
    for f, neighbours in enumerate(hull.neighbors):
        for g in neighbours[neighbours > f]:
            if hull.equations[f, :3] @ hull.equations[g, :3] < np.cos(np.radians(30)):
                edges.append(points[np.intersect1d(hull.simplices[f], hull.simplices[g])])
    return [e for e in edges if len(e) == 2]


def circle(radius_m: float, sides: int = 64) -> Array:
    """A closed circle (sides + 1, 3) about z."""
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    return np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle), np.zeros(sides + 1)], -1)


def _in_cabinet(cabinet: Cabinet, body: Body) -> Array:
    """The corners (N, 3) of a body's convex parts, in the cabinet's frame."""
    return np.concatenate([apply(inverse(cabinet.T_world_cabinet) @ body.T_world_body, p) for p in convex_parts(body.shape)])


def footprint(cabinet: Cabinet, body: Body) -> Array:
    """The closed outline (N, 3) of a body's shadow on the cabinet's floor."""
    from scipy.spatial import ConvexHull

    flat = _in_cabinet(cabinet, body)[:, :2]
    loop = ConvexHull(flat).vertices
    closed = np.append(loop, loop[:1])
    return apply(cabinet.T_world_cabinet, np.c_[flat[closed], np.full(len(closed), 0.0015)])


def ring(cabinet: Cabinet, body: Body) -> tuple[Array, float]:
    """The mark around a body on what it stands on, the cabinet's floor or a board: its pose (4, 4), with z upwards, and its radius."""
    foot = float(_in_cabinet(cabinet, body)[:, 2].min())
    loop = apply(inverse(cabinet.T_world_cabinet), footprint(cabinet, body))
    centre = (loop.min(0) + loop.max(0)) / 2
    T = cabinet.T_world_cabinet.copy()
    T[:3, 3] = apply(T, np.array([[centre[0], centre[1], 0.0015 + (foot if foot > ON_FLOOR_M else 0.0)]]))[0]
    return T, float(np.linalg.norm(loop[:, :2] - centre[:2], axis=1).max()) + 0.012


def grid(cabinet: Cabinet, n: int, z: float = 0.001) -> list[Array]:
    """The lines (2, 3) between the n × n regions of the floor, at height z above it."""
    dx, dy, _ = cabinet.size_m
    x, y = np.linspace(0, dx, n + 1), np.linspace(-dy / 2, dy / 2, n + 1)
    lines = [[[a, y[0], z], [a, y[-1], z]] for a in x] + [[[x[0], b, z], [x[-1], b, z]] for b in y]
    return [apply(cabinet.T_world_cabinet, np.array(line)) for line in lines]


def front_edges(cabinet: Cabinet) -> Array:
    """The rim (5, 3) of the open front."""
    _, dy, dz = cabinet.size_m
    rim = np.array([[0, -dy / 2, 0], [0, dy / 2, 0], [0, dy / 2, dz], [0, -dy / 2, dz], [0, -dy / 2, 0]])
    return apply(cabinet.T_world_cabinet, rim)
