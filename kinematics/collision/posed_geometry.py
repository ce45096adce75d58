"""What moves with the arm, put together in microseconds: link hulls with the fingers at any opening, and an object in the hand.

A `GeometryModel` is made once, each piece in a frame of its own; a `PosedGeometry` has them all in the frames of the chain. Only
rigid transforms lie between the two, so that nothing has to be sorted, covered or read from disk again when the fingers move.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.chain import Chain, Int
from kinematics.collision.covers.levels import Levels
from kinematics.collision.geometry import Parts
from kinematics.collision.vertex_groups import GROUP, grouped
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array


@record
class GeometryModel(NamedTuple):
    """n convex pieces, each in its own frame: vertices (3, N), groups (4, ·), start (n + 1,) as `vertex_groups.grouped` gives them.

    Their covers, as far as they have some: coarse (C, 5) and fine (F, 5) balls, centre, outer and inner radius; piece i's are
    coarse_start[i]:coarse_start[i + 1] and fine_start[i]:fine_start[i + 1]; coarse ball c lists the fine balls
    child[child_start[c]:child_start[c + 1]], counted from its piece's first.
    """

    vertices: Array
    groups: Array
    start: Int
    coarse_start: Int
    coarse: Array
    child_start: Int
    child: Int
    fine_start: Int
    fine: Array


@record
class PosedGeometry(NamedTuple):
    """P pieces in the frames that carry them, frame (P,). vertices, groups, start and the covers are as in `GeometryModel`.

    boxes (P, 7): half sizes and middle of the box around each along its frame's axes, radius of the ball about that middle.
    reach (K, P): see `_reach`.
    """

    frame: Int
    vertices: Array
    groups: Array
    start: Int
    boxes: Array
    reach: Array
    coarse_start: Int
    coarse: Array
    child_start: Int
    child: Int
    fine_start: Int
    fine: Array


def make_geometry_model(hulls: Sequence[Array], covers: Sequence[Levels] = ()) -> GeometryModel:
    """Pack hulls (V_p, 3) and their covers, if there are some. Raises: ValueError when the numbers of both differ."""
    points = np.ascontiguousarray(np.concatenate([*hulls, np.zeros((0, 3))]), float)
    none, nothing = np.zeros(len(hulls) + 1, np.int64), np.zeros((0, 5))
    pieces = GeometryModel(*grouped(points, _starts([len(h) for h in hulls])), none, nothing, none[:1], none[:0], none, nothing)
    return with_covers(pieces, covers) if covers else pieces


def with_covers(pieces: GeometryModel, covers: Sequence[Levels]) -> GeometryModel:
    """The same pieces with their covers. Raises: ValueError when the numbers of both differ."""
    if len(covers) != len(pieces.start) - 1:
        raise ValueError(f"covers: {len(covers)} for {len(pieces.start) - 1} parts")
    return pieces._replace(
        coarse_start=_starts([len(c.coarse.radii) for c in covers]),
        coarse=_rows([np.column_stack((c.coarse.centres, c.coarse.radii, c.coarse.inner_radii())) for c in covers]),
        child_start=_starts(np.concatenate([np.diff(c.start) for c in covers])),
        child=np.concatenate([c.child for c in covers]).astype(np.int64),
        fine_start=_starts([len(c.fine.radii) for c in covers]),
        fine=_rows([np.column_stack((c.fine.centres, c.fine.radii, c.fine.inner_radii())) for c in covers]),
    )


def several_times(pieces: GeometryModel, times: int) -> GeometryModel:
    """The same pieces so many times, one after the other: what `make_geometry_model` makes of hulls that are repeated."""

    def starts(table: Int) -> Int:
        return _joined([table] * times)

    return GeometryModel(
        np.tile(pieces.vertices, times),
        np.tile(pieces.groups, times),
        starts(pieces.start),
        starts(pieces.coarse_start),
        np.tile(pieces.coarse, (times, 1)),
        starts(pieces.child_start),
        np.tile(pieces.child, times),
        starts(pieces.fine_start),
        np.tile(pieces.fine, (times, 1)),
    )


def make_posed_geometry(chain: Chain, parts: Parts, covers: Sequence[Levels] = ()) -> PosedGeometry:
    """Parts and their covers, both given in the frames that carry them."""
    hulls = [parts.vertices[i:j] for i, j in zip(parts.start[:-1], parts.start[1:])]
    return pose_geometry(chain, make_geometry_model(hulls, covers), parts.frame, np.tile(np.eye(4), (len(hulls), 1, 1)))


def pose_geometry(chain: Chain, pieces: GeometryModel, frame: Int, T: Array) -> PosedGeometry:
    """Posed geometry with each piece at its pose T (n, 4, 4) in the frame (n,) that carries it."""
    n = len(frame)
    posed = PosedGeometry(
        frame,
        np.empty_like(pieces.vertices),
        np.empty_like(pieces.groups),
        pieces.start,
        np.empty((n, 7)),
        np.zeros((len(chain.q_index), n)),
        pieces.coarse_start,
        np.empty_like(pieces.coarse),
        pieces.child_start,
        pieces.child,
        pieces.fine_start,
        np.empty_like(pieces.fine),
    )
    every = np.arange(n)
    _pose_geometry(pieces, every, np.ascontiguousarray(T, float), posed)
    _reach(chain, every, posed)
    return posed


def pose_others(chain: Chain, pieces: GeometryModel, posed: PosedGeometry, which: Int, T: Array) -> PosedGeometry:
    """The same posed geometry, but some pieces, which (m,) of the n, are at other poses, T (n, 4, 4), in the frames that carry them."""
    other = posed._replace(
        vertices=posed.vertices.copy(), groups=posed.groups.copy(), boxes=posed.boxes.copy(), reach=posed.reach.copy(),
        coarse=posed.coarse.copy(), fine=posed.fine.copy(),
    )  # fmt: skip
    other.reach[:, which] = 0.0
    _pose_geometry(pieces, which, np.ascontiguousarray(T, float), other)
    _reach(chain, which, other)
    return other


def join_posed(*several: PosedGeometry) -> PosedGeometry:
    """The parts of all, in order, on one chain: an object is put into the hand without a look at the arm."""
    frame, vertices, groups, start, boxes, reach, coarse_start, coarse, child_start, child, fine_start, fine = zip(*several)
    return PosedGeometry(
        np.concatenate(frame),
        np.concatenate(vertices, 1),
        np.concatenate(groups, 1),
        _joined(start),
        np.concatenate(boxes),
        np.concatenate(reach, 1),
        _joined(coarse_start),
        np.concatenate(coarse),
        _joined(child_start),
        np.concatenate(child),
        _joined(fine_start),
        np.concatenate(fine),
    )


def without_covers(posed: PosedGeometry) -> PosedGeometry:
    """The same for the exact test alone, which is put together in less time."""
    none = np.zeros(len(posed.frame) + 1, np.int64)
    return posed._replace(
        coarse_start=none, coarse=posed.coarse[:0], child_start=none[:1], child=posed.child[:0], fine_start=none, fine=posed.fine[:0]
    )


def _joined(starts: Sequence[Int]) -> Int:
    """Where rows start when tables are put one after the other: starts (n + 1,) of each, the last of which is how long it is."""
    out, rows = [starts[0]], starts[0][-1]
    for start in starts[1:]:
        out.append(start[1:] + rows)
        rows = rows + start[-1]
    return np.concatenate(out)


@jit_entry
def _pose_geometry(pieces: GeometryModel, which: Int, T: Array, posed: PosedGeometry) -> None:
    """Vertices, groups, boxes and balls of pieces which (m,) of posed geometry."""
    for n in range(which.shape[0]):
        i = which[n]
        first, last = pieces.start[i], pieces.start[i + 1]
        for v in range(first, last):
            x, y, z = pieces.vertices[0, v], pieces.vertices[1, v], pieces.vertices[2, v]
            for r in range(3):
                posed.vertices[r, v] = T[i, r, 0] * x + T[i, r, 1] * y + T[i, r, 2] * z + T[i, r, 3]
        for g in range(first // GROUP, last // GROUP):
            x, y, z = pieces.groups[0, g], pieces.groups[1, g], pieces.groups[2, g]
            for r in range(3):
                posed.groups[r, g] = T[i, r, 0] * x + T[i, r, 1] * y + T[i, r, 2] * z + T[i, r, 3]
            posed.groups[3, g] = pieces.groups[3, g]
        _move(pieces.coarse, pieces.coarse_start[i], pieces.coarse_start[i + 1], T[i], posed.coarse)
        _move(pieces.fine, pieces.fine_start[i], pieces.fine_start[i + 1], T[i], posed.fine)
        _box(posed.vertices, first, last, posed.boxes[i])


@jit_entry
def _reach(chain: Chain, which: Int, posed: PosedGeometry) -> None:
    """Of parts which (m,) how far (K, P) any point can get from joint k's axis, whatever joints beyond it do, in metres; 1 for a sliding
    joint.

    Per rad (or m) of joint k no point of p moves further than that. 0 where joint k does not move p. Bounded by cylinders about the axes,
    each of which holds what the next joint's cylinder can sweep.
    """
    vertices, start = posed.vertices, posed.start
    for n in range(which.shape[0]):
        p = which[n]
        radius, low, high = 0.0, np.inf, -np.inf
        for v in range(start[p], start[p + 1]):
            radius = max(radius, np.sqrt(vertices[0, v] * vertices[0, v] + vertices[1, v] * vertices[1, v]))
            low, high = min(low, vertices[2, v]), max(high, vertices[2, v])
        for k in range(posed.frame[p] - 1, -1, -1):
            if chain.prismatic[k]:
                a = chain.scale[k] * chain.lower[chain.q_index[k]] + chain.offset[k]
                b = chain.scale[k] * chain.upper[chain.q_index[k]] + chain.offset[k]
                low, high = low + min(a, b), high + max(a, b)
            posed.reach[k, p] = 1.0 if chain.prismatic[k] else radius
            T = chain.T_prev[k]
            x, y, z = T[0, 2], T[1, 2], T[2, 2]
            spread = radius * np.sqrt(max(0.0, 1.0 - z * z))
            far_low = np.sqrt((T[0, 3] + x * low) ** 2 + (T[1, 3] + y * low) ** 2)
            far_high = np.sqrt((T[0, 3] + x * high) ** 2 + (T[1, 3] + y * high) ** 2)
            radius += max(far_low, far_high)
            a, b = T[2, 3] + z * low, T[2, 3] + z * high
            low, high = min(a, b) - spread, max(a, b) + spread


@jit_inline
def _move(balls: Array, first: int, last: int, T: Array, out: Array) -> None:
    for i in range(first, last):
        for r in range(3):
            out[i, r] = T[r, 0] * balls[i, 0] + T[r, 1] * balls[i, 1] + T[r, 2] * balls[i, 2] + T[r, 3]
        out[i, 3], out[i, 4] = balls[i, 3], balls[i, 4]


@jit_inline
def _box(vertices: Array, first: int, last: int, box: Array) -> None:
    for r in range(3):
        low, high = np.inf, -np.inf
        for v in range(first, last):
            low, high = min(low, vertices[r, v]), max(high, vertices[r, v])
        box[r], box[3 + r] = (high - low) / 2, (high + low) / 2
    far = 0.0
    for v in range(first, last):
        x, y, z = vertices[0, v] - box[3], vertices[1, v] - box[4], vertices[2, v] - box[5]
        far = max(far, x * x + y * y + z * z)
    box[6] = np.sqrt(far)


def _starts(counts: Sequence[int] | Int) -> Int:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _rows(blocks: list[Array]) -> Array:
    return np.ascontiguousarray(np.concatenate(blocks), float)
