"""Where flat pads first meet a mesh: bumps by hand, and random ones against a linear program."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from kinematics.shapes import ConvexMesh
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.line_contacts import GAP_M, Contact, line_contacts
from planning.grasping.pads import Pad, _edges, _joined, under_pads

PAD = Pad(0.01, -0.02, 0.01)
"""From -1 to 1 cm along the hand's x, from -2 to 1 cm along its z; it closes along y."""
ELSEWHERE = transform(rotation_about((1, -2, 3), 2.1), [0.3, -0.2, 0.5])


def reached(mesh: ConvexMesh, p: tuple[float, float, float], pad: Pad = PAD, T: Array = ELSEWHERE) -> tuple[float, float]:
    """From where to where the pads' way along y meets a mesh in the hand's frame, when they are at p in it."""
    point, u = T[:3, :3] @ p + T[:3, 3], T[:3, 1]
    hit = line_contacts(mesh, T, point, u)
    assert hit is not None
    return under_pads(mesh, T, hit, point, u, T[:3, :3], pad)


DIAMOND = ConvexMesh((np.array([[0.05, 0, 0], [-0.05, 0, 0], [0, 0.04, 0], [0, -0.03, 0], [0, 0, 0.05], [0, 0, -0.05]]),))
"""Eight facets: along y it reaches from -3 to 4 cm, in the others 5 cm each way."""


@pytest.mark.parametrize("T", [np.eye(4), ELSEWHERE], ids=["here", "elsewhere"])
def test_a_tip_between_the_pads_is_met_first(T: Array) -> None:
    assert reached(DIAMOND, (0.0, 0.0, 0.0), T=T) == pytest.approx((-0.03, 0.04))
    assert reached(DIAMOND, (0.009, 0.0, 0.019), T=T) == pytest.approx((-0.03, 0.04))
    assert reached(DIAMOND, (-0.009, 0.005, -0.009), T=T) == pytest.approx((-0.035, 0.035))  # counted from the point itself


def test_without_the_tip_the_edge_is_met_where_the_pad_ends() -> None:
    """The pad's side is at x = 1 cm, a fifth of the way down from the tip; or at z = -1, or at z = 1."""
    for p in ((0.02, 0.0, 0.0), (-0.02, 0.0, 0.0), (0.0, 0.0, -0.02), (0.0, 0.0, 0.03)):
        assert reached(DIAMOND, p) == pytest.approx((-0.03 * 0.8, 0.04 * 0.8)), p


def test_within_a_facet_a_corner_of_the_pad_is_met() -> None:
    """At (3, 3) cm of a diamond ten times as large: its corner at (2, 1) cm lies nearest to the tip."""
    large = ConvexMesh((10 * DIAMOND.parts[0],))
    assert reached(large, (0.03, 0.0, 0.03)) == pytest.approx((-0.3 * 0.94, 0.4 * 0.94))
    assert reached(large, (-0.03, 0.0, -0.03)) == pytest.approx((-0.3 * 0.92, 0.4 * 0.92))
    assert reached(large, (0.03, 0.0, 0.03), Pad(0.0, 0.0, 0.0)) == pytest.approx((-0.3 * 0.88, 0.4 * 0.88))


def test_a_ridge_beside_the_pad_is_not_met() -> None:
    """It runs along the pad's side, along z, or along x."""
    for turn in (np.eye(3), np.eye(3)[[2, 1, 0]]):
        ridge = ConvexMesh((np.array([[x, y, z] for x, y in ((0.05, 0), (-0.05, 0), (0, 0.04), (0, -0.03)) for z in (-0.5, 0.5)]) @ turn,))
        for off, share in ((0.0, 1.0), (0.0095, 1.0), (0.011, 0.98), (-0.011, 0.98)):
            x, z = off, 0.0
            if turn[0, 0] == 0:
                x, z, share = 0.0, off, 1.0 if -0.01 < off < 0.02 else 0.98
            assert reached(ridge, (x, 0.0, z)) == pytest.approx((-0.03 * share, 0.04 * share)), off


def test_all_parts_count() -> None:
    bump = ConvexMesh(
        (DIAMOND.parts[0], np.array([[0.006, 0.2, 0.0], [0.03, 0.0, 0.0], [-0.03, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, 0.0, -0.03]]))
    )
    assert reached(bump, (0.0, 0.0, 0.0)) == pytest.approx((-0.03, 0.2))


def test_pads_meet_random_meshes_where_a_linear_program_says() -> None:
    rng = np.random.default_rng(8)
    for _ in range(30):
        parts = tuple(rng.normal(size=(12, 3)) * 0.04 + rng.normal(size=3) * 0.01 for _ in range(2))
        mesh, pad = ConvexMesh(parts), Pad(rng.uniform(0.002, 0.015), -rng.uniform(0.002, 0.02), rng.uniform(0.002, 0.02))
        inner = parts[0].mean(0)
        ends = []
        for part in parts:
            planes = ConvexHull(part).equations  # normals and what is below them
            bounds = [(inner[0] - pad.half_x_m, inner[0] + pad.half_x_m), (None, None), (inner[2] + pad.low_z_m, inner[2] + pad.high_z_m)]
            found = [linprog([0, sign, 0], A_ub=planes[:, :3], b_ub=-planes[:, 3], bounds=bounds) for sign in (1, -1)]
            if all(f.status == 0 for f in found):
                ends.append([f.x[1] for f in found])
        low, high = np.array(ends).T - inner[1]
        assert reached(mesh, tuple(inner), pad) == pytest.approx((low.min(), high.max()), abs=1e-9)


def test_the_line_itself_counts() -> None:
    """Though nothing else of a mesh is between the pads."""
    hit = Contact(-0.5, 0.6, -np.eye(3)[1], np.eye(3)[1])
    far = under_pads(DIAMOND, np.eye(4), hit, np.array([0.2, 0.0, 0.0]), np.eye(3)[1], np.eye(3), PAD)
    assert far == (-0.5, 0.6)


def test_spans_that_hardly_come_apart_are_one() -> None:
    """From the first of them on, in either direction, one after the other; what lies further off is not reached, nor what it reaches."""
    g = GAP_M
    up, down = [(1 + g / 2, 2.0), (2 + g / 2, 3.0), (3 + 2 * g, 9.0)], [(-1.0, -g / 2), (-2.0, -1 - g / 2), (-9.0, -2 - 2 * g)]
    for others in (up + down, down + up, up[::-1] + down[::-1], [*down, (0.2, 0.5), *up], up[1::-1] + up[2:] + down[::-1]):
        assert _joined([(0.0, 1.0), *others]) == (-2.0, 3.0)
    assert _joined([(5.0, 6.0), (0.0, 1.0)]) == _joined([(5.0, 6.0), (5.2, 5.5)]) == (5.0, 6.0)
    assert _joined([(-1.0, 0.0), (g, 1.0)]) == (-1.0, 1.0)  # just so far
    assert _joined([(0.0, 1.0), (-1.0, -g)]) == (-1.0, 1.0)
    assert _joined([(0.0, 1.0), (-3.0, 4.0)]) == (-3.0, 4.0)


def test_each_edge_of_a_hull_stands_once() -> None:
    """A solid whose faces are all triangles has 3 V - 6 of them (Euler)."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        points = rng.normal(size=(15, 3))
        a, b = _edges(ConvexMesh((points,)))
        assert len(a) == 3 * len(ConvexHull(points).vertices) - 6
        assert len({frozenset((tuple(p), tuple(q))) for p, q in zip(a.tolist(), b.tolist(), strict=True)}) == len(a)


def test_an_edge_along_the_pads_side_counts() -> None:
    """A ridge right under it; a hair beside it does not."""
    ridge = ConvexMesh((np.array([[x, y, z] for x, y in ((0.0625, 0), (-0.0625, 0), (0, 0.0625), (0, -0.0625)) for z in (-0.5, 0.5)]),))
    pad = Pad(0.015625, -0.015625, 0.015625)
    for x, y in ((0.015625, 0.0625), (-0.015625, 0.0625), (0.03125, 0.046875), (-0.03125, 0.046875)):
        assert reached(ridge, (x, 0.0, 0.0), pad, np.eye(4)) == pytest.approx((-y, y), abs=1e-12)


def test_a_tip_that_just_touches_the_pads_side_counts() -> None:
    """All edges lead away from the pad there; a hair further off nothing of the mesh is under it."""
    side = 0.015625
    tip = ConvexMesh((np.array([[0.0, 0.25, 0.0], [-0.5, 0.0, 0.5], [-0.5, 0.0, -0.5], [-0.5, 0.5, 0.0]]),))
    hit, (_, y, _) = Contact(-0.125, 0.125, -np.eye(3)[1], np.eye(3)[1]), np.eye(3)
    for off, leave in ((0.0, 0.25), (1e-9, 0.125)):
        point = np.array([side + off, 0.0, 0.0])
        assert under_pads(tip, np.eye(4), hit, point, y, np.eye(3), Pad(side, -side, side)) == (-0.125, leave)
