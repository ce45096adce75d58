"""The plan of one line of a scene file: of a scene that is known, or of one that is looked at first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kinematics.errors import InputError, OptionError, blame
from planning.io.files import UNREADABLE, SceneLine
from planning.plan import SCENE, Plan
from retrieve_cli.own_limits import with_limits
from retrieve_cli.own_policy import is_own, own_policy
from retrieve_cli.plan_job import Job, motion_settings, pace
from retrieve_cli.sense import parse_box
from retrieve_cli.terminal import say, say_of_base, say_once
from retrieve_cli.worlds import as_it_is, own_world

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot
    from kinematics.scene import Scene
    from planning.motion.pick_place import Motions
    from planning.retrieval import Policy


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of a line: its plan, its scene if it has one, and what is wrong with it if it is invalid."""

    plan: Plan
    scene: Scene | None
    error: str = ""


def plan_line(job: Job, line: SceneLine) -> Answer:
    """The plan of a line, or one that failed at stage `scene`. Raises: InputError for such a line when the job is to fail fast."""
    from planning.conclusion import failed
    from planning.rules import Rule

    error = line.error
    if line.scene is not None:
        try:
            return Answer(plan_scene(job, line.where, line.scene), line.scene)
        except OptionError:
            raise
        except InputError as e:
            error = str(e) if str(e).startswith(f"{line.where}: ") else f"{line.where}: {e}"
    if job.fail_fast:
        raise InputError(error)
    robot = line.scene.robot.name if line.scene is not None else None
    policy = _name(job, robot or "ur5e")
    return Answer(failed(line.id, error.removeprefix(f"{line.where}: "), name=policy, rule=Rule(job.rule)), line.scene, error)


def plan_scene(job: Job, where: str, scene: Scene) -> Plan:
    """The plan of one scene. Raises: InputError, beginning with `where`, when the scene is invalid: its robot, its target, its x_g."""
    from planning import library
    from planning.learning.networks.model import once_loaded
    from planning.motion.pick_place import ITERATIONS

    if job.sense:
        return sense_and_plan(job, where, scene)
    with blame(where, *UNREADABLE):
        arm = _ready(scene, job.limits)
        plan = library.plan_scene(
            scene,
            own_policy(job.policy) if is_own(job.policy) else job.policy or _default_policy(arm.name, job.model),
            model=once_loaded(job.model) if job.model else None,
            rule=job.rule,
            seed=job.seed,
            max_moves=job.max_moves,
            iterations=job.iterations or ITERATIONS,
            time_budget_s=job.time_budget_s,
            robot=arm,
            settings=motion_settings(job),
            pace=pace(job),
            grasp=job.grasp,
            unseen_is_solid=job.unseen == "solid",
        )
    if plan.reason is not None and plan.reason.stage == SCENE:
        raise InputError(f"{where}: {plan.reason.detail}")
    return plan


def sense_and_plan(job: Job, where: str, scene: Scene) -> Plan:
    """The plan of one scene of which nothing is known at first. Raises: InputError like `plan_scene`, and for a robot without a camera."""
    import numpy as np

    from perception.camera import DepthNoise
    from planning import library
    from planning.learning.networks.model import once_loaded
    from planning.motion.pick_place import ITERATIONS
    from planning.policies import make_policy
    from planning.rules import Rule
    from planning.sensing.retrieve import retrieve_unseen
    from planning.sensing.settings import LoopSettings, SensingSettings
    from planning.sensing.turned_world import TurnedWorld
    from planning.sensing.world import SimulatedWorld, World
    from planning.target_grasps.allowed import GraspChoice, check_choice
    from planning.upright import turned_box, upright
    from planning.verdict import judge_grasp

    with blame(where, *UNREADABLE):
        arm = _ready(scene, job.limits)
        choice = GraspChoice(job.grasp)
        check_choice(scene, choice)
        if choice is GraspChoice.GIVEN and (wrong := judge_grasp(arm, scene, unseen=True)) is not None:
            raise ValueError(f"grasp: {wrong}")
        name = _name(job, arm.name)
        model = once_loaded(job.model) if job.model else None
        rng, model_noise = np.random.default_rng([job.seed, library.STAGE, scene.random_word]), DepthNoise()
        box = None if job.target_box is None else parse_box(job.target_box, "plan")
        own = None if job.world is None else own_world(job.world, scene, arm)
        if own is not None:
            scene = as_it_is(own, scene, arm)
        planned_in = upright(scene, motion_settings(job))
        scene, turn = planned_in.scene, planned_in.T_upright_world
        if turn is not None and box is not None:
            box = turned_box(box, turn)
        world: World
        if own is None:
            world = simulated = SimulatedWorld(arm, scene, rng, model_noise if job.noise else None, job.by)
        else:
            world, simulated = own if turn is None else TurnedWorld(own, turn), None

        def policy_for(motions: Motions, moves: int) -> Policy:
            return own_policy(job.policy)(motions) if is_own(job.policy) else make_policy(name, motions, model=model, max_moves=moves)

        plan = retrieve_unseen(
            world,
            arm,
            scene,
            policy_for,
            truth=simulated,
            target_box=scene.target_box if box is None else box,
            name=name,
            settings=LoopSettings(
                rule=Rule(job.rule),
                max_moves=job.max_moves,
                iterations=job.iterations or ITERATIONS,
                time_budget_s=job.time_budget_s,
                motion=planned_in.settings,
                pace=pace(job),
                grasp=choice,
            ),
            sensing=SensingSettings(
                by=job.by if job.world is None else None,
                noise_1m_m=model_noise.axial_1m_m if job.noise or job.world else 0.0,
                smallest_m=job.smallest_mm / 1000,
            ),
            rng=rng,
        )
        return planned_in.plan_as_it_is(plan) if simulated is None else planned_in.judged(arm, plan)


def _name(job: Job, robot: str) -> str:
    """What the policy is called in plans."""
    if is_own(job.policy):
        return own_policy(job.policy).__name__
    return job.policy or _default_policy(robot, job.model)


def _default_policy(robot: str, model: str | None) -> str:
    """The policy when none is asked for: the networks, or for a robot without them the look ahead alone, which is said."""
    from planning.learning.networks.model import once_loaded
    from planning.library import default_policy

    policy = default_policy(robot, once_loaded(model) if model else None)
    if policy != "neural":
        say_once(
            f"no networks ship for the robot {robot}: planning with --policy {policy} "
            "(networks of your own: retrieve label, retrieve train)"
        )
    return policy


def _ready(scene: Scene, limits: str | None) -> Robot:
    """A scene's robot, its links covered, with a file's limits; what nobody knows about them, and what stands through its base, is said
    once. Raises: ValueError, see `load` and `with_limits`."""
    from kinematics.collision.robot_model import link_covers
    from kinematics.robots.load import from_ref

    robot = with_limits(from_ref(scene.robot, on_step=say), limits)
    link_covers(robot, say)
    if robot.limits.assumed:
        say_once(f"robot {robot.name}: not known, and assumed: {robot.limits.assumed} (--limits FILE says better)")
    say_of_base(robot, scene)
    return robot
