"""Hands of three fingers: which is the thumb, which motors close, which stand still; and that things are taken with them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from six_joints import arm, box, joint

from kinematics.robots.derive import read_description
from kinematics.robots.files.fixed_joints import freeze
from kinematics.robots.hands.hand_model import NoGripper
from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.robots.tree import Tree
from kinematics.scene import Body, Cabinet, Grasp, Scene
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import rotation_about, transform
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.verdict import judge_grasp, judge_motions

CABINET = Cabinet(np.array([0.40, 0.70, 0.45]), transform(p=[0.35, 0.0, 0.15]), 0.02)


PLACES = {"left": (0.025, 1), "right": (-0.025, 1), "thumb": (0.0, -1)}
"""Of each finger its place along x, and its side along y."""


def sliding() -> str:
    """Three fingers with flat pads, a motor each."""
    out = ""
    for name, (x, side) in PLACES.items():
        out += f'<link name="{name}">{box("0.02 0.01 0.07", f"0 {0.005 * side} 0.035")}</link>'
        out += joint(f"f_{name}", "prismatic", "palm", name, f"{x} 0 0.012", f"0 {side} 0", (0.0, 0.045))
    return out


def hinged(thumb: float = 0.0) -> str:
    """Three fingers that turn about the palm's edges, each with a tip that has a motor of its own. thumb: how far it is turned round."""
    out = ""
    for name, (x, side) in PLACES.items():
        out += f'<link name="{name}">{box("0.018 0.012 0.05", f"0 {0.006 * side} 0.025")}</link>'
        out += f'<link name="{name}_tip">{box("0.018 0.010 0.035", f"0 {0.005 * side} 0.0175")}</link>'
        limits = (0.0, 0.6) if side < 0 else (-0.6, 0.0)
        out += joint(f"f_{name}", "revolute", "palm", name, f"{x} {0.018 * side} 0.01", "1 0 0", limits, f"0 0 {thumb if side < 0 else 0}")
        out += joint(f"t_{name}", "revolute", name, f"{name}_tip", "0 0 0.05", "1 0 0", (-0.5, 0.5))
    return out


def spread() -> str:
    """As Barrett's: the two that go together stand on links that turn them half round the palm, which moves them further than what closes
    them."""
    out = ""
    for name, (x, side) in PLACES.items():
        foot, y = ("palm", 0.03 * side) if side < 0 else (f"{name}_foot", 0.03)
        if side > 0:
            out += f'<link name="{foot}">{box("0.02 0.05 0.01", "0 0.015 0.005")}</link>'
            limits = (-3.14, 0.0) if x > 0 else (0.0, 3.14)
            out += joint(f"s_{name}", "revolute", "palm", foot, f"{x} 0 0.012", "0 0 1", limits)
        out += f'<link name="{name}">{box("0.018 0.05 0.012", f"0 {0.025 * side} 0.006")}</link>'
        out += f'<link name="{name}_tip">{box("0.018 0.035 0.010", f"0 {0.0175 * side} 0.005")}</link>'
        at = f"{x} {y} 0.022" if side < 0 else f"0 {y} 0.01"
        closes, bends = ((0.0, 1.9), (0.0, 0.8)) if side > 0 else ((-1.9, 0.0), (-0.8, 0.0))
        out += joint(f"f_{name}", "revolute", foot, name, at, "1 0 0", closes)
        out += joint(f"t_{name}", "revolute", name, f"{name}_tip", f"0 {0.05 * side} 0", "1 0 0", bends)
    return out


def as_one(hand: str) -> str:
    """The same with one motor, the thumb's, that the others mimic; tips are fixed."""
    rate = -1 if hand == hinged() else 1
    for name in ("left", "right"):
        at = hand.index("</joint>", hand.index(f'<joint name="f_{name}"'))
        hand = f'{hand[:at]}<mimic joint="f_thumb" multiplier="{rate}"/>{hand[at:]}'
    return re.sub(r'(<joint name="t_\w+" type=)"revolute"', r'\1"fixed"', hand)


@pytest.fixture
def robot(tmp_path: Path) -> Callable[..., Robot]:
    def make(hand: str, *args: object, **more: object) -> Robot:
        file = tmp_path / "r.urdf"
        file.write_text(arm(hand))
        return load(str(file), *args, **more)  # type: ignore[arg-type]

    return make


@pytest.mark.parametrize("hand", [sliding(), hinged()], ids=["sliding", "hinged"])
def test_two_go_together_against_the_thumb(hand: str, robot: Callable[..., Robot]) -> None:
    made = robot(hand)
    grip = made.grip
    assert grip is not None
    assert (grip.kind, set(grip.joints)) == ("three fingers", {"f_left", "f_right", "f_thumb"})
    assert made.joint_names == (*(f"a{i}" for i in range(6)), grip.joints[0])
    assert {name for name, _ in grip.frozen} == ({"t_left", "t_right", "t_thumb"} if hand == hinged() else set())
    poses = made.link_poses(made.home)
    T = np.linalg.inv(poses["palm"]) @ poses["hand"]
    np.testing.assert_allclose(np.abs(T[:3, 1]), [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-6)
    assert abs(T[0, 3]) < 1e-3
    assert made.opening.max_m > 0.05
    again = robot(hand, grip.link, T_link_hand=grip.T_link_hand, gripper_joints=grip.joints)
    np.testing.assert_allclose(again.opening.width_m, made.opening.width_m, atol=1e-6)
    named = robot(hand, gripper_joint="f_thumb").grip  # one of its joints says which hand, not that its finger is alone
    assert named is not None
    assert (named.kind, set(named.joints)) == ("three fingers", set(grip.joints))


@pytest.mark.parametrize("hand", [sliding(), hinged()], ids=["sliding", "hinged"])
def test_three_fingers_may_have_one_motor(hand: str, robot: Callable[..., Robot]) -> None:
    """The frame and what the fingers leave free are as with three motors that go together."""
    made = robot(as_one(hand))
    assert made.grip is not None
    assert (made.grip.kind, made.grip.joints) == ("three fingers", ("f_thumb",))
    of_three = robot(hand)
    T, want = (np.linalg.inv(poses["palm"]) @ poses["hand"] for r in (made, of_three) for poses in [r.link_poses(r.home)])
    np.testing.assert_allclose(np.abs(T), np.abs(want), atol=1e-6)
    assert made.opening.max_m == pytest.approx(of_three.opening.max_m, abs=1e-6)


def test_the_links_of_one_fingers_linkage_are_no_fingers(robot: Callable[..., Robot]) -> None:
    """Two bars that turn one behind the other, against a single one."""
    links = ""
    for name, y, z, side in (("outer", 0.03, 0.012, 1), ("inner", 0.022, 0.022, 1), ("other", -0.026, 0.012, -1)):
        links += f'<link name="{name}">{box("0.02 0.008 0.07", f"0 {0.004 * side} 0.035")}</link>'
        limits = (-0.6, 0.0) if side > 0 else (0.0, 0.6)
        links += joint(f"f_{name}", "revolute", "palm", name, f"0 {y} {z}", "1 0 0", limits)
    for name, rate in (("inner", 1), ("other", -1)):
        at = links.index("</joint>", links.index(f'<joint name="f_{name}"'))
        links = f'{links[:at]}<mimic joint="f_outer" multiplier="{rate}"/>{links[at:]}'
    made = robot(links)
    assert made.grip is not None
    assert made.grip.kind == "two fingers"


def test_a_motor_that_spreads_fingers_does_not_close_them(robot: Callable[..., Robot]) -> None:
    """Though it moves them further: the hand frame is where those motors close that do, and round things are held there."""
    made = robot(spread())
    grip = made.grip
    assert grip is not None
    assert (grip.kind, set(grip.joints)) == ("three fingers", {"f_left", "f_right", "f_thumb"})
    assert {name for name, _ in grip.frozen} == {"s_left", "s_right", "t_left", "t_right", "t_thumb"}
    T = np.linalg.inv(made.link_poses(made.home)["palm"]) @ made.link_poses(made.home)["hand"]
    np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=0.05)
    assert made.opening.max_m > 0.06
    body = Body("it", Cylinder(0.025, 0.14), CABINET.T_world_cabinet @ transform(p=[0.15, 0.0, 0.07]))
    scene = Scene("s", replace(to_ref(made), T_world_base=np.eye(4)), CABINET, (body,), "it", None, 6)
    level = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    grasp = Grasp(transform(level, made.opening.hand_position(body.T_world_body[:3, 3], level, 0.05)), 0.05)
    assert judge_grasp(made, scene, grasp) is None


CAN, BOX = Cylinder(0.025, 0.14), Box(np.array([0.05, 0.05, 0.14]))


@pytest.mark.parametrize(
    ("hand", "shape"), [(sliding(), CAN), (sliding(), BOX), (hinged(), CAN)], ids=["sliding, can", "sliding, box", "hinged, can"]
)
def test_things_are_taken_and_put_down(hand: str, shape: Shape, robot: Callable[..., Robot]) -> None:
    made = robot(hand)
    T = CABINET.T_world_cabinet @ transform(rotation_about((0, 0, 1), 0.1), [0.15, 0.08, 0.07])
    ref = to_ref(made)
    scene = Scene("s", replace(ref, T_world_base=np.eye(4)), CABINET, (Body("it", shape, T),), "it", None, 6)
    motions, rng = Motions(made, scene, target_grasps=()), np.random.default_rng(1)
    state = motions.start()
    done = next((d for region in (8, 14, 20) if isinstance(d := motions.relocate(state, "it", region, rng), Done)), None)
    assert done is not None, motions.picks(state, "it")[1]
    assert judge_motions(scene, motions.trajectories(state, done.motions), made) == ()


def test_a_thumb_that_does_not_oppose_is_said(robot: Callable[..., Robot]) -> None:
    with pytest.raises(NoGripper, match=r"of three fingers \(.*\) none closes against the two others"):
        robot(hinged(thumb=1.7))


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_frozen_joint_is_where_it_was(kind: str) -> None:
    """And so is what mimics it."""
    links = "".join(f'<link name="{n}">{box("0.1 0.1 0.1")}</link>' for n in "abcd")
    first = joint("one", kind, "a", "b", "0.1 0.2 0.3", "0 0.6 0.8", (-1, 1), "0.3 -0.4 0.5")
    mimic = '<mimic joint="one" multiplier="-2" offset="0.1"/></joint>'
    second = joint("two", kind, "b", "c", "0 0.1 0", "1 0 0", (-1, 1)).replace("</joint>", mimic)
    text = f'<robot name="r">{links}{first}{second}{joint("three", kind, "c", "d", "0 0 0.1", "0 1 0", (-1, 1))}</robot>'
    before, after = etree.fromstring(text), etree.fromstring(text)
    freeze(after, "one", 0.4)
    assert [j.get("type") for j in after.iter("joint")] == ["fixed", "fixed", kind]
    trees: list[Tree] = [read_description(etree.tostring(root, encoding="unicode"), "r").tree for root in (before, after)]
    for a, b in zip(trees[0].poses(np.array([0.4, 0.7])), trees[1].poses(np.array([0.7]))):
        np.testing.assert_allclose(a, b, atol=1e-9)


def swinging(names: tuple[str, ...], askew: float) -> str:
    """Fingers that turn from wide open, when nothing is between their tips, until they pass the middle; those that go together lean inwards
    by `askew`, the thumb to one side."""
    out = ""
    for name in names:
        x, side = PLACES[name] if len(names) == 3 else (0.0, PLACES[name][1])
        out += f'<link name="{name}">{box("0.018 0.012 0.05", f"0 {0.006 * side} 0.025")}</link>'
        out += f'<link name="{name}_tip">{box("0.018 0.010 0.035", f"0 {0.005 * side} 0.0175")}</link>'
        turned = -side * np.sign(x) * askew if x else askew / 2
        limits = (-0.3, 1.3) if side < 0 else (-1.3, 0.3)
        out += joint(f"f_{name}", "revolute", "palm", name, f"{x} {0.03 * side} 0.01", "1 0 0", limits, f"0 0 {turned:.6f}")
        out += joint(f"t_{name}", "fixed", name, f"{name}_tip", "0 0 0.05", "1 0 0", (0, 0))
    return out


@pytest.mark.parametrize("names", [("left", "right", "thumb"), ("left", "thumb")], ids=["three", "two"])
def test_fingers_that_swing_far_hold_while_they_face_each_other(names: tuple[str, ...], robot: Callable[..., Robot]) -> None:
    """As Kinova's: up to the end of their table the verdict says that they hold a can, though they open further; two that lean to their
    sides both touch it."""
    made = robot(swinging(names, 0.18 if len(names) == 3 else 0.0))
    opening = made.opening
    assert opening.round_only
    assert opening.max_m > 0.05
    poses = made.link_poses(made.home)
    T = np.linalg.inv(poses["palm"]) @ poses["hand"]
    np.testing.assert_allclose(np.abs(T[:3, 1]), [0, 1, 0], atol=1e-6)
    held = []
    for width in np.linspace(0.8 * opening.max_m, opening.max_m - 0.002, 4):
        body = Body("it", Cylinder(float(width) / 2, 0.14), CABINET.T_world_cabinet @ transform(p=[0.15, 0.0, 0.07]))
        scene = Scene("s", replace(to_ref(made), T_world_base=np.eye(4)), CABINET, (body,), "it", None, 6)
        level = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
        grasp = Grasp(transform(level, opening.hand_position(body.T_world_body[:3, 3], level, float(width))), float(width))
        held.append(judge_grasp(made, scene, grasp))
    assert held == [None] * 4
