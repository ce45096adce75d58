"""Limits of velocity, acceleration and jerk: from the URDF, from a robot's data sheet (robots.toml), from a file of one's own.

A URDF gives velocities at most. What nobody gives is assumed, and said: full speed after ACCELERATION_S, full acceleration after JERK_S; of
the fingers, which weigh little, after GRIPPER_ACCELERATION_S and GRIPPER_JERK_S.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from kinematics.errors import did_you_mean, one_line
from kinematics.git_lfs import refuse_pointer
from kinematics.transforms import Array

ACCELERATION_S = 0.35
JERK_S = 0.15
GRIPPER_ACCELERATION_S = 0.1
GRIPPER_JERK_S = 0.05
VELOCITY = 1.0
"""Assumed where a URDF gives none, rad/s or m/s."""
FASTEST = 20.0
"""rad/s: no joint of an arm turns faster, and who says so means degrees, mostly."""
KINDS = ("velocity", "acceleration", "jerk")
ALL = "all"
LEAST, MOST = 1e-3, 1e6
"""What a file of limits may say, in rad or m, and s: what lies beyond is a slip of the unit, and no trajectory comes of it."""


@dataclass(frozen=True, eq=False)
class JointLimits:
    """velocity, acceleration, jerk (J,) of every actuated joint, in rad (or m) and seconds. source: who says so; assumed: in words, what
    nobody says and what is taken instead, empty where all is known; jerk_is_known (J,): of which joints somebody says the jerk."""

    velocity: Array
    acceleration: Array
    jerk: Array
    source: str
    assumed: str
    jerk_is_known: NDArray[np.bool_]

    @property
    def known_jerk(self) -> Array:
        """The jerks (J,) that somebody says, infinite where they are assumed: planned by, and no reason to call another's plan false."""
        return np.where(self.jerk_is_known, self.jerk, np.inf)


def joint_limits(
    urdf: etree._Element, joints: Sequence[str], arm: Sequence[int], gripper: int, sheet: Mapping[str, Any] | None = None
) -> JointLimits:
    """The limits of a cleaned URDF's actuated joints (J,), where data sheets say more with that.

    arm: which of them the sheet's lists are about, in their order; gripper: which of them opens the fingers. sheet: `source`, lists by
    `KINDS` for the arm, and `gripper`, one number by kind.
    """
    given = {name: _urdf_velocity(urdf, name) for name in joints}
    values = {kind: np.full(len(joints), np.nan) for kind in KINDS}
    values["velocity"][:] = [np.nan if v is None else v for v in given.values()]
    for kind in KINDS:
        if sheet and kind in sheet:
            values[kind][list(arm)] = sheet[kind]
        if sheet and kind in sheet.get("gripper", {}):
            values[kind][gripper] = sheet["gripper"][kind]
    return _completed(joints, gripper, values, str(sheet["source"]) if sheet else "the URDF")


def too_fast(joints: Sequence[str], velocity: Array) -> tuple[str, ...]:
    """A note on an arm's joints that turn faster (A,), rad/s, than any arm's: they are taken as they are, and may be meant in degrees."""
    fast = [f"{name} {v:g} rad/s" for name, v in zip(joints, velocity) if v > FASTEST]
    if not fast:
        return ()
    most = float(velocity.max())
    inner = f"are they in degrees a second? Then {most:g} is {np.radians(most):.3g}: say so in the URDF, or with --limits FILE"
    return (f"joints that turn very fast by its URDF ({', '.join(fast)}); {inner}",)


def read_tables(file: Path) -> dict[str, Any]:
    """What a TOML file holds. Raises: ValueError that names the file when it can't be read."""
    refuse_pointer(file, "TOML")
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except OSError as e:
        raise ValueError(one_line(e)) from e
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as e:
        raise ValueError(f"{file}: is no TOML: {e}") from e


def read_limits(file: Path, joints: Sequence[str], known: JointLimits, urdf: str) -> JointLimits:
    """A robot's limits (J,) with those of a TOML file in their place: a table a joint, or `[all]`, with numbers by `KINDS`.

    A velocity without an acceleration leaves that as it was known, and so on. urdf: the robot's, as text. Plans are judged by its
    velocities, too: `[all]` leaves a joint's where it is lower, and a joint's own table may not be above it. Raises: ValueError that names
    the file and the place.
    """
    tables, root = read_tables(file), etree.fromstring(urdf.encode())
    most = {"velocity": np.array([_urdf_velocity(root, name) or np.inf for name in joints])}
    values, said = {kind: np.array(getattr(known, kind)) for kind in KINDS}, known.jerk_is_known.copy()
    for name, table in sorted(tables.items(), key=lambda item: item[0] != ALL):
        if name != ALL and name not in joints:
            known_ones = f"the robot's are {', '.join(joints)}, and {ALL!r} means each"
            raise ValueError(f"{file}: there is no joint {name!r}{did_you_mean(name, joints)}; {known_ones}")
        if not isinstance(table, dict):
            raise ValueError(f"{file}: {name} must be a table, [{name}], with numbers for {', '.join(KINDS)}")
        for kind, value in table.items():
            if kind not in KINDS:
                raise ValueError(f"{file}: {name}.{kind} is unknown{did_you_mean(kind, KINDS)}; {', '.join(KINDS)} can be given")
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < np.inf:
                raise ValueError(f"{file}: {name}.{kind}: {value!r} is no positive number")
            if not LEAST <= value <= MOST:
                raise ValueError(f"{file}: {name}.{kind}: {value!r} is not between {LEAST:g} and {MOST:,.0f}; it counts rad (or m) and s")
            which, bound = slice(None) if name == ALL else list(joints).index(name), most.get(kind, np.full(len(joints), np.inf))
            if name != ALL and value > bound[which]:
                above = f"{value:g} is above the URDF's {bound[which]:g}, by which every plan is judged"
                raise ValueError(f"{file}: {name}.{kind}: {above}; give less, or a URDF that allows it")
            values[kind][which] = np.minimum(value, bound[which])
            if kind == "jerk":
                said[which] = True
    assumed = "" if all(kind in tables.get(ALL, {}) for kind in KINDS) else known.assumed
    return JointLimits(values["velocity"], values["acceleration"], values["jerk"], f"{file.name}, else {known.source}", assumed, said)


def _urdf_velocity(urdf: etree._Element, name: str) -> float | None:
    """The velocity limit of a joint in a URDF, None where it gives none."""
    named = (joint for joint in urdf.iter("joint") if joint.get("name") == name)
    value = next((limit.get("velocity") for joint in named for limit in joint.iter("limit")), None)
    return float(value) if value is not None and float(value) > 0 else None


def _completed(joints: Sequence[str], gripper: int, values: dict[str, Array], source: str) -> JointLimits:
    """Fill in what is not known, nan so far, and say so."""
    said, jerk_is_known = list[str](), ~np.isnan(values["jerk"])
    slow, quick = (np.full(len(joints), seconds) for seconds in (ACCELERATION_S, JERK_S))
    slow[gripper], quick[gripper] = GRIPPER_ACCELERATION_S, GRIPPER_JERK_S
    rules = (("velocity", lambda: np.full(len(joints), VELOCITY), f"{VELOCITY:g} rad/s or m/s", ""),
             ("acceleration", lambda: values["velocity"] / slow, f"full speed in {ACCELERATION_S:g} s", f"{GRIPPER_ACCELERATION_S:g} s"),
             ("jerk", lambda: values["acceleration"] / quick, f"full acceleration in {JERK_S:g} s", f"{GRIPPER_JERK_S:g} s"))  # fmt: skip
    for kind, rule, words, fingers in rules:
        missing = np.isnan(values[kind])
        if missing.any():
            values[kind][missing] = rule()[missing]
            which = "every joint" if missing.all() else ", ".join(name for name, m in zip(joints, missing) if m)
            said.append(f"{kind} of {which}: {words}" + (f" ({joints[gripper]} {fingers})" if fingers and missing[gripper] else ""))
    return JointLimits(values["velocity"], values["acceleration"], values["jerk"], source, "; ".join(said), jerk_is_known)
