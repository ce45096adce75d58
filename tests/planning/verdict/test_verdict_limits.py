"""What joints can't do: one look at all motions leaves out none that a closer look would find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.quintic_spline import hermite
from kinematics.robots.robot import Robot
from planning.verdict import limits
from planning.verdict.arm import Arm, read
from planning.verdict.course import Course

RNG = np.random.default_rng(5)


def course(arm: Arm, number: int, start: np.ndarray, hurry: float, rests: bool = True, smooth: bool = True) -> Course:
    """A motion from `start` (J,) through two rows more; the larger `hurry`, the faster."""
    J = len(arm.joints)
    q = start + np.cumsum(np.concatenate([np.zeros((1, J)), RNG.uniform(-0.4, 0.4, (2, J))]), axis=0)
    t, qd, qdd = np.array([0.0, 1.0, 2.0]) / hurry, np.zeros((3, J)), np.zeros((3, J))
    qd[1], qdd[1] = RNG.normal(size=J) * 0.2 * hurry, RNG.normal(size=J) * 0.2 * hurry**2
    if not rests:
        qd[RNG.choice([0, 2]), RNG.integers(J)] = RNG.choice([-1.0, 1.0]) * 2e-4
    return Course(number, "transit", q, t, hermite(t, q, qd, qdd) if smooth else None, None, frozenset())


def test_no_fault_is_overlooked(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = replace(read(ur5e.urdf), velocity=np.full(7, 1.5))
    acceleration, seen = np.full(7, 6.0), {False: 0, True: 0}
    for _ in range(60):
        at, courses = np.zeros(7), list[Course]()
        for number in range(4):
            gap = RNG.choice([0.0] * 9 + [2e-6]) if number else 0.0
            rests, smooth = RNG.random() < 0.97, RNG.random() < 0.9
            courses.append(course(arm, number, at + gap, RNG.choice([0.3, 0.5, 0.5, 2.0], p=[0.4, 0.3, 0.25, 0.05]), rests, smooth))
            at = courses[-1].q[-1]
        arm = replace(arm, lower=np.where(RNG.random(7) < 0.01, 0.1, -9.0), upper=np.full(7, 9.0))
        said = limits.limit_faults(arm, courses, acceleration)
        with monkeypatch.context() as patch:
            patch.setattr(limits, "_doubtful", lambda arm, courses, acceleration: np.ones(len(courses), bool))
            closely = limits.limit_faults(arm, courses, acceleration)
        assert said == closely
        seen[bool(closely)] += 1
    assert min(seen.values()) > 3
