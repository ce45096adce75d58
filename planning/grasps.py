"""Grasps: antipodal pairs of points on a shape, approached horizontally, diagonally or from above.

A line through the shape along the closing direction gives two contact points; it is a grasp when both surface normals lie within the
friction cone about the line and the gripper opens wide enough. The closing direction is always horizontal, so that an object keeps its
upright pose when the hand holds it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product

import numpy as np

from kinematics.robots.gripper import ROOM_M, Opening
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds
from kinematics.transforms import Array, apply, inverse, transform

FRICTION_ANGLE = np.radians(10)
MESH_FRICTION_ANGLE = np.radians(20)  # smooth meshes face the fingers in no line exactly; friction of 0.5 holds 26.6°
SET_BACKS = (1.0, 0.5, 0.0)  # shares of how far a mesh, taken for a box, is set back: the first that holds; what is round needs less
BESIDE = (0.2, -0.2, 0.4, -0.4, 0.6, -0.6)  # where meshes are crossed beside their middle: shares of how far they reach there
MESH_HEIGHTS = (0.45, 0.3)  # heights of the pads on meshes beside the sampling's: what is round is widest at half of its height
CLEARANCE_M = 0.010  # the open fingers' distance to the object on each side, before they close
PITCHES = {"horizontal": (0.0,), "diagonal": (np.pi / 6, np.pi / 3), "downward": (np.pi / 2,)}
LOWEST_M = {"horizontal": 0.040, "diagonal": 0.020, "downward": 0.015}
"""The pads' centre above the floor, so that the hand clears it: of the named robots. Others are measured."""
IN_CABINET_M, CLEAR_M = 0.08, 0.003  # so much of a hand is in the cabinet with its fingers, and keeps so far from the floor
BELOW_TOP_M = 0.015
BEHIND_M = ROOM_M  # room between an object and what lies behind the pads: knuckles, palm
KNUCKLE_M = 0.020  # half of how wide a knuckle is, across the way the fingers close
SPARE_M = 0.004  # by which the fingers must open wider than the object, at least
PAD_FACE_M = 0.001  # corners of a finger this near to its innermost one belong to the pad
PAD_REACH_M = 0.025  # and no further than this from the pads' middle, along the approach
STEEP = 1.5  # rad: a hand of this pitch looks straight down
LEAST_BITE_M = 0.010  # how far the pads' middle reaches over an object's near end, at least
UP = np.array([0.0, 0.0, 1.0])
Headings = Callable[[Array, float], Sequence[Array]]
"""Where an arm of few joints can take a hand: with the middle between its pads at T (4, 4) when it is open by a width (m), but turned about
the vertical, or by half a turn about its z. The rotations (3, 3) that it then has."""


@dataclass(frozen=True)
class Sampling:
    """How many grasps are sampled. yaws: closing directions within half a turn, on what has no faces. backs_m: how much nearer to the hand
    than the middle, or than the gripper's depth lets it, a box may be taken. heights: of the pads, in shares of the object's. pitches: by
    approach, in rad."""

    yaws: int = 12
    backs_m: tuple[float, ...] = (0.0,)
    heights: tuple[float, ...] = (0.6, 0.85)
    pitches: Mapping[str, tuple[float, ...]] = field(default_factory=lambda: PITCHES)


@dataclass(frozen=True)
class Pad:
    """How large a flat pad is: half its width along the hand's x, and from where to where along z, from the pads' middle; metres."""

    half_x_m: float
    low_z_m: float
    high_z_m: float


@lru_cache(maxsize=16)
def pad_of(robot: Robot) -> Pad:
    """The face that closes, of the finger on the hand's left, half open: of its link that is innermost between the fingertips."""
    width = robot.opening.max_m / 2
    q = robot.home.copy()
    q[robot.gripper_joint] = robot.opening.value_at(width)
    poses = robot.link_poses(q)
    T_hand, middle = inverse(poses["hand"]), (0.0, robot.opening.pad_y_at(width), robot.opening.pad_z_at(width))
    faces = []
    for hull in (h for h in robot.hulls if h.link in robot.fingers):
        points = apply(T_hand @ poses[hull.link], hull.vertices) - middle
        inner = float(points[:, 1].min())
        face = points[points[:, 1] <= inner + PAD_FACE_M]
        if inner > 0 and face[:, 2].min() < PAD_REACH_M and face[:, 2].max() > -PAD_REACH_M:
            faces.append((inner, face))
    if not faces:
        return Pad(0.0, 0.0, 0.0)
    _, face = min(faces, key=lambda f: f[0])
    x, z = np.abs(face[:, 0]).max(), np.clip(face[:, 2], -PAD_REACH_M, PAD_REACH_M)
    return Pad(float(x), float(min(z.min(), 0.0)), float(max(z.max(), 0.0)))


Lowest = Callable[[str, float], float]
"""How high the pads' centre is above the floor, at least, by the approach and its pitch (rad), in metres."""


def usual_lowest(kind: str, pitch: float) -> float:
    """Of the named robots."""
    return LOWEST_M[kind]


@lru_cache(maxsize=16)
def lowest_of(robot: Robot) -> Lowest:
    """How low a robot's pads may be."""
    if robot.grip is None:
        return usual_lowest
    width = robot.opening.max_m / 2
    q = robot.home.copy()
    q[robot.gripper_joint] = robot.opening.value_at(width)
    poses, hand = robot.link_poses(q), robot.hand_links
    T_hand, middle = inverse(poses["hand"]), [0.0, 0.0, robot.opening.pad_z_at(width)]
    points = np.concatenate([apply(T_hand @ poses[h.link], h.vertices) - middle for h in robot.hulls if h.link in hand])
    points = points[points[:, 2] > -IN_CABINET_M]

    def lowest(kind: str, pitch: float) -> float:
        if pitch > STEEP:
            return float(points[:, 2].max()) + CLEAR_M
        return float((points[:, 2] * np.sin(pitch) - points[:, 0] * np.cos(pitch)).max()) + CLEAR_M

    return lowest


USUAL = Sampling()
DENSE = Sampling(36, (0.0, 0.01, 0.02), (0.3, 0.45, 0.6, 0.72, 0.85, 0.95), {**PITCHES, "diagonal": (np.pi / 6, np.pi / 4, np.pi / 3)})
"""All of the usual ones and many more: where a grasp that was not sampled would matter, as for proofs that there is none."""


@dataclass(frozen=True, eq=False)
class Contact:
    """Where a line enters and leaves a shape: distances (m) along it from its origin, and the outward normals (3,)."""

    enter: float
    leave: float
    enter_normal: Array
    leave_normal: Array


def line_contacts(shape: Shape, T: Array, origin: Array, direction: Array) -> Contact | None:
    """Cross a shape at pose T (4, 4) with the line origin + s · direction (world, unit direction); None when it misses."""
    T_object = inverse(T)
    o, d = T_object[:3, :3] @ origin + T_object[:3, 3], T_object[:3, :3] @ direction
    match shape:
        case Box():
            planes = np.concatenate([np.eye(3), -np.eye(3)])
            hits = [_through_planes(planes, np.tile(shape.half, 2), o, d)]
        case Cylinder():
            hits = [_through_cylinder(shape, o, d)]
        case ConvexMesh():
            hits = [_through_planes(rows[:, :3], rows[:, 3], o, d) for rows in _planes(shape)]
    through = [h for h in hits if h is not None]
    if not through:
        return None
    first, last = min(through, key=lambda h: h.enter), max(through, key=lambda h: h.leave)
    return Contact(first.enter, last.leave, T[:3, :3] @ first.enter_normal, T[:3, :3] @ last.leave_normal)


@lru_cache(maxsize=64)
def _planes(shape: ConvexMesh) -> tuple[Array, ...]:
    """The planes (H, 4) of each part."""
    from kinematics.meshes.cutting import planes_of  # brings scipy, which scenes without meshes do not need

    return tuple(planes_of(part) for part in shape.parts)


def _through_planes(normals: Array, offsets: Array, o: Array, d: Array) -> Contact | None:
    speed, gap = normals @ d, offsets - normals @ o
    along = np.abs(speed) < 1e-12
    if np.any(along & (gap < 0)):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        s = gap / speed
    entering, leaving = np.where(~along & (speed < 0), s, -np.inf), np.where(~along & (speed > 0), s, np.inf)
    i, j = int(np.argmax(entering)), int(np.argmin(leaving))
    return Contact(float(entering[i]), float(leaving[j]), normals[i], normals[j]) if entering[i] < leaving[j] else None


def _through_cylinder(shape: Cylinder, o: Array, d: Array) -> Contact | None:
    caps = _through_planes(np.array([UP, -UP]), np.full(2, shape.height_m / 2), o, d)
    if caps is None:
        return None
    a, b, c = d[0] ** 2 + d[1] ** 2, o[0] * d[0] + o[1] * d[1], o[0] ** 2 + o[1] ** 2 - shape.radius_m**2
    if a < 1e-12:
        return caps if c < 0 else None
    root = b * b - a * c
    if root <= 0:
        return None
    enter, leave = (-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a

    def side(s: float) -> Array:
        p = (o + s * d) * [1.0, 1.0, 0.0]
        return np.asarray(p / np.linalg.norm(p))

    first = (caps.enter, caps.enter_normal) if caps.enter > enter else (enter, side(enter))
    last = (caps.leave, caps.leave_normal) if caps.leave < leave else (leave, side(leave))
    return Contact(first[0], last[0], first[1], last[1]) if first[0] < last[0] else None


def closing_directions(shape: Shape, T: Array, sampling: Sampling = USUAL) -> list[float]:
    """Yaw angles in [0, π) of horizontal directions along which the fingers may close: a box's faces, elsewhere all round."""
    match shape:
        case Box():
            axes = T[:3, :3].T
            yaws = [float(np.arctan2(a[1], a[0])) for a in axes if abs(a[2]) < 0.2]
        case _:
            yaws = list(np.arange(sampling.yaws) * np.pi / sampling.yaws)
    return sorted({round(y % np.pi, 6) % round(np.pi, 6) for y in yaws})


def sample_grasps(
    body: Body,
    opening: Opening,
    approaches: Sequence[str],
    floor_z: float,
    toward: float,
    sampling: Sampling = USUAL,
    pad: Pad | None = None,
    headings: Headings | None = None,
    lowest: Lowest = usual_lowest,
) -> Iterator[Grasp]:
    """Antipodal grasps on a body, the most natural first: along the bearing `toward` (yaw in rad), flat before steep.

    opening: the gripper's table; approaches: parts of `kinematics.scene.APPROACHES`; floor_z: the height that the body stands on, world.
    pad: how large the pads are, so that they close on what of a mesh they meet first; without it they are lines. headings: how an arm of
    few joints looks at what has no faces, besides the yaws that are sampled. lowest: how low the pads may be.
    On a mesh those follow that meet it less squarely, or beside its middle, or that are set back less than its box would be: the pads may
    meet an edge there, or the palm the mesh.
    The hand's x points up, or for downward grasps out of the cabinet, so that a camera on that side sees over the object.
    """
    if opening.round_only and not isinstance(body.shape, Cylinder):
        return
    low, high = bounds(body.shape, body.T_world_body)
    middle = (low + high) / 2
    candidates: list[tuple[float, Array, Array, Array, tuple[float, float, float], float]] = []

    def across(yaw: float) -> float:
        """How wide the body is along a closing direction."""
        return 2 * float(body.shape.half @ np.abs(body.T_world_body[:3, :3].T @ [np.cos(yaw), np.sin(yaw), 0.0]))

    def levels_of(kind: str, pitch: float, width: float) -> list[float]:
        """Heights of the pads."""
        room = max(opening.depth_at(width) - BEHIND_M, 0.0)
        # a round body is no wider than a line where the knuckles are: its top alone has to fit before them
        least = high[2] - room / np.sin(pitch) if kind == "diagonal" and isinstance(body.shape, Cylinder) else -np.inf
        floor = floor_z + lowest(kind, pitch)
        heights = (_level(kind, low[2], high[2], floor, share, least) for share in sampling.heights)
        levels = sorted({z for z in heights if z is not None})
        if isinstance(body.shape, ConvexMesh):
            kind, floor = ("diagonal", floor_z + lowest("diagonal", pitch)) if kind == "downward" else (kind, floor)
            more = (_level(kind, low[2], high[2], floor, share) for share in MESH_HEIGHTS)
            levels += [z for z in dict.fromkeys(more) if z is not None and z not in levels]
        return levels

    def add(R: Array, ahead: Array, u: Array, pitch: float, rank: int, z: float) -> None:
        """Note the grasps of a hand R (3, 3) that looks along `ahead` (3,), level but for its pitch, and closes along u (3,)."""
        turn = abs((np.arctan2(ahead[1], ahead[0]) - toward + np.pi) % (2 * np.pi) - np.pi)
        reach = float(body.shape.half @ np.abs(body.T_world_body[:3, :3].T @ ahead))
        for back in sampling.backs_m if isinstance(body.shape, Box) and pitch == 0.0 else (0.0,):
            point, extent = np.array([middle[0], middle[1], z]), (reach, float(high[2] - z), pitch)
            candidates.append((turn + 0.5 * pitch + 0.3 * rank, point, u, R, extent, back))

    yaws = closing_directions(body.shape, body.T_world_body, sampling)
    kinds = [(kind, pitch) for kind in approaches for pitch in sampling.pitches[kind]]
    if headings is not None and not isinstance(body.shape, Box):
        there = np.array([np.cos(toward), np.sin(toward), 0.0])
        for kind, pitch in kinds:
            for rank, z in enumerate(levels_of(kind, pitch, across(toward + np.pi / 2))):
                T = transform(_level_hand(there, pitch), [middle[0], middle[1], z])
                through = line_contacts(body.shape, body.T_world_body, T[:3, 3], T[:3, 1])
                for R in [] if through is None else headings(T, through.leave - through.enter):
                    level = np.array([-R[1, 1], R[0, 1], 0.0])
                    add(R, level * np.sign(level @ (R[:, 2] if pitch < STEEP else there)), R[:, 1], pitch, rank, z)
    for yaw in yaws:
        width, u = across(yaw), np.array([np.cos(yaw), np.sin(yaw), 0.0])
        for kind, pitch in kinds:
            levels = levels_of(kind, pitch, width)
            for side in (1.0, -1.0):
                ahead = side * np.array([-u[1], u[0], 0.0])
                R = _level_hand(ahead, pitch)
                for rank, z in enumerate(levels):
                    add(R, ahead, u, pitch, rank, z)
    hits: dict[tuple[float, float, float], Contact | None] = {}
    left = []
    for candidate in sorted(candidates, key=lambda c: c[0]):
        _, point, u, R, extent, back = candidate
        hit = _crossed(body, point, u, 0.0, hits)
        grasp = _antipodal(body, opening, hit, point, u, R, extent, back, pad, FRICTION_ANGLE)
        if grasp is not None:
            yield grasp
        elif isinstance(body.shape, ConvexMesh):
            left.append(candidate)
    for _, point, u, R, (reach, above, pitch), back in left:
        level = np.array([-u[1], u[0], 0.0])
        wide = float(body.shape.half @ np.abs(body.T_world_body[:3, :3].T @ level))
        lines = [(beside, _crossed(body, point, u, beside, hits)) for beside in (share * wide for share in (0.0, *BESIDE))]
        for (beside, hit), share in product(sorted(lines, key=lambda line: _skew(line[1], u)), SET_BACKS):
            around = (reach + beside * float(np.sign(level @ R[:, 2])), above, pitch)
            grasp = _antipodal(body, opening, hit, point + beside * level, u, R, around, back, pad, MESH_FRICTION_ANGLE, share)
            if grasp is not None:
                yield grasp
                break


def _crossed(body: Body, point: Array, u: Array, beside: float, hits: dict[tuple[float, float, float], Contact | None]) -> Contact | None:
    """Where the line along u that passes so far beside a point meets the body, remembered: hands from both sides, and of all pitches, close
    along it."""
    line = (float(u[0]), float(point[2]), beside)
    if line not in hits:
        hits[line] = line_contacts(body.shape, body.T_world_body, point + beside * np.array([-u[1], u[0], 0.0]) if beside else point, u)
    return hits[line]


def _skew(hit: Contact | None, u: Array) -> float:
    """The larger angle, in rad, between a line along u and the surface's normals where it enters and leaves; π where it misses."""
    return np.pi if hit is None else float(np.arccos(np.clip(min(-hit.enter_normal @ u, hit.leave_normal @ u), -1, 1)))


def hand_looking(z: Array, ahead: Array | None = None) -> Array:
    """Rotation (3, 3) of a hand that looks along z (3,), its y level and its x up; ahead (3,): level, where it looks straight down."""
    level = z * [1.0, 1.0, 0.0] if ahead is None else ahead
    y = np.cross(level, UP) if ahead is None else np.cross(ahead, z)
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], -1)


def _level_hand(ahead: Array, pitch: float) -> Array:
    """Rotation (3, 3) of a hand that looks along `ahead` (3,), level, and down by `pitch`: it closes level, its x is up, or
    opposite to `ahead` if it looks straight down."""
    co, si = np.cos(pitch), np.sin(pitch)
    a, b = float(ahead[0]), float(ahead[1])
    y = (b, -a) if pitch < STEEP else (-b, a)  # approach × up, or ahead × approach
    z = (co * a, co * b, -si)
    x = (y[1] * z[2], -y[0] * z[2], y[0] * z[1] - y[1] * z[0])
    return np.array([[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], 0.0, z[2]]])


def _level(kind: str, low: float, high: float, floor: float, share: float, least: float = -np.inf) -> float | None:
    """The height of the pads' centre, or None when the body is too low for this approach. floor: the lowest that the pads may be, world.
    least: from here on the body's top fits before what lies behind the pads of a pitched hand; where the pads can't be as high as that,
    they are as high as they can."""
    highest = high - min(BELOW_TOP_M, 0.3 * (high - low))
    wanted = high - 0.02 if kind == "downward" else low + share * (high - low)
    z = max(wanted, floor, min(least, highest))
    return round(z, 6) if z <= highest else None


def _behind(reach: float, above: float, pitch: float) -> float:
    """How far a box reaches behind the pads' middle along the approach of a pitched hand, between its knuckles: `reach` towards the hand
    and `above` upwards. Its near face ends that, or its top."""
    by_face = (reach + KNUCKLE_M * np.sin(pitch)) / max(np.cos(pitch), 1e-9)
    return float(min(by_face, reach * np.cos(pitch) + above * np.sin(pitch)))


def set_back(reach: float, width_m: float, opening: Opening) -> float:
    """How far before an object's middle the pads must close, so that what lies behind them fits: metres along the approach.

    reach: how far the object extends from its middle towards the hand; its shape is taken for a box.
    """
    return min(max(0.0, reach + BEHIND_M - opening.depth_at(width_m)), _most_back(reach))


def _most_back(reach: float) -> float:
    """The most that a grasp may be set back."""
    return max(0.0, reach - LEAST_BITE_M)


def _set_back_pitched(reach: float, above: float, pitch: float, width_m: float, opening: Opening, more: float) -> float:
    """`set_back`, for a level hand by so much more; for a pitched one, which moves upwards with it, so that the pads stay on the body."""
    if pitch == 0.0:
        return min(set_back(reach, width_m, opening) + more, _most_back(reach))
    back = max(0.0, _behind(reach, above, pitch) + BEHIND_M - opening.depth_at(width_m))
    over = _most_back(reach) / max(np.cos(pitch), 1e-9)
    return float(min(back, over, max(0.0, above - BELOW_TOP_M) / np.sin(pitch)))


def _antipodal(
    body: Body,
    opening: Opening,
    hit: Contact | None,
    point: Array,
    u: Array,
    R: Array,
    extent: tuple[float, float, float],
    back: float,
    pad: Pad | None,
    friction_angle: float,
    share: float = 1.0,
) -> Grasp | None:
    """The grasp with the pads' centre on the line through `point` along u, which meets the body so, or where that is too deep, nearer to
    the hand; or None. extent: the body's, see `_behind`. back: how much nearer still (m), where the body reaches so far. pad: see
    `sample_grasps`. friction_angle: between the line and the surface's normals at most. share: of how far the pads are set back."""
    if hit is None:
        return None
    back = 0.0 if isinstance(body.shape, Cylinder) else _set_back_pitched(*extent, hit.leave - hit.enter, opening, back)
    if back > 0.0:
        point = point - share * back * R[:, 2]
        hit = line_contacts(body.shape, body.T_world_body, point, u)
    cone = np.cos(friction_angle)
    if hit is None or -hit.enter_normal @ u < cone or hit.leave_normal @ u < cone:
        return None
    enter, leave = hit.enter, hit.leave
    if pad is not None and isinstance(body.shape, ConvexMesh):
        enter, leave = _under_pads(body.shape, body.T_world_body, hit, point, u, R, pad)
    width = leave - enter
    if width + SPARE_M > opening.max_m:
        return None
    centre = point + 0.5 * (enter + leave) * u
    return Grasp(transform(R, opening.hand_position(centre, R, width)), float(width))


def _under_pads(shape: ConvexMesh, T: Array, hit: Contact, point: Array, u: Array, R: Array, pad: Pad) -> tuple[float, float]:
    """Where flat pads first meet a mesh (enter, leave) along the line through `point` along u: before the line itself where facets or bumps
    beside it reach further. What of a part lies between the pads ends where its edges do, or enter, or where the pads' corners meet it."""
    reached = [hit.enter, hit.leave]
    for x, z in product((-pad.half_x_m, pad.half_x_m), (pad.low_z_m, pad.high_z_m)):
        corner = line_contacts(shape, T, point + x * R[:, 0] + z * R[:, 2], u)
        if corner is not None:
            reached += [corner.enter, corner.leave]
    axes = np.stack([R[:, 0], R[:, 2], u], -1)
    low, high = np.array([-pad.half_x_m, pad.low_z_m]), np.array([pad.half_x_m, pad.high_z_m])
    for a, b in _edges(shape):
        p, q = ((end @ T[:3, :3].T + T[:3, 3] - point) @ axes for end in (a, b))
        along = q - p
        with np.errstate(divide="ignore", invalid="ignore"):  # an edge along a side of the pad is never in or out by it: inf, or nan
            sides = np.stack([(low - p[:, :2]) / along[:, :2], (high - p[:, :2]) / along[:, :2]])
        begins = np.fmax(np.fmin.reduce(sides).max(1), 0.0)
        ends = np.fmin(np.fmax.reduce(sides).min(1), 1.0)
        beside = ((along[:, :2] == 0) & ((p[:, :2] < low) | (p[:, :2] > high))).any(1)
        some = (begins <= ends) & ~beside
        reached += [*(p[some, 2] + begins[some] * along[some, 2]), *(p[some, 2] + ends[some] * along[some, 2])]
    return float(min(reached)), float(max(reached))


@lru_cache(maxsize=64)
def _edges(shape: ConvexMesh) -> tuple[tuple[Array, Array], ...]:
    """Both ends (E, 3) of the edges of each part's hull."""
    from scipy.spatial import ConvexHull

    found = []
    for part in shape.parts:
        faces = ConvexHull(part).simplices
        edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
        found.append((part[edges[:, 0]], part[edges[:, 1]]))
    return tuple(found)


def open_width(width_m: float, opening: Opening) -> float:
    """How wide the fingers are before they close on an object of this width."""
    return float(min(width_m + 2 * CLEARANCE_M, opening.max_m))
