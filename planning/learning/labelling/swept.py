"""The space that the arm sweeps along a path, kept as heights: how far down it comes above each small cell of the cabinet's floor.

Objects stand on the floor, so one touches the swept space where the arm comes lower than the object is tall: two dimensions say all.
Heights are those of the links' fine covers (kinematics.collision.covers.levels), which reach up to 5 mm beyond a link, taken at samples
between which a link moves by `SAMPLE_M`, on cells of `CELL_M`. So a verdict is that of the exact test with the object or the arm moved by a
cell: good for counting how many of many paths an object blocks, not for letting an arm loose.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Chain, Int, forward
from kinematics.collision.robot_model import link_covers
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.jit.simd import WIDTH, below, largest, load, root, store
from kinematics.robots.robot import Robot
from kinematics.shapes import Shape, convex_parts
from kinematics.transforms import Array, inverse

CELL_M = 0.01
SAMPLE_M = 0.02
_STEP_M = 0.02  # between places where a link may be drawn: when it has moved by SAMPLE_M since it was drawn last
_SURELY = 1.05  # how much faster a link may be than its joints' weights say
_SLOWEST_M = 1e-6  # what a link that stands still is taken to move in a step
_f, _U = np.float32, np.uint64
_ZERO, _ONE, _LARGE = _f(0), _f(1), _f(1e30)  # the last one's square is infinite
_ALONG = np.arange(WIDTH, dtype=np.float32)

F32 = NDArray[np.float32]


@record
class Balls(NamedTuple):
    """Balls that cover the moving links with the fingers at one opening: link p's are start[p]:start[p + 1], `WIDTH` by `WIDTH`.

    frame (P,): the chain's frame that carries the link; bound (P, 4): centre and radius of a ball around it; ball (4 · S,): all centres' x,
    y and z, and radii, which are negative of those that fill up the lanes; in that frame.
    """

    frame: Int
    bound: Array
    start: Int
    ball: F32


@record
class Floor(NamedTuple):
    """The cells: T_cabinet_world (4, 4), size (3,) of the inner space up to where it matters, number of cells (2,) along x and y and their
    edges (2,)."""

    T: Array
    size: Array
    n: Int
    cell: Array


@record
class _Scratch(NamedTuple):
    """Memory of a sweep. frames (K + 1, 4, 4); drawn (P, 3, 4): where each link was drawn last; spare, rate, due (P,): how far it may move
    before it need be looked at, how far it moves in a step, and after how many steps it may be due; q (J,); M (3, 4); along (WIDTH,): where
    the next cells along y are, metres; at (3 · WIDTH,): where balls are in the cabinet."""

    frames: Array
    drawn: Array
    spare: Array
    rate: Array
    due: Int
    q: Array
    M: Array
    along: F32
    at: F32


class Footprint(NamedTuple):
    """A standing object's shadow on the floor, about the middle of its box: where lines[:, :2] · (x, y) <= lines[:, 2], lines (E, 3); half
    the box's sides (2,); the object's height."""

    lines: Array
    half: Array
    height: float


def arm_balls(robot: Robot, T_world_base: Array, gripper: float) -> Balls:
    """The fine covers of all links that move, with the fingers at a gripper value."""
    carried = robot.frame_of_links(gripper, T_world_base)
    frames, bounds, balls = [], [], []
    for hull, cover in zip(robot.hulls, link_covers(robot)):
        frame, T = carried[hull.link]
        if frame == 0:
            continue  # the base stands still, before the cabinet
        centres = cover.fine.centres @ T[:3, :3].T + T[:3, 3]
        middle = (centres.min(0) + centres.max(0)) / 2
        reach = float((np.linalg.norm(centres - middle, axis=1) + cover.fine.radii).max())
        frames.append(frame)
        bounds.append(np.append(middle, reach))
        ball = np.full((4, -(-len(centres) // WIDTH) * WIDTH), -1.0, np.float32)
        ball[:3, : len(centres)], ball[3, : len(centres)] = centres.T, cover.fine.radii
        balls.append(ball)
    start = np.concatenate([[0], np.cumsum([ball.shape[1] for ball in balls])]).astype(np.int64)
    return Balls(np.array(frames, np.int64), np.array(bounds), start, np.concatenate(balls, 1).ravel())


def make_floor(size_m: Array, T_world_cabinet: Array, top_m: float = np.inf) -> Floor:
    """The cells of a cabinet of inner size (3,); of the arm above top_m nothing is noted down."""
    n = np.maximum(1, np.round(size_m[:2] / CELL_M)).astype(np.int64)
    return Floor(inverse(T_world_cabinet), np.minimum(size_m, [np.inf, np.inf, top_m]), n, np.asarray(size_m[:2] / n, float))


def footprint(shape: Shape, R: Array) -> Footprint:
    """Where a shape with the rotation R (3, 3), cabinet frame, meets the floor's cells: the outline of its shadow, and its height."""
    return _footprint(shape, R.tobytes())


@lru_cache(maxsize=64)
def _footprint(shape: Shape, rotation: bytes) -> Footprint:
    """See `footprint`; a scene's objects are asked about in all of its states."""
    R = np.frombuffer(rotation).reshape(3, 3)
    from scipy.spatial import ConvexHull

    points = np.concatenate(convex_parts(shape)) @ R.T
    low, high = points.min(0), points.max(0)
    flat = points[:, :2] - (low[:2] + high[:2]) / 2
    lines = ConvexHull(flat).equations
    return Footprint(np.unique(np.round(lines * [1, 1, -1], 9), axis=0), (high - low)[:2] / 2, float(high[2] - low[2]))


def lowest(chain: Chain, weight: Array, balls: Balls, floor: Floor, paths: Sequence[Array]) -> F32:
    """How low the arm comes over each cell along each path (·, J): (nx, ny, K) metres above the floor, infinite where it never is.

    weight (J,): metres that the arm moves at most per unit of each joint (`edge_problem.Problem.weight`).
    """
    nx, ny = (int(n) for n in floor.n)
    down = np.full((len(paths), nx * (ny + WIDTH)), -np.inf, np.float32)
    K, P, J = len(chain.q_index), len(balls.frame), len(weight)
    scratch = _Scratch(
        np.empty((K + 1, 4, 4)), np.empty((P, 3, 4)), np.empty(P), np.empty(P), np.empty(P, np.int64), np.empty(J), np.empty((3, 4)),
        _ALONG * np.float32(floor.cell[1]), np.empty(3 * WIDTH, np.float32),
    )  # fmt: skip
    for row, path in zip(down, paths):
        _sweep(chain, weight, balls, floor, np.ascontiguousarray(path, float), scratch, row)
    return np.negative(down.reshape(-1, nx, ny + WIDTH)[:, :, :ny].transpose(1, 2, 0), order="C")


def meets(lows: F32, floor: Floor, foot: Footprint, centres: Array) -> NDArray[np.bool_]:
    """Which of K paths (N, K) an object meets that stands with its box's middle over each of centres (N, 2), cabinet frame."""
    out = np.zeros((len(centres), lows.shape[2]), np.bool_)
    _meet(lows, floor, foot.lines, foot.half, foot.height, np.ascontiguousarray(centres, float), out)
    return out


@jit_entry
def _sweep(chain: Chain, weight: Array, balls: Balls, floor: Floor, path: Array, scratch: _Scratch, out: F32) -> None:
    """Lower the heights under one path. The arm is looked at where a link may be due: none is before it can have moved by SAMPLE_M since it
    was drawn, nor before it can have come into the cabinet.

    out (nx · (ny + WIDTH),) has the heights with the other sign, and behind each row of cells room for lanes that reach beyond it.
    """
    n_parts, frames, drawn, q = balls.frame.shape[0], scratch.frames, scratch.drawn, scratch.q
    spare, rate, due = scratch.spare, scratch.rate, scratch.due
    for p in range(n_parts):
        spare[p] = 0.0
        for r in range(3):
            for c in range(4):
                drawn[p, r, c] = np.inf
    for edge in range(path.shape[0] - 1):
        length = 0.0
        for j in range(q.shape[0]):
            length += abs(path[edge + 1, j] - path[edge, j]) * weight[j]
        steps = max(1, int(np.ceil(length / _STEP_M)))
        for p in range(n_parts):
            rate[p] = _SLOWEST_M
            for k in range(balls.frame[p]):
                j = chain.q_index[k]
                rate[p] += _SURELY * abs(path[edge + 1, j] - path[edge, j]) / steps * (weight[j] + abs(chain.scale[k]) * balls.bound[p, 3])
            due[p] = max(0, int(np.ceil(spare[p] / rate[p])))
        last = edge == path.shape[0] - 2
        s = steps
        for p in range(n_parts):
            s = min(s, due[p])
        while s < steps or last:
            for j in range(q.shape[0]):
                q[j] = path[edge, j] + s / steps * (path[edge + 1, j] - path[edge, j])
            forward(chain, q, frames)
            following = steps
            for p in range(n_parts):
                if due[p] <= s or s == steps:
                    spare[p] = _draw_part(frames[balls.frame[p]], balls, p, floor, s == steps, drawn[p], scratch, out)
                    due[p] = s + max(1, int(np.ceil(spare[p] / rate[p])))
                    spare[p] += s * rate[p]  # at the beginning of the edge it would have been so much
                following = min(following, due[p])
            if s == steps:
                break
            s = following
        for p in range(n_parts):
            spare[p] -= steps * rate[p]


@jit_inline
def _draw_part(F: Array, balls: Balls, p: int, floor: Floor, at_end: bool, drawn: Array, scratch: _Scratch, out: F32) -> float:
    """Lower the heights under link p, whose frame is at F (4, 4), if it is in the cabinet and is at the end or has moved enough since it
    was drawn, with its frame at drawn (3, 4), which is brought up to date. How far it may move, m, before it need be looked at again."""
    T, M = floor.T, scratch.M
    bx, by, bz, br = balls.bound[p, 0], balls.bound[p, 1], balls.bound[p, 2], balls.bound[p, 3]
    wx = F[0, 0] * bx + F[0, 1] * by + F[0, 2] * bz + F[0, 3]
    wy = F[1, 0] * bx + F[1, 1] * by + F[1, 2] * bz + F[1, 3]
    wz = F[2, 0] * bx + F[2, 1] * by + F[2, 2] * bz + F[2, 3]
    x = T[0, 0] * wx + T[0, 1] * wy + T[0, 2] * wz + T[0, 3]
    y = T[1, 0] * wx + T[1, 1] * wy + T[1, 2] * wz + T[1, 3]
    z = T[2, 0] * wx + T[2, 1] * wy + T[2, 2] * wz + T[2, 3]
    turned = 0.0
    for r in range(3):
        for c in range(3):
            turned += (F[r, c] - drawn[r, c]) ** 2
    moved = (x - drawn[0, 3]) ** 2 + (y - drawn[1, 3]) ** 2 + (z - drawn[2, 3]) ** 2
    moved = np.sqrt(moved) + br * np.sqrt(turned / 2)
    outside = max(max(-x, x - floor.size[0]), max(abs(y) - floor.size[1] / 2, z - floor.size[2])) - br
    if outside > 0.0 or (moved < SAMPLE_M and not at_end):
        return float(max(outside, SAMPLE_M - moved))
    for r in range(3):
        for c in range(3):
            drawn[r, c] = F[r, c]
    drawn[0, 3], drawn[1, 3], drawn[2, 3] = x, y, z
    for r in range(3):
        for c in range(4):
            M[r, c] = T[r, 0] * F[0, c] + T[r, 1] * F[1, c] + T[r, 2] * F[2, c] + (T[r, 3] if c == 3 else 0.0)
    _draw(M, balls.ball, balls.ball.shape[0] // 4, balls.start[p], balls.start[p + 1], floor, scratch, out)
    return float(SAMPLE_M)


@jit_inline
def _draw(M: Array, ball: F32, total: int, first: int, stop: int, floor: Floor, scratch: _Scratch, out: F32) -> None:
    """Lower the heights under balls first:stop of ball (4 · total,), whose frame stands at M (3, 4) in the cabinet.

    `WIDTH` balls are placed at once, and `WIDTH` cells of a row under one of them lowered; those beside it by a height of infinity.
    """
    cx, cy, along, at = floor.cell[0], floor.cell[1], scratch.along, scratch.at
    depth, width, wide = _f(floor.size[0]), _f(floor.size[1]), floor.n[1] + WIDTH
    for o in range(first, stop, WIDTH):
        bx, by, bz = load(ball, _U(o)), load(ball, _U(o + total)), load(ball, _U(o + 2 * total))
        br = load(ball, _U(o + 3 * total))
        X = bx * _f(M[0, 0]) + by * _f(M[0, 1]) + bz * _f(M[0, 2]) + _f(M[0, 3])
        Y = bx * _f(M[1, 0]) + by * _f(M[1, 1]) + bz * _f(M[1, 2]) + _f(M[1, 3] + floor.size[1] / 2)
        Z = bx * _f(M[2, 0]) + by * _f(M[2, 1]) + bz * _f(M[2, 2]) + _f(M[2, 3])
        under = below(Z - br, _f(floor.size[2])) & below(X - br, depth) & below(Y - br, width)
        under &= below(X * -_ONE, br) & below(Y * -_ONE, br)
        if under == _U(0):
            continue
        store(at, _U(0), X)
        store(at, _U(WIDTH), Y)
        store(at, _U(2 * WIDTH), Z)
        for w in range(WIDTH):
            if not (under >> _U(w)) & _U(1):
                continue
            x, y, z, r = float(at[w]), float(at[WIDTH + w]), at[2 * WIDTH + w], float(ball[3 * total + o + w])
            i0, i1 = max(0, int(np.ceil((x - r) / cx - 0.5))), min(floor.n[0] - 1, int(np.floor((x + r) / cx - 0.5)))
            j0, j1 = max(0, int(np.ceil((y - r) / cy - 0.5))), min(floor.n[1] - 1, int(np.floor((y + r) / cy - 0.5)))
            for a in range(i0, i1 + 1):
                dx = (a + 0.5) * cx - x
                left = r * r - dx * dx
                if left < 0.0:
                    continue
                for b in range(j0, j1 + 1, WIDTH):
                    cell = _U(a * wide + b)
                    dy = load(along, _U(0)) + _f((b + 0.5) * cy - y)
                    rest = _f(left) - dy * dy
                    beside = largest(rest * -_LARGE, _ZERO) * _LARGE
                    store(out, cell, largest(load(out, cell), root(largest(rest, _ZERO)) - z - beside))


@jit_entry
def _meet(lows: F32, floor: Floor, lines: Array, half: Array, height: float, centres: Array, out: NDArray[np.bool_]) -> None:
    cx, cy = floor.cell[0], floor.cell[1]
    grow = max(cx, cy) / 2
    n_paths = lows.shape[2]
    for n in range(centres.shape[0]):
        x0, y0 = centres[n, 0], centres[n, 1]
        i0 = max(0, int(np.ceil((x0 - half[0] - grow) / cx - 0.5)))
        i1 = min(floor.n[0] - 1, int(np.floor((x0 + half[0] + grow) / cx - 0.5)))
        y_low = y0 + floor.size[1] / 2
        j0 = max(0, int(np.ceil((y_low - half[1] - grow) / cy - 0.5)))
        j1 = min(floor.n[1] - 1, int(np.floor((y_low + half[1] + grow) / cy - 0.5)))
        for a in range(i0, i1 + 1):
            x = (a + 0.5) * cx - x0
            for b in range(j0, j1 + 1):
                y = (b + 0.5) * cy - y_low
                inside = True
                for e in range(lines.shape[0]):
                    if lines[e, 0] * x + lines[e, 1] * y > lines[e, 2] + grow:
                        inside = False
                        break
                if inside:
                    for k in range(n_paths):
                        if lows[a, b, k] < height:
                            out[n, k] = True
