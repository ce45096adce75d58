"""gen: scenes that are blocked, yet solvable.

A scene is a cabinet with a few upright boxes and cylinders of household size and one grasp x_g on the target. It is kept only when the
target can't be taken out as things stand, and can be once the others are gone; so every scene asks for rearrangement, and none for magic.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import MISSING, dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.collision.fcl_solids import apart
from kinematics.errors import did_you_mean
from kinematics.robots.limits import read_tables
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.antipodal import SPARE_M
from planning.grasping.cup_grasps import grasps_on
from planning.grasping.hand_poses import UP, lowest_of, set_back
from planning.motion.cell.arm import arm_at
from planning.motion.handling.object_grasps import headings_of
from planning.motion.pick_place import Motions
from planning.motion.settings import UNCONSTRAINED
from planning.plan import Blocked
from planning.verdict import judge_grasp

MOST_SAMPLES = 500
MOST = 500  # of anything in a spec: metres, objects, rows of regions
STAGE = 1  # this stage's word in the seeds of random generators
SPECS = ("paper", "paper-any", "shelf", "hard", "hard-any", "lab-s", "lab-l")


Judge = Callable[[Scene, Robot, np.random.Generator], str | None]


class NoScene(Exception):
    """A spec asks for what a robot can't do, or for what is never blocked."""


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of household object: its name, and its size (3,), along x, y and z, or of a cylinder (2,), radius and height, in metres."""

    name: str
    size_m: tuple[float, ...]

    def body(self, T_floor: Array, scale: float) -> Body:
        """One of its kind, upright, on the floor at T_floor (4, 4)."""
        size = scale * np.array(self.size_m)
        shape: Shape = Box(size) if len(size) == 3 else Cylinder(float(size[0]), float(size[1]))
        return Body(self.name, shape, T_floor @ transform(p=[0.0, 0.0, size[-1] / 2]))


@dataclass(frozen=True, eq=False)
class Spec:
    """What scenes look like; the fields of a spec file, section by section. Pairs are ranges, sampled evenly.

    cabinet_size_to_m: the largest size of a cabinet, where it is not always the same. target_depth_share: the target's depth in shares of
    the cabinet's, instead of metres. objects_household: kinds of objects, instead of boxes and cylinders of any size; objects_scale: how
    much larger or smaller each of them may be.
    """

    cabinet_size_m: Array
    cabinet_front_m: float
    cabinet_floor_m: float
    cabinet_wall_m: float
    objects_count: tuple[int, int]
    objects_gap_m: float
    grasp_bearing_share: float
    grasp_yaw_spread: float
    grasp_height_share: float
    moves_approaches: tuple[str, ...]
    regions_n: int
    objects_box_share: float = 0.0
    objects_half_width_m: tuple[float, float] = (0.0, 0.0)
    objects_height_m: tuple[float, float] = (0.0, 0.0)
    target_half_width_m: tuple[float, float] = (0.0, 0.0)
    target_depth_m: tuple[float, float] = (0.0, 0.0)
    cabinet_size_to_m: Array | None = None
    target_depth_share: tuple[float, float] | None = None
    objects_household: tuple[Kind, ...] = ()
    objects_scale: tuple[float, float] = (1.0, 1.0)


INSTEAD = {
    "objects_household": ("objects_box_share", "objects_half_width_m", "objects_height_m", "target_half_width_m"),
    "target_depth_share": ("target_depth_m",),
}
"""A field, and those that a spec has instead: either the one or all the others."""


def load_spec(which: str) -> Spec:
    """A spec that ships (`SPECS`), or a TOML file. Raises ValueError naming the file and the field."""
    if which in SPECS:
        table = tomllib.loads(resources.files("planning.scenes").joinpath("specs", f"{which}.toml").read_text(encoding="utf-8"))
    elif Path(which).is_file():
        table = read_tables(Path(which))
    else:
        raise ValueError(f"unknown spec {which!r}{did_you_mean(which, SPECS)}: the specs are {', '.join(SPECS)}; or give a TOML file")
    given = {f"{section}_{key}": value for section, entries in table.items() if isinstance(entries, dict) for key, value in entries.items()}
    known = {f.name for f in fields(Spec)}
    needed = [f.name for f in fields(Spec) if f.default is MISSING]
    needed += [name for other, names in INSTEAD.items() if other not in given for name in names]
    for name in [*(n for n in given if n not in known), *(n for n in needed if n not in given)]:
        what = "is missing" if name in known else "is no field of a spec"
        raise ValueError(f"{which}: {_field(name)} {what} (planning/scenes/specs/paper.toml and lab-s.toml show them all)")
    for other, names in INSTEAD.items():
        for name in names if other in given else ():
            if name in given:
                raise ValueError(f"{which}: {_field(name)} says what {_field(other)} says otherwise: leave one of them out")
    spec = Spec(**{name: _checked(which, name, value) for name, value in given.items()})
    largest = spec.cabinet_size_m if spec.cabinet_size_to_m is None else spec.cabinet_size_to_m
    for name, axis, how in (("objects_height_m", 2, "high"), ("target_depth_m", 0, "deep")):
        least = getattr(spec, name)[0]
        if least >= largest[axis]:
            raise ValueError(f"{which}: {_field(name)}: {least:g} m or more do not fit into a cabinet that is {largest[axis]:g} m {how}")
    return spec


def _field(name: str) -> str:
    """A field as spec files name it."""
    return name.replace("_", ".", 1)


def generate(
    spec: Spec,
    robot: Robot,
    ref: RobotRef,
    seed: int,
    index: int,
    *,
    stage: int = STAGE,
    judge: Judge | None = None,
    on_step: Callable[[str], None] = lambda _: None,
) -> Scene:
    """Scene number `index` of a seed: the same whatever came before it and on whichever worker.

    ref: how the scene file names the robot; its base stands where ref says. stage: whose word goes into the random generator, so that the
    scenes of another stage are others. judge: says what is wrong with a sample, None for a valid scene; by default, whether it is blocked
    and can be solved. on_step: told of each sample that is thrown away.
    Raises: NoScene when `MOST_SAMPLES` in a row are no valid scene: the spec asks for what this robot can't do.
    """
    rng, thrown = np.random.default_rng([seed, stage, index]), Counter[str]()
    for _ in range(MOST_SAMPLES):
        scene = _sample(spec, ref, robot, f"{seed}-{index:06d}", (seed, index), rng)
        if scene is None:
            thrown["too full"] += 1
            continue
        verdict = (judge or _judge)(scene, robot, rng) or judge_grasp(robot, scene)
        if verdict is None:
            return scene
        thrown[verdict if verdict in ("free", "unsolvable") else "with no good grasp"] += 1
        on_step(verdict)
    said = ", ".join(f"{n} {what}" for what, n in thrown.most_common())
    why = f"robot {robot.name} can't reach into this cabinet, level as x_g is, or nothing ever blocks the target"
    if ref.urdf is not None and ref.home is None:
        why += "; --fit puts the cabinet where it reaches"
    raise NoScene(f"no valid scene in {MOST_SAMPLES} samples ({said}): {why}")


def _judge(scene: Scene, robot: Robot, rng: np.random.Generator) -> str | None:
    """None for a valid scene, else what it is: "unsolvable" or "free". What motions are to keep does not decide which scenes there are."""
    scene = replace(scene, robot=replace(scene.robot, mount=False))
    alone = Scene(**{**vars(scene), "objects": (scene.body(scene.target_name),)})
    empty = Motions(robot, alone, settings=UNCONSTRAINED)
    picks, _ = empty.picks(empty.start(), scene.target_name, [scene.x_g])
    if not picks:
        return "unsolvable"
    cluttered = Motions(robot, scene, settings=UNCONSTRAINED)
    for _ in range(2):  # a search that fails once by chance is no proof
        if not isinstance(cluttered.retrieve_target(cluttered.start(), rng), Blocked):
            return "free"
    return "unsolvable" if isinstance(empty.retrieve_target(empty.start(), rng), Blocked) else None


def _sample(spec: Spec, ref: RobotRef, robot: Robot, name: str, seed: tuple[int, int], rng: np.random.Generator) -> Scene | None:
    """One scene as it comes, valid or not; None when the objects did not fit."""
    T_cabinet = transform(p=[spec.cabinet_front_m, 0.0, spec.cabinet_floor_m])
    size = spec.cabinet_size_m if spec.cabinet_size_to_m is None else rng.uniform(spec.cabinet_size_m, spec.cabinet_size_to_m)
    cabinet = Cabinet(size, T_cabinet, spec.cabinet_wall_m)
    count = int(rng.integers(spec.objects_count[0], spec.objects_count[1] + 1))
    bodies: list[Body] = []
    for i in range(count):
        for _ in range(100):
            body = _object(spec, cabinet, i, rng)
            if 2 * body.shape.half[2] < size[2] and apart(body, [*bodies, *cabinet.walls()[2:]], spec.objects_gap_m):
                bodies.append(body)
                break
        else:
            return None
    target = bodies[0]
    order = rng.permutation(count)  # the target has no fixed place in the list
    names = {bodies[i].name: _name(bodies[i].name.rsplit("_", 1)[0], rank, robot.tree.names) for rank, i in enumerate(order)}
    objects = tuple(Body(names[bodies[i].name], bodies[i].shape, bodies[i].T_world_body) for i in order)
    grasp = _grasp(spec, robot, ref, target, rng)
    if grasp is None:
        return None
    return Scene(name, ref, cabinet, objects, names[target.name], grasp, spec.regions_n, spec.moves_approaches, seed)


def _name(kind: str, number: int, links: Collection[str]) -> str:
    """An object's name that no link of the robot has: box_3."""
    name = f"{kind}_{number}"
    while name in links:
        name += "_object"
    return name


def _object(spec: Spec, cabinet: Cabinet, i: int, rng: np.random.Generator) -> Body:
    """An upright object somewhere on the floor; number 0 is the target, at a target's depth."""
    low, high = spec.target_half_width_m if i == 0 else spec.objects_half_width_m
    depth, width, _ = cabinet.size_m
    height = float(rng.uniform(*spec.objects_height_m))
    near, far = _target_depths(spec, depth) if i == 0 else (high, depth - low)
    x, y = rng.uniform(near, far), rng.uniform(-width / 2 + low, width / 2 - low)
    yaw = rng.uniform(-np.pi / 2, np.pi / 2)
    if spec.objects_household:
        kind = spec.objects_household[rng.integers(len(spec.objects_household))]
        floor = cabinet.T_world_cabinet @ transform(rotation_about(UP, yaw), [x, y, 0.0])
        body = kind.body(floor, float(rng.uniform(*spec.objects_scale)))
        return Body(f"{body.name}_{i}", body.shape, body.T_world_body)
    half = rng.uniform(low, high, 2)
    T = cabinet.T_world_cabinet @ transform(rotation_about(UP, yaw), [x, y, height / 2])
    if rng.random() < spec.objects_box_share:
        return Body(f"box_{i}", Box(np.array([2 * half[0], 2 * half[1], height])), T)
    return Body(f"can_{i}", Cylinder(float(half[0]), height), T)


def _target_depths(spec: Spec, depth_m: float) -> tuple[float, float]:
    """The range of the target's depth in a cabinet of some depth."""
    if spec.target_depth_share is None:
        return spec.target_depth_m
    return spec.target_depth_share[0] * depth_m, spec.target_depth_share[1] * depth_m


def _grasp(spec: Spec, robot: Robot, ref: RobotRef, target: Body, rng: np.random.Generator) -> Grasp | None:
    """x_g: horizontal, from the front, the camera above the hand; on a box, square to the faces that come nearest to the wanted yaw. At
    what is round an arm of few joints looks as it has to. Of a suction cup the most natural one; None where no face is wide enough."""
    opening, to_target = robot.opening, target.T_world_body[:2, 3] - robot.pivot(ref.T_world_base)
    if opening.cup_m:
        toward, floor_z = float(np.arctan2(to_target[1], to_target[0])), float(target.T_world_body[2, 3] - target.shape.half[2])
        return next(grasps_on(target, robot, APPROACHES, floor_z, toward, headings=headings_of(arm_at(robot, ref.T_world_base))), None)
    yaw = spec.grasp_bearing_share * np.arctan2(to_target[1], to_target[0]) + rng.uniform(-spec.grasp_yaw_spread, spec.grasp_yaw_spread)
    half = target.shape.half
    width = 2 * float(half[0])
    if isinstance(target.shape, Box):
        own = np.arctan2(target.T_world_body[1, 0], target.T_world_body[0, 0])
        quarter = round((yaw - own) / (np.pi / 2))
        if 2 * half[1 if quarter % 2 == 0 else 0] + SPARE_M > opening.max_m:  # too wide from here
            quarter += 1 if (yaw - own) / (np.pi / 2) > quarter else -1
        yaw, width = own + quarter * np.pi / 2, 2 * float(half[1 if quarter % 2 == 0 else 0])
    approach = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    reach = float(half[0]) if isinstance(target.shape, Cylinder) else float(half[0 if quarter % 2 == 0 else 1])
    z = max(spec.grasp_height_share * 2 * half[2], lowest_of(robot)("horizontal", 0.0))
    centre = target.T_world_body[:3, 3] + (z - half[2]) * UP
    if isinstance(target.shape, Box):
        centre = centre - set_back(reach, width, opening) * approach
    R = np.stack([UP, np.cross(approach, UP), approach], -1)
    headings = headings_of(arm_at(robot, ref.T_world_base))
    if headings is not None and isinstance(target.shape, Cylinder):
        R = next(iter(headings(transform(R, centre), width)), R)
    return Grasp(transform(R, opening.hand_position(centre, R, width)), width)


def _checked(where: str, name: str, value: Any) -> Any:
    """A spec's value in the type of its field. Raises ValueError."""
    label = f"{where}: {_field(name)}"
    if name == "objects_household":
        return _kinds(label, value)
    if name == "moves_approaches":
        if not value or not isinstance(value, list) or any(a not in APPROACHES for a in value):
            raise ValueError(f"{label}: {value!r} is no list of {', '.join(APPROACHES)}")
        return tuple(value)
    if name in ("cabinet_size_m", "cabinet_size_to_m"):
        if not isinstance(value, list) or len(value) != 3 or not all(_number(v) and v > 0 for v in value):
            raise ValueError(f"{label}: {value!r} is not three positive lengths")
        return np.array(value, float)
    kind = str(Spec.__annotations__[name])
    if kind.startswith("tuple"):
        if not isinstance(value, list) or len(value) != 2 or not all(_number(v) for v in value) or value[0] > value[1]:
            raise ValueError(f"{label}: {value!r} is no range [least, most]")
        if "int" in kind and any(v != int(v) or v < 1 for v in value):
            raise ValueError(f"{label}: {value!r} is no range of positive whole numbers")
        if value[0] <= 0:
            raise ValueError(f"{label}: {value!r} is no range of positive lengths")
        return tuple(value)
    if not _number(value) or (kind == "int" and (value != int(value) or value < 1)):
        raise ValueError(f"{label}: {value!r} is no {'positive whole ' if kind == 'int' else ''}number")
    if name == "cabinet_wall_m" and value <= 0:
        raise ValueError(f"{label}: {value!r} is not positive")
    if name in ("objects_gap_m", "grasp_yaw_spread") and value < 0:
        raise ValueError(f"{label}: {value!r} is below 0")
    return value


def _kinds(label: str, value: Any) -> tuple[Kind, ...]:
    """Kinds of household objects. Raises ValueError."""
    if not isinstance(value, dict) or not value:
        raise ValueError(f"{label}: {value!r} is no table of kinds, NAME = [x, y, z] or [radius, height]")
    for name, size in value.items():
        if not isinstance(size, list) or len(size) not in (2, 3) or not all(_number(v) and v > 0 for v in size):
            raise ValueError(f"{label}.{name}: {size!r} is neither the sides [x, y, z] of a box nor [radius, height] of a cylinder")
    return tuple(Kind(name, tuple(map(float, size))) for name, size in value.items())


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MOST  # not so for NaN
