"""Stretches of a way, during each of which the same things stand and the same is in the hand: packed once for all checks of the whole way.

What moves in any of them, fingers at several openings and objects held in several ways, becomes one set of parts; what stands in any of
them, wherever it ever does, one set of solids. Each stretch then names those that are there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.array_checks import checked
from kinematics.chain import Int
from kinematics.collision.geometry import Query, Solids, place_solids, scene_solids
from kinematics.collision.posed_geometry import PosedGeometry, join_posed
from kinematics.collision.robot_model import robot_collision_model, shape_geometry
from kinematics.collision.sphere_model import SphereModel, SphereWorld, make_sphere_world, posed_sphere_model
from kinematics.mount import standing_still
from kinematics.robots.robot import Robot
from kinematics.scene import Held, Scene
from kinematics.transforms import Array

FINGERS_AT = 5
"""At so many places of their way, both ends among them, fingers that move are looked at, at least."""
ROWS = 3
"""Fingers that move alone are looked at in one of so many rows, where that is more: on an arc they come nearer to something in between."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """Configurations q (N, J), N > 0, with objects standing at poses and perhaps one in the hand, and the contacts that are allowed."""

    q: Array
    poses: Mapping[str, Array]
    held: Held | None = None
    allowed_contacts: tuple[tuple[str, str], ...] = ()


class PackedStretches:
    """All stretches of a way, packed: arm (N, A), their configurations one after the other; posed, whatever moves; solids, whatever stands;
    names, of all parts, then of all solids.

    Raises: ValueError for configurations of another robot, and for a stretch without any.
    """

    def __init__(self, robot: Robot, scene: Scene, stretches: Sequence[Stretch]) -> None:
        self.robot, self.scene, self.stretches = robot, scene, tuple(stretches)
        self.model = robot_collision_model(robot, scene.robot.T_world_base)
        self.links, self._fingers = self.model.links, self.model.fingers
        rows = [checked("q", s.q, -1, len(robot.joint_names)) for s in self.stretches]
        if not all(len(q) for q in rows):
            raise ValueError("there are no configurations to judge")
        self.arm: Array = np.ascontiguousarray(robot.arm_q(np.concatenate([*rows, np.zeros((0, len(robot.joint_names)))])))
        self.starts: list[int] = np.cumsum([0, *(len(q) for q in rows)]).tolist()
        self.openings = [self._looked_at(q) for q in rows]
        self._pack_parts(scene)
        self._pack_solids(scene)

    def _looked_at(self, q: Array) -> tuple[float, ...]:
        """The gripper's values at which a stretch's fingers are looked at, its first one in front; one where they stand still."""
        gripper = q[:, self.robot.gripper_joint]
        if (gripper == gripper[0]).all():
            return (float(gripper[0]),)
        arm = self.robot.arm_q(q)
        alone = bool((arm == arm[0]).all())  # then it is they whose way the rows divide
        return tuple(gripper[list(_spread(len(q), max(FINGERS_AT, 1 + len(q) // ROWS) if alone else FINGERS_AT))].tolist())

    def _pack_parts(self, scene: Scene) -> None:
        first, *others = dict.fromkeys(value for values in self.openings for value in values) or {0.0: None}
        links, fingers = np.arange(len(self.links)), len(self._fingers)
        self._links_at = {first: links}
        several, names = [self.model.posed(first)], list(self.links)
        begins = {values[0] for values in self.openings}  # at the others nobody asks the covers, which take longest to place
        others = sorted(others, key=lambda value: value not in begins)
        for covered in (True, False):
            if fingers and (some := [value for value in others if (value in begins) is covered]):
                several.append(self.model.posed_fingers(some, covered=covered))
        for value in others:
            own = links.copy()
            own[self._fingers] = len(names) + np.arange(fingers)
            names += [self.links[i] for i in self._fingers]
            self._links_at[value] = own
        self._grips: dict[tuple[str, bytes], Int] = {}
        for held in (s.held for s in self.stretches):
            if held is not None and _key(held) not in self._grips:
                several.append(self.model.in_hand(shape_geometry(scene.body(held.body).shape), held.T_hand_body))
                self._grips[_key(held)] = len(names) + np.arange(len(several[-1].frame))
                names += [held.body] * len(several[-1].frame)
        self.posed: PosedGeometry = join_posed(*several) if len(several) > 1 else several[0]
        self._part_names = tuple(names)

    def _pack_solids(self, scene: Scene) -> None:
        stock, owners = scene_solids(scene)
        still = {b.name: b.T_world_body for b in standing_still(scene)}
        places: dict[tuple[int, bytes], int] = {}
        which, T = [i for i, owner in enumerate(owners) if owner in still], [still[owner] for owner in owners if owner in still]
        fixed = tuple(range(len(which)))
        parts_of = {b.name: [i for i, owner in enumerate(owners) if owner == b.name] for b in scene.objects}
        self._standing: list[tuple[Int, tuple[str, ...]]] = []
        before: Mapping[str, Array] | None = None
        for stretch in self.stretches:
            if stretch.poses is before:
                self._standing.append(self._standing[-1])
                continue
            before, here = stretch.poses, list(fixed)
            for name, pose in stretch.poses.items():
                for i in parts_of[name]:
                    at = places.setdefault((i, np.asarray(pose, float).tobytes()), len(which))
                    if at == len(which):
                        which.append(i)
                        T.append(pose)
                    here.append(at)
            self._standing.append((np.array(here, np.int64), tuple(owners[which[k]] for k in here)))
        self.solids: Solids = place_solids(stock, np.array(which, np.int64), np.array(T, float).reshape(-1, 4, 4))
        self.names = (*self._part_names, *(owners[i] for i in which))

    @cached_property
    def sphere_model(self) -> SphereModel:
        """What moves, for the sphere check."""
        return posed_sphere_model(self.model.chain, self.posed)

    @cached_property
    def sphere_world(self) -> SphereWorld:
        """What stands, for the sphere check, without a question about it."""
        B = len(self.solids.kind)
        return make_sphere_world(self.solids, Query(np.zeros((0, B), np.uint8), np.zeros((0, 2), np.int64)))

    def parts(self, s: int, gripper: float) -> tuple[Int, tuple[str, ...]]:
        """What moves in stretch s with the fingers at one of its openings, links in the robot's order, then what is held; and the names."""
        held, links = self.stretches[s].held, self._links_at[gripper]
        if held is None:
            return links, self.links
        grip = self._grips[_key(held)]
        return np.concatenate([links, grip]), (*self.links, *[held.body] * len(grip))

    def fingers(self, gripper: float) -> tuple[Int, tuple[str, ...]]:
        """The fingers alone at one of the openings, with the names."""
        return self._links_at[gripper][self._fingers], tuple(self.links[i] for i in self._fingers)

    def bodies(self, s: int) -> tuple[Int, tuple[str, ...]]:
        """What stands in stretch s, with the names."""
        return self._standing[s]


@lru_cache(maxsize=256)
def _spread(rows: int, places: int) -> tuple[int, ...]:
    """The first row, the last one and some between, each once, at which fingers are looked at."""
    return tuple(np.unique(np.linspace(0, rows - 1, places).round().astype(np.int64)).tolist())


def _key(held: Held) -> tuple[str, bytes]:
    return held.body, np.asarray(held.T_hand_body, float).tobytes()


def allow(pairs: NDArray[Any], names: tuple[str, ...], allowed_contacts: Iterable[tuple[str, str]]) -> None:
    """Take the allowed contacts out of a table of pairs (P, P + B), the names behind its columns being given."""
    at = _places(names)
    for a, b in allowed_contacts:
        for i, j in product(at.get(a, ()), at.get(b, ())):
            for one, other in ((i, j), (j, i)):
                if one < len(pairs):
                    pairs[one, other] = 0


@lru_cache(maxsize=64)
def _places(names: tuple[str, ...]) -> dict[str, list[int]]:
    """Where each name is among those of a table's columns."""
    out: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        out.setdefault(name, []).append(i)
    return out
