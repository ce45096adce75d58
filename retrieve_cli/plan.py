"""`retrieve plan`: moves and motions that take the target out, or the reason why there are none."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kinematics.errors import InputError, blame, choose
from planning.io.files import UNREADABLE, SceneLine, read_plans, read_scene_lines
from planning.io.outputs import is_special, place_for
from planning.io.results import plan_writer
from planning.plan import SCENE, Plan
from retrieve_cli.engine import map_ordered
from retrieve_cli.errors import DONE, UNSOLVED
from retrieve_cli.sense import parse_box
from retrieve_cli.story import story
from retrieve_cli.terminal import announce_first_run, mesh_progress, on_terminal, progress, say, say_settled
from retrieve_cli.version import version
from retrieve_cli.worlds import as_it_is, own_world

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot
    from kinematics.scene import RobotRef, Scene
    from planning.motion.settings import MotionSettings
    from planning.motion.trajectory import Pace

UNSEEN = ("solid", "free")


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
    fail_fast: bool = False
    speed: float = 1.0
    hand_speed: float = 1.0
    slow_below_mm: float = 0.0
    limits: str | None = None
    unseen: str = "solid"
    clearance_mm: float = 5.0
    clearance_least_mm: float = 0.5
    max_tilt_deg: float = 30.0
    grasp: str = "given"
    world: str | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of a line: its plan, its scene if it has one, and what is wrong with it if it can't be meant."""

    plan: Plan
    scene: Scene | None
    error: str = ""


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
    resume: bool = False,
    fail_fast: bool = False,
    speed: float = 1.0,
    hand_speed: float = 1.0,
    slow_below_mm: float = 0.0,
    limits: Path | None = None,
    unseen: str = "solid",
    clearance_mm: float = 5.0,
    clearance_least_mm: float = 0.5,
    max_tilt_deg: float = 30.0,
    pose_noise_mm: float = 2.0,
    grasp: str = "given",
    world: str | None = None,
    quiet: bool = False,
) -> int:
    """Plan every scene; 1 when `strict` and some scene is unsolved.

    A scene that can't be meant gets a plan that failed at stage `scene`; with `fail_fast`, or when there is no other scene, it is an error.
    """
    job = Job(
        policy, rule, seed, iterations, time_budget_s, max_moves, str(model) if model else None, sense, noise, by, target_box, fail_fast,
        speed, hand_speed, slow_below_mm, str(limits) if limits else None, unseen, clearance_mm, clearance_least_mm, max_tilt_deg, grasp,
        world,
    )  # fmt: skip
    _check(job)
    if world is not None and (not sense or (workers or 1) > 1 or engine != "local"):
        raise InputError("plan: --world goes with --sense, and with one worker: there is one arm")
    if world is not None and html is not None:
        raise InputError("plan: --html draws what is known of a scene, and of a real world that is nothing; leave it out with --world")
    if html is not None and not is_special(html):
        place_for(html)
    announce_first_run()
    override = (robot, hand_frame, gripper_joint)
    asked = {
        **asdict(replace(job, fail_fast=False)),
        "command": "plan",
        "version": version(),
        "robot": override,
        "networks": _digest(model),
        "pose_noise_mm": pose_noise_mm,
    }
    tell = not quiet and on_terminal(out)
    drawable: list[SceneLine] = []  # until one is found to be drawn
    picture: tuple[Scene, Plan] | None = None

    def lines() -> Iterator[SceneLine]:
        for line in read_scene_lines(scenes, noise_m=pose_noise_mm / 1000, on_mesh=mesh_progress):
            if line.scene is not None:
                say_settled(line.where, line.scene)
            line = _overridden(line, *override)
            if html is not None and picture is None:
                drawable.append(line)
            yield line

    with plan_writer(out, asked=asked, resume=resume, tell=say) as write, progress("plans", out=out) as advance:
        left = write.left(lines(), key=lambda line: line.key)
        unsolved = 0
        for answer in _meant(map_ordered(partial(plan_line, job), left, workers=workers, engine=engine, address=address), write.kept > 0):
            write(answer.plan)
            unsolved += not answer.plan.success
            if answer.error:
                say(f"{answer.error} (its plan says so)")
            elif tell and answer.scene is not None:
                for words in story(answer.scene, answer.plan):
                    say(words)
            if not answer.error and picture is None and answer.scene is not None:
                picture = answer.scene, answer.plan
            advance()
    if strict and write.kept:
        unsolved += sum(not plan.success for _, plan in islice(read_plans(out), write.kept))
    if html is not None and write.kept:
        kept = zip(drawable, read_plans(out))
        picture = next(((line.scene, plan) for line, (_, plan) in kept if line.scene is not None and not _refused(plan)), None)
    if html is not None and picture is not None:
        from retrieve_cli.show import write_html

        write_html(*picture, html)  # the plans are written by now, whatever becomes of their picture
    return UNSOLVED if strict and unsolved else DONE


def _pace(job: Job) -> Pace:
    """Raises: ValueError for a pace that can't be meant."""
    from planning.motion.trajectory import Pace

    return Pace(job.speed, job.hand_speed, job.slow_below_mm / 1000)


def _check(job: Job) -> None:
    """Raises: InputError for options that do not go together, or a model or limits that can't be read."""
    from kinematics.robots.limits import read_tables
    from planning.learning.model import once_loaded
    from planning.policies import NETWORKS, POLICIES

    if job.policy is not None:
        choose("policy", job.policy, POLICIES)
    if job.model is not None and job.policy is not None and job.policy not in NETWORKS:
        raise InputError(f"plan: --model: the policy {job.policy} asks no network; {', '.join(NETWORKS)} do")
    if job.model is not None:
        with blame("plan: --model"):
            once_loaded(job.model)
    if job.iterations is not None and job.time_budget_s is not None:
        raise InputError("plan: --iterations and --time-budget-s exclude each other: give one budget")
    if job.time_budget_s is not None:
        say("a budget in seconds: the plans depend on this machine's speed and can't be repeated bit by bit")
    for given, option in ((job.noise, "--noise"), (job.by != "mask", "--by"), (job.target_box is not None, "--target-box")):
        if given and not job.sense:
            raise InputError(f"plan: {option} is for --sense: without it nothing is looked at")
    if job.target_box is not None:
        parse_box(job.target_box, "plan")
    with blame("plan"):
        _pace(job)
    if job.limits is not None:
        with blame("plan: --limits"):
            read_tables(Path(job.limits))
    choose("way to take unseen space (--unseen)", job.unseen, UNSEEN)
    if job.unseen == "free":
        say("space that no frame has shown is taken for free, on your word: the plans are only as safe as that")
    motion_settings(job)


def motion_settings(job: Job) -> MotionSettings:
    """What --clearance, --clearance-least and --max-tilt mean for motions. Raises: InputError for values that can't be kept."""
    from kinematics.collision.edge_problem import MARGIN_M
    from planning.motion.settings import ClearanceSettings, MotionSettings

    def clearance(mm: float) -> float:
        """In metres; what is no more than every certified motion keeps is nothing to ask for."""
        return 0.0 if 0 < mm <= 1000 * MARGIN_M else mm / 1000

    with blame("plan: --clearance, --clearance-least"):
        clearances = ClearanceSettings(wanted_m=clearance(job.clearance_mm), least_m=clearance(job.clearance_least_mm))
    with blame("plan: --max-tilt"):
        return MotionSettings(clearances, max_tilt_deg=job.max_tilt_deg)


def _meant(answers: Iterable[Answer], some: bool) -> Iterator[Answer]:
    """The answers, those about lines that can't be meant held back until there is another one; some: there was one before.

    Raises: InputError, the first complaint, when there is no other line at all.
    """
    refused: list[Answer] = []
    for answer in answers:
        if answer.error and not some:
            refused.append(answer)
            continue
        some = True
        yield from (*refused, answer)
        refused.clear()
    if refused:
        more = f"; nor can the {len(refused) - 1} lines after it" if len(refused) > 1 else ""
        raise InputError(refused[0].error + more)


def plan_line(job: Job, line: SceneLine) -> Answer:
    """The plan of a line, or one that failed at stage `scene`. Raises: InputError for such a line when the job is to fail fast."""
    from planning.retrieval import Rule, failed

    error = line.error
    if line.scene is not None:
        try:
            return Answer(plan_scene(job, line.where, line.scene), line.scene)
        except InputError as e:
            error = str(e)
    if job.fail_fast:
        raise InputError(error)
    robot = line.scene.robot.name if line.scene is not None else None
    policy = job.policy or _default_policy(robot or "ur5e", job.model)
    return Answer(failed(line.id, error.removeprefix(f"{line.where}: "), name=policy, rule=Rule(job.rule)), line.scene, error)


def plan_scene(job: Job, where: str, scene: Scene) -> Plan:
    """The plan of one scene. Raises: InputError, beginning with `where`, when the scene can't be meant: its robot, its target, its x_g."""
    from kinematics.robots.load import from_ref
    from planning import library
    from planning.learning.model import once_loaded
    from planning.motion.pick_place import ITERATIONS

    if job.sense:
        return sense_and_plan(job, where, scene)
    with blame(where, *UNREADABLE):
        arm = _with_limits(from_ref(scene.robot, on_step=say), job.limits)
        plan = library.plan_scene(
            scene,
            job.policy or _default_policy(arm.name, job.model),
            model=once_loaded(job.model) if job.model else None,
            rule=job.rule,
            seed=job.seed,
            max_moves=job.max_moves,
            iterations=job.iterations or ITERATIONS,
            time_budget_s=job.time_budget_s,
            robot=arm,
            settings=motion_settings(job),
            pace=_pace(job),
            grasp=job.grasp,
            unseen_is_solid=job.unseen == "solid",
        )
    if plan.reason is not None and plan.reason.stage == SCENE:
        raise InputError(f"{where}: {plan.reason.detail}")
    return plan


def sense_and_plan(job: Job, where: str, scene: Scene) -> Plan:
    """The plan of one scene of which nothing is known at first. Raises: InputError like `plan_scene`, and for a robot without a camera."""
    import numpy as np

    from kinematics.robots.load import from_ref
    from perception.camera import DepthNoise
    from planning import library
    from planning.learning.model import once_loaded
    from planning.motion.pick_place import ITERATIONS
    from planning.policies import make_policy
    from planning.retrieval import Rule
    from planning.sensing.retrieve import retrieve_unseen
    from planning.sensing.world import SimulatedWorld, World
    from planning.target_grasps import GraspChoice, check_choice
    from planning.verdict import judge_grasp

    with blame(where, *UNREADABLE):
        arm = _with_limits(from_ref(scene.robot, on_step=say), job.limits)
        choice = GraspChoice(job.grasp)
        check_choice(scene, choice)
        if choice is GraspChoice.GIVEN and (wrong := judge_grasp(arm, scene, unseen=True)) is not None:
            raise ValueError(f"grasp: {wrong}")
        name = job.policy or _default_policy(arm.name, job.model)
        model = once_loaded(job.model) if job.model else None
        rng, model_noise = np.random.default_rng([job.seed, library.STAGE, scene.random_word]), DepthNoise()
        world: World
        if job.world is None:
            world = simulated = SimulatedWorld(arm, scene, rng, model_noise if job.noise else None, job.by)
        else:
            world, simulated = own_world(job.world, scene, arm), None
            scene = as_it_is(world, scene, arm)
        return retrieve_unseen(
            world,
            arm,
            scene,
            lambda motions: make_policy(name, motions, model=model, max_moves=job.max_moves),
            truth=simulated,
            by=job.by if job.world is None else None,
            noise_1m_m=model_noise.axial_1m_m if job.noise or job.world else 0.0,
            name=name,
            rule=Rule(job.rule),
            max_moves=job.max_moves,
            iterations=job.iterations or ITERATIONS,
            time_budget_s=job.time_budget_s,
            target_box=scene.target_box if job.target_box is None else parse_box(job.target_box, "plan"),
            settings=motion_settings(job),
            pace=_pace(job),
            grasp=choice,
            rng=rng,
        )


def _default_policy(robot: str, model: str | None) -> str:
    """The policy when none is asked for: the networks, or for a robot without them the look ahead alone, which is said."""
    from planning.learning.model import once_loaded
    from planning.library import default_policy

    policy = default_policy(robot, once_loaded(model) if model else None)
    if policy != "neural":
        _say_once(
            f"no networks ship for the robot {robot}: planning with --policy {policy} "
            "(networks of your own: retrieve label, retrieve train)"
        )
    return policy


_say_once = lru_cache(say)


@lru_cache(maxsize=16)
def _with_limits(robot: Robot, file: str | None) -> Robot:
    """The robot with a file's limits of speed; what nobody knows about them is said once. Raises: ValueError, see `read_limits`."""
    from kinematics.robots.limits import read_limits

    if file is not None:
        robot = replace(robot, limits=read_limits(Path(file), robot.joint_names, robot.limits))
    if robot.limits.assumed:
        _say_once(f"robot {robot.name}: not known, and assumed: {robot.limits.assumed} (--limits FILE says better)")
    return robot


def _refused(plan: Plan) -> bool:
    """Whether a plan says that its scene can't be meant."""
    return plan.reason is not None and plan.reason.stage == SCENE


def _digest(model: Path | None) -> str | None:
    """A hash of a model folder's files."""
    if model is None:
        return None
    digest = hashlib.sha256()
    for file in sorted(model.glob("*")):
        if file.is_file():
            digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _overridden(line: SceneLine, robot: str | None, hand_frame: str | None, gripper_joint: str | None) -> SceneLine:
    """The line with the robot that the options ask for."""
    if line.scene is None or not (robot or hand_frame or gripper_joint):
        return line
    try:
        ref = other_robot(line.scene.robot, robot, hand_frame, gripper_joint, line.where)
    except InputError as e:
        return replace(line, scene=None, error=str(e))
    return replace(line, scene=replace(line.scene, robot=ref))


def other_robot(scene: RobotRef, robot: str | None, hand_frame: str | None, gripper_joint: str | None, where: str) -> RobotRef:
    """The robot to plan with: another one, or the scene's own URDF with another hand frame or gripper joint. Raises InputError."""
    from kinematics.robots.named import named_robots
    from kinematics.scene import RobotRef

    if robot is None and scene.urdf is not None:
        return replace(scene, hand_frame=hand_frame or scene.hand_frame, gripper_joint=gripper_joint or scene.gripper_joint)
    name = robot or scene.name
    if name not in named_robots():
        return RobotRef(scene.T_world_base, None, name, hand_frame, gripper_joint, mount=scene.mount)
    if hand_frame or gripper_joint:
        raise InputError(f"{where}: --hand-frame and --gripper-joint are for a URDF of one's own; the robot {name} has its own")
    return scene if name == scene.name else RobotRef(scene.T_world_base, name, mount=scene.mount)
