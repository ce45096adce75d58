"""How the program speaks where a robot is needed: one line for bad input, exit codes, pipes, and the URDF it writes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import documents
import numpy as np
import pytest

from kinematics.robots.named import named_robots
from kinematics.robots.robot import Robot
from planning.policies import POLICIES
from planning.scenes.generation import SPECS
from retrieve_cli.__main__ import main

ROOT = Path(__file__).resolve().parents[2]
RETRIEVE = f"{sys.executable} -W error -m retrieve_cli"
OWN = ROOT / "examples" / "04_own_arm" / "arm.urdf"
PAPER = (ROOT / "planning" / "scenes" / "specs" / "paper.toml").read_text(encoding="utf-8")
NOTICES = (
    "reading the meshes of ",
    "getting ready: ",
    "robot ur5e: not known, and assumed: ",
    "no networks ship for ",
)  # words on stderr that a first run has beside what goes wrong

Spoken = tuple[int, str, list[str]]


def complaints(err: str) -> list[str]:
    """The lines of stderr but for the notices."""
    return [line for line in err.splitlines() if not line.startswith(NOTICES)]


@pytest.fixture
def retrieve(capsys: pytest.CaptureFixture[str]) -> Callable[..., Spoken]:
    """Run the program in this process: (exit code, stdout, lines of stderr)."""

    def call(*args: str | Path) -> Spoken:
        code = main([str(a) for a in args])
        out, err = capsys.readouterr()
        return code, out, complaints(err)

    return call


@pytest.fixture(scope="session")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two generated scenes."""
    file = tmp_path_factory.mktemp("scenes") / "scenes.jsonl"
    assert main(["gen", "-n", "2", "--seed", "1", "-o", str(file)]) == 0
    return file


def shell(line: str) -> subprocess.CompletedProcess[str]:
    """Run a line of bash in which `retrieve` is this program; what fails in a pipe fails the line."""
    script = f'set -o pipefail; retrieve() {{ {RETRIEVE} "$@"; }}; {line}'
    return subprocess.run(["bash", "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


# Bad input ------------------------------------------------------------------------------------------------------------------------------

NAMED = ", ".join(named_robots())
UNKNOWN_ROBOT = f"unknown robot 'ur7': the named ones are {NAMED}; or give a URDF file"
RULE = "retrieve plan: Invalid value for '--rule'"
KNOWN_POLICIES = f"the valid names are {', '.join(POLICIES)}"


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["gen", "--robot", "ur7"], f"gen: {UNKNOWN_ROBOT}"),
        (["gen", "--robot", "ur5"], f"gen: unknown robot 'ur5' (did you mean 'ur5e'?): the named ones are {NAMED}; or give a URDF file"),
        (["plan", "SCENES", "--rule", "depe"], f"{RULE}: 'depe' is not one of 'deep', 'region', 'strict' (did you mean 'deep'?) (see "),
        (["gen", "--robot", "missing.urdf"], "gen: URDF file missing.urdf does not exist"),
        (["gen", "--robot", OWN, "--hand-frame", "tip"], f"gen: {OWN} has no link 'tip' for the hand frame; it has base, shoulder, "),
        (["gen", "--robot", OWN, "--hand-frame", "tcp", "--gripper-joint", "pan"], f"gen: robot {OWN}: 'pan' is no joint that can open "),
        (["gen", "--spec", "papr"], f"gen: unknown spec 'papr' (did you mean 'paper'?): the specs are {', '.join(SPECS)}; or"),
        (["plan", "SCENES", "--robot", "ur7"], f"SCENES:1: {UNKNOWN_ROBOT}"),
        (["plan", "SCENES", "--policy", "lokal"], f"unknown policy 'lokal' (did you mean 'local'?); {KNOWN_POLICIES}"),
        (["plan", "SCENES", "--policy", "xyzzy"], f"unknown policy 'xyzzy'; {KNOWN_POLICIES}"),
        (["plan", "SCENES", "--iterations", "9", "--time-budget-s", "1"], "plan: --iterations and --time-budget-s exclude each other"),
        (["plan", "SCENES", "--html", "nowhere/p.html"], "nowhere/p.html: the folder "),
        (["plan", "missing.jsonl"], "missing.jsonl: no such file"),
        (["show", "SCENES", "--index", "7", "--png", "s.png"], "SCENES: there is no line for --index 7: it has 2 lines"),
        (["show", "SCENES", "--png", "nowhere/s.png"], "nowhere/s.png: the folder "),
        (["robots", "ur7"], f"unknown robot 'ur7'; the valid names are {NAMED}"),
        (["robots", "--urdf", "x.urdf"], "robots: say which robot's URDF to write, e.g. retrieve robots ur5e --urdf ur5e.urdf"),
        (["robots", "ur5e", "--urdf", "nowhere/x.urdf"], "nowhere/x.urdf: the folder "),
    ],
    ids=lambda value: " ".join(map(str, value)).replace(str(ROOT), "") if isinstance(value, list) else None,
)
def test_a_wrong_call_is_one_line_and_exit_2(
    args: Sequence[str | Path], says: str, scenes: Path, tmp_path: Path, retrieve: Callable[..., Spoken], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = retrieve(*(scenes if a == "SCENES" else a for a in args))
    assert (code, out, len(err)) == (2, "", 1)
    assert err[0].startswith(says.replace("SCENES", str(scenes)))
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["gen", "plan"])
def test_a_place_that_can_not_be_written(command: str, scenes: Path, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    out = tmp_path / "nowhere" / "out.jsonl"
    code, _, err = retrieve(command, *([scenes] if command == "plan" else []), "-o", out)
    assert (code, err) == (2, [f"{out}: the folder {out.parent} does not exist; make it first"])
    code, _, err = retrieve(command, *([scenes] if command == "plan" else []), "-o", tmp_path)
    assert (code, err) == (2, [f"{tmp_path}: is a folder, not a file"])


NO_GEOMETRY = """<robot name="bare"><link name="base"/><joint name="turn" type="revolute"><parent link="base"/><child link="tip"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint><link name="tip"/></robot>"""
NO_MESH = '<robot name="m"><link name="tip"><collision><geometry><mesh filename="nowhere.stl"/></geometry></collision></link></robot>'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (NO_GEOMETRY, "robot {} has links but no collision geometry: add <collision> elements to its URDF"),
        (NO_MESH, "{}: link 'tip' names the mesh nowhere.stl, which does not exist: "),
        ("<html/>", "{} is no URDF: its root element is <html>, not <robot>"),
        ("", "{} is no URDF: "),
    ],
    ids=["no collision geometry", "missing mesh", "HTML", "empty"],
)
def test_a_urdf_that_can_not_serve(text: str, says: str, scenes: Path, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    file = tmp_path / "own.urdf"
    file.write_text(text)
    for args, where in ((["gen"], "gen"), (["plan", scenes], f"{scenes}:1")):
        code, out, err = retrieve(*args, "--robot", file, "--hand-frame", "tip")
        assert (code, out, len(err)) == (2, "", 1)
        assert err[0].startswith(f"{where}: {says.format(file)}")


@pytest.mark.parametrize("command", [["plan"], ["show", "--png", "s.png"], ["show", "--html", "s.html"]], ids=" ".join)
def test_a_scene_with_an_unknown_robot(
    command: Sequence[str], tmp_path: Path, retrieve: Callable[..., Spoken], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = documents.scene()
    scene["robot"]["name"] = "ur7"
    Path("scenes.jsonl").write_text(documents.lines(scene))
    code, out, err = retrieve(command[0], "scenes.jsonl", *command[1:])
    assert (code, out, err) == (2, "", [f"scenes.jsonl:1: {UNKNOWN_ROBOT}"])


SHOWN = "(planning/scenes/specs/paper.toml and lab-s.toml show them all)"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("gap_m = 0.01", "", "objects.gap_m is missing " + SHOWN),
        (
            "gap_m = 0.01",
            "gap_mm = 10",
            "objects.gap_mm is no field of a spec " + SHOWN,
        ),
        ("gap_m = 0.01", "gap_m = -0.01", "objects.gap_m: -0.01 is below 0"),
        ("wall_m = 0.03", "wall_m = -0.03", "cabinet.wall_m: -0.03 is not positive"),
        ("count = [4, 10]", "count = [-3, 4]", "objects.count: [-3, 4] is no range of positive whole numbers"),
        ("[0.020, 0.037]", "[-0.020, 0.037]", "objects.half_width_m: [-0.02, 0.037] is no range of positive lengths"),
        (
            "[regions]\n",
            "[regions]\nm = 3\n",
            "regions.m is no field of a spec " + SHOWN,
        ),
        ("count = [4, 10]", "count = [10, 4]", "objects.count: [10, 4] is no range [least, most]"),
        ("box_share = 0.5", 'box_share = "half"', "objects.box_share: 'half' is no number"),
        ("[0.08, 0.25]", "[0.6, 0.7]", "objects.height_m: 0.6 m or more do not fit into a cabinet that is 0.5 m high"),
        ("[0.16, 0.46]", "[0.9, 1.0]", "target.depth_m: 0.9 m or more do not fit into a cabinet that is 0.56 m deep"),
        ("n = 10", "n = 0", "regions.n: 0 is no positive whole number"),
        ('["horizontal"]', '["sideways"]', "moves.approaches: ['sideways'] is no list of horizontal, diagonal, downward"),
        ("[0.56, 0.86, 0.50]", "[0.56, -0.86, 0.50]", "cabinet.size_m: [0.56, -0.86, 0.5] is not three positive lengths"),
        ("[cabinet]", "[cabinet", "is no TOML: Expected ']' at the end of a table declaration (at line 3, column 9)"),
    ],
)
def test_a_wrong_spec(old: str, new: str, says: str, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    assert old in PAPER
    file = tmp_path / "own.toml"
    file.write_text(PAPER.replace(old, new, 1), encoding="utf-8")
    assert retrieve("gen", "--spec", file) == (2, "", [f"gen: {file}: {says}"])


# Unsolved scenes ------------------------------------------------------------------------------------------------------------------------


def test_strict_is_1_when_a_scene_is_unsolved(scenes: Path, retrieve: Callable[..., Spoken]) -> None:
    """Without a move every generated scene stays unsolved; its plan has no motions and says what is in the way."""
    code, out, err = retrieve("plan", scenes, "--max-moves", "0", "--strict")
    assert (code, err) == (1, [])
    plans = [json.loads(line) for line in out.splitlines()]
    assert len(plans) == 2
    for plan in plans:
        assert (plan["success"], plan["moves"], plan["motions"], plan["hand_travel_m"]) == (False, [], [], 0.0)
        assert plan["reason"]["stage"]
        assert plan["reason"]["body"]
    assert retrieve("plan", scenes, "--max-moves", "0")[0] == 0


def test_strict_is_0_when_all_is_solved(retrieve: Callable[..., Spoken]) -> None:
    code, out, err = retrieve("plan", ROOT / "examples" / "02_plum_behind_cylinders.jsonl", "--policy", "local", "--strict")
    assert (code, err) == (0, [])
    assert json.loads(out)["verified"] is True


# Pipes ----------------------------------------------------------------------------------------------------------------------------------


def test_gen_plan_report_as_one_pipe() -> None:
    done = shell("retrieve gen -n 2 --seed 1 | retrieve plan --policy local | retrieve report --json")
    assert (done.returncode, complaints(done.stderr)) == (0, [])
    assert '"local"' in done.stdout


def test_head_ends_quietly() -> None:
    """`head` goes after the first scene; the second or third meets a closed pipe."""
    done = shell("retrieve gen -n 4 --seed 1 | head -1")
    assert (done.returncode, complaints(done.stderr)) == (0, [])
    assert json.loads(done.stdout)["id"] == "1-000000"
    done = shell("retrieve gen -n 3 --seed 1 | retrieve plan | head -c 100")
    assert (done.returncode, complaints(done.stderr), len(done.stdout)) == (0, [], 100)


def test_bad_input_in_the_middle_of_a_pipe() -> None:
    done = shell("retrieve gen -n 1 --seed 1 | sed s/ur5e/ur7/ | retrieve plan")
    assert (done.returncode, done.stdout, complaints(done.stderr)) == (2, "", [f"stdin:1: {UNKNOWN_ROBOT}"])


# The URDF that other programs read ------------------------------------------------------------------------------------------------------


def test_pinocchio_reads_the_urdf_that_robots_writes(ur5e: Robot, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    pin = pytest.importorskip("pinocchio")
    file = tmp_path / "ur5e.urdf"
    assert retrieve("robots", "ur5e", "--urdf", file) == (0, "", [])
    model = pin.buildModelFromUrdf(str(file), mimic=True)
    data = model.createData()
    q = ur5e.home
    index = [model.joints[model.getJointId(name)].idx_q for name in ur5e.joint_names]
    q_pin = pin.neutral(model)
    q_pin[index] = q
    pin.framesForwardKinematics(model, data, q_pin)
    ours = ur5e.link_poses(q)
    for link in ("hand", "camera"):
        assert model.existFrame(link)
        np.testing.assert_allclose(data.oMf[model.getFrameId(link)].homogeneous, ours[link], atol=1e-6)


def test_robots_tells_what_it_knows(retrieve: Callable[..., Spoken]) -> None:
    code, out, err = retrieve("robots", "ur5e", "--json")
    assert (code, err) == (0, [])
    robot = json.loads(out)
    assert (robot["name"], robot["installed"], robot["camera"], len(robot["joints"])) == ("ur5e", True, True, 7)
    assert robot["opening_m"] == pytest.approx(0.085, abs=0.002)
    assert {"hand", "camera"}.isdisjoint(robot["joints"])


def test_a_named_robots_frames_are_its_own(tmp_path: Path) -> None:
    """--hand-frame on a scene of a named robot would otherwise be ignored."""
    scenes = tmp_path / "scenes.jsonl"
    scenes.write_text(documents.lines(documents.scene()))
    assert main(["plan", str(scenes), "--hand-frame", "tip", "-o", str(tmp_path / "plans.jsonl")]) == 2
