"""What is said of x_g for a gripper of boxes: every word of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from toy_arm import URDF
from toy_robot import FINGERS, OPENING, PALM, solid, toy_robot

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box
from kinematics.transforms import Array, rotation_about, transform
from planning.verdict import Settings, closes_askew, grasp, judge_grasp
from planning.verdict.grasp import closing_value
from planning.verdict.hand import hand_of

CABINET = Cabinet(np.array([1.0, 1.0, 0.5]), np.eye(4), 0.03)
BOX = Body("it", Box(np.array([0.04, 0.04, 0.1])), transform(p=[0.5, 0.0, 0.25]))
AHEAD = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])
"""The hand looks along the world's x, and closes along -y."""
X_G = transform(AHEAD, [0.485, 0.0, 0.25])
"""Its pads' faces, from -1 to 4 cm along x, are about the box's middle."""


def said(
    T: Array = X_G,
    width_m: float = 0.04,
    robot: Robot | None = None,
    body: Body = BOX,
    unseen: bool = False,
    settings: Settings | None = None,
    **other: object,
) -> str | None:
    x_g = Grasp(T, width_m)
    scene = replace(Scene("s", RobotRef(np.eye(4), urdf="toy"), CABINET, (body,), "it", x_g), **other)  # type: ignore[arg-type]
    return judge_grasp(robot or toy_robot(), scene, settings=settings, unseen=unseen)


def by(*p: float) -> Array:
    return X_G @ transform(p=p)


def test_a_grasp_that_holds() -> None:
    assert said() is None
    assert said(grasp=None) is None
    assert said(by(0, 0, 0.005), 0.0404) is None


def test_the_grasp_that_is_asked_about() -> None:
    scene = Scene("s", RobotRef(np.eye(4), urdf="toy"), CABINET, (BOX,), "it", Grasp(by(0.5, 0, 0), 0.04))
    assert judge_grasp(toy_robot(), scene, Grasp(X_G, 0.04)) is None
    assert judge_grasp(toy_robot(), scene) is not None


def test_a_grasp_that_is_nowhere() -> None:
    assert said(transform(p=[1001.0, 0, 0])) == "x_g is 1e+03 m away"
    assert said(transform(p=[0, -2000.0, 0])) == "x_g is 2e+03 m away"
    assert said(transform(p=[0, np.nan, 0])) == "x_g is nan m away"
    assert "away" not in str(said(transform(p=[1000.0, 0, 0])))


def test_widths_that_the_gripper_has() -> None:
    """From 0 to 10 cm, and half a millimetre's play."""
    box = replace(BOX, shape=Box(np.array([0.04, 0.1, 0.1])))
    assert said(width_m=0.1004, body=box) is None
    assert said(width_m=0.1006) == "the grasp is 100.6 mm wide, and the gripper opens 100 mm"
    assert said(width_m=np.nan) == "the grasp is nan mm wide, and the gripper opens 100 mm"
    assert said(width_m=1e300) == "the grasp is 1e+303 mm wide, and the gripper opens 100 mm"
    apart = {"left": FINGERS["left"] + np.array([0, 0.02, 0]), "right": FINGERS["right"] - np.array([0, 0.02, 0]), **PALM}
    assert said(robot=toy_robot(apart)) is None
    assert said(width_m=0.0396, robot=toy_robot(apart)) is None
    assert said(width_m=0.0394, robot=toy_robot(apart)) == "the grasp is 39.4 mm wide, and the gripper closes to 40 mm"
    assert said(width_m=0.1006, settings=Settings(gap_m=0.001), unseen=True) is None


def test_widths_to_a_millimetre() -> None:
    """Of a gripper that opens a metre; just the play is well."""
    wide = toy_robot(urdf=URDF.replace('upper="0.05"', 'upper="0.5"'))
    assert said(width_m=2.0, robot=wide) == "the grasp is 2000 mm wide, and the gripper opens 1000 mm"
    apart = {"left": FINGERS["left"] + np.array([0, 0.3, 0]), "right": FINGERS["right"] - np.array([0, 0.3, 0]), **PALM}
    assert said(width_m=0.1, robot=toy_robot(apart)) == "the grasp is 100 mm wide, and the gripper closes to 600 mm"
    hand = hand_of(toy_robot(apart))
    least, most, asked = float(hand.widths[0]), hand.max_width_m, Settings(gap_m=0.01)
    for width, well in ((most + 0.01, True), (least - 0.01, True), (most + 0.0101, False), (least - 0.0101, False)):
        assert (said(width_m=width, robot=toy_robot(apart), unseen=True, settings=asked) is None) == well


def test_how_deep_is_too_deep(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pad presses by a millimetre at most, other links and walls by a thousandth of that."""
    deep = {"left": 0.0, "palm": 0.0, "floor": 0.0}
    monkeypatch.setattr(grasp, "near_pairs", lambda some, others: product(range(len(some)), range(len(others))))
    monkeypatch.setattr(
        grasp, "depth", lambda link, body, near: deep["floor"] if body.name == "floor" else deep.get(link.name, 0.0) * (body.name == "it")
    )
    for name, most, words in (
        ("left", 0.001, "x_g does not hold it: left would touch the target itself, 250.0 mm deep"),
        ("palm", 1e-6, "x_g does not hold it: palm would touch the target itself, 250.0 mm deep"),
        ("floor", 1e-6, "x_g can't be reached: palm would be 250.0 mm inside the floor"),
    ):
        for value, expected in ((most, None), (0.25, words)):
            deep[name] = value
            assert said() == expected
        deep[name] = 0.0


def test_what_the_pads_do_not_hold() -> None:
    assert said(by(0.0, 0.0, -0.2)) == "x_g does not hold it: the pads close 155.0 mm beside it"
    assert said(width_m=0.042) == "x_g does not hold it: left stops 1.0 mm before it"
    assert said(width_m=0.037) == "x_g does not hold it: left is 1.5 mm inside it"
    assert said(width_m=0.042, settings=Settings(gap_m=0.002)) is None


def test_the_rest_of_the_hand_is_not_in_the_target() -> None:
    """The palm begins 3 cm behind the hand's origin; fingers may press by a millimetre, and no more, with their other sides, too."""
    deep = replace(BOX, shape=Box(np.array([0.14, 0.04, 0.1])))  # it begins at x = 0.43
    assert said(body=deep) == "x_g does not hold it: palm would touch the target itself, 25.0 mm deep"
    assert said(by(0, 0, -0.026), body=deep) is None
    thumb = {**FINGERS, "left": [FINGERS["left"], solid((-0.011, 0.011), (-0.03, 0.01), (0.03, 0.04))], **PALM}
    short = replace(BOX, shape=Box(np.array([0.04, 0.04, 0.1])))
    for z, deep_mm in ((-0.0009, 0.9), (-0.0011, 1.1)):
        # the thumb reaches around the far side of the box, at x = 0.52
        words = said(by(0, 0, 0.005 + z), robot=toy_robot(thumb), body=short)
        assert words == (None if deep_mm < 1 else "x_g does not hold it: left would touch the target itself, 1.1 mm deep")


def test_no_part_of_the_hand_is_in_what_stands_still() -> None:
    low = replace(BOX, T_world_body=transform(p=[0.5, 0.0, 0.05]))
    post = Body("post", Box(np.array([0.01, 0.02, 0.3])), transform(p=[0.45, 0.0, 0.25]))
    # the palm, 6 cm to each side and 3 cm up and down, from 3 to 6 cm behind the hand's origin
    assert said(transform(AHEAD, [0.485, 0.0, 0.025]), body=low) == "x_g can't be reached: palm would be 5.0 mm inside the floor"
    assert said(transform(AHEAD, [0.485, 0.0, 0.031]), body=low) is None
    assert said(obstacles=(post,)) == "x_g can't be reached: palm would be 10.0 mm inside post"
    wide = replace(BOX, T_world_body=transform(p=[0.5, 0.445, 0.25]))
    assert said(transform(AHEAD, [0.485, 0.445, 0.25]), body=wide) == "x_g can't be reached: palm would be 5.0 mm inside the left"
    mounted = RobotRef(transform(p=[0, 0, 0.226]), urdf="toy", mount=True)
    beyond = replace(CABINET, T_world_cabinet=transform(p=[0.6, 0, 0]))
    scene = Scene("s", mounted, beyond, (BOX,), "it", Grasp(X_G, 0.04))
    assert judge_grasp(toy_robot(), scene) == "x_g can't be reached: palm would be 6.0 mm inside the mount"


@pytest.mark.parametrize("quarters", [0, 1])
def test_all_that_goes_with_the_hand_is_looked_at_where_it_is(quarters: int) -> None:
    """A tool on the palm, 40 cm along its y and 20 cm behind it, while the hand frame is 5 cm before it: at (0.285, -0.4, 0.25).

    So it is where the hand frame is turned against the palm, about the axis along which the fingers close.
    """
    angle = quarters * np.pi / 2
    urdf = URDF.replace('<child link="hand"/>', f'<child link="hand"/><origin xyz="0 0 0.05" rpy="0 {angle} 0"/>')
    robot = toy_robot({**PALM, **FINGERS, "tool": solid((-0.01, 0.01), (-0.01, 0.01), (-0.01, 0.01))}, urdf=urdf)
    T_world_hand = by(0, 0, 0.05) @ transform(rotation_about((0, 1, 0), angle))
    for y, words in ((-0.4, "x_g can't be reached: tool would be "), (-0.3, None)):
        post = Body("post", Box(np.full(3, 0.03)), transform(p=[0.285, y, 0.25]))
        found = said(T_world_hand, robot=robot, obstacles=(post,))
        assert (found is None) if words is None else str(found).startswith(words) and str(found).endswith("inside post")


def test_without_anything_seen_the_target_is_left_out() -> None:
    assert said(by(0, 0, -0.2), unseen=True) is None
    assert said(by(0, 0, -0.2), target=None) is None
    assert said(transform(AHEAD, [0.485, 0.0, 0.025]), unseen=True) == "x_g can't be reached: palm would be 5.0 mm inside the floor"


def test_a_robot_without_pads_has_no_grasps() -> None:
    words = "robot toy: no face of its fingers closes along the hand frame's y, on the side of +y"
    assert said(robot=toy_robot(PALM)) == words


# -------------------------------------------------------------------------------------------------------------------------- tables, widths


def askew(degrees: float) -> Robot:
    """Its fingers are turned about x, both the same way, through the middles of their faces."""
    middle = np.array([0, 0, 0.015])
    R = rotation_about((1, 0, 0), np.radians(degrees))
    return toy_robot({**PALM, **{name: (corners - middle) @ R.T + middle for name, corners in FINGERS.items()}})


def test_whether_the_faces_look_the_way_they_close() -> None:
    """Within a degree they do."""
    assert [closes_askew(askew(degrees)) for degrees in (0.0, 0.9, -0.9, 1.1, -1.1, 20.0)] == [False, False, False, True, True, True]
    one = toy_robot({**PALM, "right": FINGERS["right"], "left": askew(20.0).hulls[1].vertices})
    assert closes_askew(one)
    outer = askew(20.0).hulls[1].vertices + np.array([0.05, 0.002, 0.0])
    parts = toy_robot({**PALM, "left": [FINGERS["left"], outer], "right": FINGERS["right"]}, grip=SimpleNamespace(kind="two fingers"))
    assert len(hand_of(parts).pads) == 3
    assert closes_askew(parts) is False  # the faces that close on each other decide
    assert closes_askew(toy_robot(PALM))
    cup = {"hand": solid((-0.01, 0.01), (-0.01, 0.01), (0.0, 0.02))}
    assert closes_askew(toy_robot()) is False
    assert closes_askew(toy_robot(cup, opening=replace(OPENING, cup_m=0.02), pads=frozenset({"hand"}))) is False


def test_the_faces_of_fingers_whose_own_frames_are_turned_look_the_same_way() -> None:
    """By a quarter about z, so that a finger's own x is what the hand calls y."""
    quarter = rotation_about((0, 0, 1), np.pi / 2)
    urdf = URDF
    for finger in FINGERS:
        plain = f'<child link="{finger}"/><axis xyz="0 1 0"/>'
        assert plain in urdf
        urdf = urdf.replace(plain, f'<child link="{finger}"/><origin rpy="0 0 {np.pi / 2}"/><axis xyz="1 0 0"/>')
    robot = toy_robot({**PALM, **{name: corners @ quarter for name, corners in FINGERS.items()}}, urdf=urdf)
    assert closes_askew(robot) is False
    assert said(robot=robot) is None


def test_hinged_fingers_are_looked_at_half_open() -> None:
    """They turn about x, half a radian each way, and are parallel in the middle."""
    hinged = URDF.replace('name="grip" type="prismatic"', 'name="grip" type="revolute"').replace(
        'name="mirror" type="prismatic"', 'name="mirror" type="revolute"'
    )
    hinged = hinged.replace('child link="left"/><axis xyz="0 1 0"', 'child link="left"/><axis xyz="1 0 0"')
    hinged = hinged.replace('child link="right"/><axis xyz="0 1 0"', 'child link="right"/><axis xyz="1 0 0"')
    assert closes_askew(toy_robot(urdf=hinged.replace('lower="0" upper="0.05"', 'lower="-0.5" upper="0.5"'))) is False
    assert closes_askew(toy_robot(urdf=hinged.replace('lower="0" upper="0.05"', 'lower="-0.5" upper="0.4"')))


def test_between_askew_pads_the_table_says_what_a_width_is() -> None:
    """Whose table says that the gripper opens from 2 to 8 cm."""
    table = replace(OPENING, value=np.array([0.01, 0.04]), width_m=np.array([0.02, 0.08]))
    plain, turned = toy_robot(opening=table), askew(20.0)
    turned.__dict__["opening"] = table
    assert said(width_m=0.09, robot=plain, unseen=True) is None
    assert said(width_m=0.09, robot=turned) == "the grasp is 90 mm wide, and the gripper opens 80 mm"
    assert said(width_m=0.01, robot=plain, unseen=True) is None
    assert said(width_m=0.01, robot=turned) == "the grasp is 10 mm wide, and the gripper closes to 20 mm"


def test_against_a_fixed_jaw_the_table_says_it_too() -> None:
    jaw = {"left": FINGERS["left"], "palm": [PALM["palm"], solid((-0.02, 0.02), (-0.015, -0.005), (0.0, 0.03))]}
    robot = toy_robot(jaw, opening=replace(OPENING, jaw=1), pads=frozenset({"left", "palm"}))
    assert hand_of(robot).max_width_m == pytest.approx(0.055)
    assert said(width_m=0.09, robot=robot, unseen=True) is None
    assert said(width_m=0.11, robot=robot) == "the grasp is 110 mm wide, and the gripper opens 100 mm"


def test_a_cup_takes_any_width() -> None:
    """Its lip on the box's near side, x = 0.48."""
    cup = toy_robot(
        {"hand": solid((-0.008, 0.008), (-0.008, 0.008), (-0.01, 0.02)), **PALM},
        opening=replace(OPENING, cup_m=0.02),
        pads=frozenset({"hand"}),
    )
    cup.__dict__["opening"] = replace(cup.opening, width_m=np.array([0.02, 0.1]))
    for width in (0.0, 0.5):
        assert said(transform(AHEAD, [0.46, 0.0, 0.25]), width, cup) is None
    assert said(transform(AHEAD, [0.458, 0.0, 0.25]), 0.0, cup) == "x_g does not hold it: hand stops 2.0 mm before it"


def test_the_joints_value_at_a_width() -> None:
    """Half of it; the nearest that there is, beyond both ends."""
    hand = hand_of(toy_robot())
    for width in (0.0, 0.0123, 0.05, 0.0999, 0.1):
        assert closing_value(hand, width) == pytest.approx(width / 2, abs=1e-9)
    assert closing_value(hand, -1.0) == pytest.approx(0.0)
    assert closing_value(hand, 1.0) == pytest.approx(0.05)
