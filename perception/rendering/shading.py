"""Shaded stills from the raycaster: a soft studio, no display and no graphics card.

See-through solids are laid over what is behind them, far ones first, and get their edges drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.jit.decorators import jit_entry
from kinematics.shapes import Shape
from kinematics.transforms import Array, inverse
from perception.camera import Intrinsics
from perception.rendering.colours import Colour, encode, linear, roll_off
from perception.rendering.lighting import (
    GROUND_REACH,
    STUDIO,
    THREADS,
    Lighting,
    Studio,
    ground_shadow,
    look_up,
    points_seen,
    scatter,
)
from perception.rendering.normals import owner, write_normals
from perception.rendering.polylines import Polyline, lay_lines, sharp_edges
from perception.rendering.raycast import inverse_depth
from perception.rendering.smooth_normals import corner_normals
from perception.rendering.surfaces import Ids, Int, Mesh, Surfaces, surfaces

Float32 = NDArray[np.float32]
Image = NDArray[np.uint8]

BAND_SAMPLES = 600_000
"""An image is drawn in bands of so many samples: fewer ask for all solids too often, more take too much memory."""


@dataclass(frozen=True, eq=False)
class Item:
    """A solid to be drawn: shape at T_world_item (4, 4), as `surfaces.surfaces` takes it; sRGB colour, 0 to 1; alpha below 1: see-through.

    crease_rad: faces of hulls and meshes that meet at a smaller angle than this look like one curved surface.
    """

    shape: Shape | Mesh | Array
    T_world_item: Array
    colour: Colour
    alpha: float = 1.0
    gloss: float = 0.25
    crease_rad: float = 0.6


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
    lighting: Lighting
    shadow: Float32
    studio: Studio
    factor: int

    @staticmethod
    def of(items: Sequence[Item], polylines: Sequence[Polyline], T_world_camera: Array, studio: Studio, factor: int) -> _Still:
        solid, clear = [i for i in items if i.alpha >= 1], [i for i in items if i.alpha < 1]
        scene, panes = _pack(solid), _pack(clear)
        lighting = Lighting.around(scene, panes, T_world_camera, studio)
        edges = [
            Polyline(e, (0.55 * i.colour[0], 0.6 * i.colour[1], 0.68 * i.colour[2]), studio.edge_px, 0.0, 0.0)
            for i in clear
            for e in sharp_edges(i.shape, i.T_world_item)
        ]
        return _Still(
            scene,
            corner_normals(scene, np.array([i.crease_rad for i in solid])),
            np.array([[*linear(np.array(i.colour)), i.gloss] for i in solid]).reshape(-1, 4),
            tuple(_pack([i]) for i in clear),
            np.array([[*linear(np.array(i.colour)), i.alpha] for i in clear]).reshape(-1, 4),
            tuple(edges),
            tuple(polylines),
            T_world_camera,
            lighting,
            ground_shadow(lighting, studio),
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
        _shade_ground(T_world_camera, *camera, w, still.studio.ground_z, lighting.centre, reach, still.shadow, out)
    light = _illuminate(still, band, w.astype(np.float32), normals)
    _shade_solids(
        s, T_world_camera, *camera, w, primitive, normals, still.colours, light, lighting.key[0], lighting.eye_light, still.studio.fill, out
    )
    for lines, alpha in ((still.edges, still.studio.edge_alpha), (still.polylines, 1.0)):
        if lines:
            lay_lines(lines, T_camera_world, band, still.factor, alpha, w, out)
    if still.panes:
        layers, lights = np.zeros((len(still.panes), *w.shape), np.float32), np.zeros((len(still.panes), *w.shape), np.float32)
        coarse = band.scaled(1 / still.factor)  # a pane's border lies below its edge, which is a line
        for i, pane in enumerate(still.panes):
            pane_w, _, pane_normals = _draw_with_normals(pane, T_world_camera, np.zeros((0, 3, 3)), coarse)
            light = np.zeros(pane_w.shape, np.float32)
            _light_glass(pane_normals, lighting.key[0, :3], still.studio.key, still.studio.sky, light)
            layers[i], lights[i] = _enlarged(pane_w, still.factor), _enlarged(light, still.factor)
        layers[layers <= w] = 0.0
        _lay_glass(layers, lights, still.glass, np.empty(len(layers), np.int64), out)
    return out


def _enlarged(image: Array | Float32, factor: int) -> Array | Float32:
    return np.repeat(np.repeat(image, factor, 0), factor, 1)


def _draw_with_normals(s: Surfaces, T_world_camera: Array, corner_normals: Array, band: Intrinsics) -> tuple[Array, Ids, Float32]:
    w, primitive = inverse_depth(s, T_world_camera, band)
    normals = np.zeros((*w.shape, 3), np.float32)
    write_normals(s, T_world_camera, band.fx, band.fy, band.cx, band.cy, w, primitive, corner_normals, normals)
    return w, primitive, normals


def _illuminate(still: _Still, band: Intrinsics, w: Float32, normals: Float32) -> Float32:
    """Light (h, w, 4) on what is seen at 1 / depth w (h, w): key and sky, each as it is and as it were with nothing in the way."""
    lighting, light = still.lighting, np.zeros((*w.shape, 4), np.float32)
    camera = (band.fx, band.fy, band.cx, band.cy)
    places, points = np.empty(w.size, np.int64), np.empty((6, w.size), np.float32)
    for share in range(still.factor**2):
        n = points_seen(still.T_world_camera, *camera, w, normals, share, still.factor, places, points)
        for column, lights, maps, offset, factor in (
            (0, lighting.key, lighting.key_maps, lighting.key_offset, still.studio.key),
            (2, lighting.sky, lighting.sky_maps, lighting.sky_offset, 4 * still.studio.sky),
        ):
            sums = np.zeros((2, n), np.float32)
            asked = look_up(points, lights, maps, share, still.factor**2, offset, sums)
            scatter(places, sums, factor / max(asked, 1), column, light.reshape(-1, 4))
    return light


def _pack(items: Sequence[Item]) -> Surfaces:
    return surfaces([i.shape for i in items], np.array([i.T_world_item for i in items]).reshape(-1, 4, 4))


def _background(band: Intrinsics, top: float, height: float, studio: Studio) -> Float32:
    """Rows of a gradient from the image's top to its bottom, a little lighter in the middle; top and height are shares of the image's."""
    y = top + height * (np.arange(band.height) + 0.5) / band.height
    x = (np.arange(band.width) + 0.5) / band.width
    first, last = linear(np.array(studio.top)), linear(np.array(studio.bottom))
    blend = (y * y * (3 - 2 * y))[:, None, None]
    glow = 0.05 * np.exp(-(((x[None] - 0.5) / 0.45) ** 2 + ((y[:, None] - 0.45) / 0.45) ** 2))[..., None] - 0.02
    return np.asarray((first + (last - first) * blend) * (1 + glow), np.float32)


def _develop(samples: Float32, factor: int) -> Image:
    """Average the samples, let the highlights roll off softly, and encode as sRGB."""
    h, w, _ = samples.shape
    x = roll_off(samples).reshape(h // factor, factor, w // factor, factor, 3).mean((1, 3))
    return (encode(x) * 255 + 0.5).astype(np.uint8)


@jit_entry
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


@jit_entry
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
                last, name = i, s.id[owner(s, i)]
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


@jit_entry
def _light_glass(normals: Float32, key_direction: Float32, by_key: float, by_sky: float, light: Float32) -> None:
    """The light (h, w) on surfaces that lie in no shadow: the key light, and a sky that is brighter above."""
    key, sky = np.float32(by_key), np.float32(by_sky)
    for v in range(light.shape[0]):
        for u in range(light.shape[1]):
            n = normals[v, u]
            facing = n[0] * key_direction[0] + n[1] * key_direction[1] + n[2] * key_direction[2]
            light[v, u] = key * max(facing, np.float32(0.0)) + sky * (np.float32(0.71) + np.float32(0.29) * n[2])


@jit_entry
def _lay_glass(layers: Float32, lights: Float32, glass: Array, order: Int, out: Float32) -> None:
    """Blend see-through solids (G, h, w) over the image, the farthest first. No shadow falls on them: it would look like dirt. order (G,):
    scratch."""
    n = layers.shape[0]
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
