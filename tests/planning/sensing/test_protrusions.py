"""What protrudes of the cabinet's front is seen whole, and no way to a view leads through it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene
from kinematics.shapes import Box
from kinematics.transforms import rotation_about, transform
from perception.belief import believe
from perception.frames import Frame
from perception.mapping.voxels import unknown_voxels
from perception.objects.prepared_frames import FRONT_M
from perception.objects.segment import segment
from perception.rendering.synthetic_camera import synthetic_camera
from planning.library import STAGE
from planning.motion.checking.verify import verify
from planning.motion.pick_place import Motions
from planning.scenes.generation import generate, load_spec
from planning.sensing.belief_state import BeliefState
from planning.sensing.look_around import SKIN_M, Limits, Looked, look_around
from planning.sensing.protrusions import Protrusions
from planning.sensing.settings import SENSING, SensingSettings
from planning.sensing.world import SimulatedWorld

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def scene(ur5e: Robot) -> Scene:
    """A large cabinet at whose edge a bottle stands, half of it over the edge."""
    return generate(load_spec("lab-l"), ur5e, to_ref(ur5e), 823501, 13)


@pytest.fixture(scope="module")
def seen(ur5e: Robot, scene: Scene) -> Looked:
    empty_scene = replace(scene, objects=())
    camera = synthetic_camera(ur5e, scene, scene.poses())
    rng = np.random.default_rng([0, STAGE, scene.random_word])  # with others, by chance, no way leads through it
    start = Motions(ur5e, empty_scene).start().q
    return look_around(empty_scene, ur5e, camera, start, unknown_voxels(scene.cabinet), rng, limits=SENSING.first)


def before_the_front_m(scene: Scene, body: Body) -> float:
    """How far a body protrudes."""
    corners = (
        body.T_world_body[:3, 3] + (np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * body.shape.half) @ body.T_world_body[:3, :3].T
    )  # type: ignore[union-attr]
    return float(scene.cabinet.T_world_cabinet[0, 3] - corners[:, 0].min())


def test_no_way_to_a_view_leads_through_what_protrudes(ur5e: Robot, scene: Scene, seen: Looked) -> None:
    assert max(before_the_front_m(scene, b) for b in scene.objects if isinstance(b.shape, Box)) > 0.05
    assert len(seen.views) > 3
    assert verify(ur5e, scene, seen.motions) is None


@pytest.mark.parametrize("by", ["mask", "geometry"])
def test_it_is_seen_whole(scene: Scene, seen: Looked, by: str) -> None:
    belief = believe(replace(scene, objects=()), seen.frames, seen.voxels, by=by)  # type: ignore[arg-type]
    (true,) = (b for b in scene.objects if isinstance(b.shape, Box) and before_the_front_m(scene, b) > 0.05)
    (found,) = (b for b in belief.bodies if np.linalg.norm(b.T_world_body[:2, 3] - true.T_world_body[:2, 3]) < 0.02)
    assert isinstance(found.shape, Box)
    np.testing.assert_allclose(np.sort(found.shape.size_m), np.sort(true.shape.size_m), atol=0.002)  # type: ignore[union-attr]


def front_box(scene: Scene, x_m: float) -> Body:
    """A turned box on the floor whose middle is so far behind the front."""
    return Body(
        "stray", Box(np.array([0.05, 0.05, 0.12])), scene.cabinet.T_world_cabinet @ transform(rotation_about(UP, 0.3), [x_m, 0.2, 0.06])
    )


def pictures(ur5e: Robot, scene: Scene, seen: Looked) -> list[Frame]:
    """What the camera shows of a scene where it was in the views of another."""
    camera = synthetic_camera(ur5e, scene, scene.poses())
    return [camera(f.T_world_camera, ur5e.home) for f in seen.frames]


def test_what_stands_before_the_cabinet_is_none_of_its_objects(ur5e: Robot, scene: Scene, seen: Looked) -> None:
    for x_m, is_object in ((0.0, True), (-0.08, False)):
        stray = front_box(scene, x_m)
        frames = pictures(ur5e, replace(scene, objects=(stray,), target="stray"), seen)
        assert bool(segment(frames, scene.cabinet)) == is_object


def test_its_obstacles_hold_all_that_was_seen_there_but_what_is_known(ur5e: Robot, scene: Scene, seen: Looked) -> None:
    stray = front_box(scene, 0.0)
    protrusions = Protrusions(scene.cabinet, 0.0)
    assert protrusions.boxes((), SKIN_M) == ()
    for frame in pictures(ur5e, replace(scene, objects=(stray,), target="stray"), seen):
        protrusions.add(frame)
    boxes = protrusions.boxes((), SKIN_M)
    assert boxes
    assert protrusions.boxes((stray,), SKIN_M) == ()
    front_x = scene.cabinet.T_world_cabinet[0, 3]
    corner = stray.T_world_body[:3, 3] + stray.T_world_body[:3, :3] @ (stray.shape.half * [-1, 1, 0])  # type: ignore[union-attr]
    assert corner[0] < front_x - 0.02
    inside = [(np.abs(corner - b.T_world_body[:3, 3]) <= b.shape.half + 0.01).all() for b in boxes]  # type: ignore[union-attr]
    assert any(inside)
    for b in boxes:
        low, high = b.T_world_body[0, 3] - b.shape.half[0], b.T_world_body[0, 3] + b.shape.half[0]  # type: ignore[union-attr]
        assert front_x - FRONT_M - 1e-9 <= low < high <= front_x + 1e-9


def test_an_obstacle_that_is_known_is_no_object_and_no_protrusion(ur5e: Robot, scene: Scene) -> None:
    stray = front_box(scene, 0.25)
    at = scene.cabinet.T_world_cabinet @ transform(p=[0.04, -0.25, 0.1])
    post = Body("post", Box(np.array([0.14, 0.04, 0.2])), at)  # from 3 cm before the front to 11 cm behind it
    for obstacles in ((), (post,)):
        bodies = (stray,) if obstacles else (stray, replace(post, name="thing"))
        there = replace(scene, objects=bodies, target="stray", obstacles=obstacles)
        world = SimulatedWorld(ur5e, there, np.random.default_rng(0), by="geometry")
        mind = BeliefState(ur5e, there, np.random.default_rng(0), SensingSettings("geometry"))
        looked = mind.look(world, Limits(1.0, 0.001, 4), None, lambda _: None)
        mind.understand()
        assert len(mind.belief.bodies) == len(bodies)
        assert verify(ur5e, there, looked.motions) is None
