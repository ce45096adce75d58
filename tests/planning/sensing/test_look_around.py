"""Active sensing: every scene that can be seen is seen, nothing unseen is entered, and each odd case ends with its reason."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene, object_box
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, rotation_about, transform
from perception.belief import believe, observation, without_bodies
from perception.camera import DepthNoise, look_at, realsense_d435i
from perception.frames import Frame
from perception.mapping.voxels import UNKNOWN, unknown_voxels
from perception.objects.footprint import upright_solid
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import moved, surfaces
from perception.rendering.synthetic_camera import DEFAULT, RANGE_M, Camera, robot_depth, synthetic_camera
from planning.motion.checking.verify import verify
from planning.motion.pick_place import Motions
from planning.policies import make_policy
from planning.scenes.generation import generate, load_spec
from planning.sensing.look_around import Limits, Looked, look_around
from planning.sensing.retrieve import retrieve_unseen
from planning.sensing.settings import LoopSettings, SensingSettings
from planning.sensing.world import SimulatedWorld


@pytest.fixture(scope="module")
def scene(ur5e: Robot) -> Scene:
    return generate(load_spec("paper"), ur5e, to_ref(ur5e), 71, 0)


def look(robot: Robot, scene: Scene, **more: object) -> Looked:
    empty_scene = replace(scene, objects=())
    camera = more.pop("camera", None) or synthetic_camera(robot, scene, scene.poses())
    q = Motions(robot, empty_scene).start().q
    rng = np.random.default_rng(0)
    return look_around(empty_scene, robot, camera, q, unknown_voxels(scene.cabinet), rng, **more)  # type: ignore[arg-type]


def test_a_scene_is_seen_in_few_views_and_the_arm_touches_nothing(ur5e: Robot, scene: Scene) -> None:
    seen = look(ur5e, scene)
    assert seen.voxels.known > 0.9
    assert 2 <= len(seen.views) <= 8
    assert [share for _, share in seen.views] == sorted(share for _, share in seen.views)
    assert verify(ur5e, scene, seen.motions) is None
    again = look(ur5e, scene)
    np.testing.assert_array_equal(seen.voxels.state, again.voxels.state)


def test_the_objects_are_found_as_they_are(ur5e: Robot, scene: Scene) -> None:
    seen = look(ur5e, scene, limits=Limits(1.0, 0.001, 10))
    empty_scene = replace(scene, objects=())
    belief = believe(empty_scene, seen.frames, seen.voxels)
    assert {b.name for b in belief.bodies} == {b.name for b in scene.objects}
    for body in belief.bodies:
        true = scene.body(body.name)
        assert type(body.shape) is type(true.shape)
        np.testing.assert_allclose(body.T_world_body[:3, 3], true.T_world_body[:3, 3], atol=0.004)
    regions = observation(empty_scene, ur5e.home, belief).regions
    assert regions.shape == (scene.regions_n**2, 4)
    assert 0.5 < regions[:, 3].mean() <= 1
    unknown_mask = observation(empty_scene, ur5e.home, replace(belief, bodies=(), voxels=unknown_voxels(scene.cabinet))).regions
    assert (unknown_mask[:, 3] == 0).all()


def test_a_sealed_corner_stays_unknown_and_is_not_entered(ur5e: Robot, scene: Scene) -> None:
    plate = Body("plate", Box(np.array([0.01, 0.86, 0.49])), scene.cabinet.T_world_cabinet @ transform(p=[0.3, 0, 0.246]))
    shut = replace(scene, objects=(plate,), target="plate")
    seen = look(ur5e, shut, limits=Limits(0.97, 0.003, 6))
    assert (seen.voxels.state[32:, :, :46] == UNKNOWN).all()
    hidden = Body("hidden", Box(np.array([0.2, 0.86, 0.46])), scene.cabinet.T_world_cabinet @ transform(p=[0.44, 0, 0.24]))
    assert verify(ur5e, replace(shut, objects=(plate, hidden)), seen.motions) is None


def test_an_empty_cabinet_is_known_soon(ur5e: Robot, scene: Scene) -> None:
    seen = look(ur5e, replace(scene, objects=()))
    assert seen.reason.endswith("% of the space is known")
    assert believe(replace(scene, objects=()), seen.frames, seen.voxels).boxes == {}


def _fixed(depth: Array) -> Camera:
    none = np.full(depth.shape, -1, np.int32)
    return lambda T, q: Frame(depth.astype(np.float32), none, (), DEFAULT, T, None)


def test_no_pixel_noise_alone_and_a_covered_camera_end_with_a_reason(ur5e: Robot, scene: Scene) -> None:
    shape = (DEFAULT.height, DEFAULT.width)
    nothing = look(ur5e, scene, camera=_fixed(np.zeros(shape)))
    assert nothing.voxels.known == 0
    assert "measured nothing" in nothing.reason
    noise = look(ur5e, scene, camera=_fixed(np.random.default_rng(0).uniform(0.2, 1.5, shape)))
    assert noise.reason
    assert verify(ur5e, scene, noise.motions) is None


def test_a_camera_inside_an_object_ends_with_its_reason(ur5e: Robot, scene: Scene) -> None:
    """A real solid around the lens, wherever it goes: a bag over the camera."""
    bag = Box(np.array([0.1, 0.1, 0.1]))
    walls = scene.cabinet.walls()

    def look_out(T: Array, q: Array) -> Frame:
        world = surfaces([bag, *(w.shape for w in walls)], np.array([T, *(w.T_world_body for w in walls)]))
        depth = raycast(world, T, DEFAULT).depth
        depth = np.where(depth < RANGE_M[0], np.float32(0), depth)
        return Frame(depth, np.full(depth.shape, -1, np.int32), (), DEFAULT, T, None)

    seen = look(ur5e, scene, camera=look_out, limits=Limits(0.97, 0.0, 8))
    assert seen.voxels.known == 0
    assert len(seen.views) == 3
    assert "measured nothing: is the camera covered" in seen.reason
    assert verify(ur5e, scene, seen.motions) is None


@pytest.mark.parametrize("by", ["mask", "geometry"])
def test_noise_alone_is_no_object_or_is_told(ur5e: Robot, scene: Scene, by: Literal["mask", "geometry"]) -> None:
    empty_scene, rng = replace(scene, objects=()), np.random.default_rng(0)
    shape = (DEFAULT.height, DEFAULT.width)
    seen = look(ur5e, scene, camera=_fixed(rng.uniform(0.2, 1.5, shape)))
    assert verify(ur5e, scene, seen.motions) is None
    if by == "mask":
        assert believe(empty_scene, seen.frames, seen.voxels).boxes == {}
    else:
        with pytest.raises(ValueError, match="no surfaces"):
            believe(empty_scene, seen.frames, seen.voxels, by="geometry")


def test_a_plan_from_pictures_of_noise_fails_with_its_reason(ur5e: Robot, scene: Scene) -> None:
    """Nothing is raised, so that a batch goes on with the next scene."""

    class Noisy(SimulatedWorld):
        def take_frame(self) -> Frame:
            noise = self.rng.uniform(0.2, 1.5, (DEFAULT.height, DEFAULT.width))
            return _fixed(noise)(self.scene.robot.T_world_base @ self.robot.link_poses(self.q)["camera"], self.q)

    rng = np.random.default_rng(0)
    world = Noisy(ur5e, scene, rng, by="geometry")
    plan = retrieve_unseen(
        world, ur5e, scene, lambda m, _: make_policy("local", m), truth=world, sensing=SensingSettings(by="geometry"), name="local", rng=rng
    )  # fmt: skip
    assert not plan.success
    assert plan.reason is not None
    assert plan.reason.stage == "look"
    assert "show no surfaces" in str(plan.reason)
    assert plan.verified


def test_limits_hold(ur5e: Robot, scene: Scene) -> None:
    assert len(look(ur5e, scene, limits=Limits(1.0, 0.0, 3)).views) == 3
    assert len(look(ur5e, scene, limits=Limits(0.1, 0.0, 8)).views) == 1
    assert look(ur5e, scene, limits=Limits(1.0, 0.0, 0)).reason == "no view was allowed"
    with pytest.raises(ValueError, match="gain, random, sweep"):
        look(ur5e, scene, choose="best")


@pytest.mark.parametrize("seed", range(12))
def test_the_solid_holds_its_points_and_knows_cans_from_cartons(seed: int) -> None:
    rng = np.random.default_rng(seed)
    half, yaw = rng.uniform(0.02, 0.05, 2), rng.uniform(0, 3)
    angle = rng.uniform(0, 2 * np.pi, 3000)
    if seed % 2:
        flat = half[0] * np.stack([np.cos(angle), np.sin(angle)], -1)
    else:
        flat = rng.uniform(-1, 1, (3000, 2))
        flat = half * flat / np.abs(flat).max(1, keepdims=True) @ rotation_about((0, 0, 1), yaw)[:2, :2].T
    points = np.c_[flat + np.array([0.3, 0.1]), rng.uniform(0, 0.2, 3000)]
    shape, T = upright_solid(points)
    local = (points - T[:3, 3]) @ T[:3, :3]
    if seed % 2:
        assert isinstance(shape, Cylinder)
        assert abs(shape.radius_m - half[0]) < 2e-3
        assert np.hypot(local[:, 0], local[:, 1]).max() <= shape.radius_m + 1e-9
    else:
        assert isinstance(shape, Box)
        assert (np.abs(local[:, :2]) <= shape.half[:2] + 1e-3).all()


def test_a_plan_made_from_pictures_alone_holds_in_the_truth(ur5e: Robot) -> None:
    truth = generate(load_spec("paper"), ur5e, to_ref(ur5e), 31, 2)
    rng = np.random.default_rng([0, 4, 2])
    world = SimulatedWorld(ur5e, truth, rng)
    plan = retrieve_unseen(world, ur5e, truth, lambda m, _: make_policy("local", m), truth=world, name="local", rng=rng)
    assert plan.verified
    assert any(m.stage == "look" for m in plan.motions)
    assert verify(ur5e, truth, plan.motions) is None
    lost = replace(truth, objects=tuple(b for b in truth.objects if b.name != truth.target))
    rng = np.random.default_rng(0)
    world = SimulatedWorld(ur5e, lost, rng)
    still = LoopSettings(max_moves=0)
    unfound = retrieve_unseen(world, ur5e, lost, lambda m, _: make_policy("local", m), truth=world, name="local", settings=still, rng=rng)
    assert not unfound.success
    assert "not found" in str(unfound.reason)


@pytest.mark.parametrize("noise", [None, DepthNoise()], ids=["clean", "noisy"])
def test_without_masks_an_object_is_moved_and_the_target_taken_under_their_true_names(ur5e: Robot, noise: DepthNoise | None) -> None:
    truth = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 71, 0)
    frame = SimulatedWorld(ur5e, truth, np.random.default_rng(0), noise, "geometry").take_frame()
    assert frame.instance is None
    assert frame.names == ()
    rng = np.random.default_rng([0, 4, 0])
    world = SimulatedWorld(ur5e, truth, rng, noise, "geometry")
    plan = retrieve_unseen(
        world, ur5e, truth, lambda m, moves: make_policy("neural", m, max_moves=moves),
        truth=world, name="neural", sensing=SensingSettings("geometry", noise.axial_1m_m if noise else 0.0), rng=rng,
    )  # fmt: skip
    assert plan.success
    assert plan.verified
    assert [m.held.body for m in plan.motions if m.held][-1] == truth.target
    done = [m for m in plan.moves if m.done]
    assert done
    assert {m.object for m in plan.moves} <= {b.name for b in truth.objects}
    assert all(np.linalg.norm(m.T_world_to[:2, 3] - m.T_world_from[:2, 3]) > 0.0005 for m in plan.moves)  # none to where it stands
    others = {m.held.body for m in plan.motions if m.held} - {truth.target}
    assert others == {m.object for m in done}


def test_a_box_that_points_to_another_object_is_found_out(ur5e: Robot) -> None:
    truth = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 71, 0)
    other = next(b for b in truth.objects if b.name != truth.target)
    named = SimulatedWorld(ur5e, truth, np.random.default_rng(0), None, "geometry").names([replace(other, name="object_3")])
    assert named == {"object_3": other.name}
    seen = look(ur5e, truth)
    belief = believe(replace(truth, objects=()), seen.frames, seen.voxels, by="geometry", target_box=object_box(other))
    found = belief.body(truth.target)
    assert found is not None
    np.testing.assert_allclose(found.T_world_body[:2, 3], other.T_world_body[:2, 3], atol=0.005)
    empty_scene, few = replace(truth, objects=()), seen.frames[:3]
    again = believe(empty_scene, few, seen.voxels, by="geometry", target_box=object_box(other), before=belief.bodies)
    kept = {b.name: b for b in belief.bodies}
    for body in again.bodies:
        if body.name in kept and truth.target not in body.name:
            np.testing.assert_allclose(body.T_world_body[:2, 3], kept[body.name].T_world_body[:2, 3], atol=0.02)


def test_bodies_leave_the_picture_and_nothing_else_does(ur5e: Robot, scene: Scene) -> None:
    frame = synthetic_camera(ur5e, scene, scene.poses())(look_at(np.array([0.1, 0.0, 0.5]), np.array([0.6, 0.0, 0.1])), ur5e.home)
    assert frame.instance is not None
    shown = [k for k in range(len(frame.names)) if np.count_nonzero(frame.instance == k) > 100]
    assert shown
    for k in shown:
        left = without_bodies(frame, [scene.body(frame.names[k])], 0.0)
        assert not (left.depth[frame.instance == k] > 0).any()
        lost = (left.depth == 0) & (frame.depth > 0) & (frame.instance != k)
        assert np.count_nonzero(lost) < 0.2 * np.count_nonzero(frame.instance == k)


def test_links_that_are_left_out_of_a_picture_are_not_in_it(ur5e: Robot) -> None:
    hulls = [h for h in ur5e.hulls if h.link != "camera"]
    packed, small = surfaces([h.vertices for h in hulls], np.tile(np.eye(4), (len(hulls), 1, 1))), realsense_d435i(80, 45)
    rng, shown = np.random.default_rng(0), 0
    for i in range(40):
        q = ur5e.with_arm(rng.uniform(-2, 2, len(ur5e.arm_q(ur5e.home))), 0.2)
        poses = ur5e.link_poses(q)
        T = look_at(rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)) if i % 2 else poses["camera"]
        whole = raycast(moved(packed, np.array([poses[h.link] for h in hulls])), T, small).depth
        np.testing.assert_array_equal(robot_depth(ur5e, np.eye(4), q, T, small), whole)
        shown += bool((whole > 0).any())
    assert 5 < shown < 40
