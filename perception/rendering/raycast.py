"""Depth and instance images of boxes, cylinders, convex hulls and triangle meshes.

Images are drawn, not traced: the inverse depth w = 1 / z at which a pixel's ray meets a plane is affine in the pixel's column and row. So
a box is a few affine functions, a cylinder two and a square root, a triangle four (Olano and Greer, "Triangle scan conversion using 2D
homogeneous coordinates", 1997), and a buffer keeps the largest w. This is as exact as tracing rays, needs no division per pixel, no tree
and no near plane, and the compiler turns it into vector code.

Surfaces have two sides, as in Embree: a camera inside a solid sees that solid's far side from within, never a side behind itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.array_checks import checked
from kinematics.collision.geometry import BOX, CYLINDER
from kinematics.jit.decorators import jit_entry
from kinematics.transforms import Array, inverse
from perception.camera import Intrinsics
from perception.rendering.draw_solids import Scratch, draw_box, draw_cylinder, scratch
from perception.rendering.draw_triangles import draw_triangles
from perception.rendering.normals import write_normals
from perception.rendering.surfaces import Ids, Surfaces


class View(NamedTuple):
    """What a camera sees. depth (H, W): z in metres, 0 where nothing is; instance (H, W): the solid's id, -1 where nothing is;
    normals (H, W, 3): unit, towards the camera, in the world, zero where nothing is; None if not asked for.
    """

    depth: NDArray[np.float32]
    instance: Ids
    normals: NDArray[np.float32] | None


def raycast(s: Surfaces, T_world_camera: Array, intrinsics: Intrinsics, *, normals: bool = False) -> View:
    """What a pinhole camera at T_world_camera (4, 4) sees of the solids. Depth is 0 and the instance -1 where there is nothing."""
    T_world_camera = checked("T_world_camera", T_world_camera, 4, 4)
    w, primitive = inverse_depth(s, T_world_camera, intrinsics)
    shape = (intrinsics.height, intrinsics.width)
    depth, instance = np.empty(shape, np.float32), np.empty(shape, np.int32)
    _finish(np.concatenate([[-1], s.id, np.repeat(s.id, np.diff(s.first_face))]).astype(np.int32), w, primitive, depth, instance)
    facing = np.zeros((*shape, 3), np.float32) if normals else None
    if facing is not None:
        camera = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
        write_normals(s, np.ascontiguousarray(T_world_camera, float), *camera, w, primitive, np.zeros((0, 3, 3)), facing)
    return View(depth, instance, facing)


def inverse_depth(s: Surfaces, T_world_camera: Array, intrinsics: Intrinsics) -> tuple[Array, Ids]:
    """The image as it is drawn: 1 / depth (H, W), 0 where nothing is; and the primitive (H, W) that is seen: solid k of the S, or S + the
    row of the face, or -1.
    """
    w = np.zeros((intrinsics.height, intrinsics.width))
    primitive = np.full(w.shape, -1, np.int32)
    _draw(s, inverse(T_world_camera), intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, w, primitive, scratch(s))
    return w, primitive


@jit_entry
def _draw(s: Surfaces, T_camera_world: Array, fx: float, fy: float, cx: float, cy: float, w: Array, primitive: Ids, room: Scratch) -> None:
    P = room.pose
    for k in range(s.kind.shape[0]):
        for r in range(3):
            for c in range(4):
                P[r, c] = T_camera_world[r, 0] * s.T[k, 0, c] + T_camera_world[r, 1] * s.T[k, 1, c] + T_camera_world[r, 2] * s.T[k, 2, c]
            P[r, 3] += T_camera_world[r, 3]
        if s.kind[k] == BOX:
            draw_box(P, s.half[k], np.int32(k), fx, fy, cx, cy, w, primitive, room)
        elif s.kind[k] == CYLINDER:
            draw_cylinder(P, s.half[k], np.int32(k), fx, fy, cx, cy, w, primitive, room)
        else:
            draw_triangles(s, k, P, room.corners, fx, fy, cx, cy, w, primitive)


@jit_entry
def _finish(name: Ids, w: Array, primitive: Ids, depth: NDArray[np.float32], instance: Ids) -> None:
    """Inverse depth to depth, primitives to ids: name[i + 1] is that of primitive i."""
    nothing, one = np.float32(0.0), np.float32(1.0)
    for v in range(w.shape[0]):
        row, row_depth, row_primitive, row_instance = w[v], depth[v], primitive[v], instance[v]
        for u in range(w.shape[1]):
            near = np.float32(row[u])
            row_depth[u] = one / near if near > nothing else nothing
            row_instance[u] = name[row_primitive[u] + 1]
