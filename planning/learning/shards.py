"""Labels on disk: a folder of Parquet shards and `manifest.json`, which says what they are and which of them are whole.

A shard is written beside its name and renamed, then the manifest is, so whoever reads a folder, even of a run that was killed or still
goes on, reads whole shards only. One row is one state; its columns are those of `planning.learning.labels.Row`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from planning.learning.labels import Row

SCHEMA = "retrieve/labels@1"
MANIFEST = "manifest.json"

_F32S, _BYTES, _COUNTS = pa.list_(pa.float32()), pa.list_(pa.uint8()), pa.list_(pa.int32())
COLUMNS = pa.schema(
    [
        ("scene", pa.string()),
        ("state", pa.int32()),
        ("robot", pa.string()),
        ("base", _F32S),
        ("cabinet", _F32S),
        ("approaches", _BYTES),
        ("grasp", _F32S),
        ("width_m", pa.float32()),
        ("target", _F32S),
        ("objects", _F32S),
        ("regions", _F32S),
        ("paths", pa.int32()),
        ("blocks", _COUNTS),
        ("pickable", _BYTES),
        ("opens", _BYTES),
        ("feasible", _BYTES),
        ("hits", _BYTES),
        ("views", pa.int32()),
    ]
)


@dataclass(frozen=True)
class Shard:
    """One file of a folder of labels: its name, how many rows it holds, and their hash."""

    file: str
    rows: int
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """What a folder of labels holds. settings: everything that decides the rows (seed, paths, robot, source, …); versions: who wrote it."""

    settings: Mapping[str, Any]
    versions: Mapping[str, str]
    shards: tuple[Shard, ...] = ()
    complete: bool = False

    @property
    def rows(self) -> int:
        return sum(shard.rows for shard in self.shards)


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a folder. Raises: ValueError when there is none, or none that this version reads."""
    file = folder / MANIFEST
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        schema = data.pop("schema")
        if schema != SCHEMA:
            raise ValueError(f"{file}: schema {schema!r}; this version reads {SCHEMA}: write the labels anew")
        shards = tuple(Shard(str(s["file"]), int(s["rows"]), str(s["sha256"])) for s in data.pop("shards"))
        return Manifest({k: v for k, v in data.items() if k not in ("versions", "complete")}, data["versions"], shards, data["complete"])
    except FileNotFoundError as e:
        raise ValueError(f"{folder}: no folder of labels, there is no {MANIFEST} in it (retrieve label -o {folder} writes one)") from e
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as e:
        raise ValueError(f"{file}: no manifest of labels, or a broken one ({type(e).__name__}: {e})") from e


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write a folder's manifest, beside its name first."""
    shards = [vars(shard) for shard in manifest.shards]
    data = {"schema": SCHEMA, **manifest.settings, "versions": dict(manifest.versions), "complete": manifest.complete, "shards": shards}
    part = folder / f"{MANIFEST}.part"
    part.write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    os.replace(part, folder / MANIFEST)


def write_shard(folder: Path, number: int, rows: Sequence[Row]) -> Shard:
    """Write one shard, beside its name first. The same rows give the same bytes."""
    name = f"shard-{number:05d}.parquet"
    table = pa.Table.from_pydict({c: [_plain(getattr(row, c)) for row in rows] for c in COLUMNS.names}, schema=COLUMNS)
    part = folder / f"{name}.part"
    pq.write_table(table, part, compression="zstd")
    digest = hashlib.sha256(part.read_bytes()).hexdigest()
    os.replace(part, folder / name)
    return Shard(name, len(rows), digest)


def whole(folder: Path, shards: Sequence[Shard]) -> int:
    """How many of the first shards are there, byte for byte."""
    for i, shard in enumerate(shards):
        file = folder / shard.file
        if not file.is_file() or hashlib.sha256(file.read_bytes()).hexdigest() != shard.sha256:
            return i
    return len(shards)


def read_rows(folder: Path) -> Iterator[Row]:
    """Every row of a folder, shard by shard. Raises: ValueError for a manifest or a shard that can't be read."""
    for shard in read_manifest(folder).shards:
        try:
            table = pq.read_table(folder / shard.file, schema=COLUMNS)
        except (OSError, pa.ArrowException) as e:
            raise ValueError(f"{folder / shard.file}: can't be read ({e}); label again: what is whole is kept") from e
        columns = [table.column(name) for name in COLUMNS.names]
        for i in range(table.num_rows):
            yield _row({name: column[i].as_py() for name, column in zip(COLUMNS.names, columns)})


def _plain(value: Any) -> Any:
    return np.ravel(value).tolist() if isinstance(value, np.ndarray) else value


def _row(v: dict[str, Any]) -> Row:
    m, regions = len(v["pickable"]), np.array(v["regions"]).reshape(-1, 4)
    arrays: dict[str, Any] = {name: np.array(v[name], np.uint8).reshape(m, len(regions)) for name in ("feasible", "hits")}
    arrays |= {name: np.array(v[name], np.uint8) for name in ("approaches", "pickable", "opens")}
    arrays |= {name: np.array(v[name], float) for name in ("base", "cabinet", "grasp", "target")}
    return Row(
        scene=v["scene"], state=v["state"], robot=v["robot"], width_m=v["width_m"], paths=v["paths"],
        objects=np.array(v["objects"], float).reshape(m, 6), regions=regions, blocks=np.array(v["blocks"], np.int64),
        views=v["views"] or 0,  # older shards don't tell: all of theirs are the truth
        **arrays,
    )  # fmt: skip
