"""What a hand holds keeps its distance from the links that don't hold it: knuckles, palm."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import fcl
import numpy as np
import pytest
import trimesh

from kinematics.robots.hands.opening import ROOM_M, SLICES, TILTS, Opening
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Grasp
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.grasping.finger_grasps import sample_grasps
from planning.grasping.hand_poses import BELOW_TOP_M, LEAST_BITE_M, MOST_BESIDE_M, fit_box, fit_round, level_hand, lowest_of, most_above
from planning.grasping.sampling import DENSE, USUAL

PITCHES = np.radians([0, 30, 45, 60, 90])
PALM_Z_M, PALM_X_M = -0.04, 0.02
FLAT = Opening(
    np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.full(2, -PALM_Z_M), np.zeros(2),
    tilted_m=np.tile((-PALM_Z_M * np.cos(TILTS) - PALM_X_M * np.abs(np.sin(TILTS)))[:, None], (2, 1, len(SLICES))),
)  # fmt: skip
"""A hand with a flat palm 4 cm behind its pads' middle, 4 cm high and as wide as can be."""


def convex(vertices: Array) -> fcl.Convex:
    hull = trimesh.convex.convex_hull(vertices)
    return fcl.Convex(np.asarray(hull.vertices), len(hull.faces), np.hstack([np.full((len(hull.faces), 1), 3), hull.faces]).ravel())


def gap_m(robot: Robot, solids: list[tuple[str, fcl.Convex]], body: Body, grasp: Grasp) -> float:
    """How far a held object is from some of the hand's links."""
    q = robot.home.copy()
    q[robot.gripper_joint] = robot.opening.closing_value(grasp.width_m)
    poses, T_hand_body = robot.link_poses(q), robot.opening.held(inverse(grasp.T_world_hand) @ body.T_world_body)
    shape = body.shape
    held = fcl.Box(*shape.size_m) if isinstance(shape, Box) else fcl.Cylinder(shape.radius_m, shape.height_m)  # type: ignore[union-attr]
    gaps = []
    for link, solid in solids:
        T = inverse(poses["hand"]) @ poses[link]
        pair = [fcl.CollisionObject(g, fcl.Transform(T[:3, :3], T[:3, 3])) for g, T in ((solid, T), (held, T_hand_body))]
        gaps.append(fcl.distance(*pair, fcl.DistanceRequest(), fcl.DistanceResult()))
    return min(gaps)


@pytest.mark.parametrize("name", ["ur5e", "panda", "gen3"])
def test_what_is_held_keeps_its_distance_from_knuckles_and_palm(name: str) -> None:
    """Boxes and cylinders of any size, taken from the side, diagonally and from above: as a rule 5 mm, and at least 3."""
    robot, rng, gaps = load(name), np.random.default_rng(7), list[float]()
    solids = [(h.link, convex(h.vertices)) for h in robot.hulls if h.link in robot.hand_links and h.link not in robot.pads]
    for _ in range(3):
        half, height = rng.uniform(0.02, 0.037, 2), rng.uniform(0.08, 0.25)
        T = transform(rotation_about((0.0, 0.0, 1.0), rng.uniform(-1.5, 1.5)), [0.6, 0.0, height / 2])
        for shape in (Box(np.array([*(2 * half), height])), Cylinder(float(half[0]), height)):
            body = Body("it", shape, T)
            grasps = list(sample_grasps(body, robot.opening, APPROACHES, 0.0, 0.0, lowest=lowest_of(robot)))
            assert grasps
            gaps += [gap_m(robot, solids, body, grasp) for grasp in grasps[:: len(grasps) // 20 or 1]]
    assert min(gaps) > 0.003
    assert np.median(gaps) > 0.0049


def test_a_thorough_look_has_tighter_grasps_too_last(ur5e: Robot) -> None:
    """Where nothing else does, what is held may be nearer to the knuckles: a proof that nothing can be picked must not depend on that."""
    solids = [(h.link, convex(h.vertices)) for h in ur5e.hulls if h.link in ur5e.hand_links - ur5e.pads - {"camera"}]
    for shape in (Box(np.array([0.05, 0.06, 0.15])), Cylinder(0.034, 0.15)):
        body = Body("it", shape, transform(p=[0.6, 0.0, 0.075]))
        usual, dense = (
            list(sample_grasps(body, ur5e.opening, ["diagonal"], 0.0, 0.0, replace(sampling, yaws=4), lowest=lowest_of(ur5e)))
            for sampling in (replace(DENSE, rooms_m=(ROOM_M,)), DENSE)
        )
        assert [g.T_world_hand.tolist() for g in dense[: len(usual)]] == [g.T_world_hand.tolist() for g in usual]
        more = [gap_m(ur5e, solids, body, grasp) for grasp in dense[len(usual) :]]
        assert min(more) > 0.0005
        assert np.quantile(more, 0.2) < 0.003


@pytest.mark.parametrize(("pitch", "reach", "above"), list(product(PITCHES[1:4], (0.015, 0.03, 0.045), (0.02, 0.05, 0.1))))
def test_a_box_is_taken_as_deep_as_a_palm_lets_it(pitch: float, reach: float, above: float) -> None:
    """Where the hand went back at all, 5 mm are left of what the planes at hand can show, or the pads' middle is as near to the box's edges
    as it may be; and never nearer."""
    move = fit_box(reach, above, pitch, 0.05, FLAT, 0.0)
    R = level_hand(np.array([1.0, 0.0, 0.0]), pitch)
    at = move.by(R)
    left, over = reach + at[0], above - at[2]
    assert min(move.along_m, move.up_m, move.level_m) >= 0.0
    assert left >= min(reach, LEAST_BITE_M * np.cos(pitch)) - 1e-9
    assert over >= min(above, BELOW_TOP_M) - 1e-9
    corners = np.array([[x, 0.0, PALM_Z_M] for x in (-PALM_X_M, PALM_X_M)]) @ R.T
    gap = -np.inf
    for tilt in np.linspace(pitch - np.pi / 2, pitch, 91):  # of a plane between them
        normal = np.array([np.cos(pitch - tilt), 0.0, -np.sin(pitch - tilt)])
        gap = max(gap, -left * normal[0] + over * normal[2] - (corners @ normal).max())
    outermost = left < LEAST_BITE_M * np.cos(pitch) + 1e-9 and over < BELOW_TOP_M + 1e-9
    assert gap >= ROOM_M - 1e-9 or outermost
    if move.along_m > 0:
        assert gap <= ROOM_M + 1e-3 or left < LEAST_BITE_M * np.cos(pitch) + 1e-9 or over < BELOW_TOP_M + 1e-9


def test_a_cylinder_stays_between_the_pads() -> None:
    """It is taken before its middle by no more than the pads are sure to reach, and only where it would come too near to the palm."""
    assert fit_round(0.034, 0.05, 0.0, FLAT).along_m == 0.0
    assert fit_round(0.037, 0.05, 0.0, FLAT).along_m == pytest.approx(0.002)
    assert fit_round(0.045, 0.05, 0.0, FLAT).along_m == MOST_BESIDE_M
    hinged = Opening(FLAT.value, FLAT.width_m, FLAT.pad_z_m, FLAT.depth_m, np.zeros(2), round_only=True)
    assert fit_round(0.045, 0.05, 0.0, hinged).along_m == 0.0


def test_a_cylinder_is_taken_near_its_top_from_above() -> None:
    """As far above the pads as the palm leaves; a slim one beside the palm as a whole."""
    assert most_above(0.03, np.pi / 2, FLAT) == pytest.approx(-PALM_Z_M - ROOM_M)
    assert most_above(0.03, np.pi / 6, FLAT) == pytest.approx((-PALM_Z_M - ROOM_M - 0.03 * np.cos(np.pi / 6)) / np.sin(np.pi / 6), abs=1e-3)


@pytest.mark.parametrize("sampling", [USUAL, DENSE])
def test_a_cylinder_is_as_wide_along_every_direction(ur5e: Robot, sampling: object) -> None:
    """So hands all round it are at the same heights, and as far back."""
    body, heights = Body("can", Cylinder(0.035, 0.12), transform(p=[0.6, 0.0, 0.06])), dict[tuple[int, int], set[tuple[float, float]]]()
    for grasp in sample_grasps(body, ur5e.opening, APPROACHES, 0.0, 0.0, sampling):  # type: ignore[arg-type]
        ahead = grasp.T_world_hand[:3, 2]
        yaw = int(np.degrees(np.arctan2(ahead[1], ahead[0])).round()) if ahead[2] > -0.99 else 0
        beside = np.hypot(*(grasp.T_world_hand[:2, 3] - body.T_world_body[:2, 3]))
        at = round(float(grasp.T_world_hand[2, 3]), 5), round(float(beside), 5)
        heights.setdefault((int((1000 * ahead[2]).round()), yaw), set()).add(at)
    for slope in {slope for slope, _ in heights}:
        all_round = [there for (other, _), there in heights.items() if other == slope]
        assert all(there == all_round[0] for there in all_round)
    assert len(heights) > 2 * 12
