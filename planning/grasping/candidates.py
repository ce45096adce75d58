"""Which hands of two fingers are asked about: from where they come, how high their pads are, along which line they close."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Body
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds, is_level, is_upright
from kinematics.transforms import Array, transform
from planning.grasping.hand_poses import (
    STAY,
    STEEP,
    Lowest,
    Move,
    ahead_of,
    fit_box,
    fit_lying,
    fit_round,
    height_of,
    level_across,
    level_hand,
    most_above,
)
from planning.grasping.line_contacts import line_contacts
from planning.grasping.sampling import USUAL, Headings, Sampling

MESH_HEIGHTS = (0.45, 0.3)  # heights of the pads on meshes beside the sampling's: what is round is widest at half of its height
BESIDE = (0.25, -0.25)  # so far beside the middle of a lying cylinder it is held, too, in shares of its length
SQUARELY = 0.15  # the pads' middle is that far over a lying cylinder's axis at most, in its radii: they meet it nearly squarely there


def closing_directions(shape: Shape, T: Array, sampling: Sampling = USUAL) -> list[float]:
    """Yaw angles in [0, π) of horizontal directions along which the fingers may close: a box's faces, across a cylinder that lies and from
    end to end of it, elsewhere all round."""
    match shape:
        case Box():
            axes = T[:3, :3].T
            yaws = [float(np.arctan2(a[1], a[0])) for a in axes if abs(a[2]) < 0.2]
        case Cylinder() if is_level(T):
            along = float(np.arctan2(T[1, 2], T[0, 2]))
            yaws = [along, along + np.pi / 2]
        case _:
            yaws = list(np.arange(sampling.yaws) * np.pi / sampling.yaws)
    return sorted({round(y % np.pi, 6) % round(np.pi, 6) for y in yaws})


class Candidate(NamedTuple):
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

    @property
    def key(self) -> tuple[bytes, bytes, bytes, tuple[float, float, float], float, float, float]:
        """What tells it from other hands, but for its rank."""
        return self.u.tobytes(), self.R.tobytes(), self.point.tobytes(), self.extent, self.back_m, self.room_m, self.least_z

    def fit(self, body: Body, width_m: float, opening: Opening) -> Move:
        """How the hand moves for what lies behind its pads."""
        shape, T = body.shape, body.T_world_body
        if isinstance(shape, Cylinder) and is_upright(T):
            return fit_round(shape.radius_m, *self.extent[1:], opening, self.room_m)
        if isinstance(shape, Cylinder) and not is_level(T):
            return STAY
        if isinstance(shape, Cylinder) and _lies_across(body, self.u, self.extent[2]):
            return fit_lying(shape.radius_m, *self.extent, opening, self.room_m)
        return fit_box(*self.extent, width_m, opening, self.back_m, self.room_m)


@dataclass(frozen=True, eq=False)
class Candidates:
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

    def headed(self, headings: Headings) -> Iterator[Candidate]:
        """Hands that look where an arm of few joints can take them."""
        body, (low, high) = self.body, self.bounds
        middle, there = (low + high) / 2, np.array([np.cos(self.toward), np.sin(self.toward), 0.0])
        for kind, pitch in self.kinds:
            for order, z in enumerate(self._heights(kind, pitch)):
                T = transform(level_hand(there, pitch), [middle[0], middle[1], z])
                through = line_contacts(body.shape, body.T_world_body, T[:3, 3], T[:3, 1])
                for R in [] if through is None else headings(T, through.leave - through.enter):
                    yield from self._hand(R, self._turned(ahead_of(R, pitch, there)), R[:, 1], pitch, order, z)

    def all_round(self) -> Iterator[Candidate]:
        """Hands from both sides of every closing direction."""
        for yaw in closing_directions(self.body.shape, self.body.T_world_body, self.sampling):
            u = np.array([np.cos(yaw), np.sin(yaw), 0.0])
            sides = [(ahead, self._turned(ahead)) for ahead in (side * level_across(u) for side in (1.0, -1.0))]
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

    def _hand(self, R: Array, turned: tuple[float, float], u: Array, pitch: float, order: int, z: float) -> Iterator[Candidate]:
        """A hand R (3, 3), turned as `_turned` says, that closes along u (3,), as deep as is asked for."""
        (_, high), (turn, reach) = self.bounds, turned
        point, above, rank = self._point(z), float(high[2] - z), turn + 0.5 * pitch + 0.3 * order
        least_z = self.tips_z if pitch > STEEP else -np.inf
        for back in self.sampling.backs_m if isinstance(self.body.shape, Box) and pitch == 0.0 else (0.0,):
            yield Candidate(rank, point, u, R, (reach, above, pitch), back, self.room_m, least_z)
        if isinstance(self.body.shape, Cylinder) and _lies_across(self.body, u, pitch):
            axis = self.body.T_world_body[:3, 2]
            for by in (share * self.body.shape.height_m for share in BESIDE):
                yield Candidate(rank + 0.3, point + by * axis, u, R, (reach + abs(by), above, pitch), 0.0, self.room_m, least_z)

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
        if isinstance(shape, Cylinder) and is_level(self.body.T_world_body):
            z = height_over_lying(float(low[2] + high[2]) / 2, shape.radius_m, floor)
            return [] if z is None else [z]
        if isinstance(shape, Cylinder) and pitch > 0.0 and is_upright(self.body.T_world_body):
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


def _lies_across(body: Body, u: Array, pitch: float) -> bool:
    """Whether a cylinder lies, across the line along u (3,) in which the fingers of a hand close that looks down at it."""
    T = body.T_world_body
    return is_level(T) and bool(abs(u @ T[:3, 2]) < 0.5) and pitch > 0.0


def height_over_lying(axis_z: float, radius_m: float, lowest_z: float) -> float | None:
    """How high the pads' middle is that close on a cylinder that lies, when it may be no lower than lowest_z; None where that is too far
    over the axis."""
    z = max(axis_z, lowest_z)
    return z if z <= axis_z + SQUARELY * radius_m else None


def half_along(body: Body, direction: Array | Sequence[float]) -> float:
    """Half of how far a body's own box extends along a unit direction (3,), world, in metres."""
    return float(body.shape.half @ np.abs(body.T_world_body[:3, :3].T @ direction))


def with_sides(body: Body) -> Body:
    """The part of an upright body that pads may close on: all of it, or what was seen to have its sides where the shape has them."""
    if body.sides_m is None or not isinstance(body.shape, (Box, Cylinder)) or not is_upright(body.T_world_body):
        return body
    half, low = float(body.shape.half[2]), body.sides_m[0]
    height = min(body.sides_m[1], 2 * half) - low
    if height <= 0.0:
        return body
    shape = Cylinder(body.shape.radius_m, height) if isinstance(body.shape, Cylinder) else Box(np.array([*body.shape.size_m[:2], height]))
    return replace(body, shape=shape, T_world_body=body.T_world_body @ transform(p=[0.0, 0.0, low + height / 2 - half]), sides_m=None)
