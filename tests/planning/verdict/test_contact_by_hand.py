"""Contacts of a robot of boxes, whose every depth and distance is known by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from toy_arm import JOINTS, URDF, course, splined
from toy_robot import FINGERS, PALM, solid, toy_robot

from kinematics.collision.fcl_solids import shape_solids
from kinematics.mount import MOUNT
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, Held, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.plan import Fault
from planning.verdict.contact import _Asked, _at_hand, _deepest, certified_distance, contact_faults, farthest_distance
from planning.verdict.course import Course
from planning.verdict.faults import Settings
from planning.verdict.hand import hand_of
from planning.verdict.ledger import Carry, keep
from planning.verdict.sweep import Sweep

FAR = Cabinet(np.array([0.4, 0.4, 0.4]), transform(p=[50.0, 0.0, 0.0]), 0.03)
TOUCHING = frozenset({frozenset(("left", "it")), frozenset(("right", "it"))})
"""That the fingers may touch it."""


def block(name: str, x: tuple[float, float], y: tuple[float, float] = (-0.05, 0.05), z: tuple[float, float] = (-0.2, 0.2)) -> Body:
    low, high = np.array([x, y, z]).T
    return Body(name, Box(high - low), transform(p=(low + high) / 2))


def looked_at(
    run: Sequence[Course],
    *bodies: Body,
    obstacles: Sequence[Body] = (),
    robot: Robot | None = None,
    rests: Mapping[str, frozenset[str]] | None = None,
    base: Array | None = None,
    settings: Settings | None = None,
    ref: RobotRef | None = None,
) -> tuple[list[Fault], list[Fault]]:
    """Faults and notes of courses, one after the other."""
    robot, asked = robot or toy_robot(), settings or Settings()
    T_base = np.eye(4) if base is None else base
    scene = Scene("s", ref or RobotRef(T_base, urdf="toy"), FAR, bodies, None, Grasp(np.eye(4), 0.05), obstacles=tuple(obstacles))
    hand, numbered = hand_of(robot), [replace(c, number=n) for n, c in enumerate(run)]
    return contact_faults(robot, hand, scene, numbered, keep(hand, scene, numbered, asked), rests or {}, asked)


def said(faults: Sequence[Fault]) -> list[tuple[str, tuple[str, ...], str]]:
    return [(f.stage, f.bodies, f.detail) for f in faults]


def test_how_deep_the_palm_is_in_a_block_at_the_end() -> None:
    """It is 3 cm long each way; the block begins at 0.5. Only what overlaps is told, to a thousandth of a millimetre."""
    it = block("it", (0.5, 0.6))
    for x, deep in ((0.4, None), (0.4699, None), (0.4705, 0.5), (0.479, 9.0)):
        faults, notes = looked_at([course((0,), (x,))], it)
        assert notes == []
        assert said(faults) == ([] if deep is None else [("transit", ("palm", "it"), f"motion 0: palm is {deep:.2f} mm inside it")])
        if deep is not None:
            assert faults[0].amount == pytest.approx(deep / 1000, rel=0.02)
    for by, some in ((0.3e-6, 0), (1.6e-6, 1), (5e-6, 1)):
        assert len(looked_at([course((0,), (0.47 + by,))], it)[0]) == some


def test_each_motion_tells_the_deepest_of_each_pair_the_deepest_first() -> None:
    """A mesh in two parts is one body; a second motion tells its own."""
    parts = tuple(box_corners(np.array([0.05, 0.02, 0.2])) + np.array([0.05, y, 0.0]) for y in (-0.03, 0.03))
    mesh, wall = Body("mesh", ConvexMesh(parts), transform(p=[0.5, 0, 0])), block("wall", (0.498, 0.6), (0.04, 0.3))
    way = course((0,), (0.474,))
    faults, _ = looked_at([way, course((0.474,), (0.472,), stage="lift")], mesh, obstacles=[wall])
    assert said(faults) == [
        ("transit", ("palm", "wall"), "motion 0: palm is 6.00 mm inside wall"),
        ("transit", ("palm", "mesh"), "motion 0: palm is 4.00 mm inside mesh"),
        ("lift", ("palm", "wall"), "motion 1: palm is 6.00 mm inside wall"),
        ("lift", ("palm", "mesh"), "motion 1: palm is 4.00 mm inside mesh"),
    ]


def test_what_is_passed_on_the_way_is_found() -> None:
    """A post a millimetre wide, between the rows of a polyline, of a spline, and where the base stands elsewhere."""
    post = block("post", (0.4995, 0.5005), (-0.0005, 0.0005))
    for way in (course((0,), (1,)), splined((0,), (1,))):
        assert {f.bodies for f in looked_at([way], post)[0]} == {("palm", "post"), ("left", "post"), ("right", "post")}
    assert looked_at([course((0,), (1,))], post, base=transform(p=[0.0, 1.0, 0.0])) == ([], [])
    turned = transform(rotation_about((0, 0, 1), np.pi / 2), [0.5, -0.5, 0.0])
    assert len(looked_at([course((0,), (1,))], post, base=turned)[0]) == 3


def test_what_is_met_at_the_end_alone() -> None:
    """By a link that one joint moves, whichever way: nothing is left out as standing still."""
    rail = {"rail": solid((-0.03, 0.03), (-0.06, 0.06), (-0.06, -0.03))}
    robot = toy_robot({**rail, **{name: corners + np.array([9.0, 0, 0]) for name, corners in {**PALM, **FINGERS}.items()}})
    for way, it in (
        (course((0,), (0.48,)), block("it", (0.5, 0.6))),
        (course((-0.5,), (-0.02,)), block("it", (0.0, 0.1))),
        (course((0.5,), (0.02,)), block("it", (-0.1, 0.0))),
    ):
        assert said(looked_at([way], it, robot=robot)[0]) == [("transit", ("rail", "it"), "motion 0: rail is 10.00 mm inside it")]
    assert looked_at([course((0, 0.5), (0.48, 0.5))], block("it", (0.5, 0.6), (0.3, 0.7)))[0][0].bodies == ("palm", "it")


def test_a_tip_that_is_touched_for_a_moment_on_a_long_way_is_found() -> None:
    """By a finger 2.2 cm long, in the middle of a metre along a slanted face that boxes can't tell from it."""
    tip = np.array([[x, y, z] for x, y in ((0.0, 0.3), (1.0, 0.3), (0.5, 0.0395)) for z in (0.0, 0.02)])
    robot = toy_robot(FINGERS | {"palm": solid((-3.1, -3.0), (-0.01, 0.01), (0.0, 0.02))})
    way = course((0, 0, 0, 0, 0.03), (1, 0, 0, 0, 0.03))  # the left finger's outer side is at y = 4 cm
    found = looked_at([way], Body("tip", ConvexMesh((tip,)), np.eye(4)), robot=robot)[0]
    assert said(found) == [("transit", ("left", "tip"), "motion 0: left is 0.50 mm inside tip")]


def test_the_deepest_place_on_the_way_is_told() -> None:
    """A finger passes over a roof whose ridge it is 5 mm too low for, at a third of the way."""
    roof = np.array([[x, y, z] for x, y in ((0.1, 0.2), (0.9, 0.2), (0.33, 0.035)) for z in (0.0, 0.02)])
    robot = toy_robot(FINGERS | {"palm": solid((-3.1, -3.0), (-0.01, 0.01), (0.0, 0.02))})
    way = course((0, 0, 0, 0, 0.03), (1, 0, 0, 0, 0.03))
    (fault,) = looked_at([way], Body("roof", ConvexMesh((roof,)), np.eye(4)), robot=robot)[0]
    assert fault.amount is not None
    assert 0.004 < fault.amount < 0.0051


def grasping(value: float, *, allowed: frozenset[frozenset[str]] = TOUCHING, moves: float = 0.0) -> list[Course]:
    """The fingers close on what is 4 cm wide and lift it by 1 cm along x; moves: how far the arm moves while they close."""
    close = replace(course((0, 0, 0, 0, 0.03), (moves, 0, 0, 0, value), stage="grasp"), allowed=allowed)
    lift = course((moves, 0, 0, 0, value), (0.01, 0, 0, 0, value), stage="lift", held=Held("it", transform(p=[-moves, 0.0, 0.015])))
    return [close, replace(lift, allowed=allowed)]


IT = Body("it", Box(np.array([0.04, 0.04, 0.02])), transform(p=[0.0, 0.0, 0.015]))


def test_fingers_may_press_what_they_take_by_a_millimetre() -> None:
    for value, deep in ((0.02, 0.0), (0.0191, 0.0), (0.0189, 1.1)):
        faults, _ = looked_at(grasping(value), IT)
        both = [
            (stage, (a, b), f"motion {n}: {a} is {deep:.2f} mm inside {b}")
            for n, stage in enumerate(("grasp", "lift"))
            for a, b in _pair(n)
        ]
        assert sorted(said(faults)) == ([] if not deep else sorted(both))


def _pair(n: int) -> list[tuple[str, str]]:
    """What is held comes first."""
    return [("left", "it"), ("right", "it")] if n == 0 else [("it", "left"), ("it", "right")]


def test_fingers_may_press_wherever_the_arm_stands() -> None:
    there = [replace(c, q=c.q + np.array([0.5, -0.25, 0, 0, 0])) for c in grasping(0.0191)]
    it = replace(IT, T_world_body=transform(p=[0.5, -0.25, 0.015]))
    assert looked_at(there, it)[0] == []


def test_only_what_is_allowed_may_be_pressed() -> None:
    faults, _ = looked_at(grasping(0.0191, allowed=frozenset({frozenset(("left", "it"))})), IT)
    assert [f.bodies for f in faults] == [("right", "it"), ("it", "right")]
    palm = {**FINGERS, "palm": [PALM["palm"], solid((-0.01, 0.01), (-0.01, 0.01), (-0.03, 0.0055))]}
    more = TOUCHING | {frozenset(("palm", "it"))}
    faults, _ = looked_at(grasping(0.02, allowed=more), IT, robot=toy_robot(palm))
    assert [f.bodies for f in faults] == [("palm", "it"), ("it", "palm")]  # it holds nothing


def test_only_what_is_at_hand_may_be_pressed_and_while_the_arm_stands() -> None:
    assert {f.stage for f in looked_at(grasping(0.0191, moves=0.001), IT)[0]} == {"grasp"}
    assert looked_at(grasping(0.0191, moves=0.5e-6), IT)[0] == []
    assert {f.stage for f in looked_at(grasping(0.0191, moves=1.5e-6), IT)[0]} == {"grasp"}
    close, lift = grasping(0.0191)
    drags = replace(close, q=np.array([[-0.001, *close.q[1, 1:]], close.q[1]]))  # shut about it already
    assert {f.stage for f in looked_at([drags, lift], IT)[0]} == {"grasp"}
    alone = [close]  # it is never taken
    assert [f.stage for f in looked_at(alone, IT)[0]] == ["grasp", "grasp"]
    q = alone[0].q[-1]
    release = [replace(course(q, (0, 0, 0, 0, 0.03), stage="release"), allowed=TOUCHING)]
    there = course((0.01, *q[1:]), q, stage="lower", held=Held("it", transform(p=[0, 0, 0.015])))
    start = replace(IT, T_world_body=transform(p=[0.01, 0, 0.015]))
    assert looked_at([replace(there, allowed=TOUCHING), *release], start)[0] == []
    away = [course((0, 0, 0, 0, 0.03), (0, 0, 0, 0, 0.0191), stage="transit")]
    said_ = looked_at([replace(there, allowed=TOUCHING), *release, replace(away[0], allowed=TOUCHING)], start)[0]
    assert said_ == []  # still the last that was put down
    other = Body("other", Box(np.array([0.01, 0.01, 0.01])), transform(p=[0.5, 0, 0.015]))
    fetched = course((0.5, 0, 0, 0, 0.03), (0.5, 0, 0, 0, 0.03), stage="lift", held=Held("other", transform(p=[0, 0, 0.015])))
    put = course((0.5, 0, 0, 0, 0.03), (0, 0, 0, 0, 0.03), stage="retreat")
    soon = [replace(away[0], allowed=TOUCHING), fetched, put]
    assert {f.stage for f in looked_at([*soon, *grasping(0.02)], IT, other)[0]} >= {"transit"}  # it is taken, but not next
    late = looked_at([replace(there, allowed=TOUCHING), *release, fetched, put, replace(away[0], allowed=TOUCHING)], start, other)[0]
    assert {f.stage for f in late} == {"transit"}


def test_fingers_that_are_early_or_late_touch() -> None:
    """A post is beside the way: the closed hand passes by it, the open one does not, which closes before it comes there. The first opening
    that touches is told."""
    post = block("post", (0.49, 0.51), (0.035, 0.055), (0.02, 0.04))
    closing = course((0, 0, 0, 0, 0.03), (0.3, 0, 0, 0, 0.02), (0.6, 0, 0, 0, 0.02))
    late = "motion 0: left is 1.00 mm inside post, with grip at 0.026, early or late beside the arm"
    assert (said(looked_at([closing], post)[0]), looked_at([closing], post)[1]) == ([("transit", ("left", "post"), late)], [])
    never = replace(closing, q=np.where(np.arange(5) == 4, 0.02, closing.q))
    assert looked_at([never], post) == ([], [])
    through = replace(closing, q=np.where(np.arange(5) == 4, 0.03, closing.q))
    assert said(looked_at([through], post)[0]) == [("transit", ("left", "post"), "motion 0: left is 5.00 mm inside post")]


def test_what_is_held_is_where_the_hand_frame_has_it() -> None:
    """Which is 10 cm along the palm's x, and turned by a quarter about its z."""
    robot = toy_robot(urdf=URDF.replace('<child link="hand"/>', '<child link="hand"/><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/>'))
    robot = toy_robot({"palm": robot.hulls[0].vertices, **_quarter()}, urdf=robot.urdf)
    it = Body("it", Box(np.full(3, 0.02)), transform(rotation_about((0, 0, 1), np.pi / 2), [0.1, 0.2, 0.0]))
    wall = block("wall", (0.5, 0.6), (0.15, 0.25))
    way = course((0,), (0.392,), stage="transfer", held=Held("it", transform(p=[0.2, 0.0, 0.0])))  # 20 cm along the world's y
    assert said(looked_at([way], it, obstacles=[wall], robot=robot)[0]) == [
        ("transfer", ("it", "wall"), "motion 0: it is 2.00 mm inside wall")
    ]


def _quarter() -> dict[str, Array]:
    """Fingers that close along the palm's x, about x = 0.1: the right one is on the +y side of a hand frame that is turned by a quarter."""
    R = rotation_about((0, 0, 1), np.pi / 2)
    return {name: corners @ R.T + [0.1, 0.0, 0.0] for name, corners in {"left": FINGERS["left"], "right": FINGERS["right"]}.items()}


def test_what_is_held_may_rest_on_what_it_stood_on_or_will() -> None:
    """A millimetre deep, where the motion allows it; not in anything else, nor in what it does not rest on."""
    held = Held("it", transform(p=[0.0, 0.0, 0.0]))
    it = Body("it", Box(np.full(3, 0.02)), np.eye(4))
    for sunk, rests, allowed, well in (
        (0.0009, True, True, True),
        (0.0011, True, True, False),
        (0.0009, False, True, False),
        (0.0009, True, False, False),
    ):
        table = block("table", (-0.05, 0.05), (-0.05, 0.05), (-0.06, -0.01 + sunk))
        way = replace(
            course((0, 0, 0, 0, 0.03), (0.001, 0, 0, 0, 0.03), stage="lift", held=held),
            allowed=frozenset({frozenset(("it", "table"))} if allowed else ()),
        )
        robot = toy_robot(FINGERS | {"palm": solid((-0.3, -0.2), (-0.01, 0.01), (0.1, 0.2))})
        found, _ = looked_at([way], it, obstacles=[table], robot=robot, rests={"it": frozenset({"table"} if rests else ())})
        assert said([f for f in found if "it" in f.bodies]) == (
            [] if well else [("lift", ("it", "table"), f"motion 0: it is {1000 * sunk:.2f} mm inside table")]
        )


def test_what_the_base_stands_on() -> None:
    """It may be sunk into objects by a millimetre, into the mount and obstacles as deep as may be, which nothing that moves may touch: a
    UR5e's hull reaches 6 cm below the plane that it stands on, and a declared table is there."""
    based = {"base": solid((-0.1, 0.1), (-0.1, 0.1), (-1.0, -0.9)), **PALM, **FINGERS}
    for sunk, well in ((0.0009, True), (0.0011, False)):
        table = block("table", (-0.5, 0.5), (-0.5, 0.5), (-2.0, -1.0 + sunk))
        assert looked_at([course((0,), (0.1,))], obstacles=[table], robot=toy_robot(based)) == ([], [])
        faults, _ = looked_at([course((0,), (0.1,))], table, robot=toy_robot(based))
        assert said(faults) == ([] if well else [("transit", ("base", "table"), f"motion 0: base is {1000 * sunk:.2f} mm inside table")])
    mounted = RobotRef(transform(p=[0, 0, 0.0]), urdf="toy", mount=True)
    above = {"base": solid((-0.1, 0.1), (-0.1, 0.1), (-0.2, 0.2)), "palm": solid((0.4, 0.5), (-0.06, 0.06), (0.01, 0.05))}
    high, deep = ({name: corners + np.array([0.45, 0.0, z]) for name, corners in FINGERS.items()} for z in (0.02, 0.0))
    robot = toy_robot({**above, **high})
    assert looked_at([course((0,), (0.1,))], robot=robot, ref=mounted) == ([], [])
    table = block("table", (-0.1, 0.6), (-0.5, 0.5), (-0.5, 0.02))
    found = looked_at([course((0,), (0.1,))], robot=robot, obstacles=[table])[0]
    assert {f.bodies for f in found} == {("palm", "table"), ("left", "table"), ("right", "table")}
    low = looked_at([course((0,), (0.1,))], robot=toy_robot({**above, **deep}), ref=mounted)[0]
    assert {f.bodies for f in low} == {("left", MOUNT), ("right", MOUNT)}  # a centimetre of each
    low_rail = {"rail": solid((-0.1, 0.1), (-0.1, 0.1), (-0.01, 0.2)), **above, **high}
    found = looked_at([course((0,), (0.1,))], robot=toy_robot(low_rail), ref=mounted)[0]
    assert ("rail", MOUNT) in {f.bodies for f in found}
    named = block(MOUNT, (-0.5, 0.5), (-0.5, 0.5), (-2.0, -0.9))
    assert looked_at([course((0,), (0.1,))], obstacles=[named], robot=toy_robot(based))[0] == []


def test_links_may_not_touch_links() -> None:
    """The base's post stands where the palm comes; an SRDF that switches that off makes it a note, told without contacts, too."""
    post = {"base": solid((0.5, 0.6), (-0.05, 0.05), (-0.2, 0.2)), "column": solid((-0.01, 0.01), (-0.01, 0.01), (-0.3, -0.29))}
    robot = toy_robot({**post, **PALM, **FINGERS})
    way = course((0,), (0.472,))
    faults, notes = looked_at([way], robot=robot)
    assert said(faults) == [("transit", ("palm", "base"), "motion 0: palm is 2.00 mm inside base")]
    assert notes == []
    lenient = toy_robot({**post, **PALM, **FINGERS}, skip=frozenset({frozenset(("palm", "base"))}))
    for settings in (Settings(), Settings(contact=False)):
        faults, notes = looked_at([way], block("it", (0.497, 0.6), (0.051, 0.2)), robot=lenient, settings=settings)
        assert said(notes) == [
            ("transit", ("palm", "base"), "motion 0: palm is 2.00 mm inside base, a pair that the robot's SRDF switches off")
        ]
        assert said(faults) == ([("transit", ("palm", "it"), "motion 0: palm is 5.00 mm inside it")] if settings.contact else [])
    base_in = looked_at([way], block("it", (0.55, 0.6), (0.04, 0.2)), robot=lenient)
    assert [f.bodies for f in base_in[0]] == [("base", "it")]
    assert [f.bodies for f in base_in[1]] == [("palm", "base")]
    held = course((0.2, 0, 0, 0, 0.03), (0.3, 0, 0, 0, 0.03), stage="transfer", held=Held("it", transform(p=[0.21, 0, 0])))
    carried = looked_at([held], Body("it", Box(np.full(3, 0.04)), transform(p=[0.41, 0, 0])), robot=lenient)[0]
    assert [f.bodies for f in carried] == [("it", "base")]  # the first pair that is neither checked of old nor switched off
    others = toy_robot({**post, **PALM, **FINGERS}, skip=frozenset({frozenset(("left", "base"))}))
    assert looked_at([way], robot=others, settings=Settings(contact=False)) == ([], [])
    assert looked_at([way], block("it", (0.497, 0.6), (0.051, 0.2)), robot=robot, settings=Settings(contact=False)) == ([], [])


# ------------------------------------------------------------------------------------------------------------------------------ clearances


def clearance(least: float, run: Course, *bodies: Body, **other: object) -> list[Fault]:
    return looked_at([replace(run, clearance_m=least)], *bodies, **other)[0]  # type: ignore[arg-type]


def test_nothing_comes_nearer_than_a_motion_says() -> None:
    """The palm passes a block 3 mm beside it, and a second one 4 mm: the nearest is told; a tenth of a millimetre is rounding."""
    near, far = block("near", (0.5, 0.6), (0.063, 0.2)), block("far", (0.8, 0.9), (0.064, 0.2))
    way = course((0,), (1,))
    for least, well in ((0.003, True), (0.00309, True), (0.00311, False), (0.005, False)):
        found = clearance(least, way, far, near)
        wrong = f"motion 0: palm is 3.00 mm from near, and the least is said to be {1000 * least:.2f} mm"
        assert said(found) == ([] if well else [("transit", ("palm", "near"), wrong)])
        assert [f.amount for f in found] == ([] if well else [pytest.approx(0.003)])
    assert looked_at([way], near)[0] == []
    assert said(clearance(0.005, way, block("in", (0.5, 0.6), (0.05, 0.2)), near)) == [
        ("transit", ("palm", "in"), "motion 0: palm is 10.00 mm inside in")
    ]


def test_it_may_be_nearest_where_a_motion_begins_or_ends() -> None:
    wall = block("wall", (0.5, 0.6))
    for way in (course((0.467,), (0.2,)), course((0.2,), (0.467,)), course((0.2,), (0.467,), (0.2,))):
        (fault,) = clearance(0.005, way, wall)
        assert fault.detail == "motion 0: palm is 3.00 mm from wall, and the least is said to be 5.00 mm"
    far = clearance(0.5, course((0.067,), (0.0,)), wall)
    assert [f.detail for f in far] == ["motion 0: palm is 403.00 mm from wall, and the least is said to be 500.00 mm"]


def test_what_may_touch_may_be_near() -> None:
    near = block("near", (0.5, 0.6), (0.063, 0.2))
    way = replace(course((0,), (1,)), allowed=frozenset({frozenset(("palm", "near"))}))
    assert clearance(0.005, way, near) == []
    assert [f.bodies for f in clearance(0.060, way, near)] == [("left", "near")]  # whose side is 1 cm from the middle, or 5.3 from near
    still = {"base": solid((0.5, 0.6), (0.055, 0.0620), (-0.05, -0.04)), **PALM, **FINGERS}
    assert clearance(0.005, replace(way, q=way.q[:1], t_s=way.t_s[:1]), near, robot=toy_robot(still)) == []  # a base stands where it stands


def test_another_limb_that_stands_still_is_no_part_of_what_a_motion_says() -> None:
    """A motion's clearance is that of the links that the arm's joints move. That limb may touch nothing all the same."""
    swing = '<link name="limb"/><joint name="swing" type="prismatic"><parent link="base"/><child link="limb"/><axis xyz="0 0 1"/>'
    urdf = URDF.replace("</robot>", f'{swing}<limit lower="0" upper="1" velocity="1"/></joint></robot>')
    limb = solid((0.5, 0.6), (0.3, 0.35), (-0.05, 0.05))
    robot = toy_robot({"limb": limb, **PALM, **FINGERS}, urdf=urdf, joint_names=(*JOINTS, "swing"))
    way = course((0,), (1,))
    way = replace(way, q=np.c_[way.q, np.zeros(len(way.q))])
    assert clearance(0.2, way, block("beside", (0.5, 0.6), (0.351, 0.5)), robot=robot) == []
    assert said(clearance(0.2, way, block("in", (0.5, 0.6), (0.34, 0.5)), robot=robot)) == [
        ("transit", ("limb", "in"), "motion 0: limb is 10.00 mm inside in")
    ]
    (near,) = clearance(0.2, way, block("near", (0.5, 0.6), (0.2, 0.25)), robot=robot)
    assert near.bodies == ("palm", "near")


def test_what_is_held_keeps_away_from_links_that_do_not_hold_it() -> None:
    """The palm is 2 mm behind it; the fingers, that touch it, do not count."""
    it = Body("it", Box(np.array([0.04, 0.04, 0.02])), transform(p=[0, 0, 0.015]))
    palm = {"palm": solid((-0.03, 0.03), (-0.06, 0.06), (-0.06, 0.003)), **FINGERS}
    way = course((0, 0, 0, 0, 0.02), (0.5, 0, 0, 0, 0.02), stage="transfer", held=Held("it", it.T_world_body))
    found = clearance(0.005, way, it, robot=toy_robot(palm))
    assert said(found) == [("transfer", ("it", "palm"), "motion 0: it is 2.00 mm from palm, and the least is said to be 5.00 mm")]
    assert clearance(0.002, way, it, robot=toy_robot(palm)) == []
    wall = block("wall", (-0.5, 1.5), (0.021, 0.03), (0.0, 0.02))
    fingers = {name: corners + np.array([-3.0, 0, 0]) for name, corners in FINGERS.items()}
    found = clearance(0.005, way, it, robot=toy_robot({"palm": PALM["palm"], **fingers}), obstacles=[wall])
    assert said(found) == [("transfer", ("it", "wall"), "motion 0: it is 1.00 mm from wall, and the least is said to be 5.00 mm")]


def test_links_that_one_joint_moves_and_objects_named_like_pads_keep_away_too() -> None:
    wall, gone = block("left", (0.5, 0.6)), {name: corners + np.array([9.0, 0, 0]) for name, corners in {**PALM, **FINGERS}.items()}
    assert [f.bodies for f in clearance(0.005, course((0,), (0.467,)), wall)] == [("palm", "left")]
    rail = toy_robot({"rail": PALM["palm"], **gone})
    assert [f.bodies for f in clearance(0.005, course((0,), (0.467,)), wall, robot=rail)] == [("rail", "left")]


# ------------------------------------------------------------------------------------------------------------------ which samples are asked


def asked(distances: Mapping[int, float], first: int, last: int, apart_m: float = 0.0) -> list[int]:
    """Of two solids that go 1 m and 2 m a sample; to ask for a distance that is not given is an error."""
    gone = np.arange(9.0)[:, None] * [1.0, 2.0]
    samples = Sweep(np.arange(9.0), np.zeros((9, 2, 4, 4)), np.zeros((0, 4, 4)), np.zeros((2, 3)), np.zeros((2, 3)), gone)
    pair = _Asked(samples, [], np.array([0]), np.array([1]))
    pair.known.update({(0, n): d for n, d in distances.items()})
    return sorted(set(pair.nearer(0, first, last, apart_m)))


def test_the_search_goes_on_where_both_could_have_met() -> None:
    """Within 4 samples they go 12 m together."""
    assert asked({4: 6.1, 8: 6.0}, 4, 8) == asked({0: 6.0, 4: 6.1}, 0, 4) == []
    assert asked({4: 6.0, 8: 6.0, 6: 0.0}, 4, 8) == [6]
    assert asked({4: 5.75, 8: 6.25, 6: 0.25, 5: 0.0}, 4, 8) == [5]
    assert asked({4: 5.5, 8: 6.0, 6: 0.75}, 4, 8) == []
    assert asked({0: 0.1, 2: 0.1, 1: 0.0}, 0, 2) == [1]
    assert asked({0: 0.1, 1: 0.1}, 0, 1) == []


def test_the_search_ends_where_they_meet() -> None:
    assert asked({4: 0.0, 8: 1.0}, 4, 8) == [4]
    assert asked({4: 1.0, 8: 0.0}, 4, 8) == [8]
    assert asked({4: 0.0, 8: 0.0}, 4, 8) == [4, 8]
    assert asked({4: 0.5, 8: 1.0}, 4, 8, apart_m=0.5) == [4]
    assert asked({4: 1.0, 8: 0.5}, 4, 8, apart_m=0.5) == [8]
    assert asked({4: 6.6, 8: 6.5}, 4, 8, apart_m=0.5) == []


def test_who_is_at_hand() -> None:
    """What was put down last before a motion, and what is taken first after it."""
    carries = [
        Carry(name, first, last, *[np.eye(4)] * 4, np.zeros(5), True) for name, first, last in (("a", 1, 2), ("b", 4, 4), ("c", 6, 7))
    ]
    expected = {0: "a", 1: "b", 2: "b", 3: "ab", 4: "ac", 5: "bc", 6: "b", 7: "b", 8: "c"}
    assert {i: "".join(sorted(_at_hand(carries, i))) for i in range(9)} == expected


def test_one_fault_for_each_two_bodies() -> None:
    """The deepest, and the deepest first; what can't be measured last."""
    faults = [
        Fault("lift", bodies, "", amount)
        for bodies, amount in ((("a", "b"), 1.0), (("a", "c"), None), (("b", "a"), 3.0), (("c", "d"), 2.0))
    ]
    assert _deepest(faults) == [faults[2], faults[3], faults[1]]
    assert _deepest(faults[:2]) == _deepest(faults[1::-1]) == faults[:2]


# ------------------------------------------------------------------------------------------------------------------------------- distances


def test_distances_of_boxes() -> None:
    """A corner over the middle of a face, either way round, wherever both are; edges that cross; 0 where they touch."""
    (a,), (b,) = shape_solids("a", Box(np.array([0.4, 0.6, 0.2]))), shape_solids("b", Box(np.full(3, 0.2)))
    standing = rotation_about((1, -1, 0), np.arccos(1 / np.sqrt(3)))  # on a corner: √3 / 10 from the middle
    crossed = rotation_about((1, 0, 0), np.pi / 4)  # an edge along x, √2 / 10 below the middle
    rounded = rotation_about((0, 1, 0), np.pi / 4)
    for T in (np.eye(4), transform(rotation_about((1, 2, 3), 1.3), [1.0, -2.0, 3.0])):
        for d in (0.3, 0.05, 1e-4):
            a.move(T)
            b.move(T @ transform(standing, [0.05, 0.1, 0.1 + np.sqrt(3) / 10 + d]))
            for one, other in ((a, b), (b, a)):
                assert certified_distance(one, other) == pytest.approx(d, abs=1e-6)
                assert farthest_distance(one, other) == pytest.approx(d, abs=1e-6)
            a.move(T @ transform(rounded))  # its upper edge 0.3 √½ above its middle, along y
            for up, said_ in ((d, d), (-1e-3, 0.0)):
                b.move(T @ transform(crossed, [0.0, 0.0, 0.3 * np.sqrt(0.5) + 0.1 * np.sqrt(2) + up]))
                assert [certified_distance(a, b), certified_distance(b, a)] == pytest.approx([said_, said_], abs=1e-6)
