"""Shaded stills from the raycaster: a soft studio, no display and no graphics card.

One area light casts soft shadows, a sky of many weak lights darkens corners and contacts; both look up shadow images that the raycaster
draws from where the lights stand. Each of a pixel's samples asks another share of the lights. See-through solids are laid over what is
behind them, far ones first, and get their edges drawn; polylines are hidden by solids, but shine through faintly.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.geometry import BOX, CYLINDER, HULL
from kinematics.jit.cache_files import njit
from kinematics.shapes import Shape, box_corners, convex_parts
from kinematics.transforms import Array, apply, inverse
from perception.camera import Intrinsics, look_at
from perception.rendering.raycast import MESH, Ids, Int, Mesh, Surfaces, _normals, _owner, inverse_depth, join, surfaces

Colour = tuple[float, float, float]
Float32 = NDArray[np.float32]
Image = NDArray[np.uint8]

TARGET_COLOUR: Colour = (0.91, 0.27, 0.10)
PALETTE: tuple[Colour, ...] = (
    (0.18, 0.42, 0.70),
    (0.95, 0.78, 0.27),
    (0.16, 0.58, 0.48),
    (0.51, 0.36, 0.63),
    (0.47, 0.75, 0.90),
    (0.55, 0.60, 0.22),
    (0.86, 0.62, 0.76),
    (0.13, 0.24, 0.42),
    (0.72, 0.85, 0.62),
    (0.48, 0.40, 0.36),
)
"""Ten colours that differ in lightness as well as in hue, after Okabe and Ito and P. Tol, without the reds that mark the target."""
WALL_COLOUR: Colour = (0.62, 0.70, 0.80)
KEY_PX, SKY_PX = 640, 256
"""Width of the shadow images of one light."""
GROUND_PX, GROUND_REACH = 288, 2.0
"""The grid on which shadows on the floor are computed, and how far it goes, in radii of the scene."""
GLASS_SHARE = 4
"""One in so many of the lights casts the faint shadows of see-through solids."""
BAND_SAMPLES = 600_000
"""An image is drawn in bands of so many samples: fewer ask for all solids too often, more take too much memory."""
THREADS = min(8, os.cpu_count() or 1)


@dataclass(frozen=True, eq=False)
class Item:
    """A solid to be drawn: shape at T_world_item (4, 4), as `raycast.surfaces` takes it; sRGB colour, 0 to 1; alpha below 1: see-through.

    crease_rad: faces of hulls and meshes that meet at a smaller angle than this look like one curved surface.
    """

    shape: Shape | Mesh | Array
    T_world_item: Array
    colour: Colour
    alpha: float = 1.0
    gloss: float = 0.25
    crease_rad: float = 0.6


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


def shade(
    items: Sequence[Item],
    T_world_camera: Array,
    intrinsics: Intrinsics,
    polylines: Sequence[Polyline] = (),
    *,
    studio: Studio = STUDIO,
    supersampling: int = 2,
) -> Image:
    """Draw a still (H, W, 3), 8-bit sRGB, as the camera at T_world_camera (4, 4) sees it. The same input gives the same bytes."""
    still = _Still.of(items, polylines, np.ascontiguousarray(T_world_camera, float), studio, supersampling)
    fine = intrinsics.scaled(supersampling)
    rows = max(1, BAND_SAMPLES // (intrinsics.width * supersampling**2))

    def band_from(v: int) -> Image:
        height = min(rows, intrinsics.height - v) * supersampling
        band = Intrinsics(fine.width, height, fine.fx, fine.fy, fine.cx, fine.cy - v * supersampling)
        background = _background(band, v * supersampling / fine.height, height / fine.height, studio)
        return _develop(_shade_band(still, band, background), supersampling)

    with ThreadPoolExecutor(THREADS) as pool:  # compiled code holds no lock
        return np.concatenate(list(pool.map(band_from, range(0, intrinsics.height, rows))))


@dataclass(frozen=True, eq=False)
class _Still:
    """What all bands of an image share. colours (I, 4): linear, and gloss; glass (G, 4): linear, and alpha; one of the panes each."""

    scene: Surfaces
    corner_normals: Array
    colours: Array
    panes: tuple[Surfaces, ...]
    glass: Array
    edges: tuple[Polyline, ...]
    polylines: tuple[Polyline, ...]
    T_world_camera: Array
    lighting: _Lighting
    ground_shadow: Float32
    studio: Studio
    factor: int

    @staticmethod
    def of(items: Sequence[Item], polylines: Sequence[Polyline], T_world_camera: Array, studio: Studio, factor: int) -> _Still:
        solid, clear = [i for i in items if i.alpha >= 1], [i for i in items if i.alpha < 1]
        scene, panes = _pack(solid), _pack(clear)
        lighting = _Lighting.around(scene, panes, T_world_camera, studio)
        edges = [
            Polyline(e, (0.55 * i.colour[0], 0.6 * i.colour[1], 0.68 * i.colour[2]), studio.edge_px, 0.0, 0.0)
            for i in clear
            for e in _edges(i)
        ]
        return _Still(
            scene,
            _corner_normals(scene, np.array([i.crease_rad for i in solid])),
            np.array([[*_linear(np.array(i.colour)), i.gloss] for i in solid]).reshape(-1, 4),
            tuple(_pack([i]) for i in clear),
            np.array([[*_linear(np.array(i.colour)), i.alpha] for i in clear]).reshape(-1, 4),
            tuple(edges),
            tuple(polylines),
            T_world_camera,
            lighting,
            _ground_shadow(lighting, studio),
            studio,
            factor,
        )


def _shade_band(still: _Still, band: Intrinsics, out: Float32) -> Float32:
    """Linear colours (h, w, 3) of the samples of a few rows, drawn over the background `out`."""
    s, lighting, T_world_camera = still.scene, still.lighting, still.T_world_camera
    T_camera_world = inverse(T_world_camera)
    camera = (band.fx, band.fy, band.cx, band.cy)
    w, primitive, normals = _draw_with_normals(s, T_world_camera, still.corner_normals, band)
    if still.studio.ground_z is not None and len(s.kind):
        reach = GROUND_REACH * lighting.radius
        _shade_ground(T_world_camera, *camera, w, still.studio.ground_z, lighting.centre, reach, still.ground_shadow, out)
    light = _illuminate(still, band, w.astype(np.float32), normals)
    _shade_solids(
        s, T_world_camera, *camera, w, primitive, normals, still.colours, light, lighting.key[0], lighting.eye_light, still.studio.fill, out
    )
    for lines, alpha in ((still.edges, still.studio.edge_alpha), (still.polylines, 1.0)):
        if lines:
            _lay_lines(lines, T_camera_world, band, still.factor, alpha, w, out)
    if still.panes:
        layers, lights = np.zeros((len(still.panes), *w.shape), np.float32), np.zeros((len(still.panes), *w.shape), np.float32)
        coarse = band.scaled(1 / still.factor)  # a pane's border lies below its edge, which is a line
        for i, pane in enumerate(still.panes):
            pane_w, _, pane_normals = _draw_with_normals(pane, T_world_camera, np.zeros((0, 3, 3)), coarse)
            light = np.zeros(pane_w.shape, np.float32)
            _light_glass(pane_normals, lighting.key[0, :3], np.float32(still.studio.key), np.float32(still.studio.sky), light)
            layers[i], lights[i] = _enlarged(pane_w, still.factor), _enlarged(light, still.factor)
        layers[layers <= w] = 0.0
        _lay_glass(layers, lights, still.glass, out)
    return out


def _enlarged(image: Array | Float32, factor: int) -> Array | Float32:
    return np.repeat(np.repeat(image, factor, 0), factor, 1)


def _draw_with_normals(s: Surfaces, T_world_camera: Array, corner_normals: Array, band: Intrinsics) -> tuple[Array, Ids, Float32]:
    w, primitive = inverse_depth(s, T_world_camera, band)
    normals = np.zeros((*w.shape, 3), np.float32)
    _normals(s, T_world_camera, band.fx, band.fy, band.cx, band.cy, w, primitive, corner_normals, normals)
    return w, primitive, normals


def _illuminate(still: _Still, band: Intrinsics, w: Float32, normals: Float32) -> Float32:
    """Light (h, w, 4) on what is seen at 1 / depth w (h, w): key and sky, each as it is and as it were with nothing in the way."""
    lighting, light = still.lighting, np.zeros((*w.shape, 4), np.float32)
    camera = (band.fx, band.fy, band.cx, band.cy)
    places, points = np.empty(w.size, np.int64), np.empty((6, w.size), np.float32)
    for share in range(still.factor**2):
        n = _points(still.T_world_camera, *camera, w, normals, share, still.factor, places, points)
        for column, lights, maps, offset, factor in (
            (0, lighting.key, lighting.key_maps, lighting.key_offset, still.studio.key),
            (2, lighting.sky, lighting.sky_maps, lighting.sky_offset, 4 * still.studio.sky),
        ):
            sums = np.zeros((2, n), np.float32)
            asked = _look_up(points, lights, maps, share, still.factor**2, np.float32(offset), sums)
            _scatter(places, sums, np.float32(factor / max(asked, 1)), column, light)
    return light


def _pack(items: Sequence[Item]) -> Surfaces:
    return surfaces([i.shape for i in items], np.array([i.T_world_item for i in items]).reshape(-1, 4, 4))


def _linear(srgb: Array) -> Array:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _background(band: Intrinsics, top: float, height: float, studio: Studio) -> Float32:
    """Rows of a gradient from the image's top to its bottom, a little lighter in the middle; top and height are shares of the image's."""
    y = top + height * (np.arange(band.height) + 0.5) / band.height
    x = (np.arange(band.width) + 0.5) / band.width
    first, last = _linear(np.array(studio.top)), _linear(np.array(studio.bottom))
    blend = (y * y * (3 - 2 * y))[:, None, None]
    glow = 0.05 * np.exp(-(((x[None] - 0.5) / 0.45) ** 2 + ((y[:, None] - 0.45) / 0.45) ** 2))[..., None] - 0.02
    return np.asarray((first + (last - first) * blend) * (1 + glow), np.float32)


def _develop(samples: Float32, factor: int) -> Image:
    """Average the samples, let the highlights roll off softly, and encode as sRGB."""
    h, w, _ = samples.shape
    x = _roll_off(samples).reshape(h // factor, factor, w // factor, factor, 3).mean((1, 3))
    return (_encode(x) * 255 + 0.5).astype(np.uint8)


def _roll_off(x: Float32) -> Float32:
    """Linear up to 0.8, then ever slower towards 1."""
    over = np.maximum(x - 0.8, 0)
    return np.asarray(np.minimum(x, 0.8) + 0.2 * over / (over + 0.2), np.float32)


def _encode(x: Float32) -> Float32:
    return np.asarray(np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055), np.float32)


@dataclass(frozen=True, eq=False)
class _Lighting:
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
    def around(scene: Surfaces, panes: Surfaces, T_world_camera: Array, studio: Studio) -> _Lighting:
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
        return _Lighting(
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


def _focal(radius: float, size: int) -> float:
    """The ball of the solids, seen from 5 radii away, fills the shadow image."""
    return float(size / 2 * np.sqrt(24) * 0.98)


def _lights(centre: Array, radius: float, towards: Array, weights: Array, size: int) -> Float32:
    """Lights (L, 16) far away in the directions `towards` (L, 3)."""
    lights, f, middle = np.zeros((len(towards), 16)), _focal(radius, size), (size - 1) / 2
    K = np.array([[f, 0, middle], [0, f, middle], [0, 0, 1]])
    for light, toward, weight in zip(lights, towards, weights):
        light[:3], light[3] = toward / np.linalg.norm(toward), weight
        light[4:] = (K @ inverse(_eye_of(light, centre, radius))[:3]).ravel()
    return lights.astype(np.float32)


def _shadows(s: Surfaces, centre: Array, radius: float, lights: Float32, size: int) -> Float32:
    """What each light sees: inverse depth (L, M, M), with an empty border."""
    maps, f, middle = np.zeros((len(lights), size, size), np.float32), _focal(radius, size), (size - 1) / 2

    def draw(i: int) -> None:
        w, _ = inverse_depth(s, _eye_of(lights[i], centre, radius), Intrinsics(size, size, f, f, middle, middle))
        maps[i, 1:-1, 1:-1] = w[1:-1, 1:-1]

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(draw, range(len(lights))))
    return maps


@njit(cache=True, nogil=True)
def _points(
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


@njit(cache=True, nogil=True)
def _scatter(places: Int, sums: Float32, factor: np.float32, column: int, light: Float32) -> None:
    flat = light.reshape(-1, 4)
    for i in range(sums.shape[1]):
        flat[places[i], column], flat[places[i], column + 1] = factor * sums[0, i], factor * sums[1, i]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
def _look_up(points: Float32, lights: Float32, maps: Float32, share: int, shares: int, offset: np.float32, sums: Float32) -> int:
    """Add up, over every `shares`-th light, cosine times weight: sums (2, N) of what arrives at the first N points (6, :), and of what is
    sent; returns how many lights that were.

    A point is lit where the light sees nothing nearer, blended between the four pixels around it. Single precision and no branches, so
    that the compiler takes many points at once.
    """
    size, pixels, n = np.uint64(maps.shape[2]), maps.reshape(maps.shape[0], -1), sums.shape[1]
    one, zero, most = np.float32(1.0), np.float32(0.0), np.float32(maps.shape[2] - 1.001)
    block = 1024
    cosine = np.empty(block, np.float32)
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
    return len(range(share, lights.shape[0], shares))


def _ground_shadow(lighting: _Lighting, studio: Studio) -> Float32:
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
        n_key = _look_up(points, lighting.key[::one_in], key_maps, 0, 1, np.float32(lighting.key_offset), key)
        n_sky = _look_up(points, lighting.sky[::one_in], sky_maps, 0, 1, np.float32(lighting.sky_offset), sky)
        light = key * np.float32(studio.key / max(n_key, 1)) + sky * np.float32(4 * studio.sky / max(n_sky, 1))
        dark.append(1 - light[0] / np.maximum(light[1], np.float32(1e-6)))
    return np.asarray(dark[0] * (1 - dark[1]) + 0.30 * dark[1], np.float32).reshape(GROUND_PX, GROUND_PX)


@njit(cache=True, nogil=True)
def _shade_ground(
    T: Array, fx: float, fy: float, cx: float, cy: float, w: Array, z: float, centre: Array, reach: float, shadow: Float32, out: Float32
) -> None:
    """Darken the background where the floor at height z lies in shadow; the floor itself can't be seen."""
    size = shadow.shape[0]
    drop = z - T[2, 3]
    for v in range(w.shape[0]):
        for u in range(w.shape[1]):
            a, b = (u - cx) / fx, (v - cy) / fy
            down = T[2, 0] * a + T[2, 1] * b + T[2, 2]
            if w[v, u] > 0.0 or drop >= 0.0 or down >= 0.0:
                continue
            depth = drop / down
            x = (T[0, 3] + (T[0, 0] * a + T[0, 1] * b + T[0, 2]) * depth - centre[0]) / reach
            y = (T[1, 3] + (T[1, 0] * a + T[1, 1] * b + T[1, 2]) * depth - centre[1]) / reach
            away = x * x + y * y
            if away >= 1.0:
                continue
            p, q = (x + 1.0) / 2.0 * (size - 1), (y + 1.0) / 2.0 * (size - 1)
            j, i = min(int(p), size - 2), min(int(q), size - 2)
            p, q = p - j, q - i
            dark = (1.0 - q) * ((1.0 - p) * shadow[i, j] + p * shadow[i, j + 1]) + q * (
                (1.0 - p) * shadow[i + 1, j] + p * shadow[i + 1, j + 1]
            )
            for c in range(3):
                out[v, u, c] *= 1.0 - 0.62 * dark * (1.0 - away) ** 2


@njit(cache=True, nogil=True)
def _shade_solids(
    s: Surfaces,
    T: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    w: Array,
    primitive: Ids,
    normals: Float32,
    colours: Array,
    light: Float32,
    key: Array,
    eye_light: Array,
    fill: float,
    out: Float32,
) -> None:
    """Lambert's law, Blinn's highlight of the key light, and a weak sheen where a surface turns away from the eye."""
    last, name = np.int32(-1), 0
    for v in range(w.shape[0]):
        for u in range(w.shape[1]):
            i = primitive[v, u]
            if i < 0:
                continue
            if i != last:
                last, name = i, s.id[_owner(s, i)]
            a, b = (u - cx) / fx, (v - cy) / fy
            ex, ey, ez = (
                -(T[0, 0] * a + T[0, 1] * b + T[0, 2]),
                -(T[1, 0] * a + T[1, 1] * b + T[1, 2]),
                -(T[2, 0] * a + T[2, 1] * b + T[2, 2]),
            )
            length = np.sqrt(ex * ex + ey * ey + ez * ez)
            ex, ey, ez = ex / length, ey / length, ez / length
            nx, ny, nz = float(normals[v, u, 0]), float(normals[v, u, 1]), float(normals[v, u, 2])
            lit, full, sky = light[v, u, 0], light[v, u, 1], light[v, u, 2]
            diffuse = lit + sky + fill * max(nx * eye_light[0] + ny * eye_light[1] + nz * eye_light[2], 0.0)
            hx, hy, hz = ex + key[0], ey + key[1], ez + key[2]
            shine = max((nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz), 0.0) ** 40
            graze = (1.0 - min(max(nx * ex + ny * ey + nz * ez, 0.0), 1.0)) ** 4
            extra = colours[name, 3] * (0.8 * shine * (lit / full if full > 1e-6 else 0.0) + 0.5 * graze * sky)
            for c in range(3):
                out[v, u, c] = colours[name, c] * diffuse + extra


@njit(cache=True, nogil=True)
def _light_glass(normals: Float32, key_direction: Float32, key: np.float32, sky: np.float32, light: Float32) -> None:
    """The light (h, w) on surfaces that lie in no shadow: the key light, and a sky that is brighter above."""
    for v in range(light.shape[0]):
        for u in range(light.shape[1]):
            n = normals[v, u]
            facing = n[0] * key_direction[0] + n[1] * key_direction[1] + n[2] * key_direction[2]
            light[v, u] = key * max(facing, np.float32(0.0)) + sky * (np.float32(0.71) + np.float32(0.29) * n[2])


@njit(cache=True, nogil=True)
def _lay_glass(layers: Float32, lights: Float32, glass: Array, out: Float32) -> None:
    """Blend see-through solids (G, h, w) over the image, the farthest first. No shadow falls on them: it would look like dirt."""
    n = layers.shape[0]
    order = np.empty(n, np.int64)
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            count = 0
            for i in range(n):
                if layers[i, v, u] > 0.0:
                    j = count
                    while j > 0 and layers[order[j - 1], v, u] > layers[i, v, u]:
                        order[j] = order[j - 1]
                        j -= 1
                    order[j] = i
                    count += 1
            for j in range(count):
                i = order[j]
                light = 0.35 + 0.65 * lights[i, v, u]
                for c in range(3):
                    out[v, u, c] += glass[i, 3] * (glass[i, c] * light - out[v, u, c])


def _edges(item: Item) -> list[Array]:
    """The sharp edges of a see-through solid, as lines (2, 3) in the world."""
    if isinstance(item.shape, Mesh):
        return []
    parts = (item.shape,) if isinstance(item.shape, np.ndarray) else convex_parts(item.shape)
    lines = []
    for part in parts:
        packed = surfaces([part], item.T_world_item[None])
        corners = apply(item.T_world_item, packed.vertices)
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


def _lay_lines(
    lines: Sequence[Polyline], T_camera_world: Array, band: Intrinsics, factor: int, alpha: float, w: Array, out: Float32
) -> None:
    """Draw lines over the samples, hidden by what is nearer; what a line covers is afterwards as near as the line."""
    shape = (band.height, band.width)
    cover, halo, near = np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape)
    colour, hidden = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32)
    for line in lines:
        colours = _linear(np.broadcast_to(np.asarray(line.colour, float), (len(line.points), 3)))
        width, rim = line.width_px * factor / 2, line.halo_px * factor
        points = apply(T_camera_world, np.asarray(line.points, float))
        _draw_line(points, colours, width, rim, line.hidden, band.fx, band.fy, band.cx, band.cy, cover, halo, near, hidden, colour)
    _blend_lines(cover, halo, near, hidden, colour, alpha, w, out)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


def _corner_normals(scene: Surfaces, crease_rad: Array) -> Array:
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
        _blend_normals(corners, place, by_place // 3, first, float(np.cos(crease_rad[scene.id[k]])), out)
    return normals


def _same_places(points: Array) -> Int:
    """A number (V,) for each point, the same for points at the same place (to 1 µm)."""
    grid = np.round((points - points.min(0, initial=0.0)) * 1e6).astype(np.int64)
    _, number = np.unique((grid[:, 0] * 73_856_093) ^ (grid[:, 1] * 19_349_663) ^ (grid[:, 2] * 83_492_791), return_inverse=True)
    return np.asarray(number, np.int64)


@njit(cache=True, nogil=True)
def _blend_normals(corners: Array, place: Int, face_at: Int, first: Int, least_cosine: float, out: Array) -> None:
    n = corners.shape[0]
    area, unit = np.empty((n, 3)), np.empty((n, 3))
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
