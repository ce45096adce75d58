"""Words and progress on stderr, tables on stdout: data and talk never mix."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from threading import Event, Thread
from time import perf_counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Column, Table

    from kinematics.robots.robot import Robot
    from kinematics.scene import Scene


def say(line: str) -> None:
    """One line of words, on stderr. Nobody's work is lost because nobody can read them."""
    with suppress(OSError):
        print(line, file=sys.stderr, flush=True)


say_once = lru_cache(say)
"""A line that is the same for many scenes."""


LEANS_DEG = 2.0
"""From here on it is said that a cabinet leans: a level one is rarely measured so badly."""


def say_what_was_read(where: str, scene: Scene) -> None:
    """Which objects were moved a little when a scene was read, a line each; and that its cabinet leans."""
    for settlement in scene.settled:
        say(f"{where}: {settlement}")
    if scene.cabinet.lean_deg > LEANS_DEG:
        say(f"{where}: note: the cabinet leans by {scene.cabinet.lean_deg:.1f}° from upright; if yours does not, see its q_wxyz")


def say_of_base(robot: Robot, scene: Scene) -> None:
    """Which obstacles stand through links of the robot that never move, and so may touch any."""
    from kinematics.collision.mounted import through_base

    for link, obstacle in through_base(robot, scene) if scene.obstacles else ():
        say_once(f"note: the obstacle {obstacle} stands through {link}, which never moves and may touch it; is its place right?")


def mesh_progress(file: str, share: float) -> None:
    """How much of taking a mesh apart is done, on one line of stderr that goes when it is; only on a terminal."""
    if sys.stderr is None or not sys.stderr.isatty():
        return
    line = f"{Path(file).name}: taken apart into convex parts, this once: {100 * share:.0f} %" if share < 1 else ""
    with suppress(OSError):
        print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)


def announce_first_run(*, drawing: bool = False) -> None:
    """Say why the first run takes long, lest anybody stare at a silent terminal, and let a second process compile meanwhile; or why every
    run takes long, if compiled code can't be kept. drawing: the command draws stills, too."""
    from kinematics.jit.cache_folder import WRONG, compiled_before, lacks_room
    from planning.compiling.ahead import known, loop_s, loops, start_beside, waiting

    if left := waiting():
        seconds = max(1.0, loops(left) * loop_s() / (2 if start_beside(drawing=drawing) else 1))
        functions = "1 function is" if len(left) == 1 else f"{len(left)} functions are"
        what = f"{functions} compiled, which takes about {seconds:.0f} s"
        if wrong := WRONG or lacks_room():
            say(f"getting ready: {what}, in every run, for they can't be kept: {wrong}; XDG_CACHE_HOME names another folder")
        else:
            say(f"getting ready: this once {what}; later runs start at once")
    elif WRONG:
        say(f"compiled code can't be kept, so every run compiles, which takes a minute: {WRONG}; XDG_CACHE_HOME names another folder")
    elif not known() and not compiled_before():
        say("getting ready: the first run compiles, which takes a minute; later ones start at once")


@contextmanager
def _telling_of_compilation(tell: Callable[[str], object]) -> Iterator[None]:
    """While functions are compiled, tell twice a second how far that is, and for how long at this pace; an empty line when it is done."""
    from planning.compiling.ahead import share_done

    begun, first, done = perf_counter(), share_done(), Event()

    def watch() -> None:
        while not done.wait(0.5) and (share := share_done()) < 1.0:
            gone = perf_counter() - begun
            left = f", about {gone / (share - first) * (1.0 - share):.0f} s more" if share > first and gone > 2.0 else ""
            tell(f"compiling, this once: {100 * share:.0f} %{left}")
        tell("")

    if first == 1.0:
        yield
        return
    watcher = Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


def show(*things: RenderableType) -> None:
    """Print Rich tables and texts on stdout: coloured and fitted on a terminal, plain and as wide as they need otherwise.

    A table that is wider than the terminal comes in several, each with the first column.
    """
    from rich.console import Console
    from rich.table import Table

    from planning.io.outputs import naming

    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else 240, highlight=False)
    with naming("stdout"):
        for thing in things:
            for part in parted(thing, console) if isinstance(thing, Table) else (thing,):
                console.print(part)


def parted(table: Table, console: Console) -> list[Table]:
    """A table as several, one below the other, each with the first column and as many others as a console has room for. It has
    no title and no caption: Rich folds these to a table's width, and the last part may be narrow; they are lines of their own."""
    from rich.measure import Measurement

    def part(which: Sequence[Column]) -> Table:
        out = copy(table)
        out.columns = [replace(column, _index=i) for i, column in enumerate(which)]
        return out

    def fits(which: Sequence[Column]) -> bool:
        return Measurement.get(console, console.options.update(max_width=10_000), part(which)).maximum <= console.width

    if not table.columns or fits(table.columns):
        return [table]
    first, *others = table.columns
    blocks = [[first]]
    for column in others:
        if len(blocks[-1]) > 1 and not fits([*blocks[-1], column]):
            blocks.append([first])
        blocks[-1].append(column)
    return [part(block) for block in blocks]


def on_terminal(out: Path | None) -> bool:
    """Whether somebody reads stderr on a terminal over which the data does not run. out: where it goes; None and "-" are stdout."""
    to_stdout = out is None or str(out) == "-"
    return sys.stderr.isatty() and not (to_stdout and sys.stdout.isatty())


@contextmanager
def progress(
    what: str, total: int | None = None, *, file: Path | None = None, done: int = 0, out: Path | None = None
) -> Iterator[Callable[[], None]]:
    """`with progress("planning", 20, out=out) as step: … step()`: a bar on stderr.

    Only on a terminal, see `on_terminal`. file: there is a step for each of its lines, if they can be counted; done: so many are behind us.
    """
    if not on_terminal(out):
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from planning.io.files import count_lines

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(what, total=count_lines(file) if total is None else total, completed=done)
        with _telling_of_compilation(lambda words: bar.update(task, description=f"{what} ({words})" if words else what)):
            yield lambda: bar.advance(task)
