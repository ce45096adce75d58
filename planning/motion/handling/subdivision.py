"""The proof that no hand takes an object: the poses of the hand are subdivided (branch and bound), each cell against shrunk obstacles.

A collision of one hand says nothing of those beside it. So each hand that is looked at stands for all in its neighbourhood, and objects,
obstacles and walls are shrunk by as much as any point of those hands can lie from where this one has it: where it meets even the shrunk
ones, all of them meet something. A hand that meets nothing then is divided into several, nearer together, with obstacles shrunk by
less; and so on, till these are shrunk by so little that a way is taken to be there. That holds for hands moved ahead or up, round what is
round for turned ones, and for all pitches between those of a diagonal approach; of a box it holds for hands that close square on its faces.

Whatever meets nothing with more room is looked at in the cabinet as it is, too: a hand that meets nothing there either is one to pick with,
though it stands between all that are sampled otherwise. Expensive is a gap that is just too narrow all along a finger: all hands in it meet
nothing till little room is left. So no more than most_between are looked at for an object, and with so much inverse kinematics at most,
and then nothing is said; nor are more hands looked at first, once too many of them meet nothing for that.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from heapq import heappop, heappush
from itertools import count, islice

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Grasp, Scene
from kinematics.shapes import Cylinder
from kinematics.transforms import Array
from planning.grasping.marginal_grasps import lacks_m
from planning.grasping.pads import pad_of
from planning.grasping.sampling import DIAGONAL
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.neighbourhoods import Levels, Neighbourhood, coarsest, divided, levels_of, sampling_of
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.obstruction import Obstruction
from planning.motion.handling.picking import THOROUGH, Picking, ik_for_proofs
from planning.motion.handling.shrunk_scene import most_room_m, shrunk
from planning.motion.handling.ways import approachable
from planning.motion.settings import MotionSettings
from planning.relaxed_plan import Names
from planning.verdict import judge_hold

AT_ONCE = 128  # so many hands are looked at together
MOST_BETWEEN, MOST_OF_REDUNDANT = 10_000, 3_000
"""So many hands between those of the first level are looked at for one object; with an arm of more than six joints, for each of whose hands
many solutions are looked for, the second: proofs that come out look at up to 2,400."""
MOST_STARTS_OF_REDUNDANT = 10_000_000
"""From so many starts inverse kinematics looks for such an arm's solutions for one object, in two minutes: proofs that come out take up to
3.4 million."""


class HandSubdivision:
    """Of one scene, from coarse hands among obstacles that are much shrunk to fine ones. cell: the cabinet as it is."""

    def __init__(self, robot: Robot, scene: Scene, settings: MotionSettings, cell: Workcell) -> None:
        self.robot, self.scene, self.settings, self.cell_as_it_is = robot, scene, settings, cell
        self.picking = replace(THOROUGH, ik=ik_for_proofs(cell.arm))
        self.closer = [THOROUGH.ik, self.picking.ik] if cell.arm.redundant else [self.picking.ik]  # most are found by few starts
        self.most_between = MOST_OF_REDUNDANT if cell.arm.redundant else MOST_BETWEEN
        self.most_starts = MOST_STARTS_OF_REDUNDANT if cell.arm.redundant else math.inf
        opening = robot.opening
        self._between_pitches = not (cell.arm.few_joints or opening.cup_m or opening.round_only)  # as hands on a line of pads are
        self._cells: dict[float, Workcell] = {}
        self._levels: dict[tuple[str, bool], Levels] = {}

    def at(self, poses: Mapping[str, Array]) -> SubdivisionView:
        """What is in the way of what, if objects stand at poses."""
        return SubdivisionView(self, poses)

    def first_hands(self, name: str, T: Array) -> Iterator[tuple[Iterator[Grasp], Levels]]:
        """The hands that are looked at first, of an object at T (4, 4), and what each of them stands for: the level and the steep ones, the
        most natural first, and the diagonal ones."""
        kinds, sampled = list(self.scene.approaches), partial(sampled_grasps, self.robot, self.scene, name, T)
        if pitched := self._between_pitches and DIAGONAL in kinds:
            kinds.remove(DIAGONAL)
        if kinds:
            levels = self.levels(name)
            yield sampled(approaches=kinds, sampling=sampling_of(levels[0])), levels
        if pitched:
            levels = self.levels(name, pitched=True)
            yield sampled(approaches=[DIAGONAL], sampling=sampling_of(levels[0])), levels

    def levels(self, name: str, *, pitched: bool = False) -> Levels:
        """What hands on an object stand for, at first and after each halving. pitched: those of all pitches between two. Round what is
        round they can be turned; an arm of few joints can't choose where its hand looks."""
        key = name, pitched
        if key not in self._levels:
            shape = self.scene.body(name).shape
            radius_m = shape.radius_m if isinstance(shape, Cylinder) else 0.0
            turned = radius_m > 0.0 and not self.cell_as_it_is.arm.few_joints
            self._levels[key] = levels_of(coarsest(self.robot, most_room_m(self.scene), radius_m, turned=turned, pitched=pitched))
        return self._levels[key]

    def ik_starts(self) -> int:
        """From how many starts inverse kinematics has looked for solutions so far."""
        return sum(cell.ik_starts for cell in self._cells.values())

    def cell(self, room_m: float) -> Workcell:
        """The cabinet with so much more room; made when asked for."""
        if room_m not in self._cells:
            scene = shrunk(self.scene, room_m)
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
class SubdivisionView:
    """The same, if objects stand at poses."""

    look: HandSubdivision
    poses: Mapping[str, Array]

    def access(self, name: str, standing: Names) -> Access:
        """Whether there is a way to an object while only `standing`, itself and the target stand."""
        queue, ticket, closed, between = list[tuple[float, int, int, Grasp, Levels]](), count(), True, 0
        most_starts = self.look.ik_starts() + self.look.most_starts

        def in_time() -> bool:
            return self.look.ik_starts() < most_starts

        def batches() -> Iterator[tuple[list[Grasp], int, Levels]]:
            """What is looked at next, and its level."""
            nonlocal between, closed
            for coarse, levels in self.look.first_hands(name, self.poses[name]):
                while closed and (hands := list(islice(coarse, AT_ONCE))):
                    yield hands, 0, levels
                    closed = 2 * len(queue) <= self.look.most_between and in_time()  # each is divided into two at least
            while queue and between < self.look.most_between and in_time():
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
        found, left = list[tuple[Grasp, int]](), list(hands)
        for finer in range(level, len(levels)):
            if not left:
                return found
            cell, lacks_m = self.look.cell(levels[finer].room_m), levels[finer].lacks_m
            near = [hand for hand in left if finer == 0 or self._lacks_m(name, hand) <= lacks_m]  # those of level 0 are sampled so
            still = self._meet_nothing(cell, near, name, standing)
            if finer > level:
                found += [(hand, finer - 1) for hand in left if not any(hand is other for other in still)]
            left = still
        return found + [(hand, len(levels) if self._takes(name, hand, standing) else len(levels) - 1) for hand in left]

    def _meet_nothing(self, cell: Workcell, hands: Sequence[Grasp], name: str, standing: Names) -> list[Grasp]:
        """Those of some hands to which a whole way leads."""
        left, open_at = approachable(cell, hands, self._here(name, standing), self.look.closer), set[int]()
        for ik in self.look.closer:
            among = Obstruction(cell, lambda *_, left=tuple(left): left, ik=ik).at(self.poses)
            open_at |= {id(left[i]) for i in among.open_grasps(name, standing)}
            left = [hand for hand in left if id(hand) not in open_at]
        return [hand for hand in hands if id(hand) in open_at]

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

    def _divided(self, name: str, hand: Grasp, around: Neighbourhood) -> Iterator[Grasp]:
        return divided(hand, around, self.poses[name][:3, 3], self.look.robot.opening.pads_middle(hand.width_m))

    def _body(self, name: str) -> Body:
        return replace(self.look.scene.body(name), T_world_body=self.poses[name])
