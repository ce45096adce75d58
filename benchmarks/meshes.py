"""Household meshes as packages ship them, taken apart: parts, protrusion, fill, time; a line each, a Markdown table.

    pip download --no-deps -d wheels pybullet robosuite      # a wheel is a zip archive: nothing needs to be installed
    python benchmarks/meshes.py wheels/*.whl
    python benchmarks/meshes.py wheels/*.whl --against coacd vhacd      (pip install coacd vhacdx)

Each mesh is scaled to 0.12 m. Protrusion is the proof's bound on how far any point of a triangle lies outside the parts, fill the volume
of the parts' union over that of the solid, time CPU seconds of one core. The solid's volume is what the surface encloses; of an open
surface, half a millimetre of skin. --scan adds the duck with a million triangles and a scanner's noise.
"""

from __future__ import annotations

import argparse
import io
import sys
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import trimesh

from kinematics.meshes.containment import largest_protrusion
from kinematics.meshes.cutting import hull_volume
from kinematics.meshes.decomposition import Decomposition, decompose, solid_volume
from kinematics.meshes.inside import fill
from kinematics.meshes.surface import Surface, clean_surface
from kinematics.transforms import Array

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from union_volume import union_volume

SIZE_M = 0.12
MESHES = {
    "mug": "pybullet_data/urdf/mug.obj", "duck": "pybullet_data/duck.obj",
    "torus": "pybullet_data/torus/torus_textured.obj", "tray": "pybullet_data/tray/tray_textured.obj",
    "lego": "pybullet_data/lego/lego.obj", "bottle": "robosuite/models/assets/objects/meshes/bottle.stl",
    "can": "robosuite/models/assets/objects/meshes/can.stl", "lemon": "robosuite/models/assets/objects/meshes/lemon.stl",
    "milk": "robosuite/models/assets/objects/meshes/milk.stl", "bread": "robosuite/models/assets/objects/meshes/bread.stl",
}  # fmt: skip
HOW = Decomposition()


def scanned(surface: Surface) -> Surface:
    """The surface in a million triangles, their corners 0.05 mm off."""
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    while len(mesh.faces) < 1_000_000:
        mesh = mesh.subdivide()
    noise = np.random.default_rng(0).normal(scale=5e-5, size=mesh.vertices.shape)
    return clean_surface(np.asarray(mesh.vertices + noise, float), np.asarray(mesh.faces, np.int64))


def shipped(wheels: Sequence[Path]) -> Iterator[tuple[str, Surface]]:
    """The meshes that the wheels have, scaled."""
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:
            names = set(archive.namelist())
            for name, path in MESHES.items():
                if path in names:
                    mesh = trimesh.load(io.BytesIO(archive.read(path)), file_type=Path(path).suffix[1:], force="mesh", process=False)
                    mesh.merge_vertices(merge_tex=True, merge_norm=True)
                    mesh.apply_scale(SIZE_M / mesh.extents.max())
                    yield name, clean_surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))


def ours(surface: Surface) -> list[Array]:
    return decompose(surface, fill(surface), HOW)


def coacd(surface: Surface) -> list[Array]:
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(surface.vertices, surface.faces), threshold=0.03, max_convex_hull=HOW.parts, seed=0)
    return [np.asarray(vertices, float) for vertices, _ in parts]


def vhacd(surface: Surface) -> list[Array]:
    import vhacdx

    faces = np.c_[np.full(len(surface.faces), 3), surface.faces].ravel().astype(np.uint32)
    parts = vhacdx.compute_vhacd(surface.vertices, faces, maxConvexHulls=HOW.parts, asyncACD=False)
    return [np.asarray(vertices, float) for vertices, _ in parts]


WAYS: dict[str, Callable[[Surface], list[Array]]] = {"ours": ours, "coacd": coacd, "vhacd": vhacd}


def line(name: str, way: str, surface: Surface) -> str:
    begin = time.process_time()
    parts = WAYS[way](surface)
    seconds = time.process_time() - begin
    flat = sum(hull_volume(p) < 1e-13 for p in parts)
    parts = [p for p in parts if hull_volume(p) >= 1e-13]
    out = 1000 * largest_protrusion(surface, parts)
    share = union_volume(parts) / solid_volume(surface, fill(surface), HOW)
    notes = ", ".join(said for said in ("" if surface.closed else "open", f"{flat} flat parts" if flat else "") if said)
    return f"| {name} | {len(surface.faces)} | {way} | {len(parts)} | {out:.2f} | {share:.2f} | {seconds:.1f} | {notes} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheels", nargs="*", type=Path)
    parser.add_argument("--against", nargs="*", choices=[w for w in WAYS if w != "ours"], default=[])
    parser.add_argument("--scan", action="store_true", help="a million triangles, too")
    asked = parser.parse_args()
    print("| mesh | triangles | by | parts | protrusion ≤ mm | fill | CPU s | |\n|---|---|---|---|---|---|---|---|")
    for name, surface in shipped(asked.wheels):
        for way in ("ours", *asked.against):
            print(line(name, way, surface), flush=True)
        if asked.scan and name == "duck":
            print(line("duck, scanned", "ours", scanned(surface)), flush=True)


if __name__ == "__main__":
    main()
