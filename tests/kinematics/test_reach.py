"""How far an arm reaches: no configuration gets beyond it, whatever its joints."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.chain import forward
from kinematics.reach import reach_of
from kinematics.transforms import rotation_about
from tests.random_arms import random_chain, random_pose


@pytest.mark.parametrize("seed", range(40))
def test_no_configuration_of_any_arm_is_beyond_reach(seed: int) -> None:
    """With turning, sliding and mimic joints. Of one or two joints that turn, the reach is what can be had."""
    rng = np.random.default_rng(seed)
    chain, T_frame_hand = random_chain(rng, int(rng.integers(1, 9))), random_pose(rng, 0.1)
    reach, frames, beyond = reach_of(chain), np.empty((len(chain.q_index) + 1, 4, 4)), list[float]()
    for q in rng.uniform(chain.lower, chain.upper, (300, len(chain.lower))):
        forward(chain, q, frames)
        T = frames[-1] @ T_frame_hand
        beyond.append(reach.beyond_m(T_frame_hand, T))
        T[:3, :3] = rotation_about((0.0, 0.0, 1.0), rng.uniform(-3.0, 3.0)) @ T[:3, :3]
        assert reach.beyond_m(T_frame_hand, T, any_heading=True) < 1e-9  # turned about the vertical, it was another hand's pose
        T[:3, 3] += (T[:3, 3] - reach.shoulder) * 100 / np.linalg.norm(T[:3, 3] - reach.shoulder)
        assert reach.beyond_m(T_frame_hand, T, any_heading=True) > 90
    assert max(beyond) < 1e-9
    if len(chain.q_index) <= 2 and not chain.prismatic.any():
        assert max(beyond) > -1e-9
