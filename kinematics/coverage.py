"""A robot's arm with its sphere covers: links, fingers at any opening, and what the hand holds; and what the covers alone prove free."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.arm import Int, Query, Solids, make_solids, stand
from kinematics.lane_model import LaneModel, lane_world, model_of
from kinematics.lanes import lane_scratch, open_pairs
from kinematics.rig import Pieces, Rig, carry, join_rigs, make_pieces
from kinematics.robot import Robot
from kinematics.scene import Held, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, convex_parts
from kinematics.spheres import Levels, box_levels, cylinder_levels, levels
from kinematics.transforms import Array
from kinematics.tree import carried

OPENINGS = 128  # gripper values for which the rig is kept: some five for each width in a scene


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


@lru_cache(maxsize=256)
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
        self._rigs: dict[float, tuple[Rig, LaneModel]] = {}

    def _carried(self, gripper: float) -> tuple[Int, Array]:
        q = self.robot.with_arm(np.zeros(len(self.robot.arm_joints)), gripper)
        return carried(self.robot.tree.joints, q, *self._carriers)

    def rig(self, gripper: float) -> Rig:
        """The link hulls with the fingers at a gripper value; the link behind each is in `links`."""
        return self.packed(gripper)[0]

    def packed(self, gripper: float) -> tuple[Rig, LaneModel]:
        """The same, and packed for the lanes."""
        known = self._rigs
        if gripper not in known:
            if len(known) == OPENINGS:
                known.pop(next(iter(known)))  # the oldest
            frames, T = self._carried(gripper)
            rig = carry(self.chain, self.pieces, frames[self._link], T[self._link])
            known[gripper] = rig, model_of(self.chain, rig)
        return known[gripper]

    def rig_of(self, which: Int, pieces: Pieces, gripper: float) -> Rig:
        """Some of the link hulls alone, which (n,) of them, given as pieces, with the fingers at a gripper value."""
        frames, T = self._carried(gripper)
        return carry(self.chain, pieces, frames[self._link[which]], T[self._link[which]])

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


@dataclass(frozen=True, eq=False)
class Judged:
    """What the covers say about pairs of solids along a motion.

    names: of the solids: P parts (link hulls in the robot's order, then the pieces of a held object), then what stands (walls, objects).
    judged (P, P + B): pairs that the covers were asked about, the later of two parts first. At configuration rows[i], in rising order, the
    judged pair a[i], b[i] may touch; wherever a judged pair is not listed it is apart for certain.
    """

    names: tuple[str, ...]
    judged: NDArray[np.bool_]
    rows: Int
    a: Int
    b: Int


class Sieve:
    """Which pairs of a scene's robot, held object and bodies the covers prove apart, so that FCL need not be asked about them."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self.robot, self.scene = robot, scene
        self.carriage = carriage(robot, scene.robot.T_world_base)
        walls = scene.cabinet.walls()
        self._stock, owners = make_solids([*walls, *scene.objects])
        self._owners, self._walls = tuple(owners), [(i, w.T_world_body) for i, w in enumerate(walls)]
        self._of = {b.name: [i for i, owner in enumerate(owners) if owner == b.name and i >= len(walls)] for b in scene.objects}
        self._pieces = lru_cache(maxsize=None)(lambda name: shape_pieces(scene.body(name).shape))
        self._pairs = _self_pairs(robot)
        self._fingers = np.isin(self.carriage.links, sorted(robot.fingers))
        self._last: tuple[object, tuple[Rig, LaneModel, tuple[str, ...]]] | None = None

    def judge(self, q: Array, poses: Mapping[str, Array], held: Held | None, may_touch: Iterable[tuple[str, str]]) -> Judged:
        """Ask the covers about configurations q (N, J), N > 0, with objects standing at poses, besides the pairs in may_touch.

        Not judged, but left to FCL: pairs on one frame of the arm, such as the palm and a held object; the fingers when they move; and
        everything when a joint that is neither the arm's nor the gripper's is not at home.
        """
        gripper = float(q[0, self.robot.gripper_joint])
        rig, model, links = self._moving(gripper, held)
        own = len(self.carriage.links)
        solids, bodies = self._standing(poses)
        P, names = len(links), links + bodies
        judge = np.zeros((P, len(names)), np.bool_)
        judge[:, P:] = (rig.frame > 0)[:, None]
        judge[self._pairs[:, 0], self._pairs[:, 1]] = True
        judge[own:, :own] = True
        judge[:, :P] &= rig.frame[:, None] != rig.frame
        for pair in may_touch:
            first, second = (np.array([n == name for n in names]) for name in pair)
            judge[first[:P, None] & second | second[:P, None] & first] = False
        if (q[:, self.robot.gripper_joint] != gripper).any():
            judge[:own][self._fingers] = False
            judge[:, :own][:, self._fingers] = False
        if self._elsewhere(q):
            judge[:] = False
        pairs = np.argwhere(judge[:, :P])
        world = lane_world(solids, Query(judge[:, P:].astype(np.uint8), pairs))
        rows, which = open_pairs(model, world, np.ascontiguousarray(self.robot.arm_q(q)), lane_scratch(model, world))
        B = len(bodies)
        against = which < P * B  # else part against part
        a, b = which // max(B, 1), P + which % max(B, 1)
        a[~against], b[~against] = pairs[which[~against] - P * B].T
        return Judged(names, judge, rows, a, b)

    def _moving(self, gripper: float, held: Held | None) -> tuple[Rig, LaneModel, tuple[str, ...]]:
        """What moves with the arm, packed, and the name behind each part; kept while the hand holds on to the same."""
        grip = None if held is None else (held.body, held.T_hand_body.tobytes())
        if self._last is None or self._last[0] != (gripper, grip):
            (rig, model), links = self.carriage.packed(gripper), self.carriage.links
            if held is not None:
                own = self.carriage.in_hand(self._pieces(held.body), held.T_hand_body)
                rig, links = join_rigs(rig, own), links + (held.body,) * len(own.frame)
                model = model_of(self.carriage.chain, rig)
            self._last = (gripper, grip), (rig, model, links)
        return self._last[1]

    def _standing(self, poses: Mapping[str, Array]) -> tuple[Solids, tuple[str, ...]]:
        """The walls and the objects at poses, packed; and the name behind each solid."""
        at = self._walls + [(i, T) for name, T in poses.items() for i in self._of[name]]
        solids = stand(self._stock, np.array([i for i, _ in at], np.int64), np.array([T for _, T in at]))
        return solids, tuple(self._owners[i] for i, _ in at)

    def _elsewhere(self, q: Array) -> bool:
        """Whether a joint that the carriage takes to be at home is not."""
        others = np.ones(q.shape[1], np.bool_)
        others[[*self.robot.arm_joints, self.robot.gripper_joint]] = False
        return bool((q[:, others] != self.robot.home[others]).any())


@lru_cache(maxsize=16)
def _self_pairs(robot: Robot) -> Int:
    return robot.self_pairs()
