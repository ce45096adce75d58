"""The hand as it is read off a robot of boxes: links, faces of the pads, widths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from toy_arm import URDF
from toy_robot import FINGERS, OPENING, PALM, solid, toy_robot

from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, rotation_about, transform
from planning.verdict.hand import Hand, Pad, _in_parts, hand_of, in_hand

LEFT, RIGHT = FINGERS["left"], FINGERS["right"]


def in_hand_frame(hand: Hand, pad: Pad, value: float = 0.025) -> Array:
    return in_hand(hand, value)[pad.carrier] @ pad.T_carrier_face


def face(hand: Hand, pad: Pad) -> tuple[list[float], list[float]]:
    """Low and high corner of a pad's face in the hand's frame, half open."""
    T = in_hand_frame(hand, pad)
    points = pad.window.corners @ T[:3, :2].T + T[:3, 3]
    return points.min(0).tolist(), points.max(0).tolist()


def test_two_fingers_and_a_palm() -> None:
    hand = hand_of(toy_robot())
    assert hand.links == {"palm", "left", "right"}
    assert hand.fingers == hand.holding == {"left", "right"}
    assert (hand.carrier, hand.gripper) == (4, 4)
    assert np.array_equal(hand.T_carrier_hand, np.eye(4))
    assert hand.widths == pytest.approx(np.linspace(0, 0.1, 17))
    assert hand.values == pytest.approx(np.linspace(0, 0.05, 17))
    assert hand.max_width_m == pytest.approx(0.1)
    assert hand.width(np.array([0.01, 0.03])) == pytest.approx([0.02, 0.06])
    left, right = hand.pads
    assert (left.link, left.side, right.link, right.side) == ("left", 1, "right", -1)
    assert face(hand, left) == (pytest.approx([-0.011, 0.025, -0.01]), pytest.approx([0.011, 0.025, 0.04]))
    assert face(hand, right) == (pytest.approx([-0.011, -0.025, -0.01]), pytest.approx([0.011, -0.025, 0.04]))
    T = in_hand_frame(hand, left)
    assert pytest.approx(np.array([[0, -1, 0, 0], [0, 0, -1, 0.025], [1, 0, 0, 0.015], [0, 0, 0, 1]])) == T
    assert in_hand_frame(hand, right)[:3, :3] == pytest.approx(np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]))


def bent(x: float = 0.011) -> Array:
    """A finger with two faces that look inward: one from -1 to 1 cm along z, and above it a larger one that falls back by 20°."""
    top = 0.016 + 0.06
    back = (top - 0.016) * np.tan(np.radians(20))
    outline = [(0.0, -0.01), (0.0, 0.016), (back, top), (0.05, top), (0.05, -0.01)]
    return np.array([[s * x, y, z] for s in (-1, 1) for y, z in outline])


def test_a_face_out_of_reach_does_not_hide_another() -> None:
    """The upper one is the larger, and begins 16 mm from the hand's origin."""
    hand = hand_of(toy_robot({"left": bent(), "right": RIGHT}, grip=SimpleNamespace(kind="three fingers")))
    assert [(p.link, p.side) for p in hand.pads] == [("left", 1), ("right", -1)]
    assert face(hand, hand.pads[0]) == (pytest.approx([-0.011, 0.025, -0.01]), pytest.approx([0.011, 0.025, 0.016]))


def test_of_three_fingers_all_faces_count() -> None:
    """Of two they don't, though one has two faces."""
    low = bent() - np.array([0, 0, 0.01])
    for kind, n in (("three fingers", 3), ("two fingers", 2)):
        hand = hand_of(toy_robot({"left": low, "right": RIGHT}, grip=SimpleNamespace(kind=kind)))
        assert len(hand.pads) == n
    assert len(hand_of(toy_robot({"left": low, "right": RIGHT})).pads) == 2


def test_which_way_a_triangle_turns_does_not_matter() -> None:
    robot = toy_robot()
    for h in robot.hulls:
        h.faces[::2] = h.faces[::2, ::-1]
    assert face(hand_of(robot), hand_of(robot).pads[0]) == face(hand_of(toy_robot()), hand_of(toy_robot()).pads[0])


def test_what_goes_with_the_hand() -> None:
    """What the arm moves as it moves the hand; not what comes before. Fingers need not be pads."""
    more = {
        "column": solid((-0.1, 0.1), (-0.1, 0.1), (0.1, 0.2)),
        "base": solid((-0.1, 0.1), (-0.1, 0.1), (-1, -0.9)),
        "hand": 2 * PALM["palm"],
    }
    hand = hand_of(toy_robot({**PALM, **FINGERS, **more}))
    assert hand.links == {"palm", "left", "right", "hand"}
    assert set(in_hand(hand, 0.01)) >= {4, 5, 6}
    frames = in_hand(hand, 0.01)
    assert frames[4] == pytest.approx(np.eye(4))
    assert frames[5] == pytest.approx(transform(p=[0, 0.01, 0]))


def test_the_hand_frame_need_not_be_the_palms() -> None:
    """It is a centimetre along y here and looks along the palm's z turned by half a turn: the +y pad is the other finger."""
    there = URDF.replace('<child link="hand"/>', '<child link="hand"/><origin xyz="0 0.01 0" rpy="0 0 3.141592653589793"/>')
    hand = hand_of(toy_robot(urdf=there))
    first, second = hand.pads
    assert (first.link, second.link) == ("right", "left")
    assert face(hand, first)[0][1] == pytest.approx(0.035)
    assert face(hand, second)[0][1] == pytest.approx(-0.015)
    assert hand.width(np.array([0.025])) == pytest.approx([0.05])
    bent_arm = '<child link="palm"/><origin xyz="0.3 0.2 0.1" rpy="0.4 0.5 0.6"/>'
    aside = URDF.replace('<child link="palm"/>', bent_arm).replace(
        '<child link="hand"/>', '<child link="hand"/><origin xyz="0.02 0.003 0.01" rpy="0.1 0 0"/>'
    )
    hand = hand_of(toy_robot(urdf=aside))
    low, high = (np.array([x, 0.025, z]) - [0.02, 0.003, 0.01] for x, z in ((-0.011, -0.01), (0.011, 0.04)))
    R = rotation_about((1, 0, 0), 0.1)
    corners = np.array([[x, low[1], z] for x in (low[0], high[0]) for z in (low[2], high[2])]) @ R
    assert face(hand, hand.pads[0]) == (pytest.approx(corners.min(0)), pytest.approx(corners.max(0)))


def test_widths_rise_whichever_way_the_joint_opens() -> None:
    other = URDF.replace('child link="left"/><axis xyz="0 1 0"', 'child link="left"/><axis xyz="0 -1 0"').replace(
        'multiplier="-1"', 'multiplier="1"'
    )
    left, right = LEFT + np.array([0, 0.05, 0]), RIGHT - np.array([0, 0.05, 0])
    hand = hand_of(toy_robot({"left": left, "right": right}, urdf=other))
    assert hand.widths == pytest.approx(np.linspace(0, 0.1, 17))
    assert hand.values == pytest.approx(np.linspace(0.05, 0, 17))


def askew(corners: Array, degrees: float) -> Array:
    """Turned about x through the middle of the inner face."""
    middle = np.array([0, 0, 0.015])
    return (corners - middle) @ rotation_about((1, 0, 0), np.radians(degrees)).T + middle


NO_FACE = "robot toy: no face of its fingers closes along the hand frame's y, on the side of {}y"


def test_a_pads_face_looks_roughly_the_way_it_closes() -> None:
    for degrees, well in ((29.9, True), (-29.9, True), (30.1, False), (-30.1, False)):
        for side, links in (("+", {"left": askew(LEFT, degrees), "right": RIGHT}), ("-", {"left": LEFT, "right": askew(RIGHT, degrees)})):
            if well:
                hand = hand_of(toy_robot(links))
                pad = hand.pads[0 if side == "+" else 1]
                square = in_hand_frame(hand_of(toy_robot()), hand_of(toy_robot()).pads[0 if side == "+" else 1])[:3, :3]
                assert in_hand_frame(hand, pad)[:3, :3] == pytest.approx(rotation_about((1, 0, 0), np.radians(degrees)) @ square)
            else:
                says = NO_FACE.format(side).replace("+", r"\+") + ": the best one there looks 30.1° away from it"
                with pytest.raises(ValueError, match=f"^{says}$"):
                    hand_of(toy_robot(links))


def test_a_face_that_looks_more_than_75_degrees_away_is_a_fingers_side() -> None:
    """Of a wedge whose edge points inward: its upper face may be told as the best one, and its lower one looks straight down."""
    for degrees, told in ((74.6, ": the best one there looks 74.6° away from it"), (75.4, "")):
        y, z = 0.05 * np.sin(np.radians(degrees)), 0.05 * np.cos(np.radians(degrees))
        wedge = np.array([(x, *at) for x in (-0.011, 0.011) for at in ((0.0, 0.0), (y, z), (y, 0.0))])
        with pytest.raises(ValueError, match=f"^{NO_FACE.format('[+]')}{told}$"):
            hand_of(toy_robot({"left": wedge, "right": RIGHT}))


@pytest.mark.parametrize(
    ("x", "z", "well"),
    [
        ((-0.002, 0.002), (0.0, 0.0051), True),  # 20.4 mm²
        ((-0.002, 0.002), (0.0, 0.0049), False),
        ((-0.01, 0.01), (0.0149, 0.05), True),
        ((-0.01, 0.01), (0.0151, 0.05), False),
        ((-0.01, 0.01), (-0.05, -0.0149), True),
        ((-0.01, 0.01), (-0.05, -0.0151), False),
    ],
)
def test_a_pads_face_is_large_enough_and_near_enough(x: tuple[float, float], z: tuple[float, float], well: bool) -> None:
    links = {"left": solid(x, (0.0, 0.01), z), "right": RIGHT}
    if well:
        assert face(hand_of(toy_robot(links)), hand_of(toy_robot(links)).pads[0])[1] == pytest.approx([x[1], 0.025, z[1]])
    else:
        with pytest.raises(ValueError, match="closes along"):
            hand_of(toy_robot(links))


def test_a_face_of_the_other_side_is_none() -> None:
    """The left finger's inner face is at y = -0.03 + 0.025 when the gripper is half open."""
    for y, well in ((-0.024, True), (-0.026, False)):
        links = {"left": LEFT + np.array([0, y, 0]), "right": RIGHT}
        if well:
            assert face(hand_of(toy_robot(links)), hand_of(toy_robot(links)).pads[0])[0][1] == pytest.approx(0.025 + y)
        else:
            with pytest.raises(ValueError, match=r"on the side of \+y$"):
                hand_of(toy_robot(links))


def test_a_face_just_in_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    for z in ((0.015, 0.05), (-0.05, -0.015)):
        low = LEFT.copy()
        low[:, 2] = np.where(low[:, 2] > 0, z[1], z[0])
        assert len(hand_of(toy_robot({"left": low, "right": RIGHT})).pads) == 2


def test_the_innermost_face_is_the_pad() -> None:
    outer = LEFT + np.array([0.05, 0.02, 0.0])
    for parts in ([LEFT, outer], [outer, LEFT]):
        hand = hand_of(toy_robot({"left": parts, "right": RIGHT}))
        assert len(hand.pads) == 2
        assert face(hand, hand.pads[0])[0] == pytest.approx([-0.011, 0.025, -0.01])
    outer = RIGHT - np.array([0.05, 0.02, 0.0])
    for parts in ([RIGHT, outer], [outer, RIGHT]):
        hand = hand_of(toy_robot({"left": LEFT, "right": parts}))
        assert face(hand, hand.pads[1])[0] == pytest.approx([-0.011, -0.025, -0.01])


def test_of_a_finger_in_parts_all_faces_count() -> None:
    """Of a robot of one's own, where one side has several parts, or two fingers; the innermost stays the first."""
    outer = LEFT + np.array([0.05, 0.002, 0.0])
    links = {"left": [outer, LEFT], "right": RIGHT}
    hand = hand_of(toy_robot(links, grip=SimpleNamespace(kind="two fingers")))
    assert [(p.link, p.side) for p in hand.pads] == [("left", 1), ("right", -1), ("left", 1)]
    assert face(hand, hand.pads[2])[0] == pytest.approx([0.039, 0.027, -0.01])
    assert hand.widths == pytest.approx(np.linspace(0, 0.1, 17))
    whole = hand_of(toy_robot(grip=SimpleNamespace(kind="two fingers")))
    assert len(whole.pads) == 2
    three = {"left": LEFT, "right": RIGHT, "palm": PALM["palm"]}
    assert len(hand_of(toy_robot(three, grip=SimpleNamespace(kind="three fingers"))).pads) == 2


def test_faces_of_a_round_finger_go_together_where_they_are_flat() -> None:
    """Corners within 0.3 mm of a plane belong to it: a roof of 0.2 mm is one face, of 0.8 mm two, the larger of which is first."""
    for height, width in ((0.0002, 0.022), (0.0008, np.hypot(0.015, 0.0008))):
        ridge = np.array([[0.004, -height, z] for z in (-0.01, 0.04)])
        hand = hand_of(toy_robot({"left": np.concatenate([LEFT, ridge]), "right": RIGHT}))
        low, high = hand.pads[0].window.corners.min(0), hand.pads[0].window.corners.max(0)
        assert high - low == pytest.approx([0.05, width], abs=1e-5)


# ------------------------------------------------------------------------------------------------------------------------------ jaws, cups


@pytest.mark.parametrize("side", [1, -1])
def test_a_jaw_closes_on_what_stands_still(side: int) -> None:
    """It may be up to 50° askew, and all such faces count; the first looks along the way it closes."""
    jaw, still = ("left", LEFT) if side > 0 else ("right", RIGHT)
    fixed = {"palm": [PALM["palm"], solid((-0.02, 0.02), (-side * 0.01 - 0.005, -side * 0.01 + 0.005), (0.0, 0.03))]}
    near = -side * 0.005  # the inner face of what is fixed
    tip = askew(still, side * 49.0) + np.array([0.1, 0.0, 0.0])
    robot = toy_robot({jaw: [still, tip], **fixed}, opening=replace(OPENING, jaw=side), pads=frozenset({"palm", jaw}))
    hand = hand_of(robot)
    assert hand.fingers == {jaw}
    assert hand.holding == {jaw, "palm"}
    first, second = hand.pads[:2]
    assert [p.side for p in (first, second)] == [1, -1]
    moving, standing = (first, second) if side > 0 else (second, first)
    assert (moving.link, standing.link) == (jaw, "palm")
    assert face(hand, moving)[0][1] == pytest.approx(side * 0.025)
    assert face(hand, standing)[0][1] == pytest.approx(near)
    assert hand.widths == pytest.approx(np.linspace(0.005, 0.055, 17))
    more = [p for p in hand.pads[2:] if p.link == jaw]
    assert [round(float(np.degrees(np.arccos(abs(in_hand_frame(hand, p)[1, 2]))))) for p in more] == [49]


def test_a_jaws_first_face_looks_the_way_it_closes() -> None:
    """Is on its own side, and has 20 mm²; what is askew, small, or past the middle can be touched, but is no jaw."""
    wall = {"palm": [PALM["palm"], solid((-0.02, 0.02), (-0.015, -0.005), (0.0, 0.03))]}
    well, small = LEFT, solid((-0.001, 0.001), (0.0, 0.01), (0.0, 0.004))
    past, tip = LEFT - np.array([0, 0.026, 0]), askew(LEFT, 40.0)
    asked = {"opening": replace(OPENING, jaw=1), "pads": frozenset({"palm", "left"})}
    for other, counts in (
        (small + np.array([0.05, 0.001, 0]), True),
        (tip + np.array([0.05, 0.001, 0]), True),
        (past + np.array([0.05, 0, 0]), True),
    ):
        hand = hand_of(toy_robot({"left": [other, well], **wall}, **asked))
        assert face(hand, hand.pads[0])[0] == pytest.approx([-0.011, 0.025, -0.01])
        assert (len([p for p in hand.pads if p.link == "left"]) == 2) is counts
        with pytest.raises(ValueError, match=r"on the side of \+y(: the best one there looks [0-9.]+° away from it)?$"):
            hand_of(toy_robot({"left": [other], **wall}, **asked))


def test_how_far_fingers_swing() -> None:
    """As far as their joint goes; those that hold just what is round, as far as their table says; a jaw as its joint."""
    table = replace(OPENING, value=np.array([0.04, 0.01]), width_m=np.array([0.0, 0.1]))
    for opening, ends in ((table, (0.0, 0.05)), (replace(table, round_only=True), (0.01, 0.04))):
        hand = hand_of(toy_robot(opening=opening))
        assert (hand.values[0], hand.values[-1]) == pytest.approx(ends)
    jaw = {"left": LEFT, "palm": [PALM["palm"], solid((-0.02, 0.02), (-0.015, -0.005), (0.0, 0.03))]}
    hand = hand_of(toy_robot(jaw, opening=replace(table, round_only=True, jaw=1), pads=frozenset({"left", "palm"})))
    assert (hand.values[0], hand.values[-1]) == pytest.approx((0.0, 0.05))


def test_which_faces_of_a_jaw_count() -> None:
    """50° askew at most, of 2 mm² at least; corners up to 0.3 mm off a plane belong to its face."""
    wall = {"palm": [PALM["palm"], solid((-0.02, 0.02), (-0.015, -0.005), (0.0, 0.03))]}
    asked = {"opening": replace(OPENING, jaw=1), "pads": frozenset({"palm", "left"})}
    beside = np.array([0.05, 0.001, 0])
    for other, counts in (
        (askew(LEFT, 49.5) + beside, True),
        (askew(LEFT, 50.5) + beside, False),
        (solid((-0.001, 0.001), (0.0, 0.01), (0.0, 0.0015)) + beside, True),
        (solid((-0.001, 0.001), (0.0, 0.01), (0.0, 0.0009)) + beside, False),
    ):
        pads = hand_of(toy_robot({"left": [other, LEFT], **wall}, **asked)).pads
        assert (len([p for p in pads if p.link == "left"]) == 2) is counts
    ridge = np.array([[0.004, -0.00025, z] for z in (-0.01, 0.04)])  # the other side is 0.37 mm off its plane
    hand = hand_of(toy_robot({"left": np.concatenate([LEFT, ridge]), "right": RIGHT}))
    assert np.ptp(hand.pads[0].window.corners, axis=0) == pytest.approx([0.05, np.hypot(0.015, 0.00025)])
    assert _in_parts(toy_robot(), "left") is False


def test_fingers_that_turn_hold_with_any_of_their_faces() -> None:
    """Each with a ridge down its middle, 10° on either side; other fingers close with the innermost alone."""
    ridged = np.array(
        [[x, y, z] for x, y in ((0, 0), (0.011, 0.002), (-0.011, 0.002), (0.011, 0.01), (-0.011, 0.01)) for z in (-0.01, 0.04)]
    )
    for turns, faces in ((False, ["left", "right"]), (True, ["left", "right", "left", "right"])):
        fingers = {"left": ridged, "right": ridged * [1, -1, 1]}
        hand = hand_of(toy_robot({**PALM, **fingers}, opening=replace(OPENING, round_only=turns)))
        assert [pad.link for pad in hand.pads] == faces


def test_of_several_cups_the_one_at_the_hand_frame_holds() -> None:
    """Of two that are as near to it, the first by name; the others may touch what that one holds."""
    opening = replace(OPENING, cup_m=0.02)
    for x_hand, x_palm, holds in ((0.0, 0.05, "hand"), (0.05, 0.0, "palm"), (0.05, -0.05, "hand"), (-0.06, 0.05, "palm")):
        cups = {"hand": solid((x_hand - 0.01, x_hand + 0.01), (-0.01, 0.01), (0.0, 0.02))}
        cups["palm"] = solid((x_palm - 0.01, x_palm + 0.01), (-0.01, 0.01), (0.0, 0.02))
        hand = hand_of(toy_robot(cups, opening=opening, pads=frozenset(cups)))
        assert ([pad.link for pad in hand.pads], hand.beside) == ([holds], {"hand", "palm"} - {holds})


def test_a_suction_cup_has_one_face() -> None:
    """What of it is within a millimetre of its end; it looks along z, on side 0."""
    cup = [
        solid((-0.02, 0.02), (-0.03, 0.03), (0.0, 0.0189)),
        solid((-0.01, 0.01), (-0.015, 0.015), (0.0, 0.0191)),
        solid((-0.001, 0.001), (-0.001, 0.001), (0.0, 0.02)),
    ]
    opening = replace(OPENING, cup_m=0.02)
    hand = hand_of(toy_robot({"hand": cup, **PALM}, opening=opening, pads=frozenset({"hand"})))
    (pad,) = hand.pads
    assert (pad.link, pad.side, pad.carrier) == ("hand", 0, 4)
    assert pad.T_carrier_face == pytest.approx(transform(p=[0, 0, 0.02]))
    assert (pad.window.corners.min(0).tolist(), pad.window.corners.max(0).tolist()) == (
        pytest.approx([-0.01, -0.015]),
        pytest.approx([0.01, 0.015]),
    )
    assert np.array_equal(hand.values, opening.value)
    assert np.array_equal(hand.widths, opening.width_m)
    assert hand.links == {"hand", "palm"}
    raised = URDF.replace('<child link="hand"/>', '<child link="hand"/><origin xyz="0.1 0 0.2" rpy="0 0 0.5"/>')
    leaning = URDF.replace('<child link="hand"/>', '<child link="hand"/><origin xyz="0.1 0 0.2" rpy="0.3 0 0"/>')
    (pad,) = hand_of(toy_robot({"hand": cup}, urdf=leaning, opening=opening, pads=frozenset({"hand"}))).pads
    assert pad.T_carrier_face == pytest.approx(transform(rotation_about((1, 0, 0), 0.3), [0.1, 0, 0.2]) @ transform(p=[0, 0, 0.02]))
    (pad,) = hand_of(toy_robot({"hand": cup}, urdf=raised, opening=opening, pads=frozenset({"hand"}))).pads
    assert pad.T_carrier_face == pytest.approx(transform(rotation_about((0, 0, 1), 0.5), [0.1, 0, 0.22]))
    (pad,) = hand_of(toy_robot({"palm": cup}, urdf=raised, opening=opening, pads=frozenset({"palm"}))).pads
    assert pad.T_carrier_face == pytest.approx(transform(rotation_about((0, 0, 1), 0.5), [0.1, 0, 0.02]))
    corners = pad.window.corners @ rotation_about((0, 0, 1), 0.5)[:2, :2].T + [0.1, 0.0]
    assert (corners.min(0), corners.max(0)) == (pytest.approx([-0.01, -0.015]), pytest.approx([0.01, 0.015]))
    (pad,) = hand_of(toy_robot({"tool": cup}, urdf=raised, opening=opening, pads=frozenset({"tool"}))).pads
    seen = pad.window.corners @ rotation_about((0, 0, 1), 0.5)[:2, :2].T + [0.1, 0.0]
    there = np.array([[x, y] for x in (-0.01, 0.01) for y in (-0.015, 0.015)]) @ rotation_about((0, 0, 1), 0.7)[:2, :2].T + [0.0, 0.4]
    assert (seen.min(0), seen.max(0)) == (pytest.approx(there.min(0)), pytest.approx(there.max(0)))
    assert pad.T_carrier_face == pytest.approx(transform(rotation_about((0, 0, 1), 0.5), [0.1, 0, -0.18]))
    with pytest.raises(ValueError, match=r"^robot toy: the suction cup 'left' does not go with the hand frame$"):
        hand_of(toy_robot({"left": cup}, opening=opening, pads=frozenset({"left"})))


def test_pads_close_as_the_gripper_table_says(robot: Robot) -> None:
    """Found in another way, and measured in another way."""
    hand = hand_of(robot)
    assert {p.link for p in hand.pads} <= robot.pads
    assert sorted(p.side for p in hand.pads) == [-1, 1]
    assert hand.max_width_m == pytest.approx(robot.opening.max_m, abs=1e-4)
    assert np.abs(hand.width(robot.opening.value) - robot.opening.width_m).max() < 1e-4
    assert hand.fingers == robot.fingers


def test_pads_of_a_sliding_gripper(toy_urdf: Callable[..., Path]) -> None:
    toy = load(str(toy_urdf()), "tcp", "grip")
    hand = hand_of(toy)
    assert hand.width(np.array([0.0, 0.04])) == pytest.approx([0.0, 0.08])
    frames = in_hand(hand, 0.02)
    for pad in hand.pads:
        T = frames[pad.carrier] @ pad.T_carrier_face
        assert T[:3, 2] == pytest.approx([0.0, -pad.side, 0.0])
        assert np.ptp(pad.window.corners, axis=0) == pytest.approx([0.07, 0.02])  # along the finger, across it
