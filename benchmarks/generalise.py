"""How the shipped networks do where nothing is as they were trained: other cabinets, more objects, other grids, another base.

    python benchmarks/generalise.py --scenes 100 --workers 2

One row a change to the spec `paper-any`, everything else as in it; networks are not trained again. Scenes, plans and specs stay in --out,
and what is there already is not made again. Seed 20261122 is the table's.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from planning.statistics import wilson
from retrieve_cli.__main__ import main as retrieve

CHANGES: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "as trained": {},
    "cabinet 20 % smaller": {"cabinet": {"size_m": [0.45, 0.69, 0.40]}, "target": {"depth_m": [0.13, 0.37]}},
    "cabinet 20 % larger": {"cabinet": {"size_m": [0.67, 1.03, 0.60]}, "target": {"depth_m": [0.19, 0.55]}},
    "12 to 15 objects": {"objects": {"count": [12, 15]}},
    "6 × 6 regions": {"regions": {"n": 6}},
    "14 × 14 regions": {"regions": {"n": 14}},
    "base 8 cm further, 10 cm higher": {"cabinet": {"front_m": 0.38, "floor_m": 0.0}},
}


def changed(spec: Mapping[str, Any], change: Mapping[str, Mapping[str, Any]]) -> str:
    """A spec with some values changed, as TOML: tables of numbers and lists."""
    lines = []
    for table, values in spec.items():
        lines.append(f"[{table}]")
        lines += [f"{key} = {value!r}".replace("'", '"') for key, value in {**values, **change.get(table, {})}.items()]
    return "\n".join(lines) + "\n"


def done(file: Path, *args: str) -> Path:
    """Have `retrieve` write a file, unless it is there."""
    if not file.is_file() and (code := retrieve([*args, "-o", str(file)])):
        sys.exit(code)
    return file


arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
arguments.add_argument("--scenes", type=int, default=100)
arguments.add_argument("--seed", type=int, default=20261122)
arguments.add_argument("--policies", nargs="+", default=["random", "local", "neural"])
arguments.add_argument("--workers", default="1")
arguments.add_argument("--out", type=Path, default=Path("out/generalise"))
asked = arguments.parse_args()

spec = tomllib.loads(resources.files("planning.scenes").joinpath("specs", "paper-any.toml").read_text())
lines = [f"{'success, rule deep':34s}" + "".join(f"{p:>18s}" for p in asked.policies)]
for title, change in CHANGES.items():
    folder = asked.out / "".join(c if c.isalnum() else "-" for c in title)
    folder.mkdir(parents=True, exist_ok=True)
    toml = folder / "spec.toml"
    toml.write_text(changed(spec, change))
    n, seed = str(asked.scenes), str(asked.seed)
    scenes = done(folder / "scenes.jsonl", "gen", "-n", n, "--seed", seed, "--spec", str(toml), "--workers", asked.workers)
    row = f"{title:34s}"
    for policy in asked.policies:
        plans = done(folder / f"{policy}.jsonl", "plan", str(scenes), "--policy", policy, "--workers", asked.workers)
        ends = [json.loads(line)["success"] for line in plans.read_text().splitlines()]
        share = wilson(sum(ends), len(ends))
        row += f"{100 * share.k / share.n:.0f} [{100 * share.low:.0f}, {100 * share.high:.0f}]".rjust(18)
    lines.append(row)
print("\n".join(lines))
