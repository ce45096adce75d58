"""Recorded frames as they are: what a depth camera makes up is dropped, and what can't be of this cabinet is told.

Space is cleared along the rays of a depth image, so a depth that is too great is dangerous: a saturated value (all bits set, dropped by
`perception.frames.read_frames`), one beyond the range of any such camera, and a flying pixel at an edge, which measures neither what is
before the edge nor what is behind it but something between. A surface is connected in the image: even at a corner a pixel of it has three
neighbours that are as far. A flying pixel has fewer, as each is a mixture of its own of what is before and behind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Cabinet
from kinematics.transforms import Array, apply, inverse
from perception.camera import Depth
from perception.frames import Frame
from perception.pixels import flying_pixels
from perception.readings import Sample, other_readings, sample
from perception.seen_through import contradicted

FARTHEST_M = 10.0
"""No depth camera for arm's length measures further; what says so is no measurement."""
EDGE_M = 0.02
"""A pixel between two surfaces that are further apart, and on neither of them, flies."""
EVEN_M, FEWEST, STRAIGHT = 0.01, 3, 0.01
"""At 1 m and nearer, growing with z²: a pixel at an edge has at least so many of eight neighbours that are as far as it, but for the first;
or it lies on a line with two on either side, their 1 / z, which is affine on a plane, straight but for the third, in 1/m."""
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows and columns to neighbours, on one side
ROUNDS = 2  # as flying pixels that are dropped were neighbours of others
OUTSIDE_M = 0.03
"""What is nearer to the inner space than this is the cabinet's, as poses are not exact."""
EVERY_PX = 7
LEAST = 500  # points that others look at, at least, before frames can contradict one another
SOME, MANY = 0.002, 0.2
"""Of the points of a recording that fits, more than the first share are in the cabinet; another reading that holds the second one explains
a recording that does not fit."""
AT_WALL_M, FAR_BETTER = 0.02, 4.0
"""What is so near to a wall shows it. A reading that shows so many times as much of the walls is the right one: with poses that are right
three quarters of the points do, with the same the other way round a hundredth."""
CONTRADICTED, DOUBTFUL, BETTER = 0.35, 0.05, 1.5
"""Of what frames show in the cabinet and others look at, so much at most is where these look through to what is behind, and from the second
one on it is said. With poses that are right it is a hundredth at most, with each 1° and 5 mm off a twentieth, 2° and 1 cm off a quarter. A
reading that shows so many times as much of the walls is told as well."""
ONE = 4.0  # a frame's own share, beside the median of all, from which on it is this frame that is wrong


def trusted(frame: Frame) -> Frame:
    """The frame without the depths that are none: beyond FARTHEST_M, and pixels in the air at edges; they become 0, nothing measured."""
    depth = np.ascontiguousarray(frame.depth, np.float32)
    depth = np.where((depth > FARTHEST_M) | ~np.isfinite(depth), np.float32(0), depth)
    on_line = _on_line(depth)
    for _ in range(ROUNDS):
        depth = np.where(_unconnected(depth) & ~on_line, np.float32(0), depth)
    return replace(frame, depth=np.where(flying_pixels(depth, EDGE_M), np.float32(0), depth))


def _unconnected(depth: Depth) -> NDArray[np.bool_]:
    """Which pixels (H, W) at an edge, steps of EDGE_M to any of their eight neighbours, are as far as too few of these: see EVEN_M."""
    z = np.where(depth > 0, depth, np.float32(np.nan))
    reach = np.maximum(z * z, 1)
    even, edge = np.zeros(z.shape, np.int8), np.zeros(z.shape, bool)
    for step in STEPS:
        for side in (-1, 1):
            off = np.abs(_beside(z, step, side) - z)
            even += off < EVEN_M * reach
            edge |= off > EDGE_M * reach
    return np.asarray(edge & (even < FEWEST))


def _on_line(depth: Depth) -> NDArray[np.bool_]:
    """Which pixels (H, W) lie on a straight line with two on either side, on a plane that is seen at a grazing angle: see STRAIGHT.

    Along an edge flying pixels may be as far as one another, so such lines don't count.
    """
    z = np.where(depth > 0, depth, np.float32(np.nan))
    out = np.zeros(z.shape, bool)
    for step in STEPS:
        near, far = ([_beside(z, step, -k), _beside(z, step, k)] for k in (1, 2))
        level = np.maximum(*(np.abs(side - z) for side in near)) < EVEN_M * np.maximum(z * z, 1)
        out |= ~level & (np.abs(1 / near[0] + 1 / near[1] - 2 / z) < STRAIGHT) & (np.abs(1 / far[0] + 1 / far[1] - 2 / z) < STRAIGHT)
    return out


def _beside(z: Depth, step: tuple[int, int], times: int) -> Depth:
    """What the pixel so many rows and columns further on measured (H, W), NaN beyond the image."""
    far = abs(times)
    v, u = far + times * step[0], far + times * step[1]
    return np.pad(z, far, constant_values=np.nan)[v : v + z.shape[0], u : u + z.shape[1]]


def misfit(frames: Sequence[Frame], cabinet: Cabinet, T_world_base: Array, on_doubt: Callable[[str], None] = lambda _: None) -> str | None:
    """Why the frames can't be of this cabinet, with the likely cause; None when they may be.

    They can't when hardly any of what they measured lies inside it. Then what the files may have meant instead is tried (see
    `perception.readings`): a reading that puts much inside the cabinet is the likely cause. Nor can they when such a reading shows the
    cabinet's walls far better, nor when frames look through what others show. T_world_base (4, 4): the robot's. on_doubt: is
    told where frames agree badly, but not so badly that they can't be used.
    """
    if not any((f.depth > 0).any() for f in frames):
        return None if not frames else "no pixel of the frames measured anything: is this a depth image, and its depth_scale right?"
    samples = [sample(f, EVERY_PX) for f in frames]
    as_said = _fit(samples, cabinet)
    others = [(_fit(other, cabinet), cause) for cause, other in other_readings(samples, cabinet, T_world_base)]
    found, cause = max(others, key=lambda other: other[0].at_walls)
    if as_said.inside <= SOME:
        if found.at_walls <= MANY:
            found, cause = max(others, key=lambda other: other[0].inside)
        if found.inside > MANY:
            return f"nothing that the frames measured lies inside the cabinet; {cause} ({100 * found.inside:.0f} % of the points would)"
        return (
            "nothing that the frames measured lies inside the cabinet: is the pose world-to-camera, in millimetres, of the scene's own "
            "world, and depth_scale the millimetres of one step?"
        )
    shares = f"{100 * as_said.at_walls:.0f} % of the points lie at the cabinet's walls, and {100 * found.at_walls:.0f} % would"
    if found.at_walls > max(MANY, FAR_BETTER * as_said.at_walls):
        return f"the frames hardly show this cabinet; {cause} ({shares})"
    if why := _contradiction(frames, cabinet, on_doubt):
        return f"{why}; {cause} ({shares})" if found.at_walls > max(MANY, BETTER * as_said.at_walls) else why
    return None


def _contradiction(frames: Sequence[Frame], cabinet: Cabinet, on_doubt: Callable[[str], None]) -> str | None:
    """Whether frames look through what others show in the cabinet, all of them or one; None when they agree."""
    through, seen = contradicted(frames, lambda points: _inside(points, cabinet))
    asked = through + seen
    if asked.sum() < LEAST:
        return None
    share, what = through.sum() / asked.sum(), "of what frames show in the cabinet is where others look through"
    if share > CONTRADICTED:
        causes = "poses (hand-eye calibration, the moments they were taken at), cam_K or depth_scale are wrong, or things moved meanwhile"
        return f"the frames contradict one another, {100 * share:.0f} % {what}: {causes}"
    of_each = (asked + asked.T).sum(1)
    shares = np.where(of_each >= LEAST, (through + through.T).sum(1) / np.maximum(of_each, 1), 0.0)
    k = int(shares.argmax())
    if shares[k] > max(CONTRADICTED, ONE * np.median(shares)):
        return f"frame {k} and the others contradict one another, {100 * shares[k]:.0f} % {what}: is its pose right, and did nothing move?"
    if share > DOUBTFUL or shares[k] > 2 * DOUBTFUL:
        causes = "poses are off by a degree or more, or things moved meanwhile"
        on_doubt(f"{100 * share:.0f} % {what}, and {100 * shares[k]:.0f} % at frame {k}: {causes}")
    return None


class _Fit(NamedTuple):
    """The shares of a recording's points that lie in the cabinet or at its walls, and that lie at its walls, seen through its opening."""

    inside: float
    at_walls: float


def _fit(samples: Sequence[Sample], cabinet: Cabinet) -> _Fit:
    """How much of what was measured is of the cabinet."""
    total = inside = at_walls = 0
    T = inverse(cabinet.T_world_cabinet)
    low, high = _inner(cabinet)
    for some in samples:
        points = apply(T, some.points)
        total += len(points)
        points = points[_within(points, low, high)]
        inside += len(points)
        near = (np.abs(points - low) < AT_WALL_M) | (np.abs(points - high) < AT_WALL_M)
        near[:, 0] = np.abs(points[:, 0] - high[0]) < AT_WALL_M  # there is no wall in front
        shown = points[near.any(1)]
        at_walls += int(np.count_nonzero(_through_opening((T @ some.T_world_camera)[:3, 3], shown, low, high)))
    return _Fit(inside / max(total, 1), at_walls / max(total, 1))


def _inner(cabinet: Cabinet) -> tuple[Array, Array]:
    """The least and the greatest corner of the inner space, in the cabinet's frame."""
    low = np.array([0.0, -cabinet.size_m[1] / 2, 0.0])
    return low, low + cabinet.size_m


def _inside(points: Array, cabinet: Cabinet) -> NDArray[np.bool_]:
    """Which points (N, 3) of the world are the cabinet's: in it, or at its walls."""
    return _within(apply(inverse(cabinet.T_world_cabinet), points), *_inner(cabinet))


def _within(points: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """The same of points (N, 3) in the cabinet's frame, between the inner space's corners."""
    return np.asarray(((points > low - OUTSIDE_M) & (points < high + OUTSIDE_M)).all(1))


def _through_opening(camera: Array, points: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Whether points (N, 3) in the cabinet are seen through its opening, x = 0, or from within it: (N,). All in the cabinet's frame."""
    if ((camera > low) & (camera < high)).all():
        return np.ones(len(points), bool)
    if camera[0] >= 0.0:
        return np.zeros(len(points), bool)
    crossing = camera + (points - camera) * (-camera[0] / np.maximum(points[:, 0] - camera[0], 1e-9))[:, None]
    return np.asarray(((crossing[:, 1:] > low[1:] - OUTSIDE_M) & (crossing[:, 1:] < high[1:] + OUTSIDE_M)).all(1))
