"""Files with a checksum: one that was cut off, damaged or put in another one's place is thrown away and made again.

The checksum stands behind the data, and covers the file's name.
"""

from __future__ import annotations

import hashlib
import os
import uuid
from contextlib import suppress
from pathlib import Path

_SIZE = hashlib.sha256().digest_size


def read(path: str | Path) -> bytes | None:
    """A file's data as it was written, or None; a file that is not as it was written is removed."""
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


def write(path: str | Path, data: bytes) -> None:
    """Write data with its checksum beside the file's name first. A disk that is full, or a folder that is gone, is no error; after a power
    cut the checksum tells."""
    part = f"{path}.tmp.{uuid.uuid4().hex[:16]}"
    try:
        with open(part, "wb") as stream:
            stream.write(data + _checksum(path, data))
        os.replace(part, path)
    except OSError:
        with suppress(OSError):
            os.unlink(part)


def _checksum(path: str | Path, data: bytes) -> bytes:
    """Of a file's name and its data."""
    return hashlib.sha256(os.path.basename(path).encode() + b"\0" + data).digest()
