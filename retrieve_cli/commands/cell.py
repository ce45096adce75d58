"""What the cell is made of: robots, scenes, grasps; schemas and set-up: `robots`, `scene`, `grasp`, `schema`, `warmup`, `demo`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from retrieve_cli.commands.options import AsJson, GripperJoint, HandFrame, Job, Robot, Seed


def robots(
    name: Annotated[str | None, typer.Argument(help="A named robot or a URDF; all named ones if left out.", metavar="NAME|FILE")] = None,
    hand_frame: HandFrame = None,
    gripper_joint: GripperJoint = None,
    tool: Annotated[
        Path | None, typer.Option("--tool", help="Hang the gripper of this URDF on it, into --urdf FILE.", metavar="URDF")
    ] = None,
    at: Annotated[
        str | None, typer.Option("--at", help="The arm's link that carries --tool; its flange if left out.", metavar="LINK")
    ] = None,
    xacro_args: Annotated[
        list[str] | None,
        typer.Option("--xacro-arg", help="Of a xacro file, which becomes the robot of --urdf FILE; repeatable.", metavar="NAME:=VALUE"),
    ] = None,
    urdf: Annotated[Path | None, typer.Option("--urdf", help="Write its joined, cleaned URDF.", metavar="FILE")] = None,
    png: Annotated[Path | None, typer.Option("--png", help="Write a picture of it, with its hand frame and pads.", metavar="FILE")] = None,
    as_json: AsJson = False,
) -> Job:
    """List the named robots, or say what was understood of one or of a URDF, and write its URDF or a picture."""
    from retrieve_cli import robots as command

    return partial(
        command.run, name=name, hand_frame=hand_frame, gripper_joint=gripper_joint, tool=tool, at=at,
        xacro_args=xacro_args or (), urdf=urdf, png=png, as_json=as_json,
    )  # fmt: skip


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
    q_start: Annotated[
        str | None, typer.Option("--q-start", help="Where the arm is now, in rad; other joints are at home.", metavar="JOINT=Q,…")
    ] = None,
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
        gripper_joint=gripper_joint, base=base, q_start=q_start,
    )  # fmt: skip
    return partial(command.run, source=source, words=words, n=n, count=count, scale=scale, seed=seed, grasp=grasp, png=png, out=out)


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


def schema(
    kind: Annotated[str, typer.Argument(help="scene, plan, observation, labels, model, or words.", metavar="KIND")],
) -> Job:
    """Print the JSON Schema of a kind of file."""
    from retrieve_cli import schema as command

    return partial(command.run, kind=kind)


def warmup(
    robots: Annotated[
        list[str] | None, typer.Argument(help="Named robots; all that are installed if left out.", metavar="ROBOT...")
    ] = None,
) -> Job:
    """Compile ahead, and cover the named robots with spheres: later commands start at once."""
    from retrieve_cli import warmup as command

    return partial(command.run, robots=robots or [])


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the scene, the plan and the pictures.", metavar="DIR")] = Path("out"),
    seed: Seed = 0,
) -> Job:
    """Generate one hard scene, plan it, and write pictures of it."""
    from retrieve_cli import demo as command

    return partial(command.run, out=out, seed=seed)
