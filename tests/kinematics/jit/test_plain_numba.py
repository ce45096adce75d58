"""Without numba's inner parts the core runs as it does with them, to the same numbers; compiled plainly, it says why, once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from kinematics.jit import support
from kinematics.jit.decorators import PLAIN
from kinematics.jit.support import FORCE, SHOWN, missing_part, why_plain

ROOT = Path(__file__).resolve().parents[3]
TINY = """
import json, sys
sys.path[:0] = ["tests", "tests/planning/motion/search"]
from test_rrt_connect import LEFT, RIGHT, make_task, plan, shorten, slit
from kinematics.jit.decorators import PLAIN
from kinematics.collision import edge_check

task = make_task(slit(0.25))
found = plan(task, LEFT, RIGHT[None], max_iterations=20000, seed=0)
short = shorten(task, found.path, seed=0)
options = sorted(edge_check.config_free.targetoptions)
print(json.dumps([PLAIN, int(found.iterations), found.path.tolist(), short.path.tolist(), options]))
"""


def run_tiny(**environment: str) -> tuple[list[object], str]:
    """A cube is taken through a slit in a process of its own: what it prints, and its stderr."""
    kept = {k: v for k, v in os.environ.items() if k not in (FORCE, "NUMBA_CACHE_DIR")}
    done = subprocess.run([sys.executable, "-c", TINY], cwd=ROOT, env={**kept, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


def test_the_core_runs_without_inner_parts() -> None:
    """The same iterations, the same waypoints, the same shortcuts."""
    if PLAIN is not None:
        pytest.skip(f"there is nothing to compare with: {PLAIN}")
    (why, iterations, path, short, options), said = run_tiny(**{FORCE: "1", "NUMBA_OPT": "1"})  # at level 3 it would compile for longer
    assert why == f"{FORCE} is set"
    assert said.splitlines() == [f"retrieve: compiling plainly, so that the first start takes twice as long: {FORCE} is set"]
    assert not {"_nrt", "no_cfunc_wrapper", "pipeline_class"} & set(options)  # type: ignore[call-overload]
    (plain, own_iterations, own_path, own_short, own_options), silent = run_tiny()
    assert (plain, silent) == (None, "")
    assert "_nrt" in own_options  # type: ignore[operator]
    assert iterations == own_iterations
    assert np.allclose(path, own_path, rtol=0, atol=1e-9)  # type: ignore[arg-type]
    assert np.allclose(short, own_short, rtol=0, atol=1e-9)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("version", "reason"),
    [
        ("0.61.0", None),
        ("0.61.2", None),
        ("0.68.1", None),
        ("0.68.0rc1", None),
        ("0.60.0", "numba 0.60.0 is not among those that were tried (0.61 to 0.68)"),
        ("0.69.0", "numba 0.69.0 is not among those that were tried (0.61 to 0.68)"),
        ("1.61.0", "numba 1.61.0 is not among those that were tried (0.61 to 0.68)"),
        ("unknown", "numba unknown is not among those that were tried (0.61 to 0.68)"),
    ],
)
def test_a_numba_that_nobody_tried_is_used_plainly(version: str, reason: str | None) -> None:
    assert SHOWN == ((0, 61), (0, 68))
    assert why_plain(version, {}) == reason


@pytest.mark.parametrize(("value", "plain"), [("1", True), ("yes", True), ("0", False), ("", False)])
def test_plain_compilation_can_be_asked_for(value: str, plain: bool) -> None:
    assert (why_plain("0.68.1", {FORCE: value}) is not None) == plain


def test_a_missing_part_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    if PLAIN is not None:
        pytest.skip(PLAIN)
    assert missing_part() is None
    monkeypatch.setattr(support, "METHODS", ("get_call_template", "get_overlord"))
    assert str(missing_part()).endswith(" has no get_overlord")
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "kinematics.jit.pipeline", None)
    assert " lacks a part: " in str(missing_part())
    monkeypatch.undo()
    monkeypatch.setattr("kinematics.jit.numpy_abi.FLAGS", 24)
    assert missing_part() == "numpy's arrays are laid out in another way than was tried"


def test_it_is_told_once(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """By the process that started the others."""
    support.tell("of a reason")
    assert capsys.readouterr().err == "retrieve: compiling plainly, so that the first start takes twice as long: of a reason\n"
    monkeypatch.setattr(support.multiprocessing, "parent_process", lambda: "a parent")
    support.tell("of a reason")
    assert capsys.readouterr().err == ""
