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
    found, expected = nearest_in_window(solid, Window(WINDOW.corners)), least_z(solid)
    assert (found is None) == (expected is None)
    if found is not None:
        assert found[0] == pytest.approx(expected, abs=1e-9)


@given(SEEDS)
def test_the_normal_separates_solid_and_window(seed: int) -> None:
    """Moved together until they touch, the solid lies on one side of the contact's plane, the window's column on the other."""
    solid = some_solid(seed)
    if (found := nearest_in_window(solid, Window(WINDOW.corners))) is None:
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


# -------------------------------------------------------------------------------------------------------------------------------- by hand


def test_a_box_as_a_polyhedron() -> None:
    (box,) = polyhedra(Box(np.array([2.0, 4.0, 6.0])))
    assert {tuple(v) for v in box.vertices.tolist()} == {(x, y, z) for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)}
    assert sorted(np.abs(box.vertices[a] - box.vertices[b]).tolist() for a, b in box.edges) == 4 * [[0, 0, 6]] + 4 * [[0, 4, 0]] + 4 * [
        [2, 0, 0]
    ]
    assert sorted(box.planes.tolist()) == sorted([[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [-1, 0, 0, 1], [0, -1, 0, 2], [0, 0, -1, 3]])
    assert box.volume_m3 == 48
    assert box.centroid.tolist() == [0, 0, 0]


@pytest.mark.parametrize(("asked", "sides"), [((), 96), ((24,), 24), ((4,), 4)])
def test_a_cylinder_as_a_prism(asked: tuple[int, ...], sides: int) -> None:
    """Its corners are as far outside of the cylinder as the middles of its sides are inside."""
    (can,) = polyhedra(Cylinder(0.5, 3.0), *asked)
    assert can.vertices.shape == (2 * sides, 3)
    out = np.hypot(can.vertices[:, 0], can.vertices[:, 1])
    sides_at = can.planes[:sides, 3]
    assert out == pytest.approx(np.full(2 * sides, 0.5 / np.sqrt(np.cos(np.pi / sides))))
    assert sides_at == pytest.approx(np.full(sides, 0.5 * np.sqrt(np.cos(np.pi / sides))))
    assert out[0] * sides_at[0] == pytest.approx(0.25)
    assert can.vertices[:sides, 2].tolist() == [-1.5] * sides
    assert can.vertices[sides:, 2].tolist() == [1.5] * sides
    assert can.vertices[0, :2] == pytest.approx([out[0], 0])
    assert can.vertices[1, 1] > 0
    assert can.planes[sides:].tolist() == [[0, 0, 1, 1.5], [0, 0, -1, 1.5]]
    assert np.linalg.norm(can.planes[:, :3], axis=1) == pytest.approx(np.ones(sides + 2))
    assert can.volume_m3 == pytest.approx(np.pi * 0.25 * 3)
    assert can.centroid.tolist() == [0, 0, 0]
    lengths = np.sort(np.linalg.norm(can.vertices[can.edges[:, 0]] - can.vertices[can.edges[:, 1]], axis=1))
    assert lengths == pytest.approx(np.sort([*[2 * out[0] * np.sin(np.pi / sides)] * 2 * sides, *[3.0] * sides]))
    assert len({frozenset(e) for e in can.edges.tolist()}) == 3 * sides


def test_a_solid_from_points() -> None:
    """A cube of 2 with its corner at the origin, and points within it; a pyramid, whose middle is at a quarter of its height."""
    cube = np.array([[x, y, z] for x in (0.0, 2) for y in (0.0, 2) for z in (0.0, 2)])
    found = from_points(np.concatenate([[[1.0, 1, 1]], cube, [[0.5, 1, 1]]]))
    assert {tuple(v) for v in found.vertices.tolist()} == {tuple(v) for v in cube.tolist()}
    assert found.volume_m3 == pytest.approx(8)
    assert found.centroid == pytest.approx([1, 1, 1])
    assert sorted(found.planes.tolist()) == [[-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 1, 2], [0, 1, 0, 2], [1, 0, 0, 2]]
    lengths = np.linalg.norm(found.vertices[found.edges[:, 0]] - found.vertices[found.edges[:, 1]], axis=1)
    assert np.sort(lengths) == pytest.approx([2.0] * 12 + [np.sqrt(8)] * 6)
    turned = from_points(cube @ rotation_about((1, 2, 3), 0.7).T)
    assert (len(turned.planes), len(turned.edges)) == (6, 18)
    pyramid = from_points(np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0], [0.4, 0, 3.0]]))
    assert pyramid.volume_m3 == pytest.approx(4)
    assert pyramid.centroid == pytest.approx([0.1, 0, 0.75])
    assert pyramid.edges.dtype == np.int64
    with pytest.raises(ValueError, match=r"^the points span no solid$"):
        from_points(cube[:, :] * [1, 1, 0])


def test_a_solid_that_is_moved() -> None:
    T = transform(rotation_about((0, 0, 1), np.pi / 2), [5.0, 6.0, 7.0])
    cube = from_points(np.add(polyhedra(Box(np.full(3, 2.0)))[0].vertices, [1.0, 0.0, 0.0]))
    there = cube.moved(T)
    assert {tuple(v) for v in np.round(there.vertices, 9).tolist()} == {(x, y, z) for x in (4, 6) for y in (6, 8) for z in (6, 8)}
    assert there.centroid == pytest.approx([5, 7, 7])
    assert there.volume_m3 == cube.volume_m3
    assert sorted(np.round(there.planes, 9).tolist()) == [
        [-1, 0, 0, -4],
        [0, -1, 0, -6],
        [0, 0, -1, -6],
        [0, 0, 1, 8],
        [0, 1, 0, 8],
        [1, 0, 0, 6],
    ]


def test_the_middle_of_parts_goes_by_their_volumes() -> None:
    small, large = polyhedra(Box(np.full(3, 1.0)))[0], polyhedra(Box(np.full(3, 2.0)))[0].moved(transform(p=[9.0, 0.0, 18.0]))
    assert centre_of_mass((small, large)) == pytest.approx([8, 0, 16])


def test_a_mesh_has_a_part_for_each_of_its() -> None:
    cube = polyhedra(Box(np.full(3, 2.0)))[0].vertices
    parts = polyhedra(ConvexMesh((cube, cube + 5.0)))
    assert [p.centroid.tolist() for p in parts] == [pytest.approx([0, 0, 0]), pytest.approx([5, 5, 5])]


WIDE = np.array([[-1.0, -2.0], [1.0, -2.0], [1.0, 2.0], [-1.0, 2.0]])
"""A window of 2 by 4, to look at things that are as easily put into numbers."""


def seen(points: object) -> tuple[float, list[float]] | None:
    solid = np.array(points, float)
    found = nearest_in_window(from_points(solid), Window(WIDE))
    aside = nearest_in_window(from_points(solid + np.array([32.0, -64.0, 0.0])), Window(WIDE + np.array([32.0, -64.0])))
    assert (found is None) == (aside is None)
    if found is None or aside is None:
        return None
    assert aside[0] == pytest.approx(found[0])
    assert aside[1] == pytest.approx(found[1])
    return found[0], found[1].tolist()


def test_a_corner_within_the_window_is_what_comes_nearest() -> None:
    tip = [[0.5, 1.5, 3], [9, 9, 9], [-9, 9, 9], [9, -9, 9], [-9, -9, 9]]
    assert seen(tip) == (3.0, [0, 0, -1])
    on_the_edge = [[1, 1.5, 3], [9, 9, 9], [1, 9, 9], [9, -9, 9], [1, -9, 9]]
    assert seen(on_the_edge) == (3.0, [0, 0, -1])
    assert seen(np.array(tip) - [0, 0, 7.0]) == (-4.0, [0, 0, -1])
    assert seen(np.add(np.array(tip), [20.0, 0, 0])) is None


def test_an_edge_over_an_edge_of_the_window() -> None:
    """A ridge that looks down and rises along x by one in two: it is lowest over the window's side x = -1."""
    ridge = np.array([[-8, 0, 0], [8, 0, 8], [-8, 30, 40], [8, 30, 48], [-8, -30, 40], [8, -30, 48]], float)
    z, normal = seen(ridge) or (0.0, [])
    assert z == pytest.approx(3.5)
    assert normal == pytest.approx(np.array([1, 0, -2]) / np.sqrt(5))
    z, normal = seen(ridge * [-1, 1, 1]) or (0.0, [])
    assert z == pytest.approx(3.5)
    assert normal == pytest.approx(np.array([-1, 0, -2]) / np.sqrt(5))
    z, normal = seen(ridge[:, [1, 0, 2]]) or (0.0, [])  # along y, over y = -2
    assert z == pytest.approx(3.0)
    assert normal == pytest.approx(np.array([0, 1, -2]) / np.sqrt(5))
    z, normal = seen(ridge[:, [1, 0, 2]] * [1, -1, 1]) or (0.0, [])
    assert z == pytest.approx(3.0)
    assert normal == pytest.approx(np.array([0, -1, -2]) / np.sqrt(5))
    assert seen(np.add(ridge, [0.0, 40.0, 0.0])) is None


def test_a_face_over_a_corner_of_the_window() -> None:
    """It rises by one in two along x, and in four along y: 10 over the middle, 9 over the corner (-1, -2)."""
    slab = np.array([[x, y, 10 + x / 2 + y / 4 + up] for x in (-50, 50) for y in (-50, 50) for up in (0, 5)])
    for sx, sy in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        z, normal = seen(slab * [sx, sy, 1]) or (0.0, [])
        assert z == pytest.approx(9.0)
        assert normal == pytest.approx(np.array([sx / 2, sy / 4, -1]) / np.sqrt(1.3125))
    flat = np.array([[x, y, 10.0 + up] for x in (-50, 50) for y in (-50, 50) for up in (0, 5)])
    assert seen(flat) == (10.0, [0, 0, -1])
    assert seen(np.add(flat, [48.5, 0.0, 0.0])) == (10.0, pytest.approx([0, 0, -1]))
    narrow = np.array([[x, y, 10 + x / 8 + y / 4 + up] for x in (-1.5, 1.5) for y in (-50, 50) for up in (0, 5)])
    z, normal = seen(narrow) or (0.0, [])  # half a metre wider than the window on either side
    assert z == pytest.approx(9.375)
    assert normal == pytest.approx(np.array([1 / 8, 1 / 4, -1]) / np.sqrt(1.078125))
    quarter = np.array([[x, y, 10 - x / 2 - y / 4 + up] for x in (0, 50) for y in (0, 50) for up in (0, 5)])
    z, normal = seen(quarter) or (0.0, [])  # it is over one corner of the window, at (1, 2)
    assert z == pytest.approx(9.0)
    assert normal == pytest.approx(np.array([-1 / 2, -1 / 4, -1]) / np.sqrt(1.3125))
    assert seen(np.add(flat, [51.5, 0.0, 0.0])) is None
    assert seen(np.add(flat, [50.5, 0.0, 0.0])) == (10.0, pytest.approx([0, 0, -1]))


def test_a_section_of_a_pyramid() -> None:
    """With its point up, all below a height is its foot; with its point down, what is cut off."""
    foot = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0], [0, 0, 1.0]])
    up, down = from_points(foot), from_points(foot * [1, 1, -1])
    square = {(x, y) for x in (-1, 1) for y in (-1, 1)}
    assert {tuple(p) for p in section_below(up, 0.0).tolist()} == square
    found = {tuple(p) for p in np.round(section_below(up, 0.25), 9).tolist()}
    assert square < found
    assert found <= square | {(x, y) for x in (-0.75, 0, 0.75) for y in (-0.75, 0, 0.75)}
    assert {(x, y) for x in (-0.75, 0.75) for y in (-0.75, 0.75)} <= found
    assert {tuple(p) for p in np.round(section_below(down, -0.75), 9).tolist()} == {(0, 0), *((x / 4, y / 4) for x, y in square)}
    assert len(section_below(up, -0.1)) == 0
    assert {tuple(p) for p in section_below(down, 0.0).tolist()} == {(0, 0), *square}
