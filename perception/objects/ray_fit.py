"""Compiled work on the rays of pixels and an upright solid: how far the solid is along each, how to mend it, where a noisy point belongs.

A pixel saw the point eye + z · ray, z with noise. A solid is a row of seven numbers, in the frame of the rays, its feet on z = 0: a box is
[0, low u, high u, low v, high v, height, yaw], u and v the floor's axes turned by the yaw; a cylinder [1, x, y, radius, 0, height, 0].
"""

from __future__ import annotations

import numpy as np

from kinematics.jit.decorators import njit
from kinematics.transforms import Array

BOX, CYLINDER = 0.0, 1.0
KIND, HEIGHT, YAW = 0, 5, 6
STEEP = 0.03  # sine of the angle between a ray and a face under which the ray says too little about it
MISS_M = 0.001
ROUNDING_M = 0.001 / 12**0.5
_BISECTIONS = 30


@njit(cache=True, nogil=True)
def deviation(z: float, axial: float) -> float:
    """The standard deviation of a depth z: the camera's noise, and rounding to whole millimetres, which counts more near by."""
    return float(np.sqrt((axial * z * z) ** 2 + ROUNDING_M**2))


@njit(cache=True, nogil=True)
def hit(solid: Array, eye: Array, ray: Array, slope: Array) -> float:
    """The depth z at which a ray enters the solid, infinite when it misses; slope (7,): how z changes with each number of the solid.

    The slopes are 0 where the ray grazes: there the depth is no smooth function of the solid.
    """
    slope[:] = 0.0
    if solid[KIND] == CYLINDER:
        return float(_hit_cylinder(solid, eye, ray, slope))
    return float(_hit_box(solid, eye, ray, slope))


@njit(cache=True, nogil=True)
def _hit_cylinder(solid: Array, eye: Array, ray: Array, slope: Array) -> float:
    x, y, r, height = eye[0] - solid[1], eye[1] - solid[2], solid[3], solid[HEIGHT]
    a, b, c = ray[0] ** 2 + ray[1] ** 2, x * ray[0] + y * ray[1], x * x + y * y - r * r
    root = b * b - a * c
    if a > 1e-12 and root > 0.0:
        z = (-b - np.sqrt(root)) / a
        if z > 0.0 and 0.0 <= eye[2] + z * ray[2] <= height:
            qx, qy = x + z * ray[0], y + z * ray[1]
            along = qx * ray[0] + qy * ray[1]
            if abs(along) > 2 * STEEP * r * np.sqrt(a):
                slope[1], slope[2], slope[3] = qx / along, qy / along, r / along
            return float(z)
    if ray[2] < 0.0 and eye[2] > height:
        z = (height - eye[2]) / ray[2]
        if (x + z * ray[0]) ** 2 + (y + z * ray[1]) ** 2 <= r * r:
            if -ray[2] > STEEP:
                slope[HEIGHT] = 1.0 / ray[2]
            return float(z)
    return np.inf


@njit(cache=True, nogil=True)
def _hit_box(solid: Array, eye: Array, ray: Array, slope: Array) -> float:
    c, s = np.cos(solid[YAW]), np.sin(solid[YAW])
    enter, leave, face = 0.0, np.inf, -1
    for axis in range(3):
        if axis == 0:
            e, d = c * eye[0] + s * eye[1], c * ray[0] + s * ray[1]
        elif axis == 1:
            e, d = -s * eye[0] + c * eye[1], -s * ray[0] + c * ray[1]
        else:
            e, d = eye[2], ray[2]
        low, high = (0.0, solid[HEIGHT]) if axis == 2 else (solid[1 + 2 * axis], solid[2 + 2 * axis])
        if abs(d) < 1e-12:
            if e < low or e > high:
                return np.inf
            continue
        first, last = (low - e) / d, (high - e) / d
        if first > last:
            first, last = last, first
        if first > enter:
            enter, face = first, axis
        leave = min(leave, last)
    if face < 0 or enter > leave:
        return np.inf
    x, y = eye[0] + enter * ray[0], eye[1] + enter * ray[1]
    if face == 2:
        if -ray[2] > STEEP:
            slope[HEIGHT] = 1.0 / ray[2]
    else:
        d = c * ray[0] + s * ray[1] if face == 0 else -s * ray[0] + c * ray[1]
        if abs(d) > STEEP:
            slope[1 + 2 * face + (d < 0.0)] = 1.0 / d
            slope[YAW] = -(-s * x + c * y) / d if face == 0 else (c * x + s * y) / d
    return enter


@njit(cache=True, nogil=True)
def normal_equations(solid: Array, eyes: Array, rays: Array, z: Array, axial: float, gate: float, A: Array, g: Array) -> float:
    """Fill A (7, 7) and g (7,) of the least squares step for depths z (N,) of rays (N, 3) from eyes (N, 3), weighted by their noise.

    axial: standard deviation of a depth at 1 m, see `deviation`. Beyond `gate` of them a depth has no weight. Returns the mean square of
    the errors, in standard deviations and at most gate²; a ray that misses the solid counts one for each MISS_M that it stays away.
    """
    A[:], g[:] = 0.0, 0.0
    slope, total = np.empty(7), 0.0
    for i in range(len(z)):
        found, sigma = hit(solid, eyes[i], rays[i], slope), deviation(z[i], axial)
        if found == np.inf:
            there = nearest(solid, eyes[i], rays[i], z[i] - gate * sigma, z[i] + gate * sigma)
            error = distance(solid, eyes[i], rays[i], there) / MISS_M
        else:
            error = (z[i] - found) / sigma
            if abs(error) < gate:
                for a in range(7):
                    if slope[a] != 0.0:
                        for b in range(7):
                            A[a, b] += slope[a] * slope[b] / sigma**2
                        g[a] += slope[a] * error / sigma
        total += min(error * error, gate * gate)
    return float(total / max(len(z), 1))


@njit(cache=True, nogil=True)
def distance(solid: Array, eye: Array, ray: Array, z: float) -> float:
    """How far the point at depth z of a ray is from the solid, 0 inside."""
    x, y, height = eye[0] + z * ray[0], eye[1] + z * ray[1], eye[2] + z * ray[2]
    up = max(height - solid[HEIGHT], -height, 0.0)
    if solid[KIND] == CYLINDER:
        off = max(np.sqrt((x - solid[1]) ** 2 + (y - solid[2]) ** 2) - solid[3], 0.0)
        return float(np.sqrt(off * off + up * up))
    c, s = np.cos(solid[YAW]), np.sin(solid[YAW])
    u, v = c * x + s * y, -s * x + c * y
    a, b = max(u - solid[2], solid[1] - u, 0.0), max(v - solid[4], solid[3] - v, 0.0)
    return float(np.sqrt(a * a + b * b + up * up))


@njit(cache=True, nogil=True)
def nearest(solid: Array, eye: Array, ray: Array, low: float, high: float) -> float:
    """The depth between two at which a ray comes nearest to the solid; the distance along a ray is convex."""
    for _ in range(_BISECTIONS):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        if distance(solid, eye, ray, a) <= distance(solid, eye, ray, b):
            high = b
        else:
            low = a
    return 0.5 * (low + high)


@njit(cache=True, nogil=True)
def slid(solid: Array, eyes: Array, rays: Array, z: Array, axial: float, gate: float, out: Array) -> int:
    """The points (N, 3) of `out` moved along their rays onto the solid, or as near as they come; returns how many were.

    Those that would have to move by more than `gate` standard deviations are left out. A point's place across its ray is exact, so what
    noise has carried off a face comes back to where on the face it was.
    """
    slope, n = np.empty(7), 0
    for i in range(len(z)):
        found, reach = hit(solid, eyes[i], rays[i], slope), gate * deviation(z[i], axial)
        if found == np.inf:
            found = nearest(solid, eyes[i], rays[i], z[i] - reach, z[i] + reach)
        if abs(found - z[i]) <= reach:
            for a in range(3):
                out[n, a] = eyes[i, a] + found * rays[i, a]
            n += 1
    return n
