"""Pinhole geometry and the noise of a depth camera."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.transforms import rotation_about, transform
from perception.camera import DepthNoise, Intrinsics, cloud, depth_edges, look_at, pinhole, points_in_camera, project, realsense_d435i


def test_the_realsense_sees_70_degrees_at_every_size() -> None:
    for width, height in ((1280, 720), (640, 480), (640, 360), (320, 180)):
        camera = realsense_d435i(width, height)
        assert np.degrees(camera.fov_rad[0]) == pytest.approx(70.2, abs=0.1)
        assert camera.fx == camera.fy == pytest.approx(910 * width / 1280)
    assert np.degrees(realsense_d435i(640, 360).fov_rad[1]) == pytest.approx(43.2, abs=0.1)
    assert pinhole(200, 100, 1.2).fov_rad[0] == pytest.approx(1.2)
    assert np.allclose(realsense_d435i().K @ [0, 0, 1], [319.5, 239.5, 1])


def test_a_finer_camera_sees_the_same_field() -> None:
    coarse = Intrinsics(64, 48, 50.0, 55.0, 30.0, 25.0)
    assert coarse.scaled(3).fov_rad == pytest.approx(coarse.fov_rad)
    assert coarse.scaled(1) == coarse


@pytest.mark.parametrize("target", [(1.0, 0.0, 0.5), (0.0, 0.0, 3.0), (0.2, -2.0, 0.5)])
def test_look_at_puts_the_target_in_the_middle_and_up_upwards(target: tuple[float, float, float]) -> None:
    eye = np.array([0.0, 0.0, 0.5])
    T = look_at(eye, np.array(target))
    assert np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3))
    assert np.linalg.det(T) == pytest.approx(1)
    camera = realsense_d435i()
    u, v, z = project(np.array([target]), camera, T)[0]
    assert (u, v) == pytest.approx((camera.cx, camera.cy))
    assert z == pytest.approx(np.linalg.norm(np.array(target) - eye))
    assert T[2, 1] <= 1e-12  # the image's y points down


def test_look_at_needs_a_direction() -> None:
    with pytest.raises(ValueError, match="where it stands"):
        look_at(np.ones(3), np.ones(3))


def test_projection_undoes_back_projection() -> None:
    rng = np.random.default_rng(0)
    camera, T = Intrinsics(40, 30, 35.0, 36.0, 18.0, 15.5), transform(rotation_about((1, 2, 3), 1.1), [0.1, 0.2, 0.3])
    depth = rng.uniform(0.3, 2.0, (30, 40))
    depth[3, 5] = 0
    points = cloud(depth, camera, T)
    assert points.shape == (30 * 40 - 1, 3)
    v, u = np.nonzero(depth)
    assert np.allclose(project(points, camera, T), np.stack([u, v, depth[v, u]], -1))
    assert np.isnan(points_in_camera(depth, camera)[3, 5]).all()


def test_points_behind_the_camera_have_no_pixel() -> None:
    behind = project(np.array([[0.0, 0.0, -1.0]]), realsense_d435i(), np.eye(4))[0]
    assert np.isnan(behind[:2]).all()
    assert behind[2] == -1


def test_the_same_seed_gives_the_same_noise() -> None:
    depth = np.full((40, 50), 0.8, np.float32)
    depth[:, 25:] = 1.4
    once, again, other = (DepthNoise().apply(depth, np.random.default_rng(s)) for s in (7, 7, 8))
    assert once.dtype == np.float32
    assert once.tobytes() == again.tobytes() != other.tobytes()
    assert (depth[:, :25] == np.float32(0.8)).all()  # the clean image is left alone


@pytest.mark.parametrize("z", [0.3, 0.6, 1.2])
def test_the_error_grows_with_the_square_of_the_distance(z: float) -> None:
    flat, sigma = np.full((300, 300), z, np.float32), 0.004 * z**2
    noisy = DepthNoise(step_m=0.0).apply(flat, np.random.default_rng(1)).astype(float)
    assert noisy.std() == pytest.approx(sigma, rel=0.01)
    assert noisy.mean() == pytest.approx(z, abs=4 * sigma / 300)
    in_mm = 1000 * DepthNoise().apply(flat, np.random.default_rng(1)).astype(float)
    assert np.abs(in_mm - np.round(in_mm)).max() < 1e-3
    assert np.abs(in_mm / 1000 - noisy).max() < 0.501e-3


def test_range_and_edges_lose_pixels() -> None:
    depth = np.full((200, 200), 0.5, np.float32)
    depth[:, :50], depth[:, 50:100] = 0.1, 4.0
    noisy = DepthNoise(axial_1m_m=0.0).apply(depth, np.random.default_rng(2))
    assert (noisy[:, :100] == 0).all()
    assert np.allclose(noisy[:, 101:], 0.5)
    assert 0.3 < (noisy[:, 100] == 0).mean() < 0.7
    assert (depth_edges(depth, reach_px=2)[0] == np.isin(np.arange(200), [48, 49, 50, 51, 98, 99, 100, 101])).all()


def test_nothing_stays_nothing_and_no_noise_is_no_change() -> None:
    empty = np.zeros((20, 20), np.float32)
    assert (DepthNoise().apply(empty, np.random.default_rng(0)) == 0).all()
    depth = np.random.default_rng(3).uniform(0.5, 0.51, (20, 20)).astype(np.float32)
    clean = DepthNoise(axial_1m_m=0.0, edge_dropout=0.0, step_m=0.0)
    assert (clean.apply(depth, np.random.default_rng(0)) == depth).all()
