"""The look that a proof rests on: grasps a few millimetres apart, in a cabinet with more room than there is.

Where a hand meets something between two grasps that were looked at is not known. So objects, obstacles and walls are looked at smaller by
as much as any point of a hand can lie from where the nearest of the looked-at hands has it: what meets even those is met by all
hands between them. That holds for hands that look the same way and close along the same line, moved ahead or up; not for turned ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, transform
from planning.grasping.sampling import DENSEST, Sampling
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.obstruction import Obstruction
from planning.motion.handling.picking import THOROUGH
from planning.motion.settings import MotionSettings
from planning.relaxed_plan import Names

STEPS_M = ((0.005, 0.003), (0.002, 0.0015))
"""How far apart hands are, ahead and up: first so, and where these leave a way, so."""
SAMPLINGS = tuple(replace(DENSEST, steps_m=steps, beyond_m=math.hypot(*steps) / 2) for steps in STEPS_M)
LEAST_M = 0.002
"""What is left of a shape that is made smaller, at least."""


class FinestLook:
    """Of one scene, from coarse hands with much room to fine ones with little."""

    def __init__(self, robot: Robot, scene: Scene, settings: MotionSettings) -> None:
        self.robot, self.scene, self.settings = robot, scene, settings

    def obstructions(self, poses: Mapping[str, Array]) -> AllLevels:
        """What is in the way of what, if objects stand at poses."""
        return AllLevels(self.levels, poses)

    @cached_property
    def levels(self) -> tuple[Obstruction, ...]:
        """The looks, each with less room than the one before."""
        return tuple(self._level(sampling) for sampling in SAMPLINGS)

    def _level(self, sampling: Sampling) -> Obstruction:
        def grasps_on(name: str, T: Array) -> Iterable[Grasp]:
            return sampled_grasps(self.robot, self.scene, name, T, sampling=sampling)

        roomier = with_more_room(self.scene, sampling.beyond_m)
        cell = Workcell(self.robot, roomier, iterations=0, time_budget_s=None, settings=self.settings)
        return Obstruction(cell, grasps_on, ik_tries=THOROUGH.ik_tries)


@dataclass(frozen=True, eq=False)
class AllLevels:
    """What is in the way of what, by all looks: where one finds no way there is none, and a finer one is asked only where the coarser
    find one."""

    levels: Sequence[Obstruction]
    poses: Mapping[str, Array]

    def free(self, name: str, standing: Names) -> bool:
        """Whether an object may be picked while only `standing`, itself and the target stand."""
        return all(level.at(self.poses).free(name, standing) for level in self.levels)


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
            return replace(body, shape=Box(np.maximum(np.asarray(size_m) - 2 * by_m, LEAST_M)))
        case Cylinder(radius_m, height_m):
            return replace(body, shape=Cylinder(max(radius_m - by_m, LEAST_M / 2), max(height_m - 2 * by_m, LEAST_M)))
    return body
