"""A suction cup is found by its name or declared, its face is measured, and its vacuum is a joint that moves nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from kinematics.robots.hands.hand_model import NoGripper
from kinematics.robots.hands.opening import BESIDE_M, PUSH_M
from kinematics.robots.hands.suction import ON_M, SUCTION, VALVE
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp
from kinematics.shapes import Box
from kinematics.transforms import Array, rotation_rpy, transform
from planning.verdict.grasp import judge_hold
from planning.verdict.hand import hand_of

TURNED = (0.3, -0.5, 0.9)  # how the cup's link lies to the flange


def arm(tool: str) -> str:
    """Four joints, and a flange."""
    text = '<robot name="r"><link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>'
    for i in range(4):
        text += f'<link name="l{i}"><collision><origin xyz="0 0 0.1"/><geometry><box size="0.05 0.05 0.2"/></geometry></collision></link>'
        text += f'<joint name="a{i}" type="revolute"><parent link="{f"l{i - 1}" if i else "base"}"/><child link="l{i}"/>'
        text += f'<origin xyz="0 0 0.25"/><axis xyz="0 {i % 2} {1 - i % 2}"/><limit lower="-2" upper="2" velocity="1" effort="9"/></joint>'
    return text + tool + "</robot>"


def fixed(child: str, xyz: str, rpy: tuple[float, ...] = (0, 0, 0), parent: str = "l3") -> str:
    at = f'<origin xyz="{xyz}" rpy="{" ".join(map(str, rpy))}"/>'
    return f'<joint name="to_{child}" type="fixed"><parent link="{parent}"/><child link="{child}"/>{at}</joint>'


def cylinder(name: str, radius: float, length: float) -> str:
    """Along its link's z, from 0 on."""
    at = f'<origin xyz="0 0 {length / 2}"/>'
    return f'<link name="{name}"><collision>{at}<geometry><cylinder radius="{radius}" length="{length}"/></geometry></collision></link>'


NAMED = cylinder("vacuum_cup", 0.015, 0.04) + fixed("vacuum_cup", "0 0 0.25", TURNED)
PLAIN = cylinder("tool", 0.02, 0.06) + fixed("tool", "0 0 0.25")
FRAME = PLAIN + '<link name="tip"/>' + fixed("tip", "0 0 0.06", parent="tool")


@pytest.fixture
def robot(tmp_path: Path) -> Callable[..., Robot]:
    def make(tool: str, *args: object, **more: object) -> Robot:
        file = tmp_path / "r.urdf"
        file.write_text(arm(tool))
        return load(str(file), *args, **more)  # type: ignore[arg-type]

    return make


def hand_in(made: Robot, link: str) -> Array:
    poses = made.link_poses(made.home)
    return np.asarray(np.linalg.inv(poses[link]) @ poses["hand"])


def test_a_link_called_like_a_cup_is_one(robot: Callable[..., Robot]) -> None:
    """Its face is where it ends, away from the wrist, whatever its frame; the arm keeps its joints, and one more is the vacuum's."""
    made = robot(NAMED)
    np.testing.assert_allclose(hand_in(made, "vacuum_cup"), transform(p=[0, 0, 0.04]), atol=1e-6)
    assert made.arm_joints == (0, 1, 2, 3)
    assert made.joint_names == ("a0", "a1", "a2", "a3", SUCTION)
    assert (made.fingers, made.pads) == (frozenset(), {"vacuum_cup"})
    assert made.opening.cup_m == pytest.approx(0.030, abs=2e-4)
    assert made.grip is not None
    assert (made.grip.kind, made.grip.measured) == ("a suction cup", True)
    assert made.home[-1] == 0.0
    tree = etree.fromstring(made.urdf)
    assert [link.find("collision") for link in tree.iter("link") if link.get("name") == VALVE] == [None]


def test_of_several_cups_one_is_used_and_that_is_said(robot: Callable[..., Robot]) -> None:
    """As OnRobot's VGC10 has four: the others, which end in the same plane, may touch what it holds; one that ends before may not."""
    made = robot("".join(cylinder(f"cup{k}", 0.01, 0.04) + fixed(f"cup{k}", f"{0.03 * k} 0 {0.25 - 0.01 * (k == 1)}") for k in range(4)))
    assert made.pads == {"cup0", "cup2", "cup3"}
    hand = hand_of(made)
    assert [pad.link for pad in hand.pads] == ["cup3"]
    assert hand.holding == made.pads
    said = "one of 4 suction cups, used alone; the others may touch what it holds, hand frame measured: "
    assert any(note.startswith(said) for note in made.notes)
    box = Body("box", Box(np.array([0.05, 0.2, 0.2])), transform(p=[0.6, 0.0, 0.4]))
    level = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    assert judge_hold(made, box, Grasp(transform(level, [0.575, 0.0, 0.4]), made.opening.cup_m)) is None


@pytest.mark.parametrize("joint", ["gripper", "valve"])
def test_a_joint_that_stands_for_a_vacuum_and_moves_nothing_is_no_gripper(joint: str, robot: Callable[..., Robot]) -> None:
    """As Robotiq's EPick has one for MoveIt, on the cup."""
    state = f'<link name="vacuum_state"/><joint name="{joint}" type="revolute"><parent link="vacuum_cup"/><child link="vacuum_state"/>'
    made = robot(NAMED + state + '<axis xyz="0 0 1"/><limit lower="0" upper="1" velocity="1" effort="9"/></joint>')
    np.testing.assert_allclose(hand_in(made, "vacuum_cup"), transform(p=[0, 0, 0.04]), atol=1e-6)
    assert (made.arm_joints, made.pads) == ((0, 1, 2, 3), {"vacuum_cup"})


@pytest.mark.parametrize(("link", "at"), [("tool", 0.06), ("tip", 0.0)])
def test_any_link_can_be_declared_a_cup(link: str, at: float, robot: Callable[..., Robot]) -> None:
    """A frame that is in the face already is taken as it is."""
    made = robot(FRAME, link, SUCTION)
    np.testing.assert_allclose(hand_in(made, link), transform(p=[0, 0, at]), atol=1e-6)
    assert made.grip is not None
    assert made.grip.measured == (link == "tool")
    assert made.pads == {"tool"}
    assert made.opening.cup_m == pytest.approx(0.040, abs=3e-4)
    again = robot(FRAME, link, T_link_hand=transform(p=[0, 0, at]), gripper_joints=(SUCTION,))
    np.testing.assert_allclose(hand_in(again, link), hand_in(made, link), atol=1e-9)


def test_width_means_on_or_off(robot: Callable[..., Robot]) -> None:
    """Grasps and grippers speak of widths: a cup holds at its own, and is off at any that is wider."""
    opening = robot(NAMED).opening
    assert opening.value_at(opening.cup_m) == ON_M
    assert opening.closing_value(opening.cup_m) == ON_M
    assert opening.value_at(opening.max_m) == 0.0
    assert opening.width_at(ON_M) == opening.cup_m


def test_a_cup_stops_before_what_it_takes_and_draws_it(robot: Callable[..., Robot]) -> None:
    opening = robot(NAMED).opening
    T = transform(rotation_rpy((0.2, 0.1, 0.4)), [1.0, 2.0, 3.0])
    came = np.linalg.inv(T) @ opening.beside(T)
    assert came[:3, 3] == pytest.approx([0.0, 0.0, -BESIDE_M])
    held = opening.held(np.eye(4))
    assert held[:3, 3] == pytest.approx([0.0, 0.0, -PUSH_M])
    np.testing.assert_allclose(opening.let_go(held), np.eye(4), atol=1e-15)


@pytest.mark.parametrize(
    ("tool", "args", "says"),
    [
        (PLAIN, (), "declared by --gripper-joint suction"),
        (PLAIN, (None, SUCTION), "say which link the suction cup is, with --hand-frame"),
        ('<link name="cup"/>' + fixed("cup", "0 0.32 0.4"), (), "nothing that 'cup' is fixed to ends within 30 mm of it"),
    ],
    ids=["no name", "no link", "no face"],
)
def test_what_is_no_cup_is_said(tool: str, args: tuple[str | None, ...], says: str, robot: Callable[..., Robot]) -> None:
    with pytest.raises(NoGripper, match=says):
        robot(tool, *args)
