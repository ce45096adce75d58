"""Recorded views as folders: one scene of the BOP layout a line of the scene file, and the fused cloud beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from kinematics.errors import InputError, blame
from perception.frames import Frame, read_frames, write_frames, write_ply

CLOUD = "cloud.ply"


def save_views(folder: Path, number: int, frames: Sequence[Frame]) -> Path:
    """Write the frames of scene `number` (its line, from 0) below `folder`, and their cloud as cloud.ply; return the scene's folder.

    Raises: InputError where nothing can be written, or where somebody else's recording lies.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the views")
    with blame(f"--views {folder}", OSError):
        home = write_frames(folder, frames, scene=number)
        write_ply(home / CLOUD, frames)
    return home


def load_views(folder: Path, number: int | None = None) -> tuple[Frame, ...]:
    """The recorded frames of scene `number` in the BOP layout; without a number, of the only scene there. Raises: InputError."""
    with blame(f"--from-views {folder}", OSError):
        return read_frames(folder, scene=number)
