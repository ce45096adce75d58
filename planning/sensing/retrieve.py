"""The retrieval loop without being told the truth: look, plan on what was seen, move, look again (paper, section III-E).

The world is only asked for pictures and told to move. It is a simulated one here; what it gives back, motions with the objects where they
truly were in the hand, is judged against the truth at the end, and not before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Held, Scene, State
from kinematics.transforms import Array, inverse
from perception.belief import Belief, believe, observation, without_bodies, without_objects
from perception.camera import DepthNoise
from perception.frames import Frame
from perception.mapping.voxels import FREE, UNKNOWN, unknown_voxels
from perception.objects.clustering import NoSurfaces
from perception.rendering.synthetic_camera import Camera, synthetic_camera
from planning.motion.carry import Done
from planning.motion.pick_place import ITERATIONS, Motions
from planning.motion.replay import hand_poses
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.motion.trajectory import FULL, Pace
from planning.plan import Blocked, Fault, Motion, Move, Plan
from planning.retrieval import MAX_MOVES, Policy, Rule, Stopwatch, conclude, proposals
from planning.sensing.focus import wanted
from planning.sensing.look_around import BODY_MARGIN_M, Limits, Looked, look_around, skin, unknown_space
from planning.target_grasps import GraspChoice, TargetGrasps, target_grasps
from planning.verdict import Settings, judge_motions

FIRST = Limits(0.99, 0.001, 10)
AGAIN = Limits(1.0, 0.0004, 5, 0.001)  # after a move: what was hidden behind the object
HARDER = Limits(1.0, 0.0004, 3, 0.0)  # when nothing works with what is known: the current view, and two of what is in the way
ONCE = Limits(1.0, 1.0, 1)
PATIENCE = 4  # so often in a row
MOST_HIDDEN = 2  # objects to be moved that a look is aimed at, besides the target
HIDDEN = "unknown_"  # how the names of boxes around unseen space begin


@dataclass(frozen=True, eq=False)
class Simulated:
    """A world that is known to the simulation alone: the scene's objects at poses, and the noise of the camera (None: clean).

    by: "mask" when its pictures say which pixels are which object's, under the scene's names; "geometry" when they say nothing.
    """

    robot: Robot
    scene: Scene
    poses: Mapping[str, Array]
    noise: DepthNoise | None = None
    by: Literal["mask", "geometry"] = "mask"

    def camera(self, rng: np.random.Generator) -> Camera:
        look = synthetic_camera(self.robot, self.scene, self.poses, noise=self.noise, rng=rng)
        if self.by == "mask":
            return look
        return lambda T_world_camera, q: replace(look(T_world_camera, q), instance=None, names=())

    def names(self, bodies: Sequence[Body]) -> dict[str, str]:
        """What the bodies that somebody believes in are truly called: after the objects that stand nearest."""
        if self.by == "mask":
            return {b.name: b.name for b in bodies}
        at = {name: T[:2, 3] for name, T in self.poses.items()}
        return {b.name: min(at, key=lambda n: float(np.linalg.norm(at[n] - b.T_world_body[:2, 3]))) for b in bodies}

    def move(self, motions: Sequence[Motion], names: Mapping[str, str]) -> tuple[tuple[Motion, ...], Simulated]:
        """Carry motions out: the same with the held object where it truly is in the hand, and the world afterwards.

        names: what the motions' objects are truly called.
        """
        poses, out, held = dict(self.poses), [], None
        for motion in (_under(motion, names) for motion in motions):
            if motion.held is not None:
                name = motion.held.body
                if held is None or held.body != name:
                    held = Held(name, inverse(hand_poses(self.robot, self.scene, motion.q[0])) @ poses[name])
                poses[name] = hand_poses(self.robot, self.scene, motion.q[-1]) @ held.T_hand_body
                out.append(replace(motion, held=held))
            else:
                held = None
                out.append(motion)
        return tuple(out), replace(self, poses=poses)


def _under(motion: Motion, names: Mapping[str, str]) -> Motion:
    """The motion with other names for the objects."""
    touch = tuple((names.get(a, a), names.get(b, b)) for a, b in motion.allowed_contacts)
    held = motion.held and Held(names.get(motion.held.body, motion.held.body), motion.held.T_hand_body)
    return replace(motion, allowed_contacts=touch, held=held)


class _BeliefState:
    """What has been gathered so far: pictures, the map, objects that were moved, and where the arm is."""

    def __init__(self, world: Simulated, rng: np.random.Generator, target_box: Array | None = None, pace: Pace = FULL) -> None:
        self.by, self.target_box, self.pace = world.by, target_box, pace
        self.empty_scene = replace(world.scene, objects=(), observation=None)
        self.robot, self.rng = world.robot, rng
        self.noise = world.noise.axial_1m_m if world.noise else 0.0
        self.voxels, self.frames = unknown_voxels(self.empty_scene.cabinet), list[Frame]()
        self.tracked: dict[str, Body] = {}
        before_looking = Motions(self.robot, self.empty_scene)
        self.q, self.start_blocked = before_looking.start().q, before_looking.start_blocked()
        self.belief = Belief((), {}, self.voxels)

    def look(self, world: Simulated, limits: Limits, focus: Array | None, on_step: Callable[[str], None]) -> Looked:
        looked = look_around(
            self.empty_scene, self.robot, world.camera(self.rng), self.q, self.voxels, self.rng,
            bodies=self.belief.bodies, limits=limits, focus=focus, noise_1m_m=self.noise, pace=self.pace, on_step=on_step,
        )  # fmt: skip
        fresh = looked.frames
        if self.by == "geometry":
            fresh = tuple(without_bodies(f, tuple(self.tracked.values()), self.noise) for f in fresh)
        self.frames += fresh
        self.voxels, self.q = looked.voxels, looked.q
        return looked

    def understand(self) -> None:
        """Believe what all pictures together show. Raises: NoSurfaces when they show nothing but noise."""
        self.belief = believe(
            self.empty_scene, self.frames, self.voxels,
            by=self.by, target_box=self.target_box, tracked=self.tracked, before=self.belief.bodies,
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
    world: Simulated,
    policy_for: Callable[[Motions], Policy],
    *,
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

    policy_for: makes the policy for what is believed at a moment. target_box (6,): where the target is, see `perception.belief`.
    pace: how fast the arm is driven. grasp: with which grasps the target may be taken, x_g being what is looked for.
    The reason is stage "look" when the target was not found; otherwise what blocked the last attempt. Its motions are judged twice: by what
    was seen when they were planned, and by the truth at the end; `verified` and the reason "verify" tell.
    """
    thinking, moving, steps = Stopwatch(), Stopwatch(), 0
    moves: list[Move] = []
    way: list[Motion] = []
    doubts: list[Fault] = []
    truth = world.scene
    mind, limits, focus, patience = _BeliefState(world, rng, target_box, pace), FIRST, None, PATIENCE
    failed: set[tuple[str, int]] = set()
    took: Grasp | None = None
    kept_in: list[Blocked] = []
    if mind.start_blocked is not None:
        return conclude(world.robot, truth, mind.start_blocked, moves, way, name=name, rule=rule, thinking=thinking, moving=moving)
    while True:
        with moving:
            looked = mind.look(world, limits, focus, on_step)
        way += looked.motions
        try:
            with moving:
                mind.understand()
        except NoSurfaces as e:
            taken: Done | Blocked = Blocked("look", body=truth.target_name, detail=f"the target was not found: {e}")
            break
        with moving:
            motions, state = _ready(mind, iterations, time_budget_s, settings, grasp)
            taken = _try_target(mind, looked, motions, state, rng)
        if not isinstance(taken, Blocked):
            names = world.names(mind.belief.bodies)
            with moving:
                doubts += _as_seen(mind, state, taken.motions, settings.max_tilt_deg, taken.grasp)
            way += world.move(taken.motions, names)[0]
            took = taken.grasp
            if names[truth.target_name] != truth.target_name:
                taken = Blocked("verify", body=names[truth.target_name], detail=f"it was taken for the target {truth.target_name}")
            break
        kept_in[sum(move.done for move in moves) :] = [taken]
        moved = False
        hindered = list[tuple[str, Blocked]]()
        if steps < max_moves and mind.belief.body(truth.target_name) is not None:
            seen = observation(mind.empty_scene, mind.q, mind.belief)
            for object_name, region in proposals(policy_for(motions), seen, rule, failed, rng, thinking):
                with moving:
                    done = motions.relocate(state, object_name, region, rng)
                names = world.names(mind.belief.bodies)
                its = names[object_name]
                T_from = world.poses[its]
                if isinstance(done, Blocked):
                    failed.add((object_name, region))
                    moves.append(Move(its, region, T_from, motions.place_pose(object_name, T_from, region), False, done))
                    hindered.append((object_name, done))
                    continue
                on_step(f"moved {object_name} to region {region}")
                with moving:
                    ((_, done),) = motions.quickest([(state, done)], rng)
                    driven = motions.trajectories(state, done.motions)
                    doubts += _as_seen(mind, state, driven, settings.max_tilt_deg)
                carried, world = world.move(driven, names)
                way += carried
                moves.append(Move(its, region, T_from, world.poses[its], True))
                mind.moved(object_name, done.after.poses[object_name], done.after.q)
                failed.clear()
                moved = True
                break
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
    plan = conclude(
        world.robot, truth, why, moves, way,
        name=name, rule=rule, thinking=thinking, moving=moving, settings=settings, grasp=took, faults=doubts,
    )  # fmt: skip
    return replace(plan, target_blocked=tuple(kept_in))


def _as_seen(mind: _BeliefState, state: State, motions: Sequence[Motion], max_tilt_deg: float, grasp: Grasp | None = None) -> list[Fault]:
    """What the verdict finds wrong with motions in the world as it was seen: what was not seen is left to the planner."""
    scene = replace(mind.empty_scene, objects=tuple(replace(b, T_world_body=state.poses[b.name]) for b in mind.belief.bodies))
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
