"""A JSON value that knows where it stands, so that every complaint says where, what and how to mend it.

Checked by hand and not by JSON Schema: a person needs "objects[2].shape.size_m: -0.04 is not positive", not which branch of a oneOf failed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics import git_lfs
from kinematics.errors import InputError, did_you_mean
from kinematics.transforms import Array, rotation_from_wxyz, transform

SMALLEST_M, LARGEST_M = 1e-4, 100.0
"""Sizes and places that are allowed, metres."""
MOST_DEEP = 32
"""Levels of objects and arrays in a document; a plan has six."""
LARGEST_WHOLE = 2**53
"""Up to here every whole number is a float of its own."""
EACH_A_LINE = "one document a line is expected: `jq -c '.[]'` makes a line of each in an array"
UNIT_TOLERANCE = 1e-3
"""A quaternion whose length is within this of 1 was rounded, and is normalised; any other is a mistake."""


@dataclass(frozen=True)
class Node:
    """value: what stands in the document; where: file and line; path: the way to it inside the line, as objects[2].shape."""

    value: Any
    where: str
    path: str = ""

    def error(self, message: str) -> InputError:
        """The complaint about this value, to be raised by the caller."""
        return InputError(": ".join(part for part in (self.where, self.path, message) if part))

    def record(self, required: Sequence[str], optional: Sequence[str] = (), *, extra: bool = False) -> dict[str, Node]:
        """The fields of an object. Other fields are an error unless `extra`, in which case they are left out."""
        if not isinstance(self.value, dict):
            with_fields = f" with {', '.join(required)}" if required else ""
            raise self.error(f"{_kind(self.value)} stands where an object{with_fields} is expected")
        known = (*required, *optional)
        unknown = [name for name in self.value if name not in known]
        missing = [name for name in required if name not in self.value]
        if unknown and not extra:
            hint = did_you_mean(unknown[0], known) or f"; the fields are {', '.join(known)}"
            raise self.error(f"unknown field {unknown[0]!r}{hint}")
        if missing:
            raise self.error(f"missing field {missing[0]!r}{_misspelt(missing[0], unknown)}")
        return {name: self.at(name) for name in known if name in self.value}

    def at(self, name: str) -> Node:
        """The field `name` of an object that is known to have it."""
        return Node(self.value[name], self.where, f"{self.path}.{name}" if self.path else name)

    def items(self, least: int = 0, most: int | None = None) -> list[Node]:
        """The members of an array with at least so many, and at most."""
        if not isinstance(self.value, list):
            raise self.error(f"{_kind(self.value)} stands where an array [...] is expected")
        if len(self.value) < least:
            raise self.error(f"holds {len(self.value)}, and at least {least} is needed")
        if most is not None and len(self.value) > most:
            raise self.error(f"holds {len(self.value)}, and at most {most} can be used")
        return [Node(v, self.where, f"{self.path}[{i}]") for i, v in enumerate(self.value)]

    def text(self, choices: Iterable[str] = ()) -> str:
        """A text that is not empty, one of `choices` if there are any."""
        if not isinstance(self.value, str):
            raise self.error(f"{_kind(self.value)} stands where a text is expected")
        if not self.value:
            raise self.error("is empty")
        if not is_text(self.value):
            raise self.error(f"{self.value[:40]!r} holds half a character (a lone surrogate), which no file can hold")
        names = list(choices)
        if names and self.value not in names:
            raise self.error(f"{self.value!r} is not one of {', '.join(names)}{did_you_mean(self.value, names)}")
        return self.value

    def flag(self) -> bool:
        """true or false."""
        if not isinstance(self.value, bool):
            raise self.error(f"{_kind(self.value)} stands where true or false is expected")
        return self.value

    def integer(self, least: int | None = None, most: int | None = None) -> int:
        """A whole number, from `least` to `most`; 10.0 is one, as it is for JSON Schema: some languages write no other."""
        value = self.value
        if isinstance(value, float) and value.is_integer() and abs(value) <= LARGEST_WHOLE:
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.error(f"{_kind(value)} stands where a whole number is expected")
        if least is not None and value < least:
            raise self.error(f"{value} is below {least}")
        if most is not None and value > most:
            raise self.error(f"{value} is above {most}")
        return value

    def number(self, *, positive: bool = False, least: float | None = None, most: float | None = None) -> float:
        """A finite number in the range."""
        self._check_number(self.value)
        if positive and self.value <= 0:
            raise self.error(f"{self.value} is not positive")
        if least is not None and self.value < least:
            raise self.error(f"{self.value} is below {least:g}")
        if most is not None and self.value > most:
            raise self.error(f"{self.value} is above {most:g}")
        return float(self.value)

    def length(self) -> float:
        """The length of something, in metres."""
        return self.number(positive=True, least=SMALLEST_M, most=LARGEST_M)

    def vector(self, n: int | None = None, *, positive: bool = False, lengths: bool = False) -> Array:
        """An array of finite numbers, of length n if given, all positive if so asked; lengths: metres, in the bounds of what is meant."""
        values = self.value
        if not isinstance(values, list):
            raise self.error(f"{_kind(values)} stands where an array of numbers is expected")
        if n is not None and len(values) != n:
            raise self.error(f"holds {len(values)} numbers, and {n} are needed")
        for v in values:
            self._check_number(v)
            if positive and v <= 0:
                raise self.error(f"{v} is not positive")
            if lengths and positive and v < SMALLEST_M:
                raise self.error(f"{v} is below {SMALLEST_M:g} m")
            if lengths and abs(v) > LARGEST_M:
                raise self.error(f"{v} is beyond {LARGEST_M:g} m; are these millimetres?")
        return np.array(values, float)

    def matrix(self, columns: int) -> Array:
        """An array of at least one row of finite numbers, each of the same length."""
        rows = self.value
        if isinstance(rows, list) and rows and all(type(r) is list and len(r) == columns and set(map(type, r)) == {float} for r in rows):
            table = np.array(rows)  # a plan holds many thousands of numbers: ask about all at once
            if np.isfinite(table).all():
                return table
        return np.stack([row.vector(columns) for row in self.items(least=1)])

    def pose(self) -> Array:
        """The (4, 4) transform of {"p": [x, y, z], "q_wxyz": [w, x, y, z]}."""
        fields = self.record(("p", "q_wxyz"))
        p, node = fields["p"].vector(3, lengths=True), fields["q_wxyz"]
        q = node.vector(4)
        length = float(np.linalg.norm(q)) if np.abs(q).max() < 1e6 else np.inf
        if length == 0:
            raise node.error("has length 0, which is no rotation; no rotation at all is [1, 0, 0, 0]")
        if abs(length - 1) > UNIT_TOLERANCE:
            raise node.error(f"has length {length:.6g}, and a rotation has 1; divide w, x, y, z by their length")
        return transform(rotation_from_wxyz(q), p)

    def _check_number(self, value: object) -> None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(f"{_kind(value)} stands where a number is expected")
        if not _finite(value):
            raise self.error(f"{value} is not a finite number")


def is_text(value: object) -> bool:
    """Whether a value is a text that is not empty and can be written to a file: without halves of characters."""
    try:
        return isinstance(value, str) and bool(value.encode("utf-8"))
    except UnicodeEncodeError:
        return False


def parse_json(text: str, where: str) -> Node:
    """One JSON document. Raises InputError with the column where it is broken, or the name of a field that stands there twice."""
    twice: list[str] = []

    def fields(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            names = [name for name, _ in pairs]
            twice.extend(name for name in found if names.count(name) > 1)
        return found

    try:
        value = json.loads(text, object_pairs_hook=fields)
    except json.JSONDecodeError as e:
        hint = "; one document a line is expected: `jq -c .` joins the lines" if text.strip() == "{" else ""
        if text.lstrip().startswith("["):
            hint = f"; {EACH_A_LINE}"
        file = where.rpartition(":")[0]
        if file.lower().endswith((".yaml", ".yml")):
            hint = f"; from a YAML of words, `retrieve scene {file} -o cell.jsonl` makes a scene"
        if text.encode(errors="replace").startswith(git_lfs.START):
            hint = "; the file is a pointer of Git LFS: run `git lfs pull` where it is cloned"
        raise InputError(f"{where}: broken JSON at column {e.colno}: {e.msg}{hint}") from e
    except (RecursionError, ValueError) as e:  # nested too deeply, or an integer of thousands of digits
        raise InputError(f"{where}: broken JSON: {' '.join(str(e).split())}") from e
    if twice:
        raise InputError(f"{where}: the field {twice[0]!r} stands twice in one object")
    if _depth(text) > MOST_DEEP and _nested(value) > MOST_DEEP:
        raise InputError(f"{where}: objects and arrays lie in each other more than {MOST_DEEP} deep")
    return Node(value, where)


def _depth(text: str) -> int:
    """How deep brackets lie in each other, those inside of texts counted as well: no less than the document's own depth."""
    codes = np.frombuffer(text.encode("utf-8", "surrogatepass"), np.uint8)
    opens, closes = np.isin(codes, tuple(b"[{")), np.isin(codes, tuple(b"]}"))
    return int(np.cumsum(opens.astype(np.int64) - closes).max(initial=0))


def _nested(value: object) -> int:
    """How deep the objects and arrays of a document lie in each other."""
    deep, level = 0, [value]
    while level := [v for v in level if isinstance(v, dict | list)]:
        deep += 1
        level = [inner for v in level for inner in (v.values() if isinstance(v, dict) else v)]
    return deep


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the floats
        return False


def _misspelt(missing: str, unknown: Sequence[str]) -> str:
    near = did_you_mean(missing, unknown)
    return f", and {near[len(' (did you mean ') : -2]} is unknown: is it meant?" if near else ""


def _kind(value: object) -> str:
    """What a JSON value is, in words, with the value when it is short."""
    match value:
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case str():
            return f"the text {value!r}" if len(value) <= 40 else "a text"
        case int() | float():
            return f"the number {value}"
        case list():
            return "an array"
        case _:
            return "an object"
