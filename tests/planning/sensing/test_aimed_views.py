"""Views that are sought for what is wanted: they show it past all that is known, and the arm can take them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Scene
from kinematics.shapes import Box
from kinematics.transforms import Array, apply, transform
from perception.mapping.voxels import FREE, OCCUPIED, Voxels, unknown_voxels
from perception.rendering.synthetic_camera import DEFAULT
from planning.motion.cell.workcell import Workcell
from planning.scenes.generation import generate, load_spec
from planning.sensing.aimed_views import aimed_views, in_image, in_sight


@pytest.fixture(scope="module")
def empty(ur5e: Robot) -> Scene:
    return replace(generate(load_spec("paper"), ur5e, to_ref(ur5e), 71, 0), objects=())


def spot(cabinet: Cabinet, voxels: Voxels, at: Array) -> Array:
    """A focus on one voxel (X, Y, Z), at a point of the cabinet."""
    focus = np.zeros(voxels.state.shape)
    focus[tuple(voxels.index(apply(cabinet.T_world_cabinet, at[None]))[0])] = 1.0
    return focus


def test_a_point_is_in_sight_unless_something_known_is_between(empty: Scene) -> None:
    """Of a wall across the cabinet, seen or believed; what nobody has seen hides nothing, nor does what the point lies in."""
    cabinet, rng = empty.cabinet, np.random.default_rng(0)
    voxels = unknown_voxels(cabinet)
    _, width, height = cabinet.size_m
    eyes = apply(cabinet.T_world_cabinet, rng.uniform([-0.3, -width / 2, 0.0], [0.1, width / 2, height], (40, 3)))
    points = apply(cabinet.T_world_cabinet, rng.uniform([0.3, -width / 2, 0.0], [0.4, width / 2, height], (30, 3)))
    assert in_sight(voxels, (), eyes, points).all()
    wall = Body("wall", Box(np.array([0.03, width, height])), cabinet.T_world_cabinet @ transform(p=[0.2, 0.0, height / 2]))
    touched = voxels.touched(wall)
    for known, bodies in ((voxels, (wall,)), (voxels.marked(touched, OCCUPIED), ())):
        assert not in_sight(known, bodies, eyes, points)[(apply(np.linalg.inv(cabinet.T_world_cabinet), eyes)[:, 0] < 0.15)].any()
    at_it = voxels.marked(voxels.touched(replace(wall, T_world_body=cabinet.T_world_cabinet @ transform(p=[0.35, 0.0, height / 2]))), FREE)
    assert in_sight(at_it, (), eyes, points).all()


def test_a_box_hides_what_the_line_to_it_crosses(empty: Scene) -> None:
    """Beside a voxel's width of doubt, as the slabs of the box say."""
    cabinet, rng = empty.cabinet, np.random.default_rng(1)
    voxels, half = unknown_voxels(cabinet), np.array([0.05, 0.06, 0.08])
    box = Body("box", Box(2 * half), cabinet.T_world_cabinet @ transform(p=[0.25, 0.0, 0.1]))
    eyes, points = rng.uniform([-0.3, -0.4, 0.05], [0.1, 0.4, 0.45], (60, 3)), rng.uniform([0.38, -0.3, 0.02], [0.5, 0.3, 0.3], (50, 3))
    seen = in_sight(voxels, (box,), apply(cabinet.T_world_cabinet, eyes), apply(cabinet.T_world_cabinet, points))

    def crosses(by_m: float) -> Array:
        low, high = np.array([0.25, 0.0, 0.1]) - half - by_m, np.array([0.25, 0.0, 0.1]) + half + by_m
        ray = points - eyes[:, None]
        one, other = (low - eyes[:, None]) / ray, (high - eyes[:, None]) / ray
        return np.asarray(np.minimum(one, other).max(-1) <= np.maximum(one, other).min(-1))

    assert not seen[crosses(-0.01)].any()
    assert seen[~crosses(0.02)].all()
    assert 100 < np.count_nonzero(~seen) < seen.size - 100


def test_views_show_what_they_were_sought_for_and_the_arm_can_take_them(ur5e: Robot, empty: Scene) -> None:
    """Behind a box: from above it and from beside it."""
    cabinet, voxels = empty.cabinet, unknown_voxels(empty.cabinet)
    box = Body("box", Box(np.array([0.08, 0.12, 0.2])), cabinet.T_world_cabinet @ transform(p=[0.25, 0.05, 0.1]))
    focus = spot(cabinet, voxels, np.array([0.34, 0.05, 0.06]))
    found = aimed_views(ur5e, empty, voxels, (box,), focus, np.random.default_rng(2))
    assert found is not None
    wanted = voxels.centres(focus > 0)
    assert in_image(found.T, wanted, DEFAULT).all()
    assert in_sight(voxels, (box,), found.T[:, :3, 3], wanted).all()
    cell = Workcell(ur5e, empty, iterations=1, time_budget_s=None)
    alone = cell.problem({}, float(ur5e.home[ur5e.gripper_joint]))
    for q, T in zip(found.q[::7], found.T[::7]):
        assert cell.touch(alone, q) is None
        at = empty.robot.T_world_base @ ur5e.link_poses(ur5e.with_arm(q, 0.0))["camera"]
        np.testing.assert_allclose(at, T, atol=1e-4)


def test_there_are_none_of_what_is_walled_in_nor_of_nothing(ur5e: Robot, empty: Scene) -> None:
    cabinet, voxels, rng = empty.cabinet, unknown_voxels(empty.cabinet), np.random.default_rng(3)
    _, width, height = cabinet.size_m
    wall = Body("wall", Box(np.array([0.03, width, height])), cabinet.T_world_cabinet @ transform(p=[0.4, 0.0, height / 2]))
    deep = spot(cabinet, voxels, np.array([0.5, 0.0, 0.2]))
    assert aimed_views(ur5e, empty, voxels, (), deep, rng) is not None
    assert aimed_views(ur5e, empty, voxels, (wall,), deep, rng) is None
    assert aimed_views(ur5e, empty, voxels, (), np.zeros_like(deep), rng) is None
