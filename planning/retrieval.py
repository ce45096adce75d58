"""The retrieval loop: try the target, else move one object out of the way, at most five times (paper, section III-E).

A policy is a pair of functions. The loop is one and the same for every planner, so an ablation changes one word.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from time import perf_counter
from typing import TypeVar

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Grasp, Scene, State
from perception.observation import Observation, observe
from planning.motion.checking.replay import hand_poses, replayed, with_clearances
from planning.motion.checking.verify import first_touch
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.plan import SCENE, Blocked, Fault, Motion, Move, Outlook, Plan
from planning.verdict import Settings, examine

MAX_MOVES = 5
Thing = TypeVar("Thing")


class Rule(StrEnum):
    """How far the loop falls through when a proposed move can't be carried out."""

    STRICT = "strict"  # the first object and its first region, or the step is lost
    REGION = "region"  # the first object, its regions in order
    DEEP = "deep"  # objects in order, regions in order


@dataclass(frozen=True)
class Policy:
    """Who moves, and where to.

    select: ranks the names of the non-target objects, the one to move first in front.
    place: ranks the indices of the regions for one object, the best in front. Both may find them one by one, as they are asked for.
    outlook: what a policy that looks ahead knows of the scene once it was asked; the others know nothing.
    certain: whether a policy that tries motions itself has found those for a move: it may be proposed though it has failed before.
    choosy: so many more proposals for an object are tried after one that can be carried out, but comes near to something.
    """

    select: Callable[[Observation, np.random.Generator], Iterable[str]]
    place: Callable[[Observation, str, np.random.Generator], Iterable[int]]
    outlook: Callable[[], Outlook] = Outlook
    certain: Callable[[str, int], bool] = lambda name, region: False
    choosy: int = 0


class Stopwatch:
    """Adds up the time spent inside its `with` blocks."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __enter__(self) -> None:
        self._start = perf_counter()

    def __exit__(self, *_: object) -> None:
        self.seconds += perf_counter() - self._start


def proposals(
    policy: Policy,
    seen: Observation,
    rule: Rule,
    failed: set[tuple[str, int]],
    rng: np.random.Generator,
    thinking: Stopwatch,
    out_of_reach: Container[str] = (),
    found: Sequence[object] = (),
) -> Iterator[tuple[str, int]]:
    """Yield (object, region) in the order in which `rule` lets the loop try them, without what has failed in this very state and without
    objects that are found out of reach meanwhile, unless a move is certain now; and no other object once something was found."""
    with thinking:
        names = policy.select(seen, rng)
    for name in _timed(names, thinking):
        with thinking:
            regions = policy.place(seen, name, rng)
        proposed = False
        for region in _timed(regions, thinking):
            if ((name, region) in failed or name in out_of_reach) and not policy.certain(name, region):
                continue
            yield name, region
            proposed = True
            if rule is Rule.STRICT:
                return
        if found or (proposed and rule is not Rule.DEEP):
            return


def _timed(things: Iterable[Thing], watch: Stopwatch) -> Iterator[Thing]:
    """The things one by one, the watch running while each is found."""
    rest = iter(things)
    while True:
        with watch:
            try:
                thing = next(rest)
            except StopIteration:
                return
        yield thing


def retrieve(
    scene: Scene,
    policy: Policy,
    motions: Motions,
    *,
    name: str,
    rule: Rule = Rule.DEEP,
    max_moves: int = MAX_MOVES,
    rng: np.random.Generator,
    on_step: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan the way to the target: moves of other objects, then the grasp x_g and the way out.

    name: what the policy is called in the plan. on_step: told of each step as it is taken.
    The plan that comes back is complete and verified, or says at which stage, link and body the last attempt was blocked.
    """
    state = motions.start()
    moves: list[Move] = []
    found: list[tuple[State, Done]] = []
    failed: set[tuple[str, int]] = set()
    thinking, moving, steps = Stopwatch(), Stopwatch(), 0
    kept_in: list[Blocked] = []
    if blocked := motions.start_blocked():
        return conclude(motions.robot, scene, blocked, moves, (), name=name, rule=rule, thinking=thinking, moving=moving)
    while True:
        on_step(f"trying the target {scene.target_name}")
        with moving:
            taken = motions.retrieve_target(state, rng)  # the indicator I
        if not isinstance(taken, Blocked):
            found.append((state, taken))
            break
        kept_in[sum(move.done for move in moves) :] = [taken]
        if steps == max_moves:
            break
        steps += 1
        possible, more, out_of_reach = list[tuple[str, int, Done]](), policy.choosy, set[str]()
        for object_name, region in proposals(policy, observe(scene, state), rule, failed, rng, thinking, out_of_reach, possible):
            with moving:
                moved = motions.relocate(state, object_name, region, rng)
            if isinstance(moved, Blocked):
                failed.add((object_name, region))
                T_from = state.poses[object_name]
                moves.append(Move(object_name, region, T_from, motions.place_pose(object_name, T_from, region), False, moved))
                if not motions.picks(state, object_name)[0]:
                    out_of_reach.add(object_name)  # another region would not help
            elif moved.tight and not policy.certain(object_name, region):
                possible.append((object_name, region, moved))
            else:
                possible.insert(0, (object_name, region, moved))
                break
            if possible and more == 0:
                break
            more -= bool(possible)
        for object_name, region, moved in possible[:1]:
            on_step(f"moved {object_name} to region {region}")
            moves.append(Move(object_name, region, state.poses[object_name], moved.after.poses[object_name], True))
            found.append((state, moved))
            state = moved.after
            failed.clear()  # a new state: what failed before may work now
        if not possible and rule is Rule.DEEP:
            break  # everything that the policy has was tried in this state: another round would be the same
    outlook = policy.outlook()
    if steps == 0:
        outlook = Outlook(0)
    why = _why(taken, outlook, max_moves) if isinstance(taken, Blocked) else None
    with moving:
        found = motions.quickest(found, rng)
        way = [motion for before, done in found for motion in motions.trajectories(before, done.motions)]
    grasp = None if isinstance(taken, Blocked) else found[-1][1].grasp
    plan = conclude(
        motions.robot, scene, why, moves, way,
        name=name, rule=rule, thinking=thinking, moving=moving, settings=motions.settings, grasp=grasp,
    )  # fmt: skip
    return replace(plan, least_moves=outlook.least_moves, unsolvable=outlook.unsolvable, target_blocked=tuple(kept_in))


def _why(taken: Blocked, outlook: Outlook, max_moves: int) -> Blocked:
    """Why the target was not taken: the proof that it can't be, or that so many moves are too few; else what blocked it at last."""
    if outlook.unsolvable is not None:
        return Blocked("unsolvable", taken.link, taken.body, detail=outlook.unsolvable.words)
    if outlook.least_moves is not None and outlook.least_moves > max_moves:
        return Blocked("moves", taken.link, taken.body, detail=f"at least {outlook.least_moves} moves are needed, {max_moves} are allowed")
    return taken


def conclude(
    robot: Robot,
    scene: Scene,
    reason: Blocked | None,
    moves: Sequence[Move],
    way: Sequence[Motion],
    *,
    name: str,
    rule: Rule,
    thinking: Stopwatch,
    moving: Stopwatch,
    settings: MotionSettings = DEFAULTS,
    grasp: Grasp | None = None,
    is_truth: bool = True,
) -> Plan:
    """The plan that a loop ends with, after the final check and the verdict, with the clearances measured.

    reason: why the target was not taken, None when it was. grasp: how it was taken, by default the scene's x_g. is_truth: whether
    the scene is as things were when the motions began; otherwise nothing is judged by it.
    """
    success = reason is None
    travel = hand_travels(robot, scene, way)
    plan = Plan(
        scene.id, name, str(rule), success, reason, tuple(moves), tuple(way), thinking.seconds, moving.seconds,
        sum(travel, 0.0), objective(scene, moves, success), None, grasp=grasp, settled=scene.settled,
        relocation_travel_m=sum((length for length, counts in zip(travel, relocating(way)) if counts), 0.0),
    )  # fmt: skip
    if not way:
        return plan
    if not is_truth:
        return replace(plan, verified=True)
    faults: tuple[Fault, ...] = ()
    notes: tuple[Fault, ...] = ()
    with moving:
        sampled = replayed(robot, scene, way)
        touch = first_touch(robot, scene, way, sampled)
        if touch is None:  # all besides contacts is for the verdict to judge
            limits = Settings(contact=False, max_tilt_deg=settings.max_tilt_deg)
            verdict = examine(scene, plan, robot, limits)
            faults, notes = verdict.faults, verdict.notes
        motions = with_clearances(way, sampled)
    plan = replace(plan, motions=motions, motion_time_s=moving.seconds, faults=faults, notes=notes)
    plan = replace(plan, verified=touch is None and not faults)
    return _judged(scene, plan, touch)


def _judged(scene: Scene, plan: Plan, touch: Blocked | None) -> Plan:
    """The plan, which fails if it is not verified: touch is why, or its first fault."""
    if plan.verified:
        return plan
    why = touch or Blocked("verify", detail=str(plan.faults[0]))
    return replace(plan, success=False, reason=why, value=objective(scene, plan.moves, False))


def failed(scene: str, detail: str, *, name: str, rule: Rule) -> Plan:
    """The plan of a scene, told by its id, that can't be meant: nothing was tried."""
    return Plan(scene, name, str(rule), False, Blocked(SCENE, detail=detail), (), (), 0.0, 0.0, 0.0, 0.0, None)


def relocating(motions: Sequence[Motion]) -> list[bool]:
    """Which motions the paper counts as travel: those of the relocations, before the target is gone for. Looks are none of them."""
    last = max((i for i, motion in enumerate(motions) if motion.stage == "retreat"), default=-1)
    return [i <= last and motion.stage != "look" for i, motion in enumerate(motions)]


def hand_travel(robot: Robot, scene: Scene, motions: Sequence[Motion], step: float = 0.05) -> float:
    """Length in metres of the hand's path, measured along chords of about `step` rad (or m) in any joint."""
    return sum(hand_travels(robot, scene, motions, step), 0.0)


def hand_travels(robot: Robot, scene: Scene, motions: Sequence[Motion], step: float = 0.05) -> list[float]:
    """The same for each motion."""
    if not motions:
        return []
    q, t_s = (np.concatenate([getattr(motion, name) for motion in motions]) for name in ("q", "t_s"))
    ends = np.cumsum([len(motion.q) for motion in motions])
    parts = np.maximum(1, np.ceil(np.abs(q[1:] - q[:-1]).max(1, initial=0.0) / step)).astype(np.int64)
    parts[ends[:-1] - 1] = 0  # from one motion to the next
    piece = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(piece)) - (np.cumsum(parts) - parts)[piece]) / parts[piece]
    times = t_s[piece] + share * (t_s[piece + 1] - t_s[piece])
    of_each = np.split(times, np.searchsorted(piece, ends[:-1]))
    rows = [motion.at(np.append(some, motion.t_s[-1])) for motion, some in zip(motions, of_each)]
    at = hand_poses(robot, scene, np.concatenate(rows))[:, :3, 3]
    chords, last = np.sqrt(((at[1:] - at[:-1]) ** 2).sum(1)), np.cumsum([len(some) for some in rows])
    return [float(chords[end - len(some) : end - 1].sum()) for some, end in zip(rows, last)]


def objective(scene: Scene, moves: Sequence[Move], success: bool) -> float:
    """The paper's return (eq. 1): the sum over steps of I − d, d = |l_r → object| + |object → region|, over the moves carried out."""
    base = scene.robot.T_world_base[:3, 3]
    ends = [(m.T_world_from[:3, 3], m.T_world_to[:3, 3]) for m in moves if m.done]
    d = [np.linalg.norm(start - base) + np.linalg.norm(end - start) for start, end in ends]
    return float(success) - float(sum(d))
