"""`retrieve label`: what the networks learn from, a folder of Parquet shards, one row a state."""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.errors import InputError, blame
from planning.io.files import read_scenes
from planning.io.outputs import alone_in
from planning.io.scene_documents import scene_to_json
from retrieve_cli.engine import map_ordered
from retrieve_cli.errors import Ended
from retrieve_cli.gen import fitted, spec_hash
from retrieve_cli.robot_options import RobotOptions
from retrieve_cli.terminal import announce_first_run, mesh_progress, say, say_what_was_read

if TYPE_CHECKING:
    from kinematics.scene import RobotRef, Scene
    from planning.learning.labelling.label_file import Manifest
    from planning.learning.labelling.labels import Row
    from planning.learning.labelling.variety import Variety
    from planning.scenes.generation import Spec

SHARD = 25  # scenes
SCENES = 100  # generated when nothing says how many
TELL_S = 20.0  # between words about the pace


@dataclass(frozen=True)
class Item:
    """One scene to label: given, or the number of one to be made."""

    index: int
    where: str
    scene: Scene | None = None


@dataclass(frozen=True)
class Job:
    """What a worker needs besides the item."""

    seed: int
    paths: int
    moves: int
    objects: int | None
    partly_seen: float = 0.0
    specs: tuple[tuple[Spec, RobotRef], ...] = ()  # of scenes that are to be made, each with where the robot stands
    variety: Variety | None = None


def run(
    *,
    scenes: Path | None,
    out: Path,
    n: int | None,
    spec: Sequence[str],
    robot: RobotOptions,
    seed: int,
    paths: int,
    moves: int,
    objects: int | None,
    partly_seen: float,
    vary: bool,
    workers: int | None,
    engine: str,
    address: str | None,
    fit: bool = False,
) -> None:
    """Label scenes of a file, or generated ones, shard by shard; go on where an earlier call of the same kind stopped."""
    from planning.learning.labelling import shards
    from planning.motion.settings import DEFAULTS

    if scenes is not None and n is not None:
        raise InputError(f"label: {scenes} and -n exclude each other: label the scenes of a file, or generated ones")
    ours = {"--robot": robot.robot, "--hand-frame": robot.hand_frame, "--gripper-joint": robot.gripper_joint, "--fit": fit}
    if scenes is not None and (asked := next((option for option, value in ours.items() if value), None)):
        raise InputError(f"label: {asked} is for scenes that are generated, with -n: those of {scenes} say it themselves")
    announce_first_run()
    job = Job(seed, paths, moves, objects, partly_seen)
    if n is None and (scenes is not None or not sys.stdin.isatty()):
        given, about = _given(scenes)
        total = len(given)
    else:
        given, total = None, n or SCENES
        about, specs, variety = _made(spec, robot, vary, fit)
        job = replace(job, specs=specs, variety=variety)
    settings = {"seed": seed, "paths": paths, "moves": moves, "objects": objects, **about, "scenes": total, "scenes_a_shard": SHARD}
    settings["motions"] = {"clearance_m": DEFAULTS.clearance.wanted_m, "max_tilt_deg": DEFAULTS.max_tilt_deg}
    if partly_seen:
        settings["partly_seen"] = partly_seen
    with alone_in(out):
        manifest = _begin(out, settings)
        kept = shards.whole(out, manifest.shards)
        if kept:
            say(f"{out}: {kept} shards are there; going on")
        manifest = replace(manifest, shards=manifest.shards[:kept], complete=False)
        numbers = range(min(total, kept * SHARD), total)
        items = (given[i] if given is not None else Item(i, f"label: scene {i}") for i in numbers)
        _write(out, manifest, map_ordered(partial(label_item, job), items, workers=workers, engine=engine, address=address), numbers)


def _write(out: Path, manifest: Manifest, labelled: Iterable[list[Row]], numbers: range) -> None:
    """Write the rows of scenes of such numbers behind the shards that are there, shard by shard, and tell the pace."""
    from planning.learning.labelling import shards

    shards.write_manifest(out, manifest)
    pace = Pace(len(numbers))
    rows: list[Row] = []
    try:
        for found, number in zip(labelled, numbers):
            rows += found
            pace.step(len(found))
            if (number + 1) % SHARD == 0 or number + 1 == numbers.stop:
                shard = shards.write_shard(out, len(manifest.shards), rows)
                manifest, rows = replace(manifest, shards=(*manifest.shards, shard)), []
                shards.write_manifest(out, manifest)
                say(f"{shard.file}: {shard.rows} states; {pace}")
    except (KeyboardInterrupt, Ended):
        say(f"{out}: broken off with {len(manifest.shards)} whole shards; the same call goes on behind them")
        raise
    shards.write_manifest(out, replace(manifest, complete=True))
    say(f"{out}: {manifest.rows} states of {numbers.stop} scenes")


def label_item(job: Job, item: Item) -> list[Row]:
    """The rows of one scene. Raises: InputError when it can't be made, or the robot can't stand before it."""
    from kinematics.robots.load import from_ref
    from planning.learning.labelling.states import rows, varied_scene
    from planning.scenes.generation import NoScene

    with blame(item.where, NoScene):
        scene, index = item.scene, item.index
        if scene is not None:
            index = scene.random_word  # its place in the file is nobody's business
        else:
            assert job.variety is not None
            spec, ref = job.specs[index % len(job.specs)]
            scene = varied_scene(spec, from_ref(ref), ref, job.seed, index, job.variety)
        found = rows(
            from_ref(scene.robot), scene, job.seed, index,
            paths=job.paths, moves=job.moves, objects=job.objects, partly_seen=job.partly_seen,
        )  # fmt: skip
        return list(found)


def _given(scenes: Path | None) -> tuple[list[Item], dict[str, Any]]:
    """The scenes of a file or of stdin, and what the manifest says of them."""
    items, digest, robots = list[Item](), hashlib.sha256(), set[str]()
    for index, (where, scene) in enumerate(read_scenes(scenes, "label", on_mesh=mesh_progress)):
        say_what_was_read(where, scene)
        items.append(Item(index, where, scene))
        digest.update(json.dumps(scene_to_json(scene), sort_keys=True).encode())
        robots.add(scene.robot.name or str(scene.robot.urdf))
    return items, {"robot": " ".join(sorted(robots)), "source": {"scenes_sha256": digest.hexdigest()}}


def _made(
    spec: Sequence[str], robot: RobotOptions, vary: bool, fit: bool
) -> tuple[dict[str, Any], tuple[tuple[Spec, RobotRef], ...], Variety]:
    """What the manifest says of scenes that are to be made, and what is needed to make them: spec after spec in turn, fitted to the arm if
    asked."""
    from kinematics.robots.load import to_ref
    from planning.learning.labelling.variety import Variety
    from planning.scenes.generation import load_spec

    with blame("label"):
        plain = [load_spec(which) for which in spec]
        arm = robot.load(say)
    ref = to_ref(arm, robot.hand_frame)
    specs = tuple(fitted(s, arm, ref, "label") if fit else (s, ref) for s in plain)
    variety = Variety() if vary else Variety(0.0, 0.0, None)
    source = {
        "specs": [{"name": Path(which).name, "sha256": spec_hash(s)} for which, (s, _) in zip(spec, specs)],
        "variety": vars(variety),
    }
    return {"robot": arm.name, "source": source}, specs, variety


def _begin(out: Path, settings: Mapping[str, Any]) -> Manifest:
    """The manifest to go on with: what an earlier call left, maybe of fewer scenes, or a fresh one.

    Raises: InputError when the folder holds something else.
    """
    from importlib.metadata import version as installed

    from planning.learning.labelling import label_file
    from retrieve_cli.version import version

    versions = {"retrieve": version(), **{name: installed(name) for name in ("numpy", "numba", "pyarrow")}}
    if not (out / label_file.MANIFEST).exists():
        if any(out.iterdir()):
            raise InputError(f"{out}: is not empty, and holds no labels; name a new folder")
        return label_file.Manifest(settings, versions)
    with blame("label"):
        old = label_file.read_manifest(out)
    wanted = json.loads(json.dumps(settings))
    other = [name for name in {**old.settings, **wanted} if old.settings.get(name) != wanted.get(name)]
    if other == ["scenes"] and wanted["scenes"] > old.settings["scenes"]:  # a last shard with fewer scenes than the others gets more
        return replace(old, settings=settings, shards=old.shards[: old.settings["scenes"] // SHARD])
    if other:
        name = other[0]
        raise InputError(
            f"{out}: holds labels made otherwise: {name} was {old.settings.get(name)!r}, and is {wanted.get(name)!r} now; "
            "name a new folder, or remove this one"
        )
    return replace(old, settings=settings)


class Pace:
    """How fast it goes: words on stderr now and then."""

    def __init__(self, scenes: int) -> None:
        self.left, self.scenes, self.states = scenes, 0, 0
        self.began = self.told = time.monotonic()

    def step(self, states: int) -> None:
        """One scene more, with so many states."""
        self.left, self.scenes, self.states = self.left - 1, self.scenes + 1, self.states + states
        if time.monotonic() - self.told > TELL_S and self.left:
            say(f"states: {self}")

    def __str__(self) -> str:
        self.told = time.monotonic()
        spent = max(self.told - self.began, 1e-9)
        left = self.left * spent / max(self.scenes, 1)
        ahead = f"; {self.left} scenes and about {span(left)} left" if self.left else ""
        return f"{self.states} in all, {60 * self.states / spent:.0f} a minute{ahead}"


def span(seconds: float) -> str:
    """A time in words, as exact as one may want to know beforehand."""
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
