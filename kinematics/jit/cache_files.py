"""Numba's cache files with a checksum, see `kinematics.cache`.

Numba reads such files as they are: at best that ends in an exception of pickle, at worst damaged machine code runs. Its own reader does not
look behind the data, where the checksum stands.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO

from numba.core import caching

from kinematics import cache

_Files: Any = getattr(caching, "IndexDataCacheFile", object)  # numba's own classes are untyped


def check(dispatcher: Any) -> None:
    """Let a dispatcher's cache check its files."""
    files = getattr(dispatcher._cache, "_cache_file", None)
    if files is not None:
        files.__class__ = CheckedFiles


class CheckedFiles(_Files):  # type: ignore[misc]
    """The index and the data files of one function."""

    def _load_index(self) -> Any:
        return super()._load_index() if cache.read(self._index_path) is not None else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if cache.read(path) is None:
            raise FileNotFoundError(path)
        return super()._load_data(name)

    def save(self, key: Any, data: Any) -> None:
        with suppress(OSError):  # what can't be kept is compiled again
            super().save(key, data)

    @contextmanager
    def _open_for_write(self, path: str) -> Iterator[BinaryIO]:
        data = io.BytesIO()
        yield data
        cache.write(path, data.getvalue(), synced=False)
