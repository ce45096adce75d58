"""How far a motion keeps from everything that it may not touch: the least distance at its samples, and between which two bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from kinematics.chain import Int
from kinematics.collision.edge_problem import make_scratch, pose_all
from kinematics.collision.geometry import Asked, make_queries
from kinematics.collision.path_clearance import config_clearances, make_gaps, path_clearances
from kinematics.collision.stretches import PackedStretches, Stretch, allow
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import Array

FARTHEST_M = 1.0
"""What is further off than this is not measured."""
GRIPPER_DECIMALS = 2
"""To so many decimals of their joint's value, rad or m, fingers on their way are told apart where a curve is drawn of clearances."""
TOLERANCE = 1e-3
"""Share of the distance by which a clearance may be given too low."""
BETWEEN, TOO_LARGE_M = 4, 5e-5
"""At so many openings on either side of the nearest that was looked at, fingers that move alone are looked at once more; what lies lower by
no more than that is left as it is."""


@dataclass(frozen=True)
class Clearance:
    """The least distance of a motion in metres, never given too large, and the two bodies: a link or what is held, then what it is near
    to."""

    distance_m: float
    between: tuple[str, str]


def least_clearances(packed: PackedStretches, step_m: float) -> list[Clearance | None]:
    """The clearance of every stretch; None where nothing is within a metre.

    It is measured from the moving links and what is held to all that stands, and from what is held to the links that don't hold it; not
    among the robot's own links, nor between allowed contacts. Fingers that move are looked at in `FINGERS_AT` places and more, where the
    arm moves as well at each of these openings on all of its way. step_m: from one row to the next no point moves further.
    """
    asked, of, opened, nearest_at = list[Asked](), list[int](), list[int](), dict[int, int]()
    for s, stretch in enumerate(packed.stretches):
        first, *others = packed.openings[s]
        begin, end = packed.starts[s], packed.starts[s + 1]
        if others and (packed.arm[begin:end] == packed.arm[begin]).all():
            end = begin + 1
        whole = _asked(packed, s, (begin, end), packed.parts(s, first))
        asked.append(whole)
        for at in others:
            if stretch.held is None:
                asked.append(whole._replace(parts=packed.fingers(at)[0], check=whole.check[packed.model.fingers]))
            else:
                asked.append(whole._replace(parts=packed.parts(s, at)[0]))
        of += [s] * (1 + len(others))
        opened += range(1 + len(others))
    out: list[Clearance | None] = [None] * len(packed.stretches)
    if not asked:
        return out
    queries, steps_m = make_queries(asked), np.array([step_m if packed.stretches[s].held is None else 2 * step_m for s in of])
    problem, starts = pose_all(packed.model.chain, packed.posed, packed.solids, queries)  # two bodies may both move: hence twice the step
    least, nearest = np.empty(len(of)), np.empty(len(of), np.int64)
    scratch = make_scratch(problem, int(np.diff(starts).max()))
    gaps = make_gaps(queries.rows, starts)
    path_clearances(problem, packed.arm, queries.rows, starts, steps_m, FARTHEST_M, TOLERANCE, scratch, gaps, least, nearest)
    for s, opening, distance_m, pair in zip(of, opened, least.tolist(), nearest.tolist()):
        known = out[s]
        if pair >= 0 and (known is None or distance_m < known.distance_m):
            a, b = problem.pairs[pair, :2]
            out[s] = Clearance(distance_m, (packed.names[a], packed.names[b]))
            nearest_at[s] = opening
    return _between_openings(packed, out, nearest_at)


def _between_openings(packed: PackedStretches, found: list[Clearance | None], nearest_at: Mapping[int, int]) -> list[Clearance | None]:
    """The same, with fingers that move alone looked at around the opening at which they were nearest: on an arc, or past a corner, they
    come nearer in between."""
    stretches, of = list[Stretch](), list[int]()
    for s, k in nearest_at.items():
        openings, q = packed.openings[s], packed.stretches[s].q
        if len(openings) == 1 or not (packed.arm[packed.starts[s] : packed.starts[s + 1]] == packed.arm[packed.starts[s]]).all():
            continue
        for other in (k - 1, k + 1):
            if 0 <= other < len(openings):
                for value in np.linspace(openings[k], openings[other], BETWEEN + 2)[1:-1]:
                    row = q[:1].copy()
                    row[:, packed.robot.gripper_joint] = value
                    stretches.append(replace(packed.stretches[s], q=row))
                    of.append(s)
    if stretches:
        for s, between in zip(of, least_clearances(PackedStretches(packed.robot, packed.scene, stretches), 0.0)):
            known = found[s]
            if between is not None and known is not None and between.distance_m < known.distance_m - TOO_LARGE_M:
                found[s] = between
    return found


def clearances(robot: Robot, scene: Scene, stretch: Stretch, cap_m: float) -> Array:
    """The clearance (N,) at each configuration of a stretch, at most cap_m, what is measured being as in `least_clearances`."""
    g = robot.gripper_joint
    values, which = np.unique(np.round(stretch.q[:, g], GRIPPER_DECIMALS), return_inverse=True)
    each = [stretch.q[which == i] for i in range(len(values))]
    for q, value in zip(each, values):
        q[:, g] = value
    packed = PackedStretches(robot, scene, [replace(stretch, q=q) for q in each])
    asked = [_asked(packed, s, (packed.starts[s], packed.starts[s + 1]), packed.parts(s, packed.openings[s][0])) for s in range(len(each))]
    queries = make_queries(asked)
    problem, starts = pose_all(packed.model.chain, packed.posed, packed.solids, queries)
    out, sorted_out = np.empty(len(stretch.q)), np.empty(len(stretch.q))
    config_clearances(problem, packed.arm, queries.rows, starts, cap_m, make_scratch(problem), sorted_out)
    out[np.argsort(which, kind="stable")] = sorted_out
    return out


def _asked(packed: PackedStretches, s: int, rows: tuple[int, int], look: tuple[Int, tuple[str, ...]]) -> Asked:
    """Whose distances the clearance of stretch s is the least of, for some rows and a look at its parts (`PackedStretches.parts`)."""
    (parts, names), (bodies, standing) = look, packed.bodies(s)
    stretch, own, P = packed.stretches[s], len(packed.links), len(parts)
    check = np.zeros((P, P + len(bodies)), np.uint8)
    check[packed.posed.frame[parts] > 0, P:] = 1
    allow(check, names + standing, stretch.allowed_contacts)
    holding = [i for i in range(own) if names[i] not in packed.robot.pads] if stretch.held is not None else []
    pairs = np.array([(h, i) for h in range(own, P) for i in holding], np.int64).reshape(-1, 2)
    return Asked(rows, parts, bodies, check[:, P:], pairs)
