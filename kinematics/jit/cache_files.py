"""Numba's cache files with a checksum: one that was cut off, damaged or put in another one's place is thrown away and made again.

Numba reads such files as they are: at best that ends in an exception of pickle, at worst damaged machine code runs. The checksum stands
behind the data, where numba's own reader does not look.
"""

from __future__ import annotations

import hashlib
import io
import os
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO, TypeVar, cast

import numba
from numba.core import caching

from kinematics.jit.support import PLAIN

Function = TypeVar("Function", bound=Callable[..., Any])
_Files: Any = getattr(caching, "IndexDataCacheFile", object)  # numba's own classes are untyped
_SIZE = hashlib.sha256().digest_size


def njit(**options: Any) -> Callable[[Function], Function]:
    """`numba.njit` with a checked cache; without the check where numba's inner parts are not used."""
    compiled: Any = numba.njit(**options)
    if PLAIN:
        return cast(Callable[[Function], Function], compiled)

    def decorate(function: Function) -> Function:
        dispatcher = compiled(function)
        files = getattr(dispatcher._cache, "_cache_file", None)
        if files is not None:
            files.__class__ = CheckedFiles
        return cast(Function, dispatcher)

    return decorate


class CheckedFiles(_Files):  # type: ignore[misc]
    """The index and the data files of one function."""

    def _load_index(self) -> Any:
        return super()._load_index() if _whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not _whole(path):
            raise FileNotFoundError(path)
        return super()._load_data(name)

    def save(self, key: Any, data: Any) -> None:
        with suppress(OSError):  # what can't be kept is compiled again
            super().save(key, data)

    @contextmanager
    def _open_for_write(self, path: str) -> Iterator[BinaryIO]:
        """Collect the data, and write them with their checksum beside the file's name first; on the disk before they get it."""
        data = io.BytesIO()
        yield data
        part = f"{path}.tmp.{uuid.uuid4().hex[:16]}"
        try:
            with open(part, "wb") as stream:
                stream.write(data.getvalue() + _checksum(path, data.getvalue()))
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(part, path)
        except OSError:
            with suppress(OSError):
                os.unlink(part)
            raise


def _whole(path: str) -> bool:
    """Whether a file is there as it was written; one that is not is removed."""
    try:
        with open(path, "rb") as stream:
            data = stream.read()
    except OSError:
        return False
    if data[-_SIZE:] == _checksum(path, data[:-_SIZE]):
        return True
    with suppress(OSError):
        os.unlink(path)
    return False


def _checksum(path: str, data: bytes) -> bytes:
    """Of a file's name and its data."""
    return hashlib.sha256(os.path.basename(path).encode() + b"\0" + data).digest()
