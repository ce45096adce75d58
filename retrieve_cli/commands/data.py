"""Scenes, observations, labels, networks: `gen`, `sense`, `label`, `train`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from retrieve_cli.commands.options import (
    Address,
    At,
    By,
    Device,
    Engine,
    Fit,
    Form,
    GripperJoint,
    HandFrame,
    Job,
    Resume,
    Robot,
    Seed,
    Workers,
)

_SPECS = "paper, paper-any, shelf, hard, hard-any, lab-s, lab-l, or a TOML file"


def gen(
    n: Annotated[int, typer.Option("-n", help="How many scenes.", min=1)] = 1,
    seed: Seed = 0,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    spec: Annotated[str, typer.Option("--spec", help=f"What the scenes are like: {_SPECS}.", metavar="NAME|FILE.toml")] = "paper",
    fit: Fit = False,
    workers: Workers = None,
    engine: At = Engine.local,
    address: Address = None,
    resume: Resume = False,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Scenes, JSON Lines; stdout if left out.", metavar="FILE")] = None,
) -> Job:
    """Generate scenes: the target is blocked at first, and can be reached in the empty cabinet."""
    from retrieve_cli import gen as command
    from retrieve_cli.robot_options import RobotOptions

    return partial(
        command.run,
        n=n,
        seed=seed,
        robot=RobotOptions(robot, hand_frame, gripper_joint),
        spec=spec,
        fit=fit,
        resume=resume,
        out=out,
        workers=workers,
        engine=engine.value,
        address=address,
    )


def sense(
    scenes: Annotated[Path | None, typer.Argument(help="Scenes, JSON Lines; stdin if left out or -.", metavar="SCENES")] = None,
    views: Annotated[
        Path | None,
        typer.Option(
            "--views", help="Take the views that a plan needs, and write frames (BOP layout) and the fused cloud (PLY).", metavar="DIR"
        ),
    ] = None,
    from_views: Annotated[
        Path | None, typer.Option("--from-views", help="Take recorded frames, BOP layout, instead of looking.", metavar="DIR")
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            "--camera", help="With --from-views: the camera's intrinsics, a file of ROS, Open3D, OpenCV or RealSense.", metavar="FILE"
        ),
    ] = None,
    max_views: Annotated[
        int | None, typer.Option("--max-views", help="How many views may be taken; if left out 8, or 24 of a recording (--views).", min=1)
    ] = None,
    known: Annotated[
        float | None,
        typer.Option("--known", help="The share of the space that is enough; if left out 0.97, or 0.995 with --views.", min=0.01, max=1.0),
    ] = None,
    noise: Annotated[bool, typer.Option("--noise", help="Depths as noisy as a stereo depth camera's.")] = False,
    by: Annotated[By, typer.Option("--by", help="How objects are told apart: by masks, or by geometry alone.")] = By.mask,
    target_box: Annotated[
        str | None, typer.Option("--target-box", help="Where the target is, in the world: centre and size.", metavar="CX,CY,CZ,DX,DY,DZ")
    ] = None,
    target_pixel: Annotated[
        str | None,
        typer.Option("--target-pixel", help="Where the target is in a frame: column and row, of frame 0.", metavar="[FRAME,]U,V"),
    ] = None,
    smallest: Annotated[
        float,
        typer.Option("--smallest", help="With --from-views: nothing unseen is slimmer, in mm, or than the slimmest seen; 0: any.", min=0.0),
    ] = 40.0,
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
        camera=camera,
        max_views=max_views,
        share=known,
        noise=noise,
        by=by.value,
        target_box=target_box,
        target_pixel=target_pixel,
        smallest_mm=smallest,
        seed=seed,
        resume=resume,
        out=out,
    )


def label(
    scenes: Annotated[Path | None, typer.Argument(help="Scenes, JSON Lines; - is stdin. Generated if left out.", metavar="SCENES")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the shards and the manifest.", metavar="DIR")] = Path("labels"),
    n: Annotated[int | None, typer.Option("-n", help="How many scenes to generate, if no file is given.", min=1)] = None,
    spec: Annotated[
        list[str] | None,
        typer.Option("--spec", help=f"What they are like: {_SPECS}; several take turns.", metavar="NAME|FILE.toml"),
    ] = None,
    robot: Robot = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    fit: Fit = False,
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
    from retrieve_cli.robot_options import RobotOptions

    return partial(
        command.run,
        scenes=scenes,
        out=out,
        n=n,
        spec=spec or ["paper"],
        robot=RobotOptions(robot, hand_frame, gripper_joint),
        fit=fit,
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
