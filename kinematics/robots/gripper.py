"""What a gripper's fingers leave free, as a table over its joint: their width, where the pads are, how deep an object may reach in.

A constant would not do: the pads of a Robotiq 2F-85 move 14 mm along the approach while they open, and its knuckles reach into the opening.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.chain import Int
from kinematics.robots.tree import FIXED, LinkHull, Tree
from kinematics.transforms import Array, inverse

PAD_M = 0.008  # a finger link that stays within 8 mm of being the innermost one is a pad
_Z = np.linspace(-0.12, 0.04, 161)  # where the fingers are looked at, along the hand's z
ROOM_M = 0.005
"""What an object in the hand is to keep from all that does not hold it."""
_BETWEEN = np.abs(_Z) <= 0.015  # the hand frame's origin lies between the pads


@dataclass(frozen=True, eq=False)
class Opening:
    """The gripper's table, by rising width: joint value, width between the pads, where the pads' middle is along the hand's z, and how far
    behind that an object of this width may reach if it is to end ROOM_M before a knuckle or the palm, which then are nowhere nearer;
    metres.
    """

    value: Array
    width_m: Array
    pad_z_m: Array
    depth_m: Array

    @property
    def max_m(self) -> float:
        return float(self.width_m[-1])

    def value_at(self, width_m: float) -> float:
        """The gripper joint's value for a width, clipped to what the gripper can do."""
        return float(np.interp(width_m, self.width_m, self.value))

    def width_at(self, value: float) -> float:
        """The width between the pads, in metres, at a value of the gripper's joint."""
        order = np.argsort(self.value)
        return float(np.interp(value, self.value[order], self.width_m[order]))

    def pad_z_at(self, width_m: float) -> float:
        """The middle of the pads along the hand's z, at a width."""
        return float(np.interp(width_m, self.width_m, self.pad_z_m))

    def depth_at(self, width_m: float) -> float:
        """How far behind the pads' middle an object of this width may reach."""
        return float(np.interp(width_m, self.width_m, self.depth_m))


def measure(
    tree: Tree, hulls: tuple[LinkHull, ...], fingers: frozenset[str], gripper: int, limits: tuple[float, float], rest: Array, name: str
) -> tuple[Opening, frozenset[str]]:
    """Tabulate the opening over the gripper joint's limits, the other joints at rest (J,), and find the pads among the finger links.

    Raises: ValueError when the fingers don't close along the hand frame's y; name: the robot's, for that message.
    """
    mover = max(i for i in tree.path(tree.index["hand"]) if tree.kind[i] != FIXED)
    hand = [hull for hull in hulls if mover in tree.path(tree.index[hull.link])]
    profiles, widths, pad_z, places = [], [], [], []
    values = np.linspace(*limits, 33)
    for value in values:
        q = rest.copy()
        q[gripper] = value
        poses = tree.poses(q)
        T_hand = inverse(poses[tree.index["hand"]])
        inner = {hull.link: np.full(len(_Z), np.inf) for hull in hand}
        sides = {1: np.full(len(_Z), np.inf), -1: np.full(len(_Z), np.inf)}
        placed = [(h.link, h.vertices @ T[:3, :3].T + T[:3, 3], h.faces) for h in hand for T in [T_hand @ poses[tree.index[h.link]]]]
        for hull, (_, vertices, faces) in zip(hand, placed):
            low, high = _cross(vertices, faces, _Z)
            gap = np.where(np.isnan(low), np.inf, np.maximum(0.0, np.maximum(low, -high)))
            inner[hull.link] = np.minimum(inner[hull.link], gap)
            if hull.link in fingers and np.isfinite(low).any():
                side = 1 if np.nanmean(low + high) > 0 else -1
                sides[side] = np.minimum(sides[side], gap)
        width = sides[1] + sides[-1]
        if not np.isfinite(width[_BETWEEN]).any():
            raise ValueError(f"robot {name}: no fingers on both sides of the hand frame along its y axis; "
                             "put the hand frame between the pads, z along the approach, y the way the fingers close")  # fmt: skip
        widths.append(float(np.min(width[_BETWEEN])))
        pad_z.append(float(_Z[(np.abs(width - widths[-1]) <= 0.0005) & (_Z > -0.04)].mean()))
        profiles.append(inner)
        places.append(placed)
    if max(widths) - min(widths) < 0.005:
        raise ValueError(f"robot {name}: the gripper joint opens the fingers by less than 5 mm along the hand frame's y axis; "
                         "is it the right joint, and does the frame's y point the way the fingers close?")  # fmt: skip
    wide = [i for i, w in enumerate(widths) if w > 0.4 * max(widths)]  # when the fingers are closed, the knuckles are innermost too
    pads = frozenset(f for f in fingers if max(np.min(profiles[i][f][_BETWEEN], initial=np.inf) - widths[i] / 2 for i in wide) < PAD_M)
    depth = [_free_depth(placed, pads, width, z) for placed, width, z in zip(places, widths, pad_z)]
    order = np.argsort(widths, kind="stable")
    table = np.stack([values, widths, pad_z, depth])[:, order]
    rising = np.concatenate([[True], np.diff(table[1]) > 1e-6])
    return Opening(*table[:, rising]), pads


def _free_depth(placed: Sequence[tuple[str, Array, Int]], pads: frozenset[str], width: float, pad_z: float) -> float:
    """How far behind pad_z an object of this width may reach, however high it is, plus ROOM_M: an object that ends ROOM_M before this depth
    keeps ROOM_M from all other links, beside it as well as behind it.

    placed: hulls in the hand's frame, (link, vertices, faces).
    """
    nearest = float(_Z[0])
    steps = np.linspace(0.0, ROOM_M, 11)
    for link, vertices, faces in placed:
        if link not in pads:
            for inner, outer in itertools.pairwise(steps):  # what is that far beside it has to be so far behind it
                z = _furthest(vertices, faces, width / 2 + float(outer))
                if z < pad_z:
                    nearest = max(nearest, z - ROOM_M + float(np.sqrt(ROOM_M**2 - inner**2)))
    return pad_z - nearest


def _furthest(vertices: Array, faces: Int, half: float) -> float:
    """The largest z of a convex hull where |y| ≤ half; -inf where it has nothing there."""
    a, b = (np.concatenate([vertices[faces[:, i]] for i in order]) for order in ((0, 1, 2), (1, 2, 0)))
    best = float(np.max(a[np.abs(a[:, 1]) <= half, 2], initial=-np.inf))
    for y in (-half, half):
        crosses = (a[:, 1] - y) * (b[:, 1] - y) < 0
        share = (y - a[crosses, 1]) / (b[crosses, 1] - a[crosses, 1])
        best = max(best, float(np.max(a[crosses, 2] + share * (b[crosses, 2] - a[crosses, 2]), initial=-np.inf)))
    return best


def _cross(vertices: Array, faces: Int, z: Array) -> tuple[Array, Array]:
    """Where the lines x = 0 at heights z (Z,) cross a convex hull: least and greatest y (Z,), nan where they miss."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal *= np.sign(np.einsum("ij,ij->i", normal, a - vertices.mean(0)))[:, None]
    d = np.einsum("ij,ij->i", normal, a)
    rhs = d[:, None] - normal[:, 2:3] * z  # n_y · y <= rhs
    n_y = normal[:, 1:2]
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = rhs / n_y
    flat = np.abs(n_y) < 1e-12
    low = np.where((n_y < 0) & ~flat, bound, -np.inf).max(0)
    high = np.where((n_y > 0) & ~flat, bound, np.inf).min(0)
    miss = (low > high) | (flat & (rhs < 0)).any(0)
    return np.where(miss, np.nan, low), np.where(miss, np.nan, high)
