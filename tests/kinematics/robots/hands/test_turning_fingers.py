"""Two fingers that turn as they open: what is round is between them, touched where they lean; parallel ones take boxes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from six_joints import arm, box, joint

from kinematics.robots.hands.gripper import MOST_SLANT
from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, apply, inverse, rotation_about, transform
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.verdict import judge_motions
from planning.verdict.grasp import judge_hold

CABINET = Cabinet(np.array([0.40, 0.70, 0.45]), transform(p=[0.35, 0.0, 0.15]), 0.02)
LEVEL = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""A hand whose z is along the world's x, its x down."""


def fingers(*, parallel: bool = False) -> str:
    """Two fingers, 130 mm long, that turn about the palm's edges by 0.7 rad; parallel: their tips turn back as far."""
    out = ""
    for name, side in (("left", 1), ("right", -1)):
        out += f'<link name="{name}">{box("0.02 0.012 0.06", f"0 {0.006 * side} 0.03")}</link>'
        out += f'<link name="{name}_tip">{box("0.02 0.012 0.07", f"0 {0.006 * side} 0.035")}</link>'
        out += joint(f"f_{name}", "revolute", "palm", name, f"0 {0.002 * side} 0.01", f"{-side} 0 0", (0.0, 0.7))
        out += joint(f"t_{name}", "revolute" if parallel else "fixed", name, f"{name}_tip", "0 0 0.06", f"{side} 0 0", (0.0, 0.7))
        if parallel:
            out = out[: -len("</joint>")] + f'<mimic joint="f_{name}"/></joint>'
    return out


@pytest.fixture
def robot(tmp_path: Path) -> Callable[[str], Robot]:
    def make(hand: str) -> Robot:
        (tmp_path / "r.urdf").write_text(arm(hand))
        return load(str(tmp_path / "r.urdf"))

    return make


def _nearest(robot: Robot, width: float, side: int) -> tuple[float, Array]:
    """How far a can of a width, between the pads, is from the fingers on one side, and the direction (2,) of the nearest of them from its
    axis, along the hand's y and z: by many points on the fingers' faces, not by what measured the opening."""
    q = robot.home.copy()
    q[robot.gripper_joint] = robot.opening.value_at(width)
    poses, rng, points = robot.link_poses(q), np.random.default_rng(0), []
    for hull in (h for h in robot.hulls if h.link in robot.fingers):
        corners = apply(inverse(poses["hand"]) @ poses[hull.link], hull.vertices)
        if corners[:, 1].mean() * side > 0:
            shares = rng.dirichlet(np.ones(3), (len(hull.faces), 20_000))
            points.append(np.einsum("fnk,fkc->fnc", shares, corners[hull.faces]).reshape(-1, 3))
    from_axis = np.concatenate(points)[:, 1:] - [robot.opening.pad_y_at(width), robot.opening.pad_z_at(width)]
    off = np.linalg.norm(from_axis, axis=1)
    at = int(np.argmin(off))
    return float(off[at] - width / 2), from_axis[at] / off[at]


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 1.0])
def test_a_can_touches_both_fingers_where_they_lean_little(share: float, robot: Callable[[str], Robot]) -> None:
    made = robot(fingers())
    assert made.opening.round_only
    assert made.opening.max_m > 0.04
    width = share * made.opening.max_m
    for side in (1, -1):
        gap, direction = _nearest(made, width, side)
        assert gap == pytest.approx(0.0, abs=3e-4)
        assert np.arccos(abs(direction[0])) <= MOST_SLANT + np.radians(2)


def test_the_verdict_accepts_such_a_can_and_no_other_width(robot: Callable[[str], Robot]) -> None:
    """One as thick as the grasp says is held; one that is 2 mm thinner is not touched, one that is 4 mm thicker is deep in the fingers."""
    made = robot(fingers())
    for width in (0.016, 0.03, 0.9 * made.opening.max_m):
        grasp = Grasp(transform(LEVEL, made.opening.hand_position(np.zeros(3), LEVEL, width)), width)
        cans = (Body("can", Cylinder((width + more) / 2, 0.08), np.eye(4)) for more in (0.0, -0.002, 0.004))
        held, thin, thick = (judge_hold(made, can, grasp) for can in cans)
        assert held is None
        assert "before can" in (thin or "")
        assert "inside can" in (thick or "")


def test_a_can_is_taken_and_put_down(robot: Callable[[str], Robot]) -> None:
    made = robot(fingers())
    T = CABINET.T_world_cabinet @ transform(rotation_about((0, 0, 1), 0.1), [0.15, 0.08, 0.06])
    ref, can = replace(to_ref(made), T_world_base=np.eye(4)), Body("it", Cylinder(0.018, 0.12), T)
    scene = Scene("s", ref, CABINET, (can,), "it", None, 6)
    motions, rng = Motions(made, scene, target_grasps=()), np.random.default_rng(1)
    state = motions.start()
    done = next((d for region in (8, 14, 20) if isinstance(d := motions.relocate(state, "it", region, rng), Done)), None)
    assert done is not None, motions.picks(state, "it")[1]
    assert judge_motions(scene, motions.trajectories(state, done.motions), made) == ()


def test_fingers_that_stay_parallel_take_boxes(robot: Callable[[str], Robot]) -> None:
    made = robot(fingers(parallel=True))
    assert not made.opening.round_only
    width = 0.5 * made.opening.max_m
    grasp = Grasp(transform(LEVEL, made.opening.hand_position(np.zeros(3), LEVEL, width)), width)
    assert judge_hold(made, Body("box", Box(np.array([0.03, width, 0.08])), np.eye(4)), grasp) is None
