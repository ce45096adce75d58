"""The look that a proof rests on: hands a few millimetres apart, in a cabinet with more room than there is.

Where a hand meets something between two hands that were looked at is not known. So objects, obstacles and walls are looked at smaller by as
much as any point of a hand can lie from where the nearest of the looked-at hands has it: what meets even those is met by all hands
between them. A hand that meets nothing then is looked at again as several, nearer together, with less room; and so on, till so
little room is left that a way is taken to be there. That holds for hands moved ahead or up, and round what is round for turned ones, too;
of a box it holds for hands that close square on its faces, and everywhere for the pitches that are sampled.

Whatever meets nothing with more room is looked at in the cabinet as it is, too: a hand that meets nothing there either is one to pick with,
though it stands between all that are sampled otherwise. Expensive is a gap that is just too narrow all along a finger: all hands in it meet
nothing till little room is left. So no more than MOST_BETWEEN are looked at for an object, and then nothing is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from heapq import heappop, heappush
from itertools import count, islice, product

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.hand_poses import UP, hand_points, level_across
from planning.grasping.marginal_grasps import lacks_m
from planning.grasping.pads import pad_of
from planning.grasping.sampling import DENSEST
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.obstruction import Obstruction
from planning.motion.handling.picking import THOROUGH, Picking, ik_for_proofs
from planning.motion.search.reaching import APPROACH_M
from planning.motion.settings import MotionSettings
from planning.relaxed_plan import Names
from planning.verdict import judge_hold

STEPS_M = (0.005, 0.003)
"""How far apart hands are at first, ahead and up."""
TURN_M = 0.005
"""So far any point of a hand moves, at most, from one that is looked at first to where it is turned half of the way to the next."""
LEAST_TURN_M = 0.001  # or less, where something is so thin that nothing of it would be left; but not less than this
LEAST_ROOM_M = 0.00005
"""The room is halved till it is no more than this."""
AT_ONCE = 128  # so many hands are looked at together
MOST_BETWEEN = 5000
"""So many hands between those of the first level are looked at for one object."""
LEFT_M = 0.002
"""What is looked at smaller is still as thick as this, or thicker."""


@dataclass(frozen=True)
class Around:
    """The hands that one hand stands for: those moved ahead and up by no more than this, m, and turned about the middle of what is round by
    no more than this, rad. reach_m: how far from there any point of a hand on its way can be."""

    ahead_m: float
    up_m: float
    turn: float
    reach_m: float

    @property
    def moved_m(self) -> float:
        """How far the hands are moved, at most."""
        return math.hypot(self.ahead_m, self.up_m)

    @property
    def room_m(self) -> float:
        """How far any point of the hand can be from where the one that is looked at has it."""
        return self.moved_m + self.turn * self.reach_m

    def halved(self) -> Around:
        """What each of the hands stands for that stand for this one: half as much, where it matters most."""
        if self.turn * self.reach_m > self.moved_m:
            return replace(self, turn=self.turn / 2)
        return replace(self, ahead_m=self.ahead_m / 2, up_m=self.up_m / 2, turn=self.turn / 2)


def levels_of(coarsest: Around) -> tuple[Around, ...]:
    """What a hand stands for at first, and after each halving."""
    levels = [coarsest]
    while levels[-1].room_m > LEAST_ROOM_M:
        levels.append(levels[-1].halved())
    return tuple(levels)


SQUARE = Around(STEPS_M[0] / 2, STEPS_M[1] / 2, 0.0, 0.0)
"""Of hands that close on the faces of a box, which aren't turned."""
THINNEST_M = 2 * (SQUARE.room_m + LEAST_TURN_M) + LEFT_M
"""What is thinner can't be made smaller by the most room there is, and something be left of it."""


class FinestLook:
    """Of one scene, from coarse hands with much room to fine ones with little. cell: the cabinet as it is."""

    def __init__(self, robot: Robot, scene: Scene, settings: MotionSettings, cell: Workcell) -> None:
        self.robot, self.scene, self.settings, self.cell_as_it_is = robot, scene, settings, cell
        self.picking = replace(THOROUGH, ik=ik_for_proofs(cell.arm))
        self._cells: dict[float, Workcell] = {}
        self._levels: dict[str, tuple[Around, ...]] = {}

    def at(self, poses: Mapping[str, Array]) -> FinestView:
        """What is in the way of what, if objects stand at poses."""
        return FinestView(self, poses)

    def sampled(self, name: str, T: Array) -> Iterator[Grasp]:
        """The hands that are looked at first, of an object at T (4, 4)."""
        around = self.levels(name)[0]
        yaws = math.ceil(np.pi / (2 * around.turn)) if around.turn else DENSEST.yaws
        sampling = replace(DENSEST, yaws=yaws, steps_m=STEPS_M, beyond_m=around.moved_m)
        return sampled_grasps(self.robot, self.scene, name, T, sampling=sampling)

    def levels(self, name: str) -> tuple[Around, ...]:
        """What hands on an object stand for, at first and after each halving. Round what is round they can be turned; an arm of few joints
        can't choose where its hand looks."""
        if name not in self._levels:
            shape, coarsest = self.scene.body(name).shape, SQUARE
            if isinstance(shape, Cylinder) and not self.cell_as_it_is.arm.few_joints:
                reach_m = hand_reach_m(self.robot) + APPROACH_M + shape.radius_m
                turn_m = min(TURN_M, (thinnest_m(self.scene) - LEFT_M) / 2 - SQUARE.room_m)
                coarsest = replace(SQUARE, turn=turn_m / reach_m, reach_m=reach_m)
            self._levels[name] = levels_of(coarsest)
        return self._levels[name]

    def cell(self, room_m: float) -> Workcell:
        """The cabinet with so much more room; made when asked for."""
        if room_m not in self._cells:
            scene = with_more_room(self.scene, room_m)
            self._cells[room_m] = Workcell(self.robot, scene, iterations=0, time_budget_s=None, settings=self.settings)
        return self._cells[room_m]


@dataclass(frozen=True)
class Access:
    """What a look says of an object. hand: one that takes it as things are; closed: whether none does, for certain. With neither that is
    open. between: how many hands between those of the first level were looked at."""

    hand: Grasp | None
    closed: bool
    between: int


@dataclass(frozen=True, eq=False)
class FinestView:
    """The same, if objects stand at poses."""

    look: FinestLook
    poses: Mapping[str, Array]

    def access(self, name: str, standing: Names) -> Access:
        """Whether there is a way to an object while only `standing`, itself and the target stand."""
        coarse, between, closed = self.look.sampled(name, self.poses[name]), 0, True
        queue, ticket = list[tuple[int, int, int, Grasp]](), count()
        levels, middle = self.look.levels(name), self.poses[name][:3, 3]
        finest, as_it_is = len(levels) - 1, len(levels)
        hands, level = list(islice(coarse, AT_ONCE)), 0
        while hands:
            for hand, open_till in self._open(hands, level, name, standing):
                if open_till == as_it_is:
                    return Access(hand, False, between)
                closed &= level < finest
                if level < finest:  # those are looked around first that lack least room
                    heappush(queue, (-open_till, level, next(ticket), hand))
            if hands := list(islice(coarse, AT_ONCE)):
                continue
            if queue and between < MOST_BETWEEN:
                _, level, _, hand = heappop(queue)
                hands, level = list(divided(hand, levels[level], middle)), level + 1
                between += len(hands)
        return Access(None, closed and not queue, between)

    def _open(self, hands: Sequence[Grasp], level: int, name: str, standing: Names) -> list[tuple[Grasp, int]]:
        """Which of some hands meet nothing and may hold the object, with the room of their level, and the finest level at which each still
        does; that is the number of levels for one that takes the object without more room."""
        found, left, levels = list[tuple[Grasp, int]](), list(hands), self.look.levels(name)
        for finer in range(level, len(levels)):
            moved_m = levels[finer].moved_m
            near = [hand for hand in left if finer == 0 or self._lacks_m(name, hand) <= moved_m]  # those of level 0 are sampled so
            among = Obstruction(self.look.cell(levels[finer].room_m), lambda *_, near=near: near, ik=self.look.picking.ik)
            still = [near[i] for i in among.at(self.poses).open_grasps(name, standing)] if near else []
            if finer > level:
                found += [(hand, finer - 1) for hand in left if not any(hand is other for other in still)]
            left = still
        return found + [(hand, len(levels) if self._takes(name, hand, standing) else len(levels) - 1) for hand in left]

    def _lacks_m(self, name: str, hand: Grasp) -> float:
        """How far a hand is from holding an object, at least."""
        robot = self.look.robot
        return lacks_m(self._body(name), robot.opening, pad_of(robot), hand)

    def _takes(self, name: str, hand: Grasp, standing: Names) -> bool:
        """Whether a hand takes an object as things are: the planner finds a way, and the verdict calls it held."""
        cell = self.look.cell_as_it_is
        poses = {other: T for other, T in self.poses.items() if other in {name, *standing, self.look.scene.target_name}}
        picks, _ = Picking(cell, self.look.picking).picks_with([hand], poses, cell.without(poses, name), name, cell.home_arm)
        return bool(picks) and judge_hold(self.look.robot, self._body(name), hand) is None

    def _body(self, name: str) -> Body:
        return replace(self.look.scene.body(name), T_world_body=self.poses[name])


def divided(hand: Grasp, around: Around, middle: Array) -> Iterator[Grasp]:
    """The hands of the next level that stand together for a hand and those around it; middle (3,): of what they hold."""
    finer = around.halved()
    along, above, turn = ((was - now) for was, now in zip(_extents(around), _extents(finer)))
    for i, k, j in product(_either(along), _either(above), _either(turn)):
        T = transform(p=i * level_across(hand.T_world_hand[:3, 1]) + k * UP) @ hand.T_world_hand
        yield replace(hand, T_world_hand=transform(p=middle) @ transform(rotation_about(UP, j)) @ transform(p=-middle) @ T if j else T)


def _extents(around: Around) -> tuple[float, float, float]:
    return around.ahead_m, around.up_m, around.turn


def _either(way: float) -> tuple[float, ...]:
    return (-way, way) if way else (0.0,)


@lru_cache(maxsize=16)
def hand_reach_m(robot: Robot) -> float:
    """How far any point of the open hand is from where something between its pads is, at most."""
    width, pad = robot.opening.max_m, pad_of(robot)
    points = hand_points(robot, width, robot.hand_links) - robot.opening.middle(width)
    return float(np.linalg.norm(points, axis=1).max()) + math.hypot(pad.half_x_m, max(-pad.low_z_m, pad.high_z_m))


def thinnest_m(scene: Scene) -> float:
    """How thick the thinnest is of all that stands in a scene, and of its walls; 0 where there is a mesh."""
    bodies = (*scene.objects, *scene.obstacles)
    solid = (2 * float(b.shape.half.min()) if isinstance(b.shape, (Box, Cylinder)) else 0.0 for b in bodies)
    return min(scene.cabinet.wall_m, *solid)


def can_have_more_room(scene: Scene) -> bool:
    """Whether all that stands in a scene can be made smaller: boxes and cylinders, no plate, no thin wall."""
    return thinnest_m(scene) >= THINNEST_M


def with_more_room(scene: Scene, by_m: float) -> Scene:
    """A scene in which objects, obstacles and walls are further from any point by so much."""
    cabinet = scene.cabinet
    roomier = replace(
        cabinet,
        size_m=cabinet.size_m + np.array([0.0, 2 * by_m, 2 * by_m]),
        T_world_cabinet=cabinet.T_world_cabinet @ transform(p=[by_m, 0.0, -by_m]),
        wall_m=cabinet.wall_m - 2 * by_m,  # for links beside, above and below it, too
    )
    objects, obstacles = (tuple(_smaller(body, by_m) for body in bodies) for bodies in (scene.objects, scene.obstacles))
    return replace(scene, cabinet=roomier, objects=objects, obstacles=obstacles)


def _smaller(body: Body, by_m: float) -> Body:
    match body.shape:
        case Box(size_m):
            return replace(body, shape=Box(np.asarray(size_m) - 2 * by_m))
        case Cylinder(radius_m, height_m):
            return replace(body, shape=Cylinder(radius_m - by_m, height_m - 2 * by_m))
    raise ValueError(f"{body.name} is a mesh, and can't be made smaller")
