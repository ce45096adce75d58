"""Where a look helps: the space not yet seen that the arm would sweep on its way to a grasp.

A view that reveals much seldom reveals the little that keeps the arm from its target. So each way to a grasp names the voxels that it
would enter and nobody has seen, and the next views are chosen for these first, those of the ways that lack least before the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kinematics.chain import Int, forward
from kinematics.collision.posed_geometry import PosedGeometry
from kinematics.inverse import descend
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Grasp, Scene
from kinematics.transforms import Array, apply, transform
from perception.belief import Belief
from perception.mapping.voxels import Voxels
from planning.grasping.finger_grasps import open_width, sample_grasps
from planning.grasping.pads import pad_of
from planning.motion.cell.workcell import Workcell
from planning.motion.search.reaching import APPROACH_M, LARGEST_TURN, LIFT_M
from planning.sensing.unknown_space import unknown_mask

GRASPS, SOLUTIONS = 8, 3  # grasps of one object, and arm configurations of one grasp, that are looked at
BEST = 3  # of these ways, the ones that lack least
SHARE = 0.05  # what all the voxels of one way count, as a share of the space; the ways behind it count half of it each
LIFTED_M = 0.002  # room around a lifted object
SAMPLES = 8  # steps on the straight way to a grasp


def wanted(empty_scene: Scene, robot: Robot, belief: Belief, names: Sequence[str] = (), unseen: NDArray[np.bool_] | None = None) -> Array:
    """How much more the voxels (X, Y, Z) count that are in the way to the target's grasp and to `names`, objects that are to be moved.

    In shares of the space, to be added to a voxel's own; all 0 when nothing that was not seen is in the way.
    unseen (X, Y, Z): the voxels that may be in the way; by default all that may hold what nobody has seen.
    """
    voxels, bodies = belief.voxels, belief.bodies
    cell = Workcell(robot, empty_scene, iterations=1, time_budget_s=None)
    full = Workcell(robot, replace(empty_scene, objects=bodies), iterations=1, time_budget_s=None)
    unknown_space = np.argwhere(unknown_mask(voxels, bodies) if unseen is None else unseen)
    out = np.zeros(voxels.state.shape)
    for name in (empty_scene.target_name, *names):
        body = belief.body(name)
        grasps = [empty_scene.x_g] if name == empty_scene.target_name else _grasps(empty_scene, robot, body)
        lifted = np.flatnonzero(_above(voxels, body)[tuple(unknown_space.T)])
        ways = [(b, np.union1d(rows, lifted)) for g in grasps for b, rows in _ways(cell, full, g, voxels, unknown_space)]
        for rank, (_, rows) in enumerate(sorted((w for w in ways if len(w[1])), key=lambda w: (w[0], len(w[1])))[:BEST]):
            out[tuple(unknown_space[rows].T)] += SHARE / 2**rank / len(rows)
    return out


def _above(voxels: Voxels, body: Body | None) -> NDArray[np.bool_]:
    """The voxels (X, Y, Z) that an object enters when it is lifted."""
    if body is None:
        return np.zeros(voxels.state.shape, np.bool_)
    T = body.T_world_body
    return voxels.touched(replace(body, T_world_body=transform(T[:3, :3], T[:3, 3] + np.array([0.0, 0.0, LIFT_M]))), LIFTED_M)


def _grasps(empty_scene: Scene, robot: Robot, body: Body | None) -> Iterable[Grasp]:
    """The most natural grasps of an object; none of one that was not found."""
    if body is None:
        return []
    to_body = body.T_world_body[:2, 3] - empty_scene.robot.T_world_base[:2, 3]
    approaches = [a for a in APPROACHES if a in empty_scene.approaches]
    floor_z = float(empty_scene.cabinet.T_world_cabinet[2, 3])
    toward = float(np.arctan2(to_body[1], to_body[0]))
    return islice(sample_grasps(body, robot.opening, approaches, floor_z, toward, pad=pad_of(robot)), GRASPS)


def _ways(cell: Workcell, full: Workcell, grasp: Grasp, voxels: Voxels, unknown_space: Int) -> list[tuple[bool, NDArray[np.intp]]]:
    """For each way to a grasp: whether an object that was seen blocks it, and which of the unseen voxels (N, 3) it sweeps.

    cell: the walls alone; full: with the objects.
    """
    robot = cell.robot
    opened = robot.opening.value_at(open_width(grasp.width_m, robot.opening))
    posed = cell.arm.posed(opened)
    alone, among = cell.problem({}, opened), full.problem(full.scene.poses(), opened)
    out = []
    for q in islice((q for q in cell.ik(grasp.T_world_hand) if cell.touch(alone, q) is None), SOLUTIONS):
        back = _straight(cell, q, grasp.T_world_hand, -APPROACH_M * grasp.T_world_hand[:3, 2], SAMPLES)
        up = _straight(cell, q, grasp.T_world_hand, np.array([0.0, 0.0, LIFT_M]), 2)
        if back is None or up is None:
            continue
        way = np.concatenate([back, up])
        blocked = any(full.touch(among, row) is not None for row in back)
        out.append((blocked, _swept(cell, posed, way, voxels, unknown_space)))
    return out


def _straight(cell: Workcell, q: Array, T_world_hand: Array, by: Array, steps: int) -> Array | None:
    """Configurations (steps + 1, A) that carry the hand from T_world_hand, where q (A,) puts it, straight by a vector (3,); or None."""
    hand, T, way = cell.hand, T_world_hand.copy(), [q]
    for k in range(1, steps + 1):
        T[:3, 3] = T_world_hand[:3, 3] + k / steps * by
        row = way[-1].copy()
        if not descend(hand.backing, hand.T_frame_hand, T, row, hand.frames, hand.work, 30) or np.abs(row - way[-1]).max() > LARGEST_TURN:
            return None
        way.append(row)
    return np.array(way)


def _swept(cell: Workcell, posed: PosedGeometry, way: Array, voxels: Voxels, unknown_space: Int) -> NDArray[np.intp]:
    """Which of the voxels (N, 3) the arm comes to on a way (K, A), by the balls that cover its links; a few more than it touches."""
    chain, frames = cell.arm.chain, np.empty((len(cell.arm.chain.q_index) + 1, 4, 4))
    carrier = np.repeat(posed.frame, np.diff(posed.fine_start))
    moving = carrier > 0
    centres = []
    for q in way:
        forward(chain, q, frames)
        T = frames[carrier[moving]]
        centres.append(np.einsum("nij,nj->ni", T[:, :3, :3], posed.fine[moving, :3]) + T[:, :3, 3])
    radius = np.tile(posed.fine[moving, 3], len(way))
    points = apply(voxels.T_world_grid, (unknown_space + 0.5) * voxels.step)
    balls = np.concatenate(centres)
    low, high = balls.min(0) - radius.max(), balls.max(0) + radius.max()
    rows = np.flatnonzero(((points > low) & (points < high)).all(1))
    half = 0.5 * float(np.linalg.norm(voxels.step))
    swept = np.zeros(len(rows), bool)
    for least, most in ((0.0, 0.012), (0.012, 0.03), (0.03, np.inf)):  # balls of one size at a time, so that the nearest one decides
        of_size = (radius > least) & (radius <= most)
        if of_size.any():
            reach = float(radius[of_size].max()) + half
            near, _ = cKDTree(balls[of_size]).query(points[rows], distance_upper_bound=reach)
            swept |= near < reach
    return rows[swept]
