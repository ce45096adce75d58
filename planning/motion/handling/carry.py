"""One way to carry an object, waypoints and all, and the motions that it consists of, from transit to retreat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from kinematics.scene import Grasp, Held, State
from kinematics.transforms import Array
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.picking import Pick
from planning.motion.handling.placing import Place
from planning.plan import Blocked, Motion

SAME = 1e-9
"""Gripper values, rad or m, that differ by no more are one."""


@dataclass(frozen=True, eq=False)
class Carry:
    """How an object is taken hold of and where it ends.

    way_in (K, A): arm waypoints from where the arm was to the beginning of the pick's approach. across (K, A): from the lifted object to
    where the place's lowering begins, or without a place to where it is held in the end.
    """

    pick: Pick
    place: Place | None
    way_in: Array
    across: Array


@dataclass(frozen=True, eq=False)
class Done:
    """Motions that were found, as waypoints (`Motions.trajectories` makes them smooth), and the state after them.

    grasp: with which they take hold of the object; carry: the way that they are made of. tight: whether what was carried, or the hand that
    put it down, came nearer to something than is preferred even near the ends of a way.
    """

    motions: tuple[Motion, ...]
    after: State
    grasp: Grasp | None = None
    carry: Carry | None = None
    tight: bool = False


def carried(cell: Workcell, state: State, name: str, rest: dict[str, Array], carry: Carry, *, beside: bool = True) -> Done | Blocked:
    """The motions of a carry, and the state after them; what touches where the fingers can't be set to the pick's opening.

    rest: the poses of the objects besides the one that is carried. beside: whether the fingers may open while the arm moves; not asked
    where all will be chosen anew.
    """
    pick, place, lifted = carry.pick, carry.place, carry.pick.lift
    out = setting_out(cell, state, pick, carry.way_in, beside=beside)
    if isinstance(out, Blocked):
        return out
    at = pick.approach[-1]
    motions = [
        *out,
        motion(cell, "approach", pick.approach, pick.gripper_open),
        motion(cell, "grasp", np.array([at, at]), pick.gripper_open, to_gripper=pick.gripper_closed, touching=name),
        motion(cell, "lift", lifted, pick.gripper_closed, pick.held, on_floor=True),
        motion(cell, "transfer", carry.across, pick.gripper_closed, pick.held),
    ]
    if place is None:
        return Done(tuple(motions), State(motions[-1].q[-1], rest, pick.held), pick.grasp, carry)
    at = place.lower[-1]
    motions += [
        motion(cell, "lower", place.lower, pick.gripper_closed, pick.held, on_floor=True),
        motion(cell, "release", np.array([at, at]), pick.gripper_closed, to_gripper=pick.gripper_open, touching=name),
        motion(cell, "retreat", place.retreat, pick.gripper_open),
    ]
    return Done(tuple(motions), State(motions[-1].q[-1], {**rest, name: place.T_world_object}), pick.grasp, carry)


def setting_out(cell: Workcell, state: State, pick: Pick, path: Array, *, beside: bool = True) -> list[Motion] | Blocked:
    """The motions along a path (K, A) to a pick, the fingers moving to its opening on the way where that is clear enough, else first, or
    last."""
    q, gripper = cell.robot.arm_q(state.q), float(state.q[cell.robot.gripper_joint])
    if abs(gripper - pick.gripper_open) <= SAME:
        return [motion(cell, "transit", path, pick.gripper_open)]
    if beside and opens_on_the_way(cell, state.poses, path, gripper, pick.gripper_open):
        return [motion(cell, "transit", path, gripper, to_gripper=pick.gripper_open)]
    touch = opening_blocked(cell, state, q, pick)
    if touch is not None:
        if not cell.free_along(cell.problem(state.poses, gripper), path) or opening_blocked(cell, state, path[-1], pick):
            return touch
        return [
            motion(cell, "transit", path, gripper),
            motion(cell, "transit", path[[-1, -1]], gripper, to_gripper=pick.gripper_open),
        ]
    return [
        motion(cell, "transit", np.array([q, q]), gripper, to_gripper=pick.gripper_open),
        motion(cell, "transit", path, pick.gripper_open),
    ]


def opens_on_the_way(cell: Workcell, poses: Mapping[str, Array], path: Array, gripper: float, opened: float) -> bool:
    """Whether fingers may move from a gripper value to another while an empty hand goes along a path (K, A), and keep clear enough."""
    return abs(gripper - opened) <= SAME or cell.free_however_open(poses, path, gripper, opened, cell.settings.clearance.opening_m)


def opening_blocked(cell: Workcell, state: State, q: Array, pick: Pick) -> Blocked | None:
    """What touches while the fingers move to a pick's opening, the arm being at q (A,); None when nothing does."""
    gripper = float(state.q[cell.robot.gripper_joint])
    opens = abs(gripper - pick.gripper_open) > SAME
    if opens and cell.free_however_open(state.poses, np.array([q, q]), gripper, pick.gripper_open):
        return None  # as a rule, and what was packed for it is asked again when the arm sets out
    for value in np.linspace(gripper, pick.gripper_open, 4)[1:]:
        if touch := cell.touch(cell.problem(state.poses, float(value)), q):
            return Blocked("transit", touch.link, touch.body, detail=touch.detail)
    return None


def gripper_on_the_way(cell: Workcell, state: State, pick: Pick) -> float | Blocked:
    """The gripper's value on the way to a pick: its opening, or where the fingers can't be set to that yet, as they are; or why they can be
    set to it at neither end."""
    if opening_blocked(cell, state, cell.robot.arm_q(state.q), pick) is None:
        return pick.gripper_open
    return opening_blocked(cell, state, pick.approach[0], pick) or float(state.q[cell.robot.gripper_joint])


def motion(
    cell: Workcell,
    stage: str,
    arm: Array,
    gripper: float,
    held: Held | None = None,
    *,
    to_gripper: float | None = None,
    touching: str | None = None,
    on_floor: bool = False,
) -> Motion:
    """A motion over every actuated joint through arm waypoints (K, A), without times yet; the gripper may move along, evenly."""
    robot = cell.robot
    q = robot.with_arm(arm, gripper if to_gripper is None else np.linspace(gripper, to_gripper, len(arm)))
    body = held.body if held else touching
    allowed_contacts = [(pad, body) for pad in sorted(robot.pads)] if body else []
    if on_floor and body:
        allowed_contacts.append((body, "floor"))
    return Motion(stage, robot.joint_names, q, np.arange(len(q), dtype=float), held, tuple(allowed_contacts))
