"""Free-space carving, compiled: what one depth image proves about voxels.

The grid's frame is the cabinet's, moved so that voxel (0, 0, 0) begins at the origin; `step` (3,) are a voxel's edges. `T` (3, 4) takes
points of the grid's frame to the camera's. States are UNKNOWN, FREE and OCCUPIED.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.jit.simd import WIDTH, largest, load, store
from kinematics.transforms import Array

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
States = NDArray[np.uint8]
Image = NDArray[np.float32]
Row = tuple[float, float, float, float]
Rows = tuple[Row, Row, Row]
FAR, _MINUS, _U = np.float32(1e9), np.float32(-1), np.uint64
NEAR = 0.02  # a voxel nearer than this to the camera's plane is not judged
_SLACK = 5e-4  # m that a ray must go on behind a voxel
LEVELS = 7  # windows of 1 to 64 pixels
_LEVEL = np.array([max(n.bit_length() - 1, 0) for n in range(1 << LEVELS)])  # the windows that fit into so many pixels
BLOCK = 4  # voxels that are judged at once where all are alike
CLEAR, HIDDEN, UNDECIDED = 0, 1, 2


@jit_inline
def ray_through(x: float, y: float, R: Array, eye: Array, size: Array) -> tuple[float, float]:
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
            enter, leave = ray_through(x, y, R, eye, size)
            never = leave <= enter  # this ray never meets the inner space
            wall = z > 0.0 and z >= leave - slack_m - noise * z * z
            b[u] = FAR if never or wall else np.float32(max(z, 0.0))


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
def half_extents(step: Array, T: Array, out: Array) -> None:
    """Half the extents (3,) of a voxel along the camera's axes."""
    for r in range(3):
        out[r] = 0.5 * (abs(T[r, 0]) * step[0] + abs(T[r, 1]) * step[1] + abs(T[r, 2]) * step[2])


@jit_inline
def _image(
    a: float, b: float, c: float, half: Array, T: Array, fx: float, fy: float, cx: float, cy: float
) -> tuple[float, float, float, float, float]:
    """The rectangle of pixels around the image of a voxel, or a block of them, and the pixels next to it: first and last column, first and
    last row, whole numbers that may lie outside the picture; and its middle's depth. (a, b, c): its middle in the grid's frame. Without
    meaning for what is nearer than `NEAR`.
    """
    z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
    x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
    y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
    near, far = 1.0 / max(z - half[2], NEAR), 1.0 / max(z + half[2], NEAR)
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
    nothing = -float(FAR)
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
def wholly_clear(a: float, b: float, c: float, half: Array, T: Array, levels: Image, fx: float, fy: float, cx: float, cy: float) -> bool:
    """Whether all of a voxel's image lies on rays that are clear to beyond it: those of the rectangle around it and the pixels next to it,
    which must be within the picture. (a, b, c): its centre in the grid's frame.
    """
    u0, u1, v0, v1, z = _image(a, b, c, half, T, fx, fy, cx, cy)
    return bool(z - half[2] >= NEAR and _least(u0, u1, v0, v1, levels) > z + half[2] + _SLACK)


@jit_inline
def _hidden(a: float, b: float, c: float, deep: float, P: Rows, levels: Image, fx: float, fy: float, cx: float, cy: float) -> bool:
    """Whether the ray through a voxel's centre alone says that it is not wholly clear: a quicker look than `wholly_clear`. deep: half of
    how far a voxel reaches along the camera's z; P: the rows of T."""
    _, height, width = levels.shape
    (x0, x1, x2, x3), (y0, y1, y2, y3), (z0, z1, z2, z3) = P
    z = z0 * a + z1 * b + z2 * c + z3
    if z - deep < NEAR:
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
    if z + half[2] < NEAR:
        return HIDDEN
    if z - half[2] < NEAR:
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
    half_extents(step, T, half)
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
                                if not hidden and wholly_clear(a, b, c, half, T, levels, fx, fy, cx, cy):
                                    row[k] = FREE


@jit_entry
def mark_occupied(state: States, step: Array, clear: Image, fx: float, fy: float, cx: float, cy: float, R: Array, eye: Array) -> None:
    """Mark every voxel OCCUPIED in which a ray ends; `clear` as `clear_depth` gives it."""
    height, width = clear.shape
    for v in range(height):
        y = (v - cy) / fy
        for u in range(width):
            z = clear[v, u]
            if z <= 0.0 or z >= FAR:
                continue
            x = (u - cx) / fx
            i = int(np.floor((eye[0] + z * (R[0, 0] * x + R[0, 1] * y + R[0, 2])) / step[0]))
            j = int(np.floor((eye[1] + z * (R[1, 0] * x + R[1, 1] * y + R[1, 2])) / step[1]))
            k = int(np.floor((eye[2] + z * (R[2, 0] * x + R[2, 1] * y + R[2, 2])) / step[2]))
            if 0 <= i < state.shape[0] and 0 <= j < state.shape[1] and 0 <= k < state.shape[2]:
                state[i, j, k] = OCCUPIED


@jit_entry
def through_wall(size: Array, fx: float, fy: float, cx: float, cy: float, R: Array, eye: Array, out: NDArray[np.bool_]) -> None:
    """Which pixels (H, W) look into the inner space through a wall: from outside, and not through the front. R, eye: as above."""
    height, width = out.shape
    for v in range(height):
        y = (v - cy) / fy
        for u in range(width):
            x = (u - cx) / fx
            enter, leave = ray_through(x, y, R, eye, size)
            out[v, u] = leave > enter and enter > 0.0 and eye[0] + enter * (R[0, 0] * x + R[0, 1] * y + R[0, 2]) > 1e-6
