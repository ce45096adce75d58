"""An arm of five joints can't choose where its hand looks: it is asked where it has to look, and grasps, waits and puts down so."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics import inverse
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Cylinder
from kinematics.transforms import Array, angle_between, rotation_about, transform
from planning.grasping.hand_poses import LOWEST_M, lowest_of, usual_lowest
from planning.motion.cell.arm import HALF_TURN, Arm, arm_at
from planning.motion.handling.carry import Done
from planning.motion.handling.object_grasps import headings_of, sampled_grasps
from planning.motion.handling.waiting import places_to_wait
from planning.motion.pick_place import Motions
from planning.scenes.fitting.fit import fit
from planning.scenes.generation import load_spec
from planning.verdict import judge_motions

UP = np.array([0.0, 0.0, 1.0])
LEVEL = np.stack([UP, [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], -1)
CABINET = Cabinet(np.array([0.30, 0.60, 0.40]), transform(p=[0.32, 0.0, 0.10]), 0.02)


def urdf(*, beside_m: float, tilt: float) -> str:
    """Pan, three joints in a plane, roll; the hand is beside the roll's axis and tilted against it, as on small arms."""

    def link(name: str, size: str, z: float) -> str:
        return f'<link name="{name}"><collision><origin xyz="0 0 {z}"/><geometry><box size="{size}"/></geometry></collision></link>'

    def joint(name: str, kind: str, parent: str, child: str, xyz: str, axis: str, limits: tuple[float, float], rpy: str = "0 0 0") -> str:
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
            f'<axis xyz="{axis}"/><limit lower="{limits[0]}" upper="{limits[1]}" velocity="2" effort="9"/></joint>'
        )

    lengths, axes = (0.1, 0.28, 0.28, 0.06, 0.04), ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1")
    links = "".join(link(f"l{i}", f"0.03 0.03 {0.8 * length}", length / 2) for i, length in enumerate(lengths))
    at = ("0 0 0.05", *(f"0 0 {length}" for length in lengths[:4]))
    joints = "".join(joint(f"a{i}", "revolute", f"l{i - 1}" if i else "base", f"l{i}", at[i], axes[i], (-2.6, 2.6)) for i in range(5))
    flange = f'<parent link="l4"/><child link="palm"/><origin xyz="0 {beside_m} 0.04" rpy="{tilt} 0 0"/>'
    hand = f'<joint name="flange" type="fixed">{flange}</joint>{link("palm", "0.02 0.09 0.02", 0.0)}'
    fingers = "".join(
        f'<link name="{name}"><collision><origin xyz="0 {0.004 * side} 0.025"/><geometry><box size="0.014 0.008 0.05"/></geometry>'
        "</collision></link>" + joint(f"f{name}", "prismatic", "palm", name, "0 0 0.012", f"0 {side} 0", (0.0, 0.035))
        for name, side in (("plus", 1), ("minus", -1))
    )
    return f'<robot name="five">{link("base", "0.1 0.1 0.05", 0.025)}{links}{joints}{hand}{fingers}</robot>'


@pytest.fixture(scope="module", params=[(0.0, 0.0), (0.015, 0.0), (0.012, 0.15)], ids=["in line", "beside", "tilted"])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    file = tmp_path_factory.mktemp("five") / "five.urdf"
    file.write_text(urdf(beside_m=request.param[0], tilt=request.param[1]))
    return load(str(file))


@pytest.fixture(scope="module")
def arm(robot: Robot) -> Arm:
    return arm_at(robot, np.eye(4))


@pytest.fixture(scope="module")
def scene(robot: Robot) -> Scene:
    at = CABINET.T_world_cabinet @ transform(p=[0.12, 0.07, 0.07])
    ref = RobotRef(np.eye(4), urdf=robot.name)
    return Scene("s", ref, CABINET, (Body("can", Cylinder(0.018, 0.14), at),), "can", None, 5, ("horizontal",))


def test_a_free_heading_leaves_nothing_but_a_turn_about_the_vertical(arm: Arm) -> None:
    """Inverse kinematics with a free heading gets where the plain one can't, and is exact in everything else."""
    home, rng, solved = arm.robot.arm_q(arm.robot.home), np.random.default_rng(3), 0
    for _ in range(20):
        p, yaw = np.array([rng.uniform(0.3, 0.42), rng.uniform(-0.1, 0.1), rng.uniform(0.12, 0.3)]), rng.uniform(0.4, 0.8)
        T = transform(rotation_about(UP, yaw) @ LEVEL, p)
        assert len(inverse.solve(arm.chain, arm.T_frame_hand, arm.seeds, T, home)) == 0
        for T_wanted in (T, T @ transform(HALF_TURN)):
            for q in arm.headed(np.eye(4), T_wanted, home, 12):
                turn = rotation_about(UP, arm.turned(np.eye(4), T_wanted, q))
                np.testing.assert_allclose(arm.hand_pose(q), transform(turn @ T_wanted[:3, :3], p), atol=1e-5)
                solved += 1
    assert solved > 30


def test_headings_are_where_the_arm_gets(arm: Arm) -> None:
    """The plain inverse kinematics finds each heading that is named, and nothing a degree beside it."""
    headings, home = headings_of(arm), arm.robot.arm_q(arm.robot.home)
    assert headings is not None
    T, width = transform(LEVEL, [0.42, 0.1, 0.2]), 0.03
    found = headings(T, width)
    assert found
    for R in found:
        for turn, there in ((0.0, True), (0.02, False)):
            R_turned = rotation_about(UP, turn) @ R
            at = transform(R_turned, arm.robot.opening.hand_position(T[:3, 3], R_turned, width))
            assert (len(inverse.solve(arm.chain, arm.T_frame_hand, arm.seeds, at, home)) > 0) is there


def test_an_object_is_taken_and_put_down(robot: Robot, scene: Scene) -> None:
    """Whatever the hand is beside or tilted against: the verdict has nothing to say. The object turns with the arm."""
    motions, rng = Motions(robot, scene), np.random.default_rng(0)
    state = motions.start()
    done = next((d for region in (22, 12, 7) if isinstance(d := motions.relocate(state, "can", region, rng), Done)), None)
    assert done is not None, motions.picks(state, "can")[1]
    assert judge_motions(scene, motions.trajectories(state, done.motions), robot) == ()
    T = done.after.poses["can"]
    assert np.hypot(*(T - scene.poses()["can"])[:2, 3]) > 0.05
    assert angle_between(T[:3, :3], np.eye(3)) > 0.05


def test_it_waits_before_the_cabinet(arm: Arm) -> None:
    places = [arm.hand_pose(q) for _, q in zip(range(6), places_to_wait(arm, CABINET))]
    assert len(places) == 6
    for T in places:
        assert T[0, 3] < CABINET.T_world_cabinet[0, 3]
        assert abs(T[2, 2]) < 1e-5


def test_how_low_a_hand_goes_is_measured(robot: Robot, scene: Scene) -> None:
    """No grasp that is sampled has the hand lower than the floor, and a level one comes as low as the hand is thick."""
    lowest = lowest_of(robot)
    assert lowest("horizontal", 0.0) == pytest.approx(0.018, abs=0.006)
    assert lowest("downward", np.pi / 2) < LOWEST_M["downward"] + 0.015
    floor, hand = float(scene.cabinet.T_world_cabinet[2, 3]), [h for h in robot.hulls if h.link in ("palm", "plus", "minus")]
    q = robot.with_arm(np.zeros(5), robot.opening.value_at(robot.opening.max_m / 2))
    poses = robot.link_poses(q)
    T_hand = np.linalg.inv(poses["hand"])
    for grasp in sampled_grasps(robot, scene, "can", scene.poses()["can"], approaches=("horizontal", "diagonal", "downward")):
        T = grasp.T_world_hand @ T_hand
        assert min(_lowest(T @ poses[h.link], h.vertices) for h in hand) > floor


def _lowest(T: Array, vertices: Array) -> float:
    return float((vertices @ T[2, :3] + T[2, 3]).min())


def test_the_named_robots_keep_their_heights(ur5e: Robot) -> None:
    assert lowest_of(ur5e) is usual_lowest


def test_a_cabinet_for_an_arm_of_five_joints_has_no_boxes(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Hardly any box has a side that looks where the arm has to."""
    file = tmp_path_factory.mktemp("fit") / "five.urdf"
    file.write_text(urdf(beside_m=0.0, tilt=0.0))
    fitted = fit(load_spec("paper"), load(str(file)), RobotRef(np.eye(4), urdf=str(file)))
    assert (fitted.alone, fitted.spec.objects_box_share) == ("cylinders", 0.0)
