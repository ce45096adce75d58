"""Where a cabinet stands best for an arm: how far before it, how high, and how large, so that the arm reaches what stands in it.

First by the arm alone, on a grid around it (`places`); then the best places are tried with the hand, objects and the cabinet's walls
(`trials`); at last the objects are made so few that scenes can be solved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from kinematics.robots.joints import with_joints
from kinematics.robots.robot import Robot
from kinematics.scene import RobotRef
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.hand_poses import UP
from planning.motion.cell.arm import Arm, arm_at
from planning.motion.handling.waiting import touching_anywhere
from planning.scenes.fitting.aside import aside
from planning.scenes.fitting.places import Place, promising, worth
from planning.scenes.fitting.sizes import cut, fewer, not_too_slim, of_one_kind, scale_for, scaled, slimmed
from planning.scenes.fitting.trials import NOWHERE, Tried, held_heights, not_held, one_shape, share, solved, with_shapes
from planning.scenes.generation import NoScene, Spec

EXACTLY = 8  # places that are tried
LEAST_SHARE, BOX_SHARE = 0.2, 0.5
"""From how many of the places an arm takes a cylinder, at least; and a box where there are to be boxes: as no arm of few joints
has to look that is before it."""
SLIMMER = (1.0, 0.9, 0.8, 0.65, 0.5)
"""Shares of the objects' width, of which the first is taken that the hand can hold: palm and knuckles may leave less room than fingers."""
ALONG_RAIL = np.sin(np.pi / 20)  # of a direction that is across a rail, what leads along it
LEVEL_ONLY = "it may only take them level: --spec paper-any lets it from above and aslant, too"
SCENES, THINNER = 16, ((1.0, 1.0), (1.0, 2.0), (0.7, 2.0), (0.5, 2.0), (0.4, 2.0))
"""So many scenes are solved, each of them; or else objects are fewer and further apart: shares of their number, times their gap."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A spec and a robot's place that go together. share: of the places in the cabinet that were tried, how many the arm can take an object
    from; scale: of the cabinet and what is in it; slimmer: of the objects' width besides. alone: the only kind of objects in it, where the
    arm hardly takes others."""

    spec: Spec
    ref: RobotRef
    share: float
    scale: float
    slimmer: float = 1.0
    alone: str | None = None
    limbs: tuple[str, ...] = ()

    def __str__(self) -> str:
        size = " × ".join(f"{v:.2f}" for v in self.spec.cabinet_size_m)
        x, _, z = self.ref.T_world_base[:3, 3]
        front, floor = self.spec.cabinet_front_m - x, self.spec.cabinet_floor_m - z
        slim = f"; they are {100 * self.slimmer:.0f} % as wide, as its hand holds no wider ones" if self.slimmer < 1.0 else ""
        limbs = f"; put {', '.join(self.limbs)} aside as robot.home in the scenes says, no plan moves them" if self.limbs else ""
        alone = f"; {self.alone} alone, as it hardly takes others" if self.alone else ""
        return (
            f"a cabinet of {size} m, its front {front:.2f} m before the arm's base and its floor {floor:.2f} m above: the arm takes "
            f"objects from {100 * self.share:.0f} % of it{slim}{alone}{limbs}"
        )


def fit(spec: Spec, robot: Robot, ref: RobotRef, on_step: Callable[[str], None] = lambda _: None) -> Fitted:
    """Place and scale a spec's cabinet for an arm, and turn the arm to face it; of a robot of one's own the home is put before the cabinet.

    The same robot and spec always give the same. on_step: told of each place that is tried. Raises: NoScene when the arm does not reach
    into it anywhere.
    """
    facing, limbs = _facing(arm_at(robot, np.eye(4))), dict[str, float]()
    if ref.name is None and ref.home is None and (limbs := aside(robot, facing)):
        robot = replace(robot, home=with_joints(robot.joint_names, robot.home, limbs, f"robot {robot.name}: home"))
        ref = replace(ref, home=limbs)
    pivot = robot.pivot(np.eye(4))
    T_base = transform(rotation_about(UP, -facing))
    T_base[:3, 3] = ref.T_world_base[:3, 3] - [*(T_base[:3, :3] @ [*pivot, 0.0])[:2], 0.0]
    arm = arm_at(robot, T_base)
    reach = float(np.quantile(np.hypot(*(_positions(arm) - [*robot.pivot(T_base), 0.0])[:, :2].T), 0.98))
    scale = scale_for(spec, robot, reach)
    spec = scaled(spec, scale)
    if arm.few_joints:  # such an arm looks where it turns to
        spec = replace(spec, grasp_bearing_share=1.0, grasp_yaw_spread=0.0)
    turned = replace(ref, T_world_base=T_base)
    cup = robot.opening.cup_m > 0
    found, slimmer, why = Tried(spec, 0.0), 1.0, ""
    for places in promising(arm, spec, with_shapes(spec, turned, [one_shape(spec, 0.5, boxes=cup)]), reach):
        tried = _slim_enough(places[:EXACTLY], spec, robot, turned, cup, on_step)
        if tried[0].share > found.share or not why:
            found, slimmer, why = tried
        if found.share >= LEAST_SHARE:
            break
    if found.share < LEAST_SHARE:
        hint = "" if why == NOWHERE or spec.moves_approaches != ("horizontal",) else f"; {LEVEL_ONLY}"
        if why == NOWHERE and (touching := touching_anywhere(robot)):
            why = touching
        elif why == NOWHERE and not arm.pitches:
            hint = f"; of its {len(robot.arm_joints)} joints none pitches its hand, so that where the hand is decides how steeply it looks"
        raise NoScene(
            f"robot {robot.name}: wherever a cabinet like this one stands, the arm takes objects from {100 * found.share:.0f} % of it at "
            f"most{f' ({why})' if why else ''}{hint}"
        )
    found = _at_held_heights(found, robot, turned, cup)
    others = share(found.spec, robot, turned, boxes=not cup).share >= BOX_SHARE
    spec = found.spec if others else of_one_kind(found.spec, boxes=cup)
    if found.home is not None and ref.name is None:
        names = [robot.joint_names[j] for j in robot.arm_joints]
        turned = replace(turned, home={**(turned.home or {}), **{name: float(q) for name, q in zip(names, found.home)}})
    spec = _thinned(spec, robot, turned, on_step)
    return Fitted(spec, turned, found.share, scale, slimmer, None if others else "boxes" if cup else "cylinders", tuple(limbs))


def _slim_enough(
    places: Sequence[Place], spec: Spec, robot: Robot, ref: RobotRef, cup: bool, on_step: Callable[[str], None]
) -> tuple[Tried, float, str]:
    """The best of some places with objects as slim as the hand needs them there, the share of their width, and else what is in the way: of
    the widest that it holds, for slimmer ones a cup may be too wide."""
    best, as_wide, why = Tried(spec, 0.0), 1.0, ""
    for slimmer in SLIMMER:
        slim = not_too_slim(slimmed(spec, slimmer), robot)
        if wrong := not_held(slim, robot, ref, boxes=cup):
            why = why or wrong
            continue
        found = _best_of(places, slim, robot, ref, cup, on_step)
        if found.share > best.share or not best.why:
            best, as_wide, why = found, slimmer, found.why or why
        if found.share >= LEAST_SHARE:
            break
    return best, as_wide, why


def _best_of(places: Sequence[Place], spec: Spec, robot: Robot, ref: RobotRef, cup: bool, on_step: Callable[[str], None]) -> Tried:
    """The spec at the place that is worth most, by from where in it objects can be taken."""
    best, most = Tried(spec, 0.0), -1.0
    for k, place in enumerate(places, 1):
        on_step(f"fitting a cabinet: place {k} of {len(places)}" + (f", so far {100 * best.share:.0f} % in reach" if k > 1 else ""))
        there = replace(cut(spec, place.depth, place.width), cabinet_front_m=place.front, cabinet_floor_m=place.floor)
        tried = share(there, robot, ref, boxes=cup)
        if worth(tried.share, place) > most:
            best, most = tried, worth(tried.share, place)
        if most >= 1.0:
            break
    return best


def _at_held_heights(found: Tried, robot: Robot, ref: RobotRef, cup: bool) -> Tried:
    """The same with objects neither lower nor higher than what the arm takes from its middle."""
    shares = held_heights(found.spec, robot, ref, boxes=cup)
    if shares is None or found.spec.objects_household:
        return found
    low, high = found.spec.objects_height_m
    between = low + shares[0] * (high - low), low + shares[1] * (high - low)
    tried = share(replace(found.spec, objects_height_m=between), robot, ref, boxes=cup)
    return tried if tried.share >= found.share else found


def _thinned(spec: Spec, robot: Robot, ref: RobotRef, on_step: Callable[[str], None]) -> Spec:
    """A spec with objects so far apart and so few that all of some scenes are solved; if that is never so, the one of which most are before
    one is not: among few slim objects nothing may ever be blocked."""
    best, most = spec, 0
    for count, gap in THINNER:
        thinner = replace(fewer(spec, count), objects_gap_m=gap * spec.objects_gap_m)
        said = f"{thinner.objects_count[0]} to {thinner.objects_count[1]} objects, {1000 * thinner.objects_gap_m:.0f} mm apart"
        on_step(f"fitting a cabinet: {said}")
        done = sum(1 for _ in takewhile(bool, solved(thinner, robot, ref, SCENES)))
        if done >= most:
            best, most = thinner, done
        if done == SCENES:
            break
    return best


def _positions(arm: Arm) -> Array:
    """Hand positions (N, 3) at random configurations, world."""
    return np.asarray(arm.seeds.T.reshape(3, 4, -1)[:, 3].T, float)


def _facing(arm: Arm) -> float:
    """The direction in which an arm works best, yaw in rad: where its hand is level and looks away from it most often; ahead, if that is
    about as good. An arm on a rail works across it, and away from where on the rail it is."""
    T = arm.seeds.T.reshape(3, 4, -1).astype(float)
    out, at = T[:, 2], T[:2, 3] - arm.robot.pivot(np.eye(4))[:, None]
    rails, own = arm.robot.rails, list(arm.robot.arm_joints)
    for (joint, way), middle in zip(rails, arm.robot.mid_rails()):
        at = at - way[:, None] * (arm.seeds.q[:, own.index(joint)] - middle)
    level = np.abs(out[2]) < 0.5
    looks, lies = np.arctan2(out[1], out[0])[level], np.arctan2(at[1], at[0])[level]

    def good(yaw: float) -> int:
        return int(((np.cos(looks - yaw) > np.cos(0.8)) & (np.cos(lies - yaw) > np.cos(1.0))).sum())

    yaws = np.arange(24) * np.pi / 12
    across = np.array([all(abs(way @ [np.cos(yaw), np.sin(yaw)]) < ALONG_RAIL for _, way in rails) for yaw in yaws])
    counts = np.array([good(float(yaw)) for yaw in yaws]) * (across if across.any() else True)
    return 0.0 if counts[0] >= 0.85 * counts.max() else float(yaws[int(np.argmax(counts))])
