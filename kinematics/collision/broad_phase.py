"""The broad phase of the final check: which pairs of solids the sphere covers prove apart along a motion, so that FCL need not be asked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision.geometry import Asked, make_queries
from kinematics.collision.sphere_batch import scratch_for
from kinematics.collision.sphere_check import open_rows
from kinematics.collision.stretches import PackedStretches, allow
from kinematics.robots.robot import Robot
from kinematics.transforms import Array


@dataclass(frozen=True, eq=False)
class BroadPhaseResult:
    """What the covers say about pairs of solids along a stretch of a motion.

    names: of the solids: P parts (link hulls in the robot's order, then the pieces of a held object), then what stands (walls, objects).
    judged (P, P + B): pairs that the covers were asked about, the later of two parts first. At configuration rows[i], in rising order, the
    judged pair a[i], b[i] may touch; wherever a judged pair is not listed it is apart for certain.
    """

    names: tuple[str, ...]
    judged: NDArray[np.bool_]
    rows: Int
    a: Int
    b: Int


def broad_phase(packed: PackedStretches) -> list[BroadPhaseResult]:
    """Ask the covers about every stretch, besides its allowed contacts.

    Not judged, but left to FCL: pairs on one frame of the arm, such as the palm and a held object; the fingers when they move; and
    everything when a joint that is neither the arm's nor the gripper's is not at home.
    """
    asked, judged, names = list[Asked](), list[NDArray[np.bool_]](), list[tuple[str, ...]]()
    known: dict[tuple[tuple[str, ...], int], NDArray[np.bool_]] = {}
    for s in range(len(packed.stretches)):
        (parts, links), (bodies, standing) = packed.parts(s, packed.openings[s][0]), packed.bodies(s)
        key, P = (links, len(standing)), len(links)
        if key not in known:
            known[key] = _judgeable(packed, packed.posed.frame[parts], len(standing))
        judge, all_names = known[key].copy(), links + standing
        _leave_out(packed, s, judge, all_names)
        asked.append(Asked((packed.starts[s], packed.starts[s + 1]), parts, bodies, judge[:, P:], np.argwhere(judge[:, :P])))
        judged.append(judge)
        names.append(all_names)
    if not asked:
        return []
    model, world = packed.sphere_model, packed.sphere_world
    scratch = scratch_for(len(model.T), len(model.frame), len(world.kind), 0)
    found = open_rows(model, world, make_queries(asked), packed.arm, scratch)
    ends = np.searchsorted(found[:, 0], packed.starts)
    return [
        BroadPhaseResult(names[s], judged[s], found[i:j, 0] - packed.starts[s], found[i:j, 2], found[i:j, 3])
        for s, (i, j) in enumerate(pairwise(ends.tolist()))
    ]


def _judgeable(packed: PackedStretches, frame: Int, bodies: int) -> NDArray[np.bool_]:
    """The pairs (P, P + B) of parts on frames (P,) that the covers can be asked about if no contact is allowed."""
    P, own, pairs = len(frame), len(packed.links), packed.robot.self_pairs
    table = np.zeros((P, P + bodies), np.bool_)
    table[:, P:] = (frame > 0)[:, None]
    table[pairs[:, 0], pairs[:, 1]] = True
    table[own:, :own] = True
    table[:, :P] &= frame[:, None] != frame
    return table


def _leave_out(packed: PackedStretches, s: int, judge: NDArray[np.bool_], names: tuple[str, ...]) -> None:
    """Take out of a table (P, P + B) what stretch s allows to touch, and what the covers can't judge in it."""
    stretch, own = packed.stretches[s], len(packed.links)
    allow(judge, names, stretch.allowed_contacts)
    if len(packed.openings[s]) > 1:
        judge[:own][packed.model.fingers] = False
        judge[:, :own][:, packed.model.fingers] = False
    if elsewhere(packed.robot, stretch.q):
        judge[:] = False


def elsewhere(robot: Robot, q: Array) -> bool:
    """Whether a joint that the robot collision model takes to be at home is not, at any of q (N, J)."""
    others = _others(robot)
    return bool(len(others)) and bool((q[:, others] != robot.home[others]).any())


@lru_cache(maxsize=16)
def _others(robot: Robot) -> Int:
    """The joints that are neither the arm's nor the gripper's."""
    return np.setdiff1d(np.arange(len(robot.joint_names)), [*robot.arm_joints, robot.gripper_joint])
