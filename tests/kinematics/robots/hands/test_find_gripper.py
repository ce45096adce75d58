"""Grippers are found in the tree of joints, their motors go together, and the hand frame is measured where nobody says it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from six_joints import box

from kinematics.robots.hands.hand_model import NoGripper
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, rotation_from_wxyz, rotation_rpy, transform

ROLL = (0.4, -0.9, 1.7)  # how the palm's frame lies to the wrist, so that nothing is along an axis by chance
SLIDE, TURN = 'type="prismatic"', 'type="revolute"'


def joint(name: str, kind: str, parent: str, child: str, xyz: str, axis: str, limits: tuple[float, float], more: str = "") -> str:
    low, high = limits
    return (
        f'<joint name="{name}" {kind}><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" velocity="1" effort="1"/>{more}</joint>'
    )


def arm(gripper: str) -> str:
    """Four joints, and a palm that is turned by ROLL in the wrist; its own axes are the hand's: fingers close along y, z leads out."""
    links = "".join(f'<link name="l{i}">{box("0.06 0.06 0.2", "0 0 0.1")}</link>' for i in range(4))
    joints = "".join(
        joint(f"a{i}", TURN, f"l{i - 1}" if i else "base", f"l{i}", "0 0 0.25", f"0 {i % 2} {1 - i % 2}", (-2, 2)) for i in range(4)
    )
    rpy = " ".join(map(str, ROLL))
    flange = f'<parent link="l3"/><child link="palm"/><origin xyz="0 0 0.25" rpy="{rpy}"/>'
    return (
        f'<robot name="r"><link name="base">{box("0.2 0.2 0.1")}</link>{links}{joints}<joint name="flange" type="fixed">{flange}</joint>'
        f'<link name="palm">{box("0.04 0.13 0.04")}</link>{gripper}</robot>'
    )


def finger(name: str, side: int, z: float = 0.0) -> str:
    """A finger 12 mm thick and 80 mm long, its inner face at y = 0 of its frame, its middle at z."""
    return f'<link name="{name}">{box("0.02 0.012 0.08", f"0 {0.006 * side} {z}")}</link>'


FINGERS = finger("plus", 1) + finger("minus", -1)


def sliding(plus: tuple[float, int, tuple[float, float]], minus: tuple[float, int, tuple[float, float]], more: str = "") -> str:
    """Two fingers: of each its place along y, its axis' sign and its limits."""
    (y1, s1, limits1), (y2, s2, limits2) = plus, minus
    first = joint("f1", SLIDE, "palm", "plus", f"0 {y1} 0.06", f"0 {s1} 0", limits1)
    return first + joint("f2", SLIDE, "palm", "minus", f"0 {y2} 0.06", f"0 {s2} 0", limits2, more) + FINGERS


MIRRORED = sliding((0, 1, (0, 0.04)), (0, -1, (0, 0.04)))
SLIDING = {
    "mirrored axes": MIRRORED,
    "one direction": sliding((0, 1, (0, 0.04)), (0, 1, (-0.04, 0))),
    "closing is up": sliding((0.04, -1, (0, 0.04)), (-0.04, 1, (0, 0.04))),
    "one goes further": sliding((0, 1, (0, 0.04)), (0, -1, (0, 0.07))),
    "a mimic joint": sliding((0, 1, (0, 0.04)), (0, -1, (0, 0.04)), '<mimic joint="f1"/>'),
}
TURNING = joint("f1", TURN, "palm", "plus", "0 0.02 0.02", "1 0 0", (-0.6, 0)) + finger("plus", 1, 0.04)
TURNING += joint("f2", TURN, "palm", "minus", "0 -0.02 0.02", "1 0 0", (0, 0.6)) + finger("minus", -1, 0.04)
POST = f'<link name="post">{box("0.02 0.012 0.08", "0 -0.006 0.06")}</link>'
POST += '<joint name="p" type="fixed"><parent link="palm"/><child link="post"/></joint>'
JAW = joint("jaw", SLIDE, "palm", "plus", "0 0 0.06", "0 1 0", (0, 0.05)) + finger("plus", 1) + POST
HINGE = joint("jaw", TURN, "palm", "plus", "0 0.012 0.02", "1 0 0", (-1.5, 0.1))
HINGE += f'<link name="plus">{box("0.02 0.01 0.1", "0 0 0.05")}</link>' + POST
THIRD = joint("f3", TURN, "palm", "third", "0 0 0", "1 0 0", (0, 1)) + finger("third", 1)
FOURTH = joint("f4", TURN, "palm", "fourth", "0 0 0", "1 0 0", (0, 1)) + finger("fourth", -1)


@pytest.fixture
def robot(tmp_path: Path) -> Callable[..., Robot]:
    def make(gripper: str, *args: object, **more: object) -> Robot:
        file = tmp_path / "r.urdf"
        file.write_text(arm(gripper))
        return load(str(file), *args, **more)  # type: ignore[arg-type]

    return make


def in_palm(made: Robot) -> Array:
    """The hand frame (4, 4) in the palm's."""
    poses = made.link_poses(made.home)
    return np.asarray(np.linalg.inv(poses["palm"]) @ poses["hand"])


@pytest.mark.parametrize("kind", SLIDING)
def test_fingers_that_slide_are_driven_as_one_and_measured(kind: str, robot: Callable[..., Robot]) -> None:
    """Whatever the palm's frame, the axes' signs and which end is open."""
    made = robot(SLIDING[kind])
    T = in_palm(made)
    np.testing.assert_allclose(np.abs(T[:3, 1]), [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(T[:3, 3], [0, 0, 0.1 - 0.015], atol=0.002)
    assert (made.opening.width_m[0], made.opening.max_m) == pytest.approx((0.0, 0.08), abs=1e-6)
    assert made.pads == {"plus", "minus"}
    assert made.arm_joints == (0, 1, 2, 3)
    assert len(made.joint_names) == 5
    for share in (0.0, 0.3, 1.0):
        q = made.with_arm(np.zeros(4), made.opening.value_at(0.08 * share))
        poses = made.link_poses(q)
        y = [(np.linalg.inv(poses["hand"]) @ poses[link])[1, 3] for link in ("plus", "minus")]
        assert sum(y) == pytest.approx(0.0, abs=1e-9)
        assert abs(y[0] - y[1]) == pytest.approx(0.08 * share, abs=1e-6)


@pytest.mark.parametrize("bulge", ["0.1 0 0.01", "-0.1 0 0.01", "0.12 0 -0.02"])
def test_a_camera_at_the_palms_side_does_not_turn_the_approach(bulge: str, tmp_path: Path) -> None:
    """It draws the palm's middle aside, by 45 degrees and more as seen from the fingers (Alicia D), and the fingers lead where they led."""
    palm = '<link name="palm">' + box("0.04 0.13 0.04")
    text = arm(MIRRORED).replace(palm, palm + box("0.04 0.05 0.03", bulge))
    (tmp_path / "arm.urdf").write_text(text)
    hand = in_palm(load(str(tmp_path / "arm.urdf")))
    np.testing.assert_allclose(hand[:3, 2], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(hand[:3, 3], [0, 0, 0.085], atol=2e-3)


def test_fingers_that_turn_are_driven_as_one(robot: Callable[..., Robot]) -> None:
    made = robot(TURNING)
    assert made.grip is not None
    assert made.grip.joints == ("f1", "f2")
    assert made.grip.follows["f2"] == pytest.approx((-1.0, 0.0))
    T = in_palm(made)
    np.testing.assert_allclose(np.abs(T[:3, 1]), [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-6)
    assert made.opening.max_m > 0.04


def test_fingers_on_a_linkage_take_flat_sides_though_their_tips_part_along_the_approach(robot: Callable[..., Robot]) -> None:
    """OnRobot's RG2 and RG6: tips that stay parallel come 45 mm nearer to the palm as they open, and face each other no more at the hand
    frame when they are wide open. They were taken for fingers that turn, which hold what is round alone."""
    mimic, far = '<mimic joint="f1"/>', 0.055
    knuckles = "".join(f'<link name="k{i}">{box("0.01 0.01 0.03", "0 0 0.02")}</link>' for i in (1, 2))
    linkage = (
        joint("f1", TURN, "palm", "k1", "0 0.02 0.02", "1 0 0", (-1.4, 0.2))
        + joint("t1", TURN, "k1", "plus", f"0 0 {far}", "-1 0 0", (-2, 2), mimic)
        + joint("f2", TURN, "palm", "k2", "0 -0.02 0.02", "-1 0 0", (-1.4, 0.2), mimic)
        + joint("t2", TURN, "k2", "minus", f"0 0 {far}", "1 0 0", (-2, 2), mimic)
        + finger("plus", 1, 0.02)
        + finger("minus", -1, 0.02)
        + knuckles
    )
    made = robot(linkage)
    assert not made.opening.round_only
    assert made.pads == {"plus", "minus"}
    for width, value in zip(made.opening.width_m, made.opening.value):
        assert width == pytest.approx(2 * (0.02 - far * np.sin(value)), abs=1e-6)
    assert 0.12 < made.opening.max_m < 2 * (0.02 + far * np.sin(1.4)), "the widest, at which nothing faces anything, is left out"


def test_fingers_that_may_turn_full_circles_are_told_by_their_limits(robot: Callable[..., Robot]) -> None:
    """OMX-F's may turn by 720 degrees, and are never where fingers are."""
    limits = 'lower="-6.3" upper="6.3"'
    wide = TURNING.replace('lower="-0.6" upper="0"', limits).replace('lower="0" upper="0.6"', limits)
    assert wide.count(limits) == 2
    with pytest.raises(ValueError, match="its joint's limits are 722° apart, and no finger turns so far: give the URDF those between"):
        robot(wide)


@pytest.mark.parametrize("named", [(), ("jaw",)])
def test_a_jaw_that_slides_against_a_fixed_one(named: tuple[str, ...], robot: Callable[..., Robot]) -> None:
    """The middle between the pads moves with the opening; the table has it."""
    made = robot(JAW, gripper_joints=named)
    opening, T = made.opening, in_palm(made)
    assert (opening.jaw, opening.max_m) == (1, pytest.approx(0.05, abs=1e-6))
    assert made.pads == {"plus", "post"}
    for width in (0.0, 0.02, 0.05):
        assert T[1, 3] + opening.pad_y_at(width) == pytest.approx(width / 2, abs=1e-3)
    R = rotation_rpy((0.3, 0.2, 0.1))
    hand = transform(R, opening.hand_position(np.array([1.0, 2.0, 3.0]), R, 0.02))
    assert hand @ [0, opening.pad_y_at(0.02), opening.pad_z_at(0.02), 1] == pytest.approx([1, 2, 3, 1])


def test_a_jaw_closes_on_a_face_that_things_come_in_past(robot: Callable[..., Robot]) -> None:
    """A post whose tip leans in, as that of phosphobot's Koch does: nothing gets by along its larger face, but along the tip's."""
    tip = '<collision><origin xyz="0 0.0035 0.105" rpy="-0.45 0 0"/><geometry><box size="0.02 0.012 0.05"/></geometry></collision>'
    hooked = HINGE.replace(POST, POST.replace("</link>", tip + "</link>"))
    assert hooked != HINGE
    made = in_palm(robot(hooked))
    lean = np.degrees(np.arctan2(made[1, 2], made[2, 2]))
    assert lean == pytest.approx(np.degrees(0.45), abs=1.0)


def test_a_jaw_that_turns_opens_no_further_than_it_faces_the_fixed_one(robot: Callable[..., Robot]) -> None:
    made = robot(HINGE)
    assert made.grip is not None
    assert made.grip.limits == pytest.approx((-0.5, 0.1))
    np.testing.assert_allclose(in_palm(made)[:3, 1], [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(in_palm(made)[:3, 2], [0, 0, 1], atol=1e-6)


@pytest.mark.parametrize("where", [(0.0, 0.0, 0.0), (0.1, 0.02, 0.3)])
def test_a_frame_that_is_not_between_the_pads_is_answered_with_the_one_that_is(
    where: tuple[float, float, float], robot: Callable[..., Robot]
) -> None:
    """What the message says, said in T_link_hand, is what would have been measured."""
    x, y, z = where
    at = f'<parent link="palm"/><child link="tcp"/><origin xyz="{x} {y} {z}" rpy="1 2 3"/>'
    gripper = MIRRORED + f'<link name="tcp"/><joint name="t" type="fixed">{at}</joint>'
    with pytest.raises(
        NoGripper, match=r"two fingers found \(minus, plus\), between whose pads p \[.*\], q_wxyz \[.*\] is in the link 'tcp'"
    ) as e:
        robot(gripper, "tcp")
    p, q = (np.array([float(v) for v in part.split("]")[0].split(",")]) for part in str(e.value).split("[")[1:3])
    made = robot(gripper, "tcp", T_link_hand=transform(rotation_from_wxyz(q), p))
    np.testing.assert_allclose(in_palm(made), in_palm(robot(gripper)), atol=2e-4)


@pytest.mark.parametrize(
    ("gripper", "says"),
    [
        ("", "no gripper found: no joint moves a finger after the last one of the arm, 'a3' (links there: l3, palm); give the URDF a"),
        (MIRRORED.replace(SLIDE, 'type="continuous"'), "its joint 'f1' has no limits, so it is never open"),
        (re.sub(r"<collision>.*?</collision>", "", MIRRORED), "has no collision geometry (plus, minus): give these links their fingers"),
        (MIRRORED + THIRD + FOURTH, "4 fingers with 4 motors (f1, f2, f3, f4)"),
        (
            sliding((0, -1, (0, 0.04)), (0, -1, (-0.04, 0))),
            "its fingers plus and minus pass through each other as f1 goes from 0 to 0.04: give the <axis> of what moves plus",
        ),
    ],
    ids=["none", "endless", "mounts", "four", "through"],
)  # fmt: skip
def test_what_is_no_gripper_is_said_with_what_was_found(gripper: str, says: str, robot: Callable[..., Robot]) -> None:
    with pytest.raises(NoGripper) as e:
        robot(gripper)
    assert says in str(e.value)
    assert "frame" not in str(e.value)


def many_arms(**grippers: str) -> str:
    """Arms of four joints on one body, by the letter before their names, each with what is in its hand."""
    text = f'<robot name="r"><link name="body">{box("0.3 0.3 0.3")}</link>'
    for i, (side, gripper) in enumerate(grippers.items()):
        one = arm(gripper).removeprefix('<robot name="r">').removesuffix("</robot>")
        text += re.sub(r'(name|link|joint)="', rf'\1="{side}_', one)
        at = f'<parent link="body"/><child link="{side}_base"/><origin xyz="0 {i - 0.5} 0"/>'
        text += f'<joint name="{side}_shoulder" type="fixed">{at}</joint>'
    return text + "</robot>"


def test_of_arms_and_legs_the_one_with_a_gripper_is_taken(tmp_path: Path) -> None:
    file = tmp_path / "r.urdf"
    file.write_text(many_arms(a="", b=MIRRORED, c=""))
    made = load(str(file))
    assert made.grip is not None
    assert made.grip.joints == ("b_f1", "b_f2")
    assert [made.joint_names[j] for j in made.arm_joints] == ["b_a0", "b_a1", "b_a2", "b_a3"]


def test_of_two_arms_with_grippers_the_gripper_joint_says_which(tmp_path: Path) -> None:
    """What the message names is enough: the hand frame is measured as if there were no other arm."""
    file = tmp_path / "r.urdf"
    file.write_text(many_arms(l=MIRRORED, r=SLIDING["one direction"]))
    with pytest.raises(NoGripper, match=r"there are 2 arms with grippers; say which with --gripper-joint l_f1 or --gripper-joint r_f1$"):
        load(str(file))
    for side in "lr":
        made = load(str(file), gripper_joint=f"{side}_f1")
        poses = made.link_poses(made.home)
        T = np.linalg.inv(poses[f"{side}_palm"]) @ poses["hand"]
        np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-6)
        assert made.opening.max_m == pytest.approx(0.08, abs=1e-6)


def test_of_arms_without_grippers_the_first_is_said(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(many_arms(l="", r=""))
    says = "on none of 2 arms, which begin with the joints l_a0, r_a0, is one that can be used, for no joint moves a finger .*'l_a3'"
    with pytest.raises(NoGripper, match=says):
        load(str(tmp_path / "r.urdf"))


@pytest.mark.parametrize(
    ("moved_by", "is_jaw"), [("wrist_yaw", False), ("r_wrist_roll_joint", False), ("hand_yaw_grip", True), ("hand", True)]
)
def test_a_hand_that_its_wrist_turns_is_no_jaw(moved_by: str, is_jaw: bool, robot: Callable[..., Robot]) -> None:
    """A link may be called hand without any finger; the joint tells."""
    jaw = JAW.replace('"jaw"', f'"{moved_by}"').replace('"plus"', '"right_hand"')
    if is_jaw:
        assert robot(jaw).opening.jaw
    else:
        with pytest.raises(NoGripper, match=f"after the last one of the arm, '{moved_by}'"):
            robot(jaw)


def test_what_has_no_arm_is_said(tmp_path: Path) -> None:
    """A body with two wheels."""
    wheels = "".join(f'<link name="{n}">{box("0.1 0.1 0.1")}</link>' + joint(n, TURN, "body", n, "0 0 0", "0 1 0", (-1, 1)) for n in "lr")
    (tmp_path / "r.urdf").write_text(f'<robot name="r"><link name="body">{box("0.3 0.3 0.3")}</link>{wheels}</robot>')
    with pytest.raises(NoGripper, match=r"no arm found: 2 branches begin on 'body', with the joints l, r, and none has 4 motors"):
        load(str(tmp_path / "r.urdf"))


@pytest.mark.parametrize("rpy", ["0 -1.5707963 0", "3.1415926 0 0"], ids=["x is the approach", "z is the way back"])
def test_a_frame_whose_z_is_not_the_approach_is_answered_with_the_one_whose_is(rpy: str, robot: Callable[..., Robot]) -> None:
    """A tool frame in another convention, right between the pads: fingers would come sideways. Both remedies in the message work."""
    at = f'<parent link="palm"/><child link="tcp"/><origin xyz="0 0 0.085" rpy="{rpy}"/>'
    gripper = MIRRORED + f'<link name="tcp"/><joint name="t" type="fixed">{at}</joint>'
    with pytest.raises(NoGripper, match=r"the z of the link 'tcp' is (90|180)° off the approach: .* or --gripper-joint f1 without") as e:
        robot(gripper, "tcp")
    p, q = (np.array([float(v) for v in part.split("]")[0].split(",")]) for part in str(e.value).split("[")[1:3])
    measured = in_palm(robot(gripper, gripper_joint="f1"))
    np.testing.assert_allclose(in_palm(robot(gripper, "tcp", T_link_hand=transform(rotation_from_wxyz(q), p))), measured, atol=2e-4)


def test_a_jaw_keeps_the_fixed_pad_off_the_object_until_it_closes(robot: Callable[..., Robot]) -> None:
    """The hand comes beside the place where it closes, and the jaw pushes what it takes by less than a plan may let anything jump."""
    opening = robot(JAW).opening
    T = transform(rotation_rpy((0.2, 0.1, 0.4)), [1.0, 2.0, 3.0])
    came = np.linalg.inv(T) @ opening.beside(T)
    assert came[:3, 3] == pytest.approx([0.0, -0.00062, 0.0])
    held = opening.held(np.eye(4))
    assert held[1, 3] == pytest.approx(-0.0004)
    np.testing.assert_allclose(opening.let_go(held), np.eye(4), atol=1e-15)
    assert opening.width_at(opening.closing_value(0.03)) == pytest.approx(0.03 + 0.00022, abs=1e-6)


def test_a_hand_of_two_fingers_closes_where_it_is(robot: Callable[..., Robot]) -> None:
    opening = robot(MIRRORED).opening
    T = transform(rotation_rpy((0.2, 0.1, 0.4)), [1.0, 2.0, 3.0])
    assert opening.beside(T) is T
    assert opening.held(T) is T
    assert opening.closing_value(0.03) == opening.value_at(0.03)


@pytest.mark.parametrize(
    ("drawn", "says", "top"),
    [
        (
            '<visual><origin xyz="0 0 0.01"/><geometry><box size="0.03 0.03 0.02"/></geometry></visual>',
            "what is drawn is taken for it",
            0.02,
        ),
        ("", "they can hold nothing", 0.12),
    ],
)
def test_a_palm_that_fills_the_room_between_the_pads_is_as_it_is_drawn(
    drawn: str, says: str, top: float, robot: Callable[..., Robot]
) -> None:
    """Coarse collision geometry reaches beyond the pads, so that nothing could be held; where nothing is drawn, that is said."""
    tall = '<link name="block">' + box("0.03 0.03 0.12", "0 0 0.06") + drawn + '</link><joint name="b" type="fixed"><parent link="palm"/>'
    made = robot(MIRRORED + tall + '<child link="block"/></joint>')
    assert max(float(h.vertices[:, 2].max()) for h in made.hulls if h.link == "block") == pytest.approx(top)
    assert f"the collision geometry of block fills the room between the pads: {says}" in made.notes


def test_a_coarse_solid_around_the_palm_is_left_out_where_it_fills_the_room_between_the_pads(robot: Callable[..., Robot]) -> None:
    """As Franka's `hand_sc`, of which nothing is drawn: a link beside the hand, fixed to it."""
    around = '<link name="palm_sc">' + box("0.3 0.3 0.3", "0 0 0.04") + "</link>"
    made = robot(MIRRORED + around + '<joint name="sc" type="fixed"><parent link="palm"/><child link="palm_sc"/></joint>')
    assert not [h for h in made.hulls if h.link == "palm_sc"]
    says = "the collision geometry of palm_sc, around another link's, fills the room between the pads: it is left out"
    assert says in made.notes
    assert made.opening.max_m == pytest.approx(robot(MIRRORED).opening.max_m)


def test_fixed_joints_that_are_said_to_follow_others_are_named(robot: Callable[..., Robot]) -> None:
    frozen = '<joint name="stiff" type="fixed"><parent link="palm"/><child link="minus"/><mimic joint="f1"/></joint>'
    says = r"joints with <mimic> that are fixed stand still; where they move, say their type: stiff"
    alone = joint("f1", TURN, "palm", "plus", "0 0.3 0.06", "0 1 0", (0, 0.04)) + FINGERS + frozen
    with pytest.raises(ValueError, match=says):
        robot(alone)


def test_a_fixed_joint_follows_nothing_even_where_it_is_said_to_follow_a_fixed_one(robot: Callable[..., Robot]) -> None:
    """As converters leave fingers behind that a suction cup has taken the place of."""
    links = "".join(f'<link name="{name}">{box("0.01 0.01 0.01", "0 0.2 0")}</link>' for name in ("a", "b"))
    ends = [f'type="fixed"><parent link="palm"/><child link="{name}"/>' for name in ("a", "b")]
    made = robot(MIRRORED + links + f'<joint name="fa" {ends[0]}</joint><joint name="fb" {ends[1]}<mimic joint="fa"/></joint>')
    assert "joints with <mimic> that are fixed stand still; where they move, say their type: fb" in made.notes
