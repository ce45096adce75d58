"""Hiding places: whatever could be where nobody has looked stays an obstacle; what nothing fits into does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from kinematics.scene import Body, Cabinet
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import rotation_about, transform
from perception.mapping.voxels import FREE, UNKNOWN, Voxels, unknown_voxels
from perception.objects.tops import seen_top
from planning.sensing.hiding_places import _middles, hiding_places, smallest

CABINET = Cabinet(np.array([0.30, 0.40, 0.25]), transform(p=[0.3, 0.0, 0.1]), 0.03)
LEAST_M = 0.04


def all_free() -> Voxels:
    nothing = unknown_voxels(CABINET, 0.005)
    return replace(nothing, state=np.full_like(nothing.state, FREE))


def upright(name: str, shape: Box | Cylinder, x: float, y: float, yaw: float = 0.0) -> Body:
    height = shape.size_m[2] if isinstance(shape, Box) else shape.height_m
    turned = rotation_about((0.0, 0.0, 1.0), yaw)
    return Body(name, shape, CABINET.T_world_cabinet @ transform(turned, [x, y, float(height) / 2]))


def test_whatever_is_as_large_as_said_stays_whole() -> None:
    rng = np.random.default_rng(3)
    seen = upright("seen", Box(np.array([0.05, 0.06, 0.1])), 0.06, -0.12, 0.2)
    for i in range(30):
        size = LEAST_M + rng.choice([0.0, 0.03]) * rng.random(3)
        shape = Box(size) if i % 2 else Cylinder(float(size[0]) / 2, float(size[2]))
        hidden = upright("hidden", shape, *rng.uniform([0.12, -0.1], [0.25, 0.15]), float(rng.uniform(0, np.pi)))
        voxels = all_free().marked(all_free().touched(hidden), UNKNOWN)
        places = hiding_places(voxels, [seen], {"seen"}, LEAST_M)
        points = rng.uniform(-1, 1, (4000, 3)) * (shape.half if isinstance(shape, Box) else [shape.radius_m] * 2 + [shape.height_m / 2])
        if isinstance(shape, Cylinder):
            points = points[np.hypot(points[:, 0], points[:, 1]) < shape.radius_m]
        index = voxels.index(points @ hidden.T_world_body[:3, :3].T + hidden.T_world_body[:3, 3])
        assert places[tuple(index.T)].all()


def test_a_slit_holds_nothing_unless_a_body_may_reach_into_it() -> None:
    seen = upright("seen", Box(np.array([0.05, 0.06, 0.1])), 0.10, 0.0)
    state = all_free().state.copy()
    state[25:30, 35:45, :20] = UNKNOWN  # 2.5 cm behind it
    voxels = replace(all_free(), state=state)
    assert not hiding_places(voxels, [seen], {"seen"}, LEAST_M).any()
    assert hiding_places(voxels, [seen], set(), LEAST_M).any()
    assert hiding_places(voxels, [seen], {"seen"}, 0.015).any()
    assert hiding_places(voxels, [seen], {"seen"}, 0.0).any()


@pytest.mark.parametrize("smallest_m", [0.002, 0.012, 0.04, 0.07])
def test_a_ball_has_room_where_the_nearest_open_voxel_is_far_enough(smallest_m: float) -> None:
    """Distances to open voxels and to what is beyond the grid, by another's hand."""
    rng = np.random.default_rng(4)
    state = all_free().state.copy()
    for low in rng.integers(0, 40, (12, 3)):
        state[tuple(slice(a, a + n) for a, n in zip(low, rng.integers(3, 25, 3)))] = UNKNOWN
    voxels, closed = replace(all_free(), state=state), state != FREE
    away = distance_transform_edt(np.pad(closed, 1), sampling=voxels.step)[1:-1, 1:-1, 1:-1] - voxels.step.min() / 2
    roomy = closed & (away >= smallest_m / 2 - np.linalg.norm(voxels.step) / 2)
    np.testing.assert_array_equal(_middles(voxels, closed, [], smallest_m), roomy)


def test_the_slimmest_that_was_seen_says_how_slim_things_may_be() -> None:
    slim, wide = upright("pen", Cylinder(0.006, 0.14), 0.1, 0.1), upright("box", Box(np.array([0.1, 0.1, 0.1])), 0.1, -0.1)
    assert smallest([wide], LEAST_M) == LEAST_M
    assert np.isclose(smallest([wide, slim], LEAST_M), 0.012)


def test_a_top_is_seen_where_points_show_it() -> None:
    box, can = upright("box", Box(np.array([0.08, 0.06, 0.1])), 0.1, 0.0, 0.4), upright("can", Cylinder(0.03, 0.1), 0.2, 0.0)
    rng = np.random.default_rng(0)
    for body, half in ((box, box.shape.half[:2]), (can, np.array([0.03, 0.03]))):  # type: ignore[union-attr]
        flat = rng.uniform(-1, 1, (5000, 2)) * half
        top = np.column_stack([flat, np.full(len(flat), 0.05)])
        R, p = body.T_world_body[:3, :3], body.T_world_body[:3, 3]
        assert seen_top(body, top @ R.T + p) == 1.0
        assert 0.3 < seen_top(body, top[top[:, 0] > 0] @ R.T + p) < 0.7
        assert seen_top(body, (top - [0, 0, 0.03]) @ R.T + p) == 0.0
