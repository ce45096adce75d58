"""Compiled functions that ship with the package, in LLVM's optimised form: the first run only makes machine code of them, for its CPU, in a
tenth of the time that compiling takes, and without numba.

`shipped.zip` has LLVM's bitcode in units: each entry with what it alone calls, and what several entries call. `about.json` in it says of
what triple and LLVM they are, and of each entry of what version (`fingerprint`): one that a change of the source has made old is compiled.
`kinematics.jit.ship` makes the file; it is not used with settings of numba's, such as NUMBA_BOUNDSCHECK, that make other code.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from llvmlite import binding  # type: ignore[import-untyped]

from kinematics.jit import machine_code
from kinematics.jit.description import Description
from kinematics.jit.fingerprint import fingerprint, way_of_compiling
from kinematics.jit.numpy_abi import layout_known
from kinematics.jit.support import PLAIN

FILE = Path(__file__).with_name("shipped.zip")
ABOUT = "about.json"
_HARMLESS = ("NUMBA_CACHE_DIR", "NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "NUMBA_NUM_THREADS")
_X86 = {"opt": 3, "reloc": "static", "codemodel": "jitdefault", "jit": True}
"""How numba has machine code made on this architecture."""


def bring(symbol: str, entry: Description, args: Sequence[Any]) -> bool:
    """Make machine code of an entry for arguments like these, and of what it calls, and leave it in the cache; whether it ships."""
    if symbol not in entries() or entries()[symbol]["version"] != fingerprint(entry, args):
        return False
    with ZipFile(FILE) as file:
        for unit in _needed(symbol):
            if not machine_code.is_stored(unit):
                about = _about()["units"][unit]
                machine_code.store(machine_code.Code(unit, about["outside"], about["needs"], emit(file.read(unit))))
    return True


def entries() -> Mapping[str, Any]:
    """What is said of each entry, by symbol; nothing where what ships can't be used, see `unusable`."""
    found: Mapping[str, Any] = _about()["entries"]
    return found


def emit(bitcode: bytes) -> bytes:
    """An object file of a unit, for this machine's CPU."""
    emitted: bytes = _machine().emit_object(binding.parse_bitcode(bitcode))
    return emitted


def emit_module(text: str) -> bytes:
    """An object file of a module in LLVM's assembly, for this machine's CPU."""
    emitted: bytes = _machine().emit_object(binding.parse_assembly(text))
    return emitted


def unusable(about: Mapping[str, Any], environment: Mapping[str, str] = os.environ) -> str | None:
    """Why what ships can't be used here, in words."""
    if PLAIN:
        return PLAIN
    if about["triple"] != binding.get_process_triple():
        return f"it is for {about['triple']}"
    if tuple(about["llvm"]) > binding.llvm_version_info:
        return f"it is of LLVM {about['llvm']}"
    if settings := [name for name in environment if name.startswith("NUMBA_") and name not in _HARMLESS]:
        return f"{', '.join(settings)} is set"
    if about["way"] != way_of_compiling() or not layout_known():
        return "functions are compiled in another way"
    return None


def _needed(unit: str) -> Iterator[str]:
    """The units that one needs, and itself."""
    for need in _about()["units"][unit]["needs"]:
        yield from _needed(need)
    yield unit


@lru_cache(maxsize=1)
def _about() -> dict[str, Any]:
    nothing: dict[str, Any] = {"entries": {}, "units": {}}
    if not FILE.is_file():
        return nothing
    with ZipFile(FILE) as file:
        about: dict[str, Any] = json.loads(file.read(ABOUT))
    return nothing if unusable(about) else about


@lru_cache(maxsize=1)
def _machine() -> Any:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_triple(binding.get_process_triple())
    return target.create_target_machine(cpu=binding.get_host_cpu_name(), features=binding.get_host_cpu_features().flatten(), **_X86)
