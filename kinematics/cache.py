"""A folder for what is derived once and read often: hulls, sphere covers, compiled code. Keys hash the inputs, so a stale entry is never
read. What is kept is fed to compiled code: every entry has a checksum, and a folder that somebody else could write to is not used.
"""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_SIZE = hashlib.sha256().digest_size


def folder() -> Path:
    """`$XDG_CACHE_HOME/retrieve`, by default `~/.cache/retrieve`."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "retrieve"
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


def load(name: str) -> dict[str, NDArray[np.generic]] | None:
    """The arrays stored under a name, or None. An entry that is not as it was written is removed."""
    file = _file(name)
    try:
        if unsafe(file.parent):
            return None
        content = file.read_bytes()
    except OSError:
        return None
    digest, data = content[:_SIZE], content[_SIZE:]
    if digest != _checksum(name, data):
        with suppress(OSError):
            file.unlink()
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
    """Store arrays under a name, written beside and renamed; a cache that can't be written is no error."""
    file, stream = _file(name), io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the keyword `allow_pickle` for an array
    data = stream.getvalue()
    if unsafe(file.parent):
        return
    part = None
    try:
        with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".tmp", delete=False) as f:
            part = f.name
            f.write(_checksum(name, data) + data)
            f.flush()
            os.fsync(f.fileno())
        os.replace(part, file)
    except OSError:
        if part is not None:
            with suppress(OSError):
                os.unlink(part)


def _file(name: str) -> Path:
    return folder() / f"{name}.arrays"


def _checksum(name: str, data: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + data).digest()
