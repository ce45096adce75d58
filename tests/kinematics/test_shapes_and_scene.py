"""Shapes and the words of a scene: bounds, convex parts, meshes, cabinet, regions, states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.collision.geometry import BOX, CYLINDER, HULL, make_solids
from kinematics.meshes.load import load_mesh
from kinematics.scene import WALLS, Body, Cabinet, Grasp, Held, RobotRef, Scene, State, object_box
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds, box_corners, convex_parts, prism
from kinematics.transforms import Array, apply, inverse, rotation_about, transform

seeds = st.integers(0, 2**32 - 1)
sizes = st.floats(0.005, 0.5)


def any_T(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return transform(rotation_about(rng.normal(size=3), rng.uniform(-3, 3)), rng.normal(size=3))


def surface(shape: Shape, n: int = 2000) -> Array:
    """Points (·, 3) all over a shape's surface, in its frame."""
    match shape:
        case Box():
            return box_corners(shape.half)
        case Cylinder():
            angle = np.linspace(0, 2 * np.pi, n)
            rim = np.c_[shape.radius_m * np.cos(angle), shape.radius_m * np.sin(angle), np.full(n, shape.height_m / 2)]
            return np.concatenate([rim, rim * [1, 1, -1]])
        case ConvexMesh():
            return np.concatenate(shape.parts)


@given(seeds, sizes, sizes, sizes)
@settings(max_examples=50)
def test_bounds_are_tight(seed: int, x: float, y: float, z: float) -> None:
    T = any_T(seed)
    mesh = ConvexMesh((np.random.default_rng(seed).uniform(-x, x, (20, 3)), np.random.default_rng(seed).uniform(-y, z, (9, 3))))
    for shape in (Box(np.array([x, y, z])), Cylinder(x, y), mesh):
        low, high = bounds(shape, T)
        points = apply(T, surface(shape))
        np.testing.assert_allclose(low, points.min(0), atol=2e-6 * max(x, y, 1))
        np.testing.assert_allclose(high, points.max(0), atol=2e-6 * max(x, y, 1))


@given(sizes, sizes)
@settings(max_examples=30)
def test_a_prism_contains_its_cylinder(radius: float, height: float) -> None:
    vertices = prism(radius, height)
    side = np.linalg.norm(vertices[:, :2], axis=1)
    assert side == pytest.approx(np.full(len(vertices), radius / np.cos(np.pi / 48)))
    middles = (vertices[:48] + np.roll(vertices[:48], 1, axis=0)) / 2
    assert np.linalg.norm(middles[:, :2], axis=1) == pytest.approx(np.full(48, radius))
    np.testing.assert_allclose(np.ptp(vertices[:, 2]), height)


def test_convex_parts_of_every_shape() -> None:
    assert [p.shape for p in convex_parts(Box(np.ones(3)))] == [(8, 3)]
    assert [p.shape for p in convex_parts(Cylinder(1.0, 1.0))] == [(96, 3)]
    two = ConvexMesh((np.zeros((4, 3)), np.ones((5, 3))))
    assert convex_parts(two) == two.parts
    np.testing.assert_array_equal(two.half, [0.5, 0.5, 0.5])


# ------------------------------------------------------------------------------------------------------------------------- meshes


def test_a_convex_mesh_is_its_hull(tmp_path: Path) -> None:
    trimesh.creation.cylinder(radius=30, height=100).export(tmp_path / "can.stl")
    can = load_mesh(tmp_path / "can.stl", 0.001, "can.stl")
    assert (len(can.parts), can.file, can.scale) == (1, "can.stl", 0.001)
    np.testing.assert_allclose(can.half, [0.03, 0.03, 0.05], atol=1e-4)


def test_a_mesh_that_is_not_convex_is_decomposed(tmp_path: Path) -> None:
    """An L keeps its notch free."""
    ell = _extruded(np.array([[0, 0], [0.1, 0], [0.1, 0.02], [0.02, 0.02], [0.02, 0.1], [0, 0.1]]), 0.02)
    ell.export(tmp_path / "ell.ply")
    shape = load_mesh(tmp_path / "ell.ply")
    assert len(shape.parts) >= 2
    hulls = [trimesh.convex.convex_hull(p) for p in shape.parts]
    assert sum(h.volume for h in hulls) == pytest.approx(ell.volume, rel=0.1)


def _extruded(outline: Array, height: float) -> trimesh.Trimesh:
    """An L-shaped outline (6, 2) as a prism, triangulated by hand."""
    n = len(outline)
    vertices = np.concatenate([np.c_[outline, np.zeros(n)], np.c_[outline, np.full(n, height)]])
    cap = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    sides = [[i, (i + 1) % n, n + (i + 1) % n] for i in range(n)] + [[i, n + (i + 1) % n, n + i] for i in range(n)]
    return trimesh.Trimesh(vertices, np.concatenate([cap[:, ::-1], cap + n, sides]))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("absent.stl", None, "does not exist"),
        ("empty.stl", b"", r"can't be read|holds no triangles: it is empty"),
        ("fetched.stl", b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 84\n", "git lfs pull"),
        ("words.obj", b"not a mesh", r"can't be read|holds no triangles"),
        ("odd.xyz9", b"1 2 3", r"can't be read"),
        ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 3 4\n", "no volume"),
        ("nan.obj", b"v nan 0 0\nv 0 1 0\nv 0 0 1\nv 1 1 1\nf 1 2 3\nf 2 3 4\n", "has vertices that are no numbers"),
        ("point.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "holds no solid, but 3 corners in a plane"),
    ],
)
def test_files_that_are_no_solids(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=message) as e:
        load_mesh(tmp_path / name)
    assert name in str(e.value)


# -------------------------------------------------------------------------------------------------------------------------- scene


CABINET = Cabinet(np.array([0.5, 0.8, 0.4]), transform(rotation_about((0, 0, 1), 0.5), [1.0, 2.0, 0.3]), 0.03)


def test_walls_leave_the_inner_space_free() -> None:
    """Points within the cabinet, up to its edges, lie in no wall; points just outside do, but for the open front."""
    walls = CABINET.walls()
    assert tuple(w.name for w in walls) == WALLS

    def inside(p: list[float]) -> list[str]:
        world = CABINET.T_world_cabinet @ [*p, 1.0]
        return [w.name for w in walls if (np.abs((inverse(w.T_world_body) @ world)[:3]) < w.shape.half).all()]  # type: ignore[union-attr]

    hair = 1e-6
    rng = np.random.default_rng(0)
    for p in rng.uniform([0, -0.4, 0], [0.5, 0.4, 0.4], (200, 3)):
        assert inside(list(p)) == []
        assert CABINET.contains((CABINET.T_world_cabinet @ [*p, 1.0])[:3])
    for x, y, z, wall in [(0.2, 0.1, -hair, "floor"), (0.2, 0.1, 0.4 + hair, "ceiling"), (0.2, 0.4 + hair, 0.2, "left"),
                          (0.2, -0.4 - hair, 0.2, "right"), (0.5 + hair, 0.1, 0.2, "back"), (hair, 0.41, 0.2, "left")]:  # fmt: skip
        assert inside([x, y, z]) == [wall]
        assert not CABINET.contains((CABINET.T_world_cabinet @ [x, y, z, 1.0])[:3])
    assert inside([-hair, 0.1, 0.2]) == []
    for corner in ([0.51, 0.41, 0.2], [0.51, -0.41, -0.01], [0.2, 0.41, 0.41]):
        assert inside(corner)  # no gap where walls meet


@pytest.mark.parametrize("n", [1, 3, 10])
def test_regions_tile_the_floor(n: int) -> None:
    cells = apply(inverse(CABINET.T_world_cabinet), CABINET.regions(n))
    assert cells.shape == (n * n, 3)
    np.testing.assert_allclose(cells[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(cells.mean(0), [0.25, 0, 0], atol=1e-12)
    np.testing.assert_allclose(cells[0, :2], [0.5 / n / 2, -0.4 + 0.8 / n / 2], atol=1e-12)  # row 0 in front, column 0 on the right
    if n > 1:
        np.testing.assert_allclose(cells[1] - cells[0], [0, 0.8 / n, 0], atol=1e-12)
        np.testing.assert_allclose(cells[n] - cells[0], [0.5 / n, 0, 0], atol=1e-12)


def test_states_know_which_objects_stand() -> None:
    bodies = (Body("a", Box(np.ones(3)), np.eye(4)), Body("b", Cylinder(0.1, 0.2), transform(p=[1, 0, 0])))
    scene = Scene("s", RobotRef(np.eye(4), "ur5e"), CABINET, bodies, "b", Grasp(np.eye(4), 0.05), regions_n=4)
    assert list(scene.poses()) == ["a", "b"]
    assert scene.body("b") is bodies[1]
    with pytest.raises(KeyError):
        scene.body("c")
    assert scene.regions().shape == (16, 3)
    moved = transform(p=[2, 0, 0])
    (standing,) = State(np.zeros(7), {"a": moved}, Held("b", np.eye(4))).bodies(scene)
    assert standing.name == "a"
    np.testing.assert_array_equal(standing.T_world_body, moved)


def test_the_papers_box_of_an_object() -> None:
    T = transform(rotation_about((0, 0, 1), np.pi / 4), [1, 2, 3])
    np.testing.assert_allclose(object_box(Body("a", Box(np.array([1.0, 1.0, 2.0])), T)), [1, 2, 3, 2**0.5, 2**0.5, 2])
    np.testing.assert_allclose(object_box(Body("b", Cylinder(0.5, 2.0), T)), [1, 2, 3, 1, 1, 2])
    wedge = ConvexMesh((np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),))
    np.testing.assert_allclose(object_box(Body("c", wedge, transform(p=[1, 1, 1]))), [1.5, 1.5, 1.5, 1, 1, 1])


# --------------------------------------------------------------------------------------------------------- arrays for compiled code


def test_solids_and_parts_hold_what_they_are_given() -> None:
    T = any_T(3)
    mesh = ConvexMesh((box_corners(np.array([0.1, 0.2, 0.3])), prism(0.1, 0.2)))
    bodies = [Body("a", Box(np.array([0.2, 0.4, 0.6])), T), Body("b", mesh, T), Body("c", Cylinder(0.1, 0.4), T)]
    solids, names = make_solids(bodies)
    assert names == ["a", "b", "b", "c"]
    assert solids.kind.tolist() == [BOX, HULL, HULL, CYLINDER]
    np.testing.assert_allclose(solids.half[3], [0.1, 0.1, 0.2])
    for i, part in ((1, mesh.parts[0]), (2, mesh.parts[1])):
        np.testing.assert_array_equal(solids.vertices[solids.start[i] : solids.start[i + 1]], part)
    for i, body in enumerate([bodies[0], None, None, bodies[2]]):
        if body:
            points = apply(T, surface(body.shape))
            assert (np.linalg.norm(points - solids.centre[i], axis=1) <= solids.radius[i] + 1e-12).all()
    empty, none = make_solids([])
    assert none == []
    assert empty.T.shape == (0, 4, 4)
