"""Upright solids around clean points: a can of which a part of the side was seen is a can, and whatever is not round is none."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array
from perception.objects.footprint import LEAST_M, clean_solid

HEIGHT_M = 0.16


def upright(level: Array, top: Array | None = None) -> Array:
    """Points (N, 3) over points (M, 2) of the floor, at nine heights below the top, and points (K, 2) on the top."""
    side = [np.column_stack([level, np.full(len(level), z)]) for z in np.linspace(0.02, HEIGHT_M - 0.001, 9)]
    return np.concatenate([*side, np.column_stack([top, np.full(len(top), HEIGHT_M)])]) if top is not None else np.concatenate(side)


def arc(middle: Array, radius: float, first: float, last: float, count: int = 60) -> Array:
    angle = np.linspace(first, last, count)
    return middle + radius * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("seed", range(40))
def test_a_can_is_known_by_a_part_of_its_side(seed: int) -> None:
    rng = np.random.default_rng([7, seed])
    middle, radius, first = rng.uniform(-0.3, 0.3, 2), float(rng.uniform(0.015, 0.06)), float(rng.uniform(0, 6))
    seen = arc(middle, radius, first, first + float(rng.uniform(1.0, 6.2)))
    top = arc(middle, radius * float(rng.uniform(0.2, 1.0)), first, first + 1.0) if rng.random() < 0.5 else None
    shape, T = clean_solid(upright(seen, top).astype(np.float32).astype(float))
    assert isinstance(shape, Cylinder)
    assert abs(shape.radius_m - radius) < 2e-4
    np.testing.assert_allclose(T[:2, 3], middle, atol=2e-4)


@pytest.mark.parametrize("seed", range(40))
def test_what_is_not_round_is_no_can(seed: int) -> None:
    rng = np.random.default_rng([8, seed])
    a, b = rng.uniform(0.02, 0.1, 2)
    yaw, at = rng.uniform(0, np.pi), rng.uniform(-0.3, 0.3, 2)
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    share = float(rng.uniform(0, 1))  # how much of the second face is seen
    faces = np.concatenate(
        [np.column_stack([np.linspace(0, a, 60), np.zeros(60)]), np.column_stack([np.zeros(40), np.linspace(0, b * share, 40)])]
    )
    shape, _ = clean_solid(upright(faces @ R.T + at))
    assert isinstance(shape, Box)
    np.testing.assert_allclose(np.sort(shape.size_m[:2]), np.sort([a, max(b * share, 0.004)]), atol=1e-6)


def test_a_can_beside_whose_arc_another_point_was_seen_is_none() -> None:
    seen = arc(np.zeros(2), 0.03, 0.0, 1.5)
    beyond = np.concatenate([seen, [[0.0, 0.034]]])
    assert isinstance(clean_solid(upright(seen))[0], Cylinder)
    assert isinstance(clean_solid(upright(beyond))[0], Box)


def test_a_flat_can_gets_some_thickness() -> None:
    seen = np.column_stack([np.tile(arc(np.zeros(2), 0.02, 0.0, 2.0), (3, 1)), np.repeat([0.0, 0.001, 0.002], 60)])
    shape, T = clean_solid(seen)
    assert isinstance(shape, Cylinder)
    assert shape.height_m == LEAST_M == 2 * T[2, 3]


def test_all_points_are_contained() -> None:
    rng = np.random.default_rng(9)
    for _ in range(30):
        points = upright(arc(np.zeros(2), 0.03, 0.0, float(rng.uniform(0.5, 3.0))) + rng.normal(0, 3e-5, (60, 2)))
        shape, T = clean_solid(points)
        local = (points - T[:3, 3]) @ T[:3, :3]
        if isinstance(shape, Cylinder):
            assert np.hypot(local[:, 0], local[:, 1]).max() <= shape.radius_m + 1e-9
        else:
            assert (np.abs(local) <= shape.half + 1e-9).all()  # type: ignore[union-attr]
