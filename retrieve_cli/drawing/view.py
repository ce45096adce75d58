"""Where the camera of a picture stands."""

from __future__ import annotations

import numpy as np

from kinematics.scene import Cabinet
from kinematics.transforms import Array
from retrieve_cli.drawing.picture import Film

ASPECT = 1.45
"""Width over height for which the camera is placed."""
HALF_WIDTH, HALF_HEIGHT = 0.50, 0.36
"""Tangents of half the angles of view within which everything is to be seen."""
VIEWS = tuple((azimuth, elevation) for elevation in (32, 42) for azimuth in (-52, 52, -36, 36))
"""Directions to look from, in degrees: around the cabinet, 0 straight before its open front, positive from its left; and above it."""


def best_view(film: Film) -> Array:
    """T_world_camera (4, 4): of a few three-quarter views into the open front, the one that shows most of the target."""
    from perception.camera import pinhole
    from perception.rendering.raycast import raycast
    from perception.rendering.surfaces import surfaces

    state = film.state_at(0.0)
    bodies = film.bodies(state)
    links = film.link_poses(state.q)
    hulls = [h.vertices for h in film.robot.hulls]
    hull_poses = [links[film.robot.tree.index[h.link]] for h in film.robot.hulls]
    seen = surfaces([*(b.shape for b in bodies), *hulls], np.array([*(b.T_world_body for b in bodies), *hull_poses]))
    target = next((i for i, b in enumerate(bodies) if b.name == film.scene.target), -1)
    points = film.film_points()
    small = pinhole(320, int(320 / ASPECT), 2 * float(np.arctan(HALF_WIDTH)))
    views = [fitted(film.scene.cabinet, points, *np.radians(v)) for v in VIEWS]
    shown = [int((raycast(seen, T, small).instance == target).sum()) for T in views]
    return views[int(np.argmax([s * (1 - 0.04 * i) for i, s in enumerate(shown)]))]


def fitted(cabinet: Cabinet, points: Array, azimuth: float, elevation: float) -> Array:
    """T_world_camera (4, 4) that looks at the cabinet from a direction, as near as all points (N, 3) allow (angles in rad)."""
    from perception.camera import look_at

    flat = np.array([-np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    away = cabinet.T_world_cabinet[:3, :3] @ flat
    T = look_at(away, np.zeros(3))
    p = points @ T[:3, :3]
    centre, depth = np.empty(2), np.empty(2)
    for i, tangent in enumerate((HALF_WIDTH, HALF_HEIGHT)):
        low, high = (p[:, i] + tangent * p[:, 2]).min(), (p[:, i] - tangent * p[:, 2]).max()
        centre[i], depth[i] = (low + high) / 2, (low - high) / (2 * tangent)
    T[:3, 3] = T[:3, :3] @ np.array([*centre, depth.min()])
    return T
