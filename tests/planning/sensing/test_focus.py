"""What a look is aimed at: the voxels not seen that the arm would sweep on its way to a grasp, and no others; and views that show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import Array, apply
from perception.belief import Belief
from perception.mapping.next_best_view import InformationGain
from perception.mapping.voxels import FREE, UNKNOWN, Voxels, unknown_voxels
from perception.rendering.synthetic_camera import DEFAULT, RANGE_M
from planning.motion.pick_place import Motions
from planning.plan import Blocked
from planning.scenes.generation import generate, load_spec
from planning.sensing.focus import SHARE, wanted
from planning.sensing.reachable_views import reachable_views
from planning.sensing.unknown_space import unknown_mask, unknown_space


@pytest.fixture(scope="module")
def truth(ur5e: Robot) -> Scene:
    return generate(load_spec("paper"), ur5e, to_ref(ur5e), 71, 0)


def all_but(scene: Scene, spot: Array, half_m: float) -> Voxels:
    """A map that knows all but a cube about a spot."""
    voxels = unknown_voxels(scene.cabinet)
    near = np.abs(voxels.centres(np.ones(voxels.state.shape, bool)) - spot).max(1) < half_m
    return voxels.marked(~near.reshape(voxels.state.shape), FREE)


def test_nothing_is_wanted_when_all_is_known(ur5e: Robot, truth: Scene) -> None:
    known = unknown_voxels(truth.cabinet)
    known = known.marked(np.ones(known.state.shape, bool), FREE)
    assert not wanted(replace(truth, objects=()), ur5e, Belief(truth.objects, {}, known)).any()


def test_the_target_s_way_is_wanted_and_only_what_is_dark(ur5e: Robot, truth: Scene) -> None:
    belief = Belief((truth.body(truth.target),), {}, all_but(truth, truth.grasp.T_world_hand[:3, 3], 0.08))
    focus = wanted(replace(truth, objects=()), ur5e, belief)
    assert focus.any()
    assert not focus[~unknown_mask(belief.voxels, belief.bodies)].any()
    assert SHARE - 1e-9 <= focus.sum() <= 2 * SHARE
    far = wanted(replace(truth, objects=()), ur5e, replace(belief, voxels=all_but(truth, truth.cabinet.T_world_cabinet[:3, 3], 0.02)))
    assert not far.any()


def test_the_way_is_blocked_by_nothing_unseen_once_the_wanted_is_known(ur5e: Robot, truth: Scene) -> None:
    """The balls cover the links: when all that is wanted turns out to be free, some way to the grasp is clear of unseen space."""
    empty_scene, target = replace(truth, objects=()), (truth.body(truth.target),)
    voxels = all_but(truth, truth.grasp.T_world_hand[:3, 3], 0.12)
    alone = replace(truth, objects=target)

    def picks(voxels: Voxels) -> tuple[int, Blocked]:
        motions = Motions(ur5e, alone, obstacles=unknown_space(voxels, target, blocks=1))
        found, why = motions.picks(motions.start(), truth.target, [truth.grasp])
        return len(found), why

    before, why = picks(voxels)
    assert before == 0
    assert (why.body or "").startswith("unknown_")
    seen = voxels.marked(wanted(empty_scene, ur5e, Belief(target, {}, voxels)) > 0, FREE)
    assert picks(seen)[0] > 0, picks(seen)[1]
    assert (seen.state == UNKNOWN).any()


def test_objects_to_be_moved_add_their_own_ways(ur5e: Robot, truth: Scene) -> None:
    other = next(b for b in truth.objects if b.name != truth.target)
    belief = Belief(truth.objects, {}, all_but(truth, other.T_world_body[:3, 3], 0.1))
    empty_scene = replace(truth, objects=())
    assert wanted(empty_scene, ur5e, belief, [other.name]).sum() >= wanted(empty_scene, ur5e, belief).sum()
    assert (wanted(empty_scene, ur5e, belief, ["nobody"]) == wanted(empty_scene, ur5e, belief)).all()


def test_the_view_that_is_chosen_shows_what_is_wanted(ur5e: Robot, truth: Scene) -> None:
    spots = reachable_views(ur5e, replace(truth, objects=()))
    voxels = unknown_voxels(truth.cabinet)
    focus = np.zeros(voxels.state.shape)
    focus[30:34, 10:14, 5:9] = 0.5 / 64
    spot = apply(voxels.T_world_grid, np.array([32, 12, 7]) * voxels.step)
    chosen = []
    for wish in (None, focus):
        preview = InformationGain(voxels, spots.views, RANGE_M[0], wish)
        best = preview.best(voxels, np.zeros(len(spots.T)), lambda _: True)
        assert best is not None
        chosen.append(best)
    T = spots.T[chosen[1][0]]
    x, y, z = T[:3, :3].T @ (spot - T[:3, 3])
    assert z > 0
    assert abs(DEFAULT.fx * x / z) < DEFAULT.width / 2
    assert abs(DEFAULT.fy * y / z) < DEFAULT.height / 2
    assert chosen[1][1] >= 0.5  # the gain counts them
    assert chosen[0][1] <= 1
