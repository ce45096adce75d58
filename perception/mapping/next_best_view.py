"""Views: from where a camera may look into a cabinet, and how much unknown space it would reveal there.

What a view reveals is found in the map itself: a coarse depth image up to the first occupied voxel, unknown ones taken for free, and the
unknown voxels before that depth. Knowing more never makes a view reveal more: what is left of the voxels that it would have revealed when
it was last looked at bounds its gain, and only the few views at the top need to be looked at anew (lazy greedy choice; Minoux 1978).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Cabinet
from kinematics.transforms import Array, inverse, rotation_about
from perception.camera import Intrinsics, look_at
from perception.mapping.carving import LEVELS, pyramid, through_wall
from perception.mapping.revealed import map_depth, revealed, revealed_at_most, weigh
from perception.mapping.voxels import OCCUPIED, UNKNOWN, Voxels

FINE, COARSE = 4, 3  # pixels of the camera, in each direction, for one of the preview; pixels of the preview for one of its first guess
SPARSE = 5  # one voxel in so many is counted
STALE = 0.5  # what a voxel still counts when a view that should have shown it did not
ROLLS = ((0.0, 0.6), (np.pi, 0.2), (np.pi / 2, 0.1), (-np.pi / 2, 0.1))
_ROLLED = [rotation_about((0.0, 0.0, 1.0), turn) for turn, _ in ROLLS]
_UP_TO = np.cumsum([chance for _, chance in ROLLS])


def sample_poses(cabinet: Cabinet, n: int, rng: np.random.Generator) -> Array:
    """Camera poses T_world_camera (n, 4, 4) before and inside the cabinet, looking into it, most of them upright."""
    depth, width, height = cabinet.size_m
    out = np.empty((n, 4, 4))
    for i in range(n):
        x = rng.uniform(-0.35, 0.6 * depth)
        inside = x > 0
        y = rng.uniform(-0.45, 0.45) * width if inside else rng.uniform(-0.65, 0.65) * width
        z = rng.uniform(0.3, 0.95) * height if inside else rng.uniform(0.15, 1.25) * height
        at = np.array([rng.uniform(max(x + 0.05, 0.0), depth), rng.uniform(-0.5, 0.5) * width, rng.uniform(0.0, 0.7) * height])
        T = look_at(np.array([x, y, z]), at)
        T[:3, :3] = T[:3, :3] @ _ROLLED[int((_UP_TO / _UP_TO[-1]).searchsorted(rng.random(), side="right"))]
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


@dataclass(frozen=True, eq=False)
class ViewCandidates:
    """Views of one cabinet, and what the preview knows of them whatever stands in it; see `make_view_candidates`.

    T (C, 3, 4): from the map's grid to the camera. fine, coarse: the cameras of the preview and of its first guess.
    blind, blind_coarse (C, h, w): the pixels that teach nothing, because the robot itself or a wall is in the way.
    """

    T: Array
    fine: Intrinsics
    coarse: Intrinsics
    blind: NDArray[np.bool_]
    blind_coarse: NDArray[np.bool_]


def make_view_candidates(voxels: Voxels, poses: Array, intrinsics: Intrinsics, own: NDArray[np.bool_]) -> ViewCandidates:
    """What can be told beforehand of views from poses (C, 4, 4) into a cabinet, of which any map will do.

    own (C, h, w): where the robot itself is in each picture, of the size of `reduced(intrinsics)`.
    """
    fine, coarse = reduced(intrinsics), reduced(intrinsics, FINE * COARSE)
    T_grid_camera = inverse(voxels.T_world_grid) @ poses
    blind = np.empty(own.shape, bool)
    for T, out in zip(T_grid_camera, blind):
        through_wall(voxels.cabinet.size_m, *_pinhole(fine), np.ascontiguousarray(T[:3, :3]), T[:3, 3].copy(), out)
    blind |= own
    rows, columns = coarse.height * COARSE, coarse.width * COARSE
    squares = blind[:, :rows, :columns].reshape(-1, coarse.height, COARSE, coarse.width, COARSE)
    return ViewCandidates(np.ascontiguousarray(inverse(T_grid_camera)[:, :3]), fine, coarse, blind, np.asarray(squares.all((2, 4))))


class _Moment(NamedTuple):
    """The map as the views of one choice see it: unknown voxels that count (rows, centres, weights), centres of occupied ones."""

    rows: NDArray[np.int64]
    points: Array
    weight: Array
    occupied: Array


class InformationGain:
    """What views would reveal of a map of their cabinet. The weights and bounds it keeps are for maps that come to know more and more.

    least_m: the camera's least depth. focus (X, Y, Z): what voxels count besides their own share of the space, in the same unit.
    """

    def __init__(self, voxels: Voxels, views: ViewCandidates, least_m: float, focus: Array | None = None) -> None:
        self.views, self.least_m, self.step = views, least_m, voxels.step
        i, j, k = np.indices(voxels.state.shape)
        sparse = (i + 2 * j + 3 * k) % SPARSE == 0
        self.unit = 1.0 / np.count_nonzero(sparse)  # what one of the sparse voxels stands for, as a share of the space
        extra = np.zeros(sparse.shape) if focus is None else focus
        self.places = np.argwhere(sparse | (extra > 0))
        self.weight = (sparse + extra / self.unit)[tuple(self.places.T)]
        # which places each view would reveal when it was last looked at, more than it would reveal now
        self.seen = np.ones((len(views.T), len(self.places)), np.uint8)
        self.guessed = False
        self._levels = np.empty((LEVELS, views.fine.height, views.fine.width), np.float32)

    def best(self, voxels: Voxels, cost: Array, usable: Callable[[int], bool], least: float = 0.0) -> tuple[int, float] | None:
        """The view with the greatest gain less its cost (C,), among the usable ones that would reveal at least the share `least` of the
        space, and its gain, that share; None when there is none. usable is asked as late as possible, about the views that come to the top.
        """
        now = self._moment(voxels)
        if not self.guessed:
            self._guess(now)
        bound = np.empty(len(cost))
        weigh(now.rows, now.weight, self.seen, bound)
        bound *= self.unit
        fresh, barred = np.zeros(len(cost), bool), np.isinf(cost)
        while not barred.all():
            i = int(np.argmax(np.where(barred, -np.inf, bound - cost)))
            if bound[i] < least:
                barred[i] = True  # its cost is low, but it is not worth taking
            elif not fresh[i]:
                bound[i], fresh[i] = self._gain(now, i), True
            elif usable(i):
                return i, float(bound[i])
            else:
                barred[i] = True
        return None

    def taken(self, voxels: Voxels, index: int) -> None:
        """View number `index` was taken, and `voxels` is the map with it: what it should have shown and did not counts less from now on."""
        now = self._moment(voxels)
        self._gain(now, index)
        self.weight[now.rows[self.seen[index, now.rows] > 0]] *= STALE

    def _moment(self, voxels: Voxels) -> _Moment:
        rows = np.flatnonzero(voxels.state[tuple(self.places.T)] == UNKNOWN)
        occupied = (np.argwhere(voxels.state == OCCUPIED) + 0.5) * self.step
        return _Moment(rows, (self.places[rows] + 0.5) * self.step, self.weight[rows], occupied)

    def _gain(self, now: _Moment, index: int) -> float:
        """The share of the space that a view would reveal; `seen` says which places."""
        camera, T, seen = self.views.fine, self.views.T[index], self.seen[index]
        map_depth(now.occupied, self.step, *_pinhole(camera), T, self.views.blind[index], self.least_m, self._levels[0])
        pyramid(self._levels)
        revealed(now.rows, now.points, self.step, T, self._levels, *_pinhole(camera), seen)
        return float(now.weight @ seen[now.rows]) * self.unit

    def _guess(self, now: _Moment) -> None:
        """Strike out what views can't reveal, roughly."""
        camera = self.views.coarse
        depth = np.empty((camera.height, camera.width), np.float32)
        for T, blind, seen in zip(self.views.T, self.views.blind_coarse, self.seen):
            map_depth(now.occupied, self.step, *_pinhole(camera), T, blind, self.least_m, depth)
            revealed_at_most(now.rows, now.points, T, depth, *_pinhole(camera), seen)
        self.guessed = True


def _pinhole(camera: Intrinsics) -> tuple[float, float, float, float]:
    return camera.fx, camera.fy, camera.cx, camera.cy


def reduced(camera: Intrinsics, k: int = FINE) -> Intrinsics:
    """A camera with k × k pixels in one; what is left over at the right and below is cut off."""
    shift = (k - 1) / 2
    return Intrinsics(camera.width // k, camera.height // k, camera.fx / k, camera.fy / k, (camera.cx - shift) / k, (camera.cy - shift) / k)
