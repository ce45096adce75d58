"""Picks and places of the compiled core: what it calls free is free by FCL, and one question does not change the answer to another."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice, pairwise, product
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics.collision.fcl_check import Verdict
from kinematics.collision.fcl_solids import apart
from kinematics.collision.posed_geometry import make_posed_geometry
from kinematics.collision.robot_model import RobotCollisionModel
from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene, State
from kinematics.shapes import Cylinder, bounds
from kinematics.transforms import inverse, transform
from planning.grasping.finger_grasps import open_width, sample_grasps
from planning.learning.labelling.brief_look import BriefLook
from planning.motion import pick_place
from planning.motion.cell import workcell
from planning.motion.cell.arm import FINGERS_AT, Arm
from planning.motion.cell.queries import pair_of
from planning.motion.checking.replay import replayed, with_clearances
from planning.motion.checking.verify import verify
from planning.motion.handling.carry import Done
from planning.motion.pick_place import PATIENTLY, Motions
from planning.motion.search import reaching
from planning.plan import Blocked, Motion
from planning.scenes.generation import generate, load_spec

SPECS = ("paper", "paper-any", "shelf")


@pytest.fixture(scope="module", params=SPECS)
def scene(request: pytest.FixtureRequest, ur5e: Robot) -> Scene:
    return generate(load_spec(request.param), ur5e, to_ref(ur5e), 23, 0)


def kept_m(robot: Robot, motion: Motion, name: str) -> float:
    """What a roomy motion keeps in metres, a rounding less: more from what stands than between the arm's links and what it holds."""
    own = {*robot.frame_of_links(0.0, np.eye(4)), *([name] if motion.held else [])}
    return 0.0019 if set(motion.clearance_between or ()) <= own else 0.0029


def answers(motions: Motions, state: State, names: list[str], regions: range) -> dict[tuple[str, int], object]:
    """What relocating to some regions gives: the motions' waypoints, or why not."""
    out: dict[tuple[str, int], object] = {}
    for name in names:
        for region in regions:
            done = motions.relocate(state, name, region, np.random.default_rng([5, region]))
            out[name, region] = str(done) if isinstance(done, Blocked) else np.concatenate([m.q for m in done.motions]).tobytes()
    return out


def test_varied_picks_are_some_of_all_and_unlike_one_another(ur5e: Robot) -> None:
    """Of the grasps of the exhaustive look, the same each time; of their hands, some look from elsewhere than the most natural ones."""
    scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 23, 0)
    motions, state, wider = Motions(ur5e, scene), State(ur5e.home, scene.poses()), 0
    for body in scene.objects[3:5]:  # a can and a box; each takes some seconds
        (natural, _), (varied, _) = (look.picks(state, body.name) for look in (motions.exhaustive, motions.varied))
        all_hands = {grasp.T_world_hand.tobytes() for grasp in motions.exhaustive._picking.grasps(state.poses, body.name)}
        hands = [pick.grasp.T_world_hand for pick in varied]
        assert {T.tobytes() for T in hands} <= all_hands
        again = Motions(ur5e, scene).varied.picks(state, body.name)[0]
        assert [T.tobytes() for T in hands] == [pick.grasp.T_world_hand.tobytes() for pick in again]
        assert bool(varied) == bool(natural)
        if natural:
            spread = [np.ptp([T[:3, 2] for T in some], axis=0).sum() for some in ([p.grasp.T_world_hand for p in natural], hands)]
            wider += spread[1] > spread[0]
    assert wider >= 2


def test_of_varied_picks_those_are_carried_that_one_search_for_all_finds_a_way_to(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """No place is sought for others; where none is found nothing is, and that is not asked again in a state, nor for moves in too many."""
    scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 23, 0)
    rng, motions = np.random.default_rng(0), Motions(ur5e, scene)
    state = motions.start()
    choices = product([n for n in scene.poses() if n != scene.target_name], range(scene.regions_n**2))
    name, region = next(choice for choice in choices if isinstance(motions.relocate(state, *choice, rng), Done))
    look = Motions(ur5e, scene).varied
    done = look.relocate(state, name, region, rng)
    assert isinstance(done, Done)
    assert look._ways(state).reached[name]
    assert np.allclose(done.after.poses[name][:2, 3], scene.regions()[region][:2], atol=1e-6)

    asked = list[int]()
    monkeypatch.setattr("planning.motion.pick_place.reached", lambda *_, searches, **__: asked.append(searches) or {})
    monkeypatch.setattr("planning.motion.handling.placing.Placing.place", lambda *_: pytest.fail("a place was sought"))
    monkeypatch.setattr(pick_place, "IN_VAIN", 2)
    look = Motions(ur5e, scene).varied
    for _ in range(2):
        blocked = look.relocate(state, name, region, rng)
        assert isinstance(blocked, Blocked)
        assert blocked.stage == "transit"
        assert look.out_of_reach(state, name)
    assert asked == [1]
    for there in (state, replace(state)):  # what is told is asked whatever was in vain elsewhere
        assert not look.gets_to(there, name, rng)
        assert not look.gets_to(there, name, rng)
    assert asked == [1, PATIENTLY - 1, PATIENTLY]
    beyond = replace(state)
    assert isinstance(look.relocate(beyond, name, region, rng), Blocked)
    assert look.out_of_reach(beyond, name)
    assert asked == [1, PATIENTLY - 1, PATIENTLY]


def test_picks_hold_up_to_fcl(scene: Scene, ur5e: Robot) -> None:
    """Every waypoint of an approach and of a lift is free, with the open and with the closed hand, and the hand is where it says."""
    motions, verdict = Motions(ur5e, scene), Verdict(ur5e, scene)
    state, seen = motions.start(), 0
    for body in scene.objects:
        for pick in motions.picks(state, body.name)[0]:
            assert np.allclose(motions.cell.arm.hand_pose(pick.approach[-1]), pick.grasp.T_world_hand, atol=1e-4)
            assert np.array_equal(pick.approach[-1], pick.lift[0])
            assert np.abs(np.diff(pick.approach, axis=0)).max() < 0.3
            pads = [(pad, body.name) for pad in ur5e.pads]
            rest = {n: T for n, T in state.poses.items() if n != body.name}
            for q in pick.approach:
                assert not verdict.contacts(State(ur5e.with_arm(q, pick.gripper_open), state.poses))
            for q in pick.lift:
                assert not verdict.contacts(State(ur5e.with_arm(q, pick.gripper_closed), rest, pick.held), [*pads, (body.name, "floor")])
            seen += 1
    assert seen > 5


def test_what_stands_there_already_is_not_moved(ur5e: Robot) -> None:
    """After a move to a region, the same move again is refused, and says so."""
    scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 23, 1)
    motions, rng = Motions(ur5e, scene), np.random.default_rng(0)
    state = motions.start()
    for name, region in product([b.name for b in scene.objects if b.name != scene.target], range(0, scene.regions_n**2, 7)):
        done = motions.relocate(state, name, region, rng)
        if isinstance(done, Done):
            again = motions.relocate(done.after, name, region, rng)
            assert isinstance(again, Blocked)
            assert again.detail == "it stands there already"
            return
    pytest.fail("nothing could be moved")


def test_the_hand_alone_refuses_no_grasp_that_the_arm_can_take(scene: Scene, ur5e: Robot) -> None:
    """Where the hand alone touches, the whole arm does in every solution; where it does not, some solutions are free."""
    motions = Motions(ur5e, scene)
    cell, poses = motions.cell, motions.start().poses
    taken, refused = 0, 0
    for body in scene.objects:
        for grasp in islice(sample_grasps(body, ur5e.opening, scene.approaches, scene.cabinet.T_world_cabinet[2, 3], 0.0), 20):
            coming = cell.problem(poses, ur5e.opening.value_at(open_width(grasp.width_m, ur5e.opening)))
            code, pair = reaching.hand_way_in(cell.hand, coming.task, grasp.T_world_hand, cell.memory)
            cell.forget()
            solutions = cell.ik(grasp.T_world_hand)
            free = [cell.touch(coming, q) is None for q in solutions]
            if code == reaching.AT_GRASP:
                assert not any(free)
                assert pair_of(coming, pair) is not None
                refused += 1
            taken += code == reaching.OK and any(free)
    assert taken > 3
    assert refused > 3


def test_what_is_moved_stands_in_its_region_and_nothing_touches(scene: Scene, ur5e: Robot) -> None:
    """Moves that are found pass the final check; the object stands upright on the floor, clear of all others, over the cell's centre. Those
    that are not called tight keep their distance while it is carried and put down, by FCL."""
    motions = Motions(ur5e, scene)
    state, done, roomy = motions.start(), 0, 0
    for body in scene.objects:
        if body.name == scene.target:
            continue
        for region in range(5, scene.regions_n**2, 17):
            moved = motions.relocate(state, body.name, region, np.random.default_rng(region))
            if isinstance(moved, Blocked):
                assert moved.stage
                continue
            assert verify(ur5e, scene, moved.motions) is None
            T = moved.after.poses[body.name]
            low, high = bounds(body.shape, T)
            assert np.allclose((low + high)[:2] / 2, scene.regions()[region][:2], atol=1e-9)
            assert low[2] == pytest.approx(motions.scene.cabinet.T_world_cabinet[2, 3], abs=1e-9)
            standing = [replace(b, T_world_body=state.poses[b.name]) for b in scene.objects if b.name != body.name]
            assert apart(replace(body, T_world_body=T), [*standing, *scene.cabinet.walls()[1:]], 0.0009)
            done += 1
            if not moved.tight:
                roomy += 1
                for m in with_clearances(moved.motions, replayed(ur5e, scene, moved.motions)):
                    assert m.clearance_m is not None
                    if m.stage in ("transfer", "lower", "retreat"):
                        assert m.clearance_m > kept_m(ur5e, m, body.name), (m.stage, m.clearance_between)
    assert done > 1
    assert roomy


def test_where_no_pick_has_room_some_of_more_grasps_come_first(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Here those of the quick look are said to have none."""
    crowded = generate(load_spec("paper"), ur5e, to_ref(ur5e), 23, 0)
    motions, others = Motions(ur5e, crowded), 0
    state = motions.start()
    for name in (b.name for b in crowded.objects if b.name != crowded.target):
        quick = motions.picks(state, name)[0]
        monkeypatch.setattr(motions._room, "to_pick", lambda poses, pick, quick=quick: all(pick is not other for other in quick))
        for region in range(5, 100, 31):
            moved = motions.relocate(state, name, region, np.random.default_rng(region))
            if isinstance(moved, Done) and all(moved.grasp is not pick.grasp for pick in quick):
                assert verify(ur5e, crowded, moved.motions) is None
                others += 1
    assert others


def test_one_question_does_not_change_the_answer_to_another(scene: Scene, ur5e: Robot) -> None:
    """Memory is shared by all questions; what can be done is what a fresh one says can be done, in whichever order they are asked."""
    motions = Motions(ur5e, scene)
    state = motions.start()
    names = [b.name for b in scene.objects if b.name != scene.target][:3]
    forward, other = answers(motions, state, names, range(0, 100, 23)), Motions(ur5e, scene)
    again = other.start()
    for name in reversed(names):
        other.relocate(again, name, 34, np.random.default_rng(1))
    other.retrieve_target(again, np.random.default_rng(2))
    fresh = {k: v for name in reversed(names) for k, v in answers(Motions(ur5e, scene), state, [name], range(0, 100, 23)).items()}
    assert {k: isinstance(v, str) for k, v in forward.items()} == {k: isinstance(v, str) for k, v in fresh.items()}


def test_placed_objects_keep_clear(ur5e: Robot, scene: Scene) -> None:
    """`placed` against FCL's distance, at random poses of a cylinder among the others."""
    name = "extra"
    lone = Body(name, Cylinder(0.03, 0.12), np.eye(4))
    crowded = replace(scene, objects=(*scene.objects, lone))
    motions, rng = Motions(ur5e, crowded), np.random.default_rng(4)
    depth, width, _ = scene.cabinet.size_m
    verdicts = []
    for _ in range(300):
        p = scene.cabinet.T_world_cabinet @ np.array([rng.uniform(-0.03, depth + 0.02), rng.uniform(-0.5, 0.5) * (width + 0.05), 0.06, 1])
        T = transform(p=p[:3])
        touch = motions.cell.placed(lone, T, scene.poses())
        inside = (inverse(scene.cabinet.T_world_cabinet) @ p)[0] >= 0.03
        others = [*scene.objects, *scene.cabinet.walls()[1:]]
        free = inside and apart(replace(lone, T_world_body=T), others, 0.001)
        near = inside and not apart(replace(lone, T_world_body=T), others, 0.0013)
        assert (touch is None) == free or near, (touch, free)
        verdicts.append(free)
    assert 20 < sum(verdicts) < 280


def test_a_rig_is_the_robot(robot: Robot) -> None:
    """Links moved into their frames in compiled code: the hulls of `Robot.parts`, at any opening, and the same verdicts by covers."""
    base = transform(p=robot.base_p)
    robot_collision_model = RobotCollisionModel(robot, base)
    for width in (0.0, 0.03, robot.opening.max_m):
        value = robot.opening.value_at(width)
        parts, _ = robot.parts(value, base)
        ours, plain = robot_collision_model.posed(value), make_posed_geometry(robot_collision_model.chain, parts)
        assert np.array_equal(ours.frame, plain.frame)
        for p in range(len(parts.frame)):
            hull = parts.vertices[parts.start[p] : parts.start[p + 1]]
            mine = ours.vertices[:, ours.start[p] : ours.start[p + 1]].T
            gaps = np.linalg.norm(hull[:, None] - mine[None], axis=-1)
            assert max(gaps.min(0).max(), gaps.min(1).max()) < 1e-12
        assert np.allclose(ours.boxes, plain.boxes, atol=1e-12)
        assert np.allclose(ours.reach, plain.reach, atol=1e-12)


def test_what_was_found_once_is_found_again(ur5e: Robot) -> None:
    """A move that was looked ahead for is the same when it is carried out, whatever the random numbers, thoroughly sought or not."""
    spec, found = load_spec("paper-any"), 0
    for index in range(2):
        scene = generate(spec, ur5e, to_ref(ur5e), 29, index)
        motions = Motions(ur5e, scene)
        state = motions.start()
        name = next(n for n in state.poses if n != scene.target and motions.picks(state, n)[0])
        regions = np.flatnonzero(BriefLook(motions, state, np.random.default_rng(0)).placeable(name, np.arange(100)))
        done = motions.thorough.relocate(state, name, int(regions[0]), np.random.default_rng(1))
        again = motions.relocate(state, name, int(regions[0]), np.random.default_rng(2))
        assert done is again or isinstance(done, Blocked)  # what failed may be tried again with other random numbers
        assert motions.state is state
        found += isinstance(done, Done)
    assert found


def test_a_time_budget_is_one_for_the_whole_indicator(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each search takes 0.7 s of a second here: what is left is given to the next, none is begun after that, and the next question has a
    second of its own."""
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 23, 0)
    now, given = [0.0], list[float | None]()

    def search(*args: object, time_budget_s: float | None, **more: object) -> SimpleNamespace:
        given.append(time_budget_s)
        now[0] += 0.7
        return SimpleNamespace(path=None, why="budget", iterations=7)

    monkeypatch.setattr(workcell, "connect", search)
    monkeypatch.setattr(workcell, "perf_counter", lambda: now[0])
    alone = replace(scene, objects=(scene.target_body,))
    for _ in range(2):
        motions = Motions(ur5e, alone, time_budget_s=1.0)
        given.clear()
        state, rng = motions.start(), np.random.default_rng(0)
        assert len(motions.picks(state, alone.target_name, motions.target_grasps)[0]) >= 2
        assert isinstance(motions.retrieve_target(state, rng), Blocked)
        assert given == pytest.approx([1.0, 0.3])
        with motions.cell.within_budget():
            now[0] += 1.1
            assert motions.cell.connect(motions.cell.problem(state.poses, 0.0), ur5e.arm_q(state.q), np.zeros((1, 6)), rng) == Blocked(
                "transit", detail=workcell.TIME_IS_UP
            )


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_closing_fingers_are_looked_at_every_few_millimetres(name: str) -> None:
    """Three looks once let a pad slide 0.04 mm through a box's corner on its way."""
    robot = load(name)
    arm = Arm(robot, transform())
    opened, closed = robot.opening.value_at(robot.opening.max_m), robot.opening.closing_value(robot.opening.max_m - 0.02)
    looks = [arm.posed_fingers([opened + s * (closed - opened)]).vertices for s in (0.0, *FINGERS_AT)]
    apart = [np.linalg.norm(b - a, axis=0).max() for a, b in pairwise(looks)]
    assert FINGERS_AT[-1] == 1.0
    assert max(apart) < 0.003
