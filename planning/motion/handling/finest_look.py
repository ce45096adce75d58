"""The look that a proof rests on: hands a few millimetres apart, in a cabinet with more room than there is.

Where a hand meets something between two hands that were looked at is not known. So objects, obstacles and walls are looked at smaller by as
much as any point of a hand can lie from where the nearest of the looked-at hands has it: what meets even those is met by all hands
between them. A hand that meets nothing then is looked at again as several, nearer together, with less room; and so on, till so
little room is left that a way is taken to be there. That holds for hands moved ahead or up, round what is round for turned ones, and for
all pitches between those of a diagonal approach; of a box it holds for hands that close square on its faces.

Whatever meets nothing with more room is looked at in the cabinet as it is, too: a hand that meets nothing there either is one to pick with,
though it stands between all that are sampled otherwise. Expensive is a gap that is just too narrow all along a finger: all hands in it meet
nothing till little room is left. So no more than MOST_BETWEEN are looked at for an object, and then nothing is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from heapq import heappop, heappush
from itertools import count, islice, product

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.finger_grasps import open_width
from planning.grasping.hand_poses import UP, hand_points, level_across
from planning.grasping.marginal_grasps import SURELY_M, lacks_m
from planning.grasping.pads import pad_of
from planning.grasping.sampling import DENSEST, DIAGONAL, Sampling
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.obstruction import Obstruction
from planning.motion.handling.picking import THOROUGH, Picking, ik_for_proofs
from planning.motion.handling.ways import let_in
from planning.motion.search.reaching import APPROACH_M
from planning.motion.settings import MotionSettings
from planning.relaxed_plan import Names
from planning.verdict import judge_hold

STEPS_M = (0.005, 0.003)
"""How far apart hands are at first, ahead and up."""
TURN_M = 0.005
"""So far any point of a hand moves, at most, from one that is looked at first to where it is turned, or pitched, half of the way to the
next."""
MOVED_SHARE = 0.45
"""So much of the room that can be had is for hands moved ahead or up where they are turned and pitched, too: fewest are looked at then."""
LEAST_TURN_M = 0.001  # or less, where something is so thin that nothing of it would be left; but not less than this
LEAST_ROOM_M = 0.00005
"""The room is halved till it is no more than this."""
AT_ONCE = 128  # so many hands are looked at together
MOST_BETWEEN = 10_000
"""So many hands between those of the first level are looked at for one object."""
WIDTHS = 18  # for so many is it asked how far a hand reaches
LEFT_M = 0.002
"""What is looked at smaller is still as thick as this, or thicker."""


@dataclass(frozen=True)
class Around:
    """The hands that one hand stands for: those moved ahead and up by no more than this, m, turned about the middle of what is round, and
    pitched about the middle of the pads, by no more than this, rad. reach_m: how far from either any point of a hand on its way can be;
    pad_m: how far any of a pad is from the pads' middle."""

    ahead_m: float
    up_m: float
    turn: float = 0.0
    pitch: float = 0.0
    reach_m: float = 0.0
    pad_m: float = 0.0

    @property
    def moved_m(self) -> float:
        """How far the hands are moved, at most."""
        return math.hypot(self.ahead_m, self.up_m)

    @property
    def room_m(self) -> float:
        """How far any point of the hand can be from where the one that is looked at has it."""
        return self.moved_m + (self.turn + self.pitch) * self.reach_m

    @property
    def lacks_m(self) -> float:
        """How far the one that is looked at can be from holding what another holds. A turn about what is round changes nothing."""
        return self.moved_m + self.pitch * self.pad_m

    def halved(self) -> Around:
        """What each of the hands stands for that stand for this one: half as much, where it matters most."""
        most = max(self.turn, self.pitch)
        if most * self.reach_m > self.moved_m:
            return replace(self, turn=_half_if(self.turn, most), pitch=_half_if(self.pitch, most))
        return replace(self, ahead_m=self.ahead_m / 2, up_m=self.up_m / 2, turn=self.turn / 2, pitch=self.pitch / 2)


def _half_if(angle: float, most: float) -> float:
    return angle / 2 if angle == most else angle


def levels_of(coarsest: Around) -> Levels:
    """What a hand stands for at first, and after each halving."""
    levels = [coarsest]
    while levels[-1].room_m > LEAST_ROOM_M:
        levels.append(levels[-1].halved())
    return tuple(levels)


Levels = tuple[Around, ...]
SQUARE = Around(STEPS_M[0] / 2, STEPS_M[1] / 2)
"""Of level hands that close on the faces of a box, which aren't turned."""


class FinestLook:
    """Of one scene, from coarse hands with much room to fine ones with little. cell: the cabinet as it is."""

    def __init__(self, robot: Robot, scene: Scene, settings: MotionSettings, cell: Workcell) -> None:
        self.robot, self.scene, self.settings, self.cell_as_it_is = robot, scene, settings, cell
        self.picking = replace(THOROUGH, ik=ik_for_proofs(cell.arm))
        opening = robot.opening
        self._between_pitches = not (cell.arm.few_joints or opening.cup_m or opening.round_only)  # as hands on a line of pads are
        self._cells: dict[float, Workcell] = {}
        self._levels: dict[tuple[str, bool], Levels] = {}

    def at(self, poses: Mapping[str, Array]) -> FinestView:
        """What is in the way of what, if objects stand at poses."""
        return FinestView(self, poses)

    def first_hands(self, name: str, T: Array) -> Iterator[tuple[Iterator[Grasp], Levels]]:
        """The hands that are looked at first, of an object at T (4, 4), and what each of them stands for: the level and the steep ones, the
        most natural first, and the diagonal ones."""
        kinds, sampled = list(self.scene.approaches), partial(sampled_grasps, self.robot, self.scene, name, T)
        if pitched := self._between_pitches and DIAGONAL in kinds:
            kinds.remove(DIAGONAL)
        if kinds:
            levels = self.levels(name)
            yield sampled(approaches=kinds, sampling=_sampling(levels[0])), levels
        if pitched:
            levels = self.levels(name, pitched=True)
            yield sampled(approaches=[DIAGONAL], sampling=_sampling(levels[0])), levels

    def levels(self, name: str, *, pitched: bool = False) -> Levels:
        """What hands on an object stand for, at first and after each halving. pitched: those of all pitches between two. Round what is
        round they can be turned; an arm of few joints can't choose where its hand looks."""
        key = name, pitched
        if key not in self._levels:
            shape, coarsest = self.scene.body(name).shape, SQUARE
            turned = isinstance(shape, Cylinder) and not self.cell_as_it_is.arm.few_joints
            if turned or pitched:
                most_m = (thinnest_m(self.scene) - LEFT_M) / 2
                wider = min(2.0, max(1.0, most_m * MOVED_SHARE / SQUARE.room_m)) if turned and pitched else 1.0
                coarsest = Around(wider * SQUARE.ahead_m, wider * SQUARE.up_m)
                reach_m = hand_reach_m(self.robot) + APPROACH_M + (shape.radius_m if isinstance(shape, Cylinder) else 0.0)
                angle = min(TURN_M, (most_m - coarsest.room_m) / (turned + pitched)) / reach_m
                coarsest = replace(coarsest, turn=angle * turned, pitch=angle * pitched, reach_m=reach_m, pad_m=_pad_m(self.robot))
            self._levels[key] = levels_of(coarsest)
        return self._levels[key]

    def cell(self, room_m: float) -> Workcell:
        """The cabinet with so much more room; made when asked for."""
        if room_m not in self._cells:
            scene = with_more_room(self.scene, room_m)
            self._cells[room_m] = Workcell(self.robot, scene, iterations=0, time_budget_s=None, settings=self.settings)
        return self._cells[room_m]


@dataclass(frozen=True)
class Access:
    """What a look says of an object. hand: one that takes it as things are; closed: whether none does, for certain. With neither that is
    open. between: how many hands between those of the first level were looked at."""

    hand: Grasp | None
    closed: bool
    between: int


@dataclass(frozen=True, eq=False)
class FinestView:
    """The same, if objects stand at poses."""

    look: FinestLook
    poses: Mapping[str, Array]

    def access(self, name: str, standing: Names) -> Access:
        """Whether there is a way to an object while only `standing`, itself and the target stand."""
        queue, ticket, closed, between = list[tuple[float, int, int, Grasp, Levels]](), count(), True, 0

        def batches() -> Iterator[tuple[list[Grasp], int, Levels]]:
            """What is looked at next, and its level."""
            nonlocal between
            for coarse, levels in self.look.first_hands(name, self.poses[name]):
                while hands := list(islice(coarse, AT_ONCE)):
                    yield hands, 0, levels
            while queue and between < MOST_BETWEEN:
                _, level, _, hand, levels = heappop(queue)
                hands = list(self._divided(name, hand, levels[level]))
                between += len(hands)
                yield hands, level + 1, levels

        for hands, level, levels in batches():
            for hand, open_till in self._open(hands, level, levels, name, standing):
                if open_till == len(levels):
                    return Access(hand, False, between)
                if level < len(levels) - 1:  # those are looked around first that lack least room
                    heappush(queue, (levels[open_till].room_m, level, next(ticket), hand, levels))
                else:
                    closed = False
        return Access(None, closed and not queue, between)

    def _open(self, hands: Sequence[Grasp], level: int, levels: Levels, name: str, standing: Names) -> list[tuple[Grasp, int]]:
        """Which of some hands meet nothing and may hold the object, with the room of their level, and the finest level at which each still
        does; that is the number of levels for one that takes the object without more room."""
        found, left, here = list[tuple[Grasp, int]](), list(hands), self._here(name, standing)
        for finer in range(level, len(levels)):
            if not left:
                return found
            cell, lacks_m = self.look.cell(levels[finer].room_m), levels[finer].lacks_m
            near = [hand for hand in left if finer == 0 or self._lacks_m(name, hand) <= lacks_m]  # those of level 0 are sampled so
            still = self._meet_nothing(cell, let_in(cell, near, here, self.look.picking.ik), name, standing)
            if finer > level:
                found += [(hand, finer - 1) for hand in left if not any(hand is other for other in still)]
            left = still
        return found + [(hand, len(levels) if self._takes(name, hand, standing) else len(levels) - 1) for hand in left]

    def _meet_nothing(self, cell: Workcell, hands: Sequence[Grasp], name: str, standing: Names) -> list[Grasp]:
        """Those of some hands to which a whole way leads."""
        if not hands:
            return []
        among = Obstruction(cell, lambda *_: hands, ik=self.look.picking.ik)
        return [hands[i] for i in among.at(self.poses).open_grasps(name, standing)]

    def _lacks_m(self, name: str, hand: Grasp) -> float:
        """How far a hand is from holding an object, at least."""
        robot = self.look.robot
        return lacks_m(self._body(name), robot.opening, pad_of(robot), hand)

    def _takes(self, name: str, hand: Grasp, standing: Names) -> bool:
        """Whether a hand takes an object as things are: the planner finds a way, and the verdict calls it held."""
        cell = self.look.cell_as_it_is
        poses = self._here(name, standing)
        picks, _ = Picking(cell, self.look.picking).picks_with([hand], poses, cell.without(poses, name), name, cell.home_arm)
        return bool(picks) and judge_hold(self.look.robot, self._body(name), hand) is None

    def _here(self, name: str, standing: Names) -> dict[str, Array]:
        """Where what stands is, an object and the target among it."""
        return {other: T for other, T in self.poses.items() if other in {name, *standing, self.look.scene.target_name}}

    def _divided(self, name: str, hand: Grasp, around: Around) -> Iterator[Grasp]:
        opening, width = self.look.robot.opening, hand.width_m
        pads = np.array([0.0, opening.pad_y_at(width), opening.pad_z_at(width)])
        return divided(hand, around, self.poses[name][:3, 3], pads)

    def _body(self, name: str) -> Body:
        return replace(self.look.scene.body(name), T_world_body=self.poses[name])


def divided(hand: Grasp, around: Around, middle: Array, pads: Array) -> Iterator[Grasp]:
    """The hands of the next level that stand together for a hand and those around it; middle (3,): of what they hold; pads (3,): the pads'
    middle in the hand's frame."""
    finer = around.halved()
    steps = [was - now for was, now in zip(_extents(around), _extents(finer))]
    for along, above, turn, pitch in product(*map(_either, steps)):
        T = transform(p=along * level_across(hand.T_world_hand[:3, 1]) + above * UP) @ hand.T_world_hand
        if turn:
            T = _about(middle, rotation_about(UP, turn)) @ T
        if pitch:
            T = T @ _about(pads, rotation_about((0.0, 1.0, 0.0), pitch))
        yield replace(hand, T_world_hand=T)


def _about(point: Array, R: Array) -> Array:
    """A turn (4, 4) by R (3, 3) about a point (3,)."""
    return transform(p=point) @ transform(R) @ transform(p=-point)


def _extents(around: Around) -> tuple[float, ...]:
    return around.ahead_m, around.up_m, around.turn, around.pitch


def _either(way: float) -> tuple[float, ...]:
    return (-way, way) if way else (0.0,)


def _sampling(around: Around) -> Sampling:
    """Of the hands that are looked at first, each of which stands for all around it. With pitches: natural ones were looked at before."""
    yaws = math.ceil(np.pi / (2 * around.turn)) if around.turn else DENSEST.yaws
    sampling = replace(DENSEST, yaws=yaws, steps_m=(2 * around.ahead_m, 2 * around.up_m), beyond_m=around.lacks_m)
    if not around.pitch:
        return sampling
    low, high = min(DENSEST.pitches[DIAGONAL]), max(DENSEST.pitches[DIAGONAL])
    n = math.ceil((high - low) / (2 * around.pitch))
    return replace(sampling, heights=(), pitches={DIAGONAL: tuple(low + (np.arange(n) + 0.5) * (high - low) / n)})


@lru_cache(maxsize=16)
def hand_reach_m(robot: Robot) -> float:
    """How far any point of the hand, open to take something, is from what is between its pads then, at most; the pads' middle moves as they
    open."""
    pad, opening = pad_of(robot), robot.opening
    widths = np.linspace(0.0, opening.max_m, WIDTHS)
    points = np.concatenate([hand_points(robot, open_width(w, opening), robot.hand_links) - opening.middle(w) for w in widths])
    return float(np.linalg.norm(points, axis=1).max()) + math.hypot(pad.half_x_m, max(-pad.low_z_m, pad.high_z_m))


def _pad_m(robot: Robot) -> float:
    """How far any of a pad is from the pads' middle, by way of the middle of its face; and a little more, for the square in which it
    holds."""
    pad = pad_of(robot)
    return math.hypot(pad.half_x_m, (pad.high_z_m - pad.low_z_m) / 2) + abs(pad.high_z_m + pad.low_z_m) / 2 + SURELY_M


def thinnest_m(scene: Scene) -> float:
    """How thick the thinnest is of all that stands in a scene, and of its walls; 0 where there is a mesh."""
    bodies = (*scene.objects, *scene.obstacles)
    solid = (2 * float(b.shape.half.min()) if isinstance(b.shape, (Box, Cylinder)) else 0.0 for b in bodies)
    return min(scene.cabinet.wall_m, *solid)


def thinnest_allowed_m(scene: Scene) -> float:
    """What is thinner can't be made smaller by the most room there is in a scene, and something be left of it."""
    return 2 * (SQUARE.room_m + LEAST_TURN_M * (2 if DIAGONAL in scene.approaches else 1)) + LEFT_M


def can_have_more_room(scene: Scene) -> bool:
    """Whether all that stands in a scene can be made smaller: boxes and cylinders, no plate, no thin wall."""
    return thinnest_m(scene) >= thinnest_allowed_m(scene)


def with_more_room(scene: Scene, by_m: float) -> Scene:
    """A scene in which objects, obstacles and walls are further from any point by so much."""
    cabinet = scene.cabinet
    roomier = replace(
        cabinet,
        size_m=cabinet.size_m + np.array([0.0, 2 * by_m, 2 * by_m]),
        T_world_cabinet=cabinet.T_world_cabinet @ transform(p=[by_m, 0.0, -by_m]),
        wall_m=cabinet.wall_m - 2 * by_m,  # for links beside, above and below it, too
    )
    objects, obstacles = (tuple(_smaller(body, by_m) for body in bodies) for bodies in (scene.objects, scene.obstacles))
    return replace(scene, cabinet=roomier, objects=objects, obstacles=obstacles)


def _smaller(body: Body, by_m: float) -> Body:
    match body.shape:
        case Box(size_m):
            return replace(body, shape=Box(np.asarray(size_m) - 2 * by_m))
        case Cylinder(radius_m, height_m):
            return replace(body, shape=Cylinder(radius_m - by_m, height_m - 2 * by_m))
    raise ValueError(f"{body.name} is a mesh, and can't be made smaller")
