"""Arms and poses at random, for tests of what must hold for any."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Chain
from kinematics.transforms import Array, rotation_about, transform


def random_pose(rng: np.random.Generator, spread_m: float) -> Array:
    """A pose (4, 4), turned at random, its position about the origin, normally distributed."""
    return transform(rotation_about(rng.normal(size=3), rng.uniform(0, np.pi)), rng.normal(size=3) * spread_m)


def pose_within(rng: np.random.Generator, reach_m: float) -> Array:
    """The same, its position in a cube about the origin, evenly distributed."""
    return transform(rotation_about(rng.normal(size=3), rng.uniform(0, np.pi)), rng.uniform(-reach_m, reach_m, 3))


def random_chain(rng: np.random.Generator, joints: int) -> Chain:
    """Turning, sliding and mimic joints in any order, J <= K coordinates."""
    q_index, scale, offset = [0], [1.0], [0.0]
    for _ in range(1, joints):
        mimic = rng.random() < 0.25
        q_index.append(int(rng.integers(0, q_index[-1] + 1)) if mimic else max(q_index) + 1)
        scale.append(rng.uniform(-1.5, 1.5) if mimic else 1.0)
        offset.append(rng.uniform(-0.5, 0.5) if mimic else 0.0)
    sliding = rng.random(joints) < 0.3
    n = max(q_index) + 1
    slides = np.array([any(sliding[k] for k in range(joints) if q_index[k] == j) for j in range(n)])
    limit = np.where(slides, 0.2, rng.uniform(2.5, 6.2, n))
    T = np.array([pose_within(rng, 0.25) for _ in range(joints)])
    return Chain(T, np.array(q_index), np.array(scale), np.array(offset), sliding.astype(np.int64), -limit, limit, np.zeros(n, np.int64))
