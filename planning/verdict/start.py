"""Where a plan begins: where the scene says that the arm is, or at home, where a scene says nothing and the arm can be there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from planning.plan import JOINED
from planning.verdict.contact import near_anything
from planning.verdict.course import Course
from planning.verdict.faults import Fault
from planning.verdict.hand import Hand

NEAR_M = 1e-3
"""A home nearer to anything than that is not asked for: it need not be one that a planner begins at."""


def start_faults(robot: Robot, hand: Hand, scene: Scene, run: Sequence[Course]) -> list[Fault]:
    """The joint that is furthest from where the first motion has to begin. Where something is at home, and the scene doesn't say where the
    arm is instead, that may be anywhere."""
    home = {name: float(value) for name, value in zip(robot.joint_names, robot.home)}
    said, q = scene.robot.q_start, run[0].q[0]
    at = np.array([(home if said is None else {**home, **said})[name] for name in hand.arm.joints])
    off = np.abs(q - at)
    worst = int(np.argmax(off))
    if off[worst] <= JOINED or (said is None and near_anything(robot, hand, scene, at, NEAR_M)):
        return []
    where = "where the scene says it is" if said is not None else "home, where the arm is unless the scene's robot.q_start says otherwise"
    detail = f"motion 0 begins with {hand.arm.joints[worst]} {off[worst]:.3g} {hand.arm.units[worst]} from {where}"
    return [Fault(run[0].stage, (), detail, float(off[worst]))]
