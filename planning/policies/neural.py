"""The paper's planner: OSNet says which object to move, RPNet where to put it. Each can also stand in for half of the local baseline."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from perception.observation import Observation
from planning.learning.networks.model import Chosen, Model, Placed, Seen
from planning.policies.regions import free_regions
from planning.policies.search import Preferences


class CachedEncoding:
    """The networks' view of the latest observation, computed once for all that is asked about it."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self._view: Seen | None = None

    def of(self, seen: Observation) -> Seen:
        if self._view is None or self._view.observation is not seen:
            self._view = self.model.see(seen)
        return self._view


def make_neural_object(encoding: CachedEncoding) -> Callable[[Observation, np.random.Generator], Sequence[str]]:
    """select: all non-target objects, the best score in front; the `paper` form's score is p̂."""

    def neural_object(seen: Observation, rng: np.random.Generator) -> Sequence[str]:
        return encoding.of(seen).select().ranking

    return neural_object


def make_neural_region(encoding: CachedEncoding) -> Callable[[Observation, str, np.random.Generator], Sequence[int]]:
    """place: `paper` form, all regions, the least ĉ in front, as printed; `objects` form, the free ones, the best score in front."""

    def neural_region(seen: Observation, name: str, rng: np.random.Generator) -> Sequence[int]:
        return _placed(encoding, seen, name).ranking

    return neural_region


def _placed(encoding: CachedEncoding, seen: Observation, name: str) -> Placed:
    regions = None if encoding.model.form == "paper" else free_regions(seen, name)
    return encoding.of(seen).place(name, regions)


def make_neural_preferences(encoding: CachedEncoding) -> Preferences:
    """The networks' say as a look ahead's preferences: objects by their scores, regions in RPNet's order, where few moves are to come the
    near ones before those that are a little likelier."""

    def cost(seen: Observation) -> Callable[[str], float]:
        chosen: Chosen | None = None

        def of(name: str) -> float:
            nonlocal chosen
            chosen = chosen or encoding.of(seen).select()
            return -float(chosen.score[chosen.names.index(name)])

        return of

    def nearby(seen: Observation, name: str, rng: np.random.Generator) -> Sequence[int]:
        return _placed(encoding, seen, name).nearby.ranking

    return Preferences(cost, make_neural_region(encoding), nearby)
