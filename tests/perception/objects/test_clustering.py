"""Objects by geometry alone, piece by piece: normals, contraction, vessels, stacks, and what stands on what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from photographs import CABINET, best_matches, box, can, lifted, photograph, placed, without_masks

from kinematics.scene import Body, object_box
from kinematics.transforms import Array, rotation_about, transform
from perception.camera import DepthNoise, points_in_camera, realsense_d435i
from perception.objects.convexity import contracted, edge_angles
from perception.objects.emptiness import witness
from perception.objects.merging import fitted_circle, occluded_joined, united
from perception.objects.normals import surface_normals
from perception.objects.patches import CELL_M, Cells, surface_patches, touching
from perception.objects.prepared_frames import prepare
from perception.objects.segment import segment
from perception.objects.supports import _lowest, base_heights

ABOVE = ((-0.25, 0.0, 0.45),)
CAMERA = realsense_d435i(640, 480)
NOISE = DepthNoise(axial_1m_m=0.003)


def seen_boxes(bodies: Sequence[Body], noise: DepthNoise | None = NOISE) -> dict[str, Array]:
    frames = photograph(placed(bodies, CABINET), CABINET, noise, eyes=ABOVE, camera=CAMERA)
    return segment(without_masks(frames), CABINET, by="geometry")


def cup(x: float, y: float, radius: float = 0.04, height: float = 0.09, slabs: int = 40) -> list[Body]:
    """A cup of upright slabs around a thin bottom."""
    side = box("side", 0.0, 0.0, [0.004, 2.2 * np.pi * radius / slabs, height])
    around = [
        transform(rotation_about((0, 0, 1), a), [x, y, 0.0]) @ transform(p=[radius, 0, 0]) for a in np.arange(slabs) * 2 * np.pi / slabs
    ]
    return [can("bottom", x, y, radius, 0.014), *(replace(side, T_world_body=T @ side.T_world_body) for T in around)]


@pytest.mark.parametrize("noisy", [False, True])
def test_normals_of_a_slanted_plane_are_the_planes(noisy: bool) -> None:
    normal, rng = np.array([0.3, -0.5, -0.8]) / np.sqrt(0.98), np.random.default_rng(0)
    u, v = np.meshgrid(np.arange(80), np.arange(60))
    f, c = 400.0, np.array([40.0, 30.0])
    rays = np.stack([(u - c[0]) / f, (v - c[1]) / f, np.ones(u.shape)], -1)
    depth = -0.6 / (rays @ (-normal))
    depth = np.where(depth > 0, depth, -depth)
    depth = (depth + noisy * 0.001 * rng.standard_normal(depth.shape)).astype(np.float32)
    found = surface_normals(depth, np.ones(depth.shape, bool), f, f, *c, np.eye(4), 0.008, 0.01, 0.003)
    off = np.degrees(np.arccos(np.clip(np.abs(found[8:-8, 8:-8] @ normal), 0, 1)))
    assert off.max() < (15 if noisy else 0.2)
    assert off.mean() < (4 if noisy else 0.1)
    assert (np.einsum("hwk,hwk->hw", found, points_like(depth, rays)) < 0).all()  # towards the camera


def points_like(depth: Array, rays: Array) -> Array:
    return np.asarray(depth[..., None] * rays)


def test_contraction_leaves_no_two_clusters_that_want_to_be_one() -> None:
    rng = np.random.default_rng(1)
    edges = np.unique(np.sort(rng.integers(0, 60, (300, 2)), axis=1), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]
    weights = rng.normal(-0.1, 1.0, len(edges))
    cluster = contracted(60, edges, weights)
    ends = np.sort(cluster[edges], axis=1)
    for a, b in np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0):
        assert weights[(ends == (a, b)).all(1)].sum() <= 1e-12
    assert 1 < len(np.unique(cluster)) < 60
    assert len(np.unique(contracted(60, edges, -np.abs(weights)))) == 60
    assert np.array_equal(cluster, contracted(60, edges, weights))


def test_patches_without_a_normal_speak_neither_for_a_crease_nor_for_a_face() -> None:
    rng = np.random.default_rng(2)
    points = np.concatenate([rng.uniform([0.2, y, 0.0], [0.24, y + 0.04, 0.05], (200, 3)) for y in (0.0, 0.08)])
    index = np.unique(np.floor(points / CELL_M).astype(np.int64), axis=0)
    cells = Cells(
        (index + 0.5) * CELL_M, np.zeros((len(index), 3)), index - index.min(0), np.arange(len(index)), touching(index - index.min(0))
    )
    patches = surface_patches(cells)
    bend, climb = edge_angles(patches)
    assert not bend.any()
    assert not climb.any()
    frames = photograph([], CABINET, None, eyes=ABOVE, camera=CAMERA)
    seen = witness(prepare(without_masks(frames), CABINET))
    label = np.asarray(cells.points[:, 1] > 0.06, np.int64)
    assert set(occluded_joined(cells, patches, label, seen).tolist()) == {0, 1}


def test_what_is_known_to_be_two_is_not_united_by_way_of_a_third() -> None:
    label = np.array([0, 1, 2, 3])
    assert united(label, [(0, 2), (2, 1), (1, 3)], [(0, 1)]).tolist() == [0, 1, 0, 1]
    assert united(label, [(0, 2), (2, 1)]).tolist() == [0, 0, 0, 1]


def test_a_circle_is_fitted_without_outliers() -> None:
    angle = np.linspace(0, 2.5, 40)
    points = np.column_stack([0.3 + 0.05 * np.cos(angle), -0.1 + 0.05 * np.sin(angle)])
    points[3] += 0.03
    found = fitted_circle(points)
    assert found is not None
    assert found[0] == pytest.approx([0.3, -0.1], abs=1e-3)
    assert found[1] == pytest.approx(0.05, abs=1e-3)
    assert fitted_circle(np.column_stack([angle, angle])) is None


@pytest.mark.parametrize("noise", [None, NOISE], ids=["clean", "noisy"])
def test_a_cup_is_one_object_inside_and_outside(noise: DepthNoise | None) -> None:
    boxes = seen_boxes([*cup(0.2, 0.0), can("beside", 0.25, 0.15)], noise)
    assert len(boxes) == 2
    whole = object_box(placed([can("cup", 0.2, 0.0, 0.042, 0.09)], CABINET)[0])
    held = max(boxes.values(), key=lambda b: -np.abs(b[:2] - whole[:2]).sum())
    assert np.abs(held - whole).max() < 0.012


STACKS = {
    "a slab on a slab": (box("low", 0.25, 0.0, [0.16, 0.2, 0.05], 0.3), lifted(box("high", 0.25, 0.0, [0.1, 0.12, 0.05], 0.5), 0.05)),
    "a can on a box": (box("low", 0.25, 0.0, [0.12, 0.16, 0.08]), lifted(can("high", 0.25, 0.02, 0.03, 0.1), 0.08)),
    "a plank across": (box("low", 0.25, 0.0, [0.08, 0.08, 0.1]), lifted(box("high", 0.25, 0.0, [0.12, 0.24, 0.03], 0.2), 0.1)),
}


@pytest.mark.parametrize("case", STACKS)
def test_what_stands_on_something_ends_there(case: str) -> None:
    bodies = placed(STACKS[case], CABINET)
    boxes = seen_boxes(STACKS[case])
    assert len(boxes) == 2
    tops = sorted(boxes.values(), key=lambda b: b[2] + b[5] / 2)
    for body, found in zip(bodies, tops):
        true = object_box(body)
        assert found[2] - found[5] / 2 == pytest.approx(true[2] - true[5] / 2, abs=0.008)
        assert found[2] + found[5] / 2 == pytest.approx(true[2] + true[5] / 2, abs=0.013)  # a plank hides the top of what carries it
    assert min(best_matches(bodies[1:], boxes)) > 0.7


def test_what_is_hidden_below_stands_on_the_floor() -> None:
    rng = np.random.default_rng(0)
    behind = np.column_stack([rng.uniform(0.30, 0.36, 500), rng.uniform(-0.05, 0.05, 500), rng.uniform(0.12, 0.2, 500)])
    before = np.column_stack([rng.uniform(0.1, 0.2, 500), rng.uniform(-0.05, 0.05, 500), rng.uniform(0.0, 0.12, 500)])
    below = np.column_stack([rng.uniform(0.28, 0.4, 500), rng.uniform(-0.1, 0.1, 500), rng.uniform(0.0, 0.12, 500)])
    assert base_heights({"behind": behind, "before": before}) == {"behind": 0.0, "before": 0.0}
    bases = base_heights({"behind": behind, "below": below})
    assert bases["below"] == 0.0
    assert bases["behind"] == pytest.approx(0.12, abs=0.002)
    stray = np.concatenate([behind, [[0.33, 0.0, 0.003]]])  # a pixel of what is below
    assert base_heights({"behind": stray, "below": below})["behind"] == bases["behind"]


def test_what_is_carried_ends_where_what_carries_it_does_beside_it() -> None:
    """A seam of 8 mm was taken for the lower one's; where nothing of that is seen beside it, its own lowest point is its end."""
    rng = np.random.default_rng(1)
    upper = rng.uniform((0.32, -0.02, 0.108), (0.36, 0.02, 0.2), (4000, 3))
    seam = rng.uniform((0.32, -0.02, 0.1), (0.36, 0.02, 0.108), (400, 3))
    ledge = rng.uniform((0.28, -0.06, 0.1), (0.4, 0.06, 0.1), (800, 3))
    assert base_heights({"upper": upper, "lower": np.concatenate([seam, ledge])})["upper"] == 0.1
    covered = np.concatenate([seam, rng.uniform((0.32, -0.02, 0.0), (0.36, 0.02, 0.1), (800, 3))])
    assert base_heights({"upper": upper, "lower": covered})["upper"] == upper[:, 2].min()


def test_the_foot_of_a_thing_is_its_first_percentile_to_the_digit() -> None:
    rng = np.random.default_rng(2)
    for n in (1, 2, 99, 100, 101, 102, *rng.integers(1, 3000, 40)):
        z = rng.normal(size=(n, 3))[:, 2]
        assert _lowest(z) == np.percentile(z, 1)


def test_one_view_of_a_far_plane_has_no_object() -> None:
    frames = photograph([], CABINET, NOISE, eyes=ABOVE, camera=CAMERA)
    assert np.isfinite(points_in_camera(frames[0].depth, CAMERA)).any()
    assert segment(without_masks(frames), CABINET, by="geometry") == {}
