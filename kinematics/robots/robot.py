"""Robot: any arm with a gripper. Joints by name, limits, mimic joints, link hulls, hand and camera frames."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kinematics.chain import Chain, Int
from kinematics.collision.geometry import Parts, make_parts
from kinematics.robots.hands.opening import Opening
from kinematics.robots.limits import JointLimits
from kinematics.robots.own import Grip
from kinematics.robots.tree import FIXED, SLIDES, TURNS, LinkHull, Tree, carried
from kinematics.transforms import Array, inverse, rotation_about, transform

WINDOW = 1.3 * np.pi
PIVOT_M = 0.001
OWN_ARM = 4  # joints from which on what is on a rail is an arm


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm, its hand and its camera.

    name: as asked for; urdf: the cleaned, joined URDF text with links `hand` and `camera`. joint_names (J,): every actuated joint, mimic
    joints left out; lower, upper (J,): limits, in rad or m, infinite where a joint is continuous; limits: those of its speed.
    arm_joints: indices of those between base and hand, in order; gripper_joint: index of the one that opens the hand.
    grip_force_N: how hard the gripper is told to close on an object, and most_grip_force_N: how hard it can by its data sheet; None where
    that is not known. notes: what of its description was left out, changed or could not be done well, a line each. grip: how the hand of a
    URDF of one's own closes, None of a named robot.
    skip: pairs of links that are neighbours or always touch. fingers: links that the gripper joint moves; pads: those of them that close on
    an object.
    """

    name: str
    title: str
    urdf: str
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    limits: JointLimits
    arm_joints: tuple[int, ...]
    gripper_joint: int
    home: Array
    tree: Tree
    hulls: tuple[LinkHull, ...]
    skip: frozenset[frozenset[str]]
    fingers: frozenset[str]
    pads: frozenset[str]
    opening: Opening
    base_p: Array = field(default_factory=lambda: np.zeros(3))
    has_camera: bool = False
    grip_force_N: float | None = None
    most_grip_force_N: float | None = None
    notes: tuple[str, ...] = ()
    grip: Grip | None = None

    @property
    def velocity(self) -> Array:
        """Limits (J,) in rad/s or m/s."""
        return self.limits.velocity

    @property
    def acceleration(self) -> Array:
        """Limits (J,) in rad/s² or m/s²."""
        return self.limits.acceleration

    @property
    def jerk(self) -> Array:
        """Limits (J,) in rad/s³ or m/s³."""
        return self.limits.jerk

    @property
    def known_jerk(self) -> Array:
        """The same, infinite where nobody says a limit and one is assumed."""
        return self.limits.known_jerk

    @cached_property
    def arm_limits(self) -> tuple[Array, Array, Array]:
        """Limits of velocity, acceleration and jerk of the arm's joints (A,)."""
        return self.arm_q(self.velocity), self.arm_q(self.acceleration), self.arm_q(self.jerk)

    def link_poses(self, q: Array) -> dict[str, Array]:
        """Pose (4, 4) of every link in the base frame at q (J,). Raises: ValueError for another number of values."""
        if np.shape(q) != (len(self.joint_names),):
            raise ValueError(f"q {np.shape(q)} must hold {len(self.joint_names)} values, one for each of {', '.join(self.joint_names)}")
        return dict(zip(self.tree.names, self.tree.poses(q)))

    def with_arm(self, arm_q: Array, gripper: float | Array) -> Array:
        """The full q (J,) with the arm's joints (A,) and the gripper's value set, the rest at home; or (K, J) with (K, A) and (K,)."""
        q = np.empty((*arm_q.shape[:-1], len(self.home)))
        q[:] = self.home
        q[..., self._arm] = arm_q
        q[..., self.gripper_joint] = gripper
        return q

    def arm_q(self, q: Array) -> Array:
        """The arm's joints (A,) of a full q (J,), or (K, A) of (K, J)."""
        return np.array(q[..., self._arm])

    @cached_property
    def _arm(self) -> Int | slice:
        """The arm's joints among all; a slice where they follow one another, which is quicker."""
        first, count = self.arm_joints[0], len(self.arm_joints)
        in_turn = self.arm_joints == tuple(range(first, first + count))
        return slice(first, first + count) if in_turn else np.array(self.arm_joints, np.int64)

    @cached_property
    def hand_links(self) -> frozenset[str]:
        """The links that the arm's last joint moves: palm and fingers, and what is fixed to them."""
        return frozenset(self.tree.names[i] for i in self.tree.below(self._movers[-1]))

    def pivot(self, T_world_base: Array) -> Array:
        """Where (2,) the arm's first joint turns about the vertical, in the world's x and y; the base's origin where it does not turn so,
        or turns there. On a rail (`rails`), where that joint is with the arm in the middle of it."""
        first = self._movers[0]
        joint = T_world_base @ (self._mid_rail if self.rails else self._poses_at_home[first])
        upright = self.tree.kind[first] == TURNS and abs(joint[2, :3] @ self.tree.axis[first]) > np.cos(0.01)
        there, base = joint[:2, 3], T_world_base[:2, 3]
        return np.asarray(there if (upright or self.rails) and np.hypot(*(there - base)) > PIVOT_M else base)

    @cached_property
    def rails(self) -> tuple[tuple[int, Array], ...]:
        """What carries a whole arm along: the level sliders before its first joint that turns, each with the direction (2,) in which it
        leads, in the base's x and y. None where hardly more than a wrist is on them: a telescope, a gantry."""
        first = list(itertools.takewhile(lambda link: self.tree.kind[link] == SLIDES, self._movers))
        ways = [(int(self.tree.q_index[i]), self._poses_at_home[i, :3, :3] @ self.tree.axis[i]) for i in first]
        return tuple((j, w[:2]) for j, w in ways if abs(w[2]) < np.sin(0.01)) if len(self._movers) - len(first) >= OWN_ARM else ()

    def mid_rails(self) -> Array:
        """The middle (R,) of the range of each of `rails`, in m."""
        return np.array([(self.lower[joint] + self.upper[joint]) / 2 for joint, _ in self.rails])

    @cached_property
    def _mid_rail(self) -> Array:
        """The pose (4, 4) in the base frame of the first joint that turns, the arm in the middle of its rails."""
        q = self.home.copy()
        q[[joint for joint, _ in self.rails]] = self.mid_rails()
        turning = next(link for link in self._movers if self.tree.kind[link] == TURNS)
        return np.asarray(self.tree.poses(q)[turning])

    def shoulder(self, T_world_base: Array) -> float:
        """How high the arm's first joint is at home, world, m."""
        return float((T_world_base @ self._poses_at_home[self._movers[0]])[2, 3])

    @cached_property
    def planning_limits(self) -> tuple[Array, Array]:
        """Limits (A,) for planning: a revolute joint that turns more than once keeps to a window of 1.3 turns about its home position.

        A window of just one turn would cut through branches of solutions that straddle its ends.
        """
        arm = list(self.arm_joints)
        low, high, home = self.lower[arm].copy(), self.upper[arm].copy(), self.home[arm]
        turns = np.array([self.tree.kind[self._mover(j)] == TURNS for j in arm])
        wide = turns & (high - low > 2 * WINDOW)
        low[wide], high[wide] = np.maximum(low, home - WINDOW)[wide], np.minimum(high, home + WINDOW)[wide]
        return low, high

    def chain(self, T_world_base: Array) -> Chain:
        """The arm as arrays for compiled code, standing at T_world_base (4, 4)."""
        movers = self._movers
        T_prev, at = [], T_world_base
        column = {j: i for i, j in enumerate(self.arm_joints)}
        rest = self.home
        for link in self.tree.path(self.tree.index["hand"]):
            T_joint = self.tree.local(link, rest) if link not in movers else self.tree.T_joint[link]
            if link in movers:
                align = self._aligned[link]
                T_prev.append(at @ T_joint @ align)
                at = inverse(align)
            else:
                at = at @ T_joint
        low, high = self.planning_limits
        arm = list(self.arm_joints)
        return Chain(
            np.array(T_prev),
            np.array([column[int(self.tree.q_index[m])] for m in movers], np.int64),
            self.tree.scale[movers].astype(float),
            self.tree.offset[movers].astype(float),
            (self.tree.kind[movers] == SLIDES).astype(np.int64),
            low,
            high,
            np.isinf(self.lower[arm]).astype(np.int64),
        )

    def carriers(self, T_world_base: Array) -> tuple[Int, Array]:
        """The links that are fixed to the chain's frames, as `tree.carried` takes them: the root (frame 0: the world), the moving ones."""
        n, movers = len(self.tree.names), self._movers
        frame, T = np.full(n, -1, np.int64), np.zeros((n, 4, 4))
        roots = [i for i, parent in enumerate(self.tree.parent) if parent < 0]
        frame[roots], T[roots] = 0, [T_world_base @ self.tree.local(i, self.home) for i in roots]
        frame[movers], T[movers] = np.arange(len(movers)) + 1, [inverse(self._aligned[i]) for i in movers]
        return frame, T

    def frame_of_links(self, gripper: float, T_world_base: Array) -> dict[str, tuple[int, Array]]:
        """For every link, the chain's frame that carries it (0: the world) and its pose (4, 4) in that frame, at one gripper value."""
        q = self.with_arm(np.zeros(len(self.arm_joints)), gripper)
        frame, T = carried(self.tree.joints, q, *self.carriers(T_world_base))
        return {name: (int(frame[i]), T[i]) for i, name in enumerate(self.tree.names)}

    def carrier(self, link: str) -> str:
        """The last link on the way to a link, itself included, that one of the arm's joints moves; the first one where none does."""
        path = self.tree.path(self.tree.index[link])
        return self.tree.names[next((i for i in path[::-1] if i in self._movers), path[0])]

    def parts(self, gripper: float, T_world_base: Array) -> tuple[Parts, tuple[str, ...]]:
        """Every link hull for compiled code, with the fingers at one gripper value; also the link behind each part."""
        carried = self.frame_of_links(gripper, T_world_base)
        frames, hulls = [], []
        for hull in self.hulls:
            frame, T = carried[hull.link]
            frames.append(frame)
            hulls.append(hull.vertices @ T[:3, :3].T + T[:3, 3])
        return make_parts(frames, hulls), tuple(h.link for h in self.hulls)

    @cached_property
    def self_pairs(self) -> Int:
        """Pairs (S, 2) of parts that may not touch each other: on different chain frames, not neighbours, not always touching."""
        carried = self.frame_of_links(float(self.home[self.gripper_joint]), np.eye(4))
        pairs = [
            (i, j)
            for i, a in enumerate(self.hulls)
            for j, b in enumerate(self.hulls[:i])
            if carried[a.link][0] != carried[b.link][0] and frozenset((a.link, b.link)) not in self.skip
        ]
        return np.array(pairs, np.int64).reshape(-1, 2)

    @cached_property
    def _movers(self) -> list[int]:
        """Links on the way to the hand whose joint moves."""
        return [
            i for i in self.tree.path(self.tree.index["hand"]) if self.tree.kind[i] != FIXED and self.tree.q_index[i] in self.arm_joints
        ]

    @cached_property
    def _aligned(self) -> dict[int, Array]:
        """For each of these links a rotation (4, 4) that takes z to its joint's axis."""
        return {link: _align_z(self.tree.axis[link]) for link in self._movers}

    @cached_property
    def _poses_at_home(self) -> Array:
        """All links' poses (·, 4, 4) at home, the base at the origin."""
        return self.tree.poses(self.home)

    def _mover(self, joint: int) -> int:
        return next(i for i in range(len(self.tree.names)) if self.tree.q_index[i] == joint and self.tree.scale[i] == 1.0)


def _align_z(axis: Array) -> Array:
    """A rotation (4, 4) that takes z to `axis` (3,)."""
    z = np.array([0.0, 0.0, 1.0])
    if np.allclose(axis, z):
        return np.eye(4)
    turn = np.cross(z, axis)
    if np.linalg.norm(turn) < 1e-12:
        return transform(rotation_about((1.0, 0.0, 0.0), np.pi))
    return transform(rotation_about(turn, float(np.arctan2(np.linalg.norm(turn), axis[2]))))
