"""The look that a proof rests on: hands a few millimetres apart, in a cabinet with more room than there is.

Where a hand meets something between two hands that were looked at is not known. So objects, obstacles and walls are looked at smaller by as
much as any point of a hand can lie from where the nearest of the looked-at hands has it: what meets even those is met by all hands
between them. A hand that meets nothing then is looked at again as four, half as far apart, with half as much room; and so on, till so
little room is left that a way is taken to be there. That holds for hands that look the same way and close along the same line, moved ahead
or up; not for turned ones.

Whatever meets nothing with more room is looked at in the cabinet as it is, too: a hand that meets nothing there either is one to pick with,
though it stands between all that are sampled otherwise. Dear is a gap that is just too narrow all along a finger: all hands in it meet
nothing till little room is left. So no more than MOST_BETWEEN are looked at for an object, and then nothing is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import count, islice, product

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, transform
from planning.grasping.hand_poses import UP, level_across
from planning.grasping.marginal_grasps import lacks_m
from planning.grasping.pads import pad_of
from planning.grasping.sampling import DENSEST
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.obstruction import Obstruction
from planning.motion.handling.picking import THOROUGH, Picking
from planning.motion.settings import MotionSettings
from planning.relaxed_plan import Names
from planning.verdict import judge_hold

STEPS_M = (0.005, 0.003)
"""How far apart hands are at first, ahead and up."""
HALVINGS = 6
"""So often is that halved where a hand meets nothing: the room that is left then is 0.05 mm."""
AT_ONCE = 16  # so many hands are looked at together
MOST_BETWEEN = 5000
"""So many hands between those of the first level are looked at for one object."""
AS_IT_IS = HALVINGS + 1  # in place of a level: without more room


def room_m(level: int) -> float:
    """How much more room there is after so many halvings: half of the way from one hand to the next."""
    return math.hypot(*STEPS_M) * 0.5 ** (level + 1)


THINNEST_M = 2 * room_m(0) + 0.002
"""What is thinner can't be made smaller by the most room there is, and something be left of it."""
SAMPLING = replace(DENSEST, steps_m=STEPS_M, beyond_m=room_m(0))
"""Of the hands that are looked at first."""


class FinestLook:
    """Of one scene, from coarse hands with much room to fine ones with little. cell: the cabinet as it is."""

    def __init__(self, robot: Robot, scene: Scene, settings: MotionSettings, cell: Workcell) -> None:
        self.robot, self.scene, self.settings, self.cell_as_it_is = robot, scene, settings, cell
        self._cells: dict[int, Workcell] = {}

    def at(self, poses: Mapping[str, Array]) -> FinestView:
        """What is in the way of what, if objects stand at poses."""
        return FinestView(self, poses)

    def sampled(self, name: str, T: Array) -> Iterator[Grasp]:
        """The hands that are looked at first, of an object at T (4, 4)."""
        return sampled_grasps(self.robot, self.scene, name, T, sampling=SAMPLING)

    def cell(self, level: int) -> Workcell:
        """The cabinet with more room, less after each halving; made when asked for."""
        if level not in self._cells:
            scene = with_more_room(self.scene, room_m(level))
            self._cells[level] = Workcell(self.robot, scene, iterations=0, time_budget_s=None, settings=self.settings)
        return self._cells[level]


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
        hands, level = list(islice(coarse, AT_ONCE)), 0
        while hands:
            for hand, finest in self._open(hands, level, name, standing):
                if finest == AS_IT_IS:
                    return Access(hand, False, between)
                closed &= level < HALVINGS
                if level < HALVINGS:  # those are looked around first that lack least room
                    heappush(queue, (-finest, level, next(ticket), hand))
            if hands := list(islice(coarse, AT_ONCE)):
                continue
            if queue and between < MOST_BETWEEN:
                _, level, _, hand = heappop(queue)
                hands, level = list(quartered(hand, level)), level + 1
                between += len(hands)
        return Access(None, closed and not queue, between)

    def _open(self, hands: Sequence[Grasp], level: int, name: str, standing: Names) -> list[tuple[Grasp, int]]:
        """Which of some hands meet nothing and may hold the object, with the room of their level, and the finest level at which each still
        does; that is AS_IT_IS for one that takes the object without more room."""
        found, left = list[tuple[Grasp, int]](), list(hands)
        for finer in range(level, HALVINGS + 1):
            near = [hand for hand in left if finer == 0 or self._lacks_m(name, hand) <= room_m(finer)]  # those of level 0 are sampled so
            among = Obstruction(self.look.cell(finer), lambda *_, near=near: near, ik_tries=THOROUGH.ik_tries)
            still = [near[i] for i in among.at(self.poses).open_grasps(name, standing)] if near else []
            if finer > level:
                found += [(hand, finer - 1) for hand in left if not any(hand is other for other in still)]
            left = still
        return found + [(hand, AS_IT_IS if self._takes(name, hand, standing) else HALVINGS) for hand in left]

    def _lacks_m(self, name: str, hand: Grasp) -> float:
        """How far a hand is from holding an object, at least."""
        robot = self.look.robot
        return lacks_m(self._body(name), robot.opening, pad_of(robot), hand)

    def _takes(self, name: str, hand: Grasp, standing: Names) -> bool:
        """Whether a hand takes an object as things are: the planner finds a way, and the verdict calls it held."""
        cell = self.look.cell_as_it_is
        poses = {other: T for other, T in self.poses.items() if other in {name, *standing, self.look.scene.target_name}}
        picks, _ = Picking(cell, THOROUGH).picks_with([hand], poses, cell.without(poses, name), name, cell.home_arm)
        return bool(picks) and judge_hold(self.look.robot, self._body(name), hand) is None

    def _body(self, name: str) -> Body:
        return replace(self.look.scene.body(name), T_world_body=self.poses[name])


def quartered(hand: Grasp, level: int) -> Iterator[Grasp]:
    """The four hands of the next level that stand for a hand and those around it."""
    T = hand.T_world_hand
    ahead = level_across(T[:3, 1])
    along, above = (step / 2 ** (level + 2) for step in STEPS_M)
    for i, k in product((-along, along), (-above, above)):
        yield replace(hand, T_world_hand=transform(p=i * ahead + k * UP) @ T)


def can_have_more_room(scene: Scene) -> bool:
    """Whether all that stands in a scene can be made smaller: boxes and cylinders, no plate, no thin wall."""
    bodies = (*scene.objects, *scene.obstacles)
    solid = all(isinstance(b.shape, (Box, Cylinder)) and 2 * float(b.shape.half.min()) >= THINNEST_M for b in bodies)
    return solid and scene.cabinet.wall_m >= THINNEST_M


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
