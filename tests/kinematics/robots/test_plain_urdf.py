"""Plain numpy kinematics from the URDF agree with the compiled ones, and with pytorch-kinematics; limits and hands are read right."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import random_q

from kinematics.robots.batched_fk import Forward
from kinematics.robots.plain_urdf import poses, read
from kinematics.robots.robot import Robot
from kinematics.transforms import rotation_about, transform

T_BASE = transform(rotation_about((0.3, -0.2, 1.0), 0.7), [0.1, -0.4, 0.2])


def link_poses(robot: Robot, q: np.ndarray) -> dict[str, np.ndarray]:
    """Every link in the world, by the verdict's kinematics, q over the robot's joints."""
    arm = read(robot.urdf)
    at = poses(arm, q[:, [robot.joint_names.index(n) for n in arm.joints]], T_BASE)
    return {link: at[c] @ T for link, (c, T) in arm.links.items()}


def test_links_are_where_the_compiled_tree_has_them(robot: Robot) -> None:
    q = random_q(robot, 40, 3)
    ours, theirs = link_poses(robot, q), T_BASE @ robot.tree.poses(q)
    assert set(ours) == set(robot.tree.names)
    assert all(np.abs(ours[n] - theirs[:, i]).max() < 1e-12 for i, n in enumerate(robot.tree.names))


def test_links_are_where_pytorch_kinematics_has_them(robot: Robot) -> None:
    pytest.importorskip("pytorch_kinematics")
    q = random_q(robot, 5, 1)
    ours = link_poses(robot, q)
    for link, T in Forward(robot).poses(q).items():
        assert np.abs(ours[link] - T_BASE @ T.numpy()).max() < 1e-5, link  # which reads angles in single precision


def test_only_what_is_wanted_is_worked_out(ur5e: Robot) -> None:
    arm = read(ur5e.urdf)
    carrier, _ = arm.links["forearm_link"]
    some = poses(arm, random_q(ur5e, 3), T_BASE, frozenset({carrier}))
    assert set(some) == {0, *arm.above[carrier]}
    assert len(arm.above[carrier]) == 4  # the base, and three joints


def test_limits_are_the_robots(robot: Robot) -> None:
    arm = read(robot.urdf)
    order = [robot.joint_names.index(n) for n in arm.joints]
    assert np.array_equal(arm.lower, robot.lower[order])
    assert np.array_equal(arm.upper, robot.upper[order])
    assert np.array_equal(arm.velocity[:-1], robot.velocity[order][:-1])
    assert robot.velocity[order][-1] <= arm.velocity[-1]  # the gripper's data sheet knows better


def test_a_mimic_that_leads_nowhere_is_refused(toy_urdf: Callable[..., Path]) -> None:
    text = toy_urdf().read_text()
    with pytest.raises(ValueError, match="leads nowhere"):
        read(text.replace('mimic joint="grip"', 'mimic joint="gone"'))
    with pytest.raises(ValueError, match="leads nowhere"):
        read(text.replace('mimic joint="grip"', 'mimic joint="grip_mirror"'))
    with pytest.raises(ValueError, match="root links"):
        read(text.replace('child link="post"', 'child link="gone"'))
    with pytest.raises(ValueError, match="floating"):
        read(text.replace('name="out" type="prismatic"', 'name="out" type="floating"'))


# -------------------------------------------------------------------------------------------------------------------------------- by hand

BY_HAND = """<robot name="by-hand">
<link name="tool"/><link name="base"/><link name="drum"/><link name="sled"/><link name="nail"/><link name="tail"/>
<joint name="slide" type="prismatic"><parent link="drum"/><child link="sled"/><origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/>
<axis xyz="0 0 2"/><limit upper="0.5"/></joint>
<joint name="spin" type="continuous"><parent link="base"/><child link="drum"/><origin xyz="1 0 0"/><axis xyz="0 0 3"/>
<limit lower="-1" upper="1" velocity="0"/></joint>
<joint name="stuck" type="fixed"><parent link="sled"/><child link="tool"/><origin xyz="0 2 0"/></joint>
<joint name="nod" type="revolute"><parent link="tool"/><child link="nail"/>
<mimic joint="wag" multiplier="-2" offset="0.5"/></joint>
<joint name="wag" type="revolute"><parent link="base"/><child link="tail"/><axis xyz="0 1 0"/>
<mimic joint="spin" multiplier="3" offset="0.1"/><limit lower="-1" upper="1"/></joint>
<transmission><joint name="spin"/></transmission></robot>"""


def test_an_arm_read_from_text() -> None:
    arm = read(BY_HAND)
    assert (arm.joints, arm.units) == (("spin", "slide"), ("rad", "m"))
    assert (arm.lower.tolist(), arm.upper.tolist(), arm.velocity.tolist()) == ([-np.inf, 0], [np.inf, 0.5], [np.inf, np.inf])
    assert arm.parent_link == {"drum": "base", "sled": "drum", "tool": "sled", "nail": "tool", "tail": "base"}
    assert arm.followers == {"wag": (0, 3.0, 0.1), "nod": (0, -6.0, 0.3)}  # 0.5 - 2 (0.1 + 3 spin)
    carriers = {link: carrier for link, (carrier, _) in arm.links.items()}
    assert carriers["base"] == 0
    assert carriers["tool"] == carriers["sled"]
    assert len(set(carriers.values())) == 5
    assert {link: arm.driven_by(c) for link, c in carriers.items()} == {
        "base": frozenset(), "drum": {0}, "sled": {0, 1}, "tool": {0, 1}, "nail": {0, 1}, "tail": {0}
    }  # fmt: skip
    assert arm.above[carriers["nail"]] == {0, carriers["drum"], carriers["sled"], carriers["nail"]}


def test_mimic_joints_add_their_efforts() -> None:
    """By how far they go with what they follow, whichever way; none that is not given, or 0, is known."""
    assert read(BY_HAND).effort.tolist() == [np.inf, np.inf]
    spin, wag = 'velocity="0"', '<limit lower="-1" upper="1"/></joint>\n<transmission>'
    assert spin in BY_HAND
    assert wag in BY_HAND
    strong = BY_HAND.replace(spin, 'velocity="0" effort="7"')
    assert read(strong).effort.tolist() == [7.0, np.inf]
    assert read(strong.replace(wag, wag.replace('upper="1"', 'upper="1" effort="2"'))).effort.tolist() == [13.0, np.inf]
    nod = '<mimic joint="wag" multiplier="-2" offset="0.5"/>'
    assert read(strong.replace(nod, nod + '<limit effort="1"/>')).effort.tolist() == [13.0, np.inf]
    assert read(BY_HAND.replace(nod, nod + '<limit effort="1"/>')).effort.tolist() == [np.inf, np.inf]
    assert read(strong.replace('effort="7"', 'effort="0"')).effort.tolist() == [np.inf, np.inf]


def test_where_the_links_of_that_arm_are() -> None:
    """spin = 0.3 about z at x = 1, slide = 0.2 upwards from 1 m; the tool 2 m along the sled's y, which is the drum's -x."""
    arm = read(BY_HAND)
    base = transform(rotation_about((1, 0, 0), 0.4), [5, 6, 7])
    at = poses(arm, np.array([[0.3, 0.2], [0.0, 0.0]]), base)
    links = {link: at[c] @ T for link, (c, T) in arm.links.items()}
    drum = base @ transform(p=[1, 0, 0]) @ transform(rotation_about((0, 0, 1), 0.3))
    tool = drum @ transform(rotation_about((0, 0, 1), np.pi / 2), [0, 0, 1.2]) @ transform(p=[0, 2, 0])
    assert np.allclose(links["drum"][0], drum)
    assert np.allclose(links["tool"][0], tool)
    assert np.allclose(links["nail"][0], tool @ transform(rotation_about((1, 0, 0), 0.3 - 6 * 0.3)))  # about x, which is what an axis is
    assert np.allclose(links["tail"][0], base @ transform(rotation_about((0, 1, 0), 0.1 + 3 * 0.3)))
    assert np.allclose(links["tool"][1], base @ transform(p=[-1, 0, 1]) @ transform(rotation_about((0, 0, 1), np.pi / 2)))
    assert np.allclose(links["base"], base)
    assert links["tool"].shape == (2, 4, 4)
    tail, _ = arm.links["tail"]
    some = poses(arm, np.array([[0.3, 0.2]]), base, frozenset({tail}))
    assert set(some) == {0, tail}
    assert np.allclose(some[tail][0], links["tail"][0])


def test_what_a_urdf_may_leave_out() -> None:
    """An axis is x, limits are 0, an origin is where the parent is, each unless it says otherwise."""
    bare = BY_HAND.replace('<axis xyz="0 0 3"/>', "<axis/>").replace('<limit upper="0.5"/>', '<limit lower="-0.5" velocity="2"/>')
    arm = read(bare.replace('<origin xyz="0 2 0"/>', '<origin rpy="0 0 0.5"/>'))
    assert (arm.lower[1], arm.upper[1], arm.velocity[1]) == (-0.5, 0.0, 2.0)
    at = poses(arm, np.array([[0.3, 0.0]]), np.eye(4))
    links = {link: at[c] @ T for link, (c, T) in arm.links.items()}
    assert np.allclose(links["drum"][0], transform(p=[1, 0, 0]) @ transform(rotation_about((1, 0, 0), 0.3)))
    assert np.allclose(links["tool"][0], links["sled"][0] @ transform(rotation_about((0, 0, 1), 0.5)))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<link name="base"/>', '<link name="base"/><link name="alone"/>', "the URDF has 2 root links, and a tree has one"),
        ('<link name="base"/>', "", "the URDF has 0 root links, and a tree has one"),
        ('type="revolute"', 'type="planar"', "joint 'nod' is of type 'planar'; revolute, continuous, prismatic and fixed can be followed"),
        ('mimic joint="wag"', 'mimic joint="nod"', "joint 'nod' mimics 'nod', which leads nowhere"),
        ('mimic joint="spin"', 'mimic joint="nobody"', "joint 'wag' mimics 'nobody', which leads nowhere"),
        ('mimic joint="spin"', 'mimic joint="nod"', "joint 'wag' mimics 'nod', which leads nowhere"),
    ],
)
def test_what_is_no_arm_is_refused(old: str, new: str, said: str) -> None:
    assert old in BY_HAND
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        read(BY_HAND.replace(old, new, 1))
