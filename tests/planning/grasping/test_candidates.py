"""Which hands are asked about, by hand: heights on meshes, backs on boxes, shallow pitches, kinds of grippers; and ties between faces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Body
from kinematics.shapes import UPRIGHT, Box, ConvexMesh, Cylinder, Shape, box_corners, is_upright
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.antipodal import skew
from planning.grasping.candidates import Candidate, Candidates, with_sides
from planning.grasping.finger_grasps import sample_grasps
from planning.grasping.hand_poses import LEAST_BITE_M, STAY, Move, fit_box, height_of, level_hand, most_above, usual_lowest
from planning.grasping.line_contacts import Contact, line_contacts
from planning.grasping.pads import Pad
from planning.grasping.sampling import DENSE, USUAL, Sampling

X, Y, Z = np.eye(3)
OPENING = Opening(np.array([0.8, 0.0]), np.array([0.0, 0.10]), np.zeros(2), np.full(2, 0.5), np.zeros(2))
BOX, CAN = Box(np.array([0.04, 0.06, 0.10])), Cylinder(0.03, 0.10)
BRICK = ConvexMesh((box_corners(np.array([0.02, 0.03, 0.10])),))
"""A mesh of 4 × 6 × 20 cm about its origin."""


def candidates(
    shape: Shape, *kinds: str, sampling: Sampling = USUAL, T: Array | None = None, toward: float = 0.0, room_m: float | None = None
) -> Candidates:
    body = Body("it", shape, np.eye(4) if T is None else T)
    room_m = sampling.rooms_m[0] if room_m is None else room_m
    return Candidates(body, OPENING, kinds, -0.10, toward, sampling, usual_lowest, room_m)


def backs(shape: Shape, kind: str) -> list[float]:
    return sorted({c.back_m for c in candidates(shape, kind, sampling=DENSE).all_round()})


def test_only_boxes_are_taken_nearer_to_the_hand_and_only_level() -> None:
    assert backs(BOX, "horizontal") == sorted(DENSE.backs_m)
    assert [backs(BOX, kind) for kind in ("diagonal", "downward")] == [[0.0], [0.0]]
    assert [backs(shape, "horizontal") for shape in (CAN, BRICK)] == [[0.0], [0.0]]


@pytest.mark.parametrize("shape", [BOX, CAN], ids=["box", "can"])
def test_what_was_seen_is_held_where_its_sides_are(shape: Shape) -> None:
    """As if there were no more of it; whatever is said of sides beyond its height, or of what lies, counts for nothing."""
    body = Body("it", shape, transform(p=[0.5, 0.1, 0.05]))
    part = with_sides(replace(body, sides_m=(0.02, 0.06)))
    assert part.shape.half == pytest.approx([*shape.half[:2], 0.02])  # type: ignore[union-attr]
    assert part.T_world_body[:3, 3] == pytest.approx([0.5, 0.1, 0.04])
    kinds = ("horizontal", "diagonal")
    hands = [list(sample_grasps(b, OPENING, kinds, 0.0, 0.0, DENSE)) for b in (replace(body, sides_m=(0.02, 0.06)), part, body)]
    poses = [[grasp.T_world_hand for grasp in some] for some in hands]
    assert np.array_equal(poses[0], poses[1])
    assert not np.array_equal(poses[0], poses[2])
    assert with_sides(body) is body
    assert with_sides(replace(body, sides_m=(0.02, 9.0))).T_world_body[2, 3] == pytest.approx(0.06)
    for nothing in (
        replace(body, sides_m=(0.2, 0.3)),
        replace(body, sides_m=(0.02, 0.06), T_world_body=transform(rotation_about(X, np.pi / 2))),
        replace(body, sides_m=(0.02, 0.06), shape=BRICK),
    ):
        assert with_sides(nothing) is nothing


def test_a_mesh_is_held_lower_too_and_from_above_as_low_as_diagonally() -> None:
    """From −10 cm to 10 cm: at 0.6 and 0.85 of its height, then at 0.45 and 0.3, each once."""
    level = candidates(BRICK, "horizontal")
    assert level._heights("horizontal", 0.0) == pytest.approx([0.02, 0.07, -0.01, -0.04])
    assert candidates(BRICK, "downward")._heights("downward", np.pi / 2) == pytest.approx([0.08, -0.01, -0.04])
    high = replace(candidates(BRICK, "downward"), lowest=lambda kind, pitch: {"diagonal": 0.08, "downward": 0.0}[kind])
    assert high._heights("downward", np.pi / 2) == pytest.approx([0.08, -0.01, -0.02])
    same = replace(USUAL, heights=(0.3, 0.6))
    assert candidates(BRICK, "horizontal", sampling=same)._heights("horizontal", 0.0) == pytest.approx([-0.04, 0.02, -0.01])
    assert candidates(BOX, "downward")._heights("downward", np.pi / 2) == pytest.approx([0.03])


def test_a_mesh_too_low_for_a_height_has_fewer() -> None:
    """2 cm high: over a floor at −10 cm all heights are the lowest that its top allows, or none."""
    flat = ConvexMesh((box_corners(np.array([0.02, 0.03, 0.01])),))
    on_floor = candidates(flat, "horizontal", T=transform(p=[0.0, 0.0, -0.09]))
    assert on_floor._heights("horizontal", 0.0) == []


def test_where_more_room_is_kept_no_hand_is_level() -> None:
    """Level ones always keep the usual room; what is pitched ever so little is asked about."""
    usual = Sampling(pitches={"horizontal": (0.0,), "diagonal": (0.01, 0.5)})
    assert candidates(BOX, "horizontal", "diagonal", sampling=usual).kinds == [("horizontal", 0.0), ("diagonal", 0.01), ("diagonal", 0.5)]
    wide = candidates(BOX, "horizontal", "diagonal", sampling=usual, room_m=usual.rooms_m[0] + 0.01)
    assert wide.kinds == [("diagonal", 0.01), ("diagonal", 0.5)]


def test_upright_is_within_a_degree_and_either_way_up() -> None:
    for degrees, upright in ((0, True), (0.9, True), (1.1, False), (178.9, False), (179.1, True), (180, True)):
        assert is_upright(transform(rotation_about(X, np.radians(degrees)))) == upright
    assert np.degrees(np.arccos(UPRIGHT)) == pytest.approx(1.0)


def test_only_upright_cans_are_held_so_high_that_they_fit_before_the_palm() -> None:
    shallow = replace(OPENING, depth_m=np.full(2, 0.03))
    for T, upright in ((np.eye(4), True), (transform(rotation_about(X, np.pi / 2), [0.0, 0.0, -0.07]), False)):
        found = replace(candidates(CAN, "diagonal", T=T), opening=shallow)
        high = found.bounds[1][2]
        fits = high - most_above(CAN.radius_m, np.pi / 3, shallow, found.room_m)
        assert (min(found._heights("diagonal", np.pi / 3)) >= min(fits, high - 0.015) - 1e-6) == upright


def test_a_hinged_jaw_holds_what_is_round_and_nothing_else() -> None:
    hinged = replace(OPENING, pad_y_m=np.full(2, 0.01), round_only=True)
    for shape, some in ((CAN, True), (BOX, False), (BRICK, False)):
        assert bool(list(sample_grasps(Body("it", shape, np.eye(4)), hinged, ["horizontal"], -0.2, 0.0))) == some


def test_a_hand_of_few_joints_looks_away_from_the_base_though_it_looks_down() -> None:
    """The rank of a hand from above goes by the side that its x turns its back to: the one towards which the arm reaches."""
    toward = 0.5
    there = np.array([np.cos(toward), np.sin(toward), 0.0])
    R = level_hand(there, np.pi / 2)
    for turned in (R, R @ np.diag([-1.0, -1.0, 1.0])):
        found = list(candidates(BRICK, "downward", toward=toward).headed(lambda T, width, turned=turned: [turned]))  # type: ignore[misc]
        assert found[0].rank == pytest.approx(0.5 * np.pi / 2)
        assert found[0].extent[0] == pytest.approx(0.02 * np.cos(toward) + 0.03 * np.sin(toward))
    back = list(candidates(BRICK, "horizontal").headed(lambda T, width: [level_hand(-X, 0.0)]))
    assert back[0].rank == pytest.approx(np.pi)
    level = list(candidates(BRICK, "horizontal").headed(lambda T, width: [level_hand(X, 0.0)]))
    assert level[0].rank == pytest.approx(0.0)
    assert level[0].extent[0] == pytest.approx(0.02)


def test_a_line_along_the_normals_has_no_skew_though_they_are_rounded() -> None:
    long = 1 + 1e-9
    assert skew(Contact(0.0, 1.0, -long * X, long * X), X) == 0.0
    assert skew(Contact(0.0, 1.0, long * X, long * X), X) == pytest.approx(np.pi)
    assert skew(Contact(0.0, 1.0, -X, (X + Y) / np.sqrt(2)), X) == pytest.approx(np.pi / 4)
    assert skew(None, X) == np.pi


def test_lying_cans_stay_where_they_are() -> None:
    hand = Candidate(0.0, np.zeros(3), Y, level_hand(X, 0.0), (0.03, 0.05, np.pi / 3), 0.0, 0.005)
    assert hand.fit(Body("it", CAN, transform(rotation_about(X, np.pi / 2))), 0.06, OPENING) == STAY


# ------------------------------------------------------------------------------------------------------------------------------------ ties


def test_a_line_out_of_an_edge_of_a_box_leaves_by_the_first_of_its_faces() -> None:
    found = line_contacts(BOX, np.eye(4), np.array([0.02, 0.03, 0.0]), np.array([0.6, 0.8, 0.0]))
    assert found is not None
    assert (found.leave, found.leave_normal.tolist()) == (0.0, [1, 0, 0])


def test_a_line_in_the_face_of_a_mesh_meets_it() -> None:
    cube = ConvexMesh((box_corners(np.full(3, 0.5)),))
    found = line_contacts(cube, np.eye(4), np.array([0.0, 0.5, 0.0]), X)
    assert found is not None
    assert (found.enter, found.leave) == pytest.approx((-0.5, 0.5))
    assert line_contacts(cube, np.eye(4), np.array([0.0, 0.5 + 1e-9, 0.0]), X) is None


# --------------------------------------------------------------------------------------------------------------------------------- heights


def test_the_height_from_above_is_the_same_for_every_share() -> None:
    for share in (0.6, 1.0):
        assert height_of("downward", 0.5, 0.7, 0.515, share) == pytest.approx(0.68)


def test_a_box_is_taken_nearer_to_the_hand_by_what_is_asked_for_but_no_further_than_it_is_held() -> None:
    """5 cm from the middle to the near face; a deep hand need not go back at all."""
    for more, along in ((0.0, 0.0), (0.01, 0.01), (np.inf, 0.05 - LEAST_BITE_M)):
        assert fit_box(0.05, 0.05, 0.0, 0.04, OPENING, more, 0.005) == Move(along)


# ------------------------------------------------------------------------------------------------------------------------------------ tips


def test_only_what_is_lower_than_the_tips_let_it_be_is_held_by_the_pads_ends_and_only_straight_from_above() -> None:
    """A mesh's middle, at 0, is asked about as well where the pads' own middle stays a millimetre above it."""
    usual = [0.08, -0.01, -0.04]
    for tips_z, more in ((-0.001, []), (0.0, []), (0.001, [0.0])):
        down = replace(candidates(BRICK, "downward", "diagonal"), tips_z=tips_z)
        assert down._heights("downward", np.pi / 2) == pytest.approx(usual + more)
        assert 0.0 not in down._heights("diagonal", np.pi / 6)


def test_boxes_are_not_raised_for_the_tips() -> None:
    """The tips of a hand 13 mm higher would be clear of the floor; of a box that is not asked."""
    body, long = Body("it", BOX, np.eye(4)), Pad(0.01, -0.01, 0.01, 0.09)
    found, lines = (list(sample_grasps(body, OPENING, ["downward"], -0.05, 0.0, pad=pad)) for pad in (long, None))
    assert found
    assert [g.T_world_hand.tolist() for g in found] == [g.T_world_hand.tolist() for g in lines]


def test_what_leans_by_just_a_degree_is_not_upright() -> None:
    T = np.eye(4)
    for T[2, 2], upright in ((UPRIGHT, False), (-UPRIGHT, False), (np.nextafter(UPRIGHT, 2), True)):
        assert is_upright(T) == upright


# ------------------------------------------------------------------------------------------------------------- how far back a box is held


def test_a_pitched_hand_goes_back_as_far_as_the_top_lets_it_and_then_on_a_level_as_far_as_the_near_end_does() -> None:
    """Of the palm just one plane is known, across the approach. At 30° half a metre up goes with a metre back, 5 mm of the 2 cm above may
    be gone up, and a centimetre along the approach stays of the 10 cm; with a deep palm less is asked for."""
    co = np.cos(np.pi / 6)
    at_most = 0.10 - 0.01 * co - LEAST_BITE_M * co
    for depth, level_m in ((0.0, at_most), (0.06, 0.10 - 0.01 * co - (0.06 - 0.005 - 0.015 / 2) / co), (0.2, None)):
        move = fit_box(0.10, 0.02, np.pi / 6, 0.05, replace(OPENING, depth_m=np.full(2, depth)), 0.0, 0.005)
        if level_m is None:
            assert move == STAY
        else:
            assert (move.along_m, move.up_m, move.level_m) == pytest.approx((0.01, 0.0, level_m))


def test_a_hand_from_above_goes_up_and_nowhere_else() -> None:
    """Until the pads' middle is 15 mm under the top, though more lies behind it."""
    for depth, along in ((0.0, 0.035), (0.03, 0.025), (0.1, 0.0)):
        move = fit_box(0.03, 0.05, np.pi / 2, 0.05, replace(OPENING, depth_m=np.full(2, depth)), 0.0, 0.005)
        assert (move.along_m, move.up_m, move.level_m) == pytest.approx((along, 0.0, 0.0))
