"""What a controller gets is what was planned: every format is read back and compared with the plan's trajectory at 1 ms."""

from __future__ import annotations

import errno
import importlib.util
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from kinematics.errors import InputError
from kinematics.quintic_spline import evaluate, hermite
from kinematics.scene import Held
from kinematics.transforms import Array
from planning.io.outputs import alone_in
from planning.io.results import plan_writer
from planning.plan import Blocked, Gripper, GripperState, Motion, Plan
from retrieve_cli.__main__ import main
from retrieve_cli.export.command import export, run
from retrieve_cli.export.steps import ArmStep, GripperStep, steps

ROOT = Path(__file__).resolve().parents[3]
ARM = tuple(f"joint_{i}" for i in range(6))
OPEN, SHUT = GripperState(0.0, 0.085), GripperState(0.4, 0.05, 40.0)


def motion(stage: str, start: Array, end: Array, before: GripperState, after: GripperState, held: str | None = None) -> Motion:
    """From rest to rest through a third row, with the fingers moving evenly."""
    rng = np.random.default_rng(len(stage))
    still = bool((start == end).all())
    q = np.stack([start, (start + end) / 2 + (0.0 if still else rng.normal(0, 0.05, len(start))), end])
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    if not still:
        qd[1], qdd[1] = rng.normal(0, 0.3, len(start)), rng.normal(0, 0.5, len(start))
    grip = np.linspace(before.value, after.value, 3)[:, None]
    rows = [np.concatenate([table, extra], 1) for table, extra in ((q, grip), (qd, 0 * grip), (qdd, 0 * grip))]
    hold = Held(held, np.eye(4)) if held else None
    t_s = np.array([0.0, 0.37, 1.1])
    return Motion(stage, (*ARM, "finger"), rows[0], t_s, hold, (), rows[1], rows[2], Gripper("finger", before, after))


@pytest.fixture
def plan() -> Plan:
    a, b, c = (np.random.default_rng(i).uniform(-1, 1, 6) for i in range(3))
    motions = (
        motion("transit", a, b, OPEN, OPEN),
        motion("approach", b, c, OPEN, OPEN),
        motion("grasp", c, c, OPEN, SHUT),
        motion("lift", c, b, SHUT, SHUT, "can_1"),
        motion("transfer", b, a, SHUT, SHUT, "can_1"),
    )
    return Plan("scene/7", "local", "deep", True, None, (), motions, 0.0, 0.0, 1.0, 1.0, True)


def arm_at(plan: Plan, t: Array) -> Array:
    """The arm (N, 6) at times from the plan's start, the motions one after the other."""
    out, start = np.empty((len(t), 6)), 0.0
    for m in plan.motions:
        which = (t >= start - 1e-12) & (t <= start + m.t_s[-1] + 1e-12)
        out[which] = m.at(np.clip(t[which] - start, 0, m.t_s[-1]))[:, :6]
        start += float(m.t_s[-1])
    return out


def test_motions_become_trajectories_with_commands_between(plan: Plan) -> None:
    opened, first, grip, second = steps(plan)
    assert opened == GripperStep("finger", 0.0, 0.085, None, None, 0.0)  # nobody else may have told it so
    assert isinstance(first, ArmStep)
    assert isinstance(second, ArmStep)
    assert grip == GripperStep("finger", 0.4, 0.05, 40.0, "can_1", 1.1)
    assert first.stages == (("transit", 0.0), ("approach", 1.1))
    assert [stage for stage, _ in second.stages] == ["lift", "transfer"]
    t = np.arange(0, 2.2, 0.001)
    np.testing.assert_allclose(evaluate(first.spline, t), arm_at(plan, t), atol=1e-12)
    np.testing.assert_array_equal(first.q[0], plan.motions[0].q[0, :6])
    assert (np.diff(first.t_s) > 0).all()


def test_fingers_that_move_beside_the_arm_are_told_before_it_sets_out(plan: Plan, tmp_path: Path) -> None:
    wide = GripperState(0.1, 0.07)
    first = motion("transit", plan.motions[0].q[0, :6], plan.motions[0].q[-1, :6], OPEN, wide)
    second = motion("approach", plan.motions[1].q[0, :6], plan.motions[1].q[-1, :6], wide, wide)
    close = motion("grasp", plan.motions[2].q[0, :6], plan.motions[2].q[-1, :6], wide, SHUT)
    both = replace(plan, motions=(first, second, close, *plan.motions[3:]))
    grip, arm, *_ = steps(both)
    assert grip == GripperStep("finger", 0.1, 0.07, None, None, 0.0)
    assert isinstance(arm, ArmStep)
    export(both, "ros2", tmp_path)
    order = yaml.safe_load((tmp_path / "sequence.yaml").read_text())["steps"]
    assert [s["start_s"] for s in order] == pytest.approx([0.0, 0.0, 2.2, 3.3])
    export(both, "npz", tmp_path)
    with np.load(tmp_path / "trajectory.npz", allow_pickle=False) as data:
        np.testing.assert_allclose(data["q"], arm_at(both, data["t_s"]), atol=1e-9)
        assert float(data["gripper"][0]) == 0.1


def test_ros2_is_read_back_from_yaml_and_from_the_bag(plan: Plan, tmp_path: Path) -> None:
    export(plan, "ros2", tmp_path)
    order = yaml.safe_load((tmp_path / "sequence.yaml").read_text())["steps"]
    assert [s["file"] for s in order] == ["00_gripper.yaml", "01_arm.yaml", "02_gripper.yaml", "03_arm.yaml"]
    assert [s["start_s"] for s in order] == pytest.approx([0.0, 0.0, 2.2, 3.3])
    assert yaml.safe_load((tmp_path / "00_gripper.yaml").read_text()) == {"position": 0.0, "max_effort": 0.0}
    assert yaml.safe_load((tmp_path / "02_gripper.yaml").read_text()) == {"position": 0.4, "max_effort": 40.0}
    for number, begins in ((1, 0.0), (3, 3.3)):
        message = yaml.safe_load((tmp_path / f"{number:02d}_arm.yaml").read_text())
        assert message["joint_names"] == list(ARM)
        points = message["points"]
        t = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points])
        assert t[0] == 0
        assert (np.diff(t) > 0).all()
        q, qd, qdd = (np.array([p[what] for p in points]) for what in ("positions", "velocities", "accelerations"))
        instants = np.arange(0.0, t[-1], 0.001)
        np.testing.assert_allclose(evaluate(hermite(t, q, qd, qdd), instants), arm_at(plan, begins + instants), atol=1e-6)

    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64 position\nfloat64 max_effort\n", "control_msgs/msg/GripperCommand"))
    with Reader(tmp_path / "bag") as bag:
        seen = [(c.topic, at, store.deserialize_cdr(raw, c.msgtype)) for c, at, raw in bag.messages()]
    assert next((tmp_path / "bag").glob("*.mcap")).read_bytes().startswith(b"\x89MCAP")
    assert [at / 1e9 for _, at, _ in seen] == pytest.approx([0.0, 0.0, 2.2, 3.3])
    np.testing.assert_array_equal(seen[3][2].points[-1].positions, plan.motions[-1].q[-1, :6])
    assert [seen[n][2].position for n in (0, 2)] == [0.0, 0.4]


def test_no_step_of_a_plan_that_was_exported_before_is_left(plan: Plan, tmp_path: Path) -> None:
    export(plan, "ros2", tmp_path)
    (tmp_path / "my_arm.yaml").write_text("of one's own")
    export(replace(plan, motions=plan.motions[:2]), "ros2", tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"00_gripper.yaml", "01_arm.yaml", "sequence.yaml", "bag", "my_arm.yaml"}


def test_each_plan_has_a_folder_of_its_own(plan: Plan, tmp_path: Path) -> None:
    """Though one is called as another one's folder would be."""
    with plan_writer(tmp_path / "plans.jsonl") as write:
        for scene in ("a_2", "a", "a", "a", "a_1"):
            write(replace(plan, scene=scene))
    assert main(["export", str(tmp_path / "plans.jsonl"), "--to", "npz", "-o", str(tmp_path / "out")]) == 0
    scenes = {}
    for folder in (tmp_path / "out").iterdir():
        with np.load(folder / "trajectory.npz", allow_pickle=False) as data:
            scenes[folder.name] = str(data["scene"])
    assert scenes == {"a_2": "a_2", "a": "a", "a_1": "a", "a_3": "a", "a_1_1": "a_1"}


def test_two_runs_are_not_in_one_folder_at_once(plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with plan_writer(tmp_path / "plans.jsonl") as write:
        write(plan)
    out = tmp_path / "out"
    with alone_in(out):
        assert main(["export", str(tmp_path / "plans.jsonl"), "-o", str(out)]) == 2
        assert list(out.iterdir()) == []
    assert capsys.readouterr().err == f"{out}: another run is writing in it just now; name another folder\n"
    assert not out.exists(), "nothing was written in it"


def test_csv_and_npz_at_a_millisecond(plan: Plan, tmp_path: Path) -> None:
    export(plan, "csv", tmp_path)
    head, *lines = (tmp_path / "trajectory.csv").read_text().splitlines()
    names = head.split(",")
    assert names[:4] == ["t_s", "step", "stage", "joint_0_rad_or_m"]
    rows = [line.split(",") for line in lines]
    t, q = np.array([float(r[0]) for r in rows]), np.array([[float(x) for x in r[3:9]] for r in rows])
    np.testing.assert_allclose(q, arm_at(plan, t), atol=1e-6)
    assert np.diff(t).max() == pytest.approx(1.1)  # while the fingers close
    assert {r[2] for r in rows} == {"transit", "approach", "grasp", "lift", "transfer"}
    export(plan, "npz", tmp_path, rate_hz=250)
    with np.load(tmp_path / "trajectory.npz", allow_pickle=False) as data:
        np.testing.assert_allclose(data["q"], arm_at(plan, data["t_s"]), atol=1e-9)
        assert tuple(data["joint_names"]) == ARM
        assert float(data["gripper"][-1]) == 0.4
        assert float(data["gripper"][0]) == 0.0


def test_urscript_streams_every_two_milliseconds(plan: Plan, tmp_path: Path) -> None:
    export(plan, "urscript", tmp_path)
    text = (tmp_path / "plan.script").read_text()
    lines = [line.strip() for line in text.splitlines()]
    rows = np.array([json.loads(line[len("servoj(") : line.index("]") + 1]) for line in lines if line.startswith("servoj(")])
    t = np.arange(1, 1101) * 0.002
    np.testing.assert_allclose(rows[:1100], arm_at(plan, t), atol=1e-6)
    assert "retrieve_grip(0.050000, 40.0)  # takes can_1" in lines
    assert "retrieve_release(0.085000)" in lines[: lines.index("retrieve_grip(0.050000, 40.0)  # takes can_1")]
    weak = [
        replace(m, gripper=Gripper("finger", *(replace(s, force_N=None) for s in (m.gripper.before, m.gripper.after))))
        for m in plan.motions
        if m.gripper
    ]
    export(replace(plan, motions=tuple(weak)), "urscript", tmp_path)  # of a gripper whose force nobody knows
    assert "retrieve_grip(0.050000, 0.0)  # takes can_1" in (tmp_path / "plan.script").read_text()
    assert lines.count("end") == sum(line.startswith(("def ", "while ", "if ")) for line in lines)
    assert not text.count("\t")


def test_franka_wants_seven_joints(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"7 joints, and this plan has 6: --to ros2, csv and npz take any number$"):
        export(plan, "franka", tmp_path)
    seven = replace(plan, motions=tuple(_with_a_joint(m) for m in plan.motions))
    export(seven, "franka", tmp_path)
    rows = np.loadtxt(tmp_path / "trajectory.txt")
    assert rows.shape[1] == 14
    np.testing.assert_allclose(rows[:2200, 1:7], arm_at(plan, np.arange(2200) / 1000), atol=1e-6)
    opened, command = map(json.loads, (tmp_path / "gripper.jsonl").read_text().splitlines())
    assert opened == {"after_row": -1, "width_m": 0.085, "force_N": None, "holds": None}
    assert command == {"after_row": 2200, "width_m": 0.05, "force_N": 40.0, "holds": "can_1"}
    with pytest.raises(InputError, match=f"6 joints, and this plan has 7: --joints {','.join(ARM)} writes those that it moves$"):
        export(seven, "urscript", tmp_path)  # as of a robot whose other arm stands still
    assert len(export(seven, "urscript", tmp_path, joints=list(ARM))) == 1


def _with_a_joint(m: Motion) -> Motion:
    wider = [np.concatenate([np.zeros((len(x), 1)), x], 1) for x in (m.q, m.qd, m.qdd) if x is not None]
    return replace(m, joint_names=("rail", *m.joint_names), q=wider[0], qd=wider[1], qdd=wider[2])


def test_motions_that_do_not_follow_one_another_are_refused(plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever a plan says of itself: without its grasp the fingers would jump, and with a moved row the arm. No folder is left."""
    moved = plan.motions[1].q.copy()
    moved[-1, 2] += 0.02
    without, edited = (*plan.motions[:2], *plan.motions[3:]), (plan.motions[0], replace(plan.motions[1], q=moved), *plan.motions[2:])
    for motions, says in (
        (without, "scene/7: lift: starts 0.4 from where finger ended before"),
        (edited, "scene/7: grasp: starts 0.02 from where joint_2 ended before"),
    ):
        with plan_writer(tmp_path / "plans.jsonl") as write:
            write(replace(plan, motions=motions))
        assert main(["export", str(tmp_path / "plans.jsonl"), "-o", str(tmp_path / "out")]) == 2
        assert says in capsys.readouterr().err
        assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene of a can alone, scenes.jsonl, and its plan, plans.jsonl."""
    folder = tmp_path_factory.mktemp("planned")
    scenes, plans = str(folder / "scenes.jsonl"), str(folder / "plans.jsonl")
    assert main(["scene", "--object", "can:0.025x0.12@0.6,0", "-o", scenes]) == 0
    assert main(["plan", scenes, "--policy", "local", "-o", plans]) == 0
    return folder


def test_a_plan_that_calls_itself_verified_is_judged_by_its_scene(
    planned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As it is, it is exported; a post in its way, a scene of another name, or one that is missing is told, and nothing is written."""
    scenes, plans, out = planned / "scenes.jsonl", planned / "plans.jsonl", tmp_path / "out"
    honest, said = json.loads(plans.read_text()), json.loads(scenes.read_text())
    post = {"type": "box", "size_m": [0.05, 0.05, 0.6]}
    blocked = {**said, "obstacles": [{"name": "post", "shape": post, "T_world_object": said["objects"][0]["T_world_object"]}]}
    blocked["obstacles"][0]["T_world_object"] = {"p": [0.45, 0.0, 0.4], "q_wxyz": [1.0, 0.0, 0.0, 0.0]}
    (tmp_path / "blocked.jsonl").write_text(json.dumps({**blocked, "schema": "retrieve/scene@2"}) + "\n")
    (tmp_path / "other.jsonl").write_text(json.dumps({**said, "id": "other"}) + "\n")
    (tmp_path / "unsaid.jsonl").write_text(json.dumps({**honest, "verified": False}) + "\n")

    def exported(*args: object) -> tuple[int, str]:
        return main(["export", *map(str, args), "--to", "npz", "-o", str(out)]), capsys.readouterr().err

    for args, says in (
        (
            (plans, "--scenes", tmp_path / "blocked.jsonl"),
            r"plans.jsonl:1: the plan of scene is false: \w+: motion \d+: \w+ is .* inside post",
        ),
        ((plans, "--scenes", tmp_path / "other.jsonl"), "plans.jsonl:1: none of the 1 scenes in .*other.jsonl is scene"),
        ((plans, "--scenes", scenes, "--unverified"), "--scenes refuses what --unverified would export"),
        ((plans, "--limits", scenes), "--limits is what --scenes judges by"),
        ((plans, "--robot", "panda"), "--robot is what --scenes judges by"),
        ((plans, "--scenes", scenes, "--robot", "panda"), "is false: .* is no actuated joint of this robot"),
        (("-", "--scenes", "-"), "can't both come from stdin"),
        ((tmp_path / "unsaid.jsonl",), "is not verified"),
    ):
        code, err = exported(*args)
        assert code == 2
        assert re.search(says, err)
        assert not out.exists()
    assert exported(plans, "--scenes", scenes)[0] == 0
    assert exported(tmp_path / "unsaid.jsonl", "--scenes", scenes)[0] == 0  # the verdict counts, not what it says
    assert (out / "scene" / "trajectory.npz").is_file()


@pytest.mark.parametrize("form", ["ros2", "npz"])
def test_a_full_disk_names_the_folder(form: str, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that a writer of others' makes, too: an error that names no file is not stdout's."""

    def full(*_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with plan_writer(tmp_path / "plans.jsonl") as write:
        write(plan)
    monkeypatch.setattr(Path, "write_text" if form == "ros2" else "write_bytes", full)
    with pytest.raises(InputError, match=rf"{tmp_path}/out/scene_7.*: can't be written: no space left on device"):
        run(plans=tmp_path / "plans.jsonl", to=form, out=tmp_path / "out")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"motions": ()}, "has no motions"),
        ({"success": False, "reason": Blocked("approach", "palm", "can_1")}, "failed (approach: palm touches can_1)"),
        ({"verified": False}, "is not verified; --unverified"),
    ],
    ids=["empty", "failed", "not verified"],
)
def test_what_is_refused(change: dict[str, object], says: str, plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "plans.jsonl"
    with plan_writer(file) as write:
        write(replace(plan, **change))  # type: ignore[arg-type]
    assert main(["export", str(file), "--to", "csv", "-o", str(tmp_path / "out")]) == 2
    assert says in capsys.readouterr().err


def test_the_command_takes_the_controllers_order_of_joints(plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "plans.jsonl"
    with plan_writer(file) as write:
        write(replace(plan, verified=False))
    order = ",".join(reversed(ARM))
    assert main(["export", str(file), "--to", "npz", "--joints", order, "--unverified", "-o", str(tmp_path / "out")]) == 0
    with np.load(tmp_path / "out" / "scene_7" / "trajectory.npz", allow_pickle=False) as data:
        np.testing.assert_array_equal(data["q"][0], plan.motions[0].q[0, 5::-1])
    for wrong, says in ((order + ",elbow", "'elbow' is no joint"), ("joint_0", "'joint_1' is missing")):
        assert main(["export", str(file), "--joints", wrong, "--unverified", "-o", str(tmp_path / "out")]) == 2
        assert says in capsys.readouterr().err


def test_waypoints_are_no_trajectory(plan: Plan) -> None:
    old = replace(plan, motions=tuple(replace(m, qd=None, qdd=None) for m in plan.motions))
    with pytest.raises(InputError, match="has waypoints and no trajectory"):
        steps(old)


# The runner of examples/06_execute.py -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def runner() -> object:
    spec = importlib.util.spec_from_file_location("runner", ROOT / "examples" / "06_execute.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["runner"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_a_plan_is_carried_out(plan: Plan, runner: object) -> None:
    arm = runner.SimulatedArm(plan.motions[0].q[0, :6])  # type: ignore[attr-defined]
    end = runner.execute(plan, arm)  # type: ignore[attr-defined]
    assert (end.done, end.motion) == (True, 4)
    assert arm.gripped == [(0.05, 40.0)]
    np.testing.assert_allclose(arm.q, plan.motions[-1].q[-1, :6], atol=0.002)


@pytest.mark.parametrize(
    ("options", "where", "says"),
    [
        ({"stuck_after_s": 1.5}, 1, "from its trajectory"),
        ({"most_rad_s": 0.05}, 0, "from its trajectory"),
        ({"noise_rad": 0.05}, 0, "from where transit begins"),
    ],
    ids=["it hits something", "too slow", "its reading is noise"],
)
def test_it_stops_and_says_where(options: dict[str, float], where: int, says: str, plan: Plan, runner: object) -> None:
    arm = runner.SimulatedArm(plan.motions[0].q[0, :6], **options)  # type: ignore[attr-defined]
    end = runner.execute(plan, arm)  # type: ignore[attr-defined]
    assert (end.done, end.motion) == (False, where)
    assert says in end.why
    assert set(end.q) == set(ARM)
    elsewhere = runner.SimulatedArm(plan.motions[0].q[0, :6] + 0.2)  # type: ignore[attr-defined]
    assert runner.execute(plan, elsewhere).motion == 0  # type: ignore[attr-defined]
