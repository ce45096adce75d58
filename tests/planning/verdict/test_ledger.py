"""Who is where while an arm moves whose poses are known by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_arm import HAND, course, hand_at, splined

from kinematics.scene import Body, Cabinet, Grasp, Held, RobotRef, Scene
from kinematics.shapes import Cylinder
from kinematics.transforms import Array, rotation_about, transform
from planning.plan import Fault
from planning.verdict import ledger
from planning.verdict.course import Course
from planning.verdict.faults import Settings
from planning.verdict.ledger import Ledger, difference, hand_poses, keep

BASE = transform(rotation_about((0, 0, 1), 0.3), [0.1, -0.2, 0.4])
GRIP = transform(rotation_about((0, 1, 0), 0.5), [0.0, 0.0, 0.02])
FROM, TO, AWAY = (0.5, 0.1, 0.2, 0.1), (0.7, -0.2, 0.9, 0.0), (0.0, 0.0, 0.0, 0.0)
SETTINGS = Settings()


def scene() -> Scene:
    """Object a is where the toy holds it at FROM, b where it holds it at AWAY."""
    poses = {"a": hand_at(FROM, BASE) @ GRIP, "b": hand_at(AWAY, BASE) @ GRIP}
    bodies = tuple(Body(name, Cylinder(0.03, 0.1), T) for name, T in poses.items())
    return Scene("s", RobotRef(BASE, "toy"), Cabinet(np.ones(3), np.eye(4), 0.03), bodies, "b", Grasp(np.eye(4), 0.05))


def kept(*run: Course) -> Ledger:
    return keep(HAND, scene(), [replace(c, number=n) for n, c in enumerate(run)], SETTINGS)


def held(body: str = "a", T: Array = GRIP) -> Held:
    return Held(body, T)


def test_nothing_moves_when_nothing_is_held() -> None:
    assert keep(HAND, scene(), [], SETTINGS).poses.keys() == {"a", "b"}
    found = kept(course(AWAY, FROM), course(FROM, TO))
    assert (found.carries, found.faults) == ((), ())
    assert [sorted(s) for s in found.standing] == [["a", "b"], ["a", "b"]]
    assert all(np.array_equal(found.poses[name], T) for name, T in scene().poses().items())


def test_an_object_is_taken_carried_and_put_down() -> None:
    found = kept(course(AWAY, FROM), course(FROM, AWAY, held=held()), course(AWAY, TO, held=held()), course(TO, AWAY))
    assert found.faults == ()
    (carry,) = found.carries
    assert (carry.body, carry.first, carry.last, carry.put) == ("a", 1, 2, True)
    assert np.array_equal(carry.T_world_from, scene().poses()["a"])
    assert np.allclose(carry.T_world_to, hand_at(TO, BASE) @ GRIP)
    assert np.array_equal(carry.T_hand_body, GRIP)
    assert np.allclose(carry.T_world_hand, hand_at(FROM, BASE))
    assert carry.q.tolist() == [*FROM, 0.0]
    assert [sorted(s) for s in found.standing] == [["a", "b"], ["b"], ["b"], ["a", "b"]]
    assert np.array_equal(found.standing[0]["a"], scene().poses()["a"])
    assert np.allclose(found.standing[3]["a"], hand_at(TO, BASE) @ GRIP)
    assert np.allclose(found.poses["a"], hand_at(TO, BASE) @ GRIP)


def test_what_the_hand_keeps_is_not_put() -> None:
    found = kept(course(FROM, AWAY, held=held()), course(AWAY, TO, held=held()))
    (carry,) = found.carries
    assert (carry.first, carry.last, carry.put) == (0, 1, False)
    assert np.allclose(found.poses["a"], hand_at(TO, BASE) @ GRIP)


def test_one_object_after_another() -> None:
    """Without a motion between: the first is put down where the second is taken."""
    found = kept(course(FROM, AWAY, held=held()), course(AWAY, TO, held=held("b")))
    assert found.faults == ()
    assert [(c.body, c.first, c.last, c.put) for c in found.carries] == [("a", 0, 0, True), ("b", 1, 1, False)]
    assert [sorted(s) for s in found.standing] == [["b"], ["a"]]
    assert np.allclose(found.standing[1]["a"], hand_at(AWAY, BASE) @ GRIP)


def test_it_ends_at_a_body_that_does_not_exist() -> None:
    found = kept(course(FROM, AWAY, held=held()), course(AWAY, TO, held=held("ghost"), stage="lift"), course(TO, AWAY))
    assert found.faults == (Fault("lift", ("ghost",), "motion 1 holds 'ghost', which is not in the scene"),)
    assert len(found.standing) == 1
    assert [(c.body, c.last, c.put) for c in found.carries] == [("a", 0, False)]


def test_an_object_is_where_the_hand_takes_it() -> None:
    """To a millimetre and a milliradian; the first motion that holds it says so, and it keeps that pose in the hand."""
    for share, well in ((0.99, True), (1.01, False)):
        for by, off in (
            (transform(p=[0, share * 1e-3, 0]), "1.0 mm and 0.0°"),
            (transform(rotation_about((1, 0, 0), share * 1e-3)), "0.0 mm and 0.1°"),
        ):
            found = kept(course(FROM, AWAY, held=held(T=GRIP @ by), stage="lift"))
            wrong = [("lift", ("hand", "a"), f"motion 0: a is not where the hand takes it: {off} off")]
            assert [(f.stage, f.bodies, f.detail) for f in found.faults] == ([] if well else wrong)
            found = kept(course(FROM, AWAY, held=held()), course(AWAY, TO, held=held(T=GRIP @ by)))
            wrong = [("transit", ("hand", "a"), f"motion 1: a does not keep its pose in the hand: {off} off")]
            assert [(f.stage, f.bodies, f.detail) for f in found.faults] == ([] if well else wrong)
    (fault,) = kept(course(FROM, AWAY, held=held(T=GRIP @ transform(p=[0.02, 0, 0])))).faults
    assert fault.amount == pytest.approx(0.02)
    (fault,) = kept(course(AWAY, FROM, held=held())).faults  # taken where the motion begins, not where it ends
    assert fault.detail.startswith("motion 0: a is not where")


def test_fingers_stay_as_they_closed() -> None:
    """A tenth of a millimetre of width is play; on the way counts, too, and over motions. 5 mm of joint are 10 mm of width."""
    for by, well in ((0.0, True), (0.049e-3, True), (-0.049e-3, True), (0.051e-3, False), (-0.051e-3, False), (5e-3, False)):
        closed = 0.02
        rows = ((*FROM, closed), (*FROM, closed + by), (*FROM, closed))
        found = kept(course(*rows, held=held(), stage="lift"))
        assert [f.detail for f in found.faults] == (
            [] if well else [f"motion 0: the fingers move by {2000 * abs(by):.1f} mm while they hold a"]
        )
        for fault in found.faults:
            assert (fault.stage, fault.bodies, fault.amount) == ("lift", ("a",), pytest.approx(2 * abs(by)))
        found = kept(course(rows[0], rows[0], held=held()), course(rows[1], rows[1], held=held()))
        assert len(found.faults) == (not well)
    swings = splined((*FROM, 0.02), (*FROM, 0.02), qd=np.array([[0, 0, 0, 0, 0.05], [0, 0, 0, 0, 0]]))
    assert len(kept(replace(swings, held=held())).faults) == 1


def test_what_is_just_allowed_is_well(monkeypatch: pytest.MonkeyPatch) -> None:
    by = transform(rotation_about((1, 0, 0), 0.2), [0.0, 0.3, 0.0])
    run = course(FROM, AWAY, held=held(T=GRIP @ by))
    T = hand_poses(HAND, run.q[[0, -1]], BASE)[0] @ (GRIP @ by)
    far, turned = difference(scene().poses()["a"], T)
    for pose_m, pose_rad, well in ((far, turned, True), (np.nextafter(far, 0), turned, False), (far, np.nextafter(turned, 0), False)):
        found = keep(HAND, scene(), [run], Settings(pose_m=float(pose_m), pose_rad=float(pose_rad)))
        wrong = "motion 0: a is not where the hand takes it: 300.0 mm and 11.5° off"
        assert [f.detail for f in found.faults] == ([] if well else [wrong])
    wide = course((*FROM, 0.0), (*FROM, 0.05), held=held())
    (fault,) = kept(wide).faults
    assert fault.detail == "motion 0: the fingers move by 100.0 mm while they hold a"
    monkeypatch.setattr(ledger, "FINGERS_M", fault.amount)
    assert kept(wide).faults == ()


def test_where_the_hand_is() -> None:
    q = np.array([[*FROM, 0.01], [*TO, 0.03]])
    beyond = replace(HAND, T_carrier_hand=transform(p=[0.0, 0.1, 0.2]))
    assert np.allclose(hand_poses(beyond, q, BASE), [hand_at(row, BASE) @ beyond.T_carrier_hand for row in q])


def test_how_far_two_poses_are_apart() -> None:
    A = transform(rotation_about((1, 2, 3), 0.7), [1, 2, 3])
    assert difference(A, A) == (0.0, 0.0)
    far, turned = difference(A, A @ transform(rotation_about((0, 1, 0), 0.2), [0.3, 0, 0.4]))
    assert (far, turned) == pytest.approx((0.5, 0.2))
    for way in np.eye(3):
        for far in (1.0, -1.0, 1.5e-12, 1e-12):
            assert difference(np.eye(4), transform(p=far * way)) == (abs(far), 0.0)
    assert difference(A, A @ transform(p=[1e-9, 0, 0])) == pytest.approx((1e-9, 0.0), abs=1e-10)
