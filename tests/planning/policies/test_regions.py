"""Free regions by hand, in a cabinet of 0.4 × 0.4 × 0.3 m with 4 × 4 cells: cell 4 i + j is centred at (0.05 + 0.1 i, −0.15 + 0.1 j)."""

from __future__ import annotations

import numpy as np
import pytest
from fakes import observation

from kinematics.transforms import rotation_about, transform
from planning.policies.regions import GAP_M, free_regions

ALL = list(range(16))
FAR = (5.0, 5.0, 0.06, 0.06, 0.06, 0.12)
HAIR = 1e-6


def free(moved: tuple[float, float, float], *others: tuple[float, ...], unseen: list[int] | None = None) -> list[int]:
    """Where an object of this size may stand, which stands far away, among boxes (cx, cy, dx, dy) that reach from floor to ceiling."""
    boxes = {f"other_{i}": (x, y, 0.15, dx, dy, 0.3) for i, (x, y, dx, dy) in enumerate(others)}
    return free_regions(observation({"moved": (*FAR[:3], *moved), **boxes}, unseen=unseen or []), "moved").tolist()


def test_an_empty_cabinet_is_free() -> None:
    assert free((0.06, 0.06, 0.12)) == ALL


def test_a_cell_is_taken_with_all_that_comes_too_near() -> None:
    """0.06 wide beside 0.06: cells 0.1 apart are free; the one that it stands on is not."""
    assert free((0.06, 0.06, 0.12), (0.15, 0.05, 0.06, 0.06)) == [i for i in ALL if i != 6]
    assert free((0.06, 0.06, 0.12), (0.20, 0.05, 0.06, 0.06)) == [i for i in ALL if i not in (6, 10)]
    assert free((0.06, 0.06, 0.12), (0.20, 0.10, 0.06, 0.06)) == [i for i in ALL if i not in (6, 7, 10, 11)]
    assert free((0.06, 0.06, 0.12), (0.15, 0.05, 0.06, 0.06), (0.35, -0.15, 0.06, 0.06)) == [i for i in ALL if i not in (6, 12)]


@pytest.mark.parametrize(("axis", "neighbour"), [(0, 10), (1, 7)])
def test_the_gap_between_boxes(axis: int, neighbour: int) -> None:
    """Cells are 0.1 m apart: half of both widths and the gap of 5 mm must fit between their centres, along x or along y."""
    assert GAP_M == 0.005
    for more, taken in ((-HAIR, False), (HAIR, True)):
        width = 2 * (0.1 - GAP_M) - 0.06 + more
        other = [0.06, 0.06]
        other[axis] = width
        assert (neighbour not in free((0.06, 0.06, 0.12), (0.15, 0.05, other[0], other[1]))) == taken
    for more, taken in ((-HAIR, False), (HAIR, True)):
        size = [0.06, 0.06, 0.12]
        size[axis] = 0.075 + more  # 0.0375 + 0.0575 + 0.005 = 0.1, and it fits between the walls
        other = [0.06, 0.06]
        other[axis] = 0.115
        assert (neighbour not in free((size[0], size[1], size[2]), (0.15, 0.05, other[0], other[1]))) == taken


def test_apart_along_one_axis_is_enough() -> None:
    """A long neighbour in the row in front takes its row alone."""
    assert free((0.06, 0.06, 0.12), (0.15, 0.0, 0.06, 0.4)) == [0, 1, 2, 3, *range(8, 16)]
    assert free((0.06, 0.06, 0.12), (0.2, -0.05, 0.4, 0.06)) == [i for i in ALL if i % 4 != 1]


def test_an_object_is_not_in_its_own_way() -> None:
    seen = observation({"moved": (0.15, 0.05, 0.06, 0.06, 0.06, 0.12), "target": (0.35, 0.15, 0.06, 0.06, 0.06, 0.12)})
    assert free_regions(seen, "moved").tolist() == [i for i in ALL if i != 15]
    assert free_regions(seen, "target").tolist() == [i for i in ALL if i != 6]


def test_what_was_not_seen_is_not_free() -> None:
    assert free((0.06, 0.06, 0.12), unseen=[0, 9]) == [i for i in ALL if i not in (0, 9)]
    seen = observation({"moved": FAR})
    seen.regions[:, 3] = np.linspace(0.0, 1.0, 16)  # flags between the two: half and less is not seen
    assert free_regions(seen, "moved").tolist() == list(range(8, 16))
    seen.regions[:, 3] = 0.5
    assert free_regions(seen, "moved").tolist() == []


def test_the_walls() -> None:
    """5 mm before the back and the sides; nothing need be left before the open front, but no box may stick out."""
    for more, fits in ((-HAIR, True), (HAIR, False)):
        assert (15 in free((2 * (0.05 - GAP_M) + more, 0.02, 0.12))) == fits  # back: 0.35 + half + gap = 0.4
        assert (0 in free((2 * 0.05 + more, 0.02, 0.12))) == fits  # front: 0.05 − half = 0
        assert (8 in free((0.02, 2 * (0.05 - GAP_M) + more, 0.12))) == fits  # right: 0.15 + half + gap = 0.2
        assert (11 in free((0.02, 2 * (0.05 - GAP_M) + more, 0.12))) == fits  # left
    assert free((0.02, 0.16, 0.12)) == [i for i in ALL if i % 4 in (1, 2)]
    assert free((0.16, 0.02, 0.12)) == [4, 5, 6, 7, 8, 9, 10, 11]


def test_just_the_gap_is_enough() -> None:
    """At the distances themselves, in numbers that add up exactly."""
    x, y = observation({"moved": FAR}).regions[15, :2]
    to_the_back, to_the_side = adding_up(x, 0.4 - GAP_M), adding_up(y, 0.2 - GAP_M)
    assert 15 in free((2 * to_the_back, 0.02, 0.12))
    assert 15 in free((0.02, 2 * to_the_side, 0.12))
    assert 0 in free((0.1, 0.02, 0.12))  # the front: 0.05 − 0.1 / 2 = 0
    x, y = observation({"moved": FAR}).regions[5, :2]
    assert 5 in free((0.0, 0.0, 0.12), (x, 0.5, 0.5, 2 * adding_up(GAP_M, 0.5 - y)))


def adding_up(to: float, end: float) -> float:
    """The number that makes `to` exactly `end`."""
    return float(next(n for n in (end - to, np.nextafter(end - to, -1), np.nextafter(end - to, 1)) if to + n == end))


def test_the_ceiling() -> None:
    """An object may be as high as the cabinet, no higher."""
    assert free((0.06, 0.06, 0.3)) == ALL
    assert free((0.06, 0.06, 0.3 + HAIR)) == []


def test_a_cabinet_that_is_turned_and_moved() -> None:
    """Boxes lie along the world's axes, so that in a cabinet turned by 45° they reach √2 times as far; more than 0.09 does not fit."""
    T = transform(rotation_about((0, 0, 1), np.pi / 4), [3.0, -2.0, 0.5])
    for size, fits in ((0.06, ALL), (0.0636, ALL), (0.0637, [1, 2, 5, 6, 9, 10])):
        assert free_regions(observation({"moved": (*FAR[:3], size, size, 0.1)}, T_cabinet=T), "moved").tolist() == fits
    quarter = transform(rotation_about((0, 0, 1), np.pi / 2), [3.0, -2.0, 0.5])
    seen = observation({"moved": (*FAR[:3], 0.02, 0.16, 0.1)}, T_cabinet=quarter)  # its long side lies along the cabinet's depth
    assert free_regions(seen, "moved").tolist() == [4, 5, 6, 7, 8, 9, 10, 11]
    on_its_back = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # the cabinet's x, y, z lie along the world's y, z, x
    seen = observation({"moved": (*FAR[:3], 0.1, 0.02, 0.16)}, T_cabinet=transform(on_its_back))
    assert free_regions(seen, "moved").tolist() == [i for i in ALL if i % 4 in (1, 2)]
    other = (*(T @ [0.05, 0.15, 0.0, 1.0])[:2], 0.15, 0.05, 0.05, 0.3)
    seen = observation({"moved": (*FAR[:3], 0.05, 0.05, 0.1), "other": other}, T_cabinet=T)
    assert free_regions(seen, "moved").tolist() == [i for i in ALL if i != 3]
