"""How the program ends: bad input is one line and exit 2, an interruption 130, a closed pipe is no error, a bug says so.

Exit codes: 0 done; 1 done, but `--strict` was asked and a scene is unsolved; 2 bad input; 70 a bug in this program; 130 interrupted.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

DONE, UNSOLVED, BAD_INPUT, BUG, INTERRUPTED = 0, 1, 2, 70, 130


class ForeignPackageError(Exception):
    """Another distribution's package stands where one of ours should; so the library's own exceptions can't be imported for this."""


def guarded(job: Callable[[], int | None], *, debug: bool = False) -> int:
    """Run `job` and return the exit code; what goes wrong is told in one line on stderr, or whole with `debug`."""
    try:
        code = job()
        sys.stdout.flush()
        return code or DONE
    except KeyboardInterrupt:
        if debug:
            raise
        return INTERRUPTED
    except BrokenPipeError:
        return _closed_pipe()
    except SystemExit as e:
        if isinstance(e.__context__, BrokenPipeError):  # so do Typer and Rich end on a closed pipe, with 1
            return _closed_pipe()
        raise
    except ForeignPackageError as e:
        if debug:
            raise
        _tell(str(e))
        return BAD_INPUT
    except Exception as e:
        from kinematics.errors import InputError, one_line  # only now: `--help` loads nothing of the library

        if debug:
            raise
        if isinstance(e, (InputError, OSError)):
            _tell(one_line(e))
            return BAD_INPUT
        _tell(f"this is a bug in retrieve, not in your input: {type(e).__name__}: {one_line(e)} (the same call with --debug says where)")
        return BUG


def _tell(line: str) -> None:
    try:
        print(line, file=sys.stderr, flush=True)
    except BrokenPipeError:
        _closed_pipe()


def _closed_pipe() -> int:
    """Whoever read our output has gone: end quietly. Python flushes once more at its exit, so give it somewhere to write."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(nowhere, stream.fileno())
    return DONE
