"""The networks: what they see, that they don't mind the order of things, numpy as torch; labels as arrays; training that can be resumed."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow.parquet as parquet
import pytest
import synthetic_labels
import torch

from kinematics.scene import Cabinet, Grasp
from kinematics.transforms import rotation_about, transform
from perception.observation import Observation
from planning.learning.labelling.label_file import NOT_ASKED
from planning.learning.networks import numpy_inference
from planning.learning.networks.scores import object_score, paper_cost, region_score
from planning.learning.networks.tokens import LENGTH_M, Tokens, pair_features, token_kinds, tokens
from planning.learning.training.batches import asked, osnet_batch, rpnet_batch, usable
from planning.learning.training.dataset import Data, read, split
from planning.learning.training.evaluate import calibration_error, judge_osnet, judge_rpnet
from planning.learning.training.settings import Settings
from planning.learning.training.train import Epoch, finished, make_net, train
from planning.policies.regions import free_regions

SMALL = Settings(width=16, layers=2, batch=32, pairs=24, epochs=3)
FORMS = ("objects", "paper")


@pytest.fixture(scope="module")
def labels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return synthetic_labels.write(tmp_path_factory.mktemp("labels"), 160)


@pytest.fixture(scope="module")
def data(labels: Path) -> Data:
    return read(labels)[0]


def observation(seed: int = 0, T: np.ndarray | None = None) -> Observation:
    """A synthetic state as an observation, the cabinet at T in the world."""
    row = synthetic_labels.row("0-0", np.random.default_rng(seed))
    T = np.eye(4) if T is None else T
    R, p = T[:3, :3], T[:3, 3]
    boxes = np.array([row["target"], *np.reshape(row["objects"], (-1, 6))])
    boxes = np.concatenate([boxes[:, :3] @ R.T + p, boxes[:, 3:] @ np.abs(R).T], 1)
    names = ["target", *(f"can_{i}" for i in range(1, len(boxes)))]
    x, y = np.reshape(row["grasp"][3:], (2, 3))
    grasp = Grasp(T @ transform(np.stack([x, y, np.cross(x, y)], -1), row["grasp"][:3]), float(row["width_m"]))
    regions = np.reshape(row["regions"], (-1, 4))
    regions = np.column_stack([regions[:, :3] @ R.T + p, regions[:, 3]])
    cabinet = Cabinet(np.asarray(row["cabinet"]), T, 0.03)
    return Observation(R @ row["base"] + p, cabinet, np.zeros(6), grasp, "target", ("horizontal",), dict(zip(names, boxes)), regions)


# What the networks see --------------------------------------------------------------------------------------------------------------------


def test_tokens_do_not_tell_where_the_cabinet_stands() -> None:
    here = tokens(observation())
    for T in (transform(p=[0.3, -0.2, 0.1]), transform(rotation_about(np.array([0.0, 0.0, 1.0]), np.pi / 2), [1, 2, 3])):
        there = tokens(observation(T=T))
        for f in fields(Tokens):
            np.testing.assert_allclose(getattr(there, f.name), getattr(here, f.name), atol=1e-6)


def test_tokens_of_a_label_and_of_its_observation_are_the_same(tmp_path: Path) -> None:
    data, _ = read(synthetic_labels.write(tmp_path, 2, seed=0, shards=1))
    row = synthetic_labels.row("0-000000", np.random.default_rng(0), n=5)
    m, b = len(row["objects"]) // 6, len(row["regions"]) // 4
    t = tokens(replace(observation(), regions=np.reshape(row["regions"], (-1, 4))))
    np.testing.assert_allclose(data.context[0], t.context, atol=1e-6)
    np.testing.assert_allclose(data.grasp[0], t.grasp, atol=1e-6)
    np.testing.assert_allclose(data.boxes[0, : m + 1], t.boxes, atol=1e-6)
    np.testing.assert_allclose(data.regions[0, :b], t.regions, atol=1e-6)
    assert not data.boxes[0, m + 1 :].any()
    assert data.mask[0].sum() == m + 1
    assert data.there[0].sum() == b


def test_gaps_and_sides_are_what_they_say() -> None:
    context = np.array([-1, 0, 0, 2, 3, 2, 1, 0, 0], np.float32)
    ours = np.array([[0.5, 0, 0.2, 0.2, 0.2, 0.4]], np.float32)
    other = np.array([[1.0, 0.3, 0.1, 0.4, 0.1, 0.2]], np.float32)
    r = pair_features(ours, other, np.zeros((1, 3), np.float32), np.zeros((1, 1), np.float32), context, np)[0, 0]
    np.testing.assert_allclose(r[:7], [0.5, 0.3, -0.2, 0.2, 0.15, 0.5, 0.3], atol=1e-6)
    assert token_kinds(5).sum() == 3


# The networks -----------------------------------------------------------------------------------------------------------------------------


def torch_inputs(t: Tokens, *names: str) -> list[torch.Tensor]:
    return [torch.from_numpy(getattr(t, n))[None] for n in names]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", range(3))
def test_numpy_says_what_torch_says(form: str, seed: int) -> None:
    t, settings = tokens(observation(seed)), Settings(form=form, width=32, seed=seed)
    mask = torch.ones(1, len(t.boxes), dtype=torch.bool)
    moved = len(t.boxes) - 1
    nets = {name: make_net(name, settings).eval() for name in ("osnet", "rpnet")}
    w = {name: numpy_inference.turned({k: v.numpy() for k, v in net.state_dict().items()}) for name, net in nets.items()}
    scene = torch_inputs(t, "context", "grasp", "boxes")
    with torch.inference_mode():
        wanted = nets["osnet"](*scene, mask)[0].numpy()
        got = (numpy_inference.paper_osnet if form == "paper" else numpy_inference.osnet)(w["osnet"], t, settings.heads)
        np.testing.assert_allclose(got, wanted, atol=1e-4)
        assert got.std() > 1e-3
        regions = torch.from_numpy(t.regions)[None]
        if form == "paper":
            there = torch.ones(regions.shape[:2], dtype=torch.bool)
            wanted = nets["rpnet"](*scene, regions, there, torch.tensor([[moved]]))[0, 0].numpy()
            got = numpy_inference.paper_rpnet(
                w["rpnet"], numpy_inference.paper_rpnet_encode(w["rpnet"], t, settings.heads), moved, settings.heads
            )
        else:
            some = np.array([3, 17, 4])
            wanted = nets["rpnet"](*scene, mask, regions[:, some], torch.full((1, 3), moved))[0].numpy()
            got = numpy_inference.rpnet(
                w["rpnet"], numpy_inference.rpnet_encode(w["rpnet"], t, settings.heads), moved, some, settings.heads
            )
        np.testing.assert_allclose(got, wanted, atol=1e-4)
        assert got.std() > 1e-3


@pytest.mark.parametrize("form", FORMS)
def test_padding_changes_nothing_and_order_only_the_order(form: str) -> None:
    t, settings = tokens(observation(1)), replace(SMALL, form=form)
    net = make_net("osnet", settings).eval()
    context, grasp, boxes = torch_inputs(t, "context", "grasp", "boxes")
    n = boxes.shape[1]
    mask = torch.ones(1, n, dtype=torch.bool)
    with torch.inference_mode():
        plain = net(context, grasp, boxes, mask)[0]
        order = torch.arange(n - 1).flip(0)
        turned = net(context, grasp, torch.cat([boxes[:, :1], boxes[:, 1:][:, order]], 1), mask)[0]
        torch.testing.assert_close(turned, plain[order], atol=1e-5, rtol=1e-5)
        padded = net(context, grasp, torch.cat([boxes, torch.ones(1, 2, 6)], 1), torch.cat([mask, ~torch.ones_like(mask[:, :2])], 1))[0]
        torch.testing.assert_close(padded[: n - 1], plain, atol=1e-5, rtol=1e-5)


def test_regions_are_judged_one_by_one_whatever_else_is_padded_or_asked() -> None:
    t = tokens(observation(1))
    net = make_net("rpnet", SMALL).eval()
    context, grasp, boxes, regions = torch_inputs(t, "context", "grasp", "boxes", "regions")
    mask, moved = torch.ones(1, boxes.shape[1], dtype=torch.bool), torch.full((1, regions.shape[1]), 2)
    with torch.inference_mode():
        plain = net(context, grasp, boxes, mask, regions, moved)[0]
        padded = torch.cat([boxes, torch.ones(1, 3, 6)], 1)
        some = net(context, grasp, padded, torch.cat([mask, torch.zeros(1, 3, dtype=torch.bool)], 1), regions[:, [7, 3]], moved[:, :2])[0]
        torch.testing.assert_close(some, plain[[7, 3]], atol=1e-5, rtol=1e-5)
        other = net(context, grasp, boxes, mask, regions, moved - 1)[0]
    assert (other - plain).abs().max() > 1e-3


def test_the_printed_rpnet_is_blind_to_the_other_objects_and_ours_is_not() -> None:
    t = tokens(observation(2))
    moved = t.boxes.copy()
    moved[2, :2] += 0.3
    other = replace(t, boxes=moved)
    for form, blind in (("paper", True), ("objects", False)):
        net = make_net("rpnet", replace(SMALL, form=form))
        w = numpy_inference.turned({k: v.numpy() for k, v in net.state_dict().items()})
        if blind:
            a, b = (numpy_inference.paper_rpnet(w, numpy_inference.paper_rpnet_encode(w, s, 4), 1, 4) for s in (t, other))
        else:
            a, b = (numpy_inference.rpnet(w, numpy_inference.rpnet_encode(w, s, 4), 1, np.arange(len(t.regions)), 4) for s in (t, other))
        assert np.array_equal(a, b) is blind


# Labels as arrays -------------------------------------------------------------------------------------------------------------------------


def test_labels_are_read_as_they_were_written(labels: Path, data: Data) -> None:
    rows = [r for f in sorted(labels.glob("*.parquet")) for r in parquet.read_table(f).to_pylist()]
    assert len(data) == len(rows) == 160
    for i in (0, 1, 79, 80, 159):
        row, m, b = rows[i], len(rows[i]["objects"]) // 6, len(rows[i]["regions"]) // 4
        assert data.scene[i] == row["scene"]
        np.testing.assert_array_equal(data.feasible[i, :m, :b].ravel(), row["feasible"])
        np.testing.assert_array_equal(data.hits[i, :m, :b].ravel(), row["hits"])
        assert (data.feasible[i, m:] == 255).all()
        assert (data.hits[i, :, b:] == 255).all()
        np.testing.assert_allclose(data.p[i, :m], np.array(row["blocks"]) / max(sum(row["blocks"]), 1), atol=1e-6)
        assert np.isnan(data.p[i, m:]).all()
        np.testing.assert_allclose(data.boxes[i, 0] * LENGTH_M, row["target"], atol=1e-6)
        np.testing.assert_array_equal(data.pickable[i, :m], row["pickable"])
        np.testing.assert_array_equal(data.first[i, :m], np.where(np.array(row["first"]) == 255, np.nan, row["first"]))
        np.testing.assert_array_equal(data.shorter[i, :m, :b].ravel(), row["shorter"])
        assert data.least_moves[i] == row["least_moves"]


def test_free_cells_are_those_of_the_policies(tmp_path: Path) -> None:
    data, _ = read(synthetic_labels.write(tmp_path, 1, seed=3, shards=1))
    row = synthetic_labels.row("x", np.random.default_rng(3), n=5)
    seen = replace(observation(3), regions=np.reshape(row["regions"], (-1, 4)))
    for k, name in enumerate(seen.movable):
        np.testing.assert_array_equal(np.flatnonzero(data.free[0, k]), free_regions(seen, name))
    assert 0 < data.free.mean() < 1


def test_a_scene_is_on_one_side_of_the_split_whatever_else_there_is(data: Data) -> None:
    a, b = split(data.scene, 0.2)
    assert sorted([*a, *b]) == list(range(len(data)))
    assert not set(data.scene[a]) & set(data.scene[b])
    assert 0.05 < len(b) / len(data) < 0.4
    first = data.scene[:60]
    assert set(first[split(first, 0.2)[1]]) == set(data.scene[b]) & set(first)
    assert [len(part) for part in split(np.array(["x", "y"]), 1e-9)] == [1, 1]
    with pytest.raises(ValueError, match="all states are of one scene"):
        split(np.array(["x", "x"]), 0.2)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"schema": "retrieve/labels@1"}, "too old, it does not say how many moves are needed"),
        ({"schema": "retrieve/labels@3"}, "too new"),
        ({"schema": "retrieve/plan@1"}, "is not retrieve/labels@2"),
        ({"shards": []}, "names no shards"),
        ({"shards": [{"file": "nothing.parquet"}]}, "nothing.parquet: is missing"),
        ({"shards": [{"file": "shard-00000.parquet", "sha256": "0"}]}, "is not the file that manifest.json describes"),
        ({"shards": [{"file": "manifest.json"}]}, "is no shard of labels"),
    ],
)
def test_labels_that_can_not_be_used_say_why(labels: Path, tmp_path: Path, change: dict[str, Any], says: str) -> None:
    for file in labels.glob("*.parquet"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    manifest = json.loads((labels / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text(json.dumps({**manifest, **change}))
    with pytest.raises(ValueError, match=says):
        read(tmp_path)


def test_a_folder_that_holds_no_labels_says_so(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no manifest\.json; make one"):
        read(tmp_path)


def test_what_was_not_asked_is_not_learned(data: Data) -> None:
    """Unknown labels weigh nothing: 255 instead of any answer gives a loss that does not depend on that answer."""
    index = usable("rpnet", data)[:20]
    dim = data.feasible.copy()
    dim[:, 0] = NOT_ASKED
    hidden = replace(data, feasible=dim)
    assert not asked(hidden)[:, 0].any()
    for form in FORMS:
        batch = rpnet_batch(hidden, index, replace(SMALL, form=form), np.random.default_rng(0))
        moved = batch.inputs[5]
        known = ~np.isnan(batch.wanted[0])
        assert known.any()
        assert not known[moved == 1].any()


def test_labels_of_regions_are_the_papers_cost(data: Data) -> None:
    batch = rpnet_batch(data, usable("rpnet", data)[:20], SMALL, np.random.default_rng(0))
    cost, feasible, hits, shorter = batch.wanted
    known = ~np.isnan(cost)
    assert ((cost == 1) == ((feasible == 0) | (hits >= 0.1)))[known].all()
    assert (cost[known & (cost < 1)] < 0.95).all()
    assert np.isnan(shorter[feasible == 0]).all()
    assert set(shorter[~np.isnan(shorter)]) == {0, 1}
    one, two = np.array([1.0], np.float32), np.array([0.3], np.float32)
    assert (paper_cost(one, 0 * one, two), paper_cost(one, one, two), paper_cost(0 * one, 0 * one, two)) == (two, one, one)
    paper = rpnet_batch(data, usable("rpnet", data)[:20], replace(SMALL, form="paper"), np.random.default_rng(0))
    unseen = (paper.inputs[3][:, None, :, 3] < 0.5) & ~np.isnan(paper.wanted[0])
    assert unseen.any()
    assert (paper.wanted[0][unseen] == 1).all()


def test_scores_prefer_what_they_should() -> None:
    p, pickable, opens = np.array([1, 0.1, 1, 0.2], np.float32), np.array([0.01, 0.9, 0.9, 0.9], np.float32), np.array([1, 0.9, 0, 0])
    assert list(np.argsort(-object_score(p, pickable, opens.astype(np.float32)))) == [1, 2, 3, 0]
    first = np.array([0.9, 0.1, 0.1, 0.9], np.float32)  # where one step helps, it goes before; where none does, who goes first decides
    assert list(np.argsort(-object_score(p, pickable, opens.astype(np.float32), first))) == [1, 2, 3, 0]
    assert np.argmax(object_score(p * [1, 0, 0, 0], pickable, 0 * opens.astype(np.float32), first)) == 3
    feasible, hits, far = np.array([0.1, 0.9, 0.9, 0.9]), np.array([0, 0.9, 0, 0]), np.array([0.1, 0.1, 0.9, 0.1])
    assert list(np.argsort(-region_score(*(a.astype(np.float32) for a in (feasible, hits, far))))) == [3, 2, 0, 1]


def test_calibration_error_of_honest_and_of_bold_chances() -> None:
    rng = np.random.default_rng(0)
    chance = rng.random(20000).astype(np.float32)
    truth = (rng.random(20000) < chance).astype(np.float32)
    assert calibration_error(chance, truth) < 0.02
    assert calibration_error(np.round(chance), truth) > 0.2
    assert calibration_error(chance, np.where(chance > 0.5, np.nan, truth)) < 0.02
    assert np.isnan(calibration_error(chance, np.full(20000, np.nan, np.float32)))


# Training ---------------------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def parts(data: Data) -> tuple[Data, Data]:
    a, b = split(data.scene, 0.2)
    return data.take(a), data.take(b)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["osnet", "rpnet"])
def test_a_run_that_was_broken_off_ends_as_if_it_had_not_been(form: str, name: str, parts: tuple[Data, Data], tmp_path: Path) -> None:
    settings = replace(SMALL, form=form)
    whole = train(name, *parts, settings)

    class Broken(Exception):
        pass

    def stop(epoch: Epoch) -> None:
        if epoch.number == 1:
            raise Broken

    file = tmp_path / "run.safetensors"
    with pytest.raises(Broken):
        train(name, *parts, settings, checkpoint=file, on_epoch=stop)
    resumed = train(name, *parts, settings, checkpoint=file)
    assert resumed.epochs == whole.epochs
    assert resumed.best == whole.best
    for key, value in whole.weights.items():
        assert torch.equal(resumed.weights[key], value), key
    other = train(name, *parts, replace(settings, seed=1))
    assert any(not torch.equal(other.weights[k], v) for k, v in whole.weights.items())
    with pytest.raises(ValueError, match="that run has width = 16, not 32"):
        train(name, *parts, replace(settings, width=32), checkpoint=file)


def test_training_ends_when_validation_gets_no_better() -> None:
    def run(*losses: float) -> list[Epoch]:
        return [Epoch(i, 1.0, v, v < min(losses[:i], default=9)) for i, v in enumerate(losses)]

    settings = Settings(epochs=9, patience=2)
    assert not finished(run(3, 2, 2.5), settings)
    assert finished(run(3, 2, 2.5, 2.5), settings)
    assert not finished(run(3, 2, 2.5, 1), settings)
    assert finished(run(*range(9, 0, -1)), settings)


def test_the_networks_learn_what_the_labels_say(tmp_path: Path) -> None:
    """In a few seconds OSNet finds what stands in the lane, and RPNet regions that are far better than chance."""
    data, _ = read(synthetic_labels.write(tmp_path, 400, seed=1))
    a, b = split(data.scene, 0.2)
    settings = Settings(width=32, layers=2, batch=32, pairs=48, epochs=12, lr=4e-3)
    judged = {}
    for name, judge in (("osnet", judge_osnet), ("rpnet", judge_rpnet)):
        net = make_net(name, settings)
        net.load_state_dict(train(name, data.take(a), data.take(b), settings).weights)
        judged |= judge(net, data.take(b), settings)
    assert judged["top1_label"] > 0.75, judged
    assert judged["top1_pickable"] > 0.8, judged
    assert judged["top1_first"] > 0.75, judged
    assert judged["first_shortens"] > 0.6, judged
    assert judged["first_both"] > judged["chance"] + 0.2, judged
    assert judged["ece_feasible"] < 0.15, judged


def test_no_state_to_learn_from_is_said(parts: tuple[Data, Data]) -> None:
    nothing = replace(parts[0], paths=0 * parts[0].paths, p=parts[0].p * np.nan)
    for name in ("osnet", "rpnet"):
        with pytest.raises(ValueError, match=f"no state for training says what {name} learns from"):
            train(name, nothing, parts[1], SMALL)


def test_batches_depend_on_the_generator_alone(data: Data) -> None:
    index = usable("rpnet", data)[:10]
    for form in FORMS:
        settings = replace(SMALL, form=form)
        one, two, three = (rpnet_batch(data, index, settings, np.random.default_rng(s)) for s in (0, 0, 1))
        assert all(np.array_equal(x, y, equal_nan=x.dtype.kind == "f") for x, y in zip(one.inputs, two.inputs))
        assert not np.array_equal(one.inputs[-1], three.inputs[-1])
        assert len(osnet_batch(data, index, settings, np.random.default_rng(0)).wanted) == (1 if form == "paper" else 4)


def test_a_flag_that_blas_leaves_behind_is_no_warning_but_a_score_that_is_no_number_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The flag came up in one of some hundred runs, of a product whose numbers were right. (Warnings are errors here.)"""

    def flagged(*_: object) -> Any:
        np.array([np.inf], np.float32) * np.float32(0.0)
        return scores

    monkeypatch.setattr(numpy_inference, "_encode", lambda *_: (np.zeros((4, 1), np.float32), None))
    monkeypatch.setattr(numpy_inference, "_mlp", flagged)
    scores = np.array([[0.5]], np.float32)
    assert numpy_inference.osnet({}, cast("Tokens", None), 1) is scores
    scores = np.array([[np.nan]], np.float32)
    with pytest.raises(ArithmeticError, match="osnet"):
        numpy_inference.osnet({}, cast("Tokens", None), 1)
