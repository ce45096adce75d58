"""Hollow things by their walls: which stretches of a line lie inside a shape, and the grasps with one finger in a hole."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from kinematics.transforms import Array, rotation_about, transform
from planning.grasp_proposals import squareness
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.line_contacts import GAP_M, line_contacts, line_stretches, stretch_at
from planning.grasping.pads import Pad, under_pads
from planning.grasping.sampling import Sampling
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
