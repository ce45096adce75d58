"""Hands of three fingers, and fingers of several motors, as a gripper of two sides: one motor a finger closes it, its others stand still.

The thumb is the finger that closes most against the two others, which go together. All motors that close are driven as one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.robots.hands.hand_model import Branch, Model, NoGripper
from kinematics.robots.tree import SLIDES
from kinematics.transforms import Array, inverse

OPPOSED = 0.3
"""The others close so much against the thumb, at least: the cosine; fingers in a ring of three have 0.5."""
PARALLEL, ASIDE_M = np.cos(np.radians(5)), 0.01
LOOKS = 7


def closing_motors(model: Model, palm: int, branches: Sequence[Branch], named: Sequence[int]) -> list[tuple[int, ...]]:
    """Which actuated joints may close the fingers, one of each: first those that are named, or that move them furthest. What spreads
    fingers may move them further than what closes them; so then come those that are as many joints from the tips as each other."""
    motors = [model.motors(branch[0]) for branch in branches]
    moved = [{j: _moved(model, palm, branch, j) for j in of} for branch, of in zip(branches, motors)]
    known = [[j for j in of if j in named] for of in motors]
    first = tuple(of[0] if of else max(most, key=lambda j: most[j]) for of, most in zip(known, moved))
    alike = [tuple(of[-k] for of in motors) for k in range(1, min(map(len, motors)) + 1)]
    alike = [way for way in alike if way != first and all(j in of or not of for j, of in zip(way, known))]
    return [first, *sorted(alike, key=lambda way: -sum(most[j] for j, most in zip(way, moved)))]


def _moved(model: Model, palm: int, branch: Branch, motor: int) -> float:
    """How far a finger's middle moves by one motor, m."""
    places = np.array([model.points(branch, _at(model, motor, share), palm).mean(0) for share in np.linspace(0.0, 1.0, LOOKS)])
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def _at(model: Model, motor: int, share: float) -> Array:
    q, low, high = model.rest.copy(), float(model.lower[motor]), float(model.upper[motor])
    low, high = (low, high) if np.isfinite([low, high]).all() else (-np.pi, np.pi)
    q[motor] = low + share * (high - low)
    return q


def are_three(model: Model, palm: int, branches: Sequence[Branch]) -> bool:
    """Whether three branches that one motor moves are fingers of their own. Links of a linkage turn, about axes that are parallel, and
    stand at one place along them."""
    roots = [branch[0] for branch in branches]
    if any(model.tree.kind[i] == SLIDES for i in roots):
        return True
    poses = model.tree.poses(model.rest)
    axes = np.array([(inverse(poses[palm]) @ poses[i])[:3, :3] @ model.tree.axis[i] for i in roots])
    along = [float((model.points(branch, model.rest, palm) @ axes[0]).mean()) for branch in branches]
    return bool(np.abs(axes @ axes[0]).min() < PARALLEL or np.ptp(along) > ASIDE_M)


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
