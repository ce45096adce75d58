"""Robots from URDF: kinematics against yourdfpy and pytorch-kinematics, the opening of the hand, and what a URDF must have."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import yourdfpy
from conftest import random_q
from lxml import etree
from second_engine import Arm, nearest

from kinematics.chain import forward
from kinematics.collision.fcl_check import Verdict
from kinematics.robots.batched_fk import Forward
from kinematics.robots.load import forget, from_ref, load, to_ref
from kinematics.robots.named import named_robots
from kinematics.robots.robot import Robot
from kinematics.scene import Cabinet, RobotRef, Scene, State
from kinematics.transforms import inverse, rotation_about, transform


def test_forward_kinematics_agrees_with_yourdfpy(robot: Robot) -> None:
    model = yourdfpy.URDF.load(
        BytesIO(robot.urdf.encode()), filename_handler=lambda fname: fname, load_meshes=False, build_scene_graph=True
    )
    for q in random_q(robot, 100):
        model.update_cfg(dict(zip(robot.joint_names, q)))
        for link, T in robot.link_poses(q).items():
            np.testing.assert_allclose(T, model.get_transform(link), atol=1e-6)


def test_forward_kinematics_agrees_with_pytorch_kinematics(robot: Robot) -> None:
    q = random_q(robot, 100)
    poses = Forward(robot).poses(q)
    assert list(poses) == list(robot.tree.names)
    ours = np.array([robot.tree.poses(x) for x in q])
    for i, T in enumerate(poses.values()):
        assert T.shape == (100, 4, 4)
        np.testing.assert_allclose(ours[:, i], T.numpy(), atol=1e-6)


def test_compiled_frames_carry_every_link(robot: Robot) -> None:
    """kinematics.chain.forward with frame_of_links says the same as Robot.link_poses, at any opening and place of the base."""
    T_world_base = transform(rotation_about((1, 2, 3), 0.7), [0.3, -0.2, 0.5])
    chain = robot.chain(T_world_base)
    frames = np.empty((len(chain.q_index) + 1, 4, 4))
    for q in random_q(robot, 20, seed=1):
        forward(chain, robot.arm_q(q), frames)
        poses = robot.link_poses(q)
        carried = robot.frame_of_links(q[robot.gripper_joint], T_world_base)
        q_of_arm = robot.with_arm(robot.arm_q(q), q[robot.gripper_joint])
        np.testing.assert_array_equal(q_of_arm, q)
        for link, (frame, T) in carried.items():
            np.testing.assert_allclose(frames[frame] @ T, T_world_base @ poses[link], atol=1e-9)


@pytest.mark.parametrize("link", ["hand", "camera"])
def test_jacobians_are_derivatives(robot: Robot, link: str) -> None:
    q, h = random_q(robot, 5, seed=2), 1e-5
    jacobian = Forward(robot).jacobian(q, link).numpy()
    assert jacobian.shape == (5, 6, len(robot.arm_joints))
    for column, j in enumerate(robot.arm_joints):
        step = np.eye(len(robot.joint_names))[j] * h
        for x, J in zip(q, jacobian):
            plus, minus = robot.link_poses(x + step)[link], robot.link_poses(x - step)[link]
            turn = plus[:3, :3] @ minus[:3, :3].T
            spin = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
            np.testing.assert_allclose(J[:, column], np.concatenate([plus[:3, 3] - minus[:3, 3], spin]) / (2 * h), atol=2e-6)


def test_jacobian_of_links_apart(robot: Robot) -> None:
    """The root never moves; a finger moves with the arm, so far as the arm's joints go, like any point of the hand."""
    forward, q = Forward(robot), random_q(robot, 3)
    assert not forward.jacobian(q, robot.tree.names[0]).any()
    finger = forward.jacobian(q, min(robot.fingers))
    np.testing.assert_allclose(finger[:, 3:], forward.jacobian(q)[:, 3:], atol=1e-6)
    with pytest.raises(ValueError, match=r"no link 'tail'; it has .*hand"):
        forward.jacobian(q, "tail")


def test_torch_is_not_imported_before_it_is_needed() -> None:
    code = "import sys, kinematics.robots.batched_fk, kinematics.robots.load; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_comparison_imports_no_simulator_and_leaves_the_package_whole() -> None:
    """pytorch-kinematics' readers alone: who imports all of it afterwards gets all of it."""
    code = (
        "import sys; from kinematics.robots.batched_fk import Forward; from kinematics.robots.load import load\n"
        "robot = load('ur5e'); Forward(robot).jacobian(robot.home[None])\n"
        "assert not {'mujoco', 'matplotlib', 'pytorch_kinematics'} & set(sys.modules)\n"
        "import pytorch_kinematics; assert pytorch_kinematics.build_chain_from_urdf and pytorch_kinematics.Transform3d\n"
        "Forward(robot).poses(robot.home[None])"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_home_is_free_and_open(robot: Robot) -> None:
    assert (robot.lower <= robot.home).all()
    assert (robot.home <= robot.upper).all()
    low, high = robot.planning_limits
    assert ((low <= robot.arm_q(robot.home)) & (robot.arm_q(robot.home) <= high)).all()
    assert (robot.lower[list(robot.arm_joints)] <= low).all()
    assert (high <= robot.upper[list(robot.arm_joints)]).all()
    assert robot.home[robot.gripper_joint] == pytest.approx(robot.opening.value_at(robot.opening.max_m))
    assert robot.has_camera
    assert verdict(robot).contacts(State(robot.home, {})) == []


def verdict(robot: Robot) -> Verdict:
    """A verdict for a robot in an empty cabinet that is far away."""
    cabinet = Cabinet(np.array([0.5, 0.5, 0.5]), transform(p=[5.0, 0.0, 0.0]), 0.03)
    return Verdict(robot, Scene("empty", RobotRef(np.eye(4), robot.name), cabinet, (), "none", None))  # type: ignore[arg-type]


def test_widths_are_what_lies_between_the_pads(robot: Robot) -> None:
    """The table's width is the distance of the two sides' fingers near the hand frame, as pinocchio and coal have it."""
    opening, other = robot.opening, Arm(robot.urdf)
    assert (np.diff(opening.width_m) > 0).all()
    assert opening.max_m == pytest.approx(0.08 if robot.name == "panda" else 0.085, abs=0.002)
    order = [robot.joint_names.index(n) for n in other.actuated]
    fingers = [i for i, s in enumerate(other.solids) if s.name in robot.fingers]
    for width in np.linspace(0.003, opening.max_m - 0.001, 9):
        q = robot.with_arm(robot.arm_q(robot.home), opening.value_at(width))
        (poses,), (T_hand,) = other.place(q[None, order])
        side = {i: (inverse(T_hand) @ poses[i] @ [*other.solids[i].centre, 1])[1] > 0 for i in fingers}
        gaps = []
        for i in fingers:
            for j in fingers:
                if side[i] and not side[j]:
                    gap, point = nearest(other.solids[i].geometry, poses[i], other.solids[j].geometry, poses[j])
                    if (inverse(T_hand) @ [*point, 1])[2] > -0.013:  # further back are the knuckles
                        gaps.append(gap)
        assert min(gaps) == pytest.approx(width, abs=2e-4)


def test_the_hand_frame_lies_between_the_pads(robot: Robot) -> None:
    """The fingers close along y, symmetrically, and their pads are near the frame's origin along z, further out when more shut."""
    for width in (0.01, 0.04, 0.07):
        poses = robot.link_poses(robot.with_arm(robot.arm_q(robot.home), robot.opening.value_at(width)))
        T_hand = inverse(poses["hand"])
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for hull in robot.hulls:
            if hull.link in robot.fingers:
                T = T_hand @ poses[hull.link]
                points = hull.vertices @ T[:3, :3].T + T[:3, 3]
                low, high = np.minimum(low, points.min(0)), np.maximum(high, points.max(0))
        assert abs(low[1] + high[1]) < 0.002
        assert abs(low[0] + high[0]) < 0.004
        assert low[2] < 0 < high[2]
        assert abs(robot.opening.pad_z_at(width)) < 0.015


def test_the_camera_looks_along_the_approach(robot: Robot) -> None:
    poses = robot.link_poses(robot.home)
    T_hand_camera = inverse(poses["hand"]) @ poses["camera"]
    assert T_hand_camera[2, 2] == pytest.approx(1, abs=1e-6)
    assert abs(T_hand_camera[1, 3]) < 1e-3  # perpendicular to the way the fingers close
    assert 0.05 < abs(T_hand_camera[0, 3]) < 0.15


# ------------------------------------------------------------------------------------------------------------- one's own URDF


def test_a_urdf_of_ones_own(toy_urdf: Callable[..., Path]) -> None:
    toy = load(str(toy_urdf()), "tcp")
    assert toy.joint_names == ("turn", "up", "out", "grip")
    assert [toy.joint_names[j] for j in toy.arm_joints] == ["turn", "up", "out"]
    assert toy.fingers == {"left_finger", "right_finger"}
    assert toy.opening.max_m == pytest.approx(0.08)
    assert toy.opening.value_at(0.05) == pytest.approx(0.025)
    poses = toy.link_poses(np.array([np.pi / 2, 0.1, 0.2, 0.03]))
    np.testing.assert_allclose(poses["hand"][:3, 3], [0, 0.06 + 0.1 + 0.2 + 0.08, 0.06 + 0.05 + 0.1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(poses["left_finger"][:3, 3] - poses["right_finger"][:3, 3]), 2 * (0.005 + 0.03), atol=1e-12)
    np.testing.assert_allclose(poses["hand"], poses["tcp"])
    np.testing.assert_allclose(Forward(toy).poses(toy.home[None])["right_finger"][0], toy.link_poses(toy.home)["right_finger"], atol=1e-6)


def test_a_scene_names_a_robot_so_that_it_is_loaded_again(robot: Robot, toy_urdf: Callable[..., Path]) -> None:
    """A named one by its name, one's own by its file; the base stands where it does in generated scenes."""
    assert to_ref(robot).name == robot.name
    assert np.array_equal(to_ref(robot).T_world_base, transform(p=robot.base_p))
    assert from_ref(to_ref(robot)) is robot
    toy = load(str(toy_urdf()), "tcp")
    ref = to_ref(toy, "tcp")
    assert (ref.name, ref.urdf, ref.hand_frame, ref.gripper_joint) == (None, toy.name, "tcp", "grip")
    assert np.array_equal(from_ref(ref).link_poses(toy.home)["hand"], toy.link_poses(toy.home)["hand"])


def test_a_link_called_hand_keeps_its_place(toy_urdf: Callable[..., Path]) -> None:
    toy = load(str(toy_urdf(('"tcp"', '"hand"'))), "hand", "grip")
    assert toy.tree.names.count("hand") == 1


def test_mimic_with_factor_and_offset_and_mimic_of_a_mimic(toy_urdf: Callable[..., Path]) -> None:
    first = ('<mimic joint="grip"/>', '<mimic joint="grip" multiplier="0.5" offset="0.01"/>')
    extra = """<joint name="third" type="prismatic"><parent link="palm"/><child link="nail"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="grip_mirror" multiplier="-2" offset="0.1"/></joint>
    <link name="nail"/></robot>"""
    toy = load(str(toy_urdf(first, ("</robot>", extra))), "tcp", "grip")
    poses = toy.link_poses(np.array([0.0, 0.0, 0.0, 0.02]))
    in_palm = {n: (inverse(poses["palm"]) @ poses[n])[:3, 3] for n in ("left_finger", "right_finger", "nail")}
    assert in_palm["left_finger"][1] == pytest.approx(0.005 + 0.02)
    assert in_palm["right_finger"][1] == pytest.approx(-0.005 - (0.5 * 0.02 + 0.01))
    assert in_palm["nail"][1] == pytest.approx(-2 * (0.5 * 0.02 + 0.01) + 0.1)


def test_foreign_tags_are_no_obstacle(toy_urdf: Callable[..., Path]) -> None:
    """An undeclared XML prefix and a <transmission>, on which pytorch-kinematics fails."""
    foreign = """<drake:joint name="x"/><transmission name="t"><type>Simple</type><joint name="turn"/></transmission>
    <gazebo reference="palm"/></robot>"""
    file = toy_urdf(('<box size="0.2 0.2 0.1"/>', '<box size="0.2 0.2 0.1" drake:x="1"/>'), ("</robot>", foreign))
    toy = load(str(file), "tcp")
    assert "drake" not in toy.urdf
    assert "transmission" not in toy.urdf
    Forward(toy).poses(toy.home[None])


def test_an_srdf_beside_the_urdf_is_read(toy_urdf: Callable[..., Path]) -> None:
    file = toy_urdf()
    before = load(str(file), "tcp").skip
    other = file.with_name("with_srdf.urdf")
    other.write_text(file.read_text())
    srdf = '<robot name="toy"><disable_collisions link1="base" link2="left_finger" reason="Never"/></robot>'
    other.with_suffix(".srdf").write_text(srdf)
    assert load(str(other), "tcp").skip - before == {frozenset(("base", "left_finger"))}


@pytest.mark.parametrize(
    ("changes", "hand", "gripper", "message"),
    [
        ((), "tool", "grip", r"no link 'tool'.*it has base, .*tcp"),
        ((), "tcp", "grab", r"'grab' is no joint that can open the fingers; actuated joints besides the arm's: grip"),
        ((), "tcp", "out", r"'out' is no joint that can open the fingers.*: grip"),
        ((), "base", "grip", r"no joint moves the hand frame"),
        ((('<box size="0.2 0.2 0.1"/>', '<mesh filename="base.stl"/>'),), "tcp", "grip", r"mesh base.stl, which does not exist"),
        ((('<box size="0.2 0.2 0.1"/>', '<mesh filename="package://toy/base.stl"/>'),), "tcp", "grip", r"mesh package://toy/base.stl"),
        ((('<limit lower="0" upper="0.3" velocity="0.5" effort="10"/>', ""),), "tcp", "grip", r"joint 'up': it has no limits"),
        ((('<mimic joint="grip"/>', '<mimic joint="grab"/>'),), "tcp", "grip", r"'grip_mirror': it mimics 'grab', which does not exist"),
        ((('name="up" type="prismatic"', 'name="up" type="planar"'),), "tcp", "grip", r"'up': its type is 'planar'; revolute"),
        ((("</robot>", '<link name="loose"/></robot>'),), "tcp", "grip", r"2 root links \(.*loose"),
        ((('<origin xyz="0 0 0.08"/>', '<origin xyz="0 0 0.08" rpy="0 0 1.5708"/>'),), "tcp", "grip", r"two fingers found .*T_link"),
        ((('<origin xyz="0 0 0.08"/>', '<origin xyz="0 0 0.3"/>'),), "tcp", "grip", r"between whose pads p \[0, 0, -0.22"),
        ((("<robot", "<machine"), ("</robot", "</machine")), "tcp", "grip", r"no URDF: its root element is <machine>, not <robot>"),
    ],
)  # fmt: skip
def test_what_a_urdf_must_have(
    toy_urdf: Callable[..., Path], changes: tuple[tuple[str, str], ...], hand: str | None, gripper: str | None, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        load(str(toy_urdf(*changes)), hand, gripper)


def test_a_file_that_is_no_xml(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    for content in (b"", b"hello", b"\x00\xff\x00"):
        file.write_bytes(content)
        with pytest.raises(ValueError, match=r"no URDF"):
            load(str(file), "tcp")


def test_a_mesh_that_is_no_mesh(toy_urdf: Callable[..., Path]) -> None:
    file = toy_urdf(('<box size="0.2 0.2 0.1"/>', '<mesh filename="base.stl"/>'))
    (file.parent / "base.stl").write_bytes(b"solid nothing")
    with pytest.raises(ValueError, match=r"base\.stl"):
        load(str(file), "tcp")


def test_unknown_robots() -> None:
    with pytest.raises(ValueError, match=r"unknown robot 'hal'.*ur5e, panda, gen3"):
        load("hal")
    with pytest.raises(ValueError, match=r"hal\.urdf does not exist"):
        load("hal.urdf", "tcp")


def test_a_missing_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from kinematics.robots import load as module

    table = {**named_robots(), "ghost": {**named_robots()["panda"], "distribution": "no-such-distribution"}}
    monkeypatch.setattr(module, "named_robots", lambda: table)
    with pytest.raises(ValueError, match=r"'ghost' comes with the package no-such-distribution.*pip install 'retrieve\[panda\]'"):
        load("ghost")


def test_joined_names_get_a_prefix(ur5e: Robot) -> None:
    root = etree.fromstring(ur5e.urdf)
    names = [e.get("name") for e in root.iter("link")]
    assert len(names) == len(set(names))
    assert "gripper_base_link" in names or "gripper_base_link_inertia" in names
    assert all(Path(m.get("filename", "")).is_absolute() for m in root.iter("mesh"))


def test_the_cache_changes_nothing(toy_urdf: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file, said = str(toy_urdf()), []
    first = load(file, "tcp", on_step=said.append)
    forget()
    second = load(file, "tcp", on_step=said.append)
    assert said == ["reading the meshes of toy", "comparing the kinematics of toy with another reading of its URDF"]
    assert first.skip == second.skip
    assert first.urdf == second.urdf
    for a, b in zip(first.hulls, second.hulls, strict=True):
        np.testing.assert_array_equal(a.vertices, b.vertices)


def test_joint_values_are_counted_before_they_are_used(robot: Robot) -> None:
    """Three values for seven joints once read beyond the array."""
    J = len(robot.joint_names)
    assert robot.tree.coordinates == J
    for shape in ((), (0,), (3,), (J - 1,), (J + 1,), (2, J + 1), (J, 1)):
        with pytest.raises(ValueError, match=f"must (end with|hold) {J} values"):
            robot.tree.poses(np.zeros(shape))
        with pytest.raises(ValueError, match=f"must hold {J} values"):
            robot.link_poses(np.zeros(shape))
    for i in (-1, len(robot.tree.names)):
        with pytest.raises(ValueError, match="a link's index and q"):
            robot.tree.local(i, np.zeros(J))
    assert robot.tree.poses(np.zeros((0, J))).shape == (0, len(robot.tree.names), 4, 4)


@pytest.mark.parametrize(
    ("first", "second", "says"),
    [
        ("grip_mirror", None, "joint 'grip_mirror' mimics itself (grip_mirror mimics grip_mirror); one needs a motor"),
        ("grip_mirror", "grip_mirror", "mimics itself (grip"),
    ],
)
def test_a_circle_of_mimics_ends(first: str, second: str | None, says: str, toy_urdf: Callable[..., Path]) -> None:
    """Loading one went on for ever."""
    changes = [('<mimic joint="grip"/>', f'<mimic joint="{first if second is None else "grip"}"/>')]
    if second is not None:
        changes.append(
            (
                'velocity="0.1" effort="10"/></joint>\n  <link name="left',
                f'velocity="0.1"/><mimic joint="{second}"/></joint>\n  <link name="left',
            )
        )
    with pytest.raises(ValueError, match=re.escape(says)):
        load(str(toy_urdf(*changes)), "tcp")


def test_one_link_is_where_it_is_among_all(ur5e: Robot) -> None:
    q = np.random.default_rng(3).uniform(ur5e.lower, ur5e.upper, (2, 5, len(ur5e.lower)))
    at = ur5e.tree.poses(q)
    for name, i in ur5e.tree.index.items():
        assert np.allclose(ur5e.tree.link(name, q), at[..., i, :, :], atol=1e-12)
    with pytest.raises(ValueError, match="actuated joint"):
        ur5e.tree.link("hand", q[..., :-1])


@pytest.mark.parametrize("arm_joints", [(0, 1, 2), (0, 2, 1), (1, 3, 4)])
def test_the_arms_joints_may_stand_anywhere_among_all(ur5e: Robot, arm_joints: tuple[int, ...]) -> None:
    robot = replace(ur5e, arm_joints=arm_joints)
    rows = np.arange(3.0 * len(robot.joint_names)).reshape(3, -1)
    for q in (rows, rows[1]):
        before, arm = q.copy(), robot.arm_q(q)
        assert np.array_equal(arm, q[..., list(arm_joints)])
        arm += 1.0
        assert np.array_equal(q, before)  # a copy
        full = robot.with_arm(arm, 0.25)
        others = [j for j in range(q.shape[-1]) if j not in (*arm_joints, robot.gripper_joint)]
        assert np.array_equal(robot.arm_q(full), arm)
        assert (full[..., robot.gripper_joint] == 0.25).all()
        assert np.array_equal(full[..., others], np.broadcast_to(robot.home[others], (*q.shape[:-1], len(others))))


def test_what_is_written_is_read_again_and_again(tmp_path: Path) -> None:
    """Each time there are links `hand` and `camera` already, and joints that hold them."""
    robot = load(str(Path(__file__).resolve().parents[3] / "examples" / "04_own_arm" / "arm.urdf"))
    q, T = robot.home, robot.link_poses(robot.home)["hand"]
    for n in range(3):
        file = tmp_path / f"{n}.urdf"
        file.write_text(robot.urdf)
        robot = load(str(file))
        np.testing.assert_allclose(robot.link_poses(q)["hand"], T, atol=1e-9)
