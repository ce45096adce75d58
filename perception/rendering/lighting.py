"""Light for stills: one area light casts soft shadows, a sky of many weak lights darkens corners and contacts.

Both look up shadow images that the raycaster draws from where the lights stand. Each of a pixel's samples asks another share of the lights.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.geometry import BOX, CYLINDER
from kinematics.jit.decorators import jit_entry
from kinematics.shapes import box_corners
from kinematics.transforms import Array, apply, inverse
from perception.camera import Intrinsics, look_at
from perception.rendering.colours import Colour
from perception.rendering.raycast import inverse_depth
from perception.rendering.surfaces import Int, Surfaces, join

Float32 = NDArray[np.float32]

KEY_PX, SKY_PX = 640, 256
"""Width of the shadow images of one light."""
GROUND_PX, GROUND_REACH = 288, 2.0
"""The grid on which shadows on the floor are computed, and how far it goes, in radii of the scene."""
GLASS_SHARE = 4
"""One in so many of the lights casts the faint shadows of see-through solids."""
THREADS = min(8, os.cpu_count() or 1)
BLOCK = 1024
"""So many points are looked up at a time, lest they leave the cache."""


@dataclass(frozen=True)
class Studio:
    """Background and light. Colours are sRGB; lights are linear factors of a surface's colour.

    key_size: radius of the area light, as a share of its distance. ground_z: where a floor catches shadows, None for no floor.
    """

    top: Colour = (0.965, 0.972, 0.980)
    bottom: Colour = (0.865, 0.880, 0.900)
    key: float = 0.85
    key_size: float = 0.16
    sky: float = 0.52
    fill: float = 0.08
    ground_z: float | None = None
    key_lights: int = 24
    sky_lights: int = 96
    edge_px: float = 1.2
    edge_alpha: float = 0.7


STUDIO = Studio()


@dataclass(frozen=True, eq=False)
class Lighting:
    """Lights as rows [direction (3), weight, projection (12)], and what each sees of the solids: inverse depth (L, M, M).

    key_panes, sky_panes: what one in GLASS_SHARE sees of the see-through solids. offset: how far a lookup starts off the surface, metres.
    eye_light (3,): the direction of the fill light. centre (3,), radius: a ball around the solids.
    """

    key: Float32
    key_maps: Float32
    key_panes: Float32
    key_offset: float
    sky: Float32
    sky_maps: Float32
    sky_panes: Float32
    sky_offset: float
    eye_light: Array
    centre: Array
    radius: float

    @staticmethod
    def around(scene: Surfaces, panes: Surfaces, T_world_camera: Array, studio: Studio) -> Lighting:
        """Lights for a scene seen from a camera: the key light from above its left shoulder, the sky from everywhere."""
        low, high = _extent(join(scene, panes))
        centre, radius = (low + high) / 2, float(np.linalg.norm(high - low) / 2) + 1e-3
        right, back = T_world_camera[:3, 0], T_world_camera[:3, 2] * [-1.0, -1.0, 0.0]
        back = back / max(float(np.linalg.norm(back)), 1e-9)
        toward = np.array([0, 0, 1.0]) - 0.55 * right + 0.50 * back
        toward /= np.linalg.norm(toward)
        side = np.cross(toward, [0.31, 0.17, 0.93])
        side /= np.linalg.norm(side)
        n, golden = studio.key_lights, np.pi * (3 - np.sqrt(5))
        r, turn = np.sqrt((np.arange(n) + 0.5) / n) * studio.key_size, np.arange(n) * golden
        key_towards = toward + (r * np.cos(turn))[:, None] * side + (r * np.sin(turn))[:, None] * np.cross(toward, side)
        n = studio.sky_lights
        height, turn = 1 - 2 * (np.arange(n) + 0.5) / n, np.arange(n) * golden
        flat = np.sqrt(1 - height**2)
        sky_towards = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], -1)
        radiance = np.where(height > 0, 0.75 + 0.5 * height, 0.42)
        key = _lights(centre, radius, key_towards, np.ones(len(key_towards)), KEY_PX)
        sky = _lights(centre, radius, sky_towards, radiance, SKY_PX)
        eye = back + 0.4 * right + np.array([0, 0, 0.25])
        texel = 2 * radius / np.array([KEY_PX, SKY_PX])
        return Lighting(
            key,
            _shadows(scene, centre, radius, key, KEY_PX),
            _shadows(panes, centre, radius, key[::GLASS_SHARE], KEY_PX) if studio.ground_z is not None else np.zeros((0, 1, 1), np.float32),
            1.5 * texel[0],
            sky,
            _shadows(scene, centre, radius, sky, SKY_PX),
            _shadows(panes, centre, radius, sky[::GLASS_SHARE], SKY_PX) if studio.ground_z is not None else np.zeros((0, 1, 1), np.float32),
            1.5 * texel[1],
            eye / np.linalg.norm(eye),
            centre,
            radius,
        )


def _extent(scene: Surfaces) -> tuple[Array, Array]:
    """Lower and upper corner (3,) of a box around all solids; the unit cube if there is none."""
    points = [np.zeros((0, 3))]
    for k in range(len(scene.kind)):
        own = scene.vertices[scene.first_vertex[k] : scene.first_vertex[k + 1]]
        points.append(apply(scene.T[k], box_corners(scene.half[k]) if scene.kind[k] in (BOX, CYLINDER) else own))
    every = np.concatenate(points)
    return (every.min(0), every.max(0)) if len(every) else (np.zeros(3), np.ones(3))


def _eye_of(light: Float32 | Array, centre: Array, radius: float) -> Array:
    return look_at(centre + 5 * radius * light[:3].astype(float), centre)


def _focal(size: int) -> float:
    """The ball of the solids, seen from 5 radii away, fills the shadow image."""
    return float(size / 2 * np.sqrt(24) * 0.98)


def _lights(centre: Array, radius: float, towards: Array, weights: Array, size: int) -> Float32:
    """Lights (L, 16) far away in the directions `towards` (L, 3)."""
    lights, f, middle = np.zeros((len(towards), 16)), _focal(size), (size - 1) / 2
    K = np.array([[f, 0, middle], [0, f, middle], [0, 0, 1]])
    for light, toward, weight in zip(lights, towards, weights):
        light[:3], light[3] = toward / np.linalg.norm(toward), weight
        light[4:] = (K @ inverse(_eye_of(light, centre, radius))[:3]).ravel()
    return lights.astype(np.float32)


def _shadows(s: Surfaces, centre: Array, radius: float, lights: Float32, size: int) -> Float32:
    """What each light sees: inverse depth (L, M, M), with an empty border."""
    maps, f, middle = np.zeros((len(lights), size, size), np.float32), _focal(size), (size - 1) / 2

    def draw(i: int) -> None:
        w, _ = inverse_depth(s, _eye_of(lights[i], centre, radius), Intrinsics(size, size, f, f, middle, middle))
        maps[i, 1:-1, 1:-1] = w[1:-1, 1:-1]

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(draw, range(len(lights))))
    return maps


@jit_entry
def points_seen(
    T: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    w: Float32,
    normals: Float32,
    share: int,
    factor: int,
    places: Int,
    points: Float32,
) -> int:
    """Gather position and normal, points (6, :), of what one sample of each pixel sees, and its place in the image; returns how many."""
    n = 0
    for v in range(share // factor, w.shape[0], factor):
        for u in range(share % factor, w.shape[1], factor):
            if w[v, u] > 0.0:
                a, b, depth = (u - cx) / fx, (v - cy) / fy, 1.0 / w[v, u]
                for r in range(3):
                    points[r, n] = T[r, 3] + (T[r, 0] * a + T[r, 1] * b + T[r, 2]) * depth
                    points[3 + r, n] = normals[v, u, r]
                places[n] = v * w.shape[1] + u
                n += 1
    return n


@jit_entry
def scatter(places: Int, sums: Float32, factor: float, column: int, light: Float32) -> None:
    """Put sums (2, N), times a factor, into two columns of light (·, 4) at N places."""
    times = np.float32(factor)
    for i in range(sums.shape[1]):
        light[places[i], column], light[places[i], column + 1] = times * sums[0, i], times * sums[1, i]


def look_up(points: Float32, lights: Float32, maps: Float32, share: int, shares: int, offset: float, sums: Float32) -> int:
    """Add up, over every `shares`-th light, cosine times weight: sums (2, N) of what arrives at the first N points (6, :), and of what is
    sent; returns how many lights that were. A point is lit where the light sees nothing nearer, blended between the four pixels around it.
    """
    _look_up(points, lights, maps.reshape(len(maps), -1), maps.shape[2], share, shares, offset, np.empty(BLOCK, np.float32), sums)
    return len(range(share, len(lights), shares))


@partial(jit_entry, fastmath=("contract", "nsz", "reassoc"))
def _look_up(
    points: Float32,
    lights: Float32,
    pixels: Float32,
    width: int,
    share: int,
    shares: int,
    out: float,
    cosine: Float32,
    sums: Float32,
) -> None:
    """Single precision and no branches, so that the compiler takes many points at once."""
    size, n = np.uint64(width), sums.shape[1]
    one, zero, most, offset = np.float32(1.0), np.float32(0.0), np.float32(width - 1.001), np.float32(out)
    block = cosine.shape[0]
    for start in range(0, n, block):
        end = min(start + block, n)
        px, py, pz = points[0, start:end], points[1, start:end], points[2, start:end]
        nx, ny, nz = points[3, start:end], points[4, start:end], points[5, start:end]
        arrived, sent = sums[0, start:end], sums[1, start:end]
        for i in range(share, lights.shape[0], shares):
            image, row_of = pixels[i], lights[i]
            l0, l1, l2, weight, a0, a1, a2, a3 = row_of[0], row_of[1], row_of[2], row_of[3], row_of[4], row_of[5], row_of[6], row_of[7]
            b0, b1, b2, b3, c0, c1, c2, c3 = row_of[8], row_of[9], row_of[10], row_of[11], row_of[12], row_of[13], row_of[14], row_of[15]
            total = zero
            for j in range(end - start):
                facing = (nx[j] * l0 + ny[j] * l1 + nz[j] * l2) * weight
                cosine[j] = facing if facing > zero else zero
                total += cosine[j]
            if total == zero:
                continue
            for j in range(end - start):
                x, y, z = px[j] + nx[j] * offset, py[j] + ny[j] * offset, pz[j] + nz[j] * offset
                w = one / (c0 * x + c1 * y + c2 * z + c3)
                u, v = (a0 * x + a1 * y + a2 * z + a3) * w, (b0 * x + b1 * y + b2 * z + b3) * w
                u, v = u if u > zero else zero, v if v > zero else zero
                u, v = u if u < most else most, v if v < most else most
                column, row = np.int32(u), np.int32(v)
                a, b = v - np.float32(row), u - np.float32(column)
                at = np.uint64(row) * size + np.uint64(column)
                lit00 = one if image[at] <= w else zero
                lit01 = one if image[at + np.uint64(1)] <= w else zero
                lit10 = one if image[at + size] <= w else zero
                lit11 = one if image[at + size + np.uint64(1)] <= w else zero
                upper, lower = lit00 + b * (lit01 - lit00), lit10 + b * (lit11 - lit10)
                arrived[j] += cosine[j] * (upper + a * (lower - upper))
                sent[j] += cosine[j]


def ground_shadow(lighting: Lighting, studio: Studio) -> Float32:
    """How dark (M, M) a floor at ground_z is, 0 to 1, on a grid over ± GROUND_REACH radii around the solids: rows along y, columns along x.

    See-through solids cast a faint shadow, and keep that of what they hold.
    """
    if studio.ground_z is None:
        return np.zeros((0, 0), np.float32)
    steps = np.linspace(-1, 1, GROUND_PX) * GROUND_REACH * lighting.radius
    points = np.zeros((6, GROUND_PX**2), np.float32)
    points[0], points[1] = np.tile(lighting.centre[0] + steps, GROUND_PX), np.repeat(lighting.centre[1] + steps, GROUND_PX)
    points[2], points[5] = studio.ground_z, 1
    dark = []
    for one_in, key_maps, sky_maps in ((1, lighting.key_maps, lighting.sky_maps), (GLASS_SHARE, lighting.key_panes, lighting.sky_panes)):
        key, sky = np.zeros((2, points.shape[1]), np.float32), np.zeros((2, points.shape[1]), np.float32)
        n_key = look_up(points, lighting.key[::one_in], key_maps, 0, 1, lighting.key_offset, key)
        n_sky = look_up(points, lighting.sky[::one_in], sky_maps, 0, 1, lighting.sky_offset, sky)
        light = key * np.float32(studio.key / max(n_key, 1)) + sky * np.float32(4 * studio.sky / max(n_sky, 1))
        dark.append(1 - light[0] / np.maximum(light[1], np.float32(1e-6)))
    return np.asarray(dark[0] * (1 - dark[1]) + 0.30 * dark[1], np.float32).reshape(GROUND_PX, GROUND_PX)
