"""The map: what it calls free is free, on scenes of every kind and from anywhere; what was not seen stays unknown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.scene import Body, Cabinet
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import apply, inverse, rotation_about, transform
from perception.camera import DepthNoise, cloud, look_at, realsense_d435i
from perception.mapping import carving
from perception.mapping.revealed import revealed
from perception.mapping.voxels import FREE, OCCUPIED, UNKNOWN, Voxels, clear_rays, unknown_voxels
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import surfaces

CAMERA = realsense_d435i(320, 180)
CABINET = Cabinet(np.array([0.5, 0.7, 0.45]), transform(rotation_about((0, 0, 1), 0.3), [0.3, 0.1, 0.2]), 0.03)
DEEPEST_M = 0.002  # how deep a point of a free voxel may lie within an object


def bodies_in(cabinet: Cabinet, rng: np.random.Generator, n: int) -> list[Body]:
    """Upright boxes and cylinders on the floor, anywhere; they may overlap."""
    out = []
    depth, width, _ = cabinet.size_m
    for i in range(n):
        height = rng.uniform(0.03, 0.25)
        shape: Shape = Box(np.array([*rng.uniform(0.02, 0.12, 2), height])) if i % 2 else Cylinder(rng.uniform(0.01, 0.06), height)
        place = [rng.uniform(0.07, depth - 0.07), rng.uniform(-0.42, 0.42) * width, height / 2]
        T = cabinet.T_world_cabinet @ transform(rotation_about((0, 0, 1), rng.uniform(0, 3)), place)
        out.append(Body(f"b{i}", shape, T))
    return out


def view(bodies: list[Body], T: np.ndarray, noise: DepthNoise | None = None, seed: int = 0) -> np.ndarray:
    solids = [*CABINET.walls(), *bodies]
    depth = raycast(surfaces([b.shape for b in solids], np.array([b.T_world_body for b in solids])), T, CAMERA).depth
    return depth if noise is None else noise.apply(depth, np.random.default_rng(seed))


def camera_pose(rng: np.random.Generator) -> np.ndarray:
    """Somewhere before the cabinet, or under its ceiling, looking in."""
    inside = rng.random() < 0.4
    eye = [rng.uniform(0.02, 0.3), rng.uniform(-0.3, 0.3), 0.4] if inside else [rng.uniform(-0.3, 0), rng.uniform(-0.4, 0.4), 0.3]
    at = [rng.uniform(0.3, 0.5), rng.uniform(-0.35, 0.35), rng.uniform(0, 0.3)]
    return np.asarray(CABINET.T_world_cabinet @ look_at(np.array(eye), np.array(at)))


def depth_inside(body: Body, points: np.ndarray) -> np.ndarray:
    """How deep (N,) points (N, 3) of the world lie within a body; negative outside."""
    p = apply(inverse(body.T_world_body), points)
    if isinstance(body.shape, Cylinder):
        return np.minimum(body.shape.radius_m - np.hypot(p[:, 0], p[:, 1]), body.shape.height_m / 2 - np.abs(p[:, 2]))
    return np.asarray((body.shape.half - np.abs(p)).min(1))


def deepest_free(voxels: Voxels, body: Body) -> float:
    """How deep a corner or a middle of a free voxel, of its edges and faces too, lies within a body, m; negative where none does."""
    at = np.argwhere(voxels.state == FREE)
    near = depth_inside(body, voxels.centres(voxels.state == FREE)) > -np.linalg.norm(voxels.step) / 2  # the others are wholly outside
    offsets = np.array([[x, y, z] for x in (0, 0.5, 1) for y in (0, 0.5, 1) for z in (0, 0.5, 1)])
    points = apply(voxels.T_world_grid, ((at[near, None] + offsets) * voxels.step).reshape(-1, 3))
    return float(depth_inside(body, points).max(initial=-1.0))


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(0, 9), views=st.integers(1, 5))
def test_no_free_voxel_holds_any_part_of_an_object(seed: int, n: int, views: int) -> None:
    rng = np.random.default_rng(seed)
    bodies, voxels = bodies_in(CABINET, rng, n), unknown_voxels(CABINET)
    for _ in range(views):
        T = camera_pose(rng)
        voxels = voxels.fuse(view(bodies, T), CAMERA, T)
    for body in bodies:
        assert deepest_free(voxels, body) < DEEPEST_M


@given(seed=st.integers(0, 2**32 - 1), height=st.integers(1, 70), width=st.integers(1, 90))
def test_levels_hold_the_least_of_their_windows(seed: int, height: int, width: int) -> None:
    """Of pictures of any width, be it less than a vector's or no multiple of it."""
    levels = np.full((carving.LEVELS, height, width), -7, np.float32)
    levels[0] = image = np.random.default_rng(seed).normal(size=(height, width)).astype(np.float32)
    carving.pyramid(levels)
    for k, level in enumerate(levels[1:], 1):
        size = 2**k
        if height < size or width < size:
            assert (level == -7).all()
            continue
        windows = np.lib.stride_tricks.sliding_window_view(image, (size, size)).min((2, 3))
        assert np.array_equal(level[: height - size + 1, : width - size + 1], windows)
        assert (level[height - size + 1 :] == -7).all()
        assert (level[:, width - size + 1 :] == -7).all()


@given(seed=st.integers(0, 2**32 - 1), along_an_axis=st.booleans())
def test_a_ray_is_clear_up_to_what_it_meets(seed: int, along_an_axis: bool) -> None:
    """Ray by ray, from where it enters and leaves the inner space."""
    rng = np.random.default_rng(seed)
    R = np.eye(3)[rng.permutation(3)] if along_an_axis else np.linalg.qr(rng.normal(size=(3, 3)))[0]
    eye, size, (slack, noise) = rng.uniform(-0.4, 0.6, 3), rng.uniform(0.3, 0.8, 3), rng.uniform(0, 0.02, 2)
    depth = np.where(rng.random((20, 35)) < 0.1, 0.0, rng.uniform(-0.1, 1.5, (20, 35))).astype(np.float32)
    clear = np.empty_like(depth)
    carving.clear_depth(depth, 30.0, 28.0, 17.0, 9.0, R, eye, size, slack, noise, clear)
    for (v, u), z in np.ndenumerate(depth.astype(float)):
        enter, leave = 0.0, 1e9
        for d, at, most in zip(R @ [(u - 17.0) / 30.0, (v - 9.0) / 28.0, 1.0], eye, size):
            if abs(d) > 1e-12:
                enter, leave = max(enter, min(-at / d, (most - at) / d)), min(leave, max(-at / d, (most - at) / d))
            elif not 0.0 <= at <= most:
                leave = -1.0
        wall = leave - slack - noise * z * z
        if abs(leave - enter) > 1e-9 and abs(z - wall) > 1e-9:  # but for rounding
            far = leave <= enter or (z > 0 and z >= wall)
            assert clear[v, u] == (np.float32(1e9) if far else np.float32(max(z, 0.0)))


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), voxel_m=st.floats(0.008, 0.03))
def test_a_block_of_voxels_is_judged_as_each_of_them_would_be(seed: int, voxel_m: float) -> None:
    rng = np.random.default_rng(seed)
    T, voxels = camera_pose(rng), unknown_voxels(CABINET, voxel_m)
    rays = clear_rays(CABINET, view(bodies_in(CABINET, rng, 6), T), CAMERA, T)
    pyramids = np.empty((2, carving.LEVELS, *rays.clear.shape), np.float32)
    pyramids[:, 0] = rays.clear, -rays.clear
    for levels in pyramids:
        carving.pyramid(levels)
    T_camera_grid, together = np.ascontiguousarray(inverse(rays.T_grid_camera)[:3]), voxels.state.copy()
    carving.mark_free(
        together, voxels.step, T_camera_grid, *pyramids, *rays.camera, np.empty((2, 3)), np.empty(together.shape[2], np.uint8)
    )
    rows, alone = np.arange(voxels.state.size), np.ones(voxels.state.size, np.uint8)
    middles = (np.argwhere(voxels.state == UNKNOWN) + 0.5) * voxels.step
    revealed(rows, middles, voxels.step, T_camera_grid, pyramids[0], *rays.camera, alone)
    assert 0 < alone.sum() < alone.size
    assert np.array_equal(together.ravel() == FREE, alone == 1)


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_noise_frees_nothing_that_is_deep_inside_an_object(seed: int) -> None:
    rng, noise = np.random.default_rng(seed), DepthNoise()
    bodies, voxels = bodies_in(CABINET, rng, 6), unknown_voxels(CABINET)
    for k in range(4):
        T = camera_pose(rng)
        voxels = voxels.fuse(view(bodies, T, noise, seed + k), CAMERA, T, noise_1m_m=noise.axial_1m_m)
    for body in bodies:
        assert deepest_free(voxels, body) < 0.012


def test_measured_points_lie_in_occupied_voxels_or_at_a_wall() -> None:
    rng = np.random.default_rng(3)
    bodies, T = bodies_in(CABINET, rng, 6), camera_pose(rng)
    depth = view(bodies, T)
    voxels = unknown_voxels(CABINET).fuse(depth, CAMERA, T)
    points = cloud(depth, CAMERA, T)
    near = np.max([depth_inside(b, points) for b in bodies], axis=0) > -1e-4  # back-projected, a depth lies on the surface that made it
    p = apply(inverse(CABINET.T_world_cabinet), points)
    walls = (p[:, 0] > 0.497) | (np.abs(p[:, 1]) > 0.347) | (p[:, 2] < 0.003) | (p[:, 2] > 0.447) | (p[:, 0] < 0)
    assert (near | walls).all()
    assert near.sum() > 500
    index = voxels.index(points[near & ~walls])
    assert (voxels.state[tuple(index.T)] == OCCUPIED).mean() > 0.999


def test_an_empty_cabinet_becomes_known_but_for_what_lies_out_of_the_picture() -> None:
    voxels = unknown_voxels(CABINET)
    assert voxels.known == 0
    for y in (-0.3, 0.0, 0.3):
        T = CABINET.T_world_cabinet @ look_at(np.array([-0.5, y, 0.25]), np.array([0.3, 0, 0.2]))
        voxels = voxels.fuse(view([], T), CAMERA, T)
    assert voxels.known > 0.99
    assert not (voxels.state == OCCUPIED).any()


def test_what_is_behind_a_plate_stays_unknown_and_what_was_seen_last_holds() -> None:
    plate = Body("plate", Box(np.array([0.01, 0.7, 0.45])), CABINET.T_world_cabinet @ transform(p=[0.25, 0, 0.225]))
    T = CABINET.T_world_cabinet @ look_at(np.array([-0.5, 0.0, 0.225]), np.array([0.3, 0, 0.225]))
    shut = unknown_voxels(CABINET).fuse(view([plate], T), CAMERA, T)
    assert (shut.state[27:] == UNKNOWN).all()
    assert (shut.state[:23] == FREE).mean() > 0.9
    opened = shut.fuse(view([], T), CAMERA, T)
    assert opened.known > 0.9
    assert not (opened.state == OCCUPIED).any()


@pytest.mark.parametrize("depth", [np.zeros((180, 320), np.float32), np.full((180, 320), 0.001, np.float32)], ids=["no pixel", "covered"])
def test_a_view_that_measures_nothing_tells_nothing(depth: np.ndarray) -> None:
    T = CABINET.T_world_cabinet @ look_at(np.array([-0.3, 0.0, 0.2]), np.array([0.3, 0, 0.2]))
    assert unknown_voxels(CABINET).fuse(depth, CAMERA, T).known == 0


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_boxes_fill_just_what_is_marked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    voxels = unknown_voxels(CABINET, 0.08)
    which = rng.random(voxels.state.shape) < rng.choice([0.02, 0.5, 0.95])
    filled = np.zeros_like(which)
    for body in voxels.boxes(which):
        inside = depth_inside(body, voxels.centres(np.ones_like(which))) > 0
        filled |= inside.reshape(which.shape)
    np.testing.assert_array_equal(filled, which)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_voxels_touched_by_a_body_are_those_that_hold_some_of_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    voxels = unknown_voxels(CABINET, 0.02)
    for body in bodies_in(CABINET, rng, 2):
        touched = voxels.touched(body)
        half = np.linalg.norm(voxels.step) / 2
        deep = depth_inside(body, voxels.centres(np.ones_like(touched))).reshape(touched.shape)
        assert touched[deep > 0].all()
        assert not touched[deep < -2 * half - 0.02].any()


def test_a_voxel_must_fit_into_the_cabinet() -> None:
    with pytest.raises(ValueError, match="does not fit"):
        unknown_voxels(CABINET, 1.0)
