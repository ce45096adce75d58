"""The broad phase of the final check: which pairs of solids the sphere covers prove apart along a motion, so that FCL need not be asked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision import edge_problem
from kinematics.collision.edge_problem import Problem, Scratch
from kinematics.collision.geometry import Query, Solids, place_solids, scene_solids
from kinematics.collision.posed_geometry import PosedGeometry, join_posed
from kinematics.collision.robot_model import robot_collision_model, shape_geometry
from kinematics.collision.sphere_batch import SphereScratch, scratch_for
from kinematics.collision.sphere_check import open_pairs
from kinematics.collision.sphere_model import SphereModel, SphereWorld, make_sphere_world, posed_sphere_model
from kinematics.doors import checked
from kinematics.mount import standing_still
from kinematics.robots.robot import Robot
from kinematics.scene import Held, Scene
from kinematics.transforms import Array

KEPT = 16  # sets of what moves, and of what stands: some for each object that a hand takes


@dataclass(frozen=True, eq=False)
class BroadPhaseResult:
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


def allow(pairs: NDArray[Any], names: Sequence[str], allowed_contacts: Iterable[tuple[str, str]]) -> None:
    """Take the allowed contacts out of a table of pairs (P, P + B), the names behind its columns being given."""
    for a, b in allowed_contacts:
        first, second = ([i for i, name in enumerate(names) if name == wanted] for wanted in (a, b))
        for i, j in product(first, second):
            for one, other in ((i, j), (j, i)):
                if one < len(pairs):
                    pairs[one, other] = 0


class BroadPhase:
    """Which pairs of a scene's robot, held object and bodies the covers prove apart, so that FCL need not be asked about them."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self.robot, self.scene = robot, scene
        self.robot_collision_model = robot_collision_model(robot, scene.robot.T_world_base)
        self._stock, owners = scene_solids(scene)
        self._owners = tuple(owners)
        still = {b.name: b.T_world_body for b in standing_still(scene)}
        self._fixtures = [(i, still[owner]) for i, owner in enumerate(owners) if owner in still]
        self._of = {b.name: [i for i, owner in enumerate(owners) if owner == b.name] for b in scene.objects}
        self._pieces = lru_cache(maxsize=None)(lambda name: shape_geometry(scene.body(name).shape))
        self._pairs = _self_pairs(robot)
        self._fingers = self.robot_collision_model.fingers
        self._placed: dict[bytes, tuple[Solids, SphereWorld]] = {}
        self._scratch: Scratch | None = None
        self._spheres: tuple[int, int, int, SphereScratch] | None = None
        self._finger_posed: dict[float, PosedGeometry] = {}
        self._judged: dict[tuple[tuple[str, ...], tuple[str, ...]], NDArray[np.bool_]] = {}
        self._finger_links = tuple(self.robot_collision_model.links[i] for i in self._fingers)
        self._known: dict[object, tuple[PosedGeometry, SphereModel, tuple[str, ...]]] = {}

    def judge(
        self, q: Array, poses: Mapping[str, Array], held: Held | None, allowed_contacts: Iterable[tuple[str, str]]
    ) -> BroadPhaseResult:
        """Ask the covers about configurations q (N, J), N > 0, with objects standing at poses, besides the allowed contacts.

        Not judged, but left to FCL: pairs on one frame of the arm, such as the palm and a held object; the fingers when they move; and
        everything when a joint that is neither the arm's nor the gripper's is not at home.
        """
        q = checked("q", q, -1, len(self.robot.joint_names))
        if len(q) == 0:
            raise ValueError("there are no configurations to judge")
        gripper = float(q[0, self.robot.gripper_joint])
        posed, model, links = self.moving(gripper, held)
        own = len(self.robot_collision_model.links)
        world, bodies = self._standing(poses)[1:]
        P, names, judge = len(links), links + bodies, self._judgeable(posed, links, bodies)
        allow(judge, names, allowed_contacts)
        if (q[:, self.robot.gripper_joint] != gripper).any():
            judge[:own][self._fingers] = False
            judge[:, :own][:, self._fingers] = False
        if self._elsewhere(q):
            judge[:] = False
        pairs = np.argwhere(judge[:, :P])
        world = world._replace(check=judge[:, P:].astype(np.uint8), pairs=pairs.astype(np.uint64, order="C"))
        rows, which = open_pairs(model, world, np.ascontiguousarray(self.robot.arm_q(q)), self._sphere_scratch(model, world))
        B = len(bodies)
        against = which < P * B  # else part against part
        a, b = which // max(B, 1), P + which % max(B, 1)
        a[~against], b[~against] = pairs[which[~against] - P * B].T
        return BroadPhaseResult(names, judge, rows, a, b)

    def _judgeable(self, posed: PosedGeometry, links: tuple[str, ...], bodies: tuple[str, ...]) -> NDArray[np.bool_]:
        """The pairs (P, P + B) that the covers can be asked about if no contact is allowed, in a table of one's own."""
        known = self._judged.get((links, bodies))
        if known is None:
            P, own = len(links), len(self.robot_collision_model.links)
            known = self._judged[links, bodies] = np.zeros((P, P + len(bodies)), np.bool_)
            known[:, P:] = (posed.frame > 0)[:, None]
            known[self._pairs[:, 0], self._pairs[:, 1]] = True
            known[own:, :own] = True
            known[:, :P] &= posed.frame[:, None] != posed.frame
        return known.copy()

    def fingers(self, gripper: float) -> tuple[PosedGeometry, tuple[str, ...]]:
        """The fingers alone at a gripper value, packed, and the name behind each part."""
        if gripper not in self._finger_posed:
            if len(self._finger_posed) == KEPT:
                self._finger_posed.pop(next(iter(self._finger_posed)))  # the oldest
            self._finger_posed[gripper] = self.robot_collision_model.posed_fingers([gripper])
        return self._finger_posed[gripper], self._finger_links

    def moving(self, gripper: float, held: Held | None) -> tuple[PosedGeometry, SphereModel, tuple[str, ...]]:
        """What moves with the arm, packed, and the name behind each part; the latest of them are kept."""
        grip = None if held is None else (held.body, held.T_hand_body.tobytes())
        if (gripper, grip) not in self._known:
            (posed, model), links = self.robot_collision_model.packed(gripper), self.robot_collision_model.links
            if held is not None:
                own = self.robot_collision_model.in_hand(self._pieces(held.body), held.T_hand_body)
                posed, links = join_posed(posed, own), links + (held.body,) * len(own.frame)
                model = posed_sphere_model(self.robot_collision_model.chain, posed)
            if len(self._known) == KEPT:
                self._known.pop(next(iter(self._known)))  # the oldest
            self._known[gripper, grip] = posed, model, links
        return self._known[gripper, grip]

    def standing(self, poses: Mapping[str, Array]) -> tuple[Solids, tuple[str, ...]]:
        """What stands still and the objects at poses, packed; and the name behind each solid."""
        solids, _, names = self._standing(poses)
        return solids, names

    def _standing(self, poses: Mapping[str, Array]) -> tuple[Solids, SphereWorld, tuple[str, ...]]:
        """The same, packed for the sphere check, too, without a question about it."""
        at = self._fixtures + [(i, T) for name, T in poses.items() for i in self._of[name]]
        which, T = np.array([i for i, _ in at], np.int64), np.array([T for _, T in at])
        key = which.tobytes() + T.tobytes()
        if key not in self._placed:
            if len(self._placed) == KEPT:
                self._placed.pop(next(iter(self._placed)))  # the oldest
            solids = place_solids(self._stock, which, T)
            nothing = Query(np.zeros((0, len(which)), np.uint8), np.zeros((0, 2), np.int64))
            self._placed[key] = solids, make_sphere_world(solids, nothing)
        return *self._placed[key], tuple(self._owners[i] for i, _ in at)

    def _sphere_scratch(self, model: SphereModel, world: SphereWorld) -> SphereScratch:
        """Memory for the sphere check, the same for one question after the other."""
        parts, solids, pairs = len(model.frame), len(world.kind), len(world.pairs)
        known = self._spheres
        if known is None or known[0] < parts or known[1] < solids or known[2] < pairs:
            self._spheres = known = parts, solids, 2 * pairs, scratch_for(len(model.T), parts, solids, 2 * pairs)
        return known[3]

    def scratch(self, problem: Problem) -> Scratch:
        """Memory for an exact problem with these bodies, the same for one after the other."""
        known, chain, pairs = self._scratch, problem.chain, len(problem.pairs)
        if known is None or len(known.toward) < pairs:
            known = self._scratch = edge_problem.scratch_for(len(chain.q_index), len(chain.lower), len(self._owners), 2 * pairs)
        edge_problem.enter(problem, known)
        return known

    def _elsewhere(self, q: Array) -> bool:
        """Whether a joint that the robot collision model takes to be at home is not."""
        others = np.ones(q.shape[1], np.bool_)
        others[[*self.robot.arm_joints, self.robot.gripper_joint]] = False
        return bool((q[:, others] != self.robot.home[others]).any())


@lru_cache(maxsize=16)
def _self_pairs(robot: Robot) -> Int:
    return robot.self_pairs()
