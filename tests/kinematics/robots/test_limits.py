"""Limits of speed: what the URDF says, what a data sheet adds, what is assumed, and what a file of one's own replaces."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kinematics.robots.limits import ACCELERATION_S, GRIPPER_ACCELERATION_S, GRIPPER_JERK_S, JERK_S, VELOCITY, read_limits
from kinematics.robots.load import forget, load
from kinematics.robots.robot import Robot

JOINTS = ("turn", "up", "out", "grip")


def test_every_robot_has_positive_limits_and_says_where_they_come_from(robot: Robot) -> None:
    for limit in (robot.velocity, robot.acceleration, robot.jerk):
        assert limit.shape == (len(robot.joint_names),)
        assert (np.isfinite(limit) & (limit > 0)).all()
    assert robot.limits.source
    assert robot.joint_names[robot.gripper_joint] in robot.limits.assumed or "every joint" in robot.limits.assumed


def test_data_sheets_are_used() -> None:
    panda = load("panda")
    arm = list(panda.arm_joints)
    assert panda.velocity[arm].tolist() == [2.175] * 4 + [2.61] * 3
    assert panda.jerk[arm][1] == panda.known_jerk[arm][1] == 3750
    assert np.isinf(panda.known_jerk).tolist() == [i == panda.gripper_joint for i in range(len(panda.joint_names))]
    assert np.allclose(load("ur5e").velocity[:6], np.pi)
    assert np.allclose(load("gen3").acceleration[:7], [5.2] * 4 + [10.0] * 3)


def test_what_a_urdf_lacks_is_assumed_and_said(toy_urdf: Callable[..., Path]) -> None:
    toy = load(str(toy_urdf((' velocity="0.5"', ""))), "tcp", "grip")
    assert toy.velocity.tolist() == [2.0, VELOCITY, VELOCITY, 0.1]
    assert np.allclose(toy.acceleration, toy.velocity / ([ACCELERATION_S] * 3 + [GRIPPER_ACCELERATION_S]))
    assert np.allclose(toy.jerk, toy.acceleration / ([JERK_S] * 3 + [GRIPPER_JERK_S]))
    said = "velocity of up, out: 1 rad/s or m/s; acceleration of every joint: full speed in 0.35 s (grip 0.1 s); jerk of "
    assert toy.limits.assumed.startswith(said)


def test_joints_that_turn_faster_than_any_arms_are_asked_about(toy_urdf: Callable[..., Path]) -> None:
    """As they are in degrees; what slides is not."""

    def notes(*changes: tuple[str, str]) -> tuple[str, ...]:
        forget()
        return load(str(toy_urdf(*changes)), "tcp", "grip").notes

    assert notes() == ()
    (note,) = notes((' velocity="2"', ' velocity="180"'))
    assert note.startswith(
        "joints that turn very fast by its URDF (turn 180 rad/s); are they in degrees a second? Then 180 is 3.14: say so"
    )
    assert notes((' velocity="0.5"', ' velocity="50"')) == ()


def test_a_file_replaces_what_it_names(toy_urdf: Callable[..., Path], tmp_path: Path) -> None:
    toy = load(str(toy_urdf()), "tcp", "grip")
    file = tmp_path / "limits.toml"
    file.write_text("[turn]\nvelocity = 1\n[all]\nvelocity = 0.25\njerk = 7.5\n[up]\nacceleration = 3.0\n")
    limits = read_limits(file, toy.joint_names, toy.limits, toy.urdf)
    assert limits.velocity.tolist() == [1.0, 0.25, 0.25, 0.1]  # the URDF gives the fingers no more
    assert limits.acceleration.tolist() == [*toy.acceleration[:1], 3.0, *toy.acceleration[2:]]
    assert limits.jerk.tolist() == limits.known_jerk.tolist() == [7.5] * 4
    assert limits.source == "limits.toml, else the URDF"
    file.write_text("[up]\njerk = 7.5\n")
    limits = read_limits(file, toy.joint_names, toy.limits, toy.urdf)
    assert np.isinf(toy.known_jerk).all()
    assert limits.known_jerk.tolist() == [np.inf, 7.5, np.inf, np.inf]
    assert limits.jerk.tolist() == [toy.jerk[0], 7.5, *toy.jerk[2:]]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[turm]\nvelocity = 1\n", "there is no joint 'turm' (did you mean 'turn'?); the robot's are turn, up, out, grip, and "),
        ("[turn]\nspeed = 1\n", "turn.speed is unknown; velocity, acceleration, jerk can be given"),
        ("[turn]\njerk = -1\n", "turn.jerk: -1 is no positive number"),
        ("[turn]\nvelocty = 1\n", "turn.velocty is unknown (did you mean 'velocity'?); velocity, acceleration, jerk can be given"),
        ("[turn]\nvelocity = 1e-9\n", "turn.velocity: 1e-09 is not between 0.001 and 1,000,000; it counts rad (or m) and s"),
        ("[all]\njerk = 1e300\n", "all.jerk: 1e+300 is not between 0.001 and 1,000,000; it counts rad (or m) and s"),
        ("[turn]\nvelocity = 2.5\n", "turn.velocity: 2.5 is above the URDF's 2, by which every plan is judged; give less, or a URDF that "),
        ("[turn]\njerk = true\n", "turn.jerk: True is no positive number"),
        ("turn = 3\n", "turn must be a table, [turn], with numbers for velocity, acceleration, jerk"),
        ("[turn\n", "is no TOML: "),
    ],
)
def test_a_mistake_in_a_file_is_pointed_out(toy_urdf: Callable[..., Path], tmp_path: Path, text: str, says: str) -> None:
    toy = load(str(toy_urdf()), "tcp", "grip")
    file = tmp_path / "limits.toml"
    file.write_text(text)
    with pytest.raises(ValueError, match=r"limits\.toml: ") as caught:
        read_limits(file, toy.joint_names, toy.limits, toy.urdf)
    assert str(caught.value).startswith(f"{file}: {says}")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"limits.toml: no such file or folder"):
        read_limits(tmp_path / "limits.toml", JOINTS, load("ur5e").limits, load("ur5e").urdf)
