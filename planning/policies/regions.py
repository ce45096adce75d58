"""Which regions an object may go to, judged by the observed boxes alone."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Int
from kinematics.transforms import apply, inverse
from perception.observation import Observation

GAP_M = 0.005


def free_regions(seen: Observation, name: str) -> Int:
    """Indices of the observed regions where the object's box, moved to the cell's centre, keeps clear of the walls and all other boxes."""
    size, centre = seen.boxes[name][3:], seen.regions[:, :3]
    others = np.array([box for other, box in seen.boxes.items() if other != name]).reshape(-1, 6)
    apart = np.abs(centre[:, None, :2] - others[None, :, :2]) >= (size[:2] + others[None, :, 3:5]) / 2 + GAP_M
    T_cabinet = inverse(seen.cabinet.T_world_cabinet)
    local, reach = apply(T_cabinet, centre), np.abs(T_cabinet[:3, :3]) @ size / 2
    depth, width, height = seen.cabinet.size_m
    inside = (local[:, 0] + reach[0] <= depth - GAP_M) & (np.abs(local[:, 1]) + reach[1] <= width / 2 - GAP_M) & (2 * reach[2] <= height)
    inside &= local[:, 0] - reach[0] >= 0.0
    return np.flatnonzero(apart.any(2).all(1) & inside & (seen.regions[:, 3] > 0.5))


def nearest_regions(seen: Observation, name: str, rng: np.random.Generator) -> list[int]:
    """The free regions, the nearest to where the object stands in front. rng: not asked; regions are ordered by functions like this."""
    free = free_regions(seen, name)
    away = np.linalg.norm(seen.regions[free, :2] - seen.boxes[name][:2], axis=1)
    return [int(i) for i in free[np.argsort(away, kind="stable")]]
