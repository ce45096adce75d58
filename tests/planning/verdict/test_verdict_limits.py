"""What joints can't do: one look at all motions leaves out none that a closer look would find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_arm import ARM, course, splined

from kinematics.quintic_spline import coefficients, hermite
from kinematics.robots.plain_urdf import Arm, read
from kinematics.robots.robot import Robot
from planning.plan import Fault
from planning.verdict import limits
from planning.verdict.course import Course

RNG = np.random.default_rng(5)


def random_course(arm: Arm, number: int, start: np.ndarray, hurry: float, rests: bool = True, smooth: bool = True) -> Course:
    """A motion from `start` (J,) through two rows more; the larger `hurry`, the faster."""
    J = len(arm.joints)
    q = start + np.cumsum(np.concatenate([np.zeros((1, J)), RNG.uniform(-0.4, 0.4, (2, J))]), axis=0)
    t, qd, qdd = np.array([0.0, 1.0, 2.0]) / hurry, np.zeros((3, J)), np.zeros((3, J))
    qd[1], qdd[1] = RNG.normal(size=J) * 0.2 * hurry, RNG.normal(size=J) * 0.2 * hurry**2
    if not rests:
        qd[RNG.choice([0, 2]), RNG.integers(J)] = RNG.choice([-1.0, 1.0]) * 2e-4
    return Course(number, "transit", q, t, hermite(t, q, qd, qdd) if smooth else None, None, frozenset())


def test_no_fault_is_overlooked(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = replace(read(ur5e.urdf), velocity=np.full(7, 1.5))
    acceleration, jerk, seen = np.full(7, 6.0), np.full(7, 40.0), {False: 0, True: 0}
    for _ in range(60):
        at, courses = np.zeros(7), list[Course]()
        for number in range(4):
            gap = RNG.choice([0.0] * 9 + [2e-6]) if number else 0.0
            rests, smooth = RNG.random() < 0.97, RNG.random() < 0.9
            courses.append(random_course(arm, number, at + gap, RNG.choice([0.3, 0.5, 0.5, 2.0], p=[0.4, 0.3, 0.25, 0.05]), rests, smooth))
            at = courses[-1].q[-1]
        arm = replace(arm, lower=np.where(RNG.random(7) < 0.01, 0.1, -9.0), upper=np.full(7, 9.0))
        said = limits.limit_faults(arm, courses, acceleration, jerk)
        with monkeypatch.context() as patch:
            patch.setattr(limits, "_doubtful", lambda arm, courses, acceleration, jerk: np.ones(len(courses), bool))
            closely = limits.limit_faults(arm, courses, acceleration, jerk)
        assert said == closely
        seen[bool(closely)] += 1
    assert min(seen.values()) > 3


# ------------------------------------------------------------------------------------------------------------------------------- by hand

ACCELERATION = np.array([2.0, 3.0, 8.0, 8.0, 1.0])
UNKNOWN = np.full(5, np.inf)


def said(*run: Course, arm: Arm = ARM, acceleration: np.ndarray = ACCELERATION, jerk: np.ndarray = UNKNOWN) -> list[Fault]:
    return limits.limit_faults(arm, [replace(c, number=n) for n, c in enumerate(run)], acceleration, jerk)


def test_positions_keep_their_limits() -> None:
    """x from -2 to 2, y from -3 to 3; a millionth is rounding; the worst joint is named; turn has none."""
    assert said(course((2, -3), (2, -3)), course((2 + 0.9e-6, -3 - 0.9e-6))) == []
    for q, joint, beyond in (
        ((2.25,), "x", 0.25),
        ((-2.5,), "x", 0.5),
        ((0, 3.75), "y", 0.75),
        ((2.25, -4), "y", 1.0),
        ((2 + 1.1e-6,), "x", 1.1e-6),
    ):
        run = [course((0,)), course(q, stage="lift")]
        (fault,) = [f for f in said(*run) if "beyond" in f.detail]
        assert fault == Fault("lift", (), f"motion 1: {joint} goes {beyond:.3g} m beyond its limits", fault.amount)
        assert fault.amount == pytest.approx(beyond)
    assert said(course((0, 0, 99.0))) == []


def test_a_spline_keeps_position_limits_between_its_rows() -> None:
    """From 1.9 to 1.9 within a second, off at 1 m/s: its coefficients reach 2.3, it itself does not."""
    qd = np.zeros((2, 5))
    qd[0, 0] = 1.0
    s = np.linspace(0, 1, 100001)
    highest = 1.9 + (s * (1 - s) ** 4 + 4 * s**2 * (1 - s) ** 3).max()  # the coefficients are 1.9 + (0, 0.2, 0.4, 0, 0, 0)
    assert 2.0 < highest < 2.3
    faults = said(splined((1.9,), (1.9,), qd=qd))
    (fault,) = [f for f in faults if "beyond" in f.detail]
    assert fault.amount == pytest.approx(highest - 2.0, abs=1e-6)
    assert fault.detail == f"motion 0: x goes {highest - 2:.3g} m beyond its limits"
    assert not [f for f in said(splined((1.7,), (1.7,), qd=qd)) if "beyond" in f.detail]  # 2.1 by the coefficients, 1.93 itself
    (low,) = [f for f in said(splined((-1.9,), (-1.9,), qd=-qd)) if "beyond" in f.detail]
    assert low.amount == pytest.approx(highest - 2.0, abs=1e-6)


def test_what_is_just_beyond_is_well(monkeypatch: pytest.MonkeyPatch) -> None:
    (fault,) = said(course((2.25,), (2.25,)))
    monkeypatch.setattr(limits, "POSITION", fault.amount)
    assert said(course((2.25,), (2.25,))) == []
    assert said(course((0,), (0.25,), t_s=(0, 0))) == []  # so short a way takes no time


def test_the_piece_of_a_spline_that_goes_furthest_counts() -> None:
    """Which is the second of three, above or below."""
    for x in (2.5, -2.5):
        faults = said(splined((0,), (0,), (x,), (0,), (0,), t_s=(0, 9, 29, 49, 60)))
        assert [f.detail for f in faults] == ["motion 0: x goes 0.5 m beyond its limits"]


def test_a_motion_starts_where_the_one_before_ended() -> None:
    for gap, well in ((0.0, True), (0.9e-6, True), (-0.9e-6, True), (1.1e-6, False), (-0.5, False)):
        for end in (course, splined):
            found = said(end((0,), (0, 1), t_s=(0, 9)), course((0, 1 + gap), stage="lift"))
            assert found == (
                [] if well else [Fault("lift", (), f"motion 1: starts {abs(gap):.3g} m from where y ended before", pytest.approx(abs(gap)))]
            )
    two = said(course((0.1, 0.2)), course((0.2, 0.4)))
    assert [f.detail for f in two] == ["motion 1: starts 0.2 m from where y ended before"]
    assert said(course((0,)), course((1e-6,))) == []


def test_a_polyline_is_as_fast_as_its_way_by_its_time() -> None:
    """x may go 1 m/s, y 2; the joint that is most over its limit is named; a ten-thousandth is rounding; who stays needs no time."""
    for t, well in ((1.0, True), (0.99991, True), (0.9998, False), (0.5, False)):
        found = said(course((0,), (1, 1), (1, 1), t_s=(0, t, t)))
        wrong = Fault("transit", (), f"motion 0: x reaches {1 / t:.3g} m/s, and the limit of its velocity is 1 m/s", 1 / t)
        assert found == ([] if well else [wrong])
    assert [f.detail for f in said(course((0,), (-1, 3)))] == ["motion 0: y reaches 3 m/s, and the limit of its velocity is 2 m/s"]
    assert [f.detail for f in said(course((0,), (0.1,), (0.1, 0.1), t_s=(0, 1, 1)))] == [
        "motion 0: y reaches inf m/s, and the limit of its velocity is 2 m/s"
    ]
    assert [f.amount for f in said(course((0,), (-1.5,)))] == [1.5]
    assert said(course((0,), (1.0001,))) == []  # just so much above
    slow = replace(ARM, velocity=np.full(5, 0.5))
    assert said(course((0,), (0.4,)), arm=slow) == []
    assert said(course((0,), (0.9e-6,), t_s=(0, 0))) == []
    assert said(course((0,))) == []


def quintic(x: float, t: float, joint: int = 0) -> Course:
    """One joint from rest to rest over x in time t: its greatest velocity is 15/8 x/t, its greatest acceleration 10/√3 x/t²."""
    q = [0.0] * 5
    q[joint] = x
    return splined((0,), q, t_s=(0, t))


def test_a_spline_is_as_fast_as_its_derivative_gets() -> None:
    for x, t, well in ((1.0, 1.8752, True), (1.0, 1.8747, False), (-1.0, 1.8752, True), (-1.0, 1.8747, False), (-0.5, 0.5, False)):
        found = said(quintic(x, t), acceleration=np.full(5, 1e9))
        fast = 15 / 8 * abs(x) / t
        assert [f.detail for f in found] == (
            [] if well else [f"motion 0: x reaches {fast:.3g} m/s, and the limit of its velocity is 1 m/s"]
        )
        assert [f.amount for f in found] == ([] if well else [pytest.approx(fast, rel=1e-5)])


def test_a_joint_that_turns_counts_radians() -> None:
    """turn may go 4 rad/s, and accelerate by 8 rad/s²; it goes 15/8 and 10/√3 times as much."""
    velocity, acceleration = said(quintic(3.2, 1.0, 2))
    assert velocity.detail == "motion 0: turn reaches 6 rad/s, and the limit of its velocity is 4 rad/s"
    assert acceleration.detail == "motion 0: turn reaches 18.5 rad/s², and the limit of its acceleration is 8 rad/s²"
    (gap,) = said(course((0,)), course((0, 0, 0.5)))
    assert gap.detail == "motion 1: starts 0.5 rad from where turn ended before"


def test_a_spline_accelerates_as_its_second_derivative_says() -> None:
    limit = 10 / np.sqrt(3) * 0.1
    for t, well in ((1.0001, True), (0.9999, False), (0.5, False)):
        found = said(quintic(-0.1, t, 1), acceleration=np.full(5, limit))
        most = limit / t**2
        wrong = f"motion 0: y reaches {most:.3g} m/s², and the limit of its acceleration is {limit:.3g} m/s²"
        assert [f.detail for f in found] == ([] if well else [wrong])
        assert [f.amount for f in found] == ([] if well else [pytest.approx(most, rel=1e-5)])


def test_a_spline_jerks_as_its_third_derivative_says() -> None:
    """60 x/t³ where it begins and ends, which is the most; a ten-thousandth is rounding, and what a millionth of a way comes to in it."""
    free = np.full(5, 1e9)
    for t, well in ((1.01, True), (0.99, False), (0.5, False)):
        found = said(quintic(-0.1, t, 1), acceleration=free, jerk=np.full(5, 6.0))
        most = 6.0 / t**3
        assert [f.detail for f in found] == ([] if well else [f"motion 0: y reaches {most:.3g} m/s³, and the limit of its jerk is 6 m/s³"])
        assert [f.amount for f in found] == ([] if well else [pytest.approx(most, rel=1e-4)])
    for more, well in ((1e-5, True), (1.2e-5, False)):
        assert (said(quintic(0.1 + more, 1.0), acceleration=free, jerk=np.full(5, 6.0)) == []) == well, more
    turned = said(quintic(0.5, 1.0, 2), acceleration=free, jerk=np.array([np.inf, np.inf, 20.0, np.inf, np.inf]))
    assert [f.detail for f in turned] == ["motion 0: turn reaches 30 rad/s³, and the limit of its jerk is 20 rad/s³"]


def test_a_spike_of_an_assumed_jerk_is_worth_a_note() -> None:
    """The one that is furthest above what is assumed, of all motions; what is known is a fault, and none of these."""
    free, assumed = np.full(5, 1e9), np.array([60.0, 6.0, np.inf, np.inf, np.inf])
    run = [quintic(0.1, 1.01), quintic(-0.1, 0.9, 1), quintic(-0.1, 0.8, 1), course((0,)), quintic(9.0, 0.1, 2)]
    numbered = [replace(c, number=n) for n, c in enumerate(run)]
    (note,) = limits.jerk_notes(ARM, numbered, assumed)
    words = "motion 2: y reaches 11.7 m/s³; nobody says the limit of its jerk, and 6 m/s³ are assumed"
    assert note == Fault("transit", (), words, pytest.approx(6 / 0.8**3, rel=1e-4))
    assert limits.jerk_notes(ARM, numbered[:1], assumed) == limits.jerk_notes(ARM, numbered[3:], assumed) == []
    assert [len(limits.jerk_notes(ARM, [quintic(-0.1, t, 1)], assumed)) for t in (1.00002, 0.9999)] == [0, 1]
    assert limits.jerk_notes(ARM, [course((0,), (1,))], assumed) == limits.jerk_notes(ARM, [], assumed) == []
    assert said(*numbered[1:2], acceleration=free) == []


def test_the_rounding_of_positions_is_no_jerk_however_short_a_piece_is() -> None:
    """In 0.1 s a micrometre more comes to 60 · 1e-6 / 0.1³ = 0.06 m/s³; the worse of two pieces counts, the slowest is not made quick."""
    free = np.full(5, 1e9)
    for more, well in ((0.99e-6, True), (1.2e-6, False)):
        assert (said(quintic(1e-4 + more, 0.1), acceleration=free, jerk=np.full(5, 6.0)) == []) == well, more
    two = splined((0,), (0.1,), (0.2,), t_s=(0, 1, 5))
    assert [f.detail[:20] for f in said(two, acceleration=free, jerk=np.full(5, 1.0))] == ["motion 0: x reaches "]
    assert said(quintic(0.01, 1.0), acceleration=free, jerk=np.full(5, 0.7)) == []


def test_the_worst_piece_of_a_spline_counts() -> None:
    """The second of three is twice as fast as the first, the last is slow."""
    way = splined((0,), (1,), (0,), (0.1,), t_s=(0, 2, 3, 9))
    velocity, acceleration = said(way)
    assert velocity.detail == "motion 0: x reaches 1.88 m/s, and the limit of its velocity is 1 m/s"
    assert acceleration.detail == "motion 0: x reaches 5.77 m/s², and the limit of its acceleration is 2 m/s²"
    assert said(splined((0,), (1,), (0.9,), t_s=(0, 4, 9)), acceleration=np.full(5, 0.4)) == []


@pytest.mark.parametrize("row", [0, -1])
def test_a_spline_rests_at_its_ends(row: int) -> None:
    """A ten-thousandth of the largest limit is rest: the toy's are 4 in velocity, 8 in acceleration."""
    for rate, order, what, most, unit in ((1, "qd", "velocity", 4e-4, "m/s"), (2, "qdd", "acceleration", 8e-4, "m/s²")):
        for share, well in ((0.95, True), (-0.95, True), (1.05, False), (-1.05, False), (100.0, False)):
            given = np.zeros((3, 5))
            given[row, 1] = share * most
            found = said(splined((0,), (0,), (0,), t_s=(0, 1.5, 4), **{order: given}))  # type: ignore[arg-type]
            wrong = f"motion 0: y does not rest where it begins or ends: its {what} is {abs(share) * most:.3g} {unit} there"
            assert [f.detail for f in found] == ([] if well else [wrong]), (rate, share)
            assert [f.amount for f in found] == ([] if well else [pytest.approx(abs(share) * most, rel=1e-6)])


def test_what_is_just_rest() -> None:
    """In numbers that are exact: 4e-4 in velocity, over 5 s."""
    for rate, well in ((4e-4, True), (4.0001e-4, False)):
        qd = np.zeros((2, 5))
        qd[0, 1] = rate
        assert (said(splined((0,), (0,), t_s=(0, 5), qd=qd)) == []) == well
    weak = np.full(5, 0.5)  # without a limit above 1, a ten-thousandth itself
    for rate, well in ((0.9e-4, True), (1.1e-4, False)):
        qdd = np.zeros((2, 5))
        qdd[0, 1] = rate
        assert (said(splined((0,), (0,), t_s=(0, 1), qdd=qdd), acceleration=weak) == []) == well


def test_who_rests_away_from_zero_rests() -> None:
    """Though a closer look at it is taken, for it is too fast between its ends."""
    assert [f.detail[:20] for f in said(splined((0.5,), (1.5,), t_s=(0, 1.5)), acceleration=np.full(5, 99.0))] == ["motion 0: x reaches "]


def doubtful(*run: Course, arm: Arm = ARM, acceleration: float = 99.0, jerk: float = 99.0) -> list[bool]:
    return [bool(d) for d in limits._doubtful(arm, run, np.full(5, acceleration), np.full(5, jerk))]


def test_whose_coefficients_keep_all_limits_needs_no_closer_look() -> None:
    """From 0 to 1 within 5 s they are 1 m/s and 0.8 m/s² at most; just at a limit is within it."""
    assert doubtful(quintic(1.0, 5.0), course((1,)), quintic(-1.0, 5.0)) == [False, True, True]  # the last begins elsewhere
    assert doubtful(quintic(1.0, 5.0), splined((1,), (1.1,), t_s=(0, 9))) == [False, False]
    assert doubtful(quintic(1.0, 4.99)) == doubtful(quintic(-1.0, 4.99)) == [True]
    for joint, way, rest in ((0, 1.0, 2.0), (0, -1.0, -2.0), (1, 1.0, 3.0), (1, -1.0, -3.0)):
        near, beyond, there = ([0.0] * 5 for _ in range(3))
        near[joint], beyond[joint], there[joint] = rest - way, rest + 1e-9 * way, rest
        assert doubtful(splined(near, there, t_s=(0, 9))) == [False]
        assert doubtful(splined(near, beyond, t_s=(0, 9))) == [True]
    assert doubtful(quintic(1.0, 5.0), acceleration=0.8) == [False]
    assert doubtful(quintic(1.0, 5.0), acceleration=0.79) == doubtful(quintic(-1.0, 5.0), acceleration=0.79) == [True]
    assert doubtful(quintic(1.0, 5.0), jerk=120.001 / 5**3) == [False]  # they are 60, -120 and 60 x/t³
    assert doubtful(quintic(1.0, 5.0), jerk=119.9 / 5**3) == doubtful(quintic(-1.0, 5.0), jerk=119.9 / 5**3) == [True]
    jerks = coefficients(spline, 3) if (spline := quintic(1.0, 5.0).spline) is not None else np.zeros(1)
    assert doubtful(quintic(1.0, 5.0), jerk=float(np.abs(jerks).max())) == [False]
    brakes = splined((0,), (0.5,), (0.9,), t_s=(0, 9, 11), qd=np.array([[0.0] * 5, [0.3, 0, 0, 0, 0], [0.0] * 5]))
    assert brakes.spline is not None
    rates = coefficients(brakes.spline, 2)
    assert 2 * rates.max() < -rates.min() < 1
    assert doubtful(brakes, acceleration=-float(rates.min())) == [False]
    assert doubtful(brakes, acceleration=float(rates.max()) * 1.01) == [True]


@pytest.mark.parametrize("number", [0, 1, 2])
def test_who_does_not_rest_or_begins_elsewhere_needs_one(number: int) -> None:
    """Among others that do; a ten-thousandth, and a millionth, are none."""
    rows = (0,), (0.1,), (0,)
    plain = splined(*rows, t_s=(0, 5, 10))
    for order in ("qd", "qdd"):
        for row in (0, 2):
            for rate, odd in ((1e-4, False), (1.01e-4, True), (-1.01e-4, True)):
                given = np.zeros((3, 5))
                given[row, 1] = rate
                run = [plain] * 3
                run[number] = splined(*rows, t_s=(0, 5, 10), **{order: given})  # type: ignore[arg-type]
                assert doubtful(*run) == [odd and n == number for n in range(3)]
    for gap, odd in ((1e-6, False), (1.01e-6, True), (-1.01e-6, True)):
        run = [plain] * 3
        run[number] = splined((0, gap), (0.1,), (0,), t_s=(0, 5, 10))
        assert doubtful(*run) == [odd and 0 < n == number for n in range(3)]


def test_between_its_ends_a_spline_need_not_rest() -> None:
    qd, qdd = np.zeros((3, 5)), np.zeros((3, 5))
    qd[1, 0], qdd[1, 0] = 0.3, 0.2
    assert said(splined((0,), (0.4,), (0.8,), t_s=(0, 2, 4), qd=qd, qdd=qdd)) == []
