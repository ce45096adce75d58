"""Bad input as exceptions with one line each: where, what, how to mend it.

`RetrieveError` is the base class of every exception that this program raises on purpose.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class RetrieveError(Exception):
    """The base class of all that this program raises on purpose."""


class InputError(RetrieveError, ValueError):
    """Something that the user gave can't be used. The message is one line: where, what, how to mend it."""


class OptionError(InputError):
    """What an option asks for makes no sense: no scene is to blame, and no other scene would do better."""


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
    return f" (did you mean {str(near[0])!r}?)" if near else ""


def one_line(error: BaseException) -> str:
    """The error's message in one line; its type where there is no message."""
    if isinstance(error, OSError) and error.strerror:
        reason = {errno.ENOENT: "no such file or folder", errno.EISDIR: "is a folder, not a file", errno.EACCES: "permission denied"}
        text = reason.get(error.errno or 0, error.strerror)
        return f"{error.filename}: {text}" if error.filename else text
    return " ".join(str(error).split()) or type(error).__name__
