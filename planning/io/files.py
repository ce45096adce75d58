"""Reading scenes and plans as JSON Lines: one document a line, read as the lines arrive.

So stages can be joined by pipes, and each answers before the one in front of it has finished.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, TypeVar

from kinematics.errors import InputError, blame, did_you_mean
from kinematics.scene import Scene
from planning.io.checked import Node, is_text, parse_json
from planning.io.documents import kind_and_version
from planning.io.plan_documents import plan_from_node
from planning.io.scene_documents import OnMesh, mesh_loader, scene_from_node
from planning.io.settling import NOISE_M
from planning.plan import Plan

T = TypeVar("T")

GZIP = b"\x1f\x8b"
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
UNREADABLE = (OSError, RuntimeError)
"""What paths give besides ValueError: no permission, a name that is too long, links in a circle."""

_SCENES_FROM = "name a file of scenes or pipe them in: retrieve gen -n 20 | retrieve {command}"
_PLANS_FROM = "name a file of plans or pipe them in: retrieve gen -n 20 | retrieve plan | retrieve {command}"


@dataclass(frozen=True, eq=False)
class SceneLine:
    """A line of scenes. where: "scenes.jsonl:7"; key: a hash of the line; id: the scene's, or "line 7" where it has none.

    scene: None when the line is invalid; error: why, beginning with `where`.
    """

    where: str
    key: str
    id: str
    scene: Scene | None = None
    error: str = ""


def read_scenes(
    source: Path | None, command: str = "plan", *, noise_m: float = NOISE_M, on_mesh: OnMesh = lambda *_: None
) -> Iterator[tuple[str, Scene]]:
    """Yield (where, scene) for every line of a file, or of stdin (None or "-"), as they arrive; where is "scenes.jsonl:7".

    noise_m: how much overlap is taken for noise of the objects' poses (see `planning.io.settling`). on_mesh: see `mesh_loader`.
    Raises: InputError (where, what, how to mend) for a line that is no valid scene, and when there is none at all.
    """
    folder, load = folder_of(source), mesh_loader(folder_of(source), on_mesh)
    decode = partial(scene_from_node, folder=folder, load=load, noise_m=noise_m)
    yield from _read(source, decode, _SCENES_FROM.format(command=command))


def read_scene_lines(
    source: Path | None, command: str = "plan", *, noise_m: float = NOISE_M, on_mesh: OnMesh = lambda *_: None
) -> Iterator[SceneLine]:
    """Yield every line like `read_scenes`, those that are no valid scenes, too. Raises: InputError when there is no line at all."""
    decode = partial(scene_from_node, folder=folder_of(source), load=mesh_loader(folder_of(source), on_mesh), noise_m=noise_m)
    how, empty = _SCENES_FROM.format(command=command), True
    for where, raw in _lines(source, how):
        empty = False
        key, node = hashlib.sha256(raw).hexdigest()[:16], None
        try:
            with blame(where, *UNREADABLE):
                node = parse_json(_text(where, raw), where)
                scene = decode(node)
        except InputError as e:
            name = node.value.get("id") if node is not None and isinstance(node.value, dict) else None
            yield SceneLine(where, key, str(name) if is_text(name) else f"line {where.rpartition(':')[2]}", None, str(e))
        else:
            yield SceneLine(where, key, scene.id, scene)
    if empty:
        raise _nothing(source, how)


def read_known(
    source: Path | None, command: str, *, noise_m: float = NOISE_M, on_mesh: OnMesh = lambda *_: None
) -> tuple[list[tuple[str, Scene]], dict[str, str]]:
    """(where, scene) of every line of a file that plans were made for, and what is wrong with its invalid lines, by id.

    They did not end the batch, so they don't keep anybody from looking at its plans. Raises: InputError when there is no scene at all."""
    scenes, refused = list[tuple[str, Scene]](), dict[str, str]()
    for line in read_scene_lines(source, command, noise_m=noise_m, on_mesh=on_mesh):
        if line.scene is not None:
            scenes.append((line.where, line.scene))
        else:
            refused.setdefault(line.id, line.error)
    if not scenes:
        raise InputError(next(iter(refused.values())))
    return scenes, refused


def read_plans(source: Path | None, command: str = "report") -> Iterator[tuple[str, Plan]]:
    """Yield (where, plan) like `read_scenes`."""
    yield from _read(source, plan_from_node, _PLANS_FROM.format(command=command))


def read_either(source: Path | None, command: str = "show", *, on_mesh: OnMesh = lambda *_: None) -> Iterator[tuple[str, Scene | Plan]]:
    """Yield (where, scene or plan) like `read_scenes`, as each line says what it is."""
    folder, load = folder_of(source), mesh_loader(folder_of(source), on_mesh)

    def decode(node: Node) -> Scene | Plan:
        return plan_from_node(node) if kind_and_version(node)[0] == "plan" else scene_from_node(node, folder, load)

    yield from _read(source, decode, _SCENES_FROM.format(command=command))


def count_lines(source: Path | None) -> int | None:
    """How many documents a file has, one a line; None of stdin and of what is no regular file: reading it would be taking it away."""
    if source is None or _is_stdin(source) or not source.is_file():
        return None
    with source.open("rb") as stream:
        return sum(1 for line in stream if line.strip())


def _read(source: Path | None, decode: Callable[[Node], T], how: str) -> Iterator[tuple[str, T]]:
    empty = True
    for where, raw in _lines(source, how):
        with blame(where, *UNREADABLE):
            value = decode(parse_json(_text(where, raw), where))
        yield where, value
        empty = False
    if empty:
        raise _nothing(source, how)


def _nothing(source: Path | None, how: str) -> InputError:
    return InputError(f"{_name(source)}: there is nothing in it; {how}")


def _lines(source: Path | None, how: str) -> Iterator[tuple[str, bytes]]:
    """(where, line) of a file or of stdin, without blank lines, as they arrive."""
    if _is_stdin(source) and sys.stdin is None:
        raise InputError(f"no file is named, and stdin is closed: {how}")
    if source is None and sys.stdin.isatty():
        raise InputError(f"no file is named, and stdin is the terminal: {how}")
    stream = sys.stdin.buffer if _is_stdin(source) else _open(source)
    with stream:
        for number, raw in enumerate(stream, 1):
            line = (raw.removeprefix(b"\xef\xbb\xbf") if number == 1 else raw).rstrip(b"\r\n")
            if line.strip():
                yield f"{_name(source)}:{number}", line


def _text(where: str, raw: bytes) -> str:
    if raw.startswith(GZIP):
        raise InputError(f"{where}: this is compressed (gzip): gunzip -c FILE | retrieve …, with - for the file where another one is named")
    if raw.startswith(UTF_16):
        raise InputError(f"{where}: this is UTF-16, as PowerShell's > writes it: iconv -f UTF-16 -t UTF-8 FILE, or name the file by -o")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as e:
        raise InputError(f"{where}: byte {e.start + 1} is not UTF-8 text; is this a JSON Lines file?") from e


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


def folder_of(source: Path | None) -> Path:
    """The folder that paths inside the file are relative to; for stdin and stdout the current one. Raises: InputError."""
    if source is None or _is_stdin(source):
        return Path.cwd()
    with blame(str(source), *UNREADABLE):
        return source.resolve().parent
