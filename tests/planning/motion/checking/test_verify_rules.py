"""The last word's own rules, with engines that only note what they are asked: limits, gaps, what is held and from where, and what is said.

The robot slides along x and y and turns about z; the engines' word on contacts is tested in test_verify.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fakes import BASE, scene_of

from kinematics.collision.fcl_solids import Contact
from kinematics.collision.stretches import Stretch
from kinematics.scene import Held, Scene
from kinematics.transforms import Array, angle_between, inverse, rotations_about, transform
from planning.motion.checking import verify as module
from planning.motion.checking.replay import replay
from planning.motion.checking.verify import SAME_M, SAME_RAD, hand_poses, verify
from planning.plan import Blocked, Motion

LOWER, UPPER = np.array([-1.0, -2.0, -np.inf]), np.array([1.0, 2.0, np.inf])
UNTOUCHED: tuple[tuple[str, str], ...] = ()


def slider() -> Any:
    """Three joints: along x, along y, about z; the hand at their end."""

    def poses(q: Array) -> Array:
        at = np.stack([q[..., 0], q[..., 1], np.zeros(q.shape[:-1])], -1)
        T = transform(rotations_about((0.0, 0.0, 1.0), q[..., 2]), at)
        return np.stack([np.broadcast_to(np.eye(4), T.shape), T], -3)

    def link(name: str, q: Array) -> Array:
        return poses(q)[..., tree.index[name], :, :]

    tree = SimpleNamespace(poses=poses, link=link, names=("base", "hand"), index={"base": 0, "hand": 1})
    return SimpleNamespace(name="slider", lower=LOWER, upper=UPPER, tree=tree)


class Engines:
    """Both engines and the sampler: each question is noted, and answered as was written down for its number."""

    def __init__(self, answers: dict[int, tuple[int, list[Contact]]] | None = None) -> None:
        self.answers, self.asked, self.made = answers or {}, list[SimpleNamespace](), list[tuple[str, Any, Any]]()
        self.start: Array | None = None

    def install(self, patch: pytest.MonkeyPatch) -> Engines:
        patch.setattr(module, "Verdict", lambda robot, scene: self._make("verdict", robot, scene))
        patch.setattr(module, "broad_phase", lambda packed: [("judged", stretch) for stretch in packed.stretches])
        patch.setattr(module, "start_q", lambda robot, ref: self.start)
        patch.setattr(module, "replayed", self._replayed)
        return self

    def _make(self, what: str, robot: Any, scene: Scene) -> Engines:
        self.made.append((what, robot, scene))
        return self

    def _replayed(self, robot: Any, scene: Scene, motions: Sequence[Motion]) -> Any:
        rows = [("rows of", motion.stage) for motion in motions]
        both = zip(rows, replay(robot, scene, motions))
        stretches = [Stretch(some, poses, m.held, m.allowed_contacts) for some, (m, poses) in both]  # type: ignore[arg-type]
        return SimpleNamespace(number=tuple(range(len(rows))), rows=rows, packed=SimpleNamespace(stretches=stretches))

    def along(self, stretches: Sequence[Stretch], judged: Sequence[Any]) -> Any:
        assert judged == [("judged", stretch) for stretch in stretches]
        for number, s in enumerate(stretches):
            self.asked.append(SimpleNamespace(rows=s.q, poses=dict(s.poses), held=s.held, allowed=s.allowed_contacts))
            if (found := self.answers.get(len(self.asked) - 1)) is not None:
                return (number, *found)
        return None


@pytest.fixture
def engines(monkeypatch: pytest.MonkeyPatch) -> Engines:
    return Engines().install(monkeypatch)


SCENE = scene_of("a", "b")


def move(*q: Sequence[float], stage: str = "transit", held: Held | None = None, allowed: tuple[tuple[str, str], ...] = UNTOUCHED) -> Motion:
    return Motion(stage, ("x", "y", "turn"), np.array(q, float), np.arange(len(q), dtype=float), held, allowed)


def says(*motions: Motion, scene: Scene = SCENE) -> Blocked | None:
    return verify(slider(), scene, motions)


def holding(name: str, q: Sequence[float], scene: Scene = SCENE, by: Array | None = None) -> Held:
    """What holds an object that stands where it does at first, the hand being at q; moved in the hand by a transform."""
    T_world_hand = hand_poses(slider(), scene, np.array(q, float))
    return Held(name, inverse(T_world_hand) @ scene.poses()[name] @ (np.eye(4) if by is None else by))


# ------------------------------------------------------------------------------------------------------------------------- limits and gaps


def test_the_tolerances() -> None:
    assert (SAME_M, SAME_RAD) == (0.001, 0.001)


def test_names_that_two_things_share_are_refused_at_once(engines: Engines) -> None:
    """Nobody could tell what may touch what."""
    with pytest.raises(ValueError, match="hand"):
        says(move([9.0, 0, 0]), scene=scene_of("a", "hand"))


def test_nothing_to_check_is_well(engines: Engines) -> None:
    assert says() is None
    assert engines.asked == []


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_joint_limits(engines: Engines, joint: int, side: float) -> None:
    """Rounding may leave them by 1e-9; any waypoint counts, in any motion; a joint without limits has none."""
    limit = (UPPER if side > 0 else LOWER)[joint]
    for beyond, well in ((0.0, True), (0.9e-9, True), (1.1e-9, False), (1.0, False)):
        q = np.zeros(3)
        q[joint] = limit + side * beyond
        said = says(move([0, 0, 0], [0, 0, 50.0]), move([0, 0, 50.0], q, [0, 0, 0], stage="lower"))
        assert said == (None if well else Blocked("verify", detail="motion 1, lower: a joint leaves its limits"))
    exactly = np.zeros(3)
    exactly[joint] = limit + side * 1e-9
    assert says(move(exactly)) is None


def test_outside_is_outside() -> None:
    assert module._within_limits(slider(), move([0, 0, 0])) is True
    assert module._within_limits(slider(), move([9, 0, 0])) is False


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_none_are_outside_the_limits(engines: Engines, value: float) -> None:
    for joint in range(3):
        q = np.zeros(3)
        q[joint] = value
        assert says(move([0, 0, 0], q)) == Blocked("verify", detail="motion 0, transit: a joint leaves its limits")
    assert engines.asked == []


def test_a_spline_keeps_the_limits_between_its_waypoints(engines: Engines, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its extremes count, to 1e-10, not its waypoints alone; coefficients within the limits say as much, and nobody asks for extremes."""
    asked: list[tuple[int, float]] = []
    monkeypatch.setattr(module, "extremes", lambda spline, order, exactly: asked.append((order, exactly)) or spline.reached)
    for low, high, well in (
        (LOWER - 1e-9, UPPER + 1e-9, True),
        ([-1, -2, -9], [1, 2, 9], True),
        ([-1.1, 0, 0], [0, 0, 0], False),
        ([0, 0, 0], [0, 2.1, 0], False),
    ):
        reached = np.array([low]), np.array([high])
        spline: Any = SimpleNamespace(control=np.full((1, 6, 3), 99.0), reached=reached)
        said = says(SimpleNamespace(stage="transit", q=np.zeros((1, 3)), spline=spline, held=None, allowed_contacts=()))  # type: ignore[arg-type]
        assert said == (None if well else Blocked("verify", detail="motion 0, transit: a joint leaves its limits"))
    assert asked == 4 * [(0, 1e-10)]
    for joint, (value, well) in (*product(range(3), ((0.99, True), (np.nan, False))), *product(range(2), ((-9.0, False), (9.0, False)))):
        control = np.zeros((1, 6, 3))
        control[0, 2, joint] = value
        spline = SimpleNamespace(control=control, reached=(control[0], control[0]))
        said = says(SimpleNamespace(stage="transit", q=np.zeros((1, 3)), spline=spline, held=None, allowed_contacts=()))  # type: ignore[arg-type]
        assert (said is None) == well
    assert len(asked) == 11


def test_motions_follow_one_another_without_a_gap(engines: Engines) -> None:
    first = move([0, 0, 0], [0.5, 0.5, 0.5])
    for gap, well in ((0.0, True), (0.9e-9, True), (1.1e-9, False), (0.5, False)):
        for joint in range(3):
            q = np.array([0.5, 0.5, 0.5])
            for sign in (1, -1):
                q[joint] = 0.5 + sign * gap
                said = says(first, move(q, [0, 0, 0], stage="lift"))
                detail = "motion 1, lift: it does not start where the one before ends"
                assert said == (None if well else Blocked("verify", detail=detail))
    assert says(first, move([0.5, 0.5, 0.5], [0, 0, 0]), move([0.0, 0.0, 0.1])) is not None
    assert says(move([0.3, 0, 0], [0, 0, 0])) is None  # the first may start anywhere
    assert says(move([0, 0, 0], [0, 0, 0]), move([0, 0, 1e-9], [0, 0, 0])) is None  # just as much is none


def test_the_way_begins_where_the_scene_says_that_the_arm_is(engines: Engines) -> None:
    """To a millionth, in every joint; a scene that says nothing lets it begin anywhere."""
    assert says(move([0.5, 0, 0])) is None
    engines.start = np.array([0.5, 0.25, 0.0])
    assert says() is None
    for off, well in ((0.0, True), (0.9e-6, True), (1.1e-6, False), (0.5, False)):
        for joint in range(3):
            for sign in (1, -1):
                q = engines.start.copy()
                q[joint] += sign * off
                detail = "motion 0, lift: it does not begin where the scene says that the arm is"
                assert says(move(q, [0, 0, 0], stage="lift")) == (None if well else Blocked("verify", detail=detail))
    engines.start = np.zeros(3)
    assert says(move([0, 0, 1e-6])) is None  # just as much is well


def test_limits_are_looked_at_before_gaps_and_gaps_before_contacts(engines: Engines) -> None:
    """What comes later is not asked about."""
    assert "limits" in str(says(move([0, 0, 0]), move([5.0, 0, 0])))
    assert "does not start" in str(says(move([0, 0, 0]), move([0.5, 0, 0], held=Held("a", np.eye(4)))))
    assert [asked.rows for asked in engines.asked] == [("rows of", "transit")] * 2


# ------------------------------------------------------------------------------------------------------------------------- what is asked


def test_every_motion_is_asked_about_with_all_that_it_says(engines: Engines) -> None:
    robot, allowed = slider(), (("pad", "a"), ("a", "floor"))
    assert verify(robot, SCENE, [move([0, 0, 0]), move([0, 0, 0], stage="grasp", allowed=allowed)]) is None
    assert engines.made == [("verdict", robot, SCENE)]
    first, second = engines.asked
    assert (first.rows, first.held, first.allowed) == (("rows of", "transit"), None, ())
    assert (second.rows, second.held, second.allowed) == (("rows of", "grasp"), None, allowed)
    for asked in (first, second):
        assert list(asked.poses) == ["a", "b", "target"]
        assert all(np.array_equal(T, SCENE.poses()[n]) for n, T in asked.poses.items())


def test_the_deepest_contact_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine gives them deepest first; nothing is asked after the first motion with one."""
    engines = Engines({1: (3, [Contact("arm", "b", 0.004), Contact("hand", "a", 0.001)])}).install(monkeypatch)
    said = says(move([0, 0, 0]), move([0, 0, 0], stage="lower"), move([0, 0, 0]))
    assert said == Blocked("verify", "arm", "b", 0.004, "motion 1, lower")
    assert len(engines.asked) == 2


# ------------------------------------------------------------------------------------------------------------------------- what is held


def test_a_held_object_no_longer_stands_and_stands_where_it_is_put(engines: Engines) -> None:
    """It is taken in motion 1, carried in 2, and let go after it: from then on it stands where the hand was."""
    held = holding("a", [0.2, 0.1, 0.0])
    ends = [0.4, 0.3, 0.5]
    said = says(
        move([0, 0, 0], [0.2, 0.1, 0.0]),
        move([0.2, 0.1, 0.0], [0.3, 0.1, 0.0], stage="lift", held=held),
        move([0.3, 0.1, 0.0], ends, stage="transfer", held=held),
        move(ends, [0, 0, 0.5], stage="retreat"),
        move([0, 0, 0.5], [0, 0, 0.0]),
    )
    assert said is None
    assert [sorted(a.poses) for a in engines.asked] == [["a", "b", "target"], ["b", "target"], ["b", "target"], *[["a", "b", "target"]] * 2]
    assert [a.held for a in engines.asked] == [None, held, held, None, None]
    put = hand_poses(slider(), SCENE, np.array(ends)) @ held.T_hand_body
    assert all(np.allclose(a.poses["a"], put) for a in engines.asked[3:])
    assert not np.allclose(put, SCENE.poses()["a"])
    assert np.array_equal(engines.asked[4].poses["b"], SCENE.poses()["b"])


def test_an_object_that_was_put_down_is_taken_from_there(engines: Engines) -> None:
    held, ends = holding("a", [0.2, 0.1, 0.0]), [0.4, 0.3, 0.5]
    way = [move([0.2, 0.1, 0.0], ends, held=held), move(ends, [0, 0, 0]), move([0, 0, 0], ends)]
    assert says(*way, move(ends, [0, 0, 0], held=held)) is None
    refused = says(*way[:2], move([0, 0, 0], [0.2, 0.1, 0.0]), move([0.2, 0.1, 0.0], [0, 0, 0], stage="lift", held=held))
    assert refused == Blocked("verify", "hand", "a", detail="motion 3, lift: the object is not where the hand takes it")


def test_one_object_after_another_without_a_motion_between(engines: Engines) -> None:
    """The hand lets a go and takes b in one: a stands where it was let go."""
    first = holding("a", [0.2, 0.1, 0.0])
    there = [0.5, 0.5, 0.0]
    second = holding("b", there)
    assert says(move([0.2, 0.1, 0.0], there, held=first), move(there, [0, 0, 0], held=second)) is None
    assert [sorted(a.poses) for a in engines.asked] == [["b", "target"], ["a", "target"]]
    assert np.allclose(engines.asked[1].poses["a"], hand_poses(slider(), SCENE, np.array(there)) @ first.T_hand_body)


def leaning(degrees: float) -> Held:
    """Object a, leaning by so much from how it stood, about an axis that is neither x nor y."""
    return Held("a", transform(rotations_about((0.6, 0.8, 0.0), np.radians(degrees))))


def test_what_is_carried_may_lean_as_far_as_is_said(engines: Engines, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the plan's limit, or by the object's own; to a hundredth of a degree; at the worst of all samples."""
    turns = np.array([[0, 0, 0], [0, 0, 1.0]])
    for degrees, limit, well in ((30.0, 30.0, True), (30.005, 30.0, True), (30.015, 30.0, False), (170.0, 180.0, True)):
        said = module._leans_too_far(slider(), SCENE, leaning(degrees), turns, limit)
        assert said == (None if well else f"it leans by {degrees:.1f}°, and {limit:g}° is its limit")
    own = replace(SCENE, objects=(replace(SCENE.objects[0], max_tilt_deg=10.0), *SCENE.objects[1:]))
    assert module._leans_too_far(slider(), own, leaning(12.0), turns, 30.0) == "it leans by 12.0°, and 10° is its limit"
    lying = replace(SCENE, objects=(replace(SCENE.objects[0], T_world_body=leaning(90.0).T_hand_body), *SCENE.objects[1:]))
    assert module._leans_too_far(slider(), lying, leaning(90.0), turns, 5.0) is None  # as it lay
    assert module._leans_too_far(slider(), lying, leaning(80.0), turns, 5.0) == "it leans by 10.0°, and 5° is its limit"
    monkeypatch.setattr(module, "_leans_too_far", lambda robot, scene, held, rows, most: f"{held.body} {rows} {most:g}")
    q = [0.2, 0.1, 0.0]
    said = verify(slider(), SCENE, [move(q), move(q, stage="lift", held=holding("a", q))], max_tilt_deg=20.0)
    assert said == Blocked("verify", "hand", "a", detail="motion 1, lift: a ('rows of', 'lift') 20")


def test_the_first_motion_that_leans_is_told_and_what_comes_after_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though it touches something as well."""
    engines = Engines({1: (0, [Contact("arm", "b", 0.004)])}).install(monkeypatch)
    monkeypatch.setattr(module, "_leans_too_far", lambda robot, scene, held, rows, most: f"{held.body} leans")
    q = [0.2, 0.1, 0.0]
    motions = [move(q), move(q, stage="lift", held=holding("a", q)), move(q, stage="transfer", held=holding("a", q))]
    assert verify(slider(), SCENE, motions) == Blocked("verify", "hand", "a", detail="motion 1, lift: a leans")
    assert len(engines.asked) == 1


def test_a_way_that_is_known_is_not_made_again(engines: Engines, monkeypatch: pytest.MonkeyPatch) -> None:
    motions = [move([0.1, 0, 0]), move([0.1, 0, 0])]
    way = module.replayed(slider(), SCENE, motions)
    monkeypatch.setattr(module, "replayed", lambda *asked: pytest.fail("it is known"))
    assert verify(slider(), SCENE, motions, way=way) is None


def test_the_worst_lean_on_the_way_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hand tips about x, there and back."""
    monkeypatch.setattr(module, "hand_poses", lambda robot, scene, q: transform(rotations_about((1.0, 0.0, 0.0), np.radians(q[:, 0]))))
    tips = np.array([[0.0], [40.0], [10.0]])
    assert module._leans_too_far(slider(), SCENE, Held("a", np.eye(4)), tips, 30.0) == "it leans by 40.0°, and 30° is its limit"
    assert module._leans_too_far(slider(), SCENE, Held("a", np.eye(4)), tips, 40.0) is None
    for scale, said in ((1 + 1e-9, None), (-1 - 1e-9, "it leans by 180.0°, and 30° is its limit")):  # a cosine is rounded
        monkeypatch.setattr(module, "hand_poses", lambda robot, scene, q, scale=scale: np.array([scale * np.eye(4)]))
        assert module._leans_too_far(slider(), SCENE, Held("a", np.eye(4)), tips, 30.0) == said


def test_an_object_may_not_slip_in_the_hand(engines: Engines) -> None:
    """It is held from one motion to the next as it was, within the same tolerance."""
    q = [0.2, 0.1, 0.0]
    for slip, well in ((0.9, True), (1.1, False), (50.0, False)):
        slipped = holding("a", q, by=transform(p=[0.0, slip * SAME_M, 0.0]))
        said = says(move(q, [0.5, 0, 0], held=holding("a", q)), move([0.5, 0, 0], q, stage="transfer", held=slipped))
        assert said == (
            None if well else Blocked("verify", "hand", "a", detail="motion 1, transfer: the object is not where the hand takes it")
        )


def test_just_the_tolerance_is_well(engines: Engines, monkeypatch: pytest.MonkeyPatch) -> None:
    q, held = (
        [0.2, 0.1, 0.7],
        holding("a", [0.2, 0.1, 0.7], by=transform(rotations_about((0.0, 1.0, 0.0), np.array(2e-4)), [4e-4, 0.0, 0.0])),
    )
    jump = inverse(SCENE.poses()["a"]) @ hand_poses(slider(), SCENE, np.array(q)) @ held.T_hand_body
    far, turned = float(np.linalg.norm(jump[:3, 3])), float(angle_between(np.eye(3), jump[:3, :3]))
    for m, rad, well in ((far, turned, True), (np.nextafter(far, 0), 1.0, False), (1.0, np.nextafter(turned, 0), False)):
        monkeypatch.setattr(module, "SAME_M", m)
        monkeypatch.setattr(module, "SAME_RAD", rad)
        assert (says(move(q, held=held)) is None) == well


def test_the_target_may_stay_in_the_hand(engines: Engines) -> None:
    held = holding("target", [0.2, 0.1, 0.0])
    assert says(move([0.2, 0.1, 0.0], [0, 0, 0], held=held)) is None
    assert sorted(engines.asked[0].poses) == ["a", "b"]


@pytest.mark.parametrize("number", [0, 1])
def test_an_object_may_jump_by_a_millimetre_into_the_hand(engines: Engines, number: int) -> None:
    """In any direction, and turn by a milliradian; no more."""
    q = [0.2, 0.1, 0.7]
    before = [move([0, 0, 0], q)] * number
    for direction in np.concatenate([np.eye(3), -np.eye(3), [[0.6, 0.0, -0.8]]]):
        for share, well in ((0.99, True), (1.01, False), (100.0, False)):
            for by in (transform(p=share * SAME_M * direction), transform(rotations_about(direction, np.array(share * SAME_RAD)))):
                said = says(*before, move(q, [0, 0, 0.7], stage="lift", held=holding("a", q, by=by)))
                detail = f"motion {number}, lift: the object is not where the hand takes it"
                assert said == (None if well else Blocked("verify", "hand", "a", detail=detail))
    for by in (transform(p=[0.0, 0.0, 0.9 * SAME_M]) @ transform(rotations_about((1.0, 0.0, 0.0), np.array(0.9 * SAME_RAD))),):
        assert says(*before, move(q, [0, 0, 0.7], held=holding("a", q, by=by))) is None


def test_the_hand_takes_where_the_motion_starts(engines: Engines) -> None:
    """Not where it ends."""
    held = holding("a", [0.2, 0.1, 0.0])
    assert says(move([0.2, 0.1, 0.0], [0.5, 0.5, 1.0], held=held)) is None
    assert says(move([0.5, 0.5, 1.0], [0.2, 0.1, 0.0], held=held)) is not None


# ------------------------------------------------------------------------------------------------------------------------------- the hand


def test_where_the_hand_is() -> None:
    """One configuration or many; the base stands somewhere and is turned."""
    turned = transform(rotations_about((0.0, 0.0, 1.0), np.array(np.pi / 2)), BASE)
    scene = replace(SCENE, robot=replace(SCENE.robot, T_world_base=turned))
    T = hand_poses(slider(), scene, np.array([0.3, 0.1, 0.5]))
    assert T.shape == (4, 4)
    assert T[:3, 3] == pytest.approx(BASE + np.array([-0.1, 0.3, 0.0]))
    assert np.allclose(T[:3, :3], rotations_about((0.0, 0.0, 1.0), np.array(np.pi / 2 + 0.5)))
    many = hand_poses(slider(), scene, np.array([[[0.3, 0.1, 0.5]], [[0.0, 0.0, 0.0]]]))
    assert many.shape == (2, 1, 4, 4)
    assert np.array_equal(many[0, 0], T)
    assert np.allclose(many[1, 0], turned)
