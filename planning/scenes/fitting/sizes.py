"""A spec with other lengths: scaled for an arm, cut to where it reaches, with objects that its hand holds, and with fewer of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.robots.robot import Robot
from planning.grasping.antipodal import SPARE_M
from planning.scenes.generation import Spec

USUAL_REACH_M = 0.85  # of the arms that the specs' cabinets are made for
LEAST_SCALE = 0.25
FEWEST = 3
"""Objects, the target among them: with fewer there is hardly anything to plan."""

Pair = tuple[float, float]


def times(by: float, pair: Pair) -> Pair:
    """A range by so much."""
    return by * pair[0], by * pair[1]


def scale_for(spec: Spec, robot: Robot, reach: float) -> float:
    """How much smaller cabinet and objects are, to fit the arm and its gripper."""
    widest = 2 * max(spec.objects_half_width_m[1], spec.target_half_width_m[1])
    by_gripper = (robot.opening.max_m - 2 * SPARE_M) / widest if widest > 0 and not robot.opening.cup_m else 1.0
    return max(LEAST_SCALE, float(np.floor(100 * min(1.0, reach / USUAL_REACH_M, by_gripper + 0.02)) / 100))


def scaled(spec: Spec, scale: float) -> Spec:
    """A spec with all lengths in it by so much."""
    return spec if scale == 1.0 else replace(
        spec,
        cabinet_size_m=scale * spec.cabinet_size_m,
        cabinet_size_to_m=None if spec.cabinet_size_to_m is None else scale * spec.cabinet_size_to_m,
        objects_half_width_m=times(scale, spec.objects_half_width_m),
        objects_height_m=times(scale, spec.objects_height_m),
        objects_scale=times(scale, spec.objects_scale),
        target_half_width_m=times(scale, spec.target_half_width_m),
        target_depth_m=times(scale, spec.target_depth_m),
    )  # fmt: skip


def cut(spec: Spec, depth: float, width: float) -> Spec:
    """A spec whose cabinet has such shares of its depth and width, with as many fewer objects in it; the target's depth goes with it."""
    if depth == width == 1.0:
        return spec
    by = np.array([depth, width, 1.0])
    return fewer(
        replace(
            spec,
            cabinet_size_m=by * spec.cabinet_size_m,
            cabinet_size_to_m=None if spec.cabinet_size_to_m is None else by * spec.cabinet_size_to_m,
            target_depth_m=times(depth, spec.target_depth_m),
        ),
        depth * width,
    )


def fewer(spec: Spec, by: float) -> Spec:
    """A spec with so much fewer objects, but no fewer than `FEWEST` if it has as many."""
    least, most = (max(min(FEWEST, n), round(by * n)) for n in spec.objects_count)
    return replace(spec, objects_count=(least, max(most, least)))


def slimmed(spec: Spec, by: float) -> Spec:
    """A spec with objects as high, and so much less wide; those of a household are smaller as a whole."""
    return spec if by == 1.0 else replace(
        spec,
        objects_half_width_m=times(by, spec.objects_half_width_m),
        objects_scale=times(by, spec.objects_scale),
        target_half_width_m=times(by, spec.target_half_width_m),
    )  # fmt: skip


def not_too_slim(spec: Spec, robot: Robot) -> Spec:
    """A spec without boxes and cylinders that are slimmer than the fingers close, if they hold any that it has; kinds stay as they are."""
    least = 0.0 if robot.opening.cup_m else float(robot.opening.width_m[0]) / 2 + SPARE_M

    def from_least(pair: Pair) -> Pair:
        return (min(max(pair[0], least), pair[1]), pair[1])

    ranges = from_least(spec.objects_half_width_m), from_least(spec.target_half_width_m)
    if ranges == (spec.objects_half_width_m, spec.target_half_width_m):
        return spec
    return replace(spec, objects_half_width_m=ranges[0], target_half_width_m=ranges[1])


def of_one_kind(spec: Spec, *, boxes: bool) -> Spec:
    """A spec with boxes alone, or cylinders alone, where it has any."""
    kinds = tuple(kind for kind in spec.objects_household if len(kind.size_m) == (3 if boxes else 2))
    return replace(spec, objects_box_share=float(boxes), objects_household=kinds or spec.objects_household)
