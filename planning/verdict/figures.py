"""What a plan says of itself: its moves, its figures, its success, and the grasp x_g that it was asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.scene import Grasp, Scene
from kinematics.shapes import Shape
from kinematics.transforms import Array, inverse
from planning.plan import Move, Plan
from planning.verdict.course import Course, dense_rows
from planning.verdict.faults import MOVES, PLAN, Fault, Settings
from planning.verdict.hand import Hand
from planning.verdict.ledger import Ledger, difference, hand_poses
from planning.verdict.polyhedra import polyhedra

CHORD = 0.05  # rad or m, into which the hand's way is cut to measure it
TRAVEL_SHARE, TRAVEL_M = 0.01, 0.002  # by which a measured way may differ
VALUE = 1e-3  # by which a return may
REGION_M = 1e-3  # by which the middle of what is put down may be beside its region
TIME_S = 1e-3
NOTHING = "nothing"
EMPTY, CARRYING = ("transit", "approach", "retreat", "look"), ("lift", "transfer", "lower")
"""Stages in which a hand holds nothing, and in which it holds something."""
STATED = {"duration_s": 1e-3, "clearance_m": 1e-5}
"""By which figures in a plan's file may differ from those of its motions."""


def move_faults(scene: Scene, plan: Plan, ledger: Ledger, settings: Settings) -> list[Fault]:
    """The moves that are called done are what the hand carried, in order, from where it stood to where it was put."""
    carries, done = list(ledger.carries), [m for m in plan.moves if m.done]
    if plan.success and carries and carries[-1].body == scene.target and not carries[-1].put:
        carries.pop()
    if [m.object for m in done] != [c.body for c in carries]:
        said, was = (", ".join(names) or "nothing" for names in ([m.object for m in done], [c.body for c in carries]))
        return [Fault(MOVES, (), f"the moves say that {said} was moved, and the motions move {was}")]
    out = []
    for move, carry in zip(done, carries):
        for which, said_T, was_T in (("from", move.T_world_from, carry.T_world_from), ("to", move.T_world_to, carry.T_world_to)):
            far, turned = difference(said_T, was_T)
            if not (far <= settings.pose_m and turned <= settings.pose_rad):
                detail = f"{move.object} is {1000 * far:.1f} mm and {np.degrees(turned):.1f}° from its T_world_{which}"
                out.append(Fault(MOVES, (move.object,), detail, far))
        out += _region(scene, move)
    return out


def _region(scene: Scene, move: Move) -> list[Fault]:
    """The object's middle is over the region that the move names."""
    n, (depth, width, _) = scene.regions_n, np.asarray(scene.cabinet.size_m, float)
    if move.region >= n * n:
        return [Fault(MOVES, (move.object,), f"{move.object} goes to region {move.region}, and there are {n * n}")]
    T = inverse(scene.cabinet.T_world_cabinet) @ move.T_world_to
    middle = _span(scene.body(move.object).shape, T).mean(0)[:2]
    row, column = divmod(move.region, n)
    centre = np.array([(row + 0.5) / n * depth, (column + 0.5) / n * width - width / 2])
    off = float(np.max(np.abs(middle - centre) - np.array([depth, width]) / (2 * n)))
    if off <= REGION_M:
        return []
    return [Fault(MOVES, (move.object,), f"{move.object} stands {1000 * off:.0f} mm outside region {move.region}", off)]


def goal_faults(scene: Scene, plan: Plan, ledger: Ledger) -> list[Fault]:
    """A success ends with the whole target outside, in the hand; without one nothing stays in the hand."""
    last = ledger.carries[-1] if ledger.carries else None
    in_hand = last.body if last is not None and not last.put else None
    if not plan.success:
        return [] if in_hand is None else [Fault(PLAN, (in_hand,), f"it is no success, and {in_hand} stays in the hand at its end")]
    if in_hand is None or in_hand != scene.target:
        detail = f"it is called a success, and the hand holds {in_hand or 'nothing'} at its end, not {scene.target}"
        return [Fault(PLAN, (in_hand,) if in_hand else (), detail)]
    low, high = _span(scene.body(in_hand).shape, inverse(scene.cabinet.T_world_cabinet) @ ledger.poses[in_hand])
    depth, width, height = (float(x) for x in scene.cabinet.size_m)
    inside = float(min(high[0], depth - low[0], high[1] + width / 2, width / 2 - low[1], high[2], height - low[2]))
    if inside <= 0:
        return []
    return [Fault(PLAN, (in_hand,), f"{in_hand} still is {1000 * inside:.1f} mm inside the cabinet at the end", inside)]


def _span(shape: Shape, T: Array) -> Array:
    """The corners (2, 3) of the tightest axis-aligned box of a shape at pose T (4, 4)."""
    points = np.concatenate([p.vertices for p in polyhedra(shape)]) @ T[:3, :3].T + T[:3, 3]
    return np.stack([points.min(0), points.max(0)])


def grasp_faults(scene: Scene, ledger: Ledger, allowed: Sequence[Grasp], settings: Settings) -> list[Fault]:
    """The target is taken with one of the grasps that were asked for."""
    taken = next((c for c in ledger.carries if c.body == scene.target and not c.put), None)
    if taken is None or not allowed:
        return []
    off = off_grasps(taken.T_world_hand, allowed, settings)
    if off is None:
        return []
    words, far_m = off
    return [Fault("grasp", ("hand", taken.body), f"{taken.body} is taken {words} from the grasp that was asked for", far_m)]


def off_grasps(T_world_hand: Array, grasps: Sequence[Grasp], settings: Settings) -> tuple[str, float] | None:
    """How far a hand (4, 4) is from the nearest of some grasps, at least one: in words, and in m; None where it is there."""
    off = [difference(g.T_world_hand, T_world_hand) for g in grasps]
    far, turned = min(off, key=lambda d: d[0] + 0.1 * d[1])
    if far <= settings.pose_m and turned <= settings.pose_rad:
        return None
    return f"{1000 * far:.1f} mm and {np.degrees(turned):.1f}°", far


def tilt_faults(courses: Sequence[Course], ledger: Ledger, hand: Hand, T_world_base: Array, limits: dict[str, float]) -> list[Fault]:
    """Nothing is carried further tilted than its limit, in degrees, from how it stood before it was taken."""
    out = []
    carried = [
        (course, carry, limit)
        for carry in ledger.carries
        if (limit := limits.get(carry.body)) is not None and limit < 180
        for course in courses[carry.first : carry.last + 1]
    ]
    if not carried:
        return []
    rows = dense_rows([course for course, _, _ in carried], 0.01)
    R = hand_poses(hand, np.concatenate(rows), T_world_base)[:, :3, :3]
    for (course, carry, limit), its in zip(carried, np.split(R, np.cumsum([len(r) for r in rows])[:-1])):
        up = carry.T_world_from[:3, :3].T @ [0.0, 0.0, 1.0]  # what points up, in the body
        axis = its @ (carry.T_hand_body[:3, :3] @ up)
        tilt = float(np.degrees(np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])).max())
        if tilt > limit + 0.1:
            detail = f"{course.where}: {carry.body} leans by {tilt:.1f}°, and may by {limit:g}°"
            out.append(Fault(course.stage, (carry.body,), detail, float(np.radians(tilt))))
    return out


def figure_faults(scene: Scene, plan: Plan, courses: Sequence[Course], hand: Hand) -> list[Fault]:
    """`return`, the hand's way and the times are what moves and motions say."""
    out = []
    base = scene.robot.T_world_base[:3, 3]
    ends = [(m.T_world_from[:3, 3], m.T_world_to[:3, 3]) for m in plan.moves if m.done]
    value = float(plan.success) - float(sum(np.linalg.norm(a - base) + np.linalg.norm(b - a) for a, b in ends))
    if not abs(plan.value - value) <= VALUE:
        out.append(Fault(PLAN, (), f"its return is {plan.value:.4f}, and the moves make it {value:.4f}", abs(plan.value - value)))
    ways = hand_ways(courses, hand, scene.robot.T_world_base)
    out += _travel_faults("hand_travel_m", plan.hand_travel_m, float(ways.sum()), "the motions")
    if plan.relocation_travel_m is not None:
        last = max((i for i, course in enumerate(courses) if course.stage == "retreat"), default=-1)
        way = float(sum(way for way, course in zip(ways[: last + 1], courses) if course.stage != "look"))
        out += _travel_faults("relocation_travel_m", plan.relocation_travel_m, way, "the motions before the last retreat")
    late = [c for c in courses if c.t_s[0] > TIME_S]
    out += [Fault(c.stage, (), f"{c.where} begins at {c.t_s[0]:.3f} s, and times count from its start", float(c.t_s[0])) for c in late[:1]]
    return out + stated_faults(plan)


def stated_faults(plan: Plan) -> list[Fault]:
    """What a plan's file says of its duration and clearance is what its motions give."""
    out = []
    for name, said in plan.stated.items():
        is_so: float | None = getattr(plan, name)
        if is_so is None or not abs(said - is_so) <= STATED[name]:
            out.append(Fault(PLAN, (), f"its {name} is {said:.4f}, and the motions make it {NOTHING if is_so is None else f'{is_so:.4f}'}"))
    return out


def stage_faults(courses: Sequence[Course]) -> list[Fault]:
    """Motions of an empty hand hold nothing, and those that carry hold something."""
    out = []
    for course in courses:
        if course.stage in EMPTY and course.held is not None:
            out.append(Fault(course.stage, (course.held.body,), f"{course.where} is of an empty hand, and holds {course.held.body}"))
        if course.stage in CARRYING and course.held is None:
            out.append(Fault(course.stage, (), f"{course.where} carries, and holds nothing"))
    return out[:1]


def mass_faults(scene: Scene, ledger: Ledger) -> list[Fault]:
    """What is lifted that is heavier than the robot may lift."""
    heavy = ((carry.body, scene.too_heavy(carry.body)) for carry in ledger.carries)
    return [Fault("lift", (name,), weighs) for name, weighs in heavy if weighs is not None]


def claim_faults(scene: Scene, plan: Plan) -> list[Fault]:
    """What a plan says of its outcome does not contradict itself: success, its reason, how many moves there are, may be and must be."""
    done = sum(m.done for m in plan.moves)
    said = [
        (plan.success and plan.reason is not None, f"it is called a success, and has a reason why it failed: {plan.reason}"),
        (not plan.success and plan.reason is None, "it is no success, and does not say why"),
        (plan.success and plan.unsolvable is not None, "it is called a success, and the scene unsolvable"),
        (plan.success and done < (plan.least_moves or 0), f"its least_moves is {plan.least_moves}, and it succeeds with {done}"),
        (done > plan.max_moves, f"it makes {done} moves, and its max_moves is {plan.max_moves}"),
    ]
    out = [Fault(PLAN, (), detail) for wrong, detail in said if wrong]
    for move in plan.moves:
        if move.done and move.reason is not None:
            out.append(
                Fault(MOVES, (move.object,), f"the move of {move.object} is called done, and has a reason why it failed: {move.reason}")
            )
    known = scene.poses()
    for name in [s.object for s in plan.settled if s.object not in known][:1]:
        out.append(Fault(PLAN, (name,), f"it says that {name!r} was settled, which is not in the scene"))
    return out


def _travel_faults(name: str, said_m: float, way_m: float, of: str) -> list[Fault]:
    """What is wrong with a length that a plan says of the hand's way."""
    if abs(said_m - way_m) <= TRAVEL_SHARE * way_m + TRAVEL_M:
        return []
    return [Fault(PLAN, (), f"its {name} is {said_m:.4f}, and {of} make it {way_m:.4f}", abs(said_m - way_m))]


def hand_ways(courses: Sequence[Course], hand: Hand, T_world_base: Array) -> Array:
    """Lengths in m (C,) of the hand's way in each course, along chords of at most `CHORD` in any joint."""
    rows = dense_rows(courses, CHORD)
    at = hand_poses(hand, np.concatenate(rows), T_world_base)[:, :3, 3]
    chords = np.append(np.linalg.norm(np.diff(at, axis=0), axis=1), 0.0)
    ends = np.cumsum([len(r) for r in rows])
    chords[ends - 1] = 0.0  # from one motion to the next
    return np.add.reduceat(chords, ends - [len(r) for r in rows])
