"""Plans to JSON documents and back: the field names of docs/formats.md, and every check that a plan must pass."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np

from kinematics.scene import Grasp, Held, Settlement
from planning.io.checked import Node
from planning.io.documents import expect, number, numbers, pose_to_json, rows_of_numbers, without_none
from planning.plan import STAGES, Blocked, Fault, Gripper, GripperState, Motion, Move, Plan, Unsolvable
from planning.rules import MAX_MOVES, Rule

PLAN = "retrieve/plan@2"
WAYPOINT_PLAN = "retrieve/plan@1"
"""A plan whose motions are waypoints, without velocities and accelerations."""
STATED = ("duration_s", "clearance_m")
"""Figures of a plan that are those of its motions: kept as they were written, for the verdict."""


def plan_to_json(plan: Plan) -> dict[str, Any]:
    """A plan as schema/plan.schema.json has it; as version 1 when its motions are waypoints."""
    timed = all(m.qd is not None and m.qdd is not None for m in plan.motions)
    document = {
        "schema": PLAN if timed else WAYPOINT_PLAN,
        "scene": plan.scene,
        "policy": plan.policy,
        "rule": plan.rule,
        "success": bool(plan.success),
        "reason": _blocked_to_json(plan.reason),
        "moves": [
            {
                "object": m.object,
                "region": int(m.region),
                "T_world_from": pose_to_json(m.T_world_from),
                "T_world_to": pose_to_json(m.T_world_to),
                "done": bool(m.done),
                "reason": _blocked_to_json(m.reason),
            }
            for m in plan.moves
        ],
        "motions": [_motion_to_json(m) for m in plan.motions],
        "planning_time_s": number(plan.planning_time_s),
        "motion_time_s": number(plan.motion_time_s),
        **({"duration_s": number(plan.duration_s)} if timed else {}),
        "hand_travel_m": number(plan.hand_travel_m),
        "return": number(plan.value),
        "verified": None if plan.verified is None else bool(plan.verified),
        **_foresight_to_json(plan),
    }
    if plan.relocation_travel_m is not None:
        document["relocation_travel_m"] = number(plan.relocation_travel_m)
    if plan.clearance_m is not None:
        document["clearance_m"] = number(plan.clearance_m)
    if plan.faults:
        document["faults"] = [fault_to_json(fault) for fault in plan.faults]
    if plan.notes:
        document["notes"] = [fault_to_json(note) for note in plan.notes]
    if plan.settled:
        document["settled"] = [{"object": s.object, "by_m": numbers(s.by_m), "reason": s.reason} for s in plan.settled]
    return document


def _foresight_to_json(plan: Plan) -> dict[str, Any]:
    """The grasp that was taken, what was known ahead, and how many moves were allowed, where there is something to say."""
    grasp, proof = plan.grasp, plan.unsolvable
    known: dict[str, Any] = {
        "grasp": None if grasp is None else {"T_world_hand": pose_to_json(grasp.T_world_hand), "width_m": number(grasp.width_m)},
        "least_moves": None if plan.least_moves is None else int(plan.least_moves),
        "unsolvable": None if proof is None else {"stuck": list(proof.stuck), "would_help": list(proof.would_help)},
    }
    if proof is not None and proof.leaning:
        known["unsolvable"]["leaning"] = list(proof.leaning)
    if proof is not None and proof.lifted_into:
        known["unsolvable"]["lifted_into"] = [{"object": name, "body": body} for name, body in proof.lifted_into]
    if plan.max_moves != MAX_MOVES:
        known["max_moves"] = int(plan.max_moves)
    return {key: value for key, value in known.items() if value is not None}


def _motion_to_json(m: Motion) -> dict[str, Any]:
    document: dict[str, Any] = {
        "stage": m.stage,
        "joint_names": list(m.joint_names),
        "q": rows_of_numbers(m.q),
        "t_s": numbers(m.t_s),
        "held": None if m.held is None else {"body": m.held.body, "T_hand_body": pose_to_json(m.held.T_hand_body)},
        "may_touch": [list(pair) for pair in m.allowed_contacts],
    }
    if m.qd is not None and m.qdd is not None:
        document["qd"], document["qdd"] = rows_of_numbers(m.qd), rows_of_numbers(m.qdd)
    if m.gripper is not None:
        before, after = _state_to_json(m.gripper.before), _state_to_json(m.gripper.after)
        document["gripper"] = {"joint": m.gripper.joint, "before": before, "after": after}
    if m.clearance_m is not None and m.clearance_between is not None:
        document["clearance_m"], document["clearance_between"] = number(m.clearance_m), list(m.clearance_between)
    return document


def _state_to_json(state: GripperState) -> dict[str, float | None]:
    force = None if state.force_N is None else number(state.force_N)
    further = {} if state.command is None else {"command": number(state.command)}
    return {"value": number(state.value), "command_m": number(state.width_m), "force_N": force, **further}


def plan_from_json(document: Any, where: str = "plan") -> Plan:
    """The inverse of `plan_to_json`, checked. Raises InputError that begins with `where`."""
    return plan_from_node(Node(document, where))


def plan_from_node(node: Node) -> Plan:
    """See `plan_from_json`; every value is checked. Raises: ValueError that says where."""
    version = expect(node, "plan")
    words: tuple[str, ...] = ("scene", "policy", "rule", "success", "reason", "moves", "motions")
    words += ("planning_time_s", "motion_time_s", "hand_travel_m", "return", "verified")
    more = ("faults", "notes", "grasp", "least_moves", "unsolvable", "settled", "relocation_travel_m", "max_moves", *STATED)
    f = node.record(words, more, extra=True)
    return Plan(
        scene=f["scene"].text(),
        policy=f["policy"].text(),
        rule=f["rule"].text(tuple(Rule)),
        success=f["success"].flag(),
        reason=_blocked(f["reason"]),
        moves=tuple(_move(m) for m in f["moves"].items()),
        motions=tuple(_motion(m, version) for m in f["motions"].items()),
        planning_time_s=f["planning_time_s"].number(least=0),
        motion_time_s=f["motion_time_s"].number(least=0),
        hand_travel_m=f["hand_travel_m"].number(least=0),
        value=f["return"].number(),
        verified=None if f["verified"].value is None else f["verified"].flag(),
        faults=tuple(_fault(item) for item in f["faults"].items()) if "faults" in f else (),
        notes=tuple(_fault(item) for item in f["notes"].items()) if "notes" in f else (),
        grasp=_grasp(f["grasp"]) if _said(f, "grasp") else None,
        least_moves=f["least_moves"].integer(least=0) if _said(f, "least_moves") else None,
        unsolvable=_unsolvable(f["unsolvable"]) if _said(f, "unsolvable") else None,
        settled=tuple(_settlement(item) for item in f["settled"].items()) if "settled" in f else (),
        relocation_travel_m=f["relocation_travel_m"].number(least=0) if _said(f, "relocation_travel_m") else None,
        max_moves=f["max_moves"].integer(least=0) if _said(f, "max_moves") else MAX_MOVES,
        stated={key: f[key].number(least=0) for key in STATED if _said(f, key)},
    )


def _said(f: Mapping[str, Node], key: str) -> bool:
    """Whether an optional field is there, and not null."""
    return key in f and f[key].value is not None


def _grasp(node: Node) -> Grasp:
    f = node.record(("T_world_hand", "width_m"), extra=True)
    return Grasp(f["T_world_hand"].pose(), f["width_m"].number(least=0))


def _unsolvable(node: Node) -> Unsolvable:
    f = node.record(("stuck", "would_help"), ("leaning", "lifted_into"), extra=True)
    stuck, words, leaning = (
        tuple(name.text() for name in f[key].items()) if key in f else () for key in ("stuck", "would_help", "leaning")
    )
    pairs = [item.record(("object", "body"), extra=True) for item in f["lifted_into"].items()] if "lifted_into" in f else []
    return Unsolvable(stuck, words, leaning, tuple((pair["object"].text(), pair["body"].text()) for pair in pairs))


def _fault(node: Node) -> Fault:
    f = node.record(("stage", "bodies", "detail", "amount"), extra=True)
    amount = None if f["amount"].value is None else f["amount"].number()
    return Fault(f["stage"].text(), tuple(name.text() for name in f["bodies"].items()), f["detail"].text(), amount)


def _settlement(node: Node) -> Settlement:
    f = node.record(("object", "by_m", "reason"), extra=True)
    return Settlement(f["object"].text(), f["by_m"].vector(3), f["reason"].text())


def fault_to_json(fault: Fault) -> dict[str, Any]:
    """A fault as a plan's field `faults` has it."""
    amount = None if fault.amount is None or not isfinite(fault.amount) else number(fault.amount)
    return {"stage": fault.stage, "bodies": list(fault.bodies), "detail": fault.detail, "amount": amount}


def _move(node: Node) -> Move:
    f = node.record(("object", "region", "T_world_from", "T_world_to", "done", "reason"), extra=True)
    poses = (f["T_world_from"].pose(), f["T_world_to"].pose())
    return Move(f["object"].text(), f["region"].integer(least=0), *poses, f["done"].flag(), _blocked(f["reason"]))


def _motion(node: Node, version: int) -> Motion:
    words = ("stage", "joint_names", "q", "t_s", "held", "may_touch")
    f = node.record((*words, "qd", "qdd") if version > 1 else words, ("gripper", "clearance_m", "clearance_between"), extra=True)
    names = tuple(name.text() for name in f["joint_names"].items(least=1))
    q = f["q"].matrix(len(names))
    t_s = f["t_s"].vector(len(q))
    if (t_s[1:] < t_s[:-1]).any() or t_s[0] < 0:
        raise f["t_s"].error("runs backwards; times start at 0 or later and never decrease")
    qd, qdd = None, None
    if version > 1:
        qd, qdd = f["qd"].matrix(len(names)), f["qdd"].matrix(len(names))
        for rows, word in ((qd, "qd"), (qdd, "qdd")):
            if len(rows) != len(q):
                raise f[word].error(f"has {len(rows)} rows, and q has {len(q)}")
        if len(q) < 2 or not (np.diff(t_s) > 0).all():
            raise f["t_s"].error("must rise from row to row, two of them at least: a spline runs between the rows")
    held = None
    if f["held"].value is not None:
        h = f["held"].record(("body", "T_hand_body"), extra=True)
        held = Held(h["body"].text(), h["T_hand_body"].pose())
    clearance, between = None, None
    if "clearance_m" in f and f["clearance_m"].value is not None:
        clearance = f["clearance_m"].number(least=0)
        between = _two_names(f["clearance_between"]) if "clearance_between" in f else None
    pairs = tuple(_two_names(pair) for pair in f["may_touch"].items())
    gripper = _gripper(f["gripper"]) if "gripper" in f and f["gripper"].value is not None else None
    return Motion(f["stage"].text(STAGES), names, q, t_s, held, pairs, qd, qdd, gripper, clearance, between)


def _two_names(node: Node) -> tuple[str, str]:
    names = [name.text() for name in node.items(least=2)]
    if len(names) > 2:
        raise node.error(f"holds {len(names)} names, and 2 are needed")
    return names[0], names[1]


def _gripper(node: Node) -> Gripper:
    f = node.record(("joint", "before", "after"), extra=True)
    states = []
    for when in ("before", "after"):
        g = f[when].record(("value", "command_m", "force_N"), ("command",), extra=True)
        force = None if g["force_N"].value is None else g["force_N"].number(least=0)
        command = g["command"].number() if _said(g, "command") else None
        states.append(GripperState(g["value"].number(), g["command_m"].number(least=0), force, command))
    return Gripper(f["joint"].text(), *states)


def _blocked(node: Node) -> Blocked | None:
    if node.value is None:
        return None
    if isinstance(node.value, str):
        return Blocked(node.text())
    f = node.record(("stage",), ("link", "body", "depth_m", "detail"), extra=True)
    words = {key: f[key].text() for key in ("link", "body", "detail") if key in f and f[key].value is not None}
    depth = f["depth_m"].number() if "depth_m" in f and f["depth_m"].value is not None else None
    return Blocked(f["stage"].text(), words.get("link"), words.get("body"), depth, words.get("detail"))


def _blocked_to_json(why: Blocked | None) -> dict[str, Any] | None:
    if why is None:
        return None
    depth = None if why.depth_m is None else number(why.depth_m)
    return without_none({"stage": why.stage, "link": why.link, "body": why.body, "depth_m": depth, "detail": why.detail})
