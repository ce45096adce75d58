"""The words that all stages share: Cabinet, Body, Grasp, Scene (the truth), Held and State (one moment).

World frame: z up, metres. Cabinet frame: origin in the middle of the front edge of the inner floor, x into the cabinet, y to the left,
z up. Hand frame: origin between the finger pads, z along the approach, y the way the fingers close.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from kinematics.shapes import Box, Shape, bounds
from kinematics.transforms import Array, inverse, transform

WALLS = ("floor", "ceiling", "left", "right", "back")
APPROACHES = ("horizontal", "diagonal", "downward")


@dataclass(frozen=True, eq=False)
class Body:
    """A named solid and where it is: T_world_body (4, 4)."""

    name: str
    shape: Shape
    T_world_body: Array


@dataclass(frozen=True, eq=False)
class Cabinet:
    """A box that is open at the front (-x). size_m (3,): inner depth, width, height; wall_m: thickness of the five walls."""

    size_m: Array
    T_world_cabinet: Array
    wall_m: float

    def walls(self) -> tuple[Body, ...]:
        """The five walls as boxes: floor, ceiling, left, right, back. Floor and ceiling reach under and over the others."""
        (dx, dy, dz), w = self.size_m, self.wall_m
        boxes = {
            "floor": ([dx + w, dy + 2 * w, w], [(dx + w) / 2, 0, -w / 2]),
            "ceiling": ([dx + w, dy + 2 * w, w], [(dx + w) / 2, 0, dz + w / 2]),
            "left": ([dx + w, w, dz], [(dx + w) / 2, (dy + w) / 2, dz / 2]),
            "right": ([dx + w, w, dz], [(dx + w) / 2, -(dy + w) / 2, dz / 2]),
            "back": ([w, dy, dz], [dx + w / 2, 0, dz / 2]),
        }
        return tuple(Body(n, Box(np.array(size)), self.T_world_cabinet @ transform(p=centre)) for n, (size, centre) in boxes.items())

    def contains(self, p_world: Array) -> bool:
        """Whether a point (3,) lies in the inner space."""
        p = inverse(self.T_world_cabinet) @ np.append(p_world, 1.0)
        return bool(0 <= p[0] <= self.size_m[0] and abs(p[1]) <= self.size_m[1] / 2 and 0 <= p[2] <= self.size_m[2])

    def regions(self, n: int) -> Array:
        """Centres (n², 3) of the n × n floor cells in the world frame; cell i is row i // n from the front, column i % n from the right."""
        dx, dy, _ = self.size_m
        x = (np.arange(n) + 0.5) / n * dx
        y = (np.arange(n) + 0.5) / n * dy - dy / 2
        cells = np.stack([np.repeat(x, n), np.tile(y, n), np.zeros(n * n)], -1)
        return np.asarray(cells @ self.T_world_cabinet[:3, :3].T + self.T_world_cabinet[:3, 3])


@dataclass(frozen=True, eq=False)
class Grasp:
    """x_g: T_world_hand (4, 4), and width_m between the pads when they touch the object."""

    T_world_hand: Array
    width_m: float


@dataclass(frozen=True, eq=False)
class RobotRef:
    """Which robot a scene means: a named one, or a URDF file with its hand frame and gripper joint; and where its base stands."""

    T_world_base: Array
    name: str | None = None
    urdf: str | None = None
    hand_frame: str | None = None
    gripper_joint: str | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """The truth about one problem: objects in a cabinet, which of them is wanted, and the grasp x_g that takes it out.

    approaches: how objects may be grasped to be moved, a part of `APPROACHES`.
    observation: what a sensed scene carries beside the truth (see perception), None otherwise.
    """

    id: str
    robot: RobotRef
    cabinet: Cabinet
    objects: tuple[Body, ...]
    target: str
    grasp: Grasp
    regions_n: int = 10
    approaches: tuple[str, ...] = APPROACHES
    seed: tuple[int, ...] = ()
    observation: Mapping[str, object] | None = None

    def body(self, name: str) -> Body:
        """The object called `name`. Raises KeyError."""
        for b in self.objects:
            if b.name == name:
                return b
        raise KeyError(name)

    def poses(self) -> dict[str, Array]:
        """The objects' poses T_world_object at the beginning, by name."""
        return {b.name: b.T_world_body for b in self.objects}

    def regions(self) -> Array:
        """Centres (n², 3) of the floor regions, world frame."""
        return self.cabinet.regions(self.regions_n)


@dataclass(frozen=True, eq=False)
class Held:
    """An object in the hand: its name and T_hand_body (4, 4)."""

    body: str
    T_hand_body: Array


@dataclass(frozen=True, eq=False)
class State:
    """One moment of a scene: q (J,) of every actuated joint, poses of the objects that stand, and what the hand holds."""

    q: Array
    poses: Mapping[str, Array]
    held: Held | None = None

    def bodies(self, scene: Scene) -> tuple[Body, ...]:
        """The standing objects where they are now; the held one is not among them."""
        return tuple(replace(b, T_world_body=self.poses[b.name]) for b in scene.objects if b.name in self.poses)


def object_box(body: Body) -> Array:
    """The paper's state of an object: centre and size (6,) of its tightest axis-aligned box, world frame."""
    low, high = bounds(body.shape, body.T_world_body)
    return np.concatenate([(low + high) / 2, high - low])
