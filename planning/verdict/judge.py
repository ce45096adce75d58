"""The verdict on what a plan says, from scene and plan alone: nothing of the planner's own code is asked.

Where the robot is comes from its URDF in plain numpy; what touches is FCL's word on convex solids; holding and standing are worked out in
closed form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.robots.plain_urdf import poses
from kinematics.robots.robot import Robot
from kinematics.scene import Grasp, Scene
from kinematics.transforms import inverse
from planning.plan import Motion, Plan
from planning.verdict.contact import contact_faults
from planning.verdict.course import Course, courses
from planning.verdict.faults import MOVES, PLAN, SCENE, Fault, Settings
from planning.verdict.figures import (
    claim_faults,
    figure_faults,
    goal_faults,
    grasp_faults,
    mass_faults,
    move_faults,
    off_grasps,
    stage_faults,
    tilt_faults,
)
from planning.verdict.fingers import grip_faults
from planning.verdict.gripper import force_faults, place_faults, told_faults, width_faults
from planning.verdict.hand import Hand, hand_of
from planning.verdict.ledger import Ledger, keep
from planning.verdict.limits import jerk_notes, limit_faults
from planning.verdict.pads import hold_faults
from planning.verdict.polyhedra import polyhedra
from planning.verdict.standing import Stand, falls, placed, stand_among
from planning.verdict.start import start_faults

MOST_M = 1000.0
"""Nothing that a cabinet and a robot have to do with is larger, or further away."""


@dataclass(frozen=True)
class Verdict:
    """faults: what is wrong, in the plan's order; notes: what is worth knowing and no fault. verified: whether the plan holds; None when
    there is nothing to verify."""

    faults: tuple[Fault, ...]
    notes: tuple[Fault, ...]
    verified: bool | None


def judge(scene: Scene, plan: Plan, robot: Robot, settings: Settings | None = None) -> tuple[Fault, ...]:
    """Everything that is wrong with a plan for a scene and a robot; nothing when it holds."""
    return examine(scene, plan, robot, settings).faults


def examine(scene: Scene, plan: Plan, robot: Robot, settings: Settings | None = None) -> Verdict:
    """The same with what is no fault: pairs of links that touch and that the robot's SRDF lets touch."""
    asked = settings or Settings()
    if plan.scene != scene.id:
        return Verdict((Fault(PLAN, (), f"it is for scene {plan.scene!r}, and this is {scene.id!r}"),), (), False)
    if not plan.motions:
        missing = _without_motions(plan)
        return Verdict(missing, (), False if missing else None)
    if strange := [m.object for m in plan.moves if m.object not in scene.poses()]:
        return Verdict((Fault("moves", (strange[0],), f"a move is of {strange[0]!r}, which is not in the scene"),), (), False)
    if (huge := _huge(scene, plan)) is not None:
        return Verdict((huge,), (), False)
    try:
        hand = hand_of(robot)
    except ValueError as e:
        return Verdict((Fault(SCENE, (), str(e)),), (), False)
    with np.errstate(all="ignore"):
        faults, notes = _examine(scene, plan, robot, hand, asked)
    return Verdict(tuple(faults), tuple(notes), not faults)


def _huge(scene: Scene, plan: Plan) -> Fault | None:
    """A length in the scene or in the plan's poses that nobody can have meant."""
    lengths = [
        (SCENE, b.name, float(np.abs(np.append(b.T_world_body[:3, 3], b.shape.half)).max())) for b in (*scene.objects, *scene.obstacles)
    ]
    around = (("cabinet", scene.cabinet.size_m), ("robot", scene.robot.T_world_base[:3, 3]))
    lengths += [(SCENE, name, float(np.abs(x).max())) for name, x in around]
    lengths += [(MOVES, m.object, float(np.abs([m.T_world_from, m.T_world_to]).max())) for m in plan.moves]
    lengths += [(m.stage, m.held.body, float(np.abs(m.held.T_hand_body).max())) for m in plan.motions if m.held is not None]
    for stage, name, most in lengths:
        if not most <= MOST_M:
            return Fault(stage, (name,), f"{name} is {most:.3g} m large or away", most)
    return None


def _without_motions(plan: Plan) -> tuple[Fault, ...]:
    if plan.success:
        return (Fault(PLAN, (), "it is called a success, and has no motions"),)
    done = [m.object for m in plan.moves if m.done]
    return (Fault("moves", (done[0],), f"{done[0]} is called moved, and there are no motions"),) if done else ()


def judge_motions(
    scene: Scene, motions: Sequence[Motion], robot: Robot, settings: Settings | None = None, *, grasp: Grasp | None = None
) -> tuple[Fault, ...]:
    """What is wrong with motions alone, be they a whole plan or a part of one, from a scene's first state on.

    grasp: how the target is to be taken, by default in any way that holds it. What floats at the start is no fault of theirs.
    """
    hand = hand_of(robot)
    with np.errstate(all="ignore"):
        done = _replay(scene, motions, robot, hand, settings or Settings(), [] if grasp is None else [grasp])
    return tuple(f for f in done.faults if f.stage != SCENE)


@dataclass(frozen=True, eq=False)
class _Replayed:
    """Motions in numbers and what happens in them; ledger: None where they make no sense."""

    faults: list[Fault]
    notes: list[Fault]
    run: list[Course]
    ledger: Ledger | None


def _examine(scene: Scene, plan: Plan, robot: Robot, hand: Hand, settings: Settings) -> tuple[list[Fault], list[Fault]]:
    done = _replay(scene, plan.motions, robot, hand, settings, _allowed(scene, plan))
    if done.ledger is None:
        return done.faults, done.notes
    said = mass_faults(scene, done.ledger) + move_faults(scene, plan, done.ledger, settings) + goal_faults(scene, plan, done.ledger)
    said += figure_faults(scene, plan, done.run, hand) + place_faults(plan.motions) + width_faults(plan.motions, robot.opening)
    said += told_faults(plan.motions, robot) + force_faults(plan.motions, robot, hand) + stage_faults(done.run) + claim_faults(scene, plan)
    return done.faults + said, done.notes


def _replay(scene: Scene, motions: Sequence[Motion], robot: Robot, hand: Hand, settings: Settings, grasps: Sequence[Grasp]) -> _Replayed:
    run, faults = courses(hand.arm, motions)
    if faults or not run:
        return _Replayed(faults, [], run, None)
    order = [robot.joint_names.index(name) for name in hand.arm.joints]
    velocity = np.minimum(hand.arm.velocity, robot.velocity[order])  # a data sheet may know better than the URDF
    faults += limit_faults(replace(hand.arm, velocity=velocity), run, robot.acceleration[order], robot.known_jerk[order])
    spikes = jerk_notes(hand.arm, run, np.where(np.isinf(robot.known_jerk), robot.jerk, np.inf)[order])
    faults += start_faults(robot, hand, scene, run)
    ledger = keep(hand, scene, run, settings)
    faults += ledger.faults
    if len(ledger.standing) < len(run):
        return _Replayed(faults, spikes, run, None)
    unstable, rests, tottering = _standing(scene, ledger, settings)
    faults += unstable
    faults += _holding(scene, ledger, hand, settings) + grip_faults(hand, run, ledger)
    faults += grasp_faults(scene, ledger, grasps, settings)
    tilts = {b.name: settings.max_tilt_deg if b.max_tilt_deg is None else b.max_tilt_deg for b in scene.objects}
    limits = {name: most for name, most in tilts.items() if most is not None}
    faults += tilt_faults(run, ledger, hand, scene.robot.T_world_base, limits)
    touching, notes = contact_faults(robot, hand, scene, run, ledger, rests, settings)
    return _Replayed(faults + touching, tottering + notes + spikes, run, ledger)


def remarks(scene: Scene, plan: Plan) -> tuple[Fault, ...]:
    """What is no fault of a plan, and worth knowing: that it takes the target otherwise than the scene asks, as it says itself."""
    asked = _asked_for(scene)
    if not plan.success or plan.grasp is None or not asked:
        return ()
    off = off_grasps(plan.grasp.T_world_hand, asked, Settings())
    if off is None:
        return ()
    words, far_m = off
    return (Fault("grasp", ("hand",), f"the target is taken {words} from the scene's grasp, as the plan says", far_m),)


def _allowed(scene: Scene, plan: Plan) -> Sequence[Grasp]:
    """The grasps that the target may be taken with: the one that the plan says it takes, else the scene's."""
    return [plan.grasp] if plan.grasp is not None else _asked_for(scene)


def _asked_for(scene: Scene) -> list[Grasp]:
    """x_g and its alternatives."""
    return [g for g in (scene.grasp, *(g for g, _ in scene.grasps)) if g is not None]


def _holding(scene: Scene, ledger: Ledger, hand: Hand, settings: Settings) -> list[Fault]:
    """Whether the pads hold each object that is taken."""
    if not ledger.carries:
        return []
    at = poses(hand.arm, np.stack([c.q for c in ledger.carries]), scene.robot.T_world_base, frozenset(p.carrier for p in hand.pads))
    out = []
    for i, carry in enumerate(ledger.carries):
        T_hand_world = inverse(carry.T_world_hand)
        faces = [T_hand_world @ at[p.carrier][i] @ p.T_carrier_face for p in hand.pads]
        body = polyhedra(scene.body(carry.body).shape)
        out += hold_faults(hand.pads, faces, body, carry.T_hand_body, carry.body, "grasp", settings)
    return out


def _standing(scene: Scene, ledger: Ledger, settings: Settings) -> tuple[list[Fault], dict[str, frozenset[str]], list[Fault]]:
    """What floats at the start, and what does not stand where it is put down, or once another is taken from under it; what each object that
    is carried rests on, before or after; and, as notes, what would fall over at the start by its shape.

    That an object stands there is what the scene says, and apples and balls do, though a scan's foot is rarely under its middle: such a
    one may be put down again where it stands no worse.
    """
    cabinet, out = scene.cabinet, list[Fault]()
    here = {b.name: placed(b.name, b.shape, b.T_world_body, cabinet) for b in scene.objects}
    rests = {name: stand_among(body, here.values(), scene, settings.stands_m) for name, body in here.items()}
    said = {name: _fallen(SCENE, name, at, "at the start") for name, at in rests.items()}
    out += [fault for name, faults in said.items() for fault in faults if not rests[name].on]
    notes = [fault for name, faults in said.items() for fault in faults if rests[name].on]
    names = {c.body: set(rests[c.body].on) for c in ledger.carries}
    now = dict(rests)
    for carry in ledger.carries:
        del here[carry.body], now[carry.body]
        for name in [name for name, at in now.items() if carry.body in at.on]:  # what leaned or stood on it
            first, now[name] = now[name], stand_among(here[name], here.values(), scene, settings.stands_m)
            out += _worse("lift", name, now[name], first, f"once motion {carry.first} takes {carry.body}", settings)
        if carry.put:
            here[carry.body] = body = placed(carry.body, scene.body(carry.body).shape, carry.T_world_to, cabinet)
            now[carry.body] = at = stand_among(body, here.values(), scene, settings.stands_m)
            out += _worse("release", carry.body, at, rests[carry.body], f"where motion {carry.last} puts it", settings)
            names[carry.body] |= set(at.on)
    return out, {name: frozenset(on) for name, on in names.items()}, notes


def _worse(stage: str, name: str, at: Stand, first: Stand, when: str, settings: Settings) -> list[Fault]:
    """What does not stand, unless it stood so badly at first."""
    return _fallen(stage, name, at, when) if falls(at, first, settings.pose_m) else []


def _fallen(stage: str, name: str, at: Stand, when: str) -> list[Fault]:
    if at.carried:
        return []
    if at.on:
        return [Fault(stage, (name, *at.on), f"{name} falls over {when}: what it stands on is not under its centre of mass", None)]
    how = f"is {1000 * at.gap_m:.1f} mm above the floor" if at.gap_m >= 0 else f"is sunk {-1000 * at.gap_m:.1f} mm into the floor"
    return [Fault(stage, (name,), f"{name} {how} {when}", abs(at.gap_m))]
