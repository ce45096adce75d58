"""Parts of a body that are nowhere near a pad are left out, and nothing that is said of a touch changes by that."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.transforms import Array, rotation_about, transform
from planning.verdict import pads
from planning.verdict.hand import Pad
from planning.verdict.polyhedra import Polyhedron, Window, from_points

SQUARE = Window(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]))


def tetrahedron(x: float, y: float, z: float) -> Polyhedron:
    """From a corner at (x, y, z), its lowest in x, y and z, to x + 4, y + 4 and z + 4."""
    return from_points(np.array([x, y, z]) + 4 * np.concatenate([np.zeros((1, 3)), np.eye(3)]))


def over(*body: Polyhedron, T: Array | None = None) -> list[int]:
    return [i for _, i in pads._over(body, np.eye(4) if T is None else T, SQUARE)]


def test_a_lone_part_is_always_looked_at() -> None:
    assert pads._over((tetrahedron(9, 9, 9),), np.eye(4), SQUARE) == [(-np.inf, 0)]


def test_what_is_beside_a_window_or_below_it_is_not_over_it() -> None:
    """By what is a little more than rounding, on each side."""
    beside = [(1.001, 0, 2), (0, 1.001, 2), (-5.001, 0, 2), (0, -5.001, 2), (1.001, 1.001, 2), (0, 0, -4.001)]
    reaching = [(0.999, 0, 2), (0, 0.999, 2), (-4.999, 0, 2), (0, -4.999, 2), (0.999, 0.999, 2), (0, 0, -3.999)]
    for outside, inside in zip(beside, reaching):
        assert over(tetrahedron(*outside), tetrahedron(*inside)) == [1]
    assert over(tetrahedron(0, 0, 2), tetrahedron(9, 0, 2), T=transform(p=[-9, 0, 0])) == [1]


def test_what_is_beside_a_window_by_rounding_may_be_over_it() -> None:
    """Up to a nanometre: the same sum in another order has the corner on the other side. So it is said to begin a nanometre lower."""
    nm = pads.SLACK_M
    for at in ((1 + nm, 0, 2), (0, 1 + nm, 2), (-5 - nm, 0, 2), (0, -5 - nm, 2)):
        assert over(tetrahedron(*at), tetrahedron(0, 0, 8)) == [0, 1], at
    assert over(tetrahedron(0, 0, -4 - nm / 2), tetrahedron(0, 0, 8)) == [0, 1]
    (low, _), _ = pads._over((tetrahedron(0, 0, 2), tetrahedron(0, 0, 8)), np.eye(4), SQUARE)
    assert low == 2 - nm


def test_the_lowest_comes_first_and_of_those_as_low_the_first_in_the_body() -> None:
    assert over(tetrahedron(0, 0, 5), tetrahedron(0, 0, -1), tetrahedron(0, 0, 2)) == [1, 2, 0]
    heights = [float(z) for z in np.random.default_rng(0).integers(0, 3, 200)]
    assert over(*(tetrahedron(0, 0, z) for z in heights)) == sorted(range(200), key=lambda i: heights[i])


def test_each_part_has_its_own_corners() -> None:
    """Only its first corner, or only its last, is over the window."""
    first, last = tetrahedron(0.5, 0.5, 2), from_points(tetrahedron(0.5, 0.5, 2).vertices[::-1])
    for body in ((first, last), (last, first), (tetrahedron(9, 9, 9), first, tetrahedron(9, 9, 9), last)):
        assert over(*body) == [i for i, part in enumerate(body) if part.vertices.min() < 9]


def test_what_lies_above_the_patch_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """The nearest, and what begins within a millimetre of it; all other parts are further up than these."""
    asked, usual = list[float](), pads.nearest_in_window

    def noting(part: Polyhedron, window: Window) -> tuple[float, Array] | None:
        asked.append(float(part.vertices[:, 2].min()))
        return usual(part, window)

    monkeypatch.setattr(pads, "nearest_in_window", noting)
    heights = [0.5, 0.2, 0.2005, 0.3, 0.2009]
    found = pads.touch(Pad("pad", 1, 0, np.eye(4), SQUARE), np.eye(4), [tetrahedron(0, 0, z) for z in heights], np.eye(4))
    assert found is not None
    assert found.gap_m == pytest.approx(0.2)
    assert asked == pytest.approx([0.2, 0.2005, 0.2009])


@pytest.mark.parametrize("seed", range(4))
def test_a_touch_is_the_same_with_all_parts_and_with_those_over_the_pad(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng, touched = np.random.default_rng(seed), 0
    window = Window(np.array([[-0.01, -0.008], [0.01, -0.008], [0.012, 0.008], [-0.01, 0.008]]))
    pad = Pad("pad", 1, 0, np.eye(4), window)
    body = tuple(from_points(rng.normal(scale=0.012, size=(9, 3)) + rng.normal(scale=0.03, size=3)) for _ in range(20))
    usual = pads._over
    for _ in range(30):
        axis = rng.normal(size=3)
        T = transform(rotation_about(axis / np.linalg.norm(axis), rng.uniform(0, 3)), rng.normal(scale=0.03, size=3))
        few = pads.touch(pad, np.eye(4), body, T)
        assert len(usual(body, T, window)) < len(body)
        with monkeypatch.context() as m:
            m.setattr(pads, "_over", lambda body, *_: [(-np.inf, i) for i in range(len(body))])
            all_parts = pads.touch(pad, np.eye(4), body, T)
        assert (few is None) == (all_parts is None)
        if few is not None and all_parts is not None:
            touched += 1
            assert (few.gap_m, few.width_m) == (all_parts.gap_m, pytest.approx(all_parts.width_m, abs=1e-12))
            np.testing.assert_array_equal(few.normal, all_parts.normal)
    assert touched > 5
