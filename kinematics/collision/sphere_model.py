"""What the lanes work on, packed: an arm with covered parts, and a world of solids with the question about them.

Everything that sphere_check.py would have to work out again for each edge is worked out here once: how far each part reaches, balls and
boxes around it, and how much float32 may round.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Chain, Int
from kinematics.collision.covers.levels import Levels
from kinematics.collision.geometry import Parts, Query, Solids
from kinematics.collision.posed_geometry import PosedGeometry, make_posed_geometry
from kinematics.jit.decorators import jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array

F32 = NDArray[np.float32]
Index = NDArray[np.uint64]
MANY = 3  # parts on one frame, from which on a look at the ball around all of them pays
X_MAX = 16.0  # joint values beyond this are refused: float32 has too few digits left for them
RATIO = 96 * 2.0**-24
"""How much rounding is allowed for, a metre and a joint; sphere_lanes.py says why."""


@record
class SphereModel(NamedTuple):
    """A chain and its covered parts, for 16 lanes.

    T (K, 12): the rows of T_prev. limit (K,): largest joint value. frame (P,), bound (P, 4): a ball around each part,
    box (P, 6): a box along its frame's axes, middle and half edges.
    many (K + 1,): whether a frame carries `MANY` parts, all (K + 1, 4): a ball around them, all_slack (K + 1,): as slack.
    coarse (C, 5): centre, outer and inner radius; part p's are coarse_start[p]:coarse_start[p + 1]. fine (F, 5), child_start (C + 1,),
    child (·,): as in `Levels`. reach (P, K): see above. slack (P,): the rounding allowance, metres.
    """

    T: F32
    q_index: Index
    scale: Array
    offset: Array
    prismatic: Index
    limit: Array
    frame: Index
    bound: F32
    box: F32
    many: NDArray[np.uint8]
    all: F32
    all_slack: F32
    coarse_start: Index
    coarse: F32
    child_start: Index
    child: Index
    fine: F32
    reach: Array
    slack: F32


@record
class SphereWorld(NamedTuple):
    """Solids and the question about them.

    kind (B,); R (B, 9): rows of the rotation from the world into the body; p (B, 3): the body's origin; half (B, 3); a hull's planes (·,
    4), planes[plane_start[b]:plane_start[b + 1]], in its own frame; ball (B, 4): a ball around it; slack (B,): the rounding allowance;
    check (P, B), pairs (S, 2): see `Query`. clearance (B,): how far the parts are to stay from each body, in metres; own_clearance: from
    each other.
    """

    kind: Index
    R: F32
    p: F32
    half: F32
    plane_start: Index
    planes: F32
    ball: F32
    slack: F32
    check: NDArray[np.uint8]
    pairs: Index
    clearance: F32
    own_clearance: float


def make_sphere_model(chain: Chain, parts: Parts, covers: Sequence[Levels]) -> SphereModel:
    """Pack a chain, its P parts and their covers, given in the parts' frames. Raises: ValueError when the numbers differ."""
    if len(covers) != len(parts.frame):
        raise ValueError(f"covers: {len(covers)} for {len(parts.frame)} parts")
    return posed_sphere_model(chain, make_posed_geometry(chain, parts, covers))


def posed_sphere_model(chain: Chain, posed: PosedGeometry, like: SphereModel | None = None, moved: Int | None = None) -> SphereModel:
    """Pack a chain and posed geometry with covers. like: the model of the same parts with only some, moved (m,), elsewhere in their
    frames: how far the others reach need not be found again."""
    K, P = len(chain.q_index), len(posed.frame)
    limit, slide, far = np.full(K, X_MAX), np.zeros(K), np.empty(P)
    which = np.arange(P) if like is None or moved is None else moved
    reach, slack = (np.zeros((P, K)), np.empty(P, np.float32)) if like is None else (like.reach.copy(), like.slack.copy())
    _reaches(chain, posed, which, limit, slide, far, reach)
    slack[which] = RATIO * (K + 2) * far[which]
    many, balls, all_slack = np.zeros(K + 1, np.uint8), np.zeros((K + 1, 4), np.float32), np.zeros(K + 1, np.float32)
    _around_all(posed, slack, many, balls, all_slack)
    children = np.diff(posed.child_start[posed.coarse_start])  # of each part, counted from its first fine ball
    return SphereModel(
        chain.T_prev[:, :3].reshape(K, 12).astype(np.float32),
        chain.q_index.astype(np.uint64),
        chain.scale,
        chain.offset,
        chain.prismatic.astype(np.uint64),
        limit,
        posed.frame.astype(np.uint64),
        posed.boxes[:, 3:].astype(np.float32, order="C"),
        posed.boxes[:, [3, 4, 5, 0, 1, 2]].astype(np.float32, order="C"),
        many,
        balls,
        all_slack,
        posed.coarse_start.astype(np.uint64),
        posed.coarse.astype(np.float32),
        posed.child_start.astype(np.uint64),
        (posed.child + np.repeat(posed.fine_start[:-1], children)).astype(np.uint64),
        posed.fine.astype(np.float32),
        reach,
        slack,
    )


def with_more_parts(chain: Chain, model: SphereModel, posed: PosedGeometry, more: PosedGeometry) -> SphereModel:
    """What `posed_sphere_model` makes of posed geometry whose first parts are packed as `model`, and whose last ones are `more`: an arm has
    thousands of vertices, and an object in its hand a hundred."""
    own = posed_sphere_model(chain, more)
    slack = np.concatenate([model.slack, own.slack])
    many, balls, all_slack = np.zeros_like(model.many), np.zeros_like(model.all), np.zeros_like(model.all_slack)
    _around_all(posed, slack, many, balls, all_slack)
    fine_before = np.uint64(len(model.fine))
    return model._replace(
        frame=np.concatenate([model.frame, own.frame]),
        bound=np.concatenate([model.bound, own.bound]),
        box=np.concatenate([model.box, own.box]),
        many=many,
        all=balls,
        all_slack=all_slack,
        coarse_start=posed.coarse_start.astype(np.uint64),
        coarse=np.concatenate([model.coarse, own.coarse]),
        child_start=posed.child_start.astype(np.uint64),
        child=np.concatenate([model.child, own.child + fine_before]),
        fine=np.concatenate([model.fine, own.fine]),
        reach=np.concatenate([model.reach, own.reach]),
        slack=slack,
    )


def make_sphere_world(solids: Solids, query: Query) -> SphereWorld:
    """Pack the bodies and the question about them."""
    B = len(solids.kind)
    world = SphereWorld(
        solids.kind.astype(np.uint64),
        np.empty((B, 9), np.float32),
        np.empty((B, 3), np.float32),
        solids.half.astype(np.float32),
        solids.plane_start.astype(np.uint64),
        solids.planes.astype(np.float32),
        np.empty((B, 4), np.float32),
        np.empty(B, np.float32),
        query.check,
        query.pairs.astype(np.uint64, order="C"),
        np.zeros(B, np.float32),
        0.0,
    )
    _place_all(world, solids.T, solids.boxes)
    return world


def world_elsewhere(world: SphereWorld, solids: Solids) -> SphereWorld:
    """The same question with the same solids at other poses."""
    other = world._replace(
        R=np.empty_like(world.R), p=np.empty_like(world.p), ball=np.empty_like(world.ball), slack=np.empty_like(world.slack)
    )
    _place_all(other, solids.T, solids.boxes)
    return other


@jit_entry
def _place_all(world: SphereWorld, T: Array, boxes: Array) -> None:
    for b in range(T.shape[0]):
        place_body(world, b, T[b], boxes[b])


@jit_inline
def place_body(world: SphereWorld, b: int, T: Array, box: Array) -> None:
    """Put body b at pose T (4, 4). box (7,): its row of `Solids.boxes`."""
    squares, from_origin = 0.0, 0.0
    for r in range(3):
        centre = T[r, 0] * box[3] + T[r, 1] * box[4] + T[r, 2] * box[5] + T[r, 3]
        world.p[b, r], world.ball[b, r] = T[r, 3], centre
        squares, from_origin = squares + centre * centre, from_origin + T[r, 3] * T[r, 3]
        for k in range(3):
            world.R[b, 3 * k + r] = T[r, k]
    world.ball[b, 3] = box[6]
    world.slack[b] = RATIO * (np.sqrt(from_origin) + np.sqrt(squares) + 2 * box[6])


@jit_entry
def _reaches(chain: Chain, posed: PosedGeometry, which: Int, limit: Array, slide: Array, size: Array, reach: Array) -> None:
    """limit (K,): the largest joint values; slide (K,): how far a joint slides; size (P,): how far from the world's origin a part can get;
    reach (P, K): see the module; both of parts which (m,). All but size hold what they are for a joint that turns.

    The triangle inequality along the chain, from the part backwards: no configuration can do better.
    """
    for k in range(chain.q_index.shape[0]):
        if chain.prismatic[k]:
            low, high = chain.lower[chain.q_index[k]], chain.upper[chain.q_index[k]]
            slide[k] = max(abs(chain.scale[k] * low + chain.offset[k]), abs(chain.scale[k] * high + chain.offset[k])) + 1e-6
            limit[k] = min(slide[k], X_MAX)
    for p in which:
        far, off = 0.0, 0.0
        for i in range(posed.start[p], posed.start[p + 1]):
            x, y, z = posed.vertices[0, i], posed.vertices[1, i], posed.vertices[2, i]
            off = max(off, np.sqrt(x * x + y * y))
            far = max(far, np.sqrt(x * x + y * y + z * z))
        for k in range(posed.frame[p] - 1, -1, -1):
            reach[p, k] = 1.0 if chain.prismatic[k] else off
            x, y, z = chain.T_prev[k, 0, 3], chain.T_prev[k, 1, 3], chain.T_prev[k, 2, 3]
            off = np.sqrt(x * x + y * y) + slide[k] + far
            far = np.sqrt(x * x + y * y + z * z) + slide[k] + far
        size[p] = far


@jit_entry
def _around_all(posed: PosedGeometry, slack: F32, many: NDArray[np.uint8], balls: F32, all_slack: F32) -> None:
    """many, balls and all_slack (K + 1,): see `SphereModel`, from the parts' own balls and slack (P,).

    A ball's centre walks towards the part that reaches furthest from it (Badoiu and Clarkson 2003). So it lies between the parts' centres,
    and is placed as exactly as the worst of them.
    """
    for f in range(many.shape[0]):
        n = 0
        for p in range(posed.frame.shape[0]):
            if posed.frame[p] == f:
                n += 1
                all_slack[f] = max(all_slack[f], slack[p])
        if n < MANY:
            continue
        x, y, z = 0.0, 0.0, 0.0
        for step in range(1, 33):
            p, _ = _furthest(posed, f, x, y, z)
            x += (posed.boxes[p, 3] - x) / step
            y += (posed.boxes[p, 4] - y) / step
            z += (posed.boxes[p, 5] - z) / step
        many[f], balls[f, 0], balls[f, 1], balls[f, 2] = 1, x, y, z
        _, far = _furthest(posed, f, balls[f, 0], balls[f, 1], balls[f, 2])
        balls[f, 3] = 1.000001 * far  # float32 may round down


@jit_inline
def _furthest(posed: PosedGeometry, f: int, x: float, y: float, z: float) -> tuple[int, float]:
    """Which part on frame f reaches furthest from (x, y, z), in that frame, and how far."""
    at, furthest = 0, -1.0
    for p in range(posed.frame.shape[0]):
        if posed.frame[p] == f:
            u, v, w = posed.boxes[p, 3] - x, posed.boxes[p, 4] - y, posed.boxes[p, 5] - z
            far = np.sqrt(u * u + v * v + w * w) + posed.boxes[p, 6]
            if far > furthest:
                at, furthest = p, far
    return at, furthest
