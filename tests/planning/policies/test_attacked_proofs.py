"""benchmarks/proofs.py breaks proofs that are wrong: of what can be picked, and of a target that a move frees."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from planning.motion.pick_place import Motions
from planning.plan import Plan, Unsolvable
from planning.scenes.generation import generate, load_spec

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))
import proofs


@pytest.fixture(scope="module")
def scene(ur5e: Robot) -> Scene:
    return generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 515151, 3)


def claimed(scene: Scene, *stuck: str) -> Plan:
    return Plan(scene.id, "p", "deep", False, None, (), (), 0.0, 0.0, 0.0, 0.0, None, unsolvable=Unsolvable(stuck, ()))


def test_what_can_be_picked_is_not_stuck(ur5e: Robot, scene: Scene) -> None:
    motions = Motions(ur5e, scene)
    state = motions.start()
    name = next(b.name for b in scene.objects if b.name != scene.target and motions.picks(state, b.name)[0])
    line = proofs.attack(scene, claimed(scene, name), 60.0, 0)
    assert line["broken"] is not None
    assert line["moves"] == 0


def test_a_search_without_guidance_finds_a_target_that_is_free(scene: Scene) -> None:
    near = np.linalg.norm
    target = scene.target_body.T_world_body[:2, 3]
    other = max((b for b in scene.objects if b.name != scene.target), key=lambda b: float(near(b.T_world_body[:2, 3] - target)))
    easy = replace(scene, objects=(scene.target_body, other))
    line = {"broken": None, "grasps": 0, "moves": 0, "targets_tried": 0}
    proofs._search(proofs.from_ref(scene.robot), easy, easy.poses(), line, lambda: line["moves"] > 20, np.random.default_rng(0))
    assert "comes out" in str(line["broken"])
