"""Motions as numbers: how far and how densely, which forms are refused, and in which words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_arm import ARM, JOINTS, course, motion, splined

from kinematics.transforms import Array
from planning.plan import Fault, Motion
from planning.verdict.course import courses, dense_rows


def values(rows: Array, joint: int = 0) -> list[float]:
    return [float(x) for x in rows[:, joint]]


def test_a_polyline_reaches_as_far_as_its_rows() -> None:
    low, high = course((1, 2), (-1, 5), (0, 3, 0.5)).reach
    assert (low.tolist(), high.tolist()) == ([-1, 2, 0, 0, 0], [1, 5, 0.5, 0, 0])
    assert course((0,)).where == "motion 0"
    assert course((0,), number=7).where == "motion 7"


def test_a_spline_reaches_as_far_as_its_coefficients() -> None:
    """From 0 at 5 rad/s to 0 at rest within a second: the coefficients are 0, 1, 2, 0, 0, 0."""
    qd = np.zeros((2, 5))
    qd[0, 1] = 5.0
    low, high = splined((0,), (0,), qd=qd).reach
    assert (low.tolist(), high.tolist()) == ([0.0] * 5, [0, 2, 0, 0, 0])


def test_the_way_between_rows_is_that_of_the_joint_that_goes_furthest() -> None:
    assert course((0, 0), (1, -3), (1.5, -3)).ways.tolist() == [3, 0.5]
    assert course((0, 0)).ways.tolist() == []
    assert splined((0, 0), (1, -3)).ways.tolist() == [3]
    qd = np.zeros((2, 5))
    qd[0, 1] = 5.0  # there and back: 0, 1, 2, 0
    assert splined((0,), (0,), qd=qd).ways.tolist() == [4]
    assert splined((0,), (0.5,), qd=qd).ways.tolist() == [4]


def test_a_polyline_is_cut_into_even_pieces() -> None:
    """No longer than the step; a row that stands still has one piece."""
    rows, q = course((0,), (1,), (1,), (1.2,)).dense(0.5)
    assert rows.tolist() == [0, 0.5, 1, 2, 3]
    assert values(q) == [0, 0.5, 1, 1, 1.2]
    rows, q = course((0,), (1,)).dense(0.3)
    assert rows.tolist() == [0, 0.25, 0.5, 0.75, 1]
    rows, q = course((0, 2)).dense(0.3)
    assert (rows.tolist(), q.tolist()) == ([0], [[0, 2, 0, 0, 0]])


def test_a_place_on_the_way_is_counted_in_rows() -> None:
    way = course((0,), (1,), (3,), t_s=(0, 1, 4))
    assert values(way.at(np.array([0, 0.25, 1, 1.5, 2]))) == [0, 0.25, 1, 2, 3]
    assert values(course((4,)).at(np.array([0.0, 0.0]))) == [4, 4]
    assert values(course((4,), (6,)).at(np.array([0.0, 1.0]))) == [4, 6]


def test_a_spline_is_asked_at_its_times() -> None:
    """From rest to rest 10 s³ - 15 s⁴ + 6 s⁵: 0.5 half-way, 0.103515625 a quarter of the way, whatever time it takes."""
    way = splined((0,), (1,), (3,), t_s=(0, 1, 5))
    assert values(way.at(np.array([0, 0.25, 0.5, 1, 1.25, 1.5, 2]))) == pytest.approx([0, 0.103515625, 0.5, 1, 1.20703125, 2, 3])
    rows, q = way.dense(1.0)
    assert rows.tolist() == [0, 1, 1.5, 2]
    assert values(q) == pytest.approx([0, 1, 2, 3])


def test_several_courses_are_cut_as_each_alone() -> None:
    some = [course((0,), (1,), (1,)), course((5,)), splined((0,), (2,)), course((1, 1), (1, 0))]
    together = dense_rows(some, 0.4)
    assert [len(rows) for rows in together] == [5, 1, 6, 4]
    for rows, alone in zip(together, some, strict=True):
        assert np.array_equal(rows, alone.dense(0.4)[1])


def test_several_splines_are_cut_as_each_alone() -> None:
    """Though they do not begin where the one before ends, nor at 0 s."""
    some = [splined((0,), (2,), (3, 1)), splined((7,), (7.1,)), splined((-1, 0), (1, 0), (1, 0.5), t_s=(2, 2.5, 6)), splined((4,), (4,))]
    together = dense_rows(some, 0.4)
    for rows, alone in zip(together, some, strict=True):
        assert rows == pytest.approx(alone.dense(0.4)[1], abs=1e-12)
        assert rows[0].tolist() == alone.q[0].tolist()


def test_a_piece_that_takes_no_time_to_speak_of_hides_nothing() -> None:
    """After a long course its times could not be told apart from one another, if they were counted on."""
    long, short = splined((0,), (3,), t_s=(0, 9000)), splined((0, 0), (0, 0), (0, 1), t_s=(0, 1e-15, 1))
    rows = dense_rows([long, short], 0.1)
    assert np.isfinite(rows[1]).all()
    assert rows[1] == pytest.approx(short.dense(0.1)[1], abs=1e-12)


# ------------------------------------------------------------------------------------------------------------------------------------ form


def test_motions_become_numbers_in_the_arms_order() -> None:
    """A mimic joint may be among them; rows are those of the URDF's own joints."""
    names = ("grip", "mirror", "tip", "turn", "y", "x")
    q = np.array([[0.01, -0.01, 4, 3, 2, 1], [0.02, -0.02, 4, 3, 2, 1.5]])
    rates = np.array([[0.1, -0.1, 0.2, 0.3, 0.4, 0.5], [0, 0, 0, 0, 0, 0]])
    made = Motion("lift", names, q, np.array([0.0, 2.0]), None, (("left", "it"), ("right", "it")), rates, 2 * rates, clearance_m=0.004)
    found, wrong = courses(ARM, [motion((0,)), made])
    assert wrong == []
    first, second = found
    assert (first.number, first.stage, first.spline, first.clearance_m) == (0, "transit", None, None)
    assert (second.number, second.stage, second.held, second.clearance_m) == (1, "lift", None, 0.004)
    assert second.q.tolist() == [[1, 2, 3, 4, 0.01], [1.5, 2, 3, 4, 0.02]]
    assert second.t_s.tolist() == [0, 2]
    assert second.allowed == {frozenset(("left", "it")), frozenset(("right", "it"))}
    assert second.spline is not None
    # the first coefficients: q, q + qd h / 5, q + 2 qd h / 5 + qdd h² / 20
    assert second.spline.control[0, 1].tolist() == pytest.approx([1.2, 2.16, 3.12, 4.08, 0.05])
    assert second.spline.control[0, 2].tolist() == pytest.approx([1.6, 2.48, 3.36, 4.24, 0.13])


def test_without_rates_of_both_orders_or_of_one_row_there_is_no_spline() -> None:
    one, zero = motion((0,)), np.zeros((1, 5))
    (found,), _ = courses(ARM, [replace(one, qd=zero, qdd=zero)])
    assert found.spline is None


def test_motions_before_the_first_that_makes_no_sense_are_kept() -> None:
    odd = replace(motion((0,)), joint_names=("x", "y", "turn", "tip", "tip"))
    found, wrong = courses(ARM, [motion((0,)), odd, motion((0,))])
    assert [c.number for c in found] == [0]
    assert wrong == [Fault("transit", (), "motion 1 names a joint twice")]


def refused(**other: object) -> Fault | None:
    made = replace(motion((0,), (1,), stage="lift"), **other)  # type: ignore[arg-type]
    found, wrong = courses(ARM, [made])
    assert len(found) + len(wrong) == 1
    return wrong[0] if wrong else None


def test_names_and_tables_that_do_not_fit() -> None:
    two, known = np.zeros((2, 5)), "x, y, turn, tip, grip"
    for other, detail in (
        ({"joint_names": ("x", "y", "turn", "tip", "claw")}, f"moves 'claw', which is no actuated joint of this robot; these are {known}"),
        ({"joint_names": JOINTS[:4], "q": two[:, :4]}, f"does not say where 'grip' is; the robot's actuated joints are {known}"),
        ({"qd": two}, "has one of qd and qdd, and a spline takes both"),
        ({"qdd": two}, "has one of qd and qdd, and a spline takes both"),
        ({"q": two[:, :4]}, "has tables q, qd, qdd and t_s that don't fit each other and the joints"),
        ({"q": two[:1]}, "has tables q, qd, qdd and t_s that don't fit each other and the joints"),
        ({"qd": two, "qdd": two[:1]}, "has tables q, qd, qdd and t_s that don't fit each other and the joints"),
        ({"q": two[:0], "t_s": np.zeros(0)}, "has tables q, qd, qdd and t_s that don't fit each other and the joints"),
    ):
        assert refused(**other) == Fault("lift", (), f"motion 0 {detail}"), detail
    assert refused(qd=two, qdd=two) is None


def test_times_rise_and_begin_at_zero_or_later() -> None:
    zero, wrong = np.zeros((2, 5)), Fault("lift", (), "motion 0 has times that don't rise")
    for t_s, polyline, spline in (((0, 1), True, True), ((0, 0), True, False), ((1, 0), False, False), ((-1e-9, 1), False, False)):
        assert refused(t_s=np.array(t_s, float)) == (None if polyline else wrong)
        assert refused(t_s=np.array(t_s, float), qd=zero, qdd=zero) == (None if spline else wrong)
    assert refused(t_s=np.array([5.0, 6.0])) is None


def test_a_mimic_joint_goes_where_the_other_sends_it() -> None:
    names, q = (*JOINTS, "mirror"), np.zeros((2, 6))
    q[:, 4] = 0.02
    for away, well in ((0.0, True), (0.99e-4, True), (1.01e-4, False), (0.3, False), (np.nan, False)):
        for row in (0, 1):
            for sign in (1, -1):
                now = q.copy()
                now[:, 5] = -0.02
                now[row, 5] += sign * away
                said = refused(joint_names=names, q=now)
                if well:
                    assert said is None
                else:
                    assert said is not None
                    assert (said.stage, said.bodies) == ("lift", ())
                    assert said.detail == f"motion 0 moves 'mirror' {abs(away):.3g} from where it goes with 'grip'"
                    assert said.amount == pytest.approx(away, nan_ok=True)


def test_a_mimic_joint_may_have_an_offset() -> None:
    """And be off by a ten-thousandth itself."""
    arm = replace(ARM, followers={"mirror": (4, -1.0, 0.3)})
    for own, well in ((0.25, True), (0.35, False), (-0.25, False)):
        q = np.array([[0, 0, 0, 0, 0.05, own]])
        made = Motion("lift", (*JOINTS, "mirror"), q, np.zeros(1))
        assert bool(courses(arm, [made])[1]) is not well
    just = Motion("lift", (*JOINTS, "mirror"), np.array([[0, 0, 0, 0, 0, 1e-4]]), np.zeros(1))
    assert courses(ARM, [just])[1] == []


def test_numbers_that_nobody_meant() -> None:
    def said(q: float = 0.0, **other: object) -> Fault | None:
        return refused(q=np.array([[0, 0, 0, 0, 0], [0, q, 0, 0, 0.0]]), **other)

    wrong = [Fault("lift", (), f"motion 0 has a number as large as {x}", v) for x, v in (("1e+04", 10001.0), ("2e+04", 20000.0))]
    assert said(t_s=np.array([0.0, 1e4])) is None
    assert said(t_s=np.array([0.0, 10001.0])) == wrong[0]
    zero, big = np.zeros((2, 5)), np.full((2, 5), -2e4)
    assert said(qd=big, qdd=zero) == said(qd=zero, qdd=big) == said(-2e4) == wrong[1]
    for way, well in ((500.0, True), (-500.0, True), (501.0, False), (-501.0, False)):
        assert said(way) == (None if well else Fault("lift", (), "motion 0 turns a joint by 501 in all, and none goes that far", 501.0))
    there_and_back = np.zeros((3, 5))
    there_and_back[1, 2] = 250.5
    said_ = refused(q=there_and_back, t_s=np.arange(3.0))
    assert said_ == Fault("lift", (), "motion 0 turns a joint by 501 in all, and none goes that far", 501.0)
    apart = np.zeros((2, 5))
    apart[1, :2] = 300.0  # two joints, each for itself
    assert refused(q=apart) is None
    assert refused(q=np.full((3, 5), 400.0), t_s=np.arange(3.0)) is None  # far, but nothing moves
    assert refused(q=np.zeros((1, 5)), t_s=np.zeros(1)) is None
