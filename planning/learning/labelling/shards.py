"""Labels on disk: a folder of Parquet shards and `manifest.json`, which says what they are and which of them are whole.

A shard is written beside its name and renamed, then the manifest is, so whoever reads a folder, even of a run that was killed or still
goes on, reads whole shards only. One row is one state; its columns are those of `planning.learning.labelling.labels.Row`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from planning.learning.labelling.label_file import COLUMNS, MANIFEST, SCHEMA, Manifest, Shard
from planning.learning.labelling.labels import Row

_KINDS: dict[str, Any] = {
    "text": pa.string(),
    "whole": pa.int32(),
    "number": pa.float32(),
    "numbers": pa.list_(pa.float32()),
    "flags": pa.list_(pa.uint8()),
    "counts": pa.list_(pa.int32()),
}
ARROW = pa.schema([(name, _KINDS[kind]) for name, kind in COLUMNS.items()])


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
    table = pa.Table.from_pydict({c: [_plain(getattr(row, c)) for row in rows] for c in ARROW.names}, schema=ARROW)
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


def _plain(value: Any) -> Any:
    return np.ravel(value).tolist() if isinstance(value, np.ndarray) else value
