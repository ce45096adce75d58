"""The verdict on a plan for a robot of boxes: its whole word, with one thing changed at a time. Contacts have their own tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from toy_arm import ARM, motion
from toy_robot import toy_robot

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, Held, RobotRef, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, rotation_about, transform
from planning import verdict
from planning.plan import Blocked, Fault, Gripper, GripperState, Motion, Move, Plan
from planning.verdict import Settings, Verdict, examine, judge, judge_motions, remarks
from planning.verdict import faults as faults_module
from planning.verdict.course import courses
from planning.verdict.hand import hand_of
from planning.verdict.judge import _standing
from planning.verdict.ledger import keep

ASKED = Settings(contact=False)
CABINET = Cabinet(np.array([1.0, 1.0, 0.5]), np.eye(4), 0.03)
BASE = transform(p=[0.0, 0.0, 0.03])
IN_HAND = transform(p=[0.0, 0.0, 0.02])
"""Both objects are 4 × 4 × 10 cm; the hand looks up and takes them 2 cm below their middle."""
BOX = Box(np.array([0.04, 0.04, 0.1]))
A, B, ASIDE = transform(p=[0.5, 0.0, 0.05]), transform(p=[0.5, 0.3, 0.05]), transform(p=[0.7, 0.0, 0.05])
OPEN, SHUT = 0.03, 0.02
X_G = Grasp(B @ transform(p=[0.0, 0.0, -0.02]), 0.04)
VALUE = 1 - float(np.linalg.norm(A[:3, 3] - BASE[:3, 3])) - 0.2
SCENE = Scene("s", RobotRef(BASE, urdf="toy"), CABINET, (Body("a", BOX, A), Body("b", BOX, B)), "b", X_G, regions_n=10)


def at(x: float, y: float, grip: float, tip: float = 0.0) -> list[float]:
    return [x, y, 0.0, tip, grip]


def slow(*q: Sequence[float], **other: Any) -> Motion:
    return motion(*q, t_s=[9.0 * k for k in range(len(q))], **other)


MOTIONS = (
    slow(at(0, 0, OPEN), at(0.5, 0, OPEN)),
    slow(at(0.5, 0, OPEN), at(0.5, 0, SHUT), stage="grasp"),
    slow(at(0.5, 0, SHUT), at(0.7, 0, SHUT), stage="transfer", held=Held("a", IN_HAND)),
    slow(at(0.7, 0, SHUT), at(0.7, 0, OPEN), stage="release"),
    slow(at(0.7, 0, OPEN), at(0.5, 0.3, OPEN), stage="retreat"),
    slow(at(0.5, 0.3, OPEN), at(0.5, 0.3, SHUT), stage="grasp"),
    slow(at(0.5, 0.3, SHUT), at(-0.1, 0.3, SHUT), stage="transfer", held=Held("b", IN_HAND)),
)
TRAVEL = 0.5 + 0.2 + float(np.hypot(0.2, 0.3)) + 0.6
PLAN = Plan("s", "local", "deep", True, None, (Move("a", 75, A, ASIDE, True),), MOTIONS, 0.0, 0.0, TRAVEL, VALUE, None)


def said(scene: Scene = SCENE, plan: Plan = PLAN, robot: Robot | None = None, settings: Settings = ASKED) -> Verdict:
    found = examine(scene, plan, robot or toy_robot(), settings)
    assert str(judge(scene, plan, robot or toy_robot(), settings)) == str(found.faults)
    return found


def with_motion(number: int, changed: Motion, plan: Plan = PLAN) -> Plan:
    return replace(plan, motions=(*plan.motions[:number], changed, *plan.motions[number + 1 :]))


def faults(found: Verdict) -> list[tuple[str, tuple[str, ...], str]]:
    assert found.verified is (not found.faults)
    return [(f.stage, f.bodies, f.detail) for f in found.faults]


def test_what_the_verdict_offers() -> None:
    for offers in (verdict, faults_module):
        assert len(set(offers.__all__)) == len(offers.__all__)
        for name in offers.__all__:
            assert vars(offers)[name] is not None


def test_how_strict_it_is() -> None:
    """Unless told otherwise; whoever changes a number changes what is called verified."""
    asked = Settings()
    assert (asked.mu, asked.gap_m, asked.depth_m, asked.overlap_m, asked.stands_m) == (0.5, 5e-4, 1e-3, 3e-3, 1e-3)
    assert (asked.pose_m, asked.pose_rad, asked.step_m, asked.cup_rad) == (1e-3, 1e-3, 2e-3, 0.07)
    assert (asked.max_tilt_deg, asked.contact) == (None, True)


def test_the_plan_holds() -> None:
    assert said() == Verdict((), (), True)


def test_it_is_for_another_scene() -> None:
    wrong = Fault("plan", (), "it is for scene 't', and this is 's'")
    assert said(plan=replace(PLAN, scene="t")) == Verdict((wrong,), (), False)


def test_without_motions_nothing_may_be_claimed() -> None:
    nothing = replace(PLAN, motions=(), moves=(), success=False)
    assert said(plan=nothing) == Verdict((), (), None)
    success = Fault("plan", (), "it is called a success, and has no motions")
    assert said(plan=replace(nothing, success=True)) == Verdict((success,), (), False)
    assert said(plan=replace(nothing, success=True, moves=PLAN.moves)) == Verdict((success,), (), False)
    tried = replace(PLAN.moves[0], object="b", done=False)
    moved = Fault("moves", ("a",), "a is called moved, and there are no motions")
    assert said(plan=replace(nothing, moves=(tried, *PLAN.moves))) == Verdict((moved,), (), False)
    assert said(plan=replace(nothing, moves=(tried,))) == Verdict((), (), None)


def test_moves_of_what_is_not_there() -> None:
    moves = (*PLAN.moves, replace(PLAN.moves[0], object="ghost", done=False))
    wrong = Fault("moves", ("ghost",), "a move is of 'ghost', which is not in the scene")
    assert said(plan=replace(PLAN, moves=moves)) == Verdict((wrong,), (), False)


@pytest.mark.parametrize("far", [1000.1, -1001.0, np.inf, np.nan])
def test_lengths_that_nobody_meant(far: float) -> None:
    """A kilometre is the most."""
    T, words = transform(p=[0.0, far, 0.0]), f"is {abs(far):.3g} m large or away"

    def alone(scene: Scene = SCENE, plan: Plan = PLAN) -> tuple[str, tuple[str, ...], str]:
        (fault,) = said(scene, plan).faults
        assert fault.amount == pytest.approx(abs(far), nan_ok=True)
        return fault.stage, fault.bodies, fault.detail

    assert alone(replace(SCENE, objects=(SCENE.objects[0], replace(SCENE.objects[1], T_world_body=T)))) == ("scene", ("b",), f"b {words}")
    assert alone(replace(SCENE, obstacles=(Body("post", BOX, T),))) == ("scene", ("post",), f"post {words}")
    assert alone(replace(SCENE, robot=RobotRef(T, urdf="toy"))) == ("scene", ("robot",), f"robot {words}")
    sized = Cabinet(np.array([1.0, abs(far), 1.0]), np.eye(4), 0.03)
    assert alone(replace(SCENE, cabinet=sized)) == ("scene", ("cabinet",), f"cabinet {words}")
    for pose in ("T_world_from", "T_world_to"):
        moved = replace(PLAN, moves=(replace(PLAN.moves[0], **{pose: T}),))
        assert alone(plan=moved) == ("moves", ("a",), f"a {words}")
    held = with_motion(2, replace(MOTIONS[2], held=Held("a", T)))
    assert alone(plan=held) == ("transfer", ("a",), f"a {words}")


def test_what_is_large_but_meant() -> None:
    post = Body("post", BOX, transform(p=[0.0, -1000.0, 0.0]))
    assert said(replace(SCENE, obstacles=(post,))).verified
    long = Body("long", Box(np.array([0.1, 0.1, 2002.0])), np.eye(4))
    assert faults(said(replace(SCENE, obstacles=(long,)))) == [("scene", ("long",), "long is 1e+03 m large or away")]


def test_a_robot_without_pads() -> None:
    robot = toy_robot({"palm": toy_robot().hulls[0].vertices})
    assert said(robot=robot).verified is False
    assert said(robot=robot).faults == (
        Fault("scene", (), "robot toy: no face of its fingers closes along the hand frame's y, on the side of +y"),
    )


def test_a_motion_that_makes_no_sense_ends_it() -> None:
    odd = replace(MOTIONS[3], joint_names=("x",) * 5)
    assert faults(said(plan=with_motion(3, odd))) == [("release", (), "motion 3 names a joint twice")]
    ghost = replace(MOTIONS[2], held=Held("ghost", IN_HAND))
    assert faults(said(plan=with_motion(2, ghost))) == [("transfer", ("ghost",), "motion 2 holds 'ghost', which is not in the scene")]


def test_the_slower_of_urdf_and_data_sheet_counts() -> None:
    """Fingers close by 1 cm in 9 s; x goes 0.6 m in 9."""
    velocity = ARM.velocity.copy()
    velocity[0] = 0.066
    (wrong,) = faults(said(robot=toy_robot(velocity=velocity)))
    assert wrong == ("transfer", (), "motion 6: x reaches 0.0667 m/s, and the limit of its velocity is 0.066 m/s")
    velocity[0] = 99.0
    assert faults(said(robot=toy_robot(velocity=velocity))) == []
    assert faults(said(plan=with_motion(6, replace(MOTIONS[6], t_s=MOTIONS[6].t_s / 20)))) == [
        ("transfer", (), "motion 6: x reaches 1.33 m/s, and the limit of its velocity is 1 m/s")
    ]


def test_limits_go_by_the_joints_names() -> None:
    """The robot lists them in another order than the URDF."""
    names = ("grip", "tip", "turn", "y", "x")
    velocity, acceleration = ARM.velocity[::-1].copy(), np.array([1.0, 1, 1, 1, 1e-3])
    robot = toy_robot(joint_names=names, gripper_joint=0, velocity=velocity, acceleration=acceleration)
    assert faults(said(robot=robot)) == []
    velocity[4] = 0.066
    assert len(said(robot=robot).faults) == 1
    velocity[4] = 1.0
    zero = np.zeros((2, 5))
    smooth = replace(PLAN, motions=tuple(replace(m, qd=zero, qdd=zero) for m in MOTIONS))
    assert [f.stage for f in said(plan=smooth, robot=robot).faults] == ["transit", "transfer", "retreat", "transfer"]
    acceleration[:] = [1e-3, 1, 1, 1, 1]
    assert [f.stage for f in said(plan=smooth, robot=robot).faults] == []  # 10/√3 · 0.01/81 m/s² of the fingers
    acceleration[:] = [7e-4, 1, 1, 1, 1]
    assert [f.stage for f in said(plan=smooth, robot=robot).faults] == ["grasp", "release", "grasp"]


def test_it_begins_where_the_scene_says() -> None:
    for start, words in (
        ({"x": 0.0, "grip": OPEN}, None),
        ({"x": 0.9e-6}, None),
        ({"x": 1e-6}, None),
        ({"x": -0.25}, "motion 0 begins with x 0.25 m from where the scene says it is"),
        ({"x": 0.25, "y": 0.15}, "motion 0 begins with x 0.25 m from where the scene says it is"),
        ({"x": 0.1, "y": -0.2, "tip": 0.15}, "motion 0 begins with y 0.2 m from where the scene says it is"),
        ({"claw": 9.0}, None),
        ({}, None),
    ):
        found = said(replace(SCENE, robot=replace(SCENE.robot, q_start=start)))
        assert faults(found) == ([] if words is None else [("transit", (), words)])
        for fault in found.faults:
            assert fault.amount == pytest.approx(0.25 if "x" in words.split()[4] else 0.2)  # type: ignore[union-attr]


def test_what_the_gripper_is_told_and_what_it_is_called() -> None:
    """Each kind of fault is among the verdict's."""
    robot = toy_robot(grip_force_N=40.0, most_grip_force_N=140.0)
    own = GripperState(OPEN, 2 * OPEN)
    for number, before, joint, words in (
        (0, replace(own, value=0.02), "grip", "tells the gripper 0.02 before it, and grip is at 0.03"),
        (0, replace(own, width_m=0.04), "grip", "tells the gripper a width of 40.0 mm before it"),
        (0, replace(own, width_m=2 * SHUT, command=SHUT), "grip", "and it holds nothing there"),
        (0, replace(own, force_N=1e6), "grip", "a force of 1e+06 N before it, and its data sheet gives 140 N at most"),
        (0, replace(own, value=0.0, width_m=0.0), "y", "and the gripper's is 'grip'"),
        (2, GripperState(SHUT, 2 * SHUT), "grip", "tells the gripper no force before it"),
    ):
        motion_ = replace(MOTIONS[number], gripper=Gripper(joint, before, replace(before, value=0.2) if joint == "y" else before))
        details = [f.detail for f in said(plan=with_motion(number, motion_), robot=robot).faults]
        assert any(words in detail for detail in details), details
    assert faults(said(plan=with_motion(4, replace(MOTIONS[4], stage="lift")))) == [("lift", (), "motion 4 carries, and holds nothing")]
    assert faults(said(plan=replace(PLAN, max_moves=0))) == [("plan", (), "it makes 1 moves, and its max_moves is 0")]


def test_a_spike_of_a_jerk_that_nobody_limits_is_a_note() -> None:
    rests = np.zeros((2, 5))
    robot, known = toy_robot(jerk=np.full(5, 1e-3)), toy_robot(jerk=np.full(5, 1e-3), known_jerk=np.full(5, 1e-3))
    plan = with_motion(0, replace(MOTIONS[0], qd=rests, qdd=rests))
    found = said(plan=plan, robot=robot)
    assert (found.verified, [n.detail[:39] for n in found.notes]) == (True, ["motion 0: x reaches 0.0412 m/s³; nobody"])
    assert said(plan=plan, robot=known).notes == ()
    assert said(plan=plan, robot=known).faults[0].detail.endswith("and the limit of its jerk is 0.001 m/s³")
    strange = with_motion(2, replace(MOTIONS[2], held=Held("nobody", IN_HAND)), plan)
    assert len(said(plan=strange, robot=robot).notes) == 1


def test_the_target_is_taken_as_the_plan_says_or_as_the_scene_asks() -> None:
    """A grasp of the plan's own goes before the scene's, its best before the alternatives; without any the hand may take it anyhow."""
    off = Grasp(X_G.T_world_hand @ transform(p=[0.01, 0, 0]), 0.04)
    wrong = ("grasp", ("hand", "b"), "b is taken 10.0 mm and 0.0° from the grasp that was asked for")
    for scene, grasp, well in (
        (replace(SCENE, grasp=off), None, False),
        (replace(SCENE, grasp=off), X_G, True),
        (SCENE, off, False),
        (replace(SCENE, grasp=None), None, True),
        (replace(SCENE, grasp=None, grasps=((off, 1.0), (X_G, 0.5))), None, True),
        (replace(SCENE, grasp=None, grasps=((off, 1.0),)), None, False),
        (replace(SCENE, grasp=off, grasps=((off, 1.0), (X_G, 0.5))), None, True),
    ):
        assert faults(said(scene, replace(PLAN, grasp=grasp))) == ([] if well else [wrong])


def test_a_target_that_is_taken_otherwise_than_the_scene_asks_is_worth_knowing() -> None:
    """The scene may have been edited since; or it was planned with any grasp."""
    off = Grasp(X_G.T_world_hand @ transform(rotation_about((0, 0, 1), 0.1), [0.0, 0.0, 0.02]), 0.04)
    told = Fault("grasp", ("hand",), "the target is taken 20.0 mm and 5.7° from the scene's grasp, as the plan says", pytest.approx(0.02))
    assert remarks(SCENE, replace(PLAN, grasp=off)) == (told,)
    for scene, plan in (
        (SCENE, PLAN),
        (SCENE, replace(PLAN, grasp=X_G)),
        (replace(SCENE, grasps=((off, 1.0),)), replace(PLAN, grasp=off)),
        (replace(SCENE, grasp=None), replace(PLAN, grasp=off)),
        (SCENE, replace(PLAN, grasp=off, success=False)),
    ):
        assert remarks(scene, plan) == ()


def test_what_floats_or_sinks_at_the_start() -> None:
    for up, words in ((0.3, "is 300.0 mm above the floor"), (-0.3, "is sunk 300.0 mm into the floor"), (0.0009, None)):
        c = Body("c", BOX, transform(p=[0.2, -0.3, 0.05 + up]))
        found = said(replace(SCENE, objects=(*SCENE.objects, c)))
        assert faults(found) == ([] if words is None else [("scene", ("c",), f"c {words} at the start")])
        assert [f.amount for f in found.faults] == ([] if words is None else [pytest.approx(0.3)])
        assert found.notes == ()
    outside = Body("c", Box(np.full(3, 0.0625)), transform(p=[-0.25, 0.0, 0.03125]))
    assert faults(said(replace(SCENE, objects=(*SCENE.objects, outside)))) == [
        ("scene", ("c",), "c is 0.0 mm above the floor at the start")
    ]


def test_what_floats_from_beginning_to_end_floats_twice() -> None:
    """a is 20 cm higher, and held so."""
    up = transform(p=[0, 0, 0.2])
    scene = replace(SCENE, objects=(replace(SCENE.objects[0], T_world_body=A @ up), SCENE.objects[1]))
    plan = with_motion(2, replace(MOTIONS[2], held=Held("a", IN_HAND @ up)))
    found = said(scene, replace(plan, moves=()))
    assert {(f.stage, f.detail) for f in found.faults} >= {
        ("scene", "a is 200.0 mm above the floor at the start"),
        ("release", "a is 200.0 mm above the floor where motion 2 puts it"),
    }


def test_what_an_object_rests_on_before_and_after() -> None:
    """On one pedestal, then on another."""
    under = [Body(n, Box(np.array([0.1, 0.1, 0.2])), transform(p=[x, 0.0, -0.1])) for n, x in (("one", 0.5), ("other", 0.7))]
    scene = replace(SCENE, cabinet=replace(CABINET, T_world_cabinet=transform(p=[0, 0, -0.2])), obstacles=tuple(under))
    hand = hand_of(toy_robot())
    ledger = keep(hand, scene, courses(hand.arm, MOTIONS)[0], ASKED)
    assert _standing(scene, ledger, ASKED)[1] == {"a": {"one", "other"}, "b": frozenset()}


def test_what_stands_on_others_or_leans_on_walls() -> None:
    """On an obstacle, on another object, on the ceiling never."""
    post = Body("post", BOX, transform(p=[0.2, -0.3, 0.3]))
    c = Body("c", BOX, transform(p=[0.2, -0.3, 0.4]))
    assert faults(said(replace(SCENE, objects=(*SCENE.objects, c), obstacles=(post,)))) == []
    low = Body("low", BOX, transform(p=[0.2, -0.3, 0.05]))
    assert faults(said(replace(SCENE, objects=(*SCENE.objects, low, replace(c, T_world_body=transform(p=[0.2, -0.3, 0.15])))))) == []
    assert len(said(replace(SCENE, objects=(*SCENE.objects, c))).faults) == 1
    above = replace(c, T_world_body=transform(p=[0.2, -0.3, 0.58]))
    assert faults(said(replace(SCENE, objects=(*SCENE.objects, above)))) == []  # on the cabinet's top


def test_what_stands_on_another_does_not_stay_in_the_air_without_it() -> None:
    """On b alone; on b and a post as well; on what stands on b. What stands beside it does not mind."""

    def on_b(*more: Body, at: tuple[float, float] = (0.0, 0.1), obstacles: tuple[Body, ...] = ()) -> list[tuple[str, tuple[str, ...], str]]:
        c = Body("c", BOX, B @ transform(p=[at[0], 0.0, at[1]]))
        return faults(said(replace(SCENE, objects=(*SCENE.objects, c, *more), obstacles=obstacles)))

    assert on_b() == [("lift", ("c",), "c is 100.0 mm above the floor once motion 6 takes b")]
    post = Body("post", BOX, B @ transform(p=[0.041, 0.0, 0.0]))
    assert on_b(at=(0.015, 0.1), obstacles=(post,)) == [
        ("lift", ("c", "post"), "c falls over once motion 6 takes b: what it stands on is not under its centre of mass")
    ]
    assert on_b(at=(0.03, 0.1), obstacles=(post,)) == []
    assert on_b(at=(0.1, 0.0)) == []
    plank = Body("plank", Box(np.array([0.2, 0.04, 0.02])), B @ transform(p=[0.0, 0.0, 0.06]))
    two = replace(SCENE, objects=(*SCENE.objects, plank, Body("c", BOX, B @ transform(p=[0.0, 0.0, 0.12]))))
    assert [f.bodies for f in said(two).faults] == [("plank",)]  # c stands on the plank, as before


def test_what_leans_on_another_falls_without_it() -> None:
    """A board from the floor up to an edge of b, 10 cm high."""
    lean = np.arctan(0.5)
    s = 0.15 - 0.1 / np.sin(lean)  # where along the board the edge is
    x, z = 0.52 - s * np.cos(lean) + 0.005 * np.sin(lean), 0.15 * np.sin(lean) + 0.005 * np.cos(lean)
    board = Body("board", Box(np.array([0.3, 0.04, 0.01])), transform(rotation_about((0, 1, 0), lean), [x, 0.3, z]))
    ((stage, bodies, detail),) = faults(said(replace(SCENE, objects=(*SCENE.objects, board))))
    assert (stage, bodies) == ("lift", ("board", "floor"))
    assert detail.startswith("board falls over once motion 6 takes b")


def test_what_is_put_down_stands() -> None:
    """The cabinet's floor ends at x = 0.68, its wall's part included, and a is put at 0.7."""
    short = replace(SCENE, cabinet=replace(CABINET, size_m=np.array([0.65, 1.0, 0.5])))
    over = [f for f in said(short).faults if f.stage == "release"]
    words = "a falls over where motion 2 puts it: what it stands on is not under its centre of mass"
    assert over == [Fault("release", ("a", "floor", "back"), words)]  # it touches the wall, too, in which it is
    hardly = replace(SCENE, cabinet=replace(CABINET, size_m=np.array([0.6695, 1.0, 0.5])))  # by half a millimetre
    assert [f for f in said(hardly).faults if f.stage == "release"] == over


def test_what_stood_no_better_may_be_put_down_like_that() -> None:
    """Its middle is 1 cm beyond the front edge at the start, which is a note; put down as far beyond the back edge it is no worse."""
    front = transform(p=[-0.01, 0.0, 0.05])
    for length, well in ((0.66, True), (0.6595, True), (0.65, False)):
        cabinet = replace(CABINET, size_m=np.array([length, 1.0, 0.5]))
        scene = replace(SCENE, cabinet=cabinet, objects=(replace(SCENE.objects[0], T_world_body=front), SCENE.objects[1]))
        run = (slow(at(0, 0, OPEN), at(-0.01, 0, OPEN)), slow(at(-0.01, 0, OPEN), at(-0.01, 0, SHUT), stage="grasp"))
        carry = slow(at(-0.01, 0, SHUT), at(0.7, 0, SHUT), stage="transfer", held=Held("a", IN_HAND))
        found = said(scene, replace(PLAN, motions=(*run, carry, *MOTIONS[3:])))
        assert [(n.stage, n.bodies, n.detail, n.amount) for n in found.notes] == [
            ("scene", ("a", "floor"), "a falls over at the start: what it stands on is not under its centre of mass", None)
        ]
        assert [f.bodies for f in found.faults if f.stage == "release"] == ([] if well else [("a", "floor", "back")])


def test_pads_that_miss_what_they_take() -> None:
    wide = [replace(m, q=m.q + np.array([0, 0, 0, 0, 0.0006])) for m in MOTIONS]
    found = said(plan=replace(PLAN, motions=tuple(wide)))
    assert faults(found) == [("grasp", (side, name), f"{side} stops 0.6 mm before {name}") for name in "ab" for side in ("left", "right")]
    assert said(plan=replace(PLAN, motions=tuple(wide)), settings=replace(ASKED, gap_m=0.0007)).verified


def test_who_leans_too_far() -> None:
    """By the plan's limit, or by the object's own."""
    nods = with_motion(2, slow(at(0.5, 0, SHUT), at(0.6, 0, SHUT, 0.3), at(0.7, 0, SHUT), stage="transfer", held=Held("a", IN_HAND)))
    wrong = [("transfer", ("a",), "motion 2: a leans by 17.2°, and may by {}°")]
    travel = {"hand_travel_m": TRAVEL}

    def leans(own: float | None, limit: float | None) -> list[tuple[str, tuple[str, ...], str]]:
        scene = replace(SCENE, objects=(replace(SCENE.objects[0], max_tilt_deg=own), SCENE.objects[1]))
        return faults(said(scene, replace(nods, **travel), settings=replace(ASKED, max_tilt_deg=limit)))

    assert leans(None, None) == leans(None, 20.0) == leans(20.0, 10.0) == []
    for own, limit, most in ((None, 10.0, 10), (10.0, 20.0, 10), (15.0, None, 15)):
        assert leans(own, limit) == [(stage, bodies, words.format(most)) for stage, bodies, words in wrong]


def test_all_that_a_plan_says_of_itself_is_judged() -> None:
    wrong = replace(PLAN, value=0.0, hand_travel_m=1.0, moves=(replace(PLAN.moves[0], region=5),))
    assert [f.stage for f in said(plan=wrong).faults] == ["moves", "plan", "plan"]
    failed = replace(PLAN, success=False, value=VALUE - 1, reason=Blocked("ik"))
    assert [f.detail for f in said(plan=failed).faults] == [
        "the moves say that a was moved, and the motions move a, b",
        "it is no success, and b stays in the hand at its end",
    ]


def test_contacts_are_looked_for_unless_told_otherwise() -> None:
    """Everything stands in this toy's way."""
    words = {f.detail.split(": ")[1].split(" is ")[0] for f in examine(SCENE, PLAN, toy_robot()).faults}
    assert {"palm", "left", "right"} <= words


# -------------------------------------------------------------------------------------------------------------------------- motions alone


def test_motions_alone() -> None:
    """What floats at the start is no fault of theirs; the grasp is any that holds, or the one that is named."""
    robot, kite = toy_robot(), Body("kite", BOX, transform(p=[0.2, -0.3, 0.3]))
    scene = replace(SCENE, objects=(*SCENE.objects, kite))
    assert judge_motions(scene, MOTIONS, robot, ASKED) == ()
    assert judge_motions(scene, MOTIONS, robot, ASKED, grasp=X_G) == ()
    off = Grasp(X_G.T_world_hand @ transform(p=[0.01, 0, 0]), 0.04)
    assert [f.stage for f in judge_motions(scene, MOTIONS, robot, ASKED, grasp=off)] == ["grasp"]
    assert judge_motions(scene, (), robot, ASKED) == judge_motions(scene, MOTIONS[:1], robot, ASKED) == ()
    assert len(judge_motions(scene, MOTIONS, robot)) > 0  # with contacts
    late = [MOTIONS[0], *MOTIONS[2:]]
    assert [f.detail for f in judge_motions(scene, late, robot, ASKED)] == [
        "motion 1: starts 0.01 m from where grip ended before",
        "motion 1 holds a, and no motion before it closes the hand on it while the arm stands",
    ]


def test_a_can_is_judged_as_a_box_is() -> None:
    can = replace(SCENE, objects=(replace(SCENE.objects[0], shape=Cylinder(0.02, 0.1)), SCENE.objects[1]))
    assert faults(said(can)) == []


def _turned(T: Array) -> tuple[Scene, Plan]:
    """The same somewhere else in the world."""
    scene = replace(
        SCENE,
        robot=replace(SCENE.robot, T_world_base=T @ BASE),
        cabinet=replace(CABINET, T_world_cabinet=T),
        objects=tuple(replace(b, T_world_body=T @ b.T_world_body) for b in SCENE.objects),
        grasp=Grasp(T @ X_G.T_world_hand, 0.04),
    )
    return scene, replace(PLAN, moves=(replace(PLAN.moves[0], T_world_from=T @ A, T_world_to=T @ ASIDE),))


def test_a_world_that_is_turned_is_the_same() -> None:
    assert faults(said(*_turned(transform(rotation_about((0, 0, 1), 1.0), [3.0, -2.0, 0.5])))) == []
