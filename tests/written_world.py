"""A world for policies that look ahead in which every answer is written down: who blocks whom from where, and which moves can be done."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene, State
from kinematics.shapes import Cylinder
from kinematics.transforms import Array, transform
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Choice
from planning.plan import Blocked
from planning.relaxed_plan import Names

RADIUS_M, HEIGHT_M, N = 0.03, 0.12, 4
Blocking = Callable[[str, Mapping[str, int]], Sequence[str]]
"""What blocks each way to an object, one name a letter, when the objects stand in regions (-1: where they stood at first)."""


@dataclass
class WrittenWorld:
    """Stands for `Motions` as `planning.policies.search.World` has it. Objects are single letters, the target is t.

    blocking: see `Blocking`. can: whether an object can be moved to a region, beyond what blocks it. reached: whether the arm gets to an
    object, or to the target, at all. finer: the blocking for a thorough look; finest: for an exhaustive one; rough: for a rough one.
    can_varied: `can` with picks unlike one another, where that is not the same.
    tried: the moves that were asked for, in order. tight: which moves come near to something. seen: the blocking if unseen space were free,
    where there is some.
    """

    names: str
    blocking: Blocking
    can: Callable[[Choice], bool] = lambda choice: True
    reached: Callable[[str, Mapping[str, int]], bool] = lambda name, regions: True
    finer: Blocking | None = None
    tried: list[Choice] = field(default_factory=list)
    rough: Blocking | None = None
    finest: Blocking | None = None
    tight: Callable[[Choice], bool] = lambda choice: False
    seen: Blocking | None = None
    can_varied: Callable[[Choice], bool] | None = None
    state: State = field(init=False)

    def __post_init__(self) -> None:
        cans = [Body(n, Cylinder(RADIUS_M, HEIGHT_M), transform(p=[0.28, -0.15 + 0.075 * i, 0.06])) for i, n in enumerate(self.names)]
        wanted = Body("t", Cylinder(RADIUS_M, HEIGHT_M), transform(p=[0.36, 0.1, 0.06]))
        cabinet = Cabinet(np.array([0.4, 0.4, 0.3]), np.eye(4), 0.03)
        grasp = Grasp(np.eye(4), 2 * RADIUS_M)
        self.scene = Scene("written", RobotRef(np.eye(4), "none"), cabinet, (*cans, wanted), "t", grasp, regions_n=N)
        self.state = self.start()

    def start(self) -> State:
        return State(np.zeros(1), self.scene.poses())

    def regions_of(self, poses: Mapping[str, Array]) -> dict[str, int]:
        """In which region each object was put; -1 for one that stands where it stood."""
        centres, first = self.scene.regions()[:, :2], self.scene.poses()
        away = {name: np.linalg.norm(centres - T[:2, 3], axis=1) for name, T in poses.items() if name != "t"}
        return {name: -1 if np.allclose(poses[name], first[name]) else int(d.argmin()) for name, d in away.items()}

    def obstructions(self, poses: Mapping[str, Array], *, roughly: bool = False) -> _Written:
        return _Written((roughly and self.rough) or self.blocking, self.regions_of(poses))

    @property
    def partly_unseen(self) -> bool:
        return self.seen is not None

    @property
    def if_free(self) -> WrittenWorld:
        return self if self.seen is None else WrittenWorld(self.names, self.seen, self.can, self.reached, None, self.tried)

    @property
    def thorough(self) -> WrittenWorld:
        if self.finer is None:
            return self
        return WrittenWorld(self.names, self.finer, self.can, self.reached, None, self.tried)

    @property
    def exhaustive(self) -> WrittenWorld:
        if self.finest is None:
            return self.thorough
        return WrittenWorld(self.names, self.finest, self.can, self.reached, None, self.tried)

    @property
    def varied(self) -> WrittenWorld:
        return WrittenWorld(self.names, self.blocking, self.can_varied or self.can, self.reached, None, self.tried)

    def place_pose(self, name: str, T_from: Array, region: int) -> Array:
        return transform(p=[*self.scene.regions()[region, :2], 0.06])

    def relocate(self, state: State, name: str, region: int, rng: np.random.Generator) -> Done | Blocked:
        self.tried.append((name, region))
        self.state = state
        regions = self.regions_of(state.poses)
        others = frozenset(regions) - {name}
        if not self.obstructions(state.poses).free(name, others):
            return Blocked("approach", "hand", name)
        if not self.reached(name, regions):
            return Blocked("transit", "arm", name)
        if not self.can((name, region)):
            return Blocked("transfer", "arm", name)
        poses = {**state.poses, name: self.place_pose(name, state.poses[name], region)}
        return Done((), State(state.q, poses), tight=self.tight((name, region)))

    def retrieve_target(self, state: State, rng: np.random.Generator) -> Done | Blocked:
        self.state = state
        regions = self.regions_of(state.poses)
        if not self.obstructions(state.poses).free("t", frozenset(regions)):
            return Blocked("approach", "hand", "t")
        if not self.reached("t", regions):
            return Blocked("transit", "arm", "t")
        return Done((), State(state.q, {}))

    def out_of_reach(self, state: State, name: str) -> bool:
        return not self.reached(name, self.regions_of(state.poses))

    def gets_to(self, state: State, name: str, rng: np.random.Generator) -> bool:
        regions = self.regions_of(state.poses)
        return self.obstructions(state.poses).free(name, frozenset(regions) - {name}) and self.reached(name, regions)


@dataclass(frozen=True)
class _Written:
    blocking: Blocking
    regions: Mapping[str, int]

    def free(self, name: str, standing: Names) -> bool:
        return any(not frozenset(way) & standing for way in self.blocking(name, self.regions))

    def blockers(self, name: str, standing: Names) -> list[Names]:
        here = {frozenset(way) & standing for way in self.blocking(name, self.regions)}
        return [way for way in here if not any(other < way for other in here)]


def at_first(ways: Mapping[str, Sequence[str]]) -> Blocking:
    """A table of what blocks what while it stands where it stood; an object that was moved, or is gone, is in nobody's way."""

    def blocking(name: str, regions: Mapping[str, int]) -> Sequence[str]:
        return ["".join(o for o in way if regions.get(o) == -1) for way in ways[name]] if regions.get(name, -1) == -1 else [""]

    return blocking
