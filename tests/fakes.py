"""A planner's world without geometry, in which every answer is known by hand: four cans, a gate that says when the target is free."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from kinematics.scene import Body, Cabinet, Grasp, Held, RobotRef, Scene, State
from kinematics.shapes import Cylinder
from kinematics.transforms import Array, transform
from perception.observation import Observation
from planning.motion.handling.carry import Done
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.plan import Blocked, Motion

BASE = np.array([-0.5, 0.1, 0.2])
RADIUS_M, HEIGHT_M = 0.03, 0.12
Choice = tuple[str, int]


def scene_of(*names: str, target: str = "target", n: int = 4) -> Scene:
    """A cabinet of 0.4 × 0.4 m with n × n regions; the objects stand in a row along y at x = 0.25, 0.09 m apart, the target behind them."""
    cans = [Body(name, Cylinder(RADIUS_M, HEIGHT_M), transform(p=[0.25, -0.135 + 0.09 * i, HEIGHT_M / 2])) for i, name in enumerate(names)]
    wanted = Body(target, Cylinder(RADIUS_M, HEIGHT_M), transform(p=[0.35, 0.0, HEIGHT_M / 2]))
    cabinet = Cabinet(np.array([0.4, 0.4, 0.3]), np.eye(4), 0.03)
    grasp = Grasp(transform(p=[0.35, 0.0, 0.08]), 2 * RADIUS_M)
    return Scene("by-hand", RobotRef(transform(p=BASE), "stick"), cabinet, (*cans, wanted), target, grasp, regions_n=n)


def stick(radius_m: float = 1.0) -> Any:
    """A robot with one joint: a stick that turns about z, the hand at its end."""

    def poses(q: Array) -> Array:
        T = transform(p=np.stack([radius_m * np.cos(q[..., 0]), radius_m * np.sin(q[..., 0]), np.zeros(q.shape[:-1])], -1))
        return np.stack([np.broadcast_to(np.eye(4), T.shape), T], -3)

    tree = SimpleNamespace(
        poses=poses, link=lambda name, q: poses(q)[..., tree.index[name], :, :], names=("base", "hand"), index={"base": 0, "hand": 1}
    )
    return SimpleNamespace(name="stick", tree=tree)


def motion(stage: str, *q: float, held: Held | None = None) -> Motion:
    """A motion of the stick over some angles (rad), a second each."""
    return Motion(stage, ("turn",), np.array(q, float)[:, None], np.arange(len(q), dtype=float), held)


@dataclass
class FakeMotions:
    """Stands for `planning.motion.pick_place.Motions`: what can be moved, and when the target is free, is written down.

    opens: the sets of moves of which one must have been made for the target to be free; an empty set: it is free at once.
    possible: whether an object can be moved to a region after some moves were made; by default never.
    graspable: whether an object can be picked at all then. tight: which moves come near to something. at_start: what touches the arm where
    it stands.
    Each question costs `seconds` on `clock`, and is noted in `asked`.
    """

    scene: Scene
    opens: Sequence[frozenset[Choice]] = ()
    possible: Callable[[tuple[Choice, ...], Choice], bool] = lambda made, choice: False
    graspable: Callable[[tuple[Choice, ...], str], bool] = lambda made, name: True
    tight: Callable[[Choice], bool] = lambda choice: False
    at_start: Blocked | None = None
    robot: Any = field(default_factory=stick)
    settings: MotionSettings = DEFAULTS
    clock: Clock | None = None
    seconds: float = 0.0
    asked: list[tuple[Any, ...]] = field(default_factory=list)
    rngs: list[np.random.Generator] = field(default_factory=list)
    made: dict[int, tuple[Choice, ...]] = field(default_factory=dict)
    kept: list[State] = field(default_factory=list)

    def start(self) -> State:
        return self._state(State(np.zeros(1), self.scene.poses()), ())

    def target_stays(self) -> Blocked | None:
        return None

    def start_blocked(self) -> Blocked | None:
        return self.at_start

    def trajectories(self, state: State, motions: Sequence[Motion]) -> tuple[Motion, ...]:
        """The waypoints themselves."""
        return tuple(motions)

    def quickest(self, found: Sequence[tuple[State, Done]], rng: np.random.Generator) -> list[tuple[State, Done]]:
        """As they were found."""
        return list(found)

    def retrieve_target(self, state: State, rng: np.random.Generator) -> Done | Blocked:
        self._note(rng, "target", self.made[id(state)])
        made = self.made[id(state)]
        if any(needed <= set(made) for needed in self.opens):
            return Done((motion("approach", state.q[0], state.q[0] + 0.5),), State(state.q + 0.5, {}))
        return Blocked("approach", "hand", "can", detail=f"target blocked after {len(made)} moves")

    def relocate(self, state: State, name: str, region: int, rng: np.random.Generator) -> Done | Blocked:
        self._note(rng, "relocate", name, region)
        made, choice = self.made[id(state)], (name, region)
        if not self.possible(made, choice):
            return Blocked("transfer", "arm", name, detail=f"no way to {region}")
        poses = {**state.poses, name: self.place_pose(name, state.poses[name], region)}
        after = self._state(State(state.q + 1.0, poses), (*made, choice))
        motions = motion("transit", state.q[0], state.q[0] + 0.4), motion("transfer", state.q[0] + 0.4, after.q[0])
        return Done(motions, after, tight=self.tight(choice))

    def place_pose(self, name: str, T_from: Array, region: int) -> Array:
        T = T_from.copy()
        T[:2, 3] = self.scene.regions()[region][:2]
        return T

    def picks(self, state: State, name: str, grasps: Sequence[Grasp] | None = None) -> tuple[list[Any], Blocked]:
        return (["a pick"] if self.graspable(self.made[id(state)], name) else []), Blocked("ik", "hand", name)

    def _state(self, state: State, made: tuple[Choice, ...]) -> State:
        self.kept.append(state)  # so that no other state gets its id
        self.made[id(state)] = made
        return state

    def _note(self, rng: np.random.Generator, *what: Any) -> None:
        self.asked.append(what)
        self.rngs.append(rng)
        if self.clock is not None:
            self.clock.now += self.seconds

    @property
    def tried(self) -> list[Choice]:
        """The moves that were asked about, in order."""
        return [(a[1], a[2]) for a in self.asked if a[0] == "relocate"]

    @property
    def looks(self) -> int:
        """How often the target was tried."""
        return sum(a[0] == "target" for a in self.asked)


@dataclass
class Clock:
    """A clock that only moves when it is told to."""

    now: float = 100.0

    def __call__(self) -> float:
        return self.now


def observation(
    boxes: Mapping[str, Sequence[float]], *, target: str = "target", n: int = 4, unseen: Sequence[int] = (), T_cabinet: Array | None = None
) -> Observation:
    """What a planner sees of a cabinet of 0.4 × 0.4 × 0.3 m with n × n regions: boxes (6,), and all regions but some."""
    cabinet = Cabinet(np.array([0.4, 0.4, 0.3]), np.eye(4) if T_cabinet is None else T_cabinet, 0.03)
    regions = np.column_stack([cabinet.regions(n), np.ones(n * n)])
    regions[list(unseen), 3] = 0.0
    boxes_m = {name: np.array(box, float) for name, box in boxes.items()}
    return Observation(BASE, cabinet, np.zeros(1), Grasp(np.eye(4), 0.05), target, ("horizontal",), boxes_m, regions)
