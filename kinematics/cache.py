"""A folder for what is derived once and read often: hulls, sphere covers. Keys hash the inputs, so a stale entry is never read."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def folder() -> Path:
    """`$XDG_CACHE_HOME/retrieve`, by default `~/.cache/retrieve`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "retrieve"


def compiled_before() -> bool:
    """Whether an earlier run has left compiled code of this very version behind."""
    return any(Path(os.environ["NUMBA_CACHE_DIR"]).rglob("*.nbc"))


def key(*parts: bytes | str) -> str:
    """A file-name-safe hash of the inputs."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()[:32]


def load(name: str) -> dict[str, NDArray[np.generic]] | None:
    """The arrays stored under a name, or None."""
    try:
        with np.load(folder() / f"{name}.npz", allow_pickle=False) as data:
            return {k: data[k] for k in data.files}
    except (OSError, ValueError, KeyError, EOFError):
        return None


def store(name: str, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Store arrays under a name, written beside and renamed; a cache that can't be written is no error."""
    try:
        folder().mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder(), suffix=".tmp", delete=False) as f:
            np.savez(f, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the keyword `allow_pickle` for an array
        os.replace(f.name, folder() / f"{name}.npz")
    except OSError:
        return
