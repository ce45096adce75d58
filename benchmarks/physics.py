"""Executes plans in MuJoCo: do they succeed where physics decides, and how much may the world differ from the plan?

    pip install mujoco
    python benchmarks/physics.py scenes.jsonl plans.jsonl [--objects-mm 3] [--base-mm 2] [--friction 0.8] [--step-ms 1] [--limit 100]

A development tool: the product itself has no physics engine. The arm follows the plan's trajectory under computed torque, the fingers
close with a given force, objects are free bodies with friction. A plan succeeds when the target ends in the hand, outside the cabinet; it
is clean when, besides, no link and no held object touched what it was not allowed to touch.

Objects are displaced on the floor in a random direction, by the given length; the base likewise. One JSON line of totals goes to stdout,
and with --verbose one a plan to stderr. MuJoCo lets a held object creep with the time step: repeat what touched in a transfer with
--step-ms 0.5.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from kinematics.quintic_spline import evaluate, hermite
from kinematics.robots.load import from_ref
from kinematics.robots.robot import Robot
from kinematics.robots.tree import FIXED, SLIDES
from kinematics.scene import Body, Scene
from kinematics.shapes import Box, Cylinder, convex_parts
from kinematics.transforms import Array, inverse, transform, wxyz_from_rotation
from planning.io.files import read_plans, read_scenes
from planning.plan import Motion, Plan

STIFFNESS, DAMPING = 10000.0, 200.0  # of the arm's tracking, 1/s² and 1/s: 100 rad/s, critically damped
CONTACT = [0.004, 1.0], [0.95, 0.99, 0.0005, 0.5, 2.0]  # MuJoCo's own contacts let 40 N press two millimetres deep
SETTLE_S = 0.3  # that objects have to come to rest before anything moves
LOST_M = 0.03  # an object that is so far from where the hand should hold it was dropped
FALLEN_DEG = 30.0
SIDES = 96  # of the prism that stands for a cylinder
SINK_M = 0.0005  # contacts shallower than this are the solver's


@dataclass(frozen=True)
class Settings:
    """What is varied. Lengths in metres, the force in newtons a pad, masses in kg."""

    objects_m: float = 0.0
    base_m: float = 0.0
    friction: float = 0.8
    step_s: float = 0.001
    force_n: float = 40.0
    masses: tuple[float, float] = (0.2, 0.5)


@dataclass(frozen=True)
class Outcome:
    """What became of a plan. touched: pairs that touched and were not allowed to, with the stage; error_rad: the worst tracking error."""

    success: bool
    why: str | None
    touched: tuple[tuple[str, str, str], ...]
    fallen: tuple[str, ...]
    error_rad: float
    torque_nm: float


@dataclass(frozen=True)
class Squeeze:
    """How the gripper's joint closes: the torque or force at it, and the speed beyond which it does not go, as the plan closes it. Fingers
    that nothing slows come at half a metre a second, and strike what they meet out of the hand."""

    force: float
    speed: float


class World:
    """A robot, a cabinet and objects in MuJoCo."""

    def __init__(self, robot: Robot, scene: Scene, settings: Settings, rng: np.random.Generator) -> None:
        self.robot, self.scene, self.settings = robot, scene, settings
        self.T_base = scene.robot.T_world_base @ transform(p=settings.base_m * _direction(rng))
        spec = mujoco.MjSpec()
        spec.option.timestep, spec.option.cone = settings.step_s, mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio, spec.option.integrator = 20.0, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.noslip_iterations = 5  # without it a held object creeps out of the fingers
        self._add_robot(spec)
        for body in (*scene.cabinet.walls(), *getattr(scene, "obstacles", ())):
            self._add_shape(spec, spec.worldbody.add_body(name=f"wall:{body.name}", **_at(body.T_world_body)), body, None)
        for body in scene.objects:
            T = body.T_world_body.copy()
            T[:3, 3] += settings.objects_m * _direction(rng)
            free = spec.worldbody.add_body(name=f"object:{body.name}", **_at(T))
            free.add_freejoint()
            self._add_shape(spec, free, body, float(rng.uniform(*settings.masses)))
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._index()

    def _add_robot(self, spec: Any) -> None:
        tree, links = self.robot.tree, list[Any]()
        solid = {hull.link for hull in self.robot.hulls}
        for i, name in enumerate(tree.names):
            root = tree.parent[i] < 0
            parent = spec.worldbody if root else links[tree.parent[i]]
            link = parent.add_body(name=f"link:{name}", **_at(self.T_base @ tree.T_joint[i] if root else tree.T_joint[i]))
            link.gravcomp = 1.0  # the controller compensates the arm's own weight
            if name not in solid:  # what has no hull weighs next to nothing; the others have the density of water
                link.explicitinertial, link.mass, link.inertia = True, 0.01, [1e-5] * 3
            links.append(link)
            if tree.kind[i] != FIXED:
                kind = mujoco.mjtJoint.mjJNT_SLIDE if tree.kind[i] == SLIDES else mujoco.mjtJoint.mjJNT_HINGE
                link.add_joint(
                    name=f"joint:{name}", type=kind, axis=tree.axis[i], armature=0.05 if i in self._arm_links() else 0.002, damping=0.0
                )
        for n, hull in enumerate(self.robot.hulls):
            spec.add_mesh(name=f"hull:{n}", uservert=hull.vertices.ravel())
            geom = links[tree.index[hull.link]].add_geom(
                name=f"link:{hull.link}:{n}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"hull:{n}"
            )
            geom.friction, geom.contype, geom.conaffinity, geom.condim = [self.settings.friction, 0.01, 0.001], 1, 2, 4
            geom.solref, geom.solimp = CONTACT
        self._add_mimics(spec)

    def _arm_links(self) -> set[int]:
        return {i for i in range(len(self.robot.tree.names)) if self.robot.tree.q_index[i] in self.robot.arm_joints}

    def _add_mimics(self, spec: Any) -> None:
        """Fingers that follow the gripper's joint, as the tree says: scale · q + offset."""
        tree, g = self.robot.tree, self.robot.gripper_joint
        moved = [i for i in range(len(tree.names)) if tree.q_index[i] == g]
        leader = next(i for i in moved if tree.scale[i] == 1.0 and tree.offset[i] == 0.0)
        self.leader = tree.names[leader]
        for i in moved:
            if i != leader:
                tie = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=f"joint:{tree.names[i]}", name2=f"joint:{self.leader}")
                tie.objtype = mujoco.mjtObj.mjOBJ_JOINT
                tie.data[:2] = tree.offset[i], tree.scale[i]
                tie.solref, tie.solimp = [0.004, 1.0], [0.99, 0.999, 0.001, 0.5, 2.0]

    def _add_shape(self, spec: Any, body: Any, solid: Body, mass: float | None) -> None:
        parts: list[dict[str, Any]] = []
        match solid.shape:
            case Box():
                parts.append({"type": mujoco.mjtGeom.mjGEOM_BOX, "size": solid.shape.half})
            case shape:
                for n, part in enumerate([_prism(shape)] if isinstance(shape, Cylinder) else convex_parts(shape)):
                    spec.add_mesh(name=f"part:{solid.name}:{n}", uservert=part.ravel())
                    parts.append({"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": f"part:{solid.name}:{n}"})
        for n, part in enumerate(parts):
            geom = body.add_geom(name=f"{body.name}:{n}", **part)
            geom.friction, geom.condim = [self.settings.friction, 0.01, 0.001], 4
            geom.contype, geom.conaffinity = 2, 3 if mass is not None else 1
            geom.solref, geom.solimp = CONTACT
            if mass is not None:
                geom.mass = mass / len(parts)

    def _index(self) -> None:
        m, tree = self.model, self.robot.tree
        names = [mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_BODY, i) for i in range(m.nbody)]
        self.name_of = [names[m.geom_bodyid[g]] or "" for g in range(m.ngeom)]
        self.body_id = {name: i for i, name in enumerate(names)}
        moving = [(i, m.joint(f"joint:{n}")) for i, n in enumerate(tree.names) if tree.kind[i] != FIXED]
        self.q_at = np.array([j.qposadr[0] for _, j in moving])
        self.v_at = np.array([j.dofadr[0] for _, j in moving])
        self.drives = np.array([tree.q_index[i] for i, _ in moving])
        self.scale, self.offset = np.array([tree.scale[i] for i, _ in moving]), np.array([tree.offset[i] for i, _ in moving])
        self.arm = np.isin(self.drives, self.robot.arm_joints)
        self.grip_dof = int(m.joint(f"joint:{self.leader}").dofadr[0])
        self.grip_q = int(m.joint(f"joint:{self.leader}").qposadr[0])

    def place(self, q: Array) -> None:
        """The arm at q (J,), at rest; objects settle."""
        self.data.qpos[self.q_at] = self.scale * q[self.drives] + self.offset
        mujoco.mj_forward(self.model, self.data)

    def step(self, q: Array, qd: Array, qdd: Array, squeeze: Squeeze | None) -> float:
        """One time step after a reference (J,); squeeze: how the gripper closes, None to hold it at q. The largest arm error."""
        m, d = self.model, self.data
        error = self.scale * q[self.drives] + self.offset - d.qpos[self.q_at]
        rate = self.scale * qd[self.drives] - d.qvel[self.v_at]
        wanted = np.zeros(m.nv)
        wanted[self.v_at[self.arm]] = (self.scale * qdd[self.drives] + STIFFNESS * error + DAMPING * rate)[self.arm]
        force = np.zeros(m.nv)
        mujoco.mj_mulM(m, d, force, wanted)
        d.qfrc_applied[:] = 0.0
        arm = self.v_at[self.arm]
        d.qfrc_applied[arm] = force[arm] + d.qfrc_bias[arm] - d.qfrc_gravcomp[arm]
        g = self.robot.gripper_joint
        if squeeze is None:
            m.dof_damping[self.grip_dof] = 0.0
            d.qfrc_applied[self.grip_dof] = 200.0 * (q[g] - d.qpos[self.grip_q]) + 4.0 * (qd[g] - d.qvel[self.grip_dof])
        else:
            m.dof_damping[self.grip_dof] = abs(squeeze.force) / squeeze.speed
            d.qfrc_applied[self.grip_dof] = squeeze.force
        mujoco.mj_step(m, d)
        return float(np.abs(error[self.arm]).max())

    def contacts(self) -> Iterator[tuple[str, str]]:
        """Pairs of bodies that touch by more than the solver's depth, as link:…, object:… or wall:…."""
        for c in self.data.contact[: self.data.ncon]:
            if c.dist < -SINK_M:
                yield self.name_of[c.geom1], self.name_of[c.geom2]

    def pose(self, body: str) -> Array:
        """T_world_body (4, 4)."""
        i = self.body_id[body]
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.data.xmat[i].reshape(3, 3), self.data.xpos[i]
        return T


def execute(robot: Robot, scene: Scene, plan: Plan, settings: Settings, rng: np.random.Generator) -> Outcome:
    """Carry a plan out and say what became of it."""
    world = World(robot, scene, settings, rng)
    world.place(plan.motions[0].q[0])
    still = np.zeros(len(robot.joint_names))
    for _ in range(round(SETTLE_S / settings.step_s)):
        world.step(plan.motions[0].q[0], still, still, None)
    start = {b.name: world.pose(f"object:{b.name}") for b in scene.objects}
    touched: Counter[tuple[str, str, str]] = Counter()
    worst, torque, squeeze = 0.0, 0.0, None
    for motion in plan.motions:
        if motion.stage == "grasp":
            squeeze = _squeeze(robot, motion, settings.force_n)
        elif motion.held is None:
            squeeze = None
        for n, (q, qd, qdd) in enumerate(references(motion, settings.step_s)):
            worst = max(worst, world.step(q, qd, qdd, squeeze))
            torque = max(torque, float(np.abs(world.data.qfrc_applied[world.v_at[world.arm]]).max()))
            if n % 4 == 0:
                touched.update((motion.stage, *pair) for pair in _unwanted(world, motion))
    return _judge(world, plan, start, tuple(touched), worst, torque)


def references(motion: Motion, step_s: float) -> Iterator[tuple[Array, Array, Array]]:
    """Position, velocity, acceleration (J,) at every step: the motion's spline, or its polyline from rest to rest between the rows."""
    qd, qdd = getattr(motion, "qd", None), getattr(motion, "qdd", None)
    times = np.arange(0.0, float(motion.t_s[-1]), step_s)
    if qd is not None and qdd is not None and len(qd):
        spline = hermite(motion.t_s, motion.q, qd, qdd)
        yield from zip(*(evaluate(spline, times, order) for order in range(3)))
        return
    for t in times:
        k = min(int(np.searchsorted(motion.t_s, t, "right")) - 1, len(motion.t_s) - 2)
        h = max(float(motion.t_s[k + 1] - motion.t_s[k]), 1e-9)
        x, way = (t - motion.t_s[k]) / h, motion.q[k + 1] - motion.q[k]
        s = x**3 * (10 - 15 * x + 6 * x * x)
        yield motion.q[k] + s * way, 30 * x * x * (1 - x) ** 2 / h * way, 60 * x * (1 - x) * (1 - 2 * x) / h**2 * way


def _squeeze(robot: Robot, motion: Motion, force_n: float) -> Squeeze:
    """What presses each pad with so much force, by virtual work over the opening's table, as fast as a motion moves the fingers."""
    value = float(motion.q[-1, robot.gripper_joint])
    table = robot.opening
    order = np.argsort(table.value)
    width = np.interp([value - 1e-3, value + 1e-3], table.value[order], table.width_m[order])
    fastest = np.abs(np.diff(motion.q[:, robot.gripper_joint]) / np.diff(motion.t_s)).max(initial=0.0)
    return Squeeze(-force_n * float(width[1] - width[0]) / 2e-3, max(float(fastest), 1e-3))


def _unwanted(world: World, motion: Motion) -> Iterator[tuple[str, str]]:
    allowed = {frozenset(pair) for pair in motion.allowed_contacts}
    held = motion.held.body if motion.held else None
    for a, b in world.contacts():
        kinds = {a.split(":")[0], b.split(":")[0]}
        names = frozenset(x.split(":", 1)[1] for x in (a, b))
        if names in allowed or kinds == {"link"} or (names & world.robot.pads and held in names):
            continue
        if "link" in kinds or (held in names and names != {held}):
            yield min(a, b), max(a, b)


def _judge(
    world: World, plan: Plan, start: Mapping[str, Array], touched: tuple[tuple[str, str, str], ...], worst: float, torque: float
) -> Outcome:
    scene, last = world.scene, plan.motions[-1]
    fallen = []
    for body in scene.objects:
        if body.name != scene.target:
            up = world.pose(f"object:{body.name}")[:3, :3] @ start[body.name][:3, :3].T
            if np.degrees(np.arccos(np.clip(up[2, 2], -1, 1))) > FALLEN_DEG:
                fallen.append(body.name)
    why = None
    if last.held is None or last.held.body != scene.target:
        why = "the plan does not end with the target in the hand"
    else:
        T_hand_body = inverse(world.pose("link:hand")) @ world.pose(f"object:{scene.target}")
        if np.linalg.norm(T_hand_body[:3, 3] - last.held.T_hand_body[:3, 3]) > LOST_M:
            why = "the target was dropped"
        elif scene.cabinet.contains(world.pose(f"object:{scene.target}")[:3, 3]):
            why = "the target is still in the cabinet"
    if fallen and why is None:
        why = f"{', '.join(fallen)} fell"
    return Outcome(why is None, why, touched, tuple(fallen), worst, torque)


def _prism(can: Cylinder) -> Array:
    """The corners (2 SIDES, 3) of a cylinder as MuJoCo gets it. Of its own cylinder and an edge of a pad that lie along each other it finds
    one contact, now at one end of their line and now at the other: a can held by the pads' ends was turned about and thrown out of a hand
    that had hardly any angle to hold. Of a prism it finds both ends of the line."""
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = can.radius_m * np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    return np.concatenate([ring + np.array([0.0, 0.0, z]) for z in (-can.height_m / 2, can.height_m / 2)])


def _direction(rng: np.random.Generator) -> Array:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _at(T: Array) -> dict[str, Any]:
    return {"pos": T[:3, 3], "quat": wxyz_from_rotation(T[:3, :3])}


def main() -> int:
    """Execute the plans of a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", type=Path)
    parser.add_argument("plans", type=Path)
    parser.add_argument("--objects-mm", type=float, default=0.0, help="how far each object is displaced")
    parser.add_argument("--base-mm", type=float, default=0.0, help="how far the robot's base is displaced")
    parser.add_argument("--friction", type=float, default=0.8)
    parser.add_argument("--step-ms", type=float, default=1.0)
    parser.add_argument("--force", type=float, default=40.0, help="newtons a pad")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=int, help="execute so many solved plans")
    parser.add_argument("--verbose", action="store_true", help="a line a plan on stderr")
    asked = parser.parse_args()
    settings = Settings(asked.objects_mm / 1000, asked.base_mm / 1000, asked.friction, asked.step_ms / 1000, asked.force)
    scenes = {scene.id: scene for _, scene in read_scenes(asked.scenes)}
    outcomes = list[Outcome]()
    for number, (_, plan) in enumerate(read_plans(asked.plans)):
        if not plan.success or not plan.motions:
            continue
        scene = scenes[plan.scene]
        done = execute(from_ref(scene.robot), scene, plan, settings, np.random.default_rng([asked.seed, number]))
        outcomes.append(done)
        if asked.verbose:
            print(json.dumps({"scene": plan.scene, **vars(replace(done, touched=done.touched[:4]))}), file=sys.stderr, flush=True)
        if len(outcomes) == asked.limit:
            break
    stages = Counter(stage for o in outcomes for stage in {t[0] for t in o.touched})
    totals = {
        "plans": len(outcomes),
        "succeed": sum(o.success for o in outcomes),
        "clean": sum(o.success and not o.touched for o in outcomes),
        "touched_in": dict(stages),
        "why": Counter(o.why for o in outcomes if o.why),
        "worst_error_mrad": round(1000 * max((o.error_rad for o in outcomes), default=0.0), 2),
        "peak_torque_nm": round(max((o.torque_nm for o in outcomes), default=0.0), 1),
        **{k: v for k, v in vars(asked).items() if k in ("objects_mm", "base_mm", "friction", "step_ms", "force", "seed")},
    }
    print(json.dumps(totals))
    return 0


if __name__ == "__main__":
    sys.exit(main())
