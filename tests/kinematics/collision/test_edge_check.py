"""Verdicts on configurations and edges of random arms among random solids, against FCL and against distances to full precision."""

from __future__ import annotations

from itertools import pairwise

import fcl
import numpy as np
import pytest
from random_arms import random_pose
from scipy.spatial import ConvexHull
from small_queries import make_problem

from kinematics.chain import Chain, forward
from kinematics.collision.edge_check import config_free, edge_contact, edge_free, first_contact, pieces_free
from kinematics.collision.edge_problem import Problem, Scratch, make_scratch
from kinematics.collision.geometry import Parts, Query, make_parts, make_solids
from kinematics.collision.gjk import distance, make_work
from kinematics.collision.motion_bounds import begin_edge, safe_interval, twists
from kinematics.collision.pair_bounds import TOLERANCE, pair_bound
from kinematics.collision.path_clearance import config_clearances
from kinematics.collision.posed_geometry import make_posed_geometry
from kinematics.jit.decorators import jit_entry
from kinematics.scene import Body
from kinematics.shapes import Box, ConvexMesh, Cylinder
from kinematics.transforms import Array, apply, transform

SEEDS = (0, 1, 3, 4, 5, 6)  # arms that stand free somewhere


def random_hull(rng: np.random.Generator, size_m: float) -> Array:
    points = rng.normal(size=(rng.integers(8, 60), 3)) * size_m
    return np.asarray(points[np.sort(ConvexHull(points).vertices)])


def random_arm(seed: int) -> tuple[Chain, Parts, tuple[Body, ...], Query]:
    """Six moving joints of five coordinates (the last one is a mimic joint), one of them sliding, eight parts, nine bodies."""
    rng = np.random.default_rng(seed)
    chain = Chain(
        np.array([random_pose(rng, 0.15) for _ in range(6)]),
        np.array([0, 1, 2, 3, 4, 4]),
        np.array([1.0, 1, 1, 1, 1, -0.5]),
        np.array([0.0, 0, 0.1, 0, 0, 0.3]),
        np.array([0, 0, int(seed % 2 == 0), 0, 0, 0]),
        np.array([-3.0, -2, -0.2, -3, -3]),
        np.array([3.0, 2, 0.2, 3, 3]),
        np.zeros(5, np.int64),
    )
    frames = [0, 1, 2, 3, 4, 5, 6, 6]
    parts = make_parts(frames, [random_hull(rng, 0.025) for _ in frames])
    bodies = tuple(
        Body(f"b{i}", shape, random_pose(rng, 0.6))
        for i, shape in enumerate(
            [Box(rng.uniform(0.05, 0.3, 3)) for _ in range(3)]
            + [Cylinder(*rng.uniform(0.05, 0.2, 2)) for _ in range(3)]
            + [ConvexMesh((random_hull(rng, 0.05),)) for _ in range(3)]
        )
    )
    pairs = [(i, j) if (i + j) % 2 else (j, i) for i in range(8) for j in range(i) if abs(frames[i] - frames[j]) > 1]
    check = np.ones((8, 9), np.uint8)
    check[0] = 0
    return chain, parts, bodies, Query(check, np.array(pairs))


def packed(seed: int, margin_m: float = 5e-4) -> tuple[Problem, Parts, tuple[Body, ...]]:
    chain, parts, bodies, query = random_arm(seed)
    return make_problem(chain, parts, make_solids(bodies)[0], query, margin_m=margin_m), parts, bodies


def frames_at(problem: Problem, q: Array) -> Array:
    frames = np.zeros((len(problem.chain.q_index) + 1 + len(problem.solid_T), 4, 4))
    forward(problem.chain, q, frames)
    frames[len(problem.chain.q_index) + 1 :] = problem.solid_T
    return frames


def pair_distance(problem: Problem, frames: Array, n: int) -> float:
    """The distance of one pair to full precision."""
    a, b, i, j, kind, a0, a1, b0, b1 = problem.pairs[n]
    _ = a
    return distance(problem.vertices, a0, a1, frames[i], kind, problem.boxes[b, :3].copy(), b0, b1, frames[j], make_work())


def config_clearance(problem: Problem, q: Array, cap_m: float, scratch: Scratch) -> float:
    """What is said of one configuration."""
    out = np.empty(1)
    config_clearances(problem, q[None], np.array([[0, 1]]), np.array([0, len(problem.pairs)]), cap_m, scratch, out)
    return float(out[0])


def least_distance(problem: Problem, q: Array) -> float:
    frames = frames_at(problem, q)
    return min(pair_distance(problem, frames, n) for n in range(len(problem.pairs)))


class Fcl:
    """The same pairs, asked of FCL."""

    def __init__(self, problem: Problem, parts: Parts, bodies: tuple[Body, ...]) -> None:
        self.problem = problem
        self.objects = [self._hull(parts.vertices[a:b]) for a, b in pairwise(parts.start)]
        for body in bodies:
            match body.shape:
                case Box():
                    self.objects.append(fcl.CollisionObject(fcl.Box(*body.shape.size_m)))
                case Cylinder():
                    self.objects.append(fcl.CollisionObject(fcl.Cylinder(body.shape.radius_m, body.shape.height_m)))
                case ConvexMesh():
                    self.objects.append(self._hull(body.shape.parts[0]))

    @staticmethod
    def _hull(v: Array) -> fcl.CollisionObject:
        hull = ConvexHull(v)
        faces = np.searchsorted(np.sort(hull.vertices), hull.simplices)
        v = v[np.sort(hull.vertices)]
        normals = np.cross(v[faces[:, 1]] - v[faces[:, 0]], v[faces[:, 2]] - v[faces[:, 0]])
        inward = np.einsum("fc,fc->f", normals, hull.equations[:, :3]) < 0
        faces[inward] = faces[inward][:, [0, 2, 1]]
        return fcl.CollisionObject(fcl.Convex(v, len(faces), np.c_[np.full(len(faces), 3), faces].ravel()))

    def touches(self, q: Array) -> bool:
        frames = frames_at(self.problem, q)
        for a, b, i, j, *_ in self.problem.pairs:
            for body, pose in ((a, i), (b, j)):
                self.objects[body].setTransform(fcl.Transform(frames[pose][:3, :3], frames[pose][:3, 3]))
            if fcl.collide(self.objects[a], self.objects[b], fcl.CollisionRequest(), fcl.CollisionResult()):
                return True
        return False


@pytest.mark.parametrize("seed", SEEDS)
def test_configurations(seed: int) -> None:
    """Free and clear as the least distance to full precision says; FCL finds no contact in what is free, one in what touches."""
    problem, parts, bodies = packed(seed)
    scratch, peer = make_scratch(problem), Fcl(problem, parts, bodies)
    rng = np.random.default_rng([seed, 1])
    seen = {True: 0, False: 0}
    for q in rng.uniform(problem.chain.lower, problem.chain.upper, (150, 5)):
        exact, free = least_distance(problem, q), config_free(problem, q, scratch)
        seen[free] += 1
        assert free if exact > problem.margin_m * (1 + TOLERANCE) + 1e-9 else exact > problem.margin_m or not free
        assert free == (first_contact(problem, q, scratch) < 0)
        assert not (free and peer.touches(q))
        assert free or exact > 0 or peer.touches(q)
        bound = config_clearance(problem, q, 0.05, scratch)
        assert min(exact, 0.05) * (1 - TOLERANCE) - 1e-9 <= bound <= min(exact, 0.05) + 1e-9
    assert min(seen.values()) > 5


@pytest.mark.parametrize("seed", SEEDS)
def test_reach_bounds_every_motion(seed: int) -> None:
    """No vertex of a part moves further, relative to the other body of the pair, than the pair's reach allows; nor is it all slack."""
    problem, parts, _ = packed(seed)
    rng = np.random.default_rng([seed, 2])
    n_parts, most = len(parts.frame), 0.0
    for _ in range(60):
        qa, qb = rng.uniform(problem.chain.lower, problem.chain.upper, (2, 5))
        if rng.random() < 0.5:  # one coordinate alone, a little
            j = rng.integers(5)
            qb = qa + 1e-3 * np.eye(5)[j]
        Fa, Fb = frames_at(problem, qa), frames_at(problem, qb)
        for n, (a, b, i, j, *_) in enumerate(problem.pairs):
            bodies = ((a, i, j), (b, j, i)) if b < n_parts else ((a, i, j),)
            moved = []
            for body, own, other in bodies:
                v = parts.vertices[parts.start[body] : parts.start[body + 1]]
                was, now = (apply(np.linalg.inv(F[other]) @ F[own], v) for F in (Fa, Fb))
                moved.append(np.linalg.norm(now - was, axis=1).max())
            # seen from the one that comes first in the chain, the other one moves within its reach
            allowed = problem.reach[n] @ np.abs(problem.chain.scale * (qb - qa)[problem.chain.q_index])
            assert min(moved) <= allowed + 1e-12
            most = max(most, min(moved) / max(allowed, 1e-12))
    assert most > 0.5


def test_reach_of_a_straight_arm() -> None:
    """Two links of 0.5 m and a slide: the numbers one would write down."""
    cube = np.array([[x, y, z] for x in (0.0, 0.5) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])
    limits = np.array([3.0, 3.0, 0.3])
    T_prev = np.array([np.eye(4), transform(p=[0.5, 0, 0]), transform(p=[0.5, 0, 0])])
    chain = Chain(T_prev, np.arange(3), np.ones(3), np.zeros(3), np.array([0, 0, 1]), -limits, limits, np.zeros(3, np.int64))
    r = make_posed_geometry(chain, make_parts([0, 1, 2, 3], [cube] * 4)).reach
    tip = np.hypot(0.5, 0.05)
    np.testing.assert_allclose(r[:, 0], 0)
    np.testing.assert_allclose(r[:, 1], [tip, 0, 0])
    np.testing.assert_allclose(r[:, 2], [0.5 + tip, tip, 0])
    np.testing.assert_allclose(r[:, 3], [1.0 + tip, 0.5 + tip, 1.0])


@pytest.mark.parametrize("seed", SEEDS)
def test_edges(seed: int) -> None:
    """A certified edge keeps half the margin wherever it is sampled, FCL agrees; a refused one names a pair that is within the margin."""
    problem, parts, bodies = packed(seed)
    scratch, peer = make_scratch(problem), Fcl(problem, parts, bodies)
    rng = np.random.default_rng([seed, 3])
    free = blocked = 0
    for _ in range(3000):
        if free >= 12 and blocked >= 12:
            break
        qa = rng.uniform(problem.chain.lower, problem.chain.upper)
        step = rng.normal(size=5) * rng.choice([0.02, 0.1, 0.4])
        qb = np.clip(qa + step, problem.chain.lower, problem.chain.upper)
        if not config_free(problem, qa, scratch):
            continue
        pair = edge_contact(problem, qa, qb, scratch)
        assert edge_free(problem, qa, qb, scratch) == (pair < 0)
        if pair >= 0:
            blocked += 1
            at = qa + scratch.where[0] * (qb - qa)
            assert pair_distance(problem, frames_at(problem, at), pair) <= problem.margin_m * (1 + 2 * TOLERANCE)
        elif free < 12:
            free += 1
            for t in np.linspace(0, 1, 60):
                q = qa + t * (qb - qa)
                assert config_clearance(problem, q, problem.margin_m, scratch) >= 0.5 * problem.margin_m * (1 - TOLERANCE)
                assert t not in (0, 1) or config_clearance(problem, q, 1.0, scratch) > 0
                assert not peer.touches(q)
    assert free >= 12
    assert blocked >= 12


@jit_entry
def plane_lasts(problem: Problem, qa: Array, qb: Array, q: Array, n: int, keep: float, scratch: Scratch, out: Array) -> None:
    """out (3,): the bound that GJK's plane proves for pair n at q, on the way from qa to qb, and how far back and ahead it lasts."""
    scratch.pool[0, 0] = n
    begin_edge(problem.chain, problem.reach, qa, qb, scratch.pool[0, :1], scratch.rate, scratch.motion, scratch.bend)
    forward(problem.chain, q, scratch.poses)
    twists(problem.chain, scratch.rate, scratch.poses, scratch.twist)
    poses, work, toward, far = scratch.poses, scratch.work, scratch.toward, np.inf
    pair_bound(problem.pairs, problem.boxes, problem.vertices, problem.groups, poses, work, toward, n, 0.0, far, far, 1e-3)
    out[0] = work[7, 3]
    out[1], out[2] = safe_interval(problem.pairs, problem.boxes, scratch.poses, scratch.twist, scratch.work, n, keep, scratch.bend[n])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_plane_lasts_no_longer_than_the_pair_is_apart(seed: int) -> None:
    """On long edges, to full precision."""
    problem, _, _ = packed(seed)
    scratch, rng, out = make_scratch(problem), np.random.default_rng([seed, 5]), np.zeros(3)
    better: list[bool] = []
    for n in np.arange(len(problem.pairs)).repeat(4):
        qa, qb = rng.uniform(problem.chain.lower, problem.chain.upper, (2, 5))
        t = rng.random()
        q = qa + t * (qb - qa)
        plane_lasts(problem, qa, qb, q, n, 0.0, scratch, out)
        keep = rng.uniform(0, out[0])
        plane_lasts(problem, qa, qb, q, n, keep, scratch, out)
        if out[0] == 0:
            continue
        for way, free in ((-1, out[1]), (1, out[2])):
            for s in np.linspace(0, min(free, t if way < 0 else 1 - t), 12):
                frames = frames_at(problem, qa + (t + way * s) * (qb - qa))
                assert pair_distance(problem, frames, n) >= keep - 1e-9, (n, way, s)
            if scratch.motion[n] > 0:
                better.append(free * scratch.motion[n] > out[0] - keep)
    assert np.mean(better) > 0.5  # more often than not worth more than the bound without a direction


@pytest.mark.parametrize("seed", SEEDS)
def test_pieces_of_edges(seed: int) -> None:
    """Some pieces and some pairs: what is free keeps half the margin there; what is not is near at a place that was asked about."""
    problem, _, _ = packed(seed)
    scratch, rng = make_scratch(problem), np.random.default_rng([seed, 6])
    seen, pieces = {True: 0, False: 0}, np.array([[0.6, 0.75], [0.3, 0.35]])
    for qa in rng.uniform(problem.chain.lower, problem.chain.upper, (60, 5)):
        qb = np.clip(qa + rng.normal(size=5) * 0.3, problem.chain.lower, problem.chain.upper)
        some = rng.random((8, 8 + 9)) < 0.4
        asked = [n for n, (a, b, *_) in enumerate(problem.pairs) if some[a, b]]
        free = pieces_free(problem, qa, qb, pieces, 2, some.astype(np.uint8), scratch)
        seen[free] += 1
        where = scratch.where[0]
        assert free or 0.3 <= where <= 0.35 or 0.6 <= where <= 0.75
        S = np.concatenate([np.linspace(*piece, 12) for piece in pieces]) if free else [where]
        least = min(pair_distance(problem, frames_at(problem, qa + s * (qb - qa)), n) for s in S for n in asked)
        assert least >= 0.5 * problem.margin_m if free else least <= problem.margin_m * (1 + 2 * TOLERANCE)
    assert min(seen.values()) >= 5


def test_a_thin_obstacle_is_never_stepped_over() -> None:
    """A needle in the middle of a long sweep, found wherever it stands; a sweep past it is free."""
    stick = np.array([[x, y, z] for x in (0.0, 1.0) for y in (-0.01, 0.01) for z in (-0.01, 0.01)])
    none, limit = np.zeros(1, np.int64), np.array([3.0])
    chain = Chain(np.eye(4)[None], none, np.ones(1), np.zeros(1), none, -limit, limit, none)
    parts = make_parts([1], [stick])
    for angle in np.random.default_rng(0).uniform(-2.5, 2.5, 30):
        for radius, hits in ((0.8, True), (1.02, False)):
            needle = Body("needle", Cylinder(0.001, 0.5), transform(p=[radius * np.cos(angle), radius * np.sin(angle), 0.0]))
            problem = make_problem(chain, parts, make_solids([needle])[0], Query(np.ones((1, 1), np.uint8), np.zeros((0, 2), np.int64)))
            assert edge_free(problem, np.array([-2.9]), np.array([2.9]), make_scratch(problem)) != hits


def test_nothing_to_check() -> None:
    """No solids, no pairs: everything is free, at once."""
    chain, parts, _, _ = random_arm(0)
    problem = make_problem(chain, parts, make_solids([])[0], Query(np.zeros((8, 0), np.uint8), np.zeros((0, 2), np.int64)))
    scratch = make_scratch(problem)
    assert edge_free(problem, chain.lower, chain.upper, scratch)
    assert config_clearance(problem, chain.lower, 0.3, scratch) == 0.3
    with pytest.raises(ValueError, match="margin"):
        packed(0, margin_m=0.0)
