"""The links of a robot as a tree of joints, and the convex solids that hang on them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinematics.arm import Int
from kinematics.transforms import Array, rotations_about, transform

FIXED, TURNS, SLIDES = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Tree:
    """The links in topological order, N of them: name, parent's index (-1 for the root) and the joint that carries each.

    T_joint (N, 4, 4): the joint's frame in the parent at position 0. kind (N,): FIXED, TURNS or SLIDES along axis (N, 3).
    q_index (N,): which actuated joint drives it, as scale · q + offset; -1 when fixed.
    """

    names: tuple[str, ...]
    parent: Int
    T_joint: Array
    kind: Int
    axis: Array
    q_index: Int
    scale: Array
    offset: Array

    @cached_property
    def index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def poses(self, q: Array) -> Array:
        """Forward kinematics of every link: q (..., J) to (..., N, 4, 4) in the base frame."""
        T = np.empty((*q.shape[:-1], len(self.names), 4, 4))
        for i, parent in enumerate(self.parent):
            local = self.local(i, q)
            T[..., i, :, :] = local if parent < 0 else T[..., parent, :, :] @ local
        return T

    def local(self, i: int, q: Array) -> Array:
        """Link i's pose (..., 4, 4) in its parent at q (..., J)."""
        if self.kind[i] == FIXED:
            return np.asarray(self.T_joint[i])
        x = self.scale[i] * q[..., self.q_index[i]] + self.offset[i]
        moved = transform(rotations_about(self.axis[i], x)) if self.kind[i] == TURNS else transform(p=x[..., None] * self.axis[i])
        return np.asarray(self.T_joint[i] @ moved)

    def path(self, link: int) -> list[int]:
        """Link indices from the root to `link`."""
        way = [link]
        while self.parent[way[-1]] >= 0:
            way.append(int(self.parent[way[-1]]))
        return way[::-1]


@dataclass(frozen=True, eq=False)
class LinkHull:
    """One convex piece of a link: vertices (V, 3) and faces (F, 3) in the link's frame."""

    link: str
    vertices: Array
    faces: Int
