"""Pose noise is settled and told; what is invalid is refused with its amount and the likely cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.collision.fcl_solids import overlapping
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds, box_corners
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.io.plan_documents import plan_from_json, plan_to_json
from planning.io.settling import LEAST_M, NOISE_M, ROOM_M, Unsettled, settle
from planning.plan import Blocked, Plan

TURNED = transform(rotation_about((0, 0, 1), 0.7), [0.3, 0.1, 0.4])  # a cabinet that stands askew
BOX, CAN = Box(np.array([0.06, 0.08, 0.1])), Cylinder(0.03, 0.12)


def scene_of(*bodies: Body, T_world_cabinet: Array = TURNED, obstacles: Sequence[Body] = ()) -> Scene:
    cabinet = Cabinet(np.array([0.56, 0.86, 0.5]), T_world_cabinet, 0.03)
    grasp = Grasp(np.eye(4), 0.05)
    return Scene("s", RobotRef(np.eye(4), "ur5e"), cabinet, bodies, bodies[0].name, grasp, obstacles=tuple(obstacles))


def standing(name: str, shape: Shape, x: float, y: float, z: float = 0.0, yaw: float = 0.0, T: Array = TURNED) -> Body:
    """A body in the cabinet's frame, its bottom at height z."""
    pose = transform(rotation_about((0, 0, 1), yaw), [x, y, z + shape.half[2]])
    return Body(name, shape, T @ pose)


def in_cabinet(scene: Scene, body: Body) -> tuple[Array, Array]:
    return bounds(body.shape, inverse(scene.cabinet.T_world_cabinet) @ body.T_world_body)


def free(scene: Scene) -> bool:
    """Whether the objects overlap nothing but by what is left alone, and stand on the floor."""
    found = [c for c in overlapping([*scene.fixtures(), *scene.objects], 2 * LEAST_M) if {c.a, c.b} & set(scene.poses())]
    return not found and all(abs(in_cabinet(scene, b)[0][2]) <= LEAST_M for b in scene.objects)


def test_what_stands_well_is_left_alone() -> None:
    scene = scene_of(standing("a", BOX, 0.2, 0.0), standing("b", CAN, 0.2, 0.08, z=LEAST_M / 2))
    assert settle(scene) is scene


@pytest.mark.parametrize(("z", "why"), [(-0.0015, "it stood 1.5 mm in the floor"), (0.0012, "it floated 1.2 mm above the floor")])
def test_the_floor(z: float, why: str) -> None:
    scene = scene_of(standing("can", CAN, 0.2, 0.0, z))
    settled = settle(scene)
    assert free(settled)
    (note,) = settled.settled
    assert (note.object, note.reason) == ("can", why)
    np.testing.assert_allclose(note.by_m, [0, 0, -z], atol=1e-9)
    assert str(note) == f"can was moved by {1000 * abs(z):.1f} mm: {why}"
    np.testing.assert_allclose(settled.objects[0].T_world_body, standing("can", CAN, 0.2, 0.0).T_world_body, atol=1e-9)


@settings(max_examples=60)
@given(
    x=st.floats(0.1, 0.4), y=st.floats(-0.3, 0.3), yaw=st.floats(-3, 3), way=st.floats(-3.1, 3.1), deep=st.floats(1e-4, 0.0018),
    sink=st.floats(-0.0018, 0.0018), shapes=st.tuples(st.sampled_from([BOX, CAN]), st.sampled_from([BOX, CAN])),
)  # fmt: skip
def test_a_little_overlap_is_parted(
    x: float, y: float, yaw: float, way: float, deep: float, sink: float, shapes: tuple[Shape, Shape]
) -> None:
    """Two objects anywhere, one slid into the other by less than the noise: the other moves, by little more, and the target does not."""
    target = standing("target", shapes[0], x, y, yaw=yaw)
    along = np.array([np.cos(way), np.sin(way), 0.0])
    apart, together = 0.3, 0.0
    for _ in range(40):  # where they begin to touch
        middle = (apart + together) / 2
        other = standing("other", shapes[1], *(np.array([x, y]) + middle * along[:2]))
        if overlapping([target, other], 0.0):
            together = middle
        else:
            apart = middle
    other = standing("other", shapes[1], *(np.array([x, y]) + (apart - deep) * along[:2]), z=sink)
    scene = scene_of(target, other, T_world_cabinet=TURNED)
    if not (overlapping([target, other], LEAST_M) or abs(sink) > LEAST_M):
        return
    settled = settle(scene)
    assert free(settled)
    np.testing.assert_array_equal(settled.objects[0].T_world_body, target.T_world_body)
    by = settled.objects[1].T_world_body[:3, 3] - other.T_world_body[:3, 3]
    assert np.linalg.norm(by[:2]) <= deep + ROOM_M + 4 * LEAST_M
    assert not overlapping(settled.objects, LEAST_M - ROOM_M)
    assert by[2] == pytest.approx(-sink if abs(sink) > LEAST_M else 0.0, abs=1e-9)


def test_a_wall_and_an_obstacle_stay_where_they_are() -> None:
    post = standing("post", Cylinder(0.02, 0.5), 0.3, 0.3)
    scene = scene_of(standing("a", BOX, 0.2, 0.43 - 0.039), standing("b", BOX, 0.3 - 0.049, 0.3), obstacles=[post])
    settled = settle(scene)
    assert free(settled)
    assert {n.object: n.reason for n in settled.settled} == {"a": "it overlapped left by 1.0 mm", "b": "it overlapped post by 1.0 mm"}
    assert settled.obstacles == scene.obstacles


def test_a_row_of_neighbours() -> None:
    """Five boxes side by side, each 1 mm in the next, have room; between two walls they have none."""
    thick = Box(np.array([0.06, 0.0801, 0.1]))
    settled = settle(scene_of(*(standing(f"b{i}", thick, 0.2, 0.0791 * (i - 2)) for i in range(5))))
    assert free(settled)
    wide = Box(np.array([0.06, 0.4313, 0.1]))
    with pytest.raises(Unsettled, match="there is no room to part them"):
        settle(scene_of(standing("a", wide, 0.2, -0.215), standing("b", wide, 0.2, 0.215)))


def test_stacks_stand_on_each_other() -> None:
    low, board = standing("low", BOX, 0.2, 0.0), Body("board", Box(np.array([0.2, 0.3, 0.01])), TURNED @ transform(p=[0.3, 0.25, 0.2]))
    stacked, shelved = standing("top", CAN, 0.2, 0.0, z=0.1), standing("on_board", CAN, 0.3, 0.25, z=0.205)
    scene = scene_of(low, stacked, shelved, obstacles=[board])
    lifted = {note.object: note for note in settle(scene).settled}
    assert {n: note.reason for n, note in lifted.items()} == {"top": "it touched low", "on_board": "it touched board"}
    sunk = replace(stacked, T_world_body=TURNED @ transform(p=[0.2, 0.0, 0.159]))
    (note,) = settle(scene_of(low, sunk)).settled
    assert str(note) == "top was moved by 1.7 mm: it overlapped low by 1.0 mm"
    for by_m, up in ((lifted["top"].by_m, ROOM_M), (lifted["on_board"].by_m, ROOM_M), (note.by_m, 0.001 + ROOM_M)):
        np.testing.assert_allclose(by_m, [0, 0, up], atol=2 * LEAST_M)


def test_what_touches_is_parted_so_far_that_it_can_be_lifted() -> None:
    """Two boxes that touch, and one at a wall."""
    scene = scene_of(standing("t", BOX, 0.2, 0.0), standing("a", BOX, 0.2, 0.0802), standing("w", BOX, 0.4, -0.39))
    settled = settle(scene)
    assert {n.object: n.reason for n in settled.settled} == {"a": "it stood 0.2 mm from t", "w": "it touched right"}
    close = [c for c in overlapping([*settled.fixtures(), *settled.objects], LEAST_M - ROOM_M) if {c.a, c.b} & set(settled.poses())]
    assert {c.a for c in close} == {"floor"}
    by_m = {n.object: n.by_m @ TURNED[:3, :3] for n in settled.settled}
    np.testing.assert_allclose(by_m["a"], [0, ROOM_M - 0.0002, 0], atol=LEAST_M)
    np.testing.assert_allclose(by_m["w"], [0, ROOM_M, 0], atol=LEAST_M)
    assert settled.grasp is scene.grasp
    assert settle(scene, 0.0) is scene


def test_the_grasps_go_with_a_target_that_touches_a_wall() -> None:
    scene = scene_of(standing("t", BOX, 0.4, -0.39))
    assert scene.grasp is not None
    scene = replace(scene, grasps=((scene.grasp, 0.5),))
    settled = settle(scene)
    (note,) = settled.settled
    np.testing.assert_allclose(note.by_m @ TURNED[:3, :3], [0, ROOM_M, 0], atol=LEAST_M)
    for before, after in ((scene.grasp, settled.grasp), (scene.grasps[0][0], settled.grasps[0][0])):
        assert after is not None
        np.testing.assert_allclose(after.T_world_hand, transform(p=note.by_m) @ before.T_world_hand, atol=1e-12)


def test_what_leans_on_another_is_left_alone() -> None:
    """It touches the other's upper edge with a side that slopes: the ways to the side and up are far."""
    sloping, post = rotation_about((1, 0, 0), -0.3), Box(np.array([0.05, 0.02, 0.2]))
    low, apart, together = standing("low", BOX, 0.2, 0.2), 0.0, 0.2
    foot = (box_corners(post.size_m / 2) @ sloping.T)[:, 2].min()
    for _ in range(40):
        middle = (apart + together) / 2
        leaning = Body("post", post, TURNED @ transform(sloping, [0.2, middle, -foot]))
        apart, together = (apart, middle) if overlapping([low, leaning], 0.0) else (middle, together)
    scene = scene_of(low, leaning)
    assert overlapping([low, leaning], LEAST_M - ROOM_M)
    assert settle(scene) is scene


def test_where_there_is_no_room_for_all_all_touch_as_before() -> None:
    wide = Box(np.array([0.06, 0.215, 0.1]))
    scene = scene_of(*(standing(f"b{i}", wide, 0.2, 0.215 * i - 0.3225) for i in range(4)))
    assert settle(scene) is scene


CASES: list[tuple[Body, str]] = [
    (standing("a", BOX, 0.2, 0.0, z=0.035), "'a' floats 35.0 mm above the floor, and nothing carries it"),
    (standing("a", BOX, 0.4, -0.2, z=0.123), "'a' floats 123.0 mm above the floor, 3.0 mm above 'other', and nothing carries it"),
    (standing("a", BOX, 0.2, 0.0, z=-0.005), "'a' overlaps the cabinet's wall 'floor' by 5.0 mm; move it up"),
    (standing("a", BOX, 0.2, 0.0, z=-0.05), "'a' overlaps the cabinet's wall 'floor' by 50.0 mm; is its position that of its bottom?"),
    (standing("a", BOX, 0.2, 0.41), "'a' overlaps the cabinet's wall 'left' by 20.0 mm; move one of them"),
    (standing("a", BOX, -0.2, 0.0), "'a' stands outside: its middle is 200 mm in front of the cabinet"),
    (standing("a", BOX, 0.2, 0.9), "'a' stands outside: its middle is 470 mm to the left of the cabinet"),
    (Body("a", BOX, transform(p=[0.2, -0.3, 0.05])), "is its pose told in the cabinet's frame? poses are in the world"),
    (standing("a", ConvexMesh((box_corners(np.full(3, 40.0)),)), 0.2, 0.0), "is 80 m long: is the mesh in millimetres? \"scale\": 0.001"),
    (standing("a", Box(np.array([60.0, 60.0, 120.0])), 0.2, 0.0), "'a' is 120 m long: are its sizes in millimetres? they are metres"),
    (standing("a", Cylinder(3e-5, 1.2e-4), 0.2, 0.0), "'a' is 0.12 mm long: are its sizes metres?"),
    (standing("a", BOX, 200.0, 0.0), "'a' is 200 m away from the cabinet: is its position in millimetres?"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "says"), CASES, ids=[says[:45] for _, says in CASES])
def test_what_can_not_be_meant(body: Body, says: str) -> None:
    with pytest.raises(Unsettled) as caught:
        settle(scene_of(body, standing("other", CAN, 0.4, -0.2)))
    assert says in str(caught.value)
    assert caught.value.body == "a"


@pytest.mark.parametrize(
    ("size", "wall", "says"),
    [
        ((56.0, 0.86, 0.5), 0.03, "the cabinet is 56 m deep: are its sizes in centimetres or millimetres?"),
        ((0.56, 86.0, 0.5), 0.03, "the cabinet is 86 m wide"),
        ((0.56, 0.86, 0.0005), 0.03, "the cabinet is 0.5 mm high: are its sizes metres?"),
        ((0.56, 0.86, 0.5), 30.0, "the cabinet's walls are 30 m thick: is wall_m in millimetres?"),
    ],
)
def test_a_cabinet_that_can_not_be_meant(size: tuple[float, float, float], wall: float, says: str) -> None:
    scene = scene_of(standing("a", CAN, 0.4, -0.2))
    with pytest.raises(Unsettled) as caught:
        settle(replace(scene, cabinet=replace(scene.cabinet, size_m=np.array(size), wall_m=wall)))
    assert says in str(caught.value)
    assert caught.value.body is None


def test_two_objects_deep_in_each_other() -> None:
    with pytest.raises(Unsettled, match=r"'a' overlaps 'b' by 10\.0 mm; move one of them"):
        settle(scene_of(standing("a", BOX, 0.2, 0.0), standing("b", BOX, 0.2, 0.07)))


def test_the_noise_is_a_setting() -> None:
    scene = scene_of(standing("a", BOX, 0.2, 0.0, z=-0.004))
    with pytest.raises(Unsettled):
        settle(scene)
    assert free(settle(scene, 0.005))
    with pytest.raises(Unsettled):
        settle(scene_of(standing("a", BOX, 0.2, 0.0, z=-NOISE_M / 2)), 0.0005)


def test_what_a_camera_saw_is_left_as_it_was_fitted() -> None:
    seen = [replace(standing(n, BOX, 0.2, y, z), source="seen") for n, y, z in (("a", 0.0, 0.01), ("b", 0.07, -0.01))]
    scene = scene_of(seen[0], seen[1])
    assert settle(scene) is scene


def test_a_plan_says_what_was_settled(tmp_path: Path) -> None:
    scene = settle(scene_of(standing("can", CAN, 0.2, 0.0, -0.0015)))
    plan = Plan("s", "local", "deep", False, Blocked("moves"), (), (), 0.0, 0.0, 0.0, 0.0, None, settled=scene.settled)
    document = plan_to_json(plan)
    assert [(s["object"], s["reason"]) for s in document["settled"]] == [("can", "it stood 1.5 mm in the floor")]
    assert plan_to_json(plan_from_json(document)) == document
    assert "settled" not in plan_to_json(replace(plan, settled=()))
