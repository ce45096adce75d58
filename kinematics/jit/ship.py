"""Makes `shipped.zip`, see `kinematics.jit.shipped`."""

from __future__ import annotations

import hashlib
import json
import re
import zipfile
from collections.abc import Container, Iterable, Sequence
from typing import Any

import llvmlite.binding as llvm  # type: ignore[import-untyped]

from kinematics.jit.compiler import Library, rarely_collecting
from kinematics.jit.description import Description
from kinematics.jit.fingerprint import fingerprint, way_of_compiling
from kinematics.jit.shipped import ABOUT, FILE

CPU = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
"""What the functions are optimised for, as numba's settings: not for the machine that makes the file. Machine code is made for the machine
that runs it."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time that the file's parts bear, so that the same functions are the same bytes."""
_NAME = re.compile(r"@([-\w.$]+)")


def ship(called: Sequence[tuple[Description, Sequence[Any], str]]) -> None:
    """Write the file. called: entries, with arguments and their symbols."""
    with rarely_collecting():
        library = Library(called)
        module = library.optimised()
    split = _Split(module, library.symbols)
    versions = {symbol: {"version": fingerprint(entry, args)} for entry, args, symbol in called if symbol in library.symbols}
    about = {
        "triple": module.triple,
        "llvm": llvm.llvm_version_info,
        "way": way_of_compiling(),
        "entries": versions,
        "units": split.about(),
    }
    with zipfile.ZipFile(FILE, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as out:
        out.writestr(zipfile.ZipInfo(ABOUT, _EPOCH), json.dumps(about, indent=1), zipfile.ZIP_DEFLATED)
        for unit in split.functions:
            out.writestr(zipfile.ZipInfo(unit, _EPOCH), split.bitcode(unit), zipfile.ZIP_DEFLATED)


class _Split:
    """A module in units: functions that the same entries call are one. A unit that only one entry calls has the entry's symbol."""

    functions: dict[str, list[str]]
    """The functions of each unit, by its symbol."""

    def __init__(self, module: Any, symbols: Sequence[str]) -> None:
        mark = hashlib.sha256(module.as_bitcode()).hexdigest()[:16]
        for i, function in enumerate(module.functions):
            if not function.is_declaration and function.name not in symbols:
                function.name, function.linkage = f"core-{mark}-{i}", llvm.Linkage.external
        text = str(module)
        self.bodies = {_first_name(body): body for body in re.findall(r"^define .*?^}$", text, re.MULTILINE | re.DOTALL)}
        self.declared = {_first_name(line): line for line in re.findall(r"^declare .*$", text, re.MULTILINE)}
        self.variables = {_first_name(line): line for line in re.findall(r"^@.*$", text, re.MULTILINE)}
        self.common = "\n".join(re.findall(r"^(?:target |%|attributes |!).*$", text, re.MULTILINE))
        self.reads = {name: set(_NAME.findall(text)) - {name} for name, text in (self.bodies | self.variables).items()}
        users: dict[str, list[str]] = {name: [] for name in self.bodies}
        for symbol in symbols:
            for name in self._reached([symbol], self.bodies):
                users[name].append(symbol)
        groups: dict[tuple[str, ...], list[str]] = {}
        for name, using in users.items():
            groups.setdefault(tuple(using), []).append(name)
        self.functions = {using[0] if len(using) == 1 else names[0]: names for using, names in groups.items()}
        self.unit_of = {name: unit for unit, names in self.functions.items() for name in names}

    def _reached(self, names: Iterable[str], among: Container[str]) -> set[str]:
        """What some functions and variables read, and what that reads, as far as it is among some; and themselves."""
        found, ahead = set(names), list(names)
        while ahead:
            fresh = {name for name in self.reads[ahead.pop()] if name in among} - found
            found |= fresh
            ahead += fresh
        return found

    def _read(self, unit: str) -> list[str]:
        """The names of all that a unit reads and does not have, sorted."""
        within = self._reached(self.functions[unit], self.variables)
        return sorted(within.union(*(self.reads[name] for name in within)) - set(self.functions[unit]))

    def about(self) -> dict[str, Any]:
        """Of each unit: the units that it needs, and the functions of the C library."""
        out = {}
        for unit in self.functions:
            read = self._read(unit)
            needs = sorted({self.unit_of[name] for name in read if name in self.unit_of})
            out[unit] = {"needs": needs, "outside": [name for name in read if name in self.declared and not name.startswith("llvm.")]}
        return out

    def bitcode(self, unit: str) -> bytes:
        """A unit, with the variables that it reads, and what it calls declared."""
        lines = [self.common]
        for name in self._read(unit):
            if name in self.bodies:
                lines.append("declare" + self.bodies[name].partition(" {\n")[0].removeprefix("define"))
            else:
                lines.append(self.declared.get(name) or self.variables[name])
        lines += [self.bodies[name] for name in self.functions[unit]]
        module = llvm.parse_assembly("\n".join(lines))
        module.verify()
        data: bytes = module.as_bitcode()
        return data


def _first_name(text: str) -> str:
    found = _NAME.search(text)
    assert found is not None
    return found[1]
