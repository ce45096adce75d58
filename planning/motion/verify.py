"""The last word on a plan: FCL, at a resolution at which no point of the arm moves more than 2 mm between two samples.

It works on states built again from the motions themselves, every object where they say it is, and asks another engine than the planner:
FCL. Samples that the sphere covers prove free (kinematics.spheres) are not asked about.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.collision import Verdict
from kinematics.coverage import Sieve
from kinematics.robot import Robot
from kinematics.scene import Held, Scene
from kinematics.shapes import bounds, box_corners
from kinematics.transforms import Array, angle_between, inverse
from planning.plan import Blocked, Motion

RESOLUTION_M = 0.002
COARSE, SLACK = 0.03, 1.1  # speeds are measured over pieces of 0.03 rad (or m), within which they vary by less than a tenth
SAME_M, SAME_RAD = 1e-3, 1e-3  # how far an object may jump when the hand takes it
_BATCH = 512


def verify(robot: Robot, scene: Scene, motions: Sequence[Motion]) -> Blocked | None:
    """Replay motions from the scene's first state. None when all is well, else the first thing that is not.

    Checked: joint limits, no gap between motions, held objects taken from where they stand, and no contact outside may_touch.
    """
    verdict, sieve = Verdict(robot, scene), Sieve(robot, scene)
    poses = scene.poses()
    before: Motion | None = None
    for number, motion in enumerate(motions):
        where = f"motion {number}, {motion.stage}"
        if (motion.q < robot.lower - 1e-9).any() or (motion.q > robot.upper + 1e-9).any():
            return Blocked("verify", detail=f"{where}: a joint leaves its limits")
        if before is not None and np.abs(before.q[-1] - motion.q[0]).max() > 1e-9:
            return Blocked("verify", detail=f"{where}: it does not start where the one before ends")
        if before is not None and before.held and (motion.held is None or motion.held.body != before.held.body):
            poses[before.held.body] = hand_poses(robot, scene, before.q[-1]) @ before.held.T_hand_body
        if motion.held and motion.held.body in poses:
            jump = inverse(poses.pop(motion.held.body)) @ hand_poses(robot, scene, motion.q[0]) @ motion.held.T_hand_body
            if np.linalg.norm(jump[:3, 3]) > SAME_M or angle_between(np.eye(3), jump[:3, :3]) > SAME_RAD:
                return Blocked("verify", "hand", motion.held.body, detail=f"{where}: the object is not where the hand takes it")
        rows = samples(robot, scene, motion)
        rows = rows[sieve.undecided(rows, poses, motion.held, motion.may_touch)]
        for first in range(0, len(rows), _BATCH):
            found = verdict.first_contacts(rows[first : first + _BATCH], poses, motion.held, motion.may_touch)
            if found is not None:
                worst = found[1][0]
                return Blocked("verify", worst.a, worst.b, worst.depth_m, where)
        before = motion
    return None


def hand_poses(robot: Robot, scene: Scene, q: Array) -> Array:
    """T_world_hand (..., 4, 4) at full configurations q (..., J)."""
    return np.asarray(scene.robot.T_world_base @ robot.tree.poses(q)[..., robot.tree.index["hand"], :, :])


def samples(robot: Robot, scene: Scene, motion: Motion) -> Array:
    """Configurations (N, J) along a motion, so close that no point of the arm or the held object moves more than RESOLUTION_M from one to
    the next.

    Between two poses of a body the displacement of its points is greatest at a corner of any box around it, so eight corners tell.
    """
    corners = _corners(robot, scene, motion.held)
    rows = [motion.q[:1]]
    for a, b in zip(motion.q[:-1], motion.q[1:]):
        coarse = max(1, int(np.ceil(np.abs(b - a).max() / COARSE)))
        steps = _steps(robot, corners, a + np.arange(coarse + 1)[:, None] / coarse * (b - a))
        fine = np.maximum(1, np.ceil(steps * SLACK / RESOLUTION_M)).astype(int)
        share = np.concatenate([i + np.arange(1, n + 1) / n for i, n in enumerate(fine)]) / coarse
        rows.append(a + share[:, None] * (b - a))
    return np.concatenate(rows)


def _corners(robot: Robot, scene: Scene, held: Held | None) -> list[tuple[int, Array]]:
    """For every link hull, and the held object: the link that carries it and the corners (8, 3) of a box around it, in that link."""
    index = robot.tree.index
    out = []
    for hull in robot.hulls:
        low, high = hull.vertices.min(0), hull.vertices.max(0)
        out.append((index[hull.link], (low + high) / 2 + box_corners((high - low) / 2)))
    if held is not None:
        low, high = bounds(scene.body(held.body).shape, held.T_hand_body)
        out.append((index["hand"], (low + high) / 2 + box_corners((high - low) / 2)))
    return out


def _steps(robot: Robot, corners: list[tuple[int, Array]], q: Array) -> Array:
    """How far (N - 1,) any corner moves at most between neighbouring configurations of q (N, J), in metres."""
    T = robot.tree.poses(q)[:, [link for link, _ in corners]]
    points = np.stack([c for _, c in corners])  # (S, 8, 3)
    at = T[..., None, :3, 3] + points @ np.swapaxes(T[..., :3, :3], -1, -2)
    return np.asarray(np.linalg.norm(np.diff(at, axis=0), axis=-1).max((1, 2)))
