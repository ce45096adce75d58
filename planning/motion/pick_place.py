"""Pick and place: transit → approach → grasp → lift → transfer → lower → release → retreat, for one robot before one cabinet.

Cheap tests come first: end poses by inverse kinematics and static checks, then the straight pieces, RRT-Connect last. All checks run in
the compiled core; what can't be done comes back as `Blocked`, with the stage, the link and the body.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import chain
from weakref import WeakKeyDictionary

import numpy as np

from kinematics.array_checks import indices
from kinematics.collision.robot_model import bare_geometry
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene, State
from kinematics.transforms import Array, inverse
from planning.grasping.sampling import Sampling
from planning.motion.cell.supports import Supports
from planning.motion.cell.workcell import Workcell
from planning.motion.handling import waiting
from planning.motion.handling.carry import Carry, Done, carried, gripper_on_the_way
from planning.motion.handling.object_grasps import can_be_exhaustive
from planning.motion.handling.obstruction import Obstruction, View
from planning.motion.handling.patience import Patience
from planning.motion.handling.picking import EXHAUSTIVE, MAX_TRIES, THOROUGH, VARIED, WIDER, Pick, Picking, PickSettings, ik_for_proofs
from planning.motion.handling.placing import Place, Placing
from planning.motion.handling.reached import reached
from planning.motion.handling.room import Room
from planning.motion.handling.shrunk_scene import can_be_shrunk
from planning.motion.handling.state_ways import StateWays
from planning.motion.handling.subdivision import HandSubdivision
from planning.motion.handling.ways import WAY_IN, WHOLE_WAY
from planning.motion.lazy_list import LazyList
from planning.motion.quickest import Choices, quickest
from planning.motion.search.reaching import place_on_floor
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.motion.trajectory import FULL, Pace, timed
from planning.plan import Blocked, Motion

ITERATIONS = 3000  # of one RRT-Connect
MOST_TRIES = 8  # of the target's picks, all grasps together; of those with one grasp, MAX_TRIES
LEAST_M = 0.001  # what moves an object by less is no move
KEPT = 8  # states that are remembered
PATIENTLY = 4  # searches for a way to all picks of an object together, where all depends on the answer
IN_VAIN = 20  # such searches that may fail, in all states; then none is made for a move any more
NO_WAY = Blocked("transit", detail="no way to it is known among those to many picks")


Choice = tuple[str, int]
"""An object and the region that it is moved to."""


class Motions:
    """All motion planning for one scene: what the loop and the policies ask. Budgets count RRT-Connect's iterations.

    time_budget_s: the paper's protocol instead, wall-clock seconds for the whole indicator, way out included, and for each move.
    obstacles: more that stands still, besides what the scene has: space that was not seen yet.
    settings: how far motions keep from everything, how upright things are carried, how paths are sought.
    target_grasps: with which of them the target may be taken out, the best first; by default with the scene's x_g alone. more_grasps: with
    which others, by how densely they are sampled; then those are preferred that turn the arm least.
    pace: how fast what is found will be driven.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        *,
        iterations: int = ITERATIONS,
        time_budget_s: float | None = None,
        obstacles: Sequence[Body] = (),
        settings: MotionSettings = DEFAULTS,
        target_grasps: Sequence[Grasp] | None = None,
        more_grasps: Callable[[Sampling], Iterable[Grasp]] | None = None,
        pace: Pace = FULL,
    ) -> None:
        self.robot, self.scene, self.settings, self.pace = robot, scene, settings, pace
        self.cell = Workcell(robot, scene, iterations=iterations, time_budget_s=time_budget_s, obstacles=obstacles, settings=settings)
        given = () if scene.grasp is None else (scene.grasp,)
        self._listed_grasps, self._more_grasps = given if target_grasps is None else tuple(target_grasps), more_grasps
        self._picking, self._patience = Picking(self.cell), Patience(settings.patience, iterations)
        self._picking_wider, self._room = Picking(self.cell, WIDER), Room(self.cell)
        self._states: deque[StateWays] = deque(maxlen=KEPT)
        self._in_vain = 0  # searches for a way to all picks of an object together that failed
        self._obstruction: dict[bool, Obstruction] = {}  # by whether fingers are asked about
        self._done: WeakKeyDictionary[State, dict[Choice | None, Done]] = WeakKeyDictionary()

    @property
    def limits(self) -> tuple[Array, Array]:
        """Between which values (A,) the arm's joints may be."""
        return self.cell.arm.chain.lower, self.cell.arm.chain.upper

    def start(self) -> State:
        """The scene's first state, the arm at its q_start or at home before the cabinet. Raises ValueError when it can't wait there."""
        return State(waiting.start(self.cell), self.scene.poses())

    def start_blocked(self) -> Blocked | None:
        """Why no motion can begin where the scene says that the arm is; None when one can."""
        return waiting.start_blocked(self.cell)

    def target_stays(self) -> Blocked | None:
        """Why the target can't be taken out whatever is moved; None where nothing is known to speak against it."""
        weighs = self.scene.too_heavy(self.scene.target_name)
        return None if weighs is None else Blocked("lift", body=self.scene.target_name, detail=weighs)

    def trajectories(self, state: State, motions: Sequence[Motion]) -> tuple[Motion, ...]:
        """Motions that were found for a state, smooth and timed: see `trajectory.timed`."""
        return timed(self.cell, state.poses, motions, self.pace)

    def quickest(self, found: Sequence[tuple[State, Done]], rng: np.random.Generator) -> list[tuple[State, Done]]:
        """Moves that were found one after the other, each with the state before it, made as quick as can be (`planning.motion.quickest`).
        Every object ends where it did."""
        moves = [self._choices(state, done.carry) for state, done in found if done.carry is not None]
        if not moves:
            return []
        out, q = list[tuple[State, Done]](), moves[0].before.q
        for move, carry in zip(moves, quickest(self.cell, self.robot.arm_q(q), moves, rng)):
            state = State(q, move.before.poses, move.before.held)
            done = carried(self.cell, state, move.name, move.rest, carry)
            assert isinstance(done, Done), done
            out.append((state, done))
            q = done.after.q
        return out

    def _choices(self, state: State, found: Carry) -> Choices:
        """The ways to make a move that was found."""
        name, place = found.pick.held.body, found.place
        rest = self.without(state, name)
        if place is None:
            picks = [pick for pick in self.picks(state, name, self.target_grasps)[0] if pick.grasp is found.pick.grasp]
            return Choices(state, name, rest, found, picks, self._ways(state).way_out_ends, None)

        picks, _ = self.picks(state, name)

        def solutions(pick: Pick) -> Array:
            return self.cell.ik(place.T_world_object @ inverse(pick.held.T_hand_body))

        def put(pick: Pick, end: Array) -> Place | None:
            return self.placing(state, pick).at(place.T_world_object, end)

        return Choices(state, name, rest, found, picks, solutions, put)

    def place_pose(self, name: str, T_from: Array, region: int) -> Array:
        """Where an object stands in a region: its own orientation, its box's middle over the cell's centre, its bottom on the floor."""
        return np.asarray(self.place_poses(name, T_from, [region])[0])

    def place_poses(self, name: str, T_from: Array, regions: Sequence[int]) -> Array:
        """The same for several regions (R, 4, 4)."""
        at, T = indices("regions", regions, self.scene.regions_n**2), np.empty((4, 4))
        place_on_floor(bare_geometry(self.scene.body(name).shape).vertices, T_from[:3, :3], 0.0, np.zeros(3), T)
        out = np.repeat(T[None], len(at), 0)
        out[:, :3, 3] += self.scene.regions()[at]
        return out

    def retrieve_target(self, state: State, rng: np.random.Generator) -> Done | Blocked:
        """Take the target out with one of its grasps, x_g alone as a rule: the paper's indicator I, and the way out of the cabinet."""
        with self.cell.within_budget():
            return self._found_once(state, None, lambda: self._retrieve_target(state, rng))

    def _retrieve_target(self, state: State, rng: np.random.Generator) -> Done | Blocked:
        name = self.scene.target_name
        picks, why = self.picks(state, name, self.target_grasps)
        if picks and not (picks := self._reached(state, name, picks, rng)):
            why = NO_WAY
        tries = Counter[Grasp]()
        for pick in picks:
            tries[pick.grasp] += 1
            if tries[pick.grasp] > MAX_TRIES or tries.total() > MOST_TRIES:
                continue
            way_in = self._transit(state, pick, rng)
            if isinstance(way_in, Blocked):
                why = way_in
                continue
            goals = self._ways(state).way_out_ends(pick)
            if len(goals) == 0:
                why = Blocked("transfer", "hand", name, detail="no free configuration holds it outside the cabinet")
                continue
            across = self._across(state, pick, goals, rng)
            if isinstance(across, Blocked):
                why = across
                continue
            return carried(self.cell, state, name, self.without(state, name), across, beside=False)
        return why

    def relocate(self, state: State, name: str, region: int, rng: np.random.Generator) -> Done | Blocked:
        """Move an object to a region. What was found once is found again: a plan that was looked ahead for can be carried out."""
        with self.cell.within_budget():
            return self._found_once(state, (name, region), lambda: self._relocate(state, name, region, rng))

    def _relocate(self, state: State, name: str, region: int, rng: np.random.Generator) -> Done | Blocked:
        picks, why = self.picks(state, name)
        if not picks:
            return why
        there = self.place_pose(name, state.poses[name], region)
        if np.linalg.norm((there - state.poses[name])[:3, 3]) < LEAST_M:
            return Blocked("region", name, detail="it stands there already")
        if touch := self.cell.placed(self.scene.body(name), there, self.without(state, name)):
            return Blocked("region", touch.link, touch.body, detail=touch.detail)
        if not (picks := self._reached(state, name, picks, rng, int(self._in_vain < IN_VAIN))):
            return NO_WAY
        centre, tries, tight, rest = self.scene.regions()[region], 0, list[tuple[Pick, Place]](), self.without(state, name)

        def ways(picks: Iterable[Pick]) -> Iterator[tuple[Pick, Place]]:
            nonlocal why
            for pick in picks:
                place = self.placing(state, pick).place(centre)
                if isinstance(place, Blocked):
                    why = place
                elif self._room.to_pick(state.poses, pick) and self._room.to_place(rest, pick, place):
                    yield pick, place
                else:
                    tight.append((pick, place))

        def wider() -> Iterator[Pick]:
            if tight and not any(self._room.to_pick(state.poses, pick) for pick, _ in tight):
                yield from self._ways(state).wider(name, self._picking_wider, self._room)

        for pick, place in chain(ways(picks), ways(wider()), tight):
            places = place.turned(*self.limits) if pick.carrying.task.upright.limited else [place]
            across = self._across(state, pick, np.array([turned.lower[0] for turned in places]), rng)
            if not isinstance(across, Blocked):
                place = next(turned for turned in places if np.array_equal(turned.lower[0], across.across[-1]))
                carry = replace(across, place=place)
                done = carried(self.cell, state, name, rest, carry, beside=False)
                return done if isinstance(done, Blocked) else replace(done, tight=not self._room.to_carry(rest, carry))
            why = across
            tries += across.stage == "transfer"
            if tries == self._picking.settings.tries:
                break
        return why

    def across_again(self, state: State, motion: Motion, q: Array, rng: np.random.Generator) -> Motion | Blocked:
        """From q (J,), where the arm stopped with an object in the hand, to where a transfer ends. state: before the pick."""
        assert motion.held is not None
        rest = self.without(state, motion.held.body)
        carrying = self.cell.problem(rest, float(motion.q[-1][self.robot.gripper_joint]), held=motion.held)
        path = self.cell.connect(carrying, self.robot.arm_q(q), self.robot.arm_q(motion.q[-1])[None], rng)
        if isinstance(path, Blocked):
            return replace(path, stage=motion.stage)
        rows = self.robot.with_arm(path, q[self.robot.gripper_joint])
        again = replace(motion, q=rows, t_s=np.arange(len(rows), dtype=float), qd=None, qdd=None)
        return timed(self.cell, rest, [again], self.pace)[0]

    @cached_property
    def target_grasps(self) -> Sequence[Grasp] | LazyList[Grasp]:
        """With which grasps the target may be taken out; a list that is found as far as it is asked for where any will do."""
        if self._more_grasps is None:
            return self._listed_grasps
        return LazyList(chain(self._listed_grasps, self._more_grasps(self._picking.settings.sampling)))

    def picks(self, state: State, name: str, grasps: Sequence[Grasp] | LazyList[Grasp] | None = None) -> tuple[list[Pick], Blocked]:
        """The ways to take hold of an object that hold up to all checks but RRT-Connect's, the least to turn first; and why others don't.

        grasps: by default, those sampled on the object's shape with the scene's approaches.
        """
        return self._ways(state).picks(name, self._picking, grasps)

    def out_of_reach(self, state: State, name: str) -> bool:
        """Whether it was found that an object can't be picked as things are: nothing holds up to the static checks, or the arm does not get
        to any of what does; or that no more ways to it are sought, after so many in vain."""
        ways = self._ways(state)
        if name in ways.reached:
            return not ways.reached[name]
        return all(isinstance(ways.transits.get(pick), Blocked) for pick in self.picks(state, name)[0])

    def gets_to(self, state: State, name: str, rng: np.random.Generator) -> bool:
        """Whether the arm gets to one of the picks of an object, or of the target with one of its grasps: a path is sought to each that was
        not sought before, until one is found, or to all together."""
        picks, _ = self.picks(state, name, self.target_grasps if name == self.scene.target_name else None)
        return any(not isinstance(self._transit(state, pick, rng), Blocked) for pick in self._reached(state, name, picks, rng, PATIENTLY))

    def obstructions(self, poses: Mapping[str, Array], *, roughly: bool = False, fingers: bool = True) -> View:
        """What is in the way of what, if objects stand at poses: for plans that look ahead. roughly: without closing fingers and lift;
        fingers: whether it is asked what they meet as they close."""
        if fingers not in self._obstruction:
            target, picking, target_grasps = self.scene.target_name, self._picking, self.target_grasps
            self._obstruction[fingers] = Obstruction(
                self.cell,
                lambda name, T: target_grasps if name == target else picking.grasps({name: T}, name),
                ik=picking.settings.ik,
                fingers=fingers,
            )
        return self._obstruction[fingers].at(poses, WAY_IN if roughly else WHOLE_WAY)

    @property
    def supports(self) -> Supports:
        """Which of the scene's objects rest on which."""
        return self.cell.supports

    @property
    def partly_unseen(self) -> bool:
        """Whether space that nobody has seen is among the obstacles."""
        return self.cell.partly_unseen

    @cached_property
    def thorough(self) -> Motions:
        """The same motions with more grasps to choose from and more of the arm's solutions for them: slower, for where the quick look finds
        no way. What it finds, these find again."""
        return self._with(THOROUGH)

    @cached_property
    def exhaustive(self) -> Motions:
        """The same with as many grasps as can be looked at, for what is to be proved. Where grasps are costly to sample, the thorough look
        is all."""
        return self._with(EXHAUSTIVE) if can_be_exhaustive(self.robot, self.scene) else self.thorough

    @cached_property
    def varied(self) -> Motions:
        """The same, but of those grasps some that are unlike one another: where nothing can be done with the most natural ones."""
        other = self._with(replace(VARIED, sampling=self.exhaustive._picking.settings.sampling))
        other._patience = Patience(self.settings.patience, self.cell.iterations)
        return other

    @cached_property
    def finest(self) -> HandSubdivision | None:
        """What proofs rest on: only to ask whether something is stuck. None where no look is finer than the exhaustive one: with
        meshes, with what does not stand upright, with plates and thin walls, and with a hand of one's own whose pads are askew, where each
        grasp has to be judged. What it calls closed is so whatever unseen space holds; a hand that it finds keeps out of that."""
        if not can_be_exhaustive(self.robot, self.scene) or not can_be_shrunk(self.scene):
            return None
        return HandSubdivision(self.robot, self.scene, self.settings, self.cell)

    @cached_property
    def if_free(self) -> Motions:
        """The same as if all space that nobody has seen were free; not to be carried out, but to know what is worth a look or a move."""
        if not self.partly_unseen:
            return self
        return Motions(
            self.robot, self.scene, iterations=self.cell.iterations, time_budget_s=self.cell.time_budget_s, settings=self.settings,
            target_grasps=self._listed_grasps, more_grasps=self._more_grasps, pace=self.pace,
        )  # fmt: skip

    def with_hands(self, poses: Mapping[str, Array], hands: Mapping[str, Sequence[Grasp]]) -> Motions:
        """The exhaustive look with some more grasps of objects that stand at poses."""
        other, known, ik = copy(self.exhaustive), self.exhaustive._obstruction, ik_for_proofs(self.cell.arm)
        other._picking = self.exhaustive._picking.with_more(poses, hands, ik)
        other._states = deque(maxlen=KEPT)
        other._obstruction = {fingers: obstruction.with_more(poses, hands, ik) for fingers, obstruction in known.items()}
        return other

    def reaches_closely(self, poses: Mapping[str, Array], standing: frozenset[str]) -> bool:
        """Whether a redundant arm can take the target while only `standing` and the target stand, its solutions being looked for as closely
        as proofs ask; the others' few are all found by the thorough look."""
        if not self.cell.arm.redundant:
            return False
        closely = Obstruction(self.cell, lambda *_: self.thorough.target_grasps, ik=ik_for_proofs(self.cell.arm))
        return closely.at(poses).free(self.scene.target_name, standing)

    def _with(self, settings: PickSettings) -> Motions:
        other = copy(self)
        other._picking, other._states, other._obstruction = Picking(self.cell, settings), deque(maxlen=KEPT), {}
        for found in ("target_grasps", "thorough", "exhaustive", "varied", "finest"):
            other.__dict__.pop(found, None)
        return other

    def _found_once(self, state: State, question: Choice | None, find: Callable[[], Done | Blocked]) -> Done | Blocked:
        """What was found for a state before, or what is found now; a failure may be by chance, and is not kept."""
        known = self._done.setdefault(state, {})
        if question in known:
            self._ways(state)
            return known[question]
        found = find()
        if isinstance(found, Done):
            known[question] = found
        return found

    def placing(self, state: State, pick: Pick) -> Placing:
        """The ways to put down what a pick takes hold of."""
        return self._ways(state).placing(pick)

    def _transit(self, state: State, pick: Pick, rng: np.random.Generator) -> Array | Blocked:
        """From where the arm is to the beginning of a pick's approach, with the fingers at its opening, or where they can't be set to that
        yet, as they are."""
        known = self._ways(state).transits
        if pick not in known:
            gripper = gripper_on_the_way(self.cell, state, pick)
            if isinstance(gripper, Blocked):
                known[pick] = gripper
            else:
                known[pick] = self.cell.connect(self.cell.problem(state.poses, gripper), self.robot.arm_q(state.q), pick.approach[:1], rng)
        return known[pick]

    def _reached(self, state: State, name: str, picks: list[Pick], rng: np.random.Generator, searches: int = 1) -> list[Pick]:
        """Those of an object's picks that a place is sought for: all, or where ways to all are sought together, those that one was found
        to in so many searches."""
        ways, settings = self._ways(state), self._picking.settings
        if not settings.together or self.cell.time_budget_s is not None:
            return picks
        found, more = ways.reached.setdefault(name, {}), searches - ways.searches[name]
        if not found and more > 0:
            found |= reached(self.cell, state, picks, rng, most=settings.tries, iterations=settings.together, searches=more)
            ways.searches[name] = searches
            ways.transits |= found
            self._in_vain += not found
        return list(found)

    def _across(self, state: State, pick: Pick, goals: Array, rng: np.random.Generator) -> Carry | Blocked:
        """A way to carry what was lifted to one of goals (G, A), by a pick or by the same with joints whole turns further, and to get to
        that pick; not to a place yet."""
        ways = self._ways(state)
        failures = ways.failures
        iterations = self._patience.iterations(failures[pick]) if self.cell.time_budget_s is None else None
        passage = ways.reached.get(pick.held.body, {}).get(pick)
        picks, known = (self.turned(state, pick), []) if passage is None else ([pick], [passage[::-1]])  # out by the way in
        starts = np.array([turned.lift[-1] for turned in picks])
        path = self.cell.connect(pick.carrying, starts, goals, rng, iterations, known)
        if isinstance(path, Blocked):
            failures[pick] += 1
            self._patience.failed(iterations or 0)
            return replace(path, stage="transfer")
        pick = next(turned for turned in picks if np.array_equal(turned.lift[-1], path[0]))
        way_in = self._transit(state, pick, rng)
        return way_in if isinstance(way_in, Blocked) else Carry(pick, None, way_in, path)

    def turned(self, state: State, pick: Pick) -> list[Pick]:
        """A pick, and where what it holds must stay upright, the same with joints whole turns further."""
        return self._ways(state).turned(pick)

    @property
    def state(self) -> State:
        """The state that was asked about last. Raises: ValueError before the first question."""
        if not self._states:
            raise ValueError("nothing was asked about any state yet")
        return self._states[-1].state

    def _ways(self, state: State) -> StateWays:
        """What is known of a state; the states that were asked about last are remembered."""
        if self._states and self._states[-1].state is state:
            return self._states[-1]
        found = next((known for known in self._states if known.state is state), None)
        if found is not None:
            self._states.remove(found)
        self._states.append(found or StateWays(self.cell, state))
        return self._states[-1]

    def without(self, state: State, name: str) -> dict[str, Array]:
        """The poses of the objects besides one."""
        return self.cell.without(state.poses, name)
