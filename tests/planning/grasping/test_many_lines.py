"""Hands are sifted together as they are asked one by one; and what holds a mesh is found once, wherever it stands."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Cabinet, RobotRef, Scene
from kinematics.shapes import ConvexMesh, box_corners
from kinematics.transforms import apply, inverse, rotation_about, transform
from planning.grasping.antipodal import MESH_FRICTION_ANGLE, antipodal, crossed
from planning.grasping.candidates import Candidates
from planning.grasping.hand_poses import lowest_of
from planning.grasping.line_contacts import line_contacts, planes_of_parts
from planning.grasping.mesh_grasps import OBLIQUELY, SQUARELY, _less_squarely
from planning.grasping.sampling import USUAL
from planning.grasping.through_parts import through_all
from planning.motion.handling import object_grasps
from planning.motion.handling.object_grasps import sampled_grasps


def lump(seed: int) -> ConvexMesh:
    """Some convex parts that overlap, and one apart from them."""
    rng = np.random.default_rng(seed)
    near = [rng.normal(scale=0.015, size=(14, 3)) + rng.normal(scale=0.012, size=3) for _ in range(4)]
    return ConvexMesh((*near, box_corners(np.array([0.008, 0.01, 0.03])) + np.array([0.05, 0.0, 0.0])))


@pytest.mark.parametrize("seed", range(3))
def test_many_lines_cross_parts_as_each_does_alone(seed: int) -> None:
    rng, shape = np.random.default_rng(seed), lump(seed)
    o, d = rng.normal(scale=0.03, size=(200, 3)), rng.normal(size=(200, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    met = np.empty((200, 4))
    through_all(*planes_of_parts(shape), o, d, met)
    hits = 0
    for (enter, leave, inwards, outwards), origin, direction in zip(met, o, d):
        alone = line_contacts(shape, np.eye(4), origin, direction)
        assert (alone is None) == (enter >= leave)
        if alone is not None:
            hits += 1
            expected = alone.enter, alone.leave, -alone.enter_normal @ direction, alone.leave_normal @ direction
            np.testing.assert_allclose((enter, leave, inwards, outwards), expected, atol=1e-12)
    assert 20 < hits < 180


@pytest.mark.parametrize("seed", range(4))
def test_whom_the_sieve_drops_holds_nothing(ur5e: Robot, seed: int) -> None:
    """And it drops most of those that hold nothing."""
    body = Body("lump", lump(seed), transform(rotation_about((0.0, 0.0, 1.0), 0.3 * seed), [0.5, 0.1, 0.2]))
    candidates = Candidates(body, ur5e.opening, APPROACHES, 0.1, 0.2, USUAL, lowest_of(ur5e), USUAL.rooms_m[0])
    hands = sorted(candidates.all_round(), key=lambda c: c.rank)[:160]

    def squarely(c: object) -> bool:
        assert isinstance(c, type(hands[0]))
        return antipodal(body, ur5e.opening, crossed(body, c.point, c.u, 0.0, {}), c, None, SQUARELY.friction_angle) is not None

    alone = [[squarely(c) for c in hands], [_less_squarely(body, ur5e.opening, c, None, {}) is not None for c in hands]]
    assert OBLIQUELY.friction_angle == MESH_FRICTION_ANGLE
    for sieve, hold in zip((SQUARELY, OBLIQUELY), alone):
        passed = sieve.passes(body, ur5e.opening, hands)
        assert all(p for p, h in zip(passed, hold) if h)
        assert sum(passed) <= sum(hold) + 8  # those that the body's upper end stops


def cell(body: Body) -> Scene:
    cabinet = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.35, 0.0, 0.10]), wall_m=0.03)
    return Scene("home", RobotRef(np.eye(4), "ur5e"), cabinet, (body,), body.name, None)


def test_what_holds_a_mesh_is_found_once_wherever_it_stands(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Moved and turned, the same hands hold it; which of them come first, and which a wall leaves, is another matter."""
    knob = box_corners(np.array([0.02, 0.01, 0.02])) + np.array([0.02, 0.0, 0.0])
    shape = ConvexMesh((box_corners(np.array([0.02, 0.03, 0.06])), knob))
    body = Body("block", shape, transform(p=[0.60, 0.0, 0.16]))

    def on(T: np.ndarray) -> set[tuple[float, ...]]:
        scene = cell(replace(body, T_world_body=T))
        found = list(sampled_grasps(ur5e, scene, "block", T, approaches=APPROACHES))
        assert found
        return {tuple(np.round((inverse(T) @ g.T_world_hand).ravel(), 6) + 0.0) for g in found}

    here = on(body.T_world_body)
    asked = list[object]()
    usual = object_grasps.judge_hold
    monkeypatch.setattr(object_grasps, "judge_hold", lambda *args: asked.append(args) or usual(*args))
    there = on(transform(rotation_about((0.0, 0.0, 1.0), 0.7), [0.64, 0.1, 0.16]))
    assert len(here & there) >= 0.7 * max(len(here), len(there))
    assert len(asked) < 0.3 * len(there)  # those that are natural there alone
    lying = on(transform(rotation_about((1.0, 0.0, 0.0), np.pi / 2), [0.64, 0.1, 0.13]))
    assert not here & lying


def test_grasps_found_at_home_hold_where_the_mesh_is(ur5e: Robot) -> None:
    """The pads close on it there: the middle between them is in it, and the hand is no lower than the floor lets it."""
    shape, T = lump(1), transform(rotation_about((0.0, 0.0, 1.0), 2.0), [0.62, -0.12, 0.0])
    T[2, 3] = 0.10 - apply(T, np.concatenate(shape.parts))[:, 2].min()
    body = Body("lump", shape, T)
    some = list(islice(sampled_grasps(ur5e, cell(body), "lump", T, approaches=APPROACHES), 20))
    assert some
    for grasp in some:
        T_hand = grasp.T_world_hand
        middle = T_hand[:3, 3] + ur5e.opening.pad_z_at(grasp.width_m) * T_hand[:3, 2]
        hit = line_contacts(shape, T, middle, T_hand[:3, 1])
        assert hit is not None
        assert hit.enter >= -grasp.width_m / 2 - 1e-6
        assert hit.leave <= grasp.width_m / 2 + 1e-6
        assert middle[2] > 0.10
