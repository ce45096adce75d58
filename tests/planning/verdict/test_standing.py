"""What stands, floats, hangs over, is stacked, tips or leans."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.scene import Cabinet
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.verdict.standing import Placed, Stand, placed, stand

CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(rotation_about((0, 0, 1), 0.4), [0.30, 0.1, 0.10]), 0.03)
BOX, CAN = Box(np.array([0.06, 0.04, 0.10])), Cylinder(0.03, 0.12)


def put(shape: Shape, T_cabinet: Array, name: str = "it") -> Placed:
    return placed(name, shape, CABINET.T_world_cabinet @ T_cabinet, CABINET)


def on(shape: Shape, T: Array, *others: Placed) -> Stand:
    return stand(put(shape, T), others, CABINET, 0.001)


@pytest.mark.parametrize(("shape", "half"), [(BOX, 0.05), (CAN, 0.06)], ids=["box", "can"])
@pytest.mark.parametrize(("up", "stands"), [(0.0, True), (0.0009, True), (-0.0009, True), (0.0012, False), (-0.0012, False), (0.2, False)])
def test_within_a_millimetre_of_the_floor(shape: Shape, half: float, up: float, stands: bool) -> None:
    found = on(shape, transform(rotation_about((0, 0, 1), 1.1), [0.3, 0.1, half + up]))
    assert found.carried == stands
    assert found.gap_m == pytest.approx(up, abs=1e-9)
    assert (found.on == ("floor",)) == stands


@pytest.mark.parametrize(("x", "stands"), [(0.031, True), (0.001, True), (-0.001, False), (-0.04, False)])
def test_over_the_front_edge(x: float, stands: bool) -> None:
    """A box 6 cm deep stands as long as its middle is over the floor."""
    assert on(BOX, transform(p=[x, 0.0, 0.05])).carried == stands


@pytest.mark.parametrize(("shift", "stands"), [(0.0, True), (0.028, True), (0.032, False)])
def test_on_another(shift: float, stands: bool) -> None:
    below = put(Box(np.array([0.06, 0.06, 0.08])), transform(p=[0.3, 0.0, 0.04]), "below")
    found = on(CAN, transform(p=[0.3 + shift, 0.0, 0.08 + 0.06]), below)
    assert found.carried == stands
    assert found.on == ("below",)


def test_on_two_at_once() -> None:
    """A plank over a gap: neither post alone is under its middle."""
    posts = [put(Box(np.array([0.03, 0.03, 0.1])), transform(p=[0.3, y, 0.05]), str(y)) for y in (-0.1, 0.1)]
    plank = Box(np.array([0.04, 0.3, 0.02]))
    assert on(plank, transform(p=[0.3, 0.0, 0.11]), *posts).carried
    assert not on(plank, transform(p=[0.3, 0.0, 0.11]), posts[0]).carried


@pytest.mark.parametrize(("degrees", "stands"), [(0.3, True), (3.0, False), (20.0, False)])
def test_tilted_on_an_edge(degrees: float, stands: bool) -> None:
    """Within a millimetre a third of a degree is flat; beyond, it stands on an edge and falls back."""
    R = rotation_about((0, 1, 0), np.radians(degrees))
    lowest = (box_corners(BOX.half) @ R.T)[:, 2].min()
    assert on(BOX, transform(R, [0.3, 0.0, -lowest])).carried == stands


def test_a_board_that_leans_on_the_back_wall_stands() -> None:
    board = Box(np.array([0.01, 0.1, 0.3]))
    wall = CABINET.walls()[4]
    back = placed("back", wall.shape, wall.T_world_body, CABINET)
    R = rotation_about((0, 1, 0), np.radians(15))
    corners = box_corners(board.half) @ R.T
    T = transform(R, [0.56 - corners[:, 0].max(), 0.0, -corners[:, 2].min()])
    assert on(board, T, back).carried
    assert not on(board, T).carried
    assert set(on(board, T, back).on) == {"floor", "back"}


def test_a_mesh_stands_on_its_feet() -> None:
    """Two legs and a top: its middle is over the hull of both feet; over one of them it is not."""
    legs = [box_corners(np.array([0.01, 0.02, 0.05])) + np.array([x, 0.0, 0.05]) for x in (-0.05, 0.05)]
    top = box_corners(np.array([0.06, 0.02, 0.01])) + np.array([0.0, 0.0, 0.11])
    assert on(ConvexMesh((*legs, top)), transform(p=[0.3, 0.0, 0.0])).carried
    assert not on(ConvexMesh((legs[0], top)), transform(p=[0.3, 0.0, 0.0])).carried
