"""The subdivision that proofs rest on finds hands between others, and closes what none can take."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
import pytest
from turned_cabinet import CABINET, scene_of

from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, apply, rotation_about, transform
from planning.grasping.finger_grasps import open_width
from planning.grasping.hand_poses import hand_points, level_hand
from planning.motion.cell.workcell import QUICK_IK, IkSearch
from planning.motion.handling import neighbourhoods, subdivision
from planning.motion.handling.neighbourhoods import SQUARE, TURN_M
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.picking import Picking
from planning.motion.handling.shrunk_scene import shrunk, thinnest_allowed_m
from planning.motion.handling.subdivision import Access, HandSubdivision, SubdivisionView
from planning.motion.handling.ways import approachable
from planning.motion.pick_place import Motions
from planning.motion.search.reaching import APPROACH_M
from planning.motion.settings import DEFAULTS, UNCONSTRAINED
from planning.scenes.generation import generate, load_spec
from planning.verdict import judge_hold

UP = (0, 0, 1)


def test_what_is_stuck_is_so_by_what_stands_around_it(ur5e: Robot) -> None:
    """Three boxes of a shelf keep each other; what can be picked is free."""
    scene = generate(load_spec("shelf"), ur5e, to_ref(ur5e), 880011, 358)
    motions, stuck = Motions(ur5e, scene), frozenset({"box_0", "box_1", "box_4"})
    look = HandSubdivision(ur5e, scene, DEFAULTS, motions.cell).at(scene.poses())
    assert all(look.access(name, stuck - {name}).closed for name in stuck)
    pickable = [name for name in sorted(scene.poses()) if name != scene.target and motions.picks(motions.start(), name)[0]]
    assert pickable
    assert look.access(pickable[0], frozenset(scene.poses()) - {scene.target_name, pickable[0]}).hand is not None


def below_a_board(ur5e: Robot, height_m: float) -> Motions:
    """A box, and over it a board so low, in the middle, that level hands hardly fit between the two; the target is elsewhere."""
    box = Body("box", Box(np.array([0.05, 0.05, 0.10])), transform(p=[0.45, 0.0, 0.30]))
    can = Body("can", Cylinder(0.025, 0.12), transform(p=[0.60, 0.2, 0.31]))
    board = Body("board", Box(np.array([0.3, 0.3, 0.02])), transform(p=[0.45, 0.0, height_m]))
    cabinet = Cabinet(np.array([0.5, 0.9, 0.5]), transform(p=[0.3, 0.0, 0.25]), 0.03)
    ref = to_ref(ur5e)
    return Motions(ur5e, Scene("s", ref, cabinet, (box, can), "can", None, approaches=("horizontal",), obstacles=(board,)))


def test_a_hand_between_those_that_are_sampled_is_found_and_can_be_picked_with(ur5e: Robot) -> None:
    motions = below_a_board(ur5e, 0.4412)
    state, alone = motions.start(), frozenset[str]()
    assert not motions.exhaustive.obstructions(state.poses).free("box", alone)
    assert motions.finest is not None
    hand = motions.finest.at(state.poses).access("box", alone).hand
    assert hand is not None
    assert judge_hold(ur5e, motions.scene.body("box"), hand) is None
    there = motions.with_hands(state.poses, {"box": [hand]})
    picks, _ = there.picks(state, "box")
    assert {id(pick.grasp) for pick in picks} == {id(hand)}
    assert there.obstructions(state.poses).free("box", alone)
    assert not motions.exhaustive.obstructions(state.poses).free("box", alone)  # and nothing is changed there


def test_where_a_gap_is_too_narrow_all_along_it_that_is_certain_or_takes_too_long(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    motions = below_a_board(ur5e, 0.4408)
    assert motions.finest is not None
    look = motions.finest.at(motions.scene.poses())
    access = look.access("box", frozenset())
    assert (access.hand, access.closed) == (None, True)
    monkeypatch.setattr(motions.finest, "most_between", access.between // 2)
    doubtful = look.access("box", frozenset())
    assert (doubtful.hand, doubtful.closed) == (None, False)
    assert access.between // 2 <= doubtful.between < access.between


def test_so_much_inverse_kinematics_and_no_more(ur5e: Robot) -> None:
    def asked(share: float) -> tuple[Access, int]:
        finest = below_a_board(ur5e, 0.4408).finest
        assert finest is not None
        finest.most_starts = share * starts
        return finest.at(scene.poses()).access("box", frozenset()), finest.ik_starts()

    scene, starts = below_a_board(ur5e, 0.4408).scene, math.inf
    access, starts = asked(1.0)
    assert access.closed
    assert starts > 0
    assert asked(1.01) == (access, starts)
    fewer, of_it = asked(0.9)
    assert (fewer.hand, fewer.closed) == (None, False)
    assert 0.9 * starts <= of_it < starts
    assert fewer.between < access.between
    at_once, of_it = asked(0.01)
    assert (at_once.closed, at_once.between) == (False, 0)
    assert 0.01 * starts <= of_it < 0.9 * starts


def test_an_arm_for_which_each_hand_takes_long_is_asked_about_fewer(ur5e: Robot) -> None:
    of_each = list[tuple[int, float]]()
    for robot in (ur5e, load("panda")):
        finest = Motions(robot, generate(load_spec("paper"), robot, to_ref(robot), 5, 0)).finest
        assert finest is not None
        of_each.append((finest.most_between, finest.most_starts))
    assert of_each == [(10_000, math.inf), (3_000, 10_000_000)]


def test_where_too_many_hands_of_the_first_level_are_open_no_more_are_looked_at(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    motions, asked = below_a_board(ur5e, 0.4408), [0]
    assert motions.finest is not None
    usual = SubdivisionView._open
    monkeypatch.setattr(subdivision, "AT_ONCE", 8)

    def counted(*args: Any) -> list[tuple[Grasp, int]]:
        asked[-1] += len(args[1]) * (args[2] == 0)
        return usual(*args)

    monkeypatch.setattr(SubdivisionView, "_open", lambda *args: counted(*args))
    look = motions.finest.at(motions.scene.poses())
    assert look.access("box", frozenset()).closed
    every = asked[-1]
    asked[-1] = 0
    monkeypatch.setattr(motions.finest, "most_between", 0)
    access = look.access("box", frozenset())
    assert (access.hand, access.closed, access.between) == (None, False, 0)
    assert 0 < asked[-1] < every


def ahead_of_it(hands: Iterable[Grasp]) -> Array:
    """Where those of some hands are (N, 4, 4) that look along a yaw of about 0.4, or against it."""
    co, si = np.cos(0.4), np.sin(0.4)
    return np.array([T for T in (hand.T_world_hand for hand in hands) if abs(si * T[0, 1] - co * T[1, 1]) > 0.98])


@pytest.mark.parametrize("shape", [Cylinder(0.025, 0.05), Box(np.array([0.05, 0.06, 0.08]))], ids=["can", "box"])
def test_one_of_the_hands_that_are_looked_at_first_stands_for_any_that_holds(
    ur5e: Robot, shape: Box | Cylinder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hands drawn at random, of all pitches, that hold an object by the verdict: no point of one is further off than the room there is."""
    monkeypatch.setattr(neighbourhoods, "TURN_M", 0.010)  # fewer, further apart
    body, rng = Body("it", shape, transform(rotation_about(UP, 0.4), [0.5, 0.1, 0.26])), np.random.default_rng(3)
    scene = replace(scene_of(body), cabinet=replace(CABINET, wall_m=0.06), approaches=("horizontal", "diagonal", "downward"))
    look = HandSubdivision(ur5e, scene, DEFAULTS, Motions(ur5e, scene).cell)
    first = [(ahead_of_it(hands), levels[0].room_m) for hands, levels in look.first_hands("it", body.T_world_body)]
    held = 0
    for _ in range(300):
        pitch = float(rng.choice([0.0, np.pi / 2, rng.uniform(np.pi / 6, np.pi / 3), rng.uniform(np.pi / 6, np.pi / 3)]))
        side = 0.4 if isinstance(shape, Box) else 0.4 + rng.uniform(-0.1, 0.1)
        width = shape.size_m[1] if isinstance(shape, Box) else 2 * shape.radius_m
        ahead = np.array([np.cos(side), np.sin(side), 0.0])
        R, at = level_hand(ahead, pitch), rng.uniform(-0.05, 0.05, 2)
        pads = body.T_world_body[:3, 3] + at[0] * ahead + at[1] * np.array(UP, float)
        hand = Grasp(transform(R, ur5e.opening.hand_position(pads, R, float(width))), float(width))
        if judge_hold(ur5e, body, hand) is not None:
            continue
        held += 1
        points = np.array([[x, y, z, 1.0] for x in (-0.04, 0.04) for y in (-0.06, 0.06) for z in (-0.05, 0.15)])
        there = points @ hand.T_world_hand.T
        off = [np.linalg.norm(points @ T.transpose(0, 2, 1) - there, axis=2).max(1).min() - room_m for T, room_m in first]
        assert min(off) <= 1e-9, (pitch, at)
    assert held > 40


def test_no_point_of_a_hand_on_its_way_is_further_off_than_is_reckoned_with(ur5e: Robot) -> None:
    """Of all hands that are looked at first on a can: from its middle, level, and from the pads' middle, before the hand goes ahead."""
    can = Body("can", Cylinder(0.028, 0.12), transform(p=[0.5, 0.1, 0.26]))
    scene = replace(scene_of(can), approaches=("horizontal", "diagonal", "downward"))
    look = HandSubdivision(ur5e, scene, DEFAULTS, Motions(ur5e, scene).cell)
    points = hand_points(ur5e, open_width(2 * 0.028, ur5e.opening), ur5e.hand_links)
    for hands, levels in look.first_hands("can", can.T_world_body):
        reach_m = levels[0].reach_m
        assert reach_m < 0.35  # or proofs would take long
        for hand in islice(hands, 0, None, 997):
            back = hand.T_world_hand @ transform(p=[0.0, 0.0, -APPROACH_M])
            pads = apply(hand.T_world_hand, ur5e.opening.middle(hand.width_m))
            assert np.hypot(*(apply(back, points)[:, :2] - can.T_world_body[:2, 3]).T).max() <= reach_m
            assert np.linalg.norm(apply(back, points) - pads, axis=1).max() <= reach_m


def test_hands_judged_together_are_those_that_picks_judge_one_by_one(ur5e: Robot) -> None:
    """To what stands in a cabinet, with and without what is around it: the others are blocked before or while they come."""
    scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 7, 1)
    cell, poses, let = Motions(ur5e, scene).cell, scene.poses(), list[bool]()
    for name in sorted(poses)[:4]:
        hands = list(islice(sampled_grasps(ur5e, scene, name, poses[name]), 0, 200, 5))
        for others in ({scene.target_name}, {*poses}):
            here = {other: T for other, T in poses.items() if other in {name, *others}}
            together = approachable(cell, hands, here, [IkSearch(1), QUICK_IK])
            for hand in hands:
                picks, why = Picking(cell).picks_with([hand], here, cell.without(here, name), name, cell.home_arm)
                let.append(any(hand is other for other in together))
                assert let[-1] == bool(picks or why.stage in {"grasp", "lift"})
    assert 20 < sum(let) < len(let) - 20
    assert approachable(cell, [], here, [QUICK_IK]) == []


def test_hands_on_what_is_round_are_turned_less_where_walls_are_thin(ur5e: Robot) -> None:
    """So much that something is left of the walls with the most room."""
    can = Body("can", Cylinder(0.028, 0.05), CABINET.T_world_cabinet @ transform(p=[0.25, 0.0, 0.025]))  # hands on a low one are few
    box = Body("box", Box(np.array([0.05, 0.05, 0.12])), CABINET.T_world_cabinet @ transform(p=[0.25, 0.1, 0.06]))
    for wall_m, turn_m in ((0.03, TURN_M), (0.012, 0.005 - SQUARE.room_m), (thinnest_allowed_m(scene_of(can)), 0.001)):
        scene = scene_of(can, box)
        scene = replace(scene, cabinet=replace(scene.cabinet, wall_m=wall_m))
        look = HandSubdivision(ur5e, scene, DEFAULTS, Motions(ur5e, scene).cell)
        around = look.levels("can")[0]
        assert around.turn * around.reach_m == pytest.approx(turn_m)
        assert shrunk(scene, around.room_m).cabinet.wall_m >= 0.00199
        assert look.levels("box")[0] == SQUARE
        ((hands, _),) = look.first_hands("can", can.T_world_body)
        yaws = {round(float(np.arctan2(*hand.T_world_hand[:2, 1])), 6) for hand in hands}
        assert np.diff(sorted(yaws)).max() <= 2 * around.turn + 1e-5


def test_a_hand_between_two_that_look_other_ways_is_found(ur5e: Robot) -> None:
    """The can of a scene whose proof was attacked: hands 5° apart all met the box before it or the wall beside it, one at 8.2° did not."""
    cabinet = Cabinet(np.array([0.5, 0.5, 0.34]), transform(p=[0.3, 0.0, 0.1]), 0.03)
    can = Body(
        "can", Cylinder(0.02793179768631479, 0.10463574820296503), transform(p=[0.5178734479188796, -0.16133661066071814, 0.15231787])
    )
    box = Body("box", Box(np.array([0.0621069492504935, 0.06551186276054585, 0.09078891632331366])),
               transform(rotation_about(UP, -0.0275087), [0.5128293146425514, -0.06325981982006029, 0.14539445816165683]))  # fmt: skip
    before = Body("before", Box(np.array([0.058609763026097494, 0.05999850461071113, 0.15583526004155146])),
                  transform(rotation_about(UP, -1.45538), [0.3855111845458461, -0.07737486998861734, 0.17791763002077574]))  # fmt: skip
    target = Body("target", Box(np.array([0.04, 0.05, 0.15])), transform(p=[0.63, 0.1, 0.175]))
    scene = Scene("s", to_ref(ur5e), cabinet, (can, box, before, target), "target", None, approaches=("horizontal",))
    motions, standing = Motions(ur5e, scene, settings=UNCONSTRAINED), frozenset({"box", "before"})
    assert not motions.exhaustive.obstructions(scene.poses()).free("can", standing)
    assert motions.finest is not None
    hand = motions.finest.at(scene.poses()).access("can", standing).hand
    assert hand is not None
    assert judge_hold(ur5e, can, hand) is None


def test_an_arm_of_seven_joints_may_reach_a_hand_in_a_way_that_is_seldom_found() -> None:
    """The box of a scene whose proof was attacked: of its few usual solutions none can be used, of some dozen one can."""
    panda = load("panda")
    cabinet = Cabinet(np.array([0.5, 0.5, 0.34]), transform(p=[0.3, 0.0, 0.1]), 0.03)
    can = Body(
        "can", Cylinder(0.0292410216983601, 0.1442633308368585), transform(p=[0.7241709817395936, 0.01751848409311499, 0.17213166541842925])
    )
    box = Body("box", Box(np.array([0.06751390802256921, 0.05552542663457224, 0.17816973002763042])),
               transform(rotation_about(UP, 1.512664), [0.6461611217408658, -0.0928001896136535, 0.18908486501381522]))  # fmt: skip
    scene = Scene("s", RobotRef(transform(p=[-0.12, 0.0, -0.15]), "panda"), cabinet, (can, box), "can", None, approaches=("horizontal",))
    motions, alone = Motions(panda, scene, settings=UNCONSTRAINED), frozenset[str]()
    assert not motions.exhaustive.obstructions(scene.poses()).free("box", alone)
    assert motions.finest is not None
    hand = motions.finest.at(scene.poses()).access("box", alone).hand
    assert hand is not None
    there = motions.with_hands(scene.poses(), {"box": [hand]})
    assert there.obstructions(scene.poses()).free("box", alone)
    assert there.picks(there.start(), "box")[0]
