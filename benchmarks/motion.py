"""Motion planning in cabinets: this project's core against its FCL-only path and against other planners, on the same questions, in one run.

Half the questions are for a UR5e, half for a Panda, before cabinets of the `paper` spec with 5 to 10 objects. From home to a pregrasp, to a
grasp, and with the target in the hand from home to where it was lifted. Every planner gets the same hulls, boxes and cylinders, start and
goal, and BUDGET_S seconds; times are processor times, the median of some rounds in which all take turns. All paths are then judged by
coal at a tenth of the step that sampling planners take.

Peers run in environments of their own, made by pip under the cache folder when first asked for; one that can't be had says why in its row.
VAMP has spheres of its own and a Panda with an empty hand only, so it is asked fewer questions; ratios are over those that both solved.
Usage: python benchmarks/motion.py [--problems 200] [--peers ompl,...] [--rounds 3] [--busy 2]. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding

import kinematics.cache as cache
from kinematics.chain import Chain, forward
from kinematics.collision import sphere_check
from kinematics.collision.edge_check import config_free
from kinematics.collision.fcl_check import Verdict
from kinematics.collision.fcl_solids import hull_solid
from kinematics.collision.geometry import BOX, CYLINDER, Solids, make_solids
from kinematics.robots.load import load, to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Held, Scene, State
from kinematics.shapes import convex_parts
from kinematics.transforms import Array, apply, inverse
from planning.grasping.finger_grasps import open_width
from planning.grasping.hand_poses import UP
from planning.motion.cell.queries import PlanningQuery
from planning.motion.cell.workcell import Workcell
from planning.motion.checking.verify import hand_poses, verify
from planning.motion.search.reaching import APPROACH_M, LIFT_M
from planning.motion.search.rrt_connect import plan
from planning.motion.search.shortcut import shorten
from planning.motion.settings import DEFAULTS, UNCONSTRAINED
from planning.plan import Motion
from planning.scenes.generation import generate, load_spec

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
    "vamp": ["vamp-planner", "numpy"],
}
UNKNOWN = {"vamp": ("camera",)}
"""Links that a peer's own model of the robot lacks."""
RATIOS = {"plan_median_ms": "plan", "plan_p95_ms": "p95", "median_ms": "plan + shortcut", "p95_ms": "p95"}
Json = dict[str, Any]
Answers = list[Json | None]


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
        _, links = self.robot.parts(self.gripper, self.scene.robot.T_world_base)
        for part, link in zip(parts, links):
            part["link"] = link
        return {"robot": self.robot.name, "carries": self.held is not None, "parts": parts, "solids": solids, **rest}


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
    spec, ref = replace(load_spec("paper"), objects_count=count), replace(to_ref(robot), mount=False)
    indices = itertools.count()
    while True:
        scene = generate(spec, robot, ref, seed, next(indices), judge=lambda *_: None)
        cell = Workcell(robot, scene, iterations=10**6, time_budget_s=BUDGET_S, settings=UNCONSTRAINED)
        verdict, T = Verdict(robot, scene), scene.grasp.T_world_hand
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


def judge(questions: list[Json], answers: Answers, peer: str) -> list[bool]:
    """Which answers' paths touch something at a tenth of the step, by pinocchio and coal; links that a peer doesn't know may touch."""
    touching = []
    for question, found in zip(questions, answers):
        path = found and found["path"]
        world = peers.CoalWorld(peers.arrays(question), broad=False, without=UNKNOWN.get(peer, ())) if path else None
        touching.append(world is not None and any(world.touches(q) for q in peers.along(np.array(path), peers.STEP / 10)))
    return touching


def medians(rounds: list[Answers]) -> Answers:
    """The answers of the first round, with the median times of all in which the question was solved."""
    found: Answers = []
    for answers in zip(*rounds):
        solved = [a for a in answers if a is not None and a["path"] is not None]
        times = {k: float(np.median([a[k] for a in solved])) for k in ("plan_s", "both_s")} if solved else {}
        found.append(answers[0] and {**(solved or answers)[0], **times})
    return found


def figures(answers: Answers, checks: float | None, touching: list[bool]) -> Json:
    """One row of the table, over the questions that were asked; times of one that was not solved are longer than all others."""
    asked = [a for a in answers if a is not None]
    solved = np.array([a["path"] is not None for a in asked])
    plan_s, both_s = (np.where(solved, [a[k] for a in asked], np.inf) * 1e3 for k in ("plan_s", "both_s"))

    def at(times: Array, share: float) -> float | None:
        value = float(np.quantile(times, share, method="lower"))
        return round(value, 4) if np.isfinite(value) else None

    times = {"plan_median_ms": at(plan_s, 0.5), "plan_p95_ms": at(plan_s, 0.95), "median_ms": at(both_s, 0.5), "p95_ms": at(both_s, 0.95)}
    shares = {"success": float(solved.mean()), "touching": sum(touching) / max(1, int(solved.sum()))}
    return {"asked": len(asked), "checks_per_s": checks and round(checks), **times, **shares}


def against(mine: Answers, theirs: Answers, touching: list[bool]) -> Json:
    """A peer's times over ours, on the questions that both have solved; which it alone has solved, without touching anything."""
    solved = [[a is not None and a["path"] is not None for a in answers] for answers in (mine, theirs)]
    both = [i for i, (a, b) in enumerate(zip(*solved)) if a and b]
    row, other = (figures([answers[i] for i in both], None, []) for answers in (mine, theirs))
    alone = [i for i, (a, b) in enumerate(zip(*solved)) if b and not a and not touching[i]]
    return {"solved_by_both": len(both), **{k: round(other[k] / row[k], 2) for k in RATIOS}, "solved_alone": alone}


@contextlib.contextmanager
def busy(processes: int) -> Iterator[None]:
    """So many processes of other work beside."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for other in others:
            other.kill()


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
    parser.add_argument("--rounds", type=int, default=3, help="in which all take turns; medians are shown")
    parser.add_argument("--busy", type=int, default=0, help="processes of other work beside, for times on a loaded machine")
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
    rounds: dict[str, list[Answers]] = {name: [] for name in ("ours", *wanted)}
    checks: dict[str, float | None] = {"ours": rates["checks_per_s"]}
    rows: dict[str, Json | str] = {}
    with tempfile.TemporaryDirectory() as folder, busy(options.busy):
        file = Path(folder) / "questions.json"
        file.write_text(json.dumps({"questions": plain, "rate": {"question": counted.as_json(), "q": configurations[:2000].tolist()}}))
        for _ in range(options.rounds):
            rounds["ours"].append([ours(q, i) for i, q in enumerate(questions)])
            for peer in (peer for peer in wanted if peer not in rows):
                done = run_peer(peer, file, len(questions))
                if isinstance(done, str):
                    rows[peer] = done
                else:
                    rounds[peer].append(done["answers"])
                    checks[peer] = done["checks_per_s"]
        if not options.no_fcl:
            rounds["fcl"] = [
                [peers.in_python(FclWorld(q).touches, peers.arrays(p), BUDGET_S, i) for i, (q, p) in enumerate(zip(questions, plain))]
            ]
            checks["fcl"] = rates["fcl"]
    answers = {name: medians(found) for name, found in rounds.items() if name not in rows}
    touching = {name: judge(plain, found, name) for name, found in answers.items()}
    rows = {name: figures(found, checks[name], touching[name]) for name, found in answers.items()} | rows
    ratios = {name: against(answers["ours"], found, touching[name]) for name, found in answers.items() if name != "ours"}
    verdicts = [verdict_ms(q, np.array(a["path"])) for q, a in zip(questions, answers["ours"]) if a is not None and a["path"] is not None]
    report(rows, ratios, rates, verdicts, len(questions))


def report(rows: dict[str, Json | str], ratios: dict[str, Json], rates: Json, verdicts: list[float], n: int) -> None:
    vectors = sorted(f for f, has in binding.get_host_cpu_features().items() if has and f.startswith(("avx", "fma", "neon", "sve")))
    cpu = f"{binding.get_host_cpu_name()}: {' '.join(vectors)}"
    print(f"{n} questions; plan, and plan + shortcut: ms, median and p95 over all; - where that many were not solved in {BUDGET_S} s")
    print(f"on {cpu}")
    print(f"{'':10}{'asked':>6}{'checks/s':>12}{'plan':>10}{'p95':>10}{'+ short':>10}{'p95':>10}{'solved':>9}{'touching':>10}")
    for name, row in rows.items():
        if isinstance(row, str):
            print(f"{name:10}  {row}")
            continue
        times = [row[k] for k in RATIOS]
        shown = "".join(f"{'-' if t is None else f'{t:.3f}':>10}" for t in times)
        rate = "-" if row["checks_per_s"] is None else f"{row['checks_per_s']:,}"
        print(f"{name:10}{row['asked']:>6}{rate:>12}{shown}{row['success']:>9.1%}{row['touching']:>10.1%}")
    for name, ratio in ratios.items():
        times = ", ".join(f"{words} {ratio[k]}" for k, words in RATIOS.items())
        alone = ratio["solved_alone"] or "none"
        print(f"{name} over ours, on {ratio['solved_by_both']} that both solved: {times}; solved by it alone, without touching: {alone}")
    startup = start_up()
    print(f"verdict on a path: median {np.median(verdicts):.2f} ms; first plan: {startup['cold_s']} s cold, {startup['warm_s']} s warm")
    print(
        f"checks of ours: {rates['random']:,.0f}/s anywhere, {rates['exact']:,.0f}/s exact ({rates['undecided']:.2%} asked of GJK); "
        f"of 4000, {rates['wrongly_free']} free that FCL finds touching, {rates['too_careful']} the other way (within the margin); "
        f"{rates['checks_per_s'] / rates['fcl']:.0f} × python-fcl's managers"
    )
    mine = rows["ours"]
    assert isinstance(mine, dict)
    figures_ = {k: v for k, v in mine.items() if k != "asked"}
    figures_ |= {"verdict_ms": round(float(np.median(verdicts)), 3), **startup, "fcl_checks_per_s": round(rates["fcl"])}
    figures_ |= {"checks_to_fcl": round(rates["checks_per_s"] / rates["fcl"], 1), "exact_checks_per_s": round(rates["exact"])}
    print(json.dumps({"problems": n, "cpu": cpu, **figures_, "ratios": ratios, "rows": rows}))


if __name__ == "__main__":
    main()
