"""The retrieval loop without being told the truth: look, plan on what was seen, move, look again (paper, section III-E).

The world is only asked for pictures, told to move, and asked where the arm is (`planning.sensing.world`). What a simulated one says of the
truth is for the record: motions with the objects where they truly were in the hand are judged at the end, and not before. When an execution
stops half-way, the loop looks again and plans on from where the arm is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Grasp, Scene, State
from kinematics.transforms import Array
from perception.belief import observation
from perception.objects.clustering import NoSurfaces
from planning.conclusion import conclude
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.plan import Blocked, Fault, Motion, Move, Plan
from planning.retrieval import Policy, proposals
from planning.rules import Rule
from planning.sensing.belief_state import BeliefState
from planning.sensing.carrying_out import Driven, carry_out
from planning.sensing.focus import wanted
from planning.sensing.hiding_places import smallest
from planning.sensing.look_around import Limits, Looked
from planning.sensing.settings import LOOP, SENSING, LoopSettings, SensingSettings
from planning.sensing.world import AsBelieved, Truth, World
from planning.stopwatch import Stopwatch
from planning.target_grasps.allowed import GraspChoice, TargetGrasps, target_grasps
from planning.verdict import Settings, judge_motions

HIDDEN = "unknown_"  # how the names of boxes around unseen space begin
SAID_M = 2e-4  # what is pushed by less is not worth a word


def retrieve_unseen(
    world: World,
    robot: Robot,
    scene: Scene,
    policy_for: Callable[[Motions, int], Policy],
    *,
    truth: Truth | None = None,
    target_box: Array | None = None,
    name: str,
    settings: LoopSettings = LOOP,
    sensing: SensingSettings = SENSING,
    rng: np.random.Generator,
    on_step: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan the way to the target from nothing but pictures, as `planning.retrieval.retrieve` does from the truth.

    robot, scene: the cell, with the target's name and x_g; its objects are not looked at, but for the verdict at the end where there is a
    `truth`. policy_for: makes the policy for what is believed at a moment, and so many moves. target_box (6,): where the target is,
    see `perception.belief`. name: what the policy is called in the plan. on_step: told of each step as it is taken.
    The reason is stage "look" when the target was not found; otherwise what blocked the last attempt. Its motions are judged twice: by what
    was seen when they were planned, where those that do not hold are not carried out, and by the truth at the end, if there is one;
    `verified` and the reason "verify" tell.
    """
    known = truth or AsBelieved()
    mind = BeliefState(robot, scene, rng, sensing, target_box=target_box, pace=settings.pace)
    loop = _Loop(world, known, mind, policy_for, settings, sensing, rng, on_step, limits=sensing.first, patience=sensing.patience)
    ended = None if mind.start_blocked is None else _Ended(mind.start_blocked)
    while ended is None:
        ended = loop.round()
    record, is_truth = loop.record, truth is not None
    plan = conclude(
        robot, scene if is_truth else replace(scene, objects=mind.belief.bodies), ended.why, record.moves, record.way,
        name=name, rule=settings.rule, thinking=loop.thinking, moving=loop.moving,
        settings=settings.motion, grasp=ended.grasp, is_truth=is_truth, max_moves=settings.max_moves,
    )  # fmt: skip
    notes = (*plan.notes, *assumed(mind), *pushed(known))
    return replace(plan, target_blocked=tuple(record.kept_in), notes=notes)


@dataclass(frozen=True)
class _Ended:
    """How the loop ends: why the target is not out, None when it is, with the grasp that took it."""

    why: Blocked | None
    grasp: Grasp | None = None


@dataclass(frozen=True, eq=False)
class _Tried:
    """What came of the policy's proposals. moved: an object was moved; stopped: an execution that ended before an object was put down;
    hindered: objects that can't be moved, and why."""

    moved: bool = False
    stopped: Driven | None = None
    hindered: Sequence[tuple[str, Blocked]] = ()


@dataclass(eq=False)
class _Record:
    """What the plan will say. kept_in: for each number of moves done, why the target could not be taken then."""

    moves: list[Move] = field(default_factory=list)
    way: list[Motion] = field(default_factory=list)
    kept_in: list[Blocked] = field(default_factory=list)


@dataclass(eq=False)
class _Loop:
    """The state of the loop between two looks. limits, focus: of the next look; aimed: whether its views are sought for the focus alone;
    failed: objects and regions that came to nothing since the last change; patience: looks that may still follow without a move; steps: of
    the policy; stops: of the world."""

    world: World
    known: Truth
    mind: BeliefState
    policy_for: Callable[[Motions, int], Policy]
    settings: LoopSettings
    sensing: SensingSettings
    rng: np.random.Generator
    on_step: Callable[[str], None]
    limits: Limits
    patience: int
    focus: Array | None = None
    aimed: bool = False
    steps: int = 0
    stops: int = 0
    failed: set[tuple[str, int]] = field(default_factory=set)
    record: _Record = field(default_factory=_Record)
    thinking: Stopwatch = field(default_factory=Stopwatch)
    moving: Stopwatch = field(default_factory=Stopwatch)

    def round(self) -> _Ended | None:
        """Look, then take the target if there is a way, else move something, else look where it may help; the end, if this was it."""
        mind, record = self.mind, self.record
        with self.moving:
            looked = mind.look(self.world, self.limits, self.focus, self.on_step, aimed=self.aimed)
        record.way += looked.motions
        try:
            with self.moving:
                mind.understand()
        except NoSurfaces as e:
            return _Ended(Blocked("look", body=mind.empty_scene.target_name, detail=f"the target was not found: {e}"))
        with self.moving:
            motions, state = self.ready()
            taken = _try_target(mind, looked, motions, state, self.rng)
            if isinstance(taken, Blocked) and self.count_by_size():
                motions, state = self.ready()
                taken = _try_target(mind, looked, motions, state, self.rng)
        if not isinstance(taken, Blocked):
            return self.take_out(motions, state, taken)
        record.kept_in[sum(move.done for move in record.moves) :] = [taken]
        tried = _Tried()
        if self.steps < self.settings.max_moves and mind.belief.body(mind.empty_scene.target_name) is not None:
            tried = self.move_something(motions, state)
        if tried.stopped is not None:
            if tried.stopped.holding or self.stops == self.sensing.most_stops:
                return _Ended(tried.stopped.why or taken)
            self.look_after_stop(tried.stopped.q)
            return None
        if tried.moved:
            self.steps, self.patience = self.steps + 1, self.sensing.patience
            with self.moving:
                self.next_look(self.sensing.after_move, wanted(mind.empty_scene, mind.robot, mind.belief))
            return None
        return None if self.look_closer(motions, state, tried.hindered) else _Ended(taken)

    def count_by_size(self) -> bool:
        """From now on take unseen space into which nothing fits for free, so that an object is moved that has to be; False when that is
        done already, not wished, or no help."""
        mind = self.mind
        if mind.by_size or mind.sensing.smallest_m <= 0 or mind.belief.body(mind.empty_scene.target_name) is None:
            return False
        mind.by_size = True
        self.on_step(f"unseen space is free from now on where nothing of {1e3 * mind.sensing.smallest_m:g} mm fits in")
        return True

    def ready(self) -> tuple[Motions, State]:
        """Motion planning for what is believed now."""
        mind, asked = self.mind, self.settings
        scene = replace(mind.empty_scene, objects=mind.belief.bodies)
        found: TargetGrasps | str = TargetGrasps((scene.x_g,))
        if asked.grasp is not GraspChoice.GIVEN and mind.belief.body(scene.target_name) is not None:
            found = target_grasps(mind.robot, scene, asked.grasp)
        grasps = TargetGrasps(()) if isinstance(found, str) else found
        motions = Motions(
            mind.robot, scene, iterations=asked.iterations, time_budget_s=asked.time_budget_s, obstacles=mind.unseen_boxes(),
            settings=asked.motion, target_grasps=grasps.first, more_grasps=grasps.more, pace=asked.pace,
        )  # fmt: skip
        return motions, State(mind.q, scene.poses())

    def take_out(self, motions: Motions, state: State, taken: Done) -> _Ended | None:
        """Carry the last motions out; None when they are in doubt, or stopped before the target was in the hand, and there is another
        try."""
        target = self.mind.empty_scene.target_name
        with self.moving:
            doubts = _as_seen(self.mind, state, taken.motions, self.settings.motion.max_tilt_deg, taken.grasp)
        if doubts:
            return self.look_after_doubt(doubts[0])
        names = self.known.names(self.mind.belief.bodies)
        driven = self.carry_out(motions, state, taken.motions, names)
        if driven.why is not None and not driven.holding and driven.released is None and self.stops < self.sensing.most_stops:
            self.look_after_stop(driven.q)
            return None
        if driven.why is not None:
            return _Ended(driven.why, taken.grasp)
        if names[target] != target:
            return _Ended(Blocked("verify", body=names[target], detail=f"it was taken for the target {target}"), taken.grasp)
        return _Ended(None, taken.grasp)

    def move_something(self, motions: Motions, state: State) -> _Tried:
        """Carry out the first of the policy's proposals for which there are motions."""
        mind, hindered, out_of_reach = self.mind, list[tuple[str, Blocked]](), set[str]()
        seen = observation(mind.empty_scene, mind.q, mind.belief)
        policy = self.policy_for(motions, self.settings.max_moves - self.steps)
        for object_name, region in proposals(policy, seen, self.settings.rule, self.failed, self.rng, self.thinking, out_of_reach):
            with self.moving:
                done = self.relocation(motions, state, object_name, region)
            names = self.known.names(mind.belief.bodies)
            its = names[object_name]
            T_from = self.known.poses_now(state.poses)[its]
            if isinstance(done, Blocked):
                self.failed.add((object_name, region))
                T_to = motions.place_pose(object_name, T_from, region)
                self.record.moves.append(Move(its, region, T_from, T_to, False, done))
                hindered.append((object_name, done))
                if not motions.picks(state, object_name)[0]:
                    out_of_reach.add(object_name)  # another region would not help
                continue
            driven = self.carry_out(motions, state, done.motions, names)
            if driven.why is not None and driven.released is None:
                return _Tried(stopped=driven, hindered=hindered)
            self.on_step(f"moved {object_name} to region {region}")
            self.record.moves.append(Move(its, region, T_from, self.known.poses_now(done.after.poses)[its], True))
            mind.moved(object_name, done.after.poses[object_name], driven.q)
            self.failed.clear()
            return _Tried(moved=True, hindered=hindered)
        return _Tried(hindered=hindered)

    def relocation(self, motions: Motions, state: State, name: str, region: int) -> Done | Blocked:
        """The motions, timed, that move an object to a region and hold by what was seen."""
        done = motions.relocate(state, name, region, self.rng)
        if isinstance(done, Blocked):
            return done
        ((_, done),) = motions.quickest([(state, done)], self.rng)
        planned = motions.trajectories(state, done.motions)
        doubts = _as_seen(self.mind, state, planned, self.settings.motion.max_tilt_deg)
        return Blocked(doubts[0].stage, body=name, detail=doubts[0].detail) if doubts else replace(done, motions=planned)

    def look_closer(self, motions: Motions, state: State, hindered: Sequence[tuple[str, Blocked]]) -> bool:
        """Aim the next look at what is in the way; False when the loop is to end instead."""
        mind = self.mind
        with self.moving:
            names = _hidden(motions, state, hindered, self.sensing.most_hidden)
            focus = wanted(mind.empty_scene, mind.robot, mind.belief, names, mind.unseen_voxels())
        shown = self.focus is None or not np.array_equal(self.focus > 0, focus > 0)
        if self.patience == 0 or not focus.any() or (self.aimed and not shown):
            # the last look has not shown any of what it was to show, though it was aimed at it
            self.steps += 1
            if self.settings.rule is Rule.DEEP or self.steps >= self.settings.max_moves:
                return False
            self.next_look(self.sensing.once, None)  # the step is lost; the policy may have something else to propose
            return True
        self.next_look(self.sensing.when_stuck, focus, aimed=not shown)  # look where it may help, and try once more
        self.patience -= 1
        self.failed.clear()
        return True

    def look_after_doubt(self, doubt: Fault) -> _Ended | None:
        """What was planned does not hold by what was seen, and is not carried out: look again, or end where that was done often enough."""
        if self.patience == 0:
            return _Ended(Blocked(doubt.stage, body=self.mind.empty_scene.target_name, detail=doubt.detail))
        self.on_step(f"not carried out: {doubt}")
        self.next_look(self.sensing.when_stuck, None)
        self.patience -= 1
        return None

    def look_after_stop(self, q: Array) -> None:
        """The arm stopped at q (J,): look again, and plan on from there."""
        self.mind.q, self.stops = q, self.stops + 1
        self.next_look(self.sensing.after_move, None)

    def next_look(self, limits: Limits, focus: Array | None, *, aimed: bool = False) -> None:
        """Say how the next look is to be. aimed: by views that are sought for the focus (X, Y, Z) alone."""
        self.limits, self.focus, self.aimed = limits, focus, aimed

    def carry_out(self, motions: Motions, state: State, planned: Sequence[Motion], names: Mapping[str, str]) -> Driven:
        """Carry motions out, and put them on record. names: of the objects in the world, by those in what is believed."""
        driven = carry_out(
            self.world, self.known, motions, state, planned, names, self.rng, self.on_step, most_stops=self.sensing.most_stops
        )
        self.record.way += driven.motions
        return driven


def assumed(mind: BeliefState) -> tuple[Fault, ...]:
    """What the plan took for granted, as a note."""
    if not mind.by_size:
        return ()
    least = smallest(mind.belief.bodies, mind.sensing.smallest_m)
    return (Fault("look", (), "unseen space into which nothing of this size fits was taken for free", least),)


def pushed(known: Truth) -> tuple[Fault, ...]:
    """What the fingers pushed as they closed on it, as notes."""
    return tuple(
        Fault("grasp", (name,), f"the fingers push {name} by {1000 * way_m:.1f} mm as they close on it", way_m)
        for name, way_m in known.pushed().items()
        if way_m > SAID_M
    )


def _as_seen(mind: BeliefState, state: State, motions: Sequence[Motion], max_tilt_deg: float, grasp: Grasp | None = None) -> list[Fault]:
    """What the verdict finds wrong with motions in the world as it was seen: what was not seen is left to the planner."""
    arm = replace(mind.empty_scene.robot, q_start=dict(zip(mind.robot.joint_names, map(float, state.q))))  # where it is now
    bodies = tuple(replace(b, T_world_body=state.poses[b.name]) for b in mind.belief.bodies)
    scene = replace(mind.empty_scene, robot=arm, objects=bodies)
    found = judge_motions(scene, motions, mind.robot, Settings(max_tilt_deg=max_tilt_deg), grasp=grasp)
    return [replace(fault, detail=f"as it was seen: {fault.detail}") for fault in found]


def _try_target(mind: BeliefState, looked: Looked, motions: Motions, state: State, rng: np.random.Generator) -> Done | Blocked:
    """The motions that take the target out, or why there are none."""
    target = mind.empty_scene.target_name
    if mind.belief.body(target) is None:
        return Blocked("look", body=target, detail=f"the target was not found: {looked.reason}")
    taken = motions.retrieve_target(state, rng)
    if isinstance(taken, Blocked):  # a policy that looks ahead has reckoned with the thorough look
        thorough = motions.thorough.retrieve_target(state, rng)
        if isinstance(thorough, Blocked):
            return taken
        taken = thorough
    ((_, taken),) = motions.quickest([(state, taken)], rng)
    return replace(taken, motions=motions.trajectories(state, taken.motions))


def _hidden(motions: Motions, state: State, failed: Sequence[tuple[str, Blocked]], most: int) -> list[str]:
    """At most so many objects that can't be moved for what was not seen: those tried, else all, nearest to x_g first."""
    at = motions.scene.x_g.T_world_hand[:2, 3]
    near = sorted(state.poses, key=lambda name: float(np.linalg.norm(state.poses[name][:2, 3] - at)))
    for names in ([name for name, _ in failed], [name for name in near if name != motions.scene.target_name]):
        if found := list(islice((name for name in dict.fromkeys(names) if _is_hidden(motions, state, name)), most)):
            return found
    return []


def _is_hidden(motions: Motions, state: State, name: str) -> bool:
    """Whether an object can't be picked, but could be if what nobody has seen were free; asked closely only once the target was found."""
    picks, why = motions.picks(state, name)
    if picks:
        return False
    target, said = motions.scene.target_name, (why.body or "").startswith(HIDDEN)
    if said or target not in state.poses:
        return said
    return motions.if_free.exhaustive.obstructions(state.poses).free(name, frozenset(state.poses) - {name, target})
