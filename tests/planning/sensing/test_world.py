"""The loop in a world that is only asked: executions that stop half-way, and what a world may not say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import transform
from perception.camera import pinhole
from planning.plan import Fault, Motion, Plan
from planning.policies import make_policy
from planning.scenes.generation import generate, load_spec
from planning.sensing.retrieve import retrieve_unseen
from planning.sensing.settings import SENSING, SensingSettings
from planning.sensing.world import SimulatedWorld, Stopped, configuration, frame_from, part_done


class StumblingWorld(SimulatedWorld):
    """Stops in the middle of the first motions of some stages, once each, or every time."""

    def __init__(self, robot: Robot, scene: Scene, stages: Sequence[str], *, always: bool = False) -> None:
        super().__init__(robot, scene, np.random.default_rng(0), by="geometry")
        self.left, self.always, self.stopped = list(stages), always, list[str]()

    def execute(self, motions: Sequence[Motion]) -> Stopped | None:
        for number, motion in enumerate(motions):
            if motion.stage in self.left:
                if not self.always:
                    self.left.remove(motion.stage)
                half = motion.at(np.array([0.0, 0.5 * motion.t_s[-1]]))
                super().execute([*motions[:number], replace(motion, q=half, t_s=motion.t_s[[0, -1]], qd=None, qdd=None)])
                self.stopped.append(motion.stage)
                return Stopped(number, "somebody pressed the button")
        return super().execute(motions)


@pytest.fixture(scope="module")
def truth(ur5e: Robot) -> Scene:
    return generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 71, 0)


def planned(robot: Robot, truth: Scene, world: SimulatedWorld) -> Plan:
    """What the loop makes of a world of which it is told nothing but the target's name and x_g."""
    scene = replace(truth, objects=())
    rng = np.random.default_rng([0, 4, 0])
    sensing = SensingSettings(by=None)
    return retrieve_unseen(
        world, robot, scene, lambda m, moves: make_policy("neural", m, max_moves=moves), sensing=sensing, name="neural", rng=rng
    )


def test_it_looks_again_and_plans_on_from_where_the_arm_is(ur5e: Robot, truth: Scene) -> None:
    """On the way to a view, before an object, and with an object in the hand."""
    world = StumblingWorld(ur5e, truth, ["look", "transit", "transfer"])
    plan = planned(ur5e, truth, world)
    assert world.stopped == ["look", "transit", "transfer"]
    assert plan.success, plan.reason
    assert plan.verified
    assert not truth.cabinet.contains(world.poses[truth.target_name][:3, 3])
    for a, b in zip(plan.motions, plan.motions[1:]):
        np.testing.assert_allclose(b.q[0], a.q[-1], atol=1e-9)
    arm = list(ur5e.arm_joints)
    np.testing.assert_allclose(plan.motions[-1].q[-1, arm], world.q[arm], atol=1e-9)
    np.testing.assert_allclose(plan.motions[-1].q[-1], world.q, atol=1e-3)  # the fingers went on until they met it


def test_an_arm_that_always_stops_ends_the_loop_with_the_reason(ur5e: Robot, truth: Scene) -> None:
    world = StumblingWorld(ur5e, truth, ["transit"], always=True)
    plan = planned(ur5e, truth, world)
    assert not plan.success
    assert "the execution stopped: somebody pressed the button" in str(plan.reason)
    assert len(world.stopped) == SENSING.most_stops + 1


def test_an_arm_that_stops_as_it_lifts_is_not_gone_on_with(ur5e: Robot, truth: Scene) -> None:
    world = StumblingWorld(ur5e, truth, ["lift"])
    plan = planned(ur5e, truth, world)
    assert (plan.success, world.stopped) == (False, ["lift"])
    assert plan.reason is not None
    assert (plan.reason.stage, plan.motions[-1].stage) == ("lift", "lift")


def test_a_part_of_a_motion_ends_where_the_arm_is() -> None:
    motion = Motion("transit", ("a", "b"), np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), np.array([0.0, 1.0, 2.0]))
    part = part_done(motion, np.array([1.0, 0.4]))
    np.testing.assert_array_equal(part.q, [[0, 0], [1, 0], [1, 0.4]])
    assert part.t_s[-1] == pytest.approx(1.4, abs=0.02)
    assert (np.diff(part.t_s) > 0).all()


def test_where_the_arm_is_must_be_said_of_every_joint(ur5e: Robot) -> None:
    joints = dict(zip(ur5e.joint_names, map(float, ur5e.home)))
    np.testing.assert_array_equal(configuration(ur5e, joints), ur5e.home)
    with pytest.raises(ValueError, match="no number"):
        configuration(ur5e, {**joints, ur5e.joint_names[0]: np.nan})
    del joints[ur5e.joint_names[0]]
    with pytest.raises(ValueError, match=f"does not say where {ur5e.joint_names[0]} is"):
        configuration(ur5e, joints)


def test_a_frame_is_taken_where_the_camera_is(ur5e: Robot) -> None:
    joints = dict(zip(ur5e.joint_names, map(float, ur5e.home)))
    frame = frame_from(ur5e, transform(p=[1, 2, 3]), joints, np.ones((4, 6)), pinhole(6, 4, 1.0))
    np.testing.assert_allclose(frame.T_world_camera, transform(p=[1, 2, 3]) @ ur5e.link_poses(ur5e.home)["camera"])
    assert (frame.instance, frame.depth.dtype) == (None, np.float32)


def test_what_does_not_hold_by_what_was_seen_is_not_carried_out(ur5e: Robot, truth: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is planned is in doubt: the loop looks again and again, and ends where the arm has touched nothing."""
    doubt = Fault("grasp", ("left_pad",), "as it was seen: left_pad is 3.0 mm inside it", 0.003)
    monkeypatch.setattr("planning.sensing.retrieve._as_seen", lambda *_: [doubt])
    world = SimulatedWorld(ur5e, truth, np.random.default_rng(0), by="geometry")
    plan = planned(ur5e, truth, world)
    assert (plan.success, plan.verified) == (False, True)
    assert {motion.stage for motion in plan.motions} == {"look"}
    assert not any(move.done for move in plan.moves)
    assert doubt.detail in {move.reason.detail for move in plan.moves if move.reason} | {plan.reason and plan.reason.detail}
    for name, T in truth.poses().items():
        np.testing.assert_array_equal(world.poses[name], T)


def test_a_body_that_no_mask_names_is_the_object_that_stands_nearest(ur5e: Robot, truth: Scene) -> None:
    """As a target that is only known by its box."""
    world, body = SimulatedWorld(ur5e, truth, np.random.default_rng(0)), truth.objects[1]
    beside = replace(body, name="target", T_world_body=transform(p=[0.004, 0.0, 0.0]) @ body.T_world_body)
    assert world.names([beside, truth.objects[0]]) == {"target": body.name, truth.objects[0].name: truth.objects[0].name}
