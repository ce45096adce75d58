"""Normals that make faces which meet at a small angle look like one curved surface."""

from __future__ import annotations

import numpy as np

from kinematics.collision.geometry import HULL
from kinematics.jit.decorators import jit_entry
from kinematics.transforms import Array
from perception.rendering.surfaces import MESH, Int, Surfaces


def corner_normals(scene: Surfaces, crease_rad: Array) -> Array:
    """Normals (F, 3, 3) at the faces' corners: the mean over the faces there that differ by less than the solid's crease."""
    normals = np.zeros((len(scene.faces), 3, 3))
    for k in range(len(scene.kind)):
        if scene.kind[k] not in (HULL, MESH):
            continue
        faces = scene.faces[scene.first_face[k] : scene.first_face[k + 1]]
        own = scene.vertices[scene.first_vertex[k] : scene.first_vertex[k + 1]]
        place = _same_places(own)[faces - scene.first_vertex[k]]
        by_place = np.argsort(place.ravel(), kind="stable")
        first = np.searchsorted(place.ravel()[by_place], np.arange(int(place.max(initial=-1)) + 2))
        corners = scene.vertices[faces]
        out = normals[scene.first_face[k] : scene.first_face[k + 1]]
        area, unit = np.empty((2, len(faces), 3))
        _blend_normals(corners, place, by_place // 3, first, float(np.cos(crease_rad[scene.id[k]])), area, unit, out)
    return normals


def _same_places(points: Array) -> Int:
    """A number (V,) for each point, the same for points at the same place (to 1 µm)."""
    grid = np.round((points - points.min(0, initial=0.0)) * 1e6).astype(np.int64)
    _, number = np.unique((grid[:, 0] * 73_856_093) ^ (grid[:, 1] * 19_349_663) ^ (grid[:, 2] * 83_492_791), return_inverse=True)
    return np.asarray(number, np.int64)


@jit_entry
def _blend_normals(corners: Array, place: Int, face_at: Int, first: Int, least_cosine: float, area: Array, unit: Array, out: Array) -> None:
    """area, unit (F, 3): scratch."""
    n = corners.shape[0]
    for f in range(n):
        ax, ay, az = corners[f, 1, 0] - corners[f, 0, 0], corners[f, 1, 1] - corners[f, 0, 1], corners[f, 1, 2] - corners[f, 0, 2]
        bx, by, bz = corners[f, 2, 0] - corners[f, 0, 0], corners[f, 2, 1] - corners[f, 0, 1], corners[f, 2, 2] - corners[f, 0, 2]
        area[f, 0], area[f, 1], area[f, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        length = max(np.sqrt(area[f, 0] ** 2 + area[f, 1] ** 2 + area[f, 2] ** 2), 1e-300)
        for r in range(3):
            unit[f, r] = area[f, r] / length
    for f in range(n):
        for c in range(3):
            x, y, z = 0.0, 0.0, 0.0
            for j in range(first[place[f, c]], first[place[f, c] + 1]):
                g = face_at[j]
                if unit[f, 0] * unit[g, 0] + unit[f, 1] * unit[g, 1] + unit[f, 2] * unit[g, 2] >= least_cosine:
                    x, y, z = x + area[g, 0], y + area[g, 1], z + area[g, 2]
            length = np.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                out[f, c, 0], out[f, c, 1], out[f, c, 2] = x / length, y / length, z / length
            else:
                for r in range(3):
                    out[f, c, r] = unit[f, r]
