"""RRT-Connect (Kuffner and LaValle 2000) from one start to any of several goals, in compiled code, every edge certified.

Two trees grow towards each other in the box of joint limits; all goals are roots of the second one. With dynamic domains (Yershova et al.
2005): a node that failed to extend is drawn on only by samples near it. Half of the samples are drawn around the roots, of all sizes alike:
a hand at a grasp, or between objects, has to find its way out first. A search that lasts pulls the hand straight out of stuck roots
(pulling.py), and later goes towards each sample as far as it can. Distances are metres moved: each joint weighs what it can move.

Where what is carried must stay upright, samples are turned until it is, and so is every step that would tilt it too far (projection, as in
CBiRRT; Berenson et al. 2009): the limit leaves too little of the joints' box for samples to be met there by chance.

The loop knows neither arm nor world: it asks `connects` (edges.py), the one place where an edge is judged.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.collision.edge_check import first_contact
from kinematics.doors import checked
from kinematics.jit.decorators import copy_row, jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array
from planning.motion.edges import Memory, Task, connects, make_memory
from planning.motion.pulling import PULL_M, WAYS, pulled
from planning.motion.upright import bring_upright, is_upright

MAX_ITERATIONS = 5000
FOUND, SPENT, FULL = 1, 0, 2
HEADROOM = 0.9
"""Share of the allowed tilt to which what a step tilts too far is brought back."""
_EDGES = 4  # to a goal from others that were reached, before a search is begun
_CHUNK = 16  # iterations between looks at the clock


@dataclass(frozen=True)
class RRTConnectSettings:
    """How the trees grow.

    step: longest edge that one extension adds, as a share of the box's diagonal in the weighted metric. around_roots: share of the samples
    that are drawn around a tree's root, where the ways are narrow, in a box down to `narrowest` times the whole one. domain: radius, in
    steps, of the domain that a node gets when it first fails; it shrinks and grows by 30 % down to a tenth of this.
    pulls_at: iteration from which on the hand is pulled out of the roots, once each way; pulls: in a row, at most. stuck: a tree with more
    nodes than that, roots aside, finds its way without pulls; pulled_goals: how many goals are pulled out of, the nearest ones.
    far_from: iteration from which on an extension makes as many steps as are free, not one.
    """

    step: float = 0.04
    around_roots: float = 0.5
    narrowest: float = 0.03
    domain: float = 60.0
    pulls_at: int = 40
    pulls: int = 5
    stuck: int = 8
    pulled_goals: int = 4
    far_from: int = 150

    @cached_property
    def packed(self) -> GrowthSettings:
        """The same for compiled code."""
        return GrowthSettings(*(getattr(self, f.name) for f in fields(self)))


@record
class GrowthSettings(NamedTuple):
    """`RRTConnectSettings` for compiled code."""

    step: float
    around_roots: float
    narrowest: float
    domain: float
    pulls_at: int
    pulls: int
    stuck: int
    pulled_goals: int
    far_from: int


DEFAULTS = RRTConnectSettings()


@record
class Trees(NamedTuple):
    """Both trees, start's (0) and goals' (1), N nodes at most: q (2, N, J), parent (2, N), -1 for roots, radius (2, N) of the domain.

    goals: how many roots the second one has. size (2,); rng (1,): state of the random numbers; met (3,): the two nodes that met, and
    iterations so far. Scratch: work (3, J); descent and T (2, 4, 4) for pulls.
    """

    q: Array
    parent: Int
    radius: Array
    goals: int
    size: Int
    rng: NDArray[np.uint64]
    met: Int
    work: Array
    descent: Array
    T: Array


@dataclass(frozen=True, eq=False)
class Route:
    """What came out: the path (K, J) or None, and why not: `start` or `goals` in contact, `tilt` where what is carried leans too far at the
    start or at all goals, or the `budget` spent.

    goal: index of the goal reached, -1 without a path. contact: the pair (first body, second body) that touches at the start, or at the
    last goal when all of them touch; bodies as in `exact.Problem`, the P parts first. iterations of the planner; configurations and edges
    looked at; seconds.
    """

    path: Array | None
    why: str
    goal: int
    contact: tuple[int, int] | None
    iterations: int
    configurations: int
    edges: int
    time_s: float


def plan(
    task: Task,
    start: Array,
    goals: Array,
    *,
    max_iterations: int = MAX_ITERATIONS,
    time_budget_s: float | None = None,
    seed: int = 0,
    memory: Memory | None = None,
    settings: RRTConnectSettings = DEFAULTS,
) -> Route:
    """Find a path from start (J,) to one of goals (G, J), each edge of which is certified free (see planning.motion.edges).

    The same arguments give the same path, unless time_budget_s cuts the search off. memory: this thread's, for this task.
    Raises: ValueError when the shapes don't fit the task.
    """
    began = time.perf_counter()
    problem, n_q = task.exact, len(task.exact.chain.lower)
    start, goals = checked("start", start, n_q), checked("goals", goals, -1, n_q)
    if len(goals) == 0:
        raise ValueError(f"goals {goals.shape} must be (G, {n_q}) with G > 0")
    memory = make_memory(task) if memory is None else memory
    scratch = memory.exact
    counts = scratch.counts.copy()

    def route(path: Array | None, why: str, goal: int = -1, pair: int = -1, iterations: int = 0) -> Route:
        spent = scratch.counts - counts
        contact = None if pair < 0 else (int(problem.pairs[pair, 0]), int(problem.pairs[pair, 1]))
        return Route(path, why, goal, contact, iterations, int(spent[0]), int(spent[2]), time.perf_counter() - began)

    at_start = int(first_contact(problem, start, scratch))
    if at_start >= 0:
        return route(None, "start", pair=at_start)
    if not is_upright(problem.chain, task.upright, start, scratch):
        return route(None, "tilt")
    at_goal = [int(first_contact(problem, g, scratch)) for g in goals]
    free = [g for g in range(len(goals)) if at_goal[g] < 0]
    if not free:
        return route(None, "goals", pair=at_goal[-1])
    free = [g for g in free if is_upright(problem.chain, task.upright, goals[g], scratch)]
    if not free:
        return route(None, "tilt")
    free.sort(key=lambda g: float(np.sum((problem.weight * (goals[g] - start)) ** 2)))
    trees = _plant(start, goals[free], seed)
    status = SPENT
    while trees.met[2] < max_iterations and status != FOUND:
        if time_budget_s is not None and time.perf_counter() - began > time_budget_s:
            break
        left = max_iterations - int(trees.met[2])
        status = grow(task, trees, settings.packed, left if time_budget_s is None else min(left, _CHUNK), memory)
        if status == FULL:
            trees = _widen(trees)
    iterations = int(trees.met[2])
    if status != FOUND:
        return route(None, "budget", iterations=iterations)
    ahead, back = _climb(trees, 0), _climb(trees, 1)
    path = np.concatenate([trees.q[0, ahead[::-1]], trees.q[1, back]])
    return route(path, "", free[back[-1]], iterations=iterations)


def reach(
    task: Task,
    start: Array,
    goals: Array,
    *,
    max_iterations: int,
    seed: int,
    memory: Memory,
    settings: RRTConnectSettings = DEFAULTS,
) -> NDArray[np.bool_]:
    """To which of goals (G, J) a path leads from start (J,), each edge of which is certified free; the paths themselves are not kept.

    What one goal is reached by serves the others: edges to goals reached before come first, then one search for all that are left, as
    often as it finds one of them in max_iterations.
    """
    n_q = len(task.exact.chain.lower)
    start, goals = checked("start", start, n_q), checked("goals", goals, -1, n_q)
    found, tried = np.zeros(len(goals), np.bool_), np.zeros((len(goals), len(goals) + 1), np.bool_)
    if first_contact(task.exact, start, memory.exact) >= 0:
        return found
    while True:
        _spread(task, start, goals, memory, found, tried)
        left = np.flatnonzero(~found)
        if len(left) == 0:
            return found
        route = plan(task, start, goals[left], max_iterations=max_iterations, seed=seed + len(left), memory=memory, settings=settings)
        if route.path is None:
            return found
        found[left[route.goal]] = True


def _plant(start: Array, goals: Array, seed: int) -> Trees:
    n, J = 256 + 2 * len(goals), len(start)
    trees = Trees(
        np.zeros((2, n, J)),
        np.full((2, n), -1, np.int64),
        np.full((2, n), np.inf),
        len(goals),
        np.array([1, len(goals)], np.int64),
        np.array([seed % 2**64], np.uint64),
        np.zeros(3, np.int64),
        np.empty((3, J)),
        np.empty((12 + J, max(6, J))),
        np.empty((2, 4, 4)),
    )
    trees.q[0, 0], trees.q[1, : len(goals)] = start, goals
    return trees


def _widen(trees: Trees) -> Trees:
    """The same trees with room for twice as many nodes."""

    return trees._replace(
        q=np.concatenate([trees.q, np.zeros_like(trees.q)], 1),
        parent=np.concatenate([trees.parent, trees.parent], 1),
        radius=np.concatenate([trees.radius, trees.radius], 1),
    )


def _climb(trees: Trees, side: int) -> list[int]:
    """Node indices from where the trees met to the root."""
    way = [int(trees.met[side])]
    while trees.parent[side, way[-1]] >= 0:
        way.append(int(trees.parent[side, way[-1]]))
    return way


@jit_inline
def uniform(rng: NDArray[np.uint64]) -> float:
    """A number in [0, 1) from the state rng (1,), which it advances (SplitMix64; Steele, Lea and Flood 2014)."""
    rng[0] += np.uint64(0x9E3779B97F4A7C15)
    z = rng[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 2.0**-53


@jit_inline
def weighted(weight: Array, a: Array, b: Array) -> float:
    """The distance of two configurations (J,) in metres moved."""
    d = 0.0
    for j in range(weight.shape[0]):
        e = weight[j] * (b[j] - a[j])
        d += e * e
    return float(np.sqrt(d))


@jit_entry
def grow(task: Task, trees: Trees, s: GrowthSettings, iterations: int, memory: Memory) -> int:
    """Grow both trees for some iterations: FOUND (trees.met says where), SPENT or FULL (of nodes: widen and go on)."""
    q, size, weight = trees.q, trees.size, task.exact.weight
    lower, upper = task.exact.chain.lower, task.exact.chain.upper
    step = s.step * weighted(weight, lower, upper)
    if trees.met[2] == 0:  # the nearest goals straight away
        for g in range(min(size[1], 4)):
            if connects(task, q[0, 0], q[1, g], memory):
                trees.met[0], trees.met[1] = 0, g
                trees.met[2] = 1
                return FOUND
    for _ in range(iterations):
        if size[0] == q.shape[1] or size[1] == q.shape[1]:
            return FULL
        turn = trees.met[2]
        trees.met[2] += 1
        root = _to_pull(trees, s, turn)
        if root >= 0:
            side = min(root, 1)
            here = _pull(task, trees, side, root - side, (turn - s.pulls_at) % WAYS, s.pulls, memory)
        else:
            side = turn % 2
            if turn % 4 != 0 and max(size[0], size[1]) > 2 * min(size[0], size[1]):
                side = 0 if size[0] < size[1] else 1  # balance
            _sample(trees, s, side, lower, upper, trees.work[0])
            if task.upright.limited:
                tilt = task.upright.most * np.sqrt(uniform(trees.rng))  # evenly over the cone
                bring_upright(task.exact.chain, task.upright, weight, tilt, trees.work[0], memory.exact, trees.work[2])
            here = _extend(task, trees, s, side, step, turn >= s.far_from, memory)
        if here >= 0 and _meet(task, trees, side, here, step, memory):
            return FOUND
    return SPENT


@jit_inline
def _to_pull(trees: Trees, s: GrowthSettings, turn: int) -> int:
    """Which root the hand is pulled out of in this iteration, 0 for the start, g + 1 for goal g; -1 for none."""
    root = (turn - s.pulls_at) // WAYS
    if root < 0 or root > min(trees.goals, s.pulled_goals):
        return -1
    grown = trees.size[0] - 1 if root == 0 else trees.size[1] - trees.goals
    return root if grown <= s.stuck else -1


@jit_inline
def _pull(task: Task, trees: Trees, side: int, root: int, way: int, pulls: int, memory: Memory) -> int:
    """Pull the hand out of a root, one way; the last new node of that tree, or -1."""
    q, new, here = trees.q, trees.work[1], root
    for _ in range(pulls):
        pulled(task.exact.chain, q[side, here], way, PULL_M, memory.exact.poses, trees.descent, trees.T, new)
        if trees.size[side] == q.shape[1] or not connects(task, q[side, here], new, memory):
            break
        here = _add(trees, side, here, new)
    return here if here != root else -1


@jit_inline
def _extend(task: Task, trees: Trees, s: GrowthSettings, side: int, step: float, far: bool, memory: Memory) -> int:
    """Extend one tree towards the target trees.work[0] by a step, or by all that are free; its last new node, or -1."""
    q, weight, target, new = trees.q, task.exact.weight, trees.work[0], trees.work[1]
    near, d = _closest(q, side, trees.size[side], weight, target)
    if d > trees.radius[side, near]:
        return -1
    here = near
    while trees.size[side] < q.shape[1]:
        share = min(1.0, step / max(d, 1e-300))
        for j in range(weight.shape[0]):
            new[j] = q[side, here, j] + share * (target[j] - q[side, here, j])
        mended = _mend(task, trees, new, memory)
        if not connects(task, q[side, here], new, memory):
            break
        here = _add(trees, side, here, new)
        if mended:
            nearer = weighted(weight, new, target)
            if nearer > d - 0.3 * step:  # along the limit, not towards the target any more
                break
            d = nearer
        else:
            d -= step
        if not far or (share == 1.0 and not mended):
            break
    if here == near:
        widest = s.domain * step
        trees.radius[side, near] = widest if trees.radius[side, near] == np.inf else max(0.1 * widest, 0.7 * trees.radius[side, near])
        return -1
    trees.radius[side, near] *= 1.3
    return here


@jit_inline
def _meet(task: Task, trees: Trees, side: int, here: int, step: float, memory: Memory) -> bool:
    """Grow the other tree straight towards a node of this one, as far as it goes. Whether they met: trees.met says where."""
    q, other, target = trees.q, 1 - side, trees.work[0]
    near, d = _closest(q, other, trees.size[other], task.exact.weight, q[side, here])
    steps = max(1, int(np.ceil(d / step)))
    for s in range(steps):
        for j in range(target.shape[0]):
            target[j] = q[other, near, j] + (q[side, here, j] - q[other, near, j]) / (steps - s)
        if s < steps - 1:
            _mend(task, trees, target, memory)
        if trees.size[other] == q.shape[1] or not connects(task, q[other, near], target, memory):
            return False
        if s < steps - 1:
            near = _add(trees, other, near, target)
    trees.met[side], trees.met[other] = here, near
    return True


@jit_inline
def _mend(task: Task, trees: Trees, q: Array, memory: Memory) -> bool:
    """Bring a configuration (J,) back where what is carried is upright; whether there was anything to mend."""
    upright = task.upright
    if not upright.limited or is_upright(task.exact.chain, upright, q, memory.exact):
        return False
    bring_upright(task.exact.chain, upright, task.exact.weight, HEADROOM * upright.most, q, memory.exact, trees.work[2])
    return True


@jit_entry
def _spread(task: Task, start: Array, goals: Array, memory: Memory, found: NDArray[np.bool_], tried: NDArray[np.bool_]) -> None:
    """Mark in found (G,) which goals (G, J) an edge leads to from the start or from a goal that was found, the nearest few of these.

    tried (G, G + 1): edges to a goal that were looked at before, from another goal or, in the last column, from the start.
    """
    G, weight = goals.shape[0], task.exact.weight
    for _ in range(_EDGES):
        for g in range(G):
            if found[g]:
                continue
            near, best = -1, np.inf
            for h in range(G + 1):
                if not tried[g, h] and (h == G or found[h]):
                    d = weighted(weight, goals[h] if h < G else start, goals[g])
                    if d < best:
                        near, best = h, d
            if near >= 0:
                tried[g, near] = True
                found[g] = connects(task, goals[near] if near < G else start, goals[g], memory)


@jit_inline
def _sample(trees: Trees, s: GrowthSettings, side: int, lower: Array, upper: Array, target: Array) -> None:
    """Draw a target (J,) for one tree: from the whole box, or from a smaller one around a root, of a size from `narrowest` to 1."""
    if uniform(trees.rng) >= s.around_roots:
        for j in range(lower.shape[0]):
            target[j] = lower[j] + uniform(trees.rng) * (upper[j] - lower[j])
        return
    share = s.narrowest ** uniform(trees.rng)
    root = int(uniform(trees.rng) * trees.goals) if side == 1 else 0
    for j in range(lower.shape[0]):
        drawn = trees.q[side, root, j] + share * (uniform(trees.rng) - 0.5) * (upper[j] - lower[j])
        target[j] = min(max(drawn, lower[j]), upper[j])


@jit_inline
def _add(trees: Trees, side: int, parent: int, q: Array) -> int:
    n = trees.size[side]
    copy_row(q, trees.q[side, n])
    trees.parent[side, n], trees.radius[side, n] = parent, np.inf
    trees.size[side] = n + 1
    return int(n)


@jit_inline
def _closest(q: Array, side: int, size: int, weight: Array, target: Array) -> tuple[int, float]:
    """The node of one tree nearest to a target (J,), and how far it is."""
    at, best = 0, np.inf
    for n in range(size):
        d = 0.0
        for j in range(weight.shape[0]):
            e = weight[j] * (q[side, n, j] - target[j])
            d += e * e
        if d < best:
            at, best = n, d
    return at, float(np.sqrt(best))
