"""What the loop hands out: motions, moves and the plan that joins them; failure is a value, `Blocked`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kinematics.quintic_spline import QuinticSpline, evaluate, hermite
from kinematics.scene import Grasp, Held, Settlement
from kinematics.transforms import Array
from planning.rules import MAX_MOVES

PLACE_OUT_OF_REACH = "the place is out of reach"
"""The detail that tells a place's stage "ik" from a grasp's."""

SCENE = "scene"
"""The stage of what is wrong with a scene itself: it is invalid."""
FREE = ("transit", "transfer", "look")
"""The stages of motions that are planned freely, from place to place."""

STAGES = ("transit", "approach", "grasp", "lift", "transfer", "lower", "release", "retreat", "look")


JOINED = 1e-6
"""rad or m, by which files may round where one motion ends and the next one begins."""


@dataclass(frozen=True)
class Blocked:
    """Why something can't be done: the stage, and where known what touches what and how deep.

    stage: a motion's stage, or "ik" (the hand pose is out of reach), "grasp" (no grasp fits the object), "region" (the place itself is
    taken or outside), "select" and "place" (the policy proposed nothing more), "moves" (the limit was reached), "verify" (the final check),
    "scene" (the scene is invalid), "unsolvable" (it is proved that no move helps).
    """

    stage: str
    link: str | None = None
    body: str | None = None
    depth_m: float | None = None
    detail: str | None = None

    def in_words(self) -> str:
        """As one would tell it: "camera would touch box_3 (approach)"."""
        return f"{self.link} would touch {self.body} ({self.stage})" if self.link and self.body else str(self)

    def __str__(self) -> str:
        touch = f": {self.link} touches {self.body}" if self.link and self.body else ""
        deep = f" by {1000 * self.depth_m:.1f} mm" if self.depth_m is not None else ""
        return f"{self.stage}{touch}{deep}" + (f" ({self.detail})" if self.detail else "")


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a plan, as the verdict finds it.

    stage: the motion's, or "scene", "plan", "moves" for what belongs to no motion. bodies: links and bodies that it is about. detail: what
    is wrong, in words. amount: how much, in m, rad or their rates as the detail says; None where there is nothing to measure.
    """

    stage: str
    bodies: tuple[str, ...]
    detail: str
    amount: float | None = None

    def __str__(self) -> str:
        return f"{self.stage}: {self.detail}"


@dataclass(frozen=True)
class GripperState:
    """What the gripper is told: how wide the pads are to be, how hard to close (None: not). value: where its joint is then, in rad or m.

    command: the joint's value that it is told, where that is another: fingers that close on what was only seen are told to go on until they
    meet it, and width_m is what they would come to if they did not.
    """

    value: float
    width_m: float
    force_N: float | None = None
    command: float | None = None


@dataclass(frozen=True)
class Gripper:
    """What the gripper is told before a motion and for its end: the same but where the fingers move. joint: the one that moves them."""

    joint: str
    before: GripperState
    after: GripperState


@dataclass(frozen=True, eq=False)
class Motion:
    """One stage of the arm's way: a trajectory from rest to rest.

    q: (K, J) positions over every actuated joint, in the order of joint_names; t_s: (K,) times from the motion's start, rising.
    qd, qdd: (K, J) velocities and accelerations, rad/s and rad/s² (m for sliding joints); between two rows runs the quintic Hermite spline
    (kinematics.quintic_spline). Without them the rows are waypoints, between which the arm moves straight in joint space.
    held: the object that moves with the hand during the whole motion. allowed_contacts: pairs that may be in contact during it.
    clearance_m: the least distance that it keeps from anything besides, where that is known, and clearance_between which two bodies.
    """

    stage: str
    joint_names: tuple[str, ...]
    q: Array
    t_s: Array
    held: Held | None = None
    allowed_contacts: tuple[tuple[str, str], ...] = ()
    qd: Array | None = None
    qdd: Array | None = None
    gripper: Gripper | None = None
    clearance_m: float | None = None
    clearance_between: tuple[str, str] | None = None

    @cached_property
    def spline(self) -> QuinticSpline | None:
        """What runs between the rows; None where these are waypoints."""
        return None if self.qd is None or self.qdd is None else hermite(self.t_s, self.q, self.qd, self.qdd)

    def at(self, t_s: Array) -> Array:
        """Positions (N, J) at times t_s (N,) from the motion's start; before it and after its end, those at its ends."""
        spline = self.spline
        if spline is not None:
            return evaluate(spline, t_s)
        return np.stack([np.interp(t_s, self.t_s, column) for column in self.q.T], axis=1)


def jump(end: Array, start: Array) -> tuple[int, float] | None:
    """Which joint of where a motion starts (J,) is furthest from where the one before it ended (J,), and how far, in rad or m; None where
    all are the same but for rounding."""
    off = np.abs(start - end)
    worst = int(np.argmax(off))
    return (worst, float(off[worst])) if off[worst] > JOINED else None


@dataclass(frozen=True, eq=False)
class Move:
    """One relocation, carried out or tried: the object, its region, its pose before and after, and why it failed if it did."""

    object: str
    region: int
    T_world_from: Array
    T_world_to: Array
    done: bool
    reason: Blocked | None = None


@dataclass(frozen=True)
class Unsolvable:
    """The proof that no sequence of picks helps: objects of which none can be picked while they and the target stand, and which together
    block every way to x_g. would_help: what would change that, in words. leaning: those of them that are stuck for they lean on something
    and would stand nowhere else. lifted_into: those that have no room to be lifted, and what each of them meets. All of it holds for the
    grasps that were sampled, and no others.
    """

    stuck: tuple[str, ...]
    would_help: tuple[str, ...]
    leaning: tuple[str, ...] = ()
    lifted_into: tuple[tuple[str, str], ...] = ()

    @property
    def words(self) -> str:
        """What is proved. Nothing need be stuck: what stands still (walls, unseen space) may keep the hand from x_g by itself."""
        if not self.stuck:
            return "with every object gone the target's grasp is still out of reach, or blocked by what can't be moved"
        why = "; ".join(self._reasons())
        if len(self.stuck) == 1:
            return why or f"{self.stuck[0]} can't be picked, even with nothing but the target beside it"
        names = ", ".join(self.stuck)
        if why:
            return f"none of {names} can be moved while the others of them stand: {why}"
        return f"none of {names} can be picked while the others of them stand"

    def _reasons(self) -> Iterator[str]:
        """Why some of what is stuck is, whatever hand takes it."""
        if self.leaning:
            lean = "lean on something and" if len(self.leaning) > 1 else "leans on something and"
            yield f"{', '.join(self.leaning)} {lean} would stand nowhere else"
        under = defaultdict[str, list[str]](list)
        for name, other in self.lifted_into:
            under[other].append(name)
        for other, names in under.items():
            yield f"{', '.join(names)} would meet {other} when lifted"


@dataclass(frozen=True)
class Outlook:
    """What a policy that looks ahead knows of a scene: the fewest moves that can solve it, or why none do; None where it doesn't know.
    undecided: why it can't be told, in words, whether any moves help."""

    least_moves: int | None = None
    unsolvable: Unsolvable | None = None
    undecided: str | None = None


@dataclass(frozen=True, eq=False)
class Plan:
    """Moves and motions that retrieve the target of `scene`, or the reason why they don't.

    planning_time_s: choosing objects and regions, as in the paper; motion_time_s: all motion planning.
    hand_travel_m: length of the hand's path; relocation_travel_m: of its part before the target is gone for, as in the paper, looks left
    out; None where nobody measured it. value: the paper's objective (eq. 1), written as `return` in files.
    verified: the motions passed the exact check (planning.motion.checking.verify), and the plan the verdict (planning.verdict); None
    when there are no motions. faults: why it is not verified, as far as the verdict found it. notes: what it found and is no fault:
    pairs of links that touch and that the robot's SRDF switches off; and what the plan takes for granted of unseen space.
    grasp: the one that took the target. least_moves: a lower bound on the moves of any plan of the scene, where the policy knows one.
    unsolvable: the proof that there is none, if it was found.
    settled: objects that were moved a little before the plan began: it starts from where they stand now.
    max_moves: how many moves were allowed.
    stated: what the file that it was read from says of figures that its motions give, "duration_s" and "clearance_m": for the verdict.
    target_blocked: what kept the target in before each move, and at the end if it did; no part of the file.
    """

    scene: str
    policy: str
    rule: str
    success: bool
    reason: Blocked | None
    moves: tuple[Move, ...]
    motions: tuple[Motion, ...]
    planning_time_s: float
    motion_time_s: float
    hand_travel_m: float
    value: float
    verified: bool | None
    faults: tuple[Fault, ...] = ()
    notes: tuple[Fault, ...] = ()
    grasp: Grasp | None = None
    least_moves: int | None = None
    unsolvable: Unsolvable | None = None
    settled: tuple[Settlement, ...] = ()
    relocation_travel_m: float | None = None
    max_moves: int = MAX_MOVES
    target_blocked: tuple[Blocked, ...] = ()
    stated: Mapping[str, float] = field(default_factory=dict)

    @property
    def duration_s(self) -> float:
        """How long the robot moves, all motions one after the other."""
        return float(sum(motion.t_s[-1] for motion in self.motions))

    @property
    def clearance_m(self) -> float | None:
        """The least distance that any motion keeps outside allowed contacts; None where there is no motion, or nothing was measured."""
        return min((m.clearance_m for m in self.motions if m.clearance_m is not None), default=None)

    @property
    def free_clearance_m(self) -> float | None:
        """The same of the free motions alone: not of those that reach for an object or set it down, which end beside others."""
        return min((m.clearance_m for m in self.motions if m.clearance_m is not None and m.stage in FREE), default=None)
