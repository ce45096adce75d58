"""The retrieval loop without being told the truth: look, plan on what was seen, move, look again (paper, section III-E).

The world is only asked for pictures, told to move, and asked where the arm is (`planning.sensing.world`). What a simulated one says of the
truth is for the record: motions with the objects where they truly were in the hand are judged at the end, and not before. When an execution
stops half-way, the loop looks again and plans on from where the arm is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene, State
from kinematics.transforms import Array
from perception.belief import Belief, believe, observation, without_bodies, without_objects
from perception.frames import Frame
from perception.mapping.voxels import FREE, UNKNOWN, unknown_voxels
from perception.objects.clustering import NoSurfaces
from perception.rendering.synthetic_camera import DEFAULT
from planning.motion.carry import Done
from planning.motion.pick_place import ITERATIONS, Motions
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.motion.trajectory import FULL, Pace
from planning.plan import Blocked, Fault, Motion, Move, Plan
from planning.retrieval import MAX_MOVES, Policy, Rule, Stopwatch, conclude, proposals
from planning.sensing.focus import wanted
from planning.sensing.look_around import BODY_MARGIN_M, Limits, Looked, look_around, skin, unknown_space
from planning.sensing.world import AsBelieved, Truth, World, configuration, part_done, with_own_pixels
from planning.target_grasps import GraspChoice, TargetGrasps, target_grasps
from planning.verdict import Settings, judge_motions

FIRST = Limits(0.99, 0.001, 10)
AGAIN = Limits(1.0, 0.0004, 5, 0.001)  # after a move: what was hidden behind the object
HARDER = Limits(1.0, 0.0004, 3, 0.0)  # when nothing works with what is known: the current view, and two of what is in the way
ONCE = Limits(1.0, 1.0, 1)
PATIENCE = 4  # so often in a row
MOST_HIDDEN = 2  # objects to be moved that a look is aimed at, besides the target
MOST_STOPS = 3  # executions that may end half-way, before the loop does
HIDDEN = "unknown_"  # how the names of boxes around unseen space begin


class _BeliefState:
    """What has been gathered so far: pictures, the map, objects that were moved, and where the arm is."""

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        rng: np.random.Generator,
        *,
        by: Literal["mask", "geometry"] | None,
        noise_1m_m: float,
        target_box: Array | None,
        pace: Pace,
    ) -> None:
        self.by, self.target_box, self.pace = by, target_box, pace
        self.empty_scene = replace(scene, objects=(), observation=None)
        self.robot, self.rng, self.noise = robot, rng, noise_1m_m
        self.voxels, self.frames = unknown_voxels(self.empty_scene.cabinet), list[Frame]()
        self.tracked: dict[str, Body] = {}
        before_looking = Motions(self.robot, self.empty_scene)
        self.q, self.start_blocked = before_looking.start().q, before_looking.start_blocked()
        self.belief = Belief((), {}, self.voxels)

    def look(self, world: World, limits: Limits, focus: Array | None, on_step: Callable[[str], None]) -> Looked:
        base = self.empty_scene.robot.T_world_base

        def drive(motions: Sequence[Motion]) -> tuple[Sequence[Motion], Array]:
            stopped = world.execute(motions)
            if stopped is None:
                return motions, motions[-1].q[-1]
            q = configuration(self.robot, world.where())
            on_step(f"the way to a view stopped: {stopped.why}")
            return (*motions[: stopped.motion], part_done(motions[stopped.motion], q)), q

        looked = look_around(
            self.empty_scene, self.robot, lambda _, q: with_own_pixels(self.robot, base, world.take_frame(), q), self.q, self.voxels,
            self.rng, bodies=self.belief.bodies, limits=limits, focus=focus, noise_1m_m=self.noise,
            intrinsics=getattr(world, "intrinsics", DEFAULT), pace=self.pace, drive=drive, on_step=on_step,
        )  # fmt: skip
        fresh = looked.frames
        if self.by is None:
            self.by = "geometry" if any(f.instance is None for f in fresh) else "mask"
        if self.by == "geometry":
            fresh = tuple(without_bodies(f, tuple(self.tracked.values()), self.noise) for f in fresh)
        self.frames += fresh
        self.voxels, self.q = looked.voxels, looked.q
        return looked

    def understand(self) -> None:
        """Believe what all pictures together show. Raises: NoSurfaces when they show nothing but noise."""
        self.belief = believe(
            self.empty_scene, self.frames, self.voxels,
            by=self.by or "geometry", target_box=self.target_box, tracked=self.tracked, before=self.belief.bodies,
        )  # fmt: skip

    def moved(self, name: str, T_world_body: Array, q: Array) -> None:
        """An object has been put down: the room that it took is free now, and where it stands is its own."""
        body = self.belief.body(name)
        assert body is not None
        if self.by == "geometry" and name not in self.tracked:  # what shows it there is past
            before = (without_objects(f, (name,)) for f in self.belief.frames)
            self.frames = [replace(f, instance=None, names=()) for f in before]
        self.tracked[name] = replace(body, T_world_body=T_world_body)
        left = self.voxels.touched(body, BODY_MARGIN_M) | skin(self.voxels, [body])
        self.voxels = self.voxels.marked(left, FREE).marked(self.voxels.touched(self.tracked[name]), UNKNOWN)
        bodies = tuple(self.tracked.get(b.name, b) for b in self.belief.bodies)
        self.belief, self.q = replace(self.belief, bodies=bodies, voxels=self.voxels), q


def retrieve_unseen(
    world: World,
    robot: Robot,
    scene: Scene,
    policy_for: Callable[[Motions], Policy],
    *,
    truth: Truth | None = None,
    by: Literal["mask", "geometry"] | None = "mask",
    noise_1m_m: float = 0.0,
    name: str,
    rule: Rule = Rule.DEEP,
    max_moves: int = MAX_MOVES,
    iterations: int = ITERATIONS,
    time_budget_s: float | None = None,
    target_box: Array | None = None,
    settings: MotionSettings = DEFAULTS,
    pace: Pace = FULL,
    grasp: GraspChoice = GraspChoice.GIVEN,
    rng: np.random.Generator,
    on_step: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan the way to the target from nothing but pictures, as `planning.retrieval.retrieve` does from the truth.

    robot, scene: the cell, with the target's name and x_g; its objects are not looked at, but for the verdict at the end where there is a
    `truth`. policy_for: makes the policy for what is believed at a moment. by: how objects are told apart; None: by masks, if the frames
    have some. noise_1m_m: of the camera's depth at one metre. target_box (6,): where the target is, see `perception.belief`.
    pace: how fast the arm is driven. grasp: with which grasps the target may be taken, x_g being what is looked for.
    The reason is stage "look" when the target was not found; otherwise what blocked the last attempt. Its motions are judged twice: by what
    was seen when they were planned, and by the truth at the end, if there is one; `verified` and the reason "verify" tell.
    """
    thinking, moving, steps = Stopwatch(), Stopwatch(), 0
    moves: list[Move] = []
    way: list[Motion] = []
    doubts: list[Fault] = []
    known = truth or AsBelieved()
    mind = _BeliefState(robot, scene, rng, by=by, noise_1m_m=noise_1m_m, target_box=target_box, pace=pace)
    limits, focus, patience, stops = FIRST, None, PATIENCE, 0
    failed: set[tuple[str, int]] = set()
    took: Grasp | None = None
    kept_in: list[Blocked] = []
    if mind.start_blocked is not None:
        return conclude(robot, scene, mind.start_blocked, moves, way, name=name, rule=rule, thinking=thinking, moving=moving)
    while True:
        with moving:
            looked = mind.look(world, limits, focus, on_step)
        way += looked.motions
        try:
            with moving:
                mind.understand()
        except NoSurfaces as e:
            taken: Done | Blocked = Blocked("look", body=scene.target_name, detail=f"the target was not found: {e}")
            break
        with moving:
            motions, state = _ready(mind, iterations, time_budget_s, settings, grasp)
            taken = _try_target(mind, looked, motions, state, rng)
        if not isinstance(taken, Blocked):
            with moving:
                doubts += _as_seen(mind, state, taken.motions, settings.max_tilt_deg, taken.grasp)
            names = known.names(mind.belief.bodies)
            driven = _carry_out(world, known, motions, state, taken.motions, names, rng, on_step)
            way += driven.motions
            if driven.why is not None and not driven.holding and driven.released is None and stops < MOST_STOPS:
                mind.q, limits, focus, stops = driven.q, AGAIN, None, stops + 1
                continue
            took = taken.grasp
            if driven.why is not None:
                taken = driven.why
            elif names[scene.target_name] != scene.target_name:
                taken = Blocked("verify", body=names[scene.target_name], detail=f"it was taken for the target {scene.target_name}")
            break
        kept_in[sum(move.done for move in moves) :] = [taken]
        moved, stopped = False, None
        hindered = list[tuple[str, Blocked]]()
        if steps < max_moves and mind.belief.body(scene.target_name) is not None:
            seen = observation(mind.empty_scene, mind.q, mind.belief)
            for object_name, region in proposals(policy_for(motions), seen, rule, failed, rng, thinking):
                with moving:
                    done = motions.relocate(state, object_name, region, rng)
                names = known.names(mind.belief.bodies)
                its = names[object_name]
                T_from = known.poses_now(state.poses)[its]
                if isinstance(done, Blocked):
                    failed.add((object_name, region))
                    moves.append(Move(its, region, T_from, motions.place_pose(object_name, T_from, region), False, done))
                    hindered.append((object_name, done))
                    continue
                with moving:
                    ((_, done),) = motions.quickest([(state, done)], rng)
                    planned = motions.trajectories(state, done.motions)
                    doubts += _as_seen(mind, state, planned, settings.max_tilt_deg)
                driven = _carry_out(world, known, motions, state, planned, names, rng, on_step)
                way += driven.motions
                if driven.why is not None and driven.released is None:
                    stopped = driven
                    break
                on_step(f"moved {object_name} to region {region}")
                moves.append(Move(its, region, T_from, known.poses_now(done.after.poses)[its], True))
                mind.moved(object_name, done.after.poses[object_name], driven.q)
                failed.clear()
                moved = True
                break
        if stopped is not None:
            if stopped.holding or stops == MOST_STOPS:
                taken = stopped.why or taken
                break
            mind.q, limits, focus, stops = stopped.q, AGAIN, None, stops + 1
            continue
        if moved:
            steps, patience, limits = steps + 1, PATIENCE, AGAIN
            with moving:
                focus = wanted(mind.empty_scene, mind.robot, mind.belief)
            continue
        with moving:
            before, focus = focus, wanted(mind.empty_scene, mind.robot, mind.belief, _hidden(motions, state, hindered))
        if patience == 0 or not focus.any() or (before is not None and np.array_equal(before > 0, focus > 0)):
            # the last look has not shown any of what it was to show
            steps += 1
            if rule is Rule.DEEP or steps >= max_moves:
                break
            limits, focus = ONCE, None  # the step is lost; the policy may have something else to propose
            continue
        limits, patience = HARDER, patience - 1  # look where it may help, and try once more
        failed.clear()
    why = taken if isinstance(taken, Blocked) else None
    ended = scene if truth is not None else replace(scene, objects=mind.belief.bodies)
    plan = conclude(
        robot, ended, why, moves, way,
        name=name, rule=rule, thinking=thinking, moving=moving, settings=settings, grasp=took, faults=doubts, is_truth=truth is not None,
    )  # fmt: skip
    return replace(plan, target_blocked=tuple(kept_in))


@dataclass(frozen=True, eq=False)
class _Driven:
    """What became of motions that were to be carried out: as they were, for the record; where the arm is, q (J,); why it stopped, None when
    all is done. released: the object that was put down, if one was; holding: whether one is in the hand."""

    motions: tuple[Motion, ...]
    q: Array
    why: Blocked | None = None
    released: str | None = None
    holding: bool = False


def _carry_out(
    world: World,
    known: Truth,
    motions: Motions,
    state: State,
    planned: Sequence[Motion],
    names: Mapping[str, str],
    rng: np.random.Generator,
    on_step: Callable[[str], None],
) -> _Driven:
    """Carry motions out; a transfer that stops half-way is planned anew from where the arm is, and gone on with."""
    done, left, before = list[Motion](), list(planned), known.poses_now(state.poses)
    for _ in range(MOST_STOPS + 1):
        stopped = world.execute(left)
        if stopped is None:
            return _Driven(known.recorded([*done, *left], names, before), left[-1].q[-1], None, _released([*done, *left]), False)
        q, at = configuration(motions.robot, world.where()), left[stopped.motion]
        on_step(f"{at.stage} stopped: {stopped.why}")
        done += [*left[: stopped.motion], part_done(at, q)]
        why = Blocked(at.stage, body=at.held.body if at.held else None, detail=f"the execution stopped: {stopped.why}")
        across = motions.across_again(state, at, q, rng) if at.held is not None and at.stage == "transfer" else why
        if isinstance(across, Blocked):
            break
        left = [across, *left[stopped.motion + 1 :]]
    return _Driven(known.recorded(done, names, before), q, why, _released(done), at.held is not None)


def _released(motions: Sequence[Motion]) -> str | None:
    """The object that the motions put down, None when they put none down."""
    held = [m.held.body for m in motions if m.held]
    return held[-1] if held and motions[-1].stage in ("release", "retreat") else None


def _as_seen(mind: _BeliefState, state: State, motions: Sequence[Motion], max_tilt_deg: float, grasp: Grasp | None = None) -> list[Fault]:
    """What the verdict finds wrong with motions in the world as it was seen: what was not seen is left to the planner."""
    arm, names = mind.empty_scene.robot, mind.robot.joint_names
    if arm.q_start is not None:  # where it was at first
        arm = replace(arm, q_start=dict(zip(names, map(float, state.q))))
    bodies = tuple(replace(b, T_world_body=state.poses[b.name]) for b in mind.belief.bodies)
    scene = replace(mind.empty_scene, robot=arm, objects=bodies)
    found = judge_motions(scene, motions, mind.robot, Settings(max_tilt_deg=max_tilt_deg), grasp=grasp)
    return [replace(fault, detail=f"as it was seen: {fault.detail}") for fault in found]


def _ready(
    mind: _BeliefState, iterations: int, time_budget_s: float | None, settings: MotionSettings, choice: GraspChoice
) -> tuple[Motions, State]:
    """Motion planning for what is believed now."""
    bodies = mind.belief.bodies
    scene, walls = replace(mind.empty_scene, objects=bodies), unknown_space(mind.voxels, bodies, blocks=1)
    found: TargetGrasps | str = TargetGrasps((scene.x_g,))
    if choice is not GraspChoice.GIVEN and mind.belief.body(scene.target_name) is not None:
        found = target_grasps(mind.robot, scene, choice)
    grasps = TargetGrasps(()) if isinstance(found, str) else found
    motions = Motions(
        mind.robot, scene, iterations=iterations, time_budget_s=time_budget_s, obstacles=walls, settings=settings,
        target_grasps=grasps.first, more_grasps=grasps.more, pace=mind.pace,
    )  # fmt: skip
    return motions, State(mind.q, scene.poses())


def _try_target(mind: _BeliefState, looked: Looked, motions: Motions, state: State, rng: np.random.Generator) -> Done | Blocked:
    """The motions that take the target out, or why there are none."""
    target = mind.empty_scene.target_name
    if mind.belief.body(target) is None:
        return Blocked("look", body=target, detail=f"the target was not found: {looked.reason}")
    taken = motions.retrieve_target(state, rng)
    if isinstance(taken, Blocked):
        return taken
    ((_, taken),) = motions.quickest([(state, taken)], rng)
    return replace(taken, motions=motions.trajectories(state, taken.motions))


def _hidden(motions: Motions, state: State, failed: Sequence[tuple[str, Blocked]]) -> list[str]:
    """At most two objects that can't be moved for what was not seen: those tried, else those out of reach, nearest to x_g first."""
    tried = [name for name, why in failed if (why.body or "").startswith(HIDDEN)]
    if tried:
        return list(dict.fromkeys(tried))[:MOST_HIDDEN]
    at = motions.scene.x_g.T_world_hand[:2, 3]
    near = sorted(state.poses, key=lambda name: float(np.linalg.norm(state.poses[name][:2, 3] - at)))
    others = ((name, *motions.picks(state, name)) for name in near if name != motions.scene.target_name)
    return list(islice((n for n, picks, why in others if not picks and (why.body or "").startswith(HIDDEN)), MOST_HIDDEN))
