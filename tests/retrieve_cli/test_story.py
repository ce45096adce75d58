"""The story of a scene: what is in the way, each move, how it ends; told on a terminal and nowhere else."""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinematics.scene import Scene
from kinematics.transforms import transform
from planning import read_scenes
from planning.plan import Blocked, Fault, Move, Plan, Unsolvable
from retrieve_cli.__main__ import main
from retrieve_cli.story import story

TRIAL = Path(__file__).resolve().parents[2] / "examples" / "02_plum_behind_cylinders.jsonl"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return replace(next(iter(read_scenes(TRIAL))), id="7")


def told(scene: Scene, moves: Sequence[Move] = (), *, success: bool = False, **more: object) -> list[str]:
    plan = Plan(scene.id, "p", "deep", success, None, tuple(moves), (), 0.25, 0.5, 2.0, 0.0, success)
    return list(story(scene, replace(plan, **more)))  # type: ignore[arg-type]


def move(name: str, *, why: Blocked | None = None) -> Move:
    return Move(name, 3, np.eye(4), transform(p=(0.3, 0.4, 0.0)), why is None, why)


def test_a_success_is_told_move_by_move(scene: Scene) -> None:
    tried = [move("can_9", why=Blocked("ik")), move("box_1"), move("box_2")]
    kept_in = (Blocked("approach", "camera", "box_1"), Blocked("transit", detail="no path in 3000 iterations"))
    lines = told(scene, tried, success=True, target_blocked=kept_in)
    others = len(scene.objects) - 1
    assert lines == [
        f"scene 7: {scene.target} is wanted; {others} other objects stand in the cabinet",
        f"  {scene.target} is blocked: camera would touch box_1 (approach)",
        "  1. box_1 moves 50 cm away, to region 3",
        f"  {scene.target} is still blocked: transit (no path in 3000 iterations)",
        "  2. box_2 moves 50 cm away, to region 3",
        f"  3. {scene.target} comes out; the arm moves for 0.0 s, its hand 2.0 m",
        "  planned in 0.8 s; 1 other attempt failed",
    ]


def test_what_a_plan_notes_is_told(scene: Scene) -> None:
    note = Fault("grasp", ("box_1",), "the fingers push box_1 by 1.4 mm as they close on it", 0.0014)
    lines = told(scene, [move("box_1")], success=True, notes=(note,))
    assert lines[-2:] == ["  note: the fingers push box_1 by 1.4 mm as they close on it", "  planned in 0.8 s"]


def test_a_failure_says_what_stands_in_the_way_of_what(scene: Scene) -> None:
    why, forearm = Blocked("approach", "camera", "box_1"), Blocked("approach", "forearm", "box_3")
    attempts = [move("box_1", why=forearm), move("box_2", why=Blocked("ik")), move("box_1", why=forearm)]
    lines = told(scene, attempts, reason=why, target_blocked=(why,))
    assert lines[1:] == [
        f"  {scene.target} is blocked: camera would touch box_1 (approach)",
        "  not solved: nothing more was found to move",
        "  box_1 can't be moved: forearm would touch box_3 (approach), in 2 attempts",
        "  box_2 can't be moved: ik",
        "  planned in 0.8 s; 3 attempts failed",
    ]


def test_a_failure_says_what_is_not_got_to(scene: Scene) -> None:
    """What the policy knows of the scene, not what the last search for a path said."""
    why, detail = Blocked("transit", "camera", "box_1", detail="no path in 3000 iterations"), "no way was found for the arm to get to box_1"
    assert told(scene, reason=replace(why, detail=detail), target_blocked=(why,))[2] == f"  not solved: {detail}"
    assert told(scene, reason=why, target_blocked=(why,))[2] == "  not solved: nothing more was found to move"


def test_a_proof_says_what_would_help(scene: Scene) -> None:
    proof = Unsolvable(("box_1", "box_2"), ("another grasp of t", "box_1 taken away by hand"))
    why = Blocked("approach", "camera", "box_1")
    lines = told(scene, reason=Blocked("unsolvable", "camera", "box_1"), unsolvable=proof, target_blocked=(why,))
    assert lines[1:4] == [
        f"  {scene.target} is blocked: camera would touch box_1 (approach)",
        "  no moves help: none of box_1, box_2 can be picked while the others of them stand",
        "  what would: another grasp of t; box_1 taken away by hand",
    ]


def test_a_proof_needs_nothing_that_is_stuck(scene: Scene) -> None:
    """What stands still may block x_g by itself, and a single object has no others beside it."""
    reason = Blocked("unsolvable", "camera", "unknown_3")
    alone, walls = (told(scene, reason=reason, unsolvable=Unsolvable(stuck, ()))[1] for stuck in (("box_1",), ()))
    assert alone == "  no moves help: box_1 can't be picked, even with nothing but the target beside it"
    assert walls.startswith("  no moves help: with every object gone the target's grasp is still out of reach, or blocked")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("terminal", "quiet", "tells"), [(True, False, True), (True, True, False), (False, False, False)])
def test_the_command_tells_on_a_terminal_alone(
    terminal: bool, quiet: bool, tells: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    err = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr("retrieve_cli.plan.progress", lambda *args, **more: nullcontext(lambda: None))  # no bar
    options = ["--quiet"] if quiet else []
    assert main(["plan", str(TRIAL), "--policy", "local", *options, "-o", str(tmp_path / "plan.jsonl")]) == 0
    assert ("is wanted" in err.getvalue()) == ("comes out; the arm moves for" in err.getvalue()) == tells


@pytest.mark.parametrize("command", ["plan", "verify", "sense"])
def test_a_bar_says_how_many_lines_the_file_has(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pipe's can't be counted."""
    twice, plans = tmp_path / "two.jsonl", tmp_path / "plans.jsonl"
    twice.write_bytes(2 * TRIAL.read_bytes() + b"\n")
    shutil.copy(TRIAL.with_name("plum.obj"), tmp_path)
    monkeypatch.setattr(sys, "stderr", err := Terminal())
    words = {
        "plan": [str(twice), "--policy", "local", "-o", str(plans)],
        "sense": [str(twice), "--max-views", "1", "-o", str(tmp_path / "observed.jsonl")],
        "verify": [str(TRIAL), str(plans)],
    }[command]
    if command == "verify":
        assert main(["plan", str(twice), "--policy", "local", "--quiet", "-o", str(plans)]) == 0
        err.truncate(0)
    assert main([command, *words]) == 0
    assert "0/2" in err.getvalue()
    assert "/?" not in err.getvalue()
