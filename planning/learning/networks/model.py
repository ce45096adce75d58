"""A trained pair of networks: the folder it lives in, and what it says about an observation.

A model folder holds osnet.safetensors, rpnet.safetensors and config.json: `from_pretrained` needs these and nothing more, not even torch.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from kinematics.scene import APPROACHES
from perception.observation import Observation
from planning.learning.networks import numpy_inference
from planning.learning.networks.numpy_inference import Encoding, Weights, sigmoid
from planning.learning.networks.scores import NEAREST_TRIED, object_score, region_score
from planning.learning.networks.tokens import F32, LENGTH_M, tokens

SCHEMA = "retrieve/model@2"
OLDER = "retrieve/model@1"
"""Whose `objects` form looks one step ahead: `first` and `shorter` are unknown to it."""
FORMS = ("objects", "paper")
NETS = ("osnet", "rpnet")
WEIGHTS = Path(__file__).parents[1] / "weights"


@dataclass(frozen=True, eq=False)
class Chosen:
    """What OSNet says, one number an object in the order of `names`.

    p: the share of the blocked paths that each blocks. pickable: the chance that it can be picked now. opens: the chance that the target
    is free once it is gone. first: the chance that it goes first in a shortest relaxed plan. The `paper` form knows p alone; the others are
    NaN, as is `first` by older weights. score: larger is better.
    """

    names: tuple[str, ...]
    p: F32
    pickable: F32
    opens: F32
    first: F32
    score: F32

    @property
    def ranking(self) -> list[str]:
        """The names, the one to move first in front."""
        return [self.names[i] for i in np.argsort(-self.score, kind="stable")]


@dataclass(frozen=True, eq=False)
class Placed:
    """What RPNet says, one number for each of `regions` (indices).

    cost: ĉ. feasible: the chance that the object can be carried there. hits: the share of the paths that it would block there. shorter:
    the chance that fewer moves are needed then. distance: from where the object stands, in floor diagonals. The `paper` form knows the cost
    alone; the others are NaN, as is `shorter` by older weights. score: larger is better.
    """

    regions: NDArray[np.intp]
    cost: F32
    feasible: F32
    hits: F32
    shorter: F32
    distance: F32
    score: F32

    @property
    def ranking(self) -> list[int]:
        """The regions, the best in front."""
        return [int(i) for i in self.regions[np.argsort(-self.score, kind="stable")]]

    @property
    def nearby(self) -> Placed:
        """The same for who tries what comes next: near regions count for more. The `paper` form's cost is the distance as it is."""
        if np.isnan(self.distance).any():
            return self
        return replace(self, score=region_score(self.feasible, self.hits, self.distance, NEAREST_TRIED))


_BLAS = ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """Within it numpy's matrix products run on one thread, whatever the process is set to: to wake up others takes a hundred times as long
    as products as small as these. It costs 8 µs."""
    return cast(AbstractContextManager[object], _BLAS.limit(limits=1, user_api="blas"))


class Seen:
    """One observation as the networks see it; what does not depend on the chosen object is computed once."""

    def __init__(self, model: Model, seen: Observation) -> None:
        self.model, self.observation, self.tokens = model, seen, tokens(seen)
        self._encoding: Encoding | None = None

    def select(self) -> Chosen:
        """OSNet's say on every non-target object."""
        model, names = self.model, self.observation.movable
        if not names:
            return Chosen((), *np.zeros((5, 0), np.float32))
        if model.form == "paper":
            with one_thread():
                p = sigmoid(numpy_inference.paper_osnet(model.osnet, self.tokens, model.heads)[:, 0])
            unknown = np.full_like(p, np.nan)
            return Chosen(names, p, unknown, unknown, unknown, p)
        with one_thread():
            p, pickable, opens, *ahead = sigmoid(numpy_inference.osnet(model.osnet, self.tokens, model.heads)).T
        first = ahead[0] if ahead else np.full_like(p, np.nan)
        return Chosen(names, p, pickable, opens, first, object_score(p, pickable, opens, *ahead))

    def place(self, name: str, regions: Sequence[int] | NDArray[np.intp] | None = None) -> Placed:
        """RPNet's say on the regions (all by default) for one object. The `paper` form always answers for all of them at once."""
        model, t = self.model, self.tokens
        index = np.arange(len(t.regions)) if regions is None else np.asarray(regions, np.intp)
        moved = 1 + self.observation.movable.index(name)
        if model.form == "paper":
            with one_thread():
                self._encoding = self._encoding or numpy_inference.paper_rpnet_encode(model.rpnet, t, model.heads)
                cost = sigmoid(numpy_inference.paper_rpnet(model.rpnet, self._encoding, moved, model.heads))[index]
            unknown = np.full_like(cost, np.nan)
            return Placed(index, cost, unknown, unknown, unknown, unknown, -cost)
        if len(index) == 0:
            return Placed(index, *np.zeros((6, 0), np.float32))
        with one_thread():
            self._encoding = self._encoding or numpy_inference.rpnet_encode(model.rpnet, t, model.heads)
            cost, feasible, hits, *ahead = sigmoid(numpy_inference.rpnet(model.rpnet, self._encoding, moved, index, model.heads)).T
        shorter = ahead[0] if ahead else np.full_like(cost, np.nan)
        away = np.linalg.norm(t.regions[index, :2] - t.boxes[moved, :2], axis=1) / np.linalg.norm(t.context[3:5])
        return Placed(index, cost, feasible, hits, shorter, away, region_score(feasible, hits, away))


@dataclass(frozen=True, eq=False)
class Model:
    """Both networks. form: `objects` or `paper`; robot: the one that they were trained for; config: all that config.json says."""

    form: str
    robot: str
    heads: int
    osnet: Weights
    rpnet: Weights
    config: Mapping[str, Any]

    def see(self, seen: Observation) -> Seen:
        """An observation, ready to be asked about objects and regions."""
        return Seen(self, seen)

    def select(self, seen: Observation) -> Chosen:
        """OSNet's say on every non-target object."""
        return self.see(seen).select()

    def place(self, seen: Observation, name: str) -> Placed:
        """RPNet's say on every region for the object `name`."""
        return self.see(seen).place(name)


def from_pretrained(folder: str | Path) -> Model:
    """The model in a folder. Raises ValueError that says what is missing or does not fit."""
    from safetensors import SafetensorError
    from safetensors.numpy import load_file

    folder = Path(folder)
    config = _config(folder)
    weights: dict[str, dict[str, F32]] = {}
    for net in NETS:
        file = folder / f"{net}.safetensors"
        if not file.is_file():
            raise ValueError(f"{file}: no such file; a model folder holds {', '.join(f'{n}.safetensors' for n in NETS)} and config.json")
        try:
            weights[net] = load_file(file)
        except SafetensorError as e:
            raise ValueError(f"{file}: is no safetensors file, or was cut off: {e}") from e
        expected = config["shapes"][net]
        shapes = {name: list(w.shape) for name, w in weights[net].items()}
        for name in sorted(set(shapes) | set(expected)):
            if shapes.get(name) != expected.get(name):
                raise ValueError(f"{file}: {name}: {shapes.get(name, 'is missing')}, and config.json says {expected.get(name, 'nothing')}")
        for name, w in weights[net].items():
            if w.dtype.kind != "f" or not np.isfinite(w).all():
                raise ValueError(f"{file}: {name}: holds what is no finite number; train it again")
    turned = {net: numpy_inference.turned(w) for net, w in weights.items()}
    return Model(config["form"], config["robot"], int(config["heads"]), turned["osnet"], turned["rpnet"], config)


@lru_cache(maxsize=4)
def once_loaded(folder: str) -> Model:
    """`from_pretrained`, and the same model again for the next scene."""
    return from_pretrained(folder)


def ships(robot: str, form: str = "objects") -> bool:
    """Whether networks of a form ship for a named robot."""
    return (_shipped(robot, form) / "config.json").is_file()


def shipped(robot: str, form: str = "objects") -> Model:
    """The model of a form that ships for a named robot. Raises ValueError, saying what to do instead, when there is none."""
    if not ships(robot, form):
        configs = [json.loads(file.read_text(encoding="utf-8")) for file in WEIGHTS.glob("*/config.json")]
        have = ", ".join(sorted(config["robot"] for config in configs if config["form"] == form))
        how = "" if form == FORMS[0] else f" --form {form}"
        raise ValueError(
            f"no networks{f' of the form {form}' if how else ''} ship for the robot {robot} "
            f"({f'only for {have}' if have else 'nor for any other'}): name a model of yours with --model "
            f"(retrieve label --robot {robot} -o labels/; retrieve train labels/ -o model/{how}), or plan with --policy local"
        )
    return once_loaded(str(_shipped(robot, form)))


def _shipped(robot: str, form: str) -> Path:
    """weights/ROBOT, and weights/ROBOT-FORM for other forms than the first."""
    return WEIGHTS / (robot if form == FORMS[0] else f"{robot}-{form}")


def describe(form: str, heads: int, shapes: Mapping[str, Mapping[str, list[int]]], robot: str, about: Mapping[str, Any]) -> dict[str, Any]:
    """What config.json says: the schema, the form, the sizes, how inputs are normalised, and `about`: data, settings, versions, metrics."""
    normalisation = {"frame": "cabinet", "length_m": LENGTH_M, "rotation": "first two columns", "approaches": list(APPROACHES)}
    return {"schema": SCHEMA, "form": form, "robot": robot, "heads": heads, "normalisation": normalisation, **about, "shapes": shapes}


def _config(folder: Path) -> dict[str, Any]:
    file = folder / "config.json"
    if not file.is_file():
        what = "has no config.json" if folder.is_dir() else "no such folder"
        raise ValueError(f"{folder}: {what}; a model folder is what retrieve train labels/ -o model/ writes")
    try:
        config = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as e:
        raise ValueError(f"{file}: broken JSON: {e}") from e
    schema = config.get("schema") if isinstance(config, dict) else None
    kind, _, version = str(schema).partition("@")
    if kind != "retrieve/model" or not version.isdigit():
        raise ValueError(f"{file}: schema: {schema!r} is not {SCHEMA}")
    if schema not in (SCHEMA, OLDER):
        age = "new" if int(version) > int(SCHEMA.partition("@")[2]) else "old"
        raise ValueError(f"{file}: schema: {schema} is too {age} for this version, which reads {SCHEMA} and {OLDER}")
    for key in ("form", "robot", "heads", "shapes", "normalisation"):
        if key not in config:
            raise ValueError(f"{file}: {key} is missing")
    if config["form"] not in FORMS:
        raise ValueError(f"{file}: form: {config['form']!r} is none of {', '.join(FORMS)}")
    length_m = config["normalisation"].get("length_m") if isinstance(config["normalisation"], dict) else None
    if length_m != LENGTH_M:
        raise ValueError(f"{file}: normalisation.length_m: {length_m} is not {LENGTH_M}, which this version uses")
    if not isinstance(config["robot"], str):
        raise ValueError(f"{file}: robot: {config['robot']!r} is no name")
    if isinstance(config["heads"], bool) or not isinstance(config["heads"], int) or not 1 <= config["heads"] <= 64:
        raise ValueError(f"{file}: heads: {config['heads']!r} is no whole number from 1 to 64")
    shapes = config["shapes"]
    if not isinstance(shapes, dict) or not all(isinstance(shapes.get(net), dict) for net in NETS):
        raise ValueError(f"{file}: shapes: no table of weights for {' and '.join(NETS)}")
    heads = 1 if config["form"] == "paper" else 3 if schema == OLDER else 4
    for net in NETS:
        if shapes[net].get("head.2.bias") != [heads]:
            raise ValueError(f"{file}: shapes: {net}: head.2.bias: {shapes[net].get('head.2.bias')} is not [{heads}], what it has to say")
    return config  # type: ignore[no-any-return]
