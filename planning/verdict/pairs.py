"""Which convex hulls of a robot may not touch each other, found from its tree alone."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from kinematics.collision.fcl_solids import Solid, hull_solid
from kinematics.robots.plain_urdf import Arm, poses
from kinematics.robots.robot import Robot
from planning.verdict.hand import hand_of
from planning.verdict.polyhedra import Int

SAMPLES, OFTEN = 40, 0.95  # links that touch in so many of so many configurations are neighbours in all but name


@dataclass(frozen=True, eq=False)
class Pairs:
    """Which hulls of a robot may not touch each other (N, 2), and those (M, 2) that the robot's own list of exceptions lets touch though
    nothing else speaks for it: what an SRDF switches off."""

    checked: Int
    switched_off: Int


def link_solids(robot: Robot, links: Collection[str] | None = None) -> list[Solid]:
    """The link hulls for FCL, in the robot's order, or those of some links, to be moved by whoever asked for them."""
    return [mould.twin() for mould in _moulds(robot) if links is None or mould.name in links]


@lru_cache(maxsize=8)
def _moulds(robot: Robot) -> tuple[Solid, ...]:
    """The link hulls, which take long to make."""
    return tuple(hull_solid(h.link, h.vertices, h.faces) for h in robot.hulls)


@lru_cache(maxsize=8)
def pairs_of(robot: Robot) -> Pairs:
    """Which hulls are to be kept apart: what moves against each other, but for neighbours, what always touches, parts of the hand."""
    hand = hand_of(robot)
    arm, names = hand.arm, [h.link for h in robot.hulls]
    solid = frozenset(names)
    together = {frozenset((a, _above(arm, a, solid))) for a in solid}
    own = {n: arm.driven_by(arm.links[n][0]) for n in solid}
    moving = [
        (i, j)
        for i, a in enumerate(names)
        for j, b in enumerate(names[:i])
        if own[a] != own[b] and frozenset((a, b)) not in together and not {a, b} <= hand.links
    ]
    always = _always_touching(robot, arm, moving)
    checked = [(i, j) for i, j in moving if frozenset((names[i], names[j])) not in always]
    off = [frozenset((names[i], names[j])) in robot.skip for i, j in checked]
    table = np.array(checked, np.int64).reshape(-1, 2)
    return Pairs(table[np.logical_not(off)], table[np.array(off, bool)])


def _above(arm: Arm, link: str, solid: frozenset[str]) -> str:
    """The next link with geometry on the way to the base; "" when there is none."""
    up = arm.parent_link.get(link, "")
    while up and up not in solid:
        up = arm.parent_link.get(up, "")
    return up


def _always_touching(robot: Robot, arm: Arm, pairs: Sequence[tuple[int, int]]) -> frozenset[frozenset[str]]:
    """The links of those pairs that touch nearly wherever the joints are."""
    import fcl

    rng = np.random.default_rng(0)
    low, high = np.where(np.isinf(arm.lower), -np.pi, arm.lower), np.where(np.isinf(arm.upper), np.pi, arm.upper)
    at = poses(arm, rng.uniform(low, high, (SAMPLES, len(low))), np.eye(4))
    solids = link_solids(robot)
    names = [s.name for s in solids]
    often: dict[frozenset[str], set[int]] = {}
    left = list(pairs)
    for n in range(SAMPLES):
        for s in solids:
            c, T = arm.links[s.name]
            s.move(at[c][n] @ T)
        hit = [(i, j) for i, j in left if fcl.collide(solids[i].object, solids[j].object, fcl.CollisionRequest(), fcl.CollisionResult())]
        for i, j in hit:
            often.setdefault(frozenset((names[i], names[j])), set()).add(n)
        # what was apart more often than it may does not always touch
        left = [(i, j) for i, j in left if n + 1 - len(often.get(frozenset((names[i], names[j])), ())) <= (1 - OFTEN) * SAMPLES]
    return frozenset(pair for pair, where in often.items() if len(where) >= OFTEN * SAMPLES)
