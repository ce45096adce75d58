"""From arguments to the job that they ask for; the commands stand in `retrieve_cli.commands`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

import typer

from retrieve_cli.commands.cell import demo, grasp, robots, scene, schema, warmup
from retrieve_cli.commands.data import gen, label, sense, train
from retrieve_cli.commands.options import Job
from retrieve_cli.commands.plans import export, plan, verify
from retrieve_cli.commands.results import report, show
from retrieve_cli.errors import INTERRUPTED

app = typer.Typer(
    name="retrieve",
    help="Take a target object out of a cluttered cabinet with a robot arm.\n\n"
    "Stages exchange JSON Lines, so they can be joined: retrieve gen -n 20 | retrieve plan | retrieve report",
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
PANELS = {
    "Scenes": (gen, scene, grasp, sense),
    "Plans": (plan, verify, export, report, show),
    "Networks": (label, train),
    "Robots, files, set-up": (robots, schema, warmup, demo),
}
for panel, commands in PANELS.items():
    for command in commands:
        app.command(rich_help_panel=panel)(command)


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

        raise InputError(f"{command}: {_of_option(_of_choice(message))} (see {command} --help)") from e
    except interrupted:
        return INTERRUPTED


def _of_choice(message: str) -> str:
    """A complaint about a word that is none of an option's choices, with the nearest of them; any other as it is."""
    told = re.search(r"(Value error, )?('([^']*)' is not one of ('.+'))$", message)  # Typer has pydantic check, from 0.27 on
    if told is None:
        return message
    from kinematics.errors import did_you_mean

    return message[: told.start()] + told[2] + did_you_mean(told[3], re.findall("'([^']*)'", told[4]))


def _of_option(message: str) -> str:
    """A complaint about an option that there is not, with the commands that have it; any other as it is."""
    told = re.match("No such option:? (-[-a-z]+)", message)
    if told is None:
        return message
    commands = getattr(typer.main.get_command(app), "commands")  # noqa: B009, of Click's group, which Typer does not name
    have = [name for name, c in commands.items() if any(told[1] in (*p.opts, *p.secondary_opts) for p in c.params)]
    return f"{told[0]}; it is one of retrieve {', '.join(have)}" if have else message


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
