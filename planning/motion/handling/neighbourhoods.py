"""What a hand stands for that is looked at alone: all hands near it, moved, turned and pitched by no more than so much.

Neighbourhoods of the hands that are looked at first cover all hands that may hold an object; each is halved into several, as far as it is
asked (`subdivision.py`). How far any point of one of these hands can be from where the one that is looked at has it is the room that makes
up for looking at one alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Grasp
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.finger_grasps import open_width
from planning.grasping.hand_poses import UP, hand_points, level_across
from planning.grasping.marginal_grasps import SURELY_M
from planning.grasping.pads import pad_of
from planning.grasping.sampling import DENSEST, DIAGONAL, Sampling
from planning.motion.search.reaching import APPROACH_M

STEPS_M = (0.005, 0.003)
"""How far apart hands are at first, ahead and up."""
TURN_M = 0.005
"""So far any point of a hand moves, at most, from one that is looked at first to where it is turned, or pitched, half of the way to the
next."""
MOVED_SHARE = 0.45
"""So much of the room that can be had is for hands moved ahead or up where they are turned and pitched, too: fewest are looked at then."""
LEAST_TURN_M = 0.001  # or less, where something is so thin that nothing of it would be left; but not less than this
LEAST_ROOM_M = 0.00005
"""The room is halved till it is no more than this."""
WIDTHS = 18  # for so many is it asked how far a hand reaches


@dataclass(frozen=True)
class Neighbourhood:
    """The hands that one hand stands for: those moved ahead and up by no more than this, m, turned about the middle of what is round, and
    pitched about the middle of the pads, by no more than this, rad. reach_m: how far from either any point of a hand on its way can be;
    pad_m: how far any of a pad is from the pads' middle."""

    ahead_m: float
    up_m: float
    turn: float = 0.0
    pitch: float = 0.0
    reach_m: float = 0.0
    pad_m: float = 0.0

    @property
    def moved_m(self) -> float:
        """How far the hands are moved, at most."""
        return math.hypot(self.ahead_m, self.up_m)

    @property
    def room_m(self) -> float:
        """How far any point of the hand can be from where the one that is looked at has it."""
        return self.moved_m + (self.turn + self.pitch) * self.reach_m

    @property
    def lacks_m(self) -> float:
        """How far the one that is looked at can be from holding what another holds. A turn about what is round changes nothing."""
        return self.moved_m + self.pitch * self.pad_m

    def halved(self) -> Neighbourhood:
        """What each of the hands stands for that stand for this one: half as much, where it matters most."""
        most = max(self.turn, self.pitch)
        if most * self.reach_m > self.moved_m:
            return replace(self, turn=_half_if(self.turn, most), pitch=_half_if(self.pitch, most))
        return replace(self, ahead_m=self.ahead_m / 2, up_m=self.up_m / 2, turn=self.turn / 2, pitch=self.pitch / 2)


def _half_if(angle: float, most: float) -> float:
    return angle / 2 if angle == most else angle


def levels_of(first: Neighbourhood) -> Levels:
    """What a hand stands for at first, and after each halving."""
    levels = [first]
    while levels[-1].room_m > LEAST_ROOM_M:
        levels.append(levels[-1].halved())
    return tuple(levels)


Levels = tuple[Neighbourhood, ...]
SQUARE = Neighbourhood(STEPS_M[0] / 2, STEPS_M[1] / 2)
"""Of level hands that close on the faces of a box, which aren't turned."""


def coarsest(robot: Robot, most_room_m: float, radius_m: float, *, turned: bool, pitched: bool) -> Neighbourhood:
    """What the hands that are looked at first stand for. most_room_m: as much room as there may be; radius_m: of what is round; turned,
    pitched: whether they stand for turned hands, and for pitched ones."""
    if not turned and not pitched:
        return SQUARE
    wider = min(2.0, max(1.0, most_room_m * MOVED_SHARE / SQUARE.room_m)) if turned and pitched else 1.0
    moved = Neighbourhood(wider * SQUARE.ahead_m, wider * SQUARE.up_m)
    reach_m = hand_reach_m(robot) + APPROACH_M + radius_m
    angle = min(TURN_M, (most_room_m - moved.room_m) / (turned + pitched)) / reach_m
    return replace(moved, turn=angle * turned, pitch=angle * pitched, reach_m=reach_m, pad_m=_pad_m(robot))


def least_room_m(*, pitched: bool) -> float:
    """So much room has to be possible, where hands are pitched or not."""
    return SQUARE.room_m + LEAST_TURN_M * (2 if pitched else 1)


def sampling_of(around: Neighbourhood) -> Sampling:
    """Of the hands that are looked at first, each of which stands for all around it. With pitches: natural ones were looked at before."""
    yaws = math.ceil(np.pi / (2 * around.turn)) if around.turn else DENSEST.yaws
    sampling = replace(DENSEST, yaws=yaws, steps_m=(2 * around.ahead_m, 2 * around.up_m), beyond_m=around.lacks_m)
    if not around.pitch:
        return sampling
    low, high = min(DENSEST.pitches[DIAGONAL]), max(DENSEST.pitches[DIAGONAL])
    n = math.ceil((high - low) / (2 * around.pitch))
    return replace(sampling, heights=(), pitches={DIAGONAL: tuple(low + (np.arange(n) + 0.5) * (high - low) / n)})


def divided(hand: Grasp, around: Neighbourhood, middle: Array, pads: Array) -> Iterator[Grasp]:
    """The hands of the next level that stand together for a hand and those around it; middle (3,): of what they hold; pads (3,): the pads'
    middle in the hand's frame."""
    finer = around.halved()
    steps = [was - now for was, now in zip(_extents(around), _extents(finer))]
    for along, above, turn, pitch in product(*map(_either, steps)):
        T = transform(p=along * level_across(hand.T_world_hand[:3, 1]) + above * UP) @ hand.T_world_hand
        if turn:
            T = _about(middle, rotation_about(UP, turn)) @ T
        if pitch:
            T = T @ _about(pads, rotation_about((0.0, 1.0, 0.0), pitch))
        yield replace(hand, T_world_hand=T)


def _about(point: Array, R: Array) -> Array:
    """A turn (4, 4) by R (3, 3) about a point (3,)."""
    return transform(p=point) @ transform(R) @ transform(p=-point)


def _extents(around: Neighbourhood) -> tuple[float, ...]:
    return around.ahead_m, around.up_m, around.turn, around.pitch


def _either(way: float) -> tuple[float, ...]:
    return (-way, way) if way else (0.0,)


@lru_cache(maxsize=16)
def hand_reach_m(robot: Robot) -> float:
    """How far any point of the hand, open to take something, is from what is between its pads then, at most; the pads' middle moves as they
    open."""
    pad, opening = pad_of(robot), robot.opening
    widths = np.linspace(0.0, opening.max_m, WIDTHS)
    points = np.concatenate([hand_points(robot, open_width(w, opening), robot.hand_links) - opening.middle(w) for w in widths])
    return float(np.linalg.norm(points, axis=1).max()) + math.hypot(pad.half_x_m, max(-pad.low_z_m, pad.high_z_m))


def _pad_m(robot: Robot) -> float:
    """How far any of a pad is from the pads' middle, by way of the middle of its face; and a little more, for the square in which it
    holds."""
    pad = pad_of(robot)
    return math.hypot(pad.half_x_m, (pad.high_z_m - pad.low_z_m) / 2) + abs(pad.high_z_m + pad.low_z_m) / 2 + SURELY_M
