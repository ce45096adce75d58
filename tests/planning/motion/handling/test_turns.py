"""Whole turns of joints: the same hand, other room; and a can held from behind that only another turn of the wrist carries out upright."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.shapes import Cylinder
from kinematics.transforms import Array, transform
from planning.motion.cell.arm import arm_at
from planning.motion.checking.verify import verify
from planning.motion.handling.carry import Done
from planning.motion.handling.picking import Pick
from planning.motion.handling.placing import Place
from planning.motion.handling.turns import whole_turns
from planning.motion.pick_place import ITERATIONS, Motions
from planning.plan import Blocked
from planning.scenes.generation import generate, load_spec

REGIONS = (22, 44, 47)


def test_turned_ways_keep_the_hand_and_the_limits(robot: Robot) -> None:
    arm, rng, several = arm_at(robot, transform()), np.random.default_rng(0), 0
    lower, upper = arm.chain.lower, arm.chain.upper
    for _ in range(50):
        way = np.clip(rng.uniform(lower, upper) + rng.uniform(-0.3, 0.3, (4, len(lower))), lower, upper)
        turns = whole_turns(way, lower, upper, most=8)
        assert not turns[0].any()
        assert len(np.unique(turns, axis=0)) == len(turns) <= 8
        turned = np.count_nonzero(turns, axis=1)
        assert (np.diff(turned) >= 0).all()
        for by in turns:
            assert np.array_equal(by, 2 * np.pi * np.round(by / (2 * np.pi)))
            assert ((way + by >= lower) & (way + by <= upper)).all()
            np.testing.assert_allclose(arm.hand_pose(way[0] + by), arm.hand_pose(way[0]), atol=1e-9)
        alone = [j for j in range(len(lower)) for s in (1, -1) if fits(way[:, j] + s * 2 * np.pi, lower[j], upper[j])]
        assert len(turns) == 8 or len(turns) > len(alone)
        several += len(turns) > 1
    assert (several > 0) == bool((upper - lower > 2 * np.pi).any())


def fits(values: Array, low: float, high: float) -> bool:
    return bool(values.min() >= low and values.max() <= high)


@pytest.fixture(scope="module")
def behind(ur5e: Robot) -> tuple[Scene, Grasp]:
    """A can near the mouth of an empty cabinet, and a grasp on it by a hand that reaches round it and looks back at the robot."""
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 23, 0)
    floor_z = float(scene.cabinet.T_world_cabinet[2, 3])
    can = Body("can", Cylinder(0.03, 0.16), transform(p=[0.42, 0.12, floor_z + 0.08]))
    far = Body("far", Cylinder(0.03, 0.12), transform(p=[0.75, -0.2, floor_z + 0.06]))
    back = np.stack([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], 1)
    grasp = Grasp(transform(back, can.T_world_body[:3, 3] + [0.0, 0.0, 0.02]), 0.06)
    return replace(scene, objects=(can, far), target="far", grasp=None, grasps=()), grasp


def motions_with(scene: Scene, grasp: Grasp, ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> Motions:
    """Motions that know one grasp on the can, and hold it with the wrist turned as it likes to wait."""
    motions = Motions(ur5e, scene)
    state = motions.start()
    rest = {"far": state.poses["far"]}
    picks, why = motions._picking.picks_with([grasp], state.poses, rest, "can", ur5e.arm_q(state.q))
    assert picks, why
    assert all(pick.lift[-1][4] > np.pi for pick in picks)
    monkeypatch.setattr(motions, "picks", lambda *_: (picks, why))
    return motions


def test_what_is_held_from_behind_is_carried_with_the_wrist_a_turn_further(
    behind: tuple[Scene, Grasp], ur5e: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond half a turn of its wrist the hand would pass through the forearm on its way round; a turn back it passes beside it."""
    scene, grasp = behind
    motions = motions_with(scene, grasp, ur5e, monkeypatch)
    state = motions.start()
    for region in REGIONS:
        done = motions.relocate(state, "can", region, np.random.default_rng(region))
        assert isinstance(done, Done), (region, done)
        assert done.carry is not None
        assert done.carry.pick.lift[-1][4] < 0
        way = motions.trajectories(state, done.motions)
        assert verify(ur5e, scene, way, max_tilt_deg=motions.settings.max_tilt_deg) is None
    for kind in (Pick, Place):
        monkeypatch.setattr(kind, "turned", lambda self, *_: [self])
    motions = motions_with(scene, grasp, ur5e, monkeypatch)
    state = motions.start()
    for n, region in enumerate(REGIONS):
        blocked = motions.relocate(state, "can", region, np.random.default_rng(region))
        assert isinstance(blocked, Blocked), region
        assert (blocked.stage, blocked.detail) == ("transfer", f"no path in {ITERATIONS // 2**n} iterations")
