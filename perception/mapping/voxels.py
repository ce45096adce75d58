"""Voxels: what is known of the cabinet's inner space, unknown, free or occupied, and how a depth image adds to it.

A voxel becomes free only when its whole image lies on rays that run on beyond it, so a free voxel holds no part of anything that the
camera could resolve; a voxel in which a ray ends is occupied; the rest stays as it was. What was seen last holds. The cabinet's walls are
known beforehand: a ray that ends at one of them is clear all the way, and walls are no occupied voxels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinematics.array_checks import checked
from kinematics.scene import Body, Cabinet
from kinematics.shapes import Box, Cylinder, convex_parts, is_level
from kinematics.transforms import Array, apply, inverse, transform
from perception.camera import Intrinsics
from perception.mapping import carving
from perception.mapping.box_cover import cover_with_boxes
from perception.mapping.carving import FREE, OCCUPIED, UNKNOWN, States
from perception.pixels import filled, smooth

VOXEL_M = 0.01
WALL_SLACK_M = 0.002
"""A depth that misses the wall by no more than this is the wall's; noise is added to it."""
SMOOTH_PX, ENOUGH, FILL = 3, 9, 4
"""Noisy pixels are averaged with those so many around; with so many, a pixel is trusted to be where it says."""
MOST_BOXES = 20000


def T_world_grid(cabinet: Cabinet) -> Array:
    """The frame (4, 4) of a grid over a cabinet, whatever its voxels' size: moved to the lower corner at the right of the front."""
    return np.asarray(cabinet.T_world_cabinet @ transform(p=[0.0, -cabinet.size_m[1] / 2, 0.0]))


@dataclass(frozen=True, eq=False)
class ClearRays:
    """What one depth image says of a cabinet's space, for maps of any voxel size. clear (H, W): how far each ray is clear, along the
    camera's z; ends (H, W): where it meets something inside, for certain; camera: fx, fy, cx, cy; T_grid_camera (4, 4)."""

    clear: NDArray[np.float32]
    ends: NDArray[np.float32]
    camera: tuple[float, float, float, float]
    T_grid_camera: Array


def clear_rays(
    cabinet: Cabinet,
    depth: NDArray[np.float32],
    intrinsics: Intrinsics,
    T_world_camera: Array,
    *,
    own: NDArray[np.bool_] | None = None,
    noise_1m_m: float = 0.0,
) -> ClearRays:
    """What a depth image (H, W) says, metres, 0 where nothing was measured. own (H, W): the robot's own pixels, if any.

    noise_1m_m: standard deviation of a depth at 1 m, growing with z². Noise is averaged away where the pixels around allow it; a depth
    that misses a wall by four of its standard deviations is still the wall's, and one with few like it around marks nothing occupied.
    A pixel that was lost at an edge is taken for as near as those around it.
    """
    size = (intrinsics.height, intrinsics.width)
    if depth.shape != size or (own is not None and own.shape != size):
        raise ValueError(f"depth {depth.shape}, own {None if own is None else own.shape}: the camera's images are {size}")
    T_grid_camera = inverse(T_world_grid(cabinet)) @ checked("T_world_camera", T_world_camera, 4, 4)
    f = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
    R, eye = np.ascontiguousarray(T_grid_camera[:3, :3]), T_grid_camera[:3, 3].copy()
    own = np.zeros(depth.shape, bool) if own is None else np.ascontiguousarray(own, bool)
    depth = np.where(own, np.float32(0), depth).astype(np.float32)
    clear = np.empty(depth.shape, np.float32)
    carving.clear_depth(depth, *f, R, eye, cabinet.size_m, WALL_SLACK_M, 4 * noise_1m_m, clear)
    ends = clear
    if noise_1m_m > 0:
        averaged, count = smooth(depth, np.zeros(depth.shape, np.int32), noise_1m_m, SMOOTH_PX)
        surer = np.empty(depth.shape, np.float32)
        carving.clear_depth(averaged, *f, R, eye, cabinet.size_m, WALL_SLACK_M, 4 * noise_1m_m, surer)
        clear = np.where(count >= ENOUGH, surer, clear)
        ends = np.where(count >= ENOUGH, surer, np.float32(0))
        clear = filled(clear, own, FILL)
    return ClearRays(clear, ends, f, T_grid_camera)


@dataclass(frozen=True, eq=False)
class Voxels:
    """A grid over the cabinet's inner space. state (X, Y, Z): UNKNOWN, FREE or OCCUPIED, along the cabinet's x, y and z.

    Voxels are cuboids with edges `step` (3,), the asked size or a little less, so that a whole number of them fills the space.
    """

    cabinet: Cabinet
    state: States

    @cached_property
    def step(self) -> Array:
        """A voxel's sizes (3,), m."""
        return np.asarray(self.cabinet.size_m / self.state.shape, float)

    @cached_property
    def T_world_grid(self) -> Array:
        """The grid's frame (4, 4): the cabinet's, moved to the lower corner at the right of the front."""
        return T_world_grid(self.cabinet)

    @property
    def known(self) -> float:
        """The share of the inner space that is not unknown."""
        return 1.0 - float(np.count_nonzero(self.state == UNKNOWN)) / self.state.size

    @property
    def voxel_m3(self) -> float:
        """A voxel's volume, m³."""
        return float(np.prod(self.step))

    def fuse(
        self,
        depth: NDArray[np.float32],
        intrinsics: Intrinsics,
        T_world_camera: Array,
        *,
        own: NDArray[np.bool_] | None = None,
        noise_1m_m: float = 0.0,
    ) -> Voxels:
        """The map after one depth image, see `clear_rays`."""
        return self.after(clear_rays(self.cabinet, depth, intrinsics, T_world_camera, own=own, noise_1m_m=noise_1m_m))

    def after(self, rays: ClearRays) -> Voxels:
        """The map after what one depth image says."""
        state, (R, eye) = self.state.copy(), (np.ascontiguousarray(rays.T_grid_camera[:3, :3]), rays.T_grid_camera[:3, 3].copy())
        levels, negated = (np.empty((carving.LEVELS, *rays.clear.shape), np.float32) for _ in range(2))
        levels[0], negated[0] = rays.clear, -rays.clear
        carving.pyramid(levels)
        carving.pyramid(negated)
        T = np.ascontiguousarray(inverse(rays.T_grid_camera)[:3])
        carving.mark_free(state, self.step, T, levels, negated, *rays.camera, np.empty((2, 3)), np.empty(state.shape[2], np.uint8))
        carving.mark_occupied(state, self.step, rays.ends, *rays.camera, R, eye)
        return replace(self, state=state)

    def index(self, points_world: Array) -> NDArray[np.int64]:
        """The voxels (N, 3) that hold points (N, 3); those outside have indices outside the grid."""
        return np.floor(apply(inverse(self.T_world_grid), points_world) / self.step).astype(np.int64)

    def centres(self, which: NDArray[np.bool_]) -> Array:
        """Centres (N, 3), in the world, of the voxels marked in `which` (X, Y, Z)."""
        return np.asarray(apply(self.T_world_grid, (np.argwhere(which) + 0.5) * self.step))

    def touched(self, body: Body, margin_m: float = 0.0) -> NDArray[np.bool_]:
        """Which voxels (X, Y, Z) come within margin_m of a body: its upright prism or, for other shapes, the box around it; a few more."""
        T = inverse(self.T_world_grid) @ body.T_world_body
        points = np.concatenate([apply(T, part) for part in convex_parts(body.shape)])
        low, high = points.min(0) - margin_m, points.max(0) + margin_m
        first = np.clip(np.floor(low / self.step), 0, self.state.shape).astype(int)
        last = np.clip(np.ceil(high / self.step), 0, self.state.shape).astype(int)
        out = np.zeros(self.state.shape, bool)
        x, y = ((np.arange(a, b) + 0.5) * s for a, b, s in zip(first[:2], last[:2], self.step))
        gx, gy = np.meshgrid(x, y, indexing="ij")
        out[first[0] : last[0], first[1] : last[1], first[2] : last[2]] = self._footprint(body, T, gx, gy, margin_m)[:, :, None]
        return out

    def _footprint(self, body: Body, T: Array, x: Array, y: Array, margin_m: float) -> NDArray[np.bool_]:
        """Which columns with centres x, y come within margin_m of a body at T in the grid that is upright, or a cylinder that lies; all
        for other bodies."""
        upright = abs(T[2, 2]) > 1 - 1e-6
        dx, dy, half = x - T[0, 3], y - T[1, 3], self.step[:2] / 2
        if upright and isinstance(body.shape, Cylinder):
            gap = np.hypot(np.maximum(np.abs(dx) - half[0], 0), np.maximum(np.abs(dy) - half[1], 0))
            return np.asarray(gap < body.shape.radius_m + margin_m)
        sides: Sequence[tuple[Array, float]] = ()  # separating axes; those of the grid are the bounds that the caller has cut to
        if upright and isinstance(body.shape, Box):
            sides = [(T[:2, a], float(body.shape.half[a])) for a in range(2)]
        elif isinstance(body.shape, Cylinder) and is_level(T):
            sides = [(T[:2, 2], body.shape.height_m / 2), (np.array([-T[1, 2], T[0, 2]]), body.shape.radius_m)]
        inside = np.ones(x.shape, bool)
        for axis, most in sides:
            reach = most + margin_m + abs(axis[0]) * half[0] + abs(axis[1]) * half[1]
            inside &= np.abs(dx * axis[0] + dy * axis[1]) < reach
        return inside

    def marked(self, which: NDArray[np.bool_], state: int) -> Voxels:
        """The map with the voxels in `which` (X, Y, Z) set to a state, from other knowledge than a picture: what an arm has moved."""
        return replace(self, state=np.where(which, np.uint8(state), self.state))

    def blocked(self, bodies: Sequence[Body] = (), margin_m: float = 0.0) -> NDArray[np.bool_]:
        """The voxels (X, Y, Z) that no motion may enter: not free, and not explained by one of `bodies`, which stand for themselves."""
        out = self.state != FREE
        for body in bodies:
            out &= ~self.touched(body, margin_m)
        return np.asarray(out)

    def ranges(self, which: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Few boxes (N, 6) that together fill just the voxels in `which` (X, Y, Z): the first voxel and the one after the last."""
        out = np.empty((MOST_BOXES, 6), np.int64)
        n = cover_with_boxes(np.ascontiguousarray(which, np.uint8), out)
        if n < 0:
            raise ValueError(f"more than {MOST_BOXES} boxes are needed around what is unknown: the voxels are too small")
        return out[:n]

    def boxes(self, which: NDArray[np.bool_], name: str = "unknown") -> tuple[Body, ...]:
        """Few boxes that together fill just the voxels in `which` (X, Y, Z): obstacles, called unknown_0, unknown_1, …"""
        out = self.ranges(which)
        low, high = out[:, :3] * self.step, out[:, 3:] * self.step
        T = [self.T_world_grid @ transform(p=p) for p in (low + high) / 2]
        return tuple(Body(f"{name}_{i}", Box(size), T[i]) for i, size in enumerate(high - low))


def unknown_voxels(cabinet: Cabinet, voxel_m: float = VOXEL_M) -> Voxels:
    """A map in which nothing is known yet. Raises ValueError when a voxel is not smaller than the cabinet."""
    if not 0 < voxel_m < float(min(cabinet.size_m)):
        raise ValueError(f"a voxel of {voxel_m} m does not fit into a cabinet of {' × '.join(f'{s:g}' for s in cabinet.size_m)} m")
    shape = np.ceil(cabinet.size_m / voxel_m - 1e-9).astype(int)
    return Voxels(cabinet, np.full(shape, UNKNOWN, np.uint8))


__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "VOXEL_M", "Voxels", "unknown_voxels"]
