"""Where a cabinet stands best for an arm: how far before it, how high, and how large, so that the arm reaches what stands in it.

First by inverse kinematics alone, on a grid around the arm; then the best places are tried with the whole arm and the cabinet's walls.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice, product

import numpy as np

from kinematics import inverse
from kinematics.collision.fcl_solids import apart
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene, State
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from kinematics.transforms import Array, apply, rotation_about, transform
from planning.grasping.antipodal import SPARE_M
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.hand_poses import UP
from planning.motion.cell.arm import HALF_TURN, Arm, arm_at
from planning.motion.handling.object_grasps import headings_of
from planning.motion.handling.waiting import places_to_wait
from planning.motion.pick_place import Motions
from planning.motion.settings import UNCONSTRAINED
from planning.scenes.generation import NoScene, Spec
from planning.verdict import judge_grasp

USUAL_REACH_M = 0.85  # of the arms that the specs' cabinets are made for
LEAST_SCALE = 0.25
STEPS, TRIES, EXACTLY = 12, 8, 8
LATERAL = (-0.8, -0.4, 0.0, 0.4, 0.8)
"""Where the arm's reach is looked at across the cabinet, in shares of half its width."""
BEFORE_M, BESIDE_M = 0.05, 0.01
"""What the cabinet's front keeps from what is fixed to the arm's base, and all of it from a frame of the base that it stands in."""
LEAST_SHARE, BOX_SHARE, BOX_YAWS = 0.2, 0.5, (0.25, 0.75)
"""From how many of the places an arm takes a cylinder, at least; and a box, turned so, where there are to be boxes: as no arm of few joints
has to look that is before it."""
SLIMMER = (1.0, 0.9, 0.8, 0.65, 0.5)
"""Shares of the objects' width, of which the first is taken that the hand can hold: palm and knuckles may leave less room than fingers."""
ROOMY = 4.0  # times as large as a spec's cabinet is one whose walls are in no hand's way


@dataclass(frozen=True, eq=False)
class Fitted:
    """A spec and a robot's place that go together. share: of the places in the cabinet that were tried, how many the arm can take an object
    from; scale: of the cabinet and what is in it; slimmer: of the objects' width besides. alone: the only kind of objects in it, where the
    arm hardly takes others."""

    spec: Spec
    ref: RobotRef
    share: float
    scale: float
    slimmer: float = 1.0
    alone: str | None = None

    def __str__(self) -> str:
        size = " × ".join(f"{v:.2f}" for v in self.spec.cabinet_size_m)
        x, _, z = self.ref.T_world_base[:3, 3]
        front, floor = self.spec.cabinet_front_m - x, self.spec.cabinet_floor_m - z
        slim = f"; they are {100 * self.slimmer:.0f} % as wide, as its hand holds no wider ones" if self.slimmer < 1.0 else ""
        return (
            f"a cabinet of {size} m, its front {front:.2f} m before the arm's base and its floor {floor:.2f} m above: the arm takes "
            f"objects from {100 * self.share:.0f} % of it{slim}{f'; {self.alone} alone, as it hardly takes others' if self.alone else ''}"
        )


def fit(spec: Spec, robot: Robot, ref: RobotRef, on_step: Callable[[str], None] = lambda _: None) -> Fitted:
    """Place and scale a spec's cabinet for an arm, and turn the arm to face it; of a robot of one's own the home is put before the cabinet.

    The same robot and spec always give the same. on_step: told of each place that is tried. Raises: NoScene when the arm does not reach
    into it anywhere.
    """
    there = arm_at(robot, np.eye(4))
    facing = _facing(there)
    pivot = robot.pivot(np.eye(4))
    T_base = transform(rotation_about(UP, -facing))
    T_base[:3, 3] = ref.T_world_base[:3, 3] - [*(T_base[:3, :3] @ [*pivot, 0.0])[:2], 0.0]
    arm = arm_at(robot, T_base)
    reach = float(np.quantile(np.hypot(*(_positions(arm) - [*robot.pivot(T_base), 0.0])[:, :2].T), 0.98))
    scale = _scale(spec, robot, reach)
    spec = _scaled(spec, scale)
    if arm.few_joints:  # such an arm looks where it turns to
        spec = replace(spec, grasp_bearing_share=1.0, grasp_yaw_spread=0.0)
    turned = replace(ref, T_world_base=T_base)
    cup = robot.opening.cup_m > 0
    places = _promising(arm, spec, reach)[:EXACTLY]
    found, slimmer, why = _Tried(spec, 0.0), 1.0, ""
    for slimmer in SLIMMER:
        slim = _slimmed(spec, slimmer)
        if wrong := _not_held(slim, robot, turned, boxes=cup):
            why = wrong
            continue
        found = _best_of(places, slim, robot, turned, cup, on_step)
        if found.share >= LEAST_SHARE:
            break
        why = found.why or why
    if found.share < LEAST_SHARE:
        raise NoScene(
            f"robot {robot.name}: wherever a cabinet like this one stands, the arm takes objects from {100 * found.share:.0f} % of it at "
            f"most{f' ({why})' if why else ''}"
        )
    if found.home is not None and ref.name is None:
        names = [robot.joint_names[j] for j in robot.arm_joints]
        turned = replace(turned, home={name: float(q) for name, q in zip(names, found.home)})
    others = _share(found.spec, robot, replace(turned, home=None), boxes=not cup).share >= BOX_SHARE
    spec = found.spec if others else _of_one_kind(found.spec, boxes=cup)
    return Fitted(spec, turned, found.share, scale, slimmer, None if others else "boxes" if cup else "cylinders")


@dataclass(frozen=True, eq=False)
class _Tried:
    """A spec at one place. share: from how many of the places in the cabinet an object can be taken; home (A,): where the arm waits before
    it; why: what is in the way most often where none can, in words."""

    spec: Spec
    share: float
    home: Array | None = None
    why: str = ""


def _best_of(
    places: Sequence[tuple[float, float]], spec: Spec, robot: Robot, ref: RobotRef, cup: bool, on_step: Callable[[str], None]
) -> _Tried:
    """The spec at the front and floor from where most objects can be taken."""
    best = _Tried(spec, -1.0)
    for k, (front, floor) in enumerate(places, 1):
        on_step(f"fitting a cabinet: place {k} of {len(places)}" + (f", so far {100 * best.share:.0f} % in reach" if k > 1 else ""))
        tried = _share(replace(spec, cabinet_front_m=front, cabinet_floor_m=floor), robot, ref, boxes=cup)
        if tried.share > best.share:
            best = tried
        if best.share == 1.0:
            break
    return best if best.share >= 0.0 else _Tried(spec, 0.0)


def _positions(arm: Arm) -> Array:
    """Hand positions (N, 3) at random configurations, world."""
    return np.asarray(arm.seeds.T.reshape(3, 4, -1)[:, 3].T, float)


def _facing(arm: Arm) -> float:
    """The direction in which an arm works best, yaw in rad: where its hand is level and looks away from it most often; ahead, if that is
    about as good."""
    T = arm.seeds.T.reshape(3, 4, -1).astype(float)
    out, at = T[:, 2], T[:2, 3] - arm.robot.pivot(np.eye(4))[:, None]
    level = np.abs(out[2]) < 0.5
    looks, lies = np.arctan2(out[1], out[0])[level], np.arctan2(at[1], at[0])[level]

    def good(yaw: float) -> int:
        return int(((np.cos(looks - yaw) > np.cos(0.8)) & (np.cos(lies - yaw) > np.cos(1.0))).sum())

    yaws = np.arange(24) * np.pi / 12
    counts = np.array([good(float(yaw)) for yaw in yaws])
    return 0.0 if counts[0] >= 0.85 * counts.max() else float(yaws[int(np.argmax(counts))])


def _scale(spec: Spec, robot: Robot, reach: float) -> float:
    """How much smaller cabinet and objects are, to fit the arm and its gripper."""
    widest = 2 * max(spec.objects_half_width_m[1], spec.target_half_width_m[1])
    by_gripper = (robot.opening.max_m - 2 * SPARE_M) / widest if widest > 0 and not robot.opening.cup_m else 1.0
    return max(LEAST_SCALE, float(np.floor(100 * min(1.0, reach / USUAL_REACH_M, by_gripper + 0.02)) / 100))


def _scaled(spec: Spec, scale: float) -> Spec:
    """A spec with all lengths in it by so much."""

    def by(pair: tuple[float, float]) -> tuple[float, float]:
        return scale * pair[0], scale * pair[1]

    return spec if scale == 1.0 else replace(
        spec,
        cabinet_size_m=scale * spec.cabinet_size_m,
        cabinet_size_to_m=None if spec.cabinet_size_to_m is None else scale * spec.cabinet_size_to_m,
        objects_half_width_m=by(spec.objects_half_width_m),
        objects_height_m=by(spec.objects_height_m),
        objects_scale=by(spec.objects_scale),
        target_half_width_m=by(spec.target_half_width_m),
        target_depth_m=by(spec.target_depth_m),
    )  # fmt: skip


def _slimmed(spec: Spec, by: float) -> Spec:
    """A spec with objects as high, and so much less wide; those of a household are smaller as a whole."""

    def times(pair: tuple[float, float]) -> tuple[float, float]:
        return by * pair[0], by * pair[1]

    return spec if by == 1.0 else replace(
        spec,
        objects_half_width_m=times(spec.objects_half_width_m),
        objects_scale=times(spec.objects_scale),
        target_half_width_m=times(spec.target_half_width_m),
    )  # fmt: skip


def _not_held(spec: Spec, robot: Robot, ref: RobotRef, *, boxes: bool) -> str | None:
    """Why the hand alone can't hold the widest object that its fingers open for, level if it may, as the verdict says of most grasps; None
    when it can."""
    widest = max(spec.objects_half_width_m[1], spec.target_half_width_m[1])
    most = widest if boxes else min(widest, robot.opening.max_m / 2 - SPARE_M)
    roomy = replace(spec, cabinet_size_m=ROOMY * spec.cabinet_size_m, target_half_width_m=(most, most))
    scene = _with_one(roomy, ref, (0.5, 0.0), boxes=boxes)
    body, floor_z = scene.body("can"), float(scene.cabinet.T_world_cabinet[2, 3])
    x, y = body.T_world_body[:2, 3] - robot.pivot(ref.T_world_base)
    headings = headings_of(arm_at(robot, ref.T_world_base))
    level = [kind for kind in spec.moves_approaches if kind == "horizontal"]  # in a cabinet most others end at its ceiling
    said = Counter[str]()
    for grasp in grasps_on(body, robot, level or spec.moves_approaches, floor_z, float(np.arctan2(y, x)), headings=headings):
        wrong = judge_grasp(robot, scene, grasp)
        if wrong is None:
            return None
        said[wrong] += 1
    return next((words for words, _ in said.most_common(1)), "no grasp fits its shape and the gripper's opening")


def _promising(arm: Arm, spec: Spec, reach: float) -> list[tuple[float, float]]:
    """Fronts and floors, world, by how much of the cabinet the hand alone reaches, level and looking in; the best first."""
    depth, width, height = spec.cabinet_size_m
    base, (x, y) = arm.T_world_base[2, 3], arm.robot.pivot(arm.T_world_base)
    ahead, up = np.linspace(0.1, 1.1, STEPS) * reach, np.linspace(0.02, 1.0, STEPS) * reach
    home = arm.robot.arm_q(arm.robot.home)
    reached = np.zeros((STEPS, STEPS, len(LATERAL)), np.bool_)
    for i, k, j in product(range(STEPS), range(STEPS), range(len(LATERAL))):
        p = np.array([x + ahead[i], y + LATERAL[j] * width / 2, base + up[k]])
        yaw = spec.grasp_bearing_share * float(np.arctan2(p[1] - y, p[0] - x))
        out = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        R = np.stack([UP, np.cross(out, UP), out], -1)
        ways = [transform(R_hand, p) for R_hand in ((R, R @ HALF_TURN) if arm.few_joints else (R,))]
        reached[i, k, j] = any(len(inverse.solve(arm.backing, arm.T_frame_hand, arm.seeds, T, home, tries=TRIES)) for T in ways)
    places = []
    for front, floor in product(x + ahead, base + up[up < 0.9 * reach]):
        inside = (x + ahead > front + 0.25 * depth) & (x + ahead < front + 0.85 * depth)
        level = (base + up > floor + 0.1 * height) & (base + up < floor + 0.45 * height)
        seen = reached[inside][:, level]
        if seen.size:
            places.append((float(seen.mean()), -float(front), round(float(front), 3), round(float(floor), 3)))
    ordered, fixed = [place[2:] for place in sorted(places, reverse=True)], _fixed(arm)
    least = max([x, *(float(points[:, 0].max()) for points in fixed)]) + BEFORE_M
    before = [place for place in ordered if place[0] >= least]  # or else within a frame that is fixed to the base
    return before or list(islice((place for place in ordered if _is_beside(spec, place, fixed)), EXACTLY))


def _fixed(arm: Arm) -> list[Array]:
    """The vertices (V, 3), world, of each hull that is fixed to the base."""
    posed = arm.posed(float(arm.robot.home[arm.robot.gripper_joint]))
    poses = arm.T_world_base @ arm.robot.tree.poses(arm.robot.home)
    at = [poses[arm.robot.tree.index[hull.link]] for hull in arm.robot.hulls]
    return [apply(T, hull.vertices) for hull, T, frame in zip(arm.robot.hulls, at, posed.frame) if frame == 0]


def _is_beside(spec: Spec, place: tuple[float, float], fixed: Sequence[Array]) -> bool:
    """Whether a cabinet with its front and floor there keeps `BESIDE_M` from solids with such vertices."""
    (front, floor), size = place, spec.cabinet_size_m + 2 * spec.cabinet_wall_m
    middle = [front + spec.cabinet_size_m[0] / 2, 0.0, floor + spec.cabinet_size_m[2] / 2]
    others = [Body(f"fixed {i}", ConvexMesh((points,), "", 1.0), np.eye(4)) for i, points in enumerate(fixed)]
    return apart(Body("cabinet", Box(size), transform(p=middle)), others, BESIDE_M)


def _of_one_kind(spec: Spec, *, boxes: bool) -> Spec:
    """A spec with boxes alone, or cylinders alone, where it has any."""
    kinds = tuple(kind for kind in spec.objects_household if len(kind.size_m) == (3 if boxes else 2))
    return replace(spec, objects_box_share=float(boxes), objects_household=kinds or spec.objects_household)


def _share(spec: Spec, robot: Robot, ref: RobotRef, *, boxes: bool = False) -> _Tried:
    """From how many of 3 × 3 places in the empty cabinet an object can be taken. boxes: not a cylinder, but a box, turned in several ways,
    from three places."""
    cabinet = _with_one(spec, ref, (0.5, 0.0), boxes=boxes).cabinet
    home = next(iter(places_to_wait(arm_at(robot, ref.T_world_base), cabinet)), None)
    if home is None:
        return _Tried(spec, 0.0, None, "there is no place before it where the arm could wait")
    places = list(product((0.3, 0.5, 0.75), (0.0,) if boxes else (-0.3, 0.0, 0.3), BOX_YAWS if boxes else (0.0,)))
    good, said = 0, Counter[str]()
    for along, across, yaw in places:
        scene = _with_one(spec, ref, (along, across), yaw, boxes=boxes)
        motions = Motions(robot, replace(scene, approaches=spec.moves_approaches), settings=UNCONSTRAINED)
        state = State(robot.with_arm(home, robot.opening.value_at(robot.opening.max_m)), scene.poses())
        picks, why = motions.picks(state, "can")
        good += bool(picks)
        if not picks:
            said[str(why)] += 1
    return _Tried(spec, good / len(places), home, next((words for words, _ in said.most_common(1)), ""))


def _with_one(spec: Spec, ref: RobotRef, at: tuple[float, float], yaw: float = 0.0, *, boxes: bool) -> Scene:
    """A spec's cabinet with one object of usual size, `can`: a cylinder, or a box. at: where, in shares of its depth and width."""
    cabinet = Cabinet(spec.cabinet_size_m, transform(p=[spec.cabinet_front_m, 0.0, spec.cabinet_floor_m]), spec.cabinet_wall_m)
    depth, width, _ = cabinet.size_m
    radius, height = float(np.mean(spec.target_half_width_m)) or 0.025, float(np.mean(spec.objects_height_m)) or 0.12
    shape: Shape = Box(np.array([2 * radius, 2 * radius, height])) if boxes else Cylinder(radius, height)
    T = cabinet.T_world_cabinet @ transform(rotation_about(UP, yaw), [at[0] * depth, at[1] * width, height / 2])
    return Scene("fit", replace(ref, mount=False), cabinet, (Body("can", shape, T),), "can", None, spec.regions_n)
