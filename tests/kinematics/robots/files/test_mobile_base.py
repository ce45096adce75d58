"""What only places a robot in a room is no joint of its arm."""

from __future__ import annotations

import pytest
from lxml import etree

from kinematics.robots.files.mobile_base import hold_base

BODY = '<link name="body"><collision><geometry><box size="1 1 1"/></geometry></collision></link>'


def robot(*joints: tuple[str, str, str, str]) -> etree._Element:
    """Joints in a row, (name, type, parent, child), with the limits of which the last part of the name tells."""
    limits = {"far": '<limit lower="-20" upper="20"/>', "near": '<limit lower="-1" upper="1"/>', "none": ""}
    text = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="1 0 0"/>'
        f"{limits[name.split('_')[-1]]}</joint>"
        for name, kind, parent, child in joints
    )
    bare = "".join(f'<link name="{name}"/>' for name in dict.fromkeys(j[2] for j in joints) if name != "body")
    arm = '<link name="arm"/><joint name="pan_near" type="revolute"><parent link="body"/><child link="arm"/></joint>'
    return etree.fromstring(f'<robot name="r">{bare}{BODY}{arm}{text}</robot>')


PLANAR = (("x_far", "prismatic", "world", "a"), ("y_far", "prismatic", "a", "b"), ("turn_none", "continuous", "b", "body"))


@pytest.mark.parametrize(
    ("joints", "held"),
    [
        (PLANAR, ["x_far", "y_far", "turn_none"]),
        ((("root_none", "floating", "world", "body"),), ["root_none"]),
        ((("root_none", "planar", "world", "a"), ("mount_none", "fixed", "a", "body")), ["root_none"]),
        ((("rail_near", "prismatic", "world", "body"),), []),  # a rail that the arm rides on
        ((("pan_none", "continuous", "world", "body"),), []),  # an arm whose base has no geometry
        ((("mount_none", "fixed", "world", "body"),), []),
    ],
    ids=["planar", "floating", "planar joint", "rail", "pan", "fixed"],
)
def test_a_base_that_drives_stands_still(joints: tuple[tuple[str, str, str, str], ...], held: list[str]) -> None:
    root = robot(*joints)
    before = {j.get("name"): j.get("type") for j in root.iter("joint")}
    assert hold_base(root) == held
    for joint in root.iter("joint"):
        name = joint.get("name")
        assert joint.get("type") == ("fixed" if name in held else before[name])
        assert (joint.find("axis") is None) == (name in held or name == "pan_near")


def test_what_slides_after_the_first_body_is_the_arms() -> None:
    """However far: a gantry has a frame to slide on."""
    root = robot(("rail_far", "prismatic", "body", "a"), ("cross_far", "prismatic", "a", "b"))
    assert hold_base(root) == []
    assert hold_base(etree.fromstring('<robot name="empty"/>')) == []
