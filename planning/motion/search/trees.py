"""The two trees of RRT-Connect, compiled: how they are planted, how they grow, and what else leads from goal to goal.

With dynamic domains (Yershova et al. 2005): a node that failed to extend is drawn on only by samples near it. Half of the samples are drawn
around the roots, of all sizes alike: a hand at a grasp, or between objects, has to find its way out first. A search that lasts pulls the
hand straight out of stuck roots (pulling.py), and later goes towards each sample as far as it can. Distances are metres moved: each joint
weighs what it can move.

Where what is carried must stay upright, samples are turned until it is, and so is every step that would tilt it too far (projection, as in
CBiRRT; Berenson et al. 2009): the limit leaves too little of the joints' box for samples to be met there by chance.

The loop knows neither arm nor world: it asks `connects` (edges.py), the one place where an edge is judged.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Int
from kinematics.jit.decorators import copy_row, jit_entry, jit_inline
from kinematics.jit.record import record
from kinematics.transforms import Array
from planning.motion.search.edges import NOTHING, Memory, Task, connects, judge_ends
from planning.motion.search.pulling import PULL_M, WAYS, pulled
from planning.motion.search.tree_memory import Trees
from planning.motion.search.upright import bring_upright, is_upright

FOUND, SPENT, FULL, NO_START, NO_GOAL = 1, 0, 2, 3, 4
"""What became of a search: the trees met; the iterations are spent; a tree is full; no start, or no goal, can be an end of a way."""
HEADROOM = 0.9
"""Share of the allowed tilt to which what a step tilts too far is brought back."""
_EDGES = 4  # to a goal from others that were reached, before a search is begun


@record
class GrowthSettings(NamedTuple):
    """`planning.motion.search.rrt_connect.RRTConnectSettings` for compiled code."""

    step: float
    around_roots: float
    narrowest: float
    domain: float
    pulls_at: int
    pulls: int
    stuck: int
    pulled: int
    far_from: int
    balanced_from: int


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
def search(
    task: Task, starts: Array, goals: Array, known: Array, first: Int, s: GrowthSettings, seed: int, iterations: int, begins: bool,
    memory: Memory, said: Int, nodes: Int,
) -> tuple[int, int]:  # fmt: skip
    """A path from one of starts (S, J) to one of goals (G, J): what became of the search, and if they were joined, how many waypoints the
    path has in memory.trees.path.

    begins: whether the trees are planted; else they grow on. The memory is ready for the task. known (K, J): the waypoints of ways that
    were free for similar tasks, way w from row first[w] to first[w + 1]. said (S + G,): what each start and goal lacks, see `edges.lacks`.
    nodes (2, K): scratch.
    """
    trees = memory.trees
    if begins:
        status = _plant(task, trees, starts, goals, seed, memory, said)
        if status != FOUND:
            return status, 0
        for w in range(first.shape[0] - 1):
            if _follow(task, trees, known[first[w] : first[w + 1]], nodes, memory):
                return FOUND, _join(trees)
    status = _grow(task, trees, s, iterations, memory)
    return status, (_join(trees) if status == FOUND else 0)


@jit_inline
def _plant(task: Task, trees: Trees, starts: Array, goals: Array, seed: int, memory: Memory, said: Int) -> int:
    """Trees of nothing but roots, on each side the nearest to those on the other in front: FOUND, or on which side there is none."""
    S, weight = starts.shape[0], task.exact.weight
    if not judge_ends(task, starts, memory, said[:S]):
        return NO_START
    if not judge_ends(task, goals, memory, said[S:]):
        return NO_GOAL
    for side in range(2):
        mine, others = (starts, goals) if side == 0 else (goals, starts)
        at, opposite, n = (0, S, 0) if side == 0 else (S, 0, 0)
        for i in range(mine.shape[0]):
            if said[at + i] != NOTHING:
                continue
            least = np.inf
            for k in range(others.shape[0]):
                if said[opposite + k] == NOTHING:
                    least = min(least, weighted(weight, mine[i], others[k]))
            k = n
            while k > 0 and trees.radius[side, k - 1] > least:
                trees.radius[side, k], trees.end[side, k] = trees.radius[side, k - 1], trees.end[side, k - 1]
                k -= 1
            trees.radius[side, k], trees.end[side, k] = least, i
            n += 1
        trees.size[side] = 0
        for k in range(n):
            _add(trees, side, -1, mine[trees.end[side, k]])
        trees.roots[side] = n
    trees.rng[0] = np.uint64(seed)
    trees.met[2] = 0
    return FOUND


@jit_inline
def _join(trees: Trees) -> int:
    """Write down the path from root to root through the nodes that met, and which ends it joins; how many waypoints it has."""
    n, node = 0, trees.met[0]
    while trees.parent[0, node] >= 0:
        n, node = n + 1, trees.parent[0, node]
    trees.joined[0] = trees.end[0, node]
    n, node = n + 1, trees.met[0]
    for k in range(n):
        copy_row(trees.q[0, node], trees.path[n - 1 - k])
        node = trees.parent[0, node]
    node = trees.met[1]
    while True:
        copy_row(trees.q[1, node], trees.path[n])
        n += 1
        if trees.parent[1, node] < 0:
            trees.joined[1] = trees.end[1, node]
            return n
        node = trees.parent[1, node]


@jit_inline
def _grow(task: Task, trees: Trees, s: GrowthSettings, iterations: int, memory: Memory) -> int:
    """Grow both trees for some iterations: FOUND (trees.met says where), SPENT or FULL (of nodes: widen and go on)."""
    q, size, weight = trees.q, trees.size, task.exact.weight
    lower, upper = task.exact.chain.lower, task.exact.chain.upper
    step = s.step * weighted(weight, lower, upper)
    if trees.met[2] == 0:  # the nearest goals straight away
        for g in range(min(size[1], 4)):
            near, _ = _closest(q, 0, size[0], weight, q[1, g])
            if connects(task, q[0, near], q[1, g], memory):
                trees.met[0], trees.met[1] = near, g
                trees.met[2] = 1
                return FOUND
    for _ in range(iterations):
        if size[0] == q.shape[1] or size[1] == q.shape[1]:
            return FULL
        turn = trees.met[2]
        trees.met[2] += 1
        root = _to_pull(trees, s, turn)
        if root >= 0:
            side = 0 if root < min(trees.roots[0], s.pulled) else 1
            root -= side * min(trees.roots[0], s.pulled)
            here = _pull(task, trees, side, root, (turn - s.pulls_at) % WAYS, s.pulls, memory)
        else:
            side = turn % 2
            if turn % (4 if turn < s.balanced_from else 64) != 0 and max(size[0], size[1]) > 2 * min(size[0], size[1]):
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
def _follow(task: Task, trees: Trees, way: Array, nodes: Int, memory: Memory) -> bool:
    """Add to both trees what of a way (K, J) that was free for a similar task is free for this one, from where it comes nearest to each.
    Whether they meet on it: trees.met says where. nodes (2, K): scratch."""
    weight = task.exact.weight
    for w in range(way.shape[0]):
        nodes[0, w] = nodes[1, w] = -1
    for side in range(2):
        at, near, least = 0, 0, np.inf
        for w in range(way.shape[0]):
            n, d = _closest(trees.q, side, trees.size[side], weight, way[w])
            if d < least:
                at, near, least = w, n, d
        if least > 0.0:
            if trees.size[side] == trees.q.shape[1] or not connects(task, trees.q[side, near], way[at], memory):
                continue
            near = _add(trees, side, near, way[at])
        nodes[side, at] = near
        for by in (1, -1):
            w, here = at, near
            while 0 <= w + by < way.shape[0] and trees.size[side] < trees.q.shape[1] and nodes[1 - side, w] < 0:
                if not connects(task, way[w], way[w + by], memory):
                    break
                w += by
                here = nodes[side, w] = _add(trees, side, here, way[w])
    for w in range(way.shape[0]):
        if nodes[0, w] >= 0 and nodes[1, w] >= 0:
            trees.met[0], trees.met[1] = nodes[0, w], nodes[1, w]
            return True
    return False


@jit_inline
def _to_pull(trees: Trees, s: GrowthSettings, turn: int) -> int:
    """Which root the hand is pulled out of in this iteration, the starts first, then the goals; -1 for none."""
    starts, goals, root = min(trees.roots[0], s.pulled), min(trees.roots[1], s.pulled), (turn - s.pulls_at) // WAYS
    if root < 0 or root >= starts + goals:
        return -1
    side = 0 if root < starts else 1
    return root if trees.size[side] - trees.roots[side] <= s.stuck else -1


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
def spread(task: Task, starts: Array, goals: Array, memory: Memory, found: NDArray[np.bool_], tried: NDArray[np.bool_]) -> None:
    """Mark in found (G,) which goals (G, J) an edge leads to from one of starts (S, J) or from a goal that was found, the nearest few of
    these.

    tried (G, G + S): edges to a goal that were looked at before, from another goal or, in the last columns, from a start.
    """
    G, weight = goals.shape[0], task.exact.weight
    for _ in range(_EDGES):
        for g in range(G):
            if found[g]:
                continue
            near, best = -1, np.inf
            for h in range(tried.shape[1]):
                if not tried[g, h] and (h >= G or found[h]):
                    d = weighted(weight, goals[h] if h < G else starts[h - G], goals[g])
                    if d < best:
                        near, best = h, d
            if near >= 0:
                tried[g, near] = True
                found[g] = connects(task, goals[near] if near < G else starts[near - G], goals[g], memory)


@jit_inline
def _sample(trees: Trees, s: GrowthSettings, side: int, lower: Array, upper: Array, target: Array) -> None:
    """Draw a target (J,) for one tree: from the whole box, or from a smaller one around a root, of a size from `narrowest` to 1."""
    if uniform(trees.rng) >= s.around_roots:
        for j in range(lower.shape[0]):
            target[j] = lower[j] + uniform(trees.rng) * (upper[j] - lower[j])
        return
    share = s.narrowest ** uniform(trees.rng)
    root = int(uniform(trees.rng) * trees.roots[side]) if side == 1 or trees.roots[0] > 1 else 0
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
