"""Pointers of Git LFS: what a clone without git-lfs has in the place of large files."""

from __future__ import annotations

from pathlib import Path

START = b"version https://git-lfs.github.com/spec/"


def refuse_pointer(file: Path, what: str) -> None:
    """Raises: ValueError where Git LFS left a pointer in a file's place. what: the file should be, in a word. A file that can't be read is
    left to whoever reads it."""
    try:
        with file.open("rb") as opened:
            start = opened.read(len(START))
    except OSError:
        return
    if start == START:
        raise ValueError(f"{file} is a pointer of Git LFS, not the {what}: run `git lfs pull` where it is cloned")
