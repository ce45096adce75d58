"""Compiled surface normals of depth images: a plane is fitted to the pixels around each one.

The inverse depth of a plane is affine in column and row, and the noise of a stereo camera is nearly even in it, so the plane is a linear
least squares fit of 1 / z (as in "Adaptive neighborhood selection for real-time surface normal estimation", Holzer et al. 2012, in spirit).
"""

from __future__ import annotations

import numpy as np

from kinematics.jit.decorators import njit
from kinematics.transforms import Array
from perception.pixels import Bool, Image

FEWEST = 6
"""So many pixels at least are needed for a plane."""
LARGEST_PX = 12
"""No window reaches further than this from its middle."""


@njit(cache=True, nogil=True)
def surface_normals(
    depth: Image, inside: Bool, fx: float, fy: float, cx: float, cy: float, T: Array, reach_m: float, gate_m: float, axial: float
) -> Image:
    """Unit normals (H, W, 3) of the pixels marked `inside`, towards the camera and in the cabinet's frame; 0 where none can be told.

    T (4, 4): T_cabinet_camera. Pixels up to reach_m beside one, and within gate_m and three standard deviations of its depth, count.
    """
    height, width = depth.shape
    out = np.zeros((height, width, 3), np.float32)
    for v in range(height):
        for u in range(width):
            if not inside[v, u]:
                continue
            z = float(depth[v, u])
            r = int(min(max(reach_m * fx / z, 2.0), LARGEST_PX) + 0.5)
            step = 1 if r <= 3 else 2 if r <= 6 else 3
            gate = gate_m + 3.0 * axial * z * z
            n, su, sv, suu, suv, svv, sd, sud, svd = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for dv in range(-r, r + 1, step):
                y = v + dv
                if y < 0 or y >= height:
                    continue
                for du in range(-r, r + 1, step):
                    x = u + du
                    if x < 0 or x >= width or not inside[y, x] or abs(depth[y, x] - z) > gate:
                        continue
                    d = 1.0 / depth[y, x]
                    n += 1
                    su, sv, sd = su + du, sv + dv, sd + d
                    suu, suv, svv = suu + du * du, suv + du * dv, svv + dv * dv
                    sud, svd = sud + du * d, svd + dv * d
            if n < FEWEST:
                continue
            a11, a12, a22 = suu - su * su / n, suv - su * sv / n, svv - sv * sv / n
            det = a11 * a22 - a12 * a12
            if det < 1e-6 * n * n:
                continue
            b1, b2 = sud - su * sd / n, svd - sv * sd / n
            a, b = (a22 * b1 - a12 * b2) / det, (a11 * b2 - a12 * b1) / det
            c = (sd - a * su - b * sv) / n
            # 1 / z = a (u' - u) + b (v' - v) + c, times z: the plane a fx X + b fy Y + (c + a (cx - u) + b (cy - v)) Z = 1
            nx, ny, nz = a * fx, b * fy, c + a * (cx - u) + b * (cy - v)
            length = -np.sqrt(nx * nx + ny * ny + nz * nz)
            for k in range(3):
                out[v, u, k] = (T[k, 0] * nx + T[k, 1] * ny + T[k, 2] * nz) / length
    return out
