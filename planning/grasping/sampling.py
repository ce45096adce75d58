"""How many grasps are sampled, and from where."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.robots.hands.opening import ROOM_M
from kinematics.transforms import Array

DIAGONAL = "diagonal"
PITCHES = {"horizontal": (0.0,), DIAGONAL: (np.pi / 6, np.pi / 3), "downward": (np.pi / 2,)}
Headings = Callable[[Array, float], Sequence[Array]]
"""Where an arm of few joints can take a hand: with the middle between its pads at T (4, 4) when it is open by a width (m), but turned about
the vertical, or by half a turn about its z. The rotations (3, 3) that it then has."""


@dataclass(frozen=True)
class Sampling:
    """How many grasps are sampled. yaws: closing directions within half a turn, on what has no faces. backs_m: how much nearer to the hand
    than the middle, or than the gripper's depth lets it, a box may be taken; inf: as near as the pads still hold it. heights: of the pads,
    in shares of the object's; 0 and 1: as low, and as high, as they can be. pitches: by approach, in rad. rooms_m: what pitched hands keep
    between what they hold and what lies behind their pads, if they can; those with the first come before all others. steps_m: how far
    apart, ahead and up, those are that hold upright boxes and cans by however little (`marginal_grasps`), after all others; None: none.
    beyond_m: how much further off than where the pads just hold something hands are looked at, and whether the line in which they meet a
    can may lie a little beyond their ends, where friction alone keeps it: for proofs."""

    yaws: int = 12
    backs_m: tuple[float, ...] = (0.0,)
    heights: tuple[float, ...] = (0.6, 0.85)
    pitches: Mapping[str, tuple[float, ...]] = field(default_factory=lambda: PITCHES)
    rooms_m: tuple[float, ...] = (ROOM_M,)
    steps_m: tuple[float, float] | None = None
    beyond_m: float = 0.0


USUAL = Sampling()
DENSE = Sampling(
    yaws=36,
    backs_m=(0.0, 0.01, 0.02, np.inf),
    heights=(0.0, 0.3, 0.45, 0.6, 0.72, 0.85, 0.95, 1.0),
    pitches={**PITCHES, DIAGONAL: (np.pi / 6, np.pi / 4, np.pi / 3)},
    rooms_m=(ROOM_M, 0.001),
)
"""All of the usual ones and many more, the outermost that hold among them: where a grasp that was not sampled would matter, as for proofs
that there is none."""
DENSEST = Sampling(
    yaws=36,
    backs_m=(*np.arange(0.0, 0.025, 0.005), np.inf),
    heights=(*np.linspace(0.0, 1.0, 61), *DENSE.heights),
    pitches={**PITCHES, DIAGONAL: tuple(np.radians((30, 37.5, 45, 52.5, 60)))},
    rooms_m=DENSE.rooms_m,
    steps_m=(0.010, 0.006),
)
"""Ten times as many again, with heights 2 or 3 mm apart, and all that hold by an edge: before it is said that nothing helps. Between what
the arm would touch further down and further up there are gaps of 3 mm in which a pick is possible, and some objects that no natural grasp
takes are taken by an edge."""
