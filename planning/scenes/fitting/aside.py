"""Limbs that no plan moves, a robot's other arm above all: put where they are not in the way of a cabinet ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.collision.fcl_solids import hull_solid, near_pairs, touch
from kinematics.robots.robot import Robot
from kinematics.robots.tree import FIXED, SLIDES, TURNS, Tree
from kinematics.transforms import Array

AHEAD_M = 0.1  # a limb is put aside that reaches so much further ahead than the trunk
TRIES = 1000  # configurations of a limb that are looked at
ACROSS, OUT = 0.5, 0.25
"""How much it counts, beside a metre ahead, that a limb reaches over to the working arm's side, and away from the robot."""


@dataclass(frozen=True)
class Limb:
    """A branch of the tree that is not the working arm's. root: its first moving link; joints: indices in q of those that move it, up to
    where it branches into fingers."""

    root: int
    links: frozenset[str]
    joints: tuple[int, ...]


def aside(robot: Robot, facing: float) -> dict[str, float]:
    """Joint values by name with which limbs that reach ahead of the trunk, where a cabinet is to stand, or touch something at home, are out
    of the way: free of everything but the working arm, the least far ahead first. facing: where ahead is, yaw in rad. The same robot
    always gives the same.
    """
    values, q, limbs = dict[str, float](), _half_way_up(robot), _limbs(robot)
    moved = frozenset().union(*(limb.links for limb in limbs), *(_below(robot, i) for i in _turning(robot)))
    ahead = np.array([np.cos(facing), np.sin(facing), 0.0])
    trunk = _points(robot, {hull.link for hull in robot.hulls} - moved, q[None])[0]
    if not len(trunk):
        return {}
    front, lowest = float((trunk @ ahead).max()), float(trunk[:, 2].min())
    for limb in limbs:
        at_home = _points(robot, limb.links, q[None])[0]
        free = _Free(robot, limb)
        may_stay, carries = free(q), at_home[:, 2].min() < lowest  # what reaches lower than the trunk
        if may_stay and (carries or (at_home @ ahead).max() <= front + AHEAD_M):
            continue
        tried = _tried(robot, limb, q)
        points = _points(robot, limb.links, tried)
        beyond = np.maximum((points @ ahead).max(1), front)
        out = np.hypot(points[..., 0], points[..., 1]).max(1)
        across = np.maximum((points @ _to_the_arm(robot, limb, ahead)).max(1), 0.0)
        cost = beyond + ACROSS * across + OUT * out + np.where(points[..., 2].min(1) < lowest, np.inf, 0.0)
        most = cost[0] if may_stay else np.inf
        best = next((k for k in np.argsort(cost, kind="stable") if cost[k] < most and free(tried[k])), None)
        if best is not None:
            q = tried[best]
            values |= {robot.joint_names[j]: round(float(q[j]), 4) for j in limb.joints}
    return values


def _limbs(robot: Robot) -> list[Limb]:
    """The branches that other joints than the arm's and the gripper's move, but for what the hand carries."""
    tree, own, found = robot.tree, {*robot.arm_joints, robot.gripper_joint}, []
    other = [tree.kind[i] != FIXED and int(tree.q_index[i]) not in own for i in range(len(tree.names))]
    for i, name in enumerate(tree.names):
        if other[i] and name not in robot.hand_links and not any(other[k] for k in tree.path(i)[:-1]):
            links = _below(robot, i)
            if any(hull.link in links for hull in robot.hulls):
                found.append(Limb(i, links, tuple(int(tree.q_index[k]) for k in _stem(robot.tree, i))))
    return found


def _stem(tree: Tree, root: int) -> list[int]:
    """The moving links from a branch's root on, up to where more than one moves on the same."""
    stem, ends = [root], [root]
    while len(ends) == 1:
        moving = [i for i in tree.below(root) if tree.kind[i] != FIXED]
        ends = [i for i in moving if [k for k in tree.path(i)[:-1] if tree.kind[k] != FIXED][-1:] == stem[-1:]]
        stem += ends if len(ends) == 1 else []
    return stem


def _half_way_up(robot: Robot) -> Array:
    """Home (J,), but with the arm's sliders, which may lift the limbs too, in the middle of their range."""
    q = robot.home.copy()
    for j in (int(robot.tree.q_index[i]) for i in robot.tree.path(robot.tree.index["hand"]) if robot.tree.kind[i] == SLIDES):
        q[j] = (robot.lower[j] + robot.upper[j]) / 2
    return np.asarray(q)


def _turning(robot: Robot) -> list[int]:
    """The links that the working arm's joints turn."""
    tree = robot.tree
    return [i for i in tree.path(tree.index["hand"]) if tree.kind[i] == TURNS and int(tree.q_index[i]) in robot.arm_joints]


def _below(robot: Robot, root: int) -> frozenset[str]:
    """A link and all that hang on it."""
    return frozenset(robot.tree.names[i] for i in robot.tree.below(root))


def _to_the_arm(robot: Robot, limb: Limb, ahead: Array) -> Array:
    """The level direction (3,) across, from a limb to the working arm."""
    poses, tree = robot.tree.poses(robot.home), robot.tree
    arm = next(i for i in tree.path(tree.index["hand"]) if i not in tree.path(limb.root) and tree.kind[i] != FIXED)
    across = np.array([-ahead[1], ahead[0], 0.0])
    return np.asarray(across * np.sign((poses[arm, :3, 3] - poses[limb.root, :3, 3]) @ across))


def _tried(robot: Robot, limb: Limb, q: Array) -> Array:
    """Configurations (N, J): q (J,) first, then with the limb's joints at random."""
    joints, rng = list(limb.joints), np.random.default_rng(0)
    low, high = (np.where(np.isfinite(b), b, s * np.pi)[joints] for b, s in ((robot.lower, -1.0), (robot.upper, 1.0)))
    tried = np.tile(q, (TRIES, 1))
    tried[1:, joints] = rng.uniform(low, high, (TRIES - 1, len(joints)))
    return tried


def _points(robot: Robot, links: Sequence[str] | frozenset[str] | set[str], q: Array) -> Array:
    """The vertices (N, V, 3) of some links' hulls at configurations (N, J), in the base frame."""
    poses, index = robot.tree.poses(q), robot.tree.index
    at = [poses[:, index[h.link], :3, :3] @ h.vertices.T + poses[:, index[h.link], :3, 3:] for h in robot.hulls if h.link in links]
    return np.concatenate(at, -1).swapaxes(1, 2) if at else np.empty((len(q), 0, 3))


class _Free:
    """Whether a limb touches neither itself nor anything but the working arm."""

    def __init__(self, robot: Robot, limb: Limb) -> None:
        hand, to_limb = robot.tree.path(robot.tree.index["hand"]), robot.tree.path(limb.root)
        arm = frozenset().union(*(_below(robot, i) for i in hand if i not in to_limb))
        solids = [hull_solid(h.link, h.vertices, h.faces) for h in robot.hulls if h.link not in arm]
        self._robot, self._all, self._limb = robot, solids, [s for s in solids if s.name in limb.links]
        joints, tree = {*limb.joints}, robot.tree
        self._moved_by = {name: joints & {int(tree.q_index[k]) for k in tree.path(i)} for i, name in enumerate(tree.names)}

    def __call__(self, q: Array) -> bool:
        """At a configuration (J,)."""
        poses, skip = self._robot.link_poses(q), self._robot.skip
        for solid in self._all:
            solid.move(poses[solid.name])
        near = ((self._limb[i], self._all[k]) for i, k in near_pairs(self._limb, self._all))
        asked = ((a, b) for a, b in near if self._moved_by[a.name] != self._moved_by[b.name] and frozenset((a.name, b.name)) not in skip)
        return not any(touch(a, b) is not None for a, b in asked)
