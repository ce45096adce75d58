"""Joint values by name, and whether they are within their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kinematics.errors import did_you_mean
from kinematics.transforms import Array

WITHIN = 1e-6
"""A joint this little beyond its limit, in rad or m, was rounded."""


def with_joints(names: Sequence[str], q: Array, values: Mapping[str, float], where: str) -> Array:
    """q (J,) with some joints' values set by name. Raises ValueError, which begins with `where`, for a name that is not there."""
    out = q.copy()
    for name, value in values.items():
        if name not in names:
            raise ValueError(f"{where}: there is no joint {name!r}{did_you_mean(name, names)}; the actuated joints are {', '.join(names)}")
        out[names.index(name)] = value
    return np.asarray(out)


def beyond_limits(names: Sequence[str], q: Array, lower: Array, upper: Array) -> str | None:
    """Which joint of q (J,) is outside its limits (J,), in words; None when all are within. One that was rounded counts as within."""
    for name, value, low, high in zip(names, q, lower, upper):
        if not low - WITHIN <= value <= high + WITHIN:
            return f"joint {name} is at {value:.4g}, outside its limits {low:.4g} to {high:.4g} (rad, or m)"
    return None
