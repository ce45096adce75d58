"""Other planners on the questions that benchmarks/motion.py asks, each run in an environment of its own: nothing of ours is imported.

Usage: PYTHON peers.py PEER QUESTIONS.json ANSWERS.json BUDGET_S, as motion.py calls it. A question is all geometry: the frames of a serial
arm (every joint turns about z), convex parts fixed to them, boxes and cylinders at rest, which pairs count, start and goal. Answers: for
each question seconds to plan, seconds with shortcutting, and the path or null, or null instead of an answer where the peer knows no such
robot; and how many configurations a second the peer checks.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

STEP = 0.02
"""Length in joint space, rad, between the configurations that planners check; ours checks none, it certifies edges."""
RANGE = 1.0  # longest edge that one extension adds, rad
SHORTCUTS = 100
clock = time.process_time  # processor time: other work on the machine does not count, and the planners all use one core
Json = dict[str, Any]
Touches = Callable[[np.ndarray], bool]


def arrays(question: Json) -> Json:
    """The question with its lists as arrays."""
    part = lambda p: {**p, "vertices": np.array(p["vertices"]), "faces": np.array(p["faces"])}  # noqa: E731
    solid = lambda s: {**s, "T": np.array(s["T"])}  # noqa: E731
    lists = {k: np.array(question[k]) for k in ("T_prev", "lower", "upper", "start", "goal")}
    return {**question, **lists, "parts": [part(p) for p in question["parts"]], "solids": [solid(s) for s in question["solids"]]}


def along(path: np.ndarray, step: float) -> np.ndarray:
    """Configurations on a path (K, J), not more than a step apart."""
    rows = [path[:1]]
    for a, b in pairwise(path):
        n = max(1, int(np.ceil(np.linalg.norm(b - a) / step)))
        rows.append(a + np.arange(1, n + 1)[:, None] / n * (b - a))
    return np.concatenate(rows)


# Pinocchio and coal: the peer's checker, and the judge of all paths


class CoalWorld:
    """A question in pinocchio and coal; broad: through its broad-phase manager, else all pairs, each behind its boxes. without: links that
    may touch."""

    def __init__(self, question: Json, broad: bool = True, without: Sequence[str] = ()) -> None:
        import coal
        import pinocchio as pin

        self.pin, self.model, self.geometry = pin, pin.Model(), pin.GeometryModel()
        at, frames = 0, [0]
        for k, T in enumerate(question["T_prev"]):
            at = self.model.addJoint(at, pin.JointModelRZ(), pin.SE3(T), f"j{k}")
            frames.append(at)
        self.keep = []
        for i, part in enumerate(question["parts"]):
            mesh = coal.BVHModelOBBRSS()
            mesh.beginModel(len(part["faces"]), len(part["vertices"]))
            mesh.addSubModel(_points(coal, part["vertices"]), _triangles(coal, part["faces"]))
            mesh.endModel()
            mesh.buildConvexHull(True, "Qt")
            self.keep.append(mesh)
            self._add(f"p{i}", frames[part["frame"]], np.eye(4), mesh.convex)
        for i, solid in enumerate(question["solids"]):
            size = 2 * np.array(solid["half"])
            shape = coal.Box(*size) if solid["kind"] == "box" else coal.Cylinder(solid["half"][0], size[2])
            self._add(f"s{i}", 0, solid["T"], shape)
        n = len(question["parts"])
        may_touch = {i for i, part in enumerate(question["parts"]) if part.get("link") in without}
        pairs = [*question["pairs"], *((p, n + s) for p, s in question["check"])]
        for a, b in (pair for pair in pairs if may_touch.isdisjoint(pair)):
            self.geometry.addCollisionPair(pin.CollisionPair(int(a), int(b)))
        self.data, self.state = self.model.createData(), self.geometry.createData()
        self.manager = None
        if broad:
            self.manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(self.model, self.geometry, self.state)

    def _add(self, name: str, joint: int, T: np.ndarray, shape: Any) -> None:
        self.geometry.addGeometryObject(self.pin.GeometryObject(name, joint, self.pin.SE3(T), shape))

    def touches(self, q: np.ndarray) -> bool:
        if self.manager is not None:
            return bool(self.pin.computeCollisions(self.model, self.data, self.manager, q, True))
        return bool(self.pin.computeCollisions(self.model, self.data, self.geometry, self.state, q, True))


def _points(coal: Any, vertices: np.ndarray) -> Any:
    points = coal.StdVec_Vec3s()
    for v in vertices:
        points.append(v)
    return points


def _triangles(coal: Any, faces: np.ndarray) -> Any:
    triangles = coal.StdVec_Triangle()
    for a, b, c in faces:
        triangles.append(coal.Triangle(int(a), int(b), int(c)))
    return triangles


# RRT-Connect in Python, for checkers that come without a planner


def rrt_connect(touches: Touches, question: Json, budget_s: float, seed: int) -> np.ndarray | None:
    """A path (K, J) whose configurations, a STEP apart, all are free; None when the time is over."""
    end, rng = clock() + budget_s, np.random.default_rng(seed)
    lower, upper = question["lower"], question["upper"]
    if touches(question["start"]) or touches(question["goal"]):
        return None
    trees = [([question["start"]], [-1]), ([question["goal"]], [-1])]

    def clear(a: np.ndarray, b: np.ndarray) -> bool:
        return edge_clear(touches, a, b, end)

    def extend(side: int, target: np.ndarray) -> bool:
        """One edge towards the target; whether it was added."""
        nodes, parents = trees[side]
        d = np.linalg.norm(np.array(nodes) - target, axis=1)
        near = int(np.argmin(d))
        new = nodes[near] + min(1.0, RANGE / max(d[near], 1e-12)) * (target - nodes[near])
        if d[near] > 0 and not clear(nodes[near], new):
            return False
        nodes.append(new)
        parents.append(near)
        return True

    side = 0
    if clear(question["start"], question["goal"]):
        return np.array([question["start"], question["goal"]])
    while clock() < end:
        if extend(side, rng.uniform(lower, upper)):
            meeting = trees[side][0][-1]
            while clock() < end and extend(1 - side, meeting):
                if np.allclose(trees[1 - side][0][-1], meeting):
                    ways = []
                    for nodes, parents in trees:
                        way, at = [], len(nodes) - 1
                        while at >= 0:
                            way.append(nodes[at])
                            at = parents[at]
                        ways.append(way)
                    return np.array(ways[0][::-1] + ways[1][1:])
        side = 1 - side
    return None


def edge_clear(touches: Touches, a: np.ndarray, b: np.ndarray, end: float = np.inf) -> bool:
    n = max(1, int(np.ceil(np.linalg.norm(b - a) / STEP)))
    for i in range(1, n + 1):  # noqa: SIM110
        if touches(a + i / n * (b - a)) or (i % 16 == 0 and clock() > end):
            return False
    return True


def shortcut(touches: Touches, path: np.ndarray, seed: int) -> np.ndarray:
    """Random shortcuts."""
    rng, points = np.random.default_rng(seed), list(path)
    for _ in range(SHORTCUTS):
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        u, v = np.sort(rng.uniform(0, at[-1], 2))
        i, j = (min(int(np.searchsorted(at, x, side="right")) - 1, len(points) - 2) for x in (u, v))
        if i == j:
            continue
        a, b = (points[k] + (x - at[k]) / max(lengths[k], 1e-12) * (points[k + 1] - points[k]) for k, x in ((i, u), (j, v)))
        if edge_clear(touches, a, b):
            points = [*points[: i + 1], a, b, *points[j + 1 :]]
    return np.array(points)


def in_python(touches: Touches, question: Json, budget_s: float, seed: int) -> Json:
    """Plan and shortcut with the two above."""
    began = clock()
    path = rrt_connect(touches, question, budget_s, seed)
    planned = clock()
    short = None if path is None else shortcut(touches, path, seed)
    return answer(planned - began, clock() - began, short)


def answer(plan_s: float, both_s: float, path: Any) -> Json:
    return {"plan_s": plan_s, "both_s": both_s, "path": None if path is None else np.asarray(path).tolist()}


def rate(check: Callable[[np.ndarray], object], configurations: np.ndarray, at_least_s: float = 1.0) -> float:
    """Checks a second, one after the other."""
    n, began = 0, clock()
    while clock() - began < at_least_s:
        for q in configurations[n % len(configurations) :][:200]:
            check(q)
            n += 1
    return n / (clock() - began)


# The peers: each yields a checker (or None) and a planner for a question


def ompl(question: Json, seed: int) -> tuple[Touches, Callable[[float], Json]]:
    """OMPL 2's RRTConnect and path simplifier, pinocchio and coal as its checker."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    if seed == 0:
        util.RNG.setSeed(1)
    n, world = len(question["lower"]), CoalWorld(question)
    space, bounds = base.RealVectorStateSpace(n), base.RealVectorBounds(n)
    for i in range(n):
        bounds.setLow(i, float(question["lower"][i]))
        bounds.setHigh(i, float(question["upper"][i]))
    space.setBounds(bounds)
    setup, q = geometric.SimpleSetup(space), np.zeros(n)

    def valid(state: Any) -> bool:
        for i in range(n):
            q[i] = state[i]
        return not world.touches(q)

    setup.setStateValidityChecker(valid)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(STEP / float(np.linalg.norm(question["upper"] - question["lower"])))
    ends = []
    for values in (question["start"], question["goal"]):
        state = space.allocState()
        for i in range(n):
            state[i] = float(values[i])
        ends.append(state)
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRTConnect(information))

    def solve(budget_s: float) -> Json:
        began = clock()
        setup.solve(base.PlannerTerminationCondition(lambda: clock() - began > budget_s))
        planned = clock()
        if not setup.haveExactSolutionPath():
            return answer(planned - began, planned - began, None)
        setup.simplifySolution()
        both = clock()
        return answer(planned - began, both - began, [[s[i] for i in range(n)] for s in setup.getSolutionPath().getStates()])

    return world.touches, solve


def roboplan(question: Json, seed: int) -> tuple[Touches, Callable[[float], Json]]:
    """roboplan's RRT-Connect and its shortcutter; pinocchio and coal inside, all compiled."""
    from roboplan import core, rrt

    with written(question) as (urdf, srdf):
        scene = core.Scene("cabinet", core.loadUrdfSceneDescription(str(urdf)))
        scene.importSrdf(srdf.read_text())
    scene.setRngSeed(seed)
    n = len(question["lower"])
    scene.addGroupFromChain("arm", "l0", f"l{n}")
    for i, solid in enumerate(question["solids"]):
        half, T, colour = solid["half"], np.asfortranarray(solid["T"]), np.ones(4)
        if solid["kind"] == "box":
            scene.addBoxGeometry(f"s{i}", "universe", core.Box(*(2 * h for h in half)), T, colour)
        else:
            scene.addCylinderGeometry(f"s{i}", "universe", core.Cylinder(half[0], 2 * half[2]), T, colour)
        for p, part in enumerate(question["parts"]):
            if part["frame"] == 0:
                scene.setCollisions(f"s{i}", f"p{p}", False)
        for j in range(i):
            scene.setCollisions(f"s{i}", f"s{j}", False)
    names = [f"j{k}" for k in range(n)]

    def solve(budget_s: float) -> Json:
        start, goal = (core.JointConfiguration(names, question[k]) for k in ("start", "goal"))
        options = rrt.RRTOptions("arm", 10**6, RANGE, STEP, max_planning_time=2 * budget_s, rrt_connect=True)
        began = clock()
        planner = rrt.RRT(scene, options)
        try:
            path = planner.plan(start, goal)
        except RuntimeError:
            return answer(clock() - began, clock() - began, None)
        planned = clock()
        short = core.PathShortcutter(scene, core.PathShortcuttingOptions("arm", STEP, SHORTCUTS, seed)).shortcut(path)
        both = clock()
        return answer(planned - began, both - began, short.positions if planned - began < budget_s else None)

    return scene.hasCollisions, solve


def mplib(question: Json, seed: int) -> tuple[Touches, Callable[[float], Json]]:
    """mplib's OMPL planner over its FCL world. It plans twice: without simplification for the first time, with it for the second."""
    from mplib import Planner, Pose
    from mplib.collision_detection import fcl

    n = len(question["lower"])
    with written(question, "") as (urdf, srdf):
        planner = Planner(str(urdf), f"l{n}", srdf=str(srdf), use_convex=True)
    world = planner.planning_world
    for i, solid in enumerate(question["solids"]):
        half = np.array(solid["half"])
        shape = fcl.Box(2 * half) if solid["kind"] == "box" else fcl.Cylinder(half[0], 2 * half[2])
        world.add_object(fcl.FCLObject(f"s{i}", Pose(solid["T"]), [fcl.CollisionObject(shape)], [Pose()]))

    def touches(q: np.ndarray) -> bool:
        world.set_qpos_all(q)
        return bool(world.is_state_colliding())

    def solve(budget_s: float) -> Json:
        times, found = [], None
        for simplify in (False, True):
            began = clock()
            status, found = planner.planner.plan(
                question["start"], [question["goal"]], time=2 * budget_s, range=RANGE, simplify=simplify, verbose=False
            )
            times.append(clock() - began)
            if status != "Exact solution" or times[-1] > 2 * budget_s:
                return answer(times[0], times[0], None)
        return answer(*times, found)

    return touches, solve


def pybullet(question: Json, seed: int) -> tuple[Touches, Callable[[float], Json]]:
    """Bullet's collision detection under the RRT-Connect above."""
    import pybullet as p

    if p.isConnected():
        p.resetSimulation()
    else:
        p.connect(p.DIRECT)
    n = len(question["lower"])
    with written(question) as (urdf, _):
        arm = p.loadURDF(str(urdf), useFixedBase=True, flags=p.URDF_USE_SELF_COLLISION)
    of_link = {p.getJointInfo(arm, j)[12].decode(): j for j in range(p.getNumJoints(arm))}
    joints = [of_link[f"l{k + 1}"] for k in range(n)]
    parts = [of_link[f"p{i}"] for i in range(len(question["parts"]))]
    wanted = {frozenset(map(int, pair)) for pair in question["pairs"]}
    for i, a in enumerate(parts):
        for j, b in enumerate(parts[:i]):
            p.setCollisionFilterPair(arm, arm, a, b, int(frozenset((i, j)) in wanted))
    for solid in question["solids"]:
        half = solid["half"]
        if solid["kind"] == "box":
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half)
        else:
            shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=half[0], height=2 * half[2])
        body = p.createMultiBody(0, shape, basePosition=solid["T"][:3, 3], baseOrientation=_xyzw(solid["T"]))
        for part, link in zip(question["parts"], parts):
            p.setCollisionFilterPair(arm, body, link, -1, int(part["frame"] > 0))

    def touches(q: np.ndarray) -> bool:
        for j, x in zip(joints, q):
            p.resetJointState(arm, j, x)
        p.performCollisionDetection()
        return any(c[8] < 0 for c in p.getContactPoints(arm))

    return touches, lambda budget_s: in_python(touches, question, budget_s, seed)


def vamp(question: Json, seed: int) -> tuple[Touches | None, Callable[[float], Json | None]]:
    """VAMP's RRT-Connect and its simplifier with the settings it comes with, on its own spheres for a Panda with an open, empty hand.

    Its spheres leave parts of the hulls out and stick out elsewhere, and a cylinder becomes the box around it: it has no cylinders.
    """
    if question["robot"] != "panda" or question["carries"]:
        return None, lambda _: None
    import vamp

    arm, base = vamp.panda, question["T_prev"][0] @ _lowered(0.333)  # from the base to the first joint's frame
    world, to_base = vamp.Environment(), np.linalg.inv(base)
    for solid in question["solids"]:
        T = to_base @ solid["T"]
        world.add_cuboid(vamp.Cuboid(T[:3, 3].tolist(), _roll_pitch_yaw(T), list(solid["half"])))
    planning, simplifying = vamp.RRTCSettings(), vamp.SimplifySettings()
    planning.range = vamp.ROBOT_RRT_RANGES["panda"]

    def solve(budget_s: float) -> Json:
        rng, start, goal = arm.halton(), question["start"].astype(np.float32), question["goal"].astype(np.float32)
        began = clock()
        found = arm.rrtc(start, goal, world, planning, rng)
        planned = clock()
        if not found.solved:
            return answer(planned - began, planned - began, None)
        short = arm.simplify(found.path, world, simplifying, rng)
        return answer(planned - began, clock() - began, short.path.numpy())

    return (lambda q: not arm.validate(q.astype(np.float32), world)), solve


PEERS = {"vamp": vamp, "ompl": ompl, "roboplan": roboplan, "mplib": mplib, "pybullet": pybullet}


# A question as a URDF


@contextlib.contextmanager
def written(question: Json, prefix: str | None = None) -> Iterator[tuple[Path, Path]]:
    """The arm as files: links l0 … lK that move, and a link for each part, fixed to one of them; an SRDF for the pairs that don't count.

    prefix: of the mesh files' names, by default their folder.
    """
    with tempfile.TemporaryDirectory() as name:
        folder, n = Path(name), len(question["lower"])
        prefix = f"{folder}/" if prefix is None else prefix
        lines = ['<robot name="arm">', *(f'<link name="l{k}">{_INERTIA}</link>' for k in range(n + 1))]
        for k, T in enumerate(question["T_prev"]):
            limit = f'<limit lower="{question["lower"][k]}" upper="{question["upper"][k]}" effort="100" velocity="1"/>'
            lines.append(_joint(f"j{k}", "revolute", f"l{k}", f"l{k + 1}", T, f'<axis xyz="0 0 1"/>{limit}'))
        for i, part in enumerate(question["parts"]):
            for file in (f"p{i}.stl", f"p{i}.stl.convex.stl"):  # the second name is where mplib looks for hulls
                _write_stl(folder / file, part["vertices"], part["faces"])
            convex = f'<collision_checking><convex name="c{i}"/></collision_checking>'
            mesh = f'<collision name="c{i}"><geometry><mesh filename="{prefix}p{i}.stl"/></geometry></collision>'
            lines.append(f'<link name="p{i}">{_INERTIA}{convex}{mesh}</link>')
            lines.append(_joint(f"f{i}", "fixed", f"l{part['frame']}", f"p{i}", np.eye(4)))
        urdf, srdf = folder / "arm.urdf", folder / "arm.srdf"
        urdf.write_text("\n".join([*lines, "</robot>"]))
        wanted = {frozenset(map(int, pair)) for pair in question["pairs"]}
        skip = [(i, j) for i in range(len(question["parts"])) for j in range(i) if frozenset((i, j)) not in wanted]
        disabled = [f'<disable_collisions link1="p{i}" link2="p{j}" reason="Never"/>' for i, j in skip]
        srdf.write_text("\n".join(['<robot name="arm">', *disabled, "</robot>"]))
        yield urdf, srdf


_INERTIA = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def _joint(name: str, kind: str, parent: str, child: str, T: np.ndarray, rest: str = "") -> str:
    roll, pitch, yaw = _roll_pitch_yaw(T)
    origin = f'<origin xyz="{T[0, 3]} {T[1, 3]} {T[2, 3]}" rpy="{roll} {pitch} {yaw}"/>'
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{origin}{rest}</joint>'


def _roll_pitch_yaw(T: np.ndarray) -> list[float]:
    """Turns about the fixed x, y and z, in this order, rad."""
    return [
        float(np.arctan2(T[2, 1], T[2, 2])),
        float(np.arctan2(-T[2, 0], np.hypot(T[0, 0], T[1, 0]))),
        float(np.arctan2(T[1, 0], T[0, 0])),
    ]


def _lowered(height_m: float) -> np.ndarray:
    """The pose of what is so far below."""
    T = np.eye(4)
    T[2, 3] = -height_m
    return T


def _write_stl(file: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    rows = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("pad", "<u2")])
    rows["corners"] = vertices[faces]
    file.write_bytes(bytes(80) + len(faces).to_bytes(4, "little") + rows.tobytes())


def _xyzw(T: np.ndarray) -> list[float]:
    """The quaternion of a body that stands upright: a turn about z."""
    half = np.arctan2(T[1, 0], T[0, 0]) / 2
    return [0.0, 0.0, float(np.sin(half)), float(np.cos(half))]


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    arguments.add_argument("peer", choices=sorted(PEERS))
    arguments.add_argument("questions", type=Path, help="JSON, as benchmarks/motion.py writes it")
    arguments.add_argument("answers", type=Path, help="where they are written")
    arguments.add_argument("budget_s", type=float, help="seconds for each question")
    asked = arguments.parse_args()
    data = json.loads(asked.questions.read_text())
    answers, checks = [], None
    with quiet():
        for seed, raw in enumerate(data["questions"]):
            question = arrays(raw)
            touches, solve = PEERS[asked.peer](question, seed)
            answers.append(solve(asked.budget_s))
        if data["rate"] is not None:
            touches, _ = PEERS[asked.peer](arrays(data["rate"]["question"]), 0)
            checks = None if touches is None else rate(touches, np.array(data["rate"]["q"]))
    asked.answers.write_text(json.dumps({"answers": answers, "checks_per_s": checks}))


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """What libraries print goes nowhere."""
    with open(os.devnull, "w") as nowhere:
        kept = os.dup(1)
        os.dup2(nowhere.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(kept, 1)
            os.close(kept)


if __name__ == "__main__":
    main()
