"""Scenes from other things than words: a folder of meshes at random, or what was observed of another scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from kinematics.collision.fcl_solids import apart
from kinematics.names import free_name
from kinematics.scene import Body, Scene
from kinematics.shapes import Box, bounds
from kinematics.transforms import Array, transform
from planning.io.scene_documents import LoadMesh
from planning.io.settling import settle
from planning.scenes.words import MESHES, Say, Words, scene_from_words

STAGE = 9
"""This stage's word in the seeds of random generators."""
GAP_M, FROM_FRONT_M = 0.01, 0.04
TRIES = 200
"""So often a place is drawn for a mesh."""
ARRANGEMENTS = 5
"""So often all are drawn anew where one of them finds no room."""


class NoRoom(ValueError):
    """Meshes that don't fit into a cabinet, as far as places were drawn for them."""


def mesh_files(folder: Path) -> list[Path]:
    """The meshes in a folder, by name. Raises: ValueError when there is none."""
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in MESHES)
    if not files:
        raise ValueError(f"there is no mesh in it ({', '.join(MESHES)})")
    return files


def random_scene(
    words: Words, files: Sequence[Path], count: int, scale: float, load: LoadMesh, seed: int, index: int, say: Say = lambda _: None
) -> Scene:
    """A scene of `count` meshes at random on the cabinet's floor, turned at random, 1 cm apart at least; the target is a deep one.

    words: cabinet, robot and obstacles. Scene number `index` of a seed is the same whatever came before it.
    Raises: NoRoom when they don't fit, however often they are drawn.
    """
    rng = np.random.default_rng([seed, STAGE, index])
    empty = scene_from_words(replace(words, objects=(), target=None, id=f"{seed}-{index:06d}"), load, say)
    T, bodies = empty.cabinet.T_world_cabinet, list[Body]()
    for arrangement in range(1, ARRANGEMENTS + 1):
        chosen = [files[k] for k in rng.choice(len(files), count, replace=count > len(files))]
        bodies, left = _arranged(words, empty, chosen, scale, load, rng)
        if left is None:
            break
        if arrangement == ARRANGEMENTS:
            fit = f"{len(bodies)} of {count} meshes fit into the cabinet, and {left.name} found no room"
            raise NoRoom(f"{fit} in the last of {ARRANGEMENTS} arrangements: ask for fewer")
    deep = sorted(bodies, key=lambda b: float((b.T_world_body[:3, 3] - T[:3, 3]) @ T[:3, 0]))
    target = deep[-1 - int(rng.integers(min(3, len(deep))))]
    return replace(empty, objects=tuple(bodies), target=target.name, seed=(seed, index))


def _arranged(
    words: Words, empty: Scene, files: Sequence[Path], scale: float, load: LoadMesh, rng: np.random.Generator
) -> tuple[list[Body], Path | None]:
    """Meshes one after the other at random places of an empty cabinet, and the first that finds no room."""
    size, T, bodies = empty.cabinet.size_m, empty.cabinet.T_world_cabinet, list[Body]()
    for file in files:
        taken = [b.name for b in bodies]
        for _ in range(TRIES):
            x, y, yaw = rng.uniform(FROM_FRONT_M, size[0]), rng.uniform(-size[1] / 2, size[1] / 2), rng.uniform(-180, 180)
            p = T[:3, :3] @ np.array([x, y, 0.0]) + T[:3, 3]
            turned = f"{file}@{p[0]},{p[1]},scale={scale},yaw={yaw}"
            body = scene_from_words(replace(words, objects=(turned,), target=None), load).objects[0]
            body = replace(body, name=free_name(body.name, taken, 2))
            if apart(body, [*bodies, *empty.fixtures()[1:]], GAP_M) and _inside(empty, body):
                bodies.append(body)
                break
        else:
            return bodies, file
    return bodies, None


def _inside(scene: Scene, body: Body) -> bool:
    """Whether a body's box is wholly over the cabinet's floor."""
    low, high = bounds(body.shape, np.linalg.inv(scene.cabinet.T_world_cabinet) @ body.T_world_body)
    size = scene.cabinet.size_m
    return bool(low[0] >= 0 and high[0] <= size[0] and low[1] >= -size[1] / 2 and high[1] <= size[1] / 2 and high[2] <= size[2])


def from_observation(scene: Scene) -> Scene:
    """What was seen of a scene as a scene of its own: every observed box a body of source "seen"; nothing of the truth is left.

    Raises: ValueError for a scene that was not sensed.
    """
    if scene.observation is None:
        raise ValueError(f"scene {scene.id} was not sensed: it has no observation; retrieve sense makes one")
    entries = scene.observation["objects"]
    assert isinstance(entries, list)
    bodies = tuple(_seen(str(entry["name"]), np.asarray(entry["box"], float)) for entry in entries)
    return settle(replace(scene, objects=bodies, observation=None, settled=()))


def _seen(name: str, box: Array) -> Body:
    """A box (6,), centre and size along the world's axes, as a body."""
    return Body(name, Box(box[3:]), transform(p=box[:3]), source="seen")
