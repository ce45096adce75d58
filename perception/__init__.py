"""What is known: cameras, depth images, maps, and the objects and regions seen in them."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from perception.belief import Belief, believe
    from perception.camera import DepthNoise, Intrinsics
    from perception.frames import Frame, read_frames, write_frames
    from perception.mapping.voxels import Voxels
    from perception.observation import Observation, observe

__all__ = [
    "Belief",
    "DepthNoise",
    "Frame",
    "Intrinsics",
    "Observation",
    "Voxels",
    "believe",
    "observe",
    "read_frames",
    "write_frames",
]

_WHERE = {
    "Belief": "perception.belief",
    "DepthNoise": "perception.camera",
    "Frame": "perception.frames",
    "Intrinsics": "perception.camera",
    "Observation": "perception.observation",
    "Voxels": "perception.mapping.voxels",
    "believe": "perception.belief",
    "observe": "perception.observation",
    "read_frames": "perception.frames",
    "write_frames": "perception.frames",
}


def __getattr__(name: str) -> object:
    """What `__all__` offers is imported when it is first asked for, so that importing the package costs nothing."""
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
