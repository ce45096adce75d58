"""What the loop does while space is unseen: looks as fine as on the truth, and no move but for a plan that unseen space keeps it from."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from kinematics.errors import InputError
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene, State
from kinematics.shapes import Box
from kinematics.transforms import transform
from perception.camera import Intrinsics
from perception.rendering.synthetic_camera import DEFAULT
from planning.conclusion import failed
from planning.io.checked import Node
from planning.io.observation_documents import intrinsics_from, observation_from_node, observation_to_json
from planning.motion.pick_place import Motions
from planning.motion.settings import DEFAULTS
from planning.plan import Blocked, Plan, Unsolvable
from planning.policies import make_policy
from planning.policies.unsolvable import Finding
from planning.scenes.generation import generate, load_spec
from planning.sensing import missing_views
from planning.sensing.retrieve import _hidden, retrieve_unseen
from planning.sensing.world import SimulatedWorld


def drawn(ur5e: Robot, seed: int, index: int) -> Scene:
    return generate(load_spec("paper"), ur5e, to_ref(ur5e), seed, index)


def sensed(ur5e: Robot, scene: Scene) -> Plan:
    rng = np.random.default_rng([0, 4, scene.random_word])
    world = SimulatedWorld(ur5e, scene, rng, None, "mask")
    return retrieve_unseen(
        world, ur5e, scene, lambda motions, moves: make_policy("neural", motions, max_moves=moves), truth=world, name="neural", rng=rng
    )


@pytest.fixture(scope="module")
def behind(ur5e: Robot) -> tuple[Motions, str]:
    """Motions in a scene in which space before one object, which can be picked, is unseen."""
    scene = drawn(ur5e, 71, 0)
    motions = Motions(ur5e, scene)
    name = next(n for n in scene.poses() if n != scene.target and motions.picks(motions.start(), n)[0])
    at = scene.body(name).T_world_body[:3, 3]
    screen = Body("unknown_0", Box(np.array([0.02, 0.9, 0.6])), transform(p=[at[0] - 0.1, *at[1:]]))
    return Motions(ur5e, scene, obstacles=[screen]), name


def test_as_if_all_were_free_nothing_unseen_is_in_the_way(behind: tuple[Motions, str], ur5e: Robot) -> None:
    motions, name = behind
    state = motions.start()
    assert motions.partly_unseen
    assert not motions.if_free.partly_unseen
    assert motions.if_free.if_free is motions.if_free
    assert not motions.picks(state, name)[0]
    whole = Motions(ur5e, motions.scene)
    for other in state.poses:
        found, known = (m.picks(state, other)[0] for m in (motions.if_free, whole))
        assert [pick.approach.tolist() for pick in found] == [pick.approach.tolist() for pick in known]


def test_what_unseen_space_keeps_from_being_picked_is_looked_at(behind: tuple[Motions, str]) -> None:
    """Whatever the last of its grasps touched."""
    motions, name = behind
    state, why = motions.start(), Blocked("approach", "camera", "back")
    others = [n for n in state.poses if motions.picks(state, n)[0]]
    assert _hidden(motions, state, [(n, why) for n in (*others, name)], 2) == [name]
    whole = motions.if_free
    assert _hidden(whole, state, [(n, why) for n in state.poses], 2) == []


def test_whether_unseen_space_is_why_is_asked_with_the_grasps_and_settings_of_the_plan(
    behind: tuple[Motions, str], ur5e: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With x_g alone, or another tilt, there may be a proof where the plan had more to choose from."""
    among, name = behind
    obstacle = Body("unknown_0", Box(np.full(3, 0.02)), transform(p=[0.5, 0.0, 0.9]))
    given, settings = (among.scene.x_g, among.scene.x_g), replace(DEFAULTS, max_tilt_deg=170.0)
    motions = Motions(ur5e, among.scene, obstacles=[obstacle], target_grasps=given, settings=settings)
    proof, asked = Unsolvable((name,), ()), list[Motions]()

    def prover(free: Motions) -> Callable[[State], Finding]:
        asked.append(free)
        return lambda state: Finding(proof)

    monkeypatch.setattr(missing_views, "Prover", prover)
    plan = replace(failed("s", "", name="n", rule="deep"), reason=Blocked("unsolvable"), unsolvable=proof)
    assert missing_views.for_want_of_views(motions, plan, motions.scene) is plan
    (free,) = asked
    assert not free.partly_unseen
    assert free.target_grasps == given
    assert free.settings is settings


def test_looks_are_as_fine_as_where_all_was_seen(behind: tuple[Motions, str]) -> None:
    motions, name = behind
    poses = motions.start().poses
    usual, exhaustive = (len(list(look._picking.grasps(poses, name))) for look in (motions.thorough, motions.exhaustive))
    assert exhaustive > 3 * usual
    assert motions.finest is not None


@pytest.mark.parametrize(("seed", "index"), [(565101, 126), (565101, 105)])
def test_nothing_is_shuffled_about(ur5e: Robot, seed: int, index: int) -> None:
    """Of these scenes the first needs grasps that only an exhaustive look has, the second a view through a gap; guesses moved the same
    things till no moves were left."""
    plan = sensed(ur5e, drawn(ur5e, seed, index))
    assert plan.success, plan.reason
    assert plan.verified
    assert max(Counter(move.object for move in plan.moves if move.done).values()) == 1


def test_views_to_take_are_foreseen_with_the_camera_that_took_the_others(
    behind: tuple[Motions, str], ur5e: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the observation says; without a word the robot's own."""
    scene, asked = behind[0].scene, list[Intrinsics]()

    def no_views(robot: Robot, empty_scene: Scene, intrinsics: Intrinsics) -> None:
        asked.append(intrinsics)
        raise ValueError("no camera")

    monkeypatch.setattr(missing_views, "reachable_views", no_views)
    narrow = Intrinsics(424, 240, 610.5, 611.0, 210.0, 119.5)
    for camera in (narrow, None):
        seen = observation_to_json({}, np.empty((0, 4)), [(np.eye(4), 0.0)], 0.0, (2, 2, 2), np.array([[0, 0, 0, 2, 2, 2]]), camera)
        read = observation_from_node(Node(json.loads(json.dumps(seen)), "observation"))
        missing_views.missing(ur5e, replace(scene, observation=read), ())
    assert asked == [narrow, DEFAULT]


@pytest.mark.parametrize("wrong", [[640, 360, 1, 1, 0], [640.5, 360, 1, 1, 0, 0], [640, 0, 1, 1, 0, 0], [640, 360, 0, 1, 0, 0]])
def test_a_camera_that_is_none_is_refused(wrong: list[float]) -> None:
    with pytest.raises(InputError, match="intrinsics"):
        intrinsics_from(Node(wrong, "intrinsics"))
