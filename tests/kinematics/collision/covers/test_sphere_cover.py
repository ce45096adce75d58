"""Covers contain what they cover, reach no further than they may, and their inner balls lie inside."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import airo_models
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from kinematics.collision.covers import grids as cover_grid
from kinematics.collision.covers import levels as cover_levels
from kinematics.collision.covers import set_cover as set_covers
from kinematics.collision.covers import sphere_cover
from kinematics.collision.robot_model import link_covers
from kinematics.robots.load import load
from kinematics.shapes import box_corners, prism
from kinematics.transforms import apply, rotation_about, transform

MODELS = Path(airo_models.__file__).parent
LINKS = [MODELS / f"arms/ur5e/collision/{name}.obj" for name in ("shoulder", "wrist1", "wrist2", "wrist3", "forearm")] + [
    MODELS / f"grippers/robotiq_2f_85/meshes/collision/robotiq_arg2f_85_{name}.obj"
    for name in ("inner_finger", "outer_finger", "outer_knuckle")
]

OWN_ARM = Path(__file__).resolve().parents[4] / "examples" / "04_own_arm" / "arm.urdf"


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def link_hull(file):
    mesh = trimesh.load(file, force="mesh")
    return np.asarray(mesh.convex_hull.vertices, float) * (0.001 if "robotiq" in str(file) else 1.0)


def random_polytope(seed):
    rng = np.random.default_rng([11, seed])
    return rng.normal(size=(rng.integers(5, 40), 3)) * rng.uniform(0.01, 0.06, 3)


def inside(vertices, n, rng):
    """Points (n, 3) all over the hull: uniform, on its faces, on its edges, and its corners."""
    hull = ConvexHull(vertices)
    corners = vertices[hull.vertices]
    deep = rng.dirichlet(np.full(len(corners), 4 / len(corners)), n) @ corners
    t = vertices[hull.simplices[rng.integers(0, len(hull.simplices), n)]]
    faces = np.einsum("nk,nki->ni", rng.dirichlet((1, 1, 1), n), t)
    u = rng.random((n, 1))
    return np.concatenate([deep, faces, u * t[:, 0] + (1 - u) * t[:, 1], corners])


def depths(vertices, points):
    """How far inside the hull points lie (N,), negative outside (there a bound)."""
    planes = ConvexHull(vertices).equations
    return -(points @ planes[:, :3].T + planes[:, 3]).max(1)


def sure(vertices, cover, excess):
    """Assert all that a cover promises: by samples, by the proof, and by the planes of the hull."""
    rng = np.random.default_rng(3)
    points = inside(vertices, 3000, rng)
    in_ball = np.zeros(len(points), bool)
    for c, r in zip(cover.centres, cover.radii, strict=True):
        in_ball |= ((points - c) ** 2).sum(1) <= r * r
    assert in_ball.all()
    assert len(sphere_cover.uncovered(vertices, cover)) == 0
    depth = depths(vertices, cover.centres)
    assert (depth > -1e-9).all()
    # a ball about c with the radius depth(c) is inside, so one larger by the excess reaches no further out than that
    assert (cover.radii <= depth + excess + 1e-9).all()
    assert (cover.inner_radii() <= np.maximum(depth, 0) + 1e-12).all()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("excess", [0.02, 0.006])
def test_covers_of_random_polytopes(seed, excess):
    vertices = random_polytope(seed)
    sure(vertices, sphere_cover.cover(vertices, excess), excess)


@pytest.mark.parametrize("file", LINKS, ids=lambda f: f.stem)
def test_covers_of_robot_links(file):
    vertices = link_hull(file)
    for excess in (0.02, 0.01) if "forearm" in file.stem else (0.02, 0.005):
        sure(vertices, sphere_cover.cover(vertices, excess), excess)


def test_a_missing_ball_is_found_out():
    vertices = random_polytope(1)
    whole = sphere_cover.cover(vertices, 0.01)
    assert len(whole.radii) > 3
    for i in range(len(whole.radii)):
        left = sphere_cover.Cover(np.delete(whole.centres, i, 0), np.delete(whole.radii, i), 0.01)
        gaps = sphere_cover.uncovered(vertices, left)
        if len(gaps) == 0:  # a ball may be superfluous, though hardly ever
            continue
        distance = np.linalg.norm(gaps[:, None] - left.centres, axis=2) - left.radii
        assert (distance.min(1) > -1e-6).all()
        assert (depths(vertices, gaps) > -1e-9).all()


def test_a_shell_of_balls_is_no_cover():
    """All of the surface in balls, and a hole in the middle: a body in the hole would be missed."""
    cube = box_corners(np.full(3, 0.1))
    side = np.linspace(-0.1, 0.1, 21)
    grid = np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3)
    shell = grid[(np.abs(grid).max(1) > 0.0999)]
    gaps = sphere_cover.uncovered(cube, sphere_cover.Cover(shell, np.full(len(shell), 0.02), 0.02))
    assert len(gaps) > 0
    assert (np.abs(gaps).max(1) < 0.099).all()


@pytest.mark.parametrize("seed", range(12))
def test_boxes_and_cylinders(seed):
    rng = np.random.default_rng([13, seed])
    for excess in (0.02, 0.005):
        size = tuple(rng.uniform(0.004, 0.26, 3))
        box, _ = cover_grid.box_cover(size, excess)
        sure(box_corners(np.array(size) / 2), box, excess)
        radius, height = rng.uniform(0.004, 0.08), rng.uniform(0.01, 0.3)
        can = cover_grid.cylinder_cover(radius, height, excess)
        outside = prism(radius, height)
        assert len(sphere_cover.uncovered(outside, can)) == 0
        rho, z = np.hypot(can.centres[:, 0], can.centres[:, 1]), np.abs(can.centres[:, 2])
        depth = np.minimum(radius - rho, height / 2 - z)
        assert (depth > -1e-9).all()
        assert (can.radii <= depth + excess + 1e-9).all()


@pytest.mark.parametrize("kind", ["polytope", "box", "cylinder"])
def test_levels_list_every_fine_ball_that_a_coarse_one_needs(kind):
    if kind == "polytope":
        vertices = random_polytope(5)
        levels = cover_levels.levels(vertices, 0.02, 0.006)
    elif kind == "box":
        vertices, levels = box_corners(np.array([0.03, 0.025, 0.08])), cover_levels.box_levels((0.06, 0.05, 0.16))
    else:
        vertices, levels = prism(0.03, 0.15), cover_levels.cylinder_levels(0.03, 0.15)
    points = inside(vertices, 2000, np.random.default_rng(0))
    in_coarse = ((points[:, None] - levels.coarse.centres) ** 2).sum(2) <= levels.coarse.radii**2
    in_fine = ((points[:, None] - levels.fine.centres) ** 2).sum(2) <= levels.fine.radii**2
    listed = np.zeros((len(levels.coarse.radii), len(levels.fine.radii)), bool)
    for i in range(len(listed)):
        listed[i, levels.child[levels.start[i] : levels.start[i + 1]]] = True
    # for every point some coarse ball holds it and lists a fine ball that holds it
    assert (in_coarse[:, :, None] & listed[None] & in_fine[:, None, :]).any((1, 2)).all()
    # whichever coarse balls miss a body: the points that the fine balls listed by the others leave out lie in the ones that miss
    for gone in range(len(listed)):
        left = ~(in_fine & listed[np.arange(len(listed)) != gone].any(0)).any(1)
        assert in_coarse[left, gone].all()


def test_levels_come_from_the_disk_the_second_time():
    vertices, lines = random_polytope(2), []
    first = cover_levels.levels(vertices, on_step=lines.append)
    made = len(lines)
    second = cover_levels.levels(vertices, on_step=lines.append)
    assert made > 0
    assert len(lines) == made
    for a, b in zip(
        (first.coarse.centres, first.fine.radii, first.start, first.child),
        (second.coarse.centres, second.fine.radii, second.start, second.child),
        strict=True,
    ):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("size", [(0.1, 0.1, 2.0), (0.3, 0.2, 1.6), (0.01, 0.7, 0.6)], ids=["a mast", "a column", "a plate"])
def test_a_large_link_has_a_coarser_cover_which_ends_and_contains_it(size):
    """Its proof would find three counterexamples in each of twelve tetrahedra a round, and thousands of balls are wanted."""
    rounds, T = [], transform(rotation_about((1, 2, 3), 0.7), (0.1, -0.2, 0.3))
    vertices = apply(T, box_corners(np.array(size) / 2))
    long = max(cover_levels.LONG_M, float(np.ptp(vertices, axis=0).max()))
    balls = cover_levels.levels(vertices, on_step=rounds.append)
    assert len(rounds) < 150
    assert len(balls.fine.radii) < 1500
    for cover, usual in ((balls.coarse, cover_levels.COARSE_M), (balls.fine, cover_levels.FINE_M)):
        assert usual * (long / cover_levels.LONG_M) ** 2 <= cover.excess_m + 1e-9 <= 0.12
        sure(vertices, cover, cover.excess_m)


def test_a_long_bar_is_covered_within_thirty_rounds():
    """Of a frame's beams there are dozens. Its hull has twelve tetrahedra, and three counterexamples in each took a hundred rounds."""
    rounds = []
    vertices = box_corners(np.array([0.41, 0.015, 0.015]))
    sure(vertices, sphere_cover.cover(vertices, cover_levels.FINE_M, on_step=rounds.append), cover_levels.FINE_M)
    assert len(rounds) <= 30


@pytest.mark.parametrize("seed", range(4))
def test_what_a_set_cover_is_told_of_samples_and_balls_is_so(seed, monkeypatch):
    """Which ball holds which sample is asked of samples in a row along one axis alone: it is what all distances say."""
    rng, seen = np.random.default_rng([12, seed]), []
    centres, radii = rng.normal(size=(60, 3)) * (0.3, 0.05, 0.02), rng.uniform(0.0, 0.1, 60)
    samples = np.concatenate([rng.normal(size=(300, 3)) * (0.3, 0.05, 0.02), centres + radii[:, None] * (1, 0, 0)])  # on balls, too
    usual = set_covers.weighted_set_cover
    monkeypatch.setattr(set_covers, "weighted_set_cover", lambda holds, n, *rest: seen.append(holds.copy()) or usual(holds, n, *rest))
    chosen = set_covers.set_cover(centres, radii, samples, np.zeros(0, np.int64))
    inside = np.linalg.norm(centres[:, None] - samples, axis=2) - radii[:, None]
    bits = np.unpackbits(seen[0].view(np.uint8), axis=1, bitorder="little")[:, : len(samples)]
    order = np.argsort(samples[:, 0])
    clear = np.abs(inside[:, order]) > 1e-9
    assert clear.mean() > 0.99
    assert np.array_equal(bits[clear].astype(bool), inside[:, order][clear] < 0)
    assert (inside[chosen] <= 1e-9).any(0)[(inside < -1e-9).any(0)].all()


@pytest.mark.parametrize("seed", range(4))
def test_a_set_cover_that_grows_is_that_of_all_at_once(seed):
    rng, held = np.random.default_rng([13, seed]), set_covers.Held()
    balls, samples = rng.normal(size=(90, 3)) * (0.2, 0.1, 0.02), rng.normal(size=(500, 3)) * (0.2, 0.1, 0.02)
    radii, at, to = rng.uniform(0.02, 0.15, 90), 0, 0
    for more_balls, more_samples in ((40, 200), (0, 64), (1, 1), (49, 235)):
        some, points = slice(at, at + more_balls), slice(to, to + more_samples)
        held.add(balls[some], radii[some], samples[points])
        at, to = some.stop, points.stop
        assert np.array_equal(held.cover(), set_covers.set_cover(balls[:at], radii[:at], samples[:to], np.zeros(0, np.int64)))
    assert (at, to) == (90, 500)


def test_making_a_robots_covers_is_told_once_and_what_is_made_is_not():
    """A robot of one's own takes seconds, and nobody should wait for them without a word."""
    robot, told = load(str(OWN_ARM)), []
    link_covers(robot, told.append)
    link_covers(robot, told.append)
    link_covers(replace(robot), told.append)  # another object: its covers come from the disk
    assert told == [f"covering the {len(robot.hulls)} convex parts of {Path(robot.name).stem} with balls"]


def test_moved_levels_cover_the_moved_solid():
    vertices = random_polytope(3)
    T = transform(rotation_about((1, 2, 3), 0.7), (0.1, -0.2, 0.3))
    there = cover_levels.moved(cover_levels.levels(vertices, 0.02, 0.01), T)
    sure(apply(T, vertices), there.coarse, 0.02)
    sure(apply(T, vertices), there.fine, 0.01)


def test_what_has_no_volume_is_refused():
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    with pytest.raises(ValueError, match="no volume"):
        sphere_cover.cover(flat, 0.01)
    with pytest.raises(ValueError, match="finite"):
        sphere_cover.cover(np.full((5, 3), np.nan), 0.01)
    with pytest.raises(ValueError, match="positive"):
        sphere_cover.cover(random_polytope(0), 0.0)
    with pytest.raises(ValueError, match="positive"):
        cover_grid.box_cover((0.1, 0.0, 0.1), 0.01)
    with pytest.raises(ValueError, match="positive"):
        cover_grid.cylinder_cover(0.1, -1.0, 0.01)


@pytest.mark.parametrize("name", ["ur5e", "panda", "gen3"])
def test_the_covers_that_ship_are_those_of_the_named_robots_and_contain_their_hulls(name, monkeypatch):
    hulls = load(name).hulls
    monkeypatch.setattr(cover_levels, "_derived", None)  # to derive one would fail: `make covers` makes them again
    for hull in hulls:
        found = cover_levels.levels(hull.vertices)
        for cover in (found.coarse, found.fine):
            assert len(sphere_cover.uncovered(hull.vertices, cover)) == 0
    monkeypatch.undo()
    smallest = min(hulls, key=lambda hull: len(hull.vertices))
    for made, kept in zip(cover_levels.derived(smallest.vertices)[1].values(), cover_levels.levels(smallest.vertices)[:2]):
        assert np.array_equal(made, np.c_[kept.centres, kept.radii])
