"""Hands of three fingers, and fingers of several motors, as a gripper of two sides: one motor a finger closes it, its others stand still.

The thumb is the finger that closes most against the two others, which go together. All motors that close are driven as one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.robots.hands.hand_model import Branch, Model, NoGripper
from kinematics.transforms import Array

OPPOSED = 0.3
"""The others close so much against the thumb, at least: the cosine; fingers in a ring of three have 0.5."""
LOOKS = 7


def closing_motor(model: Model, palm: int, branch: Branch, named: Sequence[int]) -> int:
    """The actuated joint that closes a finger: the one that is named, or that moves it furthest."""
    motors = model.motors(branch[0])
    known = [j for j in motors if j in named]
    return known[0] if known else max(motors, key=lambda j: _moved(model, palm, branch, j))


def _moved(model: Model, palm: int, branch: Branch, motor: int) -> float:
    """How far a finger's middle moves by one motor, m."""
    places = np.array([model.points(branch, _at(model, motor, share), palm).mean(0) for share in np.linspace(0.0, 1.0, LOOKS)])
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def _at(model: Model, motor: int, share: float) -> Array:
    q, low, high = model.rest.copy(), float(model.lower[motor]), float(model.upper[motor])
    low, high = (low, high) if np.isfinite([low, high]).all() else (-np.pi, np.pi)
    q[motor] = low + share * (high - low)
    return q


def in_two_sides(model: Model, palm: int, branches: Sequence[Branch], motors: Sequence[int]) -> tuple[Branch, Branch]:
    """The links of the two fingers that go together, and those of the thumb. motors: which closes each branch.

    Raises: NoGripper where no finger closes against the others.
    """
    tips = [np.array([model.points(b, _at(model, j, share), palm).mean(0) for share in (0.0, 1.0)]) for b, j in zip(branches, motors)]
    middle = np.mean([ends.mean(0) for ends in tips], axis=0)
    ways = []
    for ends in tips:
        far = np.linalg.norm(ends - middle, axis=1)
        way = ends[int(np.argmin(far))] - ends[int(np.argmax(far))]
        ways.append(way / max(float(np.linalg.norm(way)), 1e-9))
    against = [min(float(-ways[t] @ w) for k, w in enumerate(ways) if k != t) for t in range(len(ways))]
    thumb = int(np.argmax(against))
    if against[thumb] < OPPOSED:
        names = ", ".join(model.joints[j] for j in motors)
        raise NoGripper(f"no gripper that can be used: of three fingers ({names}) none closes against the two others")
    return tuple(i for k, b in enumerate(branches) if k != thumb for i in b), branches[thumb]
