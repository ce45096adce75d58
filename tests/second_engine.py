"""A stranger replays a plan: pinocchio moves the arm, coal says what touches; nothing of ours is imported.

What goes in are the raw JSON objects of the scene and plan formats and the URDF that `retrieve robots NAME --urdf FILE` writes. Everything
else (walls, mimic joints, which links are neighbours, where objects stand) is worked out here a second time, from the formats' text.

A plan is asked about at samples so near to each other that no point moves further than a step. Few of them have to be looked at: a distance
is also a statement about its surroundings, since it cannot shrink faster than the two bodies move. See `_deepest`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.interpolate import BPoly

CONTACT_M = 0.001  # deeper than this is a collision
TOUCH_M = 0.003  # and so is this, even where touching is allowed; a parameter of `replay`
POSE_M, POSE_RAD = 0.001, 0.001
GAP = 1e-6
LIMIT = 1e-5  # rad or m; files round
GRIP_M = 0.003  # a finger this near to the object holds it
REST_M = 0.005  # what is put down stands at most this far above the floor
PIECE_RAD = 0.02  # rad or m; no joint moves further in a piece of a path
CHORD_RAD = 2e-5  # how far straight pieces may be from a spline
SLACK_M = 2e-5  # what coal's distances and depths are trusted to, twentyfold

STAGES = ("transit", "approach", "grasp", "lift", "transfer", "lower", "release", "retreat", "look")
FLOOR_STAGES = ("grasp", "lift", "lower", "release")
Json = dict[str, Any]


@dataclass(frozen=True)
class Problem:
    """What is wrong with a plan, of which kind, in which motion, and how deep where something touches.

    kind: form, limit, time, speed, gap, jump, grip, contact, allowance, rest, move, goal.
    """

    kind: str
    text: str
    motion: int | None = None
    depth_m: float = 0.0

    def __str__(self) -> str:
        return (f"motion {self.motion}: " if self.motion is not None else "") + f"{self.kind}: {self.text}"


def replay(
    scene: Json, plan: Json, urdf_file: str | Path, step_m: float = 0.001, folder: str | Path = ".", touch_m: float = TOUCH_M
) -> list[Problem]:
    """Everything that is wrong with a plan; an empty list when it holds.

    step_m: no point of the arm or the held object moves further between two samples; what is said is what looking at every one of them
    would say. folder: where the scene's mesh files are. touch_m: how deep bodies may press into each other where touching is allowed.
    """
    return Replay(scene, plan, urdf_file, step_m, folder, touch_m).run()


# ---------------------------------------------------------------------------------------------------------------- solids


@dataclass(frozen=True)
class Solid:
    """A named geometry, the box [low, high] around it in its own frame, and the ball around that box."""

    name: str
    geometry: Any
    low: np.ndarray
    high: np.ndarray
    keep: Any = field(default=None, repr=False)  # what owns the geometry's memory

    @cached_property
    def centre(self) -> np.ndarray:
        return (self.low + self.high) / 2

    @cached_property
    def radius(self) -> float:
        return float(np.linalg.norm(self.high - self.low) / 2)

    @cached_property
    def corners(self) -> np.ndarray:
        return np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (self.high - self.low) + self.low


def solid(name: str, geometry: Any, convex: bool = True) -> Solid:
    """Wrap a geometry; a mesh becomes its convex hull, or stays a surface when `convex` is False."""
    keep = geometry
    if isinstance(geometry, coal.BVHModelBase):
        geometry.buildConvexHull(True, "Qt")
        hull = geometry.convex
        geometry = hull if convex or geometry.computeVolume() >= 0.98 * hull.computeVolume() else geometry
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    return Solid(name, geometry, np.array(box.min_), np.array(box.max_), keep)


def body_solid(entry: Json, folder: Path) -> Solid:
    """The solid of one of a scene's objects."""
    shape, name = entry["shape"], entry["name"]
    if shape["type"] == "box":
        return solid(name, coal.Box(*map(float, shape["size_m"])))
    if shape["type"] == "cylinder":
        return solid(name, coal.Cylinder(float(shape["radius_m"]), float(shape["height_m"])))
    mesh = coal.MeshLoader().load(str(folder / shape["file"]), np.full(3, float(shape.get("scale", 1.0))))
    return solid(name, mesh, convex=False)


def walls(cabinet: Json) -> list[tuple[Solid, np.ndarray]]:
    """The five walls round the inner space [0, x] × [-y/2, y/2] × [0, z], open towards -x, each with its pose in the world."""
    (x, y, z), w, T = cabinet["size_m"], cabinet["wall_m"], matrix(cabinet["T_world_cabinet"])
    spans = {
        "floor": ((0, x + w), (-y / 2 - w, y / 2 + w), (-w, 0)),
        "ceiling": ((0, x + w), (-y / 2 - w, y / 2 + w), (z, z + w)),
        "left": ((0, x + w), (y / 2, y / 2 + w), (0, z)),
        "right": ((0, x + w), (-y / 2 - w, -y / 2), (0, z)),
        "back": ((x, x + w), (-y / 2, y / 2), (0, z)),
    }
    out = []
    for name, span in spans.items():
        low, high = np.array(span, float).T
        centre = np.eye(4)
        centre[:3, 3] = (low + high) / 2
        out.append((solid(name, coal.Box(*(high - low))), T @ centre))
    return out


def signed(a: Any, Ta: Any, b: Any, Tb: Any) -> float:
    """Distance of two geometries at coal's transforms; where they touch, minus the depth to which they penetrate."""
    result, surface = coal.CollisionResult(), _surface(a) or _surface(b)
    if coal.collide(a, Ta, b, Tb, _MANY if surface else _ONE, result):
        return -max(abs(c.penetration_depth) for c in result.getContacts())
    if surface:
        return float(coal.distance(a, Ta, b, Tb, coal.DistanceRequest(), coal.DistanceResult()))
    return float(result.distance_lower_bound)  # of convex shapes, the distance itself


_ONE, _MANY = coal.CollisionRequest(coal.CONTACT, 1), coal.CollisionRequest(coal.CONTACT, 32)


def _surface(geometry: Any) -> bool:
    return isinstance(geometry, coal.BVHModelBase)


def depth(a: Any, Ta: np.ndarray, b: Any, Tb: np.ndarray) -> float | None:
    """How deep two geometries at poses (4, 4) penetrate; None when they are apart."""
    distance = signed(a, _tf(Ta), b, _tf(Tb))
    return None if distance > 0 else -distance


def nearest(a: Any, Ta: np.ndarray, b: Any, Tb: np.ndarray) -> tuple[float, np.ndarray]:
    """Signed distance of two geometries and the nearest point on the first."""
    result = coal.DistanceResult()
    d = coal.distance(a, _tf(Ta), b, _tf(Tb), coal.DistanceRequest(True), result)
    return float(d), np.array(result.getNearestPoint1())


def _tf(T: np.ndarray) -> Any:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


# ---------------------------------------------------------------------------------------------------------------- the arm


class Arm:
    """The URDF in pinocchio: actuated joints by name, mimic joints driven from them, one solid for each collision element."""

    def __init__(self, text: str) -> None:
        self.model = pin.buildModelFromXML(text)
        geometry = pin.buildGeomFromUrdfString(self.model, text, pin.COLLISION)
        self.data = self.model.createData()
        objects = list(geometry.geometryObjects)
        self.solids = [solid(self.model.frames[o.parentFrame].name, o.geometry) for o in objects]
        self.carrier = np.array([o.parentJoint for o in objects])
        self.offset = np.array([o.placement.homogeneous for o in objects])
        hand = self.model.frames[self.model.getFrameId("hand")]
        self.hand = (hand.parentJoint, hand.placement.homogeneous)
        self.above = np.zeros((self.model.njoints, self.model.njoints), bool)  # [carrier, joint]: the joint moves the carrier
        for carrier, chain in enumerate(self.model.supports):
            self.above[carrier, list(chain)[1:]] = True
        self._read(ElementTree.fromstring(text))
        self.pairs = self._pairs()

    def _read(self, root: ElementTree.Element) -> None:
        joints = {j.get("name", ""): j for j in root.iter("joint") if j.find("parent") is not None}
        self.parent_joint = {j.find("child").get("link"): n for n, j in joints.items()}  # type: ignore[union-attr]
        self.parent_link = {j.find("child").get("link"): j.find("parent").get("link") for j in joints.values()}  # type: ignore[union-attr]
        self.links = {e.get("name", "") for e in root.iter("link")}
        moving = [n for n, j in joints.items() if j.get("type") != "fixed"]
        self.follows = {n: self._source(joints, n) for n in moving}
        self.actuated = [n for n in moving if joints[n].find("mimic") is None]
        self.slides = np.array([n in joints and joints[n].get("type") == "prismatic" for n in self.model.names])
        self.low, self.high, self.speed = {}, {}, {}
        for name in self.actuated:
            limit = joints[name].find("limit")
            bound = {} if limit is None else limit.attrib
            endless = joints[name].get("type") == "continuous"
            self.low[name] = -np.inf if endless else float(bound["lower"])
            self.high[name] = np.inf if endless else float(bound["upper"])
            self.speed[name] = float(bound.get("velocity", 0)) or np.inf
        self.arm_joints = {self.follows[n][0] for n in self._joints_above("hand") if n in self.follows}
        grips = {n for n, (source, _, _) in self.follows.items() if source not in self.arm_joints}
        self.fingers = {link for link in self.links if grips & set(self._joints_above(link))}

    @staticmethod
    def _source(joints: dict[str, ElementTree.Element], name: str) -> tuple[str, float, float]:
        """The actuated joint behind a joint, and the factor and offset with which it follows."""
        factor, offset = 1.0, 0.0
        while (mimic := joints[name].find("mimic")) is not None:
            offset += factor * float(mimic.get("offset", 0))
            factor *= float(mimic.get("multiplier", 1))
            name = mimic.get("joint", "")
        return name, factor, offset

    def _joints_above(self, link: str | None) -> Iterator[str]:
        while link in self.parent_joint:
            yield self.parent_joint[link]
            link = self.parent_link[link]

    def values(self, Q: np.ndarray) -> np.ndarray:
        """Values (S, M) of pinocchio's joints, mimic joints too, for those of the actuated joints Q (S, J), in the order of `actuated`."""
        out = np.zeros((len(Q), self.model.njoints))
        for name, (source, factor, offset) in self.follows.items():
            out[:, self.model.getJointId(name)] = factor * Q[:, self.actuated.index(source)] + offset
        return out

    def configurations(self, values: np.ndarray) -> np.ndarray:
        """pinocchio's configurations (S, nq) for the values (S, M) of its joints."""
        out = np.tile(pin.neutral(self.model), (len(values), 1))
        for joint, x in zip(self.model.joints[1:], values.T[1:]):
            out[:, joint.idx_q : joint.idx_q + joint.nq] = x[:, None] if joint.nq == 1 else np.stack([np.cos(x), np.sin(x)], -1)
        return out

    def joint_poses(self, values: np.ndarray) -> np.ndarray:
        """Poses (S, M, 4, 4) of pinocchio's joints in the base frame for their values (S, M)."""
        out = np.empty((*values.shape, 4, 4))
        for i, q in enumerate(self.configurations(values)):
            pin.forwardKinematics(self.model, self.data, q)
            out[i] = [M.homogeneous for M in self.data.oMi]
        return out

    def place(self, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses in the base frame of the solids (S, G, 4, 4) and of the hand (S, 4, 4) for configurations (S, J)."""
        joints = self.joint_poses(self.values(Q))
        return joints[:, self.carrier] @ self.offset, joints[:, self.hand[0]] @ self.hand[1]

    def levers(self, carrier: int, radius: float, furthest: np.ndarray) -> np.ndarray:
        """(M,) how far a point moves at most per rad of each joint above it, wherever the joints stand.

        radius: the point's distance from its carrier's origin; furthest (M,): how far sliding joints go. A sliding joint moves a point by 1
        per m; it counts twice, for which see `Sweep`.
        """
        out, reach = np.zeros(self.model.njoints), radius
        for joint in list(self.model.supports[carrier])[:0:-1]:
            out[joint] = 2.0 if self.slides[joint] else reach
            reach += float(np.linalg.norm(self.model.jointPlacements[joint].translation)) + self.slides[joint] * furthest[joint]
        return out

    def _pairs(self) -> np.ndarray:
        """Pairs (N, 2) of solids that may never touch: not on the same piece of the arm, not neighbours, not together all the time."""
        solid_links = {s.name for s in self.solids}
        above = {}
        for link in solid_links:
            up = self.parent_link.get(link)
            while up is not None and up not in solid_links:
                up = self.parent_link.get(up)
            above[link] = up
        piece = {}
        for link in solid_links:
            mine = [n for n in self._joints_above(link) if n in self.follows and self.follows[n][0] in self.arm_joints]
            piece[link] = mine[0] if mine else ""
        names = [s.name for s in self.solids]
        both = [(i, j) for i in range(len(names)) for j in range(i) if piece[names[i]] != piece[names[j]]]
        pairs = np.array([(i, j) for i, j in both if above[names[i]] != names[j] and above[names[j]] != names[i]]).reshape(-1, 2)
        rng = np.random.default_rng(7)
        low, high = np.array([(max(self.low[n], -np.pi), min(self.high[n], np.pi)) for n in self.actuated]).T
        poses, _ = self.place(rng.uniform(low, high, (200, len(low))))
        share: dict[frozenset[str], float] = {}
        for i, j in pairs:
            a, b = self.solids[i], self.solids[j]
            near = np.flatnonzero(close(poses[:, i], a, poses[:, j], b))
            hits = sum(depth(a.geometry, poses[s, i], b.geometry, poses[s, j]) is not None for s in near) / len(poses)
            pair = frozenset((a.name, b.name))
            share[pair] = max(share.get(pair, 0.0), hits)
        return pairs[[share[frozenset((names[i], names[j]))] < 0.9 for i, j in pairs]]


@lru_cache(maxsize=4)
def _arm(urdf_file: str, _stamp: int) -> Arm:
    return Arm(Path(urdf_file).read_text())


def close(Ta: np.ndarray, a: Solid, Tb: np.ndarray, b: Solid) -> np.ndarray:
    """Whether two solids may touch, for poses (S, 4, 4), or (4, 4) which stands for all: (S,) bool."""
    return between(Ta, a, Tb, b) <= 0


def between(Ta: np.ndarray, a: Solid, Tb: np.ndarray, b: Solid) -> np.ndarray:
    """(S,) at least how far it is from a to b, by a's ball and b's box, and the other way round; 0 or less says nothing."""
    return np.maximum(_ball_to_box(Ta, a, Tb, b), _ball_to_box(Tb, b, Ta, a))


def _ball_to_box(Ta: np.ndarray, a: Solid, Tb: np.ndarray, b: Solid) -> np.ndarray:
    centre = Ta[..., :3, :3] @ a.centre + Ta[..., :3, 3] - Tb[..., :3, 3]
    local = np.einsum("...ji,...j->...i", Tb[..., :3, :3], centre)
    beyond = np.maximum(np.maximum(b.low - local, local - b.high), 0)
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", beyond, beyond)) - a.radius)


# ---------------------------------------------------------------------------------------------------------------- a motion


@dataclass(frozen=True)
class Rider:
    """A solid on one of pinocchio's joints, or on the base, joint 0; offset (4, 4): its pose there."""

    solid: Solid
    carrier: int
    offset: np.ndarray


class Sweep:
    """A motion in samples, so near that no point of a rider moves further than step_m from one to the next.

    The path is cut into pieces in which joints move straight and by PIECE_RAD at most; piece p goes from sample starts[p] to starts[p + 1].
    pace (P, G): how far a point of each rider moves at most from one sample of a piece to the next.

    Let a piece take the time from 0 to 1. A point's velocity differs from its way p(1) - p(0) by at most half its largest acceleration. The
    length of that way is convex in the point, so the corners of a box around a solid bound it. The acceleration is a sum over pairs of
    joints, in either order: the turning speed w of the one nearer to the base, times how fast v the other one moves the point. Levers get
    shorter outwards, so this is at most (sum of w) (sum of v), where v of a sliding joint, which has no lever, counts twice.
    """

    def __init__(self, arm: Arm, Q: np.ndarray, riders: list[Rider], step_m: float) -> None:
        self.arm, self.riders = arm, riders
        carrier = np.array([r.carrier for r in riders])
        self.above = arm.above[carrier]
        corners = np.array([r.solid.corners @ r.offset[:3, :3].T + r.offset[:3, 3] for r in riders])
        values = arm.values(_pieces(Q))
        joints = arm.joint_poses(values)[:, carrier]
        self.poses = joints @ np.array([r.offset for r in riders])
        points = np.einsum("sgij,gkj->sgki", joints[..., :3, :3], corners) + joints[..., None, :3, 3]
        reach, furthest = np.linalg.norm(corners, axis=-1).max(-1), np.abs(values).max(0)
        levers = np.array([arm.levers(r.carrier, x, furthest) for r, x in zip(riders, reach)])
        self.turn = np.abs(np.diff(values, axis=0))
        bend = ((self.turn * ~arm.slides) @ self.above.T) * (self.turn @ levers.T)
        travel = np.linalg.norm(np.diff(points, axis=0), axis=-1).max(-1) + bend / 2
        self.counts = np.maximum(1, np.ceil(travel.max(-1) / step_m)).astype(int)
        self.pace = travel / self.counts[:, None]
        self.starts = np.concatenate([[0], np.cumsum(self.counts)])
        self.values = np.concatenate([values[:1], *map(_inside, values, values[1:], self.counts)])
        self._configurations = arm.configurations(self.values)
        self._offsets = [pin.SE3(r.offset) for r in riders]
        self._joints: dict[int, Any] = {}
        self._placed: dict[tuple[int, int], Any] = {}

    def at(self, sample: int, g: int) -> Any:
        """coal's transform of a rider at a sample."""
        carrier = self.riders[g].carrier
        key = (sample if carrier else 0, g)
        if key not in self._placed:
            if sample not in self._joints:
                pin.forwardKinematics(self.arm.model, self.arm.data, self._configurations[sample])
                self._joints[sample] = pin.StdVec_SE3(self.arm.data.oMi)
            M = self._joints[sample][carrier] * self._offsets[g]
            self._placed[key] = coal.Transform3s(M.rotation, M.translation)
        return self._placed[key]

    def nearing(self, one: np.ndarray, two: np.ndarray) -> np.ndarray:
        """(N, P) how much nearer pairs of riders (N,) may come in one step; 0 where no joint between them moves."""
        apart = ((self.above[one] ^ self.above[two]).astype(float) @ self.turn.T) > 0
        return np.where(apart, (self.pace[:, one] + self.pace[:, two]).T, 0.0)


def _pieces(Q: np.ndarray) -> np.ndarray:
    """The ends of the pieces of a path, at least two."""
    Q = Q if len(Q) > 1 else Q[[0, 0]]
    counts = np.maximum(1, np.ceil(np.abs(np.diff(Q, axis=0)).max(-1) / PIECE_RAD)).astype(int)
    return np.concatenate([Q[:1], *map(_inside, Q, Q[1:], counts)])


def _inside(a: np.ndarray, b: np.ndarray, n: int) -> np.ndarray:
    """n points evenly on the way from a to b, without a and with b."""
    return np.asarray(a + np.linspace(0, 1, n + 1)[1:, None] * (b - a))


# ---------------------------------------------------------------------------------------------------------------- the replay


class Replay:
    """One plan on its way; see `replay`. samples: how many the motions so far were cut into."""

    def __init__(
        self, scene: Json, plan: Json, urdf_file: str | Path, step_m: float = 0.001, folder: str | Path = ".", touch_m: float = TOUCH_M
    ) -> None:
        self.scene, self.plan, self.step_m, self.touch_m = scene, plan, step_m, touch_m
        self.arm, folder, self.samples = _arm(str(urdf_file), Path(urdf_file).stat().st_mtime_ns), Path(folder), 0
        self.problems: list[Problem] = []
        self.T_base_world = np.linalg.inv(matrix(scene["robot"]["T_world_base"]))
        self.bodies = {o["name"]: body_solid(o, folder) for o in scene["objects"]}
        self.poses = {o["name"]: matrix(o["T_world_object"]) for o in scene["objects"]}
        self.walls = walls(scene["cabinet"])
        self.carries: list[tuple[str, np.ndarray, np.ndarray]] = []
        self.held: str | None = None

    def run(self) -> list[Problem]:
        if not self._form():
            return self.problems
        last: np.ndarray | None = None
        for i, motion in enumerate(self.plan["motions"]):
            order = [motion["joint_names"].index(n) for n in self.arm.actuated]
            t, Q = _followed(motion)
            Q = Q[:, order]
            if last is not None and np.abs(Q[0] - last).max() > GAP:
                self._say("gap", f"starts {np.abs(Q[0] - last).max():.2g} rad from where the one before ends", i)
            last = Q[-1]
            self._timing(i, motion, t, Q)
            self._move(i, motion, Q)
        if self.held is not None and not self.plan["success"]:
            self._say("move", f"{self.held} is still in the hand at the end")
        self._moves()
        return self.problems

    def _say(self, kind: str, text: str, motion: int | None = None, depth_m: float = 0.0) -> None:
        if motion is not None:
            text = f"{self.plan['motions'][motion]['stage']}: {text}"
        self.problems.append(Problem(kind, text, motion, depth_m))

    def _form(self) -> bool:
        """Names and sizes; False when there is no sense in going on."""
        if self.plan["scene"] != self.scene["id"]:
            self._say("form", f"the plan is for scene {self.plan['scene']!r}, not {self.scene['id']!r}")
        names = self.arm.links | set(self.bodies) | {s.name for s, _ in self.walls}
        for i, motion in enumerate(self.plan["motions"]):
            if motion["stage"] not in STAGES:
                self._say("form", "no such stage", i)
            if sorted(motion["joint_names"]) != sorted(self.arm.actuated):
                self._say("form", f"joint_names {motion['joint_names']} are not the actuated joints", i)
            if not motion["q"] or len(motion["q"]) != len(motion["t_s"]) or {len(q) for q in motion["q"]} != {len(self.arm.actuated)}:
                self._say("form", "q and t_s don't fit each other or the joints", i)
            elif "qd" in motion and {np.shape(motion[w]) for w in ("q", "qd", "qdd")} != {np.shape(motion["q"])}:
                self._say("form", "q, qd and qdd don't fit each other", i)
            elif not np.isfinite([x for row in (*motion["q"], motion["t_s"]) for x in row]).all():
                self._say("form", "q or t_s has a number that is not finite", i)
            if motion["held"] is not None and motion["held"]["body"] not in self.bodies:
                self._say("form", f"holds {motion['held']['body']!r}, which is not in the scene", i)
            for name in {n for pair in motion["may_touch"] for n in pair} - names:
                self._say("form", f"may_touch names {name!r}, which is neither link nor body", i)
        for move in self.plan["moves"]:
            if move["object"] not in self.bodies:
                self._say("form", f"a move names {move['object']!r}, which is not in the scene")
        return not self.problems

    def _timing(self, i: int, motion: Json, t: np.ndarray, Q: np.ndarray) -> None:
        """Joint limits, times that increase, speeds within the limits."""
        for j, name in enumerate(self.arm.actuated):
            over = max(Q[:, j].max() - self.arm.high[name], self.arm.low[name] - Q[:, j].min())
            if over > LIMIT:
                self._say("limit", f"{name} is {over:.3g} outside its limits", i)
        if t[0] < 0 or (np.diff(motion["t_s"]) <= 0).any():
            self._say("time", "t_s does not increase", i)
            return
        for j, name in enumerate(self.arm.actuated):
            ratio = np.abs(np.diff(Q[:, j])) / (self.arm.speed[name] * np.diff(t) * (1 + 1e-6) + 1e-9)
            if len(ratio) and ratio.max() > 1:
                self._say("speed", f"{name} moves {ratio.max():.3f} times as fast as it can", i)

    def _move(self, i: int, motion: Json, Q: np.ndarray) -> None:
        """Carry out one motion: what is taken, what touches, what is left behind."""
        poses, hand = self.arm.place(Q[[0, -1]])
        held = motion["held"]
        name = held["body"] if held else None
        if self.held is not None and name != self.held:
            self._put_down(i, self.held)
        if held:
            T_world_base = np.linalg.inv(self.T_base_world)
            moving = hand @ matrix(held["T_hand_body"])
            start = T_world_base @ moving[0]
            far, turned = apart(self.poses[name], start)
            if far > POSE_M or turned > POSE_RAD:
                self._say("jump", f"{name} jumps by {1000 * far:.2f} mm and {1000 * turned:.2f} mrad into the hand", i)
            if name != self.held:
                self.carries.append((name, self.poses[name], self.poses[name]))
                self._grip(i, name, moving[0], poses[0], hand[0])
            self.poses[name] = T_world_base @ moving[-1]
            self.carries[-1] = (name, self.carries[-1][1], self.poses[name])
        self.held = name
        self._allowances(i, motion)
        self._contacts(i, motion, Q)

    def _grip(self, i: int, name: str, T_body: np.ndarray, poses: np.ndarray, T_hand: np.ndarray) -> None:
        """An object that is taken lies between two fingers."""
        sides = set()
        for s, T in zip(self.arm.solids, poses):
            if s.name in self.arm.fingers:
                d, point = nearest(s.geometry, T, self.bodies[name].geometry, T_body)
                if d <= GRIP_M:
                    sides.add(bool((T_hand[:3, :3].T @ (point - T_hand[:3, 3]))[1] > 0))
        if len(sides) < 2:
            self._say("grip", f"{name} is taken, but {'one finger only' if sides else 'no finger'} is at it", i)

    def _put_down(self, i: int, name: str) -> None:
        """What has been released stands on the floor and in nothing else."""
        T, body = self.poses[name], self.bodies[name]
        others = [*self.walls, *((self.bodies[n], P) for n, P in self.poses.items() if n != name)]
        for other, P in others:
            d = depth(body.geometry, T, other.geometry, P) if close(T, body, P, other) else None
            if d is not None and d > CONTACT_M:
                self._say("rest", f"{name} is put down {1000 * d:.1f} mm inside {other.name}", i, d)
        T_world_cabinet = matrix(self.scene["cabinet"]["T_world_cabinet"])
        floor, P = self.walls[0]
        gap, _ = nearest(body.geometry, T, floor.geometry, P)
        if gap > REST_M:
            up = (np.linalg.inv(T_world_cabinet) @ T)[2, 3]
            self._say("rest", f"{name} is let go {1000 * gap:.1f} mm above the floor (centre at {up:.3f} m)", i)

    def _allowances(self, i: int, motion: Json) -> None:
        """Only fingers may touch an object, only the one being moved, and only that object the floor, when it is taken or put down."""
        motions = self.plan["motions"]
        near = [m["held"]["body"] for m in motions[i : i + 1] if m["held"]]
        near += [next((m["held"]["body"] for m in motions[i:] if m["held"]), None), self.carries[-1][0] if self.carries else None]
        for pair in motion["may_touch"]:
            mine = [n for n in pair if n in near]
            other = [n for n in pair if n not in near]
            usual = self.arm.fingers | ({"floor"} if motion["stage"] in FLOOR_STAGES else set())
            if len(mine) != 1 or len(other) != 1 or other[0] not in usual:
                self._say("allowance", f"{' and '.join(pair)} may not touch", i)

    def _contacts(self, i: int, motion: Json, Q: np.ndarray) -> None:
        """Every pair that touches too deeply, at its deepest sample."""
        sweep, pairs = self._sweep(motion["held"], Q)
        self.samples += len(sweep.values)
        allowed = {frozenset(pair) for pair in motion["may_touch"]}
        one, two, near = _near(sweep, pairs)
        for g, h, open_pieces, nearing in zip(one, two, near, sweep.nearing(one, two)):
            a, b = sweep.riders[g].solid, sweep.riders[h].solid
            bound = self.touch_m if frozenset((a.name, b.name)) in allowed else CONTACT_M
            d, s = _deepest(sweep, int(g), int(h), np.flatnonzero(open_pieces), nearing, bound)
            if d > bound:
                self._say("contact", f"{a.name} is {1000 * d:.1f} mm inside {b.name} (sample {s} of {len(sweep.values)})", i, d)

    def _sweep(self, held: Json | None, Q: np.ndarray) -> tuple[Sweep, np.ndarray]:
        """A motion with all that moves and all that stands, and the pairs (N, 2) of riders that are to be apart."""
        movers = [Rider(s, int(c), T) for s, c, T in zip(self.arm.solids, self.arm.carrier, self.arm.offset)]
        pairs = [tuple(pair) for pair in self.arm.pairs]
        if held is not None:
            pairs += [(len(movers), g) for g in range(len(movers))]
            movers.append(Rider(self.bodies[held["body"]], self.arm.hand[0], self.arm.hand[1] @ matrix(held["T_hand_body"])))
        still = self.walls + [(self.bodies[n], T) for n, T in self.poses.items() if held is None or n != held["body"]]
        riders = movers + [Rider(s, 0, self.T_base_world @ T) for s, T in still]
        pairs += [(g, h) for g in range(len(movers)) for h in range(len(movers), len(riders))]
        return Sweep(self.arm, Q, riders, self.step_m), np.array(pairs)

    def _moves(self) -> None:
        """The moves say what the motions did, and a success ends with the target outside, in the hand."""
        carries = list(self.carries)
        target = self.scene["target"]
        if self.plan["success"]:
            if self.held != target:
                self._say("goal", f"success, but the hand holds {self.held} at the end instead of {target}")
            else:
                carries.pop()
                x, y, z = self.scene["cabinet"]["size_m"]
                T_cabinet_target = np.linalg.inv(matrix(self.scene["cabinet"]["T_world_cabinet"])) @ self.poses[target]
                cx, cy, cz, _ = T_cabinet_target @ [*self.bodies[target].centre, 1]
                if 0 <= cx <= x and abs(cy) <= y / 2 and 0 <= cz <= z:
                    self._say("goal", f"success, but the centre of {target} is still inside the cabinet")
        done = [m for m in self.plan["moves"] if m["done"]]
        if [m["object"] for m in done] != [name for name, _, _ in carries]:
            self._say("move", f"the moves done are {[m['object'] for m in done]}, but the hand carried {[c[0] for c in carries]}")
            return
        for move, (name, begin, end) in zip(done, carries):
            for key, T in (("T_world_from", begin), ("T_world_to", end)):
                far, turned = apart(matrix(move[key]), T)
                if far > POSE_M or turned > POSE_RAD:
                    self._say("move", f"{name} is {1000 * far:.2f} mm and {1000 * turned:.2f} mrad from the move's {key}")


def _followed(motion: Json) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,) and positions (N, J) along a motion: its waypoints, or its quintic Hermite spline, cut so that straight lines between the
    positions are nowhere further than CHORD_RAD from it."""
    t, q = np.array(motion["t_s"], float), np.array(motion["q"], float)
    if "qd" not in motion or (np.diff(t) <= 0).any():
        return t, q
    rows = np.stack([q, motion["qd"], motion["qdd"]], axis=1)
    times, out = [t[:1]], [q[:1]]
    for k in range(len(t) - 1):
        piece = BPoly.from_derivatives(t[k : k + 2], rows[k : k + 2])
        bend = np.abs(piece.derivative(2).c).max()  # Bernstein coefficients bound the polynomial
        n = max(1, int(np.ceil((t[k + 1] - t[k]) * np.sqrt(bend / (8 * CHORD_RAD)))))
        times.append(np.linspace(t[k], t[k + 1], n + 1)[1:])
        out.append(piece(times[-1]))
    return np.concatenate(times), np.concatenate(out)


def _near(sweep: Sweep, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The pairs (N,), (N,) that balls and boxes don't prove apart, and in which pieces they don't (N, P)."""
    one, two = pairs.T
    centres = np.stack([T[:, :3, :3] @ r.solid.centre + T[:, :3, 3] for r, T in zip(sweep.riders, sweep.poses.swapaxes(0, 1))])
    radii = np.array([r.solid.radius for r in sweep.riders])
    closest = np.linalg.norm(centres[one] - centres[two], axis=-1) - (radii[one] + radii[two])[:, None]
    shrinks = sweep.nearing(one, two) * sweep.counts + 2 * SLACK_M
    near = closest[:, :-1] + closest[:, 1:] < shrinks
    for k in np.flatnonzero(near.any(1)):
        g, h = pairs[k]
        closest[k] = between(sweep.poses[:, g], sweep.riders[g].solid, sweep.poses[:, h], sweep.riders[h].solid)
        near[k] &= closest[k, :-1] + closest[k, 1:] < shrinks[k]
    left = near.any(1)
    return one[left], two[left], near[left]


def _deepest(sweep: Sweep, g: int, h: int, pieces: np.ndarray, nearing: np.ndarray, bound: float) -> tuple[float, int]:
    """The largest depth in some pieces of a motion, and its sample, as if all samples were looked at; depths up to `bound` don't matter.

    The signed distance of two convex bodies shrinks by at most nearing[p] from one sample to the next. Between samples with the distances
    x and y, n steps apart, it is therefore nowhere below (x + y - n nearing) / 2. Where that does not settle it, the sample in the middle
    is looked at, and so on, down to neighbours. The depth of a surface is no such thing; but if it touches in between, x + y <= n nearing.
    """
    a, b = sweep.riders[g].solid.geometry, sweep.riders[h].solid.geometry
    least = 2 * (SLACK_M if _surface(a) or _surface(b) else SLACK_M - bound)
    seen: dict[int, float] = {}
    for p in pieces:
        rate = float(nearing[p])
        stack = [(int(sweep.starts[p]), int(sweep.starts[p + 1]))]
        while stack:
            first, last = stack.pop()
            for s in (first, last):
                if s not in seen:
                    seen[s] = signed(a, sweep.at(s, g), b, sweep.at(s, h))
            if rate > 0 and last - first > 1 and seen[first] + seen[last] - (last - first) * rate < least:
                middle = (first + last) // 2
                stack += [(middle, last), (first, middle)]
    deepest = min(seen, key=lambda s: (seen[s], s))
    return -seen[deepest], deepest


def matrix(pose: Json) -> np.ndarray:
    """(4, 4) of a pose in a file."""
    w, x, y, z = np.array(pose["q_wxyz"], float) / np.linalg.norm(pose["q_wxyz"])
    return np.array(pin.SE3(pin.Quaternion(w, x, y, z).matrix(), np.array(pose["p"], float)).homogeneous)


def apart(A: np.ndarray, B: np.ndarray) -> tuple[float, float]:
    """Distance in m and angle in rad between two poses (4, 4)."""
    return float(np.linalg.norm(A[:3, 3] - B[:3, 3])), float(np.linalg.norm(pin.log3(A[:3, :3].T @ B[:3, :3])))
