"""The compiled inner loops of the map: what one depth image proves about voxels, what a view would reveal, boxes around what is not free.

The grid's frame is the cabinet's, moved so that voxel (0, 0, 0) begins at the origin; `step` (3,) are a voxel's edges. `T` (3, 4) takes
points of the grid's frame to the camera's. States are UNKNOWN, FREE and OCCUPIED.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.jit.decorators import jit_entry, jit_inline, njit
from kinematics.jit.simd import WIDTH, largest, load, store
from kinematics.transforms import Array

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
States = NDArray[np.uint8]
Image = NDArray[np.float32]
Row = tuple[float, float, float, float]
Rows = tuple[Row, Row, Row]
_FAR, _MINUS, _U = np.float32(1e9), np.float32(-1), np.uint64
_NEAR = 0.02  # a voxel nearer than this to the camera's plane is not judged
_SLACK = 5e-4  # m that a ray must go on behind a voxel
LEVELS = 7  # windows of 1 to 64 pixels
_LEVEL = np.array([max(n.bit_length() - 1, 0) for n in range(1 << LEVELS)])  # the windows that fit into so many pixels
BLOCK = 4  # voxels that are judged at once where all are alike
CLEAR, HIDDEN, UNDECIDED = 0, 1, 2


@jit_inline
def way_through(x: float, y: float, R: Array, eye: Array, size: Array) -> tuple[float, float]:
    """The depths z at which the ray (x, y, 1) of the camera enters and leaves the inner space; it misses unless the first is less.

    R (3, 3), eye (3,): the camera in the grid's frame; size (3,): of the inner space.
    """
    enter, leave = 0.0, 1e9
    for a in range(3):
        enter, leave = _between(R[a, 0] * x + R[a, 1] * y + R[a, 2], eye[a], size[a], enter, leave)
    return enter, leave


@jit_inline
def _between(d: float, eye: float, size: float, enter: float, leave: float) -> tuple[float, float]:
    """The depths at which a ray that was inside from `enter` to `leave` is so along one more axis, where it starts at `eye` and moves by d
    per metre of depth; the inner space is from 0 to size there."""
    along = abs(d) > 1e-12
    t0, t1 = -eye / d, (size - eye) / d
    later, sooner = max(enter, min(t0, t1)), min(leave, max(t0, t1))
    beside = -1.0 if eye < 0.0 or eye > size else leave
    return later if along else enter, sooner if along else beside


@jit_entry
def clear_depth(
    depth: Image, fx: float, fy: float, cx: float, cy: float, R: Array, eye: Array, size: Array, slack_m: float, noise: float, out: Image
) -> None:
    """How far each pixel's ray is known to run freely through the inner space: `out` (H, W), z in the camera.

    R (3, 3), eye (3,): the camera in the grid's frame; size (3,): of the inner space, whose walls are known to be there. A depth that comes
    to within slack_m + noise · z² of the wall is the wall's, and the ray is clear all the way: far. 0 where nothing was measured.
    """
    for v in range(np.uint64(depth.shape[0])):  # unsigned: no look for negative indices, and many pixels at once
        y, a, b = (float(v) - cy) / fy, depth[v], out[v]
        for u in range(np.uint64(depth.shape[1])):
            x, z = (float(np.int64(u)) - cx) / fx, float(a[u])
            enter, leave = way_through(x, y, R, eye, size)
            never = leave <= enter  # this ray never meets the inner space
            wall = z > 0.0 and z >= leave - slack_m - noise * z * z
            b[u] = _FAR if never or wall else np.float32(max(z, 0.0))


def pyramid(levels: Image) -> None:
    """Fill levels (LEVELS, H, W) from the first one on: level l holds the least of the 2^l × 2^l pixels to the right of and below each."""
    _pyramid(levels.reshape(-1), *levels.shape)


@jit_entry
def _pyramid(levels: Image, n_levels: int, height: int, width: int) -> None:
    """See `pyramid`, of the flat array; `WIDTH` pixels at once."""
    for k in range(1, n_levels):
        half = 1 << (k - 1)
        count = width - 2 * half + 1
        for v in range(height - 2 * half + 1):
            a, out = ((k - 1) * height + v) * width, (k * height + v) * width
            for u in range(0, count, WIDTH):
                if count >= WIDTH:
                    i, o = _U(a + min(u, count - WIDTH)), _U(out + min(u, count - WIDTH))
                    x, y = load(levels, i) * _MINUS, load(levels, i + _U(half)) * _MINUS
                    z, t = load(levels, i + _U(half * width)) * _MINUS, load(levels, i + _U(half * width + half)) * _MINUS
                    store(levels, o, largest(largest(x, y), largest(z, t)) * _MINUS)
                else:
                    for w in range(u, count):
                        i = _U(a + w)
                        above = min(levels[i], levels[i + _U(half)])
                        levels[_U(out + w)] = min(above, min(levels[i + _U(half * width)], levels[i + _U(half * width + half)]))


@jit_inline
def _half_extents(step: Array, T: Array, out: Array) -> None:
    """Half the extents (3,) of a voxel along the camera's axes."""
    for r in range(3):
        out[r] = 0.5 * (abs(T[r, 0]) * step[0] + abs(T[r, 1]) * step[1] + abs(T[r, 2]) * step[2])


@jit_inline
def _image(
    a: float, b: float, c: float, half: Array, T: Array, fx: float, fy: float, cx: float, cy: float
) -> tuple[float, float, float, float, float]:
    """The rectangle of pixels around the image of a voxel, or a block of them, and the pixels next to it: first and last column, first and
    last row, whole numbers that may lie outside the picture; and its middle's depth. (a, b, c): its middle in the grid's frame. Without
    meaning for what is nearer than `_NEAR`.
    """
    z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
    x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
    y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
    near, far = 1.0 / max(z - half[2], _NEAR), 1.0 / max(z + half[2], _NEAR)
    u0 = np.floor(fx * min((x - half[0]) * near, (x - half[0]) * far) + cx)
    u1 = np.ceil(fx * max((x + half[0]) * near, (x + half[0]) * far) + cx)
    v0 = np.floor(fy * min((y - half[1]) * near, (y - half[1]) * far) + cy)
    v1 = np.ceil(fy * max((y + half[1]) * near, (y + half[1]) * far) + cy)
    return u0, u1, v0, v1, z


@jit_inline
def _least(u0: float, u1: float, v0: float, v1: float, levels: Image) -> float:
    """The least of the pixels of a rectangle, and maybe of some beside its shorter side; that of all there can be when it is too large, or
    not wholly within the picture."""
    n_levels, height, width = levels.shape
    nothing = -float(_FAR)
    if u0 < 0.0 or v0 < 0.0 or u1 > width - 1.0 or v1 > height - 1.0:
        return nothing
    n = int(max(u1 - u0, v1 - v0)) + 1
    if n >= 2 << (n_levels - 1):
        return nothing
    level = _LEVEL[n]
    w = 1 << level
    if w > width or w > height:
        return nothing
    left, right = min(int(u0), width - w), max(int(u1) - w + 1, 0)
    upper, lower = min(int(v0), height - w), max(int(v1) - w + 1, 0)
    image = levels[level]
    return float(min(min(image[upper, left], image[upper, right]), min(image[lower, left], image[lower, right])))


@jit_inline
def _wholly_clear(a: float, b: float, c: float, half: Array, T: Array, levels: Image, fx: float, fy: float, cx: float, cy: float) -> bool:
    """Whether all of a voxel's image lies on rays that are clear to beyond it: those of the rectangle around it and the pixels next to it,
    which must be within the picture. (a, b, c): its centre in the grid's frame.
    """
    u0, u1, v0, v1, z = _image(a, b, c, half, T, fx, fy, cx, cy)
    return bool(z - half[2] >= _NEAR and _least(u0, u1, v0, v1, levels) > z + half[2] + _SLACK)


@jit_inline
def _hidden(a: float, b: float, c: float, deep: float, P: Rows, levels: Image, fx: float, fy: float, cx: float, cy: float) -> bool:
    """Whether the ray through a voxel's centre alone says that it is not wholly clear: a quicker look than `_wholly_clear`. deep: half of
    how far a voxel reaches along the camera's z; P: the rows of T."""
    _, height, width = levels.shape
    (x0, x1, x2, x3), (y0, y1, y2, y3), (z0, z1, z2, z3) = P
    z = z0 * a + z1 * b + z2 * c + z3
    if z - deep < _NEAR:
        return True
    x = x0 * a + x1 * b + x2 * c + x3
    y = y0 * a + y1 * b + y2 * c + y3
    u, v = fx * x / z + cx, fy * y / z + cy
    if not (0.0 <= u < width and 0.0 <= v < height):
        return True
    return bool(levels[_U(0), _U(int(v)), _U(int(u))] <= z + deep + _SLACK)


@jit_inline
def _block(
    a: float, b: float, c: float, half: Array, T: Array, levels: Image, negated: Image, fx: float, fy: float, cx: float, cy: float
) -> int:
    """CLEAR or HIDDEN when each voxel of a block, `BLOCK` voxels wide, would be found so by itself; else UNDECIDED. half (3,): the block's.

    A voxel's pixels are among the block's, but for those beside its shorter side: so the block asks as far around as it is wide.
    """
    _, height, width = levels.shape
    u0, u1, v0, v1, z = _image(a, b, c, half, T, fx, fy, cx, cy)
    if z + half[2] < _NEAR:
        return HIDDEN
    if z - half[2] < _NEAR:
        return UNDECIDED
    if u1 < 0.0 or v1 < 0.0 or u0 > width - 1.0 or v0 > height - 1.0:
        return HIDDEN
    most = -_least(max(u0, 0.0), min(u1, width - 1.0), max(v0, 0.0), min(v1, height - 1.0), negated)
    if most <= z - half[2]:
        return HIDDEN
    n = max(u1 - u0, v1 - v0) + 1.0
    return CLEAR if _least(u0 - n, u1 + n, v0 - n, v1 + n, levels) > z + half[2] + _SLACK else UNDECIDED


@jit_inline
def _look_up(state: States, i0: int, j0: int, column: States) -> None:
    """Whether any voxel of the column of blocks that begins at (i0, j0) is not FREE yet, layer by layer: column (Z,), 0 where all are."""
    for k in range(_U(column.shape[0])):
        column[k] = 0
    for i in range(_U(i0), _U(min(i0 + BLOCK, state.shape[0]))):
        for j in range(_U(j0), _U(min(j0 + BLOCK, state.shape[1]))):
            row = state[i, j]
            for k in range(_U(column.shape[0])):
                column[k] |= row[k] ^ np.uint8(FREE)


@jit_inline
def _asked(column: States, k0: int) -> bool:
    """Whether any voxel of the block that begins in layer k0 of a column is not FREE yet."""
    asked = False
    for k in range(_U(k0), _U(min(k0 + BLOCK, column.shape[0]))):
        asked = asked or column[k] != 0
    return asked


@jit_entry
def mark_free(
    state: States, step: Array, T: Array, levels: Image, negated: Image, fx: float, fy: float, cx: float, cy: float, work: Array,
    column: States,
) -> None:  # fmt: skip
    """Mark every voxel FREE that is wholly clear in a picture; levels: its `pyramid`; negated: that of the negated picture; work (2, 3),
    column (Z,): scratch."""
    half, block = work[0], work[1]
    _half_extents(step, T, half)
    for r in range(3):
        block[r] = BLOCK * half[r]
    X, Y, Z = state.shape
    (sx, sy, sz), deep = (step[0], step[1], step[2]), half[2]
    P = ((T[0, 0], T[0, 1], T[0, 2], T[0, 3]), (T[1, 0], T[1, 1], T[1, 2], T[1, 3]), (T[2, 0], T[2, 1], T[2, 2], T[2, 3]))
    for i0 in range(0, X, BLOCK):
        for j0 in range(0, Y, BLOCK):
            _look_up(state, i0, j0, column)
            for k0 in range(0, Z, BLOCK):
                if not _asked(column, k0):
                    continue
                a, b, c = (i0 + 0.5 * BLOCK) * step[0], (j0 + 0.5 * BLOCK) * step[1], (k0 + 0.5 * BLOCK) * step[2]
                said = _block(a, b, c, block, T, levels, negated, fx, fy, cx, cy)
                if said == HIDDEN:
                    continue
                for i in range(_U(i0), _U(min(i0 + BLOCK, X))):
                    for j in range(_U(j0), _U(min(j0 + BLOCK, Y))):
                        row, a, b = state[i, j], (float(np.int64(i)) + 0.5) * sx, (float(np.int64(j)) + 0.5) * sy
                        for k in range(_U(k0), _U(min(k0 + BLOCK, Z))):
                            if said == CLEAR:
                                row[k] = FREE
                            elif row[k] != FREE:
                                c = (float(np.int64(k)) + 0.5) * sz
                                hidden = _hidden(a, b, c, deep, P, levels, fx, fy, cx, cy)
                                if not hidden and _wholly_clear(a, b, c, half, T, levels, fx, fy, cx, cy):
                                    row[k] = FREE


@jit_entry
def mark_occupied(state: States, step: Array, clear: Image, fx: float, fy: float, cx: float, cy: float, R: Array, eye: Array) -> None:
    """Mark every voxel OCCUPIED in which a ray ends; `clear` as `clear_depth` gives it."""
    height, width = clear.shape
    for v in range(height):
        y = (v - cy) / fy
        for u in range(width):
            z = clear[v, u]
            if z <= 0.0 or z >= _FAR:
                continue
            x = (u - cx) / fx
            i = int(np.floor((eye[0] + z * (R[0, 0] * x + R[0, 1] * y + R[0, 2])) / step[0]))
            j = int(np.floor((eye[1] + z * (R[1, 0] * x + R[1, 1] * y + R[1, 2])) / step[1]))
            k = int(np.floor((eye[2] + z * (R[2, 0] * x + R[2, 1] * y + R[2, 2])) / step[2]))
            if 0 <= i < state.shape[0] and 0 <= j < state.shape[1] and 0 <= k < state.shape[2]:
                state[i, j, k] = OCCUPIED


def hidden_layers(state: States, step: Array, T_grid_world: Array, low: Array, high: Array, axis: int, side: int, most: int) -> int:
    """How many layers of voxels, `most` at most, beside one face of a box of the world hide what is in them; 0 for two or fewer.

    low, high (3,): the box's corners. The face is that across `axis` at its low or high end, side -1 or 1. A layer hides nothing when it
    leaves the grid, when a fifth of it is FREE, or, beyond the first, when half of it is OCCUPIED. T_grid_world (4, 4).
    """
    return int(_hidden_layers(state, step, T_grid_world, low, high, axis, side, most, np.empty(3), np.empty(3, np.int64)))


@jit_entry
def _hidden_layers(
    state: States, step: Array, T_grid_world: Array, low: Array, high: Array, axis: int, side: int, most: int, x: Array, v: Int
) -> int:
    thickness, T = max(step[0], step[1], step[2]), T_grid_world
    p, q = (axis + 1) % 3, (axis + 2) % 3
    n_p = max(int(np.ceil(2 * (high[p] - low[p]) / thickness)), 3)
    n_q = max(int(np.ceil(2 * (high[q] - low[q]) / thickness)), 3)
    for layer in range(max(most, 3)):
        x[axis] = (high[axis] if side > 0 else low[axis]) + side * (layer + 0.5) * thickness
        free, occupied, inside = 0, 0, True
        for i in range(1, n_p):
            x[p] = low[p] + i * ((high[p] - low[p]) / n_p)
            for j in range(1, n_q):
                x[q] = low[q] + j * ((high[q] - low[q]) / n_q)
                for r in range(3):
                    v[r] = int(np.floor((T[r, 0] * x[0] + T[r, 1] * x[1] + T[r, 2] * x[2] + T[r, 3]) / step[r]))
                    inside = inside and 0 <= v[r] < state.shape[r]
                if inside:
                    free += state[v[0], v[1], v[2]] == FREE
                    occupied += state[v[0], v[1], v[2]] == OCCUPIED
        total = (n_p - 1) * (n_q - 1)
        if not inside or free / total >= 0.2 or (layer > 0 and occupied / total >= 0.5):
            return layer if layer > 2 else 0
    return most


@jit_entry
def through_wall(size: Array, fx: float, fy: float, cx: float, cy: float, R: Array, eye: Array, out: NDArray[np.bool_]) -> None:
    """Which pixels (H, W) look into the inner space through a wall: from outside, and not through the front. R, eye: as above."""
    height, width = out.shape
    for v in range(height):
        y = (v - cy) / fy
        for u in range(width):
            x = (u - cx) / fx
            enter, leave = way_through(x, y, R, eye, size)
            out[v, u] = leave > enter and enter > 0.0 and eye[0] + enter * (R[0, 0] * x + R[0, 1] * y + R[0, 2]) > 1e-6


@njit(cache=True, nogil=True)
def map_depth(
    occupied: Array, step: Array, fx: float, fy: float, cx: float, cy: float, T: Array, blind: NDArray[np.bool_], least: float, out: Image
) -> None:
    """A depth image (H, W) of the occupied voxels, given by their centres (N, 3): their far sides; far where there is none.

    0 where nothing would be learnt: where `blind` (H, W) is True, or where something is nearer than `least`, the camera's least depth.
    """
    height, width = out.shape
    for v in range(height):
        for u in range(width):
            out[v, u] = np.float32(0.0) if blind[v, u] else _FAR
    half = np.empty(3)
    _half_extents(step, T, half)
    for i in range(occupied.shape[0]):
        a, b, c = occupied[i, 0], occupied[i, 1], occupied[i, 2]
        z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
        if z < _NEAR:
            continue
        x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
        y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
        by = 1.0 / z
        u0 = int(max(np.ceil(fx * (x - half[0]) * by + cx), 0.0))
        u1 = int(min(np.floor(fx * (x + half[0]) * by + cx), width - 1.0))
        v0 = int(max(np.ceil(fy * (y - half[1]) * by + cy), 0.0))
        v1 = int(min(np.floor(fy * (y + half[1]) * by + cy), height - 1.0))
        far = np.float32(z + half[2]) if z >= least else np.float32(0.0)
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                out[v, u] = min(out[v, u], far)


@njit(cache=True, nogil=True)
def revealed(
    rows: Int, points: Array, step: Array, T: Array, levels: Image, fx: float, fy: float, cx: float, cy: float, seen: States
) -> None:
    """Leave 1 in `seen` (P,) only for those of `rows` (N,), with centres `points` (N, 3), that a picture would mark FREE.

    levels: the `pyramid` of the map's depth image. Places whose `seen` is 0 are not asked about, those beyond `rows` stay as they are.
    """
    half = np.empty(3)
    _half_extents(step, T, half)
    for i in range(rows.shape[0]):
        if seen[rows[i]]:
            seen[rows[i]] = _wholly_clear(points[i, 0], points[i, 1], points[i, 2], half, T, levels, fx, fy, cx, cy)


@njit(cache=True, nogil=True)
def revealed_at_most(rows: Int, points: Array, T: Array, depth: Image, fx: float, fy: float, cx: float, cy: float, seen: States) -> None:
    """Whether rows (N,) of `seen` (P,), with centres `points` (N, 3), are inside a picture and before its depth (H, W).

    Quick, and seldom too few.
    """
    height, width = depth.shape
    for i in range(rows.shape[0]):
        seen[rows[i]] = 0
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
        if z < _NEAR:
            continue
        u = fx * (T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]) / z + cx
        v = fy * (T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]) / z + cy
        if u < -0.5 or v < -0.5 or u >= width - 0.5 or v >= height - 0.5:
            continue
        if z < depth[int(np.floor(v + 0.5)), int(np.floor(u + 0.5))]:
            seen[rows[i]] = 1


@njit(cache=True, nogil=True)
def weigh(rows: Int, weight: Array, seen: States, out: Array) -> None:
    """For each view (C,) the summed weight (N,) of those of `rows` (N,) that it has seen; seen (C, P)."""
    for c in range(seen.shape[0]):
        total = 0.0
        for i in range(rows.shape[0]):
            total += weight[i] * seen[c, rows[i]]
        out[c] = total


@njit(cache=True, nogil=True)
def merge(blocked: States, out: Int) -> int:
    """Cover the blocked voxels (X, Y, Z) with boxes, rows [x0, y0, z0, x1, y1, z1) of `out` (N, 6).

    Returns how many, or -1 if N is too few.

    Greedy: from the first voxel that is not covered yet a box is grown along the three axes, in each of the six orders, over blocked
    voxels, covered or not; the box that covers most that is new is taken.
    """
    X, Y, Z = blocked.shape
    done = np.zeros((X, Y, Z), np.uint8)
    orders = np.array([[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
    low, high, best = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(6, np.int64)
    shape = np.array([X, Y, Z])
    n = 0
    for i in range(X):
        for j in range(Y):
            for k in range(Z):
                if not blocked[i, j, k] or done[i, j, k]:
                    continue
                most = -1
                for o in range(6):
                    low[0], low[1], low[2] = i, j, k
                    high[0], high[1], high[2] = i + 1, j + 1, k + 1
                    for p in range(3):
                        axis = orders[o, p]
                        for side in range(2):
                            while True:
                                at = high[axis] if side == 0 else low[axis] - 1
                                if at < 0 or at >= shape[axis] or not _slice_blocked(blocked, low, high, axis, at):
                                    break
                                if side == 0:
                                    high[axis] += 1
                                else:
                                    low[axis] -= 1
                    fresh = 0
                    for x in range(low[0], high[0]):
                        for y in range(low[1], high[1]):
                            for z in range(low[2], high[2]):
                                fresh += 1 - done[x, y, z]
                    if fresh > most:
                        most = fresh
                        best[:3], best[3:] = low, high
                if n == out.shape[0]:
                    return -1
                out[n] = best
                n += 1
                done[best[0] : best[3], best[1] : best[4], best[2] : best[5]] = 1
    return n


@njit(cache=True, nogil=True)
def _slice_blocked(blocked: States, low: Int, high: Int, axis: int, at: int) -> bool:
    """Whether the layer `at` next to a box along an axis is blocked throughout."""
    x0, x1, y0, y1, z0, z1 = low[0], high[0], low[1], high[1], low[2], high[2]
    if axis == 0:
        x0, x1 = at, at + 1
    elif axis == 1:
        y0, y1 = at, at + 1
    else:
        z0, z1 = at, at + 1
    for x in range(x0, x1):
        for y in range(y0, y1):
            for z in range(z0, z1):
                if not blocked[x, y, z]:
                    return False
    return True
