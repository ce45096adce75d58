"""What each part of the labels is worth: networks trained without it, judged on validation states by the whole labels.

    python benchmarks/ablate_labels.py LABELS [--epochs 12] [--device cuda]

The variants: all of the labels; 16 of the 64 paths, drawn from those that were found; no horizon (who goes first, where h gets shorter);
half of the scenes. Every variant has the same validation scenes and the same seed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import torch

from planning.learning.labelling.label_file import NOT_ASKED, read_manifest
from planning.learning.training.dataset import Data, read, split
from planning.learning.training.evaluate import judge_osnet, judge_rpnet
from planning.learning.training.settings import Settings
from planning.learning.training.train import make_net, train

FEW = 16
CERTAIN = 20.0  # a logit
COLUMNS = {
    "top1_opens_and_pickable": "frees the target, pickable %", "top1_first": "goes first %", "top1_first_of_several": "the same, h ≥ 2 %",
    "first_both": "region reachable, off the paths %", "first_shortens": "region shortens h %", "tries_until_both": "regions tried",
}  # fmt: skip


def fewer_paths(data: Data, blocks: list[list[int]]) -> Data:
    """The labels as 16 of the paths would have them: what each object blocks and would block, drawn without putting back."""
    rng, p, hits = np.random.default_rng(0), np.full_like(data.p, np.nan), data.hits.copy()
    known = (data.hits != NOT_ASKED) & (data.paths[:, None, None] > FEW)
    paths = np.broadcast_to(data.paths[:, None, None], hits.shape)[known].astype(int)
    hits[known] = rng.hypergeometric(np.minimum(data.hits[known], paths), paths - np.minimum(data.hits[known], paths), FEW)
    for i, counts in enumerate(blocks):
        found, few = int(data.paths[i]), min(FEW, int(data.paths[i]))
        if found:
            drawn = rng.hypergeometric(counts, found - np.array(counts), few) if counts else np.zeros(0)
            p[i, : len(counts)] = drawn / max(1, drawn.sum())
    return replace(data, p=p, hits=hits, paths=np.minimum(data.paths, FEW))


def without_horizon(data: Data) -> Data:
    """The labels as they were before they looked ahead."""
    return replace(data, first=np.full_like(data.first, np.nan), shorter=np.full_like(data.shorter, NOT_ASKED))


def half_of_the_scenes(data: Data) -> Data:
    """The states of every other scene."""
    return data.take(np.flatnonzero(np.isin(data.scene, np.unique(data.scene)[::2])))


def judged(data: Data, held_out: Data, settings: Settings, device: str, horizon: bool) -> dict[str, float]:
    """Train both networks and judge them. horizon: whether they were told of it; if not, OSNet's score does without."""
    found: dict[str, float] = {}
    for name, judge in (("osnet", judge_osnet), ("rpnet", judge_rpnet)):
        net = make_net(name, settings)
        net.load_state_dict(train(name, data, held_out if horizon else without_horizon(held_out), settings, device=device).weights)
        if name == "osnet" and not horizon:
            with torch.no_grad():
                dict(net.named_parameters())["head.2.weight"][3] = 0.0
                dict(net.named_parameters())["head.2.bias"][3] = -CERTAIN
        found |= judge(net, held_out, settings)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("labels", type=Path)
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--width", type=int, default=96)
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()
    data, _ = read(args.labels)
    tables = [parquet.read_table(args.labels / shard.file, columns=["blocks"]) for shard in read_manifest(args.labels).shards]
    blocks = [counts for table in tables for counts in table.column("blocks").to_pylist()]
    rest, held = split(data.scene, 0.1)
    held_out, settings = data.take(held), Settings(epochs=args.epochs, width=args.width)
    variants: dict[str, Callable[[], Data]] = {
        "all": lambda: data.take(rest),
        f"{FEW} paths": lambda: fewer_paths(data, blocks).take(rest),
        "no horizon": lambda: without_horizon(data).take(rest),
        "half of the scenes": lambda: half_of_the_scenes(data.take(rest)),
    }
    print(f"{len(rest)} states to train on, {len(held)} to validate on; {args.epochs} epochs\n")
    print("| labels | " + " | ".join(COLUMNS.values()) + " |\n|---" * 1 + "|---" * len(COLUMNS) + "|")
    for name, make in variants.items():
        found = judged(make(), held_out, settings, args.device, horizon=name != "no horizon")
        shown = [f"{found[c]:.2f}" if c == "tries_until_both" else f"{100 * found[c]:.1f}" for c in COLUMNS]
        print(f"| {name} | " + " | ".join(shown) + " |", flush=True)


if __name__ == "__main__":
    main()
