"""`retrieve plan`: moves and motions that take the target out, or the reason why there are none."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from retrieve_cli.errors import DONE, UNSOLVED, InputError, blame, choose
from retrieve_cli.files import plan_writer, read_scenes, replacing
from retrieve_cli.terminal import announce_first_run, progress, say

if TYPE_CHECKING:
    from kinematics.scene import RobotRef

STAGE = 4  # this stage's word in the seeds of random generators


def run(
    *,
    scenes: Path | None,
    policy: str,
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
) -> int:
    """Plan every scene; 1 when `strict` and some scene is unsolved."""
    import numpy as np

    from kinematics.robot import from_ref
    from planning.motion.pick_place import ITERATIONS, Motions
    from planning.policies import POLICIES, make_policy
    from planning.retrieval import Rule, retrieve

    choose("policy", policy, POLICIES)
    if iterations is not None and time_budget_s is not None:
        raise InputError("plan: --iterations and --time-budget-s exclude each other: give one budget")
    if time_budget_s is not None:
        say("a budget in seconds: the plans depend on this machine's speed and can't be repeated bit by bit")
    announce_first_run()
    unsolved = 0
    first = None
    with plan_writer(out) as write, progress("plans", out=out) as advance, replacing(html) if html else nullcontext() as page:
        for index, (where, scene) in enumerate(read_scenes(scenes)):
            if robot or hand_frame or gripper_joint:
                scene = replace(scene, robot=_override(scene.robot, robot, hand_frame, gripper_joint, where))
            with blame(where):
                arm = from_ref(scene.robot, on_step=say)
                motions = Motions(arm, scene, iterations=iterations or ITERATIONS, time_budget_s=time_budget_s)
                motions.start()
            rng = np.random.default_rng([seed, STAGE, index])
            plan = retrieve(scene, make_policy(policy, motions), motions, name=policy, rule=Rule(rule), max_moves=max_moves, rng=rng)
            write(plan)
            unsolved += not plan.success
            advance()
            first = first or (scene, plan)
        if page is not None and first is not None:
            from retrieve_cli.show import write_html

            write_html(*first, page)
    return UNSOLVED if strict and unsolved else DONE


def _override(scene: RobotRef, robot: str | None, hand_frame: str | None, gripper_joint: str | None, where: str) -> RobotRef:
    """The robot to plan with: another one, or the scene's own URDF with another hand frame or gripper joint. Raises InputError."""
    from kinematics.robot import named_robots
    from kinematics.scene import RobotRef

    if robot is None and scene.urdf is not None:
        return RobotRef(scene.T_world_base, None, scene.urdf, hand_frame or scene.hand_frame, gripper_joint or scene.gripper_joint)
    name = robot or scene.name
    if name not in named_robots():
        return RobotRef(scene.T_world_base, None, name, hand_frame, gripper_joint)
    if hand_frame or gripper_joint:
        raise InputError(f"{where}: --hand-frame and --gripper-joint are for a URDF of one's own; the robot {name} has its own")
    return RobotRef(scene.T_world_base, name)
