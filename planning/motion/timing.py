"""Time stamps: every straight piece of a path is driven from rest to rest within the joints' limits, synchronised by ruckig.

Stopping at each waypoint keeps the arm exactly on the polyline that was checked; a blend would cut its corners.
"""

from __future__ import annotations

import numpy as np
import ruckig

from kinematics.transforms import Array

ACCELERATION_S = 0.35  # seconds to reach full speed
JERK_S = 0.15  # seconds to reach full acceleration
LEAST_S = 0.001  # that a piece takes on which nothing moves: a robot's controller wants times that rise


def time_stamps(q: Array, velocity: Array) -> Array:
    """Times (K,) in s for waypoints q (K, J), rising from 0; velocity (J,) holds the joints' limits in rad/s or m/s."""
    t = np.zeros(len(q))
    for k in range(1, len(q)):
        t[k] = t[k - 1] + max(LEAST_S, segment_time(q[k] - q[k - 1], velocity))
    return t


def segment_time(delta: Array, velocity: Array) -> float:
    """Seconds for a straight move by delta (J,), from rest to rest, every joint at the same share of its way at every moment."""
    share = np.abs(delta) / velocity  # seconds at full speed
    slowest = float(share.max())
    if slowest < 1e-12:
        return 0.0
    generator, move = ruckig.Ruckig(1), ruckig.InputParameter(1)
    move.current_position, move.target_position = [0.0], [slowest]
    move.max_velocity, move.max_acceleration, move.max_jerk = [1.0], [1 / ACCELERATION_S], [1 / (ACCELERATION_S * JERK_S)]
    profile = ruckig.Trajectory(1)
    if generator.calculate(move, profile) < 0:
        raise ValueError(f"no time profile for a move by {delta}")
    return max(float(profile.duration), slowest * (1 + 1e-9))
