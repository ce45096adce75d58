"""A cell of one's own: obstacles are kept away from, the arm begins where it is, and home and hand are where the scene says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinematics.collision.fcl_check import Verdict
from kinematics.robots.load import from_ref, load
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene, State
from kinematics.shapes import Box, ConvexMesh, Cylinder, box_corners
from kinematics.transforms import rotation_about, transform
from perception.rendering.synthetic_camera import synthetic_camera
from planning.motion.checking.sampled_motion import samples
from planning.motion.checking.verify import verify
from planning.motion.pick_place import Motions
from planning.plan import Blocked, Plan
from planning.policies import make_policy
from planning.retrieval import retrieve

SIDEWAYS = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
TABLE = Body("table", Box(np.array([1.6, 1.2, 0.04])), transform(p=[-0.55, 0.0, -0.02]))  # the arm stands on it
START = {"shoulder_pan_joint": 0.9, "elbow_joint": 1.9}


@pytest.fixture
def scene() -> Scene:
    """A can alone in the cabinet, as it is taken out straight ahead."""
    can = Body("can", Cylinder(0.025, 0.12), transform(p=[0.55, 0.0, 0.16]))
    cabinet = Cabinet(np.array([0.56, 0.86, 0.5]), transform(p=[0.3, 0.0, 0.1]), 0.03)
    grasp = Grasp(transform(SIDEWAYS, [0.55, 0.0, 0.17]), 0.05)
    return Scene("cell", RobotRef(np.eye(4), "ur5e"), cabinet, (can,), "can", grasp, obstacles=(TABLE,))


def planned(robot: Robot, scene: Scene) -> Plan:
    motions = Motions(robot, scene)
    return retrieve(scene, make_policy("local", motions), motions, name="local", rng=np.random.default_rng(0))


def in_the_way(robot: Robot, free: Plan, scene: Scene) -> Body:
    """A post where the hand's way through the room outside the cabinet passes, when nothing is there."""
    way = next(m for m in free.motions if m.stage == "transit" and len(m.q) > 1 and np.ptp(m.q, axis=0).max() > 0.1)
    rows = samples(robot, scene, way)
    p = robot.link_poses(rows[len(rows) // 3])["hand"][:3, 3]
    return Body("post", Box(np.array([0.04, 0.04, 0.1])), transform(p=p))


@pytest.mark.parametrize("mesh", [False, True])
def test_obstacles_are_avoided(ur5e: Robot, scene: Scene, mesh: bool) -> None:
    """A post where the arm would pass sends it another way; it is seen in the plan's every sample, as an object of its own."""
    scene = replace(scene, robot=replace(scene.robot, q_start=START))
    free = planned(ur5e, scene)
    assert free.success
    post = in_the_way(ur5e, free, scene)
    if mesh:  # of two parts
        half = box_corners(np.array([0.02, 0.02, 0.025]))
        post = replace(post, shape=ConvexMesh((half + np.array([0, 0, 0.025]), half - np.array([0, 0, 0.025]))))
    cell = replace(scene, obstacles=(TABLE, post))
    found = verify(ur5e, cell, free.motions)
    assert found is not None
    assert found.body == "post"
    plan = planned(ur5e, cell)
    assert plan.success
    assert plan.verified
    judge = Verdict(ur5e, replace(scene, objects=(*scene.objects, post), obstacles=()))
    for motion in plan.motions:
        for q in samples(ur5e, scene, motion)[::3]:
            assert not judge.contacts(State(q, {"post": post.T_world_body}, motion.held), motion.allowed_contacts)


def test_the_base_may_stand_on_the_table_and_nothing_else_may_touch_it(ur5e: Robot, scene: Scene) -> None:
    scene = replace(scene, robot=replace(scene.robot, mount=False))  # the table is what it stands on
    motions = Motions(ur5e, scene)
    assert motions.start_blocked() is None
    low = {"shoulder_pan_joint": 3.1, "shoulder_lift_joint": -0.05, "elbow_joint": 0.9}
    down = replace(scene, robot=replace(scene.robot, q_start=low))
    blocked = Motions(ur5e, down).start_blocked()
    assert blocked is not None
    assert (blocked.stage, blocked.body) == ("transit", "table")
    assert Motions(ur5e, replace(down, obstacles=())).start_blocked() != blocked
    contacts = Verdict(ur5e, down).contacts(State(Motions(ur5e, down).start().q, scene.poses()))
    assert "table" in {c.b for c in contacts}


def test_obstacles_in_the_cabinet_take_room(ur5e: Robot, scene: Scene) -> None:
    """No object is put where an obstacle stands."""
    block = Body("block", Box(np.array([0.2, 0.2, 0.1])), transform(p=[0.7, 0.25, 0.15]))
    motions = Motions(ur5e, replace(scene, obstacles=(block,)))
    region = int(np.argmin(np.linalg.norm(scene.regions() - [0.7, 0.25, 0.1], axis=1)))
    T = motions.place_pose("can", scene.objects[0].T_world_body, region)
    touch = motions.cell.placed(scene.objects[0], T, {})
    assert touch is not None
    assert touch.body == "block"
    assert Motions(ur5e, scene).cell.placed(scene.objects[0], T, {}) is None


def test_the_plan_begins_where_the_arm_is(ur5e: Robot, scene: Scene) -> None:
    scene = replace(scene, robot=replace(scene.robot, q_start={**START, "finger_joint": 0.3}))
    plan = planned(ur5e, scene)
    assert plan.success
    wanted = dict(zip(ur5e.joint_names, ur5e.home)) | START | {"finger_joint": 0.3}
    np.testing.assert_allclose(plan.motions[0].q[0], [wanted[name] for name in ur5e.joint_names], atol=1e-12)
    elsewhere = verify(ur5e, replace(scene, robot=replace(scene.robot, q_start={"elbow_joint": 2.0})), plan.motions)
    assert elsewhere is not None
    assert "does not begin where" in str(elsewhere)


@pytest.mark.parametrize(
    ("start", "says"),
    [
        ({"elbow_joint": 3.5}, "transit (at the start, joint elbow_joint is at 3.5, outside its limits -3.142 to 3.142 (rad, or m))"),
        ({"shoulder_lift_joint": 0.0, "elbow_joint": 0.0}, "transit: wrist_3_link touches floor (at the start)"),
    ],
)
def test_a_start_that_can_not_be_is_said(ur5e: Robot, scene: Scene, start: dict[str, float], says: str) -> None:
    plan = planned(ur5e, replace(scene, robot=replace(scene.robot, q_start=start)))
    assert not plan.success
    assert not plan.motions
    assert isinstance(plan.reason, Blocked)
    assert str(plan.reason) == says


def test_joints_that_are_none(ur5e: Robot, scene: Scene) -> None:
    with pytest.raises(ValueError, match=r"robot ur5e: q_start: there is no joint 'elbow' \(did you mean 'elbow_joint'\?\)"):
        Motions(ur5e, replace(scene, robot=replace(scene.robot, q_start={"elbow": 1.0}))).start_blocked()
    with pytest.raises(ValueError, match="robot ur5e: home: there is no joint 'arm_1'"):
        from_ref(replace(scene.robot, home={"arm_1": 1.0}))
    with pytest.raises(ValueError, match="robot ur5e: at home, joint elbow_joint is at 4, outside its limits"):
        from_ref(replace(scene.robot, home={"elbow_joint": 4.0}))


def test_home_is_where_the_scene_says(ur5e: Robot, scene: Scene) -> None:
    """The arm waits there, and the same scene twice has the same robot, for what is known of it to be found again."""
    ref = replace(scene.robot, home={"shoulder_pan_joint": 0.4, "finger_joint": 0.2})
    robot = from_ref(ref)
    assert robot is from_ref(replace(ref, home=dict(ref.home or {})))
    changed = {name: q for name, q, old in zip(robot.joint_names, robot.home, ur5e.home) if q != old}
    assert changed == {"shoulder_pan_joint": 0.4, "finger_joint": 0.2}
    np.testing.assert_array_equal(Motions(robot, replace(scene, robot=ref)).start().q, robot.home)


def test_the_hand_is_where_the_scene_says(ur5e: Robot, toy_urdf: Callable[..., Path]) -> None:
    T = transform(rotation_about((0, 0, 1), np.pi), [0.0, 0.001, 0.002])
    for plain, moved in (
        (ur5e, load("ur5e", T_link_hand=T)),
        (load(str(toy_urdf()), "tcp", "grip"), load(str(toy_urdf()), "palm", "grip", T_link_hand=transform(p=[0, 0, 0.08]) @ T)),
    ):
        hand, new = plain.link_poses(plain.home)["hand"], moved.link_poses(plain.home)["hand"]
        np.testing.assert_allclose(hand @ T, new, atol=1e-9)
    with pytest.raises(ValueError, match="y the way they close: say T_link_hand so"):
        load(str(toy_urdf()), "tcp", "grip", T_link_hand=transform(rotation_about((0, 0, 1), np.pi / 2)))


def test_gripper_joints(toy_urdf: Callable[..., Path]) -> None:
    file = str(toy_urdf())
    robot = load(file, "tcp", gripper_joints=("grip",))
    assert robot.joint_names[robot.gripper_joint] == "grip"
    with pytest.raises(ValueError, match="gripper_joint 'grip' is not among its gripper_joints"):
        load(file, "tcp", "grip", gripper_joints=("up",))
    with pytest.raises(ValueError, match="its gripper is opened by 'finger_joint', not by 'grip'"):
        load("ur5e", gripper_joints=("grip",))


def test_obstacles_hide_what_is_behind_them(ur5e: Robot, scene: Scene) -> None:
    T = transform(SIDEWAYS @ rotation_about((0, 0, 1), -np.pi / 2), [0.1, 0.0, 0.2])  # before the cabinet, looking in
    screen = Body("screen", Box(np.array([0.01, 0.3, 0.3])), transform(p=[0.28, 0.0, 0.25]))
    seen = synthetic_camera(ur5e, scene, scene.poses())(T, ur5e.home)
    hidden = synthetic_camera(ur5e, replace(scene, obstacles=(screen,)), scene.poses())(T, ur5e.home)
    assert (seen.instance == 0).any()
    assert not (hidden.instance == 0).any()
    centre = tuple(n // 2 for n in hidden.depth.shape)
    if not (hidden.arm is not None and hidden.arm[centre]):
        assert hidden.depth[centre] == pytest.approx(0.175, abs=1e-3)
