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

from kinematics.arm import Int, forward
from kinematics.rig import Rig
from kinematics.robot import Robot
from kinematics.scene import APPROACHES, Grasp, Scene
from kinematics.transforms import Array, apply, transform
from perception.belief import Belief
from perception.voxels import Voxels
from planning.grasps import open_width, sample_grasps
from planning.motion.reaching import APPROACH_M, LIFT_M
from planning.motion.workcell import Workcell
from planning.sensing import dark

GRASPS, SOLUTIONS = 8, 3  # grasps of one object, and arm configurations of one grasp, that are looked at
BEST = 3  # of these ways, the ones that lack least
SHARE = 0.05  # what all the voxels of one way count, as a share of the space; the ways behind it count half of it each
SAMPLES = 5  # configurations on the straight way to a grasp
CLOSE_RAD = 0.8  # a joint that turns further on the short way in is passing a singularity


def wanted(blank: Scene, robot: Robot, belief: Belief, names: Sequence[str] = ()) -> Array:
    """How much more the voxels (X, Y, Z) count that are in the way to the target's grasp and to `names`, objects that are to be moved.

    In shares of the space, to be added to a voxel's own; all 0 when nothing that was not seen is in the way.
    """
    voxels, bodies = belief.voxels, belief.bodies
    cell = Workcell(robot, blank, iterations=1, time_budget_s=None)
    full = Workcell(robot, _with(blank, belief), iterations=1, time_budget_s=None)
    unseen = np.argwhere(dark(voxels, bodies))
    out = np.zeros(voxels.state.shape)
    for grasps in ([blank.grasp], *(_grasps(blank, robot, belief, name) for name in names)):
        ways = [way for grasp in grasps for way in _ways(cell, full, grasp, voxels, unseen)]
        for rank, (_, rows) in enumerate(sorted((w for w in ways if len(w[1])), key=lambda w: (w[0], len(w[1])))[:BEST]):
            out[tuple(unseen[rows].T)] += SHARE / 2**rank / len(rows)
    return out


def _with(blank: Scene, belief: Belief) -> Scene:
    return replace(blank, objects=belief.bodies)


def _grasps(blank: Scene, robot: Robot, belief: Belief, name: str) -> Iterable[Grasp]:
    body = belief.body(name)
    if body is None:
        return []
    to_body = body.T_world_body[:2, 3] - blank.robot.T_world_base[:2, 3]
    approaches = [a for a in APPROACHES if a in blank.approaches]
    floor_z = float(blank.cabinet.T_world_cabinet[2, 3])
    toward = float(np.arctan2(to_body[1], to_body[0]))
    return islice(sample_grasps(body, robot.opening, approaches, floor_z, toward), GRASPS)


def _ways(cell: Workcell, full: Workcell, grasp: Grasp, voxels: Voxels, unseen: Int) -> list[tuple[bool, NDArray[np.intp]]]:
    """For each way to a grasp: whether an object that was seen blocks it, and which of the unseen voxels (N, 3) it sweeps.

    cell: the walls alone; full: with the objects.
    """
    robot = cell.robot
    opened = robot.opening.value_at(open_width(grasp.width_m, robot.opening))
    rig = cell.arm.rig(opened)
    alone, among = cell.problem({}, opened), full.problem(full.scene.poses(), opened)
    back = transform(p=[0.0, 0.0, -APPROACH_M])
    up = transform(p=[0.0, 0.0, LIFT_M])
    out = []
    for q in islice((q for q in cell.ik(grasp.T_world_hand) if cell.touch(alone, q) is None), SOLUTIONS):
        ends = [cell.ik(T, near=q, tries=4)[:1] for T in (grasp.T_world_hand @ back, up @ grasp.T_world_hand)]
        if any(len(e) == 0 or np.abs(e[0] - q).max() > CLOSE_RAD for e in ends):
            continue
        way = np.concatenate([ends[0][0] + np.linspace(0, 1, SAMPLES)[:, None] * (q - ends[0][0]), ends[1]])
        blocked = any(full.touch(among, row) is not None for row in way[:SAMPLES])
        out.append((blocked, _swept(cell, rig, way, voxels, unseen)))
    return out


def _swept(cell: Workcell, rig: Rig, way: Array, voxels: Voxels, unseen: Int) -> NDArray[np.intp]:
    """Which of the voxels (N, 3) the arm comes to on a way (K, A), by the balls that cover its links; a few more than it touches."""
    chain, frames = cell.arm.chain, np.empty((len(cell.arm.chain.q_index) + 1, 4, 4))
    carrier = np.repeat(rig.frame, np.diff(rig.fine_start))
    moving = carrier > 0
    centres = []
    for q in way:
        forward(chain, q, frames)
        T = frames[carrier[moving]]
        centres.append(np.einsum("nij,nj->ni", T[:, :3, :3], rig.fine[moving, :3]) + T[:, :3, 3])
    radius = np.tile(rig.fine[moving, 3], len(way))
    points = apply(voxels.T_world_grid, (unseen + 0.5) * voxels.step)
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
