"""GJK against FCL, against what geometry says, and where it could stumble."""

from __future__ import annotations

import fcl
import numpy as np
import pytest
from random_arms import random_pose
from scipy.spatial import ConvexHull
from small_queries import by_coordinate, separated_by

from kinematics.collision.geometry import BOX, CYLINDER, HULL
from kinematics.collision.gjk import box_gap, distance, make_work, relative, support
from kinematics.collision.vertex_groups import grouped
from kinematics.shapes import box_corners
from kinematics.transforms import Array, apply, rotation_about, transform

NONE = np.zeros(3)
CUBE = box_corners(np.full(3, 0.5))


def fcl_hull(points: Array) -> tuple[Array, fcl.Convex]:
    """The hull's vertices and FCL's solid of it, faces outward."""
    hull = ConvexHull(points)
    faces = np.searchsorted(np.sort(hull.vertices), hull.simplices)
    v = points[np.sort(hull.vertices)]
    outward = np.einsum("fc,fc->f", np.cross(v[faces[:, 1]] - v[faces[:, 0]], v[faces[:, 2]] - v[faces[:, 0]]), hull.equations[:, :3]) > 0
    faces[~outward] = faces[~outward][:, [0, 2, 1]]
    return v, fcl.Convex(v, len(faces), np.c_[np.full(len(faces), 3), faces].ravel())


def fcl_distance(a: fcl.CollisionGeometry, T_a: Array, b: fcl.CollisionGeometry, T_b: Array) -> float:
    objects = [fcl.CollisionObject(g, fcl.Transform(T[:3, :3], T[:3, 3])) for g, T in ((a, T_a), (b, T_b))]
    return max(0.0, float(fcl.distance(*objects, fcl.DistanceRequest(), fcl.DistanceResult())))


def ask(a: Array, T_a: Array, kind: int, half: Array, b: Array, T_b: Array) -> float:
    """Our distance, without a warm start."""
    n = len(a)
    return distance(by_coordinate(np.concatenate([a, b])), 0, n, T_a, kind, half, n, n + len(b), T_b, make_work())


@pytest.mark.parametrize("kind", [BOX, CYLINDER, HULL])
def test_agrees_with_fcl(kind: int) -> None:
    rng = np.random.default_rng(kind)
    apart = 0
    for _ in range(800):
        a, solid_a = fcl_hull(rng.normal(size=(rng.integers(4, 60), 3)) * 0.1)
        b, solid_b = fcl_hull(rng.normal(size=(12, 3)) * 0.1)
        half = rng.uniform(0.02, 0.2, 3)
        half[1] = half[0] if kind == CYLINDER else half[1]
        solid_b = [fcl.Box(*(2 * half)), fcl.Cylinder(half[0], 2 * half[2]), solid_b][kind]
        T_a, T_b = random_pose(rng, 0.15), random_pose(rng, 0.15)
        ours, theirs = ask(a, T_a, kind, half, b, T_b), fcl_distance(solid_a, T_a, solid_b, T_b)
        apart += theirs > 0
        assert (ours > 0) == (theirs > 0)
        # FCL stops up to a millimetre early, and then says too much; ours is never above it
        assert ours <= theirs + 1e-9
        assert theirs - ours < 3e-3
        work = make_work()
        vertices, n = by_coordinate(np.concatenate([a, b])), len(a)
        for share in (0.5, 0.999, 1.001, 2.0):
            certain = separated_by(vertices, 0, n, T_a, kind, half, n, n + len(b), T_b, work, share * ours)
            assert certain == (share < 1 and ours > 0)
        relative(T_a, T_b, work)
        if kind == BOX:
            middle, reach = (a.max(0) + a.min(0)) / 2, (a.max(0) - a.min(0)) / 2
            assert box_gap(np.array([np.r_[reach, middle], np.r_[half, NONE]]), 0, 1, work) <= ours + 1e-12
    assert 100 < apart < 700


def test_distance_is_attained() -> None:
    """The certified bound and the nearest points agree: neither depends on FCL."""
    rng = np.random.default_rng(7)
    for _ in range(1000):
        a, b = rng.normal(size=(30, 3)) * 0.1, rng.normal(size=(30, 3)) * 0.1
        T_a, T_b = random_pose(rng, 0.2), random_pose(rng, 0.2)
        work = make_work()
        d = distance(by_coordinate(np.concatenate([a, b])), 0, 30, T_a, HULL, NONE, 30, 60, T_b, work)
        if d == 0:
            continue
        v = T_b[:3, :3] @ work[7, :3]
        assert np.linalg.norm(v) == pytest.approx(d, rel=1e-8)
        assert (apply(T_a, a) @ v).min() - (apply(T_b, b) @ v).max() == pytest.approx(d * d, rel=1e-7)


@pytest.mark.parametrize("gap", [-0.3, -1e-3, -1e-9, 0.0, 1e-9, 1e-6, 1e-3, 0.5, 3.0])
@pytest.mark.parametrize("kind", [BOX, CYLINDER, HULL])
def test_face_to_face(gap: float, kind: int) -> None:
    """Coplanar faces, exactly aligned: a cube over a box, a cylinder and a cube, touching, overlapping and apart."""
    T_a, T_b = transform(p=[0.0, 0.0, 1.0 + gap]), np.eye(4)
    for T in (np.eye(4), random_pose(np.random.default_rng(0), 1.0)):
        d = ask(CUBE, T @ T_a, kind, np.full(3, 0.5), CUBE, T @ T_b)
        assert d == pytest.approx(max(gap, 0.0), abs=1e-9)
        n, work = len(CUBE), make_work()
        vertices = by_coordinate(np.concatenate([CUBE, CUBE]))
        assert not separated_by(vertices, 0, n, T @ T_a, kind, np.full(3, 0.5), n, 2 * n, T @ T_b, work, max(gap, 0.0))


def test_degenerate_solids() -> None:
    """Points, segments and flat plates, repeated and collinear vertices, one inside the other, equal poses: it ends, and is right."""
    point, segment = np.zeros((1, 3)), np.array([[-1.0, 0, 0], [1, 0, 0]])
    plate = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 0], [0.5, 0, 0], [1, 0, 0]])
    up = transform(p=[0.0, 0.0, 2.0])
    assert ask(point, up, HULL, NONE, point, np.eye(4)) == pytest.approx(2.0)
    assert ask(point, np.eye(4), HULL, NONE, point, np.eye(4)) == 0.0
    assert ask(segment, up, HULL, NONE, segment, transform(rotation_about((0, 0, 1), 1.0))) == pytest.approx(2.0)
    assert ask(segment, np.eye(4), HULL, NONE, segment, transform(rotation_about((0, 0, 1), 1.0))) == 0.0
    assert ask(plate, up, HULL, NONE, plate, np.eye(4)) == pytest.approx(2.0)
    assert ask(plate, np.eye(4), HULL, NONE, plate, np.eye(4)) == 0.0
    assert ask(np.repeat(CUBE, 20, 0), transform(p=[2.0, 0.3, 0.1]), BOX, np.full(3, 0.5), point, np.eye(4)) == pytest.approx(1.0)
    assert ask(CUBE * 1e-3, np.eye(4), CYLINDER, np.full(3, 0.5), point, np.eye(4)) == 0.0
    assert ask(CUBE, np.eye(4), BOX, np.full(3, 1e-3), point, np.eye(4)) == 0.0


def test_never_claims_too_much_when_nearly_touching() -> None:
    """Gaps down to a nanometre at random attitudes, by moving a hull along its own witness direction."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        a, b = rng.normal(size=(20, 3)) * 0.1, rng.normal(size=(20, 3)) * 0.1
        T_a, T_b, work = random_pose(rng, 0.3), random_pose(rng, 0.1), make_work()
        vertices = by_coordinate(np.concatenate([a, b]))
        d = distance(vertices, 0, 20, T_a, HULL, NONE, 20, 40, T_b, work)
        if d == 0:
            continue
        away = T_b[:3, :3] @ work[7, :3] / np.linalg.norm(work[7, :3])
        for gap in (1e-3, 1e-6, 1e-9):
            closer = T_a.copy()
            closer[:3, 3] -= away * (d - gap)
            found = distance(vertices, 0, 20, closer, HULL, NONE, 20, 40, T_b, make_work())
            assert 0.999 * gap - 1e-9 <= found <= gap + 1e-12
            assert not separated_by(vertices, 0, 20, closer, HULL, NONE, 20, 40, T_b, work, gap * 1.001 + 1e-9)


def test_any_start_gives_the_same() -> None:
    rng = np.random.default_rng(5)
    a = rng.normal(size=(200, 3)) * 0.1
    T_a, vertices, work = transform(p=[0.5, 0.2, 0.1]), by_coordinate(a), make_work()
    first = distance(vertices, 0, 200, T_a, BOX, np.full(3, 0.1), 0, 0, np.eye(4), work)
    for _ in range(50):
        work[7, :3] = rng.normal(size=3) * 10.0 ** rng.integers(-6, 6)
        assert distance(vertices, 0, 200, T_a, BOX, np.full(3, 0.1), 0, 0, np.eye(4), work) == pytest.approx(first, rel=1e-8)


def test_support_is_the_furthest() -> None:
    rng = np.random.default_rng(6)
    points = by_coordinate(rng.normal(size=(300, 3)))
    for _ in range(200):
        d = rng.normal(size=3)
        along = d @ points  # one product for all: BLAS rounds a single column differently on some CPUs
        assert along[support(points, np.empty((4, 0)), 37, 251, *d)] == along[37:251].max()


def test_grouped_search_finds_the_same() -> None:
    """Groups change the order of the vertices and the time, not the furthest one; no body loses or gains a point."""
    rng = np.random.default_rng(8)
    sizes = [500, 3, 1, 77, 1000, 32]
    bodies = [rng.normal(size=(n, 3)) * rng.uniform(0.01, 1, 3) for n in sizes]
    bodies[3] /= np.linalg.norm(bodies[3], axis=1)[:, None]
    vertices, groups, start = grouped(np.concatenate(bodies), np.r_[0, np.cumsum(sizes)])
    for body, a, b in zip(bodies, start, start[1:]):
        assert {tuple(p) for p in vertices[:, a:b].T} == {tuple(p) for p in body}
        for _ in range(200):
            d = rng.normal(size=3) * 10.0 ** rng.integers(-3, 3)
            i = support(vertices, groups, a, b, *d)
            assert a <= i < b
            assert d @ vertices[:, i] == pytest.approx((body @ d).max(), rel=1e-12)
