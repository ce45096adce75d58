"""Cylinders that lie: found as large as they are, told from boxes, bananas and what stands; parted from what they touch."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from photographs import CABINET, box, can, photograph, placed

from kinematics.collision.fcl_solids import overlapping
from kinematics.scene import Body, object_box
from kinematics.shapes import ConvexMesh, Cylinder
from kinematics.transforms import Array, rotation_about, transform
from perception.camera import DepthNoise, realsense_d435i
from perception.mapping.voxels import unknown_voxels
from perception.objects.fit import standing_solids
from perception.objects.lying import lying_cylinder
from perception.objects.prepared_frames import prepare
from perception.objects.segment import object_pixels
from perception.objects.settle import settled, stands_on

CAMERA = realsense_d435i(640, 360)


def lying(name: str, x: float, y: float, yaw: float, radius: float = 0.03, length: float = 0.12) -> Body:
    R = rotation_about((0.0, 0.0, 1.0), yaw) @ rotation_about((0.0, 1.0, 0.0), np.pi / 2)
    return Body(name, Cylinder(radius, length), transform(R, [x, y, radius]))


def upper_side(radius: float, length: float, yaw: float, rng: np.random.Generator, noise_m: float = 0.0) -> Array:
    """Points (N, 3) of what is seen of one from above."""
    along, turn = rng.uniform(-length / 2, length / 2, 4000), rng.uniform(-1.4, 1.4, 4000)
    r = radius + noise_m * rng.normal(size=4000)
    local = np.column_stack([along, r * np.sin(turn), radius + r * np.cos(turn)])
    return np.asarray(local @ rotation_about((0.0, 0.0, 1.0), yaw).T + [0.2, 0.1, 0.0])


@pytest.mark.parametrize(("yaw", "noise_m"), list(product((0.0, 0.7, 2.5), (0.0, 0.002))))
def test_its_axis_radius_and_ends_are_found(yaw: float, noise_m: float) -> None:
    points = upper_side(0.033, 0.10, yaw, np.random.default_rng(1), noise_m)
    found = lying_cylinder(points, np.full(len(points), noise_m))
    assert found is not None
    shape, T = found
    assert shape.radius_m == pytest.approx(0.033, abs=0.0015 + noise_m)
    assert shape.height_m == pytest.approx(0.10, abs=0.002)
    assert abs(T[:2, 2] @ [np.cos(yaw), np.sin(yaw)]) > np.cos(0.01)
    assert T[:2, 3] == pytest.approx([0.2, 0.1], abs=0.001)
    assert T[2, 3] == pytest.approx(shape.radius_m)  # it lies on the plane


def test_other_shapes_are_not_taken_for_one() -> None:
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(0, 0.12, 4000), rng.uniform(0, 0.06, 4000), np.full(4000, 0.06)])
    bent = upper_side(0.018, 0.16, 0.0, rng)
    bent[:, 1] += 8.0 * (bent[:, 0] - 0.2) ** 2
    directions = rng.normal(size=(4000, 3)) * [1, 1, 0.5] + [0, 0, 0.5]
    ball = 0.03 * directions / np.linalg.norm(directions, axis=1, keepdims=True) + [0, 0, 0.03]
    for points in (flat, bent, ball, flat[:5], np.zeros((100, 3))):
        assert lying_cylinder(points, np.zeros(len(points))) is None


@pytest.mark.parametrize("noise", [None, DepthNoise()], ids=["clean", "noisy"])
def test_among_what_stands_those_that_lie_are_found_and_no_others(noise: DepthNoise | None) -> None:
    cans = [lying("can_0", 0.14, 0.15, 0.4), lying("can_1", 0.2, -0.15, 1.9, 0.025, 0.15), lying("can_2", 0.38, 0.0, 1.5, 0.035, 0.1)]
    others = [can("can_3", 0.38, 0.25), box("box_4", 0.12, -0.02, [0.05, 0.07, 0.09], 0.3)]
    bodies = placed([*cans, *others], CABINET)
    views = prepare(photograph(bodies, CABINET, noise, camera=CAMERA), CABINET)
    shown = object_pixels(views)
    found = {b.name: b for b in standing_solids(views, shown, dict.fromkeys(shown, 0.0), CABINET)}
    for body in bodies:
        seen = found[body.name]
        assert type(seen.shape) is type(body.shape)
        assert np.abs(object_box(seen) - object_box(body)).max() < 0.005
        assert abs(seen.T_world_body[2, 2]) == pytest.approx(abs(body.T_world_body[2, 2]), abs=0.01)
        assert seen.sides_m is None or abs(body.T_world_body[2, 2]) > 0.99


PAIRS = {
    "end to a box": (lying("a", 0.3, 0.0, 0.0), box("b", 0.385, 0.0, [0.06, 0.06, 0.1])),
    "side to a can": (lying("a", 0.3, 0.0, 0.2), can("b", 0.3, 0.055)),
    "side by side": (lying("a", 0.3, 0.0, 0.5), lying("b", 0.273, 0.05, 0.5)),
}


@pytest.mark.parametrize("case", PAIRS)
def test_what_touches_is_parted_and_stays_on_the_floor(case: str) -> None:
    before = PAIRS[case]
    assert overlapping(before, 0.001)
    after = settled(before, 0.0)
    assert not overlapping(after, 0.0)
    for old, new in zip(before, after):
        assert object_box(new)[2] == pytest.approx(object_box(new)[5] / 2)
        assert (object_box(new)[3:] <= object_box(old)[3:] + 1e-9).all()
        assert np.abs(object_box(new) - object_box(old)).max() < 0.012


def test_one_that_lies_on_a_box_is_put_onto_it() -> None:
    lower = box("low", 0.3, 0.0, [0.1, 0.1, 0.08])
    upper = lying("a", 0.3, 0.0, 0.3)
    upper = Body("a", upper.shape, transform(p=[0, 0, 0.076]) @ upper.T_world_body)
    assert stands_on(upper, lower, 0.0)
    on, under = settled((upper, lower), 0.0)
    assert on.shape is upper.shape
    assert object_box(on)[2] - 0.03 > object_box(under)[2] + object_box(under)[5] / 2


def test_the_voxels_that_it_explains_are_its_own() -> None:
    """Not those beside it in the corners of the box around it."""
    voxels = unknown_voxels(CABINET, 0.01)
    (body,) = placed([lying("a", 0.3, 0.0, np.pi / 4, 0.03, 0.2)], CABINET)
    touched = voxels.touched(body)
    centres = voxels.centres(np.ones_like(touched)).reshape(*touched.shape, 3)
    local = np.abs((centres - body.T_world_body[:3, 3]) @ body.T_world_body[:3, :3])
    inside = (np.hypot(local[..., 0], local[..., 1]) < 0.03) & (local[..., 2] < 0.1)
    assert touched[inside].all()
    far = np.linalg.norm(voxels.step) / 2
    sideways = np.abs((centres - body.T_world_body[:3, 3]) @ np.cross(body.T_world_body[:3, 2], [0.0, 0.0, 1.0]))
    assert not touched[(sideways > 0.03 + far) | (local[..., 2] > 0.1 + far)].any()


def test_a_mesh_is_no_cylinder_that_lies() -> None:
    mesh = Body("m", ConvexMesh((np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], float),)), transform(p=[0.3, 0, 0.03]))
    assert settled((mesh,), 0.0) == (mesh,)
