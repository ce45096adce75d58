"""A cabinet that leans is planned in as if it stood upright: scene and robot are turned together until it does, and the plan back again.

For the planner's hands, for what it carries and for what it puts down z is up and floors are level; turned so, they keep to the cabinet's
z, which is what its floor asks for. The verdict judges the plan in the scene as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.transforms import Array, apply, inverse, rotation_about, transform
from planning.conclusion import judged_again
from planning.motion.settings import LEAST_TILT_DEG, MOST_TILT_DEG, MotionSettings
from planning.plan import Plan

LEVEL_DEG = 0.1
"""A cabinet that leans by less is taken to be level: 30 cm across, that is half a millimetre."""


@dataclass(frozen=True, eq=False)
class Upright:
    """A scene and settings to plan in, and what they were made of. T_upright_world (4, 4): how the scene was turned; None, and all is as it
    was, where its cabinet is level."""

    scene: Scene
    settings: MotionSettings
    as_it_is: Scene
    as_they_are: MotionSettings
    T_upright_world: Array | None

    def plan_as_it_is(self, plan: Plan) -> Plan:
        """The plan of the upright scene, for the scene as it is."""
        return plan if self.T_upright_world is None else turned_plan(plan, self.T_upright_world)

    def judged(self, robot: Robot, plan: Plan) -> Plan:
        """The same, judged in the scene as it is."""
        if self.T_upright_world is None:
            return plan
        return judged_again(robot, self.as_it_is, self.plan_as_it_is(plan), self.as_they_are)


def upright(scene: Scene, settings: MotionSettings) -> Upright:
    """What is planned in: the scene turned upright, and settings by which what is carried may lean by less there."""
    turn = upright_turn(scene)
    if turn is None:
        return Upright(scene, settings, scene, settings, None)
    return Upright(*more_upright(turned_scene(scene, turn), settings, scene.cabinet.lean_deg), scene, settings, turn)


def upright_turn(scene: Scene) -> Array | None:
    """T_upright_world (4, 4), the smallest turn about the cabinet's origin after which its z points up; None where it does already."""
    if scene.cabinet.lean_deg < LEVEL_DEG:
        return None
    T = scene.cabinet.T_world_cabinet
    x, y = T[:2, 2] / np.hypot(*T[:2, 2])
    R = rotation_about((y, -x, 0.0), np.radians(scene.cabinet.lean_deg))
    return transform(p=T[:3, 3]) @ transform(R, -R @ T[:3, 3])


def turned_box(box: Array, T: Array) -> Array:
    """The box (6,), centre and size along the axes, around one that was turned by T (4, 4)."""
    return np.concatenate([apply(T, box[:3]), np.abs(T[:3, :3]) @ box[3:]])


def turned_scene(scene: Scene, T: Array) -> Scene:
    """A scene with everything in it turned by T (4, 4), the robot's base, too; but for the views of a camera, which stay as they were."""

    def body(b: Body) -> Body:
        return replace(b, T_world_body=T @ b.T_world_body)

    return replace(
        scene,
        robot=replace(scene.robot, T_world_base=T @ scene.robot.T_world_base),
        cabinet=replace(scene.cabinet, T_world_cabinet=T @ scene.cabinet.T_world_cabinet),
        objects=tuple(body(b) for b in scene.objects),
        obstacles=tuple(body(b) for b in scene.obstacles),
        target_box=None if scene.target_box is None else turned_box(scene.target_box, T),
        grasp=None if scene.grasp is None else turned_grasp(scene.grasp, T),
        grasps=tuple((turned_grasp(grasp, T), score) for grasp, score in scene.grasps),
    )


def more_upright(scene: Scene, settings: MotionSettings, lean_deg: float) -> tuple[Scene, MotionSettings]:
    """A scene that was turned by so many degrees, and settings for it, by which what is carried may lean by less: in the scene as it is it
    leans by up to twice as many more. A third of each limit is left, whatever the lean: the verdict has the last word."""

    def less(most_deg: float) -> float:
        return most_deg if most_deg >= MOST_TILT_DEG else max(LEAST_TILT_DEG, most_deg / 3, most_deg - 2 * lean_deg)

    objects = tuple(body if body.max_tilt_deg is None else replace(body, max_tilt_deg=less(body.max_tilt_deg)) for body in scene.objects)
    return replace(scene, objects=objects), replace(settings, max_tilt_deg=less(settings.max_tilt_deg))


def turned_plan(plan: Plan, T_upright_world: Array) -> Plan:
    """The plan of a scene that was turned, for the scene as it is: its motions are the same, for the robot was turned along."""
    T = inverse(T_upright_world)
    moves = tuple(replace(m, T_world_from=T @ m.T_world_from, T_world_to=T @ m.T_world_to) for m in plan.moves)
    return replace(plan, moves=moves, grasp=None if plan.grasp is None else turned_grasp(plan.grasp, T))


def turned_grasp(grasp: Grasp, T: Array) -> Grasp:
    """A grasp turned by T (4, 4)."""
    return replace(grasp, T_world_hand=T @ grasp.T_world_hand)
