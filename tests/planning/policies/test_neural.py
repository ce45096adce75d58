"""The networks' halves with a model whose scores are written down: its ranking is followed, and an observation is encoded once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from fakes import observation

from perception.observation import Observation
from planning.learning.networks.model import Chosen, Placed
from planning.learning.networks.scores import region_score
from planning.policies.neural import CachedEncoding, make_neural_object, make_neural_preferences, make_neural_region
from planning.policies.regions import free_regions

RNG = np.random.default_rng(0)
SCORES = {"a": 0.2, "b": 0.9, "c": 0.5}
SIZE = (0.06, 0.06, 0.12)
SEEN = observation({"a": (0.05, 0.15, 0.06, *SIZE), "b": (0.15, -0.15, 0.06, *SIZE), "target": (0.35, 0.0, 0.06, *SIZE),
                    "c": (0.25, 0.15, 0.06, *SIZE)})  # fmt: skip


@dataclass
class WrittenModel:
    """Stands for `Model`: scores by name for objects, by index for regions; what it is shown and asked is noted,
    and how often it chose an object."""

    form: str
    shown: list[Observation] = field(default_factory=list)
    asked: list[tuple[str, list[int] | None]] = field(default_factory=list)
    chosen: int = 0

    def see(self, seen: Observation) -> WrittenView:
        self.shown.append(seen)
        return WrittenView(self, seen)


@dataclass
class WrittenView:
    model: WrittenModel
    observation: Observation

    def select(self) -> Chosen:
        names = self.observation.movable
        self.model.chosen += 1
        return Chosen(names, *[np.zeros(len(names), np.float32)] * 4, np.array([SCORES[n] for n in names], np.float32))

    def place(self, name: str, regions: Sequence[int] | None = None) -> Placed:
        self.model.asked.append((name, None if regions is None else list(regions)))
        index = np.arange(len(self.observation.regions)) if regions is None else np.asarray(regions, np.intp)
        away = np.array([(5 * i) % 16 for i in index], np.float32) / 16
        if self.model.form == "paper":
            away[:] = np.nan
        return Placed(index, *[np.zeros(len(index), np.float32)] * 4, away, np.array([(7 * i) % 16 for i in index], np.float32))


def halves(form: str) -> tuple[WrittenModel, CachedEncoding, Any, Any]:
    model = WrittenModel(form)
    encoding = CachedEncoding(model)  # type: ignore[arg-type]
    return model, encoding, make_neural_object(encoding), make_neural_region(encoding)


def test_objects_by_their_scores_the_best_first() -> None:
    _, _, select, _ = halves("objects")
    assert list(select(SEEN, RNG)) == ["b", "c", "a"]


def test_the_object_form_ranks_the_free_regions() -> None:
    model, _, _, place = halves("objects")
    free = free_regions(SEEN, "b").tolist()
    assert len(free) < 16
    assert list(place(SEEN, "b", RNG)) == sorted(free, key=lambda i: -((7 * i) % 16))
    assert model.asked == [("b", free)]


def test_the_printed_form_ranks_all_regions() -> None:
    """The paper's RPNet gives the occupied ones the maximum cost itself."""
    model, _, _, place = halves("paper")
    assert list(place(SEEN, "a", RNG)) == sorted(range(16), key=lambda i: -((7 * i) % 16))
    assert model.asked == [("a", None)]


def test_an_observation_is_encoded_once_for_both_halves() -> None:
    model, encoding, select, place = halves("objects")
    other = observation({"a": (0.05, 0.15, 0.06, *SIZE), "target": (0.35, 0.0, 0.06, *SIZE)})
    select(SEEN, RNG), place(SEEN, "b", RNG), place(SEEN, "a", RNG)
    assert encoding.of(SEEN) is encoding.of(SEEN)
    assert model.shown == [SEEN]
    assert list(select(other, RNG)) == ["a"]
    assert list(place(SEEN, "c", RNG))
    assert model.shown == [SEEN, other, SEEN]
    assert encoding.model is model  # type: ignore[comparison-overlap]


def test_a_look_ahead_asks_the_networks_when_it_needs_them_and_once() -> None:
    """Objects cost the less, the better their score; nothing is asked before a cost is. Among regions that are as likely to do, near ones
    come first where few moves are to come."""
    model, encoding, _, place = halves("objects")
    preferences = make_neural_preferences(encoding)
    cost = preferences.objects(SEEN)
    assert (model.shown, model.chosen) == ([], 0)
    assert {name: cost(name) for name in "abc"} == pytest.approx({"a": -0.2, "b": -0.9, "c": -0.5})
    assert (model.shown, model.chosen) == ([SEEN], 1)
    assert list(preferences.regions_with(3)(SEEN, "b", RNG)) == sorted(free_regions(SEEN, "b").tolist(), key=lambda i: (5 * i) % 16)
    assert list(preferences.regions_with(4)(SEEN, "b", RNG)) == list(preferences.regions(SEEN, "b", RNG)) == list(place(SEEN, "b", RNG))


def test_where_motions_are_tried_a_metre_weighs_more_than_a_doubt() -> None:
    """A region half a floor nearer is worth a lower chance, but not none at all; what is printed keeps its order."""
    feasible, hits, distance = np.array([0.95, 0.7, 0.0], np.float32), np.zeros(3, np.float32), np.array([0.6, 0.1, 0.1], np.float32)
    placed = Placed(np.arange(3), hits, feasible, hits, hits, distance, region_score(feasible, hits, distance))
    assert (placed.ranking, placed.nearby.ranking) == ([0, 1, 2], [1, 0, 2])
    _, encoding, _, place = halves("paper")
    assert list(make_neural_preferences(encoding).regions_with(1)(SEEN, "b", RNG)) == list(place(SEEN, "b", RNG))
