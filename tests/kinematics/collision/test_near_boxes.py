"""What boxes leave to FCL: every pair that touches is asked about, at every configuration that it belongs to, and few others are."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.collision.fcl_solids import depth, shape_solids
from kinematics.collision.near_boxes import near_pairs_along
from kinematics.shapes import Box
from kinematics.transforms import Array, rotation_about, transform

LINKS, HELD, STANDING, N = 3, 2, 4, 40
S = LINKS + HELD + STANDING
PAIRS = np.array([(i, j) for i in range(LINKS + HELD) for j in range(i + 1, S)])


def poses(rng: np.random.Generator, *shape: int) -> Array:
    turned = [rotation_about(rng.normal(size=3), rng.uniform(-3, 3)) for _ in range(int(np.prod(shape)))]
    return np.array([transform(R, rng.uniform(-0.25, 0.25, 3)) for R in turned]).reshape(*shape, 4, 4)


@pytest.mark.parametrize("seed", range(3))
def test_boxes_leave_out_no_pair_that_touches(seed: int) -> None:
    rng = np.random.default_rng([seed, 41])
    boxes = np.stack([rng.uniform(-0.05, 0.05, (S, 3)), rng.uniform(0.005, 0.12, (S, 3))], axis=1)
    T, T_standing = poses(rng, N, LINKS + 1), poses(rng, 2 * STANDING)
    places = np.full((2, S), -1)
    places[:, LINKS + HELD :] = np.arange(2 * STANDING).reshape(2, STANDING)  # other places in the second stretch
    which = np.repeat([0, 1], N // 2)
    first = np.zeros(N, np.bool_)
    first[[0, N // 2]] = True
    some, others, last = PAIRS[::3], PAIRS[1::3], PAIRS[2::3]
    said = np.array([(100 + n, i, j) for n in range(N) for i, j in last if rng.random() < 0.5])
    starts = [np.array([0, len(p), 2 * len(p)]) for p in (some, others)]
    ask = np.empty((N * len(PAIRS), 3), np.int64)
    scratch = np.full(S, -1), np.empty_like(boxes), np.empty(3)
    count = near_pairs_along(
        boxes, T, T_standing, places, 100 + np.arange(N), which, first,
        np.tile(some, (2, 1)), starts[0], np.tile(others, (2, 1)), starts[1], said, *scratch, ask,
    )  # fmt: skip
    asked = [tuple(row) for row in ask[:count].tolist()]
    belongs = {(n, *p) for n in range(N) for p in some.tolist()} | {(int(n) - 100, i, j) for n, i, j in said.tolist()}
    belongs |= {(n, *p) for n in np.flatnonzero(first).tolist() for p in others.tolist()}
    assert [n for n, _, _ in asked] == sorted(n for n, _, _ in asked)
    assert len(set(asked)) == count
    assert set(asked) <= belongs
    solids = [shape_solids(str(k), Box(tuple(2 * boxes[k, 1])))[0] for k in range(S)]

    def touch(n: int, i: int, j: int) -> bool:
        for k in (i, j):
            at = T[n, min(k, LINKS)] if places[which[n], k] < 0 else T_standing[places[which[n], k]]
            solids[k].move(at @ transform(p=boxes[k, 0]))
        return depth(solids[i], solids[j]) is not None

    touching = {row for row in belongs if touch(*row)}
    assert touching <= set(asked)
    assert 20 < len(touching) < count < 1.5 * len(touching)  # boxes that are asked about mostly touch
