"""What an object itself meets as it is lifted straight up, whatever hand takes it: a shelf board above it, what leans over it, what it is
in.

No grasp changes that, so it is asked once of an object where the scene has it, and not of each of its grasps. What was moved has been put
down from above, and has room.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.collision.fcl_solids import SURELY_M, Solid, shape_solids, touch
from kinematics.scene import Body
from kinematics.shapes import bounds
from kinematics.transforms import transform
from planning.motion.search.reaching import LIFT_M, LIFT_STEPS

RISES = [transform(p=[0.0, 0.0, k / LIFT_STEPS * LIFT_M]) for k in range(LIFT_STEPS + 1)]
"""Where along the lift an object is looked at: where the arm's waypoints are."""


def met_when_lifted(objects: Sequence[Body], fixtures: Sequence[Body]) -> dict[str, tuple[str, ...]]:
    """For those of a scene's objects that meet any, the names of the fixtures and the other objects that they meet, the fixtures first.
    They may touch the floor."""
    still = [body for body in fixtures if body.name != "floor"]
    bodies = [*still, *objects]
    low, high = (np.array(corners) for corners in zip(*(bounds(b.shape, b.T_world_body) for b in bodies)))
    found = dict[str, tuple[str, ...]]()
    for i, body in enumerate(objects, len(still)):
        near = ((low <= high[i] + [0.0, 0.0, LIFT_M]) & (high >= low[i])).all(1)
        near[i] = False
        if names := tuple(bodies[j].name for j in np.flatnonzero(near) if _meets(body, bodies[j])):
            found[body.name] = names
    return found


def _meets(lifted: Body, other: Body) -> bool:
    """Whether a body touches another one, which stands still, on its way up."""
    mine = shape_solids(lifted.name, lifted.shape)
    others = [solid.move(other.T_world_body) for solid in shape_solids(other.name, other.shape)]
    return any(_deep(solid.move(T @ lifted.T_world_body), still) for T in RISES for solid in mine for still in others)


def _deep(a: Solid, b: Solid) -> bool:
    """Whether two solids surely touch."""
    found = touch(a, b)
    return found is not None and found > SURELY_M
