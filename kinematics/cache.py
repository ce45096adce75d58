"""A folder for what is derived once and read often: hulls, sphere covers, compiled code. Keys hash the inputs, so a stale entry is never
read. What is kept is fed to compiled code, or is compiled code: every file has a checksum, so that one that was cut off, damaged or put in
another one's place is thrown away and made again; and a folder that somebody else could write to is not used.

The checksum stands behind the data, where numba's own reader does not look, and covers the file's name.
"""

from __future__ import annotations

import hashlib
import io
import os
import uuid
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_SIZE = hashlib.sha256().digest_size
_UNWRITTEN: dict[str, bytes] = {}
"""What there was no room for, by its file: machine code goes by way of files, and would be compiled again for each that calls it."""


def folder() -> Path:
    """`$XDG_CACHE_HOME/retrieve`, by default `~/.cache/retrieve`; by the XDG specification a relative path there does not count."""
    try:
        given = Path(os.environ.get("XDG_CACHE_HOME", ""))
        return (given if given.is_absolute() else Path.home() / ".cache") / "retrieve"
    except RuntimeError:  # a user without a home
        return Path("/nonexistent/retrieve")


def unsafe(place: Path) -> str:
    """Make a folder, unless it is there; and say what is wrong with it: that it can't be made or written to, or that others than the user
    could write to it. Nothing, when all is well."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = place.stat()
    except OSError as e:
        return f"{place} can't be made: {e.strerror}"
    if hasattr(os, "getuid"):
        if about.st_uid != os.getuid():
            return f"{place} belongs to somebody else"
        if about.st_mode & 0o022:
            return f"{place} may be written to by others (chmod go-w {place})"
    return "" if os.access(place, os.W_OK | os.X_OK) else f"{place} can't be written to"


def key(*parts: bytes | str) -> str:
    """A file-name-safe hash of the inputs."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()[:32]


def read(path: str | Path) -> bytes | None:
    """A file's data as it was written, or None; a file that is not as it was written is removed."""
    if str(path) in _UNWRITTEN:
        return _UNWRITTEN[str(path)]
    try:
        with open(path, "rb") as stream:
            content = stream.read()
    except OSError:
        return None
    data, digest = content[:-_SIZE], content[-_SIZE:]
    if digest == _checksum(path, data):
        return data
    with suppress(OSError):
        os.unlink(path)
    return None


def is_kept(path: str | Path) -> bool:
    """Whether a file was written by an earlier run, or by this one, which remembers what it could not write."""
    return str(path) in _UNWRITTEN or Path(path).is_file()


def write(path: str | Path, data: bytes, *, synced: bool = True) -> None:
    """Write data with its checksum beside the file's name, then rename it. A disk that is full, or a folder that is gone, is no error: this
    process remembers what it could not write.

    synced: wait until it is on the disk. What is not may be gone after a power cut, which the checksum tells.
    """
    part = f"{path}.tmp.{uuid.uuid4().hex[:16]}"
    try:
        with open(part, "wb") as stream:
            stream.write(data + _checksum(path, data))
            if synced:
                stream.flush()
                os.fsync(stream.fileno())
        os.replace(part, path)
    except OSError:
        with suppress(OSError):
            os.unlink(part)
        _UNWRITTEN[str(path)] = data
    else:
        _UNWRITTEN.pop(str(path), None)


def load(name: str) -> dict[str, NDArray[np.generic]] | None:
    """The arrays stored under a name, or None. An entry that is not as it was written is removed."""
    file = _file(name)
    data = None if unsafe(file.parent) else read(file)
    if data is None:
        return None
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return {k: arrays[k] for k in arrays.files}


def shipped(file: Path, name: str) -> dict[str, NDArray[np.generic]] | None:
    """The arrays of a name in a file that ships with the package and has many names' ("NAME/ARRAY"), or None."""
    wanted = _names(file).get(name, ())
    if not wanted:
        return None
    with np.load(file, allow_pickle=False) as arrays:
        return {k: arrays[f"{name}/{k}"] for k in wanted}


@lru_cache(maxsize=4)
def _names(file: Path) -> dict[str, list[str]]:
    """The arrays' names by name in such a file; nothing where there is none."""
    if not file.is_file():
        return {}
    names: dict[str, list[str]] = {}
    with np.load(file, allow_pickle=False) as arrays:
        for entry in arrays.files:
            name, array = entry.split("/")
            names.setdefault(name, []).append(array)
    return names


def store(name: str, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Store arrays under a name; a cache that can't be written is no error."""
    file, stream = _file(name), io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the keyword `allow_pickle` for an array
    if not unsafe(file.parent):
        write(file, stream.getvalue())


def _file(name: str) -> Path:
    return folder() / f"{name}.arrays"


def _checksum(path: str | Path, data: bytes) -> bytes:
    """Of a file's name and its data."""
    return hashlib.sha256(os.path.basename(path).encode() + b"\0" + data).digest()
