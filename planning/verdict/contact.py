"""What touches during a plan's motions, and how near it comes, by FCL on convex solids: links, what is held, what stands.

A distance is a statement about its surroundings, too: it shrinks no faster than both solids move. So few of the samples of a motion need to
be asked about. FCL's distances are not taken on trust: a plane between the two solids has to bear each of them out.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.fcl_solids import Solid, depth, shape_solids
from kinematics.mount import MOUNT, standing_still
from kinematics.robots.plain_urdf import Arm, poses
from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from kinematics.transforms import Array
from planning.verdict.course import Course
from planning.verdict.faults import Fault, Settings
from planning.verdict.fingers import STILL, any_opening, arm_moves
from planning.verdict.hand import Hand
from planning.verdict.ledger import Carry, Ledger
from planning.verdict.pairs import Pairs, link_solids, pairs_of
from planning.verdict.polyhedra import Int
from planning.verdict.sweep import Boxes, Sweep, open_intervals, sweep

TOUCH_M = 1e-6  # what overlaps by less is rounding
CLAIM_M = 1e-4  # by so much may a motion's clearance be less than it says
_SOME = 24  # samples at which a contact's depth is measured


def contact_faults(
    robot: Robot,
    hand: Hand,
    scene: Scene,
    courses: Sequence[Course],
    ledger: Ledger,
    rests: Mapping[str, frozenset[str]],
    settings: Settings,
) -> tuple[list[Fault], list[Fault]]:
    """What touches and may not, the deepest of each pair and motion, and what is nearer than a motion says that anything comes; and which
    pairs touch that an SRDF switches off. Where fingers move beside the arm they may be anywhere on their way all along.

    rests: for each object that is carried, what it stands on before and after. Where the settings leave contacts out, the pairs that are
    switched off are still looked at.
    """
    if not settings.contact and not len(pairs_of(robot).switched_off):
        return [], []
    checker = _Checker(robot, hand, scene, rests, settings)
    faults, notes = list[Fault](), list[Fault]()
    for i, (course, standing) in enumerate(zip(courses, ledger.standing)):
        found, off = checker.course(course, standing, _at_hand(ledger.carries, i))
        faults, notes = faults + (found or checker.early_or_late(course, standing)), notes + off
    return faults, notes


def near_anything(robot: Robot, hand: Hand, scene: Scene, q: Array, near_m: float) -> bool:
    """Whether at configuration q (J,), the hand empty and all objects where they begin, anything is near_m from the arm, or one part of it
    from another, or touches."""
    checker = _Checker(robot, hand, scene, {}, Settings())
    stands = Course(0, "transit", q[None], np.zeros(1), None, None, frozenset(), near_m + CLAIM_M)
    if checker.course(stands, scene.poses(), frozenset())[0]:
        return True
    at = poses(hand.arm, q[None], np.eye(4))
    links = [solid.move(at[carrier][0] @ T) for solid, (carrier, T) in zip(checker.links, checker.at)]
    return any(certified_distance(links[a], links[b]) < near_m for a, b in checker.pairs.checked)


def _at_hand(carries: Sequence[Carry], i: int) -> frozenset[str]:
    """The objects that fingers may touch while the arm stands still: those taken next, or put down just before, course i."""
    before = [c.body for c in carries if c.last < i][-1:]
    after = [c.body for c in carries if c.first > i][:1]
    return frozenset(before + after)


@dataclass(frozen=True, eq=False)
class _Posed:
    """The solids (S) of one motion: first the robot's links, so many as `links`, then the parts of what is held, then what stands.

    carrier (M,): what carries each of those that move, which are links and what is held. T (S, 4, 4): where all are, in it or in the
    world.
    """

    solids: Sequence[Solid]
    carrier: Int
    T: Array
    links: int


class _Checker:
    """One robot in one scene; FCL's objects are made once and moved."""

    def __init__(self, robot: Robot, hand: Hand, scene: Scene, rests: Mapping[str, frozenset[str]], settings: Settings) -> None:
        self.hand, self.settings, self.rests = hand, settings, rests
        self.arm: Arm = hand.arm
        self.T_world_base = scene.robot.T_world_base
        self.links = link_solids(robot)
        self.at = [self.arm.links[s.name] for s in self.links]
        fixed, objects = (standing_still(scene), scene.objects) if settings.contact else ((), ())  # else the robot is alone
        self.mounts = frozenset((MOUNT, *(b.name for b in scene.obstacles)))  # the base stands on or beside them, however deep in its hull
        self.fixed = [(s, w.T_world_body) for w in fixed for s in shape_solids(w.name, w.shape)]
        self.objects = {b.name: shape_solids(b.name, b.shape) for b in objects}
        pairs = pairs_of(robot)
        self.pairs = pairs if settings.contact else Pairs(pairs.checked[:0], pairs.switched_off)
        self.pads = {*robot.pads, *(pad.link for pad in hand.pads)}

    def early_or_late(self, course: Course, standing: Mapping[str, Array]) -> list[Fault]:
        """Faults of a motion in which fingers move beside the arm, at the first opening that has any."""
        for value, fixed in any_opening(self.hand, course):
            if found := self.course(fixed, standing, frozenset(), self.hand.fingers)[0]:
                late = f", with {self.arm.joints[self.hand.gripper]} at {value:.3g}, early or late beside the arm"
                return [replace(fault, detail=fault.detail + late) for fault in found]
        return []

    def course(
        self, course: Course, standing: Mapping[str, Array], at_hand: frozenset[str], only: Collection[str] | None = None
    ) -> tuple[list[Fault], list[Fault]]:
        """Faults and notes of one motion. only: names of which each pair that is looked at has one; None: all."""
        posed = self._posed(course, standing)
        checked, switched_off, others = self._pairs(posed, only)
        pairs = np.concatenate([checked, switched_off, others])
        box = np.array([s.box for s in posed.solids])
        boxes = Boxes(posed.carrier, posed.T, box[:, 0], box[:, 1])
        samples = sweep(self.arm, self.T_world_base, course, boxes, self.settings.step_m)
        faults, notes = list[Fault](), list[Fault]()
        for k, deep in self._found(course, samples, posed, pairs, at_hand).items():
            off = len(checked) <= k < len(checked) + len(switched_off)
            a, b = (posed.solids[x].name for x in pairs[k])
            more = ", a pair that the robot's SRDF switches off" if off else ""
            fault = Fault(course.stage, (a, b), f"{course.where}: {a} is {1000 * deep:.2f} mm inside {b}{more}", deep)
            (notes if off else faults).append(fault)
        if not faults:
            faults = self._nearer(course, samples, posed, others)
        return _deepest(faults), _deepest(notes)

    def _posed(self, course: Course, standing: Mapping[str, Array]) -> _Posed:
        """What there is while a motion runs."""
        held = course.held
        grip = self.objects.get(held.body, []) if held is not None else []
        T_held = self.hand.T_carrier_hand @ held.T_hand_body if held is not None else np.eye(4)
        around = [*self.fixed, *((s, T) for name, T in standing.items() for s in self.objects.get(name, ()))]
        solids = [*self.links, *grip, *(s for s, _ in around)]
        carrier = np.array([*(c for c, _ in self.at), *[self.hand.carrier] * len(grip)])
        T = np.array([*(T for _, T in self.at), *[T_held] * len(grip), *(T for _, T in around)])
        return _Posed(solids, carrier, T, len(self.links))

    def _pairs(self, posed: _Posed, only: Collection[str] | None) -> tuple[Int, Int, Int]:
        """Which solids are asked about: links with links (N, 2); those of them that an SRDF switches off (M, 2); and what is held with
        links, all that moves with all that stands (K, 2)."""
        links, movers, all_ = posed.links, len(posed.carrier), len(posed.solids)
        against = _each_with_each(range(movers), range(movers, all_))
        beneath = np.array([s.name in self.mounts for s in posed.solids], np.bool_)
        against = against[~(beneath[against[:, 1]] & (posed.carrier[against[:, 0]] == 0))]  # the base stands there
        held = _each_with_each(range(links, movers), range(links))
        tables = self.pairs.checked, self.pairs.switched_off, np.concatenate([held, against])
        if only is None:
            return tables
        chosen = np.array([s.name in only for s in posed.solids], np.bool_)
        checked, switched_off, others = (table[chosen[table].any(1)] for table in tables)
        return checked, switched_off, others

    def _still(self, course: Course, carrier: Int, pairs: Int) -> NDArray[np.bool_]:
        """Between which pairs no joint moves."""
        low, high = course.reach
        moves = high - low > STILL
        turning = {c: frozenset(k for k in self.arm.above[c] if k and moves[self.arm.moving[k - 1].source]) for c in set(carrier.tolist())}
        kinds: dict[frozenset[int], int] = {frozenset(): 0}  # those with the same moving carriers below them go together
        kind = np.zeros(len(carrier) + 1, np.int64)
        kind[:-1] = [kinds.setdefault(turning[c], len(kinds)) for c in carrier.tolist()]
        return np.asarray(kind[np.minimum(pairs[:, 0], len(carrier))] == kind[np.minimum(pairs[:, 1], len(carrier))])

    def _found(self, course: Course, samples: Sweep, posed: _Posed, pairs: Int, at_hand: frozenset[str]) -> dict[int, float]:
        """How deep pairs are in each other that may not be: by their number, in m."""
        a, b = pairs.T
        solids, still = posed.solids, self._still(course, posed.carrier, pairs)
        asked = _Asked(samples, solids, a, b)
        found: dict[int, float] = {}
        for k, first, last in open_intervals(samples, a, b, still):
            one, two = ((solids[x].name, bool(x < len(self.links))) for x in (a[k], b[k]))
            bound = self._bound(course, one, two, at_hand)
            some = np.unique(np.linspace(first, last, min(_SOME, last - first + 1)).round().astype(int)).tolist()
            if bound > TOUCH_M:
                touching = [n for n in some if asked.distance(k, n) <= 0]
            else:
                touching = asked.nearer(k, first, last, 0.0)
                if touching:
                    touching += [n for n in some if asked.distance(k, n) <= 0]
            deep = max((asked.depth(k, n) for n in touching), default=0.0)
            if deep > bound:
                found[k] = max(deep, found.get(k, 0.0))
        return found

    def _nearer(self, course: Course, samples: Sweep, posed: _Posed, pairs: Int) -> list[Fault]:
        """What comes nearer than a motion says that anything does: of the links that the arm's joints move and what is held to all that
        stands, and of what is held to the links that don't hold it, but for allowed contacts."""
        if course.clearance_m is None:
            return []
        names, carrier = [s.name for s in posed.solids], posed.carrier
        a, b = pairs.T
        held = (a >= len(self.links)) & (b < len(self.links))
        free = [frozenset((names[i], names[j])) not in course.allowed and not (h and names[j] in self.pads) for i, j, h in zip(a, b, held)]
        own = set(self.arm.driven_by(self.hand.carrier))  # another arm's joints don't move what they carry
        driven = {c: not own.isdisjoint(self.arm.driven_by(c)) for c in set(carrier.tolist())}
        meant = np.array(free, np.bool_) & (held | np.array([driven[c] for c in carrier[a].tolist()], np.bool_))
        asked = _Asked(samples, posed.solids, a[meant], b[meant])
        least, still = course.clearance_m - CLAIM_M, np.zeros(len(asked.a), np.bool_)
        near = [
            (asked.most(k, n), k)
            for k, first, last in open_intervals(samples, asked.a, asked.b, still, least)
            for n in asked.nearer(k, first, last, least)
        ]
        distance, k = min(near, default=(np.inf, 0))
        if not distance < least:
            return []
        one, two = names[asked.a[k]], names[asked.b[k]]
        detail = f"{one} is {1000 * distance:.2f} mm from {two}, and the least is said to be {1000 * course.clearance_m:.2f} mm"
        return [Fault(course.stage, (one, two), f"{course.where}: {detail}", distance)]

    def _bound(self, course: Course, one: tuple[str, bool], two: tuple[str, bool], at_hand: frozenset[str]) -> float:
        """How deep two may be in each other. Of each its name, and whether it is a link; what is no link is held or stands."""
        (a, a_is_link), (b, b_is_link) = one, two
        held = course.held.body if course.held is not None else None
        if a_is_link and b_is_link:
            return TOUCH_M
        if frozenset((a, b)) in course.allowed:
            body, other = (b, a) if a_is_link else (a, b)
            if a_is_link or b_is_link:
                if other in self.hand.holding and (body == held or (body in at_hand and not arm_moves(self.hand, course))):
                    return self.settings.depth_m
            elif b in self.rests.get(a, ()):  # a is held: nothing else that is no link moves
                return self.settings.depth_m
        if a_is_link and self.arm.links[a][0] == 0:  # the base stands on something
            return self.settings.depth_m
        return TOUCH_M


def _each_with_each(some: range, others: range) -> Int:
    """All pairs (N, 2) of one of some and one of others."""
    return np.stack(np.meshgrid(np.array(some, np.int64), np.array(others, np.int64), indexing="ij"), -1).reshape(-1, 2)


class _Asked:
    """FCL's answers about pairs at samples, remembered. A distance of 0 or less means that the two touch."""

    def __init__(self, samples: Sweep, solids: Sequence[Solid], a: Int, b: Int) -> None:
        self.samples, self.solids, self.a, self.b = samples, solids, a, b
        self.known: dict[tuple[int, int], float] = {}

    def distance(self, k: int, n: int) -> float:
        """At least how far pair k is apart at sample n."""
        if (k, n) not in self.known:
            self.known[k, n] = certified_distance(*self._moved(k, n))
        return self.known[k, n]

    def depth(self, k: int, n: int) -> float:
        return depth(*self._moved(k, n)) or 0.0

    def most(self, k: int, n: int) -> float:
        """At most how far pair k is apart at sample n."""
        return farthest_distance(*self._moved(k, n))

    def nearer(self, k: int, first: int, last: int, apart_m: float) -> list[int]:
        """Samples at which pair k is no more than apart_m apart, of those that can't be left out; the search goes on only where there is
        none yet."""
        a, b, gone = int(self.a[k]), int(self.b[k]), self.samples.gone
        out, todo = list[int](), [(first, last)]
        while todo:
            i, j = todo.pop()
            x, y = self.distance(k, i) - apart_m, self.distance(k, j) - apart_m
            if x <= 0 or y <= 0:
                out += [n for n, d in ((i, x), (j, y)) if d <= 0]
            elif j - i > 1 and x + y <= gone[j, a] - gone[i, a] + gone[j, b] - gone[i, b]:
                middle = (i + j) // 2
                todo += [(middle, j), (i, middle)]
        return out

    def _moved(self, k: int, n: int) -> tuple[Solid, Solid]:
        a, b = int(self.a[k]), int(self.b[k])
        return self.solids[a].move(self.samples.pose(n, a)), self.solids[b].move(self.samples.pose(n, b))


def certified_distance(a: Solid, b: Solid) -> float:
    """A lower bound of the distance of two solids in m: of the plane that FCL's nearest points suggest; 0 when they touch."""
    import fcl

    if fcl.collide(a.object, b.object, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    way = _way(a, b)
    length = float(np.linalg.norm(way))
    if not length > 0:
        return 1e-9
    u = way / length
    ahead = (b.vertices @ (b.T[:3, :3].T @ u)).min() + b.T[:3, 3] @ u
    behind = (a.vertices @ (a.T[:3, :3].T @ u)).max() + a.T[:3, 3] @ u
    return max(float(ahead - behind), 1e-9)


def farthest_distance(a: Solid, b: Solid) -> float:
    """An upper bound of the distance of two solids in m that are apart: how far FCL's nearest points are from each other."""
    return float(np.linalg.norm(_way(a, b)))


def _way(a: Solid, b: Solid) -> Array:
    """From FCL's nearest point of one solid to that of the other, (3,)."""
    import fcl

    result = fcl.DistanceResult()
    fcl.distance(a.object, b.object, fcl.DistanceRequest(enable_nearest_points=True), result)
    return np.asarray(np.subtract(result.nearest_points[1], result.nearest_points[0]))


def _deepest(faults: Sequence[Fault]) -> list[Fault]:
    """One fault for each two bodies, the deepest; the deepest of all first."""
    best: dict[frozenset[str], Fault] = {}
    for fault in sorted(faults, key=lambda f: -(f.amount or 0.0)):
        best.setdefault(frozenset(fault.bodies), fault)
    return list(best.values())
