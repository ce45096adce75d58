"""Makes `ahead.json`, the list of entries that are compiled ahead, and what ships of them (`kinematics.jit.shipped`): `python -m
planning.compiling.make_list`, or `make ahead`.

A process of its own, with an empty cache, generates and plans a few scenes, the last one with a mesh, too; the list is what it called, in
its order. Then it draws, labels and looks around, whose functions ship, too, and are made machine code of when they are called.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from time import process_time
from typing import Any

from kinematics.jit.decorators import Entry
from kinematics.jit.shipped import FILE
from kinematics.scene import Scene
from perception.rendering.tiny_still import tiny_still
from planning.compiling.ahead import LIST, Ahead, describe, entry_of, example, loop_s

SCENES, LABELLED, SEED = 6, 3, 5


def recorded() -> tuple[list[Ahead], list[Ahead]]:
    """The entries that generating and planning a few scenes calls, and those that drawing, labels and looking around call."""
    rows: list[Ahead] = []
    usual = Entry.bring

    def bring(self: Entry, args: tuple[Any, ...], kinds: str) -> Any:
        began = process_time()
        code = usual(self, args, kinds)
        if code is not None:
            words = [describe(a) for a in args]
            rows.append(Ahead(f"{self.__module__}.{self.__qualname__}", kinds, words, round((process_time() - began) / loop_s(), 1)))
        return code

    Entry.bring = bring  # type: ignore[method-assign]
    try:
        _plan_some()
        planned = len(rows)
        tiny_still()
        _label_some()
        _sense_some()
    finally:
        Entry.bring = usual  # type: ignore[method-assign]
    return rows[:planned], rows[planned:]


def _plan_some() -> None:
    from kinematics.robots.load import load
    from planning.library import plan_scene

    robot = load("ur5e")
    for index in range(SCENES):
        plan_scene(_scene(index), robot=robot)
    plan_scene(_with_a_mesh(), robot=robot, policy="local", grasp="any")


def _scene(index: int) -> Scene:
    from kinematics.robots.load import load, to_ref
    from planning.scenes.generation import generate, load_spec

    robot = load("ur5e")
    return generate(load_spec("paper"), robot, to_ref(robot), SEED, index)


def _with_a_mesh() -> Scene:
    """The last scene, its target as a mesh."""
    from kinematics.shapes import ConvexMesh, box_corners

    scene = _scene(SCENES - 1)
    target = scene.target_body
    mesh = ConvexMesh((box_corners(target.shape.half), box_corners(0.5 * target.shape.half)))
    return replace(scene, objects=tuple(replace(body, shape=mesh) if body is target else body for body in scene.objects))


def _label_some() -> None:
    from kinematics.robots.load import load, to_ref
    from planning.learning.labelling.states import rows, varied_scene
    from planning.learning.labelling.variety import Variety
    from planning.scenes.generation import load_spec

    robot = load("ur5e")
    for index in range(LABELLED):
        scene = varied_scene(load_spec("paper"), robot, to_ref(robot), SEED, index, Variety())
        list(rows(robot, scene, SEED, index, paths=8, objects=2, partly_seen=1.0))


def _sense_some() -> None:
    """Plan a scene of which nothing is known but noisy pictures without masks."""
    import numpy as np

    from kinematics.robots.load import load
    from perception.camera import DepthNoise
    from planning.policies import make_policy
    from planning.sensing.retrieve import retrieve_unseen
    from planning.sensing.settings import SensingSettings
    from planning.sensing.world import SimulatedWorld

    robot, scene, rng, noise = load("ur5e"), _scene(0), np.random.default_rng(SEED), DepthNoise()
    world = SimulatedWorld(robot, scene, rng, noise, "geometry")
    sensing = SensingSettings(by="geometry", noise_1m_m=noise.axial_1m_m)
    retrieve_unseen(
        world, robot, scene, lambda m, moves: make_policy("local", m, max_moves=moves), truth=world, name="local", sensing=sensing, rng=rng
    )


def main() -> None:
    """Write the list, and what ships."""
    from kinematics.collision.robot_model import shape_covers
    from kinematics.jit.ship import CPU, ship

    if "--record" not in sys.argv:
        shape_covers(_with_a_mesh().target_body.shape)  # kept on disk: only who brings a mesh of their own waits for what makes them
        with tempfile.TemporaryDirectory() as folder:
            again = [sys.executable, "-m", "planning.compiling.make_list", "--record"]
            subprocess.run(again, env=os.environ | CPU | {"NUMBA_CACHE_DIR": folder}, check=True)
        return
    rows, others = recorded()
    LIST.write_text("[\n" + ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows) + "\n]\n", encoding="utf-8")
    print(f"{LIST}: {len(rows)} entries, {sum(row.loops for row in rows) * loop_s():.0f} s", file=sys.stderr)
    ship([(entry_of(row), [example(words) for words in row.arguments], row.symbol) for row in rows + others])
    print(f"{FILE}: {FILE.stat().st_size / 1e6:.1f} MB", file=sys.stderr)


if __name__ == "__main__":
    main()
