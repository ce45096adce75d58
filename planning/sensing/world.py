"""What the sensing loop asks of a world, and the simulated one.

A world has three methods: it takes a frame, it carries motions out, it says where the arm is. A real camera and a real arm take part in the
loop by being such an object (`retrieve plan --sense --world MODULE:FUNCTION`). Only a simulated world can say afterwards what was true.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Held, Scene
from kinematics.transforms import Array, inverse
from perception.camera import DepthNoise, Intrinsics
from perception.frames import Frame, checked
from perception.rendering.synthetic_camera import Camera, robot_pixels, synthetic_camera
from planning.motion.checking.replay import hand_poses
from planning.motion.pick_place import Motions
from planning.plan import Motion
from planning.sensing.closing import close_on, with_fingers
from planning.verdict.hand import hand_of
from planning.verdict.polyhedra import polyhedra


@dataclass(frozen=True)
class Stopped:
    """An execution that ended early: in which of the motions, counted from 0, and why."""

    motion: int
    why: str


@dataclass(frozen=True, eq=False)
class _Grip:
    """An object in the hand, its pose there (4, 4), and the value of the gripper's joint."""

    body: str
    T_hand_body: Array
    value: float


class World(Protocol):
    """Where the arm is and what it sees. Methods may raise what they like; the loop ends with it."""

    def take_frame(self) -> Frame:
        """What the camera sees from where the arm stands; `frame_from` makes one of a depth image."""

    def execute(self, motions: Sequence[Motion]) -> Stopped | None:
        """Carry motions out, one after the other, and return when the arm rests: None when all is done, or where it stopped and why."""

    def where(self) -> Mapping[str, float]:
        """The joints' values now, by name, rad or m; the gripper's joint too."""


def frame_from(robot: Robot, T_world_base: Array, joints: Mapping[str, float], depth: NDArray[np.float32], intrinsics: Intrinsics) -> Frame:
    """A frame of a depth image (H, W), in metres along the optical axis, 0 where nothing was measured, taken where the joints are.

    The camera is at the robot's link `camera` (z forwards, x right). Objects are not told apart. Raises: ValueError, see
    `perception.frames.checked`.
    """
    q = configuration(robot, joints)
    T_world_camera = T_world_base @ robot.link_poses(q)["camera"]
    return checked(Frame(depth, None, (), intrinsics, T_world_camera, None, q))


def configuration(robot: Robot, joints: Mapping[str, float]) -> Array:
    """The configuration (J,) of joint values by name. Raises: ValueError when one is missing or no number."""
    missing = [name for name in robot.joint_names if name not in joints]
    if missing:
        raise ValueError(f"the world does not say where {', '.join(missing)} {'is' if len(missing) == 1 else 'are'}")
    q = np.array([joints[name] for name in robot.joint_names], float)
    if not np.isfinite(q).all():
        raise ValueError("the world says that a joint is at a value that is no number")
    return q


def with_own_pixels(robot: Robot, T_world_base: Array, frame: Frame, q: Array) -> Frame:
    """The frame with the robot's own pixels marked, if they are not."""
    if frame.arm is not None:
        return frame
    stood = q if frame.q is None else frame.q
    return replace(frame, arm=robot_pixels(robot, T_world_base, stood, frame), q=stood)


def part_done(motion: Motion, q: Array) -> Motion:
    """As much of a motion as was done when the arm stopped at q (J,): its waypoints up to the nearest moment, then q."""
    times = np.linspace(0.0, float(motion.t_s[-1]), 200)
    rows = motion.at(times)
    last = max(int(np.abs(rows - q).max(1).argmin()), 1)
    kept = np.flatnonzero(motion.t_s < times[last])
    return replace(
        motion, q=np.concatenate([motion.q[kept], q[None]]), t_s=np.append(motion.t_s[kept], times[last]), qd=None, qdd=None
    )  # fmt: skip


class Truth(Protocol):
    """What a world that knows itself says for the record, once something was planned: true names and poses. No planner asks it."""

    def names(self, bodies: Sequence[Body]) -> dict[str, str]:
        """What the bodies that somebody believes in are truly called."""

    def poses_now(self, believed: Mapping[str, Array]) -> Mapping[str, Array]:
        """Where the objects truly are (4, 4), by their true names. believed: where they are believed to be."""

    def recorded(self, motions: Sequence[Motion], names: Mapping[str, str], before: Mapping[str, Array]) -> tuple[Motion, ...]:
        """Motions as they truly were: under true names, the held object as it was in the hand. before: the true poses before them."""

    def pushed(self) -> Mapping[str, float]:
        """How far in metres the fingers have pushed objects, by their true names, as they closed on them."""


class AsBelieved:
    """Nothing but what is believed: for a real world."""

    def names(self, bodies: Sequence[Body]) -> dict[str, str]:
        return {b.name: b.name for b in bodies}

    def poses_now(self, believed: Mapping[str, Array]) -> Mapping[str, Array]:
        return believed

    def recorded(self, motions: Sequence[Motion], names: Mapping[str, str], before: Mapping[str, Array]) -> tuple[Motion, ...]:
        return tuple(motions)

    def pushed(self) -> Mapping[str, float]:
        return {}


class SimulatedWorld:
    """A world that is known to the simulation alone: a scene's objects where they truly are, and a camera with or without noise.

    by: "mask" when its pictures say which pixels are which object's, under the scene's names; "geometry" when they say nothing.
    rng: for the noise, the loop's own.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        rng: np.random.Generator,
        noise: DepthNoise | None = None,
        by: Literal["mask", "geometry"] = "mask",
    ) -> None:
        self.robot, self.scene, self.rng, self.noise, self.by = robot, scene, rng, noise, by
        self.poses: dict[str, Array] = dict(scene.poses())
        self.q = Motions(robot, replace(scene, objects=(), observation=None)).start().q
        self._camera: Camera | None = None
        self._pushed: dict[str, float] = {}

    def take_frame(self) -> Frame:
        if self._camera is None:
            self._camera = synthetic_camera(self.robot, self.scene, self.poses, noise=self.noise, rng=self.rng)
        frame = self._camera(self.scene.robot.T_world_base @ self.robot.link_poses(self.q)["camera"], self.q)
        return frame if self.by == "mask" else replace(frame, instance=None, names=())

    def execute(self, motions: Sequence[Motion]) -> Stopped | None:
        names = dict[str, str]()
        for motion in motions:
            if motion.held is not None and motion.held.body not in names:
                at = hand_poses(self.robot, self.scene, motion.q[0]) @ motion.held.T_hand_body
                names[motion.held.body] = self._name_at(motion.held.body, at)
        for motion in self.recorded(motions, names, self.poses):
            if motion.held is not None:
                self.poses[motion.held.body] = hand_poses(self.robot, self.scene, motion.q[-1]) @ motion.held.T_hand_body
                self._camera = None
            self.q = motion.q[-1]
        return None

    def where(self) -> dict[str, float]:
        return dict(zip(self.robot.joint_names, map(float, self.q)))

    def names(self, bodies: Sequence[Body]) -> dict[str, str]:
        return {b.name: self._name_at(b.name, b.T_world_body) for b in bodies}

    def poses_now(self, believed: Mapping[str, Array]) -> dict[str, Array]:
        return dict(self.poses)

    def recorded(self, motions: Sequence[Motion], names: Mapping[str, str], before: Mapping[str, Array]) -> tuple[Motion, ...]:
        """See `Truth`. Fingers that are told to go on until they meet something stop at the true object, and push it where one of them
        meets it first."""
        poses, out, grip, g = dict(before), list[Motion](), None, self.robot.gripper_joint
        renamed = [_under(motion, names) for motion in motions]
        for motion, following in zip(renamed, [*(m.held for m in renamed[1:]), None]):
            first, last = float(motion.q[0, g]), float(motion.q[-1, g])
            if motion.held is not None:
                name = motion.held.body
                if grip is None or grip.body != name:
                    grip = _Grip(name, self._in_hand(motion.q[0], poses[name]), first)
                poses[name] = hand_poses(self.robot, self.scene, motion.q[-1]) @ grip.T_hand_body
                motion = replace(with_fingers(motion, g, grip.value, grip.value), held=Held(name, grip.T_hand_body))
            elif following is not None:
                grip = self._closing(motion, following.body, self._in_hand(motion.q[-1], poses[following.body]))
                motion = with_fingers(motion, g, first, grip.value)
            elif grip is not None:
                motion, grip = with_fingers(motion, g, grip.value, last), None
            out.append(replace(motion, clearance_m=None, clearance_between=None))  # what was said of them is of what was believed
        return tuple(out)

    def _in_hand(self, q: Array, T_world_body: Array) -> Array:
        return inverse(hand_poses(self.robot, self.scene, q)) @ T_world_body

    def _closing(self, motion: Motion, name: str, T_hand_body: Array) -> _Grip:
        """What comes of closing the fingers on an object, which stands at T_hand_body (4, 4) before."""
        g, told = self.robot.gripper_joint, motion.gripper.after.command if motion.gripper is not None else None
        as_planned = _Grip(name, T_hand_body, float(motion.q[-1, g]))
        if told is None:
            return as_planned
        closed = close_on(hand_of(self.robot), polyhedra(self.scene.body(name).shape), T_hand_body, float(motion.q[0, g]), told)
        if closed is None:
            return as_planned
        self._pushed[name] = max(self._pushed.get(name, 0.0), abs(closed.pushed_m))
        return _Grip(name, closed.T_hand_body, closed.value)

    def pushed(self) -> Mapping[str, float]:
        return self._pushed

    def _name_at(self, name: str, T_world_body: Array) -> str:
        """What a body is truly called: by what the masks say, and where they say nothing of it, after the object that stands nearest."""
        if self.by == "mask" and name in self.poses:
            return name
        return min(self.poses, key=lambda n: float(np.linalg.norm(self.poses[n][:2, 3] - T_world_body[:2, 3])))


def _under(motion: Motion, names: Mapping[str, str]) -> Motion:
    """The motion with other names for the objects."""
    touch = tuple((names.get(a, a), names.get(b, b)) for a, b in motion.allowed_contacts)
    held = motion.held and Held(names.get(motion.held.body, motion.held.body), motion.held.T_hand_body)
    return replace(motion, allowed_contacts=touch, held=held)
