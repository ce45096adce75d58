"""The trajectories of whole plans: smooth from rest to rest, within limits, the hand on its lines, free, and told to the gripper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import Handmade

from kinematics.collision.fcl_check import Verdict
from kinematics.inverse import BRISK, descend
from kinematics.quintic_spline import evaluate, hermite
from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Cabinet, Scene
from kinematics.shapes import bounds
from kinematics.transforms import transform
from planning.io.plan_documents import plan_from_json
from planning.io.scene_documents import scene_from_json
from planning.motion.checking.replay import replay, replayed, with_clearances
from planning.motion.checking.verify import hand_poses, verify
from planning.motion.handling import waiting
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.motion.search.reaching import APPROACH_M, APPROACH_STEPS, LARGEST_TURN
from planning.motion.smoothing.curve_check import WITHIN_M, curve_free, first_blocked
from planning.motion.smoothing.straight_line import write_line
from planning.motion.trajectory import FULL, STRAIGHT, Pace, _Drive, timed
from planning.plan import Motion
from planning.scenes.generation import generate, load_spec

KINDS = ("velocity", "acceleration", "jerk")
JUMP = 0.2  # rad by which a joint's turns differ from one waypoint to the next where the arm jumps to another way


def shares(robot: Robot, motion: Motion) -> list[float]:
    """The largest shares of their limits that velocity, acceleration and jerk reach at 1 kHz."""
    at = np.arange(0.0, motion.t_s[-1], 1e-3)
    return [float((np.abs(evaluate(motion.spline, at, order)) / getattr(robot, kind)).max()) for order, kind in enumerate(KINDS, 1)]


def test_motions_are_smooth_from_rest_to_rest_and_within_limits(planned: Handmade, ur5e: Robot) -> None:
    plan = plan_from_json(planned.plan)
    for i, motion in enumerate(plan.motions):
        assert motion.qd is not None
        assert motion.qdd is not None
        assert motion.t_s[0] == 0.0
        assert (np.diff(motion.t_s) > 0).all()
        assert not motion.qd[[0, -1]].any()
        assert not motion.qdd[[0, -1]].any()
        assert max(shares(ur5e, motion)) <= 1.0
        if i:
            assert np.array_equal(motion.q[0], plan.motions[i - 1].q[-1])


def test_the_hand_keeps_to_its_lines(planned: Handmade, ur5e: Robot) -> None:
    scene, plan = scene_from_json(planned.scene), plan_from_json(planned.plan)
    for motion in (m for m in plan.motions if m.stage in STRAIGHT):
        T = hand_poses(ur5e, scene, motion.at(np.arange(0.0, motion.t_s[-1], 2e-3)))
        first, last = T[0, :3, 3], T[-1, :3, 3]
        along = (last - first) / np.linalg.norm(last - first)
        off = T[:, :3, 3] - first
        assert np.linalg.norm(off - np.outer(off @ along, along), axis=1).max() < 2e-4
        assert (motion.qd[1:-1] != 0).any(1).all()  # one piece, without a stop


def test_the_hand_keeps_to_its_lines_near_singularities_and_with_a_joint_to_spare() -> None:
    """Where the arm bends so much that a spline through waypoints every centimetre would leave the line, it goes through more of them."""
    panda = load("panda")
    scene = generate(load_spec("paper"), panda, to_ref(panda), 5, 0)
    drive, rng, strayed = _Drive(Motions(panda, scene).cell, FULL), np.random.default_rng(0), [list[float](), list[float]()]
    arm, hand = drive.cell.arm, drive.cell.hand
    for _ in range(300):
        way = np.repeat(rng.uniform(arm.chain.lower, arm.chain.upper)[None], APPROACH_STEPS + 1, 0)
        T = arm.hand_pose(way[0])
        for k in range(1, len(way)):
            T[:3, 3] += APPROACH_M / APPROACH_STEPS * T[:3, 2]
            way[k] = way[k - 1]
            if not descend(arm.chain, arm.T_frame_hand, T, way[k], hand.frames, hand.work, BRISK):
                break
        else:
            if np.abs(np.diff(way, axis=0)).max() < LARGEST_TURN and np.abs(np.diff(way, n=2, axis=0)).max() < JUMP:
                for q, off in zip((way, drive._on_line(way)), strayed):
                    work = np.empty_like(q), np.empty(len(q)), np.empty((4, q.shape[1]))
                    count = write_line(q, APPROACH_M, np.inf, *panda.arm_limits, *work, drive.t, drive.rows)
                    spline = hermite(drive.t[:count], *np.swapaxes(drive.rows[:count], 0, 1))
                    p = np.array([arm.hand_pose(x)[:3, 3] for x in evaluate(spline, np.linspace(0, drive.t[count - 1], 100))])
                    along = (p[-1] - p[0]) / APPROACH_M
                    off.append(float(np.linalg.norm((p - p[0]) - np.outer((p - p[0]) @ along, along), axis=1).max()))
    before, after = map(np.array, strayed)
    assert len(after) > 50
    assert before.max() > 2e-4
    assert after.max() < 2e-4
    assert (after <= before + 1e-6).all()


def test_the_gripper_is_told_before_and_after_and_moves_beside_the_arm_in_transits_alone(planned: Handmade, ur5e: Robot) -> None:
    plan, g, arm = plan_from_json(planned.plan), ur5e.gripper_joint, list(ur5e.arm_joints)
    for motion in plan.motions:
        assert motion.gripper is not None
        assert (motion.gripper.before.value, motion.gripper.after.value) == (motion.q[0, g], motion.q[-1, g])
        assert motion.gripper.after.force_N == (40.0 if motion.held or motion.stage == "grasp" else None)
        assert ur5e.opening.value_at(motion.gripper.after.width_m) == pytest.approx(motion.q[-1, g], abs=1e-9)
        if motion.stage != "transit" and motion.gripper.before != motion.gripper.after:
            assert not np.ptp(motion.q[:, arm], axis=0).any()


def test_a_transit_is_free_however_early_or_late_the_fingers_are(planned: Handmade, ur5e: Robot) -> None:
    """FCL finds nothing at configurations of the arm on its way with the fingers anywhere between before and after."""
    scene, plan = scene_from_json(planned.scene), plan_from_json(planned.plan)
    verdict, rng, moved = Verdict(ur5e, scene), np.random.default_rng(0), 0
    for motion, poses in replay(ur5e, scene, plan.motions):
        before, after = motion.q[[0, -1], ur5e.gripper_joint]
        if motion.stage != "transit" or before == after:
            continue
        q = motion.at(rng.uniform(0, motion.t_s[-1], 100))
        q[:, ur5e.gripper_joint] = rng.uniform(*sorted((before, after)), len(q))
        assert verdict.first_contacts(q, poses) is None
        fingers = motion.at(np.linspace(0, motion.t_s[-1], 200))[:, ur5e.gripper_joint]
        assert (np.diff(fingers) * (after - before) > -1e-12).all()
        moved += np.ptp(ur5e.arm_q(motion.q), axis=0).max() > 0
    if not moved:
        pytest.skip("this plan sets its fingers while the arm stands")


@pytest.mark.parametrize("name", ["panda", "gen3"])
def test_other_robots_keep_their_limits(name: str) -> None:
    from conftest import make_plan

    robot = load(name)
    plan = plan_from_json(make_plan(robot, "paper", 1, "local").plan)
    assert plan.verified
    assert plan.motions
    assert max(max(shares(robot, motion)) for motion in plan.motions) <= 1.0


@pytest.fixture(scope="module")
def found(ur5e: Robot, planned_scene: Handmade) -> tuple[Motions, Done]:
    """A target that is taken out, as waypoints."""
    scene = scene_from_json(planned_scene.scene)
    scene = replace(scene, objects=tuple(b for b in scene.objects if b.name == scene.target))
    motions = Motions(ur5e, scene)
    done = motions.retrieve_target(motions.start(), np.random.default_rng(0))
    assert isinstance(done, Done)
    return motions, done


@pytest.fixture(scope="module")
def planned_scene(ur5e: Robot) -> Handmade:
    from conftest import make_plan

    return make_plan(ur5e, "paper", 0, "local")


def test_pace(found: tuple[Motions, Done], ur5e: Robot) -> None:
    """Half the speed takes twice as long on the same curves; the hand with an object is as fast as it may be, and the empty one faster."""
    motions, done = found
    poses = motions.start().poses
    full, half = (timed(motions.cell, poses, done.motions, Pace(speed, 10.0)) for speed in (1.0, 0.5))
    for a, b in zip(full, half):
        assert b.t_s[-1] == pytest.approx(2 * a.t_s[-1])
        at = np.linspace(0, a.t_s[-1], 50)
        assert np.abs(a.at(at) - b.at(2 * at)).max() < 1e-9
    for fastest in (0.1, 0.4):
        for motion in timed(motions.cell, poses, done.motions, Pace(1.0, fastest)):
            p = hand_poses(ur5e, motions.scene, motion.at(np.arange(0.0, motion.t_s[-1], 1e-3)))[:, :3, 3]
            speed = np.linalg.norm(np.diff(p, axis=0), axis=1).max() / 1e-3
            assert speed <= fastest or motion.held is None
            assert speed > 0.7 * fastest or motion.held is None or motion.stage == "lift"


def test_motions_slow_down_near_things(found: tuple[Motions, Done], ur5e: Robot) -> None:
    motions, done = found
    start = motions.start()
    full, slow = (timed(motions.cell, start.poses, done.motions, Pace(1.0, 10.0, below)) for below in (0.0, 0.01))
    for a, b, c in zip(full, slow, with_clearances(full, replayed(ur5e, motions.scene, full))):
        assert c.clearance_m is not None
        if a.stage != "grasp":
            assert b.t_s[-1] == pytest.approx(a.t_s[-1] * min(10.0, max(1.0, 0.01 / c.clearance_m)), rel=0.12)


def test_the_whole_is_free(found: tuple[Motions, Done], ur5e: Robot) -> None:
    motions, done = found
    assert verify(ur5e, motions.scene, motions.trajectories(motions.start(), done.motions)) is None


def test_corners_are_rounded_and_never_into_anything(planned_scene: Handmade, ur5e: Robot) -> None:
    """Random free polylines with a corner, before and in a full cabinet."""
    rng, rounded, tried = np.random.default_rng(3), 0, 0
    scene = scene_from_json(planned_scene.scene)
    motions = Motions(ur5e, scene)
    cell, poses, gripper = motions.cell, motions.start().poses, float(ur5e.home[ur5e.gripper_joint])
    query = cell.problem(poses, gripper)
    inside = [ur5e.arm_q(m.q[0]) for m in plan_from_json(planned_scene.plan).motions if m.stage == "approach"]
    for i in range(300):
        start = inside[0] if i % 2 and inside else ur5e.arm_q(motions.start().q)
        corner = start + rng.normal(size=6) * 0.3
        end = corner + rng.normal(size=6) * 0.3
        if cell.edge(query, start, corner) or cell.edge(query, corner, end):
            continue
        waypoints = np.array([ur5e.with_arm(q, gripper) for q in (start, corner, end)])
        (smooth,) = timed(cell, poses, [Motion("transit", ur5e.joint_names, waypoints, np.arange(3.0))], Pace())
        curve = np.ascontiguousarray(ur5e.arm_q(smooth.at(np.linspace(0, smooth.t_s[-1], 300))))
        assert first_blocked(query.task, curve, len(curve), cell.enter(query)) < 0
        tried, rounded = tried + 1, rounded + bool(np.abs(curve - corner).max(1).min() > 1e-3)
    assert tried > 20
    assert rounded > tried / 2


@pytest.mark.parametrize("joint", [0, 3, 5])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_curve_is_not_free_where_a_joint_leaves_its_limits_between_its_rows(
    found: tuple[Motions, Done], ur5e: Robot, joint: int, side: float
) -> None:
    motions, _ = found
    cell, start = motions.cell, motions.start()
    q, query = ur5e.arm_q(start.q), cell.problem(start.poses, float(start.q[ur5e.gripper_joint]))
    task, ends, points = cell.for_chords(query, 0.0, WITHIN_M), np.empty((2, 3, 6)), np.empty((64, 6))
    t, rows = np.array([0.0, 0.1]), np.zeros((2, 3, 6))
    rows[:, 0] = q
    rows[0, 1, joint], rows[1, 1, joint] = 0.05 * side, -0.05 * side  # it swings out by less than 1 mrad, and back

    def free(room: float) -> bool:
        return bool(curve_free(task, t, rows, 2, q - room, q + room, ends, points, cell.enter(query)))

    assert free(0.002)
    assert not free(0.0005)


@pytest.mark.parametrize("speed", [0.0, 0.001, 1.5])
def test_a_pace_that_cannot_be_meant(speed: float) -> None:
    with pytest.raises(ValueError, match="speed must lie between"):
        Pace(speed)
    with pytest.raises(ValueError, match="hand's speed must be positive"):
        Pace(1.0, 0.0)


def test_a_motion_that_goes_nowhere_takes_a_moment(ur5e: Robot) -> None:
    far = Cabinet(np.array([0.5, 0.5, 0.5]), transform(p=[9.0, 0.0, 0.0]), 0.03)
    cell = Motions(ur5e, Scene("test", to_ref(ur5e), far, (), None, None)).cell
    (smooth,) = timed(cell, {}, [Motion("transit", ur5e.joint_names, ur5e.home[None], np.zeros(1))], Pace())
    assert smooth.t_s.tolist() == [0.0, 0.001]
    assert np.allclose(smooth.at(np.array([0.0005]))[0], ur5e.home, atol=1e-12)


def test_fingers_may_move_while_the_arm_stands_still_for_a_part_of_a_way(found: tuple[Motions, Done], ur5e: Robot) -> None:
    """Ways that begin with what is known of another repeat its first waypoint, rounded otherwise."""
    motions, done = found
    transit = next(m for m in done.motions if m.stage == "transit")
    twice = np.concatenate([transit.q[:1], transit.q])
    twice[1, list(ur5e.arm_joints)] += 5e-17
    twice[:, ur5e.gripper_joint] = np.linspace(0.1, 0.4, len(twice))
    motion = replace(transit, q=twice, t_s=np.arange(len(twice), dtype=float))
    (driven,) = timed(motions.cell, motions.start().poses, [motion], FULL)
    assert (np.diff(driven.t_s) > 0).all()
    np.testing.assert_array_equal(driven.q[[0, -1]], twice[[0, -1]])


def test_a_target_is_pulled_straight_out_wholly_and_no_further_than_needed(found: tuple[Motions, Done], ur5e: Robot) -> None:
    motions, done = found
    scene, out = motions.scene, done.motions[-1]
    assert out.held is not None
    T = np.linalg.inv(scene.cabinet.T_world_cabinet) @ hand_poses(ur5e, scene, out.q[-1]) @ out.held.T_hand_body
    inmost = bounds(scene.body(out.held.body).shape, T)[1][0]
    assert -0.2 < inmost < 0
    query = motions.cell.problem({}, float(out.q[0, ur5e.gripper_joint]), held=out.held)
    near = waiting.pulled_out(motions.cell, query, out.held, ur5e.arm_q(out.q[0]))
    assert len(near)
    for q in near:
        assert motions.cell.touch(query, q) is None
        T = np.linalg.inv(scene.cabinet.T_world_cabinet) @ motions.cell.arm.hand_pose(q) @ out.held.T_hand_body
        assert bounds(scene.body(out.held.body).shape, T)[1][0] == pytest.approx(-waiting.OUTSIDE_M, abs=2e-3)


def test_an_arm_follows_its_hand_on_the_branch_that_it_is_on(found: tuple[Motions, Done], ur5e: Robot) -> None:
    motions, done = found
    cell, q = motions.cell, ur5e.arm_q(done.motions[-1].q[0])
    T = cell.arm.hand_pose(q)
    T[:3, 3] -= 0.05 * T[:3, 2]
    followed = cell.follow(T, q)
    assert followed is not None
    np.testing.assert_allclose(cell.arm.hand_pose(followed), T, atol=1e-5)
    np.testing.assert_allclose(followed, cell.ik(T, near=q)[0], atol=1e-4)
    assert np.array_equal(q, ur5e.arm_q(done.motions[-1].q[0]))
    T[:3, 3] -= 5.0 * T[:3, 2]
    assert cell.follow(T, q) is None
