"""Pick and place: transit → approach → grasp → lift → transfer → lower → release → retreat, for one robot before one cabinet.

Cheap tests come first: end poses by inverse kinematics and static checks, then the straight pieces, RRT-Connect last. All checks run in
the compiled core; what can't be done comes back as `Blocked`, with the stage, the link and the body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.robot import Robot
from kinematics.scene import APPROACHES, Body, Grasp, Held, Scene, State
from kinematics.shapes import Shape, bounds
from kinematics.transforms import Array, inverse, rotation_about, transform
from planning.grasps import UP, open_width, sample_grasps
from planning.motion.timing import time_stamps
from planning.motion.workcell import Situation, Touch, Workcell
from planning.plan import Blocked, Motion

ITERATIONS = 3000  # of one RRT-Connect
APPROACH_M = 0.08
LIFT_M = 0.03
MAX_PICKS = 8  # grasps with a free approach that are kept for one object
MAX_TRIES = 3  # of those, how many are given to RRT-Connect before the move is given up
PLACE_TURNS = (0.0, 0.5, -0.5, 1.0, -1.0)  # how far from its natural bearing the hand may turn where it puts an object down, rad


@dataclass(frozen=True, eq=False)
class Pick:
    """A way to take hold of an object: arm waypoints of the straight pieces, gripper values, and where the object sits in the hand."""

    grasp: Grasp
    approach: Array
    lift: Array
    gripper_open: float
    gripper_closed: float
    held: Held


@dataclass(frozen=True, eq=False)
class Place:
    """A way to put a held object down: arm waypoints of the straight pieces and the object's pose afterwards."""

    lower: Array
    retreat: Array
    T_world_object: Array


class _Memory:
    """What was found out about one state, so that the many regions of an object don't ask twice."""

    def __init__(self, state: State | None) -> None:
        self.state = state
        self.picks: dict[str, tuple[list[Pick], Blocked]] = {}
        self.transits: dict[Pick, Array | Blocked] = {}
        self.lowering: dict[Pick, Situation] = {}
        self.without: dict[str, dict[str, Array]] = {}


@dataclass(frozen=True, eq=False)
class Done:
    """Motions that were found, and the state after them."""

    motions: tuple[Motion, ...]
    after: State


class Motions:
    """All motion planning for one scene: what the loop and the policies ask. Budgets count RRT-Connect's iterations.

    time_budget_s: the paper's protocol instead, wall-clock seconds for one RRT-Connect.
    obstacles: more that stands still, besides the cabinet's walls: what was not seen yet, furniture.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        *,
        iterations: int = ITERATIONS,
        time_budget_s: float | None = None,
        obstacles: Sequence[Body] = (),
    ) -> None:
        self.robot, self.scene = robot, scene
        self.cell = Workcell(robot, scene, iterations=iterations, time_budget_s=time_budget_s, obstacles=obstacles)
        self.floor_z = float(scene.cabinet.T_world_cabinet[2, 3])
        self._memory = _Memory(None)

    def start(self) -> State:
        """The scene's first state, the arm at home before the cabinet. Raises ValueError when the robot can't stand or wait there."""
        return State(self.cell.home(), self.scene.poses())

    def place_pose(self, name: str, T_from: Array, region: int) -> Array:
        """Where an object stands in a region: its own orientation, its box's middle over the cell's centre, its bottom on the floor."""
        return _standing(self.scene.body(name).shape, T_from[:3, :3], self.scene.regions()[region])

    def retrieve_target(self, state: State, rng: np.random.Generator) -> Done | Blocked:
        """Take the target out with the scene's grasp x_g: the paper's indicator I, and the way out of the cabinet."""
        name = self.scene.target
        picks, why = self.picks(state, name, [self.scene.grasp])
        for pick in picks[:MAX_TRIES]:
            way_in = self._transit(state, pick, rng)
            if isinstance(way_in, Blocked):
                why = way_in
                continue
            way_out = self._way_out(state, pick, rng)
            if isinstance(way_out, Blocked):
                why = way_out
                continue
            motions = [*self._taking(state, name, pick, way_in), self._motion("transfer", way_out, pick.gripper_closed, pick.held)]
            return Done(tuple(motions), State(motions[-1].q[-1], self._without(state, name), pick.held))
        return why

    def relocate(self, state: State, name: str, region: int, rng: np.random.Generator) -> Done | Blocked:
        """Move an object to a region."""
        picks, why = self.picks(state, name)
        if not picks:
            return why
        T_to = self.place_pose(name, state.poses[name], region)
        rest = self._without(state, name)
        if touch := self.cell.placed(self.scene.body(name), T_to, rest):
            return Blocked("region", name, touch.body)
        tries = 0
        for pick in picks:
            unreached = self._recall(state).transits.get(pick)
            if isinstance(unreached, Blocked):
                why = unreached
                continue
            place = self._place(rest, name, pick, T_to[:3, :3], self.scene.regions()[region])
            if isinstance(place, Blocked):
                why = place
                continue
            way_in = self._transit(state, pick, rng)
            if isinstance(way_in, Blocked):
                why = way_in
                continue
            carrying = self.cell.problem(rest, pick.gripper_closed, held=pick.held)
            across = self.cell.connect(carrying, pick.lift[-1], place.lower[:1], rng)
            if not isinstance(across, Blocked):
                return self._relocated(state, rest, name, pick, place, way_in, across)
            why = replace(across, stage="transfer")
            tries += 1
            if tries == MAX_TRIES:
                break
        return why

    def picks(self, state: State, name: str, grasps: Sequence[Grasp] | None = None) -> tuple[list[Pick], Blocked]:
        """The ways to take hold of an object that hold up to all checks but RRT-Connect's, the least to turn first; and why others don't.

        grasps: by default, those sampled on the object's shape with the scene's approaches.
        """
        found = self._recall(state).picks
        if name not in found:
            found[name] = self._find_picks(state, name, grasps)
        return found[name]

    def _find_picks(self, state: State, name: str, grasps: Sequence[Grasp] | None) -> tuple[list[Pick], Blocked]:
        body = replace(self.scene.body(name), T_world_body=state.poses[name])
        if grasps is None:
            to_body = body.T_world_body[:2, 3] - self.scene.robot.T_world_base[:2, 3]
            toward = float(np.arctan2(to_body[1], to_body[0]))
            approaches = [a for a in APPROACHES if a in self.scene.approaches]
            grasps = sample_grasps(body, self.robot.opening, approaches, self.floor_z, toward)
        picks: list[Pick] = []
        why, got_to = Blocked("grasp", body=name, detail="no grasp fits its shape and the gripper's opening"), 0
        for grasp in grasps:
            opened = self.robot.opening.value_at(open_width(grasp.width_m, self.robot.opening))
            closed = self.robot.opening.value_at(grasp.width_m)
            reaching = self.cell.problem(state.poses, opened)
            solutions = self.cell.ik(grasp.T_world_hand)
            if len(solutions) == 0 and got_to == 0:
                why, got_to = Blocked("ik", "hand", name, detail="the grasp is out of reach"), _GOT_TO["ik"]
            for q in solutions:
                pick = self._pick(state, name, grasp, q, opened, closed, reaching)
                if isinstance(pick, Pick):
                    picks.append(pick)
                elif _GOT_TO[pick.stage] >= got_to:
                    why, got_to = pick, _GOT_TO[pick.stage]
            if len(picks) >= MAX_PICKS:
                break
        now = self.robot.arm_q(state.q)
        picks.sort(key=lambda p: float(np.abs(p.approach[0] - now).max()))
        return picks, why

    def _pick(self, state: State, name: str, grasp: Grasp, q: Array, opened: float, closed: float, reaching: Situation) -> Pick | Blocked:
        """One grasp with one arm configuration: static checks, the straight approach, the closing fingers, the lift."""
        if touch := self.cell.touch(reaching, q):
            return _blocked("approach", touch)
        back = self.cell.straight(reaching, q, grasp.T_world_hand, -APPROACH_M * grasp.T_world_hand[:3, 2])
        if isinstance(back, Touch):
            return _blocked("approach", back)
        if touch := self._fingers(state.poses, name, q, opened, closed):
            return _blocked("grasp", touch)
        held = Held(name, inverse(grasp.T_world_hand) @ state.poses[name])
        rest = self._without(state, name)
        lifting = self.cell.problem(rest, closed, held=held, ignore=[(name, "floor")])
        if touch := self.cell.touch(lifting, q):
            return _blocked("lift", touch)
        up = self.cell.straight(lifting, q, grasp.T_world_hand, LIFT_M * UP)
        if isinstance(up, Touch):
            return _blocked("lift", up)
        return Pick(grasp, back[::-1], up, opened, closed, held)

    def _place(self, rest: dict[str, Array], name: str, pick: Pick, R: Array, centre: Array) -> Place | Blocked:
        """Put the held object down over `centre` (3,), turned from R (3, 3) as suits the hand: static checks and the straight pieces."""
        body = self.scene.body(name)
        known = self._memory.lowering
        if pick not in known:
            known[pick] = self.cell.problem(rest, pick.gripper_closed, held=pick.held, ignore=[(name, "floor")])
        lowering = known[pick]
        why = Blocked("ik", "hand", name, detail="the place is out of reach")
        T_hand_object = pick.held.T_hand_body
        ahead = pick.grasp.T_world_hand[:3, 2]
        natural = 0.0
        if np.hypot(ahead[0], ahead[1]) > 0.3:  # for a level grasp, the hand may come in along the bearing of the place
            bearing = centre[:2] - self.scene.robot.T_world_base[:2, 3]
            natural = float(np.arctan2(bearing[1], bearing[0]) - np.arctan2(ahead[1], ahead[0]))
        ways: list[tuple[float, Array, Array]] = []
        for turn in PLACE_TURNS:
            T_object = _standing(body.shape, rotation_about(UP, natural + turn) @ R, centre)
            if not self.cell.placed(body, T_object, rest):
                for q in self.cell.ik(T_object @ inverse(T_hand_object), near=pick.lift[-1], tries=12):
                    ways.append((float(np.abs(q - pick.lift[-1]).max()), q, T_object))
        ways.sort(key=lambda way: way[0])  # the arm should turn no more than it must
        for _, q, T_object in ways:
            T_hand = T_object @ inverse(T_hand_object)
            if touch := self.cell.touch(lowering, q):
                why = _blocked("lower", touch)
                continue
            standing = {**rest, name: T_object}
            retreating = self.cell.problem(standing, pick.gripper_open)
            if touch := self.cell.touch(retreating, q):
                why = _blocked("lower", touch)
                continue
            above = self.cell.straight(lowering, q, T_hand, LIFT_M * UP)
            if isinstance(above, Touch):
                why = _blocked("lower", above)
                continue
            if touch := self._fingers(standing, name, q, pick.gripper_open, pick.gripper_closed):
                why = _blocked("release", touch)
                continue
            back = self.cell.straight(retreating, q, T_hand, -APPROACH_M * T_hand[:3, 2])
            if isinstance(back, Touch):
                why = _blocked("retreat", back)
                continue
            return Place(above[::-1], back, T_object)
        return why

    def _fingers(self, poses: Mapping[str, Array], name: str, q: Array, opened: float, closed: float) -> Touch | None:
        """What the fingers touch, besides the object, while they move between two gripper values with the arm at q."""
        ignore = [(pad, name) for pad in self.robot.pads]
        for value in np.linspace(opened, closed, 4)[1:]:
            if touch := self.cell.touch(self.cell.problem(poses, float(value), ignore=ignore), q):
                return touch
        return None

    def _transit(self, state: State, pick: Pick, rng: np.random.Generator) -> list[Motion] | Blocked:
        """From where the arm is to the beginning of a pick's approach, the fingers set to its opening first."""
        known = self._recall(state).transits
        q, gripper = self.robot.arm_q(state.q), float(state.q[self.robot.gripper_joint])
        if pick not in known:
            for value in np.linspace(gripper, pick.gripper_open, 4)[1:]:
                if touch := self.cell.touch(self.cell.problem(state.poses, float(value)), q):
                    known[pick] = _blocked("transit", touch)
                    break
            else:
                moving = self.cell.problem(state.poses, pick.gripper_open)
                known[pick] = self.cell.connect(moving, q, pick.approach[:1], rng)
        path = known[pick]
        if isinstance(path, Blocked):
            return path
        motions = []
        if abs(gripper - pick.gripper_open) > 1e-9:
            motions.append(self._motion("transit", np.stack([q, q]), gripper, to_gripper=pick.gripper_open))
        return [*motions, self._motion("transit", path, pick.gripper_open)]

    def _way_out(self, state: State, pick: Pick, rng: np.random.Generator) -> Array | Blocked:
        """From the lifted target to a configuration with its centre well outside the cabinet."""
        rest = self._without(state, pick.held.body)
        carrying = self.cell.problem(rest, pick.gripper_closed, held=pick.held)
        goals = self.cell.outside(carrying, pick.held)
        if len(goals) == 0:
            return Blocked("transfer", "hand", pick.held.body, detail="no free configuration holds it outside the cabinet")
        path = self.cell.connect(carrying, pick.lift[-1], goals, rng)
        return replace(path, stage="transfer") if isinstance(path, Blocked) else path

    def _recall(self, state: State) -> _Memory:
        if self._memory.state is not state:
            self._memory = _Memory(state)
        return self._memory

    def _without(self, state: State, name: str) -> dict[str, Array]:
        """The poses of the objects besides one."""
        known = self._recall(state).without
        if name not in known:
            known[name] = {n: T for n, T in state.poses.items() if n != name}
        return known[name]

    def _taking(self, state: State, name: str, pick: Pick, way_in: list[Motion]) -> list[Motion]:
        """The motions from where the arm is to the lifted object."""
        at = pick.approach[-1]
        return [
            *way_in,
            self._motion("approach", pick.approach, pick.gripper_open),
            self._motion("grasp", np.stack([at, at]), pick.gripper_open, to_gripper=pick.gripper_closed, touching=name),
            self._motion("lift", pick.lift, pick.gripper_closed, pick.held, on_floor=True),
        ]

    def _relocated(
        self, state: State, rest: dict[str, Array], name: str, pick: Pick, place: Place, way_in: list[Motion], across: Array
    ) -> Done:
        at = place.lower[-1]
        motions = [
            *self._taking(state, name, pick, way_in),
            self._motion("transfer", across, pick.gripper_closed, pick.held),
            self._motion("lower", place.lower, pick.gripper_closed, pick.held, on_floor=True),
            self._motion("release", np.stack([at, at]), pick.gripper_closed, to_gripper=pick.gripper_open, touching=name),
            self._motion("retreat", place.retreat, pick.gripper_open),
        ]
        return Done(tuple(motions), State(motions[-1].q[-1], {**rest, name: place.T_world_object}))

    def _motion(
        self,
        stage: str,
        arm: Array,
        gripper: float,
        held: Held | None = None,
        *,
        to_gripper: float | None = None,
        touching: str | None = None,
        on_floor: bool = False,
    ) -> Motion:
        """A motion over every actuated joint from arm waypoints (K, A); the gripper may move along, evenly."""
        values = np.linspace(gripper, gripper if to_gripper is None else to_gripper, len(arm))
        q = np.array([self.robot.with_arm(a, float(g)) for a, g in zip(arm, values)])
        body = held.body if held else touching
        may_touch = [(pad, body) for pad in sorted(self.robot.pads)] if body else []
        if on_floor and body:
            may_touch.append((body, "floor"))
        return Motion(stage, self.robot.joint_names, q, time_stamps(q, self.robot.velocity), held, tuple(may_touch))


_GOT_TO = {"ik": 1, "approach": 2, "grasp": 3, "lift": 4}  # the attempt that got furthest tells best why there is none


def _blocked(stage: str, touch: Touch) -> Blocked:
    return Blocked(stage, touch.link, touch.body, detail=touch.detail)


def _standing(shape: Shape, R: Array, centre: Array) -> Array:
    """The pose (4, 4) of a shape with rotation R (3, 3), its box's middle over `centre` (3,) and its bottom at the centre's height."""
    low, high = bounds(shape, transform(R))
    return transform(R, centre - np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]))
