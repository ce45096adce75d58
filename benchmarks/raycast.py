"""Depth and instance images at 640 × 480: ours against Embree, in one process, on one core, on the same scenes.

Embree is timed at its best: tree built and rays laid out beforehand, called through embreex without trimesh; for the record also through
trimesh's ray query, as most people call it, and with building the tree. Ours starts from poses, as after every change of a scene.
Depth errors are taken away from silhouettes. Usage: python benchmarks/raycast.py [--repeats 15]. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from trimesh.ray.ray_pyembree import RayMeshIntersector

from kinematics.scene import Cabinet
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import Array, rotation_about, transform
from perception.camera import depth_edges, look_at, ray_directions, realsense_d435i
from perception.rendering.colours import PALETTE, TARGET_COLOUR, WALL_COLOUR
from perception.rendering.lighting import Studio
from perception.rendering.raycast import raycast
from perception.rendering.shading import Item, shade
from perception.rendering.surfaces import Mesh, moved, surfaces

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from ray_tree import cast_rays

CAMERA = realsense_d435i(640, 480)
EYE = look_at(np.array([0.0, 0.1, 0.5]), np.array([0.6, 0.0, 0.3]))


def cabinet_scene(rng: np.random.Generator) -> tuple[list[Shape | Mesh], Array]:
    """Five walls of a cabinet, then ten boxes and cylinders in it."""
    walls = Cabinet(np.array([0.56, 0.86, 0.5]), transform(p=[0.3, 0, 0.1]), 0.03).walls()
    shapes: list[Shape | Mesh] = [w.shape for w in walls]
    T = [w.T_world_body for w in walls]
    for i in range(10):
        height = rng.uniform(0.08, 0.25)
        shapes.append(Box(np.array([*rng.uniform(0.04, 0.08, 2), height])) if i % 2 else Cylinder(rng.uniform(0.02, 0.04), height))
        place = [0.3 + rng.uniform(0.05, 0.5), rng.uniform(-0.38, 0.38), 0.1 + height / 2]
        T.append(transform(rotation_about((0, 0, 1), rng.uniform(0, 3)), place))
    return shapes, np.array(T)


def mesh_scene(rng: np.random.Generator) -> tuple[list[Shape | Mesh], Array]:
    """Ten rings of 10 000 triangles, in the same cabinet."""
    ring = trimesh.creation.torus(0.06, 0.025, major_sections=100, minor_sections=50)
    shapes, T = cabinet_scene(rng)
    turned = np.array([rotation_about(rng.normal(size=3), rng.uniform(0, np.pi)) for _ in range(10)])
    there = transform(turned, rng.uniform([0.4, -0.35, 0.15], [0.8, 0.35, 0.5], (10, 3)))
    return [*shapes[:5], *[Mesh(ring.vertices, ring.faces)] * 10], np.concatenate([T[:5], there])


def triangles(shapes: list[Shape | Mesh], T: Array, sections: int) -> Array:
    """The scene as triangles (F, 3, 3), cylinders as prisms of `sections` sides."""
    corners = []
    for shape, t in zip(shapes, T):
        if isinstance(shape, Box):
            mesh = trimesh.creation.box(shape.size_m)
        elif isinstance(shape, Cylinder):
            mesh = trimesh.creation.cylinder(shape.radius_m, shape.height_m, sections=sections)
        else:
            mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
        corners.append(mesh.apply_transform(t).triangles)
    return np.concatenate(corners)


def median_ms(call: Callable[[], object], repeats: int, clock: Callable[[], float] = time.perf_counter) -> float:
    times = []
    for _ in range(repeats):
        start = clock()
        call()
        times.append(clock() - start)
    return round(1e3 * float(np.median(times)), 3)


def compare(shapes: list[Shape | Mesh], T: Array, repeats: int) -> dict[str, float]:
    packed = surfaces(shapes, T)
    rays = np.ascontiguousarray((ray_directions(CAMERA) @ EYE[:3, :3].T).reshape(-1, 3))
    origins = np.tile(EYE[:3, 3], (len(rays), 1))
    o32, d32 = origins.astype(np.float32), rays.astype(np.float32)

    def build(sections: int) -> EmbreeScene:
        scene = EmbreeScene()
        TriangleMesh(scene, triangles(shapes, T, sections).astype(np.float32))
        scene.run(o32[:1], d32[:1])
        return scene

    coarse, fine = build(64), build(512)
    whole = triangles(shapes, T, 64)
    mesh = trimesh.Trimesh(whole.reshape(-1, 3), np.arange(3 * len(whole)).reshape(-1, 3), process=False)
    through_trimesh = RayMeshIntersector(mesh)
    raycast(packed, EYE, CAMERA), cast_rays(packed, origins, rays)  # compiled before the clock starts
    times = {
        "ours_ms": median_ms(lambda: raycast(moved(packed, T), EYE, CAMERA), repeats),
        "ours_with_normals_ms": median_ms(lambda: raycast(moved(packed, T), EYE, CAMERA, normals=True), repeats),
        "embree_ms": median_ms(lambda: coarse.run(o32, d32, output=True), repeats),
        "embree_with_build_ms": median_ms(lambda: build(64).run(o32, d32, output=True), 3),
        "trimesh_ms": median_ms(lambda: through_trimesh.intersects_id(origins, rays, multiple_hits=False, return_locations=True), 3),
        "our_single_rays_ms": median_ms(lambda: cast_rays(packed, origins, rays), 3),
    }
    view, hit = raycast(packed, EYE, CAMERA), fine.run(o32, d32, output=True)
    theirs = np.where(hit["primID"] >= 0, hit["tfar"], 0).astype(np.float32).reshape(view.depth.shape)
    clear = ~depth_edges(theirs, 0.01) & ~depth_edges(view.instance, 0.5) & (theirs > 0)
    error = np.abs(view.depth.astype(float) - theirs)[clear]
    errors = {"depth_error_max_mm": 1e3 * float(error.max()), "depth_error_p50_mm": 1e3 * float(np.median(error))}
    return {**times, "ours_to_embree": round(times["ours_ms"] / times["embree_ms"], 4), **{k: round(v, 6) for k, v in errors.items()}}


def still_ms(shapes: list[Shape | Mesh], T: Array, repeats: int) -> float:
    """A shaded still, 1280 × 960, of the cabinet scene; processor time, as no peer runs beside it."""
    items = [Item(s, t, WALL_COLOUR, 0.18) for s, t in zip(shapes[:5], T[:5])]
    items += [Item(s, t, TARGET_COLOUR if i == 7 else PALETTE[i]) for i, (s, t) in enumerate(zip(shapes[5:], T[5:]))]
    camera = realsense_d435i(1280, 960)
    shade(items, EYE, camera, studio=Studio(ground_z=0.0))
    return median_ms(lambda: shade(items, EYE, camera, studio=Studio(ground_z=0.0)), repeats, time.process_time)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=15)
    repeats = parser.parse_args().repeats
    rng = np.random.default_rng(0)
    simple, meshes = cabinet_scene(rng), mesh_scene(rng)
    figures = {
        "boxes_and_cylinders": compare(*simple, repeats),
        "ten_meshes_of_10000": compare(*meshes, repeats),
        "still_1280x960_cpu_ms": still_ms(*simple, 3),
    }
    for name in ("boxes_and_cylinders", "ten_meshes_of_10000"):
        print(name)
        for key, value in figures[name].items():  # type: ignore[union-attr]
            print(f"  {key:24} {value:10.4f}")
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
