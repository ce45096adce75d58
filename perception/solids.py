"""The upright solid behind noisy pixels: fitted to all of them at once, so that their errors average out.

The noise of a stereo camera is along the pixel's ray. A face that is seen lies where the mean of its pixels says; where a face ends is said
by the rays themselves, which are exact: each pixel is moved along its ray onto the face, and the solid reaches as far as these points do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import Array, rotation_about, transform
from perception.footprint import least_circle, least_rectangle, outline_of
from perception.fusion import Views
from perception.rays import BOX, CYLINDER, HEIGHT, KIND, YAW, normal_equations, slid

ROUNDS, STEPS = 3, 3
FEW = 3000
"""So many pixels of an object are enough for a least squares step."""
GATE = 4.5
"""Standard deviations beyond which a pixel is a stray."""
MOST = 0.01
"""No step moves a face by more metres, or turns one by more radians."""
STEP_M, TURN_RAD = 0.005, 0.05
"""How far a step moves a face, or turns it, that no pixel speaks of: the ridge of the least squares."""
SKIN_M = 0.0003
"""How much larger than fitted a solid is on every side: three standard deviations of a fitted face."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """What the frames show of one object: eyes (N, 3) and rays (N, 3), so that eye + z · ray is a pixel's point, and its noisy z (N,).

    axial: standard deviation of a depth at 1 m, growing with z².
    """

    eyes: Array
    rays: Array
    z: Array
    axial: float


def pixels_of(views: Views, points: Array, source: NDArray[np.int64]) -> Pixels:
    """The pixels of points (N, 3) in the cabinet; source (N, 2): frame and pixel of each, see `perception.segment.object_pixels`."""
    eyes = np.array([T[:3, 3] for T in views.T_cabinet_camera])[source[:, 0]]
    averaged, z = np.empty(len(points)), np.empty(len(points))
    for i, (frame, depth) in enumerate(zip(views.frames, views.depths)):
        mine = source[:, 0] == i
        averaged[mine], z[mine] = depth.ravel()[source[mine, 1]], np.asarray(frame.depth).ravel()[source[mine, 1]]
    return Pixels(eyes, (points - eyes) / averaged[:, None], z, views.axial)


def fitted_solid(pixels: Pixels, rough: Array) -> tuple[Shape, Array]:
    """The upright box or cylinder that explains the pixels best, and its pose (4, 4). rough (M, 3): points to begin with, averaged ones."""
    middle = np.append(rough[:, :2].mean(0), 0.0)  # turning about it moves faces least
    pixels = replace(pixels, eyes=pixels.eyes - middle)
    every = max(len(pixels.z) // FEW, 1)
    few = Pixels(pixels.eyes[::every].copy(), pixels.rays[::every].copy(), pixels.z[::every].copy(), pixels.axial)
    outline = outline_of(rough[:, :2] - middle[:2])
    best, least = None, np.inf
    for kind in (BOX, CYLINDER):
        solid = _around(kind, outline, float(rough[:, 2].max()))
        for _ in range(ROUNDS):
            solid = _reaching(_settled(solid, few), few)
        error = normal_equations(solid, few.eyes, few.rays, few.z, few.axial, GATE, np.empty((7, 7)), np.empty(7))
        if error < least:
            best, least = solid, error
    assert best is not None
    shape, T = _shape(_reaching(best, pixels))
    return shape, transform(p=middle) @ T


def _around(kind: float, outline: Array, height: float) -> Array:
    """The solid of one kind around a convex outline (K, 2)."""
    if kind == CYLINDER:
        centre, radius = least_circle(outline)
        return np.array([CYLINDER, *centre, radius, 0.0, height, 0.0])
    centre, size, yaw = least_rectangle(outline)
    c, s = np.cos(yaw), np.sin(yaw)
    u, v = c * centre[0] + s * centre[1], -s * centre[0] + c * centre[1]
    return np.array([BOX, u - size[0] / 2, u + size[0] / 2, v - size[1] / 2, v + size[1] / 2, height, yaw])


def _settled(solid: Array, pixels: Pixels) -> Array:
    """The solid after some least squares steps: each face that is seen goes to the mean of its pixels."""
    A, g = np.empty((7, 7)), np.empty(7)
    ridge = np.diag([1.0, *[STEP_M**-2] * 5, TURN_RAD**-2])
    for _ in range(STEPS):
        normal_equations(solid, pixels.eyes, pixels.rays, pixels.z, pixels.axial, GATE, A, g)
        solid = solid + np.clip(np.linalg.solve(A + ridge, g), -MOST, MOST)
    return solid


def _reaching(solid: Array, pixels: Pixels) -> Array:
    """The solid of the same kind that reaches as far as the pixels do, once moved onto its faces."""
    out = np.empty((len(pixels.z), 3))
    n = slid(solid, pixels.eyes, pixels.rays, pixels.z, pixels.axial, GATE, out)
    return _around(solid[KIND], outline_of(out[:n, :2]), float(out[:n, 2].max())) if n else solid


def _shape(solid: Array) -> tuple[Shape, Array]:
    height = solid[HEIGHT] + SKIN_M
    if solid[KIND] == CYLINDER:
        return Cylinder(float(solid[3] + SKIN_M), float(height)), transform(p=[solid[1], solid[2], height / 2])
    c, s = np.cos(solid[YAW]), np.sin(solid[YAW])
    u, v = (solid[1] + solid[2]) / 2, (solid[3] + solid[4]) / 2
    size = np.array([solid[2] - solid[1] + 2 * SKIN_M, solid[4] - solid[3] + 2 * SKIN_M, height])
    return Box(size), transform(rotation_about((0.0, 0.0, 1.0), float(solid[YAW])), [c * u - s * v, s * u + c * v, height / 2])
