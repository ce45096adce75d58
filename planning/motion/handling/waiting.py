"""Where an arm starts and waits: at its home, or before the cabinet with an empty hand or with an object in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import chain, product

import numpy as np

from kinematics import inverse
from kinematics.collision import edge_check, edge_problem
from kinematics.collision.edge_problem import MARGIN_M
from kinematics.collision.fcl_solids import always_touching, shape_solids, touch
from kinematics.collision.geometry import Query, make_solids
from kinematics.robots.joints import beyond_limits
from kinematics.robots.robot import Robot
from kinematics.robots.start import start_q
from kinematics.robots.tree import FIXED
from kinematics.scene import Cabinet, Held
from kinematics.shapes import bounds
from kinematics.transforms import Array, rotation_about, transform
from planning.motion.cell.arm import HALF_TURN, Arm
from planning.motion.cell.queries import PlanningQuery
from planning.motion.cell.workcell import IkSearch, Workcell
from planning.motion.lazy_list import LazyList
from planning.motion.search.upright import Upright, is_upright
from planning.plan import Blocked
from planning.verdict.contact import TOUCH_M
from planning.verdict.pairs import link_solids, pairs_of

LEVEL = np.stack([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], -1)  # the hand looks along the cabinet's x, its x is up
OUTSIDE_M = 0.03  # before the cabinet's front ends what is pulled straight out of it
LEAST_OUTWARD = 0.5  # a hand that looks in more steeply is not pulled back along its own axis
PULL_TRIES = 6  # starts of inverse kinematics
ENOUGH_WAITING = 24  # after a look at so many places to wait with an object in the hand, those that were found will do
ANYWHERE = 100  # configurations of an arm at which its links are asked whether they touch wherever it is
LOOKS_DOWN = 0.1  # the horizontal part of the hand's approach, from which on it tells where the hand looks


def places_to_wait(arm: Arm, cabinet: Cabinet, looks: Array = LEVEL) -> Iterable[Array]:
    """Arm configurations (A,) with the hand before the cabinet's front, looking in, free of its walls; the most central first.

    looks (3, 3): how the hand looks in, in the cabinet's frame, but for its yaw. What is found is kept.
    """
    return _waiting(arm, cabinet.size_m.tobytes(), cabinet.T_world_cabinet.tobytes(), cabinet.wall_m, looks.tobytes())


def looking_in(T_world_cabinet: Array, R_world_hand: Array) -> Array:
    """A hand's rotation (3, 3) about the vertical so that it looks into the cabinet, in the cabinet's frame; one that looks straight down
    has its x ahead."""
    ahead = R_world_hand[:, 2] if np.hypot(*R_world_hand[:2, 2]) > LOOKS_DOWN else R_world_hand[:, 0]
    yaw = np.arctan2(T_world_cabinet[1, 0], T_world_cabinet[0, 0]) - np.arctan2(ahead[1], ahead[0])
    return np.round(T_world_cabinet[:3, :3].T @ rotation_about((0.0, 0.0, 1.0), float(yaw)) @ R_world_hand, 9)


@lru_cache(maxsize=32)
def _waiting(arm: Arm, size: bytes, T_cabinet: bytes, wall_m: float, looks: bytes) -> Iterable[Array]:
    cabinet = Cabinet(np.frombuffer(size), np.frombuffer(T_cabinet).reshape(4, 4), wall_m)
    return LazyList(_find_waiting(arm, cabinet, np.frombuffer(looks).reshape(3, 3)))


def _find_waiting(arm: Arm, cabinet: Cabinet, looks: Array) -> Iterator[Array]:
    """See `places_to_wait`."""
    solids, names = make_solids(cabinet.walls())
    posed = arm.posed(float(arm.robot.home[arm.robot.gripper_joint]))
    check = np.ones((len(posed.frame), len(names)), np.uint8)
    check[posed.frame == 0] = 0
    problem = edge_problem.pose(arm.chain, posed, solids, Query(check, arm.self_pairs), MARGIN_M)
    scratch = edge_problem.make_scratch(problem)
    _, width, height = cabinet.size_m
    home = arm.robot.arm_q(arm.robot.home)
    for back, z, y, yaw in product((0.08, 0.16), (0.5, 0.9, 0.2), (0.0, 0.25, -0.25, 0.5, -0.5), (0.0, 0.6, -0.6, 1.2, -1.2)):
        p = [-back, y * width, z * height]
        for R in (looks, looks @ HALF_TURN) if arm.few_joints else (looks,):
            T = cabinet.T_world_cabinet @ transform(rotation_about((0.0, 0.0, 1.0), yaw) @ R, p)
            for q in inverse.solve(arm.backing, arm.T_frame_hand, arm.seeds, T, home, tries=8)[:2]:
                if edge_check.config_free(problem, q, scratch):
                    yield q


def home(cell: Workcell) -> Array:
    """The full configuration (J,) in which the arm waits: the robot's own, or where that touches, one before the cabinet.

    Raises: ValueError when there is none.
    """
    gripper = float(cell.robot.home[cell.robot.gripper_joint])
    empty = cell.problem(cell.scene.poses(), gripper)
    own = cell.robot.arm_q(cell.robot.home)
    at_home = cell.touch(empty, own)
    if at_home is None:
        return cell.robot.with_arm(own, gripper)
    for q in places_to_wait(cell.arm, cell.scene.cabinet):
        if cell.touch(empty, q) is None:
            return cell.robot.with_arm(q, gripper)
    words = f"robot {cell.robot.name} finds no place to wait before this cabinet: at home, "
    if (limb := _limb_in_the_way(cell)) is not None:
        raise ValueError(f"{words}{limb}")
    raise ValueError(words + (touching_anywhere(cell.robot) or f"{at_home.link} touches {at_home.body}"))


def _limb_in_the_way(cell: Workcell) -> str | None:
    """What touches at home, wherever the arm is, as joints move it that no plan moves: the link, the body and the joints, in words."""
    robot, poses = cell.robot, cell.scene.robot.T_world_base @ cell.robot.tree.poses(cell.robot.home)
    standing = [s.move(body.T_world_body) for body in cell.scene.fixtures() for s in shape_solids(body.name, body.shape)]
    moved_by, planned = _moved_by(robot), _planned(robot)
    for solid in link_solids(robot):
        solid.move(poses[robot.tree.index[solid.name]])
        for body in standing if moved_by[solid.name] - planned else ():
            if touch(solid, body) is not None:
                return f"{solid.name} touches {body.name}, {_set_by_hand(robot, moved_by[solid.name] - planned)}"
    return None


@lru_cache(maxsize=16)
def _limb_on_itself(robot: Robot) -> Blocked | None:
    """Which links touch each other at home between which there are joints, but none that a plan moves: another arm is folded on itself. The
    verdict finds them in whatever is planned."""
    moved_by, planned = _moved_by(robot), _planned(robot)
    if not any(joints - planned for joints in moved_by.values()):
        return None
    poses = robot.tree.poses(robot.home)
    solids = [solid.move(poses[robot.tree.index[solid.name]]) for solid in link_solids(robot)]
    for one, other in ((solids[i], solids[j]) for i, j in pairs_of(robot).checked):
        between = moved_by[one.name] ^ moved_by[other.name]
        if not between & planned and (depth := touch(one, other)) is not None and depth > TOUCH_M:
            return Blocked("transit", one.name, other.name, detail=f"at home, {_set_by_hand(robot, between)}")
    return None


@lru_cache(maxsize=16)
def touching_anywhere(robot: Robot) -> str | None:
    """Which links touch nearly wherever the arm is, as joints that no plan moves stand at home: which, and what mends it, in words; None
    where there are none. Links that touch wherever all joints are may do so."""
    moved_by, planned = _moved_by(robot), _planned(robot)
    if not set().union(*moved_by.values()) - planned:
        return None
    rng, arm = np.random.default_rng(0), list(robot.arm_joints)
    low, high = np.maximum(robot.lower[arm], -np.pi), np.minimum(robot.upper[arm], np.pi)
    at = robot.with_arm(rng.uniform(low, np.maximum(low, high), (ANYWHERE, len(arm))), robot.home[np.full(ANYWHERE, robot.gripper_joint)])
    samples = [robot.link_poses(q) for q in at]
    found = sorted(sorted(pair) for pair in always_touching(robot.hulls, samples, set(robot.skip)))
    pairs = [(a, b) for a, b in found if (moved_by[a] ^ moved_by[b]) - planned]
    if not pairs:
        return None
    joints = set().union(*(moved_by[a] ^ moved_by[b] for a, b in pairs)) - planned
    touching = ", ".join(f"{a} touches {b}" for a, b in pairs)
    srdf = " ".join(f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in pairs)
    return (
        f"wherever the arm is, {touching}, {_set_by_hand(robot, joints)}, or let them touch in an SRDF of the URDF's name beside it: {srdf}"
    )


def _moved_by(robot: Robot) -> dict[str, set[int]]:
    """For each link with geometry the joints that move it."""
    tree = robot.tree
    return {h.link: {int(tree.q_index[i]) for i in tree.path(tree.index[h.link]) if tree.kind[i] != FIXED} for h in robot.hulls}


def _planned(robot: Robot) -> set[int]:
    """The joints that plans move."""
    return {*robot.arm_joints, robot.gripper_joint}


def _set_by_hand(robot: Robot, joints: set[int]) -> str:
    names = ", ".join(robot.joint_names[j] for j in sorted(joints))
    return f"and no plan moves {names}: say in the scene's robot.home where they are"


def start(cell: Workcell) -> Array:
    """The full configuration (J,) in which the scene's first motion begins: its robot's q_start if it has one, else `home`.

    Raises: ValueError for a q_start with joints that the robot does not have, and like `home`.
    """
    q = start_q(cell.robot, cell.scene.robot)
    return home(cell) if q is None else np.clip(q, cell.robot.lower, cell.robot.upper)


def start_blocked(cell: Workcell) -> Blocked | None:
    """Why no motion can begin: another arm that touches itself, or the scene's q_start; None when one can."""
    if (limb := _limb_on_itself(cell.robot)) is not None:
        return limb
    q = start_q(cell.robot, cell.scene.robot)
    if q is None:
        return None
    if beyond := beyond_limits(cell.robot.joint_names, q, cell.robot.lower, cell.robot.upper):
        return Blocked("transit", detail=f"at the start, {beyond}")
    q = start(cell)
    gripper = float(q[cell.robot.gripper_joint])
    found = cell.touch(cell.problem(cell.scene.poses(), gripper), cell.robot.arm_q(q))
    return None if found is None else Blocked("transit", found.link, found.body, detail="at the start")


def outside(cell: Workcell, carrying: PlanningQuery, held: Held, most: int = 8) -> Array:
    """Free arm configurations (G, A) that hold an object wholly before the cabinet's front; home first, G may be 0."""
    goals, task, memory, shape = list[Array](), carrying.task, cell.memory, cell.scene.body(held.body).shape
    T_cabinet = np.linalg.inv(cell.scene.cabinet.T_world_cabinet)
    for i, q in enumerate(chain([cell.home_arm], places_to_wait(cell.arm, cell.scene.cabinet, _looks(cell, task.upright, held)))):
        if goals and i > ENOUGH_WAITING:
            break
        T = T_cabinet @ cell.arm.hand_pose(q) @ held.T_hand_body
        inmost = bounds(shape, T)[1][0]
        upright = is_upright(task.exact.chain, task.upright, q, memory.exact)
        if T[0, 3] < -0.03 and inmost < 0.0 and upright and cell.touch(carrying, q) is None:
            goals.append(q)
            if len(goals) == most:
                break
    return np.array(goals).reshape(-1, len(cell.home_arm))


def pulled_out(cell: Workcell, carrying: PlanningQuery, held: Held, q: Array) -> Array:
    """Free arm configurations (G, A) near q (A,) with the hand as it is there, but so far back that a held object is wholly before the
    cabinet's front: back along its own z, and straight out of the cabinet. G may be 0."""
    goals, T_hand, T_cabinet = list[Array](), cell.arm.hand_pose(q), cell.scene.cabinet.T_world_cabinet
    out = -T_cabinet[:3, 0]
    inmost = bounds(cell.scene.body(held.body).shape, np.linalg.inv(T_cabinet) @ T_hand @ held.T_hand_body)[1][0]
    for along in (-T_hand[:3, 2], out):
        if along @ out > LEAST_OUTWARD:
            there = transform(T_hand[:3, :3], T_hand[:3, 3] + max(0.0, inmost + OUTSIDE_M) / float(along @ out) * along)
            followed = None if cell.arm.few_joints else cell.follow(there, q)
            for goal in _pulled(cell, there, q)[:1] if followed is None else [followed]:
                upright = is_upright(carrying.task.exact.chain, carrying.task.upright, goal, cell.memory.exact)
                if upright and cell.touch(carrying, goal) is None:
                    goals.append(goal)
    return np.array(goals).reshape(-1, len(q))


def _pulled(cell: Workcell, T_world_hand: Array, q: Array) -> Array:
    """Arm configurations (S, A) with the hand pulled to a pose (4, 4), the nearest to q (A,) first."""
    arm = cell.arm
    return arm.headed(np.eye(4), T_world_hand, q, PULL_TRIES) if arm.few_joints else cell.ik(T_world_hand, IkSearch(PULL_TRIES), near=q)


def _looks(cell: Workcell, upright: Upright, held: Held) -> Array:
    """How the hand looks into the cabinet with an object in it, in the cabinet's frame (3, 3): level, or where the object would then
    lean too far, pitched as when it was taken."""
    T_cabinet = cell.scene.cabinet.T_world_cabinet
    axis_in_hand = cell.arm.T_frame_hand[:3, :3].T @ upright.axis
    if (T_cabinet[2, :3] @ LEVEL) @ axis_in_hand >= upright.allowed:
        return LEVEL
    return looking_in(T_cabinet, cell.scene.body(held.body).T_world_body[:3, :3] @ held.T_hand_body[:3, :3].T)
