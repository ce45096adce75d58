"""Runs of gen, plan, sense, label and train, killed at random moments and gone on with: they must end in the bytes of a run in one go.

    python benchmarks/kills.py [--kills 100] [--seed 0] [--commands gen,plan,sense,label,train] [--scenes 6]

Each command runs once in one go, which also says how long it takes. Then it is begun, killed (SIGKILL, SIGTERM or SIGINT by turns) after a
random share of that time, and begun again with --resume, until it ends by itself; and so on until there were enough kills. Compared are
the bytes of what it writes, but for the times that are measured. Prints one line of JSON: kills and runs by command, and how many runs
ended in other bytes.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MEASURED = ("planning_time_s", "motion_time_s")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
RESUMES = ("gen", "plan", "sense", "train")  # label goes on of itself


def command(name: str, folder: Path, out: Path, scenes: int) -> list[str]:
    """The words of a command that writes to `out`."""
    given = str(folder / "scenes.jsonl")
    words = {
        "gen": ["gen", "-n", str(scenes), "--seed", "7"],
        "plan": ["plan", given, "--policy", "random"],
        "sense": ["sense", given, "--max-views", "2"],
        "label": ["label", given, "--paths", "2", "--moves", "1", "--objects", "1"],
        "train": ["train", str(folder / "labels"), "--epochs", "6", "--width", "16", "--threads", "1"],
    }[name]
    return [sys.executable, "-m", "retrieve_cli", *words, "-o", str(out)]


def written(out: Path) -> dict[str, bytes]:
    """What a command has written, without what a clock measured."""
    files = [out] if out.is_file() else sorted(p for p in out.rglob("*") if p.is_file() and "checkpoint" not in p.parts)
    found = {}
    for file in files:
        data = file.read_bytes()
        if file.suffix == ".jsonl":
            lines = [json.loads(line) for line in data.splitlines()]
            data = "\n".join(json.dumps({k: v for k, v in line.items() if k not in MEASURED}) for line in lines).encode()
        if file.name in ("config.json", "manifest.json", "train.json"):
            data = json.dumps({k: v for k, v in json.loads(data).items() if k not in ("complete", "seconds", "trained_s")}).encode()
        found["" if file == out else str(file.relative_to(out))] = data
    return found


def run(words: list[str], environment: dict[str, str], after_s: float | None, number: int) -> int | None:
    """The exit code, or None when it was killed after some seconds."""
    process = subprocess.Popen(
        words, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        return process.wait(after_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, number)
        process.wait()
        return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100, help="in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--commands", default="gen,plan,sense,label,train")
    options = parser.parse_args()
    rng, names = random.Random(options.seed), options.commands.split(",")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    totals = {name: {"kills": 0, "runs": 0, "other_bytes": 0} for name in names}
    with tempfile.TemporaryDirectory() as own:
        folder = Path(own)
        assert run(command("gen", folder, folder / "scenes.jsonl", options.scenes), environment, None, 0) == 0
        if "train" in names:
            assert run(command("label", folder, folder / "labels", options.scenes), environment, None, 0) == 0
        for name in names:
            ending = ".jsonl" if name in ("gen", "plan", "sense") else ""
            whole, out = folder / f"{name}-whole{ending}", folder / f"{name}-out{ending}"
            for _ in range(2):  # the first one compiles
                shutil.rmtree(whole, ignore_errors=True)
                began = time.monotonic()
                assert run(command(name, folder, whole, options.scenes), environment, None, 0) == 0, name
            took, wanted = time.monotonic() - began, written(whole)
            while totals[name]["kills"] < -(-options.kills // len(names)):
                resume: list[str] = []
                while True:
                    after_s = rng.uniform(0.3, 1.0) * took
                    code = run([*command(name, folder, out, options.scenes), *resume], environment, after_s, rng.choice(SIGNALS))
                    if code is not None:
                        break
                    totals[name]["kills"] += 1
                    begun = name != "train" or any(out.glob("checkpoint/*"))
                    if not begun and (out / "config.json").is_file():  # it was killed when all was done
                        code = 0
                        break
                    resume = ["--resume"] if name in RESUMES and begun else []
                totals[name]["runs"] += 1
                if code != 0 or written(out) != wanted:
                    totals[name]["other_bytes"] += 1
                    print(f"{name}: exit {code}, other bytes", file=sys.stderr, flush=True)
                shutil.rmtree(out) if out.is_dir() else out.unlink(missing_ok=True)
                for left in folder.glob(f"{name}-out*"):
                    shutil.rmtree(left) if left.is_dir() else left.unlink()
    kills = sum(t["kills"] for t in totals.values())
    print(json.dumps({"kills": kills, "other_bytes": sum(t["other_bytes"] for t in totals.values()), "by_command": totals}))


if __name__ == "__main__":
    main()
