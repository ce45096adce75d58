"""Results of a long run, scenes or plans, as JSON Lines: to a pipe, or to a file that a run which was broken off can be gone on with.

Stages are joined by pipes, so every line goes out as soon as it is there. A file is written beside its name, as NAME.part.jsonl, and
renamed at the end. Beside that part lies NAME.part.log: what the run was asked, then the key of every result. A later run with `resume`
checks both, and does what is left; one without moves the part aside. Nothing is touched before there is a first result.
"""

from __future__ import annotations

import json
import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import IO, Any, Generic, TypeVar

import orjson

from kinematics.errors import InputError
from kinematics.scene import Scene
from planning.io.files import folder_of
from planning.io.outputs import is_special, naming, part_of, place_for, rename
from planning.io.plan_documents import plan_to_json
from planning.io.scene_documents import scene_to_json
from planning.plan import Plan

T = TypeVar("T")
Item = TypeVar("Item")
Tell = Callable[[str], None]
Asked = Mapping[str, Any]


def scene_writer(
    out: Path | None, *, asked: Asked | None = None, resume: bool = False, tell: Tell = lambda _: None
) -> AbstractContextManager[Results[Scene]]:
    """`with scene_writer(out) as write: write(scene)`: JSON Lines to a file, or to stdout (None or "-").

    asked: everything that decides the results, as JSON has it. resume: go on with what an earlier run left, see `Results.left`. tell: is
    told what became of an earlier run's part, and of this one's when it is broken off.
    Raises: InputError when nothing can be written there, and with resume when the part is another run's, or there is no file.
    """
    return _results(out, partial(_scene_line, folder=folder_of(out)), asked or {}, resume, tell)


def plan_writer(
    out: Path | None, *, asked: Asked | None = None, resume: bool = False, tell: Tell = lambda _: None
) -> AbstractContextManager[Results[Plan]]:
    """`with plan_writer(out) as write: write(plan)`, like `scene_writer`."""
    return _results(out, plan_line, asked or {}, resume, tell)


def _scene_line(scene: Scene, folder: Path) -> str:
    return json.dumps(scene_to_json(scene, folder), ensure_ascii=False, allow_nan=False)


def plan_line(plan: Plan) -> str:
    """A plan as a line of a file: by orjson, for it has thousands of numbers. Raises: ValueError, see `documents.number`."""
    return orjson.dumps(plan_to_json(plan)).decode()


class Results(Generic[T]):
    """Where results go, one line each. kept: how many an earlier run has left."""

    def __init__(self, encode: Callable[[T], str], stream: IO[str] | None, name: str) -> None:
        self.kept = 0
        self._encode, self._stream, self._name = encode, stream, name

    def left(self, items: Iterable[Item], key: Callable[[Item], str]) -> Iterator[Item]:
        """The items whose results are not there yet; the results are to be written in their order.

        key: what tells an item from another one. Raises: InputError when one is not what the earlier run was given.
        """
        return iter(items)

    def __call__(self, value: T) -> None:
        """Write one result."""
        self._put(self._encode(value) + "\n")

    def _put(self, line: str) -> None:
        assert self._stream is not None
        with naming(self._name):
            self._stream.write(line)
            self._stream.flush()


class _File(Results[T]):
    """Results in a file that may be gone on with."""

    def __init__(self, encode: Callable[[T], str], out: Path, asked: Asked, tell: Tell) -> None:
        super().__init__(encode, None, str(out))
        self.target = place_for(out)
        self.part, self.log = part_of(self.target), part_of(self.target, ".log")
        self._asked, self._tell = json.loads(json.dumps(dict(asked))), tell
        self._keys: list[str] = []
        self._due = deque[str]()
        self._log: IO[str] | None = None
        self._written = 0
        self._begun = False  # until then the part is an earlier run's

    def left(self, items: Iterable[Item], key: Callable[[Item], str]) -> Iterator[Item]:
        for number, item in enumerate(items):
            own = key(item)
            if number >= len(self._keys):
                self._due.append(own)
                yield item
            elif self._keys[number] != own:
                raise InputError(
                    f"{self.part}: result {number + 1} is of another scene than the one that is given now; begin anew without --resume "
                    "(what is there is kept)"
                )

    def take_up(self) -> None:
        """Go on with what is there: whole lines whose keys are known. Raises: InputError when it was asked for something else."""
        if not self.part.exists():
            self._tell(f"{self._name}: there is no {self.part.name} to go on with: beginning at the first")
            return
        self._open()
        assert self._stream is not None
        assert self._log is not None
        ends, words = _line_ends(self.part), _line_ends(self.log)
        head, *keys = self.log.read_text(encoding="utf-8", errors="replace").split("\n")[: len(words)] or [""]
        try:
            before = dict(json.loads(head)["asked"])
        except (ValueError, KeyError, TypeError) as e:
            self.close()
            raise InputError(
                f"{self.part}: nobody knows what it was made for, {self.log.name} does not say; begin anew without --resume (what is there "
                "is kept)"
            ) from e
        if other := [name for name in {**before, **self._asked} if before.get(name) != self._asked.get(name)]:
            self.close()
            raise InputError(
                f"{self.part}: was made otherwise: {other[0]} was {before.get(other[0])!r}, and is {self._asked.get(other[0])!r} now; "
                "begin anew without --resume (what is there is kept)"
            )
        self.kept = min(len(ends), len(keys))
        self._keys = keys[: self.kept]
        with naming(self._name):
            os.truncate(self.part, [0, *ends][self.kept])
            os.truncate(self.log, words[self.kept])
        self._begun = True
        self._tell(f"{self._name}: {_are(self.kept)} there; going on")

    def _put(self, line: str) -> None:
        if self._stream is None:
            self._begin()
        super()._put(line)
        self._written += 1
        assert self._log is not None
        with naming(self._name):
            self._log.write((self._due.popleft() if self._due else "") + "\n")
            self._log.flush()

    def _begin(self) -> None:
        """Begin a part of one's own; one that is there already is moved aside."""
        self._open()
        if self.part.stat().st_size:
            aside = next(p for i in range(1, 10**6) if not (p := part_of(self.target, f"-{i}{self.target.suffix}")).exists())
            lines = len(_line_ends(self.part))
            self.close()
            os.replace(self.part, aside)
            self._tell(
                f"{self._name}: an earlier run left {self.part.name} ({lines} result{'s' * (lines != 1)}): it is kept as {aside.name}"
            )
            self._open()
        self._begun = True
        assert self._log is not None
        with naming(self._name):
            self._log.truncate(0)
            self._log.write(json.dumps({"asked": self._asked}) + "\n")
            self._log.flush()

    def _open(self) -> None:
        """Open part and log for appending. Raises: InputError when another run has them open."""
        with naming(self._name):
            self._stream = self.part.open("a", encoding="utf-8", newline="\n")
            self._log = self.log.open("a", encoding="utf-8", newline="\n")
            try:
                import fcntl

                fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except ImportError:  # no such locks on this system
                pass
            except BlockingIOError as e:
                self.close()
                raise InputError(f"{self._name}: another run is writing it just now ({self.part.name}); name another file") from e

    def close(self) -> None:
        for stream in (self._stream, self._log):
            if stream is not None:
                with naming(self._name):
                    stream.close()
        self._stream = self._log = None

    def finish(self) -> None:
        """All results are there: give the file its name."""
        if self._stream is None:
            self._begin()
        with naming(self._name):
            rename(self.part, self.target)
        self.close()
        self.log.unlink(missing_ok=True)

    def break_off(self) -> None:
        """Leave what is there to a later run, an earlier run's part above all; nothing, if there is nothing."""
        if self._stream is None:
            return
        count = self.kept + self._written
        if not self._begun:
            self._tell(f"{self._name}: broken off before it began; {self.part.name} is as it was")
        elif count == 0:
            self.part.unlink(missing_ok=True)
            self.log.unlink(missing_ok=True)
        else:
            self._tell(f"{self._name}: {_are(count)} in {self.part.name}; the same call with --resume goes on there")
        try:
            self.close()
        except InputError:
            return  # there is no room: that was told already


@contextmanager
def _results(out: Path | None, encode: Callable[[T], str], asked: Asked, resume: bool, tell: Tell) -> Iterator[Results[T]]:
    stdout = out is None or str(out) == "-"
    if resume and (stdout or is_special(out)):  # type: ignore[arg-type]  # a path, if it is not stdout
        raise InputError("--resume goes on with a file: name it with -o")
    if out is None or stdout:
        yield Results(encode, sys.stdout, "stdout")
        return
    if is_special(out):
        with naming(out), out.open("w", encoding="utf-8", newline="\n") as stream:
            yield Results(encode, stream, str(out))
        return
    file = _File(encode, out, asked, tell)
    try:
        if resume:
            file.take_up()
        yield file
        file.finish()
    except BaseException:
        file.break_off()
        raise


def _are(results: int) -> str:
    return "1 result is" if results == 1 else f"{results} results are"


def _line_ends(file: Path) -> list[int]:
    """Where the lines of a file end, in bytes from its start; a line that was cut off in the middle is none."""
    ends, at = [], 0
    with file.open("rb") as stream:
        for line in stream:
            at += len(line)
            if line.endswith(b"\n"):
                ends.append(at)
    return ends
