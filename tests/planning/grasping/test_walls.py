"""Hollow things by their walls: which stretches of a line lie inside a shape, and the grasps with one finger in a hole."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from kinematics.robots.hands.opening import Opening
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.antipodal import MESH_FRICTION_ANGLE, SPARE_M, antipodal, crossed
from planning.grasping.candidates import Candidate
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.finger_grasps import sample_grasps
from planning.grasping.hand_poses import level_hand
from planning.grasping.line_contacts import GAP_M, Contact, line_contacts, line_stretches, stretch_at
from planning.grasping.mesh_grasps import _by_walls, _less_squarely
from planning.grasping.pads import Pad, under_pads
from planning.grasping.sampling import Sampling
from planning.target_grasps.proposals import squareness
from planning.verdict import judge_grasp

X, Y, Z = np.eye(3)
INNER_M, OUTER_M, HIGH_M = 0.04, 0.058, 0.024


def ring(high: float = HIGH_M, parts: int = 24) -> ConvexMesh:
    """A pipe of convex wedges about z, its middle at the origin, too wide for a 2F-85 to span."""
    out = []
    for k in range(parts):
        yaws = np.array([k, k + 1]) * 2 * np.pi / parts
        level = np.array([[r * np.cos(a), r * np.sin(a)] for r in (INNER_M, OUTER_M) for a in yaws])
        out.append(np.concatenate([np.c_[level, np.full(4, z)] for z in (-high / 2, high / 2)]))
    return ConvexMesh(tuple(out))


def cell(body: Body) -> Scene:
    cabinet = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.35, 0.0, 0.10]), wall_m=0.03)
    return Scene("walls", RobotRef(np.eye(4), "ur5e"), cabinet, (body,), body.name, None)


def standing(shape: Shape, high: float) -> Body:
    return Body("ring", shape, transform(p=[0.6, 0.05, 0.10 + high / 2]))


def test_a_hole_parts_the_stretches_of_a_line() -> None:
    T = transform(rotation_about(Z, 0.3), [0.1, -0.2, 0.3])
    inward = T[:3, :3] @ rotation_about(Z, np.pi / 24) @ X  # through the middle of a wedge
    near, far = line_stretches(ring(), T, T[:3, 3] - 0.2 * inward, inward)
    flat = np.cos(np.pi / 24)
    assert [near.enter, near.leave] == pytest.approx([0.2 - OUTER_M * flat, 0.2 - INNER_M * flat], abs=1e-9)
    assert [far.enter, far.leave] == pytest.approx([0.2 + INNER_M * flat, 0.2 + OUTER_M * flat], abs=1e-9)
    for hit in (near, far):
        assert hit.enter_normal == pytest.approx(-inward, abs=1e-9)
        assert hit.leave_normal == pytest.approx(inward, abs=1e-9)
    assert line_stretches(ring(), T, T[:3, 3] + 0.1 * Z, inward) == []


def test_stretches_are_what_lies_inside() -> None:
    """Against points along random lines, asked one by one."""
    rng, shape = np.random.default_rng(3), ring()
    from kinematics.meshes.cutting import planes_of

    planes = [planes_of(part) for part in shape.parts]
    s = np.linspace(-0.2, 0.2, 2001)
    for _ in range(20):
        p, d = rng.normal(size=3) * [0.03, 0.03, 0.004], rng.normal(size=3)
        d /= np.linalg.norm(d)
        points = p + s[:, None] * d
        inside = np.any([(points @ rows[:, :3].T <= rows[:, 3] + 1e-12).all(1) for rows in planes], axis=0)
        found = line_stretches(shape, np.eye(4), p, d)
        covered = np.any([np.zeros(len(s), bool), *((s >= h.enter) & (s <= h.leave) for h in found)], axis=0)
        assert not (inside & ~covered).any()
        assert (covered & ~inside).sum() * 0.0002 <= GAP_M * len(found)  # no more than gaps too narrow for a finger
        assert all(b.enter - a.leave > GAP_M for a, b in pairwise(found))
        whole = line_contacts(shape, np.eye(4), p, d)
        assert (whole is None) == (not found)
        if whole is not None:
            assert (whole.enter, whole.leave) == (found[0].enter, found[-1].leave)


def test_parts_that_hardly_come_apart_are_one_stretch() -> None:
    cube = np.array([[x, y, z] for x in (0, 0.02) for y in (-0.01, 0.01) for z in (-0.01, 0.01)])
    for gap, stretches in ((0.0, 1), (GAP_M - 1e-4, 1), (GAP_M + 1e-4, 2)):
        pair = ConvexMesh((cube + (0.02 + gap) * X, cube))  # the further one first
        found = line_stretches(pair, np.eye(4), -0.1 * X, X)
        assert len(found) == stretches
        assert (found[0].enter, found[-1].leave) == pytest.approx((0.1, 0.14 + gap))
        if stretches == 1:
            assert found[0].leave_normal == pytest.approx(X)
    inner = ConvexMesh((cube * 3, cube))  # one within the other ends where the larger does
    assert line_stretches(inner, np.eye(4), -0.1 * X, X)[0].leave == pytest.approx(0.16)


def test_the_stretch_at_a_place() -> None:
    shape, line = ring(), (np.eye(4), -0.1 * X, rotation_about(Z, np.pi / 24) @ X)
    near, far = line_stretches(shape, np.eye(4), -0.1 * line[2], line[2])
    where = (shape, np.eye(4), -0.1 * line[2], line[2])
    for hit in (near, far):
        for s in (hit.enter, (hit.enter + hit.leave) / 2, hit.leave + 0.9 * GAP_M, hit.enter - 0.9 * GAP_M):
            found = stretch_at(*where, s)
            assert found is not None
            assert (found.enter, found.leave) == (hit.enter, hit.leave)
    whole = stretch_at(*where, 0.1)
    assert whole is not None
    assert (whole.enter, whole.leave) == (near.enter, far.leave)
    assert stretch_at(shape, np.eye(4), 0.1 * Z, X) is None
    for solid in (Box(np.array([0.04, 0.06, 0.1])), Cylinder(0.03, 0.1)):
        one = line_contacts(solid, np.eye(4), -0.1 * X, X)
        same = stretch_at(solid, np.eye(4), -0.1 * X, X, 0.1)
        assert one is not None
        assert same is not None
        assert (one.enter, one.leave) == (same.enter, same.leave)


def test_pads_at_a_wall_meet_it_alone() -> None:
    """A flat pad inside touches a hollow wall at the pad's sides first; what is across the hole is not between the pads."""
    shape, R, u = ring(0.1), np.stack([X, Y, Z], -1), Y
    near = line_stretches(shape, np.eye(4), np.zeros(3), u)[0]
    pad = Pad(0.011, -0.01, 0.01)
    enter, leave = under_pads(shape, np.eye(4), near, np.zeros(3), u, R, pad, wall=True)
    assert enter == pytest.approx(-OUTER_M, abs=1e-6)  # a wedge's edge is at the middle of the pad
    assert -INNER_M < leave < -INNER_M * np.cos(np.arcsin(pad.half_x_m / INNER_M)) + 0.001
    assert under_pads(shape, np.eye(4), near, np.zeros(3), u, R, pad)[1] == pytest.approx(OUTER_M, abs=1e-6)


@pytest.mark.parametrize("high", [HIGH_M, 0.018, 0.1], ids=["low", "lower", "pipe"])
def test_a_ring_is_held_by_its_wall(ur5e: Robot, high: float) -> None:
    """By the verdict: a lying ring is low, so that the pads' ends alone hold it, and none of the hand is in the floor."""
    body = standing(ring(high, 12), high)
    scene = cell(body)
    found = grasps_on(body, ur5e, APPROACHES, 0.10, 0.0, Sampling(yaws=6))
    held = [g for g in found if judge_grasp(ur5e, scene, g) is None]
    assert len(held) >= 12
    middle = body.T_world_body[:3, 3]
    for grasp in held:
        assert OUTER_M - INNER_M - 0.001 < grasp.width_m < 0.035
        assert INNER_M < np.linalg.norm((grasp.T_world_hand[:3, 3] - middle)[:2]) < OUTER_M
        assert grasp.T_world_hand[2, 2] < -0.5  # no finger is in the hole from the side
        assert squareness(body, grasp) > 0.0
    yaws = {round(float(np.arctan2(*(g.T_world_hand[:3, 3] - middle)[1::-1])), 1) for g in held}
    assert len(yaws) >= 6  # all round


def test_a_hole_too_small_for_a_finger_gives_no_grasp(ur5e: Robot) -> None:
    narrow = ConvexMesh(tuple(_towards_the_axis(part) for part in ring().parts))
    body = standing(narrow, HIGH_M)
    scene = cell(body)
    assert len(line_stretches(narrow, np.eye(4), -0.1 * X, X)) == 2
    assert not [g for g in grasps_on(body, ur5e, APPROACHES, 0.10, 0.0) if judge_grasp(ur5e, scene, g) is None]


def _towards_the_axis(part: Array) -> Array:
    """A wedge whose inner face is 4 mm from the axis."""
    out = part.copy()
    radius = np.linalg.norm(part[:, :2], axis=1)
    inner = radius < (INNER_M + OUTER_M) / 2
    out[inner, :2] *= 0.004 / INNER_M
    return out


def test_what_has_no_hole_is_never_held_by_a_wall(ur5e: Robot) -> None:
    """Two halves that touch are held about their common middle."""
    half = np.array([[x, y, z] for x in (0, 0.03) for y in (-0.03, 0.03) for z in (-0.06, 0.06)])
    body = standing(ConvexMesh((half, half - 0.03 * X)), 0.12)
    found = list(grasps_on(body, ur5e, APPROACHES, 0.10, 0.0))
    assert found
    assert min(g.width_m for g in found) > 0.059


# ----------------------------------------------------------------------------------------------------------------------------- by hand


SHALLOW = Opening(np.array([0.8, 0.4, 0.0]), np.array([0.0, 0.05, 0.10]), np.zeros(3), np.array([0.0, 0.0, 0.5]), np.zeros(3))
"""Pads in the hand's origin; nothing may reach behind them, but for what is wider than 5 cm."""
OPEN = replace(SHALLOW, depth_m=np.full(3, 0.5))


def plates(*middles: float, thick: float = 0.02) -> Body:
    """Plates across y, 6 cm along x and 10 cm high, in the world's frame."""
    return Body("plates", ConvexMesh(tuple(box_corners(np.array([0.06, thick, 0.10]) / 2) + y * Y for y in middles)), np.eye(4))


def level(reach: float, u: Array = Y, z: float = 0.0) -> Candidate:
    """A hand that looks along x and closes along u about (0, 0, z), of what reaches so far towards it."""
    return Candidate(0.0, z * Z, u, level_hand(np.array([u[1], -u[0], 0.0]), 0.0), (reach, 0.05, 0.0), 0.0, 0.005)


def test_each_wall_is_held_where_the_first_share_of_the_way_back_still_meets_it() -> None:
    """Of 4 cm, all leads out of the plates, which end 3 cm from the middle; half does not."""
    body = plates(-0.06, 0.06)
    found = list(_by_walls(body, SHALLOW, level(0.05), None, {}))
    assert [g.T_world_hand[:3, 3] for g in found] == [pytest.approx([-0.02, y, 0.0]) for y in (-0.06, 0.06)]
    assert [g.width_m for g in found] == pytest.approx([0.02, 0.02])
    deep = list(_by_walls(body, OPEN, level(0.05), None, {}))
    assert [g.T_world_hand[:3, 3] for g in deep] == [pytest.approx([0.0, y, 0.0]) for y in (-0.06, 0.06)]


def test_one_stretch_is_no_wall() -> None:
    assert list(_by_walls(plates(0.0), OPEN, level(0.05), None, {})) == []


def test_walls_are_remembered_by_their_line() -> None:
    """Two lines whose directions differ in one number, and two heights."""
    ahead, body, walls = np.array([0.28, 0.96, 0.0]), plates(-0.06, 0.06), dict[tuple[float, float, float], list[Contact]]()
    for u, z in ((ahead, 0.0), (ahead * [-1, 1, 1], 0.0), (Y, 0.0), (Y, 0.2)):
        list(_by_walls(body, OPEN, level(0.05, u, z), None, walls))
    assert [len(w) for w in walls.values()] == [2, 2, 2, 0]


def test_two_parts_suffice_for_a_hole() -> None:
    """Together they are too wide for the hand."""
    found = list(sample_grasps(plates(-0.06, 0.06), OPEN, ["horizontal"], -0.05, 0.0))
    across = [g for g in found if abs(g.T_world_hand[1, 1]) > 0.999]
    assert {round(abs(float(g.T_world_hand[1, 3])), 6) for g in across} == {0.06}
    assert all(g.width_m == pytest.approx(0.02) for g in across)


def test_what_is_set_back_is_held_as_a_whole_unless_by_a_wall() -> None:
    """Three plates, 8 cm over all: the middle of them is in the one in the middle."""
    body, c = plates(-0.035, 0.0, 0.035, thick=0.01), level(0.03)
    shallow = replace(SHALLOW, depth_m=np.full(3, 0.02))
    whole = line_contacts(body.shape, body.T_world_body, c.point, c.u)
    for pad in (None, Pad(0.01, -0.01, 0.01)):
        grasp = antipodal(body, shallow, whole, c, pad, MESH_FRICTION_ANGLE)
        assert grasp is not None
        assert grasp.width_m == pytest.approx(0.08)
        assert grasp.T_world_hand[:3, 3] == pytest.approx([-0.015, 0.0, 0.0])
        wall = antipodal(body, shallow, whole, c, pad, MESH_FRICTION_ANGLE, wall=True)
        assert wall is not None
        assert wall.width_m == pytest.approx(0.01)


def test_what_bulges_under_the_pads_must_fit_between_the_fingers_too() -> None:
    """The line meets 9 cm, the pads a rib of 9.6 cm beside it: just as wide as a hand may take that opens by 10."""
    for rib, some in ((0.0959, True), (0.0961, False)):
        mesh = ConvexMesh((box_corners(np.array([0.02, 0.045, 0.05])), box_corners(np.array([0.002, rib / 2, 0.05])) + 0.006 * X))
        body, c = Body("ribbed", mesh, np.eye(4)), level(0.02)
        hit = line_contacts(mesh, np.eye(4), c.point, c.u)
        assert hit is not None
        assert (hit.leave - hit.enter, OPEN.max_m - SPARE_M) == pytest.approx((0.09, 0.096))
        grasp = antipodal(body, OPEN, hit, c, Pad(0.01, -0.01, 0.01), MESH_FRICTION_ANGLE)
        assert (grasp is not None) == some
        assert antipodal(body, OPEN, hit, c, None, MESH_FRICTION_ANGLE) is not None


def test_the_pads_are_raised_by_as_much_as_their_ends_still_hold() -> None:
    body, pad = plates(0.0), Pad(0.01, -0.01, 0.015625)
    for least_z, z in ((-0.01, 0.0), (0.01, 0.01), (0.015625, 0.015625), (0.01563, None)):
        c = level(0.03)._replace(least_z=least_z)
        grasp = antipodal(body, OPEN, line_contacts(body.shape, np.eye(4), c.point, c.u), c, pad, MESH_FRICTION_ANGLE)
        assert (None if grasp is None else float(grasp.T_world_hand[2, 3])) == (None if z is None else pytest.approx(z))


def test_a_mesh_that_is_as_skew_everywhere_is_held_in_its_middle() -> None:
    """Its sides lean by 15°, more than is held at first and less than a mesh is."""
    outline = [(x, 0.02 - (0.03 - x) * np.tan(np.radians(15))) for x in (0.03, -0.03)]
    body = Body("wedge", ConvexMesh((np.array([[x, s * y, z] for x, y in outline for s in (1, -1) for z in (-0.05, 0.05)]),)), np.eye(4))
    grasp = _less_squarely(body, OPEN, level(0.03), None, {})
    assert grasp is not None
    assert grasp.T_world_hand[:3, 3] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_beside_the_middle_a_mesh_reaches_less_far_towards_the_hand_or_further() -> None:
    """It is 10 cm long and square from x = 1.2 cm on; at 2 cm it reaches 3 cm towards a hand that comes from there and 7 cm from behind.
    The knuckles leave 2 cm of it, less 5 mm: the first is held 1.5 cm further back."""
    outline = [(0.05, 0.03), (0.012, 0.03), (-0.05, 0.03 - 0.062 * np.tan(np.radians(25)))]
    body = Body("spade", ConvexMesh((np.array([[x, s * y, z] for x, y in outline for s in (1, -1) for z in (-0.05, 0.05)]),)), np.eye(4))
    shallow = replace(SHALLOW, depth_m=np.full(3, 0.02))
    from_there = level(0.05)._replace(R=level_hand(-X, 0.0))
    grasp = _less_squarely(body, shallow, from_there, None, {})
    assert grasp is not None
    assert grasp.T_world_hand[:3, 3] == pytest.approx([0.035, 0.0, 0.0], abs=1e-9)
    assert grasp.width_m == pytest.approx(0.06)


def test_a_line_beside_a_point_is_as_high() -> None:
    """A centimetre under the top of a plate, two beside its middle."""
    hit = crossed(plates(0.0), 0.04 * Z, Y, 0.02, {})
    assert hit is not None
    assert (hit.enter, hit.leave) == pytest.approx((-0.01, 0.01))


def test_crossings_are_remembered_by_their_line() -> None:
    """Two whose directions differ in one number, two heights, and two places beside the middle."""
    body, u, hits = plates(0.0), np.array([0.28, 0.96, 0.0]), dict[tuple[float, float, float], Contact | None]()
    asked = ((u, 0.0, 0.0), (u * [-1, 1, 1], 0.0, 0.0), (u, 0.02, 0.0), (u, 0.0, 0.01), (u, 0.0, 0.0))
    found = [crossed(body, z * Z, along, beside, hits) for along, z, beside in asked]
    assert len(hits) == 4
    assert found[4] is found[0]


def test_a_stretch_reaches_a_gap_further_and_no_more() -> None:
    """Both ends count, and parts that are just a gap apart are one."""
    apart = plates(-0.06, 0.06).shape
    near, far = line_stretches(apart, np.eye(4), np.zeros(3), Y)
    for s, hit in ((near.leave + GAP_M, near), (far.enter - GAP_M, far), (near.enter - GAP_M, near), (far.leave + GAP_M, far)):
        found = stretch_at(apart, np.eye(4), np.zeros(3), Y, s)
        assert found is not None
        assert (found.enter, found.leave) == (hit.enter, hit.leave)
    before, after = (
        np.array([[x, y, z] for x in xs for y in (-0.01, 0.01) for z in (-0.01, 0.01)]) for xs in ((-0.02, 0.0), (GAP_M, 0.02))
    )
    touching = line_stretches(ConvexMesh((before, after)), np.eye(4), np.zeros(3), X)
    assert [(h.enter, h.leave) for h in touching] == [(-0.02, 0.02)]


def test_where_two_parts_end_together_the_first_ones_face_counts() -> None:
    cube = box_corners(np.full(3, 0.5))
    leaning = np.array([[x, y, z] for x, y in ((-0.25, -0.25), (-0.25, 0.75), (0.75, -0.25)) for z in (-0.5, 0.5)])
    (found,) = line_stretches(ConvexMesh((leaning, cube)), np.eye(4), np.zeros(3), X)
    assert (found.enter, found.leave) == (-0.5, 0.5)
    assert found.leave_normal == pytest.approx(X)


def test_a_line_that_touches_an_edge_of_a_mesh_in_one_point_misses() -> None:
    cube = ConvexMesh((box_corners(np.full(3, 0.5)),))
    for across, hits in ((np.array([0.6, -0.8, 0.0]), 0), (np.array([0.6, 0.8, 0.0]), 1)):
        assert len(line_stretches(cube, np.eye(4), np.array([0.5, 0.5, 0.0]), across)) == hits
