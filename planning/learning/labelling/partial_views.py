"""A labelled state as the camera may have seen it: after a few views, with objects still hidden and regions still dark.

The labels stay the truth's; what changes is what a network is told beside them, as in `plan --sense`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.scene import State
from kinematics.shapes import Box, bounds
from kinematics.transforms import Array, inverse, transform
from perception.belief import FLAG_HEIGHT_M, Belief, observation
from perception.mapping.next_best_view import sample_poses
from perception.mapping.voxels import FREE, Voxels, unknown_voxels
from perception.objects.segment import GROWN_M, segment
from perception.observation import Observation, boxes_in
from perception.rendering.synthetic_camera import DEFAULT, synthetic_camera
from planning.learning.labelling.labels import Row, movable
from planning.motion.cell.workcell import IkSearch
from planning.motion.pick_place import Motions

VIEWS = (2, 12)  # the least and the most, the first one from where the arm waits; half a dozen well chosen ones show as much as twelve
COARSELY = DEFAULT.scaled(1 / 3)  # finds 98.6 % of the same objects, boxes 0.6 mm off (median), in a third of the time
_POSES = 12  # camera poses that are tried for one that the arm can take


def partial_view(motions: Motions, state: State, row: Row, rng: np.random.Generator) -> Row | None:
    """The row of a state as a few views from anywhere within reach show it; None when they don't show the target.

    Objects that nobody saw are left out, labels and all.
    """
    views = int(rng.integers(VIEWS[0], VIEWS[1] + 1))
    seen = _look(motions, state, views, rng)
    if motions.scene.target_name not in seen.boxes:
        return None
    T = inverse(motions.scene.cabinet.T_world_cabinet)
    names = movable(motions.scene)
    kept = [i for i, name in enumerate(names) if name in seen.boxes]
    target, *objects = boxes_in(T, np.array([seen.boxes[name] for name in (motions.scene.target_name, *(names[i] for i in kept))]))
    return replace(
        row,
        views=views,
        target=target,
        objects=np.array(objects).reshape(-1, 6),
        regions=np.column_stack([row.regions[:, :3], seen.regions[:, 3]]),
        **{name: getattr(row, name)[kept] for name in ("blocks", "pickable", "opens", "first", "feasible", "hits", "shorter")},
    )


def _look(motions: Motions, state: State, views: int, rng: np.random.Generator) -> Observation:
    """What so many views tell of a state: the arm waits at the first, and stands anywhere free at the others."""
    scene, robot = motions.scene, motions.robot
    empty_scene = replace(scene, objects=(), observation=None)
    camera = synthetic_camera(robot, scene, state.poses, intrinsics=COARSELY)
    voxels, frames = _to_be_asked(motions, state), []
    for q in _stands(motions, state, views, rng):
        full = robot.with_arm(q, float(state.q[robot.gripper_joint]))
        frame = camera(scene.robot.T_world_base @ robot.link_poses(full)["camera"], full)
        voxels = voxels.fuse(frame.depth, frame.intrinsics, frame.T_world_camera, own=frame.arm)
        frames.append(frame)
    boxes = segment(frames, scene.cabinet, voxels)
    bodies = tuple(body for body in state.bodies(scene) if body.name in boxes)  # what a fit of what was seen comes to
    return observation(empty_scene, state.q, Belief(bodies, boxes, voxels))


def _to_be_asked(motions: Motions, state: State) -> Voxels:
    """A map in which only that is unknown of which boxes and flags are made: the floor's air, and what is around the objects, whose seen
    boxes grow by no more than they are wide (see `segment.grown`)."""
    scene, voxels = motions.scene, unknown_voxels(motions.scene.cabinet)
    asked, slack = np.zeros(voxels.state.shape, bool), 2 * float(voxels.step.max())
    asked[:, :, : int(np.ceil(FLAG_HEIGHT_M / voxels.step[2])) + 1] = True
    for name, pose in state.poses.items():
        low, high = bounds(scene.body(name).shape, pose)
        wide = max(float((high - low)[:2].max()), GROWN_M) + slack
        size, up = high - low + [2 * wide, 2 * wide, 0.0], np.array([0.0, 0.0, GROWN_M + slack])
        low, high = bounds(Box(size + up), inverse(voxels.T_world_grid) @ transform(p=(low + high + up) / 2))
        first, last = np.clip(np.floor(low / voxels.step), 0, None).astype(int), np.ceil(high / voxels.step).astype(int)
        asked[first[0] : last[0], first[1] : last[1], first[2] : last[2]] = True
    return voxels.marked(~asked, FREE)


def _stands(motions: Motions, state: State, views: int, rng: np.random.Generator) -> list[Array]:
    """Arm configurations (A,) with the camera towards the cabinet; fewer than `views` when they can't be found."""
    cell, robot = motions.cell, motions.robot
    T_camera_hand = inverse(robot.link_poses(state.q)["camera"]) @ robot.link_poses(state.q)["hand"]
    free = cell.problem(state.poses, float(state.q[robot.gripper_joint]))
    out = [robot.arm_q(state.q)]
    for _ in range(_POSES * (views - 1)):
        if len(out) == views:
            break
        (T,) = sample_poses(motions.scene.cabinet, 1, rng)
        out += [q for q in cell.ik(T @ T_camera_hand, IkSearch(4))[:2] if cell.touch(free, q) is None][:1]
    return out
