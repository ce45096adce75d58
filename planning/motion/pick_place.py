"""Pick and place: transit → approach → grasp → lift → transfer → lower → release → retreat, for one robot before one cabinet.

Cheap tests come first: end poses by inverse kinematics and static checks, then the straight pieces, RRT-Connect last. All checks run in
the compiled core; what can't be done comes back as `Blocked`, with the stage, the link and the body.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import count, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arm import Int
from kinematics.robot import Robot
from kinematics.scene import APPROACHES, Body, Grasp, Held, Scene, State
from kinematics.shapes import Shape, bounds
from kinematics.transforms import Array, inverse, transform
from planning.grasps import open_width, sample_grasps
from planning.motion import reaching
from planning.motion.reaching import APPROACH_STEPS, LIFT_STEPS, Standing
from planning.motion.timing import time_stamps
from planning.motion.workcell import Situation, Workcell, tasks_of
from planning.plan import PLACE_OUT_OF_REACH, Blocked, Motion

ITERATIONS = 3000  # of one RRT-Connect
MAX_PICKS = 8  # grasps with a free approach that are kept for one object
ENOUGH_GRASPS = 24  # after so many, the first in the most natural order, any that was found will do
MAX_TRIES = 3  # of those, how many are given to RRT-Connect before the move is given up
KEPT = 8  # states that are remembered
BRIEFLY, BRIEF_PICKS = 300, 4  # iterations of RRT-Connect, and grasps tried, where only labels hang on the answer
TRIES, PLACE_TRIES = 24, 12  # starts of inverse kinematics where an object is taken, and where it is put down


@dataclass(frozen=True, eq=False)
class Pick:
    """A way to take hold of an object: arm waypoints of the straight pieces, gripper values, and where the object sits in the hand."""

    grasp: Grasp
    approach: Array
    lift: Array
    gripper_open: float
    gripper_closed: float
    held: Held


@dataclass(frozen=True, eq=False)
class Place:
    """A way to put a held object down: arm waypoints of the straight pieces and the object's pose afterwards."""

    lower: Array
    retreat: Array
    T_world_object: Array


class _OpenHand:
    """The hand before it closes on an object of some width: gripper values, the situation while it is open, and those while the fingers
    move, the pads allowed to touch the object between them."""

    def __init__(self, motions: Motions, poses: Mapping[str, Array], name: str, width_m: float) -> None:
        opening = motions.robot.opening
        self.opened, self.closed = opening.value_at(open_width(width_m, opening)), opening.value_at(width_m)
        self.reaching = motions.cell.problem(poses, self.opened)
        self._closing = partial(motions.moving_fingers, poses, name, self.opened, self.closed)

    @cached_property
    def closing(self) -> tuple[Situation, ...]:
        """Not asked for where the open hand does not even get there."""
        return self._closing()


class _Grasps:
    """The grasps on an object where it stands, and the arm's solutions for each; both are found when asked for, and once."""

    def __init__(self, found: Iterable[Grasp], ik: Callable[[Array], Array]) -> None:
        self._rest, self._found, self._ik, self._solutions = iter(found), list[Grasp](), ik, dict[int, Array]()

    def __iter__(self) -> Iterator[tuple[int, Grasp]]:
        for i in count():
            if i == len(self._found):
                grasp = next(self._rest, None)
                if grasp is None:
                    return
                self._found.append(grasp)
            yield i, self._found[i]

    def solutions(self, i: int) -> Array:
        """Arm configurations (S, A) for grasp i, the nearest to home first."""
        if i not in self._solutions:
            self._solutions[i] = self._ik(self._found[i].T_world_hand)
        return self._solutions[i]


class _Placing(NamedTuple):
    """A held object that is put down: for the compiled core, and the names behind its indices."""

    compiled: reaching.Placing
    lowering: Situation
    opening: tuple[Situation, ...]
    retreating: Situation
    among: Situation

    def seen_at(self, code: int) -> Situation:
        """The situation in which `reaching.put_down` got to say a code."""
        if code in (reaching.AT_GRASP, reaching.BACKWARDS):
            return self.retreating
        return {reaching.FINGERS: self.opening[0], reaching.REGION: self.among}.get(code, self.lowering)


class _Memory:
    """What was found out about one state, so that the many regions of an object don't ask twice."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.picks: dict[str, tuple[list[Pick], Blocked]] = {}
        self.transits: dict[Pick, Array | Blocked] = {}
        self.reachable: dict[Pick, bool] = {}
        self.placing: dict[Pick, _Placing] = {}
        self.carrying: dict[Pick, Situation] = {}
        self.let_go: dict[tuple[str, float, float], tuple[Situation, tuple[Situation, ...], Standing, Situation]] = {}
        self.without: dict[str, dict[str, Array]] = {}


@dataclass(frozen=True, eq=False)
class Done:
    """Motions that were found, and the state after them."""

    motions: tuple[Motion, ...]
    after: State


class Motions:
    """All motion planning for one scene: what the loop and the policies ask. Budgets count RRT-Connect's iterations.

    time_budget_s: the paper's protocol instead, wall-clock seconds for one RRT-Connect.
    obstacles: more that stands still, besides the cabinet's walls: what was not seen yet, furniture.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        *,
        iterations: int = ITERATIONS,
        time_budget_s: float | None = None,
        obstacles: Sequence[Body] = (),
    ) -> None:
        self.robot, self.scene = robot, scene
        self.cell = Workcell(robot, scene, iterations=iterations, time_budget_s=time_budget_s, obstacles=obstacles)
        self.floor_z = float(scene.cabinet.T_world_cabinet[2, 3])
        self._memories: deque[_Memory] = deque(maxlen=KEPT)
        self._known: dict[tuple[str, bytes], _Grasps] = {}

    def start(self) -> State:
        """The scene's first state, the arm at home before the cabinet. Raises ValueError when the robot can't stand or wait there."""
        return State(self.cell.home(), self.scene.poses())

    def place_pose(self, name: str, T_from: Array, region: int) -> Array:
        """Where an object stands in a region: its own orientation, its box's middle over the cell's centre, its bottom on the floor."""
        return _standing(self.scene.body(name).shape, T_from[:3, :3], self.scene.regions()[region])

    def retrieve_target(self, state: State, rng: np.random.Generator) -> Done | Blocked:
        """Take the target out with the scene's grasp x_g: the paper's indicator I, and the way out of the cabinet."""
        name = self.scene.target
        picks, why = self.picks(state, name, [self.scene.grasp])
        for pick in picks[:MAX_TRIES]:
            way_in = self._transit(state, pick, rng)
            if isinstance(way_in, Blocked):
                why = way_in
                continue
            way_out = self._way_out(state, pick, rng)
            if isinstance(way_out, Blocked):
                why = way_out
                continue
            motions = [*self._taking(state, name, pick, way_in), self._motion("transfer", way_out, pick.gripper_closed, pick.held)]
            return Done(tuple(motions), State(motions[-1].q[-1], self._without(state, name), pick.held))
        return why

    def relocate(self, state: State, name: str, region: int, rng: np.random.Generator) -> Done | Blocked:
        """Move an object to a region."""
        picks, why = self.picks(state, name)
        if not picks:
            return why
        if touch := self.cell.placed(self.scene.body(name), self.place_pose(name, state.poses[name], region), self._without(state, name)):
            return Blocked("region", name, touch.body)
        centre, tries = self.scene.regions()[region], 0
        for pick in picks:
            unreached = self._recall(state).transits.get(pick)
            if isinstance(unreached, Blocked):
                why = unreached
                continue
            place = self._place(state, pick, centre)
            if isinstance(place, Blocked):
                why = place
                continue
            way_in = self._transit(state, pick, rng)
            if isinstance(way_in, Blocked):
                why = way_in
                continue
            across = self.cell.connect(self._carrying(state, pick), pick.lift[-1], place.lower[:1], rng)
            if not isinstance(across, Blocked):
                return self._relocated(state, self._without(state, name), name, pick, place, way_in, across)
            why = replace(across, stage="transfer")
            tries += 1
            if tries == MAX_TRIES:
                break
        return why

    def placeable(self, state: State, name: str, regions: Sequence[int] | Int, rng: np.random.Generator) -> NDArray[np.bool_]:
        """To which of some regions (N,) an object can be carried now: `relocate` with less patience, many at once, without the motions."""
        picks, _ = self.picks(state, name)
        out = np.zeros(len(regions), np.bool_)
        if not picks:
            return out
        centres, R = self.scene.regions()[np.asarray(regions, np.int64)], state.poses[name][:3, :3]
        open_ = np.flatnonzero(self.cell.room_over(name, R, centres, self._without(state, name)))
        for pick in islice((pick for pick in picks if self.reachable(state, pick, rng)), BRIEF_PICKS):
            if not len(open_):
                break
            natural = np.array([self._natural_turn(pick, centre) for centre in centres[open_]])
            compiled, A = self._placing(state, pick).compiled, pick.lift.shape[1]
            ends, codes, T = np.empty((len(open_), A)), np.empty(len(open_), np.int64), np.empty((4, 4))
            lower, retreat = np.empty((LIFT_STEPS + 1, A)), np.empty((APPROACH_STEPS + 1, A))
            reaching.put_down_all(
                self.cell.hand, compiled, R, natural, centres[open_], pick.lift[-1], self.cell.memory, lower, retreat, T, ends, codes
            )
            self.cell.forget()
            down = np.flatnonzero(codes == reaching.OK)
            if len(down):
                out[open_[down]] = self.cell.reached(self._carrying(state, pick), pick.lift[-1], ends[down], rng, BRIEFLY)
            open_ = open_[~out[open_]]
        return out

    def reachable(self, state: State, pick: Pick, rng: np.random.Generator) -> bool:
        """Whether the arm gets from where it is to the beginning of a pick's approach, sought briefly."""
        known = self._recall(state).reachable
        if pick not in known:
            moving = self.cell.problem(state.poses, pick.gripper_open)
            known[pick] = bool(self.cell.reached(moving, self.robot.arm_q(state.q), pick.approach[:1], rng, BRIEFLY)[0])
        return known[pick]

    def picks(self, state: State, name: str, grasps: Iterable[Grasp] | None = None) -> tuple[list[Pick], Blocked]:
        """The ways to take hold of an object that hold up to all checks but RRT-Connect's, the least to turn first; and why others don't.

        grasps: by default, those sampled on the object's shape with the scene's approaches.
        """
        found = self._recall(state).picks
        if name not in found:
            found[name] = self._find_picks(state, name, grasps)
        return found[name]

    def _find_picks(self, state: State, name: str, grasps: Iterable[Grasp] | None) -> tuple[list[Pick], Blocked]:
        known = self._grasps(name, state.poses[name]) if grasps is None else _Grasps(grasps, self.cell.ik)
        picks: list[Pick] = []
        why, got_to = Blocked("grasp", body=name, detail="no grasp fits its shape and the gripper's opening"), 0
        cell, hands = self.cell, dict[float, _OpenHand]()
        for i, grasp in known:
            hand = hands.get(grasp.width_m)
            if hand is None:
                hand = hands[grasp.width_m] = _OpenHand(self, state.poses, name, grasp.width_m)
            alone = reaching.hand_way_in(cell.hand, hand.reaching.task, grasp.T_world_hand, cell.memory)
            free, said, found = 0, np.array([alone]), np.empty((0, 0, 0))
            if alone[0] == reaching.OK:
                solutions = known.solutions(i)
                found, said = np.empty((len(solutions), APPROACH_STEPS + 1, solutions.shape[1])), np.empty((len(solutions), 2), np.int64)
                free = reaching.ways_in(
                    cell.hand, hand.reaching.task, tasks_of(hand.closing), grasp.T_world_hand, solutions, cell.memory, found, said
                )
            if len(said) == 0 and got_to == 0:
                why, got_to = Blocked("ik", "hand", name, detail="the grasp is out of reach"), 1
            for code, pair in said:
                if code != reaching.OK and 1 + code >= got_to:
                    named = hand.closing[0] if code == reaching.FINGERS else hand.reaching
                    why, got_to = self._blocked(_PICKING[code], named, pair, name), 1 + code
            if free == 0:
                continue
            held = Held(name, inverse(grasp.T_world_hand) @ state.poses[name])
            lifting = self.cell.problem(self._without(state, name), hand.closed, held=held, ignore=[(name, "floor")])
            for way in found[:free]:
                up = np.empty((LIFT_STEPS + 1, way.shape[1]))
                code, pair = reaching.lift(cell.hand, lifting.task, grasp.T_world_hand, way[-1], up, cell.memory)
                if code == reaching.OK:
                    picks.append(Pick(grasp, way, up, hand.opened, hand.closed, held))
                elif 1 + code >= got_to:
                    why, got_to = self._blocked(_PICKING[code], lifting, pair, name), 1 + code
            if len(picks) >= MAX_PICKS or (picks and i + 1 >= ENOUGH_GRASPS):
                break
        cell.forget()
        now = self.robot.arm_q(state.q)
        picks.sort(key=lambda p: float(np.abs(p.approach[0] - now).max()))
        return picks, why

    def _grasps(self, name: str, T: Array) -> _Grasps:
        """The grasps on an object at T, with the scene's approaches; remembered, for most objects stay where they are."""
        key = (name, T.tobytes())
        if key not in self._known:
            body = replace(self.scene.body(name), T_world_body=T)
            to_body = T[:2, 3] - self.scene.robot.T_world_base[:2, 3]
            toward = float(np.arctan2(to_body[1], to_body[0]))
            approaches = [a for a in APPROACHES if a in self.scene.approaches]
            grasps = sample_grasps(body, self.robot.opening, approaches, self.floor_z, toward)
            self._known[key] = _Grasps(grasps, self.cell.ik)
        return self._known[key]

    def moving_fingers(self, poses: Mapping[str, Array], name: str, opened: float, closed: float) -> tuple[Situation, ...]:
        """The fingers on their way between two gripper values, before and at the second; the pads may touch the object between them."""
        ignore = [(pad, name) for pad in self.robot.pads]
        return tuple(
            self.cell.problem(poses, float(value), ignore=ignore, moving=self.robot.fingers) for value in np.linspace(opened, closed, 4)[1:]
        )

    def _placing(self, state: State, pick: Pick) -> _Placing:
        """The situations in which an object that the hand holds is put down, anywhere."""
        known = self._recall(state).placing
        if pick not in known:
            name, rest = pick.held.body, self._without(state, pick.held.body)
            lowering = self.cell.problem(rest, pick.gripper_closed, held=pick.held, ignore=[(name, "floor")])
            let_go, key = self._recall(state).let_go, (name, pick.gripper_open, pick.gripper_closed)
            if key not in let_go:
                standing = {**rest, name: state.poses[name]}
                opening = self.moving_fingers(standing, name, pick.gripper_open, pick.gripper_closed)
                let_go[key] = self.cell.problem(standing, pick.gripper_open), opening, *self.cell.standing(name, rest)
            retreating, opening, among, named = let_go[key]
            rows = [i - len(self.cell.arm.links) for i, n in enumerate(retreating.names) if n == name]
            tasks = lowering.task, tasks_of(opening), retreating.task
            compiled = reaching.Placing(*tasks, rows[0], rows[-1] + 1, among, pick.held.T_hand_body)
            known[pick] = _Placing(compiled, lowering, opening, retreating, named)
        return known[pick]

    def _place(self, state: State, pick: Pick, centre: Array) -> Place | Blocked:
        """Put the held object down over `centre` (3,), turned as suits the hand: static checks and the straight pieces.

        The arm should turn no more than it must: first the solutions near the pick's are tried, for every turn of the hand, then all.
        """
        name, cell, placing = pick.held.body, self.cell, self._placing(state, pick)
        R, natural, near, A = state.poses[name][:3, :3], self._natural_turn(pick, centre), pick.lift[-1], pick.lift.shape[1]
        p, lower, retreat, T = placing.compiled, np.empty((LIFT_STEPS + 1, A)), np.empty((APPROACH_STEPS + 1, A)), np.empty((4, 4))
        code, pair = reaching.put_down(cell.hand, p, R, natural, centre, near, cell.memory, lower, retreat, T)
        cell.forget()
        if code in (reaching.OK, reaching.REGION):
            return Place(lower, retreat, T) if code == reaching.OK else self._blocked(_PLACING[code], placing.seen_at(code), pair, name)
        for turn in reaching.PLACE_TURNS:
            reaching.stand(p.standing.body, R, natural + turn, centre, T)
            if reaching.stands(p.standing, T, cell.memory) == reaching.FREE:
                T_hand = T @ inverse(pick.held.T_hand_body)
                for q in cell.ik(T_hand, near=near, tries=PLACE_TRIES):
                    got, touch = reaching.put_down_at(cell.hand, p, T, T_hand, q, cell.memory, lower, retreat)
                    if got == reaching.OK:
                        return Place(lower, retreat, T)
                    if got >= code:
                        code, pair = got, touch
        return self._blocked(_PLACING[code], placing.seen_at(code), pair, name)

    def _natural_turn(self, pick: Pick, centre: Array) -> float:
        """How far an object turns with the hand: for a level grasp the hand comes in along the bearing of the place, else not at all."""
        ahead = pick.grasp.T_world_hand[:3, 2]
        if np.hypot(ahead[0], ahead[1]) <= 0.3:
            return 0.0
        bearing = centre[:2] - self.scene.robot.T_world_base[:2, 3]
        return float(np.arctan2(bearing[1], bearing[0]) - np.arctan2(ahead[1], ahead[0]))

    def _blocked(self, stage: str, situation: Situation, pair: int, name: str) -> Blocked:
        """What the compiled core found, in words: the stage and the two bodies, or that it was the arm's reach."""
        if stage == "ik":
            return Blocked("ik", "hand", name, detail=PLACE_OUT_OF_REACH)
        touch = self.cell.name_of(situation, pair)
        if touch is not None:
            return Blocked(stage, touch.link, touch.body)
        if stage == "region":
            return Blocked("region", name, "floor", detail="it would hang over the front edge")
        return Blocked(stage, "hand", name, detail="the straight way is not free, or leaves the arm's reach")

    def _transit(self, state: State, pick: Pick, rng: np.random.Generator) -> list[Motion] | Blocked:
        """From where the arm is to the beginning of a pick's approach, the fingers set to its opening first."""
        known = self._recall(state).transits
        q, gripper = self.robot.arm_q(state.q), float(state.q[self.robot.gripper_joint])
        if pick not in known:
            for value in np.linspace(gripper, pick.gripper_open, 4)[1:]:
                if touch := self.cell.touch(self.cell.problem(state.poses, float(value)), q):
                    known[pick] = Blocked("transit", touch.link, touch.body, detail=touch.detail)
                    break
            else:
                moving = self.cell.problem(state.poses, pick.gripper_open)
                known[pick] = self.cell.connect(moving, q, pick.approach[:1], rng)
        path = known[pick]
        if isinstance(path, Blocked):
            return path
        motions = []
        if abs(gripper - pick.gripper_open) > 1e-9:
            motions.append(self._motion("transit", np.stack([q, q]), gripper, to_gripper=pick.gripper_open))
        return [*motions, self._motion("transit", path, pick.gripper_open)]

    def _way_out(self, state: State, pick: Pick, rng: np.random.Generator) -> Array | Blocked:
        """From the lifted target to a configuration with its centre well outside the cabinet."""
        carrying = self._carrying(state, pick)
        goals = self.cell.outside(carrying, pick.held)
        if len(goals) == 0:
            return Blocked("transfer", "hand", pick.held.body, detail="no free configuration holds it outside the cabinet")
        path = self.cell.connect(carrying, pick.lift[-1], goals, rng)
        return replace(path, stage="transfer") if isinstance(path, Blocked) else path

    def _carrying(self, state: State, pick: Pick) -> Situation:
        """The object in the closed hand, off the floor."""
        known = self._recall(state).carrying
        if pick not in known:
            known[pick] = self.cell.problem(self._without(state, pick.held.body), pick.gripper_closed, held=pick.held)
        return known[pick]

    @property
    def state(self) -> State:
        """The state that was asked about last. Raises: ValueError before the first question."""
        if not self._memories:
            raise ValueError("nothing was asked about any state yet")
        return self._memories[-1].state

    def _recall(self, state: State) -> _Memory:
        if self._memories and self._memories[-1].state is state:
            return self._memories[-1]
        found = next((memory for memory in self._memories if memory.state is state), None)
        if found is not None:
            self._memories.remove(found)
        self._memories.append(found or _Memory(state))
        return self._memories[-1]

    def _without(self, state: State, name: str) -> dict[str, Array]:
        """The poses of the objects besides one."""
        known = self._recall(state).without
        if name not in known:
            known[name] = {n: T for n, T in state.poses.items() if n != name}
        return known[name]

    def _taking(self, state: State, name: str, pick: Pick, way_in: list[Motion]) -> list[Motion]:
        """The motions from where the arm is to the lifted object."""
        at = pick.approach[-1]
        return [
            *way_in,
            self._motion("approach", pick.approach, pick.gripper_open),
            self._motion("grasp", np.stack([at, at]), pick.gripper_open, to_gripper=pick.gripper_closed, touching=name),
            self._motion("lift", pick.lift, pick.gripper_closed, pick.held, on_floor=True),
        ]

    def _relocated(
        self, state: State, rest: dict[str, Array], name: str, pick: Pick, place: Place, way_in: list[Motion], across: Array
    ) -> Done:
        at = place.lower[-1]
        motions = [
            *self._taking(state, name, pick, way_in),
            self._motion("transfer", across, pick.gripper_closed, pick.held),
            self._motion("lower", place.lower, pick.gripper_closed, pick.held, on_floor=True),
            self._motion("release", np.stack([at, at]), pick.gripper_closed, to_gripper=pick.gripper_open, touching=name),
            self._motion("retreat", place.retreat, pick.gripper_open),
        ]
        return Done(tuple(motions), State(motions[-1].q[-1], {**rest, name: place.T_world_object}))

    def _motion(
        self,
        stage: str,
        arm: Array,
        gripper: float,
        held: Held | None = None,
        *,
        to_gripper: float | None = None,
        touching: str | None = None,
        on_floor: bool = False,
    ) -> Motion:
        """A motion over every actuated joint from arm waypoints (K, A); the gripper may move along, evenly."""
        values = np.linspace(gripper, gripper if to_gripper is None else to_gripper, len(arm))
        q = np.array([self.robot.with_arm(a, float(g)) for a, g in zip(arm, values)])
        body = held.body if held else touching
        may_touch = [(pad, body) for pad in sorted(self.robot.pads)] if body else []
        if on_floor and body:
            may_touch.append((body, "floor"))
        return Motion(stage, self.robot.joint_names, q, time_stamps(q, self.robot.velocity), held, tuple(may_touch))


_PICKING = {
    reaching.REACH: "ik", reaching.AT_GRASP: "approach", reaching.BACKWARDS: "approach", reaching.FINGERS: "grasp",
    reaching.LIFTED: "lift", reaching.UPWARDS: "lift",
}  # fmt: skip
_PLACING = {
    reaching.REACH: "ik", reaching.REGION: "region", reaching.LIFTED: "lower", reaching.AT_GRASP: "lower", reaching.UPWARDS: "lower",
    reaching.FINGERS: "release", reaching.BACKWARDS: "retreat",
}  # fmt: skip
"""What the compiled core's codes are called in a plan."""


def _standing(shape: Shape, R: Array, centre: Array) -> Array:
    """The pose (4, 4) of a shape with rotation R (3, 3), its box's middle over `centre` (3,) and its bottom at the centre's height."""
    low, high = bounds(shape, transform(R))
    return transform(R, centre - np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]))
