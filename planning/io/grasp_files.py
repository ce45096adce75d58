"""Grasps of grasp networks, from arrays in .npz, .npy and .json files, turned into the hand's own convention.

Conventions, each with the frame of its own gripper:
- `hand`: this program's: z along the approach, y the way the fingers close, origin between the pads. (N, 4, 4) as `T`.
- `contact-graspnet` (Sundermeyer et al. 2021, github.com/NVlabs/contact_graspnet): z along the approach, x the way the fingers close,
  origin at the gripper's base, 0.1034 m before the contacts. (N, 4, 4) as `pred_grasps_cam`, scores (N,) as `scores`.
- `graspnet` and `anygrasp` (Fang et al. 2020, graspnetAPI's GraspGroup): rows (N, 17) of score, width, height, depth, rotation (9, row by
  row), translation (3), object; x along the approach, y the way the fingers close, the fingertips `depth` beyond the translation.

No pickled objects are read: they could run code.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from kinematics.errors import InputError
from kinematics.git_lfs import refuse_pointer
from kinematics.transforms import Array

CONVENTIONS = ("hand", "contact-graspnet", "graspnet", "anygrasp")
CONTACT_GRASPNET_DEPTH_M = 0.1034
ROW = 17
_POSES = ("pred_grasps_cam", "grasps", "T", "poses")
_SCORES = ("scores", "score")
_CONVENTIONAL = {"contact-graspnet": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], "graspnet": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]}


@dataclass(frozen=True, eq=False)
class ReadGrasps:
    """T (N, 4, 4): z along the approach, y the way the fingers close, in the frame of the file; scores (N,), higher is better.

    The origin lies between the pads where `at_tips` is False, and between the fingertips where it is True.
    """

    T: Array
    scores: Array
    at_tips: bool = False


def read_grasps(file: Path, convention: str) -> ReadGrasps:
    """The grasps of a file. Raises: InputError for a file that is none, or does not hold what the convention says."""
    arrays = _arrays(file)
    if convention in ("graspnet", "anygrasp"):
        return _from_rows(file, _numbers(file, _first(arrays, ("grasps", "grasp_group"))))
    T = _numbers(file, _first(arrays, _POSES))
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise InputError(f"{file}: {convention} grasps are poses (N, 4, 4), and these are {T.shape}")
    _check_rotations(file, T[:, :3, :3])
    if len(odd := np.flatnonzero(np.abs(T[:, 3] - (0, 0, 0, 1)).max(1, initial=0) > 1e-6)):
        raise InputError(
            f"{file}: grasp {odd[0]} is no pose: its last row is {', '.join(f'{v:g}' for v in T[odd[0], 3])}, and 0, 0, 0, 1 belongs "
            "there: are rows and columns exchanged?"
        )
    scores = next((_numbers(file, arrays[name]).ravel() for name in _SCORES if name in arrays), np.ones(len(T)))
    if len(scores) != len(T):
        raise InputError(f"{file}: {len(scores)} scores do not go with {len(T)} grasps")
    if convention == "hand":
        return ReadGrasps(T, scores)
    turned = _turned(T, convention)
    turned[:, :3, 3] += CONTACT_GRASPNET_DEPTH_M * turned[:, :3, 2]
    return ReadGrasps(turned, scores)


def _from_rows(file: Path, rows: Array) -> ReadGrasps:
    if rows.ndim != 2 or rows.shape[1] != ROW:
        raise InputError(f"{file}: grasps of graspnetAPI are rows of {ROW} numbers, and these are {rows.shape}")
    R, depth = rows[:, 4:13].reshape(-1, 3, 3), rows[:, 3]
    _check_rotations(file, R)
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R, rows[:, 13:16]
    turned = _turned(T, "graspnet")
    turned[:, :3, 3] += depth[:, None] * turned[:, :3, 2]
    return ReadGrasps(turned, rows[:, 0], at_tips=True)


def _turned(T: Array, convention: str) -> Array:
    """Poses (N, 4, 4) of a gripper frame as those of a hand with z along the approach and y the way the fingers close."""
    out = np.array(T, float)
    out[:, :3, :3] = T[:, :3, :3] @ np.array(_CONVENTIONAL[convention], float)
    return out


def _check_rotations(file: Path, R: Array) -> None:
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max((1, 2)) if len(R) else np.zeros(0)
    bad = np.flatnonzero((off > 1e-2) | (np.linalg.det(R) < 0) | ~np.isfinite(off))
    if len(bad):
        raise InputError(f"{file}: grasp {bad[0]} has no rotation: is the convention right, and are rows and columns as it says?")


def _arrays(file: Path) -> Mapping[str, Any]:
    """What a file holds, by name. Raises InputError."""
    if not file.is_file():
        raise InputError(f"{file}: no such file")
    try:
        refuse_pointer(file, "grasps")
        if file.suffix == ".json":
            data = json.loads(file.read_text(encoding="utf-8-sig"))
            return data if isinstance(data, dict) else {"array": data}
        if file.suffix in (".npy", ".npz"):
            with file.open("rb") as stream:
                found = np.load(stream, allow_pickle=False)  # which looks at what is in a file, not at its name
                return {"array": found} if isinstance(found, np.ndarray) else {name: found[name] for name in found.files}
    except (ValueError, EOFError, BadZipFile, RecursionError) as e:
        if "allow_pickle" in str(e) or "pickle" in str(e).lower():
            raise InputError(
                f"{file}: holds pickled objects, which are not read: they could run code; save plain arrays where you made them: "
                "np.savez(file, pred_grasps_cam=grasps[k], scores=scores[k])"
            ) from e
        raise InputError(f"{file}: can't be read: {e}") from e
    raise InputError(f"{file}: grasps come from .npz, .npy and .json files")


def _first(arrays: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    """The array that has one of the names, else the first one that there is."""
    return next((arrays[name] for name in names if name in arrays), next(iter(arrays.values()), None))


def _numbers(file: Path, values: Any) -> Array:
    try:
        numbers = np.asarray(values, float)
    except (TypeError, ValueError) as e:
        raise InputError(f"{file}: holds no array of numbers") from e
    if numbers.ndim == 0 or not np.isfinite(numbers).all():
        raise InputError(f"{file}: holds {'no array' if numbers.ndim == 0 else 'numbers that are not finite'}")
    return numbers
