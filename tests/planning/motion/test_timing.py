"""Time stamps rise, keep the joints' limits, and know nothing of a path's other pieces."""

from __future__ import annotations

import numpy as np

from planning.motion.timing import ACCELERATION_S, LEAST_S, time_stamps


def test_times_rise_and_keep_the_limits() -> None:
    rng, velocity = np.random.default_rng(0), np.array([3.1, 2.0, 0.1])
    q = rng.uniform(-1, 1, (40, 3)) * [3.0, 2.0, 0.05]
    q[20] = q[19]  # nothing moves there
    steps = np.diff(time_stamps(q, velocity))
    assert (steps > 0.999 * LEAST_S).all()
    assert np.isclose(steps[19], LEAST_S)
    fastest = (np.abs(np.diff(q, axis=0)) / velocity).max(1)
    moving = fastest > 0
    assert (steps[moving] > fastest[moving]).all()
    assert (steps[moving] < fastest[moving] + 4 * ACCELERATION_S).all()
    assert np.allclose(np.diff(time_stamps(q[::-1], velocity)), steps[::-1])
