"""Labels: what a row says is true, the same whoever writes it, and a run that was killed goes on to the same bytes."""

from __future__ import annotations

import hashlib
import json
import pickle
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from label_rows import read_rows

from kinematics.chain import forward
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Body, RobotRef, Scene, State, object_box
from kinematics.shapes import Box
from kinematics.transforms import Array, inverse, rotation_about, transform
from perception.mapping.voxels import unknown_voxels
from planning.io.outputs import alone_in
from planning.io.results import scene_writer
from planning.learning.labelling import partial_views, shards
from planning.learning.labelling.brief_look import BriefLook
from planning.learning.labelling.label_file import UNKNOWN, Manifest, read_manifest
from planning.learning.labelling.labels import NOT_ASKED, Row, label, movable, paths_to_target
from planning.learning.labelling.states import MOVES, next_state, rows, varied_scene
from planning.learning.labelling.swept import CELL_M, SAMPLE_M, arm_balls, footprint, meets
from planning.learning.labelling.variety import Variety
from planning.motion.cell.workcell import Workcell
from planning.motion.handling import waiting
from planning.motion.handling.carry import Done
from planning.motion.pick_place import Motions
from planning.plan import Blocked
from planning.relaxed_plan import relaxed_plan
from planning.scenes.generation import Spec, generate, load_spec
from planning.upright import turned_scene
from retrieve_cli import label as command
from retrieve_cli.__main__ import main

SEED = 31


@pytest.fixture(scope="module")
def scene(ur5e: Robot) -> Scene:
    """A scene for labels, made from the spec with four to six objects, so that all can be asked."""
    spec = replace(load_spec("paper-any"), objects_count=(4, 6))
    made = varied_scene(spec, ur5e, to_ref(ur5e), SEED, 3, Variety())
    return replace(made, regions_n=5)


@pytest.fixture(scope="module")
def motions(ur5e: Robot, scene: Scene) -> Motions:
    return Motions(ur5e, scene)


@pytest.fixture(scope="module")
def row(motions: Motions) -> Row:
    return labelled(motions, 12)


def labelled(motions: Motions, paths: int, objects: int | None = None) -> Row:
    """The row of a scene's first state."""
    look = BriefLook(motions, motions.start(), np.random.default_rng(0))
    return label(look, paths_to_target(motions, look.state, look.rng, paths), objects=objects)


# What a row says ------------------------------------------------------------------------------------------------------------------------


def test_a_row_keeps_to_its_description(row: Row, scene: Scene) -> None:
    m, B = len(scene.objects) - 1, scene.regions_n**2
    assert 6 <= row.paths <= 12
    assert row.objects.shape == (m, 6)
    assert row.regions.shape == (B, 4)
    assert row.feasible.shape == row.hits.shape == (m, B)
    assert row.shorter.shape == (m, B)
    assert row.blocks.shape == row.pickable.shape == row.opens.shape == row.first.shape == (m,)
    assert np.isin(row.first, (0, 1)).all()
    assert row.first.any()
    assert row.least_moves >= 1
    assert ((row.shorter == NOT_ASKED) == (row.feasible != 1)).all()
    assert ((row.blocks >= 0) & (row.blocks <= row.paths)).all()
    assert row.blocks.any(), "a blocked target, and nothing blocks it"
    assert ((row.hits <= row.paths) | (row.hits == NOT_ASKED)).all()
    assert np.isin(row.feasible, (0, 1)).all(), "all objects are asked"
    assert not row.feasible[row.pickable == 0].any()
    assert ((row.opens == NOT_ASKED) == (row.blocks == 0)).all()
    assert row.feasible[:, 0].sum() < m * B


def test_a_row_speaks_in_the_cabinets_frame(row: Row, scene: Scene, motions: Motions) -> None:
    T = scene.cabinet.T_world_cabinet
    assert np.allclose((T @ np.append(row.base, 1))[:3], scene.robot.T_world_base[:3, 3])
    assert np.allclose((T @ np.append(row.grasp[:3], 1))[:3], scene.grasp.T_world_hand[:3, 3])
    assert np.allclose(T[:3, :3] @ row.grasp[3:6], scene.grasp.T_world_hand[:3, 0])
    assert np.allclose(T[:3, :3] @ row.grasp[6:], scene.grasp.T_world_hand[:3, 1])
    boxes = np.array([object_box(scene.body(n)) for n in movable(scene)])
    assert np.allclose(row.objects[:, :3] + T[:3, 3], boxes[:, :3]), "the cabinet isn't turned here"
    assert np.allclose(row.objects[:, 3:], boxes[:, 3:])
    assert np.allclose(row.objects[:, 2], row.objects[:, 5] / 2), "all stand on the floor"
    assert (np.abs(row.regions[:, 1]) < row.cabinet[1] / 2).all()


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (0.6, -0.8, 0.0)])
def test_a_scene_that_leans_as_a_whole_is_labelled_as_it_is_upright(ur5e: Robot, scene: Scene, axis: tuple[float, float, float]) -> None:
    R, p = rotation_about(axis, np.radians(12.0)), scene.cabinet.T_world_cabinet[:3, 3]
    leaning = turned_scene(scene, transform(p=p) @ transform(R, -R @ p))
    (straight,), (leant,) = (list(rows(ur5e, one, SEED, 3, paths=4, moves=0, objects=1)) for one in (scene, leaning))
    assert (straight.feasible == 1).any()
    for f in fields(Row):
        before, after = getattr(straight, f.name), getattr(leant, f.name)
        assert np.allclose(before, after, atol=1e-9) if isinstance(before, np.ndarray) else before == after, f.name


def test_a_feasible_cell_is_free(row: Row, scene: Scene, motions: Motions) -> None:
    state = motions.start()
    for i, name in enumerate(movable(scene)):
        rest = {n: T for n, T in state.poses.items() if n != name}
        for region in np.flatnonzero(row.feasible[i]):
            assert motions.cell.placed(scene.body(name), motions.place_pose(name, state.poses[name], int(region)), rest) is None


def test_where_an_object_would_stick_out_nobody_asks_what_it_hits(scene: Scene, ur5e: Robot) -> None:
    """In cells of 2 or 3 cm it does in those along the walls and the front edge, and in no others."""
    motions = Motions(ur5e, replace(scene, regions_n=20))
    row, poses = labelled(motions, 2, objects=0), motions.start().poses
    for i, name in enumerate(movable(scene)):
        alone = [motions.cell.placed(scene.body(name), motions.place_pose(name, poses[name], region), {}) for region in range(400)]
        assert np.array_equal(row.hits[i] == NOT_ASKED, [touch is not None for touch in alone])
        assert 0 < np.count_nonzero(row.hits[i] == NOT_ASKED) < 200


def test_a_brief_look_finds_what_a_long_one_finds(row: Row, scene: Scene, ur5e: Robot) -> None:
    """What it calls pickable has picks, and what has none it does not; without all others the target is free, as it is not now."""
    motions = Motions(ur5e, scene)
    look = BriefLook(motions, motions.start(), np.random.default_rng(1))
    for i, name in enumerate(movable(scene)):
        assert look.pickable(name) == bool(row.pickable[i])
        assert look.pickable(name) <= bool(motions.picks(look.state, name)[0])
    assert look.target_free(gone=movable(scene))
    assert not look.target_free()
    for i in np.flatnonzero(row.opens != NOT_ASKED):
        gone = State(look.state.q, {n: T for n, T in look.state.poses.items() if n != movable(scene)[i]})
        assert look.target_free(gone=movable(scene)[i : i + 1]) == isinstance(motions.retrieve_target(gone, look.rng), Done)


def test_where_a_brief_look_puts_an_object_it_can_be_carried(scene: Scene, ur5e: Robot) -> None:
    """Less patience may miss a region, but what it promises can be done."""
    motions = Motions(ur5e, scene)
    look = BriefLook(motions, motions.start(), np.random.default_rng(3))
    promised, kept, missed = 0, 0, 0
    for name in movable(scene):
        regions = range(0, scene.regions_n**2, 2)
        for region, can in zip(regions, look.placeable(name, regions)):
            done = isinstance(motions.relocate(look.state, name, region, np.random.default_rng(region)), Done)
            promised, kept, missed = promised + bool(can), kept + bool(can and done), missed + bool(done and not can)
    assert promised > 3
    assert kept >= 0.97 * promised
    assert missed <= 0.5 * promised


def test_a_place_over_the_front_edge_is_refused_in_these_words(row: Row, scene: Scene, ur5e: Robot) -> None:
    motions = Motions(ur5e, replace(scene, regions_n=20))
    state, name = motions.start(), movable(scene)[int(np.argmax(row.pickable))]
    at = inverse(scene.cabinet.T_world_cabinet) @ np.column_stack([motions.scene.regions(), np.ones(400)]).T
    refused = motions.relocate(state, name, int(np.argmin(at[0] + np.abs(at[1]))), np.random.default_rng(0))
    assert isinstance(refused, Blocked)
    assert (refused.stage, refused.link, refused.body) == ("region", name, "floor")
    assert refused.detail == "it would hang over the front edge"


def test_what_blocks_every_path_keeps_the_target_in(row: Row, scene: Scene, motions: Motions) -> None:
    """The target can only be free without an object when no other one is in all paths, too."""
    everywhere = row.blocks == row.paths
    for i in np.flatnonzero(row.opens == 1):
        assert not np.delete(everywhere, i).any()


def test_the_target_comes_out_when_the_blocking_ones_are_gone(row: Row, scene: Scene, motions: Motions) -> None:
    state = motions.start()
    gone = {n for n, b in zip(movable(scene), row.blocks) if b}
    left = State(state.q, {n: T for n, T in state.poses.items() if n not in gone})
    assert isinstance(motions.retrieve_target(left, np.random.default_rng(1)), Done)


def test_the_horizon_is_that_of_the_states_that_moves_lead_to(row: Row, scene: Scene, motions: Motions) -> None:
    """Where h is said to get shorter, the shortest relaxed plan from there is one move shorter; elsewhere none is; and only what goes first
    in a shortest plan, which can be picked, makes it so."""
    state, target, names = motions.start(), scene.target_name, movable(scene)
    standing = frozenset(names)
    obstructions = motions.obstructions(state.poses)
    shortest = relaxed_plan(obstructions, target, standing)
    assert shortest is not None
    assert shortest.length == row.least_moves
    assert row.first[names.index(shortest.order[0])]
    for i, name in enumerate(names):
        assert not row.first[i] or obstructions.free(name, standing - {name})
        asked = np.flatnonzero(row.shorter[i] != NOT_ASKED)
        for region in asked[:: 1 + len(asked) // 8]:
            there = {**state.poses, name: motions.place_pose(name, state.poses[name], int(region))}
            left = relaxed_plan(motions.obstructions(there), target, standing)
            assert left is None or left.length >= row.least_moves - 1
            assert row.shorter[i, region] == (left is not None and left.length < row.least_moves)
            assert row.first[i] or not row.shorter[i, region]


def test_a_state_from_which_no_picks_help_has_no_horizon(motions: Motions, scene: Scene) -> None:
    T = scene.x_g.T_world_hand @ transform(rotation_about((1.0, 0.0, 0.0), np.pi))
    found = labelled(Motions(motions.robot, replace(scene, grasp=replace(scene.x_g, T_world_hand=T))), 1, objects=1)
    assert found.least_moves == UNKNOWN
    assert (found.first == NOT_ASKED).all()
    assert (found.shorter == NOT_ASKED).all()


# The swept space ------------------------------------------------------------------------------------------------------------------------


def test_hits_agree_with_the_exact_test_up_to_a_cell(ur5e: Robot, scene: Scene, motions: Motions) -> None:
    """Boxes all over the floor: one that a path touches exactly is met; one that is not met even when 2 cm larger, is not touched."""
    ways = paths_to_target(motions, motions.start(), np.random.default_rng(5), 4)
    size = scene.cabinet.size_m
    T = scene.cabinet.T_world_cabinet
    rng, verdicts = np.random.default_rng(6), []
    for _ in range(40):
        sides = rng.uniform([0.04, 0.04, 0.08], [0.08, 0.08, 0.25])
        xy, yaw = rng.uniform([0.05, -size[1] / 2 + 0.05], [size[0] - 0.05, size[1] / 2 - 0.05]), rng.uniform(-1.5, 1.5)
        R = rotation_about((0.0, 0.0, 1.0), yaw)
        met = meets(ways.lows, ways.floor, footprint(Box(sides), R), xy[None])[0]
        exact = {}
        for grow in (-0.01, 0.03):
            shape = Box(sides + grow)
            pose = T @ transform(R, [*xy, (sides[2] + grow) / 2])
            alone = Motions(ur5e, replace(scene, objects=(scene.body(scene.target), Body("box", shape, pose))))
            there = alone.cell.problem({"box": pose}, ways.gripper)
            edges = [list(pairwise(path)) for path in ways.paths]
            exact[grow] = np.array([any(alone.cell.edge(there, a, b) is not None for a, b in path) for path in edges])
        assert (met | ~exact[-0.01]).all(), "touched although a centimetre smaller, and not met"
        assert (~met | exact[0.03]).all(), "met, and not touched although three centimetres larger"
        verdicts += list(met)
    assert 0.1 < np.mean(verdicts) < 0.9


def test_no_ball_of_the_arm_comes_lower_than_a_sweep_says(scene: Scene, motions: Motions) -> None:
    """Anywhere on a path, up to how far a link may move between two places where it is drawn."""
    ways = paths_to_target(motions, motions.start(), np.random.default_rng(5), 6)
    balls, chain = arm_balls(motions.robot, scene.robot.T_world_base, ways.gripper), motions.cell.arm.chain
    size, frames, rng = ways.floor.size, np.empty((len(chain.q_index) + 1, 4, 4)), np.random.default_rng(3)
    part, (bx, by, bz, radius) = np.repeat(np.arange(len(balls.frame)), np.diff(balls.start)), balls.ball.reshape(4, -1)
    near, seen = int(np.ceil((SAMPLE_M + CELL_M) / CELL_M)), 0
    for k, path in enumerate(ways.paths):
        for _ in range(60):
            edge = int(rng.integers(len(path) - 1))
            forward(chain, path[edge] + rng.random() * (path[edge + 1] - path[edge]), frames)
            T = ways.floor.T @ frames[balls.frame[part]]
            x, y, z = np.einsum("nij,jn->in", T[:, :3, :3], np.stack([bx, by, bz])) + T[:, :3, 3].T
            low = z - np.sqrt(np.maximum(radius**2 - CELL_M**2 / 2, 0.0))
            inside = (radius > 0) & (x > near * CELL_M) & (x < size[0]) & (np.abs(y) < size[1] / 2) & (low + SAMPLE_M < size[2])
            for i in np.flatnonzero(inside):
                a, b = int(x[i] / ways.floor.cell[0]), int((y[i] + size[1] / 2) / ways.floor.cell[1])
                around = ways.lows[max(a - near, 0) : a + near + 1, max(b - near, 0) : b + near + 1, k]
                assert around.min() <= low[i] + SAMPLE_M + 1e-6
                seen += 1
    assert seen > 1000


def test_ways_are_all_there_and_end_at_the_grasp(ur5e: Robot, scene: Scene, motions: Motions) -> None:
    ways = paths_to_target(motions, motions.start(), np.random.default_rng(5), 9)
    assert 0 < ways.times.sum() <= 9
    assert len(ways.times) == len(ways.paths)
    for path in ways.paths:
        assert np.allclose(path[0], ur5e.arm_q(waiting.home(motions.cell)))
        assert np.allclose(motions.cell.arm.hand_pose(path[-1]), scene.grasp.T_world_hand, atol=1e-4)


def test_where_searches_fail_a_few_ways_are_enough(motions: Motions, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every third search fails: with enough ways found, the next that does is the last."""
    asked: list[int] = []

    def way(_: Workcell, query: object, start: Array, goals: Array, *args: object, **kws: object) -> Array | None:
        asked.append(len(asked))
        return np.stack([start, start + 0.01, goals[0]]) if len(asked) % 3 else None

    monkeypatch.setattr(Workcell, "way", way)
    for enough, searches, found in ((None, 10, 7), (1, 3, 2), (2, 3, 2), (3, 6, 4), (7, 10, 7)):
        asked.clear()
        ways = paths_to_target(motions, motions.start(), np.random.default_rng(5), 10, enough=enough)
        assert (len(asked), int(ways.times.sum())) == (searches, found), enough


def test_without_ways_nothing_blocks(motions: Motions, scene: Scene) -> None:
    """The grasp is turned to come from behind: no way leads there, and the row says so instead of failing."""
    T = scene.grasp.T_world_hand @ transform(rotation_about((1.0, 0.0, 0.0), np.pi))
    behind = Motions(motions.robot, replace(scene, grasp=replace(scene.grasp, T_world_hand=T)))
    found = labelled(behind, 3, objects=0)
    assert found.paths == 0
    assert not found.blocks.any()
    assert (found.hits[found.hits != NOT_ASKED] == 0).all()
    assert (found.opens == NOT_ASKED).all()


# States ---------------------------------------------------------------------------------------------------------------------------------


def test_scenes_for_labels_differ_from_others_and_among_themselves(ur5e: Robot) -> None:
    ref, spec = to_ref(ur5e), load_spec("paper")
    made = [varied_scene(spec, ur5e, ref, SEED, i, Variety()) for i in range(4)]
    plain = generate(spec, ur5e, ref, SEED, 0)
    for i, s in enumerate(made):
        shift = s.robot.T_world_base[:3, 3] - ref.T_world_base[:3, 3]
        assert (np.abs(shift) <= 0.05).all()
        assert (np.abs(s.cabinet.size_m / spec.cabinet_size_m - 1) <= 0.15 + 1e-12).all()
        assert 8 <= s.regions_n <= 12
        assert s.seed == (SEED, 3, i)
        assert not np.allclose(s.body(s.target).T_world_body, plain.body(plain.target).T_world_body)
    assert len({tuple(s.cabinet.size_m) for s in made}) == 4
    fixed = varied_scene(spec, ur5e, ref, SEED, 0, Variety(0.0, 0.0, None))
    assert np.array_equal(fixed.cabinet.size_m, spec.cabinet_size_m)
    assert fixed.regions_n == spec.regions_n


def test_a_move_carries_an_object_to_a_region(motions: Motions, row: Row, scene: Scene) -> None:
    """One object moves, to the middle of a region, and the arm ends where nothing touches."""
    cells, look = scene.regions(), BriefLook(motions, motions.start(), np.random.default_rng(2))
    state, after = look.state, next_state(look, row)
    assert after is not None
    moved = [n for n in state.poses if not np.allclose(state.poses[n], after.poses[n])]
    assert len(moved) == 1
    assert moved[0] != scene.target
    now = object_box(replace(scene.body(moved[0]), T_world_body=after.poses[moved[0]]))
    assert np.abs(cells[:, :2] - now[:2]).max(1).min() < 1e-6
    empty_hand = motions.cell.problem(after.poses, float(after.q[motions.robot.gripper_joint]))
    assert motions.cell.touch(empty_hand, motions.robot.arm_q(after.q)) is None


def test_states_end_when_the_target_is_free(ur5e: Robot, scene: Scene) -> None:
    free = replace(scene, objects=(scene.body(scene.target),))
    assert list(rows(ur5e, free, SEED, 0)) == []
    found = list(rows(ur5e, scene, SEED, 0, paths=2, objects=0))
    assert [r.state for r in found] == list(range(len(found)))
    assert 1 <= len(found) <= MOVES + 1
    again = list(rows(ur5e, scene, SEED, 0, paths=2, objects=0, moves=0))
    assert pickle.dumps(again) == pickle.dumps(found[:1])


def test_what_a_few_views_show_of_a_state(ur5e: Robot, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows of the truth are as they would be alone; those beside them leave out what is hidden, and never show a box too small. Nothing
    of them depends on what the map is not asked."""
    plain = list(rows(ur5e, scene, SEED, 0, paths=2, objects=0))
    found = list(rows(ur5e, scene, SEED, 0, paths=2, objects=0, partly_seen=1.0))
    with monkeypatch.context() as patch:
        patch.setattr(partial_views, "_to_be_asked", lambda motions, state: unknown_voxels(motions.scene.cabinet))
        assert pickle.dumps(list(rows(ur5e, scene, SEED, 0, paths=2, objects=0, partly_seen=1.0))) == pickle.dumps(found)
    assert pickle.dumps([r for r in found if not r.views]) == pickle.dumps(plain)
    true = {r.state: r for r in plain}
    parts = [r for r in found if r.views]
    assert parts
    for part in parts:
        whole = true[part.state]
        assert np.array_equal(part.regions[:, :3], whole.regions[:, :3])
        assert set(part.regions[:, 3]) <= {0.0, 1.0}
        for i, box in enumerate(part.objects):
            k = int(np.abs(whole.objects - box).max(1).argmin())
            assert np.abs(box[:2] - whole.objects[k, :2]).max() < 0.05
            assert (box[:3] + box[3:] / 2 > whole.objects[k, :3] + whole.objects[k, 3:] / 2 - 0.01).all()
            assert (part.blocks[i], part.pickable[i], part.opens[i]) == (whole.blocks[k], whole.pickable[k], whole.opens[k])
            assert (part.first[i], part.least_moves) == (whole.first[k], whole.least_moves)
            assert np.array_equal(part.feasible[i], whole.feasible[k])
            assert np.array_equal(part.shorter[i], whole.shorter[k])
        assert np.abs(part.target[:2] - whole.target[:2]).max() < 0.02


# Files ----------------------------------------------------------------------------------------------------------------------------------


def same(a: Row, b: Row) -> bool:
    return all(np.allclose(getattr(a, f.name), getattr(b, f.name), atol=1e-6) if f.type not in ("str", "int") else
               getattr(a, f.name) == getattr(b, f.name) for f in fields(Row))  # fmt: skip


def test_rows_come_back_from_a_shard(row: Row, tmp_path: Path) -> None:
    other = replace(row, scene="other", state=2)
    one, two = shards.write_shard(tmp_path, 0, [row, other]), shards.write_shard(tmp_path, 1, [row, other])
    assert one.sha256 == two.sha256 == hashlib.sha256((tmp_path / "shard-00001.parquet").read_bytes()).hexdigest()
    shards.write_manifest(tmp_path, Manifest({"seed": 1}, {}, (one, two), True))
    back = list(read_rows(tmp_path))
    assert [(r.scene, r.state) for r in back] == [(row.scene, 0), ("other", 2)] * 2
    assert all(same(a, b) for a, b in zip(back, [row, other] * 2))
    assert read_manifest(tmp_path) == Manifest({"seed": 1}, {}, (one, two), True)


def test_a_shard_that_is_not_whole_is_noticed(row: Row, tmp_path: Path) -> None:
    written = [shards.write_shard(tmp_path, i, [row]) for i in range(3)]
    assert shards.whole(tmp_path, written) == 3
    with (tmp_path / "shard-00001.parquet").open("ab") as f:
        f.write(b"!")
    assert shards.whole(tmp_path, written) == 1
    (tmp_path / "shard-00000.parquet").unlink()
    assert shards.whole(tmp_path, written) == 0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "has no manifest.json"),
        ("{", "broken JSON"),
        ("[]", "is not retrieve/labels@2"),
        ('{"schema": "retrieve/labels@1"}', "too old, it does not say how many moves are needed; label into a new folder"),
        ('{"schema": "retrieve/labels@9"}', "too new for this version, which reads retrieve/labels@2"),
        ('{"schema": "retrieve/labels@2", "shards": 3}', "not what a manifest has"),
    ],
)
def test_a_folder_without_a_good_manifest(text: str | None, says: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(ValueError, match=says):
        list(read_rows(tmp_path))


# The command ----------------------------------------------------------------------------------------------------------------------------


def folder_bytes(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@dataclass
class Quick:
    """Labels that cost nothing, four scenes a shard: which scenes were asked for, and at which the run is interrupted."""

    asked: list[int] = field(default_factory=list)
    stop: int = -1


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, row: Row) -> Quick:
    how = Quick()

    def label_item(job: command.Job, item: command.Item) -> list[Row]:
        how.asked.append(item.index)
        if item.index == how.stop:
            raise KeyboardInterrupt
        return [replace(row, scene=f"{job.seed}-{item.index}", state=s) for s in range(item.index % 3)]

    monkeypatch.setattr(command, "label_item", label_item)
    monkeypatch.setattr(command, "SHARD", 4)
    return how


def test_a_run_that_was_killed_goes_on_to_the_same_bytes(quick: Quick, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert main(["label", "-n", "11", "-o", str(whole)]) == 0
    assert sorted(folder_bytes(whole)) == ["manifest.json", "shard-00000.parquet", "shard-00001.parquet", "shard-00002.parquet"]
    quick.asked, quick.stop = [], 6
    assert main(["label", "-n", "11", "-o", str(broken)]) == 130
    assert capsys.readouterr().err.endswith(f"{broken}: broken off with 1 whole shards; the same call goes on behind them\n")
    assert quick.asked == list(range(7))
    assert not read_manifest(broken).complete
    assert len(list(read_rows(broken))) == 3, "what is there can be read"
    (broken / "shard-00001.parquet.part").write_bytes(b"half a shard")
    quick.asked, quick.stop = [], -1
    assert main(["label", "-n", "11", "-o", str(broken)]) == 0
    assert quick.asked == list(range(4, 11)), "the first shard was kept"
    assert folder_bytes(broken) == folder_bytes(whole)
    quick.asked = []
    assert main(["label", "-n", "11", "-o", str(broken)]) == 0
    assert quick.asked == [], "there was nothing left to do"
    assert folder_bytes(broken) == folder_bytes(whole)


def test_two_runs_are_not_in_one_folder_at_once(quick: Quick, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "labels"
    assert main(["label", "-n", "5", "-o", str(out)]) == 0
    before = folder_bytes(out)
    capsys.readouterr()
    with alone_in(out):
        assert main(["label", "-n", "11", "-o", str(out)]) == 2
    assert capsys.readouterr().err.endswith(f"{out}: another run is writing in it just now; name another folder\n")
    assert folder_bytes(out) == before
    assert main(["label", "-n", "11", "-o", str(out)]) == 0, "the lock goes with the run"


def test_the_scenes_of_each_spec_are_fitted_to_the_arm(quick: Quick, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `gen --fit` does it: with the place of its base, and where it waits."""
    made: list[tuple[tuple[Spec, RobotRef], ...]] = []

    def fitted(spec: Spec, arm: Robot, ref: RobotRef, command: str) -> tuple[Spec, RobotRef]:
        return replace(spec, cabinet_front_m=0.2), replace(ref, home={"elbow_joint": float(spec.objects_box_share)})

    def label_item(job: command.Job, item: command.Item) -> list[Row]:
        made.append(job.specs)
        return []

    monkeypatch.setattr(command, "fitted", fitted)
    monkeypatch.setattr(command, "label_item", label_item)
    plain, out = tmp_path / "plain", tmp_path / "fitted"
    specs = ["--spec", "paper", "--spec", "shelf"]
    assert main(["label", "-n", "2", *specs, "-o", str(plain)]) == 0
    assert main(["label", "-n", "2", *specs, "--fit", "-o", str(out)]) == 0
    (usual, _), fit = made[0], made[-1]
    assert usual[1].home is None
    assert [(spec.cabinet_front_m, ref.home) for spec, ref in fit] == [
        (0.2, {"elbow_joint": load_spec(name).objects_box_share}) for name in ("paper", "shelf")
    ]
    hashes = [read_manifest(folder).settings["source"]["specs"][0]["sha256"] for folder in (plain, out)]
    assert hashes[0] != hashes[1], "neither goes on with the other's labels"


def test_more_scenes_are_added_to_a_folder(quick: Quick, tmp_path: Path) -> None:
    whole, grown = tmp_path / "whole", tmp_path / "grown"
    assert main(["label", "-n", "11", "-o", str(whole)]) == 0
    assert main(["label", "-n", "6", "-o", str(grown)]) == 0
    quick.asked = []
    assert main(["label", "-n", "11", "-o", str(grown)]) == 0
    assert quick.asked == list(range(4, 11)), "the shard with two scenes is made whole"
    assert folder_bytes(grown) == folder_bytes(whole)


def test_a_spoilt_shard_is_written_anew(quick: Quick, tmp_path: Path) -> None:
    out = tmp_path / "labels"
    assert main(["label", "-n", "10", "-o", str(out)]) == 0
    good = folder_bytes(out)
    (out / "shard-00001.parquet").write_bytes(b"spoilt")
    quick.asked = []
    assert main(["label", "-n", "10", "-o", str(out)]) == 0
    assert quick.asked == list(range(4, 10))
    assert folder_bytes(out) == good


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["-n", "5", "--seed", "1"], "holds labels made otherwise: seed was 0, and is 1 now; name a new folder"),
        (["-n", "4"], "scenes was 5, and is 4 now"),
        (["-n", "5", "--paths", "3"], "paths was 64, and is 3 now"),
        (["-n", "5", "--no-vary"], "source was {"),
        (["-n", "5", "--spec", "shelf"], "source was {"),
    ],
)
def test_other_settings_ask_for_another_folder(
    args: list[str], says: str, quick: Quick, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "labels"
    assert main(["label", "-n", "5", "-o", str(out)]) == 0
    before = folder_bytes(out)
    capsys.readouterr()
    assert main(["label", *args, "-o", str(out)]) == 2
    err = capsys.readouterr().err.splitlines()[-1]
    assert says in err
    assert folder_bytes(out) == before


def test_folders_and_calls_that_will_not_do(quick: Quick, scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    (tmp_path / "file").write_text("")
    with scene_writer(tmp_path / "scenes.jsonl") as write:
        write(scene)
    for args, says in (
        (["-n", "1", "-o", str(tmp_path / "full")], "is not empty, and holds no labels"),
        (["-n", "1", "-o", str(tmp_path / "file")], "is a file, not a folder"),
        (["-n", "1", "-o", str(tmp_path / "file" / "labels")], "can't be made: not a directory"),
        ([str(tmp_path / "scenes.jsonl"), "-n", "1", "-o", str(tmp_path / "a")], "and -n exclude each other"),
        ([str(tmp_path / "scenes.jsonl"), "--fit", "-o", str(tmp_path / "a")], "--fit is for scenes that are generated, with -n: those of"),
        (["-n", "1", "--spec", "papr", "-o", str(tmp_path / "b")], "unknown spec 'papr'"),
        (["-n", "1", "--address", "h:1", "-o", str(tmp_path / "c")], "--address h:1 is for --engine ray"),
    ):
        assert main(["label", *args]) == 2
        assert says in capsys.readouterr().err
    assert quick.asked == []


def test_workers_change_nothing(scene: Scene, tmp_path: Path) -> None:
    """Real labels of two scenes of a file, by this process and by two others."""
    with scene_writer(tmp_path / "scenes.jsonl") as write:
        write(scene)
        write(replace(scene, id="again"))
    found = {}
    for workers in ("1", "2"):
        out = tmp_path / workers
        args = ["--paths", "3", "--moves", "1", "--objects", "0", "--workers", workers, "-o", str(out)]
        assert main(["label", str(tmp_path / "scenes.jsonl"), *args]) == 0
        found[workers] = folder_bytes(out)
    assert found["1"] == found["2"]
    read = list(read_rows(tmp_path / "2"))
    assert {r.scene for r in read} == {scene.id, "again"}
    manifest = json.loads(found["1"]["manifest.json"])
    assert manifest["schema"] == "retrieve/labels@2"
    assert (manifest["robot"], manifest["paths"], manifest["complete"]) == ("ur5e", 3, True)
    assert sum(s["rows"] for s in manifest["shards"]) == len(read)
