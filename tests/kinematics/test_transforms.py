"""Rigid transforms: the group's laws, and every conversion there and back."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.transforms import (
    Array,
    angle_between,
    apply,
    cross,
    inverse,
    rotation_about,
    rotation_from_wxyz,
    rotation_rpy,
    rpy_from_rotation,
    transform,
    wxyz_from_rotation,
)

seeds = st.integers(0, 2**32 - 1)
angles = st.floats(-7, 7)


def random_T(seed: int, n: int | None = None) -> Array:
    """One rigid transform, or n."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n or 1, 4))
    T = np.array([transform(rotation_from_wxyz(x), rng.normal(size=3)) for x in q])
    return T if n else T[0]


@given(seeds)
def test_the_cross_product_is_numpys_to_the_last_bit(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    assert np.array_equal(cross(a, b), np.cross(a, b))
    np.testing.assert_allclose([cross(a, b) @ a, cross(a, b) @ b], 0.0, atol=1e-12)


@given(seeds)
def test_inverse(seed: int) -> None:
    T = random_T(seed)
    np.testing.assert_allclose(inverse(T) @ T, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(inverse(T), np.linalg.inv(T), atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1), zeros=st.lists(st.booleans(), min_size=3, max_size=3))
def test_one_is_inverted_as_it_would_be_among_many(seed: int, zeros: list[bool]) -> None:
    rng = np.random.default_rng(seed)
    T = random_T(seed) if rng.random() < 0.5 else transform(np.eye(3)[rng.permutation(3)])
    T[:3, 3] = np.where(zeros, 0.0, rng.normal(size=3))
    assert inverse(T).tobytes() == inverse(T[None])[0].tobytes()


def test_batches_come_first() -> None:
    T = random_T(1, 6).reshape(2, 3, 4, 4)
    np.testing.assert_allclose(inverse(T) @ T, np.broadcast_to(np.eye(4), T.shape), atol=1e-12)
    assert transform(p=np.zeros((5, 3))).shape == (5, 4, 4)
    assert transform(R=np.tile(np.eye(3), (5, 1, 1))).shape == (5, 4, 4)
    assert angle_between(T[..., :3, :3], T[..., :3, :3]).shape == (2, 3)
    np.testing.assert_array_equal(transform(), np.eye(4))


@given(seeds)
def test_apply_is_the_product(seed: int) -> None:
    T, points = random_T(seed), np.random.default_rng(seed).normal(size=(7, 3))
    np.testing.assert_allclose(apply(T, points), (T @ np.c_[points, np.ones(7)].T).T[:, :3], atol=1e-12)
    np.testing.assert_allclose(apply(inverse(T), apply(T, points)), points, atol=1e-12)


@given(seeds, angles)
def test_rotation_about_an_axis(seed: int, angle: float) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    R = rotation_about(axis, angle)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    np.testing.assert_allclose(R @ axis, axis, atol=1e-12)
    np.testing.assert_allclose(R, pin.exp3(axis / np.linalg.norm(axis) * angle), atol=1e-9)
    np.testing.assert_allclose(rotation_about(axis, -angle), R.T, atol=1e-12)


@given(angles, angles, angles)
def test_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> None:
    R = rotation_rpy((roll, pitch, yaw))
    np.testing.assert_allclose(R, pin.rpy.rpyToMatrix(roll, pitch, yaw), atol=1e-9)
    back = rpy_from_rotation(R)
    np.testing.assert_allclose(rotation_rpy(back), R, atol=1e-8)
    assert abs(back[1]) <= np.pi / 2


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@given(angles, angles)
@settings(max_examples=30)
def test_roll_pitch_yaw_where_they_lock(pitch: float, roll: float, yaw: float) -> None:
    R = rotation_rpy((roll, pitch, yaw))
    np.testing.assert_allclose(rotation_rpy(rpy_from_rotation(R)), R, atol=1e-8)


@given(seeds)
def test_quaternions(seed: int) -> None:
    q = np.random.default_rng(seed).normal(size=4)
    R = rotation_from_wxyz(q)
    np.testing.assert_allclose(R, pin.Quaternion(*(q / np.linalg.norm(q))).matrix(), atol=1e-12)
    back = wxyz_from_rotation(R)
    assert back[0] >= 0
    assert np.linalg.norm(back) == pytest.approx(1)
    np.testing.assert_allclose(rotation_from_wxyz(back), R, atol=1e-12)
    np.testing.assert_allclose(rotation_from_wxyz(-3 * q), R, atol=1e-12)  # either sign and any length


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (-1, 0, 1), (1, 1, 1)])
@pytest.mark.parametrize("angle", [0.0, 1e-9, np.pi - 1e-9, np.pi, np.pi / 2])
def test_quaternions_at_their_corners(axis: tuple[float, float, float], angle: float) -> None:
    R = rotation_about(axis, angle)
    np.testing.assert_allclose(rotation_from_wxyz(wxyz_from_rotation(R)), R, atol=1e-12)


@given(seeds, st.floats(0, np.pi))
def test_angle_between(seed: int, angle: float) -> None:
    T = random_T(seed)
    axis = np.random.default_rng(seed + 1).normal(size=3)
    assert angle_between(T[:3, :3], T[:3, :3] @ rotation_about(axis, angle)) == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("angle", [1e-9, 1e-6, 1e-3])
def test_small_angles_are_exact(angle: float) -> None:
    """arccos of the trace would give 0 for the first of these."""
    assert angle_between(np.eye(3), rotation_about((1, 2, 3), angle)) == pytest.approx(angle, rel=1e-6)
