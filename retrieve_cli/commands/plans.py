"""Plans: made, judged, handed to a controller: `plan`, `verify`, `export`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from retrieve_cli.commands.options import (
    MOTIONS,
    SENSING,
    Address,
    At,
    By,
    Engine,
    GripperJoint,
    HandFrame,
    Job,
    PoseNoise,
    Resume,
    Robot,
    Rule,
    Seed,
    TargetGrasp,
    Workers,
)


def plan(
    scenes: Annotated[Path | None, typer.Argument(help="Scenes, JSON Lines; stdin if left out or -.", metavar="SCENES")] = None,
    policy: Annotated[
        str | None,
        typer.Option(
            "--policy",
            help="Who chooses objects and regions: neural (the default where networks ship), neural-greedy, neural-paper, osnet-only, "
            "rpnet-only (these two with -paper, too), lookahead (the default elsewhere), search, rrt, local, random, or your own.",
            metavar="NAME|MODULE:FUNCTION",
        ),
    ] = None,
    rule: Annotated[Rule, typer.Option("--rule", help="What to try when a proposed move can't be carried out.")] = Rule.deep,
    seed: Seed = 0,
    iterations: Annotated[
        int | None, typer.Option("--iterations", help="Budget of a motion planner's call (RRT-Connect); if left out 3000.", min=1)
    ] = None,
    time_budget_s: Annotated[
        float | None,
        typer.Option("--time-budget-s", help="Seconds for a try of the target, or of a move, instead: not repeatable.", min=1e-3),
    ] = None,
    max_moves: Annotated[int, typer.Option("--max-moves", help="How many objects may be moved.", min=0)] = 5,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    model: Annotated[
        Path | None, typer.Option("--model", help="A model folder; by default the networks that ship for the robot.", metavar="DIR")
    ] = None,
    sense: Annotated[
        bool, typer.Option("--sense", help="Know nothing at first: look, plan on what is seen, look again.", rich_help_panel=SENSING)
    ] = False,
    world: Annotated[
        str | None,
        typer.Option(
            "--world",
            help="With --sense: a real cell, the object that this function returns.",
            metavar="MODULE:FUNCTION",
            rich_help_panel=SENSING,
        ),
    ] = None,
    noise: Annotated[
        bool, typer.Option("--noise", help="With --sense: depths as noisy as a stereo depth camera's.", rich_help_panel=SENSING)
    ] = False,
    by: Annotated[
        By, typer.Option("--by", help="With --sense: tell objects apart by masks, or by geometry alone.", rich_help_panel=SENSING)
    ] = By.mask,
    target_box: Annotated[
        str | None,
        typer.Option(
            "--target-box",
            help="With --sense: where the target is, in the world: cx,cy,cz,dx,dy,dz in metres.",
            metavar="BOX",
            rich_help_panel=SENSING,
        ),
    ] = None,
    smallest: Annotated[
        float,
        typer.Option(
            "--smallest",
            help="With --sense: nothing unseen is slimmer, nor than the slimmest seen; 0: any.",
            metavar="MM",
            min=0.0,
            rich_help_panel=SENSING,
        ),
    ] = 40.0,
    grasp: Annotated[
        TargetGrasp,
        typer.Option("--grasp", help="How to take the target: x_g, any grasp that fits, or the best of a list."),
    ] = TargetGrasp.given,
    clearance: Annotated[
        float,
        typer.Option(
            "--clearance",
            help="How far motions keep from everything, where the places they join let them, mm.",
            metavar="MM",
            rich_help_panel=MOTIONS,
        ),
    ] = 5.0,
    clearance_least: Annotated[
        float, typer.Option("--clearance-least", help="Less than that is refused, mm.", metavar="MM", rich_help_panel=MOTIONS)
    ] = 0.5,
    max_tilt: Annotated[
        float,
        typer.Option(
            "--max-tilt",
            help="How far what is carried may lean, where the scene does not say; 180 frees it.",
            metavar="DEG",
            rich_help_panel=MOTIONS,
        ),
    ] = 30.0,
    speed: Annotated[
        float, typer.Option("--speed", help="Share of full speed, 0.01 to 1: at 0.5 all takes twice as long.", rich_help_panel=MOTIONS)
    ] = 1.0,
    hand_speed: Annotated[
        float,
        typer.Option("--hand-speed", help="How fast the hand may move with an object in it, m/s.", metavar="M/S", rich_help_panel=MOTIONS),
    ] = 1.0,
    slow_below: Annotated[
        float,
        typer.Option(
            "--slow-below",
            help="Motions that come nearer to something slow down in proportion; 0: none.",
            metavar="MM",
            rich_help_panel=MOTIONS,
        ),
    ] = 0.0,
    limits: Annotated[
        Path | None,
        typer.Option(
            "--limits", help="Limits of velocity, acceleration and jerk of your own, TOML.", metavar="FILE", rich_help_panel=MOTIONS
        ),
    ] = None,
    unseen: Annotated[
        str,
        typer.Option(
            "--unseen",
            help="Scenes out of frames: space that nobody has seen is solid, or free.",
            metavar="solid|free",
            rich_help_panel=SENSING,
        ),
    ] = "solid",
    html: Annotated[Path | None, typer.Option("--html", help="Also write an animation of the first plan.", metavar="FILE")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 when a scene is unsolved.")] = False,
    workers: Workers = None,
    engine: At = Engine.local,
    address: Address = None,
    resume: Resume = False,
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="End at an invalid scene, instead of saying so in its plan.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Tell no stories on the terminal.")] = False,
    pose_noise_mm: Annotated[
        float,
        typer.Option(
            "--pose-noise", help="Overlaps and gaps up to so many mm are settled as noise of the objects' poses.", min=0.0, max=20.0
        ),
    ] = 2.0,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Plans, JSON Lines; stdout if left out.", metavar="FILE")] = None,
) -> Job:
    """Plan moves and motions that take the target out, or say why there are none."""
    from retrieve_cli import plan as command
    from retrieve_cli.plan_job import Job as PlanJob
    from retrieve_cli.robot_options import RobotOptions

    job = PlanJob(
        policy=policy,
        rule=rule.value,
        seed=seed,
        iterations=iterations,
        time_budget_s=time_budget_s,
        max_moves=max_moves,
        model=str(model) if model else None,
        sense=sense,
        noise=noise,
        by=by.value,
        target_box=target_box,
        smallest_mm=smallest,
        fail_fast=fail_fast,
        speed=speed,
        hand_speed=hand_speed,
        slow_below_mm=slow_below,
        limits=str(limits) if limits else None,
        unseen=unseen,
        clearance_mm=clearance,
        clearance_least_mm=clearance_least,
        max_tilt_deg=max_tilt,
        grasp=grasp.value,
        world=world,
    )
    return partial(
        command.run,
        job,
        scenes=scenes,
        out=out,
        robot=RobotOptions(robot, hand_frame, gripper_joint),
        html=html,
        strict=strict,
        workers=workers,
        engine=engine.value,
        address=address,
        resume=resume,
        pose_noise_mm=pose_noise_mm,
        quiet=quiet,
    )


def verify(
    scenes: Annotated[Path, typer.Argument(help="The scenes that the plans were made for, JSON Lines; - is stdin.", metavar="SCENES")],
    plans: Annotated[Path | None, typer.Argument(help="Plans, JSON Lines; stdin if left out or -.", metavar="PLANS")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print every fault, one line of JSON a plan.")] = False,
    mu: Annotated[float, typer.Option("--mu", help="Friction of the pads on objects.", min=0.01, max=5.0)] = 0.5,
    max_tilt_deg: Annotated[
        float | None,
        typer.Option(
            "--max-tilt",
            help="How far, in degrees, an object may lean while it is carried; if left out, as the scene says.",
            min=0.0,
            max=180.0,
        ),
    ] = None,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    workers: Workers = None,
    pose_noise_mm: PoseNoise = 2.0,
    seen: Annotated[
        Path | None,
        typer.Option("--seen", help="What the plans were made on, where SCENES is the truth: motions are judged on that.", metavar="FILE"),
    ] = None,
    limits: Annotated[Path | None, typer.Option("--limits", help="Limits that the plans were made by.", metavar="FILE")] = None,
) -> Job:
    """Judge plans from anywhere by their scenes alone: holds, contacts, limits, and whether each plan does what it says."""
    from retrieve_cli import verify as command
    from retrieve_cli.robot_options import RobotOptions

    return partial(
        command.run,
        scenes=scenes,
        plans=plans,
        as_json=as_json,
        mu=mu,
        max_tilt_deg=max_tilt_deg,
        robot=RobotOptions(robot, hand_frame, gripper_joint),
        workers=workers,
        pose_noise_mm=pose_noise_mm,
        seen=seen,
        limits=limits,
    )


def export(
    plans: Annotated[Path | None, typer.Argument(help="Plans, JSON Lines; stdin if left out or -.", metavar="PLANS")] = None,
    to: Annotated[str, typer.Option("--to", help="What the files are for.", metavar="ros2|urscript|franka|csv|npz")] = "csv",
    out: Annotated[Path, typer.Option("-o", "--out", help="The folder that gets one folder a plan.", metavar="DIR")] = Path("exported"),
    rate_hz: Annotated[
        float | None, typer.Option("--rate", help="Rows a second: csv 1000 by default, npz the plan's own rows.", metavar="HZ")
    ] = None,
    joints: Annotated[
        str | None, typer.Option("--joints", help="The arm's joints in the controller's order, with commas between.", metavar="NAMES")
    ] = None,
    scenes: Annotated[
        Path | None,
        typer.Option(
            "--scenes", help="The scenes that the plans were made for: judges each plan anew before it is written.", metavar="FILE"
        ),
    ] = None,
    limits: Annotated[
        Path | None, typer.Option("--limits", help="With --scenes: limits that the plans were made by.", metavar="FILE")
    ] = None,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    unverified: Annotated[bool, typer.Option("--unverified", help="Export plans that are not verified, too.")] = False,
) -> Job:
    """Write plans as files that a controller takes: trajectories of the arm, and the gripper's commands between them."""
    from retrieve_cli.export import command
    from retrieve_cli.robot_options import RobotOptions

    return partial(
        command.run,
        plans=plans,
        to=to,
        out=out,
        rate_hz=rate_hz,
        joints=joints,
        scenes=scenes,
        limits=limits,
        robot=RobotOptions(robot, hand_frame, gripper_joint),
        unverified=unverified,
    )
