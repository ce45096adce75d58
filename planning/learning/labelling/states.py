"""Which states are labelled: generated scenes, robot and cabinet a little different each time, and what feasible moves make of them.

Everything about scene `index` of a seed comes from that seed, this stage's word and the index, whoever makes it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import RobotRef, Scene, State
from kinematics.transforms import transform
from planning.learning.labelling.brief_look import BriefLook
from planning.learning.labelling.labels import ENOUGH_PATHS, PATHS, Row, label, movable, paths_to_target
from planning.learning.labelling.partial_views import partial_view
from planning.learning.labelling.variety import Variety
from planning.motion.pick_place import Motions
from planning.motion.settings import DEFAULTS
from planning.scenes.generation import Spec, generate
from planning.upright import upright

STAGE = 3  # this stage's word in the seeds of random generators
MOVES = 3
_TRIES = 5  # moves tried before a state is left as it is
_TOWARDS_THE_TARGET = 0.5  # how often a blocking object is moved, where one can be; else any


def varied_scene(spec: Spec, robot: Robot, ref: RobotRef, seed: int, index: int, variety: Variety) -> Scene:
    """Scene `index` of a seed for labels: blocked and solvable as `gen` makes them, but none of those. Raises: NoScene."""
    rng = np.random.default_rng([seed, STAGE, index, 0])
    share = 1 + variety.cabinet_share * rng.uniform(-1, 1, 3)
    n = int(rng.integers(variety.regions_n[0], variety.regions_n[1] + 1)) if variety.regions_n else spec.regions_n
    T_world_base = transform(p=variety.base_m * rng.uniform(-1, 1, 3)) @ ref.T_world_base
    spec = replace(spec, cabinet_size_m=spec.cabinet_size_m * share, regions_n=n)
    scene = generate(spec, robot, replace(ref, T_world_base=T_world_base), seed, index, stage=STAGE, judge=_briefly_judged)
    return replace(scene, id=f"label-{scene.id}", seed=(seed, STAGE, index))


def _briefly_judged(scene: Scene, robot: Robot, rng: np.random.Generator) -> str | None:
    """What is wrong with a scene, "free" or "unsolvable", after a brief look; None when it is blocked, and solvable once emptied."""
    motions = Motions(robot, replace(scene, robot=replace(scene.robot, mount=False)))
    look = BriefLook(motions, motions.start(), rng)
    if look.target_free():
        return "free"
    return None if look.target_free(gone=movable(scene)) else "unsolvable"


def rows(
    robot: Robot,
    scene: Scene,
    seed: int,
    index: int,
    *,
    paths: int = PATHS,
    moves: int = MOVES,
    objects: int | None = None,
    partly_seen: float = 0.0,
) -> Iterator[Row]:
    """Label a scene as it is, and after up to `moves` moves, as long as its target is still blocked.

    partly_seen: of this share of the states there is a second row, as a few views show it, where they show the target. A cabinet that leans
    is labelled upright, as it is planned in (`planning.upright`); a row's figures are in its frame all the same.
    Raises: ValueError when the robot can't stand or wait before this cabinet.
    """
    planned_in = upright(scene, DEFAULTS)
    motions = Motions(robot, planned_in.scene, settings=planned_in.settings)
    state, ways = motions.start(), None
    rng, looks = (np.random.default_rng([seed, STAGE, index, word]) for word in (1, 2))
    for number in range(moves + 1):
        look = BriefLook(motions, state, rng)
        if look.target_free():
            return
        ways = ways or paths_to_target(motions, state, rng, paths, enough=ENOUGH_PATHS)
        row = label(look, ways, objects=objects, number=number)
        yield row
        if looks.random() < partly_seen and (part := partial_view(motions, state, row, looks)) is not None:
            yield part
        after = next_state(look, row) if number < moves else None
        if after is None:
            return
        state = after


def next_state(look: BriefLook, row: Row) -> State | None:
    """What comes of a feasible move of a state, half of the time one of an object that blocks paths; None when a few tries find none."""
    names, rng = movable(look.motions.scene), look.rng
    for _ in range(_TRIES):
        able = np.flatnonzero(row.pickable)
        blocking = [i for i in able if row.blocks[i]]
        if not len(able):
            return None
        i = int(rng.choice(blocking if blocking and rng.random() < _TOWARDS_THE_TARGET else able))
        known = np.flatnonzero(row.feasible[i] == 1)
        region = int(rng.choice(known)) if len(known) else int(rng.integers(len(row.regions)))
        if (after := look.after(names[i], region)) is not None:
            return after
    return None
