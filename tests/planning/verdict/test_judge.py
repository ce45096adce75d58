"""Plans that hold, and the same with one thing wrong: the verdict names it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import test_second_engine as spoilers
from conftest import SIDEWAYS, Handmade, Json, make_plan, pose

from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Held
from kinematics.shapes import Box, ConvexMesh
from kinematics.transforms import rotation_about, transform
from planning.conclusion import hand_travel, objective
from planning.io.plan_documents import plan_from_json
from planning.io.scene_documents import scene_from_json
from planning.plan import Motion
from planning.verdict import Settings, Verdict, examine

Change = Callable[[Json, Json], object]


@pytest.fixture(scope="module")
def honest(handmade: Handmade, ur5e: Robot) -> Handmade:
    """The plan made by hand, with the figures that it has."""
    scene, plan = scene_from_json(handmade.scene), plan_from_json(handmade.plan)
    figures = {"hand_travel_m": hand_travel(ur5e, scene, plan.motions), "return": objective(scene, plan.moves, True)}
    return Handmade(handmade.scene, {**handmade.plan, **figures, "moves": [{**handmade.plan["moves"][0], "region": region(handmade)}]})


def region(handmade: Handmade) -> int:
    """Where the can is put."""
    p = np.array(handmade.plan["moves"][0]["T_world_to"]["p"]) - handmade.scene["cabinet"]["T_world_cabinet"]["p"]
    return int(p[0] / 0.056) * 10 + int((p[1] + 0.43) / 0.086)


def verdict(made: Handmade, robot: Robot, change: Change | None = None, **asked: float | bool) -> Verdict:
    scene, plan = json.loads(json.dumps([made.scene, made.plan]))
    if change is not None:
        change(scene, plan)
    return examine(scene_from_json(scene), plan_from_json(plan), robot, Settings(**asked))  # type: ignore[arg-type]


def test_a_plan_made_by_hand_holds(honest: Handmade, ur5e: Robot) -> None:
    assert verdict(honest, ur5e) == Verdict((), (), True)


@pytest.mark.parametrize(("spec", "index", "policy"), [("paper", 0, "local"), ("paper-any", 1, "random"), ("shelf", 0, "local")])
def test_plans_of_ours_hold(ur5e: Robot, spec: str, index: int, policy: str) -> None:
    made = make_plan(ur5e, spec, index, policy)
    found = verdict(made, ur5e)
    assert found.verified, [str(f) for f in found.faults]
    assert made.plan["verified"]


@pytest.mark.parametrize("name", ["panda", "gen3"])
def test_plans_of_other_robots_hold(name: str) -> None:
    try:
        robot = load(name)
    except ValueError:
        pytest.skip(f"the package of {name} is not installed")
    found = verdict(make_plan(robot, "paper", 0, "local"), robot)
    assert found.verified, [str(f) for f in found.faults]


# ------------------------------------------------------------------------------------------------------------------- one thing wrong


def of(plan: Json, stage: str) -> Json:
    return spoilers.stage(plan, stage)


def _held(plan: Json, body: str) -> list[Json]:
    return [m for m in plan["motions"] if m["held"] and m["held"]["body"] == body]


def _fingers_open_while_they_hold(_: Json, plan: Json) -> None:
    for q in _held(plan, "can")[-1]["q"][1:]:
        q[-1] -= 0.02


def _x_g_missed(scene: Json, _: Json) -> None:
    scene["grasp"]["T_world_hand"]["p"][2] += 0.004


def _x_g_turned(scene: Json, _: Json) -> None:
    T = transform(SIDEWAYS @ rotation_about((0, 0, 1), 0.02))
    scene["grasp"]["T_world_hand"] = {**pose(T), "p": scene["grasp"]["T_world_hand"]["p"]}


def _another_width(scene: Json, _: Json) -> None:
    """The can was thinner than the fingers close."""
    scene["objects"][0]["shape"]["radius_m"] = 0.022


def _fatter(scene: Json, _: Json) -> None:
    scene["objects"][0]["shape"]["radius_m"] = 0.027


def _on_an_edge(scene: Json, _: Json) -> None:
    R = rotation_about((1.0, 0.0, 0.0), 0.6)
    up = float(np.abs(R[2]) @ [0.02, 0.02, 0.04])
    body = {"name": "leaf", "shape": {"type": "box", "size_m": [0.04, 0.04, 0.08]}}
    scene["objects"].append({**body, "T_world_object": pose(transform(R, [0.9, -0.3, 0.10 + up]))})


def _longer_way(_: Json, plan: Json) -> None:
    plan["hand_travel_m"] += 0.2


def _shorter_relocation(_: Json, plan: Json) -> None:
    plan["relocation_travel_m"] = plan["hand_travel_m"]


def _shorter(_: Json, plan: Json) -> None:
    plan["duration_s"] = sum(motion["t_s"][-1] for motion in plan["motions"]) - 1


def _clear(_: Json, plan: Json) -> None:
    plan["clearance_m"] = 0.01


def _told_otherwise(_: Json, plan: Json) -> None:
    motion, joint = plan["motions"][1], "finger_joint"
    now = {"value": motion["q"][0][motion["joint_names"].index(joint)], "command_m": 0.05, "force_N": None}
    motion["gripper"] = {"joint": joint, "before": now, "after": {**now, "value": now["value"] + 0.01}}


def _told_another_width(_: Json, plan: Json) -> None:
    """As a plan has it whose numbers for the controller alone are wrong: the joint moves as it should."""
    motion, joint = plan["motions"][1], "finger_joint"
    value = motion["q"][0][motion["joint_names"].index(joint)]
    now = {"value": value, "command_m": 0.2, "force_N": None}
    motion["gripper"] = {"joint": joint, "before": now, "after": now}


def _another_gripper(_: Json, plan: Json) -> None:
    _told_otherwise(_, plan)
    plan["motions"][1]["gripper"]["joint"] = "claw"


def _better_return(_: Json, plan: Json) -> None:
    plan["return"] += 0.5


def _another_region(_: Json, plan: Json) -> None:
    plan["moves"][0]["region"] = 11


def _no_such_region(_: Json, plan: Json) -> None:
    plan["moves"][0]["region"] = 100


def _late(_: Json, plan: Json) -> None:
    motion = plan["motions"][2]
    motion["t_s"] = [t + 1.0 for t in motion["t_s"]]


def _elsewhere_at_first(scene: Json, _: Json) -> None:
    scene.update(schema="retrieve/scene@2")
    scene["robot"]["q_start"] = {"elbow_joint": 1.0}


def _first_motion_dropped(scene: Json, plan: Json) -> None:
    """And where the arm is, of which version 1 of scenes says nothing."""
    scene["robot"].pop("q_start")
    plan["motions"].pop(0)


def _told_to_crush(_: Json, plan: Json) -> None:
    motion = plan["motions"][1]
    for when, q in (("before", motion["q"][0]), ("after", motion["q"][-1])):
        value = q[motion["joint_names"].index("finger_joint")]
        motion.setdefault("gripper", {"joint": "finger_joint"})[when] = {"value": value, "command_m": 0.05, "force_N": 1e6}


def _obstacle(scene: Json, _: Json) -> None:
    post = {"name": "post", "shape": {"type": "box", "size_m": [0.05, 0.002, 0.3]}, "T_world_object": pose(transform(p=[0.62, 0.15, 0.26]))}
    scene.update(schema="retrieve/scene@2", obstacles=[post])


def _unknown_joint(_: Json, plan: Json) -> None:
    plan["motions"][1]["joint_names"][0] = "shoulder"


def _joint_left_out(_: Json, plan: Json) -> None:
    motion = plan["motions"][1]
    motion.update(joint_names=motion["joint_names"][1:], q=[q[1:] for q in motion["q"]])


def _joint_twice(_: Json, plan: Json) -> None:
    plan["motions"][1]["joint_names"][0] = plan["motions"][1]["joint_names"][1]


def _nobody_moved(_: Json, plan: Json) -> None:
    plan["moves"][0]["object"] = "nobody"


@pytest.mark.parametrize(
    ("change", "stage", "word"),
    [
        (spoilers._into_a_wall, "transfer", "inside left"),
        (spoilers._gap, "", "starts 0.001 rad from where"),
        (spoilers._too_fast, "", "velocity"),
        (spoilers._outside_the_limits, "", "beyond its limits"),
        (spoilers._time_stands_still, "approach", "inf rad/s, and the limit of its velocity"),
        (spoilers._held_elsewhere, "lift", "is not where the hand takes it: 2.0 mm"),
        (spoilers._held_askew, "lift", "is not where the hand takes it: 0.0 mm and 0.1°"),
        (spoilers._moved_object_dropped, "moves", "not in the scene"),
        (spoilers._obstacle_in_the_way, "transfer", "inside plate"),
        (spoilers._obstacle_where_the_can_goes, "lower", "inside low"),
        (spoilers._fingers_may_not_touch, "", "pad is"),
        (spoilers._let_go_in_the_air, "release", "30.0 mm above the floor"),
        (spoilers._open_hand_carries, "grasp", "stops 15.0 mm before can"),
        (spoilers._squeezed, "grasp", "inside can"),
        (spoilers._move_says_otherwise, "moves", "3.0 mm"),
        (spoilers._move_forgotten, "moves", "the motions move can"),
        (spoilers._move_never_made, "moves", "can, box was moved"),
        (spoilers._target_still_inside, "plan", "inside the cabinet"),
        (spoilers._success_with_an_empty_hand, "plan", "holds nothing"),
        (spoilers._other_scene, "plan", "'another'"),
        (_joint_left_out, "", "does not say where 'shoulder_pan_joint' is"),
        (spoilers._base_moved, "lift", "can is not where the hand takes it: 20.0 mm"),
        (_fingers_open_while_they_hold, "", "while they hold can"),
        (_x_g_missed, "grasp", "4.0 mm and 0.0° from the grasp that was asked for"),
        (_x_g_turned, "grasp", "from the grasp that was asked for"),
        (_another_width, "grasp", "stops 3.0 mm before can"),
        (_fatter, "grasp", "2.0 mm inside can"),
        (_longer_way, "plan", "hand_travel_m"),
        (_shorter_relocation, "plan", "relocation_travel_m"),
        (_shorter, "plan", "duration_s"),
        (_clear, "plan", "clearance_m is 0.0100, and the motions make it nothing"),
        (_told_otherwise, "", "tells the gripper"),
        (_told_another_width, "", "tells the gripper a width of"),
        (_another_gripper, "", "'claw', which is none of its joints"),
        (_better_return, "plan", "return"),
        (_another_region, "moves", "outside region 11"),
        (_no_such_region, "moves", "there are 100"),
        (_late, "", "begins at 1.000 s"),
        (_elsewhere_at_first, "", "from where the scene says"),
        (_first_motion_dropped, "grasp", "from home, where the arm is unless"),
        (_told_to_crush, "grasp", "a force of 1e+06 N before it, and its data sheet gives 235 N at most"),
        (_obstacle, "transfer", "inside post"),
        (_unknown_joint, "", "'shoulder', which is no actuated joint"),
        (_joint_twice, "", "names a joint twice"),
        (_nobody_moved, "moves", "'nobody'"),
    ],
)
def test_what_is_wrong_is_named(honest: Handmade, ur5e: Robot, change: Change, stage: str, word: str) -> None:
    found = verdict(honest, ur5e, change)
    assert found.verified is False
    assert any(stage in f.stage and word in f.detail for f in found.faults), [str(f) for f in found.faults]


@pytest.mark.parametrize("spec", ["paper", "paper-any"])
def test_a_clearance_is_measured_again(ur5e: Robot, spec: str) -> None:
    """A plan of ours keeps what each of its motions says, and not half a millimetre more; what it says where fingers move beside the arm
    holds for any opening on their way, so there it may keep more."""
    made = make_plan(ur5e, spec, 0, "local")
    scene, plan = scene_from_json(made.scene), plan_from_json(made.plan)
    g = ur5e.gripper_joint
    exactly = [i for i, m in enumerate(plan.motions) if m.stage != "transit" or m.q[0, g] == m.q[-1, g]]
    said = {i: m.clearance_m for i, m in enumerate(plan.motions) if m.clearance_m is not None and i in exactly}
    assert len(said) > 3
    for i, least in said.items():
        more = replace(plan.motions[i], clearance_m=max(least + 5e-4, 1.01 * least))
        found = examine(scene, replace(plan, motions=(*plan.motions[:i], more, *plan.motions[i + 1 :]), stated={}), ur5e).faults
        assert [f.stage for f in found] == [more.stage], (i, more.stage, [str(f) for f in found])
        assert "and the least is said to be" in found[0].detail
        assert found[0].amount is not None
        assert least - 1e-4 < found[0].amount < more.clearance_m  # somewhere on the way: nobody looks for the nearest place


def _joined(motions: list[Motion], first: int) -> list[Motion]:
    """Two motions as one."""
    one, two = motions[first : first + 2]
    q, qd, qdd = (np.concatenate([a, b[1:]]) for a, b in ((one.q, two.q), (one.qd, two.qd), (one.qdd, two.qdd)) if a is not None)  # type: ignore[index]
    assert one.gripper is not None
    assert two.gripper is not None
    gripper = replace(one.gripper, after=two.gripper.after)
    stage = one.stage if two.stage == "grasp" else two.stage
    both = replace(
        two, stage=stage, q=q, qd=qd, qdd=qdd, t_s=np.append(one.t_s, one.t_s[-1] + two.t_s[1:]), gripper=gripper, clearance_m=None
    )
    return [*motions[:first], both, *motions[first + 2 :]]


def test_fingers_that_close_at_a_motions_end_may_close_at_its_beginning(ur5e: Robot) -> None:
    """A controller is told of the gripper and of the arm apart, of the gripper first: as one motion, the approach and the grasp shut the
    hand before it comes; release and retreat drag along what is still held."""
    made = make_plan(ur5e, "paper", 0, "local")
    scene, plan = scene_from_json(made.scene), replace(plan_from_json(made.plan), stated={})
    assert examine(scene, plan, ur5e).verified
    for stage, word in (("approach", "closes the hand on it while the arm stands"), ("release", "opens the hand while the arm stands")):
        first = next(i for i, m in enumerate(plan.motions) if m.stage == stage)
        faults = examine(scene, replace(plan, motions=tuple(_joined(list(plan.motions), first))), ur5e).faults
        assert faults
        assert word in faults[0].detail


def test_a_release_that_tells_the_gripper_to_stay_shut_is_found(ur5e: Robot) -> None:
    made = make_plan(ur5e, "paper", 0, "local")
    scene, plan = scene_from_json(made.scene), made.plan
    release = of(plan, "release")["gripper"]
    release["after"].update(command=release["before"]["value"], command_m=release["before"]["command_m"])
    (fault,) = examine(scene, plan_from_json(plan), ur5e).faults
    assert fault.stage == "release"
    assert "and it holds nothing there" in fault.detail


def test_what_readers_refuse_is_judged_too(honest: Handmade, ur5e: Robot) -> None:
    """Who calls the library with values of their own gets a fault, never a crash."""
    scene, plan = scene_from_json(honest.scene), plan_from_json(honest.plan)
    kite = Body("kite", Box(np.full(3, 0.03)), transform(p=[0.9, -0.3, 0.3]))
    (fault,) = examine(replace(scene, objects=(*scene.objects, kite)), plan, ur5e).faults
    assert (fault.stage, fault.detail) == ("scene", "kite is 185.0 mm above the floor at the start")
    for huge in (1e300, np.inf, np.nan):
        q = plan.motions[1].q.copy()
        q[0, 0] = huge
        T = transform(p=[huge, 0.0, 0.0])
        far = replace(plan.motions[2], held=Held("can", T))
        for motion in (replace(plan.motions[1], q=q), far, replace(plan.motions[1], t_s=np.full(len(plan.motions[1].t_s), huge))):
            assert examine(scene, replace(plan, motions=(*plan.motions[:1], motion, *plan.motions[3:])), ur5e).verified is False
        bodies = tuple(replace(b, T_world_body=T) for b in scene.objects)
        assert examine(replace(scene, objects=bodies), plan, ur5e).verified is False
        moves = tuple(replace(m, T_world_to=T) for m in plan.moves)
        assert examine(scene, replace(plan, moves=moves), ur5e).verified is False
    twirl = np.linspace(plan.motions[0].q[0], plan.motions[0].q[0] + [600.0, 0, 0, 0, 0, 0, 0], 2)
    found = examine(scene, replace(plan, motions=(replace(plan.motions[0], q=twirl, t_s=np.array([0.0, 999.0])),)), ur5e)
    assert "turns a joint by 600 in all" in found.faults[0].detail


def test_what_would_fall_at_the_start_is_a_note(honest: Handmade, ur5e: Robot) -> None:
    """The scene says that it stands: balls do. Put down again, it must stand no worse."""
    found = verdict(honest, ur5e, _on_an_edge)
    assert found.verified
    assert [(note.stage, note.bodies[0]) for note in found.notes] == [("scene", "leaf")]
    assert "leaf falls over at the start" in found.notes[0].detail


def test_what_stands_by_the_scenes_word_alone_may_be_put_down_no_worse(honest: Handmade, ur5e: Robot) -> None:
    """The can gets a foot that is 4 mm beside its middle, as a scanned apple has it."""
    scene, plan = scene_from_json(honest.scene), plan_from_json(honest.plan)
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rim = 0.025 * np.stack([np.cos(angle), np.sin(angle)], -1)
    body = np.concatenate([np.c_[rim, np.full(48, z)] for z in (-0.086, 0.09)])
    foot = np.array([[x, y, z] for x in (0.004, 0.008) for y in (-0.004, 0.004) for z in (-0.09, -0.08)])
    apple = replace(scene, objects=tuple(replace(b, shape=ConvexMesh((body, foot))) if b.name == "can" else b for b in scene.objects))
    found = examine(apple, plan, ur5e)
    assert found.verified, [str(f) for f in found.faults]
    assert [(note.stage, note.bodies[0]) for note in found.notes] == [("scene", "can")]
    T = scene.cabinet.T_world_cabinet.copy()
    T[1, 3] = -0.1935  # the floor ends under the foot where the can is put
    found = examine(replace(apple, cabinet=replace(scene.cabinet, T_world_cabinet=T)), plan, ur5e, Settings(contact=False))
    assert any("can falls over where motion" in f.detail for f in found.faults)


def test_faults_say_whose_and_how_much(honest: Handmade, ur5e: Robot) -> None:
    (fault,) = (f for f in verdict(honest, ur5e, _x_g_missed).faults if "asked for" in f.detail)
    assert fault.bodies == ("hand", "box")
    assert fault.amount == pytest.approx(0.004, abs=1e-5)


def test_friction_and_tilt_are_settings(honest: Handmade, ur5e: Robot) -> None:
    assert verdict(honest, ur5e, mu=0.05).verified  # square to the faces, nothing slips
    assert verdict(honest, ur5e, max_tilt_deg=1.0).verified  # the hand keeps level

    def tip(_: Json, plan: Json) -> None:
        last = plan["motions"][-1]
        last["q"].append([*last["q"][-1][:5], last["q"][-1][5] + 0.5, last["q"][-1][6]])
        last["t_s"].append(last["t_s"][-1] + 2.0)

    assert verdict(honest, ur5e, tip).verified
    found = verdict(honest, ur5e, tip, max_tilt_deg=20.0)
    assert [f.detail for f in found.faults] == ["motion 11: box leans by 28.6°, and may by 20°"]

    def limited(scene: Json, plan: Json) -> None:
        tip(scene, plan)
        scene.update(schema="retrieve/scene@2")
        scene["objects"][1]["max_tilt_deg"] = 25.0

    assert [f.bodies for f in verdict(honest, ur5e, limited).faults] == [("box",)]
    assert [f.bodies for f in verdict(honest, ur5e, limited, max_tilt_deg=180.0).faults] == [("box",)]


def test_the_order_of_joints_does_not_matter(honest: Handmade, ur5e: Robot) -> None:
    def turn(_: Json, plan: Json) -> None:
        for motion in plan["motions"]:
            motion["joint_names"] = motion["joint_names"][::-1]
            motion["q"] = [q[::-1] for q in motion["q"]]

    assert verdict(honest, ur5e, turn).verified


def test_without_contacts_all_else_is_judged(honest: Handmade, ur5e: Robot) -> None:
    assert verdict(honest, ur5e, _obstacle, contact=False).verified
    assert verdict(honest, ur5e, _obstacle).verified is False
    assert verdict(honest, ur5e, _x_g_missed, contact=False).verified is False


def test_a_plan_without_motions_is_neither_true_nor_false(honest: Handmade, ur5e: Robot) -> None:
    def nothing(_: Json, plan: Json) -> None:
        plan.update(motions=[], moves=[], success=False)

    assert verdict(honest, ur5e, nothing) == Verdict((), (), None)
    assert verdict(honest, ur5e, lambda s, p: p.update(motions=[], moves=[])).verified is False
    assert verdict(honest, ur5e, lambda s, p: p.update(motions=[], success=False)).verified is False


def test_a_world_that_is_turned_is_the_same(honest: Handmade, ur5e: Robot) -> None:
    T = transform(rotation_about((0, 0, 1), 2.0), [0.3, -1.0, 0.4])
    scene, plan = scene_from_json(honest.scene), plan_from_json(honest.plan)
    turned = replace(
        scene,
        robot=replace(scene.robot, T_world_base=T @ scene.robot.T_world_base),
        cabinet=replace(scene.cabinet, T_world_cabinet=T @ scene.cabinet.T_world_cabinet),
        objects=tuple(replace(b, T_world_body=T @ b.T_world_body) for b in scene.objects),
        grasp=replace(scene.x_g, T_world_hand=T @ scene.x_g.T_world_hand),
    )
    moves = tuple(replace(m, T_world_from=T @ m.T_world_from, T_world_to=T @ m.T_world_to) for m in plan.moves)
    assert examine(turned, replace(plan, moves=moves), ur5e).verified


# ---------------------------------------------------------------------------------------------------------------------------- splines


def smooth(plan: Json, slower: float = 2.5) -> None:
    """From row to row at rest, with the least jerk: the same way, as a spline."""
    for motion in plan["motions"]:
        zero = np.zeros(np.shape(motion["q"]))
        motion.update(qd=zero.tolist(), qdd=zero.tolist(), t_s=[slower * t for t in motion["t_s"]])


def splined(made: Handmade, robot: Robot, slower: float = 2.5, change: Callable[[Json], None] = lambda m: None) -> Verdict:
    scene, plan = json.loads(json.dumps([made.scene, made.plan]))
    smooth(plan, slower)
    change(plan["motions"][0])
    made_plan = plan_from_json(plan)
    motions = tuple(replace(m, qd=np.array(j["qd"]), qdd=np.array(j["qdd"])) for m, j in zip(made_plan.motions, plan["motions"]))
    return examine(scene_from_json(scene), replace(made_plan, motions=motions), robot)


def test_splines_are_judged_between_their_rows(honest: Handmade, ur5e: Robot) -> None:
    assert splined(honest, ur5e, 12.0).verified
    words = " ".join(str(f) for f in splined(honest, ur5e, 1.0).faults)
    assert "velocity" in words
    assert "acceleration" in words


def test_splines_that_do_not_rest_or_swing_out_are_found(honest: Handmade, ur5e: Robot) -> None:
    def runs_on(motion: Json) -> None:
        motion["qd"][-1][0] = 0.3

    def swings(motion: Json) -> None:
        motion["qd"][2][0] = 6.0

    assert any("does not rest" in f.detail for f in splined(honest, ur5e, 12.0, runs_on).faults)
    assert any("velocity" in f.detail for f in splined(honest, ur5e, 12.0, swings).faults)
