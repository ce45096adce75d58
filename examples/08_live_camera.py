"""A real cell in the loop: a RealSense camera in the hand, and an arm.

    ARM_HOST=192.168.0.2 retrieve plan scenes.jsonl --sense --world examples/08_live_camera.py:world    (pip install pyrealsense2 ur_rtde)
    retrieve plan scenes.jsonl --sense --world examples/08_live_camera.py:rehearsal                     (a simulated cell, to try it out)

`world` returns an object with three methods: it takes a frame, carries motions out, and says where the arm is. The scene says where the
robot stands, how large the cabinet is and where, what is wanted (a name, or a target_box) and x_g; its objects may be [].
"""

from __future__ import annotations

import os
import runpy
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from kinematics.quintic_spline import evaluate
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from perception.camera import Intrinsics
from perception.frames import Frame
from planning import Motion
from planning.sensing.world import SimulatedWorld, Stopped, frame_from

PERIOD_S = 0.002
DEVIATION_RAD = 0.05  # beyond this, in any joint, the arm is stopped
FRAMES = 5  # depth images that one frame is the median of
ARMS = runpy.run_path(str(Path(__file__).parent / "06_execute.py"))


class RealSense:
    """A depth camera; pyrealsense2 is imported when one is asked for."""

    def __init__(self, width: int = 640, height: int = 360) -> None:
        import pyrealsense2 as rs

        self._pipeline, config = rs.pipeline(), rs.config()
        config.enable_stream(rs.stream.depth, width, height, rs.format.z16, 30)
        profile = self._pipeline.start(config)
        self._scale_m = profile.get_device().first_depth_sensor().get_depth_scale()
        of = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics()
        self.intrinsics = Intrinsics(of.width, of.height, of.fx, of.fy, of.ppx, of.ppy)

    def depth(self) -> np.ndarray:
        """Metres (H, W), 0 where nothing was measured."""
        images = [np.asanyarray(self._pipeline.wait_for_frames().get_depth_frame().get_data()) for _ in range(FRAMES)]
        return (np.median(images, axis=0) * self._scale_m).astype(np.float32)


class LiveCell:
    """An arm that is streamed to (see examples/06_execute.py), and a camera in its hand. The gripper is taken to be where it was told."""

    def __init__(self, robot: Robot, scene: Scene, camera: RealSense, arm: object) -> None:
        self.robot, self.base, self.camera, self.arm = robot, scene.robot.T_world_base, camera, arm
        self.intrinsics = camera.intrinsics
        self.gripper = float(robot.home[robot.gripper_joint])

    def take_frame(self) -> Frame:
        return frame_from(self.robot, self.base, self.where(), self.camera.depth(), self.intrinsics)

    def execute(self, motions: Sequence[Motion]) -> Stopped | None:
        for number, motion in enumerate(motions):
            if motion.gripper and motion.gripper.before != motion.gripper.after:
                self.arm.grip(motion.gripper.after.width_m, motion.gripper.after.force_N)
                self.gripper = motion.gripper.after.value
            t = np.append(np.arange(0.0, motion.t_s[-1], PERIOD_S), motion.t_s[-1])
            q, qd = (evaluate(motion.spline, t, order)[:, list(self.robot.arm_joints)] for order in (0, 1))
            for row, speed in zip(q, qd):
                self.arm.send(row, speed)
                off = float(np.abs(self.arm.read() - row).max())
                if off > DEVIATION_RAD:
                    return Stopped(number, f"the arm is {off:.3f} rad from its trajectory")
        return None

    def where(self) -> Mapping[str, float]:
        names = self.robot.joint_names
        joints = {names[i]: float(q) for i, q in zip(self.robot.arm_joints, self.arm.read())}
        return {**joints, names[self.robot.gripper_joint]: self.gripper}


def world(scene: Scene, robot: Robot) -> LiveCell:
    """A RealSense in the hand of a Universal Robots arm at $ARM_HOST."""
    return LiveCell(robot, scene, RealSense(), ARMS["RtdeArm"](os.environ["ARM_HOST"]))


def rehearsal(scene: Scene, robot: Robot) -> SimulatedWorld:
    """The scene's own objects, seen by a synthetic camera that does not tell them apart."""
    return SimulatedWorld(robot, scene, np.random.default_rng(0), by="geometry")
