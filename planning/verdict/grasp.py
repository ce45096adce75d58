"""Whether a grasp is valid, before anything is planned or moved: the hand alone at x_g in the empty cabinet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np

from kinematics.collision.fcl_solids import Solid, depth, near_pairs, shape_solids
from kinematics.mount import MOUNT, standing_still
from kinematics.robots.robot import Robot
from kinematics.scene import WALLS, Body, Grasp, Scene
from kinematics.transforms import Array, inverse
from planning.verdict.contact import TOUCH_M
from planning.verdict.faults import Settings
from planning.verdict.hand import Hand, hand_of, in_hand
from planning.verdict.pads import hold_faults
from planning.verdict.pairs import link_solids
from planning.verdict.polyhedra import polyhedra

MOST_M = 1000.0  # no grasp is further away
PARALLEL = np.cos(np.radians(1))  # faces that look this much the way they close are parallel
_STEPS = 65


def judge_grasp(
    robot: Robot, scene: Scene, grasp: Grasp | None = None, settings: Settings | None = None, *, unseen: bool = False
) -> str | None:
    """What makes a grasp of the scene's target impossible whatever is moved away; None when nothing does, or there is none.

    grasp: the scene's own x_g by default. unseen: nothing is known of the objects yet, so only hand and cabinet are looked at.
    Judged: the gripper opens as wide; the pads hold the target; no other part of the hand is in it, nor any in the cabinet's walls.
    """
    x_g = grasp or scene.grasp
    if x_g is None:
        return None
    target = None if unseen or scene.target is None else scene.body(scene.target)
    T_hand_world = inverse(x_g.T_world_hand)
    walls = [Body(w.name, w.shape, T_hand_world @ w.T_world_body) for w in standing_still(scene)]
    with np.errstate(all="ignore"):
        return _judge(robot, x_g, target, walls, settings or Settings())


def judge_hold(robot: Robot, body: Body, grasp: Grasp) -> str | None:
    """As `judge_grasp`, for a body that stands alone in no cabinet."""
    with np.errstate(all="ignore"):
        return _judge(robot, grasp, body, (), Settings())


def _judge(robot: Robot, x_g: Grasp, target: Body | None, walls: Sequence[Body], asked: Settings) -> str | None:
    """walls: in the hand's frame."""
    if not np.abs(x_g.T_world_hand).max() <= MOST_M:
        return f"x_g is {np.abs(x_g.T_world_hand).max():.3g} m away"
    try:
        hand = hand_of(robot)
    except ValueError as e:
        return str(e)
    opening = robot.opening
    # between such pads, and of a cup, whose face does not look along y, the robot's table says what a width is
    tabled = bool(opening.jaw) or _askew(hand)
    least, most = (float(opening.width_m[0]), opening.max_m) if tabled else (float(hand.widths[0]), hand.max_width_m)
    if not opening.cup_m and not x_g.width_m <= most + asked.gap_m:
        return f"the grasp is {1000 * x_g.width_m:.4g} mm wide, and the gripper opens {1000 * most:.0f} mm"
    if not opening.cup_m and not x_g.width_m >= least - asked.gap_m:
        return f"the grasp is {1000 * x_g.width_m:.4g} mm wide, and the gripper closes to {1000 * least:.0f} mm"
    frames = in_hand(hand, opening.value_at(opening.cup_m or x_g.width_m) if tabled else closing_value(hand, x_g.width_m))
    links = _in_place(robot, hand, frames)
    if target is not None:
        T_hand_target = inverse(x_g.T_world_hand) @ target.T_world_body
        faces = [frames[p.carrier] @ p.T_carrier_face for p in hand.pads]
        if wrong := hold_faults(hand.pads, faces, polyhedra(target.shape), T_hand_target, target.name, "grasp", asked):
            return f"x_g does not hold {target.name}: {wrong[0].detail}"
        for link, _, deep in _touching(links, [Body(target.name, target.shape, T_hand_target)]):
            if deep > (asked.depth_m if link in hand.holding else TOUCH_M):
                return f"x_g does not hold {target.name}: {link} would touch the target itself, {1000 * deep:.1f} mm deep"
    for link, wall, deep in _touching(links, walls):
        if deep > TOUCH_M:
            return f"x_g can't be reached: {link} would be {1000 * deep:.1f} mm inside {'the ' if wall in (*WALLS, MOUNT) else ''}{wall}"
    return None


@lru_cache(maxsize=16)
def closes_askew(robot: Robot) -> bool:
    """Whether the faces of a robot's pads don't look along the way they close, or can't be found: then a width says little about what they
    hold, and each grasp is to be judged."""
    if robot.opening.cup_m:
        return False
    try:
        return _askew(hand_of(robot))
    except ValueError:
        return True


@lru_cache(maxsize=8)
def _askew(hand: Hand) -> bool:
    """Whether the pads' faces don't look along the way they close."""
    frames = in_hand(hand, float(hand.values[len(hand.values) // 2]))
    return any(abs((frames[p.carrier] @ p.T_carrier_face)[1, 2]) < PARALLEL for p in hand.pads[:2])


def closing_value(hand: Hand, width_m: float) -> float:
    """The gripper joint's value at which the pads are so far apart, to a micrometre; the nearest it can do."""
    values, widths = _closely(hand, int(np.clip(np.searchsorted(hand.widths, width_m), 1, len(hand.widths) - 1)))
    return float(np.interp(width_m, widths, values))


@lru_cache(maxsize=256)
def _closely(hand: Hand, k: int) -> tuple[Array, Array]:
    """Values of the gripper's joint, and widths there, from the hand's table's row k - 1 to its row k."""
    values = np.linspace(hand.values[k - 1], hand.values[k], _STEPS)
    return values, hand.width(values)


def _in_place(robot: Robot, hand: Hand, frames: dict[int, Array]) -> list[Solid]:
    """The hand's links where they are in its frame; frames: of what carries them."""
    solids = link_solids(robot, hand.links)
    for solid in solids:
        carrier, T = hand.arm.links[solid.name]
        solid.move(frames[carrier] @ T)
    return solids


def _touching(links: Sequence[Solid], bodies: Sequence[Body]) -> Iterator[tuple[str, str, float]]:
    """Links of the hand and bodies, in its frame, that touch, and how deep."""
    others: list[Solid] = [s.move(b.T_world_body) for b in bodies for s in shape_solids(b.name, b.shape)]
    for i, j in near_pairs(links, others):
        if (deep := depth(links[i], others[j], near=True)) is not None:
            yield links[i].name, others[j].name, deep
