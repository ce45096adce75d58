"""Polylines in stills: hidden by solids, but shining through faintly; and the edges of see-through solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry
from kinematics.shapes import Shape, convex_parts
from kinematics.transforms import Array, apply
from perception.camera import Intrinsics
from perception.rendering.colours import Colour, linear
from perception.rendering.surfaces import Mesh, surfaces

Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Polyline:
    """A line through points (N, 3) of the world, width_px wide in the finished image. colour: sRGB, one (3,) or one for each point (N, 3).

    hidden: how much of it shines through what is in front of it. halo_px: width of the light rim on each side.
    """

    points: Array
    colour: Colour | Array
    width_px: float = 4.0
    hidden: float = 0.2
    halo_px: float = 2.0


def sharp_edges(shape: Shape | Mesh | Array, T_world_shape: Array) -> list[Array]:
    """The sharp edges of a solid at T_world_shape (4, 4), as lines (2, 3) in the world; none of a mesh."""
    if isinstance(shape, Mesh):
        return []
    parts = (shape,) if isinstance(shape, np.ndarray) else convex_parts(shape)
    lines = []
    for part in parts:
        packed = surfaces([part], T_world_shape[None])
        corners = apply(T_world_shape, packed.vertices)
        turn = np.cross(
            corners[packed.faces[:, 1]] - corners[packed.faces[:, 0]], corners[packed.faces[:, 2]] - corners[packed.faces[:, 0]]
        )
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        seen: dict[tuple[int, int], int] = {}
        for f, face in enumerate(packed.faces.tolist()):
            for a, b in ((face[0], face[1]), (face[1], face[2]), (face[2], face[0])):
                other = seen.setdefault((min(a, b), max(a, b)), f)
                if other != f and turn[f] @ turn[other] < np.cos(0.5):
                    lines.append(corners[[a, b]])
    return lines


def lay_lines(
    lines: Sequence[Polyline], T_camera_world: Array, band: Intrinsics, factor: int, alpha: float, w: Array, out: Float32
) -> None:
    """Draw lines over the samples, hidden by what is nearer; what a line covers is afterwards as near as the line."""
    shape = (band.height, band.width)
    cover, halo, near = np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape)
    colour, hidden = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32)
    for line in lines:
        colours = linear(np.broadcast_to(np.asarray(line.colour, float), (len(line.points), 3)))
        width, rim = line.width_px * factor / 2, line.halo_px * factor
        points = apply(T_camera_world, np.asarray(line.points, float))
        _draw_line(points, colours, width, rim, line.hidden, band.fx, band.fy, band.cx, band.cy, cover, halo, near, hidden, colour)
    _blend_lines(cover, halo, near, hidden, colour, alpha, w, out)


@jit_entry
def _draw_line(
    p: Array,
    colours: Array,
    width: float,
    rim: float,
    ghost: float,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    cover: Float32,
    halo: Float32,
    near: Array,
    hidden: Float32,
    colour: Float32,
) -> None:
    """Keep, per sample, the best covering line: how much it covers, 1 / depth and colour; the halo is kept apart."""
    clip = 1e-3
    for i in range(p.shape[0] - 1):
        za, zb = p[i, 2], p[i + 1, 2]
        if za < clip and zb < clip:
            continue
        ta = (clip - za) / (zb - za) if za < clip else 0.0
        tb = (clip - za) / (zb - za) if zb < clip else 1.0
        za, zb = p[i, 2] + ta * (zb - za), p[i, 2] + tb * (zb - za)
        ua = fx * (p[i, 0] + ta * (p[i + 1, 0] - p[i, 0])) / za + cx
        va = fy * (p[i, 1] + ta * (p[i + 1, 1] - p[i, 1])) / za + cy
        ub = fx * (p[i, 0] + tb * (p[i + 1, 0] - p[i, 0])) / zb + cx
        vb = fy * (p[i, 1] + tb * (p[i + 1, 1] - p[i, 1])) / zb + cy
        reach = width + rim + 1.0
        du, dv = ub - ua, vb - va
        length2 = max(du * du + dv * dv, 1e-12)
        v0, v1 = max(min(va, vb) - reach, 0.0), min(max(va, vb) + reach, cover.shape[0] - 1.0)
        for v in range(int(np.ceil(v0)), int(v1) + 1 if v1 >= v0 else 0):
            # Along the row only what is near the line: the part of it whose rows are within reach.
            if abs(dv) > 1e-9:
                s0, s1 = (v - reach - va) / dv, (v + reach - va) / dv
                s0, s1 = min(max(min(s0, s1), 0.0), 1.0), min(max(max(s0, s1), 0.0), 1.0)
            else:
                s0, s1 = 0.0, 1.0
            u0 = max(min(ua + s0 * du, ua + s1 * du) - reach, 0.0)
            u1 = min(max(ua + s0 * du, ua + s1 * du) + reach, cover.shape[1] - 1.0)
            for u in range(int(np.ceil(u0)), int(u1) + 1 if u1 >= u0 else 0):
                s = min(max(((u - ua) * du + (v - va) * dv) / length2, 0.0), 1.0)
                distance = np.hypot(u - ua - s * du, v - va - s * dv)
                covered = min(max(width + 0.5 - distance, 0.0), 1.0)
                if rim > 0.0:
                    halo[v, u] = max(halo[v, u], min(max(1.0 - (distance - width) / rim, 0.0), 1.0))
                if covered > cover[v, u] or (covered == 1.0 and 1.0 / za + s * (1.0 / zb - 1.0 / za) > near[v, u]):
                    cover[v, u] = covered
                if covered > 0.0 or rim > 0.0:
                    w_line = 1.0 / za + s * (1.0 / zb - 1.0 / za)
                    if (covered > 0.0 and covered >= cover[v, u]) or near[v, u] == 0.0:
                        near[v, u], hidden[v, u] = w_line, ghost
                        along = ta + s * (tb - ta)
                        for c in range(3):
                            colour[v, u, c] = colours[i, c] + along * (colours[i + 1, c] - colours[i, c])


@jit_entry
def _blend_lines(
    cover: Float32, halo: Float32, near: Array, hidden: Float32, colour: Float32, alpha: float, w: Array, out: Float32
) -> None:
    for v in range(cover.shape[0]):
        for u in range(cover.shape[1]):
            if near[v, u] <= 0.0:
                continue
            seen = 1.0 if near[v, u] * 1.004 >= w[v, u] else hidden[v, u]
            rim = 0.55 * halo[v, u] * seen
            line = alpha * cover[v, u] * seen
            for c in range(3):
                out[v, u, c] += rim * (0.95 - out[v, u, c])
                out[v, u, c] += line * (colour[v, u, c] - out[v, u, c])
            if seen == 1.0 and line > 0.5:
                w[v, u] = max(w[v, u], near[v, u])
