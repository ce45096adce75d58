"""What becomes of fingers that are told to close until they meet something: where they stop, and by how much they push what they close on.

A gripper closes with a force. Of an object that was seen from some sides only a plan knows about where it ends, so the plan tells the
fingers to go on a little further (`planning.motion.trajectory.FURTHER_M`), and they stop where both are at the true object. The finger that
meets it first slides it along the closing direction until the other does too; it is taken to be slid upright and not turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from kinematics.transforms import Array, transform
from planning.plan import Motion
from planning.verdict.hand import Hand, in_hand
from planning.verdict.pads import touch_of
from planning.verdict.polyhedra import Polyhedron

TIGHT = 1e-7
"""How exactly the gripper's value is found, rad or m."""
FAR_M = 1.0


@dataclass(frozen=True, eq=False)
class Closed:
    """Fingers that have closed on a body. value: of the gripper's joint; T_hand_body (4, 4): where the body is then; pushed_m: how far it
    was slid along the hand's y."""

    value: float
    T_hand_body: Array
    pushed_m: float


def close_on(hand: Hand, body: Sequence[Polyhedron], T_hand_body: Array, opened: float, command: float) -> Closed | None:
    """Fingers that close from one value of their joint, rad or m, until both are at a body, or as far as they are told to; None where
    nothing is between them, or one is in it from the start.

    body: its convex parts, T_hand_body (4, 4) where it stands before.
    """
    if len(hand.pads) == 1:  # a cup does not close
        return None

    def gaps(value: float) -> tuple[float, float] | None:
        at = in_hand(hand, value)
        sides = ([pad for pad in hand.pads if pad.side == side] for side in (1, -1))
        met = [touch_of(side, [at[p.carrier] @ p.T_carrier_face for p in side], body, T_hand_body) for side in sides]
        return None if met[0] is None or met[1] is None else (met[0][1].gap_m, met[1][1].gap_m)

    def room(value: float) -> float:
        found = gaps(value)
        return FAR_M if found is None else sum(found)

    before = gaps(opened)
    if before is None or min(before) <= 0:
        return None
    value = command if room(command) >= 0 else float(brentq(room, opened, command, xtol=TIGHT))
    found = gaps(value)
    if found is None:
        return None
    left, right = found
    pushed = left if left < 0 else max(-right, 0.0)
    return Closed(value, transform(p=[0.0, pushed, 0.0]) @ T_hand_body, pushed)


def with_fingers(motion: Motion, joint: int, first: float, last: float) -> Motion:
    """A motion whose gripper begins and ends at other values of its joint, whose number is `joint`; slower where the fingers go further."""
    if (first, last) == (motion.q[0, joint], motion.q[-1, joint]):
        return motion
    q = motion.q.copy()
    was_first, was_last = float(q[0, joint]), float(q[-1, joint])
    share = (last - first) / (was_last - was_first) if was_last != was_first else 0.0
    q[:, joint] = first + (q[:, joint] - was_first) * share
    q[-1, joint] = last
    t_s, qd, qdd, slower = motion.t_s, motion.qd, motion.qdd, max(abs(share), 1.0)
    if qd is not None and qdd is not None:
        stretched = np.ones(q.shape[1])
        stretched[joint] = share
        t_s, qd, qdd = t_s * slower, qd * stretched / slower, qdd * stretched / slower**2
    gripper = motion.gripper  # what it is told stays the same; where it is then does not
    if gripper is not None:
        gripper = replace(gripper, before=replace(gripper.before, value=first), after=replace(gripper.after, value=last))
    return replace(motion, q=q, t_s=t_s, qd=qd, qdd=qdd, gripper=gripper)
