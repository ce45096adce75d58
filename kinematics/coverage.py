"""A robot's arm with its sphere covers, packed for the lane kernel: links, fingers at any opening, and what the hand holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.arm import Chain, Parts, Query, join_parts, make_parts, make_solids
from kinematics.lanes import FREE, LaneModel, configs_free, lane_model, lane_scratch, lane_world
from kinematics.robot import Robot
from kinematics.scene import Held, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, convex_parts
from kinematics.spheres import Levels, box_levels, cylinder_levels, levels, moved
from kinematics.transforms import Array, apply


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


def lane_arm(
    robot: Robot, chain: Chain, T_world_base: Array, gripper: float, held: Held | None = None, shape: Shape | None = None
) -> tuple[LaneModel, Parts, tuple[str, ...]]:
    """The arm at a gripper value, with an object of some shape in the hand, for the lane kernel; its parts, and the name behind each."""
    parts, names, covers, frame, T_frame_hand = _links_at(robot, T_world_base.tobytes(), round(gripper, 9))
    if held is not None and shape is not None:
        T = T_frame_hand @ held.T_hand_body
        pieces = convex_parts(shape)
        parts = join_parts(parts, make_parts([frame] * len(pieces), [apply(T, piece) for piece in pieces]))
        covers += tuple(moved(cover, T) for cover in shape_covers(shape))
        names += (held.body,) * len(pieces)
    return lane_model(chain, parts, covers), parts, names


@lru_cache(maxsize=64)
def _links_at(robot: Robot, base: bytes, gripper: float) -> tuple[Parts, tuple[str, ...], tuple[Levels, ...], int, Array]:
    """Links with the fingers at a gripper value: parts, names, covers in the parts' frames; the hand's frame and its pose in it."""
    T_world_base = np.frombuffer(base).reshape(4, 4)
    parts, names = robot.parts(gripper, T_world_base)
    carried = robot.frame_of_links(gripper, T_world_base)
    covers = tuple(moved(cover, carried[link][1]) for link, cover in zip(names, link_covers(robot)))
    return parts, names, covers, *carried["hand"]


class Sieve:
    """Which configurations of a scene's robot the covers prove free, so that FCL need not be asked about them."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self.robot, self.scene = robot, scene
        self.chain = robot.chain(scene.robot.T_world_base)

    def undecided(self, q: Array, poses: Mapping[str, Array], held: Held | None, may_touch: Iterable[tuple[str, str]]) -> NDArray[np.bool_]:
        """Where (N,) among configurations q (N, J) something may touch, besides the pairs in may_touch; the rest is free for certain.

        The first row is always undecided: pairs that stand still to each other, such as the palm and a held object, are left to it, and so
        is every row in which the fingers have moved.
        """
        gripper = q[:, self.robot.gripper_joint]
        still = gripper == gripper[0]
        shape = self.scene.body(held.body).shape if held else None
        model, parts, names = lane_arm(self.robot, self.chain, self.scene.robot.T_world_base, float(gripper[0]), held, shape)
        standing = [replace(self.scene.body(name), T_world_body=T) for name, T in poses.items()]
        solids, bodies = make_solids([*self.scene.cabinet.walls(), *standing])
        allowed = {frozenset(pair) for pair in may_touch}
        check = np.array([[f > 0 and frozenset((a, b)) not in allowed for b in bodies] for a, f in zip(names, parts.frame)], np.uint8)
        own = len(self.robot.hulls)
        pairs = [*self.robot.self_pairs(), *((h, i) for h in range(own, len(names)) for i in range(own))]
        moving = [(a, b) for a, b in pairs if parts.frame[a] != parts.frame[b] and frozenset((names[a], names[b])) not in allowed]
        world = lane_world(solids, Query(check, np.array(moving, np.int64).reshape(-1, 2)))
        free = configs_free(model, world, np.ascontiguousarray(self.robot.arm_q(q)), lane_scratch(model, world)) == FREE
        free[0] = False
        return np.asarray(~(free & still))
