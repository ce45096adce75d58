"""All hands that hold an upright box or can at all, by however little of their pads: for where natural grasps don't do, and for proofs
that none does.

The natural grasps of `finger_grasps` hold an object about its middle, with room behind the pads. Many others hold it, too: by its uppermost
edge, by its front alone, deeper than its middle, beside it. A hand of some pitch that closes along some direction has two ways left to be
moved, ahead and up; both are gone through in steps, wherever the pads overlap the object's outline by a square that is wide enough for
the verdict. What palm and fingers touch is not asked here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Body, Grasp
from kinematics.shapes import Box, Cylinder, is_upright
from kinematics.transforms import Array, transform
from planning.grasping.antipodal import SPARE_M
from planning.grasping.candidates import with_sides
from planning.grasping.hand_poses import UP, ahead_of, level_across, level_hand
from planning.grasping.pads import Pad
from planning.grasping.sampling import Headings, Sampling

LEAST_M = 0.004
"""The side of the square in which a pad and what it holds overlap; the verdict asks for 3 mm."""
SURELY_M = 0.003 * float(np.sqrt(2.0)) / 3
"""The side of a square in which they surely overlap where the verdict calls a thing held, for proofs: what is 3 mm wide in all directions,
a corner aslant as well, has a circle in it with a third of that for a radius."""
SAG_M = 0.001
"""A pad meets what is round in a strip that is nowhere further from it."""
LINE_M = LEAST_M * float(np.sqrt(0.5))
"""Half the width of that strip, where the line in its middle has to be on the pad: at any pitch a square just fits."""
TURNS, SAME_WAY = 4, 1e-9
"""So often is an arm of few joints asked again how it looks at a place ahead of the object's middle, till it is ahead as the hand looks."""


Places = Callable[[float], Array]
"""Where the pads' middle may be, ahead of the body's and up from it (N, 2), when the hand has some pitch."""


@dataclass(frozen=True, eq=False)
class _Outline:
    """An upright body as pads see it: how far it reaches ahead of its middle, and up, and how thick it is; m."""

    ahead_m: float
    up_m: float
    width_m: float


def marginal_grasps(
    body: Body,
    opening: Opening,
    approaches: Sequence[str],
    toward: float,
    sampling: Sampling,
    pad: Pad,
    headings: Headings | None = None,
) -> Iterator[Grasp]:
    """The grasps on an upright box or cylinder, `sampling.steps_m` apart ahead and up; none on other bodies, by a cup or a hinged jaw.

    toward, headings: see `finger_grasps.sample_grasps`.
    """
    if sampling.steps_m is None or opening.cup_m or opening.round_only or not is_upright(body.T_world_body):
        return
    body = with_sides(body)
    pitches, steps = [pitch for kind in approaches for pitch in sampling.pitches[kind]], sampling.steps_m

    def places(outline: _Outline) -> Places:
        return lambda pitch: _overlapping(outline, pitch, steps, pad, sampling.beyond_m)

    match body.shape:
        case Box():
            x, y, z = map(float, body.shape.half)
            for axis, outline in ((0, _Outline(y, z, 2 * x)), (1, _Outline(x, z, 2 * y))):
                yield from _all_round(body, opening, outline.width_m, [body.T_world_body[:3, axis]], pitches, places(outline))
        case Cylinder(radius_m=radius, height_m=height):
            strip = _strip_m(radius) if sampling.beyond_m else LINE_M
            outline = _Outline(strip, height / 2, 2 * radius)
            if headings is not None:
                yield from _headed(body, opening, outline.width_m, toward, pitches, places(outline), headings)
                return
            yaws = np.arange(sampling.yaws) * np.pi / sampling.yaws
            closing = [np.array([np.cos(yaw), np.sin(yaw), 0.0]) for yaw in yaws]
            yield from _all_round(body, opening, outline.width_m, closing, pitches, places(outline))


def _all_round(
    body: Body, opening: Opening, width_m: float, closing: Sequence[Array], pitches: Sequence[float], places: Places
) -> Iterator[Grasp]:
    """Grasps from both sides of each closing direction (3,), level."""
    if width_m + SPARE_M > opening.max_m:
        return
    for pitch in pitches:
        offsets = places(pitch)
        for u, side in product(closing, (1.0, -1.0)):
            ahead = side * level_across(u) / np.hypot(u[0], u[1])
            R = level_hand(ahead, pitch)
            middles = body.T_world_body[:3, 3] + offsets[:, :1] * ahead + offsets[:, 1:] * UP
            T = np.tile(transform(R), (len(middles), 1, 1))
            T[:, :3, 3] = opening.hand_position(middles, R, width_m)
            yield from (Grasp(T_hand, width_m) for T_hand in T)


def _headed(
    body: Body, opening: Opening, width_m: float, toward: float, pitches: Sequence[float], places: Places, headings: Headings
) -> Iterator[Grasp]:
    """Grasps on what is round of an arm of few joints."""
    if width_m + SPARE_M > opening.max_m:
        return
    there = np.array([np.cos(toward), np.sin(toward), 0.0])
    for pitch in pitches:
        for along, up in places(pitch):
            at = body.T_world_body[:3, 3] + [0.0, 0.0, up]
            for first in headings(transform(level_hand(there, pitch), at), width_m):
                R, ahead = first, ahead_of(first, pitch, there)
                for _ in range(TURNS if along else 0):
                    again = headings(transform(R, at + along * ahead), width_m)
                    R = max(again, key=lambda other: float(np.sum(other * R)), default=R)
                    before, ahead = ahead, ahead_of(R, pitch, there)
                    if np.abs(ahead - before).max() < SAME_WAY:
                        break
                middle = at + along * ahead
                yield Grasp(transform(R, opening.hand_position(middle, R, width_m)), width_m)


def lacks_m(body: Body, opening: Opening, pad: Pad, grasp: Grasp) -> float:
    """By how much, at least, a level-closing hand has to be moved ahead or up till it may hold an upright box or can, a pad overlapping it
    by a square of SURELY_M; 0 where it does, or where that can't be said."""
    if not isinstance(body.shape, (Box, Cylinder)) or not is_upright(body.T_world_body):
        return 0.0
    body = with_sides(body)
    R, T = grasp.T_world_hand[:3, :3], body.T_world_body
    if isinstance(body.shape, Cylinder):
        outline = _Outline(_strip_m(body.shape.radius_m), body.shape.height_m / 2, 2 * body.shape.radius_m)
    else:
        x, y, z = map(float, body.shape.half)
        outline = _Outline(y, z, 2 * x) if abs(R[:, 1] @ T[:3, 0]) > abs(R[:, 1] @ T[:3, 1]) else _Outline(x, z, 2 * y)
    ahead = level_across(R[:, 1])
    z_axis, x_axis = (np.array([axis @ ahead, axis[2]]) for axis in (R[:, 2], R[:, 0]))
    middle = (grasp.T_world_hand @ [*opening.pads_middle(grasp.width_m), 1.0])[:3] - T[:3, 3]
    face = np.array([middle @ ahead, middle[2]]) + (pad.high_z_m + pad.low_z_m) / 2 * z_axis
    return max(0.0, -float(_left(outline, pad, face[None], z_axis, x_axis, SURELY_M).min()))


def _overlapping(outline: _Outline, pitch: float, steps: tuple[float, float], pad: Pad, beyond_m: float) -> Array:
    """How far ahead of an outline's middle, and up from it, the pads' middle may be (N, 2): where a square with sides of LEAST_M, along the
    pads', lies in both; or for proofs, with beyond_m, where one of SURELY_M would if they were moved by that. The most overlap in front."""
    co, si, side_m = np.cos(pitch), np.sin(pitch), SURELY_M if beyond_m else LEAST_M
    half_x, half_z, ahead, up = _halves(outline, pad, side_m, abs(co) + abs(si))
    if min(half_x, half_z, ahead, up) < 0.0:
        return np.zeros((0, 2))
    z_axis, x_axis = np.array([co, -si]), np.array([si, co])  # of the hand, in the plane of ahead and up
    shift = (pad.high_z_m + pad.low_z_m) / 2 * z_axis  # from the pads' middle to the middle of the face
    most = beyond_m + np.array([ahead + half_x * abs(si) + half_z * abs(co), up + half_x * abs(co) + half_z * abs(si)])
    grids = [_steps(reach, step) for reach, step in zip(most, steps)]
    faces = np.stack(np.meshgrid(*grids, indexing="ij"), -1).reshape(-1, 2)
    left = np.round(_left(outline, pad, faces, z_axis, x_axis, side_m), 9)
    best_first = np.lexsort((-left.sum(0), -left.min(0)))
    meets = best_first[left.min(0)[best_first] >= -beyond_m]
    return np.asarray(faces[meets] - shift)


def _halves(outline: _Outline, pad: Pad, side_m: float, slant: float) -> tuple[float, float, float, float]:
    """Half of the pad's sides, and of the outline's, less half of a square's that stands aslant in it; slant: |cos| + |sin|."""
    less = side_m / 2 * slant
    return pad.half_x_m - side_m / 2, (pad.high_z_m - pad.low_z_m - side_m) / 2, outline.ahead_m - less, outline.up_m - less


def _left(outline: _Outline, pad: Pad, faces: Array, z_axis: Array, x_axis: Array, side_m: float) -> Array:
    """By how much more a pad and an outline overlap than a square of side_m, along the hand's z_axis and x_axis (2,) in the plane of ahead
    and up (2, N), the pad's middle at faces (N, 2). Where neither is negative the two rectangles, less half of the square, meet: no side of
    either parts them."""
    co, si = abs(z_axis)
    half_x, half_z, ahead, up = _halves(outline, pad, side_m, co + si)
    return np.stack([half_z + ahead * co + up * si - np.abs(faces @ z_axis), half_x + ahead * si + up * co - np.abs(faces @ x_axis)])


def _strip_m(radius_m: float) -> float:
    """Half the width of the strip in which a pad that faces what is round is nowhere further from it than SAG_M."""
    return min(float(np.sqrt(2 * radius_m * SAG_M)), radius_m)


def _steps(reach: float, step: float) -> Array:
    """Evenly from -reach to reach, no more than a step apart."""
    return np.linspace(-reach, reach, 2 * int(np.ceil(reach / step)) + 1)
