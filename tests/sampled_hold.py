"""A stranger's word on a hold: pinocchio puts the fingers where they are, and many points on the body's surface say what the pads touch.

Nothing of ours is imported. What goes in are the raw JSON shape of an object, its pose in the hand's frame, the URDF that `retrieve robots
NAME --urdf FILE` writes, and the gripper joint's value. The answer is HOLDS, FAILS, or UNDECIDED where a measure is so near to its
threshold that points can't tell.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, cKDTree

HOLDS, FAILS, UNDECIDED = "holds", "fails", "undecided"
Json = dict[str, Any]

GAP_M, DEPTH_M, WIDTH_M, PATCH_M, MU = 0.0005, 0.001, 0.003, 0.001, 0.5
BAND_M, BAND_WIDTH_M, BAND_RAD = 0.00015, 0.001, np.radians(4)
SPACING_M = 0.0004
AWAY_M = 0.012  # how far a pad is drawn back to see along which line it meets the body
INNER_M = 0.0003  # what is this near to a finger's innermost plane is its pad


@dataclass(frozen=True)
class Surface:
    """Points (N, 3) on a body's surface with outward normals (N, 3)."""

    points: np.ndarray
    normals: np.ndarray

    def moved(self, T: np.ndarray) -> Surface:
        return Surface(self.points @ T[:3, :3].T + T[:3, 3], self.normals @ T[:3, :3].T)

    def near(self, low: np.ndarray, high: np.ndarray) -> Surface:
        inside = ((self.points >= low) & (self.points <= high)).all(1)
        return Surface(self.points[inside], self.normals[inside])


def surface(shape: Json) -> Surface:
    """Points on a box or a cylinder, SPACING_M apart."""
    if shape["type"] == "box":
        return _box(np.array(shape["size_m"], float))
    assert shape["type"] == "cylinder", shape
    return _cylinder(float(shape["radius_m"]), float(shape["height_m"]))


@lru_cache(maxsize=64)
def _surface(shape: str) -> Surface:
    return surface(json.loads(shape))


def _box(size: np.ndarray) -> Surface:
    points, normals = [], []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        grid = np.meshgrid(*(np.linspace(-size[k] / 2, size[k] / 2, int(np.ceil(size[k] / SPACING_M)) + 1) for k in (u, v)))
        for side in (-1, 1):
            face = np.zeros((grid[0].size, 3))
            face[:, u], face[:, v], face[:, axis] = grid[0].ravel(), grid[1].ravel(), side * size[axis] / 2
            points.append(face)
            normals.append(np.tile(side * np.eye(3)[axis], (len(face), 1)))
    return Surface(np.concatenate(points), np.concatenate(normals))


def _cylinder(radius: float, height: float) -> Surface:
    n, m = int(np.ceil(2 * np.pi * radius / SPACING_M)), int(np.ceil(height / SPACING_M)) + 1
    angle, z = (a.ravel() for a in np.meshgrid(2 * np.pi * np.arange(n) / n, np.linspace(-height / 2, height / 2, m)))
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], -1)
    points, normals = [out * radius + np.stack([0 * z, 0 * z, z], -1)], [out]
    rings = np.linspace(0, radius, int(np.ceil(radius / SPACING_M)) + 1)
    for side in (-1, 1):
        disc = np.concatenate([_ring(r, side * height / 2) for r in rings])
        points.append(disc)
        normals.append(np.tile([0.0, 0.0, float(side)], (len(disc), 1)))
    return Surface(np.concatenate(points), np.concatenate(normals))


def _ring(radius: float, z: float) -> np.ndarray:
    n = max(1, int(np.ceil(2 * np.pi * radius / SPACING_M)))
    angle = 2 * np.pi * np.arange(n) / n
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, z)], -1)


# ---------------------------------------------------------------------------------------------------------------- the hand


@dataclass(frozen=True)
class Hull:
    """A link's solid in the hand's frame: corners, and planes n · x <= d. pad: the side, 1 or -1, on which it closes on objects, or 0."""

    link: str
    corners: np.ndarray
    planes: np.ndarray
    finger: bool
    pad: int = 0

    def depth(self, points: np.ndarray) -> np.ndarray:
        """How deep points are in it; negative outside."""
        return np.asarray((self.planes[:, 3] - points @ self.planes[:, :3].T).min(1))


class Gripper:
    """The part of a URDF that goes with the link `hand`, in pinocchio."""

    def __init__(self, urdf: str, joint: str) -> None:
        self.model = pin.buildModelFromXML(urdf)
        self.geometry = pin.buildGeomFromUrdfString(self.model, urdf, pin.COLLISION)
        self.data, self.urdf, self.joint = self.model.createData(), urdf, joint
        self.hand = self.model.frames[self.model.getFrameId("hand")]
        self.follows = _mimics(urdf)
        self.moving = [i for i in range(1, self.model.njoints) if self._source(self.model.names[i])[0] == joint]
        index = self.model.joints[self.model.getJointId(joint)].idx_q
        self.low, self.high = (float(limits[index]) for limits in (self.model.lowerPositionLimit, self.model.upperPositionLimit))
        self.pads = {0: 0}  # number of a solid to its side; nothing yet
        half_open = self.hulls((self.low + self.high) / 2)
        self.pads = {_innermost(half_open, side): side for side in (1, -1)}

    def _source(self, name: str) -> tuple[str, float, float]:
        scale, offset = 1.0, 0.0
        while name in self.follows:
            source, multiplier, more = self.follows[name]
            scale, offset, name = scale * multiplier, offset + scale * more, source
        return name, scale, offset

    def hulls(self, value: float) -> list[Hull]:
        """The solids of the hand and its fingers at a value of the gripper's joint."""
        out = []
        for link, finger, points in self._solids(value):
            hull = ConvexHull(points)
            planes = np.unique(np.c_[hull.equations[:, :3], -hull.equations[:, 3]].round(10), axis=0)
            out.append(Hull(link, points[hull.vertices], planes, finger, self.pads.get(len(out), 0)))
        return out

    def width(self, value: float) -> float:
        """How far the pads are apart at a value of the gripper's joint."""
        return sum(float((p[:, 1] * self.pads[i]).min()) for i, (_, _, p) in enumerate(self._solids(value)) if i in self.pads)

    def _solids(self, value: float) -> list[tuple[str, bool, np.ndarray]]:
        """Link, whether it is a finger, and corners in the hand's frame of each solid."""
        q = pin.neutral(self.model)
        for i in self.moving:
            _, scale, offset = self._source(self.model.names[i])
            q[self.model.joints[i].idx_q] = scale * value + offset
        pin.forwardKinematics(self.model, self.data, q)
        T_hand = np.linalg.inv((self.data.oMi[self.hand.parentJoint] * self.hand.placement).homogeneous)
        out = []
        for g in self.geometry.geometryObjects:
            finger = any(i in self.moving for i in self.model.supports[g.parentJoint])
            if finger or g.parentJoint == self.hand.parentJoint:
                T = T_hand @ (self.data.oMi[g.parentJoint] * g.placement).homogeneous
                points = _corners(g.geometry) @ T[:3, :3].T + T[:3, 3]
                out.append((self.model.frames[g.parentFrame].name, finger, points))
        return out


@lru_cache(maxsize=4)
def gripper(urdf: str, joint: str) -> Gripper:
    return Gripper(urdf, joint)


def _mimics(urdf: str) -> dict[str, tuple[str, float, float]]:
    import xml.etree.ElementTree as ElementTree

    found = {}
    for j in ElementTree.fromstring(urdf).iter("joint"):
        if (m := j.find("mimic")) is not None:
            found[j.get("name", "")] = (m.get("joint", ""), float(m.get("multiplier", 1)), float(m.get("offset", 0)))
    return found


def _corners(geometry: Any) -> np.ndarray:
    if isinstance(geometry, coal.Box):
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return np.asarray(signs * np.array(geometry.halfSide))
    assert isinstance(geometry, coal.BVHModelBase), type(geometry)
    return np.array(geometry.vertices())  # pinocchio has applied the scale already


# ---------------------------------------------------------------------------------------------------------------- the hold


def hold(shape: Json, T_hand_body: np.ndarray, hulls: list[Hull], *, whole_hand: bool = True) -> str:
    """Whether the two pads hold a body. whole_hand: the rest of the hand must not be in it, either."""
    reach = np.concatenate([h.corners for h in hulls])
    skin = _surface(json.dumps(shape)).moved(T_hand_body).near(reach.min(0) - AWAY_M, reach.max(0) + AWAY_M)
    said, contacts = [], []
    for side in (1, -1):
        pad = _pad(hulls, side)
        answer, contact = _at_pad(skin, pad, side)
        said.append(answer)
        contacts.append(contact)
    if whole_hand:
        said.append(_clear(shape, T_hand_body, skin, hulls))
    if FAILS in said:
        return FAILS
    if None not in contacts:
        said.append(_friction(*contacts))  # type: ignore[arg-type]
    return FAILS if FAILS in said else UNDECIDED if UNDECIDED in said else HOLDS


def _innermost(hulls: list[Hull], side: int) -> int:
    """The number of the finger's solid that is innermost on one side, beside the hand's origin."""
    mine = [i for i, h in enumerate(hulls) if h.finger and h.corners[:, 1].mean() * side > 0]
    beside = [i for i in mine if hulls[i].corners[:, 2].min() < 0.015 and hulls[i].corners[:, 2].max() > -0.015]
    return min(beside, key=lambda i: float((hulls[i].corners[:, 1] * side).min()))


def _pad(hulls: list[Hull], side: int) -> Hull:
    return next(h for h in hulls if h.pad == side)


@dataclass(frozen=True)
class Contact:
    """Where a pad meets a body: points of the patch (N, 3), and the line (3,) along which it presses."""

    patch: np.ndarray
    normal: np.ndarray


def _at_pad(skin: Surface, pad: Hull, side: int) -> tuple[str, Contact | None]:
    """What one pad finds, and the contact if there is one."""
    inner = float((pad.corners[:, 1] * side).min())
    face = pad.corners[pad.corners[:, 1] * side < inner + INNER_M]
    outline = ConvexHull(face[:, [0, 2]]).equations
    facing = skin.points[(skin.points[:, [0, 2]] @ outline[:, :2].T + outline[:, 2] <= 1e-9).all(1)]
    ahead = inner - facing[:, 1] * side  # from the pad inwards
    if not len(facing) or ahead.max() < 0:
        return _beside(skin, face, outline), None
    gap = float(ahead.min())
    if gap > GAP_M + BAND_M or gap < -DEPTH_M - BAND_M:
        return FAILS, None
    patch = facing[ahead <= gap + PATCH_M]
    width = _least_width(patch[:, [0, 2]])
    if width < WIDTH_M - BAND_WIDTH_M:
        return FAILS, None
    unsure = gap > GAP_M - BAND_M or gap < -DEPTH_M + BAND_M or width < WIDTH_M + BAND_WIDTH_M
    return UNDECIDED if unsure else HOLDS, Contact(patch, _line(skin, face, side))


def _beside(skin: Surface, face: np.ndarray, outline: np.ndarray) -> str:
    """No point lies before the pad: undecided when one nearly does, for it may be the points' fault."""
    if not len(skin.points):
        return FAILS
    off = (skin.points[:, [0, 2]] @ outline[:, :2].T + outline[:, 2]).max(1)
    return UNDECIDED if off.min() < SPACING_M else FAILS


def _line(skin: Surface, face: np.ndarray, side: int) -> np.ndarray:
    """The direction from the pad, drawn back a little, to the nearest point of the body."""
    low, high = face[:, [0, 2]].min(0), face[:, [0, 2]].max(0)
    outline = ConvexHull(face[:, [0, 2]]).equations
    grid = np.stack(np.meshgrid(*(np.linspace(a, b, int((b - a) / SPACING_M) + 2) for a, b in zip(low, high))), -1).reshape(-1, 2)
    grid = grid[(grid @ outline[:, :2].T + outline[:, 2] <= 1e-9).all(1)]
    y = float((face[:, 1] * side).min()) * side + AWAY_M * side
    pad = np.c_[grid[:, 0], np.full(len(grid), y), grid[:, 1]]
    around = skin.near(pad.min(0) - 2 * AWAY_M, pad.max(0) + 2 * AWAY_M)
    distance, which = cKDTree(around.points).query(pad)
    close = distance < distance.min() + 1e-5
    ways = around.points[which[close]] - pad[close]
    way = ways.mean(0)
    return np.asarray(way / np.linalg.norm(way))


def _friction(a: Contact, b: Contact) -> str:
    """Whether some line between both patches lies in both friction cones."""
    cone, best = float(np.arctan(MU)), np.inf
    p, q = (c.patch[:: max(1, len(c.patch) // 300)] for c in (a, b))
    ways = q[None] - p[:, None]
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    off = np.maximum(np.arccos(np.clip(ways @ a.normal, -1, 1)), np.arccos(np.clip(-ways @ b.normal, -1, 1)))
    best = float(off.min())
    return HOLDS if best < cone - BAND_RAD else FAILS if best > cone + BAND_RAD else UNDECIDED


def _least_width(points: np.ndarray) -> float:
    """The least extent of points (N, 2) over all directions."""
    angle = np.linspace(0, np.pi, 180, endpoint=False)
    along = points @ np.stack([np.cos(angle), np.sin(angle)])
    return float(np.ptp(along, axis=0).min())


def _clear(shape: Json, T_hand_body: np.ndarray, skin: Surface, hulls: list[Hull]) -> str:
    """The rest of the hand is not in the body; fingers may press as deep as pads may."""
    answer = HOLDS
    for hull in hulls:
        bound = DEPTH_M if hull.finger else 0.0
        near = skin.near(hull.corners.min(0), hull.corners.max(0)).points
        corners = (hull.corners - T_hand_body[:3, 3]) @ T_hand_body[:3, :3]
        deep = max(float(hull.depth(near).max(initial=-1.0)), float(_depth_in(shape, corners).max()))
        if deep > bound + BAND_M:
            return FAILS
        if deep > bound - BAND_M:
            answer = UNDECIDED
    return answer


def _depth_in(shape: Json, points: np.ndarray) -> np.ndarray:
    """How deep points in a body's own frame are in it; negative outside."""
    if shape["type"] == "box":
        return np.asarray((np.array(shape["size_m"]) / 2 - np.abs(points)).min(1))
    radial = shape["radius_m"] - np.hypot(points[:, 0], points[:, 1])
    return np.minimum(radial, shape["height_m"] / 2 - np.abs(points[:, 2]))


def in_walls(hulls: list[Hull], walls: list[tuple[np.ndarray, np.ndarray]]) -> str:
    """Whether the hand keeps out of boxes: half edges (3,) and pose T_hand_box (4, 4) of each."""
    answer = HOLDS
    for hull in hulls:
        ways = np.roll(hull.corners, 1, axis=0) - hull.corners
        points = np.concatenate([hull.corners + s * ways for s in (0.0, 0.25, 0.5, 0.75)])
        for half, T in walls:
            deep = float((half - np.abs((points - T[:3, 3]) @ T[:3, :3])).min(1).max())
            if deep > 2 * BAND_M:
                return FAILS
            if deep > -5 * BAND_M:
                answer = UNDECIDED
    return answer
