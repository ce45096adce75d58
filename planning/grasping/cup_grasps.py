"""Grasps of a suction cup: where its whole face lies on a flat, or hardly curved, face of a body.

The hand looks against the face's normal: at an upright side level, at a top straight down. Sides are taken at several heights, and about a
top the hand may turn as it likes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain

import numpy as np

from kinematics.robots.hands.opening import Opening
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds
from kinematics.transforms import Array, transform
from planning.grasping.finger_grasps import sample_grasps
from planning.grasping.hand_poses import Lowest, hand_looking, lowest_of, usual_lowest
from planning.grasping.marginal_grasps import marginal_grasps
from planning.grasping.pads import inner_pad_of, pad_of
from planning.grasping.sampling import USUAL, Headings, Sampling

EDGE_M = 0.001  # what a cup keeps from the edges of what it holds
SAG_M = 0.0002  # by which a curved face may fall away below a cup's lip
LEVEL, DOWN = np.sin(np.radians(10)), np.sin(np.radians(80))
"""A face whose normal rises by less is an upright side, by more a top; the sine."""
COPLANAR = np.cos(np.radians(2))
MOST_FACES = 24  # of a mesh, the largest


@dataclass(frozen=True, eq=False)
class Face:
    """A flat face of a shape, in its own frame: the outward normal (3,), its middle (3,), and how far a cup may be moved from there along
    two directions across it, along (2, 3), room_m (2,): half of the face's size."""

    normal: Array
    middle: Array
    along: Array
    room_m: Array


def grasps_on(
    body: Body, robot: Robot, approaches: Sequence[str], floor_z: float, toward: float, sampling: Sampling = USUAL,
    headings: Headings | None = None,
) -> Iterator[Grasp]:  # fmt: skip
    """The grasps of a robot's hand on a body, be it fingers (`finger_grasps.sample_grasps`) or a cup; the most natural first."""
    if robot.opening.cup_m:
        return cup_grasps(body, robot.opening, approaches, floor_z, toward, sampling, headings, lowest_of(robot))
    natural = sample_grasps(body, robot.opening, approaches, floor_z, toward, sampling, pad_of(robot), headings, lowest_of(robot))
    pad = pad_of(robot) if sampling.beyond_m else inner_pad_of(robot)  # a proof takes all that may hold, others what does
    return chain(natural, marginal_grasps(body, robot.opening, approaches, toward, sampling, pad, headings))


def cup_grasps(
    body: Body, opening: Opening, approaches: Sequence[str], floor_z: float, toward: float, sampling: Sampling = USUAL,
    headings: Headings | None = None, lowest: Lowest = usual_lowest,
) -> Iterator[Grasp]:  # fmt: skip
    """Grasps of a cup on the faces of a body, those along the bearing `toward` (yaw in rad) first, level before steep; see
    `sample_grasps`."""
    R_body, radius = body.T_world_body[:3, :3], opening.cup_m / 2
    low, high = bounds(body.shape, body.T_world_body)
    found = list[tuple[float, Array]]()
    there = np.array([np.cos(toward), np.sin(toward), 0.0])
    for face in faces_of(body.shape, radius, R_body.T @ -there):
        normal, middle = R_body @ face.normal, (body.T_world_body @ [*face.middle, 1.0])[:3]
        rise = float(normal[2])
        kind = "horizontal" if abs(rise) < LEVEL else "downward" if rise > DOWN else "diagonal"
        if kind not in approaches or rise < -LEVEL or (face.room_m < radius + EDGE_M).any():
            continue
        pitch = float(np.arcsin(np.clip(rise, 0.0, 1.0)))
        for rank, point in enumerate(
            _points(face, R_body, middle, radius, floor_z + lowest(kind, pitch), float(high[2] - low[2]), sampling)
        ):
            for R in _hands(normal, kind, there, point, sampling, headings, opening.cup_m):
                ahead = R[:, 2] if kind != "downward" else -R[:, 0]
                turn = abs((np.arctan2(ahead[1], ahead[0]) - toward + np.pi) % (2 * np.pi) - np.pi)
                found.append((turn + 0.5 * pitch + 0.3 * rank, transform(R, point)))
    for _, T in sorted(found, key=lambda f: f[0]):
        yield Grasp(T, opening.cup_m)


def _points(face: Face, R_body: Array, middle: Array, radius: float, lowest: float, height: float, sampling: Sampling) -> list[Array]:
    """Where a cup may be on a face, world: at several heights of an upright side, above `lowest`, in the middle of any other."""
    along = face.along @ R_body.T
    up = int(np.argmax(np.abs(along[:, 2])))
    if abs(along[up, 2]) < 0.5:
        return [middle] if middle[2] >= lowest else []
    room, rise = float(face.room_m[up] - radius - EDGE_M), along[up] / along[up, 2]
    lows, highs = middle[2] - room * abs(along[up, 2]), middle[2] + room * abs(along[up, 2])
    wanted = [middle[2] + (share - 0.5) * height for share in sampling.heights]
    levels = dict.fromkeys(round(float(max(min(z, highs), lows, lowest)), 6) for z in wanted)
    return [middle + (z - middle[2]) * rise for z in levels if z <= highs + 1e-9]


def _hands(
    normal: Array, kind: str, there: Array, point: Array, sampling: Sampling, headings: Headings | None, width: float
) -> list[Array]:
    """How a hand (3, 3) may look at a face: against its normal; turned about it where that points up, and by half a turn elsewhere."""
    if kind != "downward":
        R = hand_looking(-normal)
        return [R, R @ np.diag([-1.0, -1.0, 1.0])]
    if headings is not None:
        return list(headings(transform(hand_looking(-normal, there), point), width))
    yaws = np.arctan2(there[1], there[0]) + np.arange(sampling.yaws) * 2 * np.pi / sampling.yaws
    return [hand_looking(-normal, np.array([np.cos(yaw), np.sin(yaw), 0.0])) for yaw in yaws]


def faces_of(shape: Shape, radius_m: float, toward_hand: Array) -> Sequence[Face]:
    """The faces of a shape on which a cup may be. toward_hand (3,): where the hand comes from, in the shape's frame: where on a hardly
    curved side it meets it."""
    match shape:
        case Box():
            return [_box_face(shape, axis, sign) for axis in range(3) for sign in (1.0, -1.0)]
        case Cylinder():
            top = np.array([0.0, 0.0, shape.height_m / 2])
            ends = [Face(top / top[2] * s, top * s, np.eye(3)[:2], np.full(2, shape.radius_m)) for s in (1.0, -1.0)]
            if shape.radius_m <= radius_m or shape.radius_m - np.sqrt(shape.radius_m**2 - radius_m**2) > SAG_M:
                return ends
            out = toward_hand * [1.0, 1.0, 0.0]
            out = out / max(float(np.linalg.norm(out)), 1e-9)
            side = Face(
                out, shape.radius_m * out, np.array([[0.0, 0.0, 1.0], [-out[1], out[0], 0.0]]), np.array([shape.height_m / 2, np.inf])
            )
            return [*ends, side]
        case ConvexMesh():
            return _mesh_faces(shape)


def _box_face(shape: Box, axis: int, sign: float) -> Face:
    normal, others = sign * np.eye(3)[axis], [i for i in range(3) if i != axis]
    return Face(normal, shape.half[axis] * normal, np.eye(3)[others], shape.half[others])


@lru_cache(maxsize=64)
def _mesh_faces(shape: ConvexMesh) -> tuple[Face, ...]:
    """The largest flat faces of a mesh's parts; how much room there is on each is the verdict's to say."""
    from scipy.spatial import ConvexHull

    found = list[tuple[float, Face]]()
    for part in shape.parts:
        hull = ConvexHull(part)
        a, b, c = (part[hull.simplices[:, i]] for i in range(3))
        area, left = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, np.ones(len(hull.simplices), bool)
        while left.any():
            seed = int(np.argmax(np.where(left, area, -1.0)))
            normal = hull.equations[seed, :3]
            same = left & (hull.equations[:, :3] @ normal > COPLANAR)
            same[seed] = True
            left &= ~same
            corners = part[np.unique(hull.simplices[same])]
            middle = (area[same, None] * (a + b + c)[same] / 3).sum(0) / max(float(area[same].sum()), 1e-12)
            up = np.eye(3)[2] - normal[2] * normal
            first = up / np.linalg.norm(up) if np.linalg.norm(up) > 1e-6 else np.eye(3)[0]
            along = np.stack([first, np.cross(normal, first)])
            room = np.abs((corners - middle) @ along.T).max(0)
            found.append((float(area[same].sum()), Face(normal, middle, along, room)))
    found.sort(key=lambda f: -f[0])
    return tuple(face for _, face in found[:MOST_FACES])
