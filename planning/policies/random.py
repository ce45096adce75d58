"""The paper's first baseline: a random object to a random valid, collision-free region."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from perception.observation import Observation
from planning.policies.regions import free_regions


def random_object(seen: Observation, rng: np.random.Generator) -> Sequence[str]:
    """The non-target objects in random order."""
    names = seen.movable
    return [names[i] for i in rng.permutation(len(names))]


def random_region(seen: Observation, name: str, rng: np.random.Generator) -> Sequence[int]:
    """The observed regions where the object would touch no other, in random order."""
    return [int(i) for i in rng.permutation(free_regions(seen, name))]
