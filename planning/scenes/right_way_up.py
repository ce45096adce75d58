"""Which way up a mesh stands: the side that it rests on surely, where its file's own upright axis would let it fall."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from kinematics.shapes import ConvexMesh, convex_parts
from kinematics.transforms import Array
from planning.verdict.polyhedra import centre_of_mass, polyhedra

AXES: Mapping[str, tuple[float, float, float]] = {
    "z": (0, 0, 1), "y": (0, 1, 0), "x": (1, 0, 0), "-z": (0, 0, -1), "-y": (0, -1, 0), "-x": (-1, 0, 0),
}  # fmt: skip
USUAL = ("z", "y")
"""Files have one of them up, as a rule: a bowl whose z is up stands on its foot, though its rim were the surer base."""
SKINS = (0.005, 0.02)
"""What lies within this share of a shape's height of its lowest point is what it rests on; the second for scans that lean a little."""
SURELY = np.radians(9.0)
"""It stands surely if it may be tilted so far. A can that lies on its side rests, by the first skin, on a strip that allows 8 degrees."""


def upright_axis(shape: ConvexMesh) -> tuple[str, bool]:
    """The axis of a mesh's own frame that points up when it stands, and whether it stands surely that way.

    z, or else y, where the shape stands surely on it; else the axis with which it may be tilted furthest before it falls over.
    """
    points, middle = np.concatenate(convex_parts(shape)), centre_of_mass(polyhedra(shape))
    for skin in SKINS:
        tilts = {name: largest_tilt(points, middle, np.array(axis, float), skin) for name, axis in AXES.items()}
        best = next((name for name in USUAL if tilts[name] >= SURELY), max(tilts, key=lambda name: tilts[name]))
        if tilts[best] >= SURELY:
            return best, True
    return best, False


def largest_tilt(points: Array, middle: Array, up: Array, skin: float) -> float:
    """How far (rad) points (V, 3) with their centre of mass at `middle` (3,) may be tilted before they fall, `up` (3,) pointing up.

    Negative where they fall as they are, -pi/2 where they rest on no area at all. skin: as in `SKINS`.
    """
    height = points @ up
    low, tall = float(height.min()), float(np.ptp(height))
    R = turned_up(up)
    try:
        base = ConvexHull((points @ R.T)[height <= low + skin * tall, :2])
    except (QhullError, ValueError):
        return -np.pi / 2
    beside = -(base.equations[:, :2] @ (R @ middle)[:2] + base.equations[:, 2]).max()
    return float(np.arctan2(beside, float(middle @ up) - low))


def turned_up(up: Array) -> Array:
    """The rotation (3, 3) that takes the axis `up` (3,) of a shape to z by the shortest way."""
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), float(up @ z)
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1 + cosine))
