"""The links of a robot as a tree of joints, and the convex solids that hang on them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from kinematics.chain import Int
from kinematics.jit.decorators import copy_rows, jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array

FIXED, TURNS, SLIDES = 0, 1, 2


@record
class Joints(NamedTuple):
    """A tree's numbers for compiled code, its N links in topological order; the fields are those of `Tree`."""

    parent: Int
    T_joint: Array
    kind: Int
    axis: Array
    q_index: Int
    scale: Array
    offset: Array


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
        """Each link's place, by name."""
        return {name: i for i, name in enumerate(self.names)}

    @cached_property
    def coordinates(self) -> int:
        """How many actuated joints there are, J."""
        return int(self.q_index.max(initial=-1)) + 1

    @cached_property
    def joints(self) -> Joints:
        """The numbers behind the names, for compiled code."""
        n = len(self.names)
        return Joints(
            np.ascontiguousarray(self.parent, np.int64),
            np.ascontiguousarray(self.T_joint, float).reshape(n, 4, 4),
            np.ascontiguousarray(self.kind, np.int64),
            np.ascontiguousarray(self.axis, float).reshape(n, 3),
            np.ascontiguousarray(self.q_index, np.int64),
            np.ascontiguousarray(self.scale, float),
            np.ascontiguousarray(self.offset, float),
        )

    def poses(self, q: Array) -> Array:
        """Forward kinematics of every link: q (..., J) to (..., N, 4, 4) in the base frame. Raises: ValueError for another shape."""
        q = self._checked(q)
        rows = np.ascontiguousarray(q).reshape(-1, self.coordinates)
        T = np.empty((len(rows), len(self.names), 4, 4))
        link_poses(self.joints, rows, np.empty((4, 4)), T)
        return T.reshape(*q.shape[:-1], len(self.names), 4, 4)

    def link(self, name: str, q: Array) -> Array:
        """Forward kinematics of one link: q (..., J) to (..., 4, 4) in the base frame. Raises: ValueError for another shape."""
        q = self._checked(q)
        rows, T = np.ascontiguousarray(q).reshape(-1, self.coordinates), np.empty((q.size // self.coordinates, 4, 4))
        _one_link(self.joints, np.array(self.path(self.index[name])), rows, np.empty((2, 4, 4)), T)
        return T.reshape(*q.shape[:-1], 4, 4)

    def local(self, i: int, q: Array) -> Array:
        """Link i's pose (4, 4) in its parent at q (J,). Raises: ValueError for another shape, or when there is no link i."""
        if not 0 <= i < len(self.names) or np.ndim(q) != 1:
            raise ValueError(f"link {i} of {len(self.names)} at q {np.shape(q)}: a link's index and q (J,) are needed")
        T = np.empty((4, 4))
        _local(self.joints, i, np.ascontiguousarray(self._checked(q)), T)
        return T

    def _checked(self, q: Array) -> Array:
        """Joint values (..., J) as floats. Raises: ValueError for another shape."""
        values = np.asarray(q, float)
        if values.shape[-1:] != (self.coordinates,):
            raise ValueError(f"q {values.shape} must end with {self.coordinates} values, one for each actuated joint")
        return values

    def path(self, link: int) -> list[int]:
        """Link indices from the root to `link`."""
        way = [link]
        while self.parent[way[-1]] >= 0:
            way.append(int(self.parent[way[-1]]))
        return way[::-1]

    def below(self, link: int) -> list[int]:
        """Indices of a link and of all that it carries."""
        return [i for i in range(len(self.names)) if link in self.path(i)]


@dataclass(frozen=True, eq=False)
class LinkHull:
    """One convex piece of a link: vertices (V, 3) and faces (F, 3) in the link's frame."""

    link: str
    vertices: Array
    faces: Int


def carried(joints: Joints, q: Array, frame: Int, T_frame: Array) -> tuple[Int, Array]:
    """For every link the frame (N,) that carries it, and its pose (N, 4, 4) in that frame, at q (J,).

    frame (N,): a number for the links that are frames of their own, or fixed to one, with their poses T_frame (N, 4, 4) in it; -1 for
    the links that go with their parents.
    """
    which, T = frame.copy(), T_frame.copy()
    _carry_on(joints, np.ascontiguousarray(q, float), np.empty((4, 4)), which, T)
    return which, T


@jit_entry
def link_poses(joints: Joints, q: Array, local: Array, T: Array) -> None:
    """Poses T (R, N, 4, 4) of the links in the base frame at q (R, J). local (4, 4): scratch."""
    for r in range(q.shape[0]):
        for i in range(joints.parent.shape[0]):
            if joints.parent[i] < 0:
                _local(joints, i, q[r], T[r, i])
            else:
                _local(joints, i, q[r], local)
                product(T[r, joints.parent[i]], local, T[r, i])


@jit_entry
def _one_link(joints: Joints, path: Int, q: Array, local: Array, T: Array) -> None:
    """Poses T (R, 4, 4) of the last link of a path from the root, at q (R, J). local (2, 4, 4): scratch."""
    for r in range(q.shape[0]):
        for n in range(path.shape[0]):
            if n == 0:
                _local(joints, path[n], q[r], T[r])
            else:
                _local(joints, path[n], q[r], local[0])
                copy_rows(T[r], local[1])
                product(local[1], local[0], T[r])


@jit_entry
def _carry_on(joints: Joints, q: Array, local: Array, which: Int, T: Array) -> None:
    """Fill in the links for which `which` is -1. local (4, 4): scratch."""
    for i in range(joints.parent.shape[0]):
        if which[i] < 0:
            _local(joints, i, q, local)
            which[i] = which[joints.parent[i]]
            product(T[joints.parent[i]], local, T[i])


@jit_inline
def product(A: Array, B: Array, out: Array) -> None:
    """out = A @ B for poses (4, 4): written out, which is ten times as fast as `@` on small matrices."""
    for r in range(3):
        for c in range(4):
            out[r, c] = A[r, 0] * B[0, c] + A[r, 1] * B[1, c] + A[r, 2] * B[2, c] + (A[r, 3] if c == 3 else 0.0)
    out[3, 0] = out[3, 1] = out[3, 2] = 0.0
    out[3, 3] = 1.0


@jit_entry
def _local(joints: Joints, i: int, q: Array, T: Array) -> None:
    """Link i's pose (4, 4) in its parent at q (J,)."""
    copy_rows(joints.T_joint[i], T)
    if joints.kind[i] == FIXED:
        return
    x = joints.scale[i] * q[joints.q_index[i]] + joints.offset[i]
    a, b, c = joints.axis[i, 0], joints.axis[i, 1], joints.axis[i, 2]
    if joints.kind[i] == SLIDES:
        for r in range(3):
            T[r, 3] += x * (T[r, 0] * a + T[r, 1] * b + T[r, 2] * c)
        return
    si, v = np.sin(x), 1.0 - np.cos(x)
    co = 1.0 - v
    for r in range(3):  # Rodrigues' formula, row by row
        u, w, z = T[r, 0], T[r, 1], T[r, 2]
        along = v * (u * a + w * b + z * c)
        T[r, 0] = u * co + (w * c - z * b) * si + along * a
        T[r, 1] = w * co + (z * a - u * c) * si + along * b
        T[r, 2] = z * co + (u * b - w * a) * si + along * c
