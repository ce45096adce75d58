"""Where a cabinet may stand before an arm, and how much of it is in reach there: by the arm alone, without walls and objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, product

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from kinematics import inverse
from kinematics.chain import Int
from kinematics.collision.fcl_solids import apart
from kinematics.scene import Body, Cabinet, Scene
from kinematics.shapes import Box, ConvexMesh
from kinematics.transforms import Array, apply, transform
from planning.grasping.hand_poses import UP
from planning.motion.cell.arm import HALF_TURN, Arm
from planning.motion.cell.workcell import Workcell
from planning.motion.search.reaching import APPROACH_STEPS, ways_in
from planning.motion.settings import UNCONSTRAINED
from planning.scenes.generation import Spec

AHEAD, HIGH, TRIES = 18, 12, 8
"""Distances and heights at which an arm's reach is looked at, the least number of them: of a cabinet that is small beside the reach more,
so that some lie in it; and starts of inverse kinematics."""
LONG = 3.5
"""An arm that reaches so many times further than a cabinet is high has many places that are worth as much: those first that lie amid
others, the lowest of them, not the highest of the nearest."""
LOW_TO = (0.1, 0.45)  # the heights of a cabinet, in shares of it, in which objects are taken
LATERAL = (-0.84, -0.56, -0.28, 0.0, 0.28, 0.56, 0.84)
"""Where the arm's reach is looked at across the cabinet, in shares of half its width."""
DEPTHS, WIDTHS = (1.0, 0.85, 0.7, 0.55, 0.45), (1.0, 0.75, 0.5)
"""How much of a spec's depth and width a cabinet may keep where the arm does not reach all of it."""
FAR_M = 100.0  # the cabinet is out of the way there
BEFORE_M, BESIDE_M = 0.05, 0.01
"""What the cabinet's front keeps from what is fixed to the arm's base, and all of it from a frame of the base that it stands in."""
SHOULDER = 0.35  # of its reach an arm's first joint is above what it stands on, at most; one that is twice as high stands on a table
BY_FRAME = 200  # places that are looked at for one within a frame, the best first


@dataclass(frozen=True)
class Place:
    """front, floor: of a cabinet, world, m; depth, width: what shares it keeps of the spec's."""

    front: float
    floor: float
    depth: float = 1.0
    width: float = 1.0


def worth(share: float, place: Place) -> float:
    """How good a cabinet is that an arm reaches such a share of: a larger one is better, and one that is reached is better than that."""
    return share**2 * float(np.sqrt(place.depth * place.width))


def promising(arm: Arm, spec: Spec, scene: Scene, reach: float) -> Iterator[list[Place]]:
    """Places by how much of the cabinet the arm takes its hand straight into, level and looking in; the best first, and of each front and
    floor the best size: those before all that is fixed to the base, and then, where others promise more, those within or above it (a
    table that the arm stands on). scene: any of the robot's, its base being where the arm's is."""
    base, fixed, ways = float(arm.T_world_base[2, 3]), _fixed(arm), _Ways(arm, scene)
    least = max([arm.pivot[0], *(float(points[:, 0].max()) for points in fixed)]) + BEFORE_M
    ordered = _by_worth(arm, spec, ways, reach, base)
    before = [place for place in ordered if place.front >= least]
    if before:
        yield before
    raised = float(arm.robot.shoulder(arm.T_world_base)) - SHOULDER * reach
    if raised > base + SHOULDER * reach:
        ordered = _by_worth(arm, spec, ways, reach, raised)
    elif ordered[:1] == before[:1]:
        return
    yield [place for place in islice((p for p in ordered if p not in before), BY_FRAME) if is_beside(spec, place, fixed)]


def _by_worth(arm: Arm, spec: Spec, ways: _Ways, reach: float, base: float) -> list[Place]:
    """Places up to the arm's reach above a height `base`, world, the best first."""
    depth, width, height = spec.cabinet_size_m
    x, y = arm.pivot
    rows, columns = max(HIGH, 2 + int(reach / (LOW_TO[1] * height))), max(AHEAD, 2 + int(reach / (0.8 * depth)))
    ahead, up = np.linspace(0.1, 1.1, columns) * reach, np.linspace(0.02, 1.0, rows) * reach
    reached, lateral = np.zeros((columns, rows, len(LATERAL)), np.bool_), np.array(LATERAL)
    for i, k, j in product(range(columns), range(rows), range(len(LATERAL))):
        p = np.array([x + ahead[i], y + LATERAL[j] * width / 2, base + up[k]])
        reached[i, k, j] = ways.some(p, spec.grasp_bearing_share * float(np.arctan2(p[1] - y, p[0] - x)))
    found = []
    fronts, floors = x + ahead, base + up[up < 0.9 * reach]
    most = np.full((len(fronts), len(floors)), -np.inf)
    for (i, front), (k, floor) in product(enumerate(fronts), enumerate(floors)):
        level = (base + up > floor + LOW_TO[0] * height) & (base + up < floor + LOW_TO[1] * height)
        best = None
        for deep, wide in product(DEPTHS, WIDTHS):
            inside = (x + ahead > front + 0.1 * deep * depth) & (x + ahead < front + 0.9 * deep * depth)
            seen = reached[inside][:, level][:, :, np.abs(lateral) < 0.9 * wide]
            if seen.size:
                place = Place(round(float(front), 3), round(float(floor), 3), deep, wide)
                found_worth = worth(float(seen.mean()), place)
                if best is None or found_worth > best[0]:
                    best = found_worth, -place.front, place
        if best is not None:
            most[i, k] = best[0]
            found.append((i, k, best[1], best[2]))
    steps, up_or_down = (_amid(most), -1.0) if reach > LONG * height else (np.zeros(most.shape, np.int64), 1.0)
    ordered = sorted(found, key=lambda f: (most[f[0], f[1]], steps[f[0], f[1]], f[2], up_or_down * f[3].floor), reverse=True)
    return [place for *_, place in ordered]


def _amid(worths: Array) -> Int:
    """How many steps in all directions on a grid (I, K) nothing is worth less than each of its places: (I, K); beyond its edge all is."""
    steps, least = np.zeros(worths.shape, np.int64), np.pad(worths, 1, constant_values=-np.inf)
    amid = np.isfinite(worths)
    while amid.any():
        least = np.pad(sliding_window_view(least, (3, 3)).min((2, 3)), 1, constant_values=-np.inf)
        amid &= least[1:-1, 1:-1] >= worths
        steps += amid
    return steps


class _Ways:
    """The straight ways of an open hand, with nothing about but the arm itself."""

    def __init__(self, arm: Arm, scene: Scene) -> None:
        far = Cabinet(scene.cabinet.size_m, transform(p=[FAR_M, 0.0, 0.0]), scene.cabinet.wall_m)
        self._arm, self._home = arm, arm.robot.arm_q(arm.robot.home)
        empty = Scene("fit", scene.robot, far, (), None, None)
        self._cell = Workcell(arm.robot, empty, iterations=1, time_budget_s=None, settings=UNCONSTRAINED)
        self._task = self._cell.problem({}, arm.robot.opening.value_at(arm.robot.opening.max_m)).task
        A = len(self._home)
        self._way, self._said = np.empty((1, APPROACH_STEPS + 1, A)), np.empty((1, 2), np.int64)

    def some(self, p: Array, yaw: float) -> bool:
        """Whether one leads to p (3,), world, looking level along a yaw, or of an arm of few joints as it has to."""
        out = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        R = np.stack([UP, np.cross(out, UP), out], -1)
        return any(self._is_way(q) for R_hand in ((R, R @ HALF_TURN) if self._arm.few_joints else (R,)) for q in self._solutions(R_hand, p))

    def _solutions(self, R: Array, p: Array) -> Iterator[Array]:
        yield from inverse.solve(self._arm.backing, self._arm.T_frame_hand, self._arm.seeds, transform(R, p), self._home, tries=TRIES)

    def _is_way(self, q: Array) -> bool:
        cell, T_hand = self._cell, self._arm.hand_pose(q)
        return bool(ways_in(cell.hand, self._task, T_hand, q[None], cell.memory, self._way, self._said))


def _fixed(arm: Arm) -> list[Array]:
    """The vertices (V, 3), world, of each hull that is fixed to the base."""
    posed = arm.posed(float(arm.robot.home[arm.robot.gripper_joint]))
    poses = arm.T_world_base @ arm.robot.tree.poses(arm.robot.home)
    at = [poses[arm.robot.tree.index[hull.link]] for hull in arm.robot.hulls]
    return [apply(T, hull.vertices) for hull, T, frame in zip(arm.robot.hulls, at, posed.frame) if frame == 0]


def is_beside(spec: Spec, place: Place, fixed: Sequence[Array]) -> bool:
    """Whether a spec's cabinet at a place keeps `BESIDE_M` from solids with such vertices (V, 3)."""
    inner = spec.cabinet_size_m * [place.depth, place.width, 1.0]
    middle = [place.front + inner[0] / 2, 0.0, place.floor + inner[2] / 2]
    others = [Body(f"fixed {i}", ConvexMesh((points,), "", 1.0), np.eye(4)) for i, points in enumerate(fixed)]
    return apart(Body("cabinet", Box(inner + 2 * spec.cabinet_wall_m), transform(p=middle)), others, BESIDE_M)
