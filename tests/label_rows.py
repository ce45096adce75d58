"""Labels read back row by row, for tests; training reads them column by column (planning.learning.training.dataset)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from planning.learning.labelling.label_file import read_manifest
from planning.learning.labelling.labels import Row
from planning.learning.labelling.shards import ARROW


def read_rows(folder: Path) -> Iterator[Row]:
    """Every row of a folder, shard by shard. Raises: ValueError for a manifest or a shard that can't be read."""
    for shard in read_manifest(folder).shards:
        try:
            table = pq.read_table(folder / shard.file, schema=ARROW)
        except (OSError, pa.ArrowException) as e:
            raise ValueError(f"{folder / shard.file}: can't be read ({e}); label again: what is whole is kept") from e
        columns = [table.column(name) for name in ARROW.names]
        for i in range(table.num_rows):
            yield _row({name: column[i].as_py() for name, column in zip(ARROW.names, columns)})


def _row(v: dict[str, Any]) -> Row:
    m, regions = len(v["pickable"]), np.array(v["regions"]).reshape(-1, 4)
    arrays: dict[str, Any] = {name: np.array(v[name], np.uint8).reshape(m, len(regions)) for name in ("feasible", "hits", "shorter")}
    arrays |= {name: np.array(v[name], np.uint8) for name in ("approaches", "pickable", "opens", "first")}
    arrays |= {name: np.array(v[name], float) for name in ("base", "cabinet", "grasp", "target")}
    return Row(
        scene=v["scene"], state=v["state"], robot=v["robot"], width_m=v["width_m"], paths=v["paths"],
        objects=np.array(v["objects"], float).reshape(m, 6), regions=regions, blocks=np.array(v["blocks"], np.int64),
        least_moves=v["least_moves"],
        views=v["views"],
        **arrays,
    )  # fmt: skip
