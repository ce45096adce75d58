"""The look that a proof rests on: hands a few millimetres apart, in a cabinet with more room than there is.

Where a hand meets something between two hands that were looked at is not known. So objects, obstacles and walls are looked at smaller by as
much as any point of a hand can lie from where the nearest of the looked-at hands has it: what meets even those is met by all hands
between them. A hand that meets nothing then is looked at again as four, half as far apart, with half as much room; and so on, till so
little room is left that a way is taken to be there. That holds for hands that look the same way and close along the same line, moved ahead
or up; not for turned ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, product

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, transform
from planning.grasping.hand_poses import UP, level_across
from planning.grasping.sampling import DENSEST
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.obstruction import Obstruction
from planning.motion.handling.picking import THOROUGH
from planning.motion.settings import MotionSettings
from planning.relaxed_plan import Names

STEPS_M = (0.005, 0.003)
"""How far apart hands are at first, ahead and up."""
HALVINGS = 6
"""So often is that halved where a hand meets nothing: the room that is left then is 0.05 mm."""
AT_ONCE = 16  # so many hands are looked at together
SMALLEST_M = 0.002
"""What is left of a shape that is made smaller, at least."""


def room_m(level: int) -> float:
    """How much more room there is after so many halvings: half of the way from one hand to the next."""
    return math.hypot(*STEPS_M) * 0.5 ** (level + 1)


SAMPLING = replace(DENSEST, steps_m=STEPS_M, beyond_m=room_m(0))
"""Of the hands that are looked at first."""


class FinestLook:
    """Of one scene, from coarse hands with much room to fine ones with little."""

    def __init__(self, robot: Robot, scene: Scene, settings: MotionSettings) -> None:
        self.robot, self.scene, self.settings = robot, scene, settings
        self._cells: dict[int, Workcell] = {}

    def obstructions(self, poses: Mapping[str, Array]) -> Closed:
        """What is in the way of what, if objects stand at poses."""
        return Closed(self, poses)

    def sampled(self, name: str, T: Array) -> Iterator[Grasp]:
        """The hands that are looked at first, of an object at T (4, 4)."""
        return sampled_grasps(self.robot, self.scene, name, T, sampling=SAMPLING)

    def cell(self, level: int) -> Workcell:
        """The cabinet with more room, less after each halving; made when asked for."""
        if level not in self._cells:
            scene = with_more_room(self.scene, room_m(level))
            self._cells[level] = Workcell(self.robot, scene, iterations=0, time_budget_s=None, settings=self.settings)
        return self._cells[level]


@dataclass(frozen=True, eq=False)
class Closed:
    """The same, if objects stand at poses."""

    look: FinestLook
    poses: Mapping[str, Array]

    def free(self, name: str, standing: Names) -> bool:
        """Whether there may be a way to an object while only `standing`, itself and the target stand."""
        return self._some_open(self.look.sampled(name, self.poses[name]), 0, name, standing)

    def _some_open(self, hands: Iterator[Grasp], level: int, name: str, standing: Names) -> bool:
        """Whether some of the hands of a level, or of those between them, meet nothing."""
        while some := list(islice(hands, AT_ONCE)):
            left = self._open(some, level, name, standing)
            if level == HALVINGS:
                if any(True for _ in left):
                    return True
            elif self._some_open((part for hand in left for part in quartered(hand, level)), level + 1, name, standing):
                return True
        return False

    def _open(self, hands: Sequence[Grasp], level: int, name: str, standing: Names) -> Iterator[Grasp]:
        """Which of some hands meet nothing."""
        among = Obstruction(self.look.cell(level), lambda name, T: hands, ik_tries=THOROUGH.ik_tries)
        return (hands[i] for i in among.at(self.poses).open_grasps(name, standing))


def quartered(hand: Grasp, level: int) -> Iterator[Grasp]:
    """The four hands of the next level that stand for a hand and those around it."""
    T = hand.T_world_hand
    ahead = level_across(T[:3, 1])
    along, above = (step / 2 ** (level + 2) for step in STEPS_M)
    for i, k in product((-along, along), (-above, above)):
        yield replace(hand, T_world_hand=transform(p=i * ahead + k * UP) @ T)


def with_more_room(scene: Scene, by_m: float) -> Scene:
    """A scene in which objects, obstacles and walls are further from any point by so much, but for meshes."""
    cabinet = scene.cabinet
    roomier = replace(
        cabinet,
        size_m=cabinet.size_m + np.array([0.0, 2 * by_m, 2 * by_m]),
        T_world_cabinet=cabinet.T_world_cabinet @ transform(p=[by_m, 0.0, -by_m]),
    )
    objects, obstacles = (tuple(_smaller(body, by_m) for body in bodies) for bodies in (scene.objects, scene.obstacles))
    return replace(scene, cabinet=roomier, objects=objects, obstacles=obstacles)


def _smaller(body: Body, by_m: float) -> Body:
    match body.shape:
        case Box(size_m):
            return replace(body, shape=Box(np.maximum(np.asarray(size_m) - 2 * by_m, SMALLEST_M)))
        case Cylinder(radius_m, height_m):
            return replace(body, shape=Cylinder(max(radius_m - by_m, SMALLEST_M / 2), max(height_m - 2 * by_m, SMALLEST_M)))
    return body
