"""The examples run as they stand, and do what they say."""

from __future__ import annotations

import csv
import json
import os
import runpy
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import jsonschema
import numpy as np
import pytest
from documents import SCHEMAS

from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene, object_box
from planning.io.files import read_plans, read_scenes
from planning.io.results import scene_writer
from planning.motion.checking.verify import verify
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.plan import Blocked
from planning.policies import make_policy
from planning.retrieval import retrieve
from planning.rules import Rule
from planning.scenes.generation import generate, load_spec
from planning.sensing.world import SimulatedWorld

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "examples"
TRIALS = ("02_plum_behind_cylinders", "03_banana_at_the_left_wall")


@pytest.fixture
def program(tmp_path: Path) -> dict[str, str]:
    """An environment in which `retrieve` is the program of this checkout, and its warnings are errors."""
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "retrieve").write_text(f'#!/bin/sh\nexec {sys.executable} -W error -m retrieve_cli "$@"\n')
    (folder / "retrieve").chmod(0o755)
    return {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}


def run(environment: dict[str, str], cwd: Path, *args: str | Path) -> str:
    done = subprocess.run(args, cwd=cwd, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_each_number_is_there_once() -> None:
    """01 to 10, and each has a test below."""
    numbers = sorted({p.name[:2] for p in EXAMPLES.iterdir() if p.name[0].isdigit()})
    assert numbers == [f"{i:02}" for i in range(1, len(numbers) + 1)] == [f"{i:02}" for i in range(1, 11)]


def test_01_first_plan(program: dict[str, str], tmp_path: Path) -> None:
    out = run(program, tmp_path, EXAMPLES / "01_first_plan.sh")
    assert "local deep" in out
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["plans.jsonl", "report.html", "scenes.jsonl"]
    assert len(list(read_plans(tmp_path / "out" / "plans.jsonl"))) == 5


@pytest.fixture(params=TRIALS)
def trial(request: pytest.FixtureRequest) -> Scene:
    """A scene of the paper's real trials."""
    file = EXAMPLES / f"{request.param}.jsonl"
    ((_, scene),) = read_scenes(file)
    jsonschema.validate(json.loads(file.read_text()), json.loads((SCHEMAS / "scene.schema.json").read_text()))
    return scene


def test_02_and_03_are_the_papers_real_trials(trial: Scene, ur5e: Robot) -> None:
    """The lab's cabinet and arm; the target stands behind cylinders, is blocked at first, and free when they are gone."""
    assert trial.robot.name == "ur5e"
    np.testing.assert_allclose(trial.cabinet.size_m, [0.56, 0.86, 0.50])
    np.testing.assert_allclose(trial.cabinet.T_world_cabinet[:3, 3], [0.30, 0.0, 0.10])
    target = object_box(trial.body(trial.target))
    others = [object_box(b) for b in trial.objects if b.name != trial.target]
    assert len(others) >= 2
    assert sum(b[0] < target[0] for b in others) >= 2
    if trial.target == "banana":
        assert target[5] < 0.05 < 0.15 < max(target[3:5])  # low and long
        assert target[1] + target[4] / 2 > trial.cabinet.size_m[1] / 2 - 0.02  # at the left wall
    motions = Motions(ur5e, trial)
    for seed in range(3):
        assert isinstance(motions.retrieve_target(motions.start(), np.random.default_rng(seed)), Blocked)
    alone = Motions(ur5e, Scene(**{**vars(trial), "objects": (trial.body(trial.target),)}))
    assert not isinstance(alone.retrieve_target(alone.start(), np.random.default_rng(0)), Blocked)


@pytest.mark.parametrize("seed", range(3))
def test_02_and_03_are_solved_by_local(seed: int, trial: Scene, ur5e: Robot) -> None:
    motions = Motions(ur5e, trial)
    plan = retrieve(trial, make_policy("local", motions), motions, name="local", rule=Rule.DEEP, rng=np.random.default_rng(seed))
    assert plan.success, str(plan.reason)
    assert plan.verified
    assert any(move.done for move in plan.moves)
    assert verify(ur5e, trial, plan.motions) is None


@pytest.mark.parametrize("name", TRIALS)
def test_02_and_03_from_the_command_line(name: str, program: dict[str, str], tmp_path: Path) -> None:
    run(program, tmp_path, "retrieve", "plan", EXAMPLES / f"{name}.jsonl", "--policy", "local", "--strict", "-o", "plan.jsonl")
    run(program, tmp_path, "retrieve", "report", "plan.jsonl", "-o", "report.csv")
    with (tmp_path / "report.csv").open(newline="", encoding="utf-8") as file:
        assert "local" in str(next(csv.DictReader(file)))


def test_04_own_arm(program: dict[str, str], tmp_path: Path) -> None:
    """A robot that nobody knew: scenes, plans and a picture; the scenes say which robot they are for."""
    run(program, tmp_path, EXAMPLES / "04_own_arm.sh", "here")
    here = tmp_path / "here"
    assert (here / "own_arm.png").read_bytes().startswith(b"\x89PNG")
    scenes = {scene.id: scene for _, scene in read_scenes(here / "own_scenes.jsonl")}
    plans = [plan for _, plan in read_plans(here / "own_plans.jsonl")]
    assert len(scenes) == len(plans) == 3
    for plan in plans:
        scene = scenes[plan.scene]
        assert Path(scene.robot.urdf or "").samefile(EXAMPLES / "04_own_arm" / "arm.urdf")
        assert (scene.robot.hand_frame, scene.robot.gripper_joint) == ("tcp", "grip")
        assert plan.verified
    assert any(plan.success and plan.moves for plan in plans)


def test_04_the_arm_is_what_its_comments_say() -> None:
    arm = load(str(EXAMPLES / "04_own_arm" / "arm.urdf"), "tcp")
    assert arm.joint_names == ("pan", "lift", "elbow", "roll", "bend", "twist", "grip")
    assert arm.pads == {"left_finger", "right_finger"}
    assert arm.opening.max_m == pytest.approx(0.09, abs=1e-6)
    hand = arm.link_poses(arm.home)["hand"]
    np.testing.assert_allclose(hand[:3, 2], [1, 0, 0], atol=1e-6)  # it waits looking into the cabinet
    np.testing.assert_allclose(hand[:3, 0], [0, 0, 1], atol=1e-6)


def test_05_library_and_06_execute(program: dict[str, str], tmp_path: Path) -> None:
    out = run(program, tmp_path, sys.executable, "-W", "error", EXAMPLES / "05_library.py")
    assert "plum-behind-cylinders: solved with" in out
    assert "faults: none\n" in out
    code = [line for line in (EXAMPLES / "05_library.py").read_text().split('"""')[-1].splitlines() if line.strip()]
    assert len(code) <= 12
    out = run(program, tmp_path, sys.executable, "-W", "error", EXAMPLES / "06_execute.py", "plan.jsonl")
    assert out.startswith("plum-behind-cylinders: done\n")


def test_07_own_policy(program: dict[str, str], tmp_path: Path) -> None:
    out = run(program, tmp_path, sys.executable, "-W", "error", EXAMPLES / "07_own_policy.py")
    assert "plum-behind-cylinders: solved\n" in out
    assert "verified: True\n" in out


class FakeRealSense(ModuleType):
    """As much of pyrealsense2 as the example asks for: images of 0.5 m in steps of a quarter millimetre, one pixel of one of them mad."""

    def __init__(self) -> None:
        super().__init__("pyrealsense2")
        self.stream = self.format = SimpleNamespace(depth="depth", z16="z16")
        images = [np.full((36, 64), 2000, np.uint16) for _ in range(5)]
        images[0][3, 4] = 9
        lens = SimpleNamespace(width=64, height=36, fx=45.0, fy=45.0, ppx=31.5, ppy=17.5)
        stream = SimpleNamespace(as_video_stream_profile=lambda: SimpleNamespace(get_intrinsics=lambda: lens))
        sensor = SimpleNamespace(get_depth_scale=lambda: 0.00025)
        device = SimpleNamespace(first_depth_sensor=lambda: sensor)
        profile = SimpleNamespace(get_device=lambda: device, get_stream=lambda kind: stream)

        def frames() -> SimpleNamespace:
            return SimpleNamespace(get_depth_frame=lambda: SimpleNamespace(get_data=lambda: images.pop(0)))

        self.config = lambda: SimpleNamespace(enable_stream=lambda *asked: None)
        self.pipeline = lambda: SimpleNamespace(start=lambda config: profile, wait_for_frames=frames)


def test_08_a_live_camera_and_arm(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without either: a module that stands for the camera's, and the simulated arm of 06."""
    scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 71, 0)
    monkeypatch.setitem(sys.modules, "pyrealsense2", FakeRealSense())
    example = runpy.run_path(str(EXAMPLES / "08_live_camera.py"))
    arms, columns = example["ARMS"], list(ur5e.arm_joints)
    cell = example["LiveCell"](ur5e, scene, example["RealSense"](), arms["SimulatedArm"](ur5e.home[columns]))
    frame = cell.take_frame()
    np.testing.assert_allclose(frame.depth, 0.5)
    assert (frame.intrinsics.width, frame.instance) == (64, None)
    motions = Motions(ur5e, scene)
    state = motions.start()
    found = next(done for b in scene.objects if isinstance(done := motions.relocate(state, b.name, 5, np.random.default_rng(0)), Done))
    way = motions.trajectories(state, found.motions)[:3]
    assert cell.execute(way) is None
    here = np.array([cell.where()[name] for name in ur5e.joint_names])
    np.testing.assert_allclose(here, way[-1].q[-1], atol=5e-3)
    assert cell.arm.gripped
    cell.arm = arms["SimulatedArm"](ur5e.home[columns], stuck_after_s=0.1)
    stopped = cell.execute(way)
    moving = next(i for i, motion in enumerate(way) if np.ptp(motion.q[:, columns], axis=0).max() > 0)  # fingers may go first
    assert (stopped.motion, "rad from its trajectory" in stopped.why) == (moving, True)
    assert isinstance(example["rehearsal"](scene, ur5e), SimulatedWorld)


def test_09_a_recorded_world(program: dict[str, str], tmp_path: Path, ur5e: Robot) -> None:
    """It is looked at through recorded frames alone, and says that nothing can be moved in it."""
    scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 71, 0)
    with scene_writer(tmp_path / "scenes.jsonl") as write:
        write(scene)
    run(program, tmp_path, "retrieve", "sense", "scenes.jsonl", "--views", "views", "--max-views", "8", "-o", "seen.jsonl")
    asked = ["retrieve", "plan", "scenes.jsonl", "--policy", "local", "--sense", "--world", f"{EXAMPLES / '09_recorded_world.py'}:world"]
    run({**program, "VIEWS": "views"}, tmp_path, *asked, "-o", "plans.jsonl")
    ((_, plan),) = read_plans(tmp_path / "plans.jsonl")
    assert any(m.stage == "look" for m in plan.motions)
    assert not plan.success
    assert "the recording shows nothing of" in str(plan.reason)


def test_10_a_suction_cup(program: dict[str, str], tmp_path: Path) -> None:
    """Its face is where its geometry ends, and the maker's arm is as it was."""
    run(program, tmp_path, sys.executable, "-W", "error", EXAMPLES / "10_suction_cup.py")
    made = load(str(tmp_path / "out" / "ur5e_cup.urdf"))
    assert made.grip is not None
    assert (made.grip.kind, made.grip.joints) == ("a suction cup", ("suction",))
    assert made.opening.cup_m == pytest.approx(0.03, abs=1e-3)
    poses = made.link_poses(made.home)
    np.testing.assert_allclose((np.linalg.inv(poses["tool0"]) @ poses["hand"])[:3, 2:], [[0, 0], [0, 0], [1, 0.12]], atol=1e-6)
