"""Rigid transforms as (..., 4, 4) float64 arrays, batches first.

`T_a_b` is the pose of frame b in frame a: points map as `p_a = T_a_b @ p_b`, and neighbouring letters must match in a product.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def transform(R: Array | None = None, p: Array | tuple[float, float, float] | list[float] | None = None) -> Array:
    """The (..., 4, 4) transform with rotation R (..., 3, 3) and translation p (..., 3) in metres; either may be left out."""
    batch = np.shape(R)[:-2] if R is not None else np.shape(p)[:-1] if p is not None else ()
    T = np.zeros((*batch, 4, 4))
    T[..., :3, :3] = np.eye(3) if R is None else R
    T[..., :3, 3] = 0.0 if p is None else p
    T[..., 3, 3] = 1.0
    return T


def inverse(T: Array) -> Array:
    """The inverse of rigid transforms (..., 4, 4)."""
    if np.shape(T) == (4, 4):  # a single one is turned round most often, and quicker in plain numbers
        (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = np.asarray(T, float).tolist()
        p = -(0.0 + a * x + d * y + g * z), -(0.0 + b * x + e * y + h * z), -(0.0 + c * x + f * y + i * z)
        return np.array([[a, d, g, p[0]], [b, e, h, p[1]], [c, f, i, p[2]], [0.0, 0.0, 0.0, 1.0]])
    R_t, out = np.swapaxes(T[..., :3, :3], -1, -2), np.zeros(np.shape(T))
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def cross(a: Array, b: Array) -> Array:
    """The cross product (3,) of two vectors (3,); numpy's is made for many at once, and takes ten times as long for two."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def apply(T: Array, points: Array) -> Array:
    """Points (N, 3) in b to points (N, 3) in a, by one transform T_a_b (4, 4)."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def rotation_about(axis: Array | tuple[float, float, float], angle: float) -> Array:
    """The (3, 3) rotation by `angle` rad about `axis` (3,), which need not be of unit length."""
    return rotations_about(axis, np.asarray(angle, float))


def rotations_about(axis: Array | tuple[float, float, float], angles: Array) -> Array:
    """The rotations (..., 3, 3) by angles (...,) rad about one axis (3,), which need not be of unit length (Rodrigues' formula)."""
    a = np.asarray(axis, float)
    x, y, z = a / np.linalg.norm(a)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, versine = np.sin(angles)[..., None, None], (1 - np.cos(angles))[..., None, None]
    return np.asarray(np.eye(3) + sine * K + versine * (K @ K))


def rotation_rpy(rpy: Array | tuple[float, float, float]) -> Array:
    """The (3, 3) rotation of URDF's fixed-axis roll, pitch, yaw, in rad."""
    r, p, y = rpy
    return np.asarray(rotation_about((0, 0, 1), y) @ rotation_about((0, 1, 0), p) @ rotation_about((1, 0, 0), r))


def rpy_from_rotation(R: Array) -> Array:
    """The inverse of `rotation_rpy`: (3,) angles in rad, pitch within ±π/2."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) > 1e-9:
        return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])
    return np.array([0.0, pitch, np.arctan2(-R[0, 1], R[1, 1])])


def rotation_from_wxyz(q_wxyz: Array | list[float]) -> Array:
    """The (3, 3) rotation of a quaternion (w, x, y, z), which is normalised first."""
    w, x, y, z = np.asarray(q_wxyz, float) / np.linalg.norm(q_wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def wxyz_from_rotation(R: Array) -> Array:
    """The unit quaternion (w, x, y, z) of a (3, 3) rotation, w >= 0 (Shepperd's method: the largest component first)."""
    trace = np.trace(R)
    candidates = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    i = int(np.argmax(candidates))
    if i == 0:
        q = np.array([1 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    elif i == 1:
        q = np.array([R[2, 1] - R[1, 2], 1 + 2 * R[0, 0] - trace, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]])
    elif i == 2:
        q = np.array([R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], 1 + 2 * R[1, 1] - trace, R[1, 2] + R[2, 1]])
    else:
        q = np.array([R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1 + 2 * R[2, 2] - trace])
    q = q / np.linalg.norm(q)
    return np.asarray(-q if q[0] < 0 else q)


def angle_between(Ra: Array, Rb: Array) -> Array:
    """The angle in rad, (...,), between rotations (..., 3, 3); accurate down to small angles."""
    D = np.swapaxes(Ra, -1, -2) @ Rb
    axis = np.stack([D[..., 2, 1] - D[..., 1, 2], D[..., 0, 2] - D[..., 2, 0], D[..., 1, 0] - D[..., 0, 1]], -1)
    return np.asarray(np.arctan2(np.linalg.norm(axis, axis=-1), np.trace(D, axis1=-2, axis2=-1) - 1))
