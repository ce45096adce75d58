"""Whether a suction cup holds a body: all of its face lies on the body, near enough and square enough for the lip to seal. In closed form.

The face is looked at along lines through its lip and within it: each must meet the body, no further than a gap that the lip bridges.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kinematics.transforms import Array, inverse
from planning.verdict.faults import Fault, Settings
from planning.verdict.polyhedra import Polyhedron

if TYPE_CHECKING:
    from planning.verdict.hand import Pad

AROUND, RINGS = 48, (1.0, 0.6, 0.2)
"""Lines around the face, on rings that are as large as these shares of its outline; and one in the middle."""
STEEP = 1e-9


def cup_faults(
    cup: Pad, T_hand_face: Array, body: Sequence[Polyhedron], T_hand_body: Array, name: str, stage: str, settings: Settings
) -> list[Fault]:
    """What keeps a cup from holding a body; nothing when it does. T_hand_face, T_hand_body (4, 4): in the hand's frame."""
    points = lines(cup.window.corners)
    gap, normal = met(points, [part.moved(inverse(T_hand_face) @ T_hand_body) for part in body])
    over = int(np.isinf(gap).sum())
    if over == len(points):
        return [Fault(stage, (cup.link, name), f"{cup.link} is beside {name}")]
    bodies = (cup.link, name)
    if over:
        return [Fault(stage, bodies, f"{cup.link} does not lie on {name} whole: {100 * over / len(points):.0f} % of it is beyond an edge")]
    far, deep = float(gap.max()), float(-gap.min())
    if far > settings.gap_m:
        return [Fault(stage, bodies, f"{cup.link} stops {1000 * far:.1f} mm before {name}", far)]
    if deep > settings.depth_m:
        return [Fault(stage, bodies, f"{cup.link} is {1000 * deep:.1f} mm inside {name}", deep)]
    askew = float(np.arccos(np.minimum(-normal[:, 2], 1.0)).max())
    if askew > settings.cup_rad:
        return [Fault(stage, bodies, f"{cup.link} is {np.degrees(askew):.0f}° askew on {name}", askew)]
    return []


def lines(outline: Array) -> Array:
    """Points (N, 2) on a face with an outline of corners (M, 2): along the outline, on smaller ones within it, and in its middle."""
    closed = np.concatenate([outline, outline[:1]])
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1)))
    along = np.linspace(0.0, way[-1], AROUND, endpoint=False)
    ring = np.stack([np.interp(along, way, closed[:, i]) for i in range(2)], -1)
    middle = outline.mean(0)
    return np.concatenate([*(middle + share * (ring - middle) for share in RINGS), middle[None]])


def met(points: Array, parts: Sequence[Polyhedron]) -> tuple[Array, Array]:
    """Where lines along z through points (N, 2) of the plane z = 0 first meet convex parts that reach beyond that plane: z (N,), infinite
    where they meet none, and the outward normals (N, 3) there."""
    gap, normal = np.full(len(points), np.inf), np.tile([0.0, 0.0, -1.0], (len(points), 1))
    for part in parts:
        n, d = part.planes[:, :3], part.planes[:, 3]
        room, nz = d - points @ n[:, :2].T, n[:, 2]
        down, up = nz < -STEEP, nz > STEEP
        enters, leaves = room[:, down] / nz[down], (room[:, up] / nz[up]).min(1, initial=np.inf)
        low = enters.max(1, initial=-np.inf)
        nearer = (room[:, ~(down | up)] >= 0).all(1) & (low <= leaves) & (leaves > 0) & (low < gap)
        gap[nearer] = low[nearer]
        normal[nearer] = n[down][enters.argmax(1)][nearer]
    return gap, normal
