"""Grasps of networks: each convention's frame becomes the hand's own, and what is no grasp is told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InputError
from kinematics.transforms import Array, transform
from planning.io.grasp_files import CONTACT_GRASPNET_DEPTH_M, read_grasps


def hands(n: int = 5) -> Array:
    """Hand poses (n, 4, 4)."""
    rng = np.random.default_rng(4)
    R = Rotation.random(n, random_state=4).as_matrix()
    return np.array([transform(r, p) for r, p in zip(R, rng.uniform(-1, 1, (n, 3)))])


def same_fingers(a: Array, b: Array) -> None:
    """The same approach and the same line between the fingers, from the same point; which finger is which is no matter."""
    np.testing.assert_allclose(a[:, :3, 3], b[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(a[:, :3, 2], b[:, :3, 2], atol=1e-9)
    np.testing.assert_allclose(np.abs(np.einsum("ni,ni->n", a[:, :3, 1], b[:, :3, 1])), 1, atol=1e-9)


def test_contact_graspnet(tmp_path: Path) -> None:
    """x along the fingers' line, z along the approach, the base 0.1034 m behind the contacts."""
    T = hands()
    base = T.copy()
    base[:, :3, 0], base[:, :3, 1] = T[:, :3, 1], -T[:, :3, 0]  # x: the way the fingers close; y = z × x
    base[:, :3, 3] -= CONTACT_GRASPNET_DEPTH_M * T[:, :3, 2]
    assert np.allclose(np.linalg.det(base[:, :3, :3]), 1)
    np.savez(tmp_path / "g.npz", pred_grasps_cam=base, scores=np.linspace(0, 1, len(T)))
    read = read_grasps(tmp_path / "g.npz", "contact-graspnet")
    same_fingers(read.T, T)
    np.testing.assert_allclose(read.scores, np.linspace(0, 1, len(T)))
    assert not read.at_tips
    (tmp_path / "g.json").write_text(json.dumps({"pred_grasps_cam": base.tolist(), "scores": [0.5] * len(T)}))
    same_fingers(read_grasps(tmp_path / "g.json", "contact-graspnet").T, T)


@pytest.mark.parametrize("convention", ["graspnet", "anygrasp"])
def test_rows_of_graspnet_api(tmp_path: Path, convention: str) -> None:
    """x along the approach, y along the fingers' line, the tips `depth` beyond the translation."""
    T, depth = hands(), np.linspace(0.01, 0.04, 5)
    R = np.stack([T[:, :3, 2], T[:, :3, 1], -T[:, :3, 0]], -1)
    assert np.allclose(np.linalg.det(R), 1)
    p = T[:, :3, 3] - depth[:, None] * T[:, :3, 2]
    rows = np.concatenate([np.full((5, 1), 0.7), np.full((5, 2), 0.02), depth[:, None], R.reshape(5, 9), p, np.zeros((5, 1))], 1)
    np.save(tmp_path / "g.npy", rows)
    read = read_grasps(tmp_path / "g.npy", convention)
    same_fingers(read.T, T)
    assert read.at_tips


def test_the_hands_own(tmp_path: Path) -> None:
    (tmp_path / "g.json").write_text(json.dumps(hands().tolist()))
    np.testing.assert_array_equal(read_grasps(tmp_path / "g.json", "hand").T, hands())


def test_an_array_whose_file_says_archive(tmp_path: Path) -> None:
    np.save(tmp_path / "g.npy", hands())
    (tmp_path / "g.npy").rename(tmp_path / "g.npz")
    np.testing.assert_array_equal(read_grasps(tmp_path / "g.npz", "hand").T, hands())


def test_a_last_row_that_belongs_to_no_pose(tmp_path: Path) -> None:
    """Poses whose rows and columns are exchanged have rotations, too, and stand at the origin."""
    np.save(tmp_path / "t.npy", hands().transpose(0, 2, 1))
    with pytest.raises(
        InputError, match=r"grasp 0 is no pose: its last row is .*, and 0, 0, 0, 1 belongs there: are rows and columns exchanged"
    ):
        read_grasps(tmp_path / "t.npy", "hand")


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    (tmp_path / "g.json").write_text(json.dumps(hands().tolist()), encoding="utf-8-sig")
    np.testing.assert_array_equal(read_grasps(tmp_path / "g.json", "hand").T, hands())


def test_what_is_no_grasp(tmp_path: Path) -> None:
    pickled, sheared, flat, text = (tmp_path / name for name in ("p.npz", "s.npy", "f.npy", "g.txt"))
    np.savez(pickled, pred_grasps_cam=np.array({1: hands()}, dtype=object))
    np.save(sheared, 2 * hands())
    np.save(flat, np.zeros((4, 3)))
    text.write_text("")
    empty, cut, nested = (tmp_path / name for name in ("e.npy", "c.npz", "n.json"))
    empty.write_bytes(b"")
    np.savez(cut, T=hands())
    cut.write_bytes(cut.read_bytes()[:200])
    nested.write_text("[" * 100_000)
    for file, says in (
        (empty, "can't be read"),
        (cut, "can't be read"),
        (nested, "can't be read"),
        (pickled, "holds pickled objects, which are not read: they could run code"),
        (sheared, "grasp 0 has no rotation: is the convention right"),
        (flat, "are poses"),
        (text, "grasps come from .npz, .npy and .json files"),
        (tmp_path / "none.npy", "no such file"),
    ):
        with pytest.raises(InputError, match=says):
            read_grasps(file, "hand")
    with pytest.raises(InputError, match="rows of 17 numbers"):
        read_grasps(flat, "graspnet")
