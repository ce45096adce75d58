"""Words and progress on stderr, tables on stdout: data and talk never mix."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType

    from kinematics.scene import Scene


def say(line: str) -> None:
    """One line of words, on stderr. Nobody's work is lost because nobody can read them."""
    with suppress(OSError):
        print(line, file=sys.stderr, flush=True)


def say_settled(where: str, scene: Scene) -> None:
    """Which objects were moved a little when a scene was read, a line each."""
    for settlement in scene.settled:
        say(f"{where}: {settlement}")


def mesh_progress(file: str, share: float) -> None:
    """How much of taking a mesh apart is done, on one line of stderr that goes when it is; only on a terminal."""
    if sys.stderr is None or not sys.stderr.isatty():
        return
    line = f"{Path(file).name}: taken apart into convex parts, this once: {100 * share:.0f} %" if share < 1 else ""
    with suppress(OSError):
        print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)


def announce_first_run() -> None:
    """Say why the first run takes long, lest anybody stare at a silent terminal; and why every run does, if compiled code can't be kept."""
    from kinematics.jit.cache_folder import WRONG, compiled_before

    if WRONG:
        say(f"compiled code can't be kept, so every run compiles, which takes a minute: {WRONG}; XDG_CACHE_HOME names another folder")
    elif not compiled_before():
        say("getting ready: the first run compiles, which takes half a minute; later ones start at once")


def show(*things: RenderableType) -> None:
    """Print Rich tables and texts on stdout: coloured and fitted on a terminal, plain and as wide as they need otherwise."""
    from rich.console import Console

    from planning.io.outputs import naming

    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else 240, highlight=False)
    with naming("stdout"):
        for thing in things:
            console.print(thing)


def on_terminal(out: Path | None) -> bool:
    """Whether somebody reads stderr on a terminal over which the data does not run. out: where it goes; None and "-" are stdout."""
    to_stdout = out is None or str(out) == "-"
    return sys.stderr.isatty() and not (to_stdout and sys.stdout.isatty())


@contextmanager
def progress(what: str, total: int | None = None, *, out: Path | None = None) -> Iterator[Callable[[], None]]:
    """`with progress("planning", 20, out=out) as step: … step()`: a bar on stderr.

    Only on a terminal, see `on_terminal`.
    """
    if not on_terminal(out):
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda: bar.advance(task)
