"""What stands, floats, hangs over, is stacked, tips or leans."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.verdict import standing
from planning.verdict.standing import Placed, Stand, falls, placed, stand, stand_among

CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(rotation_about((0, 0, 1), 0.4), [0.30, 0.1, 0.10]), 0.03)
BOX, CAN = Box(np.array([0.06, 0.04, 0.10])), Cylinder(0.03, 0.12)


def put(shape: Shape, T_cabinet: Array, name: str = "it") -> Placed:
    return placed(name, shape, CABINET.T_world_cabinet @ T_cabinet, CABINET)


def on(shape: Shape, T: Array, *others: Placed) -> Stand:
    return stand(put(shape, T), others, CABINET, 0.001)


@pytest.mark.parametrize(("shape", "half"), [(BOX, 0.05), (CAN, 0.06)], ids=["box", "can"])
@pytest.mark.parametrize(("up", "stands"), [(0.0, True), (0.0009, True), (-0.0009, True), (0.0012, False), (-0.0012, False), (0.2, False)])
def test_within_a_millimetre_of_the_floor(shape: Shape, half: float, up: float, stands: bool) -> None:
    found = on(shape, transform(rotation_about((0, 0, 1), 1.1), [0.3, 0.1, half + up]))
    assert found.carried == stands
    assert found.gap_m == pytest.approx(up, abs=1e-9)
    assert (found.on == ("floor",)) == stands


@pytest.mark.parametrize(("x", "stands"), [(0.031, True), (0.001, True), (-0.001, False), (-0.04, False)])
def test_over_the_front_edge(x: float, stands: bool) -> None:
    """A box 6 cm deep stands as long as its middle is over the floor."""
    assert on(BOX, transform(p=[x, 0.0, 0.05])).carried == stands


@pytest.mark.parametrize(("shift", "stands"), [(0.0, True), (0.028, True), (0.032, False)])
def test_on_another(shift: float, stands: bool) -> None:
    below = put(Box(np.array([0.06, 0.06, 0.08])), transform(p=[0.3, 0.0, 0.04]), "below")
    found = on(CAN, transform(p=[0.3 + shift, 0.0, 0.08 + 0.06]), below)
    assert found.carried == stands
    assert found.on == ("below",)


def test_on_two_at_once() -> None:
    """A plank over a gap: neither post alone is under its middle."""
    posts = [put(Box(np.array([0.03, 0.03, 0.1])), transform(p=[0.3, y, 0.05]), str(y)) for y in (-0.1, 0.1)]
    plank = Box(np.array([0.04, 0.3, 0.02]))
    assert on(plank, transform(p=[0.3, 0.0, 0.11]), *posts).carried
    assert not on(plank, transform(p=[0.3, 0.0, 0.11]), posts[0]).carried


@pytest.mark.parametrize(("degrees", "stands"), [(0.3, True), (3.0, False), (20.0, False)])
def test_tilted_on_an_edge(degrees: float, stands: bool) -> None:
    """Within a millimetre a third of a degree is flat; beyond, it stands on an edge and falls back."""
    R = rotation_about((0, 1, 0), np.radians(degrees))
    lowest = (box_corners(BOX.half) @ R.T)[:, 2].min()
    assert on(BOX, transform(R, [0.3, 0.0, -lowest])).carried == stands


def test_a_board_that_leans_on_the_back_wall_stands() -> None:
    board = Box(np.array([0.01, 0.1, 0.3]))
    wall = CABINET.walls()[4]
    back = placed("back", wall.shape, wall.T_world_body, CABINET)
    R = rotation_about((0, 1, 0), np.radians(15))
    corners = box_corners(board.half) @ R.T
    T = transform(R, [0.56 - corners[:, 0].max(), 0.0, -corners[:, 2].min()])
    assert on(board, T, back).carried
    assert not on(board, T).carried
    assert set(on(board, T, back).on) == {"floor", "back"}


def test_a_mesh_stands_on_its_feet() -> None:
    """Two legs and a top: its middle is over the hull of both feet; over one of them it is not."""
    legs = [box_corners(np.array([0.01, 0.02, 0.05])) + np.array([x, 0.0, 0.05]) for x in (-0.05, 0.05)]
    top = box_corners(np.array([0.06, 0.02, 0.01])) + np.array([0.0, 0.0, 0.11])
    assert on(ConvexMesh((*legs, top)), transform(p=[0.3, 0.0, 0.0])).carried
    assert not on(ConvexMesh((legs[0], top)), transform(p=[0.3, 0.0, 0.0])).carried


# -------------------------------------------------------------------------------------------------------------------------------- by hand

ROOM = Cabinet(np.array([0.4, 0.6, 0.5]), np.eye(4), 0.03)
"""Its floor goes from x = 0 to 0.43 and from y = -0.33 to 0.33, the walls' part included."""


def block(x: float, y: float, z: float, *size: float, name: str = "it") -> Placed:
    """A box with its middle at (x, y), its foot at z."""
    return placed(name, Box(np.array(size)), transform(p=[x, y, z + size[2] / 2]), ROOM)


def stands(body: Placed, *others: Placed, within_m: float = 0.001) -> tuple[tuple[str, ...], float, float]:
    found = stand(body, others, ROOM, within_m)
    return found.on, pytest.approx(found.gap_m), pytest.approx(found.off_m)


def test_where_a_body_is_in_its_cabinet() -> None:
    turned = Cabinet(np.ones(3), transform(rotation_about((0, 0, 1), np.pi / 2), [1.0, 2.0, 3.0]), 0.03)
    found = placed("it", Box(np.array([0.2, 0.4, 0.6])), transform(p=[1.0, 2.5, 3.3]), turned)  # half a metre along the cabinet's x
    assert found.name == "it"
    assert found.low == pytest.approx([0.3, -0.1, 0.0])
    assert found.high == pytest.approx([0.7, 0.1, 0.6])
    assert len(found.parts) == 1
    assert len(placed("can", CAN, np.eye(4), turned).parts[0].vertices) == 2 * 24


def test_how_far_the_middle_is_beyond_the_floor() -> None:
    for x, y, off in (
        (0.2, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (-0.01, 0.0, 0.01),
        (0.43, 0.0, 0.0),
        (0.45, 0.1, 0.02),
        (0.2, 0.33, 0.0),
        (0.2, 0.34, 0.01),
        (0.2, -0.335, 0.005),
        (-0.03, 0.37, 0.05),
        (-0.03, -0.37, 0.05),
        (0.46, 0.37, 0.05),
    ):
        assert stands(block(x, y, 0.0005, 0.2, 0.2, 0.1)) == (("floor",), 0.0005, off), (x, y)
    assert stands(block(-0.2, 0, 0, 0.2, 0.2, 0.1)) == ((), 0.0, np.inf)  # wholly before it


def test_what_is_too_high_or_too_low_stands_on_nothing() -> None:
    for z, some in ((0.00099, True), (-0.00099, True), (0.00101, False), (-0.00101, False), (0.3, False)):
        assert stands(block(0.2, 0, z, 0.1, 0.1, 0.1)) == ((("floor",), z, 0.0) if some else ((), z, np.inf))
        below = block(0.2, 0, 0.0, 0.1, 0.1, 0.1, name="below")
        if -0.001 < z < 0.3:
            assert stands(block(0.2, 0, 0.1 + z, 0.1, 0.1, 0.1), below) == ((("below",), z, 0.0) if some else ((), 0.1 + z, np.inf))


@pytest.mark.parametrize("gap_m", [-0.0005, 0.0005])
def test_what_lies_on_it_carries_nothing(gap_m: float) -> None:
    """Nothing hangs in the air from what lies on it, or under a ceiling."""
    for above in (block(0.2, 0, 0.15 + gap_m, 0.05, 0.05, 0.05, name="above"), block(0.2, 0, 0.15 + gap_m, 0.4, 0.4, 0.03, name="ceiling")):
        assert stands(block(0.2, 0, 0.05, 0.1, 0.1, 0.1), above) == ((), 0.05, np.inf)


def test_what_is_just_near_enough_carries() -> None:
    """A quarter of a metre, exact in binary: from the floor, wholly over it or not, and from another."""
    for x in (0.25, 0.0):
        assert stands(block(x, 0, 0.25, 0.125, 0.125, 0.125), within_m=0.25)[0] == ("floor",)
        assert stands(block(x, 0, 0.25, 0.125, 0.125, 0.125), within_m=0.249)[0] == ()
    below = block(0.25, 0, 0.0, 0.125, 0.125, 0.5, name="below")
    assert stands(block(0.25, 0, 0.75, 0.125, 0.125, 0.125), below, within_m=0.25)[0] == ("below",)


def test_only_the_upper_side_of_what_is_below_carries() -> None:
    """Of a post that grows narrower; and of one in which a body is it is said how high it is over the floor."""
    foot, top = ([[x * s, y * s, z] for x in (-1, 1) for y in (-1, 1)] for s, z in ((0.1, 0.0), (0.01, 0.2)))
    narrow = placed("narrow", ConvexMesh((np.array(foot + top),)), transform(p=[0.2, 0.0, 0.0]), ROOM)
    on, _, off = stands(block(0.23, 0.0, 0.2, 0.1, 0.1, 0.1), narrow)
    assert (on, off) == (("narrow",), pytest.approx(0.02, abs=6e-4))  # the section is taken a millimetre down
    tall = block(0.2, 0.0, 0.0, 0.1, 0.1, 0.2, name="tall")
    assert stand(block(0.2, 0.0, 0.05, 0.02, 0.02, 0.1), [tall], ROOM, 0.001).gap_m == pytest.approx(0.05)


def test_feet_that_are_not_under_the_middle_do_not_carry_on_others_either() -> None:
    """One leg and a top: its middle is over the block, or over one with three sides, but not over its foot."""
    leg = box_corners(np.array([0.01, 0.02, 0.05])) + np.array([-0.05, 0.0, 0.05])
    lame = placed(
        "it", ConvexMesh((leg, box_corners(np.array([0.06, 0.02, 0.01])) + np.array([0.0, 0.0, 0.11]))), transform(p=[0.2, 0, 0.2]), ROOM
    )
    triangle = np.array([[x, y, z] for x, y in ((-0.2, -0.3), (-0.2, 0.3), (0.3, 0.0)) for z in (0.0, 0.2)])
    for below in (block(0.2, 0.0, 0.0, 0.4, 0.4, 0.2, name="low"), placed("low", ConvexMesh((triangle,)), transform(p=[0.2, 0, 0]), ROOM)):
        found = stand(lame, [below], ROOM, 0.001)
        assert found.on == ("low",)
        assert found.off_m == pytest.approx(0.04 - 0.05 * 8 / 17.6)  # the leg's volume is 80 cm³, the top's 96
        assert not found.carried


def test_the_middle_is_over_what_carries() -> None:
    """A board 40 cm long on a block of 10: 5 mm too far, or on two blocks of different heights, the nearest of which is told."""
    below = block(0.1, 0.0, 0.0, 0.1, 0.1, 0.2, name="below")
    assert stands(block(0.155, 0.0, 0.2, 0.4, 0.05, 0.02), below) == (("below",), 0.0, 0.005)
    assert stands(block(0.145, 0.0, 0.2, 0.4, 0.05, 0.02), below) == (("below",), 0.0, 0.0)
    other = block(0.3, 0.0, 0.0, 0.1, 0.1, 0.2004, name="other")
    board = block(0.2, 0.0, 0.2002, 0.4, 0.05, 0.02)
    assert stands(board, below, other) == (("below", "other"), 0.0002, 0.0)
    nearer = block(0.3, 0.0, 0.0, 0.1, 0.1, 0.2001, name="other")
    assert stands(board, below, nearer) == (("below", "other"), 0.0001, 0.0)
    far = block(0.3, 0.2, 0.0, 0.1, 0.1, 0.2, name="far")
    assert stands(board, far, below) == (("below",), 0.0002, 0.05)
    on_edge = block(0.2, 0.075, 0.2, 0.1, 0.1, 0.02)  # its side over the block's middle: they meet in a strip of 2.5 cm
    assert stands(on_edge, block(0.2, 0.0, 0.0, 0.1, 0.1, 0.2, name="below")) == (("below",), 0.0, 0.025)


def test_a_body_in_parts_carries_and_is_named_once() -> None:
    legs = ConvexMesh(tuple(box_corners(np.array([0.02, 0.02, 0.1])) + np.array([x, 0.0, 0.1]) for x in (-0.1, 0.1)))
    below = placed("legs", legs, transform(p=[0.2, 0.0, 0.0]), ROOM)
    assert stands(block(0.2, 0.0, 0.2, 0.3, 0.05, 0.02), below) == (("legs",), 0.0, 0.0)
    assert stands(block(0.335, 0.0, 0.2, 0.6, 0.05, 0.02), below) == (("legs",), 0.0, 0.015)
    assert stands(placed("it", legs, transform(p=[-0.01, 0, 0]), ROOM)) == (("floor",), 0.0, 0.01)
    assert stands(placed("it", legs, transform(p=[0.0, 0, 0]), ROOM)) == (("floor",), 0.0, 0.0)


def test_what_has_room_for_rounding_and_no_more() -> None:
    assert Stand(("floor",), 0.0, 0.99e-6).carried
    assert not Stand(("floor",), 0.0, 1e-6).carried


def test_a_point_is_off_a_line_though_it_lies_on_it() -> None:
    """Nothing stands on a line, nor on a point, nor on nothing."""
    line, here = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([0.5, 0.0])
    assert standing._off([line], here) == standing.OVER_M == 1e-6
    assert standing._off([line], np.array([0.5, 0.3])) == pytest.approx(0.3)
    assert standing._off([line[:1]], np.zeros(2)) == standing.OVER_M
    assert standing._off([], here) == standing._off([line[:0]], here) == np.inf
    triangle = [line, np.array([[0.0, 1.0]])]
    assert standing._off(triangle, np.array([0.2, 0.2])) == 0.0
    assert standing._off(triangle, np.array([-0.2e-6, 0.2])) == pytest.approx(0.2e-6)


def test_in_which_direction_another_is() -> None:
    a = block(0.0, 0.0, 0.0, 0.1, 0.1, 0.1).parts[0]
    for gap, some in ((0.0005, True), (-0.0005, True), (0.0011, False)):
        for way in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            b = block(*(np.array(way) * (0.1 + gap)), 0.0, 0.1, 0.1, 0.1).parts[0]
            u = standing._direction(a, b, 0.001)
            assert (u is not None) == some
            if u is not None:
                assert u == pytest.approx([*way, 0], abs=1e-6)


def test_only_what_is_near_along_every_axis_is_asked_about() -> None:
    """Whatever has a direction has boxes that meet; boxes of what is askew may meet though it is apart."""
    a, rng, some = block(0.0, 0.0, 0.0, 0.1, 0.1, 0.1).parts[0], np.random.default_rng(2), 0
    for _ in range(300):
        T = transform(rotation_about((0, 0, 1), rng.uniform(0, 3)), rng.uniform(-0.13, 0.13, 3))
        b = a.moved(T)
        meet = standing.boxes_meet(a, b, 0.001)
        assert meet == standing.boxes_meet(b, a, 0.001)
        some += not meet
        if standing._direction(a, b, 0.001) is not None:
            assert meet
    assert 50 < some < 250
    for axis in np.eye(3):
        assert standing.boxes_meet(a, a.moved(transform(p=0.1009 * axis)), 0.001)
        assert not standing.boxes_meet(a, a.moved(transform(p=0.1011 * axis)), 0.001)


def test_boxes_that_are_just_so_far_apart_meet() -> None:
    a, b = block(0.0, 0.0, 0.0, 1.0, 1.0, 1.0).parts[0], block(1.125, 0.0, 0.0, 1.0, 1.0, 1.0).parts[0]
    assert standing.boxes_meet(a, b, 0.125)
    assert standing.boxes_meet(b, a, 0.125)


def test_what_lies_on_another_is_above_it_and_not_in_it() -> None:
    """Askew by as much as a tenth of a direction's length it lies beside it; a millimetre deep it lies on it still."""
    for up, above in ((1.0, True), (0.15, True), (0.1, False), (0.05, False), (-0.15, False)):
        u = np.array([np.sqrt(1 - up**2), 0.0, up])
        lower = block(0.0, 0.0, 0.0, 0.1, 0.1, 0.1).parts[0].moved(transform(np.stack([u, [0, 1, 0], np.cross(u, [0, 1, 0])], 1)))
        for gap_m, lies in ((0.0009, above), (-0.0009, above), (-0.0011, False), (-0.02, False)):
            assert standing._lies_on(lower.moved(transform(p=(0.1 + gap_m) * u)), lower, u, 0.001) is lies, (up, gap_m)
    lower, upper = block(0.0, 0.0, 0.0, 0.5, 0.5, 0.5).parts[0], block(0.0, 0.0, 0.375, 0.5, 0.5, 0.5).parts[0]
    assert standing._lies_on(upper, lower, np.array([0.0, 0.0, 1.0]), 0.125)


def test_who_falls() -> None:
    """Who is carried does not; nor does what stood beside its support from the start, unless it is further beside it, or in the air now."""
    carried, air = Stand(("a",), 0.0, 0.0), Stand((), 0.2, np.inf)

    def beside(off_m: float) -> Stand:
        return Stand(("a",), 0.0, off_m)

    cases = [
        (carried, carried, False),
        (carried, beside(0.01), False),
        (carried, air, False),
        (air, carried, True),
        (air, air, True),
        (beside(0.01), carried, True),
        (beside(0.01), beside(0.01), False),
        (beside(0.0109), beside(0.01), False),
        (beside(0.0111), beside(0.01), True),
    ]
    for at, first, fallen in cases:
        assert falls(at, first, 0.001) is fallen, (at, first)


def test_walls_and_obstacles_carry_and_what_is_gone_does_not() -> None:
    """A can on a table that nobody moves, on another object, and on itself alone; a board at the left wall."""
    table = Body("table", Box(np.array([0.1, 0.1, 0.2])), CABINET.T_world_cabinet @ transform(p=[0.3, 0.0, 0.1]))
    scene = Scene("stands", RobotRef(np.eye(4), "ur5e"), CABINET, (), None, None, obstacles=(table,))
    low, can = put(BOX, transform(p=[0.3, 0.2, 0.05]), "low"), put(CAN, transform(p=[0.3, 0.2, 0.16]), "can")
    high = put(CAN, transform(p=[0.3, 0.0, 0.26]), "high")
    assert stand_among(high, (), scene, 0.001).on == ("table",)
    assert stand_among(can, (low, can), scene, 0.001).on == ("low",)
    assert stand_among(can, (can,), scene, 0.001).on == ()
    assert stand_among(can, (can, put(BOX, transform(p=[0.3, 0.2, 0.05]), "can")), scene, 0.001).on == ()
    lean = transform(rotation_about((1, 0, 0), -0.3))
    board = put(Box(np.array([0.1, 0.01, 0.2])), lean)
    board = put(Box(np.array([0.1, 0.01, 0.2])), transform(p=[0.3, 0.43 - board.high[1], -board.low[2]]) @ lean, "board")
    assert set(stand_among(board, (), scene, 0.001).on) == {"floor", "left"}


def test_the_patch_in_which_two_touch() -> None:
    """Seen from above: of faces that are upright, where they overlap along y; of an edge on a face, the edge; of two edges, a point."""
    a = block(0.0, 0.0, 0.0, 0.1, 0.2, 0.1).parts[0]
    b = block(0.1, 0.05, 0.0, 0.1, 0.2, 0.3).parts[0]
    patch = standing._common(a, b, np.array([1.0, 0.0, 0.0]), 0.001)
    assert patch[:, 0] == pytest.approx(np.full(len(patch), 0.05))
    assert (patch[:, 1].min(), patch[:, 1].max()) == pytest.approx((-0.05, 0.1))
    across = block(0.0, 0.2, 0.0, 0.04, 0.2, 0.3).parts[0]
    patch = standing._common(a, across, np.array([0.0, 1.0, 0.0]), 0.001)
    assert patch[:, 1] == pytest.approx(np.full(len(patch), 0.1))
    assert (patch[:, 0].min(), patch[:, 0].max()) == pytest.approx((-0.02, 0.02))
    R = rotation_about((0, 1, 0), 0.5)
    nearest = (box_corners(np.array([0.05, 0.03, 0.2])) @ R.T).min(0)[0]
    tilted = placed("it", Box(np.array([0.1, 0.06, 0.4])), transform(R, [0.05 - nearest, 0.0, 0.2]), ROOM).parts[0]
    patch = standing._common(a, tilted, np.array([1.0, 0.0, 0.0]), 1e-6)
    assert patch[:, 0] == pytest.approx(np.full(len(patch), 0.05))
    assert np.sort(patch[:, 1]) == pytest.approx([-0.03, 0.03])
    crossed = standing._common(tilted, a, np.array([-1.0, 0.0, 0.0]), 1e-6)
    assert np.sort(crossed[:, 1]) == pytest.approx([-0.03, 0.03])


def test_the_patch_of_faces_that_lean() -> None:
    """Two boxes side by side, both turned askew: the corners of their common face, seen from above."""
    T = transform(rotation_about((1, 2, 3), 0.9), [0.1, 0.2, 0.5])
    for axis in range(3):
        step = 0.1 * np.eye(3)[axis]
        a, b = (placed("", Box(np.full(3, 0.1)), T @ transform(p=p), ROOM).parts[0] for p in (0 * step, step))
        patch = standing._common(a, b, T[:3, axis], 1e-6)
        corners = [T @ np.append(c, 1.0) for c in box_corners(np.full(3, 0.05)) if c[axis] > 0]
        assert {tuple(p) for p in np.round(patch, 6)} == {tuple(np.round(c[:2], 6)) for c in corners}


def test_the_patch_of_a_face_with_three_corners() -> None:
    wedge = np.array([[x, y, z] for x in (0.05, 0.15) for y, z in ((-0.05, 0.02), (0.05, 0.02), (0.0, 0.08))])
    a = block(0.0, 0.0, 0.0, 0.1, 0.2, 0.1).parts[0]
    patch = standing._common(a, placed("", ConvexMesh((wedge,)), np.eye(4), ROOM).parts[0], np.array([1.0, 0, 0]), 1e-6)
    assert np.sort(patch[:, 1]) == pytest.approx([-0.05, 0.0, 0.05])


def test_the_patch_of_two_faces_with_three_corners() -> None:
    """The same triangle, from both sides."""
    corners = ((-0.05, 0.02), (0.05, 0.02), (0.0, 0.08))
    a, b = (
        placed("", ConvexMesh((np.array([[x, y, z] for x in ends for y, z in corners]),)), np.eye(4), ROOM).parts[0]
        for ends in ((-0.1, 0.0), (0.0, 0.1))
    )
    assert np.sort(standing._common(a, b, np.array([1.0, 0, 0]), 1e-6)[:, 1]) == pytest.approx([-0.05, 0.0, 0.05])


def test_what_leans_is_carried_at_both_ends() -> None:
    """A board whose foot stands 10 cm before a block that it leans on with its back: the block's edge is under its upper end.

    Of what is beside it and does not touch it nothing is told.
    """
    board, R = Box(np.array([0.01, 0.1, 0.3])), rotation_about((0, 1, 0), np.radians(30))
    foot = box_corners(board.half) @ R.T
    p = np.array([0.1, 0.0, 0.0]) - foot[np.argmin(foot[:, 2])] * [1, 0, 1]
    leaner = placed("it", board, transform(R, p), ROOM)
    # its underside rises by √3 along x from the foot's edge at x = 0.1; the block's upper edge is at x = 0.2, and 0.2 mm
    post = block(0.2502, 0.0, 0.0, 0.1, 0.3, 0.1 * np.sqrt(3), name="post")
    beside = block(0.2, 0.1, 0.0, 0.05, 0.09, 0.3, name="beside")
    found = stand(leaner, [beside, post], ROOM, 0.001)
    assert found.on == ("floor", "post")
    assert found.carried
    assert found.gap_m == pytest.approx(0.0, abs=1e-9)
    touching = block(0.25, 0.0, 0.0, 0.1, 0.3, 0.1 * np.sqrt(3)).parts[0]
    assert standing._direction(leaner.parts[0], touching, 0.001) is None  # without a gap there is no telling
    low = block(0.25, 0.0, 0.0, 0.1, 0.3, 0.1 * np.sqrt(3) - 0.02, name="low")
    alone = stand(leaner, [low], ROOM, 0.001)
    assert alone.on == ("floor",)
    assert not alone.carried
    middle = p[0]
    assert alone.off_m == pytest.approx(middle - 0.1, abs=0.002)
