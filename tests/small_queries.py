"""Motion queries and distances without a robot: the compiled core's inputs packed by hand, as its tests need them."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Chain
from kinematics.collision.edge_problem import MARGIN_M, Problem, pose
from kinematics.collision.geometry import Parts, Query, Solids
from kinematics.collision.gjk import gjk, relative
from kinematics.collision.posed_geometry import make_posed_geometry
from kinematics.jit.decorators import njit
from kinematics.transforms import Array


def make_problem(chain: Chain, parts: Parts, solids: Solids, query: Query, *, margin_m: float = MARGIN_M) -> Problem:
    """Pack one motion query. Raises: ValueError when margin_m is not positive: a certificate needs some room."""
    if not margin_m > 0:
        raise ValueError(f"the margin must be positive, not {margin_m} m")
    return pose(
        chain,
        make_posed_geometry(chain, parts),
        solids,
        Query(query.check, np.ascontiguousarray(query.pairs, np.int64).reshape(-1, 2)),
        margin_m,
    )


def by_coordinate(points: Array) -> Array:
    """Points (V, 3) in the layout (3, V) that the functions below take."""
    return np.ascontiguousarray(np.asarray(points, float).T)


@njit(cache=True, nogil=True)
def separated_by(
    vertices: Array, a0: int, a1: int, T_a: Array, kind: int, half: Array, b0: int, b1: int, T_b: Array, work: Array, margin_m: float
) -> bool:
    """Whether a polyhedron at T_a (4, 4) is certainly further than margin_m ≥ 0 from a solid at T_b (4, 4); in doubt it is not."""
    relative(T_a, T_b, work)
    above = margin_m + 1e-12
    return bool(gjk(vertices, np.empty((4, 0)), a0, a1, kind, half[0], half[1], half[2], b0, b1, work, margin_m, above, 1e-9) >= above)
