"""What came of it, in figures and pictures: `report`, `show`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from retrieve_cli.commands.options import AsJson, Camera, Job


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
