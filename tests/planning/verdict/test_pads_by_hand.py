"""Two square pads on plain bodies: what is said of them, in every word, and distances that are known by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from kinematics.shapes import Box, ConvexMesh
from kinematics.transforms import Array, rotation_about, transform
from planning.plan import Fault
from planning.verdict.faults import Settings
from planning.verdict.hand import Pad
from planning.verdict.pads import Touch, beside, hold_faults, slip_angle, touch, touch_of
from planning.verdict.polyhedra import Polyhedron, Window, from_points, polyhedra

X, Y, Z = np.eye(3)
TURNED = transform(rotation_about((1, 2, -1), 0.8), [0.3, 0.1, -0.2])
FACING = {1: np.stack([Z, -X, -Y], 1), -1: np.stack([Z, X, Y], 1)}
"""How the faces of both sides stand in the hand: they look at each other along y."""


def pad(side: int, half: float = 0.01) -> Pad:
    square = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    return Pad("left" if side > 0 else "right", side, 0, np.eye(4), Window(square))


def said(
    body: Sequence[Polyhedron],
    y: float = 0.02,
    half: float = 0.01,
    T: Array | None = None,
    z: tuple[float, float] = (0.0, 0.0),
    **asked: float,
) -> list[Fault]:
    """Of pads at y and -y, and at heights z, on a body at T in the hand."""
    faces = [transform(FACING[side], [0.0, side * y, up]) for side, up in zip((1, -1), z)]
    T_body = np.eye(4) if T is None else T
    return hold_faults([pad(1, half), pad(-1, half)], faces, body, T_body, "it", "grasp", Settings(**asked))  # type: ignore[arg-type]


def box(*size: float) -> tuple[Polyhedron, ...]:
    return polyhedra(Box(np.array(size)))


def both(words: str, amount: float) -> list[Fault]:
    return [Fault("grasp", (side, "it"), f"{side} {words}", pytest.approx(amount)) for side in ("left", "right")]


def test_what_is_said_of_pads_that_touch() -> None:
    assert said(box(0.06, 0.04, 0.12)) == []
    assert said(box(0.06, 0.02, 0.12), y=0.2) == both("stops 190.0 mm before it", 0.19)
    assert said(box(0.06, 0.54, 0.12), y=0.02) == both("is 250.0 mm inside it", 0.25)
    over = transform(p=[0.0, 0.0, 0.4])  # of pads 40 cm wide the lower 20 are beside a body 1 m tall whose foot is in their middle
    assert said(box(1.0, 0.04, 0.8), half=0.2, T=over, overlap_m=0.5) == both("meets it in a strip 200.0 mm wide", 0.2)
    one = said(box(0.06, 0.04, 0.12), T=transform(p=[0, 0.002, 0]))
    assert [f.detail for f in one] == ["left is 2.0 mm inside it", "right stops 2.0 mm before it"]


def test_what_is_just_allowed_holds() -> None:
    for body, more, setting in (
        (box(0.06, 0.039, 0.12), {}, "gap_m"),
        (box(0.06, 0.046, 0.12), {}, "depth_m"),
        (box(0.06, 0.04, 0.12), {"T": transform(p=[0.0, 0.0, 0.068])}, "overlap_m"),
    ):
        first = said(body, **more)[0]  # type: ignore[arg-type]
        assert first.amount is not None
        assert said(body, **more, **{setting: first.amount}) == []  # type: ignore[arg-type]


def test_what_lies_beside_the_pads() -> None:
    """Both miss it, the one by 9 cm and the other by 14: the larger is told."""
    above = transform(p=[0.0, 0.0, 0.15])
    links = ("left", "right", "it")
    assert said(box(0.06, 0.04, 0.1), T=above, z=(0.0, -0.05)) == [
        Fault("grasp", links, "the pads close 140.0 mm beside it", pytest.approx(0.14))
    ]
    assert said(box(0.06, 0.04, 0.1), T=above, z=(-0.05, 0.06)) == [
        Fault("grasp", links, "the pads close 140.0 mm beside it", pytest.approx(0.14))
    ]
    faces = [transform(FACING[1], [0, 0.02, z]) for z in (0.0, -0.05)] + [transform(FACING[-1], [0, -0.02, 0.0])]
    (two,) = hold_faults([pad(1), pad(1), pad(-1)], faces, box(0.06, 0.04, 0.1), above, "it", "grasp", Settings())
    assert two.detail == "the pads close 90.0 mm beside it"  # the nearer face of a side


def test_a_lone_pad_is_a_cup() -> None:
    for gap, words in ((0.0, None), (0.004, "left stops 4.0 mm before it")):
        found = hold_faults([pad(1)], [np.eye(4)], box(0.06, 0.04, 0.1), transform(p=[0, 0, 0.05 + gap]), "it", "grasp", Settings())
        assert [f.detail for f in found] == ([] if words is None else [words])


def test_who_slips() -> None:
    """Both sides lean by 30°, the same way: without friction of 0.58 the pads slide along them. What misses a pad does not slip."""
    lean = np.tan(np.radians(30))
    sheared = np.array([[x, y + lean * x, z] for x in (-0.05, 0.05) for y in (-0.02, 0.02) for z in (-0.05, 0.05)])
    y = 0.02 + 0.01 * lean
    (fault,) = said((from_points(sheared),), y=y, overlap_m=0.0)
    assert fault.amount is not None
    assert fault == Fault("grasp", ("left", "right", "it"), fault.detail, fault.amount)
    assert fault.detail == f"it slips: the pads press {np.degrees(fault.amount):.0f}° off, and friction 0.5 holds 27°"
    assert np.radians(27) < fault.amount < np.radians(60)
    assert said((from_points(sheared),), y=y, overlap_m=0.0, mu=float(np.tan(fault.amount)) + 1e-9) == []
    apart = said((from_points(sheared),), y=y + 0.002, overlap_m=0.0)
    assert [f.detail.split(" ")[1] for f in apart] == ["stops", "stops"]


def spot(normal: Array, *p: float) -> Touch:
    """A contact in a point."""
    return Touch(0.0, normal, np.array([p]), 0.0)


@pytest.mark.parametrize("T", [np.eye(4), TURNED], ids=["here", "turned"])
def test_how_far_the_line_between_contacts_is_from_their_normals(T: Array) -> None:
    """Two points 40 mm apart along y: beside each other by 30 mm along x and 20 along z, or right opposite, with a normal that leans."""
    R, p = T[:3, :3], T[:3, 3]

    def angle(normal_a: Array, a: Sequence[float], normal_b: Array, b: Sequence[float]) -> float:
        return slip_angle(spot(R @ normal_a, *(R @ a + p)), spot(R @ normal_b, *(R @ b + p)))

    off = np.arctan(np.hypot(0.03, 0.02) / 0.04)
    for sx, sz in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        assert angle(-Y, [0, 0.02, 0], Y, [sx * 0.03, -0.02, sz * 0.02]) == pytest.approx(off)
    leaning = rotation_about((1, 0, 0), 0.3) @ Y
    assert angle(-Y, [0, 0.02, 0], leaning, [0, -0.02, 0]) == pytest.approx(0.3)
    assert angle(-leaning, [0, 0.02, 0], Y, [0, -0.02, 0]) == pytest.approx(0.3)
    assert angle(-Y, [0, 0.02, 0], Y, [0, -0.02, 0]) == pytest.approx(0.0, abs=1e-7)


def test_the_best_line_between_patches_counts() -> None:
    """They overlap seen along y, or are 1 cm apart."""
    square = 0.01 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1.0]])
    for off, angle in ((0.015, 0.0), (0.03, np.arctan(0.01 / 0.04))):
        a, b = (Touch(0.0, n, square + np.array(p), 0.02) for n, p in ((-Y, [0, 0.02, 0]), (Y, [off, -0.02, 0])))
        assert slip_angle(a, b) == pytest.approx(angle, abs=1e-7)


# --------------------------------------------------------------------------------------------------------------------------- one pad alone


def at(T_face_body: Array, body: Sequence[Polyhedron]) -> Touch | None:
    return touch(pad(1), TURNED, body, TURNED @ T_face_body)


def test_what_ends_at_a_pads_face_does_not_lie_before_it() -> None:
    behind = from_points(box(0.125, 0.125, 0.125)[0].vertices - np.array([0, 0, 0.0625]))
    assert touch(pad(1), np.eye(4), [behind], np.eye(4)) is None


def test_the_nearest_part_is_touched_and_all_that_are_about_as_near() -> None:
    """Three blocks side by side under a pad of 2 cm: 4 and 4.5 mm away, and 6."""
    blocks = [
        from_points(box(0.006, 0.1, 0.1)[0].vertices + np.array([x, 0.0, 0.05 + gap]))
        for x, gap in ((-0.006, 0.0045), (0.0, 0.004), (0.006, 0.006))
    ]
    for parts in (blocks, blocks[::-1]):
        found = at(np.eye(4), parts)
        assert found is not None
        assert found.gap_m == pytest.approx(0.004)
        assert found.normal == pytest.approx(TURNED[:3, 2])
        patch = (found.patch - TURNED[:3, 3]) @ TURNED[:3, :3]
        assert (patch.min(0), patch.max(0)) == (
            pytest.approx([-0.009, -0.01, 0.0], abs=1e-12),
            pytest.approx([0.003, 0.01, 0.0], abs=1e-12),
        )
        assert found.width_m == pytest.approx(0.012)


def test_parts_that_are_just_as_near_are_touched_together() -> None:
    blocks = [from_points(box(0.004, 0.1, 0.1)[0].vertices + np.array([x, 0.0, 0.05])) for x in (-0.006, 0.006)]
    found = touch(pad(1), np.eye(4), blocks, np.eye(4))
    assert found is not None
    assert found.width_m == pytest.approx(0.016)


def test_two_faces_of_a_side_touch_together() -> None:
    """Beside each other: their patches make one."""
    faces = [transform(p=[x, 0.0, 0.0]) for x in (-0.01, 0.01)]
    found = touch_of([pad(1), pad(1)], faces, box(0.1, 0.1, 0.1), transform(p=[0, 0, 0.05]))
    assert found is not None
    assert found[1].width_m == pytest.approx(0.02)
    assert np.ptp(found[1].patch[:, 0]) == pytest.approx(0.04)


def test_of_two_faces_of_a_side_the_nearer_one_tells_the_gap() -> None:
    """One is 0.4 mm further back, and still in the patch; one that is 2 mm further back is not."""
    for back, span in ((0.0004, 0.04), (0.002, 0.02)):
        faces = [transform(p=[-0.01, 0.0, -back]), transform(p=[0.01, 0.0, 0.0])]
        for order in (faces, faces[::-1]):
            found = touch_of([pad(1), pad(1)], order, box(0.1, 0.1, 0.1), transform(p=[0, 0, 0.053]))
            assert found is not None
            assert found[1].gap_m == pytest.approx(0.003)
            assert np.ptp(found[1].patch[:, 0]) == pytest.approx(span)


def test_pads_that_press_straight_at_each_other_do_not_slip_by_rounding() -> None:
    """Unit vectors whose product is a little more than 1, as some of these are, have an angle of 0 between them."""
    above = 0
    for n in np.random.default_rng(0).normal(size=(100, 3)):
        normal = n / np.linalg.norm(n)
        above += bool(normal @ normal > 1)
        assert slip_angle(spot(normal, *-normal), spot(-normal, *normal)) == pytest.approx(0.0, abs=1e-7)
    assert above


# --------------------------------------------------------------------------------------------------------------------------- how far beside


@pytest.mark.parametrize("T", [np.eye(4), TURNED], ids=["here", "turned"])
def test_how_far_a_body_is_beside(T: Array) -> None:
    """From the pad's corners and its middle to the box around each part, or to its planes."""
    cube, octahedron = box(0.1, 0.1, 0.1), (from_points(0.1 * np.concatenate([np.eye(3), -np.eye(3)])),)
    if T is TURNED:  # the box around a part is the world's own
        assert beside(pad(1), T, octahedron, T @ transform(p=[0.2, 0.2, 0.0])) >= (0.38 - 0.1) / np.sqrt(3) - 1e-9
        assert beside(pad(1), T, cube, T) == 0.0
        return
    cases = [
        ((0.0, 0.0, 0.25), cube, 0.2),
        ((0.0, 0.0, -0.25), cube, 0.2),
        ((0.2, 0.0, 0.0), cube, 0.14),
        ((-0.2, 0.0, 0.0), cube, 0.14),
        ((0.2, 0.3, 0.0), cube, np.hypot(0.14, 0.24)),
        ((-0.2, -0.3, 0.0), cube, np.hypot(0.14, 0.24)),
        ((0.2, -0.3, 0.25), cube, np.sqrt(0.14**2 + 0.24**2 + 0.2**2)),
        ((0.02, 0.0, 0.0), cube, 0.0),
        ((0.2, 0.2, 0.0), octahedron, (0.38 - 0.1) / np.sqrt(3)),
        ((0.0, 0.0, 0.3), (*cube, *octahedron), 0.2),
    ]
    for p, body, distance in cases:
        assert beside(pad(1), T, body, T @ transform(p=p)) == pytest.approx(distance), p
    far = beside(pad(1), transform(p=[0.0, 0.0, 0.1]), cube, transform(p=[0.0, 0.0, 0.25]))
    assert far == pytest.approx(0.1)


def test_a_mesh_is_held_by_whichever_parts_touch() -> None:
    left, right = (ConvexMesh((box(0.06, 0.02, 0.1)[0].vertices + np.array([0, y, 0]),)).parts[0] for y in (0.01, -0.01))
    assert said(polyhedra(ConvexMesh((left, right)))) == []
