"""The second engine accepts a plan that holds, and finds every way in which we spoil it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import coal
import numpy as np
import pytest
import trimesh
from conftest import Handmade, Json, make_plan, pose
from second_engine import (
    CONTACT_M,
    SLACK_M,
    Arm,
    Problem,
    Replay,
    Rider,
    Sweep,
    _deepest,
    _near,
    close,
    depth,
    matrix,
    replay,
    signed,
    solid,
    walls,
)

from kinematics.robots.load import load
from kinematics.robots.named import installed
from kinematics.robots.robot import Robot
from kinematics.scene import WALLS, Cabinet
from kinematics.shapes import Box
from kinematics.transforms import rotation_about, transform


def spoil(handmade: Handmade, change: Callable[[Json, Json], object]) -> Handmade:
    scene, plan = json.loads(json.dumps([handmade.scene, handmade.plan]))
    change(scene, plan)
    return Handmade(scene, plan)


def found(handmade: Handmade, urdf: Path, step_m: float = 0.002) -> list[Problem]:
    return replay(handmade.scene, handmade.plan, urdf, step_m)


def kinds(problems: list[Problem]) -> set[str]:
    return {p.kind for p in problems}


def stage(plan: Json, name: str) -> Json:
    """The first motion of a stage."""
    return next(m for m in plan["motions"] if m["stage"] == name)


@pytest.mark.parametrize("step_m", [0.001, 0.002, 0.005])
def test_a_plan_that_holds_passes(handmade: Handmade, ur5e_urdf: Path, step_m: float) -> None:
    assert found(handmade, ur5e_urdf, step_m) == []


def test_an_empty_plan_passes(handmade: Handmade, ur5e_urdf: Path) -> None:
    nothing = spoil(handmade, lambda s, p: p.update(motions=[], moves=[], success=False))
    assert found(nothing, ur5e_urdf) == []


def test_a_motion_of_one_waypoint_passes(handmade: Handmade, ur5e_urdf: Path) -> None:
    def stay(_: Json, plan: Json) -> None:
        first = plan["motions"][0]
        plan.update(motions=[{**first, "q": first["q"][:1], "t_s": [0.0]}], moves=[], success=False)

    assert found(spoil(handmade, stay), ur5e_urdf) == []


def _into_a_wall(_: Json, plan: Json) -> None:
    stage(plan, "transfer")["q"][9][0] += 0.6


def _gap(_: Json, plan: Json) -> None:
    plan["motions"][3]["q"][0][4] += 1e-3


def _too_fast(_: Json, plan: Json) -> None:
    plan["motions"][3]["t_s"] = [t / 1.6 for t in plan["motions"][3]["t_s"]]


def _outside_the_limits(scene: Json, plan: Json) -> None:
    scene["robot"]["q_start"]["elbow_joint"] -= 4.0
    for motion in plan["motions"]:
        for q in motion["q"]:
            q[2] -= 4.0


def _time_stands_still(_: Json, plan: Json) -> None:
    plan["motions"][0]["t_s"][3] = plan["motions"][0]["t_s"][2]


def _held_elsewhere(_: Json, plan: Json) -> None:
    for motion in plan["motions"]:
        if motion["held"]:
            motion["held"]["T_hand_body"]["p"][1] += 0.002


def _held_askew(_: Json, plan: Json) -> None:
    turn = np.array([np.cos(0.001), 0.0, 0.0, np.sin(0.001)])
    for motion in plan["motions"]:
        if motion["held"] and motion["held"]["body"] == "box":
            w, x, y, z = motion["held"]["T_hand_body"]["q_wxyz"]
            (a, _, _, d) = turn
            motion["held"]["T_hand_body"]["q_wxyz"] = [w * a - z * d, x * a + y * d, y * a - x * d, z * a + w * d]


def _moved_object_dropped(scene: Json, _: Json) -> None:
    scene["objects"] = [o for o in scene["objects"] if o["name"] != "can"]


def _target_dropped(scene: Json, _: Json) -> None:
    scene["objects"] = [o for o in scene["objects"] if o["name"] != "box"]


def _obstacle_in_the_way(scene: Json, _: Json) -> None:
    shape = {"type": "box", "size_m": [0.05, 0.002, 0.32]}
    scene["objects"].append({"name": "plate", "shape": shape, "T_world_object": pose(transform(p=[0.62, 0.15, 0.26]))})


def _obstacle_where_the_can_goes(scene: Json, _: Json) -> None:
    shape = {"type": "cylinder", "radius_m": 0.02, "height_m": 0.05}
    scene["objects"].append({"name": "low", "shape": shape, "T_world_object": pose(transform(p=[0.64, 0.28, 0.125]))})


def _fingers_may_not_touch(_: Json, plan: Json) -> None:
    _squeezed(_, plan, 0.03)
    for motion in plan["motions"]:
        motion["may_touch"] = []


def _everything_may_touch(_: Json, plan: Json) -> None:
    plan["motions"][0]["may_touch"] = [["forearm_link", "left"], ["can", "box"], ["left_inner_finger_pad", "box"]]


def _floor_in_the_carry(_: Json, plan: Json) -> None:
    stage(plan, "transfer")["may_touch"].append(["can", "floor"])


def _let_go_in_the_air(_: Json, plan: Json) -> None:
    lower = next(i for i, m in enumerate(plan["motions"]) if m["stage"] == "lower")
    high = plan["motions"][lower]["q"][0]
    motions = plan["motions"][:lower]
    opened = [*high[:-1], plan["motions"][0]["q"][0][-1]]
    motions.append({**plan["motions"][lower + 1], "q": [high, opened]})
    plan["moves"][0]["T_world_to"]["p"][2] += 0.03
    plan.update(motions=motions, success=False)


def _open_hand_carries(_: Json, plan: Json) -> None:
    for motion in plan["motions"]:
        for q in motion["q"]:
            q[-1] = plan["motions"][0]["q"][0][-1]


def _squeezed(_: Json, plan: Json, by: float = 0.15) -> None:
    """The gripper, shut around an object, shuts further; the motions before and after join on."""
    motions = plan["motions"]
    for before, motion, after in zip([None, *motions], motions, [*motions[1:], None]):
        if motion["held"]:
            for q in motion["q"]:
                q[-1] += by
            if before and not before["held"]:
                before["q"][-1][-1] += by
            if after and not after["held"]:
                after["q"][0][-1] += by


def test_the_fingers_may_press(handmade: Handmade, ur5e_urdf: Path) -> None:
    assert kinds(found(spoil(handmade, lambda s, p: _squeezed(s, p, 0.03)), ur5e_urdf)) <= {"speed"}


def _move_says_otherwise(_: Json, plan: Json) -> None:
    plan["moves"][0]["T_world_to"]["p"][1] += 0.003


def _move_forgotten(_: Json, plan: Json) -> None:
    plan["moves"] = []


def _move_never_made(_: Json, plan: Json) -> None:
    plan["moves"].append({**plan["moves"][0], "object": "box"})


def _target_still_inside(_: Json, plan: Json) -> None:
    last = plan["motions"][-1]
    last["q"], last["t_s"] = last["q"][:6], last["t_s"][:6]


def _success_with_an_empty_hand(_: Json, plan: Json) -> None:
    plan["motions"] = plan["motions"][:8]


def _other_scene(_: Json, plan: Json) -> None:
    plan["scene"] = "another"


def _joint_left_out(_: Json, plan: Json) -> None:
    plan["motions"][2]["joint_names"] = plan["motions"][2]["joint_names"][:-1]


def _base_moved(scene: Json, _: Json) -> None:
    scene["robot"]["T_world_base"]["p"][0] += 0.02


@pytest.mark.parametrize(
    ("change", "kind", "word"),
    [
        (_into_a_wall, "contact", "left"),
        (_gap, "gap", "rad from where"),
        (_too_fast, "speed", "times as fast"),
        (_outside_the_limits, "limit", "elbow_joint"),
        (_time_stands_still, "time", "does not increase"),
        (_held_elsewhere, "jump", "can jumps by 2.00 mm"),
        (_held_askew, "jump", "2.00 mrad"),
        (_moved_object_dropped, "form", "'can', which is not in the scene"),
        (_target_dropped, "form", "'box', which is not in the scene"),
        (_obstacle_in_the_way, "contact", "can is"),
        (_obstacle_where_the_can_goes, "rest", "inside low"),
        (_fingers_may_not_touch, "contact", "finger"),
        (_everything_may_touch, "allowance", "forearm_link and left"),
        (_everything_may_touch, "allowance", "can and box"),
        (_everything_may_touch, "allowance", "left_inner_finger_pad and box"),
        (_floor_in_the_carry, "allowance", "can and floor"),
        (_let_go_in_the_air, "rest", "above the floor"),
        (_open_hand_carries, "grip", "no finger"),
        (_squeezed, "contact", "pad"),
        (_move_says_otherwise, "move", "T_world_to"),
        (_move_forgotten, "move", "the hand carried ['can']"),
        (_move_never_made, "move", "['can', 'box']"),
        (_target_still_inside, "goal", "still inside"),
        (_success_with_an_empty_hand, "goal", "instead of box"),
        (_other_scene, "form", "'another'"),
        (_joint_left_out, "form", "actuated joints"),
        (_base_moved, "jump", "can jumps by 20.00 mm"),
    ],
)
def test_a_spoilt_plan_fails(handmade: Handmade, ur5e_urdf: Path, change: Callable[[Json, Json], object], kind: str, word: str) -> None:
    problems = found(spoil(handmade, change), ur5e_urdf)
    assert any(p.kind == kind and word in p.text for p in problems), [str(p) for p in problems]


def test_contacts_name_the_motion_and_the_depth(handmade: Handmade, ur5e_urdf: Path) -> None:
    problems = found(spoil(handmade, _into_a_wall), ur5e_urdf)
    deepest = max((p for p in problems if p.kind == "contact"), key=lambda p: p.depth_m)
    assert deepest.motion is not None
    assert handmade.plan["motions"][deepest.motion]["stage"] == "transfer"
    assert 0.001 < deepest.depth_m < 0.4


def test_the_order_of_joint_names_does_not_matter(handmade: Handmade, ur5e_urdf: Path) -> None:
    def turn(_: Json, plan: Json) -> None:
        for motion in plan["motions"]:
            motion["joint_names"] = motion["joint_names"][::-1]
            motion["q"] = [q[::-1] for q in motion["q"]]

    assert found(spoil(handmade, turn), ur5e_urdf) == []


def test_a_turned_world_changes_nothing(handmade: Handmade, ur5e_urdf: Path) -> None:
    """The whole scene turned and moved in the world: the same plan holds in it."""
    T = transform(rotation_about((0, 0, 1), 2.0), [3.0, -1.0, 0.5])

    def turn(scene: Json, plan: Json) -> None:
        places = [(scene["robot"], "T_world_base"), (scene["cabinet"], "T_world_cabinet")]
        places += [(o, "T_world_object") for o in scene["objects"]] + [
            (m, k) for m in plan["moves"] for k in ("T_world_from", "T_world_to")
        ]
        for entry, key in places:
            entry[key] = pose(T @ matrix(entry[key]))

    assert found(spoil(handmade, turn), ur5e_urdf) == []


def test_a_mesh_object_is_read_from_its_file(handmade: Handmade, ur5e_urdf: Path, tmp_path: Path) -> None:
    trimesh.creation.box((50, 50, 160)).export(tmp_path / "box.stl")

    def as_mesh(scene: Json, plan: Json) -> None:
        scene["objects"][1]["shape"] = {"type": "mesh", "file": "box.stl", "scale": 0.001}

    meshed = spoil(handmade, as_mesh)
    assert replay(meshed.scene, meshed.plan, ur5e_urdf, 0.002, tmp_path) == []
    spoilt = spoil(meshed, _held_elsewhere)
    assert "jump" in kinds(replay(spoilt.scene, spoilt.plan, ur5e_urdf, 0.002, tmp_path))


def test_walls_are_ours(handmade: Handmade) -> None:
    """The second engine's walls and kinematics.scene's, worked out apart, are the same boxes."""
    entry = {**handmade.scene["cabinet"], "T_world_cabinet": pose(transform(p=[0.3, 0.1, 0.2]))}
    ours = Cabinet(np.array(entry["size_m"]), matrix(entry["T_world_cabinet"]), entry["wall_m"]).walls()
    assert [b.name for b in ours] == [s.name for s, _ in walls(entry)]
    for body, (wall, T) in zip(ours, walls(entry)):
        assert isinstance(body.shape, Box)
        np.testing.assert_allclose(body.T_world_body, T, atol=1e-12)
        np.testing.assert_allclose(body.shape.half, wall.high, atol=1e-12)


def test_pairs_that_matter_are_found_alike(ur5e: Robot, ur5e_urdf: Path) -> None:
    """Which links may never touch each other: sampled here by coal, there by FCL."""
    arm = Arm(ur5e_urdf.read_text())
    theirs = {frozenset((arm.solids[i].name, arm.solids[j].name)) for i, j in arm.pairs}
    assert theirs == {frozenset((ur5e.hulls[i].link, ur5e.hulls[j].link)) for i, j in ur5e.self_pairs}
    assert arm.fingers == ur5e.fingers


def test_steps_are_as_short_as_asked(handmade: Handmade, ur5e_urdf: Path) -> None:
    """A plate thinner than a coarse step is missed by it, as expected, and never by a fine one."""
    plate = spoil(handmade, _obstacle_in_the_way)
    hits = [p for p in found(plate, ur5e_urdf, 0.001) if p.kind == "contact" and "plate" in p.text]
    assert hits


# --------------------------------------------------------------------------------------------------------------------- what is left out


class EverySample(Replay):
    """Looks at every sample of every pair, and infers nothing from its neighbours."""

    def _contacts(self, i: int, motion: Json, Q: np.ndarray) -> None:
        sweep, pairs = self._sweep(motion["held"], Q)
        joints = self.arm.joint_poses(sweep.values)
        allowed = {frozenset(pair) for pair in motion["may_touch"]}
        for g, h in pairs:
            (a, Ta), (b, Tb) = ((r.solid, joints[:, r.carrier] @ r.offset) for r in (sweep.riders[g], sweep.riders[h]))
            found = [(depth(a.geometry, Ta[s], b.geometry, Tb[s]) or 0.0, s) for s in np.flatnonzero(close(Ta, a, Tb, b))]
            d, s = max(found, key=lambda x: (x[0], -x[1]), default=(0.0, 0))
            if d > (self.touch_m if frozenset((a.name, b.name)) in allowed else CONTACT_M):
                self._say("contact", f"{a.name} is {1000 * d:.1f} mm inside {b.name} (sample {s} of {len(sweep.values)})", i, d)


def assert_alike(made: Handmade, urdf: Path, step_m: float, touch_m: float = 0.003, folder: Path = Path()) -> list[Problem]:
    """Looking at every sample says the same; of samples that are as deep, it may be another one that is named."""
    few, all_ = (engine(made.scene, made.plan, urdf, step_m, folder, touch_m).run() for engine in (Replay, EverySample))
    assert [str(p).split("(sample")[0] for p in few] == [str(p).split("(sample")[0] for p in all_]
    np.testing.assert_allclose([p.depth_m for p in few], [p.depth_m for p in all_], atol=1e-7)
    return few


def _pushed(seed: int, by_m: float) -> Callable[[Json, Json], None]:
    """Waypoints within motions are pushed by some mrad in each joint, about as many mm at the hand, and objects by as many mm."""

    def push(scene: Json, plan: Json) -> None:
        rng = np.random.default_rng(seed)
        for motion in plan["motions"]:
            for q in motion["q"][1:-1]:
                q[:6] = (q[:6] + rng.normal(size=6) * by_m).tolist()
        for entry in scene["objects"]:
            entry["T_world_object"]["p"] = (np.array(entry["T_world_object"]["p"]) + rng.normal(size=3) * by_m).tolist()

    return push


@pytest.mark.parametrize(("seed", "by_m", "touch_m"), [(0, 0.0, 0.0), (1, 0.004, 0.0), (2, 0.008, 0.001), (3, 0.015, 0.003)])
def test_no_sample_that_matters_is_left_out(handmade: Handmade, ur5e_urdf: Path, seed: int, by_m: float, touch_m: float) -> None:
    problems = assert_alike(spoil(handmade, _pushed(seed, by_m)), ur5e_urdf, 0.001, touch_m)
    assert "contact" in kinds(problems)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_nearest_sample_is_found_by_inference(handmade: Handmade, ur5e_urdf: Path, seed: int) -> None:
    """Of every pair, one that is apart, too, with a bound that its nearest sample is just beyond; what is not near is too far off."""
    made = spoil(handmade, _pushed(seed, 0.15))
    engine, motion = Replay(made.scene, made.plan, ur5e_urdf, 0.001), stage(made.plan, "transfer")
    columns = [motion["joint_names"].index(n) for n in engine.arm.actuated]
    sweep, pairs = engine._sweep(motion["held"], np.array(motion["q"])[:3, columns])
    one, two, near = _near(sweep, pairs)
    left, touching = dict(zip(zip(one, two), near)), 0
    for (g, h), nearing in zip(pairs, sweep.nearing(*pairs.T)):
        a, b = sweep.riders[g].solid.geometry, sweep.riders[h].solid.geometry
        distance = np.array([signed(a, sweep.at(s, g), b, sweep.at(s, h)) for s in range(len(sweep.values))])
        deepest, _ = _deepest(sweep, g, h, np.arange(len(nearing)), nearing, -distance.min() - 1e-6)
        assert deepest == pytest.approx(-distance.min(), abs=1e-7)
        assert (np.diff(distance) >= -np.repeat(nearing, sweep.counts) - SLACK_M).all()
        skipped = ~left.get((g, h), np.zeros(len(nearing), bool))
        ends = distance[sweep.starts]
        assert (ends[:-1] + ends[1:] > nearing * sweep.counts)[skipped].all()
        touching += distance.min() <= 0
    assert touching


def test_no_sample_at_a_surface_is_left_out(handmade: Handmade, ur5e_urdf: Path, tmp_path: Path) -> None:
    """The box becomes a pipe, of which coal knows the surface only."""
    trimesh.creation.annulus(0.02, 0.027, 0.16).export(tmp_path / "pipe.stl")

    def as_pipe(scene: Json, _: Json) -> None:
        scene["objects"][1]["shape"] = {"type": "mesh", "file": "pipe.stl"}

    assert "contact" in kinds(assert_alike(spoil(handmade, as_pipe), ur5e_urdf, 0.001, 0.0005, tmp_path))


def _spun_past_a_plate(handmade: Handmade, arm: Arm, angle: float) -> Handmade:
    """The hand turns the box in place by 0.5 rad; at `angle` its edge is half a micrometre too deep in a plate, for 0.6 mm of its way."""
    scene, plan = json.loads(json.dumps([handmade.scene, handmade.plan]))
    motion = plan["motions"][-1]
    turned = np.array([motion["q"][-1]] * 3)
    turned[:, motion["joint_names"].index("wrist_3_joint")] += [0.0, angle, 0.5]
    _, hand = arm.place(turned[:, [motion["joint_names"].index(n) for n in arm.actuated]])
    edge = np.array([0.08, 0.025, 0.0])  # in the hand, whose z is the wrist's axis
    out, axis = edge / np.linalg.norm(edge), np.array([0.0, 0.0, 1.0])
    face = transform(np.stack([out, np.cross(axis, out), axis], 1), edge + (0.01 - CONTACT_M - 5e-7) * out)
    scene["objects"][1]["T_world_object"] = pose(hand[0] @ matrix(motion["held"]["T_hand_body"]))
    scene["objects"].append({"name": "plate", "shape": {"type": "box", "size_m": [0.02] * 3}, "T_world_object": pose(hand[1] @ face)})
    plan.update(moves=[], motions=[{**motion, "q": turned[[0, 2]].tolist(), "t_s": [0.0, 9.0]}])
    return Handmade(scene, plan)


def test_a_contact_between_coarse_samples_is_found(handmade: Handmade, ur5e_urdf: Path) -> None:
    """Some paths stride over it in steps of 2 mm; none does in steps of 0.2 mm."""
    arm, missed = Arm(ur5e_urdf.read_text()), 0
    for angle in np.linspace(0.2, 0.3, 10):
        made = _spun_past_a_plate(handmade, arm, angle)
        (problem,) = assert_alike(made, ur5e_urdf, 0.0002)
        assert "box is 1.0 mm inside plate" in problem.text
        assert CONTACT_M < problem.depth_m < CONTACT_M + 6e-7
        missed += not found(made, ur5e_urdf, 0.002)
    assert 0 < missed < 10


def assert_steps_hold(arm: Arm, seed: int) -> None:
    """No corner moves further than `pace` from a sample to the next, `pace` keeps to the step, and steps are not much shorter than that."""
    rng = np.random.default_rng(seed)
    low, high = np.array([(max(arm.low[n], -3.0), min(arm.high[n], 3.0)) for n in arm.actuated]).T
    Q = np.cumsum([rng.uniform(low, high), *(rng.normal(size=(4, len(low))) * 0.1 * (high - low) / 6)], axis=0)
    riders = [Rider(s, int(c), T) for s, c, T in zip(arm.solids, arm.carrier, arm.offset)]
    riders.append(Rider(solid("held", coal.Box(0.1, 0.2, 0.3)), *arm.hand))
    sweep = Sweep(arm, Q, riders, 0.002)
    assert sweep.pace.max() <= 0.002 * (1 + 1e-12)
    poses = arm.joint_poses(sweep.values)[:, [r.carrier for r in riders]] @ np.array([r.offset for r in riders])
    corners = np.array([r.solid.corners for r in riders])
    points = np.einsum("sgij,gkj->sgki", poses[..., :3, :3], corners) + poses[..., None, :3, 3]
    moved = np.linalg.norm(np.diff(points, axis=0), axis=-1).max(-1)
    pace = np.repeat(sweep.pace, sweep.counts, axis=0)
    assert (moved <= pace * (1 + 1e-9) + 1e-12).all()
    assert np.median(moved.max(1)) > 0.7 * 0.002
    np.testing.assert_allclose(sweep.poses, poses[sweep.starts], atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_outruns_its_bound(robot: Robot, seed: int) -> None:
    assert_steps_hold(Arm(robot.urdf), seed)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_outruns_its_bound_on_sliding_joints(toy_urdf: Callable[..., Path], seed: int) -> None:
    assert_steps_hold(Arm(load(str(toy_urdf()), "tcp").urdf), seed)


# ------------------------------------------------------------------------------------------------------------------ the planner's plans


def test_plans_hold_in_another_engine(planned: Handmade, ur5e_urdf: Path) -> None:
    """Every motion that our planner hands out, of solved and of unsolved scenes."""
    assert planned.plan["verified"]
    assert found(planned, ur5e_urdf) == []


@pytest.mark.parametrize("name", ["panda", "gen3"])
def test_plans_of_other_robots_hold(name: str, tmp_path: Path) -> None:
    if not installed(name):
        pytest.skip(f"the package of {name} is not installed")
    robot = load(name)
    (tmp_path / "robot.urdf").write_text(robot.urdf)
    planned = make_plan(robot, "paper", 1, "local")
    assert planned.plan["verified"]
    assert found(planned, tmp_path / "robot.urdf") == []


SOME = pytest.mark.parametrize("planned", [("paper", 1), ("paper-any", 1), ("shelf", 1)], indirect=True, ids=lambda p: f"{p[0]}-{p[1]}")
"""One of each spec: what the engine must find in a spoilt plan is found alike in all of them."""


@SOME
def test_plans_with_a_waypoint_in_a_wall_fail(planned: Handmade, ur5e_urdf: Path) -> None:
    """One waypoint within the cabinet is shifted, by one joint, until something of the arm is in a wall."""
    motions = planned.plan["motions"]
    inside = next(i for i, m in enumerate(motions) if m["stage"] == "approach" and len(m["q"]) > 2)
    hit: set[int | None] = set()
    for joint, by in [
        ("shoulder_lift_joint", 0.5),
        ("shoulder_lift_joint", -0.5),
        ("shoulder_pan_joint", 1.0),
        ("shoulder_pan_joint", -1.0),
    ]:

        def shift(_: Json, plan: Json, joint: str = joint, by: float = by) -> None:
            plan.update(motions=plan["motions"][: inside + 1], success=False)
            motion = plan["motions"][inside]
            motion["q"][len(motion["q"]) // 2][motion["joint_names"].index(joint)] += by

        problems = found(spoil(planned, shift), ur5e_urdf, 0.005)
        hit |= {p.motion for p in problems if p.kind == "contact" and any(f"inside {wall} " in p.text for wall in WALLS)}
    assert hit == {inside}


@SOME
def test_plans_of_another_scene_fail(planned: Handmade, ur5e_urdf: Path) -> None:
    """What is moved has been dropped from the scene, or stands 4 mm further on."""
    carried = [m["held"]["body"] for m in planned.plan["motions"] if m["held"]]

    def drop(scene: Json, _: Json) -> None:
        scene["objects"] = [o for o in scene["objects"] if o["name"] != carried[0]]

    def push(scene: Json, _: Json) -> None:
        next(o for o in scene["objects"] if o["name"] == carried[0])["T_world_object"]["p"][0] += 0.004

    assert kinds(found(spoil(planned, drop), ur5e_urdf, 0.01)) == {"form"}
    assert "jump" in kinds(found(spoil(planned, push), ur5e_urdf, 0.01))
