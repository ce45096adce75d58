"""How the program ends: bad input is one line and exit 2, an interruption 130, a closed pipe is no error, a bug says so.

Exit codes: 0 done; 1 done, but `--strict` was asked and a scene is unsolved; 2 bad input; 70 a bug in this program; 130 interrupted, 143
terminated, 129 hung up on: then all that is begun is cleared away, and the processes that were started are ended.
"""

from __future__ import annotations

import _thread
import errno
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

DONE, UNSOLVED, BAD_INPUT, BUG, INTERRUPTED = 0, 1, 2, 70, 130
ENDING = ("SIGTERM", "SIGHUP")
SOON_S = 0.05
"""After so long a signal comes again that came while an object was cleared away, where Python drops what is raised."""
NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO, errno.EBADF)


class ForeignPackageError(Exception):
    """Another distribution's package stands where one of ours should; so the library's own exceptions can't be imported for this."""


class Ended(BaseException):
    """A signal asks the program to end; number: of the signal; code: the exit code for it."""

    def __init__(self, number: int) -> None:
        self.number, self.code = number, 128 + number
        super().__init__(self.code)


def guarded(job: Callable[[], int | None], *, debug: bool = False) -> int:
    """Run `job` and return the exit code; what goes wrong is told in one line on stderr, or whole with `debug`."""
    try:
        with _ending() as came:
            code = _judged(job, debug, came)
    except Ended as e:
        code = e.code
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            _let_go(stream)
    return code


def _judged(job: Callable[[], int | None], debug: bool, came: Sequence[int]) -> int:
    """The exit code of a job. came: the signals that came while it ran."""
    try:
        code = job()
        if sys.stdout is not None:
            sys.stdout.flush()
        return code or DONE
    except KeyboardInterrupt:
        if debug:
            raise
        exec("")  # with python -m, CPython remembers an interrupt in code of a string, of which imports are full, and would end by signal
        return INTERRUPTED
    except BrokenPipeError:
        return DONE
    except SystemExit as e:
        if isinstance(e.__context__, BrokenPipeError):  # so do Typer and Rich end on a closed pipe, with 1
            return DONE
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
        if came:  # an import that is broken off may say so in words of its own, and leave half a module behind
            return 128 + came[0]
        if isinstance(e, (InputError, OSError)):
            # files say their names (planning.io.outputs.naming): what has none, and no room, is stdout
            stdout = isinstance(e, OSError) and e.filename is None and e.errno in NO_ROOM
            _tell(f"stdout: can't be written: {one_line(e).lower()}" if stdout else one_line(e))
            return BAD_INPUT
        if isinstance(e, MemoryError):
            _tell(f"there is not enough memory for this: {one_line(e)}")
            return BAD_INPUT
        _tell(f"this is a bug in retrieve, not in your input: {type(e).__name__}: {one_line(e)} (the same call with --debug says where)")
        return BUG


@contextmanager
def _ending() -> Iterator[Sequence[int]]:
    """Signals that ask the program to end come up as `Ended`, so that parts are kept and processes ended; a second one ends it at once.
    Ctrl-C comes up as KeyboardInterrupt, as ever. One that comes while an object is cleared away, where Python drops it,
    comes once more. The numbers of those that came are in what this gives."""
    before: dict[int, Any] = {}
    came: list[int] = []
    again: list[threading.Timer] = []
    tell_unraisable = sys.unraisablehook

    def end(number: int, _: object) -> None:
        came.append(number)
        signal.signal(number, signal.SIG_DFL)
        raise Ended(number)

    def interrupt(number: int, frame: FrameType | None) -> None:
        came.append(number)
        signal.default_int_handler(number, frame)

    def dropped(unraisable: Any) -> None:
        error: object = unraisable.exc_value
        number: int | None = None
        if isinstance(error, KeyboardInterrupt):
            number = signal.SIGINT
        elif isinstance(error, Ended):
            number = error.number
            signal.signal(number, end)
        if number is None:
            tell_unraisable(unraisable)
        else:
            again.append(threading.Timer(SOON_S, _thread.interrupt_main, (number,)))
            again[-1].start()

    if threading.current_thread() is threading.main_thread():
        sys.unraisablehook = dropped
        for name in ENDING:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:  # nohup has it ignored
                before[number] = signal.signal(number, end)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            before[signal.SIGINT] = signal.signal(signal.SIGINT, interrupt)
    try:
        yield came
    finally:
        for timer in again:
            timer.cancel()
        sys.unraisablehook = tell_unraisable
        for number, handler in before.items():
            signal.signal(number, handler)


def stand_in_for_closed_streams() -> None:
    """Give stdin, stdout and stderr that were closed before the program began something in their place, lest the first file that is opened
    gets their number. What is written to a closed stdout is an error, words for a closed stderr are lost."""
    for number, name, flags in ((0, "stdin", os.O_RDONLY), (1, "stdout", os.O_RDONLY), (2, "stderr", os.O_WRONLY)):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, flags)
            if handle != number:
                os.dup2(handle, number)
                os.close(handle)
            if number:
                setattr(sys, name, os.fdopen(number, "w", encoding="utf-8", closefd=False))


def _tell(line: str) -> None:
    with suppress(OSError):
        print(line, file=sys.stderr, flush=True)


def _let_go(stream: Any) -> None:
    """Whoever read our output has gone, or there is no room for it. Python flushes once more at its exit: give it somewhere to write."""
    try:
        stream.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
            stream.flush()
