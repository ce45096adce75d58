"""Grasps of two fingers: antipodal pairs of points on a shape, approached horizontally, diagonally or from above.

A line through the shape along the closing direction gives two contact points; it is a grasp when both surface normals lie within the
friction cone about the line and the gripper opens wide enough. The closing direction is horizontal, but where a wall leans.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Body, Grasp
from kinematics.shapes import Box, ConvexMesh, Cylinder
from planning.grasping.antipodal import FRICTION_ANGLE, antipodal, crossed
from planning.grasping.candidates import Candidates, with_sides
from planning.grasping.hand_poses import CLEAR_M, Lowest, usual_lowest
from planning.grasping.line_contacts import Contact
from planning.grasping.mesh_grasps import mesh_grasps
from planning.grasping.pads import Pad
from planning.grasping.sampling import USUAL, Headings, Sampling

CLEARANCE_M = 0.010  # the open fingers' distance to the object on each side, before they close
OPEN_STEP_M = 0.0025  # in such steps do they open, rather less than more


def sample_grasps(
    body: Body,
    opening: Opening,
    approaches: Sequence[str],
    floor_z: float,
    toward: float,
    sampling: Sampling = USUAL,
    pad: Pad | None = None,
    headings: Headings | None = None,
    lowest: Lowest = usual_lowest,
) -> Iterator[Grasp]:
    """Antipodal grasps on a body, the most natural first: along the bearing `toward` (yaw in rad), flat before steep.

    opening: the gripper's table; approaches: parts of `kinematics.scene.APPROACHES`; floor_z: the height that the body stands on, world.
    pad: how large the pads are, so that they close on what of a mesh they meet first; without it they are lines. headings: how an arm of
    few joints looks at what has no faces, besides the yaws that are sampled. lowest: how low the pads may be.
    On a mesh those follow that meet it less squarely, or beside its middle, or that are set back less than its box would be: the pads may
    meet an edge there, or the palm the mesh. At last come those that hold it by a wall, one finger in a hole of it, and by a rim
    that leans outwards.
    The hand's x points up, or for downward grasps out of the cabinet, so that a camera on that side sees over the object.
    """
    if opening.round_only and not isinstance(body.shape, Cylinder):
        return
    body, ranked = with_sides(body), []
    tips = floor_z + pad.tip_z_m + CLEAR_M if pad is not None and isinstance(body.shape, ConvexMesh) else -np.inf
    for room_m in sampling.rooms_m:
        candidates = Candidates(body, opening, tuple(approaches), floor_z, toward, sampling, lowest, room_m, tips)
        headed = [] if headings is None or isinstance(body.shape, Box) else candidates.headed(headings)
        ranked += sorted([*headed, *candidates.all_round()], key=lambda c: c.rank)
    if isinstance(body.shape, ConvexMesh):
        yield from mesh_grasps(body, opening, ranked, pad)
        return
    hits: dict[tuple[float, float, float], Contact | None] = {}
    for c in ranked:
        grasp = antipodal(body, opening, crossed(body, c.point, c.u, 0.0, hits), c, pad, FRICTION_ANGLE)
        if grasp is not None:
            yield grasp


def open_width(width_m: float, opening: Opening) -> float:
    """How wide the fingers are before they close on an object of this width: one of few widths, so that what is packed of them serves many
    objects."""
    return float(min(np.floor((width_m + 2 * CLEARANCE_M) / OPEN_STEP_M + 1e-6) * OPEN_STEP_M, opening.max_m))
