"""Grasps of two fingers: antipodal pairs of points on a shape, approached horizontally, diagonally or from above.

A line through the shape along the closing direction gives two contact points; it is a grasp when both surface normals lie within the
friction cone about the line and the gripper opens wide enough. The closing direction is horizontal, but where a wall leans.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Body, Grasp
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.hand_poses import (
    CLEAR_M,
    STAY,
    STEEP,
    UP,
    Lowest,
    Move,
    fit_box,
    fit_round,
    height_of,
    level_hand,
    most_above,
    usual_lowest,
)
from planning.grasping.line_contacts import Contact, line_contacts, line_stretches, stretch_at
from planning.grasping.pads import Pad, under_pads
from planning.grasping.sampling import USUAL, Headings, Sampling

FRICTION_ANGLE = np.radians(10)
MESH_FRICTION_ANGLE = np.radians(20)  # smooth meshes face the fingers in no line exactly; friction of 0.5 holds 26.6°
SET_BACKS = (1.0, 0.5, 0.0)  # shares of how far a mesh, taken for a box, is set back: the first that holds; what is round needs less
BESIDE = (0.2, -0.2, 0.4, -0.4, 0.6, -0.6)  # where meshes are crossed beside their middle: shares of how far they reach there
MESH_HEIGHTS = (0.45, 0.3)  # heights of the pads on meshes beside the sampling's: what is round is widest at half of its height
BELOW_RIM_M = 0.006  # so far below a rim it is seen how its wall leans, and so much further down the pads reach
MOST_LEAN = np.radians(50)  # of a hand that leans as a wall does
CLEARANCE_M = 0.010  # the open fingers' distance to the object on each side, before they close
OPEN_STEP_M = 0.0025  # in such steps do they open, rather less than more
UPRIGHT = np.cos(np.radians(1))
SPARE_M = 0.004  # by which the fingers must open wider than the object, at least


def closing_directions(shape: Shape, T: Array, sampling: Sampling = USUAL) -> list[float]:
    """Yaw angles in [0, π) of horizontal directions along which the fingers may close: a box's faces, elsewhere all round."""
    match shape:
        case Box():
            axes = T[:3, :3].T
            yaws = [float(np.arctan2(a[1], a[0])) for a in axes if abs(a[2]) < 0.2]
        case _:
            yaws = list(np.arange(sampling.yaws) * np.pi / sampling.yaws)
    return sorted({round(y % np.pi, 6) % round(np.pi, 6) for y in yaws})


def sample_grasps(
    body: Body,
    opening: Opening,
    approaches: Sequence[str],
    floor_z: float,
    toward: float,
    sampling: Sampling = USUAL,
    pad: Pad | None = None,
    headings: Headings | None = None,
    lowest: Lowest = usual_lowest,
) -> Iterator[Grasp]:
    """Antipodal grasps on a body, the most natural first: along the bearing `toward` (yaw in rad), flat before steep.

    opening: the gripper's table; approaches: parts of `kinematics.scene.APPROACHES`; floor_z: the height that the body stands on, world.
    pad: how large the pads are, so that they close on what of a mesh they meet first; without it they are lines. headings: how an arm of
    few joints looks at what has no faces, besides the yaws that are sampled. lowest: how low the pads may be.
    On a mesh those follow that meet it less squarely, or beside its middle, or that are set back less than its box would be: the pads may
    meet an edge there, or the palm the mesh. At last come those that hold it by a wall, one finger in a hole of it, and by a rim
    that leans outwards.
    The hand's x points up, or for downward grasps out of the cabinet, so that a camera on that side sees over the object.
    """
    if opening.round_only and not isinstance(body.shape, Cylinder):
        return
    ranked = []
    tips = floor_z + pad.tip_z_m + CLEAR_M if pad is not None and isinstance(body.shape, ConvexMesh) else -np.inf
    for room_m in sampling.rooms_m:
        candidates = _Candidates(body, opening, tuple(approaches), floor_z, toward, sampling, lowest, room_m, tips)
        headed = [] if headings is None or isinstance(body.shape, Box) else candidates.headed(headings)
        ranked += sorted([*headed, *candidates.all_round()], key=lambda c: c.rank)
    hits: dict[tuple[float, float, float], Contact | None] = {}
    left = []
    for c in ranked:
        grasp = _antipodal(body, opening, _crossed(body, c.point, c.u, 0.0, hits), c, pad, FRICTION_ANGLE)
        if grasp is not None:
            yield grasp
        elif isinstance(body.shape, ConvexMesh):
            left.append(c)
    for c in left:
        grasp = _less_squarely(body, opening, c, pad, hits)
        if grasp is not None:
            yield grasp
    if isinstance(body.shape, ConvexMesh) and len(body.shape.parts) > 1:
        walls = dict[tuple[float, float, float], list[Contact]]()
        for c in ranked:
            yield from _by_walls(body, opening, c, pad, walls)
        if pad is not None:
            yield from _by_rims(body.shape, body.T_world_body, opening, ranked, pad)


class _Candidate(NamedTuple):
    """A hand that may close. rank: the smaller the more natural; point (3,): between the pads; u (3,): along which; R (3, 3): the
    hand's; extent: the body's, see `hand_poses.fit_box`; back_m: how much nearer to the hand than it must be; room_m: see `Sampling`;
    least_z: the pads' middle is no lower, though what they close on is."""

    rank: float
    point: Array
    u: Array
    R: Array
    extent: tuple[float, float, float]
    back_m: float
    room_m: float
    least_z: float = -np.inf

    def fit(self, body: Body, width_m: float, opening: Opening) -> Move:
        """How the hand moves for what lies behind its pads."""
        if not isinstance(body.shape, Cylinder):
            return fit_box(*self.extent, width_m, opening, self.back_m, self.room_m)
        return fit_round(body.shape.radius_m, *self.extent[1:], opening, self.room_m) if _is_upright(body) else STAY


@dataclass(frozen=True, eq=False)
class _Candidates:
    """All hands that are asked about; see `sample_grasps`. tips_z: how high the pads' middle is where a hand's tips that look down are as
    low as they may be, world; -inf where the pads close on what their middle is at."""

    body: Body
    opening: Opening
    approaches: tuple[str, ...]
    floor_z: float
    toward: float
    sampling: Sampling
    lowest: Lowest
    room_m: float
    tips_z: float = -np.inf

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """The body's lowest and highest corner (3,), world."""
        return bounds(self.body.shape, self.body.T_world_body)

    @cached_property
    def kinds(self) -> list[tuple[str, float]]:
        """Approaches and their pitches; level ones always keep the usual room."""
        usual = self.room_m == self.sampling.rooms_m[0]
        return [(kind, pitch) for kind in self.approaches for pitch in self.sampling.pitches[kind] if usual or pitch > 0.0]

    def headed(self, headings: Headings) -> Iterator[_Candidate]:
        """Hands that look where an arm of few joints can take them."""
        body, (low, high) = self.body, self.bounds
        middle, there = (low + high) / 2, np.array([np.cos(self.toward), np.sin(self.toward), 0.0])
        for kind, pitch in self.kinds:
            for order, z in enumerate(self._heights(kind, pitch)):
                T = transform(level_hand(there, pitch), [middle[0], middle[1], z])
                through = line_contacts(body.shape, body.T_world_body, T[:3, 3], T[:3, 1])
                for R in [] if through is None else headings(T, through.leave - through.enter):
                    level = np.array([-R[1, 1], R[0, 1], 0.0])
                    ahead = level * np.sign(level @ (R[:, 2] if pitch < STEEP else there))
                    yield from self._hand(R, self._turned(ahead), R[:, 1], pitch, order, z)

    def all_round(self) -> Iterator[_Candidate]:
        """Hands from both sides of every closing direction."""
        for yaw in closing_directions(self.body.shape, self.body.T_world_body, self.sampling):
            u = np.array([np.cos(yaw), np.sin(yaw), 0.0])
            sides = [(ahead, self._turned(ahead)) for ahead in (side * np.array([-u[1], u[0], 0.0]) for side in (1.0, -1.0))]
            for kind, pitch in self.kinds:
                for ahead, turned in sides:
                    R = level_hand(ahead, pitch)
                    for order, z in enumerate(self._heights(kind, pitch)):
                        yield from self._hand(R, turned, u, pitch, order, z)

    def _turned(self, ahead: Array) -> tuple[float, float]:
        """Of a hand that looks along `ahead` (3,), level but for its pitch: how far it is turned from the bearing, rad, and how far the
        body reaches that way."""
        turn = abs((np.arctan2(ahead[1], ahead[0]) - self.toward + np.pi) % (2 * np.pi) - np.pi)
        return float(turn), half_along(self.body, ahead)

    def _hand(self, R: Array, turned: tuple[float, float], u: Array, pitch: float, order: int, z: float) -> Iterator[_Candidate]:
        """A hand R (3, 3), turned as `_turned` says, that closes along u (3,), as deep as is asked for."""
        (_, high), (turn, reach) = self.bounds, turned
        point, extent = self._point(z), (reach, float(high[2] - z), pitch)
        for back in self.sampling.backs_m if isinstance(self.body.shape, Box) and pitch == 0.0 else (0.0,):
            least_z = self.tips_z if pitch > STEEP else -np.inf
            yield _Candidate(turn + 0.5 * pitch + 0.3 * order, point, u, R, extent, back, self.room_m, least_z)

    def _point(self, z: float) -> Array:
        """The body's middle (3,), at a height."""
        if z not in self._points:
            low, high = self.bounds
            middle = (low + high) / 2
            self._points[z] = np.array([middle[0], middle[1], z])
        return self._points[z]

    @cached_property
    def _points(self) -> dict[float, Array]:
        return {}

    def _heights(self, kind: str, pitch: float) -> list[float]:
        """Heights of the pads, world."""
        return self._known_heights[kind, pitch]

    @cached_property
    def _known_heights(self) -> dict[tuple[str, float], list[float]]:
        return {(kind, pitch): self._find_heights(kind, pitch) for kind, pitch in self.kinds}

    def _find_heights(self, kind: str, pitch: float) -> list[float]:
        shape, (low, high) = self.body.shape, self.bounds
        least, floor = -np.inf, self.floor_z + self.lowest(kind, pitch)
        if isinstance(shape, Cylinder) and pitch > 0.0 and _is_upright(self.body):
            least = high[2] - most_above(shape.radius_m, pitch, self.opening, self.room_m)
        usual = (height_of(kind, low[2], high[2], floor, share, least) for share in self.sampling.heights)
        heights = sorted({z for z in usual if z is not None})
        if isinstance(shape, ConvexMesh):
            kind, floor = ("diagonal", self.floor_z + self.lowest("diagonal", pitch)) if kind == "downward" else (kind, floor)
            more = (height_of(kind, low[2], high[2], floor, share) for share in MESH_HEIGHTS)
            heights += [z for z in dict.fromkeys(more) if z is not None and z not in heights]
            if pitch > STEEP and (middle := float(low[2] + high[2]) / 2) < self.tips_z:
                heights.append(middle)  # what is low is held by the pads' ends
        return heights


def half_along(body: Body, direction: Array | Sequence[float]) -> float:
    """Half of how far a body's own box extends along a unit direction (3,), world, in metres."""
    return float(body.shape.half @ np.abs(body.T_world_body[:3, :3].T @ direction))


def _is_upright(body: Body) -> bool:
    """Whether the body's z is the vertical."""
    return bool(abs(body.T_world_body[2, 2]) > UPRIGHT)


def _less_squarely(
    body: Body, opening: Opening, c: _Candidate, pad: Pad | None, hits: dict[tuple[float, float, float], Contact | None]
) -> Grasp | None:
    """A mesh's grasp by a candidate that does not meet it squarely in its middle: beside it, or set back less."""
    reach, above, pitch = c.extent
    level = np.array([-c.u[1], c.u[0], 0.0])
    wide = half_along(body, level)
    lines = [(beside, _crossed(body, c.point, c.u, beside, hits)) for beside in (share * wide for share in (0.0, *BESIDE))]
    for (beside, hit), share in product(sorted(lines, key=lambda line: _skew(line[1], c.u)), SET_BACKS):
        around = (reach + beside * float(np.sign(level @ c.R[:, 2])), above, pitch)
        there = c._replace(point=c.point + beside * level, extent=around)
        grasp = _antipodal(body, opening, hit, there, pad, MESH_FRICTION_ANGLE, share)
        if grasp is not None:
            return grasp
    return None


def _by_walls(
    body: Body, opening: Opening, c: _Candidate, pad: Pad | None, walls: dict[tuple[float, float, float], list[Contact]]
) -> Iterator[Grasp]:
    """A mesh's grasps by the stretches of a candidate's line that holes part. walls: what was found of each line, remembered."""
    line = (float(c.u[0]), float(c.point[2]), 0.0)
    if line not in walls:
        walls[line] = line_stretches(body.shape, body.T_world_body, c.point, c.u)
    for hit in walls[line] if len(walls[line]) > 1 else []:
        shares = SET_BACKS if c.fit(body, hit.leave - hit.enter, opening) != STAY else SET_BACKS[:1]
        found = (_antipodal(body, opening, hit, c, pad, MESH_FRICTION_ANGLE, share, wall=True) for share in shares)
        yield from islice((grasp for grasp in found if grasp is not None), 1)


def _by_rims(shape: ConvexMesh, T: Array, opening: Opening, candidates: Sequence[_Candidate], pad: Pad) -> Iterator[Grasp]:
    """Grasps of a mesh at pose T (4, 4) from above, by walls that lean outwards, as a bowl's do: the hand leans as the wall does, and the
    pads' ends close on its rim."""
    top = float(bounds(shape, T)[1][2]) - BELOW_RIM_M
    asked = set[tuple[float, ...]]()
    for c in (c for c in candidates if c.extent[2] > STEEP):
        if (key := (*c.u.tolist(), *c.R[:, 0].tolist())) in asked:
            continue
        asked.add(key)
        rims = line_stretches(shape, T, np.array([*c.point[:2], top]), c.u)
        for rim in rims if len(rims) > 1 else []:
            across = rim.leave_normal - rim.enter_normal
            lean = float(np.arctan2(across[2], across @ c.u))
            if not MESH_FRICTION_ANGLE / 4 < abs(lean) < MOST_LEAN:
                continue
            turn = rotation_about((c.u[1], -c.u[0], 0.0), lean)
            point, u, R = np.array([*c.point[:2], top]) + (rim.enter + rim.leave) / 2 * c.u, turn @ c.u, turn @ c.R
            hit = stretch_at(shape, T, point, u)
            if hit is None or _skew(hit, u) > MESH_FRICTION_ANGLE:
                continue
            point = point - (pad.high_z_m - BELOW_RIM_M) * R[:, 2]
            enter, leave = under_pads(shape, T, hit, point, u, R, pad, wall=True)
            if (width := leave - enter) + SPARE_M <= opening.max_m:
                yield Grasp(transform(R, opening.hand_position(point + 0.5 * (enter + leave) * u, R, width)), float(width))


def _crossed(body: Body, point: Array, u: Array, beside: float, hits: dict[tuple[float, float, float], Contact | None]) -> Contact | None:
    """Where the line along u that passes so far beside a point meets the body, remembered: hands from both sides, and of all pitches, close
    along it."""
    line = (float(u[0]), float(point[2]), beside)
    if line not in hits:
        hits[line] = line_contacts(body.shape, body.T_world_body, point + beside * np.array([-u[1], u[0], 0.0]) if beside else point, u)
    return hits[line]


def _skew(hit: Contact | None, u: Array) -> float:
    """The larger angle, in rad, between a line along u and the surface's normals where it enters and leaves; π where it misses."""
    return np.pi if hit is None else float(np.arccos(np.clip(min(-hit.enter_normal @ u, hit.leave_normal @ u), -1, 1)))


def _antipodal(
    body: Body,
    opening: Opening,
    hit: Contact | None,
    c: _Candidate,
    pad: Pad | None,
    friction_angle: float,
    share: float = 1.0,
    *,
    wall: bool = False,
) -> Grasp | None:
    """The grasp with the pads' centre on the line through a candidate's point along u, which meets the body so, or where that is too deep,
    nearer to the hand; or None. pad: see `sample_grasps`. friction_angle: between the line and the surface's normals at most. share: of how
    far the pads are set back. wall: the line meets more of the body, apart from there."""
    if hit is None:
        return None
    point, u = c.point, c.u
    move = c.fit(body, hit.leave - hit.enter, opening)
    if move != STAY:
        point = point + share * move.by(c.R)
        if not isinstance(body.shape, Cylinder):  # which flat pads meet where it is widest
            middle = (hit.enter + hit.leave) / 2
            hit = (
                stretch_at(body.shape, body.T_world_body, point, u, middle)
                if wall
                else line_contacts(body.shape, body.T_world_body, point, u)
            )
    raised = max(0.0, c.least_z - float(point[2]))
    if pad is not None and raised > pad.high_z_m:
        return None
    point = point + raised * UP if raised else point
    cone = np.cos(friction_angle)
    if hit is None or -hit.enter_normal @ u < cone or hit.leave_normal @ u < cone:
        return None
    enter, leave = hit.enter, hit.leave
    if leave - enter + SPARE_M > opening.max_m:
        return None
    if pad is not None and isinstance(body.shape, ConvexMesh):
        enter, leave = under_pads(body.shape, body.T_world_body, hit, point, u, c.R, pad, wall)
    width = leave - enter
    if width + SPARE_M > opening.max_m:
        return None
    centre = point + 0.5 * (enter + leave) * u
    return Grasp(transform(c.R, opening.hand_position(centre, c.R, width)), float(width))


def open_width(width_m: float, opening: Opening) -> float:
    """How wide the fingers are before they close on an object of this width: one of few widths, so that what is packed of them serves many
    objects."""
    return float(min(np.floor((width_m + 2 * CLEARANCE_M) / OPEN_STEP_M + 1e-6) * OPEN_STEP_M, opening.max_m))
