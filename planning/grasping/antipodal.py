"""One grasp of two fingers along one line: the surface's normals where it enters and leaves lie within the friction cone about it, and the
gripper opens wide enough."""

from __future__ import annotations

import numpy as np

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Body, Grasp
from kinematics.shapes import ConvexMesh, Cylinder
from kinematics.transforms import Array, transform
from planning.grasping.candidates import Candidate
from planning.grasping.hand_poses import STAY, UP, level_across
from planning.grasping.line_contacts import Contact, line_contacts, stretch_at
from planning.grasping.pads import Pad, under_pads

FRICTION_ANGLE = np.radians(10)
MESH_FRICTION_ANGLE = np.radians(20)  # smooth meshes face the fingers in no line exactly; friction of 0.5 holds 26.6°
ON_PAD_M = 0.001  # the line in which fingers meet what is round is so far from their tips, at least
SPARE_M = 0.004  # by which the fingers must open wider than the object, at least


def crossed(body: Body, point: Array, u: Array, beside: float, hits: dict[tuple[float, float, float], Contact | None]) -> Contact | None:
    """Where the line along u that passes so far beside a point meets the body, remembered: hands from both sides, and of all pitches, close
    along it."""
    line = (float(u[0]), float(point[2]), beside)
    if line not in hits:
        hits[line] = line_contacts(body.shape, body.T_world_body, point + beside * level_across(u) if beside else point, u)
    return hits[line]


def skew(hit: Contact | None, u: Array) -> float:
    """The larger angle, in rad, between a line along u and the surface's normals where it enters and leaves; π where it misses."""
    return np.pi if hit is None else float(np.arccos(np.clip(min(-hit.enter_normal @ u, hit.leave_normal @ u), -1, 1)))


def antipodal(
    body: Body,
    opening: Opening,
    hit: Contact | None,
    c: Candidate,
    pad: Pad | None,
    friction_angle: float,
    share: float = 1.0,
    *,
    wall: bool = False,
) -> Grasp | None:
    """The grasp with the pads' centre on the line through a candidate's point along u, which meets the body so, or where that is too deep,
    nearer to the hand; or None. pad: see `sample_grasps`. friction_angle: between the line and the surface's normals at most. share: of how
    far the pads are set back. wall: the line meets more of the body, apart from there."""
    if hit is None:
        return None
    point, u = c.point, c.u
    move = c.fit(body, hit.leave - hit.enter, opening)
    if move != STAY:
        if isinstance(body.shape, Cylinder) and pad is not None and move.along_m > pad.tip_z_m - ON_PAD_M:
            return None  # the line in which they would meet it is ahead of their tips
        point = point + share * move.by(c.R)
        if not isinstance(body.shape, Cylinder):  # which flat pads meet where it is widest
            middle = (hit.enter + hit.leave) / 2
            hit = (
                stretch_at(body.shape, body.T_world_body, point, u, middle)
                if wall
                else line_contacts(body.shape, body.T_world_body, point, u)
            )
    raised = max(0.0, c.least_z - float(point[2]))
    if pad is not None and raised > pad.high_z_m:
        return None
    point = point + raised * UP if raised else point
    cone = np.cos(friction_angle)
    if hit is None or -hit.enter_normal @ u < cone or hit.leave_normal @ u < cone:
        return None
    enter, leave = hit.enter, hit.leave
    if leave - enter + SPARE_M > opening.max_m:
        return None
    if pad is not None and isinstance(body.shape, ConvexMesh):
        enter, leave = under_pads(body.shape, body.T_world_body, hit, point, u, c.R, pad, wall)
    width = leave - enter
    if width + SPARE_M > opening.max_m:
        return None
    centre = point + 0.5 * (enter + leave) * u
    return Grasp(transform(c.R, opening.hand_position(centre, c.R, width)), float(width))
