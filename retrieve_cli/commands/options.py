"""The options that several commands share, and the words that they may take."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated

import typer

Job = Callable[[], int | None]


class Rule(StrEnum):
    """How far the retrieval loop falls through when a proposed move can't be carried out: `planning.rules.Rule`, without loading it."""

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


ROBOT, SENSING, MOTIONS, PROCESSES = "Robot", "Looking", "Motions", "Processes"
"""The groups that a long list of options has in `--help`, beside those that belong to no group."""

Robot = Annotated[
    str | None,
    typer.Option("--robot", help="A named robot (see `retrieve robots`) or a URDF file.", metavar="NAME|URDF", rich_help_panel=ROBOT),
]
HandFrame = Annotated[
    str | None,
    typer.Option("--hand-frame", help="Link between the finger pads, for a URDF of one's own.", metavar="LINK", rich_help_panel=ROBOT),
]
GripperJoint = Annotated[
    str | None,
    typer.Option("--gripper-joint", help="Joint that opens the gripper, for a URDF of one's own.", metavar="JOINT", rich_help_panel=ROBOT),
]
Fit = Annotated[bool, typer.Option("--fit", help="Place and scale the cabinet for this arm's reach and gripper.", rich_help_panel=ROBOT)]
Seed = Annotated[int, typer.Option("--seed", help="Same seed, same result.", min=0)]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers", help="Processes at a time; by default 1 here, and all cores of a Ray cluster.", min=1, rich_help_panel=PROCESSES
    ),
]
At = Annotated[
    Engine, typer.Option("--engine", help="Where the processes run: here, or as tasks of a Ray cluster.", rich_help_panel=PROCESSES)
]
Address = Annotated[
    str | None,
    typer.Option(
        "--address",
        help="The cluster's address; without it, one of its own on this machine.",
        metavar="HOST:PORT",
        rich_help_panel=PROCESSES,
    ),
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with what an earlier call, which was broken off, has left beside the file of -o.")
]
PoseNoise = Annotated[
    float, typer.Option("--pose-noise", help="Overlaps and gaps up to so many mm are settled as noise of poses.", min=0.0, max=20.0)
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
