"""Reading and writing scenes and plans as JSON Lines: one document a line, read as the lines arrive, written line by line.

So stages can be joined by pipes, and each answers before the one in front of it has finished.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import IO, Any, TypeVar

from kinematics.errors import InputError, did_you_mean
from kinematics.scene import Scene
from planning.io.checked import Node, parse_json
from planning.io.documents import kind_and_version
from planning.io.plan_documents import plan_from_node, plan_to_json
from planning.io.scene_documents import mesh_loader, scene_from_node, scene_to_json
from planning.plan import Plan

T = TypeVar("T")

_SCENES_FROM = "name a file of scenes or pipe them in: retrieve gen -n 20 | retrieve {command}"
_PLANS_FROM = "name a file of plans or pipe them in: retrieve gen -n 20 | retrieve plan | retrieve {command}"


# Reading ------------------------------------------------------------------------------------------------------------------------------


def read_scenes(source: Path | None, command: str = "plan") -> Iterator[tuple[str, Scene]]:
    """Yield (where, scene) for every line of a file, or of stdin (None or "-"), as they arrive; where is "scenes.jsonl:7".

    Raises: InputError (where, what, how to mend) for a line that is no valid scene, and when there is none at all.
    """
    folder, load = _folder(source), mesh_loader(_folder(source))
    yield from _read(source, partial(scene_from_node, folder=folder, load=load), _SCENES_FROM.format(command=command))


def read_plans(source: Path | None, command: str = "report") -> Iterator[tuple[str, Plan]]:
    """Yield (where, plan) like `read_scenes`."""
    yield from _read(source, plan_from_node, _PLANS_FROM.format(command=command))


def read_either(source: Path | None, command: str = "show") -> Iterator[tuple[str, Scene | Plan]]:
    """Yield (where, scene or plan) like `read_scenes`, as each line says what it is."""
    folder, load = _folder(source), mesh_loader(_folder(source))

    def decode(node: Node) -> Scene | Plan:
        return plan_from_node(node) if kind_and_version(node)[0] == "plan" else scene_from_node(node, folder, load)

    yield from _read(source, decode, _SCENES_FROM.format(command=command))


def _read(source: Path | None, decode: Callable[[Node], T], how: str) -> Iterator[tuple[str, T]]:
    empty = True
    for where, line in _lines(source, how):
        yield where, decode(parse_json(line, where))
        empty = False
    if empty:
        raise InputError(f"{_name(source)}: there is nothing in it; {how}")


def _lines(source: Path | None, how: str) -> Iterator[tuple[str, str]]:
    """(where, line) of a file or of stdin, without blank lines, as they arrive."""
    if source is None and sys.stdin.isatty():
        raise InputError(f"no file is named, and stdin is the terminal: {how}")
    stream = sys.stdin.buffer if _is_stdin(source) else _open(source)
    with stream:
        for number, raw in enumerate(stream, 1):
            where = f"{_name(source)}:{number}"
            try:
                line = raw.decode("utf-8-sig" if number == 1 else "utf-8").rstrip("\r\n")
            except UnicodeDecodeError as e:
                raise InputError(f"{where}: byte {e.start + 1} is not UTF-8 text; is this a JSON Lines file?") from e
            if line.strip():
                yield where, line


def _open(source: Path | None) -> IO[bytes]:
    assert source is not None
    try:
        return source.open("rb")
    except FileNotFoundError as e:
        siblings = [p.name for p in source.parent.iterdir()] if source.parent.is_dir() else []
        raise InputError(f"{source}: no such file{did_you_mean(source.name, siblings)}") from e


def _is_stdin(source: Path | None) -> bool:
    return source is None or str(source) == "-"


def _name(source: Path | None) -> str:
    return "stdin" if _is_stdin(source) else str(source)


def _folder(source: Path | None) -> Path:
    """The folder that paths inside the file are relative to; for stdin and stdout the current one."""
    return Path.cwd() if source is None or _is_stdin(source) else source.resolve().parent


# Writing --------------------------------------------------------------------------------------------------------------------------------


def scene_writer(out: Path | None) -> AbstractContextManager[Callable[[Scene], None]]:
    """`with scene_writer(out) as write: write(scene)`: JSON Lines to a file, or to stdout (None or "-"), line by line.

    A file is written beside its name, as NAME.part.jsonl, and renamed at the end; when the work is broken off, that part stays.
    """
    return _writer(out, partial(scene_to_json, folder=_folder(out)))


def plan_writer(out: Path | None) -> AbstractContextManager[Callable[[Plan], None]]:
    """`with plan_writer(out) as write: write(plan)`, like `scene_writer`."""
    return _writer(out, plan_to_json)


@contextmanager
def _writer(out: Path | None, encode: Callable[[T], dict[str, Any]]) -> Iterator[Callable[[T], None]]:
    def to(stream: Any) -> Callable[[T], None]:
        def write(value: T) -> None:
            stream.write(json.dumps(encode(value), ensure_ascii=False, allow_nan=False) + "\n")
            stream.flush()

        return write

    if out is None or str(out) == "-":
        yield to(sys.stdout)
        return
    with replacing(out, keep_part=True) as part, part.open("w", encoding="utf-8", newline="\n") as stream:
        yield to(stream)


@contextmanager
def replacing(out: Path, *, keep_part: bool = False) -> Iterator[Path]:
    """A path to write to, NAME.part.ENDING beside `out`, that is renamed to `out` when all went well, and removed if not `keep_part`.

    What is no ordinary file (/dev/null, a pipe) is written to directly.
    Raises: InputError when there is no such folder, or it can't be written to.
    """
    if out.exists() and not out.is_file():
        if out.is_dir():
            raise InputError(f"{out}: is a folder, not a file")
        yield out
        return
    target = out.resolve()  # a link stays a link
    if not target.parent.is_dir():
        raise InputError(f"{out}: the folder {target.parent} does not exist; make it first")
    part = target.with_name(f"{target.stem}.part{target.suffix}")
    try:
        part.open("wb").close()
    except OSError as e:
        raise InputError(f"{out}: can't be written: {(e.strerror or str(e)).lower()}") from e
    try:
        yield part
        os.replace(part, target)
    except BaseException:
        if not keep_part or part.stat().st_size == 0:
            part.unlink(missing_ok=True)
        raise


def write_text(out: Path, text: str) -> None:
    """Write a whole file, beside its name first. Raises InputError like `replacing`."""
    with replacing(out) as part:
        part.write_text(text, encoding="utf-8")
