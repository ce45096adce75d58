"""How upright what is carried stays: proofs along edges against dense samples, and configurations that are mended."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from random_arms import random_chain

from kinematics.chain import Chain, forward
from kinematics.collision.edge_problem import Scratch, scratch_for
from kinematics.jit.decorators import jit_entry
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.transforms import Array, transform
from planning.motion.search.upright import (
    ANY_WAY_UP,
    ROOM,
    Upright,
    _rates,
    bring_upright,
    edge_upright,
    is_upright,
    make_upright,
)

SEEDS = (0, 1, 2, 4)


def arms(seed: int) -> tuple[Chain, Scratch, np.random.Generator]:
    """An arm of any kind: the UR5e, or one of random joints, sliding and mimic ones among them."""
    rng = np.random.default_rng([seed, 3])
    chain = load("ur5e").chain(transform()) if seed == 0 else random_chain(rng, 3 + seed)
    return chain, scratch_for(len(chain.q_index), len(chain.lower), 0, 1, 1), rng


@jit_entry
def edge_is_upright(chain: Chain, upright: Upright, qa: Array, qb: Array, scratch: Scratch) -> bool:
    """As `edge_upright`; true when there is no limit, as callers have it."""
    return not upright.limited or edge_upright(chain, upright, qa, qb, scratch)


def tilts(chain: Chain, axis: Array, Q: Array) -> Array:
    """The tilt (N,) in rad of an axis in the last frame, without the code under test."""
    frames, out = np.empty((len(chain.q_index) + 1, 4, 4)), []
    for q in Q:
        forward(chain, q, frames)
        z = frames[-1, :3, :3] @ axis
        out.append(np.arctan2(np.hypot(z[0], z[1]), z[2]))
    return np.array(out)


def unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def some_upright(chain: Chain, upright: Upright, rng: np.random.Generator, scratch: Scratch) -> Array | None:
    q = rng.uniform(chain.lower, chain.upper)
    weight = np.ones(len(q))
    return q if bring_upright(chain, upright, weight, 0.9 * upright.most, q, scratch, np.empty(len(q))) else None


@pytest.mark.parametrize("seed", SEEDS)
def test_a_granted_edge_stays_upright_and_a_refused_one_does_not(seed: int) -> None:
    chain, scratch, rng = arms(seed)
    seen = {True: 0, False: 0}
    for _ in range(400):
        upright = make_upright(unit(rng), rng.choice(np.radians([5.0, 30.0, 100.0])))
        qa = some_upright(chain, upright, rng, scratch)
        if qa is None:
            continue
        qb = np.clip(qa + rng.normal(size=len(qa)) * rng.choice([0.05, 0.5, 2.0]), chain.lower, chain.upper)
        free = edge_is_upright(chain, upright, qa, qb, scratch)
        worst = tilts(chain, upright.axis, qa + np.linspace(0, 1, 150)[:, None] * (qb - qa)).max()
        seen[free] += 1
        assert worst <= upright.most / (1 - ROOM) + 1e-9 if free else worst >= upright.most * (1 - 1e-3) - 1e-3
    assert min(seen.values()) >= 20


@jit_entry
def bend_of(chain: Chain, qa: Array, qb: Array, rate: Array) -> float:
    return float(_rates(chain, qa, qb, rate))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_cosine_bends_no_more_than_is_allowed_for(seed: int) -> None:
    chain, _, rng = arms(seed)
    shares, h = [], 1e-3
    for _ in range(200):
        axis = unit(rng)
        qa, qb = rng.uniform(chain.lower, chain.upper, (2, len(chain.lower)))
        s = rng.uniform(0.1, 0.9)
        f = np.cos(tilts(chain, axis, qa + np.array([s - h, s, s + h])[:, None] * (qb - qa)))
        bend = bend_of(chain, qa, qb, np.empty(len(chain.q_index)))
        second = abs(f[0] - 2 * f[1] + f[2]) / h**2
        assert second <= bend + 1e-4
        shares.append(second / max(bend, 1e-9))
    assert max(shares) > 0.05  # nor is it all slack


def test_turning_about_the_vertical_and_level_wrists_cost_nothing(ur5e: Robot) -> None:
    """What does not tilt does not count: the first joint, and three parallel ones that make up for each other."""
    chain = ur5e.chain(transform())
    for d in ([2.0, 0, 0, 0, 0, 0], [0, 0.7, 0.3, -1.0, 0, 0], [1.0, -0.5, 1.0, -0.5, 0, 0]):
        assert abs(bend_of(chain, np.zeros(6), np.array(d), np.empty(6))) < 1e-12
    assert bend_of(chain, np.zeros(6), np.array([0, 0.7, 0.3, -0.9, 0, 0]), np.empty(6)) > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_mended_configurations_are_upright_within_the_limits_and_near(seed: int) -> None:
    chain, scratch, rng = arms(seed)
    weight, mended, moved = rng.uniform(0.1, 1.0, len(chain.lower)), [], []
    for _ in range(200):
        upright = make_upright(unit(rng), np.radians(30))
        q = rng.uniform(chain.lower, chain.upper)
        before, tilted = q.copy(), tilts(chain, upright.axis, q[None])[0]
        most = rng.uniform(0.2, 1.0) * upright.most
        found = bring_upright(chain, upright, weight, most, q, scratch, np.empty(len(q)))
        assert (q >= chain.lower).all()
        assert (q <= chain.upper).all()
        assert found == (tilts(chain, upright.axis, q[None])[0] <= most + 1e-9)
        assert not found or is_upright(chain, upright, q, scratch)
        if tilted <= most:
            assert found
            np.testing.assert_array_equal(q, before)
        mended.append(found)
        moved.append(np.abs(q - before).sum())
    assert np.mean(mended) > (0.85 if seed == 0 else 0.1)
    assert np.mean(moved) < 3.0


def test_no_limit_is_no_limit(ur5e: Robot) -> None:
    chain, scratch, rng = arms(0)
    assert make_upright(np.array([1.0, 0, 0]), np.pi) is ANY_WAY_UP
    Q = rng.uniform(chain.lower, chain.upper, (20, 6))
    assert all(is_upright(chain, ANY_WAY_UP, q, scratch) for q in Q)
    assert all(edge_is_upright(chain, ANY_WAY_UP, a, b, scratch) for a, b in pairwise(Q))
    axis = unit(rng)
    Q = Q[tilts(chain, axis, Q) < 2.5]
    largest = tilts(chain, axis, Q).max()
    for within, more in ((True, 1e-6), (False, -1e-6)):
        assert all(is_upright(chain, make_upright(axis, (largest + more) / (1 - ROOM)), q, scratch) for q in Q) == within
    upright = make_upright(axis, 1.0)
    assert not is_upright(chain, upright, np.full(6, np.nan), scratch)
    assert not edge_is_upright(chain, upright, Q[0], np.full(6, np.nan), scratch)
