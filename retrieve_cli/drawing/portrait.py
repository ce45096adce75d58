"""A robot alone, at home, with its hand and camera frames and its pads: whether it was understood is seen at a glance."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.transforms import Array, apply, inverse, transform
from perception.rendering.colours import Colour
from perception.rendering.lighting import Studio
from perception.rendering.polylines import Polyline
from perception.rendering.shading import Item, shade
from retrieve_cli.drawing.still import WIDTH_PX, save
from retrieve_cli.drawing.view import ASPECT, HALF_HEIGHT, HALF_WIDTH
from retrieve_cli.drawing.visuals import visuals

AXES: tuple[Colour, ...] = ((0.80, 0.16, 0.16), (0.13, 0.58, 0.20), (0.12, 0.33, 0.78))
AXIS_SHARE = 0.15
"""How long the frames' axes are, in shares of the robot's largest extent."""
PAD_COLOUR: Colour = (0.93, 0.49, 0.10)
AZIMUTH, ELEVATION = np.radians(-50.0), np.radians(22.0)
"""From where the picture is taken, about the robot's base."""


def write_portrait(robot: Robot, out: Path) -> None:
    """Write a PNG. x, y and z of the hand are red, green and blue, those of a camera shorter; the pads are orange.

    Raises: InputError when `out` can't be written.
    """
    from kinematics.shapes import ConvexMesh
    from perception.camera import pinhole
    from perception.rendering.surfaces import Mesh

    poses = robot.link_poses(robot.home)
    items = [Item(Mesh(piece.vertices, piece.faces), poses[piece.link], piece.colour, gloss=0.3) for piece in visuals(robot)]
    pads = [h for h in robot.hulls if h.link in robot.pads]
    items += [Item(ConvexMesh((h.vertices,)), poses[h.link], PAD_COLOUR, alpha=0.35, gloss=0.0) for h in pads]
    points = np.concatenate([apply(poses[h.link], h.vertices) for h in robot.hulls])
    size = AXIS_SHARE * float(np.ptp(points, axis=0).max())
    frames = [("hand", size), *([("camera", size / 2)] if robot.has_camera else [])]
    lines = [line for name, length in frames for line in _axes(poses[name], length)]
    points = np.concatenate([points, *(line.points for line in lines)])
    T = _camera(points)
    studio = Studio(ground_z=float(points[:, 2].min()), key_lights=48, sky_lights=192)
    camera = pinhole(WIDTH_PX, round(WIDTH_PX / ASPECT), 2 * float(np.arctan(HALF_WIDTH * 1.06)))
    save(shade(items, T, camera, lines, studio=studio), out)


def _axes(T: Array, size_m: float) -> list[Polyline]:
    ends = [apply(T, np.array([np.zeros(3), size_m * axis])) for axis in np.eye(3)]
    return [Polyline(line, colour, 4.0, hidden=0.6, halo_px=1.5) for line, colour in zip(ends, AXES)]


def _camera(points: Array) -> Array:
    """T_world_camera (4, 4), so far away that all points (N, 3) are in view."""
    middle = (points.min(0) + points.max(0)) / 2
    out = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
    x = np.cross(-out, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(-out, x), -out], -1)
    seen = apply(inverse(transform(R, middle)), points)
    away = max(float((np.abs(seen[:, 0]) / HALF_WIDTH - seen[:, 2]).max()), float((np.abs(seen[:, 1]) / HALF_HEIGHT - seen[:, 2]).max()))
    return transform(R, middle + 1.05 * away * out)
