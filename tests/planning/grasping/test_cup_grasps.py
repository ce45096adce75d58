"""A suction cup takes what has a face for it: sampled, judged by its own rule, planned, carried and put down."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import rotation_about, transform
from planning.grasping.cup_grasps import EDGE_M, grasps_on
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.verdict import judge_grasp, judge_motions
from planning.verdict.cup import cup_faults, lines, met
from planning.verdict.faults import Settings
from planning.verdict.hand import Pad, hand_of
from planning.verdict.polyhedra import Window, polyhedra

UP = (0.0, 0.0, 1.0)
CABINET = Cabinet(np.array([0.40, 0.70, 0.45]), transform(p=[0.35, 0.0, 0.15]), 0.02)
BOX, CAN = Box(np.array([0.05, 0.06, 0.14])), Cylinder(0.03, 0.12)
FOOT = box_corners(np.array([0.03, 0.03, 0.02])) + np.array([0.06, 0.0, -0.04])
L_SHAPE = ConvexMesh((box_corners(np.array([0.03, 0.03, 0.06])), FOOT), "l", 1.0)
ANGLE = 2 * np.pi * np.arange(24) / 24
PAD = Pad("cup", 0, 0, np.eye(4), Window(0.01 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], -1)))
ASKED = Settings()


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Six joints and a cup."""
    lengths, axes = (0.12, 0.35, 0.20, 0.15, 0.06, 0.05), ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    text = '<robot name="six"><link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>'
    for i, (length, axis) in enumerate(zip(lengths, axes)):
        at = f"0 0 {lengths[i - 1] if i else 0.05}"
        text += f'<link name="l{i}"><collision><origin xyz="0 0 {length / 2}"/>'
        text += f'<geometry><box size="0.04 0.04 {0.8 * length}"/></geometry></collision></link>'
        text += f'<joint name="a{i}" type="revolute"><parent link="{f"l{i - 1}" if i else "base"}"/><child link="l{i}"/>'
        text += f'<origin xyz="{at}"/><axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="2" effort="9"/></joint>'
    solid = '<origin xyz="0 0 0.02"/><geometry><cylinder radius="0.012" length="0.04"/></geometry>'
    text += f'<link name="cup"><collision>{solid}</collision></link>'
    text += '<joint name="c" type="fixed"><parent link="l5"/><child link="cup"/><origin xyz="0 0 0.05"/></joint></robot>'
    file = tmp_path_factory.mktemp("six") / "six.urdf"
    file.write_text(text)
    return load(str(file))


def scene_of(robot: Robot, *shapes: Shape) -> Scene:
    """Objects in a row across the cabinet, each turned a little; the first is the target."""
    bodies = []
    for i, shape in enumerate(shapes):
        T = CABINET.T_world_cabinet @ transform(rotation_about(UP, 0.3 - 0.2 * i), [0.2, 0.18 * i, shape.half[2]])
        bodies.append(Body(f"it_{i}", shape, T))
    return Scene("s", RobotRef(np.eye(4), urdf=robot.name), CABINET, tuple(bodies), "it_0", None, 6)


# ----------------------------------------------------------------------------------------------------------------------- the verdict's rule


@pytest.mark.parametrize(
    ("p", "tilt", "says"),
    [
        ((0.0, 0.0, 0.0002), 0.0, None),
        ((0.013, 0.0, 0.0002), 0.0, None),
        ((0.0, 0.0, -0.0008), 0.0, None),
        ((0.017, 0.0, 0.0002), 0.0, "does not lie on it whole"),
        ((0.0, 0.0, 0.0007), 0.0, "stops 0.7 mm before it"),
        ((0.0, 0.0, -0.0015), 0.0, "is 1.5 mm inside it"),
        ((0.0, 0.0, 0.0001), 0.02, None),
        ((0.0, 0.0, 0.0), 0.06, "stops 0.6 mm before it"),
        ((0.2, 0.0, 0.0), 0.0, "is beside it"),
    ],
)  # fmt: skip
def test_a_cup_on_a_face(p: tuple[float, float, float], tilt: float, says: str | None) -> None:
    """At a box's face, moved by p from it and tilted about the cup's middle."""
    T = transform(p=[*p[:2], 0.0]) @ transform(rotation_about((1.0, 0.0, 0.0), tilt)) @ transform(p=[0.0, 0.0, BOX.half[2] + p[2]])
    found = cup_faults(PAD, np.eye(4), polyhedra(BOX), T, "it", "grasp", ASKED)
    assert ([] if says is None else [f"cup {says}"]) == [f.detail.split(":")[0] for f in found]


def test_a_small_cup_may_not_be_askew_either() -> None:
    """Though its lip is near everywhere."""
    small = replace(PAD, window=Window(0.2 * PAD.window.corners))
    T = transform(rotation_about((1.0, 0.0, 0.0), 0.15)) @ transform(p=[0.0, 0.0, BOX.half[2] + 0.0001])
    (fault,) = cup_faults(small, np.eye(4), polyhedra(BOX), T, "it", "grasp", ASKED)
    assert "9\u00b0 askew" in fault.detail


@pytest.mark.parametrize(("radius", "held"), [(0.03, False), (0.09, False), (0.3, True)])
def test_a_curved_side_is_held_where_it_hardly_falls_away(radius: float, held: bool) -> None:
    T = transform(rotation_about((1.0, 0.0, 0.0), np.pi / 2), [0.0, 0.0, radius + 0.0002])
    found = cup_faults(PAD, np.eye(4), polyhedra(Cylinder(radius, 0.2)), T, "it", "grasp", ASKED)
    assert (not found) is held


def test_what_lines_meet_is_what_points_are_in() -> None:
    """On random boxes: just before where a line enters no part holds the point, just behind one does."""
    rng, points = np.random.default_rng(5), lines(PAD.window.corners)
    for _ in range(30):
        axis = rng.normal(size=3)
        T = transform(rotation_about(tuple(axis / np.linalg.norm(axis)), rng.uniform(0, 3)), [*rng.uniform(-0.02, 0.02, 2), 0.06])
        parts = [part.moved(T) for part in polyhedra(Box(rng.uniform(0.02, 0.08, 3)))]
        gap, normal = met(points, parts)
        seen = np.isfinite(gap)
        for step, inside in ((1e-7, True), (-1e-7, False)):
            at = np.c_[points[seen], gap[seen] + step]
            assert ((at @ parts[0].planes[:, :3].T <= parts[0].planes[:, 3] + 1e-12).all(1) == inside).all()
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)
        assert (normal[seen, 2] < 0).all()


# ----------------------------------------------------------------------------------------------------------------------------------- grasps


@pytest.mark.parametrize("shape", [BOX, CAN, L_SHAPE, Box(np.array([0.02, 0.09, 0.12]))], ids=["box", "can", "mesh", "board"])
def test_every_sampled_grasp_of_a_solid_holds(shape: Shape, robot: Robot) -> None:
    """The verdict accepts each in the empty cabinet, but for those that the cabinet blocks; of a mesh some faces are too small."""
    scene = scene_of(robot, shape)
    body = scene.target_body
    found = list(grasps_on(body, robot, APPROACHES, 0.15, 0.0))
    assert found
    wrong = [w for g in found if (w := judge_grasp(robot, scene, g)) is not None and "can't be reached" not in w]
    assert not wrong if not isinstance(shape, ConvexMesh) else len(wrong) < len(found)
    level = [g for g in found if abs(g.T_world_hand[2, 2]) < 1e-6]
    if shape is CAN:
        assert not level
    for grasp in found:
        T = np.linalg.inv(body.T_world_body) @ grasp.T_world_hand
        beyond = np.abs(T[:3, 3]) - shape.half
        if isinstance(shape, Box):
            assert beyond.max() == pytest.approx(0.0, abs=1e-9)
            assert np.sort(beyond)[1] <= -(robot.opening.cup_m / 2 + EDGE_M) + 1e-9


def test_what_is_too_small_for_the_cup_has_no_grasps(robot: Robot) -> None:
    thin = Box(np.array([0.02, 0.02, 0.02]))
    assert not list(grasps_on(scene_of(robot, thin).target_body, robot, APPROACHES, 0.15, 0.0))


# ------------------------------------------------------------------------------------------------------------------------------------ plans


def test_boxes_and_cans_are_taken_and_put_down(robot: Robot) -> None:
    """The verdict has nothing to say of it; and much, once the vacuum goes off on the way, or the cup was elsewhere."""
    scene = scene_of(robot, BOX, CAN)
    motions, rng = Motions(robot, scene, target_grasps=()), np.random.default_rng(1)
    state = motions.start()
    assert hand_of(robot).pads[0].link == "cup"
    for name in ("it_0", "it_1"):
        done = next((d for region in (8, 14, 20, 9, 15) if isinstance(d := motions.relocate(state, name, region, rng), Done)), None)
        assert done is not None, motions.picks(state, name)[1]
        smooth = motions.trajectories(state, done.motions)
        assert judge_motions(scene, smooth, robot) == ()
        valve = robot.joint_names.index("suction")
        carried = next(i for i, m in enumerate(smooth) if m.stage == "transfer")
        off = smooth[carried].q.copy()
        off[len(off) // 2 :, valve] = 0.0
        assert judge_motions(scene, [*smooth[:carried], replace(smooth[carried], q=off), *smooth[carried + 1 :]], robot)
        moved = [
            replace(m, held=replace(m.held, T_hand_body=transform(p=[0.0, 0.0, 0.02]) @ m.held.T_hand_body)) if m.held else m
            for m in smooth
        ]
        assert any(f.stage in ("grasp", "lift") for f in judge_motions(scene, moved, robot))
