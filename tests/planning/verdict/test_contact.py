"""Contacts along motions: what is found is there, what is there is found; distances are never too large."""

from __future__ import annotations

from dataclasses import replace

import fcl
import numpy as np
import pytest
from conftest import random_q

from kinematics.collision.fcl_check import Verdict as Exact
from kinematics.collision.fcl_solids import shape_solids
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, Held, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import rotation_about, transform
from planning.plan import Motion
from planning.verdict.contact import certified_distance, contact_faults
from planning.verdict.course import courses
from planning.verdict.faults import Fault, Settings
from planning.verdict.hand import hand_of
from planning.verdict.ledger import Ledger, keep
from planning.verdict.pairs import link_solids, pairs_of
from planning.verdict.sweep import SLACK, Boxes, sweep

CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.30, 0.0, 0.10]), 0.03)
GRIP = transform(rotation_about((1.0, 0.0, 0.0), 1.4), [0.0, 0.0, 0.01])


def scene_of(robot: Robot, seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    bodies = [Body("0", Box(np.array([0.03, 0.05, 0.2])), transform(p=[5.0, 0.0, 0.0]))]
    for i in range(1, 8):
        p = rng.uniform([-0.5, -0.5, 0.0], [0.7, 0.5, 0.8])
        shape = Box(rng.uniform(0.03, 0.12, 3)) if i % 2 else Cylinder(float(rng.uniform(0.02, 0.05)), float(rng.uniform(0.1, 0.3)))
        bodies.append(Body(str(i), shape, transform(rotation_about(rng.normal(size=3), 1.0), p)))
    return Scene("test", to_ref(robot), CABINET, tuple(bodies), "0", Grasp(np.eye(4), 0.05))


def motion_of(robot: Robot, seed: int) -> Motion:
    a, b = random_q(robot, 2, seed)
    held = Held("0", GRIP) if seed % 2 else None
    q = np.array([a, a + 0.15 * (b - a), a + 0.2 * (b - a)])
    if seed % 3:
        q[:, robot.gripper_joint] = q[0, robot.gripper_joint]
    return Motion("transfer", robot.joint_names, q, np.arange(3.0), held)


def found_by_us(robot: Robot, scene: Scene, motion: Motion) -> dict[frozenset[str], float]:
    return {frozenset(f.bodies): f.amount or 0.0 for f in looked_at(robot, scene, motion, Settings())[0]}


def looked_at(robot: Robot, scene: Scene, motion: Motion, settings: Settings) -> tuple[list[Fault], list[Fault]]:
    hand = hand_of(robot)
    run, wrong = courses(hand.arm, [motion])
    assert not wrong
    poses = {name: T for name, T in scene.poses().items() if motion.held is None or name != motion.held.body}
    ledger = Ledger((), (poses,), poses, ())
    return contact_faults(robot, hand, scene, run, ledger, {}, settings)


def found_densely(robot: Robot, scene: Scene, motion: Motion, n: int = 60) -> dict[frozenset[str], float]:
    """The planner's own exact check, asked at every one of many samples."""
    exact, out = Exact(robot, scene), dict[frozenset[str], float]()
    poses = {name: T for name, T in scene.poses().items() if motion.held is None or name != motion.held.body}
    for k in np.linspace(0, len(motion.q) - 1, n):
        i = min(int(k), len(motion.q) - 2)
        q = motion.q[i] + (k - i) * (motion.q[i + 1] - motion.q[i])
        if (found := exact.first_contacts(q[None], poses, motion.held)) is not None:
            for c in found[1]:
                pair = frozenset((c.a, c.b))
                out[pair] = max(out.get(pair, 0.0), c.depth_m)
    return out


def test_contacts_are_those_of_many_samples(robot: Robot) -> None:
    """Of pairs that both look at: the hand's own parts, and what an SRDF switches off, are not the verdict's."""
    hand, names = hand_of(robot), [h.link for h in robot.hulls]
    ours = {frozenset((names[i], names[j])) for i, j in pairs_of(robot).checked}
    some = 0
    for seed in range(5):
        scene, motion = scene_of(robot, seed), motion_of(robot, 40 + seed)
        us, them = found_by_us(robot, scene, motion), found_densely(robot, scene, motion)
        outside = {p: d for p, d in them.items() if not p <= set(names) or p in ours}
        base = {n for n in names if hand.arm.links[n][0] == 0}
        must = {p for p, d in outside.items() if d > 0.0015 and not p & base}  # what the base stands on, and how deep, is its own matter
        assert must <= set(us), (seed, must - set(us))
        assert set(us) <= set(them), (seed, set(us) - set(them))
        assert all(us[p] == pytest.approx(them[p], rel=0.5, abs=0.003) for p in must if them[p] < 0.01)
        some += len(must)
    assert some > 5


def test_pairs_are_those_that_the_robot_lists(robot: Robot) -> None:
    """But for its fingers, which the verdict takes for one mechanism, and what an SRDF switches off, which it names."""
    names = [h.link for h in robot.hulls]
    pairs = pairs_of(robot)
    ours = {frozenset((names[i], names[j])) for i, j in pairs.checked}
    theirs = {frozenset((names[i], names[j])) for i, j in robot.self_pairs}
    hand = hand_of(robot).links
    assert ours == {p for p in theirs if not p <= hand}
    assert (len(pairs.switched_off) > 0) == (robot.name == "panda")


def test_pairs_that_an_srdf_switches_off_are_notes(ur5e: Robot) -> None:
    """They are no faults, and are looked at where other contacts are left out, too."""
    scene, names = scene_of(ur5e, 0), {h.link for h in ur5e.hulls}
    motion, pair = next((m, p) for m in (motion_of(ur5e, k) for k in range(40, 80)) for p in found_by_us(ur5e, scene, m) if p <= names)
    lenient = replace(ur5e, skip=ur5e.skip | {pair})
    for settings in (Settings(), Settings(contact=False)):
        faults, notes = looked_at(lenient, scene, motion, settings)
        assert [frozenset(note.bodies) for note in notes] == [pair]
        assert notes[0].detail.endswith("a pair that the robot's SRDF switches off")
        assert pair not in {frozenset(fault.bodies) for fault in faults}
        assert settings.contact or not faults


def test_distances_are_never_too_large(ur5e: Robot) -> None:
    """Against coal; and hardly ever much too small."""
    coal = pytest.importorskip("coal")
    rng, off = np.random.default_rng(3), []
    links = link_solids(ur5e)
    for _ in range(300):
        k = int(rng.integers(len(links)))
        a, hull = links[k], ur5e.hulls[k]
        points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for p in hull.vertices:
            points.append(p)
        for f in hull.faces:
            faces.append(coal.Triangle(*map(int, f)))
        size = rng.uniform(0.02, 0.2, 3)
        (b,) = shape_solids("b", Box(size))
        way = rng.normal(size=3)
        T_a = transform(rotation_about(rng.normal(size=3), 2.0))
        p = T_a[:3, :3] @ a.centre + way / np.linalg.norm(way) * rng.uniform(0.05, 0.4)
        T_b = transform(rotation_about(rng.normal(size=3), 2.0), p)
        at_a, at_b = (coal.Transform3s(T[:3, :3], T[:3, 3]) for T in (T_a, T_b))
        asked = coal.DistanceRequest(), coal.DistanceResult()
        expected = coal.distance(coal.Convex(points, faces), at_a, coal.Box(*size), at_b, *asked)
        found = certified_distance(a.move(T_a), b.move(T_b))
        assert (found <= 0) == (expected <= 0)
        if expected > 1e-4:
            assert found <= expected + 1e-6
            off.append(expected - found)
    assert np.median(off) < 1e-5
    assert np.mean(np.array(off) < 1e-3) > 0.95


def test_no_point_outruns_what_a_sweep_allows(robot: Robot) -> None:
    """Corners of the hulls, between samples: no further than the step, and no further than `gone` says."""
    hand, motion = hand_of(robot), motion_of(robot, 42)
    (course,), _ = courses(hand.arm, [motion])
    solids = link_solids(robot)
    carrier = np.array([hand.arm.links[s.name][0] for s in solids])
    T = np.array([hand.arm.links[s.name][1] for s in solids])
    box = np.array([s.box for s in solids])
    found = sweep(hand.arm, np.eye(4), course, Boxes(carrier, T, box[:, 0], box[:, 1]), 0.002)
    assert len(found.rows) > 50
    for i, s in enumerate(solids):
        points = s.vertices @ np.swapaxes(found.T[:, i, :3, :3], 1, 2) + found.T[:, i, None, :3, 3]
        ways = np.linalg.norm(np.diff(points, axis=0), axis=-1).max(1)
        assert ways.max() <= 0.002
        assert (ways <= np.diff(found.gone[:, i]) + 1e-12).all()
    assert np.diff(found.gone, axis=0).max() <= 0.002 + 1e-12
    assert SLACK > 1


def test_an_object_named_like_a_link_is_an_object(ur5e: Robot) -> None:
    """The base may stand on something; an object that bears its name may not be run into."""
    scene = scene_of(ur5e, 1)
    hand = hand_of(ur5e)
    motion = Motion("transit", ur5e.joint_names, np.tile(ur5e.home, (2, 1)), np.arange(2.0))
    forearm = transform(p=ur5e.base_p) @ ur5e.link_poses(ur5e.home)["forearm_link"]
    body = Body("base_link_inertia", Box(np.full(3, 0.1)), forearm)
    (course,), _ = courses(hand.arm, [motion])
    crowded = Scene(**{**vars(scene), "objects": (body,)})
    ledger = keep(hand, crowded, [course], Settings())
    faults, _ = contact_faults(ur5e, hand, crowded, [course], ledger, {}, Settings())
    assert any(set(f.bodies) == {"forearm_link", "base_link_inertia"} for f in faults)


def test_fcl_is_asked_with_fresh_results() -> None:
    """Results accumulate: a second query into the same one would find the first one's contact."""
    (a,), (b,) = shape_solids("a", Box(np.full(3, 0.1))), shape_solids("b", Box(np.full(3, 0.1)))
    assert certified_distance(a, b) == 0.0
    b.move(transform(p=[0.3, 0.0, 0.0]))
    assert certified_distance(a, b) == pytest.approx(0.2)
    assert not fcl.collide(a.object, b.object, fcl.CollisionRequest(), fcl.CollisionResult())
