"""What a picture of a scene or a plan holds, whoever draws it: colours, the hand's path, the moments of a plan.

The path says who is carried: grey where the hand is empty, else the carried object's own colour. Objects have colours that a colour-blind
eye tells apart too; the strong warm one belongs to the target alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.robots.start import start_q
from kinematics.scene import Body, Held, Scene, State
from kinematics.shapes import ConvexMesh, Shape, bounds, convex_parts
from kinematics.transforms import Array, apply
from perception.rendering.colours import PALETTE, TARGET_COLOUR, Colour
from planning.plan import Motion, Move, Plan
from retrieve_cli.drawing.meshes import look_of
from retrieve_cli.drawing.outlines import outline

if TYPE_CHECKING:
    from perception.rendering.surfaces import Mesh

EMPTY_COLOUR: Colour = (0.44, 0.48, 0.54)
"""The hand's path where it holds nothing."""
FLOOR_COLOUR: Colour = (0.93, 0.93, 0.92)


@dataclass(frozen=True, eq=False)
class Stretch:
    """One motion in the film of a plan: when it starts and ends, and what stands where during it.

    move: which of the moves carried out it belongs to, counted from 0; their number, for the way to the target. about: the object.
    """

    start_s: float
    end_s: float
    motion: Motion
    move: int
    about: str | None
    poses: dict[str, Array]


@dataclass(frozen=True, eq=False)
class HandPath:
    """A piece of the hand's path: points (N, 3), the object that is carried along it, and the move as in `Stretch`."""

    points: Array
    held: str | None
    move: int


@dataclass(frozen=True, eq=False)
class Film:
    """A scene, the robot in it, and what a plan does with them; a scene without a plan is a film that stands still.

    parts: meshes are drawn as the convex parts that stand for them.
    """

    robot: Robot
    scene: Scene
    plan: Plan | None = None
    parts: bool = False

    def look(self, shape: Shape) -> Shape | Mesh:
        """What to draw of a shape: of a mesh its own triangles, or where `parts` are asked for, its convex parts."""
        return look_of(shape, self.parts)

    def as_drawn(self, body: Body) -> Body:
        """A body for its silhouette: around a mesh's own triangles runs one line, not one around each part."""
        shape = body.shape
        return body if self.look(shape) is shape else replace(body, shape=ConvexMesh((np.concatenate(convex_parts(shape)),)))

    def outline(self, shape: Shape) -> list[Array]:
        """The edges of a shape as it is drawn, as polylines (N, 3); none of a mesh's own triangles."""
        return outline(shape) if self.look(shape) is shape else []

    @property
    def target(self) -> Body | None:
        """The target as the scene has it, if it is among its objects."""
        return next((b for b in self.scene.objects if b.name == self.scene.target), None)

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """The motions in order. Objects stand where the scene or the last release has put them; what is held is not among them."""
        motions = self.plan.motions if self.plan else ()
        order = [*(m.object for m in self.done), self.scene.target]
        poses, time, out = self.scene.poses(), 0.0, []
        for i, motion in enumerate(motions):
            before = motions[i - 1] if i else None
            if before and before.held and (motion.held is None or motion.held.body != before.held.body):
                poses = {**poses, before.held.body: self.hand_pose(self.full(before)[-1]) @ before.held.T_hand_body}
            if motion.held:
                poses = {name: T for name, T in poses.items() if name != motion.held.body}
            end = time + float(motion.t_s[-1])
            move = min(_moves_before(motions, i), len(order) - 1)
            out.append(Stretch(time, end, motion, move, order[move], poses))
            time = end
        return tuple(out)

    @property
    def done(self) -> tuple[Move, ...]:
        """The moves that were carried out."""
        return tuple(m for m in self.plan.moves if m.done) if self.plan else ()

    @property
    def length_s(self) -> float:
        """How long the film is, s."""
        return self.stretches[-1].end_s if self.stretches else 0.0

    @cached_property
    def colours(self) -> dict[str, Colour]:
        """Every object's sRGB colour."""
        others = [b.name for b in self.scene.objects if b.name != self.scene.target]
        target = {} if self.scene.target is None else {self.scene.target: TARGET_COLOUR}
        return {**target, **{name: PALETTE[i % len(PALETTE)] for i, name in enumerate(others)}}

    def full(self, motion: Motion, t_s: Array | None = None) -> Array:
        """A motion's rows (K, J), or where it is at times t_s (K,), in the robot's own order of joints.

        Raises: ValueError for joints that the robot does not have.
        """
        q = motion.q if t_s is None else motion.at(t_s)
        if motion.joint_names == self.robot.joint_names:
            return q
        if sorted(motion.joint_names) != sorted(self.robot.joint_names):
            raise ValueError(f"the plan moves the joints {', '.join(motion.joint_names)}; the scene's robot is {self.robot.name}")
        return q[:, [motion.joint_names.index(j) for j in self.robot.joint_names]]

    def hand_pose(self, q: Array) -> Array:
        """T_world_hand (4, 4) at q (J,)."""
        return np.asarray(self.link_poses(q)[self.robot.tree.index["hand"]])

    def link_poses(self, q: Array) -> Array:
        """Poses (N, 4, 4) of the tree's links in the world."""
        return np.asarray(self.scene.robot.T_world_base @ self.robot.tree.poses(q))

    def state_at(self, time_s: float) -> State:
        """The moment time_s after the start."""
        if not self.stretches:
            start = start_q(self.robot, self.scene.robot)
            return State(self.robot.home if start is None else start, self.scene.poses())
        now = next((s for s in self.stretches if time_s < s.end_s), self.stretches[-1])
        return State(self.full(now.motion, np.array([time_s - now.start_s]))[0], now.poses, now.motion.held)

    def bodies(self, state: State) -> tuple[Body, ...]:
        """All objects where they are, the held one too."""
        standing = state.bodies(self.scene)
        if state.held is None:
            return standing
        T = self.hand_pose(state.q) @ state.held.T_hand_body
        return (*standing, Body(state.held.body, self.scene.body(state.held.body).shape, T))

    def path(self) -> list[HandPath]:
        """The hand's way in pieces, straight runs without points in between."""
        ways: list[HandPath] = []
        for s in self.stretches:
            points = _hand_points(self, s.motion)
            held = s.motion.held.body if s.motion.held else None
            if ways and (ways[-1].held, ways[-1].move) == (held, s.move):
                ways[-1] = HandPath(np.concatenate([ways[-1].points, points[1:]]), held, s.move)
            else:
                ways.append(HandPath(points, held, s.move))
        ways = [HandPath(straightened(w.points), w.held, w.move) for w in ways]
        return [w for w in ways if len(w.points) > 1]

    def destinations(self) -> list[Body]:
        """Where the moved objects stand in the end; the target, which leaves the cabinet, is not among them."""
        last = {m.object: m.T_world_to for m in self.done if m.object != self.scene.target}
        return [Body(name, self.scene.body(name).shape, T) for name, T in last.items()]

    def film_points(self) -> Array:
        """Points (N, 3) that a camera should have in its view: the cabinet, and the arm at the beginning and at the end."""
        corners = [apply(w.T_world_body, c) for w in self.scene.cabinet.walls() for c in convex_parts(w.shape)]
        arm = []
        for t in (0.0, self.length_s):
            poses = self.link_poses(self.state_at(t).q)
            arm += [apply(poses[self.robot.tree.index[h.link]], h.vertices) for h in self.robot.hulls]
        return np.concatenate([*corners, *arm])


def _moves_before(motions: Sequence[Motion], i: int) -> int:
    """How many moves are over when motion i begins; a move is over when the hand has gone back from what it has put down."""
    put_down = sum(1 for a, b in pairwise(motions[: i + 1]) if a.held and (b.held is None or b.held.body != a.held.body))
    return put_down - (motions[i].stage in ("release", "retreat") and put_down > 0)


def frame_times(motion: Motion, most_turn: float, most_s: float = np.inf) -> Array:
    """Times (N,) from a motion's start, those of its rows among them, between which no joint turns by much more than most_turn, rad."""
    turn, took = np.abs(np.diff(motion.q, axis=0)).max(1), np.diff(motion.t_s)
    parts = np.maximum(1, np.ceil(np.maximum(turn / most_turn, took / most_s))).astype(int)
    ends = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(motion.t_s[:-1], motion.t_s[1:], parts)]
    return np.concatenate([*ends, motion.t_s[-1:]])


def _hand_points(film: Film, motion: Motion) -> Array:
    """Points (N, 3) of the hand along a motion."""
    return np.array([film.hand_pose(q)[:3, 3] for q in film.full(motion, frame_times(motion, 0.02))])


def straightened(points: Array, tolerance_m: float = 0.0008) -> Array:
    """Points (N, 3) without those that lie on the line between the kept ones (Ramer, Douglas, Peucker)."""
    keep = np.zeros(len(points), bool)
    keep[[0, -1]] = True
    todo = [(0, len(points) - 1)]
    while todo:
        a, b = todo.pop()
        if b - a < 2:
            continue
        along = points[b] - points[a]
        away = points[a + 1 : b] - points[a]
        share = np.clip(away @ along / max(float(along @ along), 1e-18), 0, 1)
        distance = np.linalg.norm(away - share[:, None] * along, axis=1)
        worst = int(np.argmax(distance))
        if distance[worst] > tolerance_m:
            keep[a + 1 + worst] = True
            todo += [(a, a + 1 + worst), (a + 1 + worst, b)]
    kept = points[keep]
    return np.asarray(kept[np.r_[True, np.linalg.norm(np.diff(kept, axis=0), axis=1) > 1e-6]])


def held_by(film: Film) -> list[Held]:
    """The different ways in which objects are held in the film, in order."""
    ways: list[Held] = []
    for s in film.stretches:
        held = s.motion.held
        if held and not any(w.body == held.body and np.abs(w.T_hand_body - held.T_hand_body).max() < 1e-9 for w in ways):
            ways.append(held)
    return ways


def ground(film: Film) -> float:
    """The height of the room's floor: where the arm stands, and below the cabinet and the obstacles."""
    links = film.link_poses(film.robot.home)
    index = film.robot.tree.index
    arm = min(float(apply(links[index[h.link]], h.vertices)[:, 2].min()) for h in film.robot.hulls)
    cabinet = min(float((w.T_world_body[:3, 3] - np.abs(w.T_world_body[:3, :3]) @ w.shape.half)[2]) for w in film.scene.cabinet.walls())
    furniture = min((float(bounds(b.shape, b.T_world_body)[0][2]) for b in film.scene.obstacles), default=cabinet)
    return min(max(arm, float(film.scene.robot.T_world_base[2, 3])), cabinet, furniture) - 0.001
