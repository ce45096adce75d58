"""A robot's other arm is put aside where it would stand in the cabinet's way, and nothing else is."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from six_joints import box

from kinematics.collision.fcl_solids import hull_solid, touch
from kinematics.robots.load import forget, load
from kinematics.robots.robot import Robot
from kinematics.scene import Cabinet, RobotRef, Scene
from kinematics.transforms import transform
from planning.motion.cell.arm import arm_at
from planning.motion.cell.workcell import Workcell
from planning.motion.handling import waiting
from planning.motion.handling.waiting import places_to_wait, touching_anywhere
from planning.motion.settings import UNCONSTRAINED
from planning.scenes.fitting.aside import AHEAD_M, aside
from planning.scenes.fitting.fit import fit
from planning.scenes.generation import NoScene, load_spec


def _joint(name: str, kind: str, parent: str, child: str, at: str, axis: str, least: float, most: float) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin {at}/><axis xyz="{axis}"/>'
        f'<limit lower="{least}" upper="{most}" velocity="1" effort="1"/></joint>'
    )


def _arm(side: str, at: str) -> str:
    """Six joints, fingers that open 80 mm; at 0 it is stretched out ahead."""
    names = [f"{side}{i}" for i in range(6)]
    links = "".join(f'<link name="{name}">{box("0.05 0.05 0.15", "0 0 0.09")}</link>' for name in names[:-1])
    links += f'<link name="{names[-1]}">{box("0.04 0.1 0.04", "0 0 0.03")}</link>'
    joints = "".join(
        _joint(
            f"j{name}",
            "revolute",
            names[i - 1] if i else "trunk",
            name,
            at if i == 0 else 'xyz="0 0 0.2"',
            f"0 {i % 2} {1 - i % 2}",
            -2.5,
            2.5,
        )
        for i, name in enumerate(names)
    )
    for f, y in (("f", 1), ("g", -1)):
        links += f'<link name="{side}{f}">{box("0.02 0.01 0.05", f"0 {0.005 * y} 0.025")}</link>'
        joints += _joint(f"j{side}{f}", "prismatic", names[-1], side + f, 'xyz="0 0 0.05"', f"0 {y} 0", 0.0, 0.04)
    return links + joints


def _robot(tmp_path: Path, other: str, more: str = "") -> Robot:
    """A trunk on a lift with an arm on its left, and another, or none, on its right."""
    base = f'<link name="base">{box("0.3 0.3 0.1", "0 0 0.05")}</link><link name="trunk">{box("0.2 0.2 0.4", "0 0 0.2")}</link>'
    lift = _joint("lift", "prismatic", "base", "trunk", 'xyz="0 0 0.3"', "0 0 1", 0.0, 0.3)
    left = _arm("left", 'xyz="0 0.2 0.3" rpy="0 1.5707963 0"')
    right = _arm("right", f'xyz="0 -0.2 0.3" rpy="{other}"') if other else ""
    file = tmp_path / "two.urdf"
    file.write_text(f'<robot name="two">{base}{lift}{left}{right}{more}</robot>')
    return load(str(file), gripper_joint="jleftf" if other else None)


def _reach(robot: Robot, values: dict[str, float], of: str) -> float:
    q = robot.home.copy()
    for name, value in values.items():
        q[robot.joint_names.index(name)] = value
    poses = robot.link_poses(q)
    return max(
        float((h.vertices @ poses[h.link][:3, :3].T + poses[h.link][:3, 3])[:, 0].max()) for h in robot.hulls if h.link.startswith(of)
    )


@pytest.fixture(scope="module")
def stretched(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return _robot(tmp_path_factory.mktemp("two"), "0 1.5707963 0")


@pytest.fixture(scope="module")
def folded(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """At the lower ends of their joints' ranges links of the right arm lie in each other, as in Kinova's example of two."""
    robot = _robot(tmp_path_factory.mktemp("folded"), "0 -1.5707963 0")
    text = Path(robot.name).read_text()
    for joint, least in (("jright1", 1.75), ("jright3", 2.45)):
        text = re.sub(rf'(name="{joint}".*?lower=")-2.5(")', rf"\g<1>{least}\2", text, count=1)
    third = f'<link name="right3">{box("0.05 0.05 0.15", "0 0 0.09")}'
    assert third in text
    text = text.replace(third, f'<link name="right3">{box("0.3 0.05 0.5", "0 0 0.25")}')
    Path(robot.name).write_text(text)
    forget()
    return load(robot.name, gripper_joint="jleftf")


def test_an_arm_that_touches_itself_at_home_is_put_aside(folded: Robot) -> None:
    q = folded.home.copy()
    poses = folded.link_poses(q)
    a, b = (next(hull_solid(h.link, h.vertices, h.faces) for h in folded.hulls if h.link == link) for link in ("right0", "right3"))
    assert touch(a.move(poses["right0"]), b.move(poses["right3"])) is not None
    values = aside(folded, 0.0)
    assert set(values) == {f"jright{i}" for i in range(6)}


def test_nothing_begins_while_another_arm_touches_itself(folded: Robot) -> None:
    """The verdict would find that in every motion; no plan moves that arm, and the words say what does."""
    cabinet = Cabinet(np.array([0.5, 0.8, 0.4]), transform(p=[0.45, 0.0, 0.45]), 0.03)
    scene = Scene("before it", RobotRef(np.eye(4), urdf=folded.name, gripper_joint="jleftf"), cabinet, (), None, None)
    cell = Workcell(folded, scene, iterations=1, time_budget_s=None, settings=UNCONSTRAINED)
    blocked = waiting.start_blocked(cell)
    assert blocked is not None
    assert blocked.link is not None
    assert blocked.body is not None
    assert {blocked.link[:5], blocked.body[:5]} == {"right"}
    assert re.search(r"at home, and no plan moves jright\d.*: say in the scene's robot.home where they are", str(blocked))
    moved = load(folded.name, gripper_joint="jleftf", home=aside(folded, 0.0))
    assert waiting.start_blocked(Workcell(moved, scene, iterations=1, time_budget_s=None, settings=UNCONSTRAINED)) is None


def test_an_arm_that_is_stretched_ahead_is_put_aside_and_the_working_arm_then_finds_where_to_wait(stretched: Robot) -> None:
    values = aside(stretched, 0.0)
    assert set(values) == {f"jright{i}" for i in range(6)}  # not its fingers
    assert values == aside(stretched, 0.0)
    assert _reach(stretched, {}, "right") > 1.0
    assert _reach(stretched, values, "right") < 0.15 + AHEAD_M  # the base ends 0.15 m ahead
    cabinet = Cabinet(np.array([0.5, 0.8, 0.4]), transform(p=[0.45, 0.0, 0.45]), 0.03)
    moved = load(stretched.name, gripper_joint="jleftf", home=values)
    assert not list(places_to_wait(arm_at(stretched, np.eye(4)), cabinet))
    assert len(list(places_to_wait(arm_at(moved, np.eye(4)), cabinet))) > 5
    scene = Scene("before it", RobotRef(np.eye(4), urdf=stretched.name, gripper_joint="jleftf"), cabinet, (), None, None)
    cell = Workcell(stretched, scene, iterations=1, time_budget_s=None, settings=UNCONSTRAINED)
    with pytest.raises(
        ValueError, match=r"at home, right\d touches .*, and no plan moves jright0.*: say in the scene's robot.home where they are"
    ):
        waiting.home(cell)


def test_what_is_put_aside_touches_neither_itself_nor_the_trunk_nor_the_ground(stretched: Robot) -> None:
    moved = load(stretched.name, gripper_joint="jleftf", home=aside(stretched, 0.0))
    q = moved.home.copy()
    q[moved.joint_names.index("lift")] = 0.15
    poses = moved.link_poses(q)
    solids = [hull_solid(h.link, h.vertices, h.faces).move(poses[h.link]) for h in moved.hulls if not h.link.startswith("left")]
    fingers = {"rightf", "rightg"}
    for k, a in enumerate(solids):
        for b in solids[:k]:
            if frozenset((a.name, b.name)) not in moved.skip and {a.name, b.name} != fingers:
                assert touch(a, b) is None, (a.name, b.name)
    assert min(float((poses[h.link] @ [*v, 1.0])[2]) for h in moved.hulls for v in h.vertices) >= -1e-9


def test_an_arm_that_hangs_beside_the_trunk_stays_and_so_does_what_carries_the_robot(tmp_path: Path) -> None:
    assert aside(_robot(tmp_path, "3.1415926 0 0"), 0.0) == {}
    foot = f'<link name="leg">{box("0.6 0.05 0.05", "0.3 0 -0.1")}</link>'
    leg = _joint("hip", "revolute", "base", "leg", 'xyz="0 0.2 0"', "0 1 0", -1.0, 1.0)
    assert aside(_robot(tmp_path, "", foot + leg), 0.0) == {}


def test_links_that_touch_wherever_the_arm_is_are_named_with_what_mends_it(tmp_path: Path) -> None:
    """A bellows of Fetch's torso has a joint that no plan moves, and lies in what the torso is on: no arm could wait anywhere."""
    cover = f'<link name="cover">{box("0.05 0.05 0.9", "0 0 -0.4")}</link>'
    cover += _joint("slide", "prismatic", "trunk", "cover", 'xyz="-0.1 0 0"', "0 1 0", 0.0, 1.5)
    robot = _robot(tmp_path, "", cover)
    with pytest.raises(
        NoScene, match=r"wherever the arm is, base touches cover, and no plan moves slide: say .*<disable_collisions link1="
    ) as e:
        fit(load_spec("paper-any"), robot, RobotRef(np.eye(4), urdf=robot.name))
    cabinet = Cabinet(np.array([0.5, 0.8, 0.4]), transform(p=[0.45, 0.0, 0.45]), 0.03)
    scene = Scene("before it", RobotRef(np.eye(4), urdf=robot.name), cabinet, (), None, None)
    with pytest.raises(ValueError, match="no place to wait before this cabinet: at home, wherever the arm is, base touches cover"):
        waiting.home(Workcell(robot, scene, iterations=1, time_budget_s=None, settings=UNCONSTRAINED))
    srdf = re.search("<disable.*/>", str(e.value))
    assert srdf is not None
    Path(robot.name).with_suffix(".srdf").write_text(f'<robot name="two">{srdf[0]}</robot>')
    forget()
    mended = load(robot.name)
    assert touching_anywhere(mended) is None
    assert list(places_to_wait(arm_at(mended, np.eye(4)), cabinet))


def test_links_without_a_standing_joint_between_are_not_asked(ur5e: Robot) -> None:
    assert touching_anywhere(ur5e) is None
