"""How far a motion keeps from everything that it may not touch: the least distance at its samples, and between which two bodies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from kinematics.collision import edge_problem, path_clearance
from kinematics.collision.broad_phase import BroadPhase, allow
from kinematics.collision.edge_problem import MARGIN_M, Problem
from kinematics.collision.geometry import Query
from kinematics.scene import Held
from kinematics.transforms import Array

FARTHEST_M = 1.0
"""What is further off than this is not measured."""
FINGERS_AT = 3
"""At so many places of their way, both ends among them, fingers that move are looked at."""
GRIPPER_DECIMALS = 2
"""To so many decimals of their joint's value, rad or m, fingers on their way are told apart where a curve is drawn of clearances."""
TOLERANCE = 1e-3
"""Share of the distance by which a clearance may be given too low."""


@dataclass(frozen=True)
class Clearance:
    """The least distance of a motion in metres, never given too large, and the two bodies: a link or what is held, then what it is near
    to."""

    distance_m: float
    between: tuple[str, str]


def least_clearance(
    bodies: BroadPhase,
    q: Array,
    poses: Mapping[str, Array],
    held: Held | None,
    allowed_contacts: Iterable[tuple[str, str]],
    step_m: float,
) -> Clearance | None:
    """The clearance at configurations q (N, J), with objects standing at poses; None where nothing is within a metre.

    It is measured from the moving links and what is held to all that stands, and from what is held to the links that don't hold it; not
    among the robot's own links, nor between allowed contacts. step_m: from one row to the next no point moves further.
    """
    gripper, arm = q[:, bodies.robot.gripper_joint], np.ascontiguousarray(bodies.robot.arm_q(q))
    if (gripper == gripper[0]).all():
        return _least(bodies, arm, float(gripper[0]), poses, held, allowed_contacts, step_m)
    first, *others = np.unique(np.linspace(0, len(q) - 1, FINGERS_AT).round().astype(np.int64))
    stands = (arm == arm[0]).all()
    at = arm[:1] if stands else arm  # where the arm moves as well, at each of these openings on all of its way
    found = [_least(bodies, at, float(gripper[first]), poses, held, allowed_contacts, step_m)]
    found += [_least(bodies, at, float(gripper[i]), poses, held, allowed_contacts, step_m, fingers_alone=held is None) for i in others]
    return min((c for c in found if c is not None), key=lambda c: c.distance_m, default=None)


def _least(
    bodies: BroadPhase,
    arm: Array,
    gripper: float,
    poses: Mapping[str, Array],
    held: Held | None,
    allowed_contacts: Iterable[tuple[str, str]],
    step_m: float,
    *,
    fingers_alone: bool = False,
) -> Clearance | None:
    """`least_clearance` for one gripper value and the arm's configurations (N, A); fingers_alone: of them and nothing else."""
    problem, names = _problem(bodies, gripper, poses, held, allowed_contacts, fingers_alone=fingers_alone)
    relative_m = step_m if held is None else 2 * step_m  # of two bodies that both move
    distance_m, _, pair = path_clearance.path_clearance(problem, arm, relative_m, FARTHEST_M, TOLERANCE, bodies.scratch(problem))
    if pair < 0:
        return None
    a, b = problem.pairs[pair, :2]
    return Clearance(float(distance_m), (names[a], names[b]))


def clearances(
    bodies: BroadPhase, q: Array, poses: Mapping[str, Array], held: Held | None, allowed_contacts: Iterable[tuple[str, str]], cap_m: float
) -> Array:
    """The clearance (N,) at each of configurations q (N, J), at most cap_m, what is measured being as in `least_clearance`."""
    contacts, arm, out = tuple(allowed_contacts), np.ascontiguousarray(bodies.robot.arm_q(q)), np.empty(len(q))
    gripper = np.round(q[:, bodies.robot.gripper_joint], GRIPPER_DECIMALS)
    for value in np.unique(gripper):
        problem, _ = _problem(bodies, float(value), poses, held, contacts)
        scratch = bodies.scratch(problem)
        for i in np.flatnonzero(gripper == value):
            out[i] = path_clearance.config_clearance(problem, arm[i], cap_m, scratch)
    return out


def _problem(
    bodies: BroadPhase,
    gripper: float,
    poses: Mapping[str, Array],
    held: Held | None,
    allowed_contacts: Iterable[tuple[str, str]],
    *,
    fingers_alone: bool = False,
) -> tuple[Problem, tuple[str, ...]]:
    """Whose distances a clearance is the least of, and the names behind its bodies."""
    if fingers_alone:
        posed, links = bodies.fingers(gripper)
    else:
        posed, _, links = bodies.moving(gripper, held)
    solids, names = bodies.standing(poses)
    own, P = len(bodies.robot_collision_model.links), len(links)
    check = np.zeros((P, P + len(names)), np.uint8)
    check[posed.frame > 0, P:] = 1
    allow(check, (*links, *names), allowed_contacts)
    holding = [i for i in range(own) if links[i] not in bodies.robot.pads] if held is not None else []
    pairs = np.array([(h, i) for h in range(own, P) for i in holding], np.int64).reshape(-1, 2)
    query = Query(np.ascontiguousarray(check[:, P:]), pairs)
    problem = edge_problem.pose(bodies.robot_collision_model.chain, posed, solids, query, MARGIN_M)
    return problem, (*links, *names)
