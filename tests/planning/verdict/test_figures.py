"""What a plan says of itself, on an arm and in a cabinet whose every figure is known by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from toy_arm import HAND, course, motion, splined

from kinematics.scene import Body, Cabinet, Grasp, Held, RobotRef, Scene, Settlement
from kinematics.shapes import Box, ConvexMesh, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.plan import Blocked, Fault, Motion, Move, Plan, Unsolvable
from planning.verdict import figures as figures_module
from planning.verdict.course import Course
from planning.verdict.faults import Settings
from planning.verdict.figures import (
    claim_faults,
    figure_faults,
    goal_faults,
    grasp_faults,
    hand_ways,
    mass_faults,
    move_faults,
    stage_faults,
    stated_faults,
    tilt_faults,
)
from planning.verdict.ledger import Carry, Ledger, difference

CABINET = Cabinet(np.array([0.4, 0.8, 0.5]), transform(p=[1.0, 0.0, 0.2]), 0.03)
"""Its front edge is at x = 1; with 2 × 2 regions, each is 0.2 m deep and 0.4 m wide; number 1 is the front left one."""
BASE, SETTINGS = np.array([0.1, 0.2, 0.3]), Settings()


def scene(*more: Body, turn: Array | None = None) -> Scene:
    a, b = (Body(name, Box(np.array([0.1, 0.06, 0.2])), transform(p=[1.1, y, 0.3])) for name, y in (("a", -0.2), ("b", 0.2)))
    cabinet = CABINET if turn is None else replace(CABINET, T_world_cabinet=turn @ CABINET.T_world_cabinet)
    return Scene("by-hand", RobotRef(transform(p=BASE), "toy"), cabinet, (a, b, *more), "b", Grasp(np.eye(4), 0.06), regions_n=2)


def carry(body: str, to: Array | Sequence[float], put: bool = True, start: Array | None = None, hand: Array | None = None) -> Carry:
    T = transform(p=to) if np.ndim(to) == 1 else np.asarray(to)
    T_from = scene().poses()[body] if start is None else start
    return Carry(body, 0, 0, T_from, T, np.eye(4), np.eye(4) if hand is None else hand, np.zeros(5), put)


def ledger(*carries: Carry, poses: Mapping[str, Array] | None = None) -> Ledger:
    at = {**scene().poses(), **{c.body: c.T_world_to for c in carries}} if poses is None else poses
    return Ledger(carries, (), at, ())


def move(body: str, to: Sequence[float] | Array, region: int, done: bool = True, start: Array | None = None) -> Move:
    T = transform(p=to) if np.ndim(to) == 1 else np.asarray(to)
    return Move(body, region, scene().poses()[body] if start is None else start, T, done)


def plan(*moves: Move, motions: Sequence[Motion] = (), success: bool = False, **other: Any) -> Plan:
    return Plan(
        "by-hand",
        "local",
        "deep",
        success,
        None,
        moves,
        tuple(motions),
        0,
        0,
        **{"hand_travel_m": 0.0, "value": 0.0, "verified": None, **other},
    )


# ----------------------------------------------------------------------------------------------------------------------------------- moves


def said_of_moves(moves: Sequence[Move], carries: Sequence[Carry], success: bool = False) -> list[Fault]:
    return move_faults(scene(), plan(*moves, success=success), ledger(*carries), SETTINGS)


def test_moves_are_what_the_hand_carried() -> None:
    a, b = (1.1, 0.2, 0.3), (1.3, 0.2, 0.3)
    assert said_of_moves([move("a", a, 1), move("b", b, 3)], [carry("a", a), carry("b", b)]) == []
    tried = move("b", (9, 9, 9), 1, done=False)
    assert said_of_moves([tried, move("a", a, 1)], [carry("a", a)]) == []
    for moves, carries, said, was in (
        ([move("a", a, 1)], [], "a", "nothing"),
        ([], [carry("a", a)], "nothing", "a"),
        ([move("b", b, 3), move("a", a, 1)], [carry("a", a), carry("b", b)], "b, a", "a, b"),
        ([tried], [carry("b", b)], "nothing", "b"),
    ):
        assert said_of_moves(moves, carries) == [Fault("moves", (), f"the moves say that {said} was moved, and the motions move {was}")]


def test_the_target_that_a_success_ends_with_is_no_move() -> None:
    """But one that is put down, or another object, or that of a failure, is."""
    kept, other = carry("b", (0, 0, 0), put=False), carry("a", (0, 0, 0), put=False)
    assert said_of_moves([], [kept], success=True) == []
    assert said_of_moves([], [], success=True) == []
    for carries, success in (([kept], False), ([other], True), ([carry("b", (0, 0, 0))], True)):
        said = f"the moves say that nothing was moved, and the motions move {carries[0].body}"
        assert said_of_moves([], carries, success) == [Fault("moves", (), said)]


def test_a_move_says_from_where_and_to_where() -> None:
    """To a millimetre and a milliradian."""
    start, to = scene().poses()["a"], transform(p=[1.1, 0.2, 0.3])
    for share, well in ((0.99, True), (1.01, False)):
        far = transform(p=[0, share * 0.001, 0])
        askew = transform(rotation_about((0, 0, 1), share * 0.001))
        for by, mm in ((far, 1.0), (askew, 0.0)):
            for which, made in (("from", move("a", to, 1, start=start @ by)), ("to", move("a", to @ by, 1))):
                said = said_of_moves([made], [carry("a", to)])
                if well:
                    assert said == []
                else:
                    degrees = 0.1 if mm == 0 else 0.0
                    assert [(f.stage, f.bodies) for f in said] == [("moves", ("a",))]
                    assert said[0].detail == f"a is {mm:.1f} mm and {degrees:.1f}° from its T_world_{which}"
                    assert said[0].amount == pytest.approx(0.00101 if mm else 0.0, abs=1e-9)


def test_a_pose_that_is_just_as_near_as_asked_is_the_same() -> None:
    to = transform(p=[1.1, 0.2, 0.3])
    there = to @ transform(rotation_about((0, 0, 1), 0.01), [0.3, 0.0, 0.0])
    far, turned = difference(there, to)
    for pose_m, pose_rad, well in ((far, turned, True), (np.nextafter(far, 0), turned, False), (far, np.nextafter(turned, 0), False)):
        asked = Settings(pose_m=float(pose_m), pose_rad=float(pose_rad))
        moved = move_faults(scene(), plan(move("a", there, 3)), ledger(carry("a", to)), asked)
        assert [f.detail for f in moved if "T_world_to" in f.detail] == ([] if well else ["a is 300.0 mm and 0.6° from its T_world_to"])
        taken = grasp_faults(scene(), ledger(carry("b", to, put=False, hand=to)), [Grasp(there, 0.06)], asked)
        wrong = "b is taken 300.0 mm and 0.6° from the grasp that was asked for"
        assert [f.detail for f in taken] == ([] if well else [wrong])


def test_an_objects_middle_is_over_its_region() -> None:
    """A millimetre may be wrong. Region 1 goes from x = 1.0 to 1.2 and from y = 0 to 0.4, region 2 from 1.2 and from -0.4 to 0."""
    for to, region, off in (
        ((1.1, 0.2), 1, 0.0),
        ((1.001, 0.399), 1, 0.0),
        ((1.3, -0.2), 2, 0.0),
        ((1.3, -0.2), 3, 200.0),
        ((1.2009, 0.2), 1, 0.0),
        ((1.2015, 0.2), 1, 2.0),
        ((1.2021, 0.2), 1, 2.0),
        ((1.1, 1.4), 1, 1000.0),
        ((0.9991, 0.2), 1, 0.0),
        ((0.99, 0.2), 1, 10.0),
        ((1.1, -0.0009), 1, 0.0),
        ((1.1, -0.02), 1, 20.0),
        ((1.1, 0.45), 1, 50.0),
        ((1.25, 0.47), 1, 70.0),
    ):
        p = [*to, 0.3]
        said = said_of_moves([move("a", p, region)], [carry("a", p)])
        assert [f.detail for f in said] == ([] if not off else [f"a stands {off:.0f} mm outside region {region}"]), (to, region)
        if off:
            assert (said[0].stage, said[0].bodies, said[0].amount) == ("moves", ("a",), pytest.approx(off / 1000, abs=6e-4))
    p = [1.1, 0.2, 0.3]
    assert said_of_moves([move("a", p, 4)], [carry("a", p)]) == [Fault("moves", ("a",), "a goes to region 4, and there are 4")]


def test_a_middle_just_so_far_beside_its_region(monkeypatch: pytest.MonkeyPatch) -> None:
    p = [1.25, 0.2, 0.3]
    (fault,) = said_of_moves([move("a", p, 1)], [carry("a", p)])
    assert fault.amount is not None
    monkeypatch.setattr(figures_module, "REGION_M", fault.amount)
    assert said_of_moves([move("a", p, 1)], [carry("a", p)]) == []


def test_the_middle_is_that_of_all_parts_where_the_cabinet_stands() -> None:
    """Of a mesh whose frame is at its end; in a cabinet that is turned by a quarter."""
    parts = tuple(box_corners(np.array([0.05, 0.02, 0.1])) + np.array([x, 0.0, 0.0]) for x in (0.05, 0.25))  # from x = 0 to 0.3
    mesh = Body("m", ConvexMesh(parts), transform(p=[1.0, 0.1, 0.3]))
    quarter = transform(rotation_about((0, 0, 1), np.pi / 2))
    there = scene(mesh, turn=quarter)
    for x, region in ((0.96, 1), (1.15, 3)):  # the middle at x + 0.15
        T = quarter @ transform(p=[x, 0.2, 0.3])
        made = plan(move("m", T, region, start=mesh.T_world_body))
        said = move_faults(there, made, ledger(carry("m", T, start=mesh.T_world_body)), SETTINGS)
        assert said == []


# ------------------------------------------------------------------------------------------------------------------------------------ goal


def test_a_failure_ends_with_an_empty_hand() -> None:
    assert goal_faults(scene(), plan(), ledger()) == []
    assert goal_faults(scene(), plan(), ledger(carry("a", (0, 0, 0)))) == []
    said = goal_faults(scene(), plan(), ledger(carry("b", (0, 0, 0)), carry("a", (0, 0, 0), put=False)))
    assert said == [Fault("plan", ("a",), "it is no success, and a stays in the hand at its end")]


def test_a_success_ends_with_the_target_in_the_hand() -> None:
    for carries, bodies, holds in (
        ([], (), "nothing"),
        ([carry("b", (0, 0, 0))], (), "nothing"),
        ([carry("a", (0, 0, 0), put=False)], ("a",), "a"),
    ):
        said = goal_faults(scene(), plan(success=True), ledger(*carries))
        assert said == [Fault("plan", bodies, f"it is called a success, and the hand holds {holds} at its end, not b")]


def test_a_scene_without_a_target_has_no_success() -> None:
    none = replace(scene(), target=None)
    said = goal_faults(none, plan(success=True), ledger())
    assert said == [Fault("plan", (), "it is called a success, and the hand holds nothing at its end, not None")]


def test_a_target_that_just_touches_the_cabinets_front_is_outside() -> None:
    """In numbers that are exact in binary."""
    cube = Body("b", Box(np.full(3, 0.125)), np.eye(4))
    for x, well in ((0.9375, True), (0.9376, False)):
        T = transform(p=[x, 0, 0.5])
        there = replace(scene(), objects=(cube,))
        assert (goal_faults(there, plan(success=True), ledger(carry("b", T, put=False, start=np.eye(4)), poses={"b": T})) == []) == well


def test_the_whole_target_is_outside() -> None:
    """By any side: 10 × 6 × 20 cm, the cabinet from x 1.0 to 1.4, y ±0.4, z 0.2 to 0.7."""
    for p, mm in (
        ((0.949, 0, 0.4), 0.0),
        ((0.95, 0, 0.4), 0.0),
        ((0.96, 0, 0.4), 10.0),
        ((1.0, 0.0, 0.4), 50.0),
        ((1.0, 0.425, 0.4), 5.0),
        ((1.0, -0.425, 0.4), 5.0),
        ((1.0, 0.431, 0.4), 0.0),
        ((1.0, -0.431, 0.4), 0.0),
        ((1.445, 0.0, 0.4), 5.0),
        ((1.451, 0.0, 0.4), 0.0),
        ((1.0, 0.0, 0.103), 3.0),
        ((1.0, 0.0, 0.099), 0.0),
        ((1.0, 0.0, 0.797), 3.0),
        ((1.0, 0.0, 0.801), 0.0),
        ((1.175, 0.0, 0.4), 225.0),
    ):
        T = transform(p=p)
        said = goal_faults(scene(), plan(success=True), ledger(carry("b", T, put=False)))
        assert [f.detail for f in said] == ([f"b still is {mm:.1f} mm inside the cabinet at the end"] if mm else []), p
        for fault in said:
            assert (fault.stage, fault.bodies, fault.amount) == ("plan", ("b",), pytest.approx(mm / 1000))
    quarter = transform(rotation_about((0, 0, 1), np.pi / 2))
    for x, some in ((0.96, 1), (0.94, 0)):
        at = quarter @ transform(p=[x, 0, 0.4])
        assert len(goal_faults(scene(turn=quarter), plan(success=True), ledger(carry("b", at, put=False)))) == some


def test_the_target_is_taken_with_a_grasp_that_was_asked_for() -> None:
    """The last time that it is taken for good; by any of those, to a millimetre and a milliradian."""
    X = transform(p=[1.0, 0.1, 0.3])

    def said(hand: Array, *allowed: Array, body: str = "b", put: bool = False) -> list[Fault]:
        first = carry("b", (0, 0, 0), hand=transform(p=[9, 9, 9]))
        return grasp_faults(scene(), ledger(first, carry(body, (0, 0, 0), put, hand=hand)), [Grasp(T, 0.06) for T in allowed], SETTINGS)

    assert said(X, X) == said(X, transform(p=[5, 5, 5]), X) == []
    far = X @ transform(p=[0, 0.02, 0])
    wrong = Fault("grasp", ("hand", "b"), "b is taken 20.0 mm and 0.0° from the grasp that was asked for", 0.02)
    (found,) = said(far, X)
    assert found == replace(wrong, amount=found.amount)
    assert found.amount == pytest.approx(0.02)
    assert said(far) == said(far, X, body="a") == said(far, X, put=True) == []
    for share, well in ((0.99, True), (1.01, False)):
        for by in (transform(p=[share * 0.001, 0, 0]), transform(rotation_about((1, 0, 0), share * 0.001))):
            assert (said(X @ by, X) == []) == well
    # the nearest counts, a radian like ten centimetres: 5 mm off, or 0.04 rad
    turned, beside = X @ transform(rotation_about((0, 0, 1), 0.04)), X @ transform(p=[0.005, 0, 0])
    assert said(X, turned, beside)[0].detail == "b is taken 0.0 mm and 2.3° from the grasp that was asked for"
    more = X @ transform(rotation_about((0, 0, 1), 0.06))
    assert said(X, more, beside)[0].detail == "b is taken 5.0 mm and 0.0° from the grasp that was asked for"


# ------------------------------------------------------------------------------------------------------------------------------------ tilt


def tilted(
    limit: float | None, *run: Course, first: int = 0, last: int = 0, T: Array | None = None, grip: Array | None = None
) -> list[Fault]:
    held = Carry(
        "a", first, last, np.eye(4) if T is None else T, np.eye(4), np.eye(4) if grip is None else grip, np.eye(4), np.zeros(5), True
    )
    limits = {} if limit is None else {"a": limit}
    return tilt_faults(run, ledger(held), HAND, transform(p=BASE), limits)


def test_what_is_carried_leans_no_further_than_its_limit() -> None:
    """The toy tips about x. The worst of a motion counts, a tenth of a degree is rounding."""
    for degrees, limit, well in (
        (29.0, 30.0, True),
        (30.09, 30.0, True),
        (30.11, 30.0, False),
        (170.0, 179.9, True),
        (175.0, 170.0, False),
    ):
        tip = np.radians(degrees)
        said = tilted(limit, course((0, 0, 0, 0), (0, 0, 0, tip), (0, 0, 0, 0)))
        assert [f.detail for f in said] == ([] if well else [f"motion 0: a leans by {degrees:.1f}°, and may by {limit:g}°"])
        for fault in said:
            assert (fault.stage, fault.bodies, fault.amount) == ("transit", ("a",), pytest.approx(tip))
    upside_down = course((0, 0, 0, 3.0), (0, 0, 0, 3.0))
    assert tilted(None, upside_down) == tilted(180.0, upside_down) == tilted(200.0, upside_down) == []
    assert len(tilted(179.5, course((0, 0, 0, 3.14), (0, 0, 0, 3.14)))) == 1
    assert len(tilted(171.0, upside_down)) == 1


def test_which_of_its_motions_it_leans_in() -> None:
    """It is taken by a hand that is tipped already: turned about the vertical, it stands as it stood."""
    tipped = transform(rotation_about((1, 0, 0), 0.5))
    turns, tips = course((0, 0, 0, 0.5), (0, 0, 1.5, 0.5)), course((0, 0, 1.5, 0.5), (0, 0, 1.5, 0.8), number=1)
    assert tilted(5.0, turns, T=tipped) == []
    assert [f.detail for f in tilted(5.0, turns, tips, last=1, T=tipped)] == ["motion 1: a leans by 17.2°, and may by 5°"]


def test_what_leans_just_as_far_as_it_may() -> None:
    """A tenth of a degree more than its limit."""
    run = course((0, 0, 0, 0), (0, 0, 0, 0.3))
    (fault,) = tilted(5.0, run)
    lean = float(np.degrees(fault.amount or 0.0))
    limit = next(float(x) for x in lean - 0.1 + np.spacing(lean) * np.arange(-4, 5) if float(x) + 0.1 == lean)
    assert tilted(limit, run) == []
    assert len(tilted(float(np.nextafter(limit, 0)) - 1e-12, run)) == 1


def test_a_swing_between_two_rows_is_found() -> None:
    """Of a quarter of a degree, by a spline whose ends are upright."""
    qd = np.zeros((2, 5))
    qd[0, 3] = 5 * 0.0045  # the coefficients are 0, 4.5, 9, 0 mrad; half-way it is at 25/32 of 4.5 mrad
    said = tilted(0.05, splined((0,), (0,), qd=qd))
    assert [f.detail for f in said] == ["motion 0: a leans by 0.2°, and may by 0.05°"]


def test_each_motion_of_a_carry_is_judged_and_no_other() -> None:
    run = [
        course((0, 0, 0, tip), (0, 0, 0, tip / 2), number=n, stage=s)
        for n, (tip, s) in enumerate(((1.0, "transit"), (0.4, "lift"), (0.5, "transfer"), (0.2, "lower"), (1.0, "retreat")))
    ]
    said = tilted(15.0, *run, first=1, last=3)
    assert [(f.stage, f.detail) for f in said] == [
        ("lift", "motion 1: a leans by 22.9°, and may by 15°"),
        ("transfer", "motion 2: a leans by 28.6°, and may by 15°"),
    ]


def test_it_leans_from_how_it_stood() -> None:
    """Lying on its side before it was taken, it may lie; between two rows it may lean most."""
    side = transform(rotation_about((1, 0, 0), np.pi / 2))
    assert tilted(5.0, course((0,), (0.1,)), T=side, grip=side) == []
    assert [f.detail for f in tilted(5.0, course((0,), (0.1,)), T=side)] == ["motion 0: a leans by 90.0°, and may by 5°"]
    yawed = transform(rotation_about((0, 0, 1), 2.0))
    assert tilted(1.0, course((0, 0, 0), (0, 0, 3)), T=yawed) == []
    over = course((0, 0, 0, -0.3), (0, 0, 3.0, 0.3))
    assert [f.detail for f in tilted(10.0, over)] == ["motion 0: a leans by 17.2°, and may by 10°"]


# --------------------------------------------------------------------------------------------------------------------------------- figures


def figures(*run: Course, moves: Sequence[Move] = (), **said: Any) -> list[Fault]:
    return figure_faults(scene(), plan(*moves, **said), run, HAND)


def test_the_return_is_one_for_a_success_less_the_ways_of_the_moves() -> None:
    """From the base at (0.1, 0.2, 0.3) to the object, and from there to where it is put: eq. 1."""
    made = move("a", (1.1, 0.2, 0.3), 1, start=transform(p=[0.4, 0.6, 0.3]))  # 0.5 m, and √(0.49 + 0.16) m
    value = -0.5 - np.sqrt(0.65)
    tried = move("a", (9, 9, 9), 1, done=False)
    for success in (False, True):
        for off, well in ((0.0, True), (0.9e-3, True), (-0.9e-3, True), (1.1e-3, False), (-1.1e-3, False), (np.nan, False)):
            said = figures(course((0,)), moves=[tried, made], success=success, value=value + success + off)
            assert (said == []) == well
            if np.isfinite(off) and not well:
                now, right = value + success + off, value + success
                assert said == [Fault("plan", (), f"its return is {now:.4f}, and the moves make it {right:.4f}", said[0].amount)]
                assert said[0].amount == pytest.approx(1.1e-3)
    assert figures(course((0,)), value=0.0) == figures(course((0,)), value=1e-3) == []


def test_the_hands_way_is_what_the_motions_make_it() -> None:
    """To 1 % and 2 mm; the leap from one motion to the next is no way."""
    run = [course((0,), (1,), (1, 0.5)), course((0, 3), (0, 3.5))]  # 1.5 m, 0.5 m
    assert hand_ways(run, HAND, np.eye(4)) == pytest.approx([1.5, 0.5])
    for off, well in ((0.0, True), (0.0219, True), (-0.0219, True), (0.0221, False), (-0.0221, False)):
        said = figures(*run, hand_travel_m=2.0 + off)
        wrong = [Fault("plan", (), f"its hand_travel_m is {2 + off:.4f}, and the motions make it 2.0000", abs(off))]
        assert [(f.stage, f.bodies, f.detail) for f in said] == ([] if well else [(f.stage, f.bodies, f.detail) for f in wrong])
        assert [f.amount for f in said] == ([] if well else [pytest.approx(0.0221)])


def test_a_way_just_so_far_off() -> None:
    assert figures(course((0,)), hand_travel_m=0.002) == []
    assert len(figures(course((0,)), hand_travel_m=0.0021)) == 1


def test_the_way_is_measured_along_arcs() -> None:
    """About a base that is turned: the hand 0.3 m beside the axis, over half a turn."""
    arm = replace(HAND, T_carrier_hand=transform(p=[0.3, 0.0, 0.0]))
    (way,) = hand_ways([course((0, 0, 0), (0, 0, np.pi))], arm, transform(rotation_about((1, 0, 0), 0.5)))
    assert 0.3 * np.pi * (1 - 0.05**2 / 20) < way < 0.3 * np.pi


def test_relocations_end_with_the_last_retreat() -> None:
    """Looks left out."""
    stages = ("transit", "look", "retreat", "transit", "look", "retreat", "transfer")
    run = [course((0,), (0.1 * 2**n,), number=n, stage=s) for n, s in enumerate(stages)]  # 0.1, 0.2, 0.4, …
    whole, before = 12.7, 0.1 + 0.4 + 0.8 + 3.2
    assert figures(*run, hand_travel_m=whole) == []
    assert figures(*run, hand_travel_m=whole, relocation_travel_m=before) == []
    (said,) = figures(*run, hand_travel_m=whole, relocation_travel_m=before + 0.1)
    assert said.detail == "its relocation_travel_m is 4.6000, and the motions before the last retreat make it 4.5000"
    none = [c for c in run if c.stage != "retreat"]
    assert figures(*none, hand_travel_m=12.7 - 3.6, relocation_travel_m=0.0) == []
    assert len(figures(*none, hand_travel_m=12.7 - 3.6, relocation_travel_m=0.1)) == 1


def test_times_count_from_a_motions_start() -> None:
    late = [course((0,), (0,), number=n, stage="lift", t_s=(t, 9.0)) for n, t in enumerate((0.0009, 0.0011, 1.0))]
    assert figures(late[0]) == figures(course((0,), (0,), t_s=(0.001, 1))) == []
    assert figures(*late) == [Fault("lift", (), "motion 1 begins at 0.001 s, and times count from its start", 0.0011)]


def test_what_a_file_states_is_what_its_motions_give() -> None:
    motions = [replace(motion((0,), (0,), t_s=(0, t)), clearance_m=c) for t, c in ((2.0, 0.004), (1.5, 0.003))]

    def said(**stated: float) -> list[Fault]:
        made = plan(motions=motions, stated=stated)
        assert figure_faults(scene(), made, [course((0,))], HAND) == stated_faults(made)
        return stated_faults(made)

    assert said() == said(duration_s=3.5, clearance_m=0.003) == said(duration_s=3.5009) == said(clearance_m=0.0030099) == []
    assert said(duration_s=3.5011) == [Fault("plan", (), "its duration_s is 3.5011, and the motions make it 3.5000")]
    assert said(duration_s=3.4989, clearance_m=0.0030101) == [
        Fault("plan", (), "its duration_s is 3.4989, and the motions make it 3.5000"),
        Fault("plan", (), "its clearance_m is 0.0030, and the motions make it 0.0030"),
    ]
    assert len(said(duration_s=np.nan)) == 1
    assert stated_faults(plan(motions=[motion((0,))], stated={"duration_s": 0.001})) == []
    nothing = stated_faults(plan(motions=[motion((0,))], stated={"clearance_m": 0.5}))
    assert nothing == [Fault("plan", (), "its clearance_m is 0.5000, and the motions make it nothing")]


def test_stages_say_whether_something_is_held() -> None:
    held = Held("a", np.eye(4))
    for stage in ("transit", "approach", "retreat", "look"):
        assert stage_faults([course((0,), stage=stage)]) == []
        (fault,) = stage_faults([course((0,), stage="lift", held=held), course((0,), stage=stage, held=held, number=1)])
        assert fault == Fault(stage, ("a",), "motion 1 is of an empty hand, and holds a")
    for stage in ("lift", "transfer", "lower"):
        assert stage_faults([course((0,), stage=stage, held=held)]) == []
        assert stage_faults([course((0,), stage=stage)]) == [Fault(stage, (), "motion 0 carries, and holds nothing")]
    assert len(stage_faults([course((0,), stage="lift"), course((0,), stage="lower")])) == 1  # the first is enough
    for stage in ("grasp", "release"):
        assert stage_faults([course((0,), stage=stage), course((0,), stage=stage, held=held)]) == []


def test_what_is_carried_weighs_no_more_than_the_robot_may_lift() -> None:
    """Each carry is asked, in its order; what stays may weigh anything, and a mass or a payload that nobody tells is no fault."""

    def said(payload_kg: float | None, *carried: str, **kg: float) -> list[Fault]:
        at = scene()
        objects = tuple(replace(b, mass_kg=kg.get(b.name)) for b in at.objects)
        return mass_faults(
            replace(at, robot=replace(at.robot, payload_kg=payload_kg), objects=objects),
            ledger(*(carry(name, (0, 0, 0)) for name in carried)),
        )

    def heavy(name: str, kg: str) -> Fault:
        return Fault("lift", (name,), f"{name} weighs {kg} kg, and the robot's payload is 0.5 kg")

    assert said(0.5, "b", "a", a=0.501, b=2.0) == [heavy("b", "2"), heavy("a", "0.501")]
    assert said(0.5, "b", a=2.0, b=0.5) == []
    assert said(0.5, "b", "a", a=2.0) == [heavy("a", "2")]
    assert said(None, "a", a=2.0) == []
    assert said(0.5, a=2.0) == []


def test_a_plan_does_not_contradict_itself() -> None:
    why, done, tried = Blocked("ik"), move("a", (1.1, -0.2, 0.3), 1), move("a", (1.1, -0.2, 0.3), 1, done=False)

    def said(*moves: Move, **other: Any) -> list[str]:
        return [f.detail for f in claim_faults(scene(), replace(plan(*moves), **other))]

    assert said(done, tried, success=True, least_moves=1, max_moves=1) == said(tried, reason=why, least_moves=3, max_moves=0) == []
    assert said(success=True, reason=why) == ["it is called a success, and has a reason why it failed: ik"]
    assert said() == ["it is no success, and does not say why"]
    stuck = Unsolvable(("a",), ())
    assert said(success=True, unsolvable=stuck) == ["it is called a success, and the scene unsolvable"]
    assert said(reason=why, unsolvable=stuck) == []
    assert said(done, tried, success=True, least_moves=2) == ["its least_moves is 2, and it succeeds with 1"]
    assert said(done, reason=why, max_moves=0) == ["it makes 1 moves, and its max_moves is 0"]
    assert said(replace(done, reason=why), success=True) == ["the move of a is called done, and has a reason why it failed: ik"]
    assert said(replace(tried, reason=why), success=True) == []
    settled = [Settlement(name, np.zeros(3), "") for name in ("a", "ghost", "spook")]
    assert said(success=True, settled=tuple(settled)) == ["it says that 'ghost' was settled, which is not in the scene"]
