"""What is known: cameras, depth images, maps, and the objects and regions seen in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinematics.lazy_imports import lazily

if TYPE_CHECKING:
    from perception.belief import Belief, believe
    from perception.calibration import Calibration, read_calibration
    from perception.camera import DepthNoise, Intrinsics
    from perception.frames import Frame, read_frames, write_frames
    from perception.mapping.voxels import Voxels
    from perception.observation import Observation, observe

__all__ = [
    "Belief",
    "Calibration",
    "DepthNoise",
    "Frame",
    "Intrinsics",
    "Observation",
    "Voxels",
    "believe",
    "observe",
    "read_calibration",
    "read_frames",
    "write_frames",
]

_WHERE = {
    "Belief": "perception.belief",
    "Calibration": "perception.calibration",
    "DepthNoise": "perception.camera",
    "Frame": "perception.frames",
    "Intrinsics": "perception.camera",
    "Observation": "perception.observation",
    "Voxels": "perception.mapping.voxels",
    "believe": "perception.belief",
    "observe": "perception.observation",
    "read_calibration": "perception.calibration",
    "read_frames": "perception.frames",
    "write_frames": "perception.frames",
}

__getattr__ = lazily(__name__, _WHERE)
