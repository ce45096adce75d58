"""`retrieve plan`: moves and motions that take the target out, or the reason why there are none."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kinematics.errors import InputError, blame, choose
from planning.io.files import plan_writer, read_scenes, replacing
from retrieve_cli.engine import map_ordered
from retrieve_cli.errors import DONE, UNSOLVED
from retrieve_cli.sense import parse_box
from retrieve_cli.terminal import announce_first_run, progress, say

if TYPE_CHECKING:
    from kinematics.scene import RobotRef, Scene
    from planning.plan import Plan

STAGE = 4  # this stage's word in the seeds of random generators


@dataclass(frozen=True)
class Job:
    """How to plan: what a worker needs besides the scene."""

    policy: str | None  # None: the networks where the robot has some, else the local baseline
    rule: str
    seed: int
    iterations: int | None
    time_budget_s: float | None
    max_moves: int
    model: str | None = None
    sense: bool = False
    noise: bool = False
    by: Literal["mask", "geometry"] = "mask"
    target_box: str | None = None


@dataclass(frozen=True)
class Item:
    """One scene to plan, its number and where it was read."""

    index: int
    where: str
    scene: Scene


def run(
    *,
    scenes: Path | None,
    policy: str | None,
    rule: str,
    seed: int,
    iterations: int | None,
    time_budget_s: float | None,
    max_moves: int,
    robot: str | None,
    hand_frame: str | None,
    gripper_joint: str | None,
    html: Path | None,
    strict: bool,
    out: Path | None,
    model: Path | None = None,
    workers: int | None = None,
    engine: str = "local",
    address: str | None = None,
    sense: bool = False,
    noise: bool = False,
    by: Literal["mask", "geometry"] = "mask",
    target_box: str | None = None,
) -> int:
    """Plan every scene; 1 when `strict` and some scene is unsolved."""
    from planning.learning.model import once_loaded
    from planning.policies import NETWORKS, POLICIES

    if policy is not None:
        choose("policy", policy, POLICIES)
    if model is not None and policy is not None and policy not in NETWORKS:
        raise InputError(f"plan: --model: the policy {policy} asks no network; {', '.join(NETWORKS)} do")
    if model is not None:
        with blame("plan: --model"):
            once_loaded(str(model))
    if iterations is not None and time_budget_s is not None:
        raise InputError("plan: --iterations and --time-budget-s exclude each other: give one budget")
    if time_budget_s is not None:
        say("a budget in seconds: the plans depend on this machine's speed and can't be repeated bit by bit")
    for given, option in ((noise, "--noise"), (by != "mask", "--by"), (target_box is not None, "--target-box")):
        if given and not sense:
            raise InputError(f"plan: {option} is for --sense: without it nothing is looked at")
    if target_box is not None:
        parse_box(target_box, "plan")
    announce_first_run()
    unsolved = 0
    first: Item | None = None

    def items() -> Iterator[Item]:
        nonlocal first
        for index, (where, scene) in enumerate(read_scenes(scenes)):
            if robot or hand_frame or gripper_joint:
                scene = replace(scene, robot=other_robot(scene.robot, robot, hand_frame, gripper_joint, where))
            item = Item(index, where, scene)
            first = first or item
            yield item

    one = partial(
        plan_scene,
        Job(policy, rule, seed, iterations, time_budget_s, max_moves, str(model) if model else None, sense, noise, by, target_box),
    )
    plans = map_ordered(one, items(), workers=workers, engine=engine, address=address)
    with plan_writer(out) as write, progress("plans", out=out) as advance, replacing(html) if html else nullcontext() as page:
        shown: Plan | None = None
        for plan in refuse_alone(plans, lambda: first):
            write(plan)
            unsolved += not plan.success
            advance()
            shown = shown or plan
        if page is not None and first is not None and shown is not None:
            from retrieve_cli.show import write_html

            write_html(first.scene, shown, page)
    return UNSOLVED if strict and unsolved else DONE


def refuse_alone(plans: Iterable[Plan], first: Callable[[], Item | None]) -> Iterator[Plan]:
    """The plans, one after the other. Raises: InputError when there is one alone, and its scene can't be meant.

    first: the item of the first plan. In a batch such a plan is one of those that failed.
    """
    from planning.plan import SCENE

    rest = iter(plans)
    plan = next(rest, None)
    if plan is None:
        return
    if plan.reason is not None and plan.reason.stage == SCENE:
        after, item = next(rest, None), first()
        if after is None and item is not None:
            raise InputError(f"{item.where}: grasp: {plan.reason.detail}")
        rest = chain(() if after is None else (after,), rest)
    yield plan
    yield from rest


def plan_scene(job: Job, item: Item) -> Plan:
    """The plan of one scene. Raises: InputError when the robot can't be loaded, or can't stand there."""
    import numpy as np

    from kinematics.robots.robot import from_ref
    from planning.learning.model import once_loaded
    from planning.motion.pick_place import ITERATIONS, Motions
    from planning.policies import make_policy
    from planning.retrieval import Rule, failed, retrieve
    from planning.verdict import judge_grasp

    if job.sense:
        return sense_and_plan(job, item)
    with blame(item.where):
        arm = from_ref(item.scene.robot, on_step=say)
        if (wrong := judge_grasp(arm, item.scene)) is not None:
            return failed(item.scene, wrong, name=job.policy or _default_policy(arm.name, job.model), rule=Rule(job.rule))
        motions = Motions(arm, item.scene, iterations=job.iterations or ITERATIONS, time_budget_s=job.time_budget_s)
        motions.start()
        name = job.policy or _default_policy(arm.name, job.model)
        policy = make_policy(name, motions, model=once_loaded(job.model) if job.model else None, max_moves=job.max_moves)
    rng = np.random.default_rng([job.seed, STAGE, item.scene.random_word])
    return retrieve(item.scene, policy, motions, name=name, rule=Rule(job.rule), max_moves=job.max_moves, rng=rng)


def sense_and_plan(job: Job, item: Item) -> Plan:
    """The plan of one scene of which nothing is known at first. Raises: InputError like `plan_scene`, and for a robot without a camera."""
    import numpy as np

    from kinematics.robots.robot import from_ref
    from perception.camera import DepthNoise
    from planning.learning.model import once_loaded
    from planning.motion.pick_place import ITERATIONS
    from planning.policies import make_policy
    from planning.retrieval import Rule, failed
    from planning.sensing.retrieve import Simulated, retrieve_unseen
    from planning.verdict import judge_grasp

    with blame(item.where):
        arm = from_ref(item.scene.robot, on_step=say)
        if (wrong := judge_grasp(arm, item.scene, unseen=True)) is not None:
            return failed(item.scene, wrong, name=job.policy or _default_policy(arm.name, job.model), rule=Rule(job.rule))
        name = job.policy or _default_policy(arm.name, job.model)
        model = once_loaded(job.model) if job.model else None
        return retrieve_unseen(
            Simulated(arm, item.scene, item.scene.poses(), DepthNoise() if job.noise else None, job.by),
            lambda motions: make_policy(name, motions, model=model, max_moves=job.max_moves),
            name=name,
            rule=Rule(job.rule),
            max_moves=job.max_moves,
            iterations=job.iterations or ITERATIONS,
            time_budget_s=job.time_budget_s,
            target_box=None if job.target_box is None else parse_box(job.target_box, "plan"),
            rng=np.random.default_rng([job.seed, STAGE, item.scene.random_word]),
        )


def _default_policy(robot: str, model: str | None) -> str:
    """The policy when none is asked for: the networks, or for a robot without them the look ahead alone, which is said."""
    from planning.learning.model import ships

    if model is not None or ships(robot):
        return "neural"
    _say_once(
        f"no networks ship for the robot {robot}: planning with --policy lookahead (networks of your own: retrieve label, retrieve train)"
    )
    return "lookahead"


_say_once = lru_cache(say)


def other_robot(scene: RobotRef, robot: str | None, hand_frame: str | None, gripper_joint: str | None, where: str) -> RobotRef:
    """The robot to plan with: another one, or the scene's own URDF with another hand frame or gripper joint. Raises InputError."""
    from kinematics.robots.robot import named_robots
    from kinematics.scene import RobotRef

    if robot is None and scene.urdf is not None:
        return RobotRef(scene.T_world_base, None, scene.urdf, hand_frame or scene.hand_frame, gripper_joint or scene.gripper_joint)
    name = robot or scene.name
    if name not in named_robots():
        return RobotRef(scene.T_world_base, None, name, hand_frame, gripper_joint)
    if hand_frame or gripper_joint:
        raise InputError(f"{where}: --hand-frame and --gripper-joint are for a URDF of one's own; the robot {name} has its own")
    return RobotRef(scene.T_world_base, name)
