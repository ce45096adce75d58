"""The last word on a plan: FCL, at a resolution at which no point of the arm moves more than 2 mm between two samples.

It shares nothing with the compiled planner but the robot's hulls: another distance algorithm, on states built again from the motions
themselves, every object where the motions say it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.arm import join_parts, make_parts
from kinematics.collision import Verdict
from kinematics.exact import reach
from kinematics.robot import Robot
from kinematics.scene import Held, Scene, State
from kinematics.shapes import convex_parts
from kinematics.transforms import Array, angle_between, apply, inverse
from planning.plan import Blocked, Motion

RESOLUTION_M = 0.002
SAME_M, SAME_RAD = 1e-3, 1e-3  # how far an object may jump when the hand takes it
DEEPEST_M = 1e-6  # contact is contact: only rounding is forgiven


def verify(robot: Robot, scene: Scene, motions: Sequence[Motion]) -> Blocked | None:
    """Replay motions from the scene's first state. None when all is well, else the first thing that is not.

    Checked: joint limits, no gap between motions, held objects taken from where they stand, and no contact outside may_touch.
    """
    verdict = Verdict(robot, scene)
    poses = scene.poses()
    before: Motion | None = None
    for number, motion in enumerate(motions):
        where = f"motion {number}, {motion.stage}"
        if (motion.q < robot.lower - 1e-9).any() or (motion.q > robot.upper + 1e-9).any():
            return Blocked("verify", detail=f"{where}: a joint leaves its limits")
        if before is not None and np.abs(before.q[-1] - motion.q[0]).max() > 1e-9:
            return Blocked("verify", detail=f"{where}: it does not start where the one before ends")
        if before is not None and before.held and (motion.held is None or motion.held.body != before.held.body):
            poses[before.held.body] = hand_pose(robot, scene, before.q[-1]) @ before.held.T_hand_body
        if motion.held and motion.held.body in poses:
            jump = inverse(poses.pop(motion.held.body)) @ hand_pose(robot, scene, motion.q[0]) @ motion.held.T_hand_body
            if np.linalg.norm(jump[:3, 3]) > SAME_M or angle_between(np.eye(3), jump[:3, :3]) > SAME_RAD:
                return Blocked("verify", "hand", motion.held.body, detail=f"{where}: the object is not where the hand takes it")
        bound = speed_bound(robot, scene, motion)
        for q in samples(motion.q, bound):
            contacts = verdict.contacts(State(q, poses, motion.held), motion.may_touch)
            if contacts and contacts[0].depth_m > DEEPEST_M:
                worst = contacts[0]
                return Blocked("verify", worst.a, worst.b, worst.depth_m, where)
        before = motion
    return None


def hand_pose(robot: Robot, scene: Scene, q: Array) -> Array:
    """T_world_hand (4, 4) at a full configuration q (J,)."""
    return np.asarray(scene.robot.T_world_base @ robot.tree.poses(q)[robot.tree.index["hand"]])


def samples(q: Array, bound: Array) -> Array:
    """Configurations (N, J) along waypoints q (K, J), close enough that nothing moves more than RESOLUTION_M from one to the next.

    bound (P, J): metres that each part moves at most, per unit of each joint.
    """
    rows = [q[:1]]
    for a, b in zip(q[:-1], q[1:]):
        n = max(1, int(np.ceil((bound @ np.abs(b - a)).max() / RESOLUTION_M)))
        rows.append(a + np.arange(1, n + 1)[:, None] / n * (b - a))
    return np.concatenate(rows)


def speed_bound(robot: Robot, scene: Scene, motion: Motion) -> Array:
    """Metres (P, J) that each link hull, and the held object, moves at most per unit of each joint, anywhere in the joints' range."""
    gripper = float(motion.q[0, robot.gripper_joint])
    T_base = scene.robot.T_world_base
    chain = robot.chain(T_base)
    parts, links = robot.parts(gripper, T_base)
    if motion.held is not None:
        frame, T_frame_hand = robot.frame_of_links(gripper, T_base)["hand"]
        T = T_frame_hand @ motion.held.T_hand_body
        pieces = [apply(T, part) for part in convex_parts(_shape(scene, motion.held))]
        parts, links = join_parts(parts, make_parts([frame] * len(pieces), pieces)), (*links, *[motion.held.body] * len(pieces))
    bound = np.zeros((len(links), len(robot.joint_names)))
    per_joint = reach(chain, parts)
    for k, j in enumerate(chain.q_index):
        bound[:, robot.arm_joints[j]] += per_joint[k] * abs(chain.scale[k])
    fingers = [i for i, link in enumerate(links) if link in robot.fingers]
    bound[fingers, robot.gripper_joint] = 0.25  # m per rad, and more than the 1 m per m of a sliding finger needs below
    if robot.tree.kind[next(i for i in range(len(robot.tree.names)) if robot.tree.q_index[i] == robot.gripper_joint)] == 2:
        bound[fingers, robot.gripper_joint] = 1.0
    return bound


def _shape(scene: Scene, held: Held):  # type: ignore[no-untyped-def]
    return scene.body(held.body).shape
