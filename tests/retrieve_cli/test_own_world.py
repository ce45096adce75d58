"""`plan --sense --world MODULE:FUNCTION`: what is wrong with a user's module is one line with its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kinematics.errors import InputError
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from planning.plan import Motion
from planning.scenes.generation import generate, load_spec
from retrieve_cli.worlds import as_it_is, own_world

GOOD = """
from planning.sensing.world import SimulatedWorld, Stopped
import numpy as np
def world(scene, robot):
    return SimulatedWorld(robot, scene, np.random.default_rng(0))
def broken(scene, robot):
    raise RuntimeError("no camera\\nis connected")
class Half:
    def take_frame(self): return None
    def where(self): return {}
def half(scene, robot):
    return Half()
class Odd(Half):
    def execute(self, motions): return Stopped(motions[0] if motions else 3, "x")
    def where(self): return [1.0]
def odd(scene, robot):
    return Odd()
class Millimetres(SimulatedWorld):
    def take_frame(self):
        from dataclasses import replace
        frame = super().take_frame()
        return replace(frame, depth=1000 * frame.depth)
def millimetres(scene, robot):
    return Millimetres(robot, scene, np.random.default_rng(0))
number = 3
"""


@pytest.fixture
def scene(ur5e: Robot) -> Scene:
    return generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 71, 0)


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "cell_of_mine.py").write_text(GOOD)
    (tmp_path / "cell_with_a_slip.py").write_text("def world(:")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return "cell_of_mine"


def test_a_world_by_module_and_by_file(ur5e: Robot, scene: Scene, module: str) -> None:
    for spec in (f"{module}:world", f"{module}.py:world"):
        world = own_world(spec, scene, ur5e)
        q = np.array(list(world.where().values()))
        np.testing.assert_array_equal(q, ur5e.home)
        assert world.take_frame().depth.any()
        assert world.execute([]) is None
    real = as_it_is(world, scene, ur5e)
    assert real.objects == ()
    assert real.robot.q_start == world.where()


def test_a_frame_that_is_none_is_told_with_the_method(ur5e: Robot, scene: Scene, module: str) -> None:
    with pytest.raises(InputError, match=r"--world cell_of_mine:millimetres: take_frame: .*are these millimetres\?"):
        own_world(f"{module}:millimetres", scene, ur5e).take_frame()


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("cell_of_mine", "MODULE:FUNCTION is expected"),
        ("nowhere_at_all:world", "ModuleNotFoundError: No module named 'nowhere_at_all'"),
        ("nowhere.py:world", "no such file"),
        ("cell_with_a_slip:world", "SyntaxError"),
        ("cell_of_mine:wrld", "has no function 'wrld' (did you mean 'world'?)"),
        ("cell_of_mine:number", "has no function 'number'"),
        ("cell_of_mine:broken", "--world cell_of_mine:broken: RuntimeError: no camera is connected"),
        ("cell_of_mine:half", "a Half has no execute; a world has take_frame, execute, where"),
    ],
)
def test_what_is_wrong_is_one_line(ur5e: Robot, scene: Scene, module: str, spec: str, words: str) -> None:
    with pytest.raises(InputError) as e:
        own_world(spec, scene, ur5e)
    assert words in str(e.value)
    assert "\n" not in str(e.value)


def test_answers_of_the_wrong_kind_are_told(ur5e: Robot, scene: Scene, module: str) -> None:
    odd = own_world("cell_of_mine:odd", scene, ur5e)
    with pytest.raises(InputError, match="odd: take_frame: returned a NoneType, and a Frame is expected"):
        odd.take_frame()
    with pytest.raises(InputError, match="odd: where: returned a list, and a Mapping is expected"):
        odd.where()
    with pytest.raises(InputError, match="odd: execute: it stopped in motion 3, of 0"):
        odd.execute([])
    with pytest.raises(InputError, match="it stopped in motion a Motion, of 1; Stopped takes the motion's number, from 0, and why"):
        odd.execute([Motion("transit", ur5e.joint_names, np.zeros((2, 7)), np.arange(2.0))])


def test_a_module_that_is_broken_is_bad_input_of_plan(ur5e: Robot, scene: Scene, module: str, capsys: pytest.CaptureFixture[str]) -> None:
    from planning.io.results import scene_writer
    from retrieve_cli.__main__ import main

    with scene_writer(Path("scenes.jsonl")) as write:
        write(scene)
    asked = ["plan", "scenes.jsonl", "--world", "cell_of_mine:broken", "-o", "plans.jsonl"]
    assert main([*asked, "--sense"]) == 2
    assert "--world" in (said := capsys.readouterr().err)
    assert "RuntimeError: no camera is connected" in said
    assert main(asked) == 2
    assert "--world goes with --sense" in capsys.readouterr().err
