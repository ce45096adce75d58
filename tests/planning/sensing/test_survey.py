"""A survey for a recording: it goes on where a look around ends, at what is in the way of grasps, and keeps no view twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import RobotRef
from kinematics.transforms import transform
from perception.belief import Belief
from planning.motion.trajectory import FULL
from planning.scenes.generation import generate, load_spec
from planning.sensing.belief_state import BeliefState
from planning.sensing.focus import wanted
from planning.sensing.look_around import Limits
from planning.sensing.survey import survey
from planning.sensing.world import SimulatedWorld


def test_a_survey_looks_closer_at_what_is_in_the_way(ur5e: Robot) -> None:
    scene = generate(load_spec("paper"), ur5e, RobotRef(transform(p=ur5e.base_p), "ur5e"), 71, 0)
    unknown, views = [], []
    for most in (4, 10):
        rng = np.random.default_rng(0)
        mind = BeliefState(ur5e, scene, rng, by="mask", noise_1m_m=0.0, target_box=None, pace=FULL)
        reason = survey(mind, SimulatedWorld(ur5e, scene, rng), Limits(share=0.9, least=0.001, views=most))
        assert reason
        assert len(mind.frames) <= most
        at = np.array([f.T_world_camera for f in mind.frames])
        assert len(np.unique(at.round(6), axis=0)) == len(at)
        belief = Belief(scene.objects, {}, mind.voxels)
        unknown.append(int(np.count_nonzero(wanted(replace(scene, objects=()), ur5e, belief))))
        views.append(len(mind.frames))
    assert views[1] > views[0]
    assert unknown[1] < unknown[0]
