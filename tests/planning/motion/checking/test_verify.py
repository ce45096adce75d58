"""The last word on a plan: what the covers prove apart, FCL finds apart; nothing else goes unasked; a contact of a millimetre is found."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace

import fcl
import numpy as np
import pytest
import test_second_engine as spoilers
from cluttered_cell import cell_of, cluttered
from conftest import Handmade, Json, random_q

from kinematics.chain import forward
from kinematics.collision import sphere_check
from kinematics.collision.broad_phase import BroadPhaseResult, broad_phase, elsewhere
from kinematics.collision.clearance import least_clearances
from kinematics.collision.fcl_check import Verdict
from kinematics.collision.fcl_solids import Contact
from kinematics.collision.stretches import PackedStretches, Stretch
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, Held, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.io.plan_documents import plan_from_json
from planning.io.scene_documents import scene_from_json
from planning.motion.checking.sampled_motion import RESOLUTION_M, samples
from planning.motion.checking.verify import hand_poses, verify
from planning.plan import Motion

CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.30, 0.0, 0.10]), 0.03)
FAR = Cabinet(np.array([0.5, 0.5, 0.5]), transform(p=[9.0, 0.0, 0.0]), 0.03)
GRIP = transform(rotation_about((1.0, 0.0, 0.0), 1.4), [0.0, 0.0, 0.01])
Walk = tuple[Array, Held | None, tuple[tuple[str, str], ...]]


def scene_of(robot: Robot, *bodies: Body, cabinet: Cabinet = CABINET) -> Scene:
    return Scene("test", to_ref(robot), cabinet, bodies, "0", Grasp(np.eye(4), 0.05))


def motion(robot: Robot, q: Array, held: Held | None = None, allowed_contacts: tuple[tuple[str, str], ...] = ()) -> Motion:
    return Motion("transit", robot.joint_names, q, np.arange(len(q), dtype=float), held, allowed_contacts)


def walks(robot: Robot, n: int, seed: int) -> list[Walk]:
    """Short motions of all kinds: the arm moves or stands, so do the fingers; something in the hand or not; some pairs allowed."""
    rng, out = np.random.default_rng(seed), []
    starts, ends = random_q(robot, n, seed), random_q(robot, n, seed + 1)
    for i in range(n):
        a, b = starts[i], starts[i] + 0.3 * (ends[i] - starts[i])
        b[robot.gripper_joint] = ends[i][robot.gripper_joint] if i % 3 == 0 else a[robot.gripper_joint]
        if i % 6 == 0:
            b[list(robot.arm_joints)] = a[list(robot.arm_joints)]
        links = [h.link for h in robot.hulls]
        may = tuple((links[rng.integers(len(links))], str(rng.integers(8))) for _ in range(i % 4))
        held = Held("0", transform(rotation_about(rng.normal(size=3), 1.0), [0, 0, 0.08 * (i % 3)])) if i % 2 else None
        out.append((a + np.linspace(0, 1, 21)[:, None] * (b - a), held, may))
    return out


# --------------------------------------------------------------------------------------------------------------------------- the covers


def test_pairs_that_are_not_open_are_apart(robot: Robot) -> None:
    """By FCL; and a configuration is free for the kernel just when none of its pairs is open."""
    cell = cell_of(robot)
    Q, world = cell.random(1003, 6), cell.task.world
    rows, which = sphere_check.open_pairs(cell.task.model, world, Q, cell.memory.spheres)
    P, B = world.check.shape
    assert (np.diff(rows * (P * B + len(world.pairs)) + which) > 0).all()
    free = np.ones(len(Q), bool)
    free[rows] = False
    assert np.array_equal(free, sphere_check.configs_free(cell.task.model, world, Q, cell.memory.spheres) == sphere_check.FREE)
    number = {(i, P + b): i * B + b for i in range(P) for b in range(B)} | {tuple(p): P * B + k for k, p in enumerate(world.pairs.tolist())}
    left_open, apart = set(zip(rows.tolist(), which.tolist())), 0
    for n, q in enumerate(Q[:200]):
        forward(cell.chain, q, cell.frames)
        for s, T in zip(cell.movers, cell.frames[cell.frame]):
            s.move(T)
        for i, j in cell.pairs.tolist():
            if (n, number[i, j]) not in left_open:
                assert not fcl.collide(cell.objects[i], cell.objects[j], fcl.CollisionRequest(), fcl.CollisionResult()), (q, i, j)
                apart += 1
    assert apart > 0.8 * 200 * len(cell.pairs)


def test_refused_joint_values_leave_every_pair_open(ur5e: Robot) -> None:
    cell = cell_of(ur5e)
    Q, world = np.tile(ur5e.arm_q(ur5e.home), (20, 1)), cell.task.world
    Q[3, 2], Q[17, 0] = np.nan, 100.0
    rows, _ = sphere_check.open_pairs(cell.task.model, world, Q, cell.memory.spheres)
    counts = np.bincount(rows, minlength=20)
    assert counts[[3, 17]].tolist() == [np.count_nonzero(world.check) + len(world.pairs)] * 2
    assert (np.delete(counts, [3, 17]) == counts[0]).all()
    assert counts[0] < 10
    assert all(not len(x) for x in sphere_check.open_pairs(cell.task.model, world, Q[:0], cell.memory.spheres))


# ------------------------------------------------------------------------------------------------------------------- covers and FCL as one


def judge(
    robot: Robot,
    scene: Scene,
    q: Array,
    poses: Mapping[str, Array],
    held: Held | None = None,
    may: tuple[tuple[str, str], ...] = (),
) -> BroadPhaseResult:
    """What the covers say of one stretch."""
    (result,) = broad_phase(PackedStretches(robot, scene, [Stretch(q, poses, held, may)]))
    return result


def test_the_sieved_verdict_is_the_verdict(robot: Robot) -> None:
    """The same first configuration, the same pairs, the same depths; also at each configuration by itself."""
    bodies = cluttered(np.random.default_rng(8))[5:]
    angle = ConvexMesh((box_corners(np.array([0.02, 0.03, 0.06])), box_corners(np.array([0.06, 0.03, 0.01])) - (-0.04, 0.0, 0.07)))
    bodies[0], bodies[3] = replace(bodies[0], shape=angle), replace(bodies[3], shape=angle)
    scene = scene_of(robot, *bodies)
    verdict = Verdict(robot, scene)
    hits = later = proven = pairs = 0
    for i, (q, held, may) in enumerate(walks(robot, 24, 3)):
        poses = {name: T for name, T in scene.poses().items() if held is None or name != held.body}
        judged = judge(robot, scene, q, poses, held, may)
        plain = verdict.first_contacts(q, poses, held, may)
        assert same(verdict.first_contacts(q, poses, held, may, judged), plain), i
        hits, later = hits + (plain is not None), later + (plain is not None and plain[0] > 0)
        proven, pairs = proven + judged.judged.sum() * len(q) - len(judged.rows), pairs + judged.judged.sum() * len(q)
        for row in q[:: 5 + i % 7]:
            one = verdict.first_contacts(row[None], poses, held, may, judge(robot, scene, row[None], poses, held, may))
            assert same(one, verdict.first_contacts(row[None], poses, held, may)), i
    assert hits > 6
    assert later > 0
    assert proven > 0.8 * pairs


@pytest.mark.parametrize("at", [(0.0, 0.015, 0.045), (0.0, 0.03, 0.04)])
def test_fingers_that_move_alone_pass_nothing_nearer_than_is_said(at: tuple[float, float, float], ur5e: Robot) -> None:
    """A pin ahead of one finger's tip, which comes nearest half-way. A claim may be 0.1 mm off for the verdict; these were 0.4 and 0.9."""
    wide, shut = (ur5e.with_arm(ur5e.home[list(ur5e.arm_joints)], ur5e.opening.value_at(width)) for width in (0.085, 0.0))
    alone = scene_of(ur5e, Body("0", Box(np.full(3, 0.004)), np.eye(4)), cabinet=FAR)
    T_hand = hand_poses(ur5e, alone, wide)
    pin = replace(alone.objects[0], T_world_body=T_hand @ transform(p=at))
    scene = scene_of(ur5e, pin, cabinet=FAR)
    rows = samples(ur5e, scene, motion(ur5e, np.stack([wide, shut])))
    (said,) = least_clearances(PackedStretches(ur5e, scene, [Stretch(rows, scene.poses())]), RESOLUTION_M)
    each = least_clearances(PackedStretches(ur5e, scene, [Stretch(row[None], scene.poses()) for row in rows]), RESOLUTION_M)
    assert said is not None
    distances = [found.distance_m for found in each if found is not None]
    assert said.between[1] == "0"
    assert 0 < int(np.argmin(distances)) < len(rows) - 1
    assert said.distance_m <= min(distances) + 1e-4


@pytest.mark.parametrize("at", [(0.0192, 0.0411, 0.0325), (-0.0035, 0.0491, 0.0313), (-0.015, 0.0402, 0.0324), (-0.0034, 0.0441, 0.0356)])
def test_nor_in_between_what_is_looked_at(at: tuple[float, float, float], ur5e: Robot) -> None:
    """Of such pins a finger that closes was said to keep up to 0.4 mm more than it does, and plans were judged false for it."""
    wide, shut = (ur5e.with_arm(ur5e.home[list(ur5e.arm_joints)], ur5e.opening.value_at(width)) for width in (0.085, 0.04))
    pin = Body("0", Box(np.full(3, 0.004)), hand_poses(ur5e, scene_of(ur5e, cabinet=FAR), wide) @ transform(p=at))
    scene = scene_of(ur5e, pin, cabinet=FAR)
    rows, fine = (np.linspace(wide, shut, n) for n in (9, 200))
    (said,) = least_clearances(PackedStretches(ur5e, scene, [Stretch(rows, scene.poses())]), RESOLUTION_M)
    each = least_clearances(PackedStretches(ur5e, scene, [Stretch(row[None], scene.poses()) for row in fine]), RESOLUTION_M)
    assert said is not None
    assert said.distance_m <= min(found.distance_m for found in each if found is not None) + 1e-4


def test_a_way_packed_as_a_whole_says_what_its_stretches_say(robot: Robot) -> None:
    """Covers, FCL and distances: the same of each stretch, whatever else moves and stands in the others."""
    scene = scene_of(robot, *cluttered(np.random.default_rng(8))[5:])
    way = [
        Stretch(q, {name: T for name, T in scene.poses().items() if held is None or name != held.body}, held, may)
        for q, held, may in walks(robot, 8, 3)
    ]
    way[2:2] = [replace(way[1], q=way[0].q[:1])]  # a stretch of one row
    packed, verdict = PackedStretches(robot, scene, way), Verdict(robot, scene)
    judged, clearances = broad_phase(packed), least_clearances(packed, RESOLUTION_M)
    firsts = []
    for s, stretch in enumerate(way):
        alone = PackedStretches(robot, scene, [stretch])
        (one,) = broad_phase(alone)
        for field in ("rows", "a", "b", "judged"):
            assert np.array_equal(getattr(one, field), getattr(judged[s], field)), (s, field)
        assert least_clearances(alone, RESOLUTION_M) == clearances[s : s + 1]
        firsts.append(verdict.first_contacts(stretch.q, stretch.poses, stretch.held, stretch.allowed_contacts, one))
    hits = [s for s, first in enumerate(firsts) if first is not None]
    assert hits
    for start in range(len(way)):
        found, ahead = verdict.along(way[start:], judged[start:]), [s for s in hits if s >= start]
        assert (found is None) == (not ahead)
        assert found is None or (found[0] == ahead[0] - start and same(found[1:], firsts[ahead[0]]))


def same(a: tuple[int, list[Contact]] | None, b: tuple[int, list[Contact]] | None) -> bool:
    return (a is None and b is None) or (a is not None and b is not None and a[0] == b[0] and set(a[1]) == set(b[1]))


def test_what_the_covers_never_judge_is_asked(ur5e: Robot) -> None:
    """A bar through the palm stands still to it; a block on the base never moves: both are found in the first configuration."""
    base = Body("block", Box(np.full(3, 0.05)), transform(p=ur5e.base_p) @ ur5e.link_poses(ur5e.home)["base_link_inertia"])
    bar = Body("0", Box(np.array([0.02, 0.02, 0.3])), np.eye(4))
    held = Held("0", np.eye(4))
    q = ur5e.home + np.linspace(0, 0.1, 5)[:, None] * np.isin(np.arange(len(ur5e.home)), ur5e.arm_joints)
    for scene, in_hand, body in ((scene_of(ur5e, base, cabinet=FAR), None, "block"), (scene_of(ur5e, bar, cabinet=FAR), held, "0")):
        poses = {} if in_hand else scene.poses()
        judged = judge(ur5e, scene, q, poses, in_hand)
        found = Verdict(ur5e, scene).first_contacts(q, poses, in_hand, (), judged)
        assert found is not None
        assert found[0] == 0
        assert any(body in (c.a, c.b) for c in found[1])


def test_fingers_that_close_on_something_are_asked_at_every_step(ur5e: Robot) -> None:
    """A block between the pads, touched near the end of the closing alone."""
    q = np.tile(ur5e.home, (15, 1))
    q[:, ur5e.gripper_joint] = np.linspace(ur5e.opening.value_at(0.08), ur5e.opening.value_at(0.05), 15)
    scene = scene_of(ur5e, Body("0", Box(np.full(3, 0.056)), np.eye(4)), cabinet=FAR)
    poses = {"0": hand_poses(ur5e, scene, q[0])}
    judged = judge(ur5e, scene, q, poses)
    found = Verdict(ur5e, scene).first_contacts(q, poses, None, (), judged)
    assert found is not None
    assert 5 < found[0] < 15
    assert {c.a for c in found[1]} <= ur5e.fingers
    everything = tuple((finger, "0") for finger in ur5e.fingers)
    assert Verdict(ur5e, scene).first_contacts(q, poses, None, everything, judge(ur5e, scene, q, poses, None, everything)) is None


def test_a_joint_that_the_covers_take_to_be_at_home(ur5e: Robot) -> None:
    """Nothing is judged when a joint besides the arm's and the gripper's has moved."""
    loose = replace(ur5e, arm_joints=ur5e.arm_joints[1:])
    assert elsewhere(loose, np.array([ur5e.home])) is False
    q = ur5e.home.copy()
    q[ur5e.arm_joints[0]] += 0.1
    assert elsewhere(loose, np.array([q])) is True


def test_slips_are_not_hidden(ur5e: Robot) -> None:
    """Covers asked about another scene, or about a pair that FCL is not to test, are refused; a pair they forget is asked."""
    scene = scene_of(ur5e, *cluttered(np.random.default_rng(8))[5:])
    poses = scene.poses()
    verdict, some = Verdict(ur5e, scene), 0
    for q, held, _ in walks(ur5e, 20, 5):
        if held is None and (plain := verdict.first_contacts(q, poses)) is not None:
            judged = judge(ur5e, scene, q, poses)
            with pytest.raises(ValueError, match="different pairs"):
                verdict.first_contacts(q, {n: T for n, T in poses.items() if n != "3"}, None, (), judged)
            with pytest.raises(ValueError, match="different pairs"):
                verdict.first_contacts(q, poses, None, [("floor", "forearm_link")], judged)
            nothing = replace(judged, judged=judged.judged & False, rows=judged.rows[:0], a=judged.a[:0], b=judged.b[:0])
            assert same(verdict.first_contacts(q, poses, None, (), nothing), plain)
            some += 1
    assert some


# -------------------------------------------------------------------------------------------------------------------------- whole motions


def test_no_point_moves_further_than_the_resolution(robot: Robot) -> None:
    """No vertex of a link or of the held object, between neighbouring samples; and not much less either."""
    scene = scene_of(robot, Body("0", Box(np.array([0.03, 0.05, 0.2])), np.eye(4)))
    for i, (a, b) in enumerate(zip(random_q(robot, 3, 1), random_q(robot, 3, 2))):
        held = Held("0", GRIP) if i else None
        way = motion(robot, np.array([a, a + 0.1 * (b - a), a + 0.1 * (b - a), 0.9 * a + 0.08 * b]), held)
        q = samples(robot, scene, way)
        assert all(np.abs(q - w).max(1).min() < 1e-9 for w in way.q)
        T, farthest = robot.tree.poses(q), np.zeros(len(q) - 1)
        groups = [(h.link, h.vertices) for h in robot.hulls]
        groups += [
            ("hand", np.array([[x, y, z, 1] for x in (-0.015, 0.015) for y in (-0.025, 0.025) for z in (-0.1, 0.1)]) @ GRIP[:3].T)
        ] * (i > 0)
        for link, points in groups:
            at = points @ np.swapaxes(T[:, robot.tree.index[link], :3, :3], 1, 2) + T[:, robot.tree.index[link], None, :3, 3]
            farthest = np.maximum(farthest, np.linalg.norm(np.diff(at, axis=0), axis=-1).max(1))
        assert farthest.max() <= RESOLUTION_M
        assert np.median(farthest) > 0.6 * RESOLUTION_M
    assert np.array_equal(samples(robot, scene, motion(robot, a[None])), a[None])


def test_no_point_moves_further_than_the_resolution_on_a_spline(robot: Robot) -> None:
    """Nor where the joints set out from rest, or turn back within a piece."""
    scene, rng = scene_of(robot, cabinet=FAR), np.random.default_rng(5)
    rest = np.zeros((2, len(robot.joint_names)))
    for a, b in zip(random_q(robot, 4, 1), random_q(robot, 4, 2)):
        q = np.array([a, a + 0.15 * (b - a)])
        way = replace(motion(robot, q), qd=rest + rng.normal(size=rest.shape) * [[0.0], [0.3]], qdd=rest)
        rows = samples(robot, scene, way)
        assert np.abs(rows[[0, -1]] - q).max() < 1e-12
        T = robot.tree.poses(rows)
        farthest = np.zeros(len(rows) - 1)
        for hull in robot.hulls:
            i = robot.tree.index[hull.link]
            at = hull.vertices @ np.swapaxes(T[:, i, :3, :3], 1, 2) + T[:, i, None, :3, 3]
            farthest = np.maximum(farthest, np.linalg.norm(np.diff(at, axis=0), axis=-1).max(1))
        assert farthest.max() <= RESOLUTION_M
        assert np.median(farthest) > 0.35 * RESOLUTION_M


def test_a_joint_that_leaves_its_limits_between_two_rows_is_found(ur5e: Robot) -> None:
    scene, rest = scene_of(ur5e, cabinet=FAR), np.zeros((2, len(ur5e.joint_names)))
    q = np.repeat(ur5e.home[None], 2, 0)
    q[:, 2] = ur5e.upper[2] - np.array([0.05, 0.0])
    for speed, holds in ((0.0, True), (-1.0, False)):
        qd = rest.copy()
        qd[1, 2] = speed
        found = verify(ur5e, replace(scene, objects=()), [replace(motion(ur5e, q), qd=qd, qdd=rest)])
        assert (found is None or found.detail is None or "leaves its limits" not in found.detail) == holds


def test_a_planted_contact_of_a_millimetre_is_found(robot: Robot) -> None:
    """A crumb, 1 mm inside a face of any solid that moves, anywhere on the way; half a millimetre outside it is none of our business."""
    rng, planted, outside = np.random.default_rng(4), 0, 0
    bar = Body("0", Cylinder(0.02, 0.1), np.eye(4))
    for q, held, _ in walks(robot, 30, 11):
        way = motion(robot, q[[0, -1]], held)
        empty = scene_of(robot, bar, cabinet=FAR)
        start = {} if held is None else {"0": hand_poses(robot, empty, q[0]) @ held.T_hand_body}
        empty = replace(empty, objects=tuple(replace(bar, T_world_body=T) for T in start.values()))
        if verify(robot, empty, [way]) is not None:
            continue
        rows = samples(robot, empty, way)
        row = rows[rng.integers(len(rows))]
        for hull in (robot.hulls[i] for i in rng.permutation(len(robot.hulls))[:4]):
            a, b, c = hull.vertices[hull.faces[rng.integers(len(hull.faces))]]
            z = np.cross(b - a, c - a)
            z = z / np.linalg.norm(z) * np.sign(z @ (a - hull.vertices.mean(0)))
            y = np.cross(z, b - a) / np.linalg.norm(b - a)
            T = (
                empty.robot.T_world_base
                @ robot.link_poses(row)[hull.link]
                @ transform(np.stack([np.cross(y, z), y, z], 1), (a + b + c) / 3)
            )
            crumb = Body("crumb", Box(np.full(3, 0.006)), T @ transform(p=[0, 0, 0.003 - 0.001]))
            found = verify(robot, replace(empty, objects=(*empty.objects, crumb)), [way])
            assert found is not None, (hull.link, q[0])
            assert found.body == "crumb"
            planted += 1
            still = replace(crumb, T_world_body=T @ transform(p=[0, 0, 0.003 + 0.0005]))
            found = verify(robot, replace(empty, objects=(*empty.objects, still)), [motion(robot, row[None], held)])
            assert found is None or found.link != hull.link or [h.link for h in robot.hulls].count(hull.link) > 1
            outside += found is None
    assert planted > 15
    assert outside > 5  # elsewhere another link lies behind the face


# ------------------------------------------------------------------------------------------------------------------------------ whole plans


def words(made: Handmade, robot: Robot) -> str | None:
    """What verify says about a plan in the files' form."""
    scene, plan = scene_from_json(made.scene), plan_from_json(made.plan)
    found = verify(robot, scene, plan.motions)
    return None if found is None else str(found)


def test_plans_that_hold(handmade: Handmade, planned: Handmade, ur5e: Robot) -> None:
    assert words(handmade, ur5e) is None
    assert words(planned, ur5e) is None


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (spoilers._into_a_wall, "left"),
        (spoilers._gap, "does not start where"),
        (spoilers._outside_the_limits, "limits"),
        (spoilers._held_elsewhere, "not where the hand takes it"),
        (spoilers._held_askew, "not where the hand takes it"),
        (spoilers._obstacle_in_the_way, "touches plate"),
        (spoilers._obstacle_where_the_can_goes, "touches low"),
        (spoilers._fingers_may_not_touch, "pad touches"),
    ],
)
def test_spoilt_plans(change: Callable[[Json, Json], object], word: str, handmade: Handmade, ur5e: Robot) -> None:
    scene, plan = json.loads(json.dumps([handmade.scene, handmade.plan]))
    change(scene, plan)
    assert word in (words(Handmade(scene, plan), ur5e) or "")
