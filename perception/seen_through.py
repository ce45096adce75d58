"""Pixels of a recording that other views see through: what one frame measured in the air at an edge, where nothing is.

A flying pixel lies somewhere between what is before an edge and what is behind it. In its own image it may look like a surface, where
holes and other flying pixels are around it; but cameras elsewhere look through the place where it seems to be. A pixel that is dropped
clears no space.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from kinematics.transforms import Array, apply, inverse
from perception.camera import Depth, Intrinsics
from perception.frames import Frame
from perception.readings import sample

APART_M = 0.02
"""At 1 m and nearer, growing with z²: neighbouring pixels whose depths differ by more are at an edge, and a view that measures so much more
where a point is looks through it."""
OFF_M, AT_M = 0.005, 0.5
"""So far may poses be off: so far around where a pixel would be, at this distance, a view has to see through."""
VALID = 0.5  # of the pixels there that measured something, at least, for a view to have a say
VIEWS = 2  # so many, and more than see something there
EVERY_PX = 11  # of columns and rows, where frames are compared with one another
MOST = 24  # frames that others are compared with, spread over a long recording


def without_seen_through(frames: Sequence[Frame]) -> list[Frame]:
    """Frames of one scene that stands still, without the pixels at edges that several of the others see through, and fewer see: they become
    0, nothing measured. A robot's own pixels have no say, and are left as they are."""
    others = [_view(frame) for frame in frames]
    return [_judged(frame, [view for view, other in zip(others, frames) if other is not frame]) for frame in frames]


def contradicted(frames: Sequence[Frame], counts: Callable[[Array], NDArray[np.bool_]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """How many points of frame i frame j looks through to what is behind, and at how many it sees something: (F, F) each.

    counts: which of points (N, 3), world, are asked about. What is hidden in frame j, and a robot's own pixels, have no say. Of many frames
    only some are j, and the others' columns 0.
    """
    spread = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST)).astype(int))
    views = [(j, _view(frames[j])) for j in spread]
    through, seen = (np.zeros((len(frames), len(frames)), np.int64) for _ in range(2))
    for i, frame in enumerate(frames):
        points = sample(frame, EVERY_PX).points
        points = points[counts(points)]
        for j, view in views:
            if j != i:
                through[i, j], seen[i, j] = (int(np.count_nonzero(some)) for some in _looked_at(view, points))
    return through, seen


@dataclass(frozen=True, eq=False)
class _View:
    """nearest (H, W): the least depth that a frame measured around each pixel; 0 where too little was measured for a say."""

    nearest: Depth
    intrinsics: Intrinsics
    T_camera_world: Array


def _view(frame: Frame) -> _View:
    size = 2 * max(1, round(OFF_M / AT_M * frame.intrinsics.fx)) + 1
    valid = frame.depth > 0 if frame.arm is None else (frame.depth > 0) & ~frame.arm
    valid &= ~_at_edges(frame.depth)  # where it may itself be in the air
    nearest = ndimage.minimum_filter(np.where(valid, frame.depth, np.float32(np.inf)), size, mode="constant", cval=np.inf)
    enough = ndimage.uniform_filter(valid.astype(np.float32), size, mode="constant") >= VALID
    return _View(np.where(enough, nearest, np.float32(0)), frame.intrinsics, inverse(frame.T_world_camera))


def _judged(frame: Frame, views: Sequence[_View]) -> Frame:
    v, u = np.nonzero(_at_edges(frame.depth) if frame.arm is None else _at_edges(frame.depth) & ~frame.arm)
    k, z = frame.intrinsics, frame.depth[v, u].astype(float)
    points = apply(frame.T_world_camera, np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], -1))
    through, seen = np.zeros(len(z), int), np.zeros(len(z), int)
    for view in views:
        looked_through, at = _looked_at(view, points)
        through += looked_through
        seen += at
    wrong = (through >= VIEWS) & (through > seen)
    depth = frame.depth.copy()
    depth[v[wrong], u[wrong]] = 0.0
    return replace(frame, depth=depth)


def _looked_at(view: _View, points: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of points (N, 3), world, a view looks through to what is behind, and where it sees something."""
    nearest, far = _seen_at(view, points)
    margin = APART_M * np.maximum(far * far, 1.0)
    return (nearest > 0) & (nearest > far + margin), (nearest > 0) & (np.abs(nearest - far) <= margin)


def _seen_at(view: _View, points: Array) -> tuple[Array, Array]:
    """The least depth (N,) that a view measured around where points (N, 3), world, would be in it, 0 where it has no say; and theirs."""
    at, k = apply(view.T_camera_world, points), view.intrinsics
    z = np.maximum(at[:, 2], 1e-6)
    u, v = np.rint(at[:, 0] / z * k.fx + k.cx), np.rint(at[:, 1] / z * k.fy + k.cy)
    height, width = view.nearest.shape
    inside = (at[:, 2] > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    out = np.zeros(len(points))
    out[inside] = view.nearest[v[inside].astype(int), u[inside].astype(int)]
    return out, z


def _at_edges(depth: Depth) -> NDArray[np.bool_]:
    """Which pixels (H, W) measured something that differs by more than APART_M from a neighbour's."""
    out = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        a, b = np.moveaxis(depth, axis, 0)[:-1], np.moveaxis(depth, axis, 0)[1:]
        step = (a > 0) & (b > 0) & (np.abs(a - b) > APART_M * np.maximum(np.minimum(a, b) ** 2, 1.0))
        np.moveaxis(out, axis, 0)[:-1] |= step
        np.moveaxis(out, axis, 0)[1:] |= step
    return out
