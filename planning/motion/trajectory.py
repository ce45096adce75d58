"""From certified waypoints to trajectories: every motion one C² spline from rest to rest, free by proof, as fast as the limits allow.

A motion of two waypoints is a straight line in joint space. Where the waypoints lie evenly on a straight line of the hand, the arm drives
along it in one piece (straight_line.py). Any other polyline has its corners rounded (blending.py), each as far as it can be proved free
(curve_check.py); where nothing can be proved, the arm stops at the corner, exactly on the polyline that was certified.

Source of the profiles: jerk_limited.py. Other libraries were looked at: toppra knows no jerk limits, ruckig drives to states and not along
a path (between way points only in its cloud service). benchmarks/trajectories.py compares with toppra, a test with ruckig.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.collision.clearance import clearances
from kinematics.collision.stretches import Stretch
from kinematics.inverse import BRISK, descend
from kinematics.quintic_spline import evaluate, hermite
from kinematics.robots.robot import Robot
from kinematics.transforms import Array
from planning.motion.cell.workcell import Workcell
from planning.motion.search.edges import Task
from planning.motion.smoothing.blending import Corners, choose_speeds, make_corners, write_corner, write_rows
from planning.motion.smoothing.curve_check import WITHIN_M, curve_free
from planning.motion.smoothing.hand_speed import along_pieces, along_rows, hand_points
from planning.motion.smoothing.spline_rows import keep_limits, slow_down
from planning.motion.smoothing.straight_line import second_derivatives, write_line
from planning.plan import Gripper, GripperState, Motion

MOST_USED = 1 - 1e-4
"""Of each limit: what rounding may add stays within it."""
STRAIGHT_M = 2e-4
"""How far the hand may be from its line where waypoints count as a straight way of the hand."""
ON_LINE_M, MOST_HALVINGS = 3e-5, 3
"""So near to its line the hand shall stay on a straight way, along any axis; and how often waypoints are put in between for that."""
NEAR = 0.05
"""What is put in between is no further from where the spline is, rad or m: else the arm would take another way."""
SMALLEST_M = 1e-5
"""A corner that is rounded by less is a stop."""
SHRINK = 0.6
SAME = 1e-9
"""Waypoints that differ by less, in rad or m, are one."""
STRAIGHT = ("approach", "lift", "lower", "retreat")
LOOK_S = 0.02
"""So often it is measured how near a motion comes to something."""
SLOWEST = 10.0
"""So many times slower a motion is at most for what it comes near to."""
LEAST_S = 0.001
"""A motion in which nothing moves takes so long: a controller wants times that rise."""
FURTHER_M = 0.006
"""So much nearer to each other than they are thought to meet it, fingers are told to close on what was only seen, 3 mm on each side: a face
that no view shows well may be off by that. They stop where they meet it."""
_ROWS = 1024


@dataclass(frozen=True)
class Pace:
    """How fast a plan is driven.

    speed: 1 as fast as the limits allow; at 0.5 all takes twice as long. hand_speed: of the hand with an object in it, m/s. slow_below_m: a
    motion that comes nearer to something than that is so much slower, in proportion; 0: none is.
    """

    speed: float = 1.0
    hand_speed: float = 1.0
    slow_below_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0.01 <= self.speed <= 1:
            raise ValueError(f"the speed must lie between 0.01 and 1, not at {self.speed:g}")
        if not self.hand_speed > 0:
            raise ValueError(f"the hand's speed must be positive, not {self.hand_speed:g} m/s")
        if not 0 <= self.slow_below_m <= 0.1:
            raise ValueError(f"motions may slow down below a clearance of 0 to 100 mm, not {1000 * self.slow_below_m:g} mm")


FULL = Pace()


class _Drive:
    """One robot before one cabinet, to be driven at some pace: its limits, and scratch memory for the rows of a spline."""

    def __init__(self, cell: Workcell, pace: Pace) -> None:
        self.cell, self.pace = cell, pace
        robot, arm = cell.robot, list(cell.robot.arm_joints)
        self.limits = robot.arm_limits
        self.positions = robot.lower[arm], robot.upper[arm]
        self.t, self.rows = np.empty(_ROWS), np.empty((_ROWS, 3, len(arm)))
        self.ends, self.points = np.empty((2, 3, len(arm))), np.empty((_ROWS, len(arm)))
        self.frames = np.empty((len(cell.arm.chain.q_index) + 1, 4, 4))

    def trajectory(self, poses: Mapping[str, Array], motion: Motion) -> Motion:
        """One motion's trajectory. poses: of the objects that stand meanwhile."""
        robot, arm, gripper = self.cell.robot, list(self.cell.robot.arm_joints), _gripper(self.cell, motion)
        q = _without_repeats(motion.q)
        if len(q) == 1:  # nothing moves
            still = np.zeros((2, q.shape[1]))
            return replace(motion, q=np.repeat(q, 2, 0), t_s=np.array([0.0, LEAST_S]), qd=still, qdd=still, gripper=gripper)
        way = _without_repeats(np.ascontiguousarray(q[:, arm]))  # rows may differ in the gripper's value alone
        if len(way) == 1:
            t, rows = _from_stop_to_stop(q, robot.velocity, robot.acceleration, robot.jerk)
        else:
            count = self._drive(poses, motion, way)
            t, rows = self.t[:count].copy(), np.zeros((count, 3, q.shape[1]))
            rows[:, 0] = q[0]
            rows[:, :, arm] = self.rows[:count]
            g = robot.gripper_joint
            if q[0, g] != q[-1, g]:
                limits = (limit[[g]] for limit in (robot.velocity, robot.acceleration, robot.jerk))
                t, rows = _beside(t, rows, g, *_from_stop_to_stop(q[[0, -1]][:, [g]], *limits))
        slower = 1 / self.pace.speed
        if self.pace.slow_below_m > 0:
            slower *= self._slower(poses, motion, t, rows)
        if slower > 1:
            slow_down(slower, len(t), t, rows)
        return replace(motion, q=rows[:, 0].copy(), t_s=t, qd=rows[:, 1].copy(), qdd=rows[:, 2].copy(), gripper=gripper)

    def _slower(self, poses: Mapping[str, Array], motion: Motion, t: Array, rows: Array) -> float:
        """So many times slower a motion with times t (R,) and rows (R, 3, J) is for what it comes near to."""
        most = self.pace.slow_below_m
        q = evaluate(hermite(t, *np.swapaxes(rows, 0, 1)), np.linspace(0, t[-1], 2 + int(t[-1] / LOOK_S)))
        stretch = Stretch(q, poses, motion.held, tuple(motion.allowed_contacts))
        clearance_m = float(clearances(self.cell.robot, self.cell.scene, stretch, most).min())
        return most / max(clearance_m, most / SLOWEST)

    def _drive(self, poses: Mapping[str, Array], motion: Motion, q: Array) -> int:
        """The rows for the arm's waypoints q (K, A), K > 1, in self.t and self.rows; how many."""
        task = None if len(q) == 2 else self._task(poses, motion, q)
        hand_speed = self.pace.hand_speed if motion.held else np.inf
        count = self._along_line(task, q, hand_speed) if task is not None and motion.stage in STRAIGHT else 0
        if count == 0:
            count = self._along_polyline(task, q, hand_speed, STRAIGHT_M / 2 if motion.stage in STRAIGHT else np.inf)
        keep_limits(*self.limits, MOST_USED, count, self.t, self.rows)
        if motion.held:
            arm = self.cell.arm
            fastest = along_rows(arm.chain, arm.T_frame_hand, count, self.t, self.rows, self.frames, self.ends[0])
            if fastest > hand_speed * MOST_USED:
                slow_down(fastest / (hand_speed * MOST_USED), count, self.t, self.rows)
        return count

    def _task(self, poses: Mapping[str, Array], motion: Motion, q: Array) -> Task:
        """What may not touch while a motion lasts, for chords of curves; the memory is ready for it. Free ways keep as clear as their
        waypoints q (K, A) do."""
        cell = self.cell
        first, last = (float(motion.q[i, cell.robot.gripper_joint]) for i in (0, -1))
        moving = None if first == last else cell.any_opening(poses, first, last)
        query = cell.problem(poses, first, held=motion.held) if moving is None else moving
        for a, b in motion.allowed_contacts:
            if motion.held is None or b != motion.held.body:
                query = query.allowing(a, b)
        clearance_m = 0.0 if motion.stage in STRAIGHT else cell.clearest(query, q)
        cell.enter(query)
        return cell.for_chords(query, clearance_m, WITHIN_M)

    def _along_line(self, task: Task, q: Array, hand_speed: float) -> int:
        """The rows of a straight way of the hand, on its line or, where that can't be proved free, through q alone; 0 when it is none."""
        length = self._straight(q)
        if length == 0.0:
            return 0
        finest = self._on_line(q)
        for points in (finest, q) if len(finest) > len(q) else (q,):
            work = np.empty_like(points), np.empty(len(points)), np.empty((4, q.shape[1]))
            count = write_line(points, length, hand_speed, *self.limits, *work, self.t, self.rows)
            if count and self._free(task, count):
                return int(count)
        return 0

    def _straight(self, q: Array) -> float:
        """The length in metres of the hand's way when waypoints q (K, A) stand evenly on a straight line of it, else 0."""
        at, arm = np.empty((len(q), 3)), self.cell.arm
        hand_points(arm.chain, arm.T_frame_hand, q, self.frames, at)
        even = at[0] + np.linspace(0, 1, len(q))[:, None] * (at[-1] - at[0])
        length = float(np.linalg.norm(at[-1] - at[0]))
        return length if np.linalg.norm(at - even, axis=1).max() < STRAIGHT_M else 0.0

    def _on_line(self, q: Array) -> Array:
        """Waypoints (K', A) of the straight way along q (K, A), so many that the spline through them keeps the hand on its line: others
        are put halfway between where it would stray. Arms that pass near a singularity, or have a joint to spare, bend so much."""
        arm, hand = self.cell.arm, self.cell.hand
        for _ in range(MOST_HALVINGS):
            between, n = _middles(q), len(q)
            at = np.empty((n + 1, 3))
            hand_points(arm.chain, arm.T_frame_hand, np.concatenate([q[[0, -1]], between]), self.frames, at)
            line = at[0] + (np.arange(n - 1)[:, None] + 0.5) / (n - 1) * (at[1] - at[0])
            if np.abs(at[2:] - line).max() < ON_LINE_M:
                break
            finer = np.empty((2 * n - 1, q.shape[1]))
            finer[::2], finer[1::2] = q, between
            for x, to in zip(finer[1::2], line):
                T = arm.hand_pose(x)
                T[:3, 3] = to
                if not descend(arm.backing, arm.T_frame_hand, T, x, hand.frames, hand.work, BRISK):
                    return q
            if np.abs(finer[1::2] - between).max() > NEAR:
                return q
            q = finer
        return q

    def _along_polyline(self, task: Task | None, q: Array, hand_speed: float, stray_m: float) -> int:
        """The rows of a polyline with its corners rounded as far as they are proved free, and no point of the arm strays further than
        stray_m. task: None where there are no corners."""
        weight = np.ones(q.shape[1]) if task is None else task.exact.weight
        corners = make_corners(q, *self.limits, weight)
        corners.allowed[:] = stray_m
        if hand_speed < np.inf:
            arm = self.cell.arm
            along_pieces(arm.chain, arm.T_frame_hand, q, corners.direction, self.frames, np.empty(q.shape[1]), corners.most)
            corners.most[:] = np.minimum(1.0, hand_speed / np.maximum(corners.most, 1e-9))
        proved: dict[int, tuple[float, float]] = {}
        while True:
            choose_speeds(corners)
            doubtful = [i for i in range(1, len(q) - 1) if corners.strays[i] > 0 and proved.get(i) != tuple(corners.speed[i])]
            blocked = [i for i in doubtful if task is None or not self._corner_free(task, corners, i)]
            proved.update((i, (float(corners.speed[i, 0]), float(corners.speed[i, 1]))) for i in doubtful)
            for i in blocked:
                corners.allowed[i] = SHRINK * corners.strays[i] if corners.strays[i] > SMALLEST_M else 0.0
            if not blocked:
                return int(write_rows(corners, self.t, self.rows))

    def _corner_free(self, task: Task, corners: Corners, i: int) -> bool:
        return self._free(task, int(write_corner(corners, i, self.t, self.rows)))

    def _free(self, task: Task, count: int) -> bool:
        """Whether the curve of the first rows is free, for certain, and no joint leaves its limits on it."""
        return bool(curve_free(task, self.t, self.rows, count, *self.positions, self.ends, self.points, self.cell.memory))


def timed(cell: Workcell, poses: Mapping[str, Array], motions: Sequence[Motion], pace: Pace) -> tuple[Motion, ...]:
    """The trajectories of motions that follow one another, given as certified waypoints; the objects stand at `poses` before them."""
    drive, out = _Drive(cell, pace), list[Motion]()
    before: Motion | None = None
    for motion in motions:
        if before is not None and before.held and (motion.held is None or motion.held.body != before.held.body):
            at = cell.arm.hand_pose(cell.robot.arm_q(before.q[-1])) @ before.held.T_hand_body
            poses = {**poses, before.held.body: at}
        if motion.held and motion.held.body in poses:
            poses = cell.without(poses, motion.held.body)
        out.append(drive.trajectory(poses, motion))
        before = motion
    return tuple(out)


def _gripper(cell: Workcell, motion: Motion) -> Gripper:
    """What the gripper is told: with force while it holds something, when it begins to, and until it lets go."""
    robot, g = cell.robot, cell.robot.gripper_joint
    closed = (motion.held is not None or motion.stage == "release", motion.held is not None or motion.stage == "grasp")
    taken = motion.held.body if motion.held is not None else next((b for _, b in motion.allowed_contacts), None)
    further = FURTHER_M if any(b.name == taken and b.source == "seen" for b in cell.scene.objects) and not robot.opening.cup_m else 0.0
    before, after = (
        _told(robot, float(q[g]), further) if tight else GripperState(float(q[g]), robot.opening.width_at(float(q[g])))
        for q, tight in zip((motion.q[0], motion.q[-1]), closed)
    )
    return Gripper(robot.joint_names[g], before, after)


def _told(robot: Robot, value: float, further_m: float) -> GripperState:
    """What closed fingers are told: to come so much nearer to each other than they are thought to."""
    width_m = robot.opening.width_at(value)
    if further_m == 0.0:
        return GripperState(value, width_m, robot.grip_force_N)
    width_m = max(width_m - further_m, 0.0)
    return GripperState(value, width_m, robot.grip_force_N, robot.opening.value_at(width_m))


def _without_repeats(q: Array) -> Array:
    """Waypoints (K, J) without those that repeat the one before; both ends are kept as they are."""
    new = (np.abs(q[1:] - q[:-1]) > SAME).any(1)
    if new.all():
        return q
    kept = q[np.append(True, new)]
    if len(kept) > 1:
        kept[-1] = q[-1]
    return np.asarray(kept)


def _middles(q: Array) -> Array:
    """Where the spline of a straight way (straight_line.py) through q (K, A), K > 2, is halfway between any two of them: (K - 1, A)."""
    second = np.empty_like(q)
    second_derivatives(q, 1.0, second, np.empty(len(q)))
    return np.asarray((q[:-1] + q[1:]) / 2 - (second[:-1] + second[1:]) / 16)


def _from_stop_to_stop(q: Array, velocity: Array, acceleration: Array, jerk: Array) -> tuple[Array, Array]:
    """Times (R,) and rows (R, 3, J) of a polyline (K, J) that stops at every waypoint."""
    corners = make_corners(q, velocity, acceleration, jerk, np.ones(q.shape[1]))
    t, rows = np.empty(10 * len(q)), np.empty((10 * len(q), 3, q.shape[1]))
    count = int(write_rows(corners, t, rows))
    keep_limits(velocity, acceleration, jerk, MOST_USED, count, t, rows)
    return t[:count].copy(), rows[:count]


def _beside(t: Array, rows: Array, joint: int, t_joint: Array, rows_joint: Array) -> tuple[Array, Array]:
    """A trajectory, times t (R,) and rows (R, 3, J), with one joint moving at the same time, rows_joint (S, 3, 1), from its beginning on;
    whichever is done first waits for the other. The joint is slowed down a little where its rows would lie too near to the others."""
    for slower in np.linspace(1, 1.5, 101):
        gaps = np.abs(slower * t_joint[1:, None] - t)
        if gaps.min() > LEAST_S:
            break
    t_joint, rows_joint = t_joint * slower, rows_joint / np.array([1, slower, slower**2])[:, None]
    every = np.unique(np.concatenate([t, t_joint]))
    splines = [hermite(when, *np.swapaxes(what, 0, 1)) for when, what in ((t, rows), (t_joint, rows_joint))]
    whole, alone = (np.stack([evaluate(spline, every, order) for order in range(3)], axis=1) for spline in splines)
    whole[:, :, joint] = alone[:, :, 0]
    return every, whole
