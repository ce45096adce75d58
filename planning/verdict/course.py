"""A motion as numbers over the robot's own joints: a polyline (plan@1), or a quintic Hermite spline between the rows (plan@2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinematics.quintic_spline import QuinticSpline, evaluate, hermite
from kinematics.robots.plain_urdf import Arm
from kinematics.scene import Held
from kinematics.transforms import Array
from planning.plan import Motion
from planning.verdict.faults import Fault

MOST = 1e4
"""No joint value, time or rate in a plan is larger than this; what is, was not meant."""


FOLLOWS = 1e-4
"""rad or m: so far from where it follows another joint may a plan have one."""
LONGEST = 500.0
"""rad or m: no joint goes further in one motion."""


@dataclass(frozen=True, eq=False)
class Course:
    """Motion number `number` of a plan. q (K, J): rows over `Arm.joints`, in their order; t_s (K,). spline: None for a polyline or one row.
    allowed: pairs that may touch, as the motion says; clearance_m: how far it says that it keeps from anything besides, if it does."""

    number: int
    stage: str
    q: Array
    t_s: Array
    spline: QuinticSpline | None
    held: Held | None
    allowed: frozenset[frozenset[str]]
    clearance_m: float | None = None

    @property
    def where(self) -> str:
        """The motion's number, for complaints."""
        return f"motion {self.number}"

    @cached_property
    def reach(self) -> tuple[Array, Array]:
        """Positions (J,) that no joint leaves on its way, the low ones and the high ones; those of a joint that stands still are equal."""
        if self.spline is None:
            return self.q.min(0), self.q.max(0)
        return self.spline.control.min((0, 1)), self.spline.control.max((0, 1))

    @cached_property
    def ways(self) -> Array:
        """How far (K - 1,) the joint that goes furthest goes between any two rows, at most."""
        return _ways(self.q[1:] - self.q[:-1], None if self.spline is None else self.spline.control)

    def dense(self, step: float) -> tuple[Array, Array]:
        """Where on the way (N,), in rows, and configurations (N, J), such that no joint moves by much more than `step` between two."""
        k, share = _cut(self.ways, step)
        return np.append(0.0, k + share), np.concatenate([self.q[:1], self._between(k, share)])

    def _between(self, k: NDArray[np.int64], share: Array) -> Array:
        """Configurations (N, J) at shares (N,) of the way from rows k (N,) to the next ones."""
        if self.spline is None:
            return np.asarray(self.q[k] + share[:, None] * (self.q[k + 1] - self.q[k]))
        start = self.t_s[k]
        return evaluate(self.spline, start + share * (self.t_s[k + 1] - start))

    def at(self, rows: Array) -> Array:
        """Configurations (N, J) at places (N,) on the way, counted in rows: 2.5 is half-way from row 2 to row 3."""
        k = np.clip(np.floor(rows).astype(np.int64), 0, max(0, len(self.q) - 2))
        return self.q[k] if len(self.q) < 2 else self._between(k, rows - k)


def _ways(ahead: Array, control: Array | None) -> Array:
    """How far (P,) the joint that goes furthest goes at most on ways that end `ahead` (P, J) of where they begin; control (P, 6, J): their
    coefficients, if they are pieces of a spline."""
    far = np.abs(ahead).max(1, initial=0.0)
    if control is not None:
        # a joint's way is no longer than that along its Bernstein coefficients: it turns back less often than they do
        far = np.maximum(far, np.abs(control[:, 1:] - control[:, :-1]).sum(1).max(1))
    return np.asarray(far)


def _cut(ways: Array, step: float) -> tuple[NDArray[np.int64], Array]:
    """Ways (P,) cut into even pieces of about `step`: for each piece's end the way (N,) that it is on, and its share (N,) of that."""
    counts = np.maximum(1, np.ceil(ways / step)).astype(np.int64)
    k = np.repeat(np.arange(len(counts)), counts)
    return k, (np.arange(1, len(k) + 1) - (np.cumsum(counts) - counts)[k]) / counts[k]


def dense_rows(courses: Sequence[Course], step: float) -> list[Array]:
    """The configurations (N, J) of `Course.dense` for several courses, at least one."""
    splines = [course.spline for course in courses if course.spline is not None]
    if len(splines) < len(courses):
        return [course.dense(step)[1] for course in courses]
    control = _one_after_the_other(splines)
    piece, share = _cut(_ways(control[:, -1] - control[:, 0], control), step)
    rows = evaluate(QuinticSpline(np.arange(len(control) + 1.0), control), piece + share)  # where a piece is depends on the share alone
    first = np.cumsum([0, *(len(spline.t_s) for spline in splines)])  # pieces, the still one before the next course among them
    return np.split(np.concatenate([courses[0].q[:1], rows]), np.searchsorted(piece, first[1:-1]))


def _one_after_the_other(splines: Sequence[QuinticSpline]) -> Array:
    """The coefficients (P, 6, J) of all their pieces, and between one spline and the next of a piece in which nothing moves."""
    control = list[Array]()
    for spline in splines:
        control += [spline.control, np.broadcast_to(spline.control[-1:, -1:], (1, *spline.control.shape[1:]))]
    return np.concatenate(control[:-1])


def courses(arm: Arm, motions: Sequence[Motion]) -> tuple[list[Course], list[Fault]]:
    """The motions in numbers, up to the first that has none; and what is wrong with that one's form."""
    out: list[Course] = []
    for number, motion in enumerate(motions):
        wrong = _form(arm, motion, number)
        if wrong is not None:
            return out, [wrong]
        order = [motion.joint_names.index(name) for name in arm.joints]
        q = np.asarray(motion.q, float)[:, order]
        spline = None
        qd, qdd = motion.qd, motion.qdd
        if qd is not None and qdd is not None and len(q) > 1:
            spline = hermite(motion.t_s, q, np.asarray(qd, float)[:, order], np.asarray(qdd, float)[:, order])
        pairs = frozenset(frozenset(pair) for pair in motion.allowed_contacts)
        out.append(Course(number, motion.stage, q, np.asarray(motion.t_s, float), spline, motion.held, pairs, motion.clearance_m))
    return out, []


def _form(arm: Arm, motion: Motion, number: int) -> Fault | None:
    """Names and sizes: what would make no sense to look at further."""

    def fault(detail: str, amount: float | None = None) -> Fault:
        return Fault(motion.stage, (), f"motion {number} {detail}", amount)

    names = motion.joint_names
    if len(set(names)) < len(names):
        return fault("names a joint twice")
    if strange := [n for n in names if n not in arm.joints and n not in arm.followers]:
        return fault(f"moves {strange[0]!r}, which is no actuated joint of this robot; these are {', '.join(arm.joints)}")
    if missing := [n for n in arm.joints if n not in names]:
        return fault(f"does not say where {missing[0]!r} is; the robot's actuated joints are {', '.join(arm.joints)}")
    qd, qdd = motion.qd, motion.qdd
    tables = [motion.q, *(t for t in (qd, qdd) if t is not None)]
    if (qd is None) != (qdd is None):
        return fault("has one of qd and qdd, and a spline takes both")
    if any(np.shape(t) != (len(motion.t_s), len(names)) for t in tables) or not len(motion.t_s):
        return fault("has tables q, qd, qdd and t_s that don't fit each other and the joints")
    for name in (n for n in names if n in arm.followers):
        source, scale, offset = arm.followers[name]
        own, other = (np.asarray(motion.q, float)[:, names.index(n)] for n in (name, arm.joints[source]))
        if not (away := float(np.abs(scale * other + offset - own).max())) <= FOLLOWS:
            return fault(f"moves {name!r} {away:.3g} from where it goes with {arm.joints[source]!r}", away)
    largest = float(np.abs(np.concatenate([np.ravel(t) for t in (*tables, motion.t_s)])).max())
    if not largest <= MOST:
        return fault(f"has a number as large as {largest:.3g}", largest)
    q, t_s = np.asarray(motion.q, float), np.asarray(motion.t_s, float)
    way = np.abs(q[1:] - q[:-1]).sum(0).max()
    if not way <= LONGEST:
        return fault(f"turns a joint by {way:.3g} in all, and none goes that far", float(way))
    rises = (t_s[1:] - t_s[:-1]).min(initial=np.inf)
    if t_s[0] < 0 or rises < 0 or (qd is not None and rises == 0):
        return fault("has times that don't rise")
    return None
