"""Ways to many picks of an object at once, where most picks lie in pockets of the arm's free space and few narrow passages lead to any.

One search from where the arm is to all picks finds such a passage in seconds, where a search for each pick would look for it anew and give
up. To others in the same pocket the way leads on from those that were reached.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from kinematics.scene import State
from kinematics.transforms import Array
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.carry import gripper_on_the_way
from planning.motion.handling.picking import Pick
from planning.plan import Blocked


def reached(
    cell: Workcell, state: State, picks: Sequence[Pick], rng: np.random.Generator, *, most: int, iterations: int, searches: int = 1
) -> dict[Pick, Array]:
    """Certified paths (K, A) from where the arm is to the beginnings of some picks' approaches, to so many at most, in the order in which
    they were found. iterations: of a search for a way to any; searches: so many are begun, for one that finds a way mostly does so early.
    Once there is a way, others are sought as long as one motion usually is."""
    found = dict[Pick, Array]()
    groups = defaultdict[float, list[Pick]](list)
    for pick in picks:
        if not isinstance(gripper := gripper_on_the_way(cell, state, pick), Blocked):
            groups[gripper].append(pick)
    for gripper, group in groups.items():
        query, ways = cell.problem(state.poses, gripper), [cell.robot.arm_q(state.q)[None]]
        tries = [iterations] * searches
        while group and tries and len(found) < most:
            goals = np.array([pick.approach[0] for pick in group])
            path = cell.way(query, np.array([way[-1] for way in ways]), goals, rng, tries.pop(), shorter=True)
            if path is not None:
                so_far = next(way for way in ways if np.array_equal(way[-1], path[0]))
                ways.append(np.concatenate([so_far[:-1], path]))
                found[group.pop(next(i for i, goal in enumerate(goals) if np.array_equal(goal, path[-1])))] = ways[-1]
                tries = [cell.iterations]
    return found
