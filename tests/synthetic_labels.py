"""Labels by a small rule instead of a planner: what stands in the straight lane between the robot and a thing is in its way."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

PATHS = 32
LANE_M = 0.05
CABINET = np.array([0.56, 0.86, 0.50])
BASE = np.array([-0.30, 0.0, -0.10])

SCHEMA = pa.schema(
    [("scene", pa.string()), ("state", pa.int32()), ("robot", pa.string())]
    + [(name, pa.list_(pa.float32())) for name in ("base", "cabinet", "grasp", "target", "objects", "regions")]
    + [(name, pa.list_(pa.uint8())) for name in ("approaches", "pickable", "opens", "first", "feasible", "hits", "shorter")]
    + [("width_m", pa.float32()), ("paths", pa.int32()), ("least_moves", pa.int32()), ("blocks", pa.list_(pa.int32()))]
)


def in_the_way(thing: np.ndarray, box: np.ndarray) -> bool:
    """Whether a box (6,) stands in the lane from the robot to a thing (6,)."""
    way = thing[:2] - BASE[:2]
    along = way / np.linalg.norm(way)
    to = box[:2] - BASE[:2]
    beside = abs(to[0] * along[1] - to[1] * along[0])
    return bool(to @ along < np.linalg.norm(way) - 1e-6 and beside < LANE_M + box[3] / 2)


def must_go(thing: np.ndarray, boxes: list[np.ndarray]) -> set[int]:
    """Which of some boxes must go before a thing can be taken: those in its way, and those in theirs."""
    found, things = set[int](), [thing]
    while things:
        thing = things.pop()
        new = {i for i, box in enumerate(boxes) if box is not thing and i not in found and in_the_way(thing, box)}
        found |= new
        things += [boxes[i] for i in new]
    return found


def row(name: str, rng: np.random.Generator, n: int = 6) -> dict[str, Any]:
    """One state of 3 to 7 objects and n × n regions."""
    boxes: list[np.ndarray] = []
    count = int(rng.integers(4, 9))
    while len(boxes) < count:
        half, height = rng.uniform(0.02, 0.035), rng.uniform(0.08, 0.25)
        x = rng.uniform(0.3, 0.5) if not boxes else rng.uniform(0.05, 0.5)
        box = np.array([x, rng.uniform(-0.38, 0.38), height / 2, 2 * half, 2 * half, height])
        if all((abs(box[:2] - b[:2]) >= (box[3] + b[3]) / 2 + 0.01).any() for b in boxes):
            boxes.append(box)
    target, objects = boxes[0], boxes[1:]
    m = len(objects)
    x = (np.arange(n) + 0.5) / n
    regions = np.column_stack([np.repeat(x * CABINET[0], n), np.tile((x - 0.5) * CABINET[1], n), np.zeros(n * n), np.ones(n * n)])
    blocks = np.array([PATHS * in_the_way(target, o) for o in objects], np.int32)
    pickable = [not any(in_the_way(o, b) for b in [target, *objects] if b is not o) for o in objects]
    hits, feasible = np.zeros((m, n * n), np.uint8), np.zeros((m, n * n), np.uint8)
    for k, o in enumerate(objects):
        for i, region in enumerate(regions):
            there = np.array([region[0], region[1], o[5] / 2, *o[3:]])
            others = [b for b in boxes if b is not o]
            free = all((abs(there[:2] - b[:2]) >= (there[3:5] + b[3:5]) / 2 + 0.005).any() for b in others)
            feasible[k, i] = pickable[k] and free and not any(in_the_way(there, b) for b in others)
            hits[k, i] = PATHS * in_the_way(target, there)
    needed = must_go(target, objects)
    first, shorter = [int(k in needed and pickable[k]) for k in range(m)], np.full((m, n * n), 255, np.uint8)
    for k, i in np.argwhere(feasible) if needed else ():
        there = np.array([*regions[i, :2], objects[k][5] / 2, *objects[k][3:]])
        shorter[k, i] = len(must_go(target, [*objects[:k], there, *objects[k + 1 :]])) < len(needed)
    yaw = np.arctan2(target[1], target[0] - BASE[0])
    return {
        "scene": name, "state": 0, "robot": "ur5e", "base": BASE, "cabinet": CABINET, "approaches": [1, 0, 0],
        "grasp": [target[0] - 0.14 * np.cos(yaw), target[1] - 0.14 * np.sin(yaw), 0.6 * target[5], 0, 0, 1, np.sin(yaw), -np.cos(yaw), 0],
        "width_m": target[3], "target": target, "objects": np.concatenate(objects), "regions": regions.ravel(), "paths": PATHS,
        "blocks": blocks, "pickable": pickable, "opens": [(blocks > 0).sum() == (blocks[k] > 0) for k in range(m)],
        "least_moves": len(needed), "first": first if needed else [255] * m,
        "feasible": feasible.ravel(), "hits": hits.ravel(), "shorter": shorter.ravel(),
    }  # fmt: skip


def write(folder: Path, states: int, seed: int = 0, shards: int = 2) -> Path:
    """A folder of labels; every second state is of the same scene as the one before."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    rows = [row(f"{seed}-{i // 2:06d}", rng, n=6 if i % 3 else 5) for i in range(states)]
    names = []
    for number, part in enumerate(np.array_split(np.arange(states), shards)):
        columns = {f.name: [np.asarray(rows[i][f.name]).tolist() for i in part] for f in SCHEMA}
        for name in ("pickable", "opens", "first"):
            columns[name] = [[int(v) for v in values] for values in columns[name]]
        names.append(f"shard-{number:05d}.parquet")
        parquet.write_table(pa.table(columns, SCHEMA), folder / names[-1])
    manifest = {"schema": "retrieve/labels@2", "paths": PATHS, "robot": "ur5e", "spec": "synthetic", "shards": [{"file": n} for n in names]}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder
