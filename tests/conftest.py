"""Robots, a toy URDF and one hand-made scene with a plan, shared by the tests."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from kinematics.inverse import descend, make_seeds, make_work, solve
from kinematics.robots.load import load, to_ref
from kinematics.robots.named import installed, named_robots
from kinematics.robots.robot import Robot
from kinematics.transforms import transform, wxyz_from_rotation

settings.register_profile("repeatable", derandomize=True, database=None, deadline=None)
settings.load_profile("repeatable")

Json = dict[str, Any]
PLANNED = {"paper": 6, "paper-any": 2, "shelf": 2}  # so many scenes of each spec
SIDEWAYS = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # the hand looking along the world's x, its own x up


@pytest.fixture
def retrieve(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run the program in this process: (exit code, stdout, stderr)."""

    from retrieve_cli.__main__ import main

    def call(*args: str | Path) -> tuple[int, str, str]:
        code = main([str(a) for a in args])
        return code, *capsys.readouterr()

    return call


@pytest.fixture(scope="session", params=list(named_robots()))
def robot(request: pytest.FixtureRequest) -> Robot:
    """Each named robot in turn."""
    if not installed(request.param):
        pytest.skip(f"the package of {request.param} is not installed")
    return load(request.param)


@pytest.fixture(scope="session")
def ur5e() -> Robot:
    return load("ur5e")


@pytest.fixture(scope="session")
def ur5e_urdf(ur5e: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `retrieve robots ur5e --urdf FILE` writes."""
    file = tmp_path_factory.mktemp("urdf") / "ur5e.urdf"
    file.write_text(ur5e.urdf)
    return file


def random_q(robot: Robot, n: int, seed: int = 0) -> np.ndarray:
    """n configurations (n, J) inside the limits, continuous joints within one turn."""
    low, high = np.where(np.isinf(robot.lower), -np.pi, robot.lower), np.where(np.isinf(robot.upper), np.pi, robot.upper)
    return np.random.default_rng(seed).uniform(low, high, (n, len(low)))


TOY = """<?xml version="1.0"?>
<robot name="toy">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="post"/><origin xyz="0 0 0.06"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="10"/></joint>
  <link name="post"><collision><origin xyz="0 0 0.2"/><geometry><box size="0.06 0.06 0.38"/></geometry></collision></link>
  <joint name="up" type="prismatic"><parent link="post"/><child link="sled"/><origin xyz="0.06 0 0.05"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.3" velocity="0.5" effort="10"/></joint>
  <link name="sled"><collision><geometry><box size="0.05 0.05 0.05"/></geometry></collision></link>
  <joint name="out" type="prismatic"><parent link="sled"/><child link="palm"/><origin xyz="0.1 0 0" rpy="0 1.5707963267948966 0"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.4" velocity="0.5" effort="10"/></joint>
  <link name="palm"><collision><geometry><box size="0.04 0.12 0.04"/></geometry></collision></link>
  <joint name="grip" type="prismatic"><parent link="palm"/><child link="left_finger"/><origin xyz="0 0.005 0.06"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" velocity="0.1" effort="10"/></joint>
  <link name="left_finger"><collision><geometry><box size="0.02 0.01 0.07"/></geometry></collision></link>
  <joint name="grip_mirror" type="prismatic"><parent link="palm"/><child link="right_finger"/><origin xyz="0 -0.005 0.06"/>
    <axis xyz="0 -1 0"/><limit lower="0" upper="0.04" velocity="0.1" effort="10"/><mimic joint="grip"/></joint>
  <link name="right_finger"><collision><geometry><box size="0.02 0.01 0.07"/></geometry></collision></link>
  <joint name="tip" type="fixed"><parent link="palm"/><child link="tcp"/><origin xyz="0 0 0.08"/></joint>
  <link name="tcp"/>
</robot>
"""


@pytest.fixture
def toy_urdf(tmp_path: Path) -> Callable[..., Path]:
    """Writes the toy robot, three joints and a gripper of boxes, with some of its text replaced: toy_urdf(("old", "new"), …)."""

    def write(*changes: tuple[str, str]) -> Path:
        text = TOY
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        file = tmp_path / "toy.urdf"
        file.write_text(text)
        return file

    return write


def pose(T: np.ndarray) -> Json:
    """A pose as files have it."""
    return {"p": T[:3, 3].tolist(), "q_wxyz": wxyz_from_rotation(T[:3, :3]).tolist()}


@dataclass(frozen=True)
class Handmade:
    """A scene and a plan in the files' form, the plan made by hand."""

    scene: Json
    plan: Json


@pytest.fixture(scope="session")
def handmade(ur5e: Robot) -> Handmade:
    """A can is moved aside and the box behind it is pulled out, the hand moving along straight lines; nothing collides."""
    can, box = transform(p=[0.62, 0.02, 0.10 + 0.09]), transform(p=[0.76, -0.02, 0.10 + 0.08])
    aside = transform(p=[0.62, 0.27, 0.10 + 0.09])
    arm = _Hand(ur5e)
    back, lift = np.array([-0.12, 0, 0]), np.array([0, 0, 0.03])
    arm.at(can[:3, 3] + back)
    q_start = dict(zip(ur5e.joint_names, arm.q.tolist()))
    scene = {
        "schema": "retrieve/scene@2", "id": "handmade",
        "robot": {"name": "ur5e", "T_world_base": pose(np.eye(4)), "q_start": q_start},
        "cabinet": {"size_m": [0.56, 0.86, 0.50], "T_world_cabinet": pose(transform(p=[0.52, 0.0, 0.10])), "wall_m": 0.03},
        "regions": {"n": 10}, "target": "box",
        "objects": [{"name": "can", "shape": {"type": "cylinder", "radius_m": 0.025, "height_m": 0.18}, "T_world_object": pose(can)},
                    {"name": "box", "shape": {"type": "box", "size_m": [0.05, 0.05, 0.16]}, "T_world_object": pose(box)}],
        "grasp": {"T_world_hand": pose(transform(SIDEWAYS, box[:3, 3])), "width_m": 0.05},
    }  # fmt: skip
    arm.pick("can", can, back, lift)
    arm.line("transfer", aside[:3, 3] - can[:3, 3])
    arm.line("lower", -lift, ("can", "floor"))
    arm.open("release", "can")
    arm.line("retreat", back, release="can")
    arm.line("transit", box[:3, 3] + back - (aside[:3, 3] + back))
    arm.pick("box", box, back, lift)
    arm.line("transfer", np.array([-0.29, 0, 0.05]))
    plan = {
        "schema": "retrieve/plan@1", "scene": "handmade", "policy": "by hand", "rule": "deep", "success": True, "reason": None,
        "moves": [{"object": "can", "region": 28, "T_world_from": pose(can), "T_world_to": pose(aside), "done": True, "reason": None}],
        "motions": arm.motions,
        "planning_time_s": 0.0, "motion_time_s": 0.0, "hand_travel_m": 1.0, "return": 0.0, "verified": False,
    }  # fmt: skip
    return Handmade(scene, plan)


@pytest.fixture(scope="session", params=[(spec, i) for spec, n in PLANNED.items() for i in range(n)], ids=lambda p: f"{p[0]}-{p[1]}")
def planned(request: pytest.FixtureRequest, ur5e: Robot) -> Handmade:
    """A scene and its plan as `retrieve gen | retrieve plan` write them, one after the other."""
    spec, index = request.param
    return make_plan(ur5e, spec, index, ("local", "random")[index % 2])


def make_plan(robot: Robot, spec: str, index: int, policy: str) -> Handmade:
    """Scene `index` of a spec before a named robot, and its plan, as they come back from files."""
    pytest.importorskip("planning.retrieval")
    from planning.io.plan_documents import plan_to_json
    from planning.io.scene_documents import scene_to_json
    from planning.motion.pick_place import Motions
    from planning.policies import make_policy
    from planning.retrieval import retrieve
    from planning.rules import Rule
    from planning.scenes.generation import generate, load_spec

    scene = generate(load_spec(spec), robot, to_ref(robot), 11, index)
    motions = Motions(robot, scene)
    rng = np.random.default_rng([11, index])
    plan = retrieve(scene, make_policy(policy, motions), motions, name=policy, rule=Rule.DEEP, rng=rng)
    return Handmade(*json.loads(json.dumps([scene_to_json(scene), plan_to_json(plan)])))


class _Hand:
    """Draws motions along straight lines of the hand, which always looks along the world's x."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.chain = robot, robot.chain(np.eye(4))
        self.T_frame_hand = robot.frame_of_links(0.0, np.eye(4))["hand"][1]
        self.wide = robot.opening.value_at(0.08)
        self.held: Json | None = None
        self.motions: list[Json] = []
        self.touch: list[list[str]] = []

    def at(self, p: np.ndarray) -> None:
        """Begin with the open hand at p, elbow and wrist up."""
        seeds, up = make_seeds(self.chain, self.T_frame_hand), np.array([-2.5, -1.6, -2.3, -2.3, -1.0, 1.57])
        found = solve(self.chain, self.T_frame_hand, seeds, transform(SIDEWAYS, p), up, tries=200)
        self.p, self.q = p, self.robot.with_arm(found[0], self.wide)

    def line(self, stage: str, by: np.ndarray, *touch: tuple[str, str], release: str | None = None) -> None:
        """Move the hand by a vector, waypoints 2 cm apart."""
        n = int(np.ceil(np.linalg.norm(by) / 0.02))
        rows, q = [self.q], self.robot.arm_q(self.q).copy()
        scratch = make_work(self.chain)
        for i in range(1, n + 1):
            assert descend(self.chain, self.T_frame_hand, transform(SIDEWAYS, self.p + by * i / n), q, *scratch, 40), (stage, i)
            rows.append(self.robot.with_arm(q, self.q[self.robot.gripper_joint]))
        self.p = self.p + by
        body = self.held["body"] if self.held else release
        self._add(stage, np.array(rows), [*touch, *((f, body) for f in sorted(self.robot.fingers) if body)])

    def pick(self, body: str, T: np.ndarray, back: np.ndarray, lift: np.ndarray) -> None:
        """Approach, close, lift."""
        self.line("approach", T[:3, 3] - self.p)
        shut = self.robot.opening.value_at(0.05)
        self._turn("grasp", shut, body)
        self.held = {"body": body, "T_hand_body": pose(np.linalg.inv(transform(SIDEWAYS, self.p)) @ T)}
        self.line("lift", lift, (body, "floor"))

    def open(self, stage: str, body: str) -> None:
        self.held = None
        self._turn(stage, self.wide, body)

    def _turn(self, stage: str, value: float, body: str) -> None:
        end = self.q.copy()
        end[self.robot.gripper_joint] = value
        self._add(stage, np.array([self.q, end]), [(f, body) for f in sorted(self.robot.fingers)])

    def _add(self, stage: str, Q: np.ndarray, touch: list[tuple[str, str]]) -> None:
        t = np.concatenate([[0.0], np.cumsum(np.max(np.abs(np.diff(Q, axis=0)) / self.robot.velocity, axis=1) * 1.5 + 1e-3)])
        self.q = Q[-1]
        self.motions.append({"stage": stage, "joint_names": list(self.robot.joint_names), "q": Q.tolist(), "t_s": t.tolist(),
                             "held": self.held, "may_touch": [list(pair) for pair in touch]})  # fmt: skip
