"""Which objects rest on which, as the verdict has it: what bears another stays till that is gone, and what leans is put down nowhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, box_corners
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.io.plan_documents import plan_from_json, plan_to_json
from planning.motion.cell.supports import STRAIGHT, Supports, _alone_on_floor
from planning.motion.pick_place import Motions
from planning.plan import Blocked, Fault, Plan, Unsolvable
from planning.policies import make_policy
from planning.policies.unsolvable import Prover
from planning.retrieval import retrieve
from planning.verdict import judge
from planning.verdict.faults import Settings
from planning.verdict.judge import _standing
from planning.verdict.ledger import Carry, Ledger

AHEAD = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # the hand looks into the cabinet, its x up
CABINET = Cabinet(np.array([0.56, 0.86, 0.5]), transform(p=[0.3, 0.0, 0.1]), 0.03)
FLOOR_Z, GAP_M = 0.1, 0.0008
CUBE = Box(np.full(3, 0.06))


def standing(name: str, shape: Box | Cylinder, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Body:
    """Upright, its bottom z above the cabinet's floor."""
    return Body(name, shape, transform(rotation_about((0, 0, 1), yaw), [x, y, FLOOR_Z + z + shape.half[2]]))


def leaning(name: str, x: float, y: float, z: float, slope: float = np.radians(70)) -> Body:
    """A board behind x that stands on the floor and whose upper end is GAP_M behind x, z above the floor; slope: from the level."""
    thick, along, out = 0.01, np.array([-np.cos(slope), 0.0, np.sin(slope)]), np.array([np.sin(slope), 0.0, np.cos(slope)])
    length = z / np.sin(slope)
    foot = np.array([x + GAP_M + length * np.cos(slope), y, FLOOR_Z])
    R = np.stack([along, np.cross(out, along), out], -1)
    return Body(name, Box(np.array([length, 0.05, thick])), transform(R, foot + along * length / 2 + out * thick / 2))


def scene_of(*objects: Body, obstacles: tuple[Body, ...] = (), target: str = "target") -> Scene:
    return Scene("rests", RobotRef(np.eye(4), "ur5e"), CABINET, objects, target, None, obstacles=obstacles)


def kept(scene: Scene) -> dict[str, tuple[str, str | None, str | None]]:
    found = {b.name: Supports(scene).kept(b.name, scene.poses()) for b in scene.objects}
    return {name: (why.stage, why.body, why.detail) for name, why in found.items() if why is not None}


def rests_on(upper: str, lower: str) -> tuple[str, str, str]:
    return "grasp", upper, f"{upper} rests on {lower} and goes first"


TARGET = standing("target", CUBE, 0.7, -0.3)
LOW = standing("low", CUBE, 0.5, 0.1)
TOP = standing("top", Cylinder(0.02, 0.05), 0.5, 0.1, 0.06 + GAP_M)


def test_what_stands_on_the_floor_waits_for_nothing() -> None:
    scene = scene_of(TARGET, LOW, standing("over_the_edge", CUBE, 0.31, 0.3), standing("lying", Cylinder(0.03, 0.1), 0.6, 0.3))
    assert kept(scene) == {}
    assert Supports(scene).waiting(scene.poses()) == {}


def test_a_stack_is_taken_from_above() -> None:
    """Three high, and on a plate of 5 mm; once the top was moved what was below it is free."""
    plate, middle = standing("plate", Box(np.array([0.1, 0.1, 0.005])), 0.5, 0.1), standing("low", CUBE, 0.5, 0.1, 0.005 + GAP_M)
    top = standing("top", Cylinder(0.02, 0.05), 0.5, 0.1, 0.065 + 2 * GAP_M)
    scene = scene_of(TARGET, plate, middle, top)
    assert kept(scene) == {"plate": rests_on("low", "plate"), "low": rests_on("top", "low")}
    supports, moved = Supports(scene), {**scene.poses(), "top": transform(p=[0.4, 0.0, FLOOR_Z + 0.025])}
    assert supports.waiting(scene.poses()) == {"plate": {"low"}, "low": {"top"}}
    assert supports.kept("low", moved) is None
    assert supports.waiting(moved) == {"plate": {"low"}}
    gone = {name: T for name, T in scene.poses().items() if name in ("plate", "target")}
    assert supports.waiting(gone) == {}


def test_the_target_waits_as_well() -> None:
    assert kept(scene_of(LOW, TOP, target="low")) == {"low": rests_on("top", "low")}
    scene = scene_of(LOW, TOP, target="top")
    assert Supports(scene).waiting(scene.poses()) == {"low": {"top"}}


def test_what_rests_on_several_waits_for_the_last_of_them() -> None:
    """A plank on three cubes lies on any two that have its middle between them; a moved cube bears nothing. None of them has room to be
    lifted, though."""
    cubes = [standing(f"cube_{i}", CUBE, 0.5, y) for i, y in enumerate((-0.15, 0.0, 0.15))]
    plank = standing("plank", Box(np.array([0.05, 0.4, 0.01])), 0.5, 0.0, 0.06 + GAP_M)
    scene = scene_of(TARGET, *cubes, plank)
    supports, poses = Supports(scene), scene.poses()
    assert all(supports.resting_on(cube.name, poses) == () for cube in cubes)
    assert supports.waiting(poses) == {cube.name: {"plank"} for cube in cubes}
    poses["cube_1"] = transform(p=[0.5, 0.3, FLOOR_Z + 0.03])
    assert [supports.resting_on(cube.name, poses) for cube in cubes] == [("plank",), (), ("plank",)]
    assert supports.waiting(poses) == {"cube_0": {"plank"}, "cube_2": {"plank"}}


def test_what_stands_under_a_board_bears_nothing_on_it() -> None:
    """The things on the shelf begin 17 mm above what is under it, which has no room to be lifted."""
    board = Body("board", Box(np.array([0.3, 0.8, 0.01])), transform(p=[0.6, 0.0, FLOOR_Z + 0.07]))
    scene = scene_of(TARGET, LOW, standing("on_it", CUBE, 0.5, 0.1, 0.075 + GAP_M), obstacles=(board,))
    assert all(Supports(scene).resting_on(body.name, scene.poses()) == () for body in scene.objects)
    words = "{} has no room above, whatever hand takes it"
    assert kept(scene) == {name: ("lift", "board", words.format(name)) for name in ("target", "low")}


def test_what_lies_in_a_tray_goes_before_it() -> None:
    """It begins far below the tray's rim."""
    sides = [(0.2, 0.2, 0.01, 0.0, 0.0, 0.005)] + [(0.01, 0.2, 0.05, x, 0.0, 0.025) for x in (-0.095, 0.095)]
    sides += [(0.2, 0.01, 0.05, 0.0, y, 0.025) for y in (-0.095, 0.095)]
    tray = ConvexMesh(tuple(box_corners(np.array(s[:3]) / 2) + s[3:] for s in sides))
    body = Body("tray", tray, transform(p=[0.55, 0.1, FLOOR_Z]))
    assert kept(scene_of(TARGET, body, standing("top", CUBE, 0.55, 0.1, 0.01 + GAP_M))) == {"tray": rests_on("top", "tray")}


def test_what_leans_is_put_down_nowhere_and_what_it_leans_on_stays() -> None:
    board = leaning("board", 0.53, 0.1, 0.05)
    scene = scene_of(TARGET, LOW, board)
    words = "board leans on low, and would stand nowhere else as it is turned"
    assert kept(scene) == {"low": rests_on("board", "low"), "board": ("release", "board", words)}
    assert Supports(scene).waiting(scene.poses()) == {"low": {"board"}, "board": {"target"}}
    assert Supports(scene).put_down_nowhere == {"board"}
    assert kept(replace(scene, target="board")) == {"low": rests_on("board", "low")}
    assert Supports(replace(scene, target="board")).put_down_nowhere == frozenset()
    wall = scene_of(TARGET, leaning("board", 0.86 - 0.2, 0.1, 0.05), obstacles=(standing("post", CUBE, 0.63, 0.1),))
    assert kept(wall) == {"board": ("release", "board", "board leans on post, and would stand nowhere else as it is turned")}


def test_what_leans_the_other_way_or_on_two() -> None:
    """A board turned about the upright axis through what it leans on; and one across two cubes."""
    about = transform(p=[0.5, 0.1, 0.0])
    board = leaning("board", 0.53, 0.1, 0.05)
    turned = replace(board, T_world_body=about @ transform(rotation_about((0, 0, 1), np.pi)) @ inverse(about) @ board.T_world_body)
    words = "board leans on low, and would stand nowhere else as it is turned"
    assert kept(scene_of(TARGET, LOW, turned)) == {"low": rests_on("board", "low"), "board": ("release", "board", words)}
    pair = [standing(name, CUBE, 0.5, y) for name, y in (("low", 0.065), ("other", 0.135))]
    assert kept(scene_of(TARGET, *pair, board))["board"][2] == words.replace("low", "low and other")


def test_what_would_stand_elsewhere_may_be_put_down() -> None:
    """A stack of three in the cabinet's corner: what is on top of it would stand on the floor."""
    low = standing("low", Box(np.array([0.08, 0.08, 0.3])), 0.81, -0.38)
    top = standing("top", Box(np.array([0.08, 0.08, 0.1])), 0.81, -0.38, 0.3 + GAP_M)
    assert Supports(scene_of(TARGET, low, top)).put_down_nowhere == frozenset()


def test_in_a_cabinet_that_is_turned_all_is_the_same() -> None:
    turn = transform(rotation_about((0, 0, 1), 0.5), [1.0, -2.0, 0.3])
    scene = scene_of(TARGET, LOW, TOP, leaning("board", 0.53, 0.1, 0.05))
    cabinet = replace(CABINET, T_world_cabinet=turn @ CABINET.T_world_cabinet)
    objects = tuple(replace(b, T_world_body=turn @ b.T_world_body) for b in scene.objects)
    assert kept(replace(scene, cabinet=cabinet, objects=objects)) == kept(scene) != {}


def test_what_counts_as_standing_is_the_verdicts_setting() -> None:
    high = replace(TOP, T_world_body=transform(p=[0, 0, 0.01]) @ TOP.T_world_body)
    scene = scene_of(TARGET, LOW, high)
    assert Supports(scene).resting_on("low", scene.poses()) == ()
    assert Supports(scene, Settings(stands_m=0.015)).resting_on("low", scene.poses()) == ("top",)


def test_what_hangs_in_the_air_once_its_support_was_moved_rests_on_nothing() -> None:
    plate = standing("plate", Box(np.array([0.1, 0.1, 0.005])), 0.5, 0.1)
    low, top = standing("low", CUBE, 0.5, 0.1, 0.005 + GAP_M), standing("top", Cylinder(0.02, 0.05), 0.5, 0.1, 0.065 + 2 * GAP_M)
    scene = scene_of(TARGET, plate, low, top)
    for low_at in ({}, {"low": transform(p=[0.7, 0.3, FLOOR_Z + 0.03])}):
        poses = {name: T for name, T in scene.poses().items() if name != "low"} | low_at
        assert Supports(scene).waiting(poses) == {}


def test_what_is_too_heavy_stays() -> None:
    """It waits for the target, besides what goes before it; where all stands on the floor as well."""
    for objects, waiting in (((TARGET, LOW), {"low": {"target"}}), ((TARGET, LOW, TOP), {"low": {"top", "target"}})):
        scene = scene_of(*(replace(b, mass_kg=2.0) if b.name == "low" else b for b in objects))
        scene = replace(scene, robot=replace(scene.robot, payload_kg=1.0))
        assert Supports(scene).waiting(scene.poses()) == waiting
        assert kept(scene) == {"low": ("lift", "low", "low weighs 2 kg, and the robot's payload is 1 kg")}
        assert kept(replace(scene, robot=replace(scene.robot, payload_kg=2.0))) == kept(scene_of(*objects))


@pytest.mark.parametrize("turn", [np.eye(4), transform(rotation_about((0, 0, 1), 0.5), [1.0, -2.0, 0.3])], ids=["here", "turned"])
def test_a_quick_look_tells_what_stands_alone(turn: Array) -> None:
    """A box 10 cm high whose outline lies in a circle of 5 cm: upright, near the floor, and the circle within the cabinet's 56 × 86 cm."""
    cabinet = replace(CABINET, T_world_cabinet=turn)

    def alone(x: float = 0.3, y: float = 0.0, z: float = 0.05, R: Array | None = None, shape: Box | Cylinder | None = None) -> bool:
        body = Body("it", shape or Box(np.array([0.06, 0.08, 0.1])), turn @ transform(np.eye(3) if R is None else R, [x, y, z]))
        found = _alone_on_floor(body, cabinet, 0.001)
        assert isinstance(found, bool)
        return found

    assert alone()
    assert alone(shape=Cylinder(0.035, 0.1))
    assert alone(R=rotation_about((0, 0, 1), 1.0))
    assert alone(R=rotation_about((1, 0, 0), np.pi))
    assert [alone(R=rotation_about((1, 0, 0), lean)) for lean in (1e-5, 1e-3, np.pi / 2)] == [True, False, False]
    assert [alone(z=0.05 + up) for up in (-0.0011, -0.0009, 0.0009, 0.0011)] == [False, True, True, False]
    assert [alone(x=x) for x in (0.0499, 0.0501, 0.5099, 0.5101)] == [False, True, True, False]
    assert [alone(y=y) for y in (-0.3801, -0.3799, 0.3799, 0.3801)] == [False, True, True, False]
    mesh = ConvexMesh((box_corners(np.array([0.03, 0.04, 0.05])),))
    assert _alone_on_floor(Body("it", mesh, turn @ transform(p=[0.3, 0.0, 0.05])), cabinet, 0.001) is False


def test_what_stands_just_so_stands_alone() -> None:
    """In the corner, to the last bit; and as upright as is asked."""
    cabinet = replace(CABINET, T_world_cabinet=np.eye(4))
    T = transform(p=[0.05, 0.86 / 2 - 0.05, 0.05])
    T[2, 2] = 1 - STRAIGHT
    for x in (0.05, 0.56 - 0.05):
        T[0, 3] = x
        assert _alone_on_floor(Body("it", Box(np.array([0.06, 0.08, 0.1])), T), cabinet, 0.0)


def test_it_agrees_with_the_verdict() -> None:
    """On heaps at random, from which one object is taken and comes nowhere."""
    rng, said = np.random.default_rng(45003), 0
    for _ in range(20):
        heap = [TARGET, *(standing(f"cube_{i}", CUBE, 0.5 + rng.uniform(-0.06, 0.06), 0.1 * i) for i in range(3))]
        for i in range(3):
            size = np.array([0.05, rng.uniform(0.03, 0.3), 0.04])
            heap.append(standing(f"on_{i}", Box(size), 0.5 + rng.uniform(-0.03, 0.03), rng.uniform(-0.02, 0.22), 0.06 + i * 0.0408 + GAP_M))
        heap.append(leaning("board", float(heap[1].T_world_body[0, 3]) + 0.03, 0.0, rng.uniform(0.04, 0.06)))
        scene = scene_of(*heap)
        supports, poses = Supports(scene), scene.poses()
        for name, T in poses.items():
            carry = Carry(name, 0, 0, T, T, np.eye(4), np.eye(4), np.zeros(1), False)
            faults = _standing(scene, Ledger((carry,), (), poses, ()), Settings())[0]
            fallen = [f.bodies[0] for f in faults if f.stage == "lift"]
            assert sorted(fallen) == sorted(supports.resting_on(name, poses)), (name, faults)
            said += len(fallen)
    assert said > 20


def planned(robot: Robot, scene: Scene, policy: str = "lookahead") -> Plan:
    motions = Motions(robot, scene)
    return retrieve(scene, make_policy(policy, motions), motions, name=policy, rng=np.random.default_rng(0))


def x_g(at: Array, height_m: float = 0.05) -> Grasp:
    return Grasp(transform(AHEAD, [*at[:2], FLOOR_Z + height_m]), 0.05)


CAN = Cylinder(0.025, 0.12)


@pytest.mark.parametrize("policy", ["lookahead", "local", "random"])
def test_a_target_that_bears_a_board_stays(ur5e: Robot, policy: str) -> None:
    """The hand could lift it as it is, and the board would fall: it was a plan that the verdict refused."""
    can = standing("target", CAN, 0.5, 0.0)
    scene = replace(scene_of(can, leaning("board", 0.525, 0.0, 0.09)), grasp=x_g(can.T_world_body[:3, 3]))
    plan = planned(ur5e, scene, policy)
    assert (plan.success, plan.motions) == (False, ())
    assert plan.target_blocked[0] == Blocked("grasp", body="board", detail="board rests on target and goes first")
    assert {str(move.reason) for move in plan.moves} <= {"release (board leans on target, and would stand nowhere else as it is turned)"}
    if policy == "lookahead":
        assert plan.unsolvable == Unsolvable(("board",), ("board taken away by hand",), ("board",))
        assert plan.reason == Blocked("unsolvable", body="board", detail="board leans on something and would stand nowhere else")
    else:
        assert plan.reason == plan.target_blocked[0]


def test_what_is_in_the_way_and_bears_another_goes_after_it(ur5e: Robot) -> None:
    """A can stands on the box before the target: two moves at least, and the verdict has nothing to say."""
    can, box = standing("target", CAN, 0.62, 0.0), standing("box", Box(np.array([0.06, 0.06, 0.12])), 0.5, 0.0)
    scene = scene_of(can, box, standing("top", Cylinder(0.025, 0.08), 0.5, 0.0, 0.12 + GAP_M))
    scene = replace(scene, grasp=x_g(can.T_world_body[:3, 3]), approaches=("horizontal",))
    plan = planned(ur5e, scene)
    assert plan.verified, plan.reason
    assert [move.object for move in plan.moves if move.done] == ["top", "box"]
    assert plan.least_moves == 2


def test_no_hand_is_sought_for_what_bears_others(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Were hands for it the matter, a proof would find them again and again."""
    can = standing("target", CAN, 0.62, 0.0)
    low = standing("low", Box(np.array([0.06, 0.06, 0.12])), 0.5, 0.0)
    board = leaning("board", 0.53, 0.0, 0.04)
    scene = replace(scene_of(can, low, board), grasp=x_g(can.T_world_body[:3, 3]), approaches=("horizontal",))
    motions = Motions(ur5e, scene)

    def never(*args: Any) -> None:
        raise AssertionError

    monkeypatch.setattr(Motions, "finest", property(never))
    found = Prover(motions)(motions.start())
    assert found.unsolvable is not None
    assert (found.unsolvable.stuck, found.unsolvable.leaning) == (("board", "low"), ("board",))
    assert found.unsolvable.words == (
        "none of board, low can be moved while the others of them stand: board leans on something and would stand nowhere else"
    )


def test_what_is_too_heavy_is_not_lifted(ur5e: Robot) -> None:
    """The target, for which nothing is tried then; what is in its way; and what may be lifted just so."""
    can, box = standing("target", CAN, 0.62, 0.0), standing("box", Box(np.array([0.06, 0.06, 0.12])), 0.5, 0.0)
    scene = replace(scene_of(can, box), grasp=x_g(can.T_world_body[:3, 3]), approaches=("horizontal",))
    scene = replace(scene, robot=replace(scene.robot, payload_kg=3.5))

    def weighing(name: str, kg: float) -> Scene:
        return replace(scene, objects=tuple(replace(b, mass_kg=kg) if b.name == name else b for b in scene.objects))

    heavy = planned(ur5e, weighing("target", 4.0), "random")
    assert (heavy.success, heavy.moves, heavy.motions) == (False, (), ())
    assert heavy.reason == Blocked("lift", body="target", detail="target weighs 4 kg, and the robot's payload is 3.5 kg")
    blocking = planned(ur5e, weighing("box", 4.0))
    words = "box can't be picked, even with nothing but the target beside it; box weighs 4 kg, and the robot's payload is 3.5 kg"
    assert blocking.reason is not None
    assert (blocking.reason.stage, blocking.reason.detail) == ("unsolvable", words)
    assert {str(m.reason) for m in planned(ur5e, weighing("box", 4.0), "random").moves} == {
        "lift (box weighs 4 kg, and the robot's payload is 3.5 kg)"
    }
    just = planned(ur5e, weighing("box", 3.5))
    assert just.verified, just.reason
    assert judge(weighing("box", 3.5), just, ur5e) == ()
    (fault,) = judge(weighing("box", 3.51), just, ur5e)
    assert fault == Fault("lift", ("box",), "box weighs 3.51 kg, and the robot's payload is 3.5 kg")
    unknown = weighing("box", 3.51)
    assert judge(replace(unknown, robot=replace(unknown.robot, payload_kg=None)), just, ur5e) == ()


def test_what_has_no_room_to_be_lifted_stays_without_a_look_at_its_grasps(ur5e: Robot) -> None:
    """Cans under a board, 15 mm below it; what was moved from under it may be lifted, and what was moved under it was put down there."""
    can, tall = standing("target", CAN, 0.62, 0.0), Cylinder(0.025, 0.24)
    cans = [standing(f"can_{i}", tall, 0.5, y) for i, y in enumerate(np.linspace(-0.4, 0.4, 9))]
    board = Body("board", Box(np.array([0.1, 0.86, 0.01])), transform(p=[0.5, 0.0, FLOOR_Z + tall.height_m + 0.02]))
    scene = replace(scene_of(can, *cans, obstacles=(board,)), grasp=x_g(can.T_world_body[:3, 3]), approaches=("horizontal",))
    motions = Motions(ur5e, scene)
    found = Prover(motions)(motions.start())
    assert found.unsolvable is not None
    stuck = tuple(sorted(body.name for body in cans))
    assert (found.unsolvable.stuck, found.unsolvable.lifted_into) == (stuck, tuple((name, "board") for name in stuck))
    assert found.unsolvable.words == (
        f"none of {', '.join(stuck)} can be moved while the others of them stand: {', '.join(stuck)} would meet board when lifted"
    )
    supports, poses = motions.supports, scene.poses()
    assert supports.lifted_into("can_4", poses) == ("board",)
    assert supports.lifted_into("can_4", {**poses, "can_4": transform(p=[0.4, 0.0, FLOOR_Z + 0.06])}) == ()
    assert supports.lifted_into("target", {**poses, "target": can.T_world_body @ transform(p=[-0.2, 0.0, 0.0])}) == ()
    plan = planned(ur5e, scene)
    assert plan.reason == Blocked("unsolvable", plan.target_blocked[0].link, plan.target_blocked[0].body, detail=found.unsolvable.words)
    assert plan_from_json(plan_to_json(plan)).unsolvable == found.unsolvable
