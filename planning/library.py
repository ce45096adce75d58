"""The library in a few functions: read scenes, load a robot, plan, verify, write. `import planning` offers them.

from planning import plan_scene, read_scenes, verify_plan

for scene in read_scenes("scenes.jsonl"):
    plan = plan_scene(scene, policy="local", seed=0)
    print(scene.id, plan.success, plan.reason, verify_plan(scene, plan))
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from kinematics.robots.load import from_ref, load
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from perception.observation import is_seen
from planning.conclusion import failed
from planning.io import files
from planning.io.results import plan_writer, scene_writer
from planning.learning.networks.model import Model, ships
from planning.motion.pick_place import ITERATIONS, Motions
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.motion.trajectory import FULL, Pace
from planning.plan import Plan
from planning.policies import make_policy
from planning.retrieval import Policy, retrieve
from planning.rules import MAX_MOVES, Rule
from planning.sensing.unknown_space import unknown_boxes
from planning.target_grasps.allowed import GraspChoice, target_grasps
from planning.upright import upright
from planning.verdict import Fault, judge

STAGE = 4
"""What a plan's random numbers are drawn from, beside the seed and the scene: other stages have other numbers."""


def load_robot(name: str, hand_frame: str | None = None, gripper_joint: str | None = None) -> Robot:
    """A named robot ("ur5e", "panda", "gen3"), or one's own URDF file with its grasp point's link and the joint that opens the fingers.

    Raises: ValueError that says what the file lacks.
    """
    return load(name, hand_frame, gripper_joint)


def read_scenes(file: str | Path) -> Iterator[Scene]:
    """The scenes of a JSON Lines file, one after the other. Raises: InputError with line and field of what is wrong."""
    return (scene for _, scene in files.read_scenes(Path(file)))


def read_plans(file: str | Path) -> Iterator[Plan]:
    """The plans of a JSON Lines file. Raises: InputError with line and field of what is wrong."""
    return (plan for _, plan in files.read_plans(Path(file)))


def write_scenes(scenes: Iterable[Scene], file: str | Path) -> None:
    """Write scenes as JSON Lines, like `write_plans`; paths of meshes and URDFs in them are written as from the file's folder."""
    with scene_writer(Path(file)) as write:
        for scene in scenes:
            write(scene)


def write_plans(plans: Iterable[Plan], file: str | Path) -> None:
    """Write plans as JSON Lines, beside the name first. Raises: InputError when the file can't be written."""
    with plan_writer(Path(file)) as write:
        for plan in plans:
            write(plan)


def plan_scene(
    scene: Scene,
    policy: str | Callable[[Motions], Policy] | None = None,
    *,
    model: Model | None = None,
    rule: Rule | str = Rule.DEEP,
    seed: int = 0,
    max_moves: int = MAX_MOVES,
    iterations: int = ITERATIONS,
    time_budget_s: float | None = None,
    robot: Robot | None = None,
    settings: MotionSettings = DEFAULTS,
    pace: Pace = FULL,
    grasp: GraspChoice | str = GraspChoice.GIVEN,
    unseen_is_solid: bool = True,
    on_step: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan one scene: moves of other objects, then the grasp x_g and the way out. The same seed gives the same plan.

    policy: a name (`planning.policies` lists them), or a function that makes one from the scene's `Motions`; by default the networks
    where some ship for the robot, else "lookahead". model: networks of one's own. iterations: of one RRT-Connect; time_budget_s: seconds
    instead, which can't be repeated exactly. robot: the scene's own by default. settings: clearance and tilt that motions keep; pace: how
    fast they are. grasp: with which grasps the target may be taken, "given", "any" or "list". unseen_is_solid: whether, in a scene out of
    recorded frames, what no frame has shown is an obstacle. on_step: told of each step as it is taken. A cabinet that leans is planned in
    upright, with all else turned along (`planning.upright`): so a policy of one's own sees it.

    The plan says whether it succeeded, or at which stage which link met which body; stage `scene` when x_g can't hold the target.
    Raises: ValueError when the robot can't be loaded, or can't stand there, or the scene has no target, or no such grasps.
    """
    robot, rule = robot or from_ref(scene.robot), Rule(rule)
    if policy is None:
        policy = default_policy(robot.name, model)
    name = policy if isinstance(policy, str) else str(getattr(policy, "__name__", "own"))
    planned_in = upright(scene, settings)
    scene, settings = planned_in.scene, planned_in.settings
    grasps = target_grasps(robot, scene, GraspChoice(grasp))
    if isinstance(grasps, str):
        return failed(scene.id, f"grasp: {grasps}", name=name, rule=rule)
    if (grasp_of_all := grasps.representative()) is not scene.grasp:
        scene = replace(scene, grasp=grasp_of_all)
    unseen = unknown_boxes(scene) if is_seen(scene) and unseen_is_solid else ()
    motions = Motions(
        robot, scene, iterations=iterations, time_budget_s=time_budget_s, obstacles=unseen, settings=settings,
        target_grasps=grasps.first, more_grasps=grasps.more, pace=pace,
    )  # fmt: skip
    motions.start()
    chooses = make_policy(policy, motions, model=model, max_moves=max_moves) if isinstance(policy, str) else policy(motions)
    rng = np.random.default_rng([seed, STAGE, scene.random_word])
    plan = retrieve(scene, chooses, motions, name=name, rule=rule, max_moves=max_moves, rng=rng, on_step=on_step)
    plan = planned_in.judged(robot, plan)
    if not unseen or plan.success:
        return plan
    from planning.sensing.missing_views import for_want_of_views  # views and what draws them: not every plan needs them

    return for_want_of_views(motions, plan, planned_in.as_it_is)


def verify_plan(scene: Scene, plan: Plan) -> tuple[Fault, ...]:
    """Everything that is wrong with a plan, judged from scene and plan alone; nothing when it holds."""
    return judge(scene, plan, from_ref(scene.robot))


def default_policy(robot: str, model: Model | None = None) -> str:
    """The policy when none is asked for: "neural" where there are networks for the robot, else the look ahead alone."""
    return "neural" if model is not None or ships(robot) else "lookahead"
