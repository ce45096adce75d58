"""The model folder and the policies that ask it: no torch, errors that say what is wrong, an order that follows the scores."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file
from test_networks import FORMS, SMALL, observation

from planning.learning.networks.model import NETS, WEIGHTS, Model, describe, from_pretrained, shipped
from planning.learning.networks.scores import object_score
from planning.learning.training.train import make_net
from planning.policies import NETWORKS, POLICIES, make_policy
from planning.policies.regions import free_regions

ROOT = Path(__file__).resolve().parents[4]
UR5E = Model("objects", "ur5e", 4, {}, {}, {})


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """Writes a model folder of untrained networks."""

    def write(form: str = "objects", **config: Any) -> Path:
        out, shapes = tmp_path / form, {}
        out.mkdir()
        for name in ("osnet", "rpnet"):
            settings = SMALL.__class__(**{**vars(SMALL), "form": form})
            weights = {k: v.numpy() for k, v in make_net(name, settings).state_dict().items()}
            save_file(weights, out / f"{name}.safetensors")
            shapes[name] = {k: list(v.shape) for k, v in weights.items()}
        (out / "config.json").write_text(json.dumps({**describe(form, 4, shapes, "ur5e", {}), **config}))
        return out

    return write


def motions(robot: str = "ur5e") -> Any:
    return SimpleNamespace(robot=SimpleNamespace(name=robot))


@pytest.mark.parametrize("form", FORMS)
def test_a_model_ranks_all_objects_and_regions(form: str, folder: Callable[..., Path]) -> None:
    model, seen, rng = from_pretrained(folder(form)), observation(), np.random.default_rng(0)
    chosen = model.select(seen)
    assert chosen.names == seen.movable
    assert sorted(chosen.ranking) == sorted(seen.movable)
    assert [chosen.score[chosen.names.index(n)] for n in chosen.ranking] == sorted(chosen.score, reverse=True)
    assert np.isnan(chosen.opens).all() == np.isnan(chosen.first).all() == (form == "paper")
    name = seen.movable[1]
    placed = model.place(seen, name)
    assert sorted(placed.ranking) == list(range(len(seen.regions)))
    assert (((placed.cost > 0) & (placed.cost < 1)).all(), np.isnan(placed.feasible).all()) == (True, form == "paper")
    some = model.see(seen).place(name, [5, 2])
    np.testing.assert_allclose(some.cost, placed.cost[[5, 2]], atol=1e-5)
    assert set(some.ranking) == {2, 5}
    policy = make_policy("neural-greedy", motions(), model=model)
    assert list(policy.select(seen, rng)) == chosen.ranking
    expected = set(range(len(seen.regions))) if form == "paper" else set(free_regions(seen, name))
    assert set(policy.place(seen, name, rng)) == expected
    assert len(expected) > 3


@pytest.mark.parametrize("form", FORMS)
def test_a_new_observation_is_looked_at_anew(form: str, folder: Callable[..., Path]) -> None:
    model, rng = from_pretrained(folder(form)), np.random.default_rng(0)
    policy = make_policy("neural-greedy", motions(), model=model)
    one, two = observation(0), observation(3)
    name = one.movable[0]
    ranked = {}
    for seen in (one, two, one):
        assert list(policy.select(seen, rng)) == model.select(seen).ranking
        regions = list(policy.place(seen, name, rng))
        assert regions == model.see(seen).place(name, None if form == "paper" else free_regions(seen, name)).ranking
        assert ranked.setdefault(id(seen), regions) == regions
    assert ranked[id(one)] != ranked[id(two)]


def test_older_networks_go_on_looking_one_step_ahead(folder: Callable[..., Path]) -> None:
    """Weights of model@1 have no head that knows the horizon: all else is said as before."""
    old, seen = folder(), observation()
    said = from_pretrained(old).select(seen)
    config = json.loads((old / "config.json").read_text())
    for name in NETS:
        weights = load_file(old / f"{name}.safetensors")
        weights |= {key: weights[key][:3] for key in ("head.2.weight", "head.2.bias")}
        save_file(weights, old / f"{name}.safetensors")
        config["shapes"][name] = {k: list(v.shape) for k, v in weights.items()}
    (old / "config.json").write_text(json.dumps({**config, "schema": "retrieve/model@1"}))
    model = from_pretrained(old)
    chosen, placed = model.select(seen), model.place(seen, seen.movable[0])
    np.testing.assert_allclose(chosen.opens, said.opens, atol=1e-5)
    assert np.isnan(chosen.first).all()
    assert np.isnan(placed.shorter).all()
    np.testing.assert_array_equal(chosen.score, object_score(chosen.p, chosen.pickable, chosen.opens))


def test_a_scene_without_other_objects_is_no_trouble(folder: Callable[..., Path]) -> None:
    model, seen = from_pretrained(folder()), observation()
    alone = SimpleNamespace(**vars(seen), movable=())
    alone.boxes = {"target": seen.boxes["target"]}
    assert model.select(alone).ranking == []
    assert model.see(seen).place(seen.movable[0], []).ranking == []


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:200])


def drop_a_tensor(file: Path) -> None:
    weights = load_file(file)
    weights.pop("head.0.weight")
    save_file(weights, file)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda d: (d / "config.json").unlink(), "has no config.json; a model folder is what retrieve train"),
        (lambda d: (d / "config.json").write_text("{"), "config.json: broken JSON"),
        (lambda d: (d / "rpnet.safetensors").unlink(), r"rpnet\.safetensors: no such file; a model folder holds osnet\.safetensors"),
        (lambda d: cut(d / "osnet.safetensors"), r"osnet\.safetensors: is no safetensors file, or was cut off"),
        (
            lambda d: drop_a_tensor(d / "osnet.safetensors"),
            r"osnet\.safetensors: head\.0\.weight: is missing, and config\.json says \[16, 16\]",
        ),
    ],
)
def test_a_damaged_folder_says_what_is_wrong(damage: Callable[[Path], object], says: str, folder: Callable[..., Path]) -> None:
    out = folder()
    damage(out)
    with pytest.raises(ValueError, match=says):
        from_pretrained(out)


@pytest.mark.parametrize(
    ("config", "says"),
    [
        ({"schema": "retrieve/model@3"}, "retrieve/model@3 is too new for this version, which reads retrieve/model@2 and retrieve/model@1"),
        ({"schema": "retrieve/model@1"}, r"osnet: head\.2\.bias: \[4\] is not \[3\]"),
        ({"schema": "retrieve/model@0"}, "is too old for this version"),
        ({"schema": "retrieve/plan@1"}, "is not retrieve/model@2"),
        ({"form": "circles"}, "'circles' is none of objects, paper"),
        ({"normalisation": {"length_m": 1.0}}, "length_m: 1.0 is not 0.3"),
        ({"normalisation": None}, "length_m: None is not 0.3"),
        ({"heads": None}, "heads: None is no whole number from 1 to 64"),
        ({"heads": 0}, "heads: 0 is no whole number from 1 to 64"),
        ({"heads": "4"}, "heads: '4' is no whole number from 1 to 64"),
        ({"heads": 1e9}, "heads: 1000000000.0 is no whole number"),
        ({"shapes": []}, "shapes: no table of weights for osnet and rpnet"),
        ({"robot": 7}, "robot: 7 is no name"),
    ],
)
def test_a_config_of_another_kind_is_refused(config: dict[str, Any], says: str, folder: Callable[..., Path]) -> None:
    with pytest.raises(ValueError, match=says):
        from_pretrained(folder(**config))


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such folder; a model folder is what retrieve train"):
        from_pretrained(tmp_path / "nowhere")


def test_a_robot_without_networks_is_told_what_to_do() -> None:
    says = r"no networks ship for the robot xarm6 \(only for gen3, panda, ur5e\).*retrieve train labels/ -o model/.*--policy local"
    with pytest.raises(ValueError, match=says):
        shipped("xarm6")
    for name in NETWORKS:
        form = " of the form paper" if name.endswith("-paper") else ""
        with pytest.raises(ValueError, match=f"no networks{form} ship for the robot xarm6"):
            make_policy(name, motions("xarm6"))
        if form:
            with pytest.raises(ValueError, match="asks networks of the form paper, and this model's are of the form objects"):
                make_policy(name, motions("xarm6"), model=UR5E)
            continue
        with pytest.raises(ValueError, match="trained for the robot ur5e, and this scene's is xarm6"):
            make_policy(name, motions("xarm6"), model=UR5E)
    assert set(NETWORKS) < set(POLICIES)


@pytest.mark.parametrize("folder", sorted(p.parent for p in WEIGHTS.glob("*/config.json")), ids=lambda p: p.name)
def test_shipped_networks_are_whole(folder: Path) -> None:
    model = from_pretrained(folder)
    assert shipped(model.robot, model.form).config == model.config
    assert model.select(observation()).names


def test_shipped_networks_are_small() -> None:
    assert sum(f.stat().st_size for f in WEIGHTS.glob("*/*")) < 12e6


def test_inference_needs_no_torch(folder: Callable[..., Path]) -> None:
    code = (
        f"import sys; from planning.learning.networks.model import from_pretrained; from planning.policies import neural; "
        f"from_pretrained({str(folder())!r}); print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_weights_that_are_no_numbers_are_refused(folder: Callable[..., Path]) -> None:
    model = folder()
    weights = load_file(model / "rpnet.safetensors")
    next(iter(weights.values())).flat[0] = np.nan
    save_file(weights, model / "rpnet.safetensors")
    with pytest.raises(ValueError, match=r"rpnet.safetensors: .* holds what is no finite number"):
        from_pretrained(model)


def test_the_networks_run_on_one_thread_whatever_the_process_is_set_to(folder: Callable[..., Path]) -> None:
    """In the library, where numpy was imported long before, and its threads may be the user's choice."""
    code = f"""if True:
        import numpy, threadpoolctl
        from planning.learning.networks import model
        from test_networks import observation
        told = []
        for form in {list(FORMS)!r}:
            threads = lambda: max(lib["num_threads"] for lib in threadpoolctl.threadpool_info() if "numpy" in lib["filepath"])
            matmul = model.numpy_inference._linear
            def linear(*args):
                told.append(threads())
                return matmul(*args)
            model.numpy_inference._linear = linear
            seen = observation()
            asked = model.from_pretrained({str(folder("objects").parent)!r} + "/" + form)
            asked.select(seen), asked.place(seen, seen.movable[0])
            model.numpy_inference._linear = matmul
        print(threads(), sorted(set(told)), len(told) > 10)
    """
    folder("paper")
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "2", "PYTHONPATH": os.pathsep.join(sys.path)}
    said = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True).stdout
    assert said.split("\n")[0] == "2 [1] True"


def test_a_command_has_one_thread_from_the_beginning() -> None:
    code = "import retrieve_cli.__main__, numpy, threadpoolctl; print([lib['num_threads'] for lib in threadpoolctl.threadpool_info()])"
    env = {**{k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}, "PYTHONPATH": os.pathsep.join(sys.path)}
    assert subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True).stdout == "[1]\n"
