"""The words that all stages share: Cabinet, Body, Grasp, Scene (the truth), Held and State (one moment).

A scene may be incomplete: without a target, a grasp or any object yet. Who needs them asks `Scene.target_name`, `Scene.x_g` and
`Scene.target_body`, which say what is missing and which command finds it.

World frame: z up, metres. Cabinet frame: origin in the middle of the front edge of the inner floor, x into the cabinet, y to the left,
z up. Hand frame: origin between the finger pads, z along the approach, y the way the fingers close.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from kinematics.errors import InputError, did_you_mean
from kinematics.shapes import Box, Shape, bounds
from kinematics.transforms import Array, inverse, transform

WALLS = ("floor", "ceiling", "left", "right", "back")
APPROACHES = ("horizontal", "diagonal", "downward")


@dataclass(frozen=True, eq=False)
class Body:
    """A named solid and where it is: T_world_body (4, 4).

    max_tilt_deg: how far it may be tilted while it is carried, None where the plan's own limit holds. source: whether someone said where it
    is, or a camera saw it. sides_m: of what was seen, from which to which height above its bottom its sides are where the shape has them;
    None: all the way up. mass_kg: None where it is not known.
    """

    name: str
    shape: Shape
    T_world_body: Array
    max_tilt_deg: float | None = None
    source: Literal["given", "seen"] = "given"
    sides_m: tuple[float, float] | None = None
    mass_kg: float | None = None


@dataclass(frozen=True, eq=False)
class Cabinet:
    """A box that is open at the front (-x). size_m (3,): inner depth, width, height; wall_m: thickness of the five walls."""

    size_m: Array
    T_world_cabinet: Array
    wall_m: float

    @property
    def lean_deg(self) -> float:
        """By how much its z leans from the world's."""
        return float(np.degrees(np.arccos(np.clip(self.T_world_cabinet[2, 2], -1.0, 1.0))))

    def walls(self) -> tuple[Body, ...]:
        """The five walls as boxes: floor, ceiling, left, right, back. Floor and ceiling reach under and over the others."""
        return self._walls

    @cached_property
    def _walls(self) -> tuple[Body, ...]:
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
        """Centres (n², 3) of the n × n floor cells in the world frame, to be read.

        Cell i is row i // n from the front, column i % n from the right.
        """
        return _regions(self, n)


@lru_cache(maxsize=64)
def _regions(cabinet: Cabinet, n: int) -> Array:
    dx, dy, _ = cabinet.size_m
    x = (np.arange(n) + 0.5) / n * dx
    y = (np.arange(n) + 0.5) / n * dy - dy / 2
    cells = np.stack([np.repeat(x, n), np.tile(y, n), np.zeros(n * n)], -1)
    centres = np.asarray(cells @ cabinet.T_world_cabinet[:3, :3].T + cabinet.T_world_cabinet[:3, 3])
    centres.flags.writeable = False
    return centres


@dataclass(frozen=True, eq=False)
class Grasp:
    """x_g: T_world_hand (4, 4), and width_m between the pads when they touch the object."""

    T_world_hand: Array
    width_m: float


@dataclass(frozen=True, eq=False)
class Settlement:
    """An object that was moved a little before anything was planned, for its pose can't have been meant to the millimetre.

    by_m (3,): how far, world frame; reason: why, in words: "it stood 1.5 mm in the floor".
    """

    object: str
    by_m: Array
    reason: str

    def __str__(self) -> str:
        return f"{self.object} was moved by {1000 * float(np.linalg.norm(self.by_m)):.1f} mm: {self.reason}"


@dataclass(frozen=True, eq=False)
class RobotRef:
    """Which robot a scene means: a named one, or a URDF file with its hand frame and gripper joint; and where its base stands.

    q_start: where its joints are now, by name; those that are left out are at home, and without it all are. home: where it waits, by
    joint name; those that are left out are where the robot's description has them. T_link_hand (4, 4): the hand frame in the link that
    `hand_frame` names (of a named robot: in its own hand frame). gripper_joints: all joints that move fingers, where one is not enough.
    mount: whether the arm stands on a surface through the base's origin, which it must not dip under; None leaves that to the command.
    payload_kg: what it may lift besides its gripper; None where nobody says.
    """

    T_world_base: Array
    name: str | None = None
    urdf: str | None = None
    hand_frame: str | None = None
    gripper_joint: str | None = None
    q_start: Mapping[str, float] | None = None
    home: Mapping[str, float] | None = None
    T_link_hand: Array | None = None
    gripper_joints: tuple[str, ...] = ()
    mount: bool | None = None
    payload_kg: float | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """The truth about one problem: objects in a cabinet, which of them is wanted, and the grasp x_g that takes it out.

    target: its name, None while it is not known; target_box (6,): where it is then, centre and size along the world's axes.
    grasps: others than x_g that take the target out, the best first, each with its score. obstacles: what stands still and is never to be
    touched. approaches: how objects may be grasped to be moved, a part of `APPROACHES`.
    observation: what a sensed scene carries beside the truth (see perception), None otherwise.
    settled: which objects were moved when the scene was read, to stand free of each other and on the floor; no part of the file.
    """

    id: str
    robot: RobotRef
    cabinet: Cabinet
    objects: tuple[Body, ...]
    target: str | None
    grasp: Grasp | None
    regions_n: int = 10
    approaches: tuple[str, ...] = APPROACHES
    seed: tuple[int, ...] = ()
    observation: Mapping[str, object] | None = None
    obstacles: tuple[Body, ...] = ()
    grasps: tuple[tuple[Grasp, float], ...] = ()
    target_box: Array | None = None
    settled: tuple[Settlement, ...] = ()

    @property
    def target_name(self) -> str:
        """The target's name. Raises InputError when the scene has none."""
        if self.target is None:
            raise InputError(f"scene {self.id} has no target: name one of its objects as `target`, or sense it with --target-box")
        return self.target

    @property
    def target_body(self) -> Body:
        """The target. Raises InputError when the scene has none, or it is not among the objects."""
        names = [b.name for b in self.objects]
        if self.target_name not in names:
            among = f"its objects ({', '.join(names)})" if names else "its objects: it has none yet; look for it with retrieve sense"
            raise InputError(f"scene {self.id}: the target {self.target!r} is not among {among}{did_you_mean(self.target_name, names)}")
        return self.body(self.target_name)

    @property
    def x_g(self) -> Grasp:
        """The grasp that takes the target out. Raises InputError when the scene has none."""
        if self.grasp is None:
            how = "retrieve grasp proposes one, or takes one from a file; plan --grasp any needs none"
            raise InputError(f"scene {self.id} has no grasp for its target: {how}")
        return self.grasp

    def fixtures(self) -> tuple[Body, ...]:
        """All that stands still whatever the arm does: the cabinet's walls, then the obstacles."""
        return (*self.cabinet.walls(), *self.obstacles)

    def body(self, name: str) -> Body:
        """The object called `name`. Raises KeyError."""
        for b in self.objects:
            if b.name == name:
                return b
        raise KeyError(name)

    def too_heavy(self, name: str) -> str | None:
        """In words, that an object weighs more than the robot may lift; None where it doesn't, or it is not known."""
        payload = self.robot.payload_kg
        mass = None if payload is None else self.body(name).mass_kg
        if mass is None or payload is None or mass <= payload:
            return None
        return f"{name} weighs {mass:g} kg, and the robot's payload is {payload:g} kg"

    @property
    def random_word(self) -> int:
        """A number (63 bits) for the seeds of random generators, from the scene's own id and seed alone: what is drawn for a scene does not
        depend on which scenes come before it, nor on who draws."""
        words = json.dumps([self.id, [int(s) for s in self.seed]]).encode()
        return int.from_bytes(hashlib.sha256(words).digest()[:8], "little") >> 1

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
