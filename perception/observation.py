"""Observation: what a planner knows of a scene. Objects as boxes, floor cells with a flag, as in the paper (section III-A)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from kinematics.scene import Cabinet, Grasp, Scene, State, object_box
from kinematics.transforms import Array


@dataclass(frozen=True, eq=False)
class Observation:
    """The planner's picture of one moment.

    robot_base: l_r (3,), world frame. cabinet: its size and place are known beforehand. q (J,): the robot's configuration.
    grasp: x_g. target: its name. approaches: how objects may be grasped to be moved (kinematics.scene.APPROACHES).
    boxes: name to the paper's object state (6,): centre and size of the tightest axis-aligned box, world frame; the target's too.
    regions (n², 4): x, y, z of each floor cell's centre in the world, and 1 where the cell was observed, 0 where not.
    """

    robot_base: Array
    cabinet: Cabinet
    q: Array
    grasp: Grasp
    target: str
    approaches: tuple[str, ...]
    boxes: Mapping[str, Array]
    regions: Array

    @property
    def movable(self) -> tuple[str, ...]:
        """The non-target objects' names, in the scene's order."""
        return tuple(name for name in self.boxes if name != self.target)


def boxes_in(T: Array, boxes: Array) -> Array:
    """Boxes (N, 6), centre and size along the axes of one frame, as boxes along those of another; T (4, 4) leads from one to the other."""
    return np.concatenate([boxes[:, :3] @ T[:3, :3].T + T[:3, 3], boxes[:, 3:] @ np.abs(T[:3, :3]).T], 1)


def observe(scene: Scene, state: State) -> Observation:
    """The observation of a scene whose objects are known: their boxes; every region observed, but for those that a recording left out."""
    regions = scene.regions()
    flags = np.ones(len(regions))
    if is_seen(scene) and scene.observation is not None:
        flags = np.array(scene.observation["regions"], float).reshape(-1, 4)[:, 3]
    return Observation(
        scene.robot.T_world_base[:3, 3],
        scene.cabinet,
        state.q,
        scene.x_g,
        scene.target_name,
        scene.approaches,
        {b.name: object_box(b) for b in state.bodies(scene)},
        np.column_stack([regions, flags]),
    )


def is_seen(scene: Scene) -> bool:
    """Whether a scene is what cameras saw, and nothing else is known of it."""
    return scene.observation is not None and all(b.source == "seen" for b in scene.objects)
