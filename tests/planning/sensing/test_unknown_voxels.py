"""What nobody has seen, as obstacles."""

from __future__ import annotations

import numpy as np

from kinematics.scene import Cabinet
from perception.mapping.voxels import FREE, unknown_voxels
from planning.sensing.unknown_space import unknown_space


def test_the_unseen_boxes_hold_all_that_is_not_free() -> None:
    voxels = unknown_voxels(Cabinet(np.array([0.56, 0.86, 0.5]), np.eye(4), 0.03))
    rng = np.random.default_rng(0)
    voxels = voxels.marked(rng.random(voxels.state.shape) < 0.9, FREE)
    fine, coarse = (sum(float(np.prod(b.shape.half * 2)) for b in unknown_space(voxels, (), blocks)) for blocks in (1, 2))
    left = float((voxels.state != FREE).sum()) * voxels.voxel_m3
    assert left <= fine + 1e-9
    assert fine <= coarse
