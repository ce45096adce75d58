"""`retrieve gen`: scenes that are blocked, yet solvable."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import MISSING, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.errors import blame
from planning.io.results import scene_writer
from retrieve_cli.engine import map_ordered
from retrieve_cli.robot_options import RobotOptions
from retrieve_cli.terminal import announce_first_run, progress, say
from retrieve_cli.version import version

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot
    from kinematics.scene import RobotRef, Scene
    from planning.scenes.generation import Spec

OFTEN = 50
"""So often somebody who waits is told what became of samples: most are no blocked, solvable scenes."""


def run(
    *,
    n: int,
    seed: int,
    robot: RobotOptions,
    spec: str,
    out: Path | None,
    fit: bool = False,
    workers: int | None = None,
    engine: str = "local",
    address: str | None = None,
    resume: bool = False,
) -> None:
    """Write n scenes; scene number i of a seed is the same in every run, whoever makes it."""
    from kinematics.collision.robot_model import link_covers
    from kinematics.robots.load import to_ref
    from planning.scenes.generation import load_spec

    announce_first_run()
    with blame("gen"):
        wanted = load_spec(spec)
        arm = robot.load(say)
        link_covers(arm, say)
    ref = to_ref(arm, robot.hand_frame)
    if fit:
        wanted, ref = fitted(wanted, arm, ref, "gen")
    make = partial(make_scene, wanted, ref, seed)
    robots = (arm.name, robot.hand_frame, robot.gripper_joint)
    asked = {"command": "gen", "version": version(), "seed": seed, "spec": spec_hash(wanted), "robot": robots}
    with scene_writer(out, asked=asked, resume=resume, tell=say) as write, progress("scenes", n, done=write.kept, out=out) as advance:
        for scene in map_ordered(make, write.left(range(n), key=str), workers=workers, engine=engine, address=address):
            write(scene)
            advance()


def fitted(spec: Spec, arm: Robot, ref: RobotRef, command: str) -> tuple[Spec, RobotRef]:
    """The spec and the robot's place that go together. Raises: InputError, of a command, where the arm reaches into no such cabinet."""
    from planning.scenes.fitting.fit import fit
    from planning.scenes.generation import NoScene

    with blame(command, NoScene):
        found = fit(spec, arm, ref, say)
    say(f"fitted: {found}")
    return found.spec, found.ref


def make_scene(spec: Spec, ref: RobotRef, seed: int, index: int) -> Scene:
    """Scene number `index` of a seed. Raises: InputError when the spec asks for what the robot can't do."""
    from kinematics.robots.load import from_ref
    from planning.scenes.generation import NoScene, generate

    thrown = Counter[str]()

    def tell(verdict: str) -> None:
        thrown[verdict if verdict in ("free", "unsolvable") else "with no good grasp"] += 1
        if thrown.total() % OFTEN == 0:
            say(f"scene {index}: {thrown.total()} samples were no scenes: {', '.join(f'{n} {what}' for what, n in thrown.most_common())}")

    with blame("gen", NoScene):
        return generate(spec, from_ref(ref), ref, seed, index, on_step=tell)


def spec_hash(spec: Spec) -> str:
    """What tells a spec from any other: the fields that it gives."""
    optional = [f.name for f in fields(spec) if f.default is not MISSING and getattr(spec, f.name) is f.default]
    given = {name: value for name, value in vars(spec).items() if name not in optional}
    plain = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in given.items()}
    return hashlib.sha256(json.dumps(plain, sort_keys=True, default=vars).encode()).hexdigest()
