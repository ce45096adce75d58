"""What an arm can take, tried with all of it and the cabinet's walls: one object at many places, of several sizes, and among others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.antipodal import SPARE_M
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.hand_poses import UP
from planning.motion.cell.arm import arm_at
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.object_grasps import headings_of
from planning.motion.handling.picking import QUICK, Picking
from planning.motion.handling.waiting import places_to_wait
from planning.motion.pick_place import Motions
from planning.motion.settings import UNCONSTRAINED
from planning.policies.lookahead import NEAREST
from planning.policies.search import Effort, Search
from planning.rules import MAX_MOVES
from planning.scenes.generation import NoScene, Spec, generate
from planning.verdict import judge_grasp

ALONG, ACROSS = (0.125, 0.375, 0.625, 0.875), (-0.8, -0.4, 0.0, 0.4, 0.8)
"""Where an object is tried, in shares of how far it may stand from the front to the back wall, and from the middle to the left."""
MIDDLE = ((0.375, 0.0), (0.625, -0.4), (0.625, 0.4))
"""Where sizes of objects are tried."""
YAWS = (0.25, 0.75)  # of boxes
SIZES = (0.0, 1.0, 0.5)  # heights that are tried, in shares of their range
ROOMY = 4.0  # times as large as a spec's cabinet is one whose walls are in no hand's way
ONE_PICK = replace(QUICK, enough_picks=1, enough_grasps=1)
SEED, STAGE = 0, 7  # of the scenes that are tried
NOWHERE = "there is no place before it where the arm could wait"
ATTEMPTS = 40  # moves that are tried in each of them
Where = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Tried:
    """A spec at one place. share: from how many of the places in the cabinet an object can be taken; home (A,): where the arm waits before
    it; why: what is in the way most often where none can, in words."""

    spec: Spec
    share: float
    home: Array | None = None
    why: str = ""


def cabinet_of(spec: Spec) -> Cabinet:
    """A spec's smallest cabinet."""
    return Cabinet(spec.cabinet_size_m, transform(p=[spec.cabinet_front_m, 0.0, spec.cabinet_floor_m]), spec.cabinet_wall_m)


def one_shape(spec: Spec, height: float, width: float = 0.5, *, boxes: bool) -> Shape:
    """An object of a spec: a cylinder, or a box. height, width: in shares of their ranges."""
    radius = _within(spec.target_half_width_m, width) or 0.025
    high = _within(spec.objects_height_m, height) or 0.12
    return Box(np.array([2 * radius, 2 * radius, high])) if boxes else Cylinder(radius, high)


def _within(pair: tuple[float, float], share: float) -> float:
    return pair[0] + share * (pair[1] - pair[0])


def with_shapes(spec: Spec, ref: RobotRef, shapes: Sequence[Shape]) -> Scene:
    """A spec's cabinet with objects, `can 0` and so on, which all stand in its middle; the first is the target."""
    cabinet = cabinet_of(spec)
    bodies = tuple(Body(f"can {i}", shape, _stood(spec, cabinet, shape, (0.5, 0.0), 0.0)) for i, shape in enumerate(shapes))
    return Scene("fit", replace(ref, mount=False), cabinet, bodies, "can 0", None, spec.regions_n, spec.moves_approaches)


def _stood(spec: Spec, cabinet: Cabinet, shape: Shape, at: Where, yaw: float) -> Array:
    """The pose (4, 4) of an object that stands there, as near to the walls as a spec lets it."""
    depth, width, _ = cabinet.size_m
    half = float(np.hypot(*shape.half[:2])) if isinstance(shape, Box) else float(shape.half[0])
    least, most = half + spec.objects_gap_m, depth - half - spec.objects_gap_m
    p = [least + at[0] * (most - least), at[1] * (width / 2 - half - spec.objects_gap_m), float(shape.half[2])]
    return np.asarray(cabinet.T_world_cabinet @ transform(rotation_about(UP, yaw), p))


class Trial:
    """An arm before a spec's cabinet, which takes objects of some shapes one at a time."""

    def __init__(self, spec: Spec, robot: Robot, ref: RobotRef, shapes: Sequence[Shape]) -> None:
        self.spec, self.robot = spec, robot
        self.scene = with_shapes(spec, ref, shapes)
        self.home = next(iter(places_to_wait(arm_at(robot, ref.T_world_base), self.scene.cabinet)), None)
        cell = Workcell(robot, self.scene, iterations=1, time_budget_s=None, settings=UNCONSTRAINED)
        self._picking, self.said = Picking(cell, ONE_PICK), Counter[str]()

    def takes(self, shape: int, at: Where, yaw: float = 0.0) -> bool:
        """Whether an object of a shape can be taken from a place."""
        if self.home is None:
            self.said[NOWHERE] += 1
            return False
        body = self.scene.objects[shape]
        poses = {body.name: _stood(self.spec, self.scene.cabinet, body.shape, at, yaw)}
        picks, why = self._picking.picks(poses, {}, body.name, self.home)
        if not picks:
            self.said[str(why)] += 1
        return bool(picks)

    def share(self, tries: Sequence[tuple[int, Where, float]]) -> Tried:
        """From how many of places an object can be taken, each with the shape that stands there and its yaw."""
        good = sum(self.takes(*tried) for tried in tries)
        return Tried(self.spec, good / len(tries), self.home, next((words for words, _ in self.said.most_common(1)), ""))


def share(spec: Spec, robot: Robot, ref: RobotRef, *, boxes: bool = False) -> Tried:
    """From how many of places all over the empty cabinet an object, low, high or in between, can be taken. boxes: not a cylinder, but a
    box, turned in several ways."""
    trial = Trial(spec, robot, ref, [one_shape(spec, height, boxes=boxes) for height in SIZES])
    places = list(product(ALONG, ACROSS))
    return trial.share([(i % len(SIZES), at, YAWS[i % 2] if boxes else 0.0) for i, at in enumerate(places)])


def held_heights(spec: Spec, robot: Robot, ref: RobotRef, *, boxes: bool) -> tuple[float, float] | None:
    """Between which shares of their range of heights objects are taken from most of `MIDDLE`; None where all or none are."""
    shares = np.linspace(0.0, 1.0, 6)
    trial = Trial(spec, robot, ref, [one_shape(spec, float(height), boxes=boxes) for height in shares])
    taken = [sum(trial.takes(i, at) for at in MIDDLE) > len(MIDDLE) / 2 for i in range(len(shares))]
    if all(taken) or not any(taken):
        return None
    first = taken.index(True)
    last = next((i for i in range(first, len(taken)) if not taken[i]), len(taken)) - 1
    return float(shares[first]), float(shares[last])


def solved(spec: Spec, robot: Robot, ref: RobotRef, n: int) -> Iterator[bool]:
    """Of each of n scenes of a spec, whether moves are found after which its target can be taken out, motions and all: picked, carried and
    put down, as the policy `lookahead` does it, with `ATTEMPTS` to be made."""
    for i in range(n):
        try:
            scene = generate(spec, robot, ref, SEED, i, stage=STAGE)
        except NoScene:
            yield from (n - i) * [False]
            return
        motions = Motions(robot, scene)
        if motions.start_blocked() is not None:
            yield False
            continue
        search = Search(motions, NEAREST, Effort(ATTEMPTS, choosy=0), MAX_MOVES, np.random.default_rng([SEED, STAGE, i]))
        yield bool(search.run(motions.start()))


def not_held(spec: Spec, robot: Robot, ref: RobotRef, *, boxes: bool) -> str | None:
    """Why the hand alone can't hold the widest object that its fingers open for, level if it may, as the verdict says of most grasps; None
    when it can."""
    widest = max(spec.objects_half_width_m[1], spec.target_half_width_m[1])
    most = widest if boxes else min(widest, robot.opening.max_m / 2 - SPARE_M)
    roomy = replace(spec, cabinet_size_m=ROOMY * spec.cabinet_size_m, target_half_width_m=(most, most))
    scene = with_shapes(roomy, ref, [one_shape(roomy, 0.5, boxes=boxes)])
    body, floor_z = scene.objects[0], float(scene.cabinet.T_world_cabinet[2, 3])
    x, y = body.T_world_body[:2, 3] - robot.pivot(ref.T_world_base)
    headings = headings_of(arm_at(robot, ref.T_world_base))
    level = [kind for kind in spec.moves_approaches if kind == "horizontal"]  # in a cabinet most others end at its ceiling
    said = Counter[str]()
    for grasp in grasps_on(body, robot, level or spec.moves_approaches, floor_z, float(np.arctan2(y, x)), headings=headings):
        wrong = judge_grasp(robot, scene, grasp)
        if wrong is None:
            return None
        said[wrong] += 1
    opening = robot.opening
    deep = 1000 * float(opening.depth_at(2 * body.shape.half[0]))
    fits = (
        f"fingers close to {1000 * opening.width_m[0]:.0f} and open to {1000 * opening.max_m:.0f} mm, and {deep:.0f} mm have room behind "
        "their pads' middle"
    )
    if opening.cup_m:
        fits = f"the cup is {1000 * opening.cup_m:.0f} mm across and takes flat faces that are wider"
    width = f"{1000 * body.shape.half[0] * 2:.0f} mm wide"
    return next((words for words, _ in said.most_common(1)), f"no grasp fits the widest {'box' if boxes else 'cylinder'}, {width}: {fits}")
