"""What ships is of this version, is used without numba, and does what numba's own code does; else it is left alone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, cast
from zipfile import ZipFile

import numpy as np
import pytest
from llvmlite import binding  # type: ignore[import-untyped]

from kinematics.jit import shipped
from kinematics.jit.decorators import PLAIN, Entry
from kinematics.jit.description import Description
from kinematics.jit.fingerprint import code_of, fingerprint, way_of_compiling
from kinematics.jit.record import record
from planning.compiling import ahead

ROOT = Path(__file__).resolve().parents[3]
PROGRAM = """
import json, sys
import numpy as np
from kinematics.spline_kernel import evaluate_rows

rng = np.random.default_rng(5)
rows, control, t = np.array([0.0, 0.4, 1.0]), rng.uniform(size=(2, 6, 3)), np.linspace(0.0, 1.0, 9)
out = np.zeros((2, 9, 3))
evaluate_rows(rows, control, t, 1, np.empty((6, 3)), out[0])
without = "numba" not in sys.modules
evaluate_rows.checked(rows, control, t, 1, np.empty((6, 3)), out[1])
print(json.dumps([without, *out.tolist()]))
"""
with ZipFile(shipped.FILE) as file:
    ABOUT_FILE = json.loads(file.read(shipped.ABOUT))
WHY_NOT = shipped.unusable(ABOUT_FILE | {"way": way_of_compiling()})
needs_shipped = pytest.mark.skipif(WHY_NOT is not None, reason=f"what ships can't be used here: {WHY_NOT}")


@needs_shipped
def test_what_ships_is_of_this_version() -> None:
    """`make ahead` makes it again. One that is old is compiled, which costs a first run a second, so one in ten may be."""
    rows = [(row, ahead.entry_of(row), [ahead.example(words) for words in row.arguments]) for row in ahead.known()]
    old = [row.entry for row, entry, args in rows if shipped.entries().get(row.symbol, {}).get("version") != fingerprint(entry, args)]
    assert len(old) <= len(rows) // 10, f"make ahead: {old}"


@needs_shipped
def test_it_is_called_without_numba_and_does_the_same(tmp_path: Path) -> None:
    kept = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")} | {"XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, env=kept, capture_output=True, text=True, check=True)
    without_numba, ours, theirs = json.loads(done.stdout)
    assert without_numba
    assert ours == theirs
    assert np.ptp(ours) > 0.1


@needs_shipped
def test_units_need_only_units_that_ship() -> None:
    units = ABOUT_FILE["units"]
    assert all(set(unit["needs"]) <= set(units) for unit in units.values())
    assert set(ABOUT_FILE["entries"]) <= set(units)
    assert all(binding.address_of_symbol(name) for unit in units.values() for name in unit["outside"]), "of the C library, not of numba's"


@pytest.mark.parametrize(
    ("about", "environment", "why"),
    [
        ({}, {}, None),
        ({}, {"NUMBA_NUM_THREADS": "2", "NUMBA_CACHE_DIR": "x", "HOME": "y"}, None),
        ({}, {"NUMBA_BOUNDSCHECK": "1"}, "NUMBA_BOUNDSCHECK is set"),
        ({"triple": "other-cpu-os"}, {}, "it is for other-cpu-os"),
        ({"llvm": [999, 0, 0]}, {}, "it is of LLVM [999, 0, 0]"),
        ({"way": "other"}, {}, "functions are compiled in another way"),
    ],
)
def test_it_is_used_where_it_was_made_for(about: dict[str, Any], environment: dict[str, str], why: str | None) -> None:
    fits = {"triple": binding.get_process_triple(), "llvm": [1, 0, 0], "way": way_of_compiling()}
    assert shipped.unusable(fits | about, environment) == (PLAIN or why)


def test_an_entry_that_does_not_ship_is_compiled() -> None:
    assert not shipped.bring("nobody.knows-0", cast(Description, None), [])


# The version of an entry --------------------------------------------------------------------------------------------------------------

FACTOR = 2.0


def _inner(x: float) -> float:
    return FACTOR * x


def _described(function: Callable[..., Any]) -> Description:
    return Entry(function, {})


inner = _described(_inner)


def outer(x: float) -> float:
    return inner(x) + np.sqrt(x)


def test_the_version_changes_with_what_is_called_and_read(monkeypatch: pytest.MonkeyPatch) -> None:
    def version() -> str:
        return fingerprint(_described(outer), [1.0])

    before = version()
    assert version() == before
    monkeypatch.setattr(sys.modules[__name__], "FACTOR", 2.5)
    assert version() != before
    monkeypatch.undo()
    assert version() == before

    def other(x: float) -> float:
        return FACTOR * x + 1.0

    monkeypatch.setattr(sys.modules[__name__], "inner", _described(other))
    assert version() != before


def test_what_does_not_run_makes_no_version() -> None:
    bare = 'X = 1\n@f\ndef g(a):\n    if a:\n        return "s" + (a)\n    return b\n'
    full = bare.replace("X = 1", '"""Module."""\n\nX = 1  # one\n"""Of X."""').replace("(a):", '(a):\n    """Two\n    lines."""\n    # so')
    full = full.replace("(a)\n    return", "(\n            a)\n\n    return")
    assert code_of(full) == code_of(bare)
    for changed in (
        bare.replace("X = 1", "X = 2"),
        bare.replace('"s"', '"t"'),
        bare.replace("    return b", "        return b"),
        bare.replace("@f", "@h"),
    ):
        assert code_of(changed) != code_of(bare)


def test_a_text_is_the_same_for_any_python() -> None:
    """Python 3.12 took f-strings apart; what ships is made by one version and used by all."""
    source = 'def g(a, w):\n    return h(f"{a!r:>{w}} {{x}} {f\'{a}\'}", f"""\n{a}\n  b""")\n'
    expected = 'def g ( a , w ) : NEWLINE INDENT return h ( f"{a!r:>{w}} {{x}} {f\'{a}\'}" , f"""\n{a}\n  b""" ) NEWLINE DEDENT '
    assert code_of(source) == expected


def test_the_version_changes_with_the_order_of_fields() -> None:
    class _One(NamedTuple):
        a: Any
        b: Any

    class _Other(NamedTuple):
        b: Any
        a: Any

    table = np.zeros(3)
    versions = [fingerprint(_described(outer), [cast(Any, record(cls))(table, table)]) for cls in (_One, _Other)]
    assert versions[0] != versions[1]
