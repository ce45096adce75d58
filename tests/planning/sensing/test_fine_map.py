"""The loop's finer map: it agrees with the frames and moves that it comes from, and keeps whatever may really hide an object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, apply, transform
from perception.mapping.voxels import FREE, UNKNOWN, Voxels, unknown_voxels
from planning.plan import Plan
from planning.policies import make_policy
from planning.scenes.generation import generate, load_spec
from planning.sensing.belief_state import BeliefState
from planning.sensing.fine_map import FineMap, Moved, coarsened
from planning.sensing.hiding_places import SMALLEST_M
from planning.sensing.look_around import KnownFreePaths, Limits
from planning.sensing.reachable_views import reachable_views
from planning.sensing.retrieve import retrieve_unseen
from planning.sensing.settings import SensingSettings
from planning.sensing.unknown_space import unknown_space
from planning.sensing.world import SimulatedWorld

CABINET = Cabinet(np.array([0.305, 0.40, 0.25]), transform(p=[0.3, 0.0, 0.1]), 0.03)


@pytest.fixture(scope="module")
def truth(ur5e: Robot) -> Scene:
    return generate(load_spec("paper"), ur5e, to_ref(ur5e), 71, 0)


@pytest.fixture(scope="module")
def half_hidden(truth: Scene) -> Scene:
    """The scene with a board in the middle, and those of its objects that stand behind it or before it."""
    T = truth.cabinet.T_world_cabinet
    board = Body("board", Box(np.array([0.04, 0.70, 0.40])), T @ transform(p=[0.25, 0.0, 0.2]))
    away = {b.name: abs(b.T_world_body[0, 3] - board.T_world_body[0, 3]) for b in truth.objects}
    return replace(truth, objects=(board, *(b for b in truth.objects if away[b.name] > 0.06)))


@pytest.fixture(scope="module")
def glimpsed(ur5e: Robot, half_hidden: Scene) -> BeliefState:
    """What is believed after two views: some objects were seen, others not at all."""
    truth = half_hidden
    world = SimulatedWorld(ur5e, truth, np.random.default_rng(0))
    mind = BeliefState(ur5e, truth, np.random.default_rng(0))
    mind.look(world, Limits(1.0, 0.001, 2), None, lambda _: None)
    mind.understand()
    mind.by_size = True
    return mind


def inside(body: Body, count: int = 3000) -> Array:
    """Points (N, 3) of an upright body, in the world."""
    local = np.random.default_rng(1).uniform(-1, 1, (count, 3))
    if isinstance(body.shape, Cylinder):
        local = local[np.hypot(local[:, 0], local[:, 1]) < 1] * [body.shape.radius_m, body.shape.radius_m, body.shape.height_m / 2]
    else:
        assert isinstance(body.shape, Box)
        local = local * body.shape.half
    return apply(body.T_world_body, local)


def filled(boxes: tuple[Body, ...], points: Array) -> np.ndarray:
    """Which of the points (N, 3) are in one of the boxes, which stand along the world's axes."""
    out = np.zeros(len(points), bool)
    for box in boxes:
        assert isinstance(box.shape, Box)
        out |= (np.abs(points - box.T_world_body[:3, 3]) <= box.shape.half + 1e-9).all(1)
    return out


def test_what_nobody_has_seen_is_wholly_in_the_obstacles(glimpsed: BeliefState, half_hidden: Scene) -> None:
    """Not by the believed bodies: each object that was not found at all lies in what the planner may not enter."""
    unseen = [b for b in half_hidden.objects if glimpsed.belief.body(b.name) is None]
    walls = glimpsed.unseen_boxes()
    assert 0 < len(unseen) < len(half_hidden.objects)
    for body in unseen:
        assert filled(walls, inside(body)).all(), body.name


def test_it_holds_no_more_than_the_coarse_map(glimpsed: BeliefState) -> None:
    bodies, places = glimpsed.belief.bodies, glimpsed.unseen_voxels()
    coarse = replace(glimpsed.voxels, state=np.where(places, np.uint8(UNKNOWN), np.uint8(FREE)))
    strict = unknown_space(glimpsed.voxels, bodies, blocks=1)
    assert filled(strict, coarse.centres(places)).all()
    assert not (places & (glimpsed.voxels.state == FREE)).any()


def test_a_map_asked_for_late_is_the_map_of_the_frames(glimpsed: BeliefState, truth: Scene) -> None:
    """Whatever the frames show alone is free in it, and nothing else but what the coarse map knows."""
    alone = unknown_voxels(truth.cabinet, 0.005)
    for f in glimpsed.frames:
        alone = alone.fuse(f.depth, f.intrinsics, f.T_world_camera, own=f.arm)
    glimpsed.unseen_boxes()
    ours = glimpsed.fine.voxels.state == FREE
    assert ours[alone.state == FREE].all()
    extra = glimpsed.fine.voxels.centres(ours & (alone.state != FREE))
    assert (glimpsed.voxels.state[tuple(glimpsed.voxels.index(extra).T)] == FREE).all()


def test_moves_are_in_it_in_their_order() -> None:
    """Where an object stood is free, and where it stands is no hiding place, whatever was thought before."""
    shape = Box(np.array([0.06, 0.06, 0.1]))
    spots = [CABINET.T_world_cabinet @ transform(p=[0.1, y, 0.05]) for y in (-0.1, 0.1)]
    before, after = (Body("box", shape, T) for T in spots)
    coarse = unknown_voxels(CABINET)
    coarse = Moved(before, after).marked_in(coarse.marked(~coarse.touched(before), FREE))
    fine = FineMap(CABINET)
    fine.add(Moved(before, after))
    nothing = np.zeros(coarse.state.shape, bool)
    fine.hiding_places(coarse, nothing, [after], {"box"}, SMALLEST_M)
    assert (fine.voxels.state[fine.voxels.touched(before)] == FREE).all()
    assert not fine.hiding_places(coarse, ~nothing, [after], {"box"}, SMALLEST_M).any()


def test_maps_of_any_two_grids_are_compared_by_place() -> None:
    """A cabinet of 30.5 cm has 31 coarse voxels along it and 61 fine ones."""
    coarse, fine = unknown_voxels(CABINET), unknown_voxels(CABINET, 0.005)
    assert (coarse.state.shape[0], fine.state.shape[0]) == (31, 61)
    which = np.random.default_rng(2).random(fine.state.shape) < 0.001
    marked = coarsened(which, fine, coarse)
    assert marked[tuple(coarse.index(fine.centres(which)).T)].all()
    assert marked.sum() <= which.sum()


def test_an_arm_in_a_slit_can_move_on_to_the_next_view(ur5e: Robot, truth: Scene) -> None:
    """Where it stands may be unknown to the coarse map once slits are free: then ways keep clear of what may hide something."""
    empty_scene = replace(truth, objects=())
    spots, nothing = reachable_views(ur5e, empty_scene), unknown_voxels(truth.cabinet)
    depth = spots.T[:, 0, 3] - truth.cabinet.T_world_cabinet[0, 3]
    q = ur5e.with_arm(spots.q[int(np.argmax(depth))], float(ur5e.home[ur5e.gripper_joint]))

    def blocked(voxels: Voxels, **more: object) -> bool:
        ways = KnownFreePaths(empty_scene, ur5e, voxels, (), q, spots, np.random.default_rng(0), **more)  # type: ignore[arg-type]
        return ways.blocked is not None

    assert blocked(nothing)
    assert not blocked(nothing, hiding=lambda: ())
    assert blocked(nothing, hiding=lambda: unknown_space(nothing, (), 1))


@pytest.mark.parametrize("smallest_m", [0.0, SMALLEST_M])
def test_a_plan_says_what_it_took_for_granted(ur5e: Robot, smallest_m: float) -> None:
    scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 71, 0)
    world = SimulatedWorld(ur5e, scene, np.random.default_rng(0))
    plan: Plan = retrieve_unseen(
        world, ur5e, replace(scene, objects=scene.objects), lambda m, moves: make_policy("neural", m, max_moves=moves), truth=world,
        name="neural", sensing=SensingSettings(smallest_m=smallest_m), rng=np.random.default_rng(0),
    )  # fmt: skip
    assert plan.success
    assert plan.verified
    assert any(move.done for move in plan.moves)
    assumed = [note for note in plan.notes if note.stage == "look"]
    assert len(assumed) == (smallest_m > 0)
    assert all(note.amount is not None and note.amount <= SMALLEST_M for note in assumed)
