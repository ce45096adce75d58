"""The paper's second baseline: move what blocks the straight line in joint space to the goal, each to the nearest region off that line."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from kinematics.collision.edge_check import first_in_contact
from kinematics.collision.edge_problem import MARGIN_M, enter, make_scratch, pose
from kinematics.collision.geometry import Query, make_solids
from kinematics.scene import Body
from kinematics.shapes import Box
from kinematics.transforms import Array, transform
from perception.observation import Observation
from planning.grasping.finger_grasps import open_width
from planning.motion.pick_place import Motions
from planning.policies.regions import nearest_regions

SAMPLES = 64


class Line:
    """The arm's straight joint-space line from where it waits to x_g, and which boxes would be in its way.

    From where it waits: the paper's arm sets out anew for the target at every step. The goal is the solution nearest to that, walls or not.
    """

    def __init__(self, motions: Motions, seen: Observation) -> None:
        self.motions = motions
        arm, robot = motions.cell.arm, motions.robot
        start = motions.cell.home_arm
        solutions = motions.cell.ik(seen.grasp.T_world_hand)
        opened = robot.opening.value_at(open_width(seen.grasp.width_m, robot.opening))
        goal = min(solutions, key=lambda q: float(np.abs(q - start).max()), default=None)
        self.samples = np.zeros((0, len(start))) if goal is None else start + np.linspace(0, 1, SAMPLES)[:, None] * (goal - start)
        self.posed = arm.posed(opened)
        solids, _ = make_solids([Body("box", Box(np.ones(3)), transform())])
        query = Query(np.ones((len(self.posed.frame), 1), np.uint8), np.zeros((0, 2), np.int64))
        self.problem = pose(arm.chain, self.posed, solids, query, MARGIN_M)
        self.scratch = make_scratch(self.problem)

    def first_touch(self, box: Array) -> int | None:
        """Index of the first sample at which the arm touches a box (6,), centre and size; None when none does."""
        half = box[3:] / 2
        self.problem.boxes[-1] = [*half, 0, 0, 0, np.linalg.norm(half)]
        self.problem.solid_T[0, :3, 3] = box[:3]
        enter(self.problem, self.scratch)
        at = first_in_contact(self.problem, self.samples, self.scratch)
        return None if at < 0 else at


class Lines:
    """The line of the latest observation, computed once for all that is asked about it."""

    def __init__(self, motions: Motions) -> None:
        self.motions = motions
        self._seen: Observation | None = None

    def of(self, seen: Observation) -> Line:
        if self._seen is not seen:
            self._seen, self._line = seen, Line(self.motions, seen)
        return self._line


def make_local_object(lines: Lines) -> Callable[[Observation, np.random.Generator], Sequence[str]]:
    """select: the objects that the line runs into, the first to be met in front; none, when it is free or x_g is out of reach."""

    def local_object(seen: Observation, rng: np.random.Generator) -> Sequence[str]:
        line = lines.of(seen)
        met = {name: line.first_touch(seen.boxes[name]) for name in seen.movable}
        return sorted((n for n in met if met[n] is not None), key=lambda n: (met[n], n))

    return local_object


def make_local_region(lines: Lines) -> Callable[[Observation, str, np.random.Generator], Sequence[int]]:
    """place: the free regions where the object would be off the line, the nearest to where it stands in front."""

    def local_region(seen: Observation, name: str, rng: np.random.Generator) -> Sequence[int]:
        line, box = lines.of(seen), seen.boxes[name]
        return [i for i in nearest_regions(seen, name, rng) if line.first_touch(np.array([*seen.regions[i, :2], *box[2:]])) is None]

    return local_region
