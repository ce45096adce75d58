"""The retrieval loop: try the target, else move one object out of the way, at most five times (paper, section III-E).

A policy is a pair of functions. The loop is one and the same for every planner, so an ablation changes one word.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from kinematics.scene import Scene, State
from perception.observation import Observation, observe
from planning.conclusion import conclude
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.plan import Blocked, Move, Outlook, Plan
from planning.rules import MAX_MOVES, Rule
from planning.stopwatch import Stopwatch

Thing = TypeVar("Thing")


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
    if blocked := motions.start_blocked() or motions.target_stays():
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
        attempts, done = one_move(policy, motions, state, rule, failed, rng, thinking, moving)
        moves += attempts
        if done is not None:
            on_step(f"moved {moves[-1].object} to region {moves[-1].region}")
            found.append((state, done))
            state = done.after
            failed.clear()  # a new state: what failed before may work now
        elif rule is Rule.DEEP:
            break  # everything that the policy has was tried in this state: another round would be the same
    outlook = policy.outlook()
    if steps == 0:
        outlook = Outlook(0)
    why = _why(scene, taken, outlook, max_moves) if isinstance(taken, Blocked) else None
    with moving:
        found = motions.quickest(found, rng)
        way = [motion for before, done in found for motion in motions.trajectories(before, done.motions)]
    grasp = None if isinstance(taken, Blocked) else found[-1][1].grasp
    plan = conclude(
        motions.robot, scene, why, moves, way,
        name=name, rule=rule, thinking=thinking, moving=moving, settings=motions.settings, grasp=grasp, max_moves=max_moves,
    )  # fmt: skip
    least = outlook.least_moves
    if plan.success and least is not None:
        least = min(least, sum(move.done for move in moves))  # a bound by the grasps that were sampled, and others may do
    return replace(plan, least_moves=least, unsolvable=None if plan.success else outlook.unsolvable, target_blocked=tuple(kept_in))


def one_move(
    policy: Policy,
    motions: Motions,
    state: State,
    rule: Rule,
    failed: set[tuple[str, int]],
    rng: np.random.Generator,
    thinking: Stopwatch,
    moving: Stopwatch,
) -> tuple[list[Move], Done | None]:
    """The moves that were tried in this state, and the motions of the last, if one was found: the first that keeps room, else the first.

    failed: what has failed in this state; what fails now is added.
    """
    attempts: list[Move] = []
    found: list[tuple[Move, Done]] = []
    more, out_of_reach = policy.choosy, set[str]()
    for name, region in proposals(policy, observe(motions.scene, state), rule, failed, rng, thinking, out_of_reach, found):
        T_from = state.poses[name]
        with moving:
            done = motions.relocate(state, name, region, rng)
        if isinstance(done, Blocked):
            failed.add((name, region))
            attempts.append(Move(name, region, T_from, motions.place_pose(name, T_from, region), False, done))
            if not motions.picks(state, name)[0]:
                out_of_reach.add(name)  # another region would not help
        else:
            move = Move(name, region, T_from, done.after.poses[name], True)
            if not done.tight or policy.certain(name, region):
                return [*attempts, move], done
            found.append((move, done))
        if found and more == 0:
            break
        more -= bool(found)
    for move, done in found[:1]:
        return [*attempts, move], done
    return attempts, None


def _why(scene: Scene, taken: Blocked, outlook: Outlook, max_moves: int) -> Blocked:
    """Why the target was not taken: the proof that it can't be, or that so many moves are too few; else what blocked it at last."""
    if outlook.unsolvable is not None:
        heavy = filter(None, map(scene.too_heavy, outlook.unsolvable.stuck))
        return Blocked("unsolvable", taken.link, taken.body, detail="; ".join([outlook.unsolvable.words, *heavy]))
    if outlook.least_moves is not None and outlook.least_moves > max_moves:
        return Blocked("moves", taken.link, taken.body, detail=f"at least {outlook.least_moves} moves are needed, {max_moves} are allowed")
    return taken if outlook.undecided is None else replace(taken, detail=outlook.undecided)
