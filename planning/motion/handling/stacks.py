"""Which object stands on which: what carries another is not picked before that."""

from __future__ import annotations

from kinematics.scene import Scene, State, object_box
from perception.objects.settle import LOWEST_M, stands_on


class Stacks:
    """The stacks of one scene's objects, wherever they stand."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self._floor_z = scene, float(scene.cabinet.T_world_cabinet[2, 3])
        boxes = {b.name: object_box(b) for b in scene.objects}
        self._bottoms = {b.name: float(boxes[b.name][2] - boxes[b.name][5] / 2 - b.T_world_body[2, 3]) for b in scene.objects}
        """How far below its origin each object ends, as the scene has it."""

    def on(self, state: State, name: str) -> str | None:
        """An object that stands on another, None when nothing does."""
        least_z = self._floor_z + LOWEST_M
        off_floor = [n for n, T in state.poses.items() if n != name and T[2, 3] + self._bottoms[n] > least_z]
        if not off_floor or name not in state.poses:
            return None
        standing = {b.name: b for b in state.bodies(self.scene)}
        return next((n for n in off_floor if stands_on(standing[n], standing[name], self._floor_z)), None)
