"""The kernel says free only where it is: against its float64 twin, and against FCL on convex shapes, on arms of any kind."""

from __future__ import annotations

from functools import cache
from typing import Any

import fcl
import numpy as np
import pytest
from numba import njit
from random_arms import pose_within, random_chain
from scipy.spatial import ConvexHull

from kinematics.chain import Chain, forward
from kinematics.collision import sphere_check
from kinematics.collision.covers import levels as cover_levels
from kinematics.collision.geometry import BOX, CYLINDER, Parts, Query, make_parts, make_solids
from kinematics.collision.sphere_model import make_sphere_model, make_sphere_world
from kinematics.scene import Body
from kinematics.shapes import Box, ConvexMesh, Cylinder
from kinematics.transforms import transform


class Problem:
    """A random arm with a random world, and FCL's view of it."""

    def __init__(self, seed, joints):
        rng = np.random.default_rng([7, seed])
        self.chain = random_chain(rng, joints)
        frames = [0, *range(1, joints + 1), joints, joints]  # the last one carries three, which the kernel looks at together first
        hulls = [rng.uniform(-0.09, 0.09, (rng.integers(6, 16), 3)) * rng.uniform(0.4, 1, 3) for _ in frames]
        held = pose_within(rng, 0.1)
        hulls[-1] = Box(np.array([0.06, 0.05, 0.12])).half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        hulls[-1] = hulls[-1] @ held[:3, :3].T + held[:3, 3]
        self.parts = make_parts(frames, hulls)
        self.covers = [cover_levels.levels(h, 0.02, 0.006) for h in hulls[:-1]]
        self.covers.append(cover_levels.moved(cover_levels.box_levels((0.06, 0.05, 0.12)), held))
        tilted, upright = pose_within(rng, 0.9), transform(p=rng.uniform(-0.9, 0.9, 3))
        self.bodies = [
            Body("box", Box(np.array([0.3, 0.2, 0.5])), pose_within(rng, 0.9)),
            Body("wall", Box(np.array([1.5, 0.03, 1.0])), transform(p=rng.uniform(0.4, 1.0, 3))),
            Body("can", Cylinder(0.1, 0.4), upright),
            Body("log", Cylinder(0.08, 0.6), tilted),
            Body("stone", ConvexMesh((rng.uniform(-0.2, 0.2, (12, 3)),)), pose_within(rng, 0.8)),
        ]
        self.solids, _ = make_solids(self.bodies)
        spans = zip(self.solids.start[:-1], self.solids.start[1:], strict=True)
        self.planes = [ConvexHull(self.solids.vertices[i:j]).equations if j > i else np.zeros((0, 4)) for i, j in spans]
        P, B = len(frames), len(self.bodies)
        check = (rng.random((P, B)) < 0.9).astype(np.uint8)
        check[0] = 0
        pairs = [(a, b) for a in range(P) for b in range(a) if abs(frames[a] - frames[b]) >= 2 and rng.random() < 0.5]
        self.query = Query(check, np.array(pairs, np.int64).reshape(-1, 2))
        self.model = make_sphere_model(self.chain, self.parts, self.covers)
        self.world = make_sphere_world(self.solids, self.query)
        self.scratch = sphere_check.make_sphere_scratch(self.model, self.world)
        self.fcl_parts = [fcl.CollisionObject(convex(h)) for h in hulls]
        self.fcl_bodies = [fcl.CollisionObject(geometry(b.shape), placed(b.T_world_body)) for b in self.bodies]
        self.frames = np.empty((joints + 1, 4, 4))

    def sample(self, rng, n):
        return rng.uniform(self.chain.lower, self.chain.upper, (*np.atleast_1d(n), len(self.chain.lower)))

    def touches(self, q):
        """FCL's verdict on one configuration."""
        return next(self.contacts(q), None) is not None

    def contacts(self, q):
        """The pairs of bodies that touch for FCL; the parts come first."""
        forward(self.chain, q, self.frames)
        for p, part in enumerate(self.fcl_parts):
            T = self.frames[self.parts.frame[p]]
            part.setTransform(placed(T))
        everything, request = [*self.fcl_parts, *self.fcl_bodies], fcl.CollisionRequest()
        for a, b in [*(np.argwhere(self.query.check) + np.array([0, len(self.fcl_parts)])), *self.query.pairs]:
            if fcl.collide(everything[a], everything[b], request, fcl.CollisionResult()) > 0:
                yield a, b


def placed(T):
    return fcl.Transform(np.ascontiguousarray(T[:3, :3]), T[:3, 3].copy())


def convex(points):
    hull = ConvexHull(points)
    used = np.full(len(points), -1)
    used[hull.vertices] = np.arange(len(hull.vertices))
    faces = used[hull.simplices]
    corners = points[hull.vertices]
    flip = (
        np.einsum(
            "ij,ij->i",
            np.cross(corners[faces[:, 1]] - corners[faces[:, 0]], corners[faces[:, 2]] - corners[faces[:, 0]]),
            hull.equations[:, :3],
        )
        < 0
    )
    faces[flip] = faces[flip][:, ::-1]
    return fcl.Convex(corners, len(faces), np.c_[np.full(len(faces), 3), faces].ravel())


def geometry(shape):
    match shape:
        case Box():
            return fcl.Box(*shape.size_m)
        case Cylinder():
            return fcl.Cylinder(shape.radius_m, shape.height_m)
        case ConvexMesh():
            return convex(shape.parts[0])


@cache
def problem(seed):
    return Problem(seed, joints=3 + seed % 5)


SEEDS = range(5)  # an arm of each number of joints, three to seven


# The twin: the same question in float64, one ball after the other


@njit(cache=True)
def gap(c, kind, T, half, planes):
    """The distance (a lower bound for hulls) of a point from a body; negative inside a hull only."""
    x, y, z = 0.0, 0.0, 0.0
    for r in range(3):
        d = c[r] - T[r, 3]
        x += T[r, 0] * d
        y += T[r, 1] * d
        z += T[r, 2] * d
    if kind == BOX:
        return np.sqrt(max(abs(x) - half[0], 0.0) ** 2 + max(abs(y) - half[1], 0.0) ** 2 + max(abs(z) - half[2], 0.0) ** 2)
    if kind == CYLINDER:
        return np.sqrt(max(np.hypot(x, y) - half[0], 0.0) ** 2 + max(abs(z) - half[2], 0.0) ** 2)
    best = -1e9
    for j in range(planes.shape[0]):
        best = max(best, planes[j, 0] * x + planes[j, 1] * y + planes[j, 2] * z + planes[j, 3])
    return best


@njit(cache=True)
def mapped(T, c):
    return np.array([T[r, 0] * c[0] + T[r, 1] * c[1] + T[r, 2] * c[2] + T[r, 3] for r in range(3)])


@njit(cache=True)
def part_misses(Tf, bound, coarse, fine, start, child, kind, T, half, planes, ball, more):
    """Whether the bounding ball misses the body, or each coarse ball, or else every fine ball that it lists; all larger by `more`."""
    x = mapped(Tf, bound)
    if np.linalg.norm(x - ball[:3]) >= bound[3] + ball[3] + more or gap(x, kind, T, half, planes) >= bound[3] + more:
        return True
    for i in range(coarse.shape[0]):
        if gap(mapped(Tf, coarse[i]), kind, T, half, planes) >= coarse[i, 3] + more:
            continue
        for c in child[start[i] : start[i + 1]]:
            if gap(mapped(Tf, fine[c]), kind, T, half, planes) < fine[c, 3] + more:
                return False
    return True


@njit(cache=True)
def parts_miss(Ta, box_a, bound_a, coarse_a, fine_a, start_a, child_a, Tb, bound_b, coarse_b, fine_b, start_b, child_b, more):
    """The same for two parts, a on the frame nearer to the base; first b's ball against a's box."""
    whole = mapped(Ta, bound_a)
    if np.linalg.norm(whole - mapped(Tb, bound_b)) >= bound_a[3] + bound_b[3] + more:
        return True
    none = np.zeros((0, 4))
    box = Ta.copy()
    box[:3, 3] = mapped(Ta, box_a[:3])
    if gap(mapped(Tb, bound_b), BOX, box, box_a[3:], none) >= bound_b[3] + more:
        return True
    for i in range(coarse_a.shape[0]):
        x = mapped(Ta, coarse_a[i])
        for j in range(coarse_b.shape[0]):
            if np.linalg.norm(x - mapped(Tb, coarse_b[j])) >= coarse_a[i, 3] + coarse_b[j, 3] + more:
                continue
            if gap(mapped(Tb, coarse_b[j]), BOX, box, box_a[3:], none) >= coarse_b[j, 3] + more:
                continue
            for d in child_b[start_b[j] : start_b[j + 1]]:
                if np.linalg.norm(x - mapped(Tb, fine_b[d])) >= coarse_a[i, 3] + fine_b[d, 3] + more:
                    continue
                for c in child_a[start_a[i] : start_a[i + 1]]:
                    y = mapped(Ta, fine_a[c])
                    if np.linalg.norm(y - mapped(Tb, fine_b[d])) < fine_a[c, 3] + fine_b[d, 3] + more:
                        return False
    return True


def twin_free(p, q, more):
    """The float64 verdict on configuration q with all balls larger by `more` metres."""
    frames = np.empty((len(p.chain.q_index) + 1, 4, 4))
    forward(p.chain, q, frames)
    T = frames[p.parts.frame]
    bounds = np.c_[p.parts.centre, p.parts.radius]
    balls = [
        (bounds[i], np.c_[c.coarse.centres, c.coarse.radii], np.c_[c.fine.centres, c.fine.radii], c.start, c.child)
        for i, c in enumerate(p.covers)
    ]
    s = p.solids
    for i, b in zip(*np.nonzero(p.query.check), strict=True):
        ball = np.append(s.centre[b], s.radius[b])
        if not part_misses(T[i], *balls[i], s.kind[b], s.T[b], s.half[b], p.planes[b], ball, more):
            return False
    near_first = [(a, b) if p.parts.frame[a] <= p.parts.frame[b] else (b, a) for a, b in p.query.pairs]
    corners = [p.parts.vertices[i:j] for i, j in zip(p.parts.start[:-1], p.parts.start[1:], strict=True)]
    boxes = [np.concatenate([(v.max(0) + v.min(0)) / 2, np.ptp(v, axis=0) / 2]) for v in corners]
    return all(parts_miss(T[a], boxes[a], *balls[a], T[b], *balls[b], more) for a, b in near_first)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_kernel_agrees_with_its_float64_twin_but_within_the_rounding_allowance(seed):
    p = problem(seed)
    Q = p.sample(np.random.default_rng([1, seed]), 400)
    free = sphere_check.configs_free(p.model, p.world, Q, p.scratch) == sphere_check.FREE
    allowance = 2 * float(p.model.slack.max() + p.world.slack.max()) + 2e-7
    assert 0 < allowance < 2e-3
    for q, says in zip(Q, free, strict=True):
        if says:
            assert twin_free(p, q, 0.0)
        else:
            assert not twin_free(p, q, allowance + 1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_free_is_free_and_touching_touches_for_fcl(seed):
    p = problem(seed)
    Q = p.sample(np.random.default_rng([2, seed]), 2500)
    verdict = sphere_check.configs_free(p.model, p.world, Q, p.scratch)
    for q, says in zip(Q, verdict, strict=True):
        if says == sphere_check.FREE:
            assert not p.touches(q)
        elif says == sphere_check.TOUCHES:
            assert p.touches(q)
    assert (verdict == sphere_check.UNDECIDED).mean() < 0.2


@pytest.mark.parametrize("seed", SEEDS)
def test_a_free_edge_is_free_everywhere(seed):
    p, rng = problem(seed), np.random.default_rng([3, seed])
    seen = {sphere_check.FREE: 0, sphere_check.UNDECIDED: 0, sphere_check.TOUCHES: 0}
    for a, b in zip(p.sample(rng, 200), p.sample(rng, 200), strict=True):
        b = a + rng.uniform(0.02, 1) ** 2 * (b - a)
        says = sphere_check.edge_free(p.model, p.world, a, b, p.scratch)
        seen[says] += 1
        if says == sphere_check.FREE and seen[says] <= 25:
            assert not any(p.touches(a + s * (b - a)) for s in np.linspace(0, 1, 130))
        if says == sphere_check.TOUCHES and seen[says] <= 25:
            assert any(p.touches(a + s * (b - a)) for s in np.linspace(0, 1, 513))
    assert seen[sphere_check.UNDECIDED] < 70  # of what touches, some is left to the exact check: to look further here costs more
    assert seen[sphere_check.FREE] + seen[sphere_check.TOUCHES] > 100


def test_what_an_edge_leaves_open_is_all_that_may_touch():
    pieces, partly = np.empty((500, 2)), 0
    edges = [(problem(seed), *ends) for seed in SEEDS for ends in problem(seed).sample(np.random.default_rng([9, seed]), (100, 2))]
    for p, a, b in edges:
        says = sphere_check.edge_free(p.model, p.world, a, b, p.scratch)
        n = sphere_check.edge_open(p.model, p.world, a, b, p.scratch, pieces)
        assert (n == 0) == (says == sphere_check.FREE)
        assert n == -1 or says != sphere_check.TOUCHES
        if n > 0:
            partly += 1
            s = np.linspace(0, 1, 100)
            closed = ~((pieces[:n, 0] <= s[:, None]) & (s[:, None] <= pieces[:n, 1])).any(1)
            assert not any(p.touches(a + t * (b - a)) for t in s[closed])
            assert all(p.scratch.left[pair] for t in s[~closed] for pair in p.contacts(a + t * (b - a)))
            assert (pieces[1:n, 1] < pieces[: n - 1, 0]).all()
        if n > 1:
            assert sphere_check.edge_open(p.model, p.world, a, b, p.scratch, pieces[: n - 1]) == -2
    assert partly > 20


@pytest.mark.parametrize("seed", SEEDS)
def test_a_grain_on_the_way_of_a_corner_is_never_missed(seed):
    """A body of 2 mm, put where a corner of a part comes by at some moment of a long motion."""
    p, rng = problem(seed), np.random.default_rng([6, seed])
    P = len(p.parts.frame)
    query = Query(np.ones((P, 1), np.uint8), np.zeros((0, 2), np.int64))
    for a, b in zip(p.sample(rng, 100), p.sample(rng, 100), strict=True):
        part = rng.integers(1, P)
        vertex = p.parts.vertices[rng.integers(p.parts.start[part], p.parts.start[part + 1])]
        forward(p.chain, a + rng.random() * (b - a), p.frames)
        grain = Body("grain", Box(np.full(3, 0.002)), transform(p=mapped(p.frames[p.parts.frame[part]], vertex)))
        world = make_sphere_world(make_solids([grain])[0], query)
        assert sphere_check.edge_free(p.model, world, a, b, sphere_check.make_sphere_scratch(p.model, world)) != sphere_check.FREE


@pytest.mark.parametrize("seed", SEEDS)
def test_parts_that_meet_on_the_way_are_never_missed(seed):
    """Long motions, parts against parts alone."""
    p, rng = problem(seed), np.random.default_rng([8, seed])
    world = make_sphere_world(p.solids, p.query._replace(check=np.zeros_like(p.query.check)))
    scratch = sphere_check.make_sphere_scratch(p.model, world)
    request = fcl.CollisionRequest()
    for a, b in zip(p.sample(rng, 60), p.sample(rng, 60), strict=True):
        if sphere_check.edge_free(p.model, world, a, b, scratch) != sphere_check.FREE:
            continue
        for s in np.linspace(0, 1, 100):
            forward(p.chain, a + s * (b - a), p.frames)
            for i, part in enumerate(p.fcl_parts):
                part.setTransform(placed(p.frames[p.parts.frame[i]]))
            for i, j in p.query.pairs:
                assert fcl.collide(p.fcl_parts[i], p.fcl_parts[j], request, fcl.CollisionResult()) == 0


def test_growth_covers_a_piece_to_its_very_ends():
    """A sliding needle whose tip touches a grain at the end of the motion only: the bounding ball, which ends at the tip, has to grow by
    the whole half piece."""
    needle = np.concatenate([np.diag([0.02, 0.02, 0.1]), -np.diag([0.02, 0.02, 0.1])])
    one, zero = np.ones(1), np.zeros(1, np.int64)
    chain = Chain(np.eye(4)[None], zero, one, 0 * one, zero + 1, 0 * one, one, zero)
    parts = make_parts([1], [needle])
    model = make_sphere_model(chain, parts, [cover_levels.levels(needle)])
    for at, far in ((1.1, 0.0), (-0.1, 1.0)):
        grain = Body("grain", Box(np.full(3, 0.001)), transform(p=(0, 0, at)))
        world = make_sphere_world(make_solids([grain])[0], Query(np.ones((1, 1), np.uint8), np.zeros((0, 2), np.int64)))
        scratch = sphere_check.make_sphere_scratch(model, world)
        assert sphere_check.edge_free(model, world, far * one, (1 - far) * one, scratch) != sphere_check.FREE
        assert sphere_check.edge_free(model, world, far * one, 0.5 * one, scratch) == sphere_check.FREE
        assert sphere_check.edge_free(model, world, 0.5 * one, 1.001 * one, scratch) == sphere_check.UNDECIDED  # beyond the limit


def test_growth_covers_what_a_frame_carries_as_one():
    """Three small cubes at the end of a long lever, and one that stands in their way, as a body and as a part, between two of the places
    that are looked at first."""
    one, zero = np.ones(1), np.zeros(1, np.int64)
    chain = Chain(np.eye(4)[None], zero, one, 0 * one, zero, -3 * one, 3 * one, zero)
    corners = 0.005 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    cubes = [corners + np.array([1.0, 0.0, z]) for z in (-0.02, 0.0, 0.02)]
    for eighth in range(1, 8):
        there = np.array([np.cos(0.375 * eighth), np.sin(0.375 * eighth), 0])
        hulls = [corners + there, *cubes]
        model = make_sphere_model(chain, make_parts([0, 1, 1, 1], hulls), [cover_levels.levels(h) for h in hulls])
        solids = make_solids([Body("cube", Box(np.full(3, 0.01)), transform(p=there))])[0]
        for check, pairs in (([0, 1, 1, 1], []), ([0, 0, 0, 0], [(2, 0)])):
            world = make_sphere_world(solids, Query(np.array(check, np.uint8)[:, None], np.array(pairs, np.int64).reshape(-1, 2)))
            scratch = sphere_check.make_sphere_scratch(model, world)
            assert sphere_check.edge_free(model, world, 0 * one, 3 * one, scratch) != sphere_check.FREE
            assert sphere_check.edge_free(model, world, 0 * one, -3 * one, scratch) == sphere_check.FREE


def test_float32_frames_stay_within_a_quarter_of_the_allowance():
    for seed in SEEDS:
        p, rng = problem(seed), np.random.default_rng([4, seed])
        K, P, seen = len(p.chain.q_index), len(p.parts.frame), 0
        for q in p.sample(rng, 60):
            if sphere_check.configs_free(p.model, p.world, q[None], p.scratch)[0] == sphere_check.TOUCHES:
                continue  # the last parts were not placed any more
            seen += 1
            frames = np.empty((K + 1, 4, 4))
            forward(p.chain, q, frames)
            rows = p.scratch.rows.reshape(-1, 16)
            for i in range(P):
                exact = mapped(frames[p.parts.frame[i]], p.parts.centre[i])
                at = 13 + K + 12 * (K + 1) + 3 * i
                assert np.abs(rows[at : at + 3] - exact[:, None]).max() < p.model.slack[i] / 4
        assert seen >= 10


def test_no_point_moves_faster_than_the_reach_says():
    for seed in SEEDS:
        p, rng = problem(seed), np.random.default_rng([5, seed])
        K = len(p.chain.q_index)
        a, b = np.empty((K + 1, 4, 4)), np.empty((K + 1, 4, 4))
        for q in p.sample(rng, 100):
            dq = 1e-5 * rng.normal(size=len(q))
            forward(p.chain, q, a)
            forward(p.chain, q + dq, b)
            for i, f in enumerate(p.parts.frame):
                v = p.parts.vertices[p.parts.start[i] : p.parts.start[i + 1]]
                moved = np.linalg.norm((v @ a[f, :3, :3].T + a[f, :3, 3]) - (v @ b[f, :3, :3].T + b[f, :3, 3]), axis=1).max()
                assert moved <= np.abs(p.chain.scale * dq[p.chain.q_index]) @ p.model.reach[i] + 1e-9


def test_values_that_are_no_numbers_or_out_of_bounds_are_undecided():
    p = problem(0)
    good = np.zeros(len(p.chain.lower))
    for bad in (np.nan, np.inf, 1e3):
        q = good.copy()
        q[-1] = bad
        assert sphere_check.edge_free(p.model, p.world, good, q, p.scratch) == sphere_check.UNDECIDED
        assert sphere_check.configs_free(p.model, p.world, np.array([q]), p.scratch)[0] == sphere_check.UNDECIDED


def test_nothing_to_hit_is_free_and_a_missing_cover_is_an_error():
    p = problem(1)
    empty: Any = make_solids([])[0]
    P = len(p.parts.frame)
    world = make_sphere_world(empty, Query(np.zeros((P, 0), np.uint8), np.zeros((0, 2), np.int64)))
    scratch = sphere_check.make_sphere_scratch(p.model, world)
    assert sphere_check.edge_free(p.model, world, p.chain.lower, p.chain.upper, scratch) == sphere_check.FREE
    assert not sphere_check.configs_free(p.model, world, np.zeros((0, len(p.chain.lower))), scratch).size
    with pytest.raises(ValueError, match="covers"):
        make_sphere_model(p.chain, p.parts, p.covers[:-1])


def test_parts_without_joints_fixed_to_the_world():
    parts: Parts = make_parts([0], [np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1)])])
    none = Chain(
        np.zeros((0, 4, 4)),
        *(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0, np.int64)),
        np.zeros(0),
        np.zeros(0),
        np.zeros(0, np.int64),
    )
    model = make_sphere_model(none, parts, [cover_levels.levels(parts.vertices)])
    for x, verdict in ((0.3, sphere_check.FREE), (0.05, sphere_check.TOUCHES)):
        solids, _ = make_solids([Body("b", Box(np.array([0.02, 0.02, 0.02])), transform(p=(x, 0.05, 0.05)))])
        world = make_sphere_world(solids, Query(np.ones((1, 1), np.uint8), np.zeros((0, 2), np.int64)))
        assert sphere_check.configs_free(model, world, np.zeros((1, 0)), sphere_check.make_sphere_scratch(model, world))[0] == verdict
