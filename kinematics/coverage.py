"""A robot's arm with its sphere covers: links, fingers at any opening, and what the hand holds; and what the covers alone prove free."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.arm import Int, Query, make_solids
from kinematics.lanes import FREE, configs_free, lane_scratch, lane_world, model_of
from kinematics.rig import Pieces, Rig, carry, join_rigs, make_pieces
from kinematics.robot import Robot
from kinematics.scene import Held, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, convex_parts
from kinematics.spheres import Levels, box_levels, cylinder_levels, levels
from kinematics.transforms import Array
from kinematics.tree import carried

OPENINGS = 64  # gripper values for which the rig is kept


@lru_cache(maxsize=16)
def link_covers(robot: Robot) -> tuple[Levels, ...]:
    """The covers of a robot's link hulls, in the links' frames; computed once and cached on disk."""
    return tuple(levels(hull.vertices) for hull in robot.hulls)


def shape_covers(shape: Shape) -> tuple[Levels, ...]:
    """Covers of a shape's convex parts, in its own frame."""
    match shape:
        case Box():
            return (box_levels((float(shape.size_m[0]), float(shape.size_m[1]), float(shape.size_m[2]))),)
        case Cylinder():
            return (cylinder_levels(shape.radius_m, shape.height_m),)
        case ConvexMesh():
            return tuple(levels(part) for part in shape.parts)


def shape_pieces(shape: Shape) -> Pieces:
    """A shape's convex parts and their covers, ready to be taken in the hand."""
    return make_pieces(convex_parts(shape), shape_covers(shape))


class Carriage:
    """A robot that stands somewhere, as rigs: its links with the fingers at any opening, and with any object in the hand."""

    def __init__(self, robot: Robot, T_world_base: Array) -> None:
        self.robot, self.T_world_base = robot, T_world_base
        self.chain = robot.chain(T_world_base)
        self.links = tuple(hull.link for hull in robot.hulls)
        self.pieces = make_pieces([hull.vertices for hull in robot.hulls], link_covers(robot))
        self._carriers = robot.carriers(T_world_base)
        self._link = np.array([robot.tree.index[link] for link in self.links])
        frames, T = self._carried(float(robot.home[robot.gripper_joint]))
        hand = robot.tree.index["hand"]
        self.hand_frame, self.T_frame_hand = int(frames[hand]), T[hand].copy()
        self.rig = lru_cache(maxsize=OPENINGS)(self._rig)

    def _carried(self, gripper: float) -> tuple[Int, Array]:
        q = self.robot.with_arm(np.zeros(len(self.robot.arm_joints)), gripper)
        return carried(self.robot.tree.joints, q, *self._carriers)

    def _rig(self, gripper: float) -> Rig:
        """The link hulls with the fingers at a gripper value; the link behind each is in `links`."""
        frames, T = self._carried(gripper)
        return carry(self.chain, self.pieces, frames[self._link], T[self._link])

    def in_hand(self, pieces: Pieces, T_hand_body: Array) -> Rig:
        """A held object, alone."""
        n = len(pieces.start) - 1
        return carry(self.chain, pieces, np.full(n, self.hand_frame), np.tile(self.T_frame_hand @ T_hand_body, (n, 1, 1)))


def carriage(robot: Robot, T_world_base: Array) -> Carriage:
    """The robot standing at T_world_base (4, 4), made once."""
    return _carriage(robot, T_world_base.tobytes())


@lru_cache(maxsize=8)
def _carriage(robot: Robot, base: bytes) -> Carriage:
    return Carriage(robot, np.frombuffer(base).reshape(4, 4))


class Sieve:
    """Which configurations of a scene's robot the covers prove free, so that FCL need not be asked about them."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self.robot, self.scene = robot, scene
        self.carriage = carriage(robot, scene.robot.T_world_base)

    def undecided(self, q: Array, poses: Mapping[str, Array], held: Held | None, may_touch: Iterable[tuple[str, str]]) -> NDArray[np.bool_]:
        """Where (N,) among configurations q (N, J) something may touch, besides the pairs in may_touch; the rest is free for certain.

        The first row is always undecided: pairs that stand still to each other, such as the palm and a held object, are left to it, and so
        is every row in which the fingers have moved.
        """
        gripper = q[:, self.robot.gripper_joint]
        still = gripper == gripper[0]
        rig, names = self.carriage.rig(float(gripper[0])), self.carriage.links
        if held is not None:
            grip = self.carriage.in_hand(shape_pieces(self.scene.body(held.body).shape), held.T_hand_body)
            rig, names = join_rigs(rig, grip), names + (held.body,) * len(grip.frame)
        standing = [replace(self.scene.body(name), T_world_body=T) for name, T in poses.items()]
        solids, bodies = make_solids([*self.scene.cabinet.walls(), *standing])
        allowed = {frozenset(pair) for pair in may_touch}
        check = np.array([[f > 0 and frozenset((a, b)) not in allowed for b in bodies] for a, f in zip(names, rig.frame)], np.uint8)
        own = len(self.robot.hulls)
        pairs = [*self.robot.self_pairs(), *((h, i) for h in range(own, len(names)) for i in range(own))]
        moving = [(a, b) for a, b in pairs if rig.frame[a] != rig.frame[b] and frozenset((names[a], names[b])) not in allowed]
        model = model_of(self.carriage.chain, rig)
        world = lane_world(solids, Query(check, np.array(moving, np.int64).reshape(-1, 2)))
        free = configs_free(model, world, np.ascontiguousarray(self.robot.arm_q(q)), lane_scratch(model, world)) == FREE
        free[0] = False
        return np.asarray(~(free & still))
