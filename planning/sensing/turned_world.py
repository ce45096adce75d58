"""A world whose cabinet leans, for a loop that sees it upright: all of it is turned, the robot along with it (`planning.upright`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from kinematics.transforms import Array
from perception.frames import Frame
from planning.plan import Motion
from planning.sensing.world import Stopped, World


class TurnedWorld:
    """A world turned by T (4, 4). Only where its camera stands is told in the world; motions and joints are the robot's."""

    def __init__(self, world: World, T: Array) -> None:
        self._world, self._T = world, T
        if (intrinsics := getattr(world, "intrinsics", None)) is not None:
            self.intrinsics = intrinsics

    def take_frame(self) -> Frame:
        """The world's frame, its camera turned along."""
        frame = self._world.take_frame()
        return replace(frame, T_world_camera=self._T @ frame.T_world_camera)

    def execute(self, motions: Sequence[Motion]) -> Stopped | None:
        """As the world does."""
        return self._world.execute(motions)

    def where(self) -> Mapping[str, float]:
        """As the world says."""
        return self._world.where()
