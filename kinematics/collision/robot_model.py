"""A robot's arm with its sphere covers: links, fingers at any opening, and what the hand holds; and what the covers alone prove free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from kinematics.bounded_cache import evict_oldest
from kinematics.chain import Int
from kinematics.collision.covers.levels import Levels, box_levels, cylinder_levels, levels
from kinematics.collision.posed_geometry import (
    GeometryModel,
    PosedGeometry,
    make_geometry_model,
    pose_geometry,
    pose_others,
    several_times,
    with_covers,
)
from kinematics.collision.sphere_model import SphereModel, posed_sphere_model
from kinematics.robots.robot import Robot
from kinematics.robots.tree import carried
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, convex_parts
from kinematics.transforms import Array

ROBOTS = 16  # whose covers are kept in memory
OPENINGS = 128  # gripper values for which the posed geometry is kept: some five for each width in a scene


_covered: dict[Robot, tuple[Levels, ...]] = {}


def link_covers(robot: Robot, on_step: Callable[[str], None] | None = None) -> tuple[Levels, ...]:
    """The covers of a robot's link hulls, in the links' frames; computed once and cached on disk. on_step is told when that begins: a robot
    of one's own takes seconds."""

    def begins(_: str) -> None:
        if on_step is not None and not told:
            told.append(f"covering the {len(robot.hulls)} convex parts of {Path(robot.name).stem} with balls")
            on_step(told[0])

    told: list[str] = []
    if robot not in _covered:
        covers = tuple(levels(hull.vertices, on_step=begins) for hull in robot.hulls)
        evict_oldest(_covered, ROBOTS)
        _covered[robot] = covers
    return _covered[robot]


@lru_cache(maxsize=ROBOTS)
def _link_pieces(robot: Robot) -> GeometryModel:
    """The link hulls and their covers, wherever the robot stands."""
    return make_geometry_model([hull.vertices for hull in robot.hulls], link_covers(robot))


@lru_cache(maxsize=64)  # a plan's fingers stand at five to thirty openings
def _finger_pieces(robot: Robot, times: int, covered: bool) -> GeometryModel:
    """The hulls that move with the gripper's joint, so many times: each time they may stand elsewhere."""
    if times != 1:
        return several_times(_finger_pieces(robot, 1, covered), times)
    own = [i for i, hull in enumerate(robot.hulls) if hull.link in robot.fingers]
    return make_geometry_model([robot.hulls[i].vertices for i in own], [link_covers(robot)[i] for i in own] if covered else [])


def shape_covers(shape: Shape) -> tuple[Levels, ...]:
    """Covers of a shape's convex parts, in its own frame."""
    match shape:
        case Box():
            return (box_levels((float(shape.size_m[0]), float(shape.size_m[1]), float(shape.size_m[2]))),)
        case Cylinder():
            return (cylinder_levels(shape.radius_m, shape.height_m),)
        case ConvexMesh():
            return tuple(levels(part) for part in shape.parts)


@lru_cache(maxsize=256)
def bare_geometry(shape: Shape) -> GeometryModel:
    """A shape's convex parts without their covers, which take longest to make: for the exact test alone, or for the vertices."""
    return make_geometry_model(convex_parts(shape))


@lru_cache(maxsize=256)
def shape_geometry(shape: Shape) -> GeometryModel:
    """A shape's convex parts and their covers, ready to be taken in the hand."""
    return with_covers(bare_geometry(shape), shape_covers(shape))


class RobotCollisionModel:
    """A robot that stands somewhere, as rigs: its links with the fingers at any opening, and with any object in the hand."""

    def __init__(self, robot: Robot, T_world_base: Array) -> None:
        self.robot, self.T_world_base = robot, T_world_base
        self.chain = robot.chain(T_world_base)
        self.links = tuple(hull.link for hull in robot.hulls)
        self.pieces = _link_pieces(robot)
        self._carriers = robot.carriers(T_world_base)
        self._link = np.array([robot.tree.index[link] for link in self.links])
        frames, T = self._carried(float(robot.home[robot.gripper_joint]))
        hand = robot.tree.index["hand"]
        self.hand_frame, self.T_frame_hand = int(frames[hand]), T[hand].copy()
        self.fingers: Int = np.flatnonzero(np.isin(self.links, sorted(robot.fingers)))  # nothing else moves with the gripper's joint
        self._home: PosedGeometry | None = None
        self._model: SphereModel | None = None
        self._posed: dict[float, PosedGeometry] = {}
        self._packed: dict[float, tuple[PosedGeometry, SphereModel]] = {}

    def _carried(self, gripper: float) -> tuple[Int, Array]:
        q = self.robot.with_arm(np.zeros(len(self.robot.arm_joints)), gripper)
        return carried(self.robot.tree.joints, q, *self._carriers)

    def posed(self, gripper: float) -> PosedGeometry:
        """The link hulls with the fingers at a gripper value; the link behind each is in `links`."""
        known = self._posed
        if gripper not in known:
            evict_oldest(known, OPENINGS)
            frames, T = self._carried(gripper)
            if self._home is None:
                self._home = pose_geometry(self.chain, self.pieces, frames[self._link], T[self._link])
            known[gripper] = pose_others(self.chain, self.pieces, self._home, self.fingers, T[self._link])
        return known[gripper]

    def packed(self, gripper: float) -> tuple[PosedGeometry, SphereModel]:
        """The same, and packed for the sphere check."""
        known = self._packed
        if gripper not in known:
            evict_oldest(known, OPENINGS)
            posed = self.posed(gripper)
            if self._model is None:
                self._model = posed_sphere_model(self.chain, posed)
            known[gripper] = posed, posed_sphere_model(self.chain, posed, self._model, self.fingers)
        return known[gripper]

    def posed_fingers(self, openings: Sequence[float], *, covered: bool = True) -> PosedGeometry:
        """The fingers alone, at each of some gripper values, one after the other. covered: with their covers."""
        frames, T = zip(*(self._carried(gripper) for gripper in openings), strict=True)
        own, pieces = self._link[self.fingers], _finger_pieces(self.robot, len(openings), covered)
        return pose_geometry(self.chain, pieces, np.concatenate([f[own] for f in frames]), np.concatenate([t[own] for t in T]))

    def in_hand(self, pieces: GeometryModel, T_hand_body: Array) -> PosedGeometry:
        """A held object, alone."""
        n = len(pieces.start) - 1
        return pose_geometry(self.chain, pieces, np.full(n, self.hand_frame), np.tile(self.T_frame_hand @ T_hand_body, (n, 1, 1)))


def robot_collision_model(robot: Robot, T_world_base: Array) -> RobotCollisionModel:
    """The robot standing at T_world_base (4, 4), made once."""
    return _robot_collision_model(robot, T_world_base.tobytes())


@lru_cache(maxsize=8)
def _robot_collision_model(robot: Robot, base: bytes) -> RobotCollisionModel:
    return RobotCollisionModel(robot, np.frombuffer(base).reshape(4, 4))
