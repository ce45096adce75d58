"""Where to look, when a scene out of recorded frames is not solved for what no frame has shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene, object_box
from kinematics.transforms import Array, apply, inverse
from perception.belief import Belief
from perception.camera import Intrinsics
from perception.mapping.next_best_view import InformationGain
from perception.mapping.voxels import FREE, OCCUPIED, UNKNOWN, Voxels
from perception.rendering.synthetic_camera import DEFAULT, RANGE_M
from planning.io.checked import Node
from planning.io.observation_documents import intrinsics_from
from planning.motion.pick_place import Motions
from planning.plan import Blocked, Plan
from planning.policies.unsolvable import Prover
from planning.sensing.focus import wanted
from planning.sensing.reachable_views import reachable_views
from planning.sensing.unknown_space import unknown_cells

STAGE = "look"
NEAR_M = 0.3
"""A view is told by where the camera is and by the point so far before it."""


def for_want_of_views(motions: Motions, plan: Plan, scene: Scene) -> Plan:
    """The plan of an unsolved scene out of frames; its reason is stage "look", with what to look at, when unseen space is why.

    motions: with which it was sought. scene: that of which the reason tells, in which the cabinet may lean. Unseen space is not why when it
    is proved that no moves would help even if all of it were free.
    """
    if plan.success or plan.reason is None or plan.reason.stage in ("scene", "verify"):
        return plan
    free = motions.if_free
    if plan.unsolvable is not None and Prover(free)(free.start()).unsolvable is not None:
        return plan
    stuck = () if plan.unsolvable is None else plan.unsolvable.stuck
    hindered = dict.fromkeys([*stuck, *(m.object for m in plan.moves if not m.done)])
    words = missing(motions.robot, scene, tuple(hindered))
    if words is None:
        return plan
    why = plan.reason
    return replace(plan, reason=Blocked(STAGE, why.link, why.body, detail=words), unsolvable=None, least_moves=None)


def missing(robot: Robot, scene: Scene, names: Sequence[str]) -> str | None:
    """What unseen space is in the ways to the target and to objects, `names`, and which view would show most of it; None without any."""
    voxels = seen_voxels(scene)
    if voxels is None:
        return None
    weight = wanted(scene, robot, Belief(scene.objects, {}, voxels), names)
    rows = np.argwhere(weight > 0)
    if not len(rows):
        return None
    at = voxels.centres(weight > 0)
    middle = np.average(at, axis=0, weights=weight[tuple(rows.T)])
    litres = 1e3 * voxels.voxel_m3 * len(rows)
    said = f"unseen space {_beside(scene, middle)} is in every way ({litres:.2f} litres around {_point(middle)})"
    view = _best_view(robot, scene, voxels, weight)
    if view is None:
        return f"{said}; no view that the arm can take from the outset would show it"
    return f"{said}: look from {_point(view[:3, 3])} towards {_point(view[:3, 3] + NEAR_M * view[:3, 2])}"


def seen_voxels(scene: Scene) -> Voxels | None:
    """The map that a scene's observation tells of: unknown, occupied by what was seen, or free; None when it tells of none."""
    unknown = unknown_cells(scene)
    if unknown is None:
        return None
    cells, boxes = unknown
    state = np.full(cells, FREE, np.uint8)
    voxels = Voxels(scene.cabinet, state)
    for body in scene.objects:
        state[voxels.touched(body)] = OCCUPIED
    for row in boxes:
        state[tuple(map(slice, row[:3], row[3:]))] = UNKNOWN
    return voxels


def _best_view(robot: Robot, scene: Scene, voxels: Voxels, weight: Array) -> Array | None:
    """The view T_world_camera (4, 4) that would reveal most of what is weighted (X, Y, Z); None when none would reveal any."""
    try:
        spots = reachable_views(robot, replace(scene, objects=()), intrinsics_of(scene))
    except ValueError:  # a robot without a camera in its hand: somebody else took the pictures
        return None
    best = InformationGain(voxels, spots.views, RANGE_M[0], weight).best(voxels, np.zeros(len(spots.T)), lambda _: True)
    return None if best is None or best[1] <= 0 else spots.T[best[0]]


def intrinsics_of(scene: Scene) -> Intrinsics:
    """The camera that took the last view of a scene's observation; the robot's own where it does not say."""
    views: Any = scene.observation["views"] if scene.observation else []
    if not views or "intrinsics" not in views[-1]:
        return DEFAULT
    return intrinsics_from(Node(views[-1]["intrinsics"], "intrinsics"))


def _beside(scene: Scene, point: Array) -> str:
    """Where a point (3,) is, told by the object that is nearest."""
    T = inverse(scene.cabinet.T_world_cabinet)

    def away(body: Body) -> float:
        box = object_box(body)
        return float(np.linalg.norm(np.maximum(np.abs(point - box[:3]) - box[3:] / 2, 0)))

    nearest = min(scene.objects, key=away, default=None)
    if nearest is None:
        return "in the cabinet"
    behind = float(apply(T, point[None])[0, 0] - apply(T, nearest.T_world_body[None, :3, 3])[0, 0])
    return f"{'behind' if behind > 0 else 'before'} {nearest.name}"


def _point(p: Array) -> str:
    return "({:.2f}, {:.2f}, {:.2f})".format(*p)
