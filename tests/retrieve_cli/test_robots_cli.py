"""`retrieve robots FILE` says what was understood; `gen --fit` puts a cabinet where the arm reaches."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import chain, repeat
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from kinematics.robots.load import forget, from_ref, load, to_ref
from kinematics.scene import Cabinet, RobotRef, Scene
from kinematics.transforms import transform
from perception.camera import realsense_d435i
from planning.motion.cell.arm import arm_at
from planning.motion.pick_place import Motions
from planning.scenes.fitting.fit import fit
from planning.scenes.fitting.trials import Tried
from planning.scenes.generation import NoScene, load_spec
from planning.sensing.reachable_views import views_from
from retrieve_cli.__main__ import main

OWN = Path(__file__).resolve().parents[2] / "examples" / "04_own_arm" / "arm.urdf"


def test_what_was_understood_of_a_urdf_is_told_drawn_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    png, urdf = tmp_path / "arm.png", tmp_path / "joined.urdf"
    assert main(["robots", str(OWN), "--json", "--png", str(png)]) == 0
    row = json.loads(capsys.readouterr().out)
    assert row["gripper"] == {"kind": "two fingers", "joints": ["grip"], "pads": ["left_finger", "right_finger"], "force_N": None}
    assert (row["closes_to_m"], row["opening_m"], row["hand"]["measured"]) == (0.0, 0.09, True)
    assert row["limits"]["grip"] == {"lower": 0.0, "upper": 0.045, "velocity": 0.1}
    assert ["left_finger", "palm"] in row["ignored_pairs"]
    assert png.read_bytes().startswith(b"\x89PNG")
    assert main(["robots", str(OWN)]) == 0
    told = capsys.readouterr().out
    assert all(words in told for words in ("opening: 0 to 90 mm", "hand frame (measured): p [", "gripper: two fingers, by grip"))
    assert main(["robots", str(OWN), "--hand-frame", "tcp"]) == 0
    assert "hand frame (given): p [0, 0, 0.12], q_wxyz [0, 0, 0, 1] in palm" in capsys.readouterr().out, "not -1, as its rpy gives it"
    assert main(["robots", str(OWN), "--urdf", str(urdf)]) == 0
    assert '<link name="hand"' in urdf.read_text()


@pytest.mark.parametrize(
    ("link", "on", "told", "own"),
    [
        ("camera", "palm", "camera: a link of its own\n", True),
        ("camera", "base", "camera: a link of its own, which goes with base and not with the hand: --sense needs one that does\n", True),
        (
            "cam_optical_frame",
            "palm",
            "looks along the hand (rename the link 'cam_optical_frame' to camera, and it looks from there)\n",
            False,
        ),
    ],
)
def test_where_a_camera_is_told(link: str, on: str, told: str, own: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A frame without geometry was told as none, and one beside the robot as any other."""
    frame = f'<joint name="c" type="fixed"><parent link="{on}"/><child link="{link}"/><origin xyz="0.1 0 0"/></joint><link name="{link}"/>'
    (tmp_path / "arm.urdf").write_text(OWN.read_text().replace("</robot>", f"{frame}</robot>"))
    assert main(["robots", str(tmp_path / "arm.urdf")]) == 0
    assert told in capsys.readouterr().out
    assert main(["robots", str(tmp_path / "arm.urdf"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["camera"] == own


def test_views_are_chosen_for_a_camera_in_the_hand_alone(tmp_path: Path) -> None:
    frame = '<joint name="c" type="fixed"><parent link="base"/><child link="camera"/></joint><link name="camera"/>'
    (tmp_path / "arm.urdf").write_text(OWN.read_text().replace("</robot>", f"{frame}</robot>"))
    robot = load(str(tmp_path / "arm.urdf"))
    cabinet = Cabinet(np.array([0.5, 0.8, 0.5]), transform(p=[0.4, 0.0, 0.1]), 0.03)
    scene = Scene("s", RobotRef(np.eye(4), urdf=robot.name), cabinet, (), None, None)
    with pytest.raises(ValueError, match=r"its link 'camera' goes with 'base'; .* fixed to '.*'.* `retrieve sense --from-views DIR`"):
        views_from(robot, scene, np.eye(4)[None], realsense_d435i())


def test_an_arm_and_a_gripper_of_two_files_become_one_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The toy arm, cut at its palm, and put together again: the same hand, on the link that ends the arm."""
    text, out = OWN.read_text(), tmp_path / "both.urdf"
    root = etree.fromstring(text.encode())
    hand = etree.Element("robot", name="hand")
    joints = {joint.find("child").get("link"): joint for joint in root.iter("joint")}
    palm = joints.pop("palm")
    of_hand = {
        "palm",
        *(child for child, joint in joints.items() if joint.find("parent").get("link") in ("palm", "left_finger", "right_finger")),
    }
    for link in [link for link in root.iter("link") if link.get("name") in of_hand]:
        hand.append(link)
        if link.get("name") in joints:
            hand.append(joints[link.get("name")])
    root.remove(palm)
    (tmp_path / "arm.urdf").write_bytes(etree.tostring(root))
    (tmp_path / "hand.urdf").write_bytes(etree.tostring(hand))
    end = palm.find("parent").get("link")
    assert main(["robots", str(tmp_path / "arm.urdf"), "--tool", str(tmp_path / "hand.urdf"), "--urdf", str(out), "--json"]) == 0
    spoken = capsys.readouterr()
    assert f"hand.urdf hangs on the link {end!r}, its z along that link's z; " in spoken.err
    row = json.loads(spoken.out)
    assert (row["gripper"]["joints"], row["opening_m"], row["gripper"]["pads"]) == (["grip"], 0.09, ["left_finger", "right_finger"])
    for words, says in (
        (("--tool", "h.urdf"), "say where the arm with its tool goes"),
        (("--at", end), "--at says where a tool is; say which"),
        (("--tool", str(tmp_path / "hand.urdf"), "--at", "nose", "--urdf", str(out)), "has no link 'nose' to hang a tool on; it has "),
    ):
        assert main(["robots", str(tmp_path / "arm.urdf"), *words]) == 2
        assert says in capsys.readouterr().err


def hang(folder: Path, arm: str, tool: str, *more: str) -> int:
    """An arm with a tool, both from texts; the robot is both.urdf."""
    (folder / "arm.urdf").write_text(arm)
    (folder / "hand.xacro").write_text(tool)
    return main(["robots", f"{folder}/arm.urdf", "--tool", f"{folder}/hand.xacro", "--urdf", f"{folder}/both.urdf", "--json", *more])


def cut() -> tuple[str, str, str]:
    """The toy arm without its hand, its hand, and the link between."""
    root, hand = etree.fromstring(OWN.read_bytes()), etree.Element("robot", name="hand")
    of_hand = ("palm", "left_finger", "right_finger", "tcp")
    for element in list(root):
        child = element.find("child")
        if element.get("name") in of_hand or (child is not None and child.get("link") in of_hand[1:]):
            hand.append(element)
    (palm,) = [joint for joint in root.iter("joint") if joint.find("child").get("link") == "palm"]
    palm.find("child").set("link", "end")
    etree.SubElement(root, "link", name="end")
    return etree.tostring(root).decode(), etree.tostring(hand).decode(), "end"


def hand_in(folder: Path, link: str) -> np.ndarray:
    forget()
    robot = load(str(folder / "both.urdf"))
    poses = robot.link_poses(robot.home)
    return np.asarray(np.linalg.inv(poses[link]) @ poses["hand"])


def test_a_gripper_that_its_file_shows_in_a_world_hangs_on_the_arm_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """DH's AG-95 stands 10 cm above one, and hung in the air."""
    arm, hand, end = cut()
    assert hang(tmp_path, arm, hand) == 0
    plain = hand_in(tmp_path, end)
    shown = '<link name="world"/><joint name="shown" type="fixed"><parent link="world"/><child link="palm"/><origin xyz="0 0 0.1"/></joint>'
    assert hang(tmp_path, arm, hand.replace("</robot>", f"{shown}</robot>")) == 0
    np.testing.assert_allclose(hand_in(tmp_path, end), plain, atol=1e-12)


def test_a_gripper_looks_along_the_flanges_x_where_that_is_the_last_joints_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """ROS has x lead out of a link called flange, and z out of tool0; igus' tool0 is turned as its flange is."""
    arm, hand, end = cut()
    assert hang(tmp_path, arm, hand) == 0
    plain = hand_in(tmp_path, end)
    turned = '<origin rpy="0 -1.5707963267948966 0"/>'
    flange = f'<link name="tool0"/><joint name="out" type="fixed"><parent link="{end}"/><child link="tool0"/>{turned}</joint>'
    capsys.readouterr()
    assert hang(tmp_path, arm.replace("</robot>", f"{flange}</robot>"), hand) == 0
    assert "hangs on the link 'tool0', its z along that link's x" in capsys.readouterr().err
    hung = hand_in(tmp_path, end)
    both = flange.replace("tool0", "ee_x") + flange.replace("tool0", "ee").replace('"out"', '"e"').replace(turned, "")
    (tmp_path / "two.urdf").write_text(arm.replace("</robot>", f"{both}</robot>"))
    assert main(["robots", f"{tmp_path}/two.urdf", "--tool", f"{tmp_path}/hand.xacro", "--urdf", f"{tmp_path}/third.urdf"]) == 0
    assert "hangs on the link 'ee', its z along that link's z" in capsys.readouterr().err, "of two, the one that leads along the axis"
    np.testing.assert_allclose(hung[:3, 2:], plain[:3, 2:], atol=1e-9)
    assert hang(tmp_path, arm.replace("</robot>", f"{flange}</robot>"), hand, "--at", "tool0") == 0
    assert abs(hand_in(tmp_path, end)[2, 2]) < 1e-6, "where it is said, it is turned as the link is"


@pytest.mark.parametrize(
    ("rpy", "axis"), [("0 1.5707963267948966 0", "x"), ("1.5707963267948966 0 0", "-y"), ("3.141592653589793 0 0", "-z")]
)
def test_a_gripper_takes_things_away_from_the_flange_whichever_of_its_axes_that_is(
    rpy: str, axis: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Robotiq's C2 looks along the x of its first link, and hung sideways in the wrist."""
    arm, hand, end = cut()
    assert hang(tmp_path, arm, hand) == 0
    plain = hand_in(tmp_path, end)
    turned = f'<link name="foot"/><joint name="f" type="fixed"><parent link="foot"/><child link="palm"/><origin rpy="{rpy}"/></joint>'
    capsys.readouterr()
    assert hang(tmp_path, arm, hand.replace("</robot>", f"{turned}</robot>")) == 0
    assert f"hangs on the link {end!r}, its {axis} along that link's z" in capsys.readouterr().err
    np.testing.assert_allclose(hand_in(tmp_path, end)[:3, 2:], plain[:3, 2:], atol=1e-9)
    assert hang(tmp_path, arm, hand.replace("</robot>", f"{turned}</robot>"), "--at", end) == 0
    assert hand_in(tmp_path, end)[2, 2] < 0.1, "where it is said, it is turned as the link is"


def test_a_grippers_xacro_takes_arguments_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, hand, _ = cut()
    hand = hand.replace("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ', 1).replace('type="prismatic"', 'type="$(arg kind)"')
    assert hang(tmp_path, arm, hand) == 2
    assert "Undefined substitution argument kind; where it needs arguments: retrieve robots" in capsys.readouterr().err
    assert hang(tmp_path, arm, hand, "--xacro-arg", "kind:=prismatic") == 0
    assert json.loads(capsys.readouterr().out)["gripper"]["joints"] == ["grip"]
    assert hang(tmp_path, arm, hand, "--xacro-arg", "kind:=prismatic", "--xacro-arg", "knd:=x") == 2
    assert "arm.urdf: arguments are for xacro, and this is none" in capsys.readouterr().err


def test_a_robot_of_a_xacro_with_arguments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What it makes is a robot of its own, for the other commands; without them it says which there are."""
    file, out = tmp_path / "arm.urdf.xacro", tmp_path / "arm.urdf"
    text = OWN.read_text().replace("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ', 1)
    assert text.count('type="prismatic"') == 2, "its fingers"
    text = text.replace('type="prismatic"', 'type="$(arg kind)"')
    file.write_text(text.replace("<link ", '<xacro:arg name="kind" default="fixed"/><link ', 1))
    assert main(["robots", str(file)]) == 2
    assert "; xacro arguments: kind:=fixed (others: --xacro-arg)" in capsys.readouterr().err
    assert main(["robots", str(file), "--xacro-arg", "kind:=prismatic", "--urdf", str(out), "--json"]) == 0
    spoken = capsys.readouterr()
    assert f"the robot is {out}" in spoken.err
    row = json.loads(spoken.out)
    assert (row["gripper"]["joints"], row["opening_m"]) == (["grip"], 0.09)
    for words, says in (
        (("--xacro-arg", "kind:=prismatic"), f"where the robot goes: retrieve robots {file} --xacro-arg kind:=prismatic --urdf OUT.urdf"),
        (
            ("--xacro-arg", "kind:=a", "--xacro-arg", "b:=c d"),
            f"retrieve robots {file} --xacro-arg kind:=a --xacro-arg 'b:=c d' --urdf OUT.urdf",
        ),
        (("--xacro-arg", "kind=prismatic", "--urdf", str(out)), "--xacro-arg kind=prismatic: NAME:=VALUE is expected"),
        (("--xacro-arg", "kin:=prismatic", "--urdf", str(out)), "no xacro argument 'kin' (did you mean 'kind'?)"),
    ):
        assert main(["robots", str(file), *words]) == 2
        assert says in capsys.readouterr().err


@pytest.mark.parametrize("before", [None, b"<robot/>"])
def test_an_arm_whose_tool_is_no_gripper_leaves_no_urdf_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], before: bytes | None
) -> None:
    tool, out = tmp_path / "ball.urdf", tmp_path / "both.urdf"
    tool.write_text('<robot name="t"><link name="b"><collision><geometry><sphere radius="0.02"/></geometry></collision></link></robot>')
    bare = etree.fromstring(OWN.read_bytes())
    for joint in [joint for joint in bare.iter("joint") if joint.find("parent").get("link") == "palm"]:
        joint.set("type", "fixed")
    (tmp_path / "arm.urdf").write_bytes(etree.tostring(bare))
    if before is not None:
        out.write_bytes(before)
    words = ["robots", str(tmp_path / "arm.urdf"), "--tool", str(tool), "--at", "palm", "--urdf", str(out)]
    assert main(words) == 2
    assert "no gripper" in capsys.readouterr().err
    assert (out.read_bytes() if out.exists() else None) == before


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (("robots", "--png", "x.png"), "robots: say which robot --png is about, e.g. retrieve robots ur5e --png"),
        (("robots", "ur5e", "--hand-frame", "tcp"), "robots: ur5e has a hand frame and a gripper joint of its own; leave"),
        (("robots", "./nowhere.urdf"), "robots: URDF file nowhere.urdf does not exist"),
    ],
)
def test_a_wrong_call_of_robots(args: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(list(args)) == 2
    assert capsys.readouterr().err.startswith(says)


def test_a_fitted_cabinet_is_within_reach_and_always_the_same() -> None:
    """Of an arm of the usual size with a wide gripper; the arm waits before the cabinet, looking in."""
    arm = load(str(OWN))
    spec, ref = load_spec("paper-any"), to_ref(arm)
    fitted, again = fit(spec, arm, ref), fit(spec, arm, ref)
    assert (str(fitted), fitted.ref.home) == (str(again), again.ref.home)
    assert fitted.share >= 0.8
    assert fitted.scale == 1.0
    home = from_ref(fitted.ref).home
    assert not (home == arm.home).all()
    poses = arm.link_poses(home)
    assert (fitted.ref.T_world_base @ poses["hand"])[0, 3] < fitted.spec.cabinet_front_m


def test_why_no_cabinet_fits(toy_urdf: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Another spec is named where it may help: not to an arm whose hand can't pitch, as a SCARA's."""
    looks_up, arm = load(str(toy_urdf(('rpy="0 1.5707963267948966 0"', 'rpy="0 1 0"'))), "tcp"), load(str(OWN))
    assert not arm_at(looks_up, np.eye(4)).pitches
    assert arm_at(arm, np.eye(4)).pitches
    for name in ("paper", "paper-any"):
        says = r"at most \(there is no place before it where the arm could wait\); of its 3 joints none "
        with pytest.raises(NoScene, match=says + "pitches its hand, so that where the hand is decides how steeply it looks$"):
            fit(load_spec(name), looks_up, to_ref(looks_up, "tcp"))
    monkeypatch.setattr("planning.scenes.fitting.fit.LEAST_SHARE", 1.1)
    monkeypatch.setattr("planning.scenes.fitting.fit.EXACTLY", 1)
    for name, remedy in (("paper", "level: --spec paper-any lets it from above and aslant, too$"), ("paper-any", r"at most( \(.*\))?$")):
        with pytest.raises(NoScene, match=remedy):
            fit(load_spec(name), arm, to_ref(arm))


def test_what_is_in_the_way_is_told_of_objects_as_wide_as_the_hand_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not of slimmer ones, on which a cup finds no room."""
    arm, tried = load(str(OWN)), chain(["l4 touches back"], repeat("no grasp fits"))
    held = chain(["the palm is in the way"], repeat(None))
    monkeypatch.setattr("planning.scenes.fitting.fit.not_held", lambda *_, **__: next(held))
    monkeypatch.setattr("planning.scenes.fitting.fit._best_of", lambda _, spec, *__: Tried(spec, 0.0, None, next(tried)))
    with pytest.raises(NoScene, match=r"at most \(l4 touches back\)"):
        fit(load_spec("paper"), arm, to_ref(arm))


def test_a_narrow_gripper_gets_smaller_objects_and_a_smaller_cabinet(tmp_path: Path) -> None:
    narrow = tmp_path / "arm.urdf"
    narrow.write_text(OWN.read_text().replace('upper="0.045"', 'upper="0.025"'))
    arm = load(str(narrow))
    spec = load_spec("paper")
    fitted = fit(spec, arm, to_ref(arm))
    assert fitted.scale < 0.7
    np.testing.assert_allclose(fitted.spec.cabinet_size_m, fitted.scale * spec.cabinet_size_m)
    assert 2 * fitted.spec.objects_half_width_m[1] < arm.opening.max_m


def test_scenes_of_a_fitted_cabinet_begin_where_the_arm_can_wait(tmp_path: Path) -> None:
    from planning.io.files import read_scenes

    out = tmp_path / "scenes.jsonl"
    assert main(["gen", "--robot", str(OWN), "--fit", "-n", "1", "--seed", "3", "-o", str(out)]) == 0
    ((_, scene),) = read_scenes(out)
    assert scene.robot.home is not None
    robot = from_ref(scene.robot)
    assert scene.robot.gripper_joints == ("grip",)
    motions = Motions(robot, replace(scene, objects=(scene.target_body,)))
    assert motions.start_blocked() is None
    assert motions.picks(motions.start(), scene.target_name, [scene.x_g])[0]
