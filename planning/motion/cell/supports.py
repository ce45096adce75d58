"""Which objects can't be moved as things are, whatever hand takes them: what bears another, or stands beneath it, goes after that, what
leans on something is put down nowhere, and what is too heavy, or has no room above, is not lifted.

Support is what the verdict calls so (`planning.verdict.standing`). Only what stands where the scene has it can rest on others: all that was
moved stands on the floor and touches nothing else, nor does it come to bear what stands already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from kinematics.scene import Body, Cabinet, Scene
from kinematics.shapes import ConvexMesh
from kinematics.transforms import Array, inverse, transform
from planning.motion.cell.lifts import met_when_lifted
from planning.plan import Blocked
from planning.verdict.faults import Settings
from planning.verdict.standing import Placed, Stand, boxes_meet, falls, placed, stand, stand_among

Names = frozenset[str]
STRAIGHT = 1e-9  # of a cosine: what leans by no more stands as if it did not lean


class Supports:
    """Of one scene's objects. settings: when the verdict says that something stands. fixtures: what stands still, by default the scene's
    own."""

    def __init__(self, scene: Scene, settings: Settings | None = None, fixtures: Sequence[Body] | None = None) -> None:
        self.scene, self.settings, self._first = scene, settings or Settings(), scene.poses()
        raised = [b for b in scene.objects if not _alone_on_floor(b, scene.cabinet, self.settings.stands_m)]
        self._placed = {b.name: placed(b.name, b.shape, b.T_world_body, scene.cabinet) for b in scene.objects} if raised else {}
        self._stands: dict[tuple[str, Names], Stand] = {}
        everything = frozenset(self._first)
        self._near = {b.name: self._touchable(b.name) for b in raised}
        first = {b.name: self._stand(b.name, everything) for b in raised}
        self._resting = tuple(name for name, at in first.items() if not everything.isdisjoint(at.on))
        self._leans = {name: at.on for name, at in first.items() if falls(self._on_the_floor(name), at, self.settings.pose_m)}
        self.put_down_nowhere: Names = frozenset(self._leans) - {scene.target}
        """What leans on something and would stand nowhere else as it is turned; the target is not put down."""
        self._stays = self.put_down_nowhere.union(name for name in self._first if scene.too_heavy(name) is not None)
        self._fixtures = scene.fixtures() if fixtures is None else fixtures

    @cached_property
    def _lifts(self) -> Mapping[str, tuple[str, ...]]:
        """What objects meet as they are lifted where the scene has them."""
        return met_when_lifted(self.scene.objects, self._fixtures)

    def lifted_into(self, name: str, poses: Mapping[str, Array]) -> tuple[str, ...]:
        """What an object itself would meet as it is lifted: other objects at poses, and what stands still."""
        if name not in self._lifts or not self._is_first(name, poses):
            return ()
        return tuple(other for other in self._lifts[name] if other not in self._first or self._is_first(other, poses))

    def resting_on(self, name: str, poses: Mapping[str, Array]) -> tuple[str, ...]:
        """Which of the objects at poses would not stay where they are without one of them: they go before it."""
        if not self._resting:
            return ()
        here = frozenset(n for n in poses if self._is_first(n, poses))
        return tuple(upper for upper in self._resting if upper in here and self._bears(name, upper, here))

    def kept(self, name: str, poses: Mapping[str, Array]) -> Blocked | None:
        """Why an object at poses can't be moved as things are, though the hand may get to it; None where nothing speaks against it."""
        if (weighs := self.scene.too_heavy(name)) is not None:
            return Blocked("lift", body=name, detail=weighs)
        for upper in self.resting_on(name, poses):
            return Blocked("grasp", body=upper, detail=f"{upper} rests on {name} and goes first")
        for other in self.lifted_into(name, poses):
            return Blocked("lift", name, other, detail=f"{name} has no room above, whatever hand takes it")
        if name in self.put_down_nowhere:
            on = " and ".join(other for other in self._leans[name] if other != "floor")
            return Blocked("release", body=name, detail=f"{name} leans on {on}, and would stand nowhere else as it is turned")
        return None

    def waiting(self, poses: Mapping[str, Array]) -> dict[str, Names]:
        """For the objects at poses that are not to be moved as things are, the others that have to go first. What can't be moved at all
        waits for the target: it stays."""
        if not self._resting and not self._stays and not self._lifts:
            return {}
        first = {name: frozenset(self.resting_on(name, poses)) for name in poses}
        for name in first:
            meets = self.lifted_into(name, poses)
            first[name] |= self._first.keys() & meets
            if name in self._stays or not self._first.keys() >= set(meets):
                first[name] |= {self.scene.target_name}
        return {name: others for name, others in first.items() if others}

    def _is_first(self, name: str, poses: Mapping[str, Array]) -> bool:
        """Whether an object stands where the scene has it."""
        return name in poses and np.array_equal(poses[name], self._first[name])

    def _bears(self, lower: str, upper: str, here: Names) -> bool:
        """Whether an object would not stay where it is if another one of those that are here were taken."""
        at = self._stand(upper, here)
        return lower in at.on and falls(self._stand(upper, here - {lower}), at, self.settings.pose_m)

    def _stand(self, name: str, here: Names) -> Stand:
        """What an object stands on among those that are here."""
        key = (name, here & self._near[name])
        if key not in self._stands:
            among = [self._placed[other] for other in self._placed if other in key[1]]
            self._stands[key] = stand_among(self._placed[name], among, self.scene, self.settings.stands_m)
        return self._stands[key]

    def _touchable(self, name: str) -> Names:
        """The other objects so near to one that it may rest on them."""
        body, others = self._placed[name], (o for o in self._placed.values() if o.name != name)
        return frozenset(other.name for other in others if boxes_meet(body, other, self.settings.stands_m))

    def _on_the_floor(self, name: str) -> Stand:
        """How an object stands on the floor alone, put down as it is turned."""
        body, (depth, _, _) = self._placed[name], self.scene.cabinet.size_m
        middle = (body.low + body.high) / 2
        down = transform(p=[depth / 2 - middle[0], -middle[1], -body.low[2]])
        there = Placed(name, tuple(part.moved(down) for part in body.parts), body.low + down[:3, 3], body.high + down[:3, 3])
        return stand(there, (), self.scene.cabinet, self.settings.stands_m)


def _alone_on_floor(body: Body, cabinet: Cabinet, within_m: float) -> bool:
    """Whether an object stands upright on a cabinet's floor, as nearly all do, by a look that is quick."""
    if isinstance(body.shape, ConvexMesh):
        return False
    T, half, (depth, width, _) = inverse(cabinet.T_world_cabinet) @ body.T_world_body, body.shape.half, cabinet.size_m
    if abs(T[2, 2]) < 1 - STRAIGHT:
        return False
    (x, y, z), radius = T[:3, 3], np.hypot(half[0], half[1])
    return bool(abs(z - half[2]) <= within_m and radius <= x <= depth - radius and abs(y) <= width / 2 - radius)
