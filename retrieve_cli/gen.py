"""`retrieve gen`: scenes that are blocked, yet solvable."""

from __future__ import annotations

from pathlib import Path

from retrieve_cli.errors import InputError, blame
from retrieve_cli.files import scene_writer
from retrieve_cli.terminal import announce_first_run, progress, say


def run(*, n: int, seed: int, robot: str | None, hand_frame: str | None, gripper_joint: str | None, spec: str, out: Path | None) -> None:
    """Write n scenes; scene number i of a seed is the same in every run."""
    from kinematics.robot import load, named_robots
    from kinematics.scene import RobotRef
    from kinematics.transforms import transform
    from planning.problems import NoScene, generate, load_spec

    announce_first_run()
    with blame("gen"):
        wanted = load_spec(spec)
        arm = load(robot or "ur5e", hand_frame, gripper_joint, on_step=say)
    T_base = transform(p=arm.stand)
    own = arm.name not in named_robots()
    ref = (
        RobotRef(T_base, urdf=str(Path(arm.name).resolve()), hand_frame=hand_frame, gripper_joint=arm.joint_names[arm.gripper_joint])
        if own
        else RobotRef(T_base, name=arm.name)
    )
    with scene_writer(out) as write, progress("scenes", n, out=out) as advance:
        for index in range(n):
            try:
                scene = generate(wanted, arm, ref, seed, index)
            except NoScene as e:
                raise InputError(f"gen: {e}") from e
            write(scene)
            advance()
