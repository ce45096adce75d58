"""Pinhole cameras: intrinsics, poses, depth images to points, and the noise of a stereo depth camera.

Camera frame as in OpenCV: z forward, x right, y down. Pixel (u, v) is column u, row v; whole numbers are pixel centres. A depth image
(H, W) holds z, not the distance along the ray, in metres; 0 means that nothing was measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array, apply, cross

Depth = NDArray[np.float32]
D435I_WIDTH, D435I_F = 1280, 910.0  # the colour stream of a RealSense D435i, to which its depth is aligned


@dataclass(frozen=True)
class Intrinsics:
    """width, height, focal lengths fx, fy and principal point cx, cy, all in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def K(self) -> Array:
        """The (3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def fov_rad(self) -> tuple[float, float]:
        """Horizontal and vertical angle between the outer borders of the outermost pixels."""
        w, h = self.width, self.height
        return (
            float(np.arctan((self.cx + 0.5) / self.fx) + np.arctan((w - 0.5 - self.cx) / self.fx)),
            float(np.arctan((self.cy + 0.5) / self.fy) + np.arctan((h - 0.5 - self.cy) / self.fy)),
        )

    def scaled(self, factor: float) -> Intrinsics:
        """The same camera with every pixel divided into factor × factor; with 1 / k, every k × k pixels joined."""
        k, shift = factor, (factor - 1) / 2
        return Intrinsics(round(self.width * k), round(self.height * k), self.fx * k, self.fy * k, self.cx * k + shift, self.cy * k + shift)


def pinhole(width: int, height: int, hfov_rad: float) -> Intrinsics:
    """A camera with square pixels, a centred principal point and the given horizontal field of view."""
    f = width / 2 / np.tan(hfov_rad / 2)
    return Intrinsics(width, height, f, f, (width - 1) / 2, (height - 1) / 2)


def realsense_d435i(width: int = 640, height: int = 480) -> Intrinsics:
    """A RealSense D435i: the 1280 × 720 stream, f = 910 px, scaled to `width`; the horizontal field of view is 70° at every size.

    Only 16:9 sizes such as 640 × 360 keep the sensor's 43° vertically; 4:3 shows more above and below.
    """
    f = D435I_F * width / D435I_WIDTH
    return Intrinsics(width, height, f, f, (width - 1) / 2, (height - 1) / 2)


def look_at(eye: Array, target: Array, up: Array | tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Array:
    """T_world_camera (4, 4) at `eye` (3,), looking at `target` (3,), with `up` (3,) upwards in the image.

    When the view runs along `up`, the world's x axis takes its place. Raises: ValueError when eye and target coincide.
    """
    eye, up = np.asarray(eye, float), np.asarray(up, float)
    forward = np.asarray(target, float) - eye
    distance = sqrt(forward.dot(forward))
    if not distance > 1e-9:
        raise ValueError("a camera can't look at the point where it stands")
    z = forward / distance
    x = cross(z, up)
    if sqrt(x.dot(x)) < 1e-6 * sqrt(up.dot(up)):
        x = cross(z, np.array([1.0, 0.0, 0.0]))
    x = x / sqrt(x.dot(x))
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, cross(z, x), z, eye
    return T


def ray_directions(intrinsics: Intrinsics) -> Array:
    """Directions (H, W, 3) through the pixel centres in the camera frame, with z = 1: depth times direction is the point."""
    x = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    y = (np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy
    rays = np.ones((intrinsics.height, intrinsics.width, 3))
    rays[..., 0], rays[..., 1] = x, y[:, None]
    return rays


def points_in_camera(depth: Depth | Array, intrinsics: Intrinsics) -> Array:
    """Points (H, W, 3) in the camera frame, metres; NaN where nothing was measured."""
    z = np.asarray(depth, float)
    return np.where(z > 0, z, np.nan)[..., None] * ray_directions(intrinsics)


def cloud(depth: Depth | Array, intrinsics: Intrinsics, T_world_camera: Array) -> Array:
    """The N measured points (N, 3) in the world, row by row."""
    return apply(T_world_camera, points_in_camera(depth, intrinsics)[np.asarray(depth, np.float32) > 0])


def project(points_world: Array, intrinsics: Intrinsics, T_world_camera: Array) -> Array:
    """Points (N, 3) to (N, 3): column, row and depth z; columns and rows are NaN for points that are not in front of the camera. By
    cameras at several poses (C, 4, 4): (C, N, 3)."""
    p = (points_world - T_world_camera[..., None, :3, 3]) @ T_world_camera[..., :3, :3]
    z = np.where(p[..., 2] > 1e-9, p[..., 2], np.nan)
    return np.stack([intrinsics.fx * p[..., 0] / z + intrinsics.cx, intrinsics.fy * p[..., 1] / z + intrinsics.cy, p[..., 2]], -1)


@dataclass(frozen=True)
class DepthNoise:
    """What a stereo depth camera does to a clean image; the defaults are a D435i's.

    min_m, max_m: outside of this range nothing is measured.
    axial_1m_m: standard deviation at 1 m; it grows with z², as the error of a constant disparity does.
    edge_dropout: the chance that a pixel at a depth edge measures nothing; an edge is a step of more than edge_step_m to one of the pixels
    up to edge_px away.
    step_m: depths are whole multiples of it.
    """

    min_m: float = 0.17
    max_m: float = 3.0
    axial_1m_m: float = 0.004
    edge_dropout: float = 0.5
    edge_step_m: float = 0.02
    edge_px: int = 1
    step_m: float = 0.001

    def apply(self, depth: Depth, rng: np.random.Generator) -> Depth:
        """A noisy copy (H, W) of a clean depth image. The same generator state gives the same bytes."""
        z = np.asarray(depth, float)
        chance, error = rng.random(z.shape), rng.standard_normal(z.shape)
        noisy = z + self.axial_1m_m * z**2 * error
        if self.step_m > 0:
            noisy = np.round(noisy / self.step_m) * self.step_m
        lost = (z <= 0) | (noisy < self.min_m) | (noisy > self.max_m)
        lost |= depth_edges(depth, self.edge_step_m, self.edge_px) & (chance < self.edge_dropout)
        return np.where(lost, 0.0, noisy).astype(np.float32)


def depth_edges(depth: Depth, step_m: float = 0.02, reach_px: int = 1) -> NDArray[np.bool_]:
    """Where (H, W) the depth changes by more than step_m within reach_px columns or rows; the border of "nothing" is an edge too."""
    z = np.asarray(depth, np.float32)
    edge = np.zeros(z.shape, bool)
    for k in range(1, reach_px + 1):
        columns, rows = np.abs(z[:, k:] - z[:, :-k]) > step_m, np.abs(z[k:] - z[:-k]) > step_m
        edge[:, k:] |= columns
        edge[:, :-k] |= columns
        edge[k:] |= rows
        edge[:-k] |= rows
    return edge
