"""Where the sides of a solid were seen: all the way up what is straight, as far as its shoulder up a bottle."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import Array, apply, rotation_about, transform
from perception.objects.sides import LAYER_M, NARROW_M, seen_sides

T = transform(rotation_about((0, 0, 1), 0.4), [0.3, 0.1, 0.10])
CAN, BOX = Cylinder(0.035, 0.2), Box(np.array([0.07, 0.06, 0.2]))
NOISE_M = 0.001


def surface(shape: Shape, part: tuple[float, float], *, in_m: float = 0.0, n: int = 8000, noise_m: float = NOISE_M) -> Array:
    """Points on the sides of a solid at T that lie so far inside it, between two heights above its bottom, as a camera in front sees them:
    one side of a box, half of a can; and the top's."""
    rng = np.random.default_rng(7)
    z = rng.uniform(*part, n) - shape.half[2]  # type: ignore[union-attr]
    if isinstance(shape, Cylinder):
        angle, r = rng.uniform(np.pi / 2, 3 * np.pi / 2, n), shape.radius_m - in_m
        local = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    else:
        assert isinstance(shape, Box)
        local = np.column_stack([np.full(n, in_m - shape.half[0]), rng.uniform(-1, 1, n) * (shape.half[1] - in_m), z])
    local[:, 0] += rng.normal(0, noise_m, n)
    return apply(T, local)


def top(shape: Shape) -> Array:
    half = shape.half  # type: ignore[union-attr]
    xy = np.random.default_rng(8).uniform(-0.5, 0.5, (2000, 2)) * half[:2]
    return apply(T, np.column_stack([xy, np.full(2000, half[2])]))


@pytest.mark.parametrize("shape", [CAN, BOX], ids=["can", "box"])
def test_what_is_straight_has_its_sides_all_the_way_up(shape: Shape) -> None:
    """Though only some of it shows, at the top its face, and nothing of it below."""
    assert seen_sides(shape, T, np.concatenate([surface(shape, (0.0, 0.2)), top(shape)])) is None
    assert seen_sides(shape, T, np.concatenate([surface(shape, (0.12, 0.2)), top(shape)])) is None
    assert seen_sides(shape, T, top(shape)) is None
    assert seen_sides(shape, T, surface(shape, (0.0, 0.2), in_m=1.5 * NARROW_M)) is None


@pytest.mark.parametrize("shape", [CAN, BOX], ids=["can", "box"])
@pytest.mark.parametrize("shoulder", [0.06, 0.12, 0.16])
def test_a_bottle_has_them_as_far_as_its_shoulder(shape: Shape, shoulder: float) -> None:
    points = np.concatenate([surface(shape, (0.0, shoulder)), surface(shape, (shoulder, 0.2), in_m=0.015)])
    sides = seen_sides(shape, T, points)
    assert sides is not None
    assert sides[0] == 0.0
    assert abs(sides[1] - shoulder) <= LAYER_M + 1e-9
    hidden = points[(points[:, 2] > 0.10 + shoulder - 0.1 - 0.02)]  # most of its body is hidden
    seen = seen_sides(shape, T, hidden)
    assert seen is not None
    assert abs(seen[1] - shoulder) <= LAYER_M + 1e-9


def test_a_goblet_has_them_above_its_stem() -> None:
    points = np.concatenate([surface(CAN, (0.0, 0.08), in_m=0.02), surface(CAN, (0.08, 0.2))])
    sides = seen_sides(CAN, T, points)
    assert sides is not None
    assert abs(sides[0] - 0.08) <= LAYER_M + 1e-9
    assert sides[1] == pytest.approx(0.2)


def test_nothing_is_said_of_what_is_nowhere_as_wide_or_is_shown_by_hardly_any_point() -> None:
    assert seen_sides(CAN, T, surface(CAN, (0.0, 0.2), in_m=0.02)) is None
    assert seen_sides(CAN, T, surface(CAN, (0.12, 0.2), in_m=0.02, n=100)) is None
    assert seen_sides(ConvexMesh((box_corners(BOX.half),)), T, surface(BOX, (0.0, 0.2), in_m=0.02)) is None
