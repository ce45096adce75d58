"""Meshes as scans are: their convex parts contain them, stay hollow where they are, and are the same every time."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from union_volume import union_volume

from kinematics import cache
from kinematics.meshes import load as loading
from kinematics.meshes.containment import largest_protrusion
from kinematics.meshes.cutting import cut, hull_volume, planes_of
from kinematics.meshes.decomposition import Decomposition, simplified
from kinematics.meshes.inside import fill
from kinematics.meshes.load import PROTRUSION_M, convex_parts_of, load_mesh
from kinematics.meshes.parts import joined, thinned
from kinematics.meshes.surface import Surface, clean_surface
from kinematics.shapes import bounds
from kinematics.transforms import Array

QUICK = Decomposition(parts=10, cells=10, offsets=3)
MUG = np.array([[0, 0], [0.04, 0], [0.04, 0.09], [0.034, 0.09], [0.034, 0.008], [0, 0.008]])
"""Half of a mug's section, radius and height."""


def dented_sphere(rng: np.random.Generator) -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    for at in rng.normal(size=(3, 3)):
        near = np.linalg.norm(ball.vertices / 0.05 - at / np.linalg.norm(at), axis=1)
        ball.vertices *= 1 - 0.4 * np.exp(-((near / 0.5) ** 2))[:, None]
    return ball


def ell(rng: np.random.Generator) -> trimesh.Trimesh:
    a, b, c = rng.uniform(0.02, 0.06, 3)
    post, foot = trimesh.creation.box((a, c, 0.1)), trimesh.creation.box((a + b, c, 0.02))
    return trimesh.util.concatenate([post, foot.apply_translation((b / 2, 0, -0.06))])


def mug(rng: np.random.Generator) -> trimesh.Trimesh:
    """A cup with a handle that reaches into its wall: two bodies."""
    handle = trimesh.creation.torus(0.022, 0.005, major_sections=12, minor_sections=6)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    return trimesh.util.concatenate([trimesh.creation.revolve(MUG, sections=24), handle.apply_translation((0.055, 0, 0.045))])


def bowl(rng: np.random.Generator) -> trimesh.Trimesh:
    """An open surface without thickness."""
    angle = np.linspace(-np.pi / 2, 0.2, 7)
    return trimesh.creation.revolve(np.c_[0.05 * np.cos(angle), 0.05 * np.sin(angle)], sections=16)


def punctured(rng: np.random.Generator) -> trimesh.Trimesh:
    """A sphere with holes, split vertices, some faces turned, one doubled, one degenerate, and a second sphere within."""
    ball = dented_sphere(rng)
    faces = ball.faces[rng.permutation(len(ball.faces))[:-4]]
    faces[:20] = faces[:20, ::-1]
    faces = np.concatenate([faces, faces[:1], faces[:1, [0, 0, 1]]])
    outer = trimesh.Trimesh(ball.vertices, faces, process=False)
    outer.unmerge_vertices()
    return trimesh.util.concatenate([outer, trimesh.creation.icosphere(subdivisions=1, radius=0.02)])


MESHES: list[Callable[[np.random.Generator], trimesh.Trimesh]] = [dented_sphere, ell, mug, bowl, punctured]


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    mesh = mesh.copy()
    mesh.merge_vertices()
    return clean_surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))


def outside(points: Array, parts: list[Array]) -> Array:
    """How far points (N, 3) are outside the union of parts (N,), negative within; by the parts' planes."""
    return np.min([(points @ e[:, :3].T - e[:, 3]).max(1) for e in map(planes_of, parts)], axis=0)


@pytest.mark.parametrize(
    ("make", "seed", "fill"),
    [(dented_sphere, 1, 1.1), (dented_sphere, 2, 1.1), (ell, 3, 1.01), (mug, 4, 2.5), (bowl, 5, None), (punctured, 6, 1.15)],
)
def test_the_parts_contain_the_mesh_and_hardly_more(
    make: Callable[[np.random.Generator], trimesh.Trimesh], seed: int, fill: float | None
) -> None:
    """fill: the volume of the parts over that of the solid, at most."""
    mesh = make(np.random.default_rng(seed))
    whole = dented_sphere(np.random.default_rng(seed)) if make is punctured else mesh
    mesh.apply_translation((0.3, -0.2, 0.1))
    parts = convex_parts_of(surface_of(mesh), "x", QUICK)
    assert 1 <= len(parts) <= QUICK.parts
    points, _ = trimesh.sample.sample_surface(mesh, 20_000, seed=seed)
    assert outside(np.concatenate([points, mesh.vertices]), parts).max() <= PROTRUSION_M
    if fill is not None:
        assert 0.98 * whole.volume <= union_volume(parts) <= fill * whole.volume


def test_a_mug_stays_hollow_and_its_handle_open() -> None:
    parts = convex_parts_of(surface_of(mug(np.random.default_rng(0))), "mug")
    free = np.array([[0, 0, 0.05], [0.02, 0, 0.08], [0, -0.025, 0.03], [0.055, 0, 0.045], [0.05, 0, 0.05]])
    assert outside(free, parts).min() > 0.002
    assert len(parts) <= 32


def test_a_bowl_without_thickness_is_its_shell() -> None:
    parts = convex_parts_of(surface_of(bowl(np.random.default_rng(0))), "bowl", QUICK)
    assert outside(np.array([[0, 0, 0.0], [0, 0, 0.02]]), parts).min() > 0.005
    assert min(hull_volume(p) for p in parts) > 0


def test_the_proof_finds_what_sticks_out_between_the_vertices() -> None:
    """Both boxes hold all vertices of the plate, and neither its middle."""
    plate = Surface(np.array([[-0.1, 0, 0], [0.1, 0, 0], [0.1, 0.01, 0], [-0.1, 0.01, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    box = np.asarray(trimesh.creation.box((0.06, 0.06, 0.02)).vertices)
    ends = [box + np.array([x, 0, 0]) for x in (0.1, -0.1)]
    assert outside(plate.vertices, ends).max() < 0
    assert largest_protrusion(plate, ends) == pytest.approx(0.07, abs=2e-4)
    assert largest_protrusion(plate, [*ends, box * (3, 1, 1)]) <= PROTRUSION_M
    assert largest_protrusion(plate, []) == np.inf


@pytest.mark.parametrize("seed", range(5))
def test_a_cut_keeps_the_surface(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(200, 3, 3))
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    triangles[:20] -= (triangles[:20] @ normal - 0.1)[..., None] * normal  # in the plane
    triangles[20:40, 0] -= (triangles[20:40, 0] @ normal - 0.1)[..., None] * normal  # a corner in it
    down, up = cut(triangles, normal, 0.1)
    area = [np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum() for t in (triangles, down, up)]
    assert area[1] + area[2] == pytest.approx(area[0])
    assert (down @ normal).max() <= 0.1 + 1e-8
    assert (up @ normal).min() >= 0.1 - 1e-8


def test_thinned_corners_hold_the_others_to_the_slack() -> None:
    points = np.random.default_rng(3).normal(size=(400, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1)[:, None]
    few = thinned(points, 0.002)
    assert len(few) < 200
    assert 0 < outside(points, [few]).max() <= 0.002
    np.testing.assert_array_equal([few.min(0), few.max(0)], [points.min(0), points.max(0)])


def test_thinning_a_fine_ball_takes_little_memory() -> None:
    """All distances of its corners to the faces at once are 600 MB, and of a finer one more than a machine has."""
    points = np.asarray(trimesh.creation.icosphere(subdivisions=5, radius=0.035).vertices)
    tracemalloc.start()
    few = thinned(points, 4e-5)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(few) < len(points) / 2
    assert peak < 50e6


def test_small_holes_are_filled_and_large_ones_are_not() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    small = surface_of(trimesh.Trimesh(ball.vertices, ball.faces[1:]))
    assert (small.filled, small.closed) == (1, True)
    assert len(fill(small).points) > 1000
    half = surface_of(trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] < 0]))
    assert (half.filled, half.closed, len(fill(half).points)) == (0, False, 0)


def test_a_simplified_surface_is_small_and_near() -> None:
    surface = surface_of(trimesh.creation.icosphere(subdivisions=5, radius=0.05))
    few = simplified(surface, 2000)
    assert 500 < len(few.faces) < 4000
    assert np.abs(np.linalg.norm(few.vertices, axis=1) - 0.05).max() < 0.003


def test_a_mesh_is_taken_apart_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By content: another name or time changes nothing, another scale or a damaged entry does; the same parts every time."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    ell(np.random.default_rng(0)).export(tmp_path / "a.stl")
    shares: list[float] = []
    first = load_mesh(tmp_path / "a.stl", on_share=shares.append)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert shares == sorted(shares)
    (entry,) = cache.folder().glob("mesh-*")
    (tmp_path / "b.stl").write_bytes((tmp_path / "a.stl").read_bytes())

    def refuse(*_: object) -> list[Array]:
        raise AssertionError("it is known")

    with monkeypatch.context() as known:
        known.setattr(loading, "convex_parts_of", refuse)
        again = load_mesh(tmp_path / "b.stl", name="b")
        assert (again.file, len(again.parts)) == ("b", len(first.parts))
        with pytest.raises(AssertionError):
            load_mesh(tmp_path / "a.stl", 2.0)
    entry.write_bytes(entry.read_bytes()[:-3])
    fresh = load_mesh(tmp_path / "a.stl")
    for a, b, c in zip(first.parts, again.parts, fresh.parts):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (1.0, "is 100 m large at scale 1, and 0.001 to 3 m are allowed; is it in millimetres? then its scale is 0.001"),
        (1e-6, "scale is 0.001"),
    ],
)
def test_a_wrong_scale_is_an_error_that_names_the_right_one(tmp_path: Path, scale: float, words: str) -> None:
    trimesh.creation.box((50, 60, 100)).export(tmp_path / "box.stl")
    with pytest.raises(ValueError, match="box") as e:
        load_mesh(tmp_path / "box.stl", scale)
    assert words in str(e.value)


def test_a_scanned_object_stands_on_its_lowest_point(tmp_path: Path) -> None:
    mesh = dented_sphere(np.random.default_rng(7))
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(np.array([0.2, 0.5, 0.8])))
    mesh.export(tmp_path / "ball.ply")
    low, high = bounds(load_mesh(tmp_path / "ball.ply", how=QUICK), np.eye(4))
    np.testing.assert_allclose([low, high], mesh.bounds, atol=1e-6)


def test_boxes_in_a_row_are_joined_and_a_corner_is_not() -> None:
    box = np.asarray(trimesh.creation.box((0.02, 0.02, 0.02)).vertices)
    row, corner = [box + np.array([0.02 * k, 0, 0]) for k in range(5)], box + np.array([0, 0, 0.02])
    assert sorted(len(joined(row, most)[0]) for most in (1, 32)) == [8, 8]
    assert [len(joined([*row, corner], most)) for most in (32, 1)] == [2, 1]


@pytest.mark.parametrize("corner", [8, 56069, -1])
def test_faces_with_corners_that_are_not_there_are_refused(tmp_path: Path, corner: int) -> None:
    file = tmp_path / "box.ply"
    trimesh.creation.box().export(file, encoding="ascii")
    lines = file.read_text().splitlines()
    lines[-1] = f"3 0 1 {corner}"
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=r"box\.ply"):
        load_mesh(file)


def test_a_vertex_without_three_numbers_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "box.obj"
    trimesh.creation.box().export(file)
    lines = file.read_text().splitlines()
    lines[next(i for i, line in enumerate(lines) if line.startswith("v "))] = "v 000"
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=r"box\.obj"):
        load_mesh(file)
