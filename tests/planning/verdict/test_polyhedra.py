"""Solids seen through a window: the least height against linear programming, sections against sampled points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from kinematics.transforms import rotation_about, transform
from planning.verdict import polygons
from planning.verdict.polyhedra import Polyhedron, Window, centre_of_mass, from_points, nearest_in_window, polyhedra, section_below

SEEDS = st.integers(0, 10**6)
WINDOW = Window(np.array([[-0.011, -0.018], [0.011, -0.018], [0.011, 0.018], [-0.011, 0.018]]))


def some_shape(rng: np.random.Generator) -> Shape:
    kind = rng.integers(3)
    if kind == 0:
        return Box(rng.uniform(0.02, 0.08, 3))
    if kind == 1:
        return Cylinder(float(rng.uniform(0.01, 0.04)), float(rng.uniform(0.05, 0.2)))
    return ConvexMesh((rng.normal(size=(14, 3)) * 0.03,))


def some_solid(seed: int) -> Polyhedron:
    rng = np.random.default_rng(seed)
    T = transform(rotation_about(rng.normal(size=3), rng.uniform(0, 3)), rng.uniform(-0.03, 0.03, 3) + np.array([0, 0, 0.08]))
    return polyhedra(some_shape(rng))[0].moved(T)


def least_z(solid: Polyhedron) -> float | None:
    """Over the window, by linear programming on the planes."""
    x, y = np.abs(WINDOW.corners).max(0)
    found = linprog([0, 0, 1], A_ub=solid.planes[:, :3], b_ub=solid.planes[:, 3], bounds=[(-x, x), (-y, y), (None, None)])
    return float(found.fun) if found.status == 0 else None


@given(SEEDS)
def test_the_nearest_point_is_that_of_a_linear_program(seed: int) -> None:
    solid = some_solid(seed)
    found, expected = nearest_in_window(solid, WINDOW), least_z(solid)
    assert (found is None) == (expected is None)
    if found is not None:
        assert found[0] == pytest.approx(expected, abs=1e-9)


@given(SEEDS)
def test_the_normal_separates_solid_and_window(seed: int) -> None:
    """Moved together until they touch, the solid lies on one side of the contact's plane, the window's column on the other."""
    solid = some_solid(seed)
    if (found := nearest_in_window(solid, WINDOW)) is None:
        return
    z, normal = found
    up = -normal
    assert up[2] > 0
    corners = np.c_[WINDOW.corners, np.full(len(WINDOW.corners), z)]
    assert (solid.vertices @ up).min() >= (corners @ up).max() - 1e-9


@given(SEEDS)
def test_a_section_holds_all_that_is_below(seed: int) -> None:
    solid, rng = some_solid(seed), np.random.default_rng(seed)
    z = float(rng.uniform(solid.vertices[:, 2].min(), solid.vertices[:, 2].max()))
    outline = polygons.hull(section_below(solid, z))
    weights = rng.dirichlet(np.ones(len(solid.vertices)), 300)
    points = weights @ solid.vertices
    below = points[points[:, 2] <= z]
    assert all(polygons.contains(outline, p) for p in below[:, :2])
    assert outline.max(0)[0] <= solid.vertices[:, 0].max() + 1e-12


@given(SEEDS)
def test_solids_hold_their_corners_and_their_middle(seed: int) -> None:
    solid = some_solid(seed)
    room = solid.planes[:, 3] - solid.vertices @ solid.planes[:, :3].T
    assert room.min() > -1e-9
    assert np.allclose(np.sort(room, axis=1)[:, :3], 0, atol=1e-9)  # three planes meet at a corner
    assert (solid.planes[:, 3] - solid.centroid @ solid.planes[:, :3].T > 0).all()


def test_volumes_and_middles() -> None:
    box = from_points(polyhedra(Box(np.array([0.02, 0.04, 0.06])))[0].vertices + np.array([0.1, 0.0, 0.0]))
    assert box.volume_m3 == pytest.approx(0.02 * 0.04 * 0.06)
    assert box.centroid == pytest.approx([0.1, 0.0, 0.0])
    (can,) = polyhedra(Cylinder(0.03, 0.1))
    assert from_points(can.vertices).volume_m3 == pytest.approx(can.volume_m3, rel=2e-3)
    assert centre_of_mass((box, box.moved(transform(p=[0.2, 0.0, 0.0])))) == pytest.approx([0.2, 0.0, 0.0])


def test_points_without_volume_are_refused() -> None:
    with pytest.raises(ValueError, match="no solid"):
        from_points(np.zeros((5, 3)))
