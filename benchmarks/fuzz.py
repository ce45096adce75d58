"""Mutated inputs of every kind, read as the command line reads them: none may be a bug (exit 70), a hang or a crash.

    python benchmarks/fuzz.py [-n 10000] [--seed 0] [--kinds scene,plan,…]

Each kind has a few good inputs. A mutant has bytes cut, flipped, repeated or put in from elsewhere, or (JSON, TOML, XML) a value replaced
by one that is odd: of another type, huge, negative, not a number, nested, empty, half a character. A worker process takes mutants one by
one through the same functions as `retrieve` does, with the same last word (`retrieve_cli.errors.guarded`); one that takes more than 20 s is
killed and counts as a hang, one that takes its process down as a crash. Prints one line of JSON: how many ended how, by kind.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

LIMIT_S = 20.0
ODD = (
    None, True, False, 0, -1, 1, 2, 101, 10**9, 10**400, -(10**9), 0.5, -0.0, 1e-300, 1e300, float("nan"), float("inf"), "", "x", "left",
    "camera", "\ud800", "a\x00b", "../../../x", "/dev/full", "<script>", "9" * 999, [], {}, [[]], [None], {"a": 1}, [0] * 1000, [[[[[0]]]]],
)  # fmt: skip
PIECES = (b"\x00", b"\xff\xfe", b"[" * 5000, b"{", b'"', b"<", b">", b"nan", b"-1", b"1e999", b"\n", b"]]", b"//")
WORDS = ("0", "-1", "nan", "inf", "1e300", "1e-300", "9" * 400, "", "x", "0 0 0", "true", "[]", "1e999")
KINDS = ("scene", "observation", "plan", "urdf", "srdf", "mesh", "toml", "model", "labels", "bop")


# Mutants --------------------------------------------------------------------------------------------------------------------------------


def mutate_bytes(data: bytes, rng: random.Random) -> bytes:
    """Some bytes cut out, flipped, repeated, overwritten or put in."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at, length = rng.randrange(len(out) + 1), rng.choice((1, 1, 4, 30, 400))
        match rng.randrange(6):
            case 0:
                del out[at : at + length]
            case 1 if at < len(out):
                out[at] ^= 1 << rng.randrange(8)
            case 2:
                out[at:at] = out[at : at + length]
            case 3:
                out[at : at + length] = rng.randbytes(length)
            case 4:
                del out[at:]
            case _:
                out[at:at] = rng.choice(
                    (b"\x00", b"\xff\xfe", b"[" * 5000, b"{", b'"', b"<", b">", b"nan", b"-1", b"1e999", b"\n", b"]]", b"//")
                )
    return bytes(out)


def mutate_value(value: object, rng: random.Random) -> object:
    """A JSON value with one place in it replaced, dropped, doubled or swapped."""
    paths: list[tuple[object, object]] = []

    def walk(node: object) -> None:
        keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        for key in keys:
            paths.append((node, key))
            walk(node[key])  # type: ignore[index]

    walk(value)
    for _ in range(rng.choice((1, 1, 2, 5))):
        holder, key = rng.choice(paths)
        try:
            match rng.randrange(5):
                case 0:
                    del holder[key]  # type: ignore[attr-defined]
                case 1 if isinstance(holder, list):
                    holder.insert(int(key), holder[int(key)])  # type: ignore[call-overload]
                case 2:
                    other, name = rng.choice(paths)
                    holder[key] = other[name]  # type: ignore[index]
                case _:
                    holder[key] = rng.choice(ODD)  # type: ignore[index]
        except (KeyError, IndexError):
            continue
    return value


def mutate_text(data: bytes, rng: random.Random) -> bytes:
    """A number or a word in quotes of a text (TOML, XML) replaced by an odd one; or its bytes."""
    if rng.random() < 0.4:
        return mutate_bytes(data, rng)
    import re

    text = data.decode()
    spots = list(re.finditer(r'-?\d+(?:\.\d+)?|"[^"]*"', text))
    for _ in range(rng.choice((1, 1, 3))):
        spot = rng.choice(spots)
        new = rng.choice(
            ("0", "-1", "nan", "inf", "1e300", "1e-300", "9" * 400, "", "x", "0 0 0", "true", "[]", "1e999", rng.choice(spots)[0])
        )
        quoted = spot[0].startswith('"') and not new.startswith('"')
        text = text[: spot.start()] + (f'"{new}"' if quoted else new) + text[spot.end() :]
        spots = list(re.finditer(r'-?\d+(?:\.\d+)?|"[^"]*"', text)) or spots[:0]
        if not spots:
            break
    return text.encode()


def mutate_json(data: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.3:
        return mutate_bytes(data, rng)
    try:
        return json.dumps(mutate_value(json.loads(data), rng)).encode() + b"\n"
    except (RecursionError, ValueError):
        return mutate_bytes(data, rng)


# Inputs, and how they are read ----------------------------------------------------------------------------------------------------------


def prepare(folder: Path) -> None:
    """Good inputs of every kind, in one folder."""
    import documents
    import numpy as np
    import trimesh
    from conftest import TOY
    from synthetic_labels import write

    from perception.camera import pinhole
    from perception.frames import Frame, write_frames
    from planning.learning.networks.model import WEIGHTS

    (folder / "scene.jsonl").write_text(documents.lines(documents.scene()))
    (folder / "observation.jsonl").write_text(documents.lines(documents.observed()))
    (folder / "plan.jsonl").write_text(documents.lines(documents.plan()))
    (folder / "arm.urdf").write_text(TOY)
    (folder / "arm.srdf").write_text('<robot name="toy"><disable_collisions link1="base" link2="post" reason="Adjacent"/></robot>')
    (folder / "spec.toml").write_bytes((ROOT / "planning" / "scenes" / "specs" / "paper.toml").read_bytes())
    for ending in ("stl", "obj", "ply"):
        trimesh.creation.box((0.1, 0.1, 0.2)).export(folder / f"box.{ending}")
    shutil.copytree(WEIGHTS / "ur5e", folder / "model")
    write(folder / "labels", 8)
    frame = Frame(np.ones((12, 16), np.float32), np.zeros((12, 16), np.int32), ("box",), pinhole(16, 12, 1.2), np.eye(4))
    write_frames(folder / "bop", [frame])


def read_scene(file: Path) -> None:
    """As `retrieve plan` reads a line, and packs it for the motion core."""
    from planning.io.files import read_scenes

    for _, scene in read_scenes(file):
        if len(scene.objects) < 20:
            from kinematics.errors import blame
            from kinematics.robots.load import from_ref
            from planning.motion.pick_place import Motions

            with blame("scene"):
                Motions(from_ref(scene.robot), scene).start()


def read_plan(file: Path) -> None:
    from planning.episodes import Episode
    from planning.io.files import read_plans
    from planning.metrics import rows
    from retrieve_cli.reporting.forms import WRITERS
    from retrieve_cli.reporting.tables import Report

    episodes = [Episode.of(plan) for _, plan in read_plans(file)]
    for write in WRITERS.values():
        write(Report(rows(episodes), [], [], []))


def read_urdf(file: Path) -> None:
    from kinematics.errors import blame
    from kinematics.robots.load import forget, load

    forget()  # the file of this name is another one each time
    with blame("robots", OSError, RuntimeError):
        load(str(file), "tcp")


def read_mesh(file: Path) -> None:
    from kinematics.errors import blame
    from kinematics.meshes.load import load_mesh

    with blame("mesh"):
        load_mesh(file)


def read_toml(file: Path) -> None:
    from kinematics.errors import blame
    from planning.scenes.generation import load_spec

    with blame("gen"):
        load_spec(str(file))


def read_model(file: Path) -> None:
    from kinematics.errors import blame
    from planning.learning.networks.model import from_pretrained

    with blame("plan: --model"):
        from_pretrained(file.parent)


def read_labels(file: Path) -> None:
    from kinematics.errors import blame
    from planning.learning.training.dataset import read

    with blame("train"):
        read(file.parent)


def read_bop(file: Path) -> None:
    from kinematics.errors import blame
    from perception.frames import read_frames

    with blame("sense"):
        read_frames(file.parents[1] if file.parent.name in ("depth", "mask_visib") else file.parent)


Mutate = Callable[[bytes, random.Random], bytes]
PLAN: dict[str, tuple[str, Mutate, Callable[[Path], None]]] = {
    "scene": ("scene.jsonl", mutate_json, read_scene),
    "observation": ("observation.jsonl", mutate_json, read_scene),
    "plan": ("plan.jsonl", mutate_json, read_plan),
    "urdf": ("arm.urdf", mutate_text, read_urdf),
    "srdf": ("arm.srdf", mutate_text, read_urdf),
    "mesh": ("box.*", mutate_bytes, read_mesh),
    "toml": ("spec.toml", mutate_text, read_toml),
    "model": ("model/*", mutate_bytes, read_model),
    "labels": ("labels/*", mutate_bytes, read_labels),
    "bop": ("bop/**/*.*", mutate_bytes, read_bop),
}


def warm_up(folder: Path, kinds: list[str]) -> None:
    """Read the good inputs, so that what is compiled and loaded once is. Raises: SystemExit when one of them is refused."""
    for kind in kinds:
        pattern, _, read = PLAN[kind]
        file = sorted(f for f in folder.glob(pattern) if f.is_file())[0]
        read(file.with_suffix(".urdf") if kind == "srdf" else file)


def one(folder: Path, kind: str, seed: int) -> int:
    """The exit code with which mutant `seed` of a kind ends."""
    from retrieve_cli.errors import guarded

    rng = random.Random(f"{kind} {seed}")
    pattern, mutate, read = PLAN[kind]
    files = sorted(f for f in folder.glob(pattern) if f.is_file())
    file = rng.choice(files)
    good = file.read_bytes()
    change = mutate_json if file.suffix == ".json" else mutate
    file.write_bytes(change(good, rng))
    try:
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            return guarded(partial(read, file.with_suffix(".urdf") if kind == "srdf" else file))
    finally:
        file.write_bytes(good)


def serve(pipe: Connection, master: Path, kinds: list[str]) -> None:
    """Say when everything is loaded; then take (kind, seed) and send the exit code, in a folder of one's own."""
    import faulthandler
    import logging
    import warnings

    faulthandler.enable()
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as own:
        folder = Path(own) / "inputs"
        shutil.copytree(master, folder)
        warm_up(folder, kinds)
        os.environ["XDG_CACHE_HOME"] = own
        pipe.send(None)
        while True:
            try:
                kind, seed = pipe.recv()
            except EOFError:
                return
            pipe.send(one(folder, kind, seed))


def answered(process: multiprocessing.Process, pipe: Connection) -> bool:
    """Whether an answer comes within the limit of processor time, for a busy machine is no hang; or ten times as long on the clock."""

    def spent() -> float:
        try:
            words = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
            return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
        except (OSError, IndexError):
            return time.monotonic()

    began, at_first = time.monotonic(), spent()
    while not pipe.poll(1.0):
        if spent() - at_first > LIMIT_S or time.monotonic() - began > 10 * LIMIT_S:
            return False
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(KINDS))
    options = parser.parse_args()
    kinds = options.kinds.split(",")
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    failed: list[str] = []
    with tempfile.TemporaryDirectory() as own:
        master = Path(own)
        prepare(master)
        context = multiprocessing.get_context("spawn")  # torch does not outlive a fork

        def begin() -> tuple[multiprocessing.Process, Connection]:
            mine, theirs = context.Pipe()
            process = context.Process(target=serve, args=(theirs, master, kinds), daemon=True)
            process.start()
            theirs.close()
            mine.recv()
            return process, mine  # type: ignore[return-value]

        process, pipe = begin()
        for i in range(options.n):
            kind, seed = kinds[i % len(kinds)], options.seed * 10**9 + i
            pipe.send((kind, seed))
            outcome = "hang"
            if answered(process, pipe):
                try:
                    outcome = str(pipe.recv())
                except (EOFError, OSError):
                    outcome = "crash"
            counts[kind][outcome] += 1
            if outcome not in ("0", "2"):
                failed.append(f"{kind} {seed}: {outcome}")
                print(failed[-1], file=sys.stderr, flush=True)
            if outcome in ("hang", "crash"):
                process.kill()
                process.join()
                process, pipe = begin()
        process.kill()
        process.join()
    total = sum(counts.values(), Counter())
    summary = {"inputs": sum(total.values()), "exit_70": total["70"], "hangs": total["hang"], "crashes": total["crash"]}
    print(json.dumps({**summary, "by_kind": {k: dict(c) for k, c in counts.items()}, "failed": failed[:50]}))


if __name__ == "__main__":
    main()
