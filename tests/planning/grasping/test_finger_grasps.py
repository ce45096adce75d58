"""Grasps by hand: where lines cross shapes, which ways fingers may close, at which heights, how deep, and in which order."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import trimesh

from kinematics.robots.hands.opening import Opening
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds, box_corners, prism
from kinematics.transforms import Array, apply, inverse, rotation_about, transform
from planning.grasping import antipodal, candidates, finger_grasps, hand_poses, mesh_grasps
from planning.grasping.antipodal import FRICTION_ANGLE, MESH_FRICTION_ANGLE
from planning.grasping.candidates import closing_directions
from planning.grasping.finger_grasps import CLEARANCE_M, OPEN_STEP_M, open_width, sample_grasps
from planning.grasping.hand_poses import BEHIND_M, BELOW_TOP_M, LEAST_BITE_M, LOWEST_M, MOST_BESIDE_M, set_back, usual_lowest
from planning.grasping.line_contacts import Contact, line_contacts
from planning.grasping.pads import Pad, pad_of
from planning.grasping.sampling import PITCHES
from planning.motion.handling.object_grasps import sampled_grasps
from planning.verdict import judge_grasp

BOX, CAN = Box(np.array([0.04, 0.06, 0.10])), Cylinder(0.03, 0.10)


def table(value: Array, width_m: Array, pad_z_m: Array, depth_m: Array) -> Opening:
    """Of a gripper both of whose jaws move."""
    return Opening(value, width_m, pad_z_m, depth_m, np.zeros(len(value)))


PLAIN = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.full(2, 0.5))
"""A gripper that opens to 0.10 m, its pads in the hand's origin, an open palm far behind them."""
X, Y, Z = np.eye(3)


def test_the_numbers() -> None:
    """All of them in one place; whoever changes one changes plans."""
    assert pytest.approx(np.radians(10)) == FRICTION_ANGLE
    assert pytest.approx(np.radians(20)) == MESH_FRICTION_ANGLE
    assert (CLEARANCE_M, BELOW_TOP_M, BEHIND_M, LEAST_BITE_M) == (0.010, 0.015, 0.005, 0.010)
    assert {"horizontal": (0.0,), "diagonal": (np.pi / 6, np.pi / 3), "downward": (np.pi / 2,)} == PITCHES
    assert LOWEST_M == {"horizontal": 0.040, "diagonal": 0.020, "downward": 0.015}
    assert hand_poses.UP.tolist() == [0.0, 0.0, 1.0]
    assert mesh_grasps.SET_BACKS == (1.0, 0.5, 0.0)
    assert mesh_grasps.BESIDE == (0.2, -0.2, 0.4, -0.4, 0.6, -0.6)
    assert candidates.MESH_HEIGHTS == (0.45, 0.3)
    assert antipodal.SPARE_M == 0.004


# ------------------------------------------------------------------------------------------------------------------------------------ lines


def crossing(
    shape: Shape, origin: Array | list[float], direction: Array | list[float], T: Array | None = None
) -> tuple[float, float] | None:
    found = line_contacts(shape, np.eye(4) if T is None else T, np.array(origin, float), np.array(direction, float))
    return None if found is None else (found.enter, found.leave)


def normals(shape: Shape, origin: Array | list[float], direction: Array | list[float], T: Array | None = None) -> list[list[float]]:
    found = line_contacts(shape, np.eye(4) if T is None else T, np.array(origin, float), np.array(direction, float))
    assert found is not None
    return [found.enter_normal.tolist(), found.leave_normal.tolist()]


def test_a_line_through_a_box() -> None:
    assert crossing(BOX, [0, 0, 0], X) == pytest.approx((-0.02, 0.02))
    assert crossing(BOX, [0.005, 0.01, 0.03], X) == pytest.approx((-0.025, 0.015))
    assert crossing(BOX, [0, 0, 0], -Y) == pytest.approx((-0.03, 0.03))
    assert crossing(BOX, [0, 1.0, 0], Z) is None
    assert crossing(BOX, [-1.0, 0.0, 0.0], X) == pytest.approx((0.98, 1.02))
    assert normals(BOX, [0, 0, 0], X) == [[-1, 0, 0], [1, 0, 0]]
    assert normals(BOX, [0, 0, 0], -Y) == [[0, 1, 0], [0, -1, 0]]
    assert normals(BOX, [0, 0, 0], Z) == [[0, 0, -1], [0, 0, 1]]


def test_a_line_that_misses_a_box_or_runs_along_a_face() -> None:
    for beside, hit in ((0.0299, True), (0.0301, False)):
        assert (crossing(BOX, [0, beside, 0], X) is not None) == hit
        assert (crossing(BOX, [0, -beside, 0], X) is not None) == hit
    assert crossing(BOX, [0, 0.03, 0], X) == pytest.approx((-0.02, 0.02))  # in the face itself
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    for beside, hit in ((0.0499, True), (0.0501, False)):  # past an edge
        assert (crossing(BOX, [0, beside, 0], diagonal) is not None) == hit


def test_a_line_that_touches_an_edge_or_a_rim_in_one_point_misses() -> None:
    across = np.array([0.6, -0.8, 0.0])
    assert crossing(BOX, [0.02, 0.03, 0.0], across * [1, -1, 1]) is not None
    assert crossing(BOX, [0.02, 0.03, 0.0], across) is None
    assert crossing(CAN, [-0.03, 0.0, 0.05], [0.6, 0.0, 0.8]) is None
    assert crossing(CAN, [0.03, 0.0, 0.0], Y) is None


def test_a_line_that_is_all_but_parallel_to_a_face() -> None:
    """It meets the face a million kilometres away, if at all: beside the box it misses, in the box it is as good as parallel."""
    for slope in (1e-13, 1e-12, 1.5e-12, 1e-9):
        for sign in (1, -1):
            d = [1.0, sign * slope, 0.0]
            assert crossing(BOX, [0, 0.031, 0], d) is None
            assert crossing(BOX, [0, -0.031, 0], d) is None
            assert crossing(BOX, [0, 0.029, 0], d) == pytest.approx((-0.02, 0.02))


def test_a_line_all_but_along_a_can_leaves_by_the_side() -> None:
    """Ten nanometres inside the side, and leaning: less than a millionth is taken for upright."""
    assert 1e-6**2 == 1e-12
    for lean, leaves in ((0.9e-6, 0.05), (1e-6, 0.01), (1.25e-6, 0.008)):
        assert crossing(CAN, [0.03 - 1e-8, 0, 0], [lean, 0.0, 1.0]) == pytest.approx((-0.05, leaves), rel=1e-5)


def test_on_the_rim_the_side_counts() -> None:
    down = np.array([0.6, 0.0, -0.8])
    assert normals(CAN, [-0.03, 0, 0.05], down) == [[-1, 0, 0], pytest.approx([1, 0, 0])]
    assert normals(CAN, [0.03, 0, -0.05], down) == [pytest.approx([-1, 0, 0]), [1, 0, 0]]


def test_a_line_into_an_edge_of_a_box_meets_the_first_of_its_faces() -> None:
    assert normals(BOX, [-0.02, -0.03, 0.0], [0.6, 0.8, 0.0])[0] == [-1, 0, 0]
    assert normals(BOX, [0.0, 0.03, -0.05], [0.0, -0.8, 0.6])[0] == [0, 1, 0]


def test_a_line_across_an_edge_of_a_box() -> None:
    """It enters through one face and leaves through another, whose normals are told."""
    assert crossing(BOX, [0, 0.02, 0], np.array([0.6, 0.8, 0.0])) == pytest.approx((-0.02 / 0.6, 0.01 / 0.8))
    assert normals(BOX, [0, 0.02, 0], np.array([0.6, 0.8, 0.0])) == [[-1, 0, 0], [0, 1, 0]]


def test_a_line_through_a_body_that_stands_elsewhere() -> None:
    T = transform(rotation_about(Z, np.pi / 2), [1.0, 2.0, 3.0])  # its x lies along the world's y
    assert crossing(BOX, [1.0, 2.0, 3.0], Y, T) == pytest.approx((-0.02, 0.02))
    assert crossing(BOX, [1.0, 2.0, 3.0], X, T) == pytest.approx((-0.03, 0.03))
    enter, leave = normals(BOX, [1.0, 2.0, 3.0], X, T)
    assert enter == pytest.approx([-1, 0, 0])
    assert leave == pytest.approx([1, 0, 0])


def test_a_line_through_a_can() -> None:
    assert crossing(CAN, [0, 0, 0.04], X) == pytest.approx((-0.03, 0.03))
    assert crossing(CAN, [0, 0.018, 0], X) == pytest.approx((-0.024, 0.024))
    assert crossing(CAN, [0.5, 0.0, 0.0], -X) == pytest.approx((0.47, 0.53))
    assert normals(CAN, [0, 0.018, 0], X) == [pytest.approx([-0.8, 0.6, 0.0]), pytest.approx([0.8, 0.6, 0.0])]
    assert normals(CAN, [0.018, 0, 0.01], Y) == [pytest.approx([0.6, -0.8, 0.0]), pytest.approx([0.6, 0.8, 0.0])]
    assert crossing(CAN, [0.02, 0.02, 0.3], -Z) == pytest.approx((0.25, 0.35))
    assert normals(CAN, [0.02, 0.02, 0.3], -Z) == [[0, 0, 1], [0, 0, -1]]


def test_a_line_that_misses_a_can() -> None:
    for beside, hit in ((0.0299, True), (0.03, False), (0.0301, False)):
        assert (crossing(CAN, [0, beside, 0], X) is not None) == hit
        assert (crossing(CAN, [beside, 0, 0.0], Z) is not None) == hit
    for above, hit in ((0.0499, True), (0.0501, False)):
        assert (crossing(CAN, [0, 0, above], X) is not None) == hit
        assert (crossing(CAN, [0, 0, -above], X) is not None) == hit
    assert crossing(CAN, [0, 0, 0.11], np.array([0.8, 0.0, 0.6])) is None  # over the rim: in the ball, above the lid


def test_a_line_that_enters_a_can_by_the_lid_and_leaves_by_the_side() -> None:
    down = np.array([0.6, 0.0, -0.8])
    assert crossing(CAN, [0, 0, 0.05], down) == pytest.approx((0.0, 0.05))
    assert normals(CAN, [0, 0, 0.05], down) == [[0, 0, 1], pytest.approx([1, 0, 0])]
    assert crossing(CAN, [0, 0, -0.05], down) == pytest.approx((-0.05, 0.0))
    assert normals(CAN, [0, 0, -0.05], down) == [pytest.approx([-1, 0, 0]), [0, 0, -1]]


def test_a_line_through_a_mesh_is_measured_over_all_its_parts() -> None:
    """Two cubes of 2 cm, 4 cm apart: from the first's near face to the last's far face, or through the one that is met."""
    cube = box_corners(np.full(3, 0.01))
    mesh = ConvexMesh((cube + np.array([0.03, 0, 0]), cube + np.array([-0.03, 0.005, 0])))
    assert crossing(mesh, [0, 0, 0], X) == pytest.approx((-0.04, 0.04))
    assert crossing(mesh, [0, 0, 0], -X) == pytest.approx((-0.04, 0.04))
    assert normals(mesh, [0, 0, 0], X) == [pytest.approx([-1, 0, 0]), pytest.approx([1, 0, 0])]
    assert crossing(mesh, [0, 0.012, 0], X) == pytest.approx((-0.04, -0.02))
    assert crossing(mesh, [0, 0.02, 0], X) is None
    stepped = ConvexMesh((box_corners(np.array([0.02, 0.02, 0.02])), box_corners(np.array([0.01, 0.01, 0.05]))))
    assert crossing(stepped, [0, 0, 0], X) == pytest.approx((-0.02, 0.02))


@pytest.mark.parametrize("shape", [BOX, CAN, ConvexMesh((prism(0.03, 0.08, 7),))], ids=["box", "can", "prism"])
def test_where_a_line_enters_it_was_outside_and_goes_inside(shape: Shape) -> None:
    """For random lines and poses: just before enter and just after leave outside, in between inside; and the normals point outwards."""
    rng, hits = np.random.default_rng(5), 0
    for _ in range(150):
        T = transform(rotation_about(rng.normal(size=3), rng.uniform(0, 3)), rng.normal(size=3))
        d = rng.normal(size=3)
        d /= np.linalg.norm(d)
        o = T[:3, 3] + rng.uniform(-0.06, 0.06, 3)
        found = line_contacts(shape, T, o, d)
        steps = np.linspace(-0.3, 0.3, 6001)
        within = steps[inside(shape, apply(inverse(T), o + steps[:, None] * d))]
        if found is None:
            assert len(within) <= 1
            continue
        hits += 1
        assert within.min() == pytest.approx(found.enter, abs=2e-4)
        assert within.max() == pytest.approx(found.leave, abs=2e-4)
        assert found.enter_normal @ d < 0 < found.leave_normal @ d
        for s, n in ((found.enter, found.enter_normal), (found.leave, found.leave_normal)):
            assert np.linalg.norm(n) == pytest.approx(1.0)
            assert inside(shape, apply(inverse(T), (o + s * d - 1e-5 * n)[None]))[0]
            assert not inside(shape, apply(inverse(T), (o + s * d + 1e-5 * n)[None]))[0]
    assert hits > 50


def inside(shape: Shape, p: Array) -> Array:
    """Which of points (N, 3), in the shape's own frame, lie in it."""
    match shape:
        case Box():
            return np.asarray((np.abs(p) <= shape.half).all(1))
        case Cylinder():
            return np.asarray((np.hypot(p[:, 0], p[:, 1]) <= shape.radius_m) & (np.abs(p[:, 2]) <= shape.height_m / 2))
        case ConvexMesh():
            angles = np.pi / 7 + 2 * np.pi * np.arange(7) / 7  # the prism's faces
            across = p[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
            return np.asarray((across <= 0.03).all(1) & (np.abs(p[:, 2]) <= 0.04))


# ------------------------------------------------------------------------------------------------------------------------- closing, opening


def test_fingers_close_on_the_upright_faces_of_a_box() -> None:
    assert closing_directions(BOX, np.eye(4)) == pytest.approx([0.0, np.pi / 2])
    assert closing_directions(BOX, transform(rotation_about(Z, 0.3))) == pytest.approx([0.3, 0.3 + np.pi / 2], abs=1e-6)
    assert closing_directions(BOX, transform(rotation_about(Z, -0.3))) == pytest.approx([np.pi / 2 - 0.3, np.pi - 0.3], abs=1e-6)
    assert closing_directions(BOX, transform(rotation_about(Z, 2.0))) == pytest.approx([2.0 - np.pi / 2, 2.0], abs=1e-6)


def test_directions_that_are_the_same_stand_once() -> None:
    """Half a turn about the upright axis is the same box, also where rounding would make it π."""
    for turn in (np.pi, -np.pi, 2 * np.pi, np.pi - 1e-8, 1e-8, -1e-8):
        assert closing_directions(BOX, transform(rotation_about(Z, turn))) == [0.0, round(np.pi / 2, 6)]


def test_fingers_do_not_close_on_faces_that_look_up() -> None:
    """An axis that rises by more than 0.2 of its length is no closing direction: a box on its side has two all the same."""
    assert closing_directions(BOX, transform(rotation_about(X, np.pi / 2))) == pytest.approx([0.0, np.pi / 2])
    rise = np.arcsin(0.2)
    for more, n in ((-1e-3, 2), (1e-3, 1)):
        assert len(closing_directions(BOX, transform(rotation_about(X, rise + more)))) == n
        assert len(closing_directions(BOX, transform(rotation_about(X, -rise - more)))) == n
    assert closing_directions(BOX, transform(rotation_about(X, np.pi / 4))) == pytest.approx([0.0])
    T = np.eye(4)
    T[:3, 0] = np.sqrt(0.96), 0.0, 0.2  # that much itself is too much
    assert closing_directions(BOX, T) == pytest.approx([np.pi / 2], abs=1e-6)


def test_fingers_close_all_round_on_everything_else() -> None:
    every_15 = [pytest.approx(i * np.pi / 12, abs=1e-6) for i in range(12)]
    for shape in (CAN, ConvexMesh((box_corners(np.full(3, 0.02)),))):
        assert closing_directions(shape, transform(rotation_about(Z, 0.3))) == every_15


def test_the_fingers_open_by_a_clearance_on_each_side_if_they_can() -> None:
    assert open_width(0.05, PLAIN) == pytest.approx(0.05 + 2 * CLEARANCE_M)
    assert open_width(0.08, PLAIN) == pytest.approx(0.10)
    assert open_width(0.095, PLAIN) == pytest.approx(0.10)
    for width in np.linspace(0.02, 0.0799, 40):
        steps, spare = open_width(width, PLAIN) / OPEN_STEP_M, width + 2 * CLEARANCE_M - open_width(width, PLAIN)
        assert steps == pytest.approx(round(steps), abs=1e-9)
        assert -1e-8 < spare < OPEN_STEP_M
    assert type(open_width(0.05, PLAIN)) is float


def test_how_far_before_the_middle_the_pads_close() -> None:
    """So far that what lies behind the pads fits, but the pads' middle stays a bite over the near end."""
    shallow = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.array([0.02, 0.04]))
    assert set_back(0.02, 0.05, shallow) == 0.0  # 3 cm of depth at this width
    assert set_back(0.03, 0.05, shallow) == pytest.approx(BEHIND_M)
    assert set_back(0.035, 0.05, shallow) == pytest.approx(0.005 + BEHIND_M)
    assert set_back(0.035, 0.10, shallow) == 0.0
    none = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.zeros(2))
    assert set_back(0.06, 0.05, none) == pytest.approx(0.06 - LEAST_BITE_M)
    assert set_back(0.005, 0.05, none) == 0.0


# ---------------------------------------------------------------------------------------------------------------------------------- heights


@pytest.mark.parametrize("kind", ["horizontal", "diagonal"])
def test_the_height_of_a_grasp_from_the_side(kind: str) -> None:
    """A share of the body's height, but no lower than the hand fits over the floor; none where that is too near the top."""
    lowest = 0.5 + usual_lowest(kind, 0.0)
    assert lowest == 0.5 + LOWEST_M[kind]
    assert hand_poses.height_of(kind, 0.5, 0.7, lowest, 0.6) == pytest.approx(0.62)
    assert hand_poses.height_of(kind, 0.5, 0.7, lowest, 0.85) == pytest.approx(0.67)
    assert hand_poses.height_of(kind, 0.5, 0.7, lowest, 1.0) == pytest.approx(0.7 - hand_poses.BELOW_TOP_M)
    assert hand_poses.height_of(kind, 0.5, 0.58, lowest, 0.1) == pytest.approx(lowest)
    top = lowest + BELOW_TOP_M
    assert hand_poses.height_of(kind, 0.45, top + 1e-5, lowest, 0.1) == pytest.approx(lowest)
    assert hand_poses.height_of(kind, 0.45, top - 1e-5, lowest, 0.1) is None
    assert hand_poses.height_of(kind, 0.6, 0.7, lowest, 0.6) == pytest.approx(0.66)  # what stands on something is higher above the floor
    assert hand_poses.height_of(kind, 0.0, 1.0, 0.0, 1 / 3) == 0.333333  # rounded, so that hands from both sides meet in one line


def test_what_is_low_may_be_held_nearer_to_its_top() -> None:
    """By 0.3 of its height, where that is less than 15 mm."""
    lowest = LOWEST_M["diagonal"]
    height = lowest / 0.7
    assert 0.3 * height < BELOW_TOP_M
    assert hand_poses.height_of("diagonal", 0.0, height + 1e-5, lowest, 0.1) == pytest.approx(lowest)
    assert hand_poses.height_of("diagonal", 0.0, height - 1e-5, lowest, 0.1) is None
    assert hand_poses.height_of("diagonal", 0.2, 0.2 + height + 1e-5, 0.2 + lowest, 0.1) == pytest.approx(0.2 + lowest)


def test_the_height_of_a_grasp_from_above() -> None:
    """2 cm below the top, whatever the share."""
    lowest = 0.5 + LOWEST_M["downward"]
    for share in (0.6, 0.85):
        assert hand_poses.height_of("downward", 0.5, 0.7, lowest, share) == pytest.approx(0.68)
    assert hand_poses.height_of("downward", 0.5, 0.53, lowest, 0.6) == pytest.approx(0.515)
    assert hand_poses.height_of("downward", 0.5, 0.52, lowest, 0.6) is None


# --------------------------------------------------------------------------------------------------------------------------------- the hand


def test_a_level_hand_closes_level_and_keeps_its_camera_up() -> None:
    R = hand_poses.level_hand(X, 0.0)
    assert np.allclose(R[:, 2], X)
    assert np.allclose(R[:, 0], Z)
    for ahead in (X, Y, np.array([0.6, -0.8, 0.0])):
        for pitch in (0.0, np.pi / 6, np.pi / 3):
            R = hand_poses.level_hand(ahead, pitch)
            assert np.allclose(R.T @ R, np.eye(3))
            assert np.linalg.det(R) == pytest.approx(1.0)
            assert np.allclose(R[:, 2], np.cos(pitch) * ahead - np.sin(pitch) * Z)
            assert R[2, 1] == 0.0
            assert R[2, 0] == pytest.approx(np.cos(pitch))


def test_a_hand_from_above_turns_its_camera_back() -> None:
    """Its x points against the way a level hand would look: out of the cabinet."""
    for ahead in (X, Y, np.array([0.6, -0.8, 0.0])):
        R = hand_poses.level_hand(ahead, np.pi / 2)
        assert np.allclose(R[:, 2], -Z)
        assert np.allclose(R[:, 0], -ahead)
        assert np.linalg.det(R) == pytest.approx(1.0)


# ----------------------------------------------------------------------------------------------------------------------------- all together


def found_on(
    shape: Shape, *kinds: str, toward: float = 0.0, opening: Opening = PLAIN, T: Array | None = None, floor_z: float = -0.05
) -> list[Grasp]:
    body = Body("it", shape, np.eye(4) if T is None else T)
    return list(sample_grasps(body, opening, kinds, floor_z, toward))


def looks(grasp: Grasp) -> tuple[float, float]:
    """Bearing and pitch (rad) of a hand."""
    z = grasp.T_world_hand[:3, 2]
    return float(np.round(np.arctan2(z[1], z[0]), 6)) + 0.0, float(np.round(np.arctan2(-z[2], np.hypot(z[0], z[1])), 6)) + 0.0


def test_the_most_natural_grasp_comes_first() -> None:
    """On a box, with horizontal hands: straight ahead at 0.6 of the height, the same at 0.85, then from the sides, then from behind."""
    found = found_on(BOX, "horizontal")
    assert all(looks(g)[1] == 0.0 for g in found)
    bearings = [round(np.degrees(looks(g)[0])) for g in found]
    assert bearings[:2] == [0, 0]
    assert sorted(bearings[2:4]) == sorted(bearings[4:6]) == [-90, 90]
    assert [abs(b) for b in bearings[6:]] == [180, 180]
    heights = [float(g.T_world_hand[2, 3]) for g in found]
    assert heights == pytest.approx([0.01, 0.035, 0.01, 0.01, 0.035, 0.035, 0.01, 0.035])
    assert [g.width_m for g in found] == pytest.approx([0.06, 0.06, 0.04, 0.04, 0.04, 0.04, 0.06, 0.06])


def test_natural_is_along_the_bearing_of_the_object() -> None:
    for toward, first in (
        (np.pi / 2, np.pi / 2),
        (-np.pi / 2, -np.pi / 2),
        (0.1, 0.0),
        (np.pi - 0.1, np.pi),
        (-3.0, np.pi),
        (1.2, np.pi / 2),
    ):
        bearing, pitch = looks(found_on(BOX, "horizontal", toward=toward)[0])
        assert np.cos(bearing - first) == pytest.approx(1.0)
        assert pitch == 0.0
    turned = transform(rotation_about(Z, 0.3), [1.0, 2.0, 3.0])
    assert looks(found_on(BOX, "horizontal", T=turned, floor_z=2.95)[0])[0] == pytest.approx(0.3)


def test_flat_comes_before_steep() -> None:
    """By half of the pitch in rad; a second height costs 0.3: 0, 30° (0.26), 0 higher (0.3), 60° (0.52), 30° higher (0.56), 90° (0.79) …"""
    found = [looks(g) for g in found_on(BOX, "horizontal", "diagonal", "downward") if abs(looks(g)[0]) < 0.1 and looks(g)[1] < 1.6]
    degrees = [round(np.degrees(pitch)) for _, pitch in found]
    assert [d for d in degrees if d < 90] == [0, 30, 0, 60, 30, 60]
    costs = []
    for grasp in found_on(BOX, "horizontal", "diagonal", "downward"):
        R, higher = grasp.T_world_hand[:3, :3], grasp.T_world_hand[2, 3] > 0.03
        ahead, pitch = (-R[:, 0], np.pi / 2) if R[2, 2] < -0.99 else (R[:, 2], np.arcsin(-R[2, 2]))
        turn = abs(np.arctan2(ahead[1], ahead[0]))
        costs.append(turn + 0.5 * pitch + (0.3 if higher and pitch < 1.5 else 0.0))
    assert all(a <= b + 1e-5 for a, b in pairwise(costs))
    assert costs[0] == pytest.approx(0.0, abs=1e-6)


def test_a_can_is_grasped_from_all_sides() -> None:
    found = found_on(CAN, "horizontal")
    assert len(found) == 2 * 24
    bearings = sorted({round(np.degrees(looks(g)[0])) % 360 for g in found})
    assert bearings == list(range(0, 360, 15))
    assert all(g.width_m == pytest.approx(0.06) for g in found)
    turns = [abs(looks(g)[0]) + 0.3 * (g.T_world_hand[2, 3] > 0.03) for g in found]
    assert all(a <= b + 1e-5 for a, b in pairwise(turns))


@pytest.mark.parametrize("kind", ["horizontal", "diagonal", "downward"])
@pytest.mark.parametrize("shape", [BOX, CAN, ConvexMesh((prism(0.03, 0.1, 8),))], ids=["box", "can", "prism"])
def test_every_grasp_closes_on_the_object_from_both_sides(shape: Shape, kind: str) -> None:
    """The pads' middle lies halfway between two points of the surface, which lie across the closing direction, within the friction cone."""
    T = transform(rotation_about(Z, 0.4), [0.3, 0.2, 0.15])
    opening = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.array([0.02, 0.01]), np.full(2, 0.5))
    found = found_on(shape, kind, opening=opening, T=T, floor_z=0.1)
    assert found
    for grasp in found:
        T_hand, width = grasp.T_world_hand, grasp.width_m
        pads = T_hand[:3, 3] + opening.pad_z_at(width) * T_hand[:3, 2]
        line = line_contacts(shape, T, pads, T_hand[:3, 1])
        assert line is not None
        assert (line.enter, line.leave) == pytest.approx((-width / 2, width / 2), abs=1e-9)
        cone = np.cos(MESH_FRICTION_ANGLE if isinstance(shape, ConvexMesh) else FRICTION_ANGLE) - 1e-12
        assert -line.enter_normal @ T_hand[:3, 1] >= cone
        assert line.leave_normal @ T_hand[:3, 1] >= cone
        assert T_hand[2, 1] == 0.0
        assert width <= opening.max_m - 0.004
        assert np.linalg.norm((pads - T[:3, 3])[:2]) < 0.02


def test_pads_close_on_a_skew_side_only_within_the_friction_cone() -> None:
    """A wedge whose side leans by the angle of friction, less or more."""
    for degrees, holds in ((19.9, True), (20.1, False)):
        lean = 0.04 * np.tan(np.radians(degrees))
        base = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (-0.05, 0.05)])
        for side in (1.0, -1.0):
            corners = base.copy()
            corners[(base[:, 1] == 0.02 * side) & (base[:, 0] > 0), 1] -= side * lean
            mesh = ConvexMesh((corners,))
            assert any(looks(g) == (0.0, 0.0) for g in found_on(mesh, "horizontal")) == holds


def spade(*stretches: tuple[float, float]) -> ConvexMesh:
    """6 cm long along x: from its end at x = 0.03 on, stretches (to x, by how many degrees its two sides lean), 4 cm wide at that end."""
    x, y, outline = 0.03, 0.02, [(0.03, 0.02)]
    for to, degrees in stretches:
        x, y = to, y - (x - to) * np.tan(np.radians(degrees))
        outline.append((x, y))
    return ConvexMesh((np.array([[x, s * y, z] for x, y in outline for s in (1.0, -1.0) for z in (-0.05, 0.05)]),))


@pytest.mark.parametrize("turned", [0.0, 30.0, 180.0, 210.0])
@pytest.mark.parametrize(
    ("mesh", "beside"),
    [
        (spade((0.009, 0.0), (0.003, 15.0), (-0.03, 25.0)), 0.012),  # in the middle too skew, a fifth beside it nearly so, then square
        (spade((0.016, 0.0), (-0.03, 25.0)), 0.018),
        (spade((-0.03, 5.0)), 0.0),
    ],
    ids=["two fifths", "three fifths", "middle"],
)
def test_a_mesh_is_held_beside_its_middle_where_its_sides_face_the_pads_best(mesh: ConvexMesh, beside: float, turned: float) -> None:
    """Turned askew, the middle is that of the box around it along the world's axes; the pads stay on the object's own axis."""
    T = transform(rotation_about(Z, np.radians(turned)), [0.3, 0.2, 0.0])
    across = [g for g in found_on(mesh, "horizontal", T=T) if abs(g.T_world_hand[:3, 1] @ T[:3, 1]) > 0.999]
    assert {round(float(g.T_world_hand[:3, 2] @ T[:3, 0])) for g in across} == {1, -1}
    for grasp in across:
        x, y = (inverse(T) @ grasp.T_world_hand)[:2, 3]
        assert y == pytest.approx(0.0, abs=1e-6)
        if turned % 180 == 0:
            assert x == pytest.approx(beside, abs=1e-6)
        assert grasp.width_m == pytest.approx(0.04 if beside else 0.04 - 2 * (0.03 - x) * np.tan(np.radians(5.0)), abs=1e-6)


@pytest.mark.parametrize("kind", ["horizontal", "diagonal", "downward"])
@pytest.mark.parametrize("half_turn", [False, True])
def test_an_arm_of_few_joints_says_where_it_can_look(kind: str, *, half_turn: bool) -> None:
    """It is asked along the bearing, between the pads, at the heights of hands that close across; what it says comes first."""
    T, deep = transform(p=[0.3, 0.1, 0.0]), table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.array([0.0, 0.12]))
    asked: list[tuple[Array, float]] = []

    def headings(T_middle: Array, width_m: float) -> list[Array]:
        asked.append((T_middle, width_m))
        return [T_middle[:3, :3] @ rotation_about(Z, np.pi * half_turn)]

    for toward in (0.0, 0.5):
        found = list(sample_grasps(Body("it", CAN, T), deep, [kind], -0.05, toward, headings=headings))
        ahead = np.array([np.cos(toward), np.sin(toward), 0.0])
        assert len(asked) == {"horizontal": 2, "diagonal": 4, "downward": 1}[kind]
        for T_middle, width_m in asked:
            assert width_m == pytest.approx(0.06)
            assert T_middle[:2, 3] == pytest.approx([0.3, 0.1])
            assert T_middle[2, 1] == pytest.approx(0.0)
            assert T_middle[:3, 2] @ np.cross(ahead, Z) == pytest.approx(0.0, abs=1e-12)
        assert np.allclose(found[0].T_world_hand[:3, :3] @ rotation_about(Z, np.pi * half_turn), asked[0][0][:3, :3])
        if toward == 0.0:  # a direction that is sampled all round, too
            alike = [g for g in sample_grasps(Body("it", CAN, T), deep, [kind], -0.05, toward) if looks(g)[0] == 0.0 or kind == "downward"]
            assert {round(float(M[2, 3]), 6) for M, _ in asked} == {round(float(g.T_world_hand[2, 3]), 6) for g in alike}
        asked.clear()


@pytest.mark.parametrize("shape", [BOX, CAN], ids=["box", "can"])
def test_flat_pads_close_on_boxes_and_cans_as_lines_do(shape: Shape) -> None:
    body, pad = Body("it", shape, np.eye(4)), Pad(0.01, -0.01, 0.01)
    wide, narrow = (list(sample_grasps(body, PLAIN, ["horizontal"], -0.05, 0.0, pad=p)) for p in (pad, None))
    assert [(g.T_world_hand.tolist(), g.width_m) for g in wide] == [(g.T_world_hand.tolist(), g.width_m) for g in narrow]


def test_what_has_faces_is_not_asked_about() -> None:
    """A box's faces say how the fingers close, whatever an arm can do."""
    body = Body("it", BOX, np.eye(4))
    found = list(sample_grasps(body, PLAIN, ["horizontal"], -0.05, 0.0, headings=lambda T, width_m: [T[:3, :3]]))
    assert len(found) == len(found_on(BOX, "horizontal"))


def test_a_line_is_as_skew_as_the_surface_that_faces_it_less() -> None:
    leans = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    for enter, leave, angle in ((-X, X, 0.0), (-X, leans, 0.3), (-leans, X, 0.3), (-X * (1 + 1e-15), X * (1 + 1e-15), 0.0), (X, X, np.pi)):
        assert antipodal.skew(Contact(-0.02, 0.02, enter, leave), X) == pytest.approx(angle, abs=1e-7)
    assert antipodal.skew(None, X) == np.pi


def test_normals_at_the_edge_of_the_friction_cone_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without friction just those along the closing direction are left."""
    monkeypatch.setattr(finger_grasps, "FRICTION_ANGLE", 0.0)
    assert {abs(looks(g)[0]) for g in found_on(BOX, "horizontal")} == {round(np.pi / 2, 6)}


def test_what_is_too_wide_is_not_grasped() -> None:
    """Two millimetres must be left on each side."""
    assert PLAIN.max_m == 0.096 + 0.004
    assert len(found_on(Box(np.array([0.096, 0.04, 0.1])), "horizontal")) == 8
    for width, n in ((0.0959, 8), (0.0961, 4)):
        assert len(found_on(Box(np.array([0.04, width, 0.1])), "horizontal")) == n
    assert found_on(Cylinder(0.049, 0.1), "horizontal") == []


def test_heights_that_coincide_are_tried_once() -> None:
    """Of a low can just one height is left; too low a one is not grasped at all."""
    assert len(found_on(Cylinder(0.03, 0.06), "horizontal", floor_z=-0.03)) == 24
    assert len(found_on(Cylinder(0.03, 0.05), "horizontal", floor_z=-0.025)) == 0
    assert len(found_on(CAN, "downward")) == 24
    assert found_on(CAN) == []


def test_a_mesh_is_held_lower_too_where_what_is_round_is_widest() -> None:
    """At 0.45 of its height, besides 0.6 and 0.85, and at 0.3, or as low as the pads may be."""
    heights = {round(float(g.T_world_hand[2, 3]), 6) for g in found_on(ConvexMesh((prism(0.03, 0.1, 8),)), "horizontal", floor_z=-0.05)}
    low, _ = bounds(ConvexMesh((prism(0.03, 0.1, 8),)), np.eye(4))
    assert heights == {round(float(max(low[2] + share * 0.1, -0.05 + 0.04)), 6) for share in (0.3, 0.45, 0.6, 0.85)}


def test_the_height_nearest_to_its_natural_share_comes_first() -> None:
    """A can of 7 cm whose lower height is lifted to 4 cm above the floor: 0.6 of 7 cm is 4.2, 0.85 is 5.95 and too near the top."""
    found = found_on(Cylinder(0.03, 0.07), "horizontal", floor_z=-0.035)
    assert {round(float(g.T_world_hand[2, 3]), 4) for g in found} == {0.007}
    found = found_on(Cylinder(0.03, 0.11), "horizontal", floor_z=-0.055)
    assert [round(float(g.T_world_hand[2, 3]), 4) for g in found[:1]] == [0.011]


def test_the_pads_close_where_their_table_says() -> None:
    """The hand stays back by what the pads lie before its origin, at the width of the object."""
    opening = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.array([0.03, 0.01]), np.full(2, 0.5))
    first = found_on(BOX, "horizontal", opening=opening)[0]
    assert first.T_world_hand[:3, 3] == pytest.approx([-opening.pad_z_at(0.06), 0.0, 0.01], abs=1e-6)
    assert opening.pad_z_at(0.06) == pytest.approx(0.018)
    first = found_on(BOX, "downward", opening=opening)[0]
    assert first.T_world_hand[:3, 3] == pytest.approx([0.0, 0.0, 0.03 + opening.pad_z_at(0.06)], abs=1e-6)


def test_a_deep_box_is_grasped_nearer_to_the_hand() -> None:
    """The knuckles leave 2 cm, the box reaches 4 cm towards the hand: the pads close 2.5 cm before its middle; a can is taken 5 mm before
    it at most, for it touches flat pads in a line on either side.

    Of a hand that is pitched by 30° the knuckles would leave 5 mm to its top edge, 5.5 cm behind the pads, when these close 4 cm further
    back; but they keep a centimetre of it, along the approach, and close higher instead. A hand from above leaves the two centimetres over
    the pads 5 mm more.
    """
    opening = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.full(2, 0.02))
    deep = Box(np.array([0.08, 0.05, 0.10]))
    first = found_on(deep, "horizontal", opening=opening)[0]
    assert first.T_world_hand[:3, 3] == pytest.approx([-(0.04 + BEHIND_M - 0.02), 0.0, 0.01])
    assert first.width_m == pytest.approx(0.05)
    turned = transform(rotation_about(Z, 0.3))
    first = found_on(deep, "horizontal", opening=opening, T=turned)[0]
    ahead = turned[:3, 0]
    assert first.T_world_hand[:3, 3] == pytest.approx(-(0.04 + BEHIND_M - 0.02) * ahead + [0, 0, 0.01], abs=1e-6)
    assert found_on(Cylinder(0.04, 0.1), "horizontal", opening=opening)[0].T_world_hand[:3, 3] == pytest.approx(
        [-MOST_BESIDE_M, 0, 0.01], abs=1e-6
    )
    steep = next(g for g in found_on(deep, "diagonal", opening=opening))
    co, si = np.cos(np.pi / 6), np.sin(np.pi / 6)
    back, wanted = 0.04 / co - LEAST_BITE_M, 0.04 * co + 0.04 * si + BEHIND_M - 0.02
    assert back < wanted
    assert steep.T_world_hand[:3, 3] == pytest.approx([-back * co, 0.0, 0.01 + back * si + (wanted - back) / si])
    above = found_on(Box(np.array([0.08, 0.05, 0.30])), "downward", opening=opening, floor_z=-0.15)[0]
    assert above.T_world_hand[:3, 3] == pytest.approx([0.0, 0.0, 0.13 + BEHIND_M])


@pytest.mark.parametrize(("high_m", "held"), [(0.0045, False), (0.0065, True)])
def test_a_can_is_not_held_before_the_ends_of_short_pads(high_m: float, held: bool) -> None:
    """Schunk's PG70 has pads that end 3.5 mm ahead: the palm keeps cans 5 mm ahead of their middle, and what was planned so was no hold."""
    opening = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.full(2, 0.02))
    body, pad = Body("can", Cylinder(0.04, 0.1), np.eye(4)), Pad(0.015, -0.0065, high_m, high_m)
    assert bool(list(sample_grasps(body, opening, ["horizontal"], -0.05, 0.0, pad=pad))) == held


def test_how_deep_depends_on_the_width() -> None:
    """The table is asked at the object's width, which is measured where the pads would close: 3 cm at 5 cm, so 1.2 cm are left over."""
    opening = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.array([0.02, 0.04]))
    first = found_on(Box(np.array([0.08, 0.05, 0.10])), "horizontal", opening=opening)[0]
    assert first.T_world_hand[:3, 3] == pytest.approx([-(0.04 + BEHIND_M - 0.03), 0.0, 0.01], abs=1e-6)


def test_how_far_a_mesh_reaches_is_measured_on_its_box() -> None:
    """A round mesh reaches further across its box's corners, where the pads would close so far forward that they slip off: there they are
    set back less, after all that need not be."""
    opening = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.full(2, 0.0335))
    found = found_on(ConvexMesh((prism(0.03, 0.1, 48),)), "horizontal", opening=opening)
    bearings = [round(np.degrees(looks(g)[0])) % 360 for g in found]
    assert set(list(dict.fromkeys(bearings))[:4]) == {0, 90, 180, 270}
    assert set(bearings) == set(range(0, 360, 15))


def test_a_grasp_that_would_close_beside_a_set_back_mesh_is_left_out() -> None:
    """A mesh that is shorter at the side of the hand than its box: where the pads would close, there is nothing."""
    opening = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.zeros(2))
    post_behind = ConvexMesh(
        (box_corners(np.array([0.01, 0.02, 0.05])) + 0.05 * X, box_corners(np.array([0.05, 0.02, 0.005])) - np.array([0.01, 0, 0.045]))
    )
    bearings = {looks(g)[0] for g in found_on(post_behind, "horizontal", opening=opening)}
    assert 0.0 not in bearings


def test_a_pitched_hand_takes_a_can_near_its_top() -> None:
    """At 30° the can's top would reach 5 cm behind pads that close at 0.6 of its height; 2 cm less 5 mm of room are left there."""
    opening = table(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.full(2, 0.02))
    found = [(looks(g)[1], g.T_world_hand) for g in found_on(Cylinder(0.03, 0.2), "diagonal", opening=opening)]
    assert {pitch for pitch, _ in found} == {round(pitch, 6) for pitch in PITCHES["diagonal"]}
    for pitch, T in found:
        over = 0.1 - float((T[:3, 3] + opening.pad_z_at(0.06) * T[:3, 2])[2])
        assert over * np.sin(pitch) <= 0.02 - BEHIND_M + 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_pads_close_on_what_they_meet_first(ur5e: Robot, seed: int) -> None:
    """Of a mesh with facets and bumps nothing that lies between the pads reaches beyond the width, and something reaches it."""
    angle, height = np.random.default_rng(seed).uniform((0, 0.0), (6.2, 0.04))
    bump = box_corners(np.full(3, 0.006)) + np.array([0.026 * np.cos(angle), 0.026 * np.sin(angle), height])
    mesh = ConvexMesh((prism(0.028, 0.1, 12 + seed), bump))
    body, pad = Body("mesh", mesh, transform(p=[0.5, 0, 0.1])), pad_of(ur5e)
    surface = np.concatenate([trimesh.sample.sample_surface(trimesh.convex.convex_hull(p), 20_000, seed=1)[0] for p in mesh.parts])
    grasps = list(sample_grasps(body, ur5e.opening, ("horizontal", "diagonal", "downward"), 0.0, 0.0, pad=pad))
    assert grasps
    for grasp in grasps:
        x, y, z = (apply(inverse(grasp.T_world_hand) @ body.T_world_body, surface) - (0, 0, ur5e.opening.pad_z_at(grasp.width_m))).T
        between = (np.abs(x) <= pad.half_x_m) & (z >= pad.low_z_m) & (z <= pad.high_z_m)
        beyond = np.abs(y[between]).max() - grasp.width_m / 2
        assert -0.0005 < beyond < 0.0007
    lines = list(sample_grasps(body, ur5e.opening, ("horizontal", "diagonal", "downward"), 0.0, 0.0))
    assert min(g.width_m for g in lines) < min(g.width_m for g in grasps)


def lathed_bottle() -> trimesh.Trimesh:
    """A slim one with a round shoulder."""
    outline = [[0, 0], [0.03, 0], [0.032, 0.05], [0.03, 0.09], [0.013, 0.12], [0.013, 0.15], [0, 0.15]]
    return trimesh.creation.revolve(outline, sections=32)


def scaled(by: list[float]) -> trimesh.Trimesh:
    """An ellipsoid with these half axes."""
    ball = trimesh.creation.icosphere(2)
    ball.apply_scale(by)
    return ball


SMOOTH = {
    "ball": scaled([0.035, 0.035, 0.035]),
    "egg": scaled([0.03, 0.025, 0.04]),
    "flat": scaled([0.06, 0.03, 0.025]),
    "capsule": trimesh.creation.capsule(height=0.08, radius=0.025, count=(16, 16)),
    "bottle": lathed_bottle(),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_what_is_smooth_is_held_from_several_sides(ur5e: Robot, name: str) -> None:
    """No line meets it squarely at the heights that a box is held at: there are grasps all the same, and the verdict accepts them."""
    corners = np.asarray(SMOOTH[name].convex_hull.vertices) - SMOOTH[name].bounds.mean(0)
    body = Body("t", ConvexMesh((corners,)), transform(p=[0.55, 0, 0.1 - corners[:, 2].min()]))
    cabinet = Cabinet(np.array([0.56, 0.86, 0.5]), transform(p=[0.3, 0, 0.1]), 0.03)
    scene = Scene("s", RobotRef(np.eye(4), "ur5e"), cabinet, (body,), "t", None)
    found = list(sampled_grasps(ur5e, scene, "t", body.T_world_body, approaches=APPROACHES))
    assert len({round(np.degrees(looks(g)[0])) for g in found}) >= 4
    assert len(found) <= 120
    for grasp in found[::10]:
        assert judge_grasp(ur5e, scene, grasp) is None
