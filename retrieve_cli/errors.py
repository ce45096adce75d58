"""How the program ends: bad input is one line and exit 2, an interruption 130, a closed pipe is no error, a bug says so.

Exit codes: 0 done; 1 done, but `--strict` was asked and a scene is unsolved; 2 bad input; 70 a bug in this program; 130 interrupted.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

DONE, UNSOLVED, BAD_INPUT, BUG, INTERRUPTED = 0, 1, 2, 70, 130


class InputError(ValueError):
    """Something that the user gave can't be used. The message is one line: where, what, how to mend it."""


@contextmanager
def blame(where: str, *kinds: type[Exception]) -> Iterator[None]:
    """Turn the library's complaints about bad input (ValueError, and `kinds`) into an InputError that says where: "where: complaint"."""
    try:
        yield
    except InputError:
        raise
    except Exception as e:
        if not isinstance(e, (ValueError, *kinds)):
            raise
        raise InputError(f"{where}: {one_line(e)}") from e


def choose(what: str, given: str, valid: Iterable[str]) -> str:
    """`given`, if it is among `valid`. Raises InputError with the nearest name and the list of all: "unknown policy 'randm' …"."""
    names = list(valid)
    if given in names:
        return given
    raise InputError(f"unknown {what} {given!r}{did_you_mean(given, names)}; the valid names are {', '.join(names)}")


def did_you_mean(given: str, names: Iterable[str]) -> str:
    """The words " (did you mean 'x'?)" when one of `names` is close to `given`, else nothing."""
    from difflib import get_close_matches

    near = get_close_matches(given, list(names), n=1, cutoff=0.6)
    return f" (did you mean {near[0]!r}?)" if near else ""


def one_line(error: BaseException) -> str:
    """The error's message in one line; its type where there is no message."""
    if isinstance(error, OSError) and error.strerror:
        reason = {errno.ENOENT: "no such file or folder", errno.EISDIR: "is a folder, not a file", errno.EACCES: "permission denied"}
        text = reason.get(error.errno or 0, error.strerror)
        return f"{error.filename}: {text}" if error.filename else text
    return " ".join(str(error).split()) or type(error).__name__


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
    except (InputError, OSError) as e:
        if debug:
            raise
        _tell(one_line(e))
        return BAD_INPUT
    except Exception as e:
        if debug:
            raise
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
