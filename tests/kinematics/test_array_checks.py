"""Arrays of a wrong shape, NaN, huge and aliased ones at every public function that hands arrays to compiled code: ValueError, or an answer
that is right; asked once more with NUMBA_BOUNDSCHECK=1, where an index beyond an array would be seen."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Handmade
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kinematics.array_checks import checked, indices
from kinematics.collision.broad_phase import broad_phase
from kinematics.collision.clearance import least_clearances
from kinematics.collision.fcl_check import Verdict
from kinematics.collision.sphere_check import configs_free, make_sphere_scratch, open_pairs
from kinematics.collision.stretches import PackedStretches, Stretch
from kinematics.inverse import make_seeds, solve
from kinematics.robots.robot import Robot
from kinematics.scene import Held, Scene
from perception.camera import pinhole
from perception.mapping.voxels import unknown_voxels
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import surfaces
from planning.io.scene_documents import scene_from_json
from planning.motion.cell.workcell import IkSearch
from planning.motion.pick_place import Motions
from planning.motion.search.rrt_connect import plan, reach
from planning.motion.search.shortcut import shorten

ROOT = Path(__file__).resolve().parents[2]
ODD = st.sampled_from([0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-300, 3.2])
SHAPES = st.lists(st.integers(0, 8), min_size=0, max_size=3).map(tuple)


@st.composite
def odd(draw: st.DrawFn, good: np.ndarray) -> np.ndarray:
    """An array of another shape, or of this one with odd numbers in it, or a view of a larger one."""
    shape = draw(st.one_of(st.just(good.shape), SHAPES))
    values = np.resize(good, shape) if good.size else np.zeros(shape)
    values = np.array(values, float)
    for _ in range(draw(st.integers(0, 2))):
        if values.size:
            values.flat[draw(st.integers(0, values.size - 1))] = draw(ODD)
    if draw(st.booleans()):
        values = np.repeat(values, 2, axis=-1)[..., ::2] if values.ndim else values
    return values


class Doors:
    """One scene and everything that is asked about it."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self.robot, self.scene, self.motions = robot, scene, Motions(robot, scene)
        self.state, cell = self.motions.start(), self.motions.cell
        self.cell, self.query = cell, cell.problem(self.state.poses, 0.0)
        self.q, self.arm = self.state.q, robot.arm_q(self.state.q)
        self.model, self.world = self.query.task.model, self.query.task.world
        self.scratch = make_sphere_scratch(self.model, self.world)
        self.seeds = make_seeds(cell.arm.chain, cell.arm.T_frame_hand, 256)
        self.T = cell.arm.hand_pose(self.arm)
        self.verdict = Verdict(robot, scene)
        self.camera, self.voxels = pinhole(16, 12, 1.2), unknown_voxels(scene.cabinet)
        self.solids = surfaces([b.shape for b in scene.objects], np.array([b.T_world_body for b in scene.objects]))
        self.depth = np.ones((12, 16), np.float32)

    def packed(self, q: np.ndarray, poses: Mapping[str, np.ndarray]) -> PackedStretches:
        return PackedStretches(self.robot, self.scene, [Stretch(q, poses)])

    def asked(self) -> dict[str, tuple[np.ndarray, Callable[[Any], Any]]]:
        """By name: a good argument, and the call that takes it or another one."""
        task, poses, memory = self.query.task, self.state.poses, self.cell.enter(self.query)
        arm, few = self.cell.arm, {"max_iterations": 5, "seed": 0, "memory": memory}
        name = self.scene.objects[0].name
        rest = {n: T for n, T in poses.items() if n != name}
        return {
            "link_poses": (self.q, self.robot.link_poses),
            "tree.poses": (np.stack([self.q, self.q]), self.robot.tree.poses),
            "touch": (self.arm, lambda q: self.cell.touch(self.query, q)),
            "edge": (self.arm, lambda q: self.cell.edge(self.query, self.arm, q)),
            "ik": (self.T, lambda T: self.cell.ik(T, IkSearch(2))),
            "solve near": (self.arm, lambda q: solve(arm.chain, arm.T_frame_hand, self.seeds, self.T, q, tries=2)),
            "solve hand": (self.T, lambda T: solve(arm.chain, T, self.seeds, self.T, self.arm, tries=2)),
            "seeds": (arm.T_frame_hand, lambda T: make_seeds(arm.chain, T, 4)),
            "plan start": (self.arm, lambda q: plan(task, q, self.arm[None], **few)),
            "plan goals": (self.arm[None], lambda q: plan(task, self.arm, q, **few)),
            "reach": (self.arm[None], lambda q: reach(task, self.arm, q, **few)),
            "shorten": (np.stack([self.arm, self.arm]), lambda q: shorten(task, q, memory=memory)),
            "configs_free": (np.stack([self.arm] * 3), lambda q: configs_free(self.model, self.world, q, self.scratch)),
            "open_pairs": (np.stack([self.arm] * 3), lambda q: open_pairs(self.model, self.world, q, self.scratch)),
            "verdict": (np.stack([self.q] * 2), lambda q: self.verdict.first_contacts(q, poses)),
            "verdict pose": (np.eye(4), lambda T: self.verdict.first_contacts(self.q[None], {**rest, name: T})),
            "verdict held": (np.eye(4), lambda T: self.verdict.first_contacts(self.q[None], rest, Held(name, T))),
            "stretches": (np.stack([self.q] * 2), lambda q: broad_phase(self.packed(q, poses))),
            "clearances": (np.stack([self.q] * 2), lambda q: least_clearances(self.packed(q, poses), 0.002)),
            "raycast": (np.eye(4), lambda T: raycast(self.solids, T, self.camera)),
            "surfaces": (np.eye(4)[None], lambda T: surfaces([self.scene.objects[0].shape], T)),
            "fuse": (self.depth, lambda d: self.voxels.fuse(np.asarray(d, np.float32), self.camera, np.eye(4))),
            "fuse pose": (np.eye(4), lambda T: self.voxels.fuse(self.depth, self.camera, T)),
        }


@pytest.fixture(scope="module")
def doors(ur5e: Robot, handmade: Handmade) -> Doors:
    return Doors(ur5e, scene_from_json(handmade.scene))


NAMES = (
    "link_poses", "tree.poses", "touch", "edge", "ik", "solve near", "solve hand", "seeds", "plan start", "plan goals", "reach", "shorten",
    "configs_free", "open_pairs", "verdict", "verdict pose", "verdict held", "stretches", "clearances",
    "raycast", "surfaces", "fuse", "fuse pose",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_odd_arrays_end_in_a_value_error_or_an_answer(name: str, doors: Doors, data: st.DataObject) -> None:
    good, call = doors.asked()[name]
    value = data.draw(odd(good))
    try:
        call(value)
    except ValueError:
        assert (
            value.shape != good.shape or not np.isfinite(value).all() or np.abs(value).max(initial=0) > 100 or name in ("ik", "fuse pose")
        )
    call(good)  # and nothing was spoilt


def test_the_doors_are_all_there(doors: Doors) -> None:
    assert set(doors.asked()) == set(NAMES)
    for good, call in doors.asked().values():
        call(good)
        call(np.asfortranarray(good))
        call(np.repeat(good, 2, axis=-1)[..., ::2])


def test_regions_beyond_the_grid_are_refused(doors: Doors) -> None:
    motions, name = doors.motions, doors.scene.objects[0].name
    for region in (-1, doors.scene.regions_n**2, 10**12):
        with pytest.raises(ValueError, match="regions run from"):
            motions.place_pose(name, np.eye(4), region)


@pytest.mark.skipif(os.environ.get("NUMBA_BOUNDSCHECK") == "1", reason="this is the process that checks indices")
def test_no_index_is_beyond_its_array() -> None:
    """All tests of this file, in a process whose compiled code looks at each index."""
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"NUMBA_BOUNDSCHECK": "1"}
    command = [sys.executable, "-m", "pytest", __file__]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert f"{len(NAMES) + 3} passed, 1 skipped" in done.stdout


def test_what_a_check_says() -> None:
    for value, says in (
        ([1, 2], r"q \(2,\) must be \(3\)"),
        ([1, 2, np.nan], "q holds what is no finite number"),
        (["a", 1, 2], "q is no array of numbers"),
        ([[1, 2, 3]], r"q \(1, 3\) must be \(3\)"),
        (None, "q"),
        ([1, 2, 10**400], "q"),
    ):
        with pytest.raises(ValueError, match=says):
            checked("q", value, 3)
    for wrong in ([0.5], [-1], [3], ["a"], [True]):
        with pytest.raises(ValueError, match="regions"):
            indices("regions", wrong, 3)
    assert indices("regions", [], 0).shape == (0,)
    assert checked("q", np.zeros((2, 3)), -1, 3).flags.c_contiguous
    array = np.zeros((2, 3))
    assert checked("q", array, -1, 3) is array  # nothing is copied that need not be
