"""How large a finger's pad is, and where two pads first meet a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.shapes import ConvexMesh
from kinematics.transforms import Array, apply, inverse
from planning.grasping.hand_poses import hand_points
from planning.grasping.line_contacts import GAP_M, Contact, line_stretches

PAD_FACE_M = 0.001  # corners of a finger this near to its innermost one belong to the pad
PAD_REACH_M = 0.025  # and no further than this from the pads' middle, along the approach
ROUND_M = 0.0009  # a corner that is rounded off by so much leaves a square of 4 mm in it 3 mm wide, as the verdict asks
SIDES = 64  # in so many directions, and of so many widths, the largest rectangle in a face is sought
OPENINGS = 9  # at which the hand is measured


@dataclass(frozen=True)
class Pad:
    """How large a flat pad is: half its width along the hand's x, and from where to where along z, from the pads' middle; tip_z_m: how far
    any of the hand reaches beyond that, however wide it is open; metres."""

    half_x_m: float
    low_z_m: float
    high_z_m: float
    tip_z_m: float = 0.0


@lru_cache(maxsize=16)
def pad_of(robot: Robot) -> Pad:
    """The face that closes, of the finger on the hand's left, half open: of its link that is innermost between the fingertips."""
    face = _face(robot)
    if face is None:
        return Pad(0.0, 0.0, 0.0, _tip_z(robot))
    return Pad(float(np.abs(face[:, 0]).max()), float(min(face[:, 1].min(), 0.0)), float(max(face[:, 1].max(), 0.0)), _tip_z(robot))


@lru_cache(maxsize=16)
def inner_pad_of(robot: Robot) -> Pad:
    """The largest rectangle in that face, which it is itself but for a finger with round pads: corners may stand out by ROUND_M."""
    whole, face = pad_of(robot), _face(robot)
    if face is None:
        return whole
    angles = np.arange(1, SIDES) * (np.pi / SIDES)
    x, z = np.cos(angles), np.sin(angles)  # directions that rise; the others are their opposites
    along = face @ [x, z]
    above, below, best, most = along.max(0) + ROUND_M, along.min(0) - ROUND_M, whole, 0.0
    for half_x in np.linspace(1.0, 0.0, SIDES, endpoint=False) * whole.half_x_m:
        low = max(whole.low_z_m, float(((below + half_x * np.abs(x)) / z).max()))
        high = min(whole.high_z_m, float(((above - half_x * np.abs(x)) / z).min()))
        if low <= 0.0 <= high and half_x * (high - low) > most:
            best, most = Pad(float(half_x), low, high, whole.tip_z_m), half_x * (high - low)
    return best


def _face(robot: Robot) -> Array | None:
    """The corners (N, 2) of that face, along the hand's x and z from the pads' middle; None where there is none."""
    width = robot.opening.max_m / 2
    q = robot.home.copy()
    q[robot.gripper_joint] = robot.opening.value_at(width)
    poses = robot.link_poses(q)
    T_hand, middle = inverse(poses["hand"]), robot.opening.pads_middle(width)
    faces = []
    for hull in (h for h in robot.hulls if h.link in robot.fingers):
        points = apply(T_hand @ poses[hull.link], hull.vertices) - middle
        inner = float(points[:, 1].min())
        face = points[points[:, 1] <= inner + PAD_FACE_M]
        if inner > 0 and face[:, 2].min() < PAD_REACH_M and face[:, 2].max() > -PAD_REACH_M:
            faces.append((inner, face))
    if not faces:
        return None
    _, face = min(faces, key=lambda f: f[0])
    return np.stack([face[:, 0], np.clip(face[:, 2], -PAD_REACH_M, PAD_REACH_M)], -1)


def _tip_z(robot: Robot) -> float:
    """How far the hand reaches beyond the pads' middle along the approach, at most."""
    widths = np.linspace(float(robot.opening.width_m[0]), robot.opening.max_m, OPENINGS).tolist()
    return max(float(hand_points(robot, width, robot.hand_links)[:, 2].max()) - robot.opening.pad_z_at(width) for width in widths)


def under_pads(
    shape: ConvexMesh, T: Array, hit: Contact, point: Array, u: Array, R: Array, pad: Pad, wall: bool = False
) -> tuple[float, float]:
    """Where flat pads first meet a mesh (enter, leave) along the line through `point` along u: before the line itself where facets or bumps
    beside it reach further. What of a part lies between the pads ends where its edges do, or enter, or where the pads' corners meet it.
    wall: `hit` is one stretch of several, and what a hole parts from it is not between the pads."""
    spans = [(hit.enter, hit.leave)]
    for x, z in product((-pad.half_x_m, pad.half_x_m), (pad.low_z_m, pad.high_z_m)):
        spans += [(c.enter, c.leave) for c in line_stretches(shape, T, point + x * R[:, 0] + z * R[:, 2], u)]
    axes = np.stack([R[:, 0], R[:, 2], u], -1)
    low, high = np.array([-pad.half_x_m, pad.low_z_m]), np.array([pad.half_x_m, pad.high_z_m])
    p, q = ((end @ T[:3, :3].T + T[:3, 3] - point) @ axes for end in _edges(shape))
    along = q - p
    with np.errstate(divide="ignore", invalid="ignore"):  # an edge along a side of the pad begins in it at -inf, beside it at inf
        sides = np.stack([(low - p[:, :2]) / along[:, :2], (high - p[:, :2]) / along[:, :2]])
    begins = np.fmax(np.fmin.reduce(sides).max(1), 0.0)
    ends = np.fmin(np.fmax.reduce(sides).min(1), 1.0)
    some = begins <= ends
    between = np.sort(p[some, 2:] + np.stack([begins[some], ends[some]], -1) * along[some, 2:], axis=1)
    spans += list(map(tuple, between.tolist()))
    return _joined(spans) if wall else (min(first for first, _ in spans), max(last for _, last in spans))


def _joined(spans: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The first of some spans of a line, with all others that are less than GAP_M from it, or from such ones."""
    low, high = spans[0]
    for first, last in sorted(spans):
        if first <= high + GAP_M:
            high = max(high, last)
    for first, last in sorted(spans, key=lambda span: -span[1]):
        if last >= low - GAP_M:
            low = min(low, first)
    return low, high


@lru_cache(maxsize=64)
def _edges(shape: ConvexMesh) -> tuple[Array, Array]:
    """Both ends (E, 3) of the edges of all parts' hulls."""
    from scipy.spatial import ConvexHull

    found = []
    for part in shape.parts:
        faces = ConvexHull(part).simplices
        edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])), axis=0)
        found.append(part[edges])
    ends = np.concatenate(found)
    return ends[:, 0], ends[:, 1]
