"""An arm whose poses are known by hand: it slides along x and y, turns about z, tips about x; two fingers slide apart by a mimic joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.quintic_spline import hermite
from kinematics.robots.plain_urdf import read
from kinematics.scene import Held
from kinematics.transforms import Array, rotation_about, transform
from planning.plan import Motion
from planning.verdict.course import Course
from planning.verdict.hand import Hand

JOINTS = ("x", "y", "turn", "tip", "grip")
URDF = """<robot name="toy">
<link name="base"/><link name="rail"/><link name="bridge"/><link name="column"/><link name="palm"/><link name="hand"/>
<link name="left"/><link name="right"/><link name="tool"/>
<joint name="x" type="prismatic"><parent link="base"/><child link="rail"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" velocity="1"/></joint>
<joint name="y" type="prismatic"><parent link="rail"/><child link="bridge"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="2"/></joint>
<joint name="turn" type="continuous"><parent link="bridge"/><child link="column"/><axis xyz="0 0 1"/><limit velocity="4"/></joint>
<joint name="tip" type="revolute"><parent link="column"/><child link="palm"/><axis xyz="1 0 0"/>
<limit lower="-3.2" upper="3.2" velocity="4"/></joint>
<joint name="flange" type="fixed"><parent link="palm"/><child link="hand"/></joint>
<joint name="mount" type="fixed"><parent link="palm"/><child link="tool"/><origin xyz="0 0.4 -0.2" rpy="0 0 0.7"/></joint>
<joint name="grip" type="prismatic"><parent link="palm"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.05" velocity="1"/></joint>
<joint name="mirror" type="prismatic"><parent link="palm"/><child link="right"/><axis xyz="0 1 0"/>
<mimic joint="grip" multiplier="-1"/></joint>
</robot>"""
ARM = read(URDF)
HAND = Hand(
    ARM,
    4,
    np.eye(4),
    4,
    frozenset({"palm", "left", "right"}),
    frozenset({"left", "right"}),
    (),
    np.linspace(0, 0.05, 6),
    np.linspace(0, 0.1, 6),
)
"""The hand frame is the palm's own; grip's value is half of the width, 0 to 10 cm. It has no pads."""


def hand_at(q: Sequence[float], T_world_base: Array | None = None) -> Array:
    """Where the hand is (4, 4), written down without the verdict's kinematics."""
    T = transform(rotation_about((0, 0, 1), q[2]) @ rotation_about((1, 0, 0), q[3]), [q[0], q[1], 0.0])
    return T if T_world_base is None else T_world_base @ T


def course(
    *q: Sequence[float], number: int = 0, stage: str = "transit", t_s: Sequence[float] | None = None, held: Held | None = None
) -> Course:
    """A polyline through rows (x, y, turn, tip, grip), a second each; what is left out at a row's end is 0."""
    rows = np.array([[*row, *[0.0] * (5 - len(row))] for row in q])
    times = np.arange(float(len(rows))) if t_s is None else np.asarray(t_s, float)
    return Course(number, stage, rows, times, None, held, frozenset())


def splined(*q: Sequence[float], t_s: Sequence[float] | None = None, qd: Array | None = None, qdd: Array | None = None) -> Course:
    """The same with a spline through the rows, that rests at each unless told otherwise."""
    plain = course(*q, t_s=t_s)
    zero = np.zeros(plain.q.shape)
    spline = hermite(plain.t_s, plain.q, zero if qd is None else qd, zero if qdd is None else qdd)
    return Course(0, "transit", plain.q, plain.t_s, spline, None, frozenset())


def motion(*q: Sequence[float], stage: str = "transit", held: Held | None = None, t_s: Sequence[float] | None = None) -> Motion:
    """A motion of that arm, as a plan has it."""
    made = course(*q, t_s=t_s)
    return Motion(stage, JOINTS, made.q, made.t_s, held)
