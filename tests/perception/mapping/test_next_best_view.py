"""What a view would reveal, guessed from the map, against what it then reveals; the synthetic camera against the surfaces it sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box
from kinematics.transforms import apply, inverse, transform
from perception.camera import DepthNoise, cloud, look_at
from perception.mapping.next_best_view import InformationGain, make_view_candidates, reduced, sample_poses, sweep_poses
from perception.mapping.voxels import Voxels, unknown_voxels
from perception.rendering.synthetic_camera import DEFAULT, RANGE_M, robot_depth, robot_pixels, synthetic_camera

CABINET = Cabinet(np.array([0.56, 0.86, 0.5]), transform(p=[0.3, 0, 0.1]), 0.03)
CARTON = Body("carton", Box(np.array([0.1, 0.2, 0.25])), transform(p=[0.55, 0.1, 0.225]))
SCENE = Scene("s", RobotRef(np.eye(4), "ur5e"), CABINET, (CARTON,), "carton", Grasp(np.eye(4), 0.05))
FRONT = look_at(np.array([0.1, 0.0, 0.45]), np.array([0.6, 0.0, 0.3]))


def previewed(poses: np.ndarray) -> InformationGain:
    small = reduced(DEFAULT)
    nothing = unknown_voxels(CABINET)
    own = np.zeros((len(poses), small.height, small.width), bool)
    return InformationGain(nothing, make_view_candidates(nothing, poses, DEFAULT, own), RANGE_M[0])


def all_gains(poses: np.ndarray, voxels: Voxels) -> list[float]:
    """What each view would reveal, by a preview that has kept nothing."""
    preview = previewed(poses)
    return [preview._gain(preview._moment(voxels), i) for i in range(len(poses))]


def test_poses_are_rigid_and_look_at_the_cabinet() -> None:
    poses = np.concatenate([sample_poses(CABINET, 200, np.random.default_rng(0)), sweep_poses(CABINET)])
    np.testing.assert_allclose(poses[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2), np.tile(np.eye(3), (len(poses), 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(poses), 1)


def test_rolls_come_as_often_as_they_should() -> None:
    poses = sample_poses(CABINET, 2000, np.random.default_rng(1))
    rightwards = poses[:, 2, 0]  # how far the picture's x points up: 0 where the camera is upright or upside down
    turned = np.abs(rightwards) > 0.5
    upside_down = ~turned & (poses[:, 2, 1] > 0)
    assert abs(turned.mean() - 0.2) < 0.03
    assert abs(upside_down.mean() - 0.2) < 0.03


def test_the_frame_shows_objects_by_name_and_the_robot_apart(ur5e: Robot) -> None:
    camera = synthetic_camera(ur5e, SCENE, SCENE.poses())
    frame = camera(FRONT, ur5e.home)
    assert frame.instance is not None
    points = cloud(np.where(frame.instance == 0, frame.depth, 0), DEFAULT, FRONT)
    p = apply(inverse(CARTON.T_world_body), points)
    assert len(p) > 1000
    assert np.abs(np.abs(p / CARTON.shape.half).max(1) - 1).max() < 1e-3
    behind = look_at(np.array([-0.9, 0.0, 0.6]), np.array([0.3, 0.0, 0.3]))  # the arm stands between camera and cabinet
    frame = camera(behind, ur5e.home)
    assert frame.arm is not None
    assert frame.arm.sum() > 1000
    assert frame.instance is not None
    assert not (frame.arm & (frame.instance >= 0)).any()
    own = robot_depth(ur5e, np.eye(4), ur5e.home, behind, DEFAULT) > 0
    found = robot_pixels(ur5e, np.eye(4), ur5e.home, frame)
    assert (found >= frame.arm & (frame.depth > 0)).all()
    assert own.sum() >= frame.arm.sum()


def test_noise_is_seeded_and_wants_a_generator(ur5e: Robot) -> None:
    frames = [
        synthetic_camera(ur5e, SCENE, SCENE.poses(), noise=DepthNoise(), rng=np.random.default_rng(seed))(FRONT, ur5e.home)
        for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(frames[0].depth, frames[1].depth)
    assert (frames[0].depth != frames[2].depth).any()


def test_the_guess_comes_near_to_what_a_view_reveals(ur5e: Robot) -> None:
    """In a map that has seen what is there, the guess and the truth must agree; rank correlation over many views."""
    camera = synthetic_camera(ur5e, SCENE, SCENE.poses())
    seen = unknown_voxels(CABINET).fuse(camera(FRONT, ur5e.home).depth, DEFAULT, FRONT)
    rng = np.random.default_rng(1)
    poses = np.array([T for T in sample_poses(CABINET, 60, rng) if CABINET.T_world_cabinet[0, 3] > T[0, 3]])
    preview = previewed(poses)
    now = preview._moment(seen)
    guess = np.array([preview._gain(now, i) for i in range(len(poses))])
    far = replace(SCENE, robot=RobotRef(transform(p=[-5, 0, 0]), "ur5e"))  # the arm out of the picture
    apart = synthetic_camera(ur5e, far, SCENE.poses())
    truth = np.array([seen.fuse(apart(T, ur5e.home).depth, DEFAULT, T).known - seen.known for T in poses])
    ranks = np.corrcoef(np.argsort(np.argsort(guess)), np.argsort(np.argsort(truth)))[0, 1]
    assert ranks > 0.9
    assert np.abs(guess - truth).max() < 0.08


def test_the_best_view_is_the_best_and_asks_late_whether_it_is_usable(ur5e: Robot) -> None:
    poses = sample_poses(CABINET, 40, np.random.default_rng(2))
    voxels = unknown_voxels(CABINET)
    preview, asked = previewed(poses), list[int]()
    first = preview.best(voxels, np.zeros(40), lambda i: not asked.append(i))
    assert first is not None
    gains = all_gains(poses, voxels)
    assert first[1] == max(gains[i] for i in asked) >= 0.999 * max(gains) - 0.05
    assert len(asked) == 1
    barred = preview.best(voxels, np.zeros(40), lambda i: i != first[0])
    assert barred is not None
    assert barred[0] != first[0]
    assert preview.best(voxels, np.zeros(40), lambda _: False) is None


def test_a_view_that_costs_nothing_is_not_taken_for_one_that_shows_something(ur5e: Robot) -> None:
    poses, voxels = sample_poses(CABINET, 40, np.random.default_rng(2)), unknown_voxels(CABINET)
    gains = np.array(all_gains(poses, voxels))
    far = np.where(gains < np.median(gains), 0.0, 2.0)
    near = previewed(poses).best(voxels, far, lambda _: True)
    assert near is not None
    assert near[1] < np.median(gains)
    worth_it = previewed(poses).best(voxels, far, lambda _: True, float(np.median(gains)))
    assert worth_it is not None
    assert worth_it[1] >= np.median(gains)
    assert previewed(poses).best(voxels, far, lambda _: True, 1.0) is None


def test_what_is_kept_from_view_to_view_changes_no_choice(ur5e: Robot) -> None:
    """As the map grows, the view chosen with the kept bounds is the best of all views counted anew, and few of them are counted."""
    camera = synthetic_camera(ur5e, replace(SCENE, robot=RobotRef(transform(p=[-5, 0, 0]), "ur5e")), SCENE.poses())
    poses = np.array([T for T in sample_poses(CABINET, 150, np.random.default_rng(3)) if CABINET.T_world_cabinet[0, 3] > T[0, 3]])
    voxels, preview = unknown_voxels(CABINET), previewed(poses)
    for number in range(4):
        counted = list[int]()
        gain = preview._gain
        preview._gain = lambda now, i, gain=gain, to=counted: to.append(i) or gain(now, i)  # type: ignore[method-assign]
        best = preview.best(voxels, np.zeros(len(poses)), lambda _: True)
        preview._gain = gain  # type: ignore[method-assign]
        gains = all_gains(poses, voxels)
        assert best is not None
        np.testing.assert_allclose(best[1], gains[best[0]])
        assert best[1] >= 0.98 * max(gains)
        assert number == 0 or len(counted) < len(poses) / 2
        voxels = voxels.fuse(camera(poses[best[0]], ur5e.home).depth, DEFAULT, poses[best[0]])


def test_a_wall_in_the_way_shows_nothing() -> None:
    through_the_side = look_at(np.array([0.5, 0.9, 0.35]), np.array([0.6, 0.0, 0.3]))
    front, side = all_gains(np.array([FRONT, through_the_side]), unknown_voxels(CABINET))
    assert front > 0.3
    assert side == 0
