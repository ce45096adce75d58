"""Views: from where a camera may look into a cabinet, and how much unknown space it would reveal there.

What a view reveals is found in the map itself: a coarse depth image up to the first occupied voxel, unknown ones taken for free, and the
unknown voxels before that depth. Knowing more never makes a view reveal more, so a view's last figure bounds its next one, and only the
few views at the top need to be looked at anew (lazy greedy choice; Minoux 1978).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Cabinet
from kinematics.transforms import Array, inverse, rotation_about
from perception import grid
from perception.camera import Intrinsics, look_at
from perception.voxels import OCCUPIED, UNKNOWN, Voxels

FINE, COARSE = 4, 3  # pixels of the camera, in each direction, for one of the preview; pixels of the preview for one of its first guess
SPARSE = 5  # one voxel in so many is counted
STALE = 0.5  # what a voxel still counts when a view that should have shown it did not
ROLLS = ((0.0, 0.6), (np.pi, 0.2), (np.pi / 2, 0.1), (-np.pi / 2, 0.1))


def sample_poses(cabinet: Cabinet, n: int, rng: np.random.Generator) -> Array:
    """Camera poses T_world_camera (n, 4, 4) before and inside the cabinet, looking into it, most of them upright."""
    depth, width, height = cabinet.size_m
    out = np.empty((n, 4, 4))
    turns, chances = zip(*ROLLS)
    for i in range(n):
        x = rng.uniform(-0.35, 0.6 * depth)
        inside = x > 0
        y = rng.uniform(-0.45, 0.45) * width if inside else rng.uniform(-0.65, 0.65) * width
        z = rng.uniform(0.3, 0.95) * height if inside else rng.uniform(0.15, 1.25) * height
        at = np.array([rng.uniform(max(x + 0.05, 0.0), depth), rng.uniform(-0.5, 0.5) * width, rng.uniform(0.0, 0.7) * height])
        T = look_at(np.array([x, y, z]), at)
        T[:3, :3] = T[:3, :3] @ rotation_about((0.0, 0.0, 1.0), float(rng.choice(turns, p=chances)))
        out[i] = cabinet.T_world_cabinet @ T
    return out


def sweep_poses(cabinet: Cabinet) -> Array:
    """A fixed sweep (15, 4, 4): across the front at three heights, from left to right and back, each looking straight in and a bit down."""
    _, width, height = cabinet.size_m
    out = []
    for row, z in enumerate((0.6, 0.95, 0.35)):
        for y in np.array([0.4, 0.2, 0.0, -0.2, -0.4]) * (1 if row % 2 == 0 else -1):
            eye = np.array([-0.12, y * width, z * height])
            out.append(cabinet.T_world_cabinet @ look_at(eye, eye + np.array([1.0, 0.0, -0.35])))
    return np.array(out)


class _Moment(NamedTuple):
    """The map as the views of one choice see it: unknown voxels that count (rows, centres, weights), centres of occupied ones."""

    voxels: Voxels
    rows: NDArray[np.int64]
    points: Array
    weight: Array
    occupied: Array
    T_grid_world: Array


class Preview:
    """What views would reveal of a map. The bounds and weights it keeps belong to one cabinet and one list of poses.

    poses (C, 4, 4): T_world_camera. own (C, h, w): where the robot's own body is in each picture, of the size of `reduced(intrinsics)`.
    least_m: the camera's least depth. focus (X, Y, Z): what voxels count besides their own share of the space, in the same unit.
    """

    def __init__(
        self,
        voxels: Voxels,
        poses: Array,
        intrinsics: Intrinsics,
        own: NDArray[np.bool_],
        least_m: float,
        focus: Array | None = None,
    ) -> None:
        self.poses, self.least_m, self.own = poses, least_m, own
        self.fine, self.coarse = reduced(intrinsics), reduced(intrinsics, FINE * COARSE)
        i, j, k = np.indices(voxels.state.shape)
        sparse = (i + 2 * j + 3 * k) % SPARSE == 0
        self.unit = 1.0 / np.count_nonzero(sparse)  # what one of the sparse voxels stands for, as a share of the space
        extra = np.zeros(sparse.shape) if focus is None else focus
        self.places = np.argwhere(sparse | (extra > 0))
        self.weight = (sparse + extra / self.unit)[tuple(self.places.T)]
        self.bound: Array | None = None

    def best(self, voxels: Voxels, cost: Array, usable: Callable[[int], bool]) -> tuple[int, float] | None:
        """The view with the greatest gain less its cost (C,), among the usable ones, and its gain, the share of the space that it would
        reveal; None when there is none. usable is asked as late as possible, about the views that come to the top.
        """
        now = self._moment(voxels)
        if self.bound is None:
            self.bound = np.array([self._at_most(now, i) for i in range(len(self.poses))])
        fresh, barred = np.zeros(len(self.poses), bool), np.zeros(len(self.poses), bool)
        while not barred.all():
            i = int(np.argmax(np.where(barred, -np.inf, self.bound - cost)))
            if not fresh[i]:
                self.bound[i], fresh[i] = self._gain(now, i)[0], True
            elif usable(i):
                return i, float(self.bound[i])
            else:
                barred[i] = True
        return None

    def taken(self, voxels: Voxels, index: int) -> None:
        """View number `index` was taken, and `voxels` is the map with it: what it should have shown and did not counts less from now on."""
        now = self._moment(voxels)
        _, seen = self._gain(now, index)
        self.weight[now.rows[seen.astype(bool)]] *= STALE

    def _moment(self, voxels: Voxels) -> _Moment:
        rows = np.flatnonzero(voxels.state[tuple(self.places.T)] == UNKNOWN)
        occupied = (np.argwhere(voxels.state == OCCUPIED) + 0.5) * voxels.step
        return _Moment(voxels, rows, (self.places[rows] + 0.5) * voxels.step, self.weight[rows], occupied, inverse(voxels.T_world_grid))

    def _gain(self, now: _Moment, index: int) -> tuple[float, grid.States]:
        depth, T, f = self._depth(now, index, self.fine, self.own[index])
        levels = np.zeros((grid.LEVELS, *depth.shape), np.float32)
        grid.pyramid(depth, levels)
        seen = np.empty(len(now.rows), np.uint8)
        total = grid.revealed(now.points, now.weight, now.voxels.step, T, levels, *f, seen)
        return float(total) * self.unit, seen

    def _at_most(self, now: _Moment, index: int) -> float:
        height, width, k = self.coarse.height, self.coarse.width, COARSE
        own = np.asarray(self.own[index, : height * k, : width * k].reshape(height, k, width, k).any((1, 3)))
        depth, T, f = self._depth(now, index, self.coarse, own)
        return float(grid.revealed_at_most(now.points, now.weight, T, depth, *f)) * self.unit

    def _depth(
        self, now: _Moment, index: int, camera: Intrinsics, own: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], Array, tuple[float, float, float, float]]:
        """The map's depth image (H, W), the way from the grid's frame to the camera's (3, 4), and fx, fy, cx, cy."""
        f = (camera.fx, camera.fy, camera.cx, camera.cy)
        T_grid_camera = now.T_grid_world @ self.poses[index]
        R, eye = np.ascontiguousarray(T_grid_camera[:3, :3]), T_grid_camera[:3, 3].copy()
        T = np.ascontiguousarray(np.c_[R.T, -R.T @ eye])
        depth = np.empty((camera.height, camera.width), np.float32)
        grid.map_depth(now.occupied, now.voxels.step, now.voxels.cabinet.size_m, *f, R, eye, T, own, self.least_m, depth)
        return depth, T, f


def reduced(camera: Intrinsics, k: int = FINE) -> Intrinsics:
    """A camera with k × k pixels in one; what is left over at the right and below is cut off."""
    shift = (k - 1) / 2
    return Intrinsics(camera.width // k, camera.height // k, camera.fx / k, camera.fy / k, (camera.cx - shift) / k, (camera.cy - shift) / k)
