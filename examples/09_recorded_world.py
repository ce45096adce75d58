"""A recorded folder stands for the world: each look gets the recorded frame that was taken nearest to where the arm is.

    retrieve sense scenes.jsonl --views views/ > /dev/null                       or frames of your own, docs/formats.md says in which layout
    VIEWS=views retrieve plan scenes.jsonl --sense --world examples/09_recorded_world.py:world

For trying the loop on real pictures without an arm. A recording shows nothing of what is moved, so it stops when an object is lifted that
is not the target: the plan then ends with that reason.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from perception.frames import Frame, read_frames
from planning import Motion
from planning.motion.pick_place import Motions
from planning.sensing.world import Stopped


class RecordedWorld:
    """frames: of one scene, none of which has changed meanwhile. The arm begins where the scene says."""

    def __init__(self, robot: Robot, scene: Scene, frames: Sequence[Frame]) -> None:
        self.robot, self.scene, self.frames = robot, scene, frames
        self.intrinsics = frames[0].intrinsics
        self.q = Motions(robot, scene).start().q

    def take_frame(self) -> Frame:
        camera = self.scene.robot.T_world_base @ self.robot.link_poses(self.q)["camera"]

        def away(frame: Frame) -> float:
            """In metres, a metre for a radian."""
            other = frame.T_world_camera
            turned = np.arccos(np.clip(other[:3, 2] @ camera[:3, 2], -1, 1))
            return float(np.linalg.norm(other[:3, 3] - camera[:3, 3]) + turned)

        return min(self.frames, key=away)

    def execute(self, motions: Sequence[Motion]) -> Stopped | None:
        for number, motion in enumerate(motions):
            if motion.held is not None and motion.held.body != self.scene.target:
                return Stopped(number, f"the recording shows nothing of {motion.held.body} being moved")
            self.q = motion.q[-1]
        return None

    def where(self) -> Mapping[str, float]:
        return dict(zip(self.robot.joint_names, map(float, self.q)))


def world(scene: Scene, robot: Robot) -> RecordedWorld:
    """The folder that $VIEWS names, in the BOP layout."""
    return RecordedWorld(robot, scene, read_frames(Path(os.environ["VIEWS"])))
