"""Labels as padded arrays: the whole folder in memory, states of a scene all for training or all for validation.

M is the largest number of non-target objects, B of regions. What a label does not say (`NOT_ASKED` in the files) is NaN here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planning.learning.labelling.label_file import COLUMNS, MANIFEST, NOT_ASKED, read_manifest
from planning.learning.networks.tokens import F32, LENGTH_M
from planning.policies.regions import GAP_M

Flags = NDArray[np.bool_]
_UNREAD = ("state", "views")  # columns that training has no use for


@dataclass(frozen=True, eq=False)
class Data:
    """N states: the networks' inputs, normalised as in `tokens`, and what is to be predicted.

    scene (N,) ids; context (N, 9), grasp (N, 10), boxes (N, M + 1, 6) with mask (N, M + 1), regions (N, B, 4) with there (N, B).
    p (N, M): share of the blocked paths, NaN where no path was found; pickable, opens, first (N, M).
    feasible, hits, shorter (N, M, B) as in the files; paths, least_moves (N,). free (N, M, B): the object's box would touch no other
    there, nor a wall.
    """

    scene: NDArray[np.str_]
    context: F32
    grasp: F32
    boxes: F32
    mask: Flags
    regions: F32
    there: Flags
    p: F32
    pickable: F32
    opens: F32
    first: F32
    feasible: NDArray[np.uint8]
    hits: NDArray[np.uint8]
    shorter: NDArray[np.uint8]
    paths: F32
    least_moves: F32
    free: Flags

    def __len__(self) -> int:
        return len(self.scene)

    def take(self, index: NDArray[Any]) -> Data:
        """Some of the states."""
        return Data(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def distance(self) -> F32:
        """From each object to each region, in floor diagonals (N, M, B)."""
        way = self.boxes[:, 1:, None, :2] - self.regions[:, None, :, :2]
        diagonal = np.linalg.norm(self.context[:, 3:5], axis=1)
        return np.asarray(np.linalg.norm(way, axis=-1) / diagonal[:, None, None], np.float32)


def read_all(folders: Sequence[Path]) -> tuple[Data, dict[str, Any]]:
    """All labels of several folders, which must be of one robot, and a manifest for them: `source` and `hash` of all; see `read`."""
    parts, manifests = zip(*(read(folder) for folder in folders))
    if len(folders) == 1:
        return parts[0], manifests[0]
    robots = [m["robot"] for m in manifests]
    for folder, robot in zip(folders, robots):
        if robot != robots[0]:
            raise ValueError(f"{folder}: labels of the robot {robot}, and {folders[0]} has labels of {robots[0]}; a model is for one robot")
    scenes = [set(part.scene) for part in parts]
    for i, folder in enumerate(folders):
        if common := set().union(*scenes[:i]) & scenes[i]:
            raise ValueError(f"{folder}: has states of scene {min(common)}, as another folder has; label it with another --seed")
    digest = hashlib.sha256("".join(m["hash"] for m in manifests).encode()).hexdigest()[:16]
    return _joined(parts), {"robot": robots[0], "source": [m.get("source", m.get("spec")) for m in manifests], "hash": digest}


def read(folder: Path) -> tuple[Data, dict[str, Any]]:
    """All labels of a folder, and its manifest with `hash` (of all shards) added.

    Raises: ValueError that says which file is missing, too new, or not what the manifest promises.
    """
    import pyarrow.parquet as parquet

    manifest = read_manifest(folder)
    if not manifest.shards:
        raise ValueError(f"{folder / MANIFEST}: names no shards; label some scenes first: retrieve label -o {folder}")
    digest, tables = hashlib.sha256(), []
    for shard in manifest.shards:
        file = folder / shard.file
        if not file.is_file():
            raise ValueError(f"{file}: is missing, and manifest.json names it; run retrieve label again, it goes on where it stopped")
        content = hashlib.sha256(file.read_bytes()).hexdigest()
        if shard.sha256 not in (None, content):
            raise ValueError(f"{file}: is not the file that manifest.json describes (another sha256); label again into a new folder")
        digest.update(content.encode())
        try:
            tables.append(parquet.read_table(file, columns=[name for name in COLUMNS if name not in _UNREAD]))
        except Exception as e:  # pyarrow has no common class for a broken file, a missing column, a wrong type
            raise ValueError(f"{file}: is no shard of labels: {' '.join(str(e).split())[:200]}") from e
    try:
        parts = [_arrays(table) for table in tables if table.num_rows]
    except ValueError as e:
        raise ValueError(f"{folder}: {e}") from e
    except (KeyError, IndexError, TypeError, AttributeError, OverflowError) as e:  # a column of another kind, missing or empty lists
        raise ValueError(f"{folder}: holds what are no labels ({type(e).__name__}: {e}); label again into a new folder") from e
    if not parts:
        raise ValueError(f"{folder}: there is no state in it; label more scenes")
    robots = sorted({str(r) for table in tables for r in table.column("robot").unique().to_pylist()})
    if len(robots) > 1:
        raise ValueError(f"{folder}: states of the robots {', '.join(robots)}; a model is for one robot: label each in a folder of its own")
    return _joined(parts), {**manifest.settings, "robot": robots[0], "hash": digest.hexdigest()[:16]}


def split(scenes: NDArray[np.str_], share: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the states for training and for validation; a scene is wholly in one of them, whatever else is in the folder.

    Raises: ValueError when there are fewer than two scenes.
    """
    names = np.unique(scenes)
    if len(names) < 2:
        raise ValueError("all states are of one scene: none would be left for validation; label more scenes")
    drawn = np.array([int.from_bytes(hashlib.sha256(str(n).encode()).digest()[:6], "big") / 2**48 for n in names])
    held = set(names[drawn < share]) or {names[drawn.argmin()]}
    if len(held) == len(names):
        held = {names[drawn.argmin()]}
    validation = np.array([s in held for s in scenes])
    return np.flatnonzero(~validation), np.flatnonzero(validation)


def free_cells(boxes: F32, mask: Flags, cabinet: F32, regions: F32) -> Flags:
    """`policies.regions.free_regions` for many states: (N, M, B). All in the cabinet frame and in `LENGTH_M`."""
    gap = np.float32(GAP_M / LENGTH_M)
    size = boxes[:, 1:, None, 3:5]
    centre = regions[:, None, :, :2]
    inside = (centre[..., 0] + size[..., 0] / 2 <= cabinet[:, None, None, 0] - gap) & (centre[..., 0] >= size[..., 0] / 2)
    inside &= abs(centre[..., 1]) + size[..., 1] / 2 <= cabinet[:, None, None, 1] / 2 - gap
    inside &= boxes[:, 1:, None, 5] <= cabinet[:, None, None, 2]
    free = inside & (regions[:, None, :, 3] > 0.5) & mask[:, 1:, None]
    for other in range(boxes.shape[1]):
        box = boxes[:, None, None, other]
        apart = (abs(centre - box[..., :2]) >= (size + box[..., 3:5]) / 2 + gap).any(-1)
        apart |= ~mask[:, None, None, other]
        if other:
            apart[:, other - 1] = True  # where it stands itself is free once it is lifted
        free &= apart
    return np.asarray(free)


def _arrays(table: Any) -> Data:
    """One shard."""
    n = table.num_rows
    values, lengths = {}, {}
    for name in table.column_names:
        column = table.column(name).combine_chunks()
        if name in ("scene", "robot", "width_m", "paths", "least_moves"):
            values[name] = np.asarray(column.to_pylist())
        else:
            values[name], lengths[name] = column.flatten().to_numpy(zero_copy_only=False), np.diff(column.offsets.to_numpy())
    m, b = lengths["objects"] // 6, lengths["regions"] // 4
    wrong = np.any([lengths[name] != m for name in ("blocks", "pickable", "opens", "first")], axis=0)
    wrong |= np.any([lengths[name] != m * b for name in ("feasible", "hits", "shorter")], axis=0)
    if wrong.any():
        raise ValueError(f"row {int(wrong.argmax())} of scene {values['scene'][wrong.argmax()]}: its lists do not have one entry an object")
    most, cells = int(m.max()), int(b.max())

    def fixed(name: str, width: int) -> F32:
        return np.asarray(values[name].reshape(n, width), np.float32)

    def padded(name: str, shape: tuple[int, ...], fill: float, kind: type) -> NDArray[Any]:
        """Lists of differing length: rows of the same numbers of objects and regions are copied together."""
        out = np.full((n, *shape), fill, kind)
        start = np.concatenate([[0], np.cumsum(lengths[name])])
        for rows, cols in {(int(i), int(j)) for i, j in zip(m, b)}:
            which = np.flatnonzero((m == rows) & (b == cols))
            inner = _inner(name, rows, cols)
            flat = values[name][start[which][:, None] + np.arange(int(np.prod(inner)))]
            place: tuple[Any, ...] = (which, *(slice(0, k) for k in inner))
            out[place] = flat.reshape(len(which), *inner)
        return out

    unit = np.float32(1 / LENGTH_M)
    cabinet = fixed("cabinet", 3) * unit
    grasp = fixed("grasp", 9) * np.array([unit] * 3 + [1] * 6, np.float32)
    boxes = np.concatenate([fixed("target", 6)[:, None], padded("objects", (most, 6), 0, np.float32)], 1) * unit
    regions = padded("regions", (cells, 4), 0, np.float32) * np.array([unit, unit, unit, 1], np.float32)
    mask = np.arange(most + 1) <= m[:, None]
    paths = values["paths"].astype(np.float32)
    blocks = padded("blocks", (most,), 0, np.float32)
    p = np.where(paths[:, None] > 0, blocks / np.maximum(blocks.sum(1, keepdims=True), 1), np.nan)
    return Data(
        scene=values["scene"],
        context=np.concatenate([fixed("base", 3) * unit, cabinet, fixed("approaches", 3)], 1),
        grasp=np.concatenate([grasp, values["width_m"].astype(np.float32)[:, None] * unit], 1),
        boxes=boxes,
        mask=mask,
        regions=regions,
        there=np.arange(cells) < b[:, None],
        p=np.where(mask[:, 1:], p, np.nan).astype(np.float32),
        pickable=_known(padded("pickable", (most,), NOT_ASKED, np.uint8)),
        opens=_known(padded("opens", (most,), NOT_ASKED, np.uint8)),
        first=_known(padded("first", (most,), NOT_ASKED, np.uint8)),
        feasible=padded("feasible", (most, cells), NOT_ASKED, np.uint8),
        hits=padded("hits", (most, cells), NOT_ASKED, np.uint8),
        shorter=padded("shorter", (most, cells), NOT_ASKED, np.uint8),
        paths=paths,
        least_moves=values["least_moves"].astype(np.float32),
        free=free_cells(boxes, mask, cabinet, regions),
    )


def _inner(name: str, objects: int, regions: int) -> tuple[int, ...]:
    """The shape that a row's flat list has."""
    if name in ("feasible", "hits", "shorter"):
        return objects, regions
    return {"objects": (objects, 6), "regions": (regions, 4)}.get(name, (objects,))


def _known(flags: NDArray[np.uint8]) -> F32:
    return np.where(flags == NOT_ASKED, np.nan, flags).astype(np.float32)


def _joined(parts: Sequence[Data]) -> Data:
    """Shards one after another, padded to the largest."""
    fill: dict[str, Any] = dict.fromkeys(("p", "pickable", "opens", "first"), np.nan)
    fill |= dict.fromkeys(("feasible", "hits", "shorter"), NOT_ASKED)

    def join(name: str) -> NDArray[Any]:
        arrays = [getattr(part, name) for part in parts]
        shape = np.max([a.shape[1:] for a in arrays], axis=0) if arrays[0].ndim > 1 else ()
        pads = [[(0, 0), *((0, int(s) - k) for s, k in zip(shape, a.shape[1:]))] for a in arrays]
        return np.concatenate([np.pad(a, pad, constant_values=fill.get(name, 0)) if a.ndim > 1 else a for a, pad in zip(arrays, pads)])

    return Data(**{f.name: join(f.name) for f in fields(Data)})
