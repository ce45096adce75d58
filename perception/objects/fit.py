"""The upright solid behind noisy pixels: fitted to all of them at once, so that their errors average out.

The noise of a stereo camera is along the pixel's ray. A face that is seen lies where the mean of its pixels says; where a face ends is said
by the rays themselves, which are exact: each pixel is moved along its ray onto the face, and the solid reaches as far as these points do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Body, Cabinet
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import Array, apply, inverse, rotation_about, transform
from perception.objects.footprint import DIRECTIONS, LEAST_M, clean_solid, least_circle, least_rectangle, outline_of
from perception.objects.lying import lying_cylinder
from perception.objects.prepared_frames import PreparedFrames
from perception.objects.ray_fit import BOX, CYLINDER, HEIGHT, KIND, YAW, normal_equations, slid
from perception.objects.sides import seen_sides

ROUNDS, STEPS = 3, 3
FEW = 3000
"""So many pixels of an object are enough for a least squares step."""
GATE = 4.5
"""Standard deviations beyond which a pixel is a stray."""
OFF_M = 0.002
"""Clean points that are further from the sides and the top of an upright solid around them show another shape."""
MISFIT = 1.3
"""Mean square error, in variances of the noise, above which pixels show neither a box nor a cylinder."""
SURE_M, SURE_RAD = 2e-4, 5e-3
"""A face is seen so well that its pixels say where it is, and no single one beyond it."""
STRAYS, APART_M = 2e-4, 0.001
"""So small a share of the pixels may lie further out by so much than all others, and not count."""
BELOW = 0.9
"""Pixels that are lower than so much of the height show the sides."""
DOUBT = 2.0
MOST = 0.01
"""No step moves a face by more metres, or turns one by more radians."""
STEP_M, TURN_RAD = 0.005, 0.05
"""How far a step moves a face, or turns it, that no pixel speaks of: the ridge of the least squares."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """What the frames show of one object: eyes (N, 3) and rays (N, 3), so that eye + z · ray is a pixel's point, and its noisy z (N,).

    axial: standard deviation of a depth at 1 m, growing with z². spread (N,): standard deviations of the averaged depths, metres.
    """

    eyes: Array
    rays: Array
    z: Array
    axial: float
    spread: Array


def standing_solids(
    views: PreparedFrames, shown: Mapping[str, tuple[Array, NDArray[np.int64]]], bases: Mapping[str, float], cabinet: Cabinet
) -> tuple[Body, ...]:
    """An upright solid in the world for each object; shown: its points (N, 3) and pixels, see `perception.objects.segment.object_pixels`;
    bases: how high over the floor it ends below, see `perception.objects.supports`.

    Clean points are all contained. Of noisy ones the fit leaves out less than a millimetre of a box or a cylinder that is well seen.
    """
    out = []
    for name, (points, source) in shown.items():
        up = np.array([0.0, 0.0, bases[name]])
        if views.axial > 0:
            pixels = pixels_of(views, points, source)
            shape, T = fitted_solid(replace(pixels, eyes=pixels.eyes - up), points - up)
        else:
            shape, T = clean_solid(points - up)
            if _off(shape, T, points - up) > OFF_M:
                shape, T = lying_cylinder(points - up, np.zeros(len(points))) or (shape, T)
        sides = seen_sides(shape, T, points - up)
        out.append(Body(name, shape, cabinet.T_world_cabinet @ transform(p=up) @ T, source="seen", sides_m=sides))
    return tuple(out)


def _off(shape: Shape, T: Array, points: Array) -> float:
    """How far four fifths of points (N, 3) inside of an upright box or cylinder are from its sides and its top at most, in metres."""
    local = apply(inverse(T), points)
    if isinstance(shape, Cylinder):
        beside = shape.radius_m - np.hypot(local[:, 0], local[:, 1])
    else:
        beside = (shape.half - np.abs(local))[:, :2].min(1)
    return float(np.quantile(np.minimum(beside, shape.half[2] - local[:, 2]), 0.8))


def pixels_of(views: PreparedFrames, points: Array, source: NDArray[np.int64]) -> Pixels:
    """The pixels of points (N, 3) in the cabinet; source (N, 2): frame and pixel of each, see `segment.object_pixels`."""
    eyes = np.array([T[:3, 3] for T in views.T_cabinet_camera])[source[:, 0]]
    averaged, z, count = np.empty(len(points)), np.empty(len(points)), np.empty(len(points))
    for i, (frame, depth) in enumerate(zip(views.frames, views.depths)):
        mine = source[:, 0] == i
        for out, image in ((averaged, depth), (z, np.asarray(frame.depth)), (count, views.counts[i])):
            out[mine] = image.ravel()[source[mine, 1]]
    return Pixels(eyes, (points - eyes) / averaged[:, None], z, views.axial, views.axial * averaged**2 / np.sqrt(count))


def fitted_solid(pixels: Pixels, rough: Array) -> tuple[Shape, Array]:
    """The upright box or cylinder that explains the pixels best, and its pose (4, 4); else a cylinder that lies; around what is none of
    these, an upright solid that contains the points.

    rough (N, 3): the pixels' points, from averaged depths.
    """
    middle = np.append(rough[:, :2].mean(0), 0.0)  # turning about it moves faces least
    pixels = replace(pixels, eyes=pixels.eyes - middle)
    every = max(len(pixels.z) // FEW, 1)
    few = replace(pixels, **{name: getattr(pixels, name)[::every].copy() for name in ("eyes", "rays", "z", "spread")})
    height, outline = float(rough[:, 2].max()), outline_of(rough[:, :2] - middle[:2])
    side = rough[rough[:, 2] < BELOW * height, :2] - middle[:2]
    starts = [_around(BOX, outline, height), _around(BOX, outline, height, side), _around(CYLINDER, outline, height)]
    tried = [_fitted(solid, few) for k, solid in enumerate(starts) if k == 0 or (solid != starts[0]).any()]
    error, solid = min(tried, key=lambda pair: pair[0])
    if error > MISFIT:
        if (fallen := lying_cylinder(rough, pixels.spread)) is not None:
            return fallen
        drawn = drawn_in(rough - middle, pixels)
        solid = _around(solid[KIND], outline_of(drawn[:, :2]), float(drawn[:, 2].max()))
    else:
        solid = _reaching(_settled(solid, pixels), pixels)  # a face that is hardly seen is told by few of them
    shape, T = _shape(solid)
    return shape, transform(p=middle) @ T


def _fitted(solid: Array, pixels: Pixels) -> tuple[float, Array]:
    """The mean square error and the solid of the same kind that explains the pixels best, beginning with this one."""
    for _ in range(ROUNDS):
        solid = _reaching(_settled(solid, pixels), pixels)
    args = (pixels.eyes, pixels.rays, pixels.z, pixels.axial, GATE)
    return normal_equations(solid, *args, np.empty((7, 7)), np.empty(7)), solid


def drawn_in(points: Array, pixels: Pixels) -> Array:
    """The outermost points (D + 1, 3) of a noisy cloud (N, 3), and the highest, each brought back by what noise may have carried it out.

    Of very many points the outermost is the one with the worst luck; so the one counts that is furthest out less DOUBT of its own standard
    deviations in that direction, which noise along a ray across it does not touch.
    """
    along = pixels.rays * pixels.spread[:, None] * DOUBT
    angle = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
    out = []
    for d in np.column_stack([np.cos(angle), np.sin(angle), np.zeros(DIRECTIONS)]):
        doubt = np.abs(along @ d)
        i = int(np.argmax(points @ d - doubt))
        out.append(points[i] - doubt[i] * d)
    top = points[:, 2] - np.abs(along[:, 2])
    i = int(np.argmax(top))
    return np.array([*out, [*points[i, :2], top[i]]])


def _around(kind: float, outline: Array, height: float, side: Array | None = None) -> Array:
    """The solid of one kind around a convex outline (K, 2). side: see `least_rectangle`."""
    if kind == CYLINDER:
        centre, radius = least_circle(outline)
        return np.array([CYLINDER, *centre, radius, 0.0, height, 0.0])
    centre, size, yaw = least_rectangle(outline, side)
    c, s = np.cos(yaw), np.sin(yaw)
    u, v = c * centre[0] + s * centre[1], -s * centre[0] + c * centre[1]
    return np.array([BOX, u - size[0] / 2, u + size[0] / 2, v - size[1] / 2, v + size[1] / 2, height, yaw])


def _settled(solid: Array, pixels: Pixels) -> Array:
    """The solid after some least squares steps: each face that is seen goes to the mean of its pixels."""
    A, g = np.empty((7, 7)), np.empty(7)
    ridge = np.diag([1.0, *[STEP_M**-2] * 5, TURN_RAD**-2])
    for _ in range(STEPS):
        normal_equations(solid, pixels.eyes, pixels.rays, pixels.z, pixels.axial, GATE, A, g)
        solid = solid + np.clip(np.linalg.solve(A + ridge, g), -MOST, MOST)
    return solid


def _reaching(solid: Array, pixels: Pixels) -> Array:
    """The solid of the same kind that reaches as far as the pixels do, once moved onto its faces, but for strays. Faces that enough pixels
    show stay where these have them."""
    out = np.empty((len(pixels.z), 3))
    n = slid(solid, pixels.eyes, pixels.rays, pixels.z, pixels.axial, GATE, out)
    if n == 0:
        return solid
    A, g = np.empty((7, 7)), np.empty(7)
    normal_equations(solid, pixels.eyes, pixels.rays, pixels.z, pixels.axial, GATE, A, g)
    sure = np.diag(A) > np.array([0.0, *[SURE_M**-2] * 5, SURE_RAD**-2])
    found = without_strays(solid, out[:n])
    height = solid[HEIGHT] if sure[HEIGHT] else found[:, 2].max()
    if solid[KIND] == CYLINDER:
        if sure[1:4].all():
            return np.array([CYLINDER, *solid[1:4], 0.0, height, 0.0])
    elif sure[YAW]:
        c, s = np.cos(solid[YAW]), np.sin(solid[YAW])
        u, v = c * found[:, 0] + s * found[:, 1], c * found[:, 1] - s * found[:, 0]
        sides = np.where(sure[1:5], solid[1:5], [u.min(), u.max(), v.min(), v.max()])
        return np.array([BOX, *sides, height, solid[YAW]])
    return _around(solid[KIND], outline_of(found[:, :2]), float(height))


def without_strays(solid: Array, points: Array) -> Array:
    """Points (N, 3) on a solid without the few that lie further out than all others: pixels that show what stands beside it.

    At most STRAYS of all on each side, so none where there are few: the last row of pixels that an object shows has more.
    """
    most = int(STRAYS * len(points))
    if most == 0:
        return points
    if solid[KIND] == CYLINDER:
        sides = [np.hypot(points[:, 0] - solid[1], points[:, 1] - solid[2])]
    else:
        c, s = np.cos(solid[YAW]), np.sin(solid[YAW])
        u, v = c * points[:, 0] + s * points[:, 1], c * points[:, 1] - s * points[:, 0]
        sides = [u, -u, v, -v]
    kept = np.ones(len(points), bool)
    for out in (*sides, points[:, 2]):
        kept &= out < np.partition(out, -most - 1)[-most - 1] + APART_M
    return points[kept]


def _shape(solid: Array) -> tuple[Shape, Array]:
    """A solid's shape and its pose (4, 4) above the plane z = 0: nowhere slimmer than LEAST_M, though stray pixels lie in one plane."""
    height = max(float(solid[HEIGHT]), LEAST_M)
    if solid[KIND] == CYLINDER:
        return Cylinder(max(float(solid[3]), LEAST_M / 2), height), transform(p=[solid[1], solid[2], height / 2])
    c, s = np.cos(solid[YAW]), np.sin(solid[YAW])
    u, v = (solid[1] + solid[2]) / 2, (solid[3] + solid[4]) / 2
    size = np.maximum([solid[2] - solid[1], solid[4] - solid[3], height], LEAST_M)
    return Box(size), transform(rotation_about((0.0, 0.0, 1.0), float(solid[YAW])), [c * u - s * v, s * u + c * v, height / 2])
