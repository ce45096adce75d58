"""Compiled work on the pixels of depth images: which show something in the cabinet, averages over a surface, what is seen to be empty.

All depths are metres along the camera's z, 0 where nothing was measured. The noise of a stereo camera is along the pixel's ray and grows
with z²; `axial` is its standard deviation at 1 m (see `perception.camera.DepthNoise`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry, njit
from kinematics.transforms import Array

Bool = NDArray[np.bool_]
Image = NDArray[np.float32]
Labels = NDArray[np.int32]
HIDDEN, SURFACE, EMPTY = 0, 1, 2


def wall_errors(
    depth: Image, arm: Bool, fx: float, fy: float, cx: float, cy: float, T: Array, size: Array, near_m: float, every: int
) -> Array:
    """How far (N,) pixels that show a wall are from it, along their ray, divided by z²: the spread is the camera's noise at 1 m.

    T (4, 4): T_cabinet_camera. A pixel shows a wall when it is within near_m of exactly one, which it does not see at a grazing angle.
    Looks at one pixel in `every` columns and rows.
    """
    found = np.empty(-(-depth.shape[0] // every) * -(-depth.shape[1] // every))
    return found[: _wall_errors(depth, arm, fx, fy, cx, cy, T, size, near_m, every, found)]


@jit_entry
def _wall_errors(
    depth: Image, arm: Bool, fx: float, fy: float, cx: float, cy: float, T: Array, size: Array, near_m: float, every: int, found: Array
) -> int:
    n = 0
    for v in range(0, depth.shape[0], every):
        for u in range(0, depth.shape[1], every):
            z = depth[v, u]
            if z <= 0.0 or arm[v, u]:
                continue
            a, b = (u - cx) / fx, (v - cy) / fy
            count, error = 0, 0.0
            for axis in range(3):
                slope = T[axis, 0] * a + T[axis, 1] * b + T[axis, 2]
                p = T[axis, 3] + z * slope
                for side in range(2):
                    if axis == 0 and side == 0:
                        continue  # the front is open
                    at = size[axis] * side if axis != 1 else size[1] * (side - 0.5)
                    if abs(p - at) < near_m:
                        count += 1
                        error = (p - at) / slope if abs(slope) > 0.3 else np.inf
            if count == 1 and error < np.inf:
                found[n] = error / (z * z)
                n += 1
    return n


def in_cabinet(
    depth: Image, arm: Bool, fx: float, fy: float, cx: float, cy: float, T: Array, size: Array, front_m: float, margin_m: float,
    axial: float,
) -> tuple[Bool, Image]:  # fmt: skip
    """Which pixels (H, W) show something inside the cabinet, or up to front_m before its open side, that is no wall; and every pixel's
    point (H, W, 3) in the cabinet.

    A point is no wall when it is margin_m off, and three standard deviations more, as far as noise along the ray moves it off the wall.
    """
    inside, points = np.zeros(depth.shape, np.bool_), np.zeros((*depth.shape, 3), np.float32)
    _in_cabinet(depth, arm, fx, fy, cx, cy, T, size, front_m, margin_m, axial, inside, points)
    return inside, points


@jit_entry
def _in_cabinet(
    depth: Image, arm: Bool, fx: float, fy: float, cx: float, cy: float, T: Array, size: Array, front_m: float, margin_m: float,
    axial: float, inside: Bool, points: Image,
) -> None:  # fmt: skip
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            if z <= 0.0:
                continue
            a, b = (u - cx) / fx, (v - cy) / fy
            good = not arm[v, u]
            for axis in range(3):
                slope = T[axis, 0] * a + T[axis, 1] * b + T[axis, 2]
                p = T[axis, 3] + z * slope
                points[v, u, axis] = p
                off = margin_m + 3.0 * axial * z * z * abs(slope)
                low, high = off, size[axis] - off
                if axis == 0:
                    low = -front_m
                elif axis == 1:
                    low, high = off - size[1] / 2, size[1] / 2 - off
                good = good and low < p < high
            inside[v, u] = good


@njit(cache=True, nogil=True)
def smooth(depth: Image, label: Labels, axial: float, reach_px: int) -> tuple[Image, NDArray[np.uint8]]:
    """Each pixel with a label >= 0 averaged with those up to reach_px around it that have the same and are within four standard deviations.

    The average is of 1 / z, which is affine in column and row on a plane, so slanted faces stay where they are. Others keep their depth.
    The second image (H, W) says of how many pixels each one is the average.
    """
    out, count = depth.copy(), np.ones(depth.shape, np.uint8)
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if z <= 0.0 or label[v, u] < 0:
                continue
            gate = 4.0 * axial * z * z
            total, n = 0.0, 0
            # What lies opposite counts as well or not at all: at a border the average would slide inwards along a slanted face.
            for dv in range(reach_px + 1):
                for du in range(-reach_px if dv > 0 else 1, reach_px + 1):
                    v1, u1, v2, u2 = v + dv, u + du, v - dv, u - du
                    if v1 >= height or v2 < 0 or u1 < 0 or u2 < 0 or u1 >= width or u2 >= width:
                        continue
                    z1, z2 = depth[v1, u1], depth[v2, u2]
                    if z1 <= 0.0 or z2 <= 0.0 or label[v1, u1] != label[v, u] or label[v2, u2] != label[v, u]:
                        continue
                    if abs(0.5 * (z1 + z2) - z) < gate and abs(z1 - z2) < 0.04:
                        total += 1.0 / z1 + 1.0 / z2
                        n += 2
            out[v, u], count[v, u] = (n + 1) / (total + 1.0 / z), n + 1
    return out, count


@njit(cache=True, nogil=True)
def filled(depth: Image, arm: Bool, fewest: int) -> Image:
    """The image with a pixel that measured nothing as near as the nearest of the 3 × 3 around it, where at least `fewest` measured any.

    A stereo camera loses pixels at the edges of things, where nothing else is than what is on the one side or on the other. The robot's own
    pixels, and those beside them, stay empty.
    """
    out = depth.copy()
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            if depth[v, u] > 0.0:
                continue
            least, n = np.inf, 0
            for y in range(max(v - 1, 0), min(v + 2, height)):
                for x in range(max(u - 1, 0), min(u + 2, width)):
                    if arm[y, x]:
                        n = -9
                    if depth[y, x] > 0.0:
                        n += 1
                        least = min(least, depth[y, x])
            if n >= fewest:
                out[v, u] = least
    return out


@njit(cache=True, nogil=True)
def nearest_around(depth: Image, arm: Bool) -> Image:
    """The least measured depth in the 3 × 3 pixels around each, 0 where fewer than three were measured or the robot is among them."""
    out = np.zeros(depth.shape, np.float32)
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            least, n, clear = np.inf, 0, True
            for y in range(max(v - 1, 0), min(v + 2, height)):
                for x in range(max(u - 1, 0), min(u + 2, width)):
                    clear = clear and not arm[y, x]
                    if depth[y, x] > 0.0:
                        n += 1
                        least = min(least, depth[y, x])
            if n >= 3 and clear:
                out[v, u] = least
    return out


@njit(cache=True, nogil=True)
def seen(p: Array, near: Image, cameras: Array, T: Array, slack_m: float, axial: float) -> int:
    """What the frames know of the point p (3,) of the cabinet: EMPTY when one looks through it and measures what is further away by more
    than the slack, SURFACE when one measures just that depth, else HIDDEN.

    near (F, H, W): `nearest_around` of each frame; cameras (F, 4): fx, fy, cx, cy; T (F, 4, 4): T_camera_cabinet.
    """
    found = HIDDEN
    for f in range(near.shape[0]):
        z = T[f, 2, 0] * p[0] + T[f, 2, 1] * p[1] + T[f, 2, 2] * p[2] + T[f, 2, 3]
        if z < 0.01:
            continue
        x = T[f, 0, 0] * p[0] + T[f, 0, 1] * p[1] + T[f, 0, 2] * p[2] + T[f, 0, 3]
        y = T[f, 1, 0] * p[0] + T[f, 1, 1] * p[1] + T[f, 1, 2] * p[2] + T[f, 1, 3]
        u, v = int(np.floor(cameras[f, 0] * x / z + cameras[f, 2] + 0.5)), int(np.floor(cameras[f, 1] * y / z + cameras[f, 3] + 0.5))
        if 0 <= u < near.shape[2] and 0 <= v < near.shape[1] and near[f, v, u] > 0.0:
            behind, slack = near[f, v, u] - z, slack_m + 2.0 * axial * z * z
            if behind > slack:
                return EMPTY
            if behind > -slack:
                found = SURFACE
    return found


@njit(cache=True, nogil=True)
def hidden_between(a: Array, b: Array, near: Image, cameras: Array, T: Array, step_m: float, slack_m: float, axial: float) -> float:
    """How much of the segment between a and b (3,) nobody has seen, in metres; -1 when a point of it is seen to be empty."""
    length = np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    n, hidden = int(length / step_m), 0
    p = np.empty(3)
    for i in range(n):
        # from the middle outwards: that is where two objects have their gap
        j = n // 2 + (i + 1) // 2 * (-1 if i % 2 else 1)
        share = (j + 0.5) / n
        for r in range(3):
            p[r] = a[r] + share * (b[r] - a[r])
        known = seen(p, near, cameras, T, slack_m, axial)
        if known == EMPTY:
            return -1.0
        hidden += known == HIDDEN
    return hidden * step_m


@njit(cache=True, nogil=True)
def separations(
    points: Array, near: Image, cameras: Array, T: Array, step_m: float, slack_m: float, axial: float, usual_m: float, most_m: float
) -> Array:
    """How surely two points are not of one convex object: (N·(N - 1)/2,) between 0 and 1, in SciPy's condensed order.

    1 where the segment between them is seen to be empty somewhere. Else it rises slowly with the distance on the floor, to 0.05 at usual_m,
    so that what stands in one column belongs together before what stands beside it; and, of what nobody has seen of the segment, from 0
    at a length of usual_m to 1 at most_m.
    """
    n = points.shape[0]
    out = np.ones(n * (n - 1) // 2)
    k = 0
    for i in range(n):
        for j in range(i + 1, n):
            apart = np.hypot(points[i, 0] - points[j, 0], points[i, 1] - points[j, 1])
            hidden = hidden_between(points[i], points[j], near, cameras, T, step_m, slack_m, axial) if apart < most_m else -1.0
            if hidden >= 0.0:
                level = hidden * apart / max(np.sqrt(apart**2 + (points[i, 2] - points[j, 2]) ** 2), 1e-9)
                out[k] = max(0.05 * min(apart / usual_m, 1.0), min((level - usual_m) / (most_m - usual_m), 1.0))
            k += 1
    return out


@njit(cache=True, nogil=True)
def separated_shares(
    cells: Array,
    candidates: Labels,
    members: Array,
    first: Labels,
    near: Image,
    cameras: Array,
    T: Array,
    step_m: float,
    slack_m: float,
    axial: float,
) -> Array:
    """For each cell (C, 3) and each of its candidate groups (C, K), -1 for none, the share of the group's members separated from it.

    members[first[g]:first[g + 1]] (·, 3) are points of group g. Where there is no candidate, inf.
    """
    out = np.full(candidates.shape, np.inf)
    for c in range(cells.shape[0]):
        for k in range(candidates.shape[1]):
            g = candidates[c, k]
            if g >= 0:
                apart = 0
                for m in range(first[g], first[g + 1]):
                    apart += hidden_between(cells[c], members[m], near, cameras, T, step_m, slack_m, axial) < 0.0
                out[c, k] = apart / max(first[g + 1] - first[g], 1)
    return out


@njit(cache=True, nogil=True)
def empty_share(a: Array, b: Array, near: Image, cameras: Array, T: Array, step_m: float, slack_m: float, axial: float) -> float:
    """The share of the segments between points a (N, 3) and b (M, 3) that are seen to be empty somewhere."""
    empty = 0
    for i in range(len(a)):
        for j in range(len(b)):
            empty += hidden_between(a[i], b[j], near, cameras, T, step_m, slack_m, axial) < 0.0
    return empty / max(len(a) * len(b), 1)


@njit(cache=True, nogil=True)
def flying_pixels(depth: Image, edge_m: float) -> Bool:
    """Which pixels (H, W) lie between the two sides of an edge and on neither: what they measure is in the air.

    Along a row, a column or a diagonal, the pixels one or two before and behind differ by more than edge_m (at 1 m, growing with z²), are
    even with those four further on their side, and the pixel is off both of them by a fifth of the step.
    """
    height, width = depth.shape
    out = np.zeros(depth.shape, np.bool_)
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if z <= 0.0:
                continue
            for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1)):
                for k in range(1, 3):
                    v1, u1, v2, u2 = v - (k + 4) * dv, u - (k + 4) * du, v + (k + 4) * dv, u + (k + 4) * du
                    if v1 < 0 or v2 >= height or min(u1, u2) < 0 or max(u1, u2) >= width:
                        continue
                    a, b = depth[v - k * dv, u - k * du], depth[v + k * dv, u + k * du]
                    a2, b2 = depth[v1, u1], depth[v2, u2]
                    step = abs(b - a)
                    if a <= 0.0 or b <= 0.0 or a2 <= 0.0 or b2 <= 0.0 or step < edge_m * max(z * z, 1.0):
                        continue
                    even = abs(a2 - a) < 0.25 * step and abs(b2 - b) < 0.25 * step
                    if even and min(a, b) + 0.2 * step < z < max(a, b) - 0.2 * step:
                        out[v, u] = True
    return out
