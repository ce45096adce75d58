"""A survey for a recording goes on where a look around ends, until nothing unseen is in the way of grasps, and keeps no view twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from perception.belief import Belief
from planning.scenes.generation import generate, load_spec
from planning.sensing.belief_state import BeliefState
from planning.sensing.focus import wanted
from planning.sensing.look_around import Limits
from planning.sensing.survey import RECORDING, survey
from planning.sensing.world import SimulatedWorld


def test_a_survey_looks_closer_at_what_is_in_the_way(ur5e: Robot) -> None:
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 71, 0)
    unknown, views, reasons = [], [], []
    for limits in (Limits(share=0.9, least=0.001, views=4), Limits(share=0.9, least=0.001, views=10), RECORDING):
        rng = np.random.default_rng(0)
        mind = BeliefState(ur5e, scene, rng)
        reasons.append(survey(mind, SimulatedWorld(ur5e, scene, rng), limits))
        assert len(mind.frames) <= limits.views
        at = np.array([f.T_world_camera for f in mind.frames])
        assert len(np.unique(at.round(6), axis=0)) == len(at)
        belief = Belief(scene.objects, {}, mind.voxels)
        unknown.append(int(np.count_nonzero(wanted(replace(scene, objects=()), ur5e, belief))))
        views.append(len(mind.frames))
    assert views[0] < views[1] < views[2] < RECORDING.views
    assert unknown[0] > unknown[1] > unknown[2] == 0
    assert reasons == ["4 views were taken", "10 views were taken", "nothing that was not seen is in the way of any grasp"]


def test_why_it_ended_is_said_of_all_views(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last round's own reason is about its few views."""
    monkeypatch.setattr("planning.sensing.survey.ROUNDS", 1)
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 71, 0)
    rng = np.random.default_rng(0)
    mind, limits = BeliefState(ur5e, scene, rng), Limits(share=0.9, least=0.001, views=24)
    assert survey(mind, SimulatedWorld(ur5e, scene, rng), limits) == "1 rounds of closer looks were taken"
