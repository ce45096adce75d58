"""Grasps of a cup of 2 cm, each worked out by hand: on boxes, cylinders and meshes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from kinematics.robots.hands.opening import Opening
from kinematics.scene import APPROACHES, Body, Grasp
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.cup_grasps import DOWN, LEVEL, _hands, cup_grasps, faces_of
from planning.grasping.sampling import Headings, Sampling

CUP = Opening(np.array([0.0, 1.0]), np.array([0.02, 0.1]), np.zeros(2), np.zeros(2), cup_m=0.02)
MIDDLE = np.array([0.5, 0.1, 0.25])
FOUR = Sampling(yaws=4, heights=(0.6,))
BRICK = Box(np.array([0.06, 0.08, 0.10]))
CUBE = Box(np.full(3, 0.06))


def no_lowest(kind: str, pitch: float) -> float:
    return 0.0


def grasps(
    shape: Shape,
    *,
    R: Array | None = None,
    approaches: Sequence[str] = APPROACHES,
    floor_z: float = 0.0,
    toward: float = 0.0,
    sampling: Sampling = FOUR,
    headings: Headings | None = None,
) -> list[Grasp]:
    body = Body("it", shape, transform(np.eye(3) if R is None else R, MIDDLE))
    return list(cup_grasps(body, CUP, approaches, floor_z, toward, sampling, headings, no_lowest))


def ways(found: Sequence[Grasp], R: Array | None = None) -> list[tuple[float, ...]]:
    """Where each cup is, from the body's middle, and where it looks; both in the frame R."""
    back = (np.eye(3) if R is None else R).T
    rows = [[*(back @ (g.T_world_hand[:3, 3] - MIDDLE)), *(back @ g.T_world_hand[:3, 2])] for g in found]
    return [tuple(float(v) + 0.0 for v in np.round(row, 6)) for row in rows]


LEFT, RIGHT = (0.0, 0.04, 0.01, 0.0, -1.0, 0.0), (0.0, -0.04, 0.01, 0.0, 1.0, 0.0)
NEAR, FAR, TOP = (-0.03, 0.0, 0.01, 1.0, 0.0, 0.0), (0.03, 0.0, 0.01, -1.0, 0.0, 0.0), (0.0, 0.0, 0.05, 0.0, 0.0, -1.0)


@pytest.mark.parametrize("yaw", [0.0, 0.3, 3.0, -2.5])
def test_a_brick_is_taken_from_all_sides_but_from_below_the_nearest_first(yaw: float) -> None:
    """By how far the hand turns, and the top as if by an eighth of a turn more; sides at 0.6 of the height, with two hands each."""
    R = rotation_about((0, 0, 1), yaw)
    found = grasps(BRICK, R=R, toward=yaw)
    in_order = ways(found, R)
    assert in_order[:3] == [NEAR, NEAR, TOP]
    assert sorted(in_order[3:7]) == sorted([LEFT, LEFT, RIGHT, RIGHT])
    assert in_order[7:] == [TOP, TOP, FAR, FAR, TOP]
    assert {g.width_m for g in found} == {0.02}
    x = [R.T @ g.T_world_hand[:3, 0] for g in found]
    np.testing.assert_allclose(sorted(v[2] for v in x[:2]), [-1, 1], atol=1e-9)  # up, and after half a turn down
    np.testing.assert_allclose(x[2], [-1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(sorted(v[1] for v in (x[7], x[8])), [-1, 1], atol=1e-9)
    np.testing.assert_allclose(x[11], [1, 0, 0], atol=1e-9)
    for g in found:
        np.testing.assert_allclose(np.cross(g.T_world_hand[:3, 0], g.T_world_hand[:3, 1]), g.T_world_hand[:3, 2], atol=1e-9)


def test_a_brick_upside_down_is_taken_like_one_that_is_not() -> None:
    R = rotation_about((1, 0, 0), np.pi)
    assert sorted(ways(grasps(BRICK, R=R))) == sorted(ways(grasps(BRICK)))


def test_a_pose_that_is_rounded_up_has_a_top() -> None:
    """Whose normal is a little longer than 1, so that it rises by more than there is."""
    assert set(ways(grasps(BRICK, R=np.diag([1.0, 1.0, np.nextafter(1.0, 2.0)]), approaches=("downward",)))) == {TOP}


def test_only_the_approaches_that_are_asked_for() -> None:
    assert set(ways(grasps(BRICK, approaches=("downward",)))) == {TOP}
    assert set(ways(grasps(BRICK, approaches=("horizontal",)))) == {NEAR, FAR, LEFT, RIGHT}
    assert not grasps(BRICK, approaches=("diagonal",))


def heights(floor_z: float, *shares: float) -> list[float]:
    """Of the near side's grasps with the first of two hands, from the brick's middle."""
    found = grasps(BRICK, approaches=("horizontal",), floor_z=floor_z, sampling=Sampling(heights=shares))
    return [way[2] for way in ways(found) if way[0] == -0.03][::2]


def test_heights_on_a_side() -> None:
    """The cup keeps a radius and a millimetre from the edges, 39 mm from the middle; the floor may leave less, or nothing."""
    assert heights(0.0, 0.6, 0.85, 0.2) == [0.01, 0.035, -0.03]
    assert heights(0.0, 0.0, 1.0) == [-0.039, 0.039]
    assert heights(0.0, 0.0, 0.01) == [-0.039]
    assert heights(0.0, 0.6, 0.600001) == [0.01]  # to a micrometre
    assert heights(0.25, 0.0, 0.6) == [0.0, 0.01]
    assert heights(0.2889, 0.6) == [0.0389]
    assert heights(0.2891, 0.6) == []


def test_a_top_is_taken_from_the_lowest_height_on() -> None:
    assert grasps(BRICK, approaches=("downward",), floor_z=0.3)
    assert not grasps(BRICK, approaches=("downward",), floor_z=0.3001)


def test_a_later_height_costs_less_than_a_quarter_turn() -> None:
    """0.3 rad each: two come before the top, whose cost is 0.79, and the third after it."""
    found = grasps(BRICK, sampling=Sampling(yaws=1, heights=(0.5, 0.6, 0.7, 0.4)))
    heights = [way[2] if way[0] else 0.05 for way in ways(found)]
    assert heights[:9] == [0.0, 0.0, 0.01, 0.01, 0.02, 0.02, 0.05, -0.01, -0.01]


def test_the_floor_is_asked_about_by_approach_and_pitch() -> None:
    """A leaning box: its near side looks up by 25 degrees, its top is pitched by 65."""
    asked = set[tuple[str, float]]()

    def lowest(kind: str, pitch: float) -> float:
        asked.add((kind, round(float(np.degrees(pitch)), 6)))
        return 0.275 if kind == "diagonal" else 0.0

    body = Body("it", CUBE, transform(rotation_about((0, 1, 0), np.radians(25)), MIDDLE))
    found = list(cup_grasps(body, CUP, APPROACHES, 0.0, 0.0, FOUR, None, lowest))
    assert asked == {("horizontal", 0.0), ("diagonal", 25.0), ("diagonal", 65.0)}
    co, si = np.cos(np.radians(25)), np.sin(np.radians(25))
    near, top = [g for g in found if g.T_world_hand[0, 2] > 0.5], [g for g in found if g.T_world_hand[2, 2] < -0.8]
    assert (len(near), len(top)) == (2, 2)
    along = (0.025 - 0.03 * si) / co * np.array([si, 0, co])
    np.testing.assert_allclose(near[0].T_world_hand[:3, 3], MIDDLE + 0.03 * np.array([-co, 0, si]) + along, atol=2e-6)
    np.testing.assert_allclose(top[0].T_world_hand[:3, 3], MIDDLE + 0.03 * np.array([si, 0, co]), atol=1e-9)
    assert not list(cup_grasps(body, CUP, ("diagonal",), 0.01, 0.0, FOUR, None, lowest))


def test_on_a_leaning_side_a_cup_goes_up_along_it() -> None:
    """At 0.6 of the whole height, a tenth of it above the side's middle; and no further than its room of 19 mm lets it."""
    R = rotation_about((0, 1, 0), np.radians(25))
    co, si = np.cos(np.radians(25)), np.sin(np.radians(25))
    for share, up_m in ((0.6, 0.1 * 0.06 * (co + si) / co), (1.0, 0.019), (0.0, -0.019)):
        found = grasps(CUBE, R=R, sampling=Sampling(heights=(share,)))
        (p, _), *_ = [(g.T_world_hand[:3, 3], g) for g in found if g.T_world_hand[0, 2] > 0.5]
        np.testing.assert_allclose(R.T @ (p - MIDDLE), [-0.03, 0.0, up_m], atol=2e-6)


@pytest.mark.parametrize("degrees", [9.9, 10.1])
def test_what_is_level_and_what_is_straight_down(degrees: float) -> None:
    """Within ten degrees; a side that leans over by more is none."""
    R = rotation_about((0, 1, 0), np.radians(degrees))
    level, down = ({way[3:] for way in ways(grasps(CUBE, R=R, approaches=(kind,)), R)} for kind in ("horizontal", "downward"))
    sides = {(0.0, 1.0, 0.0), (0.0, -1.0, 0.0)}
    if degrees < 10:
        assert level == {(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), *sides}
        assert down == {(0.0, 0.0, -1.0)}
    else:
        assert level == sides
        assert not down
        assert {way[3:] for way in ways(grasps(CUBE, R=R, approaches=("diagonal",)), R)} == {(1.0, 0.0, 0.0), (0.0, 0.0, -1.0)}


def test_what_leans_by_just_ten_degrees_is_neither_level_nor_straight_down() -> None:
    """Nor does its other side lean over too far."""
    R = np.array([[DOWN, 0, LEVEL], [0, 1, 0], [-LEVEL, 0, DOWN]])
    assert {way[3:] for way in ways(grasps(CUBE, R=R, approaches=("diagonal",)), R)} == {
        (1.0, 0.0, 0.0),
        (-1.0, 0.0, 0.0),
        (0.0, 0.0, -1.0),
    }


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_face_takes_the_cup_with_a_millimetre_around_it(axis: int) -> None:
    """22 mm across: with less along one axis only the two faces across that are left."""
    for size, left in ((0.02202, {0, 1, 2}), (0.022, {0, 1, 2}), (0.02198, {axis})):
        edges = np.full(3, 0.06)
        edges[axis] = size
        found = ways(grasps(Box(edges)))
        assert {int(np.argmax(np.abs(way[3:]))) for way in found} == left


def test_above_a_top_the_hand_turns_all_the_way_around_from_where_it_comes() -> None:
    """To the left first; a top may lean a little, here by 5 degrees to +x, and the hand's y stays level with the way it turns."""
    co, si = np.cos(np.radians(5)), np.sin(np.radians(5))
    ahead = np.array([[0, 1, 0], [-1, 0, 0], [0, -1, 0], [1, 0, 0]])
    for normal, y in (
        (np.array([0.0, 0, 1]), [[-1, 0, 0], [0, -1, 0], [1, 0, 0], [0, 1, 0]]),
        (np.array([si, 0, co]), [[-co, 0, si], [0, -1, 0], [co, 0, -si], [0, 1, 0]]),
    ):
        hands = _hands(normal, "downward", ahead[0].astype(float), MIDDLE, FOUR, None, 0.02)
        np.testing.assert_allclose([R[:, 1] for R in hands], y, atol=1e-12)
        np.testing.assert_allclose([R[:, 2] for R in hands], np.tile(-normal, (4, 1)), atol=1e-12)


def test_an_arm_of_few_joints_says_how_its_hand_is_turned_above_a_top() -> None:
    asked, R = list[tuple[Array, float]](), rotation_about((0, 0, 1), 0.2)
    turned = np.stack([R @ [-1, 0, 0], R @ [0, 1, 0], R @ [0, 0, -1]], -1)

    def headings(T: Array, width_m: float) -> list[Array]:
        asked.append((T, width_m))
        return [turned]

    (found,) = grasps(BRICK, approaches=("downward",), toward=0.5, headings=headings)
    ((T, width_m),) = asked
    np.testing.assert_allclose(T[:3, 3], MIDDLE + np.array([0, 0, 0.05]))
    co, si = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(T[:3, :3], np.array([[-co, -si, 0], [-si, co, 0], [0, 0, -1]]), atol=1e-12)
    assert width_m == 0.02
    np.testing.assert_allclose(found.T_world_hand[:3, :3], turned)


# -------------------------------------------------------------------------------------------------------------------------------- cylinders


def test_a_can_has_a_top_and_a_wide_drum_a_side_where_the_hand_comes_from() -> None:
    """Below a cup's lip, 1 cm from its middle, the side may fall away by 0.2 mm: from a radius of 25.01 cm on."""
    ahead = np.array([-0.6, 0.0, 0.8])
    for radius_m, n in ((0.005, 2), (0.01, 2), (0.25, 2), (0.2502, 3), (0.4, 3)):
        faces = faces_of(Cylinder(radius_m, 0.12), 0.01, ahead)
        assert len(faces) == n
        for face, s in zip(faces[:2], (1, -1)):
            np.testing.assert_allclose(face.normal, [0, 0, s])
            np.testing.assert_allclose(face.middle, [0, 0, 0.06 * s])
            np.testing.assert_allclose(face.along, [[1, 0, 0], [0, 1, 0]])
            np.testing.assert_allclose(face.room_m, [radius_m, radius_m])
    np.testing.assert_allclose(faces[2].normal, [-1, 0, 0])
    np.testing.assert_allclose(faces[2].middle, [-0.4, 0, 0])
    np.testing.assert_allclose(faces[2].along, [[0, 0, 1], [0, -1, 0]])
    np.testing.assert_allclose(faces[2].room_m, [0.06, np.inf])
    slanting = faces_of(Cylinder(0.4, 0.12), 0.01, np.array([0.3, 0.4, 0.5]))[2]
    np.testing.assert_allclose(slanting.normal, [0.6, 0.8, 0])
    np.testing.assert_allclose(slanting.along, [[0, 0, 1], [-0.8, 0.6, 0]])
    assert not faces_of(Cylinder(0.4, 0.12), 0.01, np.array([0.0, 0.0, 1.0]))[2].normal.any()


def test_what_is_no_wider_than_the_cup_has_no_side_for_it_however_small_both_are() -> None:
    """The side of a needle of 0.1 mm falls away by no more than that."""
    for radius_m, n in ((0.0001, 2), (0.00011, 3)):
        assert len(faces_of(Cylinder(radius_m, 0.12), 0.0001, np.array([1.0, 0, 0]))) == n


def test_a_drum_is_taken_from_its_near_side() -> None:
    leaning = grasps(Cylinder(0.3, 0.12), R=(R := rotation_about((0, 1, 0), np.radians(5))), toward=1.0, approaches=("horizontal",))
    out = (R.T @ [-np.cos(1.0), -np.sin(1.0), 0.0]) * [1, 1, 0]
    np.testing.assert_allclose(leaning[0].T_world_hand[:3, 2], -R @ out / np.linalg.norm(out), atol=1e-9)
    for toward, R in ((0.0, np.eye(3)), (1.0, rotation_about((0, 0, 1), 2.0))):
        found = grasps(Cylinder(0.3, 0.12), R=R, toward=toward, approaches=("horizontal",))
        there = np.array([np.cos(toward), np.sin(toward), 0.0])
        assert len(found) == 2
        for g in found:
            np.testing.assert_allclose(g.T_world_hand[:3, 3], MIDDLE - 0.3 * there + np.array([0, 0, 0.012]), atol=1e-6)
            np.testing.assert_allclose(g.T_world_hand[:3, 2], there, atol=1e-9)


# ----------------------------------------------------------------------------------------------------------------------------------- meshes


def prism(outline: Sequence[tuple[float, float]], depth_m: float) -> ConvexMesh:
    """An outline in x and z, so deep along y."""
    return ConvexMesh((np.array([[x, y, z] for x, z in outline for y in (-depth_m / 2, depth_m / 2)]),), "prism", 1.0)


def test_the_faces_of_a_brick_that_is_a_mesh_are_those_of_the_brick() -> None:
    """The largest first, each with its middle and its room, along the vertical first."""
    faces = faces_of(ConvexMesh((box_corners(BRICK.half) + np.array([0.01, 0.02, 0.03]),), "brick", 1.0), 0.01, np.array([1.0, 0, 0]))
    assert [int(np.argmax(np.abs(f.normal))) for f in faces] == [0, 0, 1, 1, 2, 2]
    for face in faces:
        axis = int(np.argmax(np.abs(face.normal)))
        np.testing.assert_allclose(face.middle, face.normal * BRICK.half + [0.01, 0.02, 0.03], atol=1e-12)
        first, second = {0: (2, 1), 1: (2, 0), 2: (0, 1)}[axis]
        np.testing.assert_allclose(np.abs(face.along), np.eye(3)[[first, second]], atol=1e-12)
        np.testing.assert_allclose(face.room_m, BRICK.half[[first, second]], atol=1e-12)
        assert face.along[0].sum() > 0
        np.testing.assert_allclose(np.cross(face.normal, face.along[0]), face.along[1], atol=1e-12)


def test_a_slanting_face_of_a_mesh() -> None:
    """A wedge: from (0, 0) and (0.06, 0) up to (0, 0.08); its slope is 10 cm long and looks up by asin 0.6."""
    slope = next(
        f for f in faces_of(prism([(0, 0), (0.06, 0), (0, 0.08)], 0.05), 0.01, np.array([1.0, 0, 0])) if f.normal[0] * f.normal[2] > 0.1
    )
    np.testing.assert_allclose(slope.normal, [0.8, 0, 0.6], atol=1e-12)
    np.testing.assert_allclose(slope.middle, [0.03, 0, 0.04], atol=1e-12)
    np.testing.assert_allclose(slope.along, [[-0.6, 0, 0.8], [0, -1, 0]], atol=1e-12)
    np.testing.assert_allclose(slope.room_m, [0.05, 0.025], atol=1e-12)


def test_the_middle_of_a_face_is_its_centre_of_area() -> None:
    """Of a trapezium, 4 cm wide below, 2 cm above, 3 cm high: at 3 (4 + 2 · 2) / 3 (4 + 2) cm; and the other way about."""
    for below, above, z in ((0.02, 0.01, 0.04 / 3), (0.01, 0.02, 0.05 / 3)):
        outline = [(-below, 0.0), (below, 0.0), (above, 0.03), (-above, 0.03)]
        face = next(f for f in faces_of(prism(outline, 0.05), 0.01, np.array([1.0, 0, 0])) if f.normal[1] > 0.9)
        np.testing.assert_allclose(face.middle, [0, 0.025, z], atol=1e-12)
        np.testing.assert_allclose(face.room_m, [0.05 / 3, 0.02], atol=1e-12)


@pytest.mark.parametrize(("degrees", "n"), [(1.9, 6), (2.1, 7)])
def test_facets_that_hardly_bend_are_one_face(degrees: float, n: int) -> None:
    """A house whose two roofs differ by so much."""
    rise = 0.03 * np.tan(np.radians(degrees / 2))
    house = prism([(-0.03, 0), (0.03, 0), (0.03, 0.05), (0.0, 0.05 + rise), (-0.03, 0.05)], 0.04)
    assert len(faces_of(house, 0.01, np.array([1.0, 0, 0]))) == n


def test_of_a_mesh_the_twenty_four_largest_faces_over_all_its_parts() -> None:
    angles = 2 * np.pi * np.arange(30) / 30
    wheel = prism([(0.1 * np.cos(a), 0.1 * np.sin(a)) for a in angles], 0.02)
    cube = box_corners(np.full(3, 0.02))
    faces = faces_of(ConvexMesh((*wheel.parts, cube), "both", 1.0), 0.01, np.array([1.0, 0, 0]))
    assert len(faces) == 24
    assert {abs(f.normal[1]) for f in faces[:2]} == {1.0}
    assert sum(bool(np.isclose(np.sort(f.room_m), [0.02, 0.02]).all()) for f in faces) == 6
