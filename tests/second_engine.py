"""A stranger replays a plan: pinocchio moves the arm, coal says what touches; nothing of ours is imported.

What goes in are the raw JSON objects of the scene and plan formats and the URDF that `retrieve robots NAME --urdf FILE` writes. Everything
else (walls, mimic joints, which links are neighbours, where objects stand) is worked out here a second time, from the formats' text.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

CONTACT_M = 0.001  # deeper than this is a collision
TOUCH_M = 0.003  # and so is this, even where touching is allowed; a parameter of `replay`
POSE_M, POSE_RAD = 0.001, 0.001
GAP = 1e-6
LIMIT = 1e-5  # rad or m; files round
GRIP_M = 0.003  # a finger this near to the object holds it
REST_M = 0.005  # what is put down stands at most this far above the floor

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

    step_m: no point of the arm or the held object moves further between two samples. folder: where the scene's mesh files are.
    touch_m: how deep bodies may press into each other where touching is allowed.
    """
    return _Replay(scene, plan, _arm(str(urdf_file), Path(urdf_file).stat().st_mtime_ns), step_m, Path(folder), touch_m).run()


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


def depth(a: Any, Ta: np.ndarray, b: Any, Tb: np.ndarray) -> float | None:
    """How deep two geometries at poses (4, 4) penetrate; None when they are apart."""
    result = coal.CollisionResult()
    surface = isinstance(a, coal.BVHModelBase) or isinstance(b, coal.BVHModelBase)
    request = coal.CollisionRequest(coal.CONTACT, 32 if surface else 1)
    if not coal.collide(a, _tf(Ta), b, _tf(Tb), request, result):
        return None
    return max(abs(c.penetration_depth) for c in result.getContacts())


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

    def configurations(self, Q: np.ndarray) -> np.ndarray:
        """pinocchio's configurations (S, nq) for the actuated joints' values Q (S, J), in the order of `actuated`."""
        column = {name: j for j, name in enumerate(self.actuated)}
        out = np.tile(pin.neutral(self.model), (len(Q), 1))
        for name, (source, factor, offset) in self.follows.items():
            joint = self.model.joints[self.model.getJointId(name)]
            x = factor * Q[:, column[source]] + offset
            out[:, joint.idx_q : joint.idx_q + joint.nq] = x[:, None] if joint.nq == 1 else np.stack([np.cos(x), np.sin(x)], -1)
        return out

    def place(self, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses in the base frame of the solids (S, G, 4, 4) and of the hand (S, 4, 4) for configurations (S, J)."""
        joints = np.empty((len(Q), self.model.njoints, 4, 4))
        for i, q in enumerate(self.configurations(Q)):
            pin.forwardKinematics(self.model, self.data, q)
            joints[i] = [M.homogeneous for M in self.data.oMi]
        return joints[:, self.carrier] @ self.offset, joints[:, self.hand[0]] @ self.hand[1]

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
    """Whether a's ball reaches into b's box and b's into a's, for poses (S, 4, 4), or (4, 4) which stands for all: (S,) bool."""
    return _reaches(Ta, a, Tb, b) & _reaches(Tb, b, Ta, a)


def _reaches(Ta: np.ndarray, a: Solid, Tb: np.ndarray, b: Solid) -> np.ndarray:
    centre = Ta[..., :3, :3] @ a.centre + Ta[..., :3, 3] - Tb[..., :3, 3]
    local = np.einsum("...ji,...j->...i", Tb[..., :3, :3], centre)
    beyond = np.maximum(np.maximum(b.low - local, local - b.high), 0)
    return np.asarray(np.einsum("...i,...i->...", beyond, beyond) <= a.radius**2)


# ---------------------------------------------------------------------------------------------------------------- the replay


class _Replay:
    def __init__(self, scene: Json, plan: Json, arm: Arm, step_m: float, folder: Path, touch_m: float) -> None:
        self.scene, self.plan, self.arm, self.step_m, self.touch_m = scene, plan, arm, step_m, touch_m
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
            Q = np.array(motion["q"], float)[:, order]
            if last is not None and np.abs(Q[0] - last).max() > GAP:
                self._say("gap", f"starts {np.abs(Q[0] - last).max():.2g} rad from where the one before ends", i)
            last = Q[-1]
            self._timing(i, motion, Q)
            self._move(i, motion, self._samples(Q, motion["held"]))
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

    def _timing(self, i: int, motion: Json, Q: np.ndarray) -> None:
        """Joint limits, times that increase, speeds within the limits."""
        for j, name in enumerate(self.arm.actuated):
            over = max(Q[:, j].max() - self.arm.high[name], self.arm.low[name] - Q[:, j].min())
            if over > LIMIT:
                self._say("limit", f"{name} is {over:.3g} outside its limits", i)
        t = np.array(motion["t_s"], float)
        if t[0] < 0 or (np.diff(t) <= 0).any():
            self._say("time", "t_s does not increase", i)
            return
        for j, name in enumerate(self.arm.actuated):
            ratio = np.abs(np.diff(Q[:, j])) / (self.arm.speed[name] * np.diff(t) * (1 + 1e-6) + 1e-9)
            if len(ratio) and ratio.max() > 1:
                self._say("speed", f"{name} moves {ratio.max():.3f} times as fast as it can", i)

    def _samples(self, Q: np.ndarray, held: Json | None) -> np.ndarray:
        """Configurations (S, J) along straight segments, so near that no point moves further than step_m from one to the next."""
        rows = [Q[:1]]
        for a, b in pairwise(Q):
            coarse = a + np.linspace(0, 1, int(np.ceil(np.abs(b - a).max() / 0.02)) + 1)[:, None] * (b - a)
            for c, d, travel in zip(coarse, coarse[1:], self._travel(coarse, held)):
                n = max(1, int(np.ceil(1.02 * travel / self.step_m)))
                rows.append(c + np.linspace(0, 1, n + 1)[1:, None] * (d - c))
        fine = np.concatenate(rows)
        widest = self._travel(fine, held).max(initial=0.0)
        assert widest <= self.step_m * (1 + 1e-9), f"a step of {widest} m"
        return fine

    def _travel(self, Q: np.ndarray, held: Json | None) -> np.ndarray:
        """(S - 1,) the furthest that a corner of a box around a solid moves from one configuration to the next.

        The distance that a point moves under a rigid motion is convex in the point, so the corners bound all that is between them.
        """
        poses, hand = self.arm.place(Q)
        furthest = np.zeros(len(Q) - 1)
        groups = [(poses[:, g], s.corners) for g, s in enumerate(self.arm.solids)]
        if held is not None:
            groups.append((hand @ matrix(held["T_hand_body"]), self.bodies[held["body"]].corners))
        for T, corners in groups:
            points = np.einsum("sij,kj->ski", T[:, :3, :3], corners) + T[:, None, :3, 3]
            furthest = np.maximum(furthest, np.linalg.norm(np.diff(points, axis=0), axis=-1).max(-1, initial=0.0))
        return furthest

    def _move(self, i: int, motion: Json, Q: np.ndarray) -> None:
        """Carry out one motion: what is taken, what touches, what is left behind."""
        poses, hand = self.arm.place(Q)
        held, moving = motion["held"], None
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
        self._contacts(i, motion, poses, moving, name)

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

    def _contacts(self, i: int, motion: Json, poses: np.ndarray, moving: np.ndarray | None, name: str | None) -> None:
        """Every pair that touches too deeply, at its deepest sample."""
        allowed = {frozenset(pair) for pair in motion["may_touch"]}
        movers = [(s, poses[:, g]) for g, s in enumerate(self.arm.solids)]
        still = self.walls + [(self.bodies[n], T) for n, T in self.poses.items() if n != name]
        still = [(s, self.T_base_world @ T) for s, T in still]
        first = len(movers)
        pairs = [tuple(pair) for pair in self.arm.pairs]
        if name is not None and moving is not None:
            movers.append((self.bodies[name], moving))
            pairs += [(first, g) for g in range(first)]
        solids = [s for s, _ in movers + still]
        centres = np.stack([np.broadcast_to(T[..., :3, :3] @ s.centre + T[..., :3, 3], (len(poses), 3)) for s, T in movers + still])
        radii = np.array([s.radius for s in solids])
        pairs += [(g, h) for g in range(len(movers)) for h in range(len(movers), len(solids))]
        one, two = np.array(pairs).T
        near = (((centres[one] - centres[two]) ** 2).sum(-1) <= (radii[one] + radii[two])[:, None] ** 2).any(1)
        deepest: dict[tuple[str, str], tuple[float, int]] = {}
        for (a, Ta), (b, Tb) in ((movers[g], (movers + still)[h]) for g, h in zip(one[near], two[near])):
            bound = self.touch_m if frozenset((a.name, b.name)) in allowed else CONTACT_M
            for s in np.flatnonzero(close(Ta, a, Tb, b)):
                d = depth(a.geometry, Ta[s], b.geometry, Tb if Tb.ndim == 2 else Tb[s])
                if d is not None and d > max(bound, deepest.get((a.name, b.name), (0.0, 0))[0]):
                    deepest[a.name, b.name] = d, int(s)
        for (a_name, b_name), (d, s) in deepest.items():
            self._say("contact", f"{a_name} is {1000 * d:.1f} mm inside {b_name} (sample {s} of {len(poses)})", i, d)

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


def matrix(pose: Json) -> np.ndarray:
    """(4, 4) of a pose in a file."""
    w, x, y, z = np.array(pose["q_wxyz"], float) / np.linalg.norm(pose["q_wxyz"])
    return np.array(pin.SE3(pin.Quaternion(w, x, y, z).matrix(), np.array(pose["p"], float)).homogeneous)


def apart(A: np.ndarray, B: np.ndarray) -> tuple[float, float]:
    """Distance in m and angle in rad between two poses (4, 4)."""
    return float(np.linalg.norm(A[:3, 3] - B[:3, 3])), float(np.linalg.norm(pin.log3(A[:3, :3].T @ B[:3, :3])))


def replay_files(scenes_file: Path, plans_file: Path, urdf_file: Path, step_m: float = 0.002) -> dict[str, list[Problem]]:
    """Replay every plan of a JSON Lines file; problems by the scene's id."""
    scenes = {s["id"]: s for s in map(json.loads, scenes_file.read_text().splitlines())}
    plans = [json.loads(line) for line in plans_file.read_text().splitlines()]
    return {p["scene"]: replay(scenes[p["scene"]], p, urdf_file, step_m, scenes_file.parent) for p in plans}
