"""Jerk-limited speed profiles along a line: from one speed to another, and over a distance between two speeds, as fast as limits allow.

A change of speed raises the acceleration at the full jerk, keeps it where it has reached its limit, and lowers it again, so that it begins
and ends without acceleration (the "double S" of Biagiotti and Melchiorri 2008, Trajectory Planning for Automatic Machines, section 3.4). A
distance is driven by changing to a peak speed, keeping it, and changing to the last speed. Speeds are never negative.
"""

from __future__ import annotations

import numpy as np

from kinematics.jit.decorators import jit_inline

PEAK_STEPS = 60
"""Most iterations of the search for a peak speed; it converges in about ten."""


@jit_inline
def change_time(change: float, acceleration: float, jerk: float) -> float:
    """Seconds that a change of speed takes."""
    d = abs(change)
    if d * jerk <= acceleration * acceleration:
        return float(2.0 * np.sqrt(d / jerk))
    return float(d / acceleration + acceleration / jerk)


@jit_inline
def ramp_time(change: float, acceleration: float, jerk: float) -> float:
    """Seconds for which the jerk is on at each end of a change of speed."""
    d = abs(change)
    return float(np.sqrt(d / jerk) if d * jerk <= acceleration * acceleration else acceleration / jerk)


@jit_inline
def distance_over(peak: float, first: float, last: float, acceleration: float, jerk: float) -> float:
    """The distance that it takes to change speed from `first` to `peak` to `last`."""
    up = (first + peak) * change_time(peak - first, acceleration, jerk)
    down = (peak + last) * change_time(peak - last, acceleration, jerk)
    return 0.5 * (up + down)


@jit_inline
def peak_speed(distance: float, first: float, last: float, most: float, acceleration: float, jerk: float) -> float:
    """The speed to change to on the way over a distance; -1 when the distance is too short for the change from `first` to `last`.

    The search is regula falsi with Illinois's halving; what it returns never needs more than the distance.
    """
    low, high = max(first, last), most
    below = distance_over(low, first, last, acceleration, jerk) - distance
    if below > 1e-12 * (1.0 + distance):
        return -1.0
    above = distance_over(high, first, last, acceleration, jerk) - distance
    if above <= 0.0:
        return most
    for _ in range(PEAK_STEPS):
        if high - low <= 1e-14 * high or below >= -1e-14:
            break
        middle = high - above * (high - low) / (above - below)
        if not low < middle < high:
            middle = 0.5 * (low + high)
        miss = distance_over(middle, first, last, acceleration, jerk) - distance
        if miss <= 0.0:
            low, below, above = middle, miss, 0.5 * above
        else:
            high, above, below = middle, miss, 0.5 * below
    return float(low)


@jit_inline
def driving_time(distance: float, first: float, last: float, most: float, acceleration: float, jerk: float) -> float:
    """Seconds over a distance, infinite when it is too short for the change of speed."""
    peak = peak_speed(distance, first, last, most, acceleration, jerk)
    if peak < 0.0:
        return np.inf
    changing = change_time(peak - first, acceleration, jerk) + change_time(peak - last, acceleration, jerk)
    if peak == 0.0:
        return float(changing)
    return float(changing + max(0.0, distance - distance_over(peak, first, last, acceleration, jerk)) / peak)
