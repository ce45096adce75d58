"""`retrieve train`, from labels to a model folder that `retrieve plan` takes; what it refuses, and how it goes on."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import synthetic_labels
from safetensors.numpy import load_file

from planning.io.outputs import alone_in
from planning.learning.networks.model import from_pretrained
from planning.learning.training import train as training
from retrieve_cli.label import Pace, span
from retrieve_cli.train import sparkline

FAST = ("--epochs", "2", "--width", "16", "--batch", "32", "--threads", "1", "--device", "cpu")
Spoken = tuple[int, str, str]


@pytest.fixture(scope="module")
def labels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return synthetic_labels.write(tmp_path_factory.mktemp("labels"), 80)


@pytest.mark.parametrize("form", ["objects", "paper"])
def test_labels_become_a_model(form: str, labels: Path, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    code, out, err = retrieve("train", labels, "-o", tmp_path / "model", "--form", form, *FAST)
    assert code == 0, err
    assert "osnet epoch   2/2  loss " in err
    assert "first both" in out
    assert sorted(f.name for f in (tmp_path / "model").iterdir()) == ["config.json", "loss.png", "osnet.safetensors", "rpnet.safetensors"]
    config = json.loads((tmp_path / "model" / "config.json").read_text())
    assert (config["schema"], config["form"], config["robot"]) == ("retrieve/model@2", form, "ur5e")
    assert config["data"]["train"] + config["data"]["validation"] == 80
    assert set(config["metrics"]) == {"osnet", "rpnet"}
    assert {"retrieve", "torch", "numpy"} <= set(config["versions"])
    assert from_pretrained(tmp_path / "model").form == form


def test_a_run_that_is_killed_goes_on_and_ends_with_the_same_bytes(
    labels: Path, tmp_path: Path, retrieve: Callable[..., Spoken], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert retrieve("train", labels, "-o", tmp_path / "whole", *FAST)[0] == 0
    save, calls = training._save, []

    def interrupted(*args: object) -> None:
        save(*args)  # type: ignore[arg-type]
        calls.append(1)
        if len(calls) == 3:  # the second network's first epoch
            raise KeyboardInterrupt

    monkeypatch.setattr(training, "_save", interrupted)
    model = tmp_path / "model"
    code, _, err = retrieve("train", labels, "-o", model, *FAST)
    assert (code, err.splitlines()[-1]) == (130, f"{model}: broken off; the same call with --resume goes on there")
    monkeypatch.undo()
    with alone_in(model):
        for how in ((), ("--resume",)):
            code, _, err = retrieve("train", labels, "-o", model, *FAST, *how)
            assert (code, err.splitlines()[-1]) == (2, f"{model}: another run is writing in it just now; name another folder")
    assert not (model / "config.json").exists()
    code, _, err = retrieve("train", labels, "-o", model, *FAST)
    assert (code, err) == (2, f"{model}: holds a run that was broken off; go on with --resume, or choose another folder\n")
    code, _, err = retrieve("train", labels, "-o", model, *FAST, "--seed", "4", "--resume")
    assert (code, err.splitlines()[-1].split(": ", 2)[2]) == (
        2,
        "that run has seed = 0, not 4; resume with the same options, or begin elsewhere",
    )
    code, _, err = retrieve("train", labels, "-o", model, *FAST, "--resume")
    assert code == 0, err
    assert "osnet epoch" not in err
    for name in ("osnet.safetensors", "rpnet.safetensors"):
        assert (model / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    one, two = (json.loads((d / "config.json").read_text()) for d in (model, tmp_path / "whole"))
    assert one == two


def test_several_folders_train_one_model(labels: Path, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    more = synthetic_labels.write(tmp_path / "more", 20, seed=5)
    code, _, err = retrieve("train", labels, more, "-o", tmp_path / "model", *FAST)
    assert code == 0
    config = json.loads((tmp_path / "model" / "config.json").read_text())
    assert config["data"]["train"] + config["data"]["validation"] == 100
    assert config["data"]["source"] == ["synthetic", "synthetic"]
    code, _, err = retrieve("train", labels, labels, "-o", tmp_path / "twice", *FAST)
    assert (code, err.count("\n")) == (2, 1)
    assert "as another folder has; label it with another --seed" in err
    for shard in more.glob("*.parquet"):
        table = pq.read_table(shard)
        robots = pa.array(["panda"] * table.num_rows)
        pq.write_table(table.set_column(table.column_names.index("robot"), "robot", robots), shard)
    code, _, err = retrieve("train", labels, more, "-o", tmp_path / "two", *FAST)
    assert (code, err) == (2, f"train: {more}: labels of the robot panda, and {labels} has labels of ur5e; a model is for one robot\n")


def test_what_train_refuses(labels: Path, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    def refused(*args: str | Path) -> str:
        code, out, err = retrieve("train", *args)
        assert (code, out, err.count("\n")) == (2, "", 1)
        return err

    new = tmp_path / "new"
    assert refused(tmp_path, "-o", new).startswith(f"train: {tmp_path}: is no folder of labels, for it has no manifest.json; make one: ")
    assert not new.exists()
    assert (
        refused(labels, "-o", labels / ".." / labels.name)
        == f"train: {labels}/../{labels.name}: holds the labels; name another folder for the model with -o\n"
    )
    assert refused(labels, "-o", new, "--width", "18").startswith("train: --width: 18 is no multiple of 4")
    assert "there is no run, nothing to resume" in refused(labels, "-o", new, "--resume")
    assert not new.exists()
    new.mkdir()
    (new / "config.json").write_text("{}")
    assert "holds a model already" in refused(labels, "-o", new)
    assert "this model is finished" in refused(labels, "-o", new, "--resume")
    (tmp_path / "file").write_text("")
    assert refused(labels, "-o", tmp_path / "file") == f"{tmp_path}/file: is a file, not a folder\n"
    assert refused(labels, "-o", tmp_path / "a", "--form", "round").startswith("retrieve train: Invalid value for '--form': ")


def test_plan_refuses_a_model_that_it_can_not_use(tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    code, _, err = retrieve("plan", "x.jsonl", "--policy", "local", "--model", tmp_path)
    networks = "neural, neural-greedy, neural-paper, osnet-only, osnet-only-paper, rpnet-only, rpnet-only-paper"
    assert (code, err) == (2, f"plan: --model: the policy local asks no network; {networks} do\n")
    code, _, err = retrieve("plan", "x.jsonl", "--policy", "neural", "--model", tmp_path)
    assert (code, err.split(";")[0]) == (2, f"plan: --model: {tmp_path}: has no config.json")


def test_a_curve_in_one_line() -> None:
    assert sparkline([3, 2, 1]) == "█▅▁"
    assert sparkline([1, 1]) == "▁▁"
    assert len(sparkline(list(range(100)))) == 40


def test_a_run_begins_with_the_weights_of_a_model(labels: Path, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    """At a learning rate of next to nothing they stay as they were; with another form or width they are refused."""
    assert retrieve("train", labels, "-o", tmp_path / "first", *FAST)[0] == 0
    gentle = ("--learning-rate", "1e-6", "--from", tmp_path / "first")
    assert retrieve("train", labels, "-o", tmp_path / "second", *FAST, *gentle)[0] == 0
    first, second = (load_file(tmp_path / which / "rpnet.safetensors") for which in ("first", "second"))
    assert all(np.abs(first[key] - second[key]).max() < 1e-3 for key in first)
    assert any(np.abs(first[key] - second[key]).max() > 0 for key in first)
    config = json.loads((tmp_path / "second" / "config.json").read_text())
    assert config["settings"]["began_with"]
    code, _, err = retrieve("train", labels, "-o", tmp_path / "third", *FAST, "--width", "32", *gentle)
    assert (code, "the networks to begin with have (" in err) == (2, True)
    code, _, err = retrieve("train", labels, "-o", tmp_path / "fourth", *FAST, "--form", "paper", *gentle)
    assert (code, "networks of the form objects; train those with --form objects" in err) == (2, True)


def test_heads_that_older_networks_lack_are_new(labels: Path, tmp_path: Path, retrieve: Callable[..., Spoken]) -> None:
    from planning.learning.training.settings import Settings
    from planning.learning.training.train import make_net

    settings = Settings(width=16)
    old = {key: w.numpy() for key, w in make_net("osnet", replace(settings, seed=5)).state_dict().items()}
    old |= {key: old[key][:3] for key in ("head.2.weight", "head.2.bias")}
    net = make_net("osnet", settings, old).state_dict()
    fresh = make_net("osnet", settings).state_dict()
    assert all(np.array_equal(net[key][: len(w)], w) for key, w in old.items())
    assert np.array_equal(net["head.2.weight"][3], fresh["head.2.weight"][3])


def test_what_is_left_is_said_in_a_fitting_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    pace = Pace(3)
    now[0] = 10.0
    pace.step(5)
    assert str(pace) == "5 in all, 30 a minute; 2 scenes and about 20 s left"
    pace.step(1)
    pace.step(0)
    assert str(pace) == "6 in all, 36 a minute"
    assert [span(s) for s in (0.4, 89.0, 91.0, 5300.0, 9000.0)] == ["0 s", "89 s", "2 min", "88 min", "2.5 h"]
