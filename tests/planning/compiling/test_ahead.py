"""The list of what is compiled ahead is true and complete; and a plan needs neither a compiler nor other heavy packages."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinematics.jit import machine_code, shipped
from kinematics.jit.decorators import PLAIN, Entry
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from planning.compiling import ahead
from planning.io.results import scene_writer
from planning.scenes.generation import generate, load_spec
from retrieve_cli import terminal

pytestmark = pytest.mark.skipif(PLAIN is not None, reason="functions are compiled plainly")

ROOT = Path(__file__).resolve().parents[3]
HEAVY = ("numba", "torch", "scipy", "trimesh", "pyarrow", "matplotlib", "yourdfpy", "pytorch_kinematics", "rich")
PROGRAM = f"""
import gc, json, sys
from retrieve_cli.__main__ import main

code = main(["plan", sys.argv[1], "-o", sys.argv[2]])
from kinematics.jit.decorators import Entry
called = [[f"{{e.__module__}}.{{e.__qualname__}}", kinds] for e in gc.get_objects() if type(e) is Entry for kinds in e._tried]
print(json.dumps([code, called, [name for name in {HEAVY!r} if name in sys.modules]]))
"""


LABELS = """
import gc, json, sys
from retrieve_cli.__main__ import main

code = main(sys.argv[1:])
from kinematics.jit.decorators import Entry
from kinematics.jit.machine_code import symbol_of
entries = [e for e in gc.get_objects() if type(e) is Entry]
print(json.dumps([code, [symbol_of(e.__module__, e.__qualname__, kinds) for e in entries for kinds in e._tried], "numba" in sys.modules]))
"""


def is_of_this_version(row: ahead.Ahead) -> bool:
    try:
        entry = ahead.entry_of(row)
        kinds = machine_code.kinds([ahead.example(words) for words in row.arguments])
    except (ImportError, AttributeError, TypeError):
        return False
    return isinstance(entry, Entry) and kinds == row.kinds


def test_the_rows_are_of_this_version() -> None:
    """`make ahead` makes the list again. A row that is out of date costs a first run a second, so one in ten may be."""
    stale = [row.entry for row in ahead.known() if not is_of_this_version(row)]
    assert len(stale) <= len(ahead.known()) // 10, stale
    assert all(0.0 < row.loops < 6000.0 for row in ahead.known())


def test_a_description_is_enough_to_make_an_example() -> None:
    table = np.zeros((3, 4))
    for value in (1, 2.5, True, table, table[:, ::2], table.astype(np.float32), np.zeros(3, np.uint64)):
        assert machine_code.kinds([ahead.example(ahead.describe(value))]) == machine_code.kinds([value])


def test_the_list_holds_what_a_plan_calls_and_the_next_plan_needs_no_compiler(ur5e: Robot, tmp_path: Path) -> None:
    with scene_writer(tmp_path / "scene.jsonl") as write:
        write(generate(load_spec("paper"), ur5e, to_ref(ur5e), 7, 0))
    for again in (False, True):
        command = [sys.executable, "-c", PROGRAM, str(tmp_path / "scene.jsonl"), str(tmp_path / "plans.jsonl")]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        code, called, heavy = json.loads(done.stdout)
        listed = {(row.entry, row.kinds) for row in ahead.known()}
        assert code == 0
        assert len(called) > 30
        missing = {tuple(c) for c in called} - listed
        assert len(missing) <= len(called) // 10, f"make ahead: {missing}"
        assert not again or not heavy


def test_labels_need_no_compiler_either(tmp_path: Path) -> None:
    """What only they call ships, too. Once some were made, numba is not imported: each worker would take a second longer to begin."""
    words = ["label", "-n", "1", "--seed", "8", "--moves", "1", "--objects", "1", "--partly-seen", "1", "--paths", "8", "-o"]
    for again in (False, True):
        command = [sys.executable, "-c", LABELS, *words, str(tmp_path / str(again))]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        code, symbols, numba = json.loads(done.stdout)
        assert code == 0
        assert not again or not numba
        missing = [symbol for symbol in symbols if symbol not in shipped.entries()]
        assert len(symbols) > 50
        assert not shipped.entries() or len(missing) <= len(symbols) // 10, f"make ahead: {missing}"


def test_there_are_few_functions() -> None:
    """Each costs a first run half a second."""
    assert 50 < len(ahead.known()) < 75
    assert sum(row.loops for row in ahead.known()) < 40_000
    assert 0.0005 < ahead.loop_s() < 1.0


def test_a_process_beside_ends_with_its_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[ahead.Ahead] = []
    monkeypatch.setattr(ahead, "compile_now", asked.append)
    monkeypatch.setattr(machine_code, "is_stored", lambda symbol: False)
    ahead.main(os.getppid() + 1)
    assert asked == []
    ahead.main(os.getppid())
    assert asked == ahead.known()[::-1], "from the end"
    assert ahead.waiting() == ahead.known()
    assert ahead.share_done() == 0.0


def test_one_is_started_only_for_something_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine_code, "is_stored", lambda symbol: True)
    assert ahead.start_beside() is None
    assert ahead.share_done() == 1.0


def test_only_one_is_at_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another one is started only once the first has ended."""

    class Beside:
        ended: int | None = None

        def poll(self) -> int | None:
            return self.ended

    monkeypatch.setattr(machine_code, "is_stored", lambda symbol: False)
    monkeypatch.setattr(ahead, "_STARTED", [])
    monkeypatch.setattr(ahead.os, "sched_getaffinity", lambda pid: {0, 1}, raising=False)
    monkeypatch.setattr(ahead.subprocess, "Popen", lambda *args, **kws: Beside())
    monkeypatch.setattr(ahead.atexit, "register", lambda *args: None)
    first: Any = ahead.start_beside()
    assert isinstance(first, Beside)
    assert ahead.start_beside() is None
    first.ended = 0
    assert isinstance(ahead.start_beside(), Beside)


def test_the_share_and_the_time_left_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    shares = iter([0.0, 0.25, 0.5, *[1.0] * 99])
    monkeypatch.setattr(ahead, "share_done", lambda: next(shares))
    monkeypatch.setattr(terminal, "perf_counter", iter([0.0, 1.0, 4.0]).__next__)
    with terminal._telling_of_compilation(told.append):
        time.sleep(1.8)
    assert told == ["compiling, this once: 25 %", "compiling, this once: 50 %, about 4 s more", ""]


def test_an_entry_that_is_gone_is_told_and_no_more() -> None:
    wrong = ahead.compile_now(ahead.Ahead("planning.gone.away", "i", ["i"], 1.0))
    assert wrong is not None
    assert "planning.gone" in wrong
