"""What a frame measured in the air is dropped where other views see through it; nothing true is, and what nobody else sees is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.scene import Body, Cabinet
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, transform
from perception import seen_through
from perception.camera import look_at, realsense_d435i
from perception.frames import Frame
from perception.rendering.raycast import raycast
from perception.rendering.surfaces import surfaces
from perception.seen_through import contradicted, without_seen_through

CAMERA = realsense_d435i(320, 180)
CABINET = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.5, 0.0, 0.1]), 0.03)
BODIES = [
    Body("box", Box(np.array([0.08, 0.06, 0.2])), transform(p=[0.75, 0.1, 0.2])),
    Body("pen", Cylinder(0.005, 0.15), transform(p=[0.70, -0.1, 0.175])),
    *CABINET.walls(),
]
SURFACES = surfaces([b.shape for b in BODIES], np.array([b.T_world_body for b in BODIES]))


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    """Seven views from before the cabinet, of a box and of a thing as slim as a pen."""
    eyes = [np.array([0.25, y, z]) for y, z in ((-0.3, 0.3), (-0.2, 0.5), (-0.1, 0.3), (0.0, 0.45), (0.1, 0.3), (0.2, 0.5), (0.3, 0.3))]
    return [photograph(look_at(eye, np.array([0.8, 0.0, 0.15]))) for eye in eyes]


def photograph(pose: Array) -> Frame:
    return Frame(raycast(SURFACES, pose, CAMERA).depth, None, (), CAMERA, pose)


def test_true_pixels_stay(frames: list[Frame]) -> None:
    """Even where poses are off by two millimetres, and at the edges of what is slim."""
    rng = np.random.default_rng(2)
    off = [replace(f, T_world_camera=transform(p=rng.normal(scale=0.001, size=3)) @ f.T_world_camera) for f in frames]
    for before, after in zip(off, without_seen_through(off)):
        assert ((before.depth > 0) & (after.depth == 0)).sum() <= 3


def test_flying_pixels_in_the_air_go(frames: list[Frame]) -> None:
    """Half of those at the box's edges are between it and the wall behind, in ragged rows that no look at one image alone tells."""
    rng, flying, left = np.random.default_rng(4), 0, 0
    worn = []
    for frame in frames:
        depth, behind = frame.depth.copy(), np.roll(frame.depth, 1, 1)
        edge = (np.abs(depth - behind) > 0.15) & (rng.random(depth.shape) < 0.5)
        depth[edge] = (0.5 * depth + 0.5 * behind)[edge]
        depth[rng.random(depth.shape) < 0.01] = 0.0
        worn.append((replace(frame, depth=depth), edge & (depth > 0)))
    for (_, edge), after in zip(worn, without_seen_through([f for f, _ in worn])):
        flying, left = flying + edge.sum(), left + (edge & (after.depth > 0)).sum()
    assert flying > 300
    assert left < 0.25 * flying


def test_one_view_alone_contradicts_nobody(frames: list[Frame]) -> None:
    depth = frames[3].depth.copy()
    depth[60:64, 100:104] = 0.35
    worn = [replace(frames[3], depth=depth), frames[1]]
    assert (without_seen_through(worn)[0].depth[60:64, 100:104] > 0).all()
    assert without_seen_through([worn[0]])[0].depth.tolist() == depth.tolist()


def test_the_robot_s_own_pixels_are_left_and_have_no_say(frames: list[Frame]) -> None:
    """The arm stands elsewhere in every frame."""
    arm = np.zeros(frames[0].depth.shape, bool)
    arm[100:130, 150:180] = True
    armed = [replace(f, depth=np.where(arm, np.float32(0.2), f.depth), arm=arm) for f in frames]
    for after in without_seen_through(armed):
        assert (after.depth[arm] == np.float32(0.2)).all()


def test_in_a_long_recording_all_frames_are_compared_with_some(frames: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    """And a wrong one is told, whether it is one of these or not; in a short one all are compared with all."""
    everything = np.ones(1, np.bool_)

    def shares(frames: list[Frame]) -> tuple[Array, Array]:
        through, seen = contradicted(frames, lambda points: np.repeat(everything, len(points)))
        return through + seen, (through + through.T).sum(1) / (through + seen + (through + seen).T).sum(1)

    assert ((shares(frames)[0] > 0) == ~np.eye(7, dtype=bool)).all()
    monkeypatch.setattr(seen_through, "MOST", 3)
    for wrong in (1, 3):  # frames 0, 3 and 6 are those that others are compared with
        turned = frames.copy()
        turned[wrong] = replace(frames[wrong], T_world_camera=frames[wrong].T_world_camera @ transform(np.diag([-1.0, -1.0, 1.0])))
        asked, share = shares(turned)
        assert np.flatnonzero(asked.sum(0)).tolist() == [0, 3, 6]
        assert share.argmax() == wrong
        assert share[wrong] > 3 * np.median(share)
