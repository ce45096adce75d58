"""A suction cup on bodies whose every distance is known by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.shapes import Box, ConvexMesh, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning.plan import Fault
from planning.verdict.cup import AROUND, cup_faults, lines, met
from planning.verdict.faults import Settings
from planning.verdict.hand import Pad
from planning.verdict.polyhedra import Polyhedron, Window, polyhedra

SQUARE = np.array([[-0.01, -0.01], [0.01, -0.01], [0.01, 0.01], [-0.01, 0.01]])
CUP = Pad("lip", 0, 0, np.eye(4), Window(SQUARE))
FACE = transform(rotation_about((0, 0, 1), 0.4), [0.1, 0.2, 0.3])
"""Where the face is in the hand's frame."""
BOX = polyhedra(Box(np.array([0.1, 0.1, 0.2])))


def said(T_face_body: Array, body: tuple[Polyhedron, ...] = BOX, **asked: float) -> list[Fault]:
    return cup_faults(CUP, FACE, body, FACE @ T_face_body, "it", "grasp", Settings(**asked))  # type: ignore[arg-type]


def test_lines_through_a_face() -> None:
    """48 along the outline, evenly from its first corner on, as many on outlines 0.6 and 0.2 as large, and one in the middle."""
    square = SQUARE + np.array([0.05, 0.0])
    points = lines(square)
    assert points.shape == (3 * AROUND + 1, 2) == (145, 2)
    assert points[-1] == pytest.approx([0.05, 0.0])
    ring = points[:48]
    assert ring[0] == pytest.approx(square[0])
    assert ring[1] == pytest.approx(square[0] + [0.08 / 48, 0.0])
    assert ring[12] == pytest.approx(square[1])
    assert ring[30] == pytest.approx([0.05, 0.01])
    assert ring[47] == pytest.approx(square[0] + [0.0, 0.08 / 48])
    assert points[48:96] - [0.05, 0] == pytest.approx(0.6 * (ring - [0.05, 0]))
    assert points[96:144] - [0.05, 0] == pytest.approx(0.2 * (ring - [0.05, 0]))


def test_where_lines_meet_a_box() -> None:
    """It begins 3 cm above the plane; beyond its sides nothing is met, in a side it is."""
    box = BOX[0].moved(transform(p=[0.0, 0.0, 0.13]))
    points = np.array([[0.0, 0.0], [0.05, 0.0], [0.0500001, 0.0], [0.0, -0.0500001], [0.049, -0.049]])
    gap, normal = met(points, [box])
    assert gap == pytest.approx([0.03, 0.03, np.inf, np.inf, 0.03])
    assert normal.tolist() == [[0, 0, -1]] * 5


def test_where_lines_meet_several_parts() -> None:
    """The nearest counts, whichever comes first; what lies wholly behind the plane is not met; what reaches through it is, below it."""
    low, high, behind, through = (BOX[0].moved(transform(p=[x, 0.0, z])) for x, z in ((0.0, 0.11), (0.06, 0.12), (0.0, -0.1), (0.0, 0.0)))
    points = np.array([[0.0, 0.0], [0.03, 0.0], [0.1, 0.0]])
    for parts in ([low, high], [high, low], [behind, high, low]):
        assert met(points, parts)[0] == pytest.approx([0.01, 0.01, 0.02])
    assert met(points, [behind])[0].tolist() == [np.inf] * 3
    assert met(points[:1], [BOX[0].moved(transform(p=[0.0, 0.0, -0.0999]))])[0] == pytest.approx([-0.1999])
    assert met(points[:1], [low, through])[0] == pytest.approx([-0.1])
    assert met(points, [])[0].tolist() == [np.inf] * 3


def test_the_normal_is_that_of_the_plane_that_is_entered() -> None:
    """A box that stands on its edge, 45° to either side."""
    T = transform(rotation_about((0, 1, 0), np.pi / 4), [0.0, 0.0, 0.2])
    gap, normal = met(np.array([[0.02, 0.0], [0.5, 0.5], [-0.02, 0.01]]), [polyhedra(Box(np.full(3, 0.1)))[0].moved(T)])
    assert gap[[0, 2]] == pytest.approx(2 * [0.2 - 0.05 * np.sqrt(2) + 0.02])
    assert gap[1] == np.inf
    assert normal[[0, 2]] == pytest.approx(np.array([[1, 0, -1], [-1, 0, -1]]) / np.sqrt(2))


def test_a_line_through_a_tip_meets_it() -> None:
    """Of an octahedron whose middle is at z = 1: at its side's corner it enters and leaves at once."""
    planes = np.array([[x, y, z, 1 + z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    octahedron = replace(BOX[0], planes=planes)
    assert met(np.array([[1.0, 0.0], [0.5, 0.0], [1.5, 0.0]]), [octahedron])[0].tolist() == [1.0, 0.5, np.inf]


def test_what_is_just_allowed_holds() -> None:
    for T, setting in ((transform(p=[0, 0, 0.1006]), "gap_m"), (transform(p=[0, 0, 0.0988]), "depth_m")):
        (fault,) = said(T)
        assert fault.amount is not None
        assert said(T, **{setting: fault.amount}) == []
        assert len(said(T, **{setting: float(np.nextafter(fault.amount, 0))})) == 1
    T = transform(rotation_about((0, 1, 0), 0.1)) @ transform(p=[0, 0, 0.1])
    (fault,) = said(T, gap_m=0.01, depth_m=0.01)
    assert fault.amount is not None
    assert said(T, gap_m=0.01, depth_m=0.01, cup_rad=fault.amount) == []


def test_the_furthest_and_the_deepest_of_a_lip_count() -> None:
    """Tilted by 0.06 about its middle: 0.6 mm off on one side, as deep in on the other."""
    tilted = transform(rotation_about((0, 1, 0), 0.06)) @ transform(p=[0, 0, 0.1])
    assert said(tilted)[0].detail == "lip stops 0.6 mm before it"
    assert said(transform(p=[0, 0, -0.0005]) @ tilted)[0].detail == "lip is 1.1 mm inside it"
    assert said(transform(p=[0, 0, 0.2]))[0].detail == "lip stops 100.0 mm before it"
    assert said(transform(p=[0, 0, 0.0]))[0].detail == "lip is 100.0 mm inside it"


def test_a_normal_a_little_too_long_looks_straight() -> None:
    long = replace(BOX[0], planes=BOX[0].planes * [1 + 1e-12, 1 + 1e-12, 1 + 1e-12, 1])
    assert said(transform(p=[0, 0, 0.1]), (long,)) == []


def test_what_a_cup_holds() -> None:
    """Flat on a face, to half a millimetre before it and a millimetre inside, and 0.07 rad askew."""
    for gap, well in ((0.0, True), (0.0004, True), (-0.0009, True)):
        assert (said(transform(p=[0, 0, 0.1 + gap])) == []) == well
    (far,) = said(transform(p=[0, 0, 0.1006]))
    assert far == Fault("grasp", ("lip", "it"), "lip stops 0.6 mm before it", far.amount)
    assert far.amount == pytest.approx(0.0006)
    (deep,) = said(transform(p=[0, 0, 0.0988]))
    assert deep == Fault("grasp", ("lip", "it"), "lip is 1.2 mm inside it", deep.amount)
    assert deep.amount == pytest.approx(0.0012)
    assert said(transform(p=[0, 0, 0.1012]), gap_m=0.002) == said(transform(p=[0, 0, 0.0988]), depth_m=0.002) == []


def test_a_cup_that_is_askew_does_not_seal() -> None:
    for angle, well in ((0.03, True), (-0.069, True), (0.071, False), (-0.2, False)):
        found = said(transform(rotation_about((0, 1, 0), angle)) @ transform(p=[0, 0, 0.1]), gap_m=0.01, depth_m=0.01)
        wrong = Fault("grasp", ("lip", "it"), f"lip is {np.degrees(abs(angle)):.0f}° askew on it", abs(angle))
        assert [f.detail for f in found] == ([] if well else [wrong.detail])
        assert [(f.stage, f.bodies) for f in found] == ([] if well else [("grasp", ("lip", "it"))])
        assert [f.amount for f in found] == ([] if well else [pytest.approx(abs(angle))])
    half = said(transform(p=[0, 0, 0.1]), (_ridge(),), gap_m=0.02)
    assert half[0].detail == "lip is 27° askew on it"  # half of it on a slope that falls by one in two


def _ridge() -> Polyhedron:
    """The box with its half x < 0 planed off, from 10 cm below its middle to 7.5 cm at the side."""
    corners = box_corners(np.array([0.05, 0.05, 0.1]))
    corners[(corners[:, 0] < 0) & (corners[:, 2] < 0), 2] += 0.025
    edge = np.array([[0.0, y, -0.1] for y in (-0.05, 0.05)])
    return polyhedra(ConvexMesh((np.concatenate([corners, edge]),)))[0]


def test_a_cup_beside_a_body_or_over_its_edge() -> None:
    assert said(transform(p=[0.2, 0, 0.1])) == [Fault("grasp", ("lip", "it"), "lip is beside it")]
    assert said(transform(p=[0, 0, -0.11])) == [Fault("grasp", ("lip", "it"), "lip is beside it")]
    # its side at 5.1 mm: what lies beyond of 3 × 48 lines through a square of 2 cm and one in the middle, which is not over it either
    found = said(transform(p=[0.0551, 0, 0.1]))
    over = int((lines(SQUARE)[:, 0] < 0.0051).sum())
    assert found == [Fault("grasp", ("lip", "it"), f"lip does not lie on it whole: {100 * over / 145:.0f} % of it is beyond an edge")]
    assert 70 < 100 * over / 145 < 90
