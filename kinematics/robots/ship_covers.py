"""`python -m kinematics.robots.ship_covers`: the sphere covers of every named robot's hulls, in the file that ships with the package."""

from __future__ import annotations

import io
import zipfile

import numpy as np

from kinematics.collision.covers import levels as cover_levels
from kinematics.robots.load import load
from kinematics.robots.named import named_robots
from kinematics.transforms import Array

EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time that the file's parts bear, so that the same covers are the same bytes."""


def hulls() -> list[Array]:
    """The vertices (V, 3) of every hull of every named robot. Raises: ValueError when one's package is not installed."""
    return [hull.vertices for name in named_robots() for hull in load(name).hulls]


def main() -> None:
    """Derive the covers of the named robots' hulls and write the file that ships."""
    made = dict(cover_levels.derived(vertices) for vertices in hulls())
    with zipfile.ZipFile(cover_levels.SHIPPED, "w", zipfile.ZIP_DEFLATED) as out:
        for name in sorted(made):
            for array, values in made[name].items():
                data = io.BytesIO()
                np.save(data, values)
                out.writestr(zipfile.ZipInfo(f"{name}/{array}.npy", EPOCH), data.getvalue())
    print(f"{cover_levels.SHIPPED}: covers of {len(made)} hulls, {cover_levels.SHIPPED.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
