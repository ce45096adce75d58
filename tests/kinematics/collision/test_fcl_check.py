"""FCL's verdict: who touches whom and how deep, on scenes made for it, and the same as coal's in clutter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from second_engine import Arm, body_solid
from second_engine import depth as depth_of_coal
from second_engine import walls as walls_of_coal

from kinematics.collision.fcl_check import Verdict
from kinematics.collision.fcl_solids import (
    Contact,
    Solid,
    always_touching,
    apart,
    depth,
    gap,
    hull_solid,
    near_pairs,
    overlapping,
    shape_solids,
    touch,
)
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, Held, RobotRef, Scene, State
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners, prism
from kinematics.transforms import Array, rotation_about, transform

FAR = Cabinet(np.array([0.5, 0.5, 0.5]), transform(p=[9.0, 0.0, 0.0]), 0.03)
HOME = np.array([0.0, 0.1, 0.1, 0.03])  # the toy's joints: turn, up, out, grip


@pytest.fixture
def toy(toy_urdf: Callable[..., Path]) -> Robot:
    return load(str(toy_urdf()), "tcp", "grip")


def scene_of(robot: Robot, *bodies: Body, cabinet: Cabinet = FAR, T_world_base: Array | None = None) -> Scene:
    ref = RobotRef(np.eye(4) if T_world_base is None else T_world_base, robot.name)
    return Scene("test", ref, cabinet, bodies, "target", Grasp(np.eye(4), 0.05))


def contacts(robot: Robot, scene: Scene, state: State | None = None, *allowed_contacts: tuple[str, str]) -> dict[tuple[str, str], float]:
    state = State(HOME, scene.poses()) if state is None else state
    return {(c.a, c.b): c.depth_m for c in Verdict(robot, scene).contacts(state, allowed_contacts)}


def at(robot: Robot, link: str, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """A pose with a link's orientation at an offset (3,) in the link's frame."""
    return robot.link_poses(HOME)[link] @ transform(p=offset)


def test_nothing_touches_at_rest(toy: Robot) -> None:
    assert contacts(toy, scene_of(toy)) == {}


def test_a_finger_in_a_box_and_how_deep(toy: Robot) -> None:
    """The finger's end is 35 mm out; a box with its face 31 mm out is entered by 4 mm."""
    box = Body("box", Box(np.array([0.05, 0.05, 0.04])), at(toy, "left_finger", (0, 0, 0.031 + 0.02)))
    found = contacts(toy, scene_of(toy, box))
    assert found == {("left_finger", "box"): pytest.approx(0.004, abs=1e-6)}
    assert contacts(toy, scene_of(toy, box), None, ("left_finger", "box")) == {}
    assert contacts(toy, scene_of(toy, box), None, ("box", "left_finger")) == {}
    assert contacts(toy, scene_of(toy, box), None, ("right_finger", "box")) == found


def test_a_hair_apart_is_free(toy: Robot) -> None:
    box = Body("box", Box(np.array([0.05, 0.05, 0.04])), at(toy, "left_finger", (0, 0, 0.0351 + 0.02)))
    assert contacts(toy, scene_of(toy, box)) == {}


@pytest.mark.parametrize(
    "shape",
    [Box(np.array([0.01, 0.01, 0.01])), Cylinder(0.005, 0.01), ConvexMesh((box_corners(np.full(3, 0.005)), prism(0.004, 0.02)))],
    ids=["box", "cylinder", "mesh"],
)
def test_a_body_wholly_inside_a_link_is_found(toy: Robot, shape: Shape) -> None:
    """FCL's meshes are surfaces and would say that nothing touches: every solid must be convex."""
    found = contacts(toy, scene_of(toy, Body("crumb", shape, at(toy, "post", (0.0, 0.0, 0.2)))))
    assert found == {("post", "crumb"): pytest.approx(0.035, abs=0.003)}


def test_a_link_wholly_inside_a_body_is_found(toy: Robot) -> None:
    found = contacts(toy, scene_of(toy, Body("block", Cylinder(0.06, 0.3), at(toy, "left_finger", (0.0, 0.0, 0.1)))))
    assert ("left_finger", "block") in found


def test_the_hand_in_a_wall(toy: Robot) -> None:
    """The cabinet's left wall is where the left finger is: its inner face 2 mm inside the finger's outer one."""
    outer = at(toy, "left_finger")[1, 3] + 0.005
    cabinet = Cabinet(np.array([0.6, 0.4, 0.8]), transform(p=[0.2, outer - 0.002 - 0.2, 0.0]), 0.03)
    found = contacts(toy, scene_of(toy, cabinet=cabinet))
    assert found[("left_finger", "left")] == pytest.approx(0.002, abs=1e-6)
    assert {wall for _, wall in found} == {"left"}
    assert contacts(toy, scene_of(toy, cabinet=cabinet), None, *((link, "left") for link, _ in found)) == {}


def test_the_base_may_stand_anywhere(toy: Robot) -> None:
    T = transform(rotation_about((1, 1, 0), 0.5), [3.0, 2.0, 1.0])
    box = Body("box", Box(np.array([0.05, 0.05, 0.04])), T @ at(toy, "left_finger", (0, 0, 0.031 + 0.02)))
    found = contacts(toy, scene_of(toy, box, T_world_base=T))
    assert found == {("left_finger", "box"): pytest.approx(0.004, abs=1e-6)}


def test_the_held_object_is_part_of_the_state(toy: Robot) -> None:
    """A bar in the hand touches the other bar, the wall and the arm, and is not in its old place any more."""
    bar = Body("bar", Box(np.array([0.02, 0.05, 0.02])), at(toy, "post", (0.0, 0.0, 0.2)))
    other = Body("other", Box(np.array([0.1, 0.1, 0.1])), at(toy, "hand", (0.0, 0.0, 0.07)))  # 20 mm before the hand
    scene = scene_of(toy, bar, other)

    def found(z: float, *may: tuple[str, str]) -> dict[tuple[str, str], float]:
        return contacts(toy, scene, State(HOME, {"other": other.T_world_body}, Held("bar", transform(p=[0, 0, z]))), *may)

    assert found(0.0) == {}  # the fingers are 60 mm apart
    assert found(0.012) == {("bar", "other"): pytest.approx(0.002, abs=1e-6)}
    assert found(0.012, ("other", "bar")) == {}
    scene = scene_of(toy, replace(bar, shape=Box(np.array([0.02, 0.09, 0.02]))), other)  # the fingers end 15 mm before the hand
    assert found(0.018) == {
        ("bar", "other"): pytest.approx(0.008, abs=1e-6),
        ("bar", "left_finger"): pytest.approx(0.007, abs=1e-6),
        ("bar", "right_finger"): pytest.approx(0.007, abs=1e-6),
    }
    assert set(found(-0.07, ("bar", "left_finger"), ("bar", "right_finger"))) == {("bar", "palm")}


def test_the_held_object_and_the_walls(toy: Robot) -> None:
    bar = Body("bar", Cylinder(0.02, 0.1), transform())
    low = at(toy, "hand")[2, 3] - 0.05  # the hand's x points down, a cylinder's axis is turned to it
    cabinet = Cabinet(np.array([0.6, 0.8, 0.8]), transform(p=[0.2, 0.0, low + 0.003]), 0.03)
    upright = transform(rotation_about((0, 1, 0), np.pi / 2))
    state = State(HOME, {}, Held("bar", upright))
    found = contacts(toy, scene_of(toy, bar, cabinet=cabinet), state, ("bar", "left_finger"), ("bar", "right_finger"))
    assert found == {("bar", "floor"): pytest.approx(0.003, abs=1e-6)}


def test_pairs_that_touch_are_near_and_far_ones_are_not() -> None:
    rng, solids, far = np.random.default_rng(3), list[Solid](), 0
    for n in range(60):
        shape = Box(rng.uniform(0.03, 0.15, 3)) if n % 2 else Cylinder(float(rng.uniform(0.02, 0.06)), float(rng.uniform(0.05, 0.2)))
        T = transform(rotation_about(rng.normal(size=3), float(rng.uniform(0, 3))), rng.uniform(-0.3, 0.3, 3))
        solids += [s.move(T) for s in shape_solids(f"{n}", shape)]
    some, others = solids[:30], solids[30:]
    near = near_pairs(some, others)
    for i, a in enumerate(some):
        for j, b in enumerate(others):
            if [i, j] not in near:
                assert touch(a, b) is None
                far += 1
    assert near == sorted(near)
    assert far > 500  # of 900


def test_standing_objects_are_none_of_its_business(toy: Robot) -> None:
    a = Body("a", Box(np.full(3, 0.1)), transform(p=[2.0, 0.0, 0.0]))
    b = Body("b", Cylinder(0.1, 0.1), transform(p=[2.05, 0.0, 0.0]))
    assert contacts(toy, scene_of(toy, a, b)) == {}
    deep = overlapping([a, b])
    assert [(c.a, c.b) for c in deep] == [("a", "b")]
    assert deep[0].depth_m == pytest.approx(0.1, abs=0.001)
    assert overlapping([a, replace(b, T_world_body=transform(p=[2.1495, 0.0, 0.0]))]) == []  # half a millimetre is forgiven
    assert len(overlapping([a, replace(b, T_world_body=transform(p=[2.1495, 0.0, 0.0]))], 0.0001)) == 1


def test_deepest_contact_comes_first(toy: Robot) -> None:
    bodies = [
        Body(f"b{i}", Box(np.full(3, 0.02)), at(toy, "post", (0.0, 0.03 + 0.01 - d, 0.3))) for i, d in enumerate((0.001, 0.006, 0.003))
    ]
    found = Verdict(toy, scene_of(toy, *bodies)).contacts(State(HOME, {b.name: b.T_world_body for b in bodies}))
    assert [c.b for c in found] == ["b1", "b2", "b0"]
    assert [c.depth_m for c in found] == pytest.approx([0.006, 0.003, 0.001], abs=1e-6)


def test_a_verdict_can_be_asked_again(toy: Robot) -> None:
    box = Body("box", Box(np.array([0.05, 0.05, 0.04])), at(toy, "left_finger", (0, 0, 0.031 + 0.02)))
    verdict = Verdict(toy, scene_of(toy, box))
    hit, free = State(HOME, {"box": box.T_world_body}), State(HOME - np.array([0, 0, 0.1, 0]), {"box": box.T_world_body})
    answers = [verdict.contacts(s) for s in (hit, free, hit, free)]
    assert answers == [answers[0], [], answers[0], []]
    assert answers[0] == [Contact("left_finger", "box", answers[0][0].depth_m)]


def test_the_first_of_many_configurations_that_touches(toy: Robot) -> None:
    """The arm reaches out step by step, until a finger is in the box."""
    box = Body("box", Box(np.array([0.05, 0.05, 0.04])), at(toy, "left_finger", (0, 0, 0.0351 + 0.02)))
    verdict, q = Verdict(toy, scene_of(toy, box)), np.linspace(HOME - np.array([0, 0, 0.05, 0]), HOME + np.array([0, 0, 0.05, 0]), 11)
    found = verdict.first_contacts(q, {"box": box.T_world_body})
    assert found is not None
    assert (found[0], [(c.a, c.b) for c in found[1]]) == (6, [("left_finger", "box")])
    assert found[1][0].depth_m == pytest.approx(0.0099, abs=1e-6)
    assert verdict.first_contacts(q[:6], {"box": box.T_world_body}) is None
    assert verdict.first_contacts(q, {"box": box.T_world_body}, allowed_contacts=[("left_finger", "box")]) is None


def test_an_arm_folded_into_itself(ur5e: Robot) -> None:
    q = ur5e.home.copy()
    q[list(ur5e.arm_joints)] = [0.0, -1.5, 2.9, 0.0, 0.0, 0.0]
    found = contacts(ur5e, scene_of(ur5e), State(q, {}))
    assert found
    assert all({a, b} <= {h.link for h in ur5e.hulls} for a, b in found)


# ------------------------------------------------------------------------------------------------------------ links that always touch


def test_links_that_always_touch(toy: Robot) -> None:
    """Neighbours aside, only what touches nearly always counts, not what touches often."""
    hulls = [h for h in toy.hulls if h.link in ("base", "post", "sled", "palm")]
    near, far = {h.link: transform() for h in hulls}, {h.link: transform(p=[i, 0, 0]) for i, h in enumerate(hulls)}
    half = {**far, "post": far["base"]}
    assert always_touching(hulls, [half] * 19 + [far], set()) == {frozenset(("base", "post"))}
    assert always_touching(hulls, [half] * 18 + [far] * 2, set()) == set()
    assert always_touching(hulls, [half] * 20, {frozenset(("base", "post"))}) == set()
    assert len(always_touching(hulls, [near] * 3, set())) == 6


def test_named_robots_skip_their_neighbours(robot: Robot) -> None:
    for i, name in enumerate(robot.tree.names):
        above = robot.tree.names[robot.tree.parent[i]]
        solid = {h.link for h in robot.hulls}
        if i and {name, above} <= solid:
            assert frozenset((name, above)) in robot.skip
    pairs = {frozenset((robot.hulls[i].link, robot.hulls[j].link)) for i, j in robot.self_pairs}
    assert not pairs & robot.skip
    assert not any(pair <= robot.fingers for pair in pairs)


# ----------------------------------------------------------------------------------------------------------------------- against coal


def test_the_same_as_coal_in_clutter(ur5e: Robot, ur5e_urdf: Path) -> None:
    """Random configurations among bodies of every kind: pinocchio and coal find the same pairs, as deep but where two edges meet."""
    rng = np.random.default_rng(3)
    cabinet = Cabinet(np.array([0.56, 0.86, 0.5]), transform(p=[0.3, 0.0, 0.1]), 0.03)
    shapes: list[Shape] = [Box(np.array([0.05, 0.08, 0.2])), Cylinder(0.04, 0.2)]
    bodies = [
        Body(f"b{i}", shapes[i % 2], transform(rotation_about(rng.normal(size=3), 2.0), rng.uniform([0.3, -0.4, 0.1], [0.8, 0.4, 0.5])))
        for i in range(12)
    ]
    scene = scene_of(ur5e, *bodies, cabinet=cabinet)
    scene = replace(scene, robot=replace(scene.robot, mount=False))  # coal is asked about walls and objects alone
    verdict, arm = Verdict(ur5e, scene), Arm(ur5e_urdf.read_text())
    around = walls_of_coal({"size_m": [0.56, 0.86, 0.5], "wall_m": 0.03, "T_world_cabinet": {"p": [0.3, 0, 0.1], "q_wxyz": [1, 0, 0, 0]}})
    entries = [{"type": "box", "size_m": [0.05, 0.08, 0.2]}, {"type": "cylinder", "radius_m": 0.04, "height_m": 0.2}]
    around += [(body_solid({"name": b.name, "shape": entries[i % 2]}, Path()), b.T_world_body) for i, b in enumerate(bodies)]
    round_links = {"base_link_inertia"}  # its spheres are polyhedra that contain them in ours
    low, high = ur5e.home - 0.9, ur5e.home + 0.9
    high[-1] = low[-1] = 0.3
    seen = 0
    for q in rng.uniform(low, high, (60, len(low))):
        (poses,), _ = arm.place(q[None, [ur5e.joint_names.index(n) for n in arm.actuated]])
        theirs: dict[tuple[str, str], float] = {}
        pairs = [((s.name, o.name), s.geometry, T, o.geometry, P) for s, T in zip(arm.solids, poses) for o, P in around]
        pairs += [
            ((arm.solids[i].name, arm.solids[j].name), arm.solids[i].geometry, poses[i], arm.solids[j].geometry, poses[j])
            for i, j in arm.pairs
        ]
        for names, a, Ta, b, Tb in pairs:
            if (d := depth_of_coal(a, Ta, b, Tb)) is not None and not round_links & set(names):
                theirs[names] = max(d, theirs.get(names, 0.0))
        ours = {(c.a, c.b): c.depth_m for c in verdict.contacts(State(q, scene.poses())) if not round_links & {c.a, c.b}}
        assert {k for k, d in ours.items() if d > 1e-4} <= set(theirs)
        assert {k for k, d in theirs.items() if d > 1e-4} <= set(ours)
        for names in ours.keys() & theirs.keys():
            assert theirs[names] - 1e-4 < ours[names] < theirs[names] * (1.02 if theirs[names] < 0.001 else 1.6) + 1e-5
        seen += len(ours)
    assert seen > 50


def test_hulls_without_faces() -> None:
    """Interior points and any order of the vertices make no difference."""
    rng = np.random.default_rng(1)
    points = np.concatenate([box_corners(np.array([0.1, 0.2, 0.3])), rng.uniform(-0.09, 0.09, (20, 3))])
    for _ in range(5):
        block = hull_solid("block", rng.permutation(points)).move(np.eye(4))
        (ball,) = shape_solids("crumb", Box(np.full(3, 0.01)))
        assert depth(block, ball.move(transform(p=[0.0, 0.0, 0.304]))) == pytest.approx(0.001, abs=1e-6)
        assert depth(block, ball.move(transform(p=[0.0, 0.0, 0.3051]))) is None
        assert depth(block, ball.move(transform(p=[0.0, 0.1, 0.1]))) is not None


def test_bodies_are_apart_just_when_fcl_says_so() -> None:
    """The look at the boxes around them may answer only what FCL would answer."""
    rng, said = np.random.default_rng(8), []
    for _ in range(300):
        a, b = (
            Body(
                name,
                Box(rng.uniform(0.02, 0.3, 3)) if rng.random() < 0.5 else Cylinder(*rng.uniform(0.02, 0.15, 2).tolist()),
                transform(rotation_about(rng.normal(size=3), rng.uniform(0, 3)), rng.uniform(-0.2, 0.2, 3)),
            )
            for name in ("a", "b")
        )
        first, second = (shape_solids(body.name, body.shape)[0].move(body.T_world_body) for body in (a, b))
        said.append(apart(a, [b], 0.01))
        assert said[-1] == (gap(first, second, 0.01) >= 0.01)
    assert 50 < sum(said) < 250
