"""x_g is judged before anything is moved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import SIDEWAYS

from kinematics.robots.load import load, to_ref
from kinematics.robots.named import installed
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import rotation_about, transform
from planning.io.files import read_scenes
from planning.scenes.generation import generate, load_spec
from planning.verdict import judge_grasp
from planning.verdict.grasp import closing_value
from planning.verdict.hand import hand_of

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.30, 0.0, 0.10]), 0.03)
CAN = Body("can_1", Cylinder(0.025, 0.12), transform(p=[0.66, 0.0, 0.16]))
X_G = Grasp(transform(SIDEWAYS, CAN.T_world_body[:3, 3]), 0.05)


def scene(grasp: Grasp | None = X_G, body: Body = CAN, **more: object) -> Scene:
    return replace(Scene("s", RobotRef(np.eye(4), "ur5e"), CABINET, (body,), body.name, grasp), **more)  # type: ignore[arg-type]


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0, width: float = 0.05) -> Grasp:
    return Grasp(X_G.T_world_hand @ transform(p=[x, y, z]), width)


def test_a_grasp_that_holds_is_fine(ur5e: Robot) -> None:
    assert judge_grasp(ur5e, scene()) is None
    assert judge_grasp(ur5e, scene(None)) is None


@pytest.mark.parametrize(
    ("grasp", "word"),
    [
        (moved(x=0.21), "x_g does not hold can_1: the pads close 1"),
        (moved(y=0.01), "10.0 mm"),
        (moved(width=0.12), "the grasp is 120 mm wide, and the gripper opens 86 mm"),
        (moved(width=1e300), "the gripper opens 86 mm"),
        (moved(width=0.054), "stops 2.0 mm before can_1"),
        (moved(width=0.044), "3.0 mm inside can_1"),
        (moved(z=1e300), "1e+300 m away"),
        (Grasp(X_G.T_world_hand @ transform(rotation_about((0, 0, 1), np.pi / 2)), 0.05), "inside can_1"),
    ],
)
def test_what_does_not_hold_is_said(ur5e: Robot, grasp: Grasp, word: str) -> None:
    found = judge_grasp(ur5e, scene(grasp))
    assert found is not None
    assert word in found
    assert "\n" not in found


def test_the_rest_of_the_hand_is_not_in_the_target(ur5e: Robot) -> None:
    """A deep box whose far end the pads reach: the palm would be in it."""
    deep = Body("box", Box(np.array([0.30, 0.05, 0.12])), transform(p=[0.60, 0.0, 0.16]))
    near = Grasp(transform(SIDEWAYS, [0.46, 0.0, 0.16]), 0.05)
    far = Grasp(transform(SIDEWAYS, [0.62, 0.0, 0.16]), 0.05)
    assert judge_grasp(ur5e, scene(near, deep)) is None
    found = judge_grasp(ur5e, scene(far, deep)) or ""
    assert "would touch the target itself" in found
    assert found.startswith("x_g does not hold box: ")


def test_the_hand_is_not_in_a_wall_nor_in_an_obstacle(ur5e: Robot) -> None:
    aside = replace(CAN, T_world_body=transform(p=[0.66, 0.40, 0.16]))
    grasp = Grasp(transform(SIDEWAYS, aside.T_world_body[:3, 3]), 0.05)
    assert "inside the left" in (judge_grasp(ur5e, scene(grasp, aside)) or "")
    post = Body("post", Box(np.array([0.02, 0.02, 0.3])), transform(p=[0.55, 0.0, 0.25]))
    assert "inside post" in (judge_grasp(ur5e, scene(obstacles=(post,))) or "")


def test_of_what_was_not_seen_only_hand_and_cabinet_are_judged(ur5e: Robot) -> None:
    assert judge_grasp(ur5e, scene(moved(x=0.1)), unseen=True) is None
    assert judge_grasp(ur5e, scene(moved(width=0.12)), unseen=True) is not None
    assert judge_grasp(ur5e, replace(scene(), objects=()), unseen=True) is None


def test_another_grasp_than_the_scenes(ur5e: Robot) -> None:
    assert judge_grasp(ur5e, scene(), moved(x=0.21)) is not None
    assert judge_grasp(ur5e, scene(moved(x=0.21)), X_G) is None


@pytest.mark.parametrize("name", ["02_plum_behind_cylinders", "03_banana_at_the_left_wall"])
def test_examples_hold(ur5e: Robot, name: str) -> None:
    for _, example in read_scenes(EXAMPLES / f"{name}.jsonl"):
        assert judge_grasp(ur5e, example) is None


@pytest.mark.parametrize("name", ["ur5e", "panda", "gen3"])
@pytest.mark.parametrize("spec", ["paper", "paper-any", "shelf"])
def test_generated_scenes_hold(name: str, spec: str) -> None:
    """As they are sampled, before `gen` asks: what it asks for throws none of them away."""
    if not installed(name):
        pytest.skip(f"the package of {name} is not installed")
    robot = load(name)
    ref = to_ref(robot)
    for index in range(2):
        assert judge_grasp(robot, generate(load_spec(spec), robot, ref, 77, index)) is None


def test_fingers_close_to_the_width_asked(robot: Robot) -> None:
    hand = hand_of(robot)
    for width in np.linspace(hand.widths[0] + 1e-4, hand.max_width_m, 7):
        assert hand.width(np.array([closing_value(hand, float(width))]))[0] == pytest.approx(width, abs=2e-6)
