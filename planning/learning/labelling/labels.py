"""Labels of one state, for both networks: which object blocks the paths to the target, and where it could really be put.

The paper (section III-D) finds several paths to x_g with RRT-Connect that ignore all non-target objects, and counts for each object how
many it blocks; a region costs the most when the object can't be carried there, or would stand in the way of those paths. `Row` keeps the
counts and the verdicts apart, so that training decides how they are weighed. What it takes to get at the target, and not only whether one
move does, is in `horizon`.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.edge_problem import MARGIN_M
from kinematics.scene import APPROACHES, Body, Scene, State, object_box
from kinematics.shapes import bounds
from kinematics.transforms import Array, inverse
from planning.learning.labelling.brief_look import BriefLook
from planning.learning.labelling.horizon import look_ahead, shortens
from planning.learning.labelling.label_file import NOT_ASKED
from planning.learning.labelling.swept import F32, Floor, arm_balls, footprint, lowest, make_floor, meets
from planning.motion.handling import waiting
from planning.motion.pick_place import Motions

ITERATIONS = 500  # of a search in the emptied cabinet
PATHS = 64
ENOUGH_PATHS = 16
"""So many are enough where searches fail: there one takes ten times as long, and two runs of 64 searches differ as much from each other."""
MOST_IN_VAIN = 2  # searches for one solution of x_g

Bytes = NDArray[np.uint8]
Counts = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Row:
    """One state and its labels: m non-target objects in the scene's order, B regions. Metres, cabinet frame.

    base (3,): l_r. cabinet (3,): inner size. approaches (3,): 1 where horizontal, diagonal, downward grasps may be used. grasp (9,): x_g's
    position and the first two columns of its rotation; width_m between the pads. target (6,), objects (m, 6): centre and size of the
    tightest box along the cabinet's axes. regions (B, 4): x, y, z, flag.
    paths: K', how many paths were found. blocks (m,): how many of them each object blocks. pickable (m,): whether it can be picked now.
    opens (m,): whether the target can be taken out once this object is gone. feasible (m, B): whether the object can be carried there now.
    hits (m, B): how many of the paths it would block there.
    least_moves: the length h of the state's shortest relaxed plans, `UNKNOWN` where none was found. first (m,): whether the object goes
    first in one of them. shorter (m, B): whether h gets shorter once it stands there; asked where it can be carried.
    `NOT_ASKED` where nobody looked.
    views: how many views the boxes and the regions' flags come from, of the objects that were seen; 0 where they are the truth.
    """

    scene: str
    state: int
    robot: str
    base: Array
    cabinet: Array
    approaches: Bytes
    grasp: Array
    width_m: float
    target: Array
    objects: Array
    regions: Array
    paths: int
    blocks: Counts
    pickable: Bytes
    opens: Bytes
    feasible: Bytes
    hits: Bytes
    least_moves: int
    first: Bytes
    shorter: Bytes
    views: int = 0


@dataclass(frozen=True, eq=False)
class PathsToTarget:
    """Distinct paths (·, A) to x_g, approach included, how often each was found (D,), and the gripper's value on them; floor, lows: how
    low the arm comes there (see `swept.lowest`). They ignore the other objects, so all states of a scene have them in common."""

    paths: tuple[Array, ...]
    times: Counts
    gripper: float
    floor: Floor
    lows: F32


def label(look: BriefLook, ways: PathsToTarget, *, objects: int | None = None, number: int = 0) -> Row:
    """Label a state in which the target is still blocked, by the ways to x_g that `paths_to_target` found.

    objects: how many objects at most are asked where they could be carried to, those that go first in a shortest relaxed plan in front,
    then those that block paths; None for all of them.
    number: of the state within its scene.
    """
    motions, state = look.motions, look.state
    scene, names = motions.scene, movable(motions.scene)
    T = inverse(scene.cabinet.T_world_cabinet)
    cells = scene.cabinet.regions(scene.regions_n) @ T[:3, :3].T + T[:3, 3]
    fits = np.array([_fits(scene, state, name, cells) for name in names], np.bool_).reshape(len(names), len(cells))
    blocks, hits = paths_met(motions, state, names, cells, ways)
    horizon = look_ahead(look.view)
    firsts = np.array([name in horizon.firsts for name in names], np.uint8)
    can, asked = _can(look, names, (firsts == 0, blocks == 0), objects)
    feasible = np.where(can[:, None] == 1, NOT_ASKED, np.uint8(0)) * np.ones((1, len(cells)), np.uint8)
    shorter = np.full(feasible.shape, NOT_ASKED, np.uint8)
    for i in asked:
        at = np.flatnonzero(fits[i])
        feasible[i] = 0
        feasible[i, at] = look.placeable(names[i], at)
        for region, helps in shortens(motions, state, look.view, horizon, names[i], np.flatnonzero(feasible[i] == 1)).items():
            shorter[i, region] = helps
    hand = T @ scene.x_g.T_world_hand
    boxes = {name: object_box(Body(name, scene.body(name).shape, T @ pose)) for name, pose in state.poses.items()}
    return Row(
        scene.id, number, motions.robot.name, (T @ scene.robot.T_world_base)[:3, 3], np.asarray(scene.cabinet.size_m),
        np.array([a in scene.approaches for a in APPROACHES], np.uint8), np.concatenate([hand[:3, 3], hand[:3, 0], hand[:3, 1]]),
        scene.x_g.width_m, boxes[scene.target_name], np.array([boxes[n] for n in names]).reshape(-1, 6),
        np.column_stack([cells, np.ones(len(cells))]), int(ways.times.sum()), blocks, can, _opens(look, names, blocks),
        feasible, np.where(fits, hits, NOT_ASKED).astype(np.uint8),
        horizon.moves, firsts if horizon.moves > 0 else np.full(len(names), NOT_ASKED, np.uint8), shorter,
    )  # fmt: skip


def movable(scene: Scene) -> tuple[str, ...]:
    """The non-target objects' names in the scene's order: a row's m objects."""
    return tuple(b.name for b in scene.objects if b.name != scene.target_name)


def paths_to_target(motions: Motions, state: State, rng: np.random.Generator, paths: int, *, enough: int | None = None) -> PathsToTarget:
    """Ways from where the arm waits to x_g through the cabinet without the other objects: what `paths` searches (K) find, shortened.

    The searches are spread evenly over the solutions of x_g that the emptied cabinet allows; one that the first two searches do not reach
    is given up. enough: once so many ways were found, the first search in vain is the last; all searches are made by default.
    No way at all when there is no solution. Raises: ValueError when paths is not within 1 to 254.
    """
    if not 0 < paths < NOT_ASKED:
        raise ValueError(f"paths: {paths} is not within 1 to {NOT_ASKED - 1}")
    scene = motions.scene
    alone = State(waiting.home(motions.cell), {scene.target_name: state.poses[scene.target_name]})
    picks, _ = motions.picks(alone, scene.target_name, [scene.x_g])
    start, found, times = motions.robot.arm_q(alone.q), list[Array](), list[int]()
    floor = make_floor(scene.cabinet.size_m, scene.cabinet.T_world_cabinet, _tallest(motions, state))
    if not picks:
        return PathsToTarget((), np.zeros(0, np.int64), 0.0, floor, np.zeros((*floor.n, 0), np.float32))
    empty = motions.cell.problem(alone.poses, picks[0].gripper_open)
    left, straight, of = deque(range(len(picks))), dict[int, int](), list[int]()
    reached, in_vain = set[int](), Counter[int]()
    for _ in range(paths):
        if not left:
            break
        i = left[0]
        left.rotate(-1)
        if i in straight:  # the straight way is what every search tries first: it would be found again
            times[straight[i]] += 1
            continue
        way = motions.cell.way(empty, start, picks[i].approach[:1], rng, ITERATIONS, shorter=True)
        if way is None:
            in_vain[i] += 1
            if enough is not None and sum(times) >= enough:
                break
            if in_vain[i] == MOST_IN_VAIN and i not in reached:
                left.remove(i)
            continue
        reached.add(i)
        if len(way) == 2:
            straight[i] = len(found)
        found.append(way)
        of.append(i)
        times.append(1)
    balls = arm_balls(motions.robot, scene.robot.T_world_base, picks[0].gripper_open)
    chain, weight, used = motions.cell.arm.chain, empty.problem.weight, sorted(set(of))
    ends = lowest(chain, weight, balls, floor, [picks[i].approach for i in used])
    lows = np.minimum(lowest(chain, weight, balls, floor, found), ends[:, :, [used.index(i) for i in of]])
    paths_found = tuple(np.concatenate([way, picks[i].approach[1:]]) for way, i in zip(found, of))
    return PathsToTarget(paths_found, np.array(times, np.int64), picks[0].gripper_open, floor, lows)


def _tallest(motions: Motions, state: State) -> float:
    """The height of the tallest non-target object."""
    extents = [bounds(motions.scene.body(name).shape, state.poses[name]) for name in movable(motions.scene)]
    return max((float((high - low)[2]) for low, high in extents), default=0.0)


def paths_met(motions: Motions, state: State, names: Sequence[str], cells: Array, ways: PathsToTarget) -> tuple[Counts, Counts]:
    """How many of the ways meet each object: where it stands (m,), and over each cell (m, B)."""
    scene, T = motions.scene, inverse(motions.scene.cabinet.T_world_cabinet)
    blocks, hits = np.zeros(len(names), np.int64), np.zeros((len(names), len(cells)), np.int64)
    for i, name in enumerate(names):
        shape, here = scene.body(name).shape, T @ state.poses[name]
        low, high = bounds(shape, here)
        at = np.concatenate([(low + high)[None, :2] / 2, cells[:, :2]])
        met = meets(ways.lows, ways.floor, footprint(shape, here[:3, :3]), at) @ ways.times
        blocks[i], hits[i] = met[0], met[1:]
    return blocks, hits


def _fits(scene: Scene, state: State, name: str, cells: Array) -> NDArray[np.bool_]:
    """Over which cells (B, 3) an object stands within the cabinet, clear of its walls, whatever else is there (workcell's `placed`)."""
    T = inverse(scene.cabinet.T_world_cabinet) @ state.poses[name]
    low, high = bounds(scene.body(name).shape, T)
    half, (depth, width, height) = (high - low) / 2, scene.cabinet.size_m
    room = np.stack([width / 2 - np.abs(cells[:, 1]) - half[1], depth - cells[:, 0] - half[0], height - 2 * half[2] - 0 * cells[:, 0]])
    return np.asarray((room >= 2 * MARGIN_M).all(0) & (cells[:, 0] >= half[0]))


def _can(look: BriefLook, names: Sequence[str], last: Sequence[Flags], most: int | None) -> tuple[Bytes, list[int]]:
    """Whether each object can be picked (m,), and whose regions are looked at: of those that can, the ones that are not `last` in front.

    last: flags (m,) by which objects are sorted, the most important flags first.
    """
    can = np.array([look.pickable(name) for name in names], np.uint8)
    order = sorted(look.rng.permutation(len(names)), key=lambda i: [flags[i] for flags in last])
    return can, [int(i) for i in order if can[i]][:most]


def _opens(look: BriefLook, names: Sequence[str], blocks: Counts) -> Bytes:
    """Whether the target can be taken out without each object (m,); one that blocks no path is not asked about."""
    return np.array([look.target_free(gone=(name,)) if met else NOT_ASKED for name, met in zip(names, blocks)], np.uint8)
