"""The command line's words: every command with its options and help. The work is done in the module of the command's name.

A command reads its options and returns the job to do; `parse` hands it to `__main__`, which runs it. So nothing heavy is imported before
it is needed, and how a command ends is decided in one place (`errors.guarded`). A new command needs a function here and a module
`retrieve_cli/NAME.py` with `run(*, …) -> int | None`, which returns the exit code and raises InputError.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from retrieve_cli.errors import INTERRUPTED

Job = Callable[[], int | None]


class Rule(StrEnum):
    """How far the retrieval loop falls through when a proposed move can't be carried out."""

    deep = "deep"
    region = "region"
    strict = "strict"


class Engine(StrEnum):
    """Where the work is done."""

    local = "local"
    ray = "ray"


class Form(StrEnum):
    """Which networks to train."""

    objects = "objects"
    paper = "paper"


class Device(StrEnum):
    """Where to train."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


class TargetGrasp(StrEnum):
    """With which grasps the target may be taken."""

    given = "given"
    any = "any"
    list = "list"


class By(StrEnum):
    """How objects are told apart."""

    mask = "mask"
    geometry = "geometry"


class Camera(StrEnum):
    """Where a still picture is taken from."""

    hand = "hand"
    side = "side"


app = typer.Typer(
    name="retrieve",
    help="Take a target object out of a cluttered cabinet with a robot arm.\n\n"
    "Stages exchange JSON Lines, so they can be joined: retrieve gen -n 20 | retrieve plan | retrieve report",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Robot = Annotated[str | None, typer.Option("--robot", help="A named robot (see `retrieve robots`) or a URDF file.", metavar="NAME|URDF")]
HandFrame = Annotated[
    str | None, typer.Option("--hand-frame", help="Link between the finger pads, for a URDF of one's own.", metavar="LINK")
]
GripperJoint = Annotated[
    str | None, typer.Option("--gripper-joint", help="Joint that opens the gripper, for a URDF of one's own.", metavar="JOINT")
]
Seed = Annotated[int, typer.Option("--seed", help="Same seed, same result.", min=0)]
Workers = Annotated[
    int | None, typer.Option("--workers", help="Processes at a time; by default 1 here, and all cores of a Ray cluster.", min=1)
]
At = Annotated[Engine, typer.Option("--engine", help="Where the processes run: here, or as tasks of a Ray cluster.")]
Address = Annotated[
    str | None, typer.Option("--address", help="The cluster's address; without it, one of its own on this machine.", metavar="HOST:PORT")
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with what an earlier call, which was broken off, has left beside the file of -o.")
]
PoseNoise = Annotated[
    float, typer.Option("--pose-noise", help="Overlaps and gaps up to so many mm are settled as noise of poses.", min=0.0, max=20.0)
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def parse(args: Sequence[str]) -> Job | int | None:
    """The job that the arguments ask for, or an exit code when there is none (`--help`, `--version`).

    Raises: InputError for a wrong command line.
    """
    complaint, interrupted = _named("ClickException"), typer.Abort
    try:
        job: Job | int | None = typer.main.get_command(app)(args=list(args), prog_name="retrieve", standalone_mode=False)
        return job
    except complaint as e:
        names = [c.callback.__name__ for c in app.registered_commands if c.callback]
        command = " ".join(["retrieve", *[a for a in args if a in names][:1]])
        message = " ".join(e.format_message().split()).rstrip(".")  # type: ignore[attr-defined]
        from kinematics.errors import InputError

        raise InputError(f"{command}: {message} (see {command} --help)") from e
    except interrupted:
        return INTERRUPTED


def _named(name: str) -> type[Exception]:
    """An exception class of Click by its name: Typer brings Click along, from 0.20 on under a name of its own."""
    return next(c for c in typer.BadParameter.__mro__ if c.__name__ == name)


def _print_version(asked: bool) -> None:
    if asked:
        from retrieve_cli.version import version

        typer.echo(f"retrieve {version()}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True)] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def gen(
    n: Annotated[int, typer.Option("-n", help="How many scenes.", min=1)] = 1,
    seed: Seed = 0,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    spec: Annotated[str, typer.Option("--spec", help="What the scenes are like.", metavar="paper|paper-any|shelf|FILE.toml")] = "paper",
    fit: Annotated[bool, typer.Option("--fit", help="Place and scale the cabinet for this arm's reach and gripper.")] = False,
    workers: Workers = None,
    engine: At = Engine.local,
    address: Address = None,
    resume: Resume = False,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Scenes, JSON Lines; stdout if left out.", metavar="FILE")] = None,
) -> Job:
    """Generate scenes: the target is blocked at first, and can be reached in the empty cabinet."""
    from retrieve_cli import gen as command

    return partial(
        command.run,
        n=n,
        seed=seed,
        robot=robot,
        hand_frame=hand_frame,
        gripper_joint=gripper_joint,
        spec=spec,
        fit=fit,
        resume=resume,
        out=out,
        workers=workers,
        engine=engine.value,
        address=address,
    )


@app.command()
def sense(
    scenes: Annotated[Path | None, typer.Argument(help="Scenes, JSON Lines; stdin if left out or -.", metavar="SCENES")] = None,
    views: Annotated[
        Path | None, typer.Option("--views", help="Also write the frames, BOP layout, and the fused cloud (PLY).", metavar="DIR")
    ] = None,
    from_views: Annotated[
        Path | None, typer.Option("--from-views", help="Take recorded frames, BOP layout, instead of looking.", metavar="DIR")
    ] = None,
    max_views: Annotated[int, typer.Option("--max-views", help="How many views may be taken.", min=1)] = 8,
    known: Annotated[float, typer.Option("--known", help="The share of the space that is enough.", min=0.01, max=1.0)] = 0.97,
    noise: Annotated[bool, typer.Option("--noise", help="Depths as noisy as a stereo depth camera's.")] = False,
    by: Annotated[By, typer.Option("--by", help="How objects are told apart: by masks, or by geometry alone.")] = By.mask,
    target_box: Annotated[
        str | None, typer.Option("--target-box", help="Where the target is, in the world: centre and size.", metavar="CX,CY,CZ,DX,DY,DZ")
    ] = None,
    target_pixel: Annotated[
        str | None,
        typer.Option("--target-pixel", help="Where the target is in a frame: column and row, of frame 0.", metavar="[FRAME,]U,V"),
    ] = None,
    seed: Seed = 0,
    resume: Resume = False,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Observed scenes, JSON Lines; stdout if left out.", metavar="FILE")
    ] = None,
) -> Job:
    """Look into the cabinet with the camera in the hand, until enough is known."""
    from retrieve_cli import sense as command

    return partial(
        command.run,
        scenes=scenes,
        views=views,
        from_views=from_views,
        max_views=max_views,
        share=known,
        noise=noise,
        by=by.value,
        target_box=target_box,
        target_pixel=target_pixel,
        seed=seed,
        resume=resume,
        out=out,
    )


@app.command()
def label(
    scenes: Annotated[Path | None, typer.Argument(help="Scenes, JSON Lines; - is stdin. Generated if left out.", metavar="SCENES")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the shards and the manifest.", metavar="DIR")] = Path("labels"),
    n: Annotated[int | None, typer.Option("-n", help="How many scenes to generate, if no file is given.", min=1)] = None,
    spec: Annotated[
        list[str] | None,
        typer.Option("--spec", help="What they are like; several take turns.", metavar="paper|paper-any|shelf|FILE.toml"),
    ] = None,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    vary: Annotated[
        bool, typer.Option("--vary/--no-vary", help="Generate with the robot's place, the cabinet's size and the grid a little different.")
    ] = True,
    seed: Seed = 0,
    paths: Annotated[int, typer.Option("--paths", help="Paths to the target that a state's labels are counted on.", min=1, max=254)] = 64,
    moves: Annotated[int, typer.Option("--moves", help="Label the states after up to so many moves, too.", min=0)] = 3,
    objects: Annotated[
        int | None, typer.Option("--objects", help="Ask of so many objects a state where they can be put; of all if left out.", min=0)
    ] = None,
    partly_seen: Annotated[
        float, typer.Option("--partly-seen", help="Add a row for this share of the states: as a few views show them.", min=0.0, max=1.0)
    ] = 0.0,
    workers: Workers = None,
    engine: At = Engine.local,
    address: Address = None,
) -> Job:
    """Label states for training: which objects block the target, and where each could be put. Goes on where it was stopped."""
    from retrieve_cli import label as command

    return partial(
        command.run,
        scenes=scenes,
        out=out,
        n=n,
        spec=spec or ["paper"],
        robot=robot,
        hand_frame=hand_frame,
        gripper_joint=gripper_joint,
        vary=vary,
        seed=seed,
        paths=paths,
        moves=moves,
        objects=objects,
        partly_seen=partly_seen,
        workers=workers,
        engine=engine.value,
        address=address,
    )


@app.command()
def train(
    labels: Annotated[list[Path], typer.Argument(help="Folders that `retrieve label` wrote, for one robot.", metavar="LABELS...")],
    out: Annotated[Path, typer.Option("-o", "--out", help="The model folder to write.", metavar="DIR")],
    form: Annotated[
        Form, typer.Option("--form", help="Networks that see the other objects and judge feasibility, or those printed in the paper.")
    ] = Form.objects,
    epochs: Annotated[int, typer.Option("--epochs", help="Of each network, at most; fewer when validation gets no better.", min=1)] = 30,
    width: Annotated[int, typer.Option("--width", help="Numbers a token; the size of the networks.", min=8, max=1024)] = 96,
    batch: Annotated[int, typer.Option("--batch", help="States in a step.", min=1)] = 128,
    learning_rate: Annotated[float, typer.Option("--learning-rate", help="At its highest.", min=1e-6, max=1.0)] = 1.5e-3,
    seed: Seed = 0,
    threads: Annotated[int | None, typer.Option("--threads", help="Processor threads; PyTorch's choice if left out.", min=1)] = None,
    device: Annotated[Device, typer.Option("--device", help="Where to train; auto takes a CUDA device if there is one.")] = Device.auto,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a run that was broken off, with the same options.")] = False,
    begin: Annotated[
        Path | None,
        typer.Option("--from", help="Begin with a model's weights: few labels of a new cell, or robot, go further.", metavar="DIR"),
    ] = None,
) -> Job:
    """Train the networks on labels, and write a model folder for `retrieve plan --model`."""
    from retrieve_cli import train as command

    return partial(
        command.run,
        labels=labels,
        out=out,
        form=form.value,
        epochs=epochs,
        width=width,
        batch=batch,
        learning_rate=learning_rate,
        seed=seed,
        threads=threads,
        device=device.value,
        resume=resume,
        begin=begin,
    )


@app.command()
def plan(
    scenes: Annotated[Path | None, typer.Argument(help="Scenes, JSON Lines; stdin if left out or -.", metavar="SCENES")] = None,
    policy: Annotated[
        str | None,
        typer.Option(
            "--policy", help="Who chooses objects and regions: neural (where networks ship, the default), local, …", metavar="NAME"
        ),
    ] = None,
    rule: Annotated[Rule, typer.Option("--rule", help="What to try when a proposed move can't be carried out.")] = Rule.deep,
    seed: Seed = 0,
    iterations: Annotated[int | None, typer.Option("--iterations", help="Budget of a motion planner's call (RRT-Connect).", min=1)] = None,
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
    sense: Annotated[bool, typer.Option("--sense", help="Know nothing at first: look, plan on what is seen, look again.")] = False,
    world: Annotated[
        str | None,
        typer.Option("--world", help="With --sense: a real cell, the object that this function returns.", metavar="MODULE:FUNCTION"),
    ] = None,
    noise: Annotated[bool, typer.Option("--noise", help="With --sense: depths as noisy as a stereo depth camera's.")] = False,
    by: Annotated[By, typer.Option("--by", help="With --sense: tell objects apart by masks, or by geometry alone.")] = By.mask,
    target_box: Annotated[
        str | None,
        typer.Option("--target-box", help="With --sense: where the target is, in the world: cx,cy,cz,dx,dy,dz in metres.", metavar="BOX"),
    ] = None,
    grasp: Annotated[
        TargetGrasp,
        typer.Option("--grasp", help="How to take the target: x_g, any grasp that fits, or the best of a list."),
    ] = TargetGrasp.given,
    clearance: Annotated[
        float,
        typer.Option("--clearance", help="How far motions keep from everything, where the places they join let them, mm.", metavar="MM"),
    ] = 5.0,
    clearance_least: Annotated[float, typer.Option("--clearance-least", help="Less than that is refused, mm.", metavar="MM")] = 0.5,
    max_tilt: Annotated[
        float,
        typer.Option("--max-tilt", help="How far what is carried may lean, where the scene does not say; 180 frees it.", metavar="DEG"),
    ] = 30.0,
    speed: Annotated[float, typer.Option("--speed", help="Share of full speed, 0.01 to 1: at 0.5 all takes twice as long.")] = 1.0,
    hand_speed: Annotated[
        float, typer.Option("--hand-speed", help="How fast the hand may move with an object in it, m/s.", metavar="M/S")
    ] = 1.0,
    slow_below: Annotated[
        float,
        typer.Option("--slow-below", help="Motions that come nearer to something slow down in proportion; 0: none.", metavar="MM"),
    ] = 0.0,
    limits: Annotated[
        Path | None, typer.Option("--limits", help="Limits of velocity, acceleration and jerk of your own, TOML.", metavar="FILE")
    ] = None,
    unseen: Annotated[
        str, typer.Option("--unseen", help="Scenes out of frames: space that nobody has seen is solid, or free.", metavar="solid|free")
    ] = "solid",
    html: Annotated[Path | None, typer.Option("--html", help="Also write an animation of the first plan.", metavar="FILE")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 when a scene is unsolved.")] = False,
    workers: Workers = None,
    engine: At = Engine.local,
    address: Address = None,
    resume: Resume = False,
    fail_fast: Annotated[
        bool, typer.Option("--fail-fast", help="End at a scene that can't be meant, instead of saying so in its plan.")
    ] = False,
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

    return partial(
        command.run,
        scenes=scenes,
        policy=policy,
        rule=rule.value,
        seed=seed,
        iterations=iterations,
        time_budget_s=time_budget_s,
        max_moves=max_moves,
        robot=robot,
        hand_frame=hand_frame,
        gripper_joint=gripper_joint,
        model=model,
        sense=sense,
        world=world,
        noise=noise,
        by=by.value,
        target_box=target_box,
        grasp=grasp.value,
        clearance_mm=clearance,
        clearance_least_mm=clearance_least,
        max_tilt_deg=max_tilt,
        speed=speed,
        hand_speed=hand_speed,
        slow_below_mm=slow_below,
        limits=limits,
        unseen=unseen,
        html=html,
        strict=strict,
        resume=resume,
        fail_fast=fail_fast,
        quiet=quiet,
        pose_noise_mm=pose_noise_mm,
        out=out,
        workers=workers,
        engine=engine.value,
        address=address,
    )


@app.command()
def verify(
    scenes: Annotated[Path, typer.Argument(help="The scenes that the plans were made for, JSON Lines; - is stdin.", metavar="SCENES")],
    plans: Annotated[Path | None, typer.Argument(help="Plans, JSON Lines; stdin if left out or -.", metavar="PLANS")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print every fault, one line of JSON a plan.")] = False,
    mu: Annotated[float, typer.Option("--mu", help="Friction of the pads on objects.", min=0.01, max=5.0)] = 0.5,
    max_tilt_deg: Annotated[
        float | None, typer.Option("--max-tilt", help="How far, in degrees, an object may lean while it is carried.", min=0.0, max=180.0)
    ] = None,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    workers: Workers = None,
    pose_noise_mm: PoseNoise = 2.0,
) -> Job:
    """Judge plans from anywhere by their scenes alone: holds, contacts, limits, and whether each plan does what it says."""
    from retrieve_cli import verify as command

    return partial(
        command.run,
        scenes=scenes,
        plans=plans,
        as_json=as_json,
        mu=mu,
        max_tilt_deg=max_tilt_deg,
        robot=robot,
        hand_frame=hand_frame,
        gripper_joint=gripper_joint,
        workers=workers,
        pose_noise_mm=pose_noise_mm,
    )


@app.command()
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
    unverified: Annotated[bool, typer.Option("--unverified", help="Export plans that are not verified, too.")] = False,
) -> Job:
    """Write plans as files that a controller takes: trajectories of the arm, and the gripper's commands between them."""
    from retrieve_cli.export import command

    return partial(command.run, plans=plans, to=to, out=out, rate_hz=rate_hz, joints=joints, unverified=unverified)


@app.command()
def report(
    plans: Annotated[list[Path] | None, typer.Argument(help="Plans, JSON Lines; stdin if left out or -.", metavar="PLANS")] = None,
    scenes: Annotated[
        list[Path] | None,
        typer.Option("--scenes", help="The scenes that the plans were made for: adds success by number of objects.", metavar="FILE"),
    ] = None,
    out: Annotated[
        list[Path] | None, typer.Option("-o", "--out", help="A .md, .csv, .tex, .html or .json file, or several.", metavar="FILE")
    ] = None,
    as_json: AsJson = False,
) -> Job:
    """Success, moves, times and travel of plans, beside the paper's Table I, and why the others failed."""
    from retrieve_cli import report as command

    return partial(command.run, plans=plans or [], scenes=scenes or [], out=out or [], as_json=as_json)


@app.command()
def show(
    file: Annotated[
        Path | None, typer.Argument(help="A scene or a plan, JSON Lines; stdin if left out or -.", metavar="SCENE-OR-PLAN")
    ] = None,
    index: Annotated[int, typer.Option("--index", help="Which line of the file, from 0.", min=0)] = 0,
    scenes: Annotated[Path | None, typer.Option("--scenes", help="The scenes that the plan was made for.", metavar="FILE")] = None,
    html: Annotated[Path | None, typer.Option("--html", help="Write one self-contained page, animated.", metavar="FILE")] = None,
    png: Annotated[Path | None, typer.Option("--png", help="Write a still picture; needs no display.", metavar="FILE")] = None,
    camera: Annotated[Camera, typer.Option("--camera", help="Where the still is taken from.")] = Camera.side,
    plots: Annotated[bool, typer.Option("--plots", help="The page plots the joints over time against their limits, too.")] = False,
    parts: Annotated[bool, typer.Option("--parts", help="Draw the convex parts that stand for meshes, not the meshes.")] = False,
) -> Job:
    """Show a scene or a plan: in the browser, as a page, or as a still picture."""
    from retrieve_cli import show as command

    return partial(command.run, file=file, index=index, scenes=scenes, html=html, png=png, camera=camera.value, plots=plots, parts=parts)


@app.command()
def robots(
    name: Annotated[str | None, typer.Argument(help="A named robot or a URDF; all named ones if left out.", metavar="NAME|FILE")] = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    urdf: Annotated[Path | None, typer.Option("--urdf", help="Write its joined, cleaned URDF.", metavar="FILE")] = None,
    png: Annotated[Path | None, typer.Option("--png", help="Write a picture of it, with its hand frame and pads.", metavar="FILE")] = None,
    as_json: AsJson = False,
) -> Job:
    """List the named robots, or say what was understood of one or of a URDF, and write its URDF or a picture."""
    from retrieve_cli import robots as command

    return partial(
        command.run, name=name, hand_frame=hand_frame, gripper_joint=gripper_joint, urdf=urdf, png=png, as_json=as_json
    )  # fmt: skip


@app.command()
def scene(
    source: Annotated[
        Path | None,
        typer.Argument(help="A YAML of the same words, a folder of meshes, or observed scenes.", metavar="FILE.yaml|DIR|OBSERVED.jsonl"),
    ] = None,
    cabinet: Annotated[
        str | None, typer.Option("--cabinet", help="Inner depth, width and height: 0.56x0.86x0.5.", metavar="DXxDYxDZ")
    ] = None,
    at: Annotated[
        str | None, typer.Option("--at", help="The middle of the inner floor's front edge, in the world.", metavar="X,Y,Z[,yaw=DEG]")
    ] = None,
    objects: Annotated[
        list[str] | None,
        typer.Option("--object", help="box:DXxDYxDZ, can:RADIUSxHEIGHT or a mesh, on the floor at @x,y[,yaw=30].", metavar="SHAPE@X,Y[,…]"),
    ] = None,
    obstacles: Annotated[
        list[str] | None,
        typer.Option("--obstacle", help="What stands still: table:box:0.8x1.2x0.04@-0.1,0,top=0.", metavar="NAME:SHAPE@X,Y,Z"),
    ] = None,
    target: Annotated[str | None, typer.Option("--target", help="The object that is wanted.", metavar="NAME")] = None,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    base: Annotated[str | None, typer.Option("--base", help="Where the robot's base stands.", metavar="X,Y,Z[,yaw=DEG]")] = None,
    name: Annotated[str | None, typer.Option("--id", help="The scene's id.", metavar="TEXT")] = None,
    n: Annotated[int, typer.Option("-n", help="From a folder: how many scenes.", min=1)] = 1,
    count: Annotated[int, typer.Option("--count", help="From a folder: how many objects a scene.", min=1)] = 6,
    scale: Annotated[float, typer.Option("--scale", help="From a folder: what the meshes are scaled by; 0.001 for mm.", min=1e-6)] = 1.0,
    seed: Seed = 0,
    grasp: Annotated[bool, typer.Option("--grasp/--no-grasp", help="Propose x_g for the target.")] = True,
    png: Annotated[Path | None, typer.Option("--png", help="Also draw the first scene.", metavar="FILE")] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="The scene, JSON Lines; stdout if left out.", metavar="FILE")] = None,
) -> Job:
    """Build a scene from words: a cabinet, objects standing on its floor, obstacles, a target and a grasp for it."""
    from retrieve_cli import scene as command

    words = command.given(
        id=name, cabinet=cabinet, at=at, objects=objects, obstacles=obstacles, target=target, robot=robot, hand_frame=hand_frame,
        gripper_joint=gripper_joint, base=base,
    )  # fmt: skip
    return partial(command.run, source=source, words=words, n=n, count=count, scale=scale, seed=seed, grasp=grasp, png=png, out=out)


@app.command()
def grasp(
    scenes: Annotated[Path | None, typer.Argument(help="Scenes, JSON Lines; stdin if left out or -.", metavar="SCENES")] = None,
    source: Annotated[
        Path | None, typer.Option("--from", help="Grasps of a network, .npz, .npy or .json, instead of proposing them.", metavar="FILE")
    ] = None,
    convention: Annotated[
        str | None, typer.Option("--convention", help="Their frame: hand, contact-graspnet, graspnet or anygrasp.", metavar="NAME")
    ] = None,
    frame: Annotated[
        str,
        typer.Option(
            "--frame", help="What they are told in: world, base, view:K of a sensed scene, or x,y,z,qw,qx,qy,qz.", metavar="FRAME"
        ),
    ] = "world",
    most: Annotated[int, typer.Option("-n", "--most", help="How many grasps a scene keeps.", min=1)] = 12,
    png: Annotated[Path | None, typer.Option("--png", help="Draw the grasps of the first scene.", metavar="FILE")] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Scenes with grasps, JSON Lines; stdout if left out.", metavar="FILE")
    ] = None,
) -> Job:
    """Propose x_g for every scene's target, or take it from a grasp network; the others are its alternatives, the best first."""
    from retrieve_cli import grasp as command

    return partial(command.run, scenes=scenes, source=source, convention=convention, frame=frame, most=most, png=png, out=out)


@app.command()
def schema(
    kind: Annotated[str, typer.Argument(help="scene, plan, observation, labels, model, or words.", metavar="KIND")],
) -> Job:
    """Print the JSON Schema of a kind of file."""
    from retrieve_cli import schema as command

    return partial(command.run, kind=kind)


@app.command()
def warmup(
    robots: Annotated[
        list[str] | None, typer.Argument(help="Named robots; all that are installed if left out.", metavar="ROBOT...")
    ] = None,
) -> Job:
    """Compile ahead, and cover the named robots with spheres: later commands start at once."""
    from retrieve_cli import warmup as command

    return partial(command.run, robots=robots or [])


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the scene, the plan and the pictures.", metavar="DIR")] = Path("out"),
    seed: Seed = 0,
) -> Job:
    """Generate one hard scene, plan it, and write pictures of it."""
    from retrieve_cli import demo as command

    return partial(command.run, out=out, seed=seed)
