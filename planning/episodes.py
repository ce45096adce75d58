"""What is counted of one plan: its figures, and why it failed."""

from __future__ import annotations

import re
from dataclasses import dataclass

from kinematics.mount import MOUNT
from kinematics.scene import WALLS
from planning.plan import PLACE_OUT_OF_REACH, Blocked, Plan
from planning.rules import Rule

KINDS = ("selection", "pick", "region", "place", "retrieve", "look", "verify", "moves", "unsolvable", "scene")
"""Why a scene stays unsolved (`failure`), in the order in which a move gets there; at the end what was proved beforehand."""

SAID = ("look", "verify", "moves", "unsolvable", "scene")
"""Kinds of failure that the reason's stage says outright."""

SENSED = ", sensed"
"""What the name of a planner ends with when it had to look around first."""

_FIXED = frozenset({*WALLS, MOUNT})
_NAMED = re.compile(r"\b[A-Za-z]+_\d+\b")
_PICK = frozenset({"ik", "grasp", "transit", "approach", "lift"})
_PLACE = frozenset({"transfer", "lower", "release", "retreat"})


@dataclass(frozen=True)
class Episode:
    """What is counted of one plan.

    policy: with `SENSED` behind it where nothing was known but what the camera saw. moved: relocations carried out; reason: the stage that
    stopped it, None for a success; kind: why it failed, one of `KINDS`, None for a success; blocked: the stages of failed attempts.
    kept_in: what keeps the target in at the end, and stopped: what stopped the attempts, in words. least_moves: a lower bound on the moves;
    proved: that no moves help, or none so few. Both where the planner looked. clearance_m, free_clearance_m: the least distance that all
    motions, and the free ones, keep from what they may not touch; None where it was not measured. pushed_m: how far each object was pushed
    by the fingers that closed on what was only seen, where the plan tells of it.
    """

    scene: str
    policy: str
    rule: str
    success: bool
    verified: bool
    moved: int
    planning_time_s: float
    motion_time_s: float
    relocation_travel_m: float | None
    hand_travel_m: float
    duration_s: float
    value: float
    reason: str | None
    kind: str | None
    blocked: tuple[str, ...]
    kept_in: str | None
    stopped: tuple[str, ...]
    least_moves: int | None
    proved: bool
    clearance_m: float | None
    free_clearance_m: float | None
    pushed_m: tuple[float, ...] = ()

    @property
    def whole_time_s(self) -> float:
        """From a scene to its verified plan: choosing, motion planning and the exact check."""
        return self.planning_time_s + self.motion_time_s

    @staticmethod
    def of(plan: Plan) -> Episode:
        """The figures of a plan, without its motions, so that many fit in memory."""
        return Episode(
            scene=plan.scene,
            policy=plan.policy + SENSED * any(motion.stage == "look" for motion in plan.motions),
            rule=plan.rule,
            success=plan.success,
            verified=plan.verified is True,
            moved=sum(move.done for move in plan.moves),
            planning_time_s=plan.planning_time_s,
            motion_time_s=plan.motion_time_s,
            relocation_travel_m=plan.relocation_travel_m,
            hand_travel_m=plan.hand_travel_m,
            duration_s=plan.duration_s,
            value=plan.value,
            reason=None if plan.success else plan.reason.stage if plan.reason else "unknown",
            kind=None if plan.success else failure(plan),
            blocked=tuple(move.reason.stage for move in plan.moves if not move.done and move.reason),
            kept_in=None if plan.success or plan.reason is None else in_general(plan.reason),
            stopped=tuple(in_general(move.reason, move.object) for move in plan.moves if not move.done and move.reason),
            least_moves=plan.least_moves,
            proved=plan.unsolvable is not None or (plan.reason is not None and plan.reason.stage == "moves"),
            clearance_m=plan.clearance_m,
            free_clearance_m=plan.free_clearance_m,
            pushed_m=tuple(n.amount for n in plan.notes if n.stage == "grasp" and len(n.bodies) == 1 and n.amount is not None),
        )


def in_general(why: Blocked, moved: str | None = None) -> str:
    """A reason in words that count alike in all scenes: objects without their names. moved: the object that it was about."""

    def called(name: str) -> str:
        if name in _FIXED:
            return f"the {name} wall" if name in ("left", "right", "back") else f"the {name}"
        return "the object itself" if name == moved else "unseen space" if name.startswith("unknown_") else "another object"

    if why.stage == "unsolvable":
        return "it is proved that no picks help"
    if why.link and why.body:
        return f"{'the object' if why.link == moved else why.link} would touch {called(why.body)} ({why.stage})"
    return f"{why.stage}: {_NAMED.sub('an object', why.detail)}" if why.detail else why.stage


def failure(plan: Plan) -> str:
    """Why a plan failed, one of `KINDS`.

    scene: it is invalid. verify: the exact check refused its motions. look: the target was not found. moves: more are needed than are
    allowed. unsolvable: no move helps. Else the plan ends in a state where the target can't be taken, and what counts is how far the
    attempts got in that state. pick: no proposed object could be taken hold of; region: one could, but all its proposed places were taken;
    place: one was free, but the object could not be carried there. Where nothing was attempted, retrieve: all moves that are allowed were
    made, and the target is still blocked; selection: the policy proposed nothing.
    """
    if plan.reason is not None and plan.reason.stage in SAID:
        return plan.reason.stage
    last = max((i for i, move in enumerate(plan.moves) if move.done), default=-1)
    got_to = [_attempt_kind(move.reason) for move in plan.moves[last + 1 :] if move.reason]
    if got_to:
        return max(got_to, key=KINDS.index)
    return "retrieve" if _steps(plan) >= plan.max_moves else "selection"


def _steps(plan: Plan) -> int:
    """How many steps of the loop a plan's moves took: a lost one is an attempt (strict), or those on one object (region)."""
    if plan.rule == Rule.STRICT:
        return len(plan.moves)
    done = sum(move.done for move in plan.moves)
    if plan.rule != Rule.REGION:
        return done
    lost = [a for a, b in zip(plan.moves, (*plan.moves[1:], None)) if not a.done and (b is None or a.object != b.object)]
    return done + len(lost)


def _attempt_kind(why: Blocked) -> str:
    """What stopped one attempt to move an object: pick, region or place; selection for what the policy itself refused."""
    if why.stage == "region":
        return "region"
    if why.stage in _PLACE or why.detail == PLACE_OUT_OF_REACH:
        return "place"
    return "pick" if why.stage in _PICK else "selection"
