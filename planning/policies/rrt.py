"""The planner that the paper's source has commented out: OSNet's and RPNet's labels instead of the networks.

RRT-Connect finds several paths to x_g that ignore the other objects. The object that blocks most of them is moved, to the nearest free
region where it would block none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.transforms import apply, inverse
from perception.observation import Observation
from planning.learning.labelling.labels import PathsToTarget, paths_met, paths_to_target
from planning.motion.pick_place import Motions
from planning.policies.regions import nearest_regions

PATHS = 16


class CountedPaths:
    """Paths to x_g of one scene, found once, and how many of them each object blocks in the latest state: where it stands (m,), and over
    each region (m, B)."""

    def __init__(self, motions: Motions) -> None:
        self.motions = motions
        self._paths: PathsToTarget | None = None
        self._seen: Observation | None = None

    def of(self, seen: Observation, rng: np.random.Generator) -> tuple[Int, NDArray[np.int64]]:
        motions = self.motions
        if self._seen is not seen:
            state = motions.state
            if self._paths is None:
                self._paths = paths_to_target(motions, state, rng, PATHS)
            cells = apply(inverse(seen.cabinet.T_world_cabinet), seen.regions[:, :3])
            self._seen, self._counts = seen, paths_met(motions, state, seen.movable, cells, self._paths)
        return self._counts


def make_rrt_object(paths: CountedPaths) -> Callable[[Observation, np.random.Generator], Sequence[str]]:
    """select: the objects that block paths, those that block most in front."""

    def rrt_object(seen: Observation, rng: np.random.Generator) -> Sequence[str]:
        blocks, _ = paths.of(seen, rng)
        return [seen.movable[i] for i in np.argsort(-blocks, kind="stable") if blocks[i]]

    return rrt_object


def make_rrt_region(paths: CountedPaths) -> Callable[[Observation, str, np.random.Generator], Sequence[int]]:
    """place: the free regions where the object blocks no path, the nearest to where it stands in front."""

    def rrt_region(seen: Observation, name: str, rng: np.random.Generator) -> Sequence[int]:
        _, hits = paths.of(seen, rng)
        of_this = hits[seen.movable.index(name)]
        return [i for i in nearest_regions(seen, name, rng) if of_this[i] == 0]

    return rrt_region
