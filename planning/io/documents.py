"""What all documents have in common: kind and version, poses, numbers, paths.

The field names are those of docs/formats.md; every document that is read is checked. Lengths in metres, angles in radians, poses as
{"p": [x, y, z], "q_wxyz": [w, x, y, z]}. Paths inside a file (meshes, URDFs) are relative to its folder; in memory they are absolute.
Numbers keep every digit.
"""

from __future__ import annotations

import re
from math import isfinite
from pathlib import Path
from typing import Any, cast

import numpy as np

from kinematics.transforms import Array, wxyz_from_rotation
from planning.io.checked import EACH_A_LINE, Node

VERSIONS = {"scene": (1, 2), "plan": (1, 2)}
"""The versions of each kind of document that are read."""


def kind_and_version(node: Node) -> tuple[str, int]:
    """What a document says it is: ("scene", 1)."""
    if isinstance(node.value, list):
        raise node.error(f"this is an array; {EACH_A_LINE}")
    if not isinstance(node.value, dict) or "schema" not in node.value:
        node.record(("schema",), tuple(node.value) if isinstance(node.value, dict) else ())
    schema = node.at("schema")
    found = re.fullmatch(r"retrieve/(scene|plan)@(\d+)", schema.text())
    if found is None:
        raise schema.error(f"{schema.value!r} is unknown; this program reads {_readable('scene')} and {_readable('plan')}")
    return found[1], int(found[2])


def expect(node: Node, kind: str) -> int:
    """The document's version. Raises InputError when it is of another kind, or of a version that is not read."""
    found, version = kind_and_version(node)
    schema = node.at("schema")
    if found != kind:
        advice = {
            "plan": "plans go to `retrieve report` and `retrieve show`, and after their scenes to `retrieve verify`",
            "scene": "scenes go to `retrieve plan` and `retrieve show`",
        }
        raise schema.error(f"this is a {found}, and a {kind} is expected; {advice[found]}")
    if version not in VERSIONS[kind]:
        advice_v = "too new: update the program" if version > max(VERSIONS[kind]) else "too old: write the file again"
        raise schema.error(f"{schema.value!r} is {advice_v}; this program reads {_readable(kind)}")
    return version


def _readable(kind: str) -> str:
    """The versions of a kind of document that are read, in words."""
    return " and ".join(f"retrieve/{kind}@{version}" for version in VERSIONS[kind])


def pose_to_json(T_a_b: Array) -> dict[str, list[float]]:
    """A transform (4, 4) as files have it."""
    return {"p": numbers(T_a_b[:3, 3]), "q_wxyz": numbers(wxyz_from_rotation(T_a_b[:3, :3]))}


def number(value: float) -> float:
    """A plain number. Raises: ValueError when it is none that JSON can say (infinity, NaN)."""
    if not isfinite(value):
        raise ValueError(f"{value} can't be written to a file")
    return float(value)


def numbers(values: Array) -> list[float]:
    """An array (N,) as plain numbers with every digit. Raises: ValueError like `number`."""
    return cast("list[float]", _finite(values).tolist())


def rows_of_numbers(values: Array) -> list[list[float]]:
    """The same of a table (N, M), row by row."""
    return cast("list[list[float]]", _finite(values).tolist())


def _finite(values: Array) -> Array:
    if not np.isfinite(out := np.asarray(values, float)).all():
        number(out[~np.isfinite(out)][0])
    return out


def without_none(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields that have a value."""
    return {key: value for key, value in fields.items() if value is not None}


def relative(file: str | None, folder: Path) -> str | None:
    """A path as a file in `folder` should say it: relative when it lies inside."""
    if file is None:
        return None
    path, at = Path(file).resolve(), folder.resolve()
    return path.relative_to(at).as_posix() if path.is_relative_to(at) else str(path)
