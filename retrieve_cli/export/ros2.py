"""ROS 2: each arm step a trajectory_msgs/JointTrajectory, each gripper step a control_msgs/GripperCommand, as YAML and as an MCAP bag.

joint_trajectory_controller interpolates points that have positions, velocities and accelerations with quintic splines, which is what a
plan's rows mean (ros2_controllers, joint_trajectory_controller/doc/trajectory.rst). So the points are the plan's own rows.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.errors import InputError
from retrieve_cli.export.steps import ArmStep, GripperStep, Step

ARM_TOPIC = "/joint_trajectory_controller/joint_trajectory"
GRIPPER_TOPIC = "/gripper_controller/gripper_cmd"
GRIPPER_TYPE = "control_msgs/msg/GripperCommand"
GRIPPER_FIELDS = "float64 position\nfloat64 max_effort\n"


def write(folder: Path, steps: Sequence[Step], scene: str) -> list[Path]:
    """Write a plan's steps below a folder: NN_arm.yaml, NN_gripper.yaml, sequence.yaml (their order and times) and bag/ (MCAP).

    Raises: InputError when the package that writes bags is missing.
    """
    import yaml

    written, order, start = list[Path](), list[dict[str, Any]](), 0.0
    for old in folder.iterdir():  # steps of a longer plan, perhaps, that was exported there before
        if re.fullmatch(r"\d{2,}_(arm|gripper)\.yaml", old.name):
            old.unlink()
    for number, step in enumerate(steps):
        arm = isinstance(step, ArmStep)
        file = folder / f"{number:02d}_{'arm' if arm else 'gripper'}.yaml"
        message = trajectory(step) if isinstance(step, ArmStep) else command(step)
        file.write_text(yaml.dump(message, Dumper=yaml.CSafeDumper, sort_keys=False, default_flow_style=None, width=1000), encoding="utf-8")
        duration = float(step.t_s[-1]) if isinstance(step, ArmStep) else step.duration_s
        kind = "trajectory_msgs/msg/JointTrajectory" if arm else GRIPPER_TYPE
        order.append(
            {"file": file.name, "type": kind, "topic": ARM_TOPIC if arm else GRIPPER_TOPIC, "start_s": start, "duration_s": duration}
        )
        written.append(file)
        start += duration
    sequence = folder / "sequence.yaml"
    sequence.write_text(yaml.safe_dump({"scene": scene, "steps": order}, sort_keys=False), encoding="utf-8")
    return [*written, sequence, _bag(folder / "bag", steps)]


def trajectory(step: ArmStep) -> dict[str, Any]:
    """A JointTrajectory: the step's rows as points, the first at the start state and time 0."""
    points = [
        {"positions": q, "velocities": qd, "accelerations": qdd, "effort": [], "time_from_start": _duration(t)}
        for t, q, qd, qdd in zip(_nanoseconds(step.t_s), step.q.tolist(), step.qd.tolist(), step.qdd.tolist())
    ]
    return {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}, "joint_names": list(step.joints), "points": points}


def command(step: GripperStep) -> dict[str, Any]:
    """A GripperCommand: the joint's value, and the force (0: the gripper's own); of a suction cup 1 for on, 0 for off."""
    if step.vacuum is not None:
        return {"position": float(step.vacuum), "max_effort": 0.0}
    return {"position": float(step.value), "max_effort": float(step.force_N or 0.0)}


def _nanoseconds(t_s: Any) -> list[int]:
    """Whole nanoseconds, which must rise: rows that lie closer together than one are moved on by one."""
    whole = np.rint(np.asarray(t_s) * 1e9).astype(np.int64)
    for k in range(1, len(whole)):
        whole[k] = max(whole[k], whole[k - 1] + 1)
    return [int(n) for n in whole]


def _duration(nanoseconds: int) -> dict[str, int]:
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def _bag(folder: Path, steps: Sequence[Step]) -> Path:
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as e:
        raise InputError("export: --to ros2 writes an MCAP bag with the package rosbags, which is missing: pip install '.[ros2]'") from e
    if folder.exists():
        for old in folder.iterdir():
            old.unlink()
        folder.rmdir()
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(GRIPPER_FIELDS, GRIPPER_TYPE))
    types = store.types
    Header, Time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    Duration, Point = types["builtin_interfaces/msg/Duration"], types["trajectory_msgs/msg/JointTrajectoryPoint"]
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        arm = bag.add_connection(ARM_TOPIC, "trajectory_msgs/msg/JointTrajectory", typestore=store)
        gripper = bag.add_connection(GRIPPER_TOPIC, GRIPPER_TYPE, typestore=store)
        now = 0
        for step in steps:
            if isinstance(step, ArmStep):
                times = _nanoseconds(step.t_s)
                rows = zip(times, *(np.ascontiguousarray(table) for table in (step.q, step.qd, step.qdd)))
                points = [Point(q, qd, qdd, np.zeros(0), Duration(t // 10**9, t % 10**9)) for t, q, qd, qdd in rows]
                message = types["trajectory_msgs/msg/JointTrajectory"](Header(Time(0, 0), ""), list(step.joints), points)
                bag.write(arm, now, store.serialize_cdr(message, message.__msgtype__))
                now += times[-1]
            else:
                message = types[GRIPPER_TYPE](**command(step))
                bag.write(gripper, now, store.serialize_cdr(message, GRIPPER_TYPE))
                now += round(step.duration_s * 1e9)
    return folder
