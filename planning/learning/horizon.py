"""Labels that look ahead: how many moves a state is away from the target, which object goes first, and where it helps to put it.

The paper's labels look one step ahead: an object blocks paths or it does not. Here the shortest relaxed plans (planning.relaxed_plan) say
which objects must go, and in which order, if what is moved vanished.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from kinematics.chain import Int
from kinematics.scene import State
from planning.learning.label_file import NOT_ASKED, UNKNOWN
from planning.motion.pick_place import Motions
from planning.relaxed_plan import Names, RelaxedPlan, gets_shorter, relaxed_plans, shortest_plans

MOST_MOVES = 6
MOST_SETS = 1000
"""Longer relaxed plans are not looked for, nor any among more sets of objects: beyond, a state's horizon is unknown."""


@dataclass(frozen=True, eq=False)
class Horizon:
    """The shortest relaxed plans of a state; none where it is unknown, or where no picks help."""

    plans: Sequence[RelaxedPlan]

    @property
    def moves(self) -> int:
        """The length h of the plans, `UNKNOWN` without one."""
        return self.plans[0].length if self.plans else UNKNOWN

    @property
    def firsts(self) -> Names:
        """The objects that go first in some shortest plan."""
        return frozenset(name for plan in self.plans for name in plan.firsts)


def look_ahead(motions: Motions, state: State) -> Horizon:
    """The shortest relaxed plans of a state."""
    target = motions.scene.target_name
    standing = frozenset(state.poses) - {target}
    plans = relaxed_plans(motions.obstructions(state.poses), target, standing, most=MOST_MOVES, most_sets=MOST_SETS)
    return Horizon(shortest_plans(plans))


def shortens(motions: Motions, state: State, horizon: Horizon, name: str, regions: Sequence[int] | Int) -> Mapping[int, int]:
    """For each of some regions whether h gets shorter once an object stands there (1 or 0); `NOT_ASKED` without a plan to shorten."""
    if horizon.moves < 1:
        return {int(region): NOT_ASKED for region in regions}
    target, poses = motions.scene.target_name, state.poses
    standing, out = frozenset(poses) - {target}, {}
    for region in map(int, regions):
        there = {**poses, name: motions.place_pose(name, poses[name], region)}
        shorter = name in horizon.firsts and gets_shorter(motions.obstructions(there), target, standing, horizon.plans, name)
        out[region] = int(shorter)
    return out
