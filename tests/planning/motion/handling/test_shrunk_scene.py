"""A scene with shrunk obstacles: each is as much smaller as is asked, and something is left of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from turned_cabinet import CABINET, scene_of

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body
from kinematics.shapes import Box, ConvexMesh, Cylinder
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.motion.handling.shrunk_scene import LEFT_M, can_be_shrunk, most_room_m, shrunk, thinnest_allowed_m, thinnest_m
from planning.motion.pick_place import Motions
from planning.scenes.generation import generate, load_spec


def inside(body: Body, points: Array, by_m: float) -> Array:
    """Which of points (N, 3), world frame, are in a solid, and by so much from its surface."""
    p = (points - body.T_world_body[:3, 3]) @ body.T_world_body[:3, :3]
    if isinstance(body.shape, Cylinder):
        return (np.hypot(p[:, 0], p[:, 1]) <= body.shape.radius_m - by_m) & (np.abs(p[:, 2]) <= body.shape.height_m / 2 - by_m)
    return np.asarray((np.abs(p) <= body.shape.half - by_m).all(1))


def test_everything_is_further_from_any_point_by_as_much_as_is_asked() -> None:
    """What is in a solid of the shrunk scene is in one of the scene, and so much from its surface, but where walls meet walls."""
    box = Body("b", Box(np.array([0.08, 0.05, 0.2])), CABINET.T_world_cabinet @ transform(p=[0.2, 0.0, 0.1]))
    can = Body("c", Cylinder(0.04, 0.1), transform(rotation_about((1, 0, 0), 0.7), [0.6, 0.2, 0.3]))
    scene, by_m = replace(scene_of(box, can), obstacles=(replace(box, name="post"),)), 0.004
    less = shrunk(scene, by_m)
    points = np.random.default_rng(0).uniform([0.2, -0.4, 0.1], [1.0, 0.6, 0.7], (200_000, 3))
    for before, after in zip((*scene.objects, *scene.obstacles), (*less.objects, *less.obstacles)):
        assert np.array_equal(inside(after, points, 0.0), inside(before, points, by_m))
    solid = np.any([inside(wall, points, 0.0) for wall in less.cabinet.walls()], 0)
    in_cabinet = points @ inverse(CABINET.T_world_cabinet)[:3, :3].T + inverse(CABINET.T_world_cabinet)[:3, 3]
    low, high = np.array([0.0, -0.3, 0.0]), np.array([0.5, 0.3, 0.4])
    nearest = np.clip(in_cabinet, low, high)  # of the space that the walls enclose
    assert solid.sum() > 1000
    assert np.linalg.norm(in_cabinet - nearest, axis=1)[solid].min() > by_m - 1e-9


def test_where_something_is_a_plate_a_thin_wall_or_a_mesh_there_is_no_such_look(ur5e: Robot) -> None:
    """Less than nothing would be left of it, and a hand that misses it by a little be called closed by what is left."""
    post = Body("post", Box(np.array([0.05, 0.05, 0.3])), CABINET.T_world_cabinet @ transform(p=[0.2, 0.0, 0.15]))
    scene = scene_of(post)
    mesh = replace(post, shape=ConvexMesh((np.eye(3, 4).T * 0.1,)))
    assert can_be_shrunk(scene)
    for thin in (Box(np.array([0.05, 0.3, 0.004])), Cylinder(0.1, 0.003), Cylinder(0.003, 0.1)):
        assert not can_be_shrunk(replace(scene, obstacles=(replace(post, shape=thin),)))
        assert not can_be_shrunk(scene_of(replace(post, shape=thin)))
    assert not can_be_shrunk(replace(scene, obstacles=(mesh,)))
    assert not can_be_shrunk(replace(scene, cabinet=replace(scene.cabinet, wall_m=0.005)))
    with pytest.raises(ValueError, match="post is a mesh"):
        shrunk(replace(scene, obstacles=(mesh,)), 0.001)
    shelf = generate(load_spec("shelf"), ur5e, to_ref(ur5e), 880011, 358)
    assert Motions(ur5e, shelf).finest is not None
    assert Motions(ur5e, replace(shelf, cabinet=replace(shelf.cabinet, wall_m=0.005))).finest is None


def test_walls_are_further_from_what_is_outside_too() -> None:
    """A forearm may pass below the cabinet's floor: no point of a shrunk wall is nearer than asked to one that is in no wall."""
    by_m, rng = 0.004, np.random.default_rng(1)
    points = rng.uniform([0.2, -0.4, 0.1], [1.0, 0.6, 0.7], (200_000, 3))
    less = shrunk(scene_of(Body("b", Box(np.full(3, 0.05)), CABINET.T_world_cabinet)), by_m).cabinet
    solid = points[np.any([inside(wall, points, 0.0) for wall in less.walls()], 0)]
    ways = rng.normal(size=solid.shape)
    around = solid + (by_m - 1e-9) * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    assert len(solid) > 1000
    assert np.any([inside(wall, around, 0.0) for wall in CABINET.walls()], 0).all()


@pytest.mark.parametrize(
    "shape", [Box(np.array([0.05, 0.012, 0.3])), Cylinder(0.006, 0.1), Cylinder(0.1, 0.012), Box(np.full(3, 0.3))], ids=str
)
def test_as_much_as_can_be_leaves_as_little_as_may_be(shape: Box | Cylinder) -> None:
    """Of the thinnest thing, or of the walls where nothing is thinner."""
    scene = scene_of(Body("it", shape, CABINET.T_world_cabinet @ transform(p=[0.2, 0.0, 0.15])))
    assert thinnest_m(scene) == pytest.approx(min(0.03, 2 * shape.half.min()))
    assert thinnest_m(shrunk(scene, most_room_m(scene))) == pytest.approx(LEFT_M)


def test_proofs_ask_for_ten_millimetres_and_for_twelve_where_hands_are_pitched() -> None:
    scene = scene_of(Body("it", Box(np.full(3, 0.05)), CABINET.T_world_cabinet))
    assert round(1e3 * thinnest_allowed_m(scene)) == 10
    assert round(1e3 * thinnest_allowed_m(replace(scene, approaches=("diagonal", "downward")))) == 12
