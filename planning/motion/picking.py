"""Taking hold of an object where it stands: grasps, the arm's solutions for them, straight ways in and up, all but RRT-Connect."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

import numpy as np

from kinematics.scene import APPROACHES, Grasp, Held
from kinematics.transforms import Array, inverse
from planning.grasps import open_width, sample_grasps
from planning.motion import reaching
from planning.motion.reaching import APPROACH_STEPS, LIFT_STEPS
from planning.motion.workcell import Situation, Workcell, tasks_of
from planning.plan import Blocked

MAX_PICKS = 8  # grasps with a free approach that are kept for one object
ENOUGH_GRASPS = 24  # after so many, the first in the most natural order, any that was found will do
STAGES = {
    reaching.REACH: "ik", reaching.AT_GRASP: "approach", reaching.BACKWARDS: "approach", reaching.FINGERS: "grasp",
    reaching.LIFTED: "lift", reaching.UPWARDS: "lift",
}  # fmt: skip
"""What the compiled core's codes are called in a plan."""


@dataclass(frozen=True, eq=False)
class Pick:
    """A way to take hold of an object: arm waypoints of the straight pieces, gripper values, and where the object sits in the hand."""

    grasp: Grasp
    approach: Array
    lift: Array
    gripper_open: float
    gripper_closed: float
    held: Held


class Picking:
    """The picks of a scene's objects. The grasps on an object are remembered, for most objects stay where they are."""

    def __init__(self, cell: Workcell) -> None:
        self.cell = cell
        self._known: dict[tuple[str, bytes], _Grasps] = {}

    def picks(self, poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, q: Array) -> tuple[list[Pick], Blocked]:
        """The ways to take hold of an object that hold up to all checks but RRT-Connect's, those first that turn the arm least from q (A,);
        and how far the best of the others got.

        poses: of all objects; rest: of all besides this one.
        """
        key = (name, poses[name].tobytes())
        if key not in self._known:
            self._known[key] = _Grasps(self.cell, _sampled(self.cell, name, poses[name]))
        return self._picks(self._known[key], poses, rest, name, q)

    def picks_with(
        self, grasps: Iterable[Grasp], poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, q: Array
    ) -> tuple[list[Pick], Blocked]:
        """As `picks`, with these grasps and no others."""
        return self._picks(_Grasps(self.cell, grasps), poses, rest, name, q)

    def _picks(
        self, grasps: _Grasps, poses: Mapping[str, Array], rest: Mapping[str, Array], name: str, q: Array
    ) -> tuple[list[Pick], Blocked]:
        cell, hands = self.cell, dict[float, _OpenHand]()
        picks: list[Pick] = []
        why, got_to = Blocked("grasp", body=name, detail="no grasp fits its shape and the gripper's opening"), 0
        for i, grasp in grasps:
            hand = hands.get(grasp.width_m)
            if hand is None:
                hand = hands[grasp.width_m] = _OpenHand(cell, poses, name, grasp.width_m)
            alone = reaching.hand_way_in(cell.hand, hand.reaching.task, grasp.T_world_hand, cell.memory)
            free, said, found = 0, np.array([alone]), np.empty((0, 0, 0))
            if alone[0] == reaching.OK:
                solutions = grasps.solutions(i)
                found, said = np.empty((len(solutions), APPROACH_STEPS + 1, solutions.shape[1])), np.empty((len(solutions), 2), np.int64)
                free = reaching.ways_in(
                    cell.hand, hand.reaching.task, tasks_of(hand.closing), grasp.T_world_hand, solutions, cell.memory, found, said
                )
                if len(said) == 0 and got_to == 0:
                    why, got_to = Blocked("ik", "hand", name, detail="the grasp is out of reach"), 1
            for code, pair in said:
                if code != reaching.OK and 1 + code >= got_to:
                    named = hand.closing[0] if code == reaching.FINGERS else hand.reaching
                    why, got_to = cell.blocked(STAGES[code], named, pair, name), 1 + code
            if free == 0:
                continue
            held = Held(name, inverse(grasp.T_world_hand) @ poses[name])
            lifting = cell.problem(rest, hand.closed, held=held, ignore=[(name, "floor")])
            for way in found[:free]:
                up = np.empty((LIFT_STEPS + 1, way.shape[1]))
                code, pair = reaching.lift(cell.hand, lifting.task, grasp.T_world_hand, way[-1], up, cell.memory)
                if code == reaching.OK:
                    picks.append(Pick(grasp, way, up, hand.opened, hand.closed, held))
                elif 1 + code >= got_to:
                    why, got_to = cell.blocked(STAGES[code], lifting, pair, name), 1 + code
            if len(picks) >= MAX_PICKS or (picks and i + 1 >= ENOUGH_GRASPS):
                break
        cell.forget()
        picks.sort(key=lambda p: float(np.abs(p.approach[0] - q).max()))
        return picks, why


class _OpenHand:
    """The hand before it closes on an object of some width: gripper values, the situation while it is open, and those while the fingers
    move."""

    def __init__(self, cell: Workcell, poses: Mapping[str, Array], name: str, width_m: float) -> None:
        opening = cell.robot.opening
        self.opened, self.closed = opening.value_at(open_width(width_m, opening)), opening.value_at(width_m)
        self.reaching = cell.problem(poses, self.opened)
        self._cell, self._poses, self._name = cell, poses, name

    @cached_property
    def closing(self) -> tuple[Situation, ...]:
        """Not asked for where the open hand does not even get there."""
        return self._cell.moving_fingers(self._poses, self._name, self.opened, self.closed)


class _Grasps:
    """The grasps on an object where it stands, and the arm's solutions for each; both are found when asked for, and once."""

    def __init__(self, cell: Workcell, grasps: Iterable[Grasp]) -> None:
        self._cell, self._rest = cell, iter(grasps)
        self._found: list[Grasp] = []
        self._solutions: dict[int, Array] = {}

    def __iter__(self) -> Iterator[tuple[int, Grasp]]:
        for i in count():
            if i == len(self._found):
                grasp = next(self._rest, None)
                if grasp is None:
                    return
                self._found.append(grasp)
            yield i, self._found[i]

    def solutions(self, i: int) -> Array:
        """Arm configurations (S, A) for grasp i, the nearest to home first."""
        if i not in self._solutions:
            self._solutions[i] = self._cell.ik(self._found[i].T_world_hand)
        return self._solutions[i]


def _sampled(cell: Workcell, name: str, T: Array) -> Iterator[Grasp]:
    """Grasps on an object at T (4, 4) with the scene's approaches, the most natural first."""
    scene = cell.scene
    to_body = T[:2, 3] - scene.robot.T_world_base[:2, 3]
    toward = float(np.arctan2(to_body[1], to_body[0]))
    approaches = [a for a in APPROACHES if a in scene.approaches]
    body = replace(scene.body(name), T_world_body=T)
    return sample_grasps(body, cell.robot.opening, approaches, float(scene.cabinet.T_world_cabinet[2, 3]), toward)
