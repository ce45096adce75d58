"""Where everything is while motions follow one another, and how far each motion keeps from what it may not touch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from kinematics.collision.broad_phase import BroadPhase
from kinematics.collision.clearance import least_clearance
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import Array
from planning.motion.sampling import RESOLUTION_M, samples, while_fingers_move
from planning.plan import Motion


def replay(robot: Robot, scene: Scene, motions: Sequence[Motion]) -> Iterator[tuple[Motion, dict[str, Array]]]:
    """Each of the motions with the poses of the objects that stand while it lasts, from the scene's first state on: what a hand lets go of
    stays where it is then."""
    poses, before = scene.poses(), None
    for motion in motions:
        if before is not None and before.held and (motion.held is None or motion.held.body != before.held.body):
            poses[before.held.body] = hand_poses(robot, scene, before.q[-1]) @ before.held.T_hand_body
        if motion.held is not None:
            poses.pop(motion.held.body, None)
        yield motion, dict(poses)
        before = motion


def with_clearances(
    robot: Robot,
    scene: Scene,
    motions: Sequence[Motion],
    bodies: BroadPhase | None = None,
    sampled: Callable[[Motion], Array] | None = None,
) -> tuple[Motion, ...]:
    """The same motions, each with the least distance that it keeps outside allowed contacts, and between which two bodies that is.

    bodies: the scene's, packed before. sampled: `sampling.samples` of this scene's motions, if they are known already.
    """
    bodies, out = bodies or BroadPhase(robot, scene), list[Motion]()
    for motion, poses in replay(robot, scene, motions):
        rows = samples(robot, scene, motion) if sampled is None else sampled(motion)
        measured = (
            least_clearance(bodies, some, poses, motion.held, motion.allowed_contacts, RESOLUTION_M)
            for some in while_fingers_move(robot, rows)
        )
        found = min((c for c in measured if c is not None), key=lambda c: c.distance_m, default=None)
        distance, between = (None, None) if found is None else (found.distance_m, found.between)
        out.append(replace(motion, clearance_m=distance, clearance_between=between))
    return tuple(out)


def hand_poses(robot: Robot, scene: Scene, q: Array) -> Array:
    """T_world_hand (..., 4, 4) at full configurations q (..., J)."""
    return np.asarray(scene.robot.T_world_base @ robot.tree.link("hand", q))
