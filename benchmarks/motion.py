"""Motion planning in cabinets: this project's core against its FCL-only path and against other planners, on the same questions, in one run.

Half the questions are for a UR5e, half for a Panda, before cabinets of the `paper` spec with 5 to 10 objects. From home to a pregrasp, to a
grasp, and with the target in the hand from home to where it was lifted. Every planner gets the same hulls, boxes and cylinders, start and
goal, and BUDGET_S seconds; times are processor times. All paths are then judged by coal at a tenth of the step that sampling planners
take.

Peers run in environments of their own, made by pip under the cache folder when first asked for; one that can't be had says why in its row.
Usage: python benchmarks/motion.py [--problems 200] [--peers ompl,...]. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import kinematics.cache as cache
from kinematics.chain import Chain, forward
from kinematics.collision import sphere_check
from kinematics.collision.edge_check import config_free
from kinematics.collision.fcl_check import Verdict
from kinematics.collision.fcl_solids import hull_solid
from kinematics.collision.geometry import BOX, CYLINDER, Solids, make_solids
from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import Held, RobotRef, Scene, State
from kinematics.shapes import convex_parts
from kinematics.transforms import Array, apply, inverse, transform
from planning.grasping.finger_grasps import open_width
from planning.grasping.hand_poses import UP
from planning.motion.queries import PlanningQuery
from planning.motion.reaching import APPROACH_M, LIFT_M
from planning.motion.rrt_connect import plan
from planning.motion.settings import DEFAULTS
from planning.motion.shortcut import shorten
from planning.motion.verify import hand_poses, verify
from planning.motion.workcell import Workcell
from planning.plan import Motion
from planning.scene_generation import _sample, load_spec

sys.path.insert(0, str(Path(__file__).resolve().parent))
import peers

BUDGET_S = 5.0
ROBOTS = ("ur5e", "panda")
KINDS = ("pregrasp", "grasp", "held")
WHEELS = {
    "ompl": ["ompl", "pin", "coal", "numpy"],
    "roboplan": ["roboplan", "numpy"],
    "mplib": ["mplib", "numpy<2"],
    "pybullet": ["pybullet", "numpy"],
}
Json = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Question:
    """One motion query, for our core and as plain geometry for the others. gripper: the joint's value; held: what the hand carries."""

    robot: Robot
    scene: Scene
    cell: Workcell
    query: PlanningQuery
    gripper: float
    held: Held | None
    start: Array
    goal: Array

    @property
    def hulls(self) -> list[tuple[int, Array]]:
        """Every part: the frame that carries it and its vertices (V, 3) in that frame."""
        base = self.scene.robot.T_world_base
        parts, _ = self.robot.parts(self.gripper, base)
        found = [(int(f), parts.vertices[a:b]) for f, a, b in zip(parts.frame, parts.start[:-1], parts.start[1:])]
        if self.held is not None:
            frame, T = self.robot.frame_of_links(self.gripper, base)["hand"]
            found += [(frame, apply(T @ self.held.T_hand_body, piece)) for piece in convex_parts(self.scene.body(self.held.body).shape)]
        return found

    @cached_property
    def chain(self) -> Chain:
        return self.robot.chain(self.scene.robot.T_world_base)

    @property
    def solids(self) -> Solids:
        held = self.held.body if self.held else None
        return make_solids([*self.scene.cabinet.walls(), *(b for b in self.scene.objects if b.name != held)])[0]

    @property
    def pairs(self) -> tuple[Array, Array]:
        """Part against part (S, 2), and part against solid (C, 2): what our task itself looks at."""
        n, both = len(self.hulls), self.query.task.exact.pairs[:, :2]
        own = both[:, 1] < n
        return both[own], both[~own] - np.array([0, n])

    def as_json(self) -> Json:
        chain, (pairs, check), parts = self.chain, self.pairs, []
        if chain.prismatic.any() or (chain.scale != 1).any() or (chain.offset != 0).any():
            raise ValueError("peers are told of turning joints only")
        for frame, vertices in self.hulls:
            hull = hull_solid("", vertices)
            faces = _faces(hull.vertices)
            parts.append({"frame": frame, "vertices": hull.vertices.tolist(), "faces": faces.tolist()})
        kinds = {BOX: "box", CYLINDER: "cylinder"}
        solids = [{"kind": kinds[int(k)], "T": T.tolist(), "half": h.tolist()} for k, T, h in zip(*self.solids[:3])]
        lists = {"T_prev": chain.T_prev, "lower": chain.lower, "upper": chain.upper, "pairs": pairs, "check": check}
        rest = {k: v.tolist() for k, v in {**lists, "start": self.start, "goal": self.goal}.items()}
        return {"parts": parts, "solids": solids, **rest}


def _faces(vertices: Array) -> Array:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices)
    a, b, c = (vertices[hull.simplices[:, i]] for i in range(3))
    faces = hull.simplices.copy()
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def ask(robot: Robot, kind: str, seed: int, count: tuple[int, int] = (5, 10)) -> Question:
    """Question number `seed` of a kind: scenes are drawn until one has a goal that FCL calls free, and that keeps the core's margin."""
    rng = np.random.default_rng([seed, 99])
    spec = replace(load_spec("paper"), objects_count=count)
    while True:
        scene = _sample(spec, RobotRef(transform(p=robot.base_p), robot.name), robot.opening, f"{kind}-{seed}", (), rng)
        if scene is None:
            continue
        cell, verdict, T = Workcell(robot, scene, iterations=10**6, time_budget_s=BUDGET_S), Verdict(robot, scene), scene.grasp.T_world_hand
        T_hand, held, poses = T.copy(), None, scene.poses()
        width, allowed_contacts = open_width(scene.grasp.width_m, robot.opening), []
        if kind == "pregrasp":
            T_hand[:3, 3] -= APPROACH_M * T[:3, 2]
        if kind == "held":
            T_hand[:3, 3] += LIFT_M * UP
            held = Held(scene.target, inverse(T) @ poses.pop(scene.target))
            width, allowed_contacts = scene.grasp.width_m, [(pad, scene.target) for pad in robot.pads]
        gripper = robot.opening.value_at(width)
        free = [
            q
            for q in (cell.home_arm, *cell.ik(T_hand))
            if not verdict.contacts(State(robot.with_arm(q, gripper), poses, held), allowed_contacts)
        ]
        query = cell.problem(poses, gripper, held=held)
        free = [q for q in free if cell.touch(query, q) is None]  # nobody is asked for what our margin rules out
        if len(free) >= 2 and np.array_equal(free[0], cell.home_arm):
            return Question(robot, scene, cell, query, gripper, held, free[0], free[1])


class FclWorld:
    """The same question for python-fcl: the arm in one broad-phase manager, what stands in the other; links against links one by one."""

    def __init__(self, question: Question) -> None:
        import fcl

        self.fcl, hulls, solids = fcl, question.hulls, question.solids
        self.chain, (pairs, _) = question.chain, question.pairs
        self.frame = np.array([f for f, _ in hulls])
        made = [hull_solid("", v) for _, v in hulls]
        self.objects, self.centre = [s.object for s in made], np.array([s.centre for s in made])
        self.radius = np.array([s.radius for s in made])
        self.one, self.two = pairs.T
        self.reach = (self.radius[self.one] + self.radius[self.two]) ** 2
        self.still = []
        for kind, T, half in zip(*solids[:3]):
            shape = fcl.Box(*(2 * half)) if kind == BOX else fcl.Cylinder(half[0], 2 * half[2])
            self.still.append(fcl.CollisionObject(shape, fcl.Transform(T[:3, :3], T[:3, 3])))
        self.arm, self.world = fcl.DynamicAABBTreeCollisionManager(), fcl.DynamicAABBTreeCollisionManager()
        self.arm.registerObjects([o for o, f in zip(self.objects, self.frame) if f > 0])
        self.world.registerObjects(self.still)
        self.arm.setup()
        self.world.setup()
        self.frames, self.request = np.zeros((len(self.chain.q_index) + 1, 4, 4)), fcl.CollisionRequest()

    def touches(self, q: Array) -> bool:
        fcl, hit = self.fcl, [False]
        forward(self.chain, q, self.frames)
        T = self.frames[self.frame]
        for o, t in zip(self.objects, T):
            o.setTransform(fcl.Transform(t[:3, :3], t[:3, 3]))
        self.arm.update()

        def touch(a: Any, b: Any, _: object) -> bool:
            hit[0] = hit[0] or fcl.collide(a, b, self.request, fcl.CollisionResult()) > 0
            return hit[0]

        self.arm.collide(self.world, None, touch)
        if hit[0]:
            return True
        at = np.einsum("pij,pj->pi", T[:, :3, :3], self.centre) + T[:, :3, 3]
        near = ((at[self.one] - at[self.two]) ** 2).sum(1) <= self.reach
        return any(
            fcl.collide(self.objects[i], self.objects[j], self.request, fcl.CollisionResult()) > 0
            for i, j in zip(self.one[near], self.two[near])
        )


def ours(question: Question, seed: int, budget_s: float = BUDGET_S) -> Json:
    """Plan and shorten, as the pipeline does: on a task packed just before (not timed)."""
    held = question.held.body if question.held else None
    poses = {name: T for name, T in question.scene.poses().items() if name != held}
    query = question.cell.problem(poses, question.gripper, held=question.held)
    task, memory = query.task, question.cell.enter(query)
    began = peers.clock()
    found = plan(task, question.start, question.goal[None], seed=seed, time_budget_s=3 * budget_s, max_iterations=10**7, memory=memory)
    planned = peers.clock()
    if found.path is None or planned - began > budget_s:
        return peers.answer(planned - began, planned - began, None)
    path = shorten(task, found.path, settings=DEFAULTS.shortcuts, seed=seed, memory=memory).path
    return peers.answer(planned - began, peers.clock() - began, path)


def verdict_ms(question: Question, path: Array) -> float:
    """The final check of one motion; what is held is carried out, from where the goal has it."""
    robot, scene, allowed_contacts = question.robot, question.scene, ()
    q = np.array([robot.with_arm(row, question.gripper) for row in path])
    if question.held is not None:
        q = q[::-1].copy()
        T = hand_poses(robot, scene, q[0]) @ question.held.T_hand_body
        scene = replace(scene, objects=tuple(replace(b, T_world_body=T) if b.name == question.held.body else b for b in scene.objects))
        allowed_contacts = tuple((pad, question.held.body) for pad in robot.pads)
    motion = Motion("transit", robot.joint_names, q, np.arange(len(q), dtype=float), question.held, allowed_contacts)
    began = peers.clock()
    blocked = verify(robot, scene, [motion])
    if blocked is not None:
        print(f"verify: {blocked}", file=sys.stderr)
    return 1e3 * (peers.clock() - began)


def checks_per_s(question: Question) -> tuple[Json, Array]:
    """Configurations a second: ours by covers (`checks_per_s`: neighbours on edges, as planners ask; `random`: anywhere), with the exact
    test of what they leave open (`exact`), and python-fcl's managers on the first of the same configurations."""
    rng, task, memory = np.random.default_rng(0), question.query.task, question.cell.enter(question.query)
    chain = question.chain
    a = rng.uniform(chain.lower, chain.upper, (20000, len(chain.lower)))
    way = rng.normal(size=a.shape)
    b = a + 16 * peers.STEP * way / np.linalg.norm(way, axis=1, keepdims=True)
    edges = (a[:, None] + np.linspace(0, 1, 16)[:, None] * (b - a)[:, None]).reshape(-1, a.shape[1])
    anywhere = rng.uniform(chain.lower, chain.upper, edges.shape)

    def rate(q: Array) -> float:
        times = []
        for _ in range(5):
            began = peers.clock()
            sphere_check.configs_free(task.model, task.world, q, memory.spheres)
            times.append(peers.clock() - began)
        return len(q) / min(times)

    rates = {"checks_per_s": rate(edges), "random": rate(anywhere)}
    few = edges[:64000]
    began = peers.clock()
    verdicts = sphere_check.configs_free(task.model, task.world, few, memory.spheres)
    unsure = np.flatnonzero(verdicts == sphere_check.UNDECIDED)
    touching = [not config_free(task.exact, few[i], memory.exact) for i in unsure]
    rates["exact"] = len(few) / (peers.clock() - began)
    rates["undecided"] = len(unsure) / len(few)
    world = FclWorld(question)
    rates["fcl"] = peers.rate(world.touches, few, 3.0)
    said = (verdicts == sphere_check.TOUCHES)[:4000]
    said[unsure[unsure < 4000]] = np.array(touching)[unsure < 4000]
    by_fcl = np.array([world.touches(q) for q in few[:4000]])
    rates["wrongly_free"], rates["too_careful"] = int((by_fcl & ~said).sum()), int((said & ~by_fcl).sum())
    return rates, few


def environment(peer: str) -> Path | str:
    """The Python of a peer's own environment, made when it is missing; or why there is none."""
    where = cache.folder() / "peers" / peer
    python, ready = where / "bin" / "python", where / "ready"
    if ready.exists():
        return python
    print(f"{peer}: setting up its environment", file=sys.stderr)
    try:
        venv.create(where, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "-q", *WHEELS[peer]], check=True, capture_output=True, text=True, timeout=600)
    except (OSError, subprocess.SubprocessError) as e:
        return f"not installed: {(getattr(e, 'stderr', '') or str(e)).strip().splitlines()[-1]}"
    ready.touch()
    return python


def run_peer(peer: str, file: Path, n: int) -> Json | str:
    python = environment(peer)
    if isinstance(python, str):
        return python
    out = file.with_name(f"{peer}.json")
    command = [str(python), str(Path(peers.__file__)), peer, str(file), str(out), str(BUDGET_S)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60 + 2 * BUDGET_S * n, env={**os.environ, "PYTHONPATH": ""})
    except subprocess.TimeoutExpired:
        return "gave up: too slow"
    if not out.exists():
        return f"failed: {(done.stderr.strip().splitlines() or [f'exit status {done.returncode}'])[-1]}"
    return dict(json.loads(out.read_text()))


def judge(questions: list[Json], answers: list[Json]) -> float:
    """The share of paths that touch something at a tenth of the step, by pinocchio and coal."""
    touching = []
    for question, found in zip(questions, answers):
        if found["path"] is not None:
            world = peers.CoalWorld(peers.arrays(question), broad=False)
            touching.append(any(world.touches(q) for q in peers.along(np.array(found["path"]), peers.STEP / 10)))
    return float(np.mean(touching)) if touching else 0.0


def figures(answers: list[Json], checks: float, touching: float) -> Json:
    """One row of the table; times over the questions that were solved, budgets over all for p95."""
    solved = [a for a in answers if a["path"] is not None]
    plan_s, both_s = (np.array([a[k] if a["path"] is not None else np.inf for a in answers]) * 1e3 for k in ("plan_s", "both_s"))

    def at(times: Array, share: float) -> float | None:
        value = float(np.quantile(times, share, method="lower"))
        return round(value, 4) if np.isfinite(value) else None

    times = {"plan_median_ms": at(plan_s, 0.5), "plan_p95_ms": at(plan_s, 0.95), "median_ms": at(both_s, 0.5), "p95_ms": at(both_s, 0.95)}
    return {"checks_per_s": round(checks), **times, "success": len(solved) / len(answers), "touching": touching}


def start_up() -> dict[str, float]:
    """Seconds from starting Python to the first path, with nothing compiled yet and with all compiled."""
    times = {}
    with tempfile.TemporaryDirectory() as folder:
        for when in ("cold_s", "warm_s"):
            began = time.perf_counter()
            env = {**os.environ, "NUMBA_CACHE_DIR": folder}
            subprocess.run([sys.executable, __file__, "--first-plan"], check=True, capture_output=True, env=env)
            times[when] = round(time.perf_counter() - began, 2)
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--peers", default=",".join(WHEELS), help="comma-separated; none for no peer; known: %(default)s")
    parser.add_argument("--no-fcl", action="store_true", help="leave out the FCL-only path, which takes longest")
    parser.add_argument("--first-plan", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.first_plan:
        assert ours(ask(load("ur5e"), "pregrasp", 0), 0, 300.0)["path"] is not None
        return
    wanted = [p for p in options.peers.split(",") if p not in ("", "none")]
    if unknown := set(wanted) - set(WHEELS):
        parser.error(f"unknown peers: {', '.join(sorted(unknown))}")

    robots = [load(name) for name in ROBOTS]
    questions = [ask(robots[i % 2], KINDS[i // 2 % 3], i) for i in range(options.problems)]
    counted = ask(robots[0], "pregrasp", 10**6, (8, 8))
    plain = [q.as_json() for q in questions]
    print(f"{len(questions)} questions made", file=sys.stderr)
    rates, configurations = checks_per_s(counted)

    for i, q in enumerate(questions[:4]):
        ours(q, i)  # compiled before the clock starts
    answers = [ours(q, i) for i, q in enumerate(questions)]
    rows: dict[str, Json | str] = {"ours": figures(answers, rates["checks_per_s"], judge(plain, answers))}
    verdicts = [verdict_ms(q, np.array(a["path"])) for q, a in zip(questions, answers) if a["path"] is not None]
    lost: list[int] = []
    if not options.no_fcl:
        by_fcl = []
        for i, (q, as_json) in enumerate(zip(questions, plain)):
            by_fcl.append(peers.in_python(FclWorld(q).touches, peers.arrays(as_json), BUDGET_S, i))
        rows["fcl"] = figures(by_fcl, rates["fcl"], judge(plain, by_fcl))
        lost = [i for i, (a, b) in enumerate(zip(answers, by_fcl)) if a["path"] is None and b["path"] is not None]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "questions.json"
        file.write_text(json.dumps({"questions": plain, "rate": {"question": counted.as_json(), "q": configurations[:2000].tolist()}}))
        for peer in wanted:
            done = run_peer(peer, file, len(questions))
            rows[peer] = done if isinstance(done, str) else figures(done["answers"], done["checks_per_s"], judge(plain, done["answers"]))
    report(rows, rates, verdicts, lost, len(questions))


def report(rows: dict[str, Json | str], rates: Json, verdicts: list[float], lost: list[int], n: int) -> None:
    print(f"{n} questions; plan, and plan + shortcut: ms, median and p95 over all; - where that many were not solved in {BUDGET_S} s")
    print(f"{'':10}{'checks/s':>12}{'plan':>10}{'p95':>10}{'+ short':>10}{'p95':>10}{'solved':>9}{'touching':>10}")
    for name, row in rows.items():
        if isinstance(row, str):
            print(f"{name:10}  {row}")
            continue
        times = [row[k] for k in ("plan_median_ms", "plan_p95_ms", "median_ms", "p95_ms")]
        shown = "".join(f"{'-' if t is None else f'{t:.3f}':>10}" for t in times)
        print(f"{name:10}{row['checks_per_s']:>12,}{shown}{row['success']:>9.1%}{row['touching']:>10.1%}")
    mine = rows["ours"]
    assert isinstance(mine, dict)
    ratios = {}
    for name, row in rows.items():
        if name != "ours" and isinstance(row, dict):
            slower = round(row["median_ms"] / mine["median_ms"], 1) if row["median_ms"] and mine["median_ms"] else None
            more = round(mine["checks_per_s"] / row["checks_per_s"], 1) if row["checks_per_s"] else None
            ratios[name] = {"checks_per_s": more, "median_ms": slower}
    startup = start_up()
    print(f"verdict on a path: median {np.median(verdicts):.2f} ms; first plan: {startup['cold_s']} s cold, {startup['warm_s']} s warm")
    print(
        f"checks of ours: {rates['random']:,.0f}/s anywhere, {rates['exact']:,.0f}/s exact ({rates['undecided']:.2%} asked of GJK); "
        f"of 4000, {rates['wrongly_free']} free that FCL finds touching, {rates['too_careful']} the other way (within the margin); "
        f"{rates['checks_per_s'] / rates['fcl']:.0f} × python-fcl's managers"
    )
    if lost:
        print(f"solved by FCL and not by ours: questions {lost}")
    keys = ("checks_per_s", "median_ms", "p95_ms", "plan_median_ms", "plan_p95_ms", "success", "touching")
    figures_ = {k: mine[k] for k in keys}
    figures_ |= {"verdict_ms": round(float(np.median(verdicts)), 3), **startup, "fcl_checks_per_s": round(rates["fcl"])}
    figures_ |= {"checks_to_fcl": round(rates["checks_per_s"] / rates["fcl"], 1), "exact_checks_per_s": round(rates["exact"])}
    print(json.dumps({"problems": n, **figures_, "lost_to_fcl": len(lost), "ratios": ratios, "rows": rows}))


if __name__ == "__main__":
    main()
