"""What a folder of labels looks like, for those who write it (shards.py) and those who read it (dataset.py): columns and manifest.

`manifest.json` names the shards that are whole. One row of a shard is one state, see `planning.learning.labelling.labels.Row`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SCHEMA = "retrieve/labels@2"
MANIFEST = "manifest.json"
NOT_ASKED = 255
"""What a flag or a count is where nobody looked."""
UNKNOWN = -1
"""What a number of moves is where none is known."""

COLUMNS = {
    "scene": "text",
    "state": "whole",
    "robot": "text",
    "base": "numbers",
    "cabinet": "numbers",
    "approaches": "flags",
    "grasp": "numbers",
    "width_m": "number",
    "target": "numbers",
    "objects": "numbers",
    "regions": "numbers",
    "paths": "whole",
    "blocks": "counts",
    "pickable": "flags",
    "opens": "flags",
    "least_moves": "whole",
    "first": "flags",
    "feasible": "flags",
    "hits": "flags",
    "shorter": "flags",
    "views": "whole",
}
"""The columns of a shard and their kinds; `shards.ARROW` says which of Arrow's types each kind is."""


@dataclass(frozen=True)
class Shard:
    """One file of a folder of labels: its name, how many rows it holds, and their hash (None: nobody said)."""

    file: str
    rows: int
    sha256: str | None


@dataclass(frozen=True)
class Manifest:
    """What a folder of labels holds. settings: everything that decides the rows (seed, paths, robot, source, …); versions: who wrote it."""

    settings: Mapping[str, Any]
    versions: Mapping[str, str]
    shards: tuple[Shard, ...] = ()
    complete: bool = False

    @property
    def rows(self) -> int:
        """How many rows all shards have."""
        return sum(shard.rows for shard in self.shards)


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a folder. Raises: ValueError when there is none, or none that this version reads."""
    file = folder / MANIFEST
    if not file.is_file():
        raise ValueError(f"{folder}: is no folder of labels, for it has no {MANIFEST}; make one: retrieve label scenes.jsonl -o {folder}")
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as e:
        raise ValueError(f"{file}: broken JSON: {e}") from e
    _check_schema(file, data.get("schema") if isinstance(data, dict) else None)
    try:
        shards = tuple(Shard(str(s["file"]), int(s.get("rows", 0)), s.get("sha256")) for s in data.get("shards", ()))
        versions = {str(k): str(v) for k, v in data.get("versions", {}).items()}
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as e:
        raise ValueError(f"{file}: its shards or versions are not what a manifest has ({type(e).__name__}: {e})") from e
    apart = ("schema", "versions", "complete", "shards")
    return Manifest({k: v for k, v in data.items() if k not in apart}, versions, shards, data.get("complete") is True)


def _check_schema(file: Path, schema: object) -> None:
    kind, _, version = str(schema).partition("@")
    own_kind, _, own_version = SCHEMA.partition("@")
    if kind != own_kind or not version.isdigit():
        raise ValueError(f"{file}: schema: {schema!r} is not {SCHEMA}")
    if version != own_version:
        if int(version) > int(own_version):
            raise ValueError(f"{file}: schema: {schema} is too new for this version, which reads {SCHEMA}")
        raise ValueError(f"{file}: schema: {schema} is too old, it does not say how many moves are needed; label into a new folder")
