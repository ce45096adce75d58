"""Scenes and plans to JSON documents and back: the field names of DESIGN's contract, and every check that a document must pass.

Lengths in metres, angles in radians, poses as {"p": [x, y, z], "q_wxyz": [w, x, y, z]}. Paths inside a file (meshes, URDFs) are relative to
its folder; in memory they are absolute. Numbers keep every digit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.fcl_solids import overlapping
from kinematics.errors import blame, did_you_mean
from kinematics.scene import APPROACHES, WALLS, Body, Cabinet, Grasp, Held, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, load_mesh
from kinematics.transforms import Array, wxyz_from_rotation
from planning.io.checked import Node
from planning.plan import STAGES, Blocked, Motion, Move, Plan

SCENE, PLAN = "retrieve/scene@1", "retrieve/plan@1"
RULES = ("deep", "region", "strict")
OVERLAP_TOLERANCE_M = 0.001
"""Solids that overlap by no more than this stand side by side."""

MOST_CELLS = 10**8

LoadMesh = Callable[[str, float], ConvexMesh]


def mesh_loader(folder: Path) -> LoadMesh:
    """Reads the meshes of one file, each once."""

    @cache
    def load(file: str, scale: float) -> ConvexMesh:
        path = (folder / file).resolve()
        return load_mesh(path, scale, str(path))

    return load


# Scenes -------------------------------------------------------------------------------------------------------------------------------


def scene_to_json(scene: Scene, folder: Path | None = None) -> dict[str, Any]:
    """A scene as schema/scene.schema.json has it. Files inside `folder` (default: the current one) are written relative to it."""
    at = folder or Path.cwd()
    robot: dict[str, Any] = {
        "name": scene.robot.name,
        "urdf": _relative(scene.robot.urdf, at),
        "hand_frame": scene.robot.hand_frame,
        "gripper_joint": scene.robot.gripper_joint,
        "T_world_base": _pose(scene.robot.T_world_base),
    }
    cabinet = scene.cabinet
    document: dict[str, Any] = {
        "schema": SCENE,
        "id": scene.id,
        "seed": [int(s) for s in scene.seed] or None,
        "robot": _without_none(robot),
        "cabinet": {
            "size_m": _numbers(cabinet.size_m),
            "T_world_cabinet": _pose(cabinet.T_world_cabinet),
            "wall_m": float(cabinet.wall_m),
        },
        "regions": {"n": int(scene.regions_n)},
        "approaches": list(scene.approaches),
        "objects": [{"name": b.name, "shape": _shape_to_json(b.shape, at), "T_world_object": _pose(b.T_world_body)} for b in scene.objects],
        "target": scene.target,
        "grasp": {"T_world_hand": _pose(scene.grasp.T_world_hand), "width_m": float(scene.grasp.width_m)},
        "observation": scene.observation,
    }
    return _without_none(document)


def scene_from_json(document: Any, where: str = "scene", folder: Path | None = None) -> Scene:
    """The inverse of `scene_to_json`, checked. Raises InputError that begins with `where`."""
    at = (folder or Path.cwd()).resolve()
    return scene_from_node(Node(document, where), at, mesh_loader(at))


def scene_from_node(node: Node, folder: Path, load: LoadMesh) -> Scene:
    _expect(node, "scene")
    f = node.record(("schema", "id", "robot", "cabinet", "regions", "objects", "target", "grasp"), ("seed", "approaches", "observation"))
    cabinet = f["cabinet"].record(("size_m", "T_world_cabinet", "wall_m"))
    grasp = f["grasp"].record(("T_world_hand", "width_m"))
    objects = _objects(f["objects"], load)
    target = f["target"].text()
    if target not in (names := [b.name for b in objects]):
        raise f["target"].error(f"{target!r} is not among the objects ({', '.join(names)}){did_you_mean(target, names)}")
    scene = Scene(
        id=f["id"].text(),
        robot=_robot(f["robot"], folder),
        cabinet=Cabinet(
            cabinet["size_m"].vector(3, positive=True), cabinet["T_world_cabinet"].pose(), cabinet["wall_m"].number(positive=True)
        ),
        objects=objects,
        target=target,
        grasp=Grasp(grasp["T_world_hand"].pose(), grasp["width_m"].number(least=0)),
        regions_n=f["regions"].record(("n",))["n"].integer(least=1),
        approaches=tuple(a.text(APPROACHES) for a in f["approaches"].items(least=1)) if "approaches" in f else APPROACHES,
        seed=tuple(s.integer() for s in f["seed"].items()) if "seed" in f else (),
        observation=_observation(f["observation"]) if "observation" in f else None,
    )
    _check_overlaps(scene, f["objects"])
    return scene


def _robot(node: Node, folder: Path) -> RobotRef:
    f = node.record(("T_world_base",), ("name", "urdf", "hand_frame", "gripper_joint"))
    if ("name" in f) == ("urdf" in f):
        raise node.error(
            "must say either 'name' (a named robot) or 'urdf' (a file), " + ("not both" if "name" in f else "and says neither")
        )
    name, urdf, hand, joint = (f[key].text() if key in f else None for key in ("name", "urdf", "hand_frame", "gripper_joint"))
    if urdf is not None and not (folder / urdf).is_file():
        raise f["urdf"].error(f"the file {folder / urdf} does not exist; the path is relative to the scene file")
    return RobotRef(f["T_world_base"].pose(), name, str((folder / urdf).resolve()) if urdf else None, hand, joint)


def _objects(node: Node, load: LoadMesh) -> tuple[Body, ...]:
    bodies: dict[str, Body] = {}
    for item in node.items(least=1):
        f = item.record(("name", "shape", "T_world_object"))
        name = f["name"].text()
        if name in bodies:
            raise f["name"].error(f"{name!r} is the name of an object before it; every object needs its own")
        if name in WALLS:
            raise f["name"].error(f"{name!r} is a wall of the cabinet; choose another name")
        bodies[name] = Body(name, _shape(f["shape"], load), f["T_world_object"].pose())
    return tuple(bodies.values())


def _shape(node: Node, load: LoadMesh) -> Shape:
    fields = {"box": ("size_m",), "cylinder": ("radius_m", "height_m"), "mesh": ("file",)}
    kind = node.record(("type",), tuple(node.value) if isinstance(node.value, dict) else ())["type"].text(fields)
    f = node.record(("type", *fields[kind]), ("scale",) if kind == "mesh" else ())
    if kind == "box":
        return Box(f["size_m"].vector(3, positive=True))
    if kind == "cylinder":
        return Cylinder(f["radius_m"].number(positive=True), f["height_m"].number(positive=True))
    file, scale = f["file"].text(), f["scale"].number(positive=True) if "scale" in f else 1.0
    with blame(f"{node.where}: {f['file'].path}"):
        return load(file, scale)


def _shape_to_json(shape: Shape, folder: Path) -> dict[str, Any]:
    match shape:
        case Box():
            return {"type": "box", "size_m": _numbers(shape.size_m)}
        case Cylinder():
            return {"type": "cylinder", "radius_m": float(shape.radius_m), "height_m": float(shape.height_m)}
        case ConvexMesh():
            if not shape.file:
                raise ValueError("a mesh that was not read from a file can't be written into a scene")
            return {"type": "mesh", "file": _relative(shape.file, folder), "scale": float(shape.scale)}


def _observation(node: Node) -> dict[str, Any]:
    """What a sensed scene carries: checked, and passed on as it is."""
    f = node.record(("objects", "regions", "views", "known"))
    for item in f["objects"].items():
        o = item.record(("name", "box"), extra=True)
        o["name"].text()
        o["box"].vector(6)
    for item in f["regions"].items():
        item.vector(4)
    for item in f["views"].items():
        v = item.record(("T_world_camera", "known"), ("unknown",), extra=True)
        if "unknown" in v:
            _unknown(v["unknown"])
        v["T_world_camera"].pose()
        v["known"].number(least=0, most=1)
    f["known"].number(least=0, most=1)
    return dict(node.value)


def _unknown(node: Node) -> None:
    """Raises InputError for boxes that are not of whole cells within the cabinet."""
    u = node.record(("cells", "boxes"))
    cells = u["cells"].vector(3)
    if (cells % 1 != 0).any() or (cells < 1).any() or np.prod(cells) > MOST_CELLS:
        raise u["cells"].error(f"three whole numbers from 1 on are needed, whose product is at most {MOST_CELLS}")
    for item in u["boxes"].items():
        box = item.vector(6)
        if (box % 1 != 0).any() or (box[:3] < 0).any() or (box[:3] >= box[3:]).any() or (box[3:] > cells).any():
            raise item.error("a box is six whole numbers, its first cell and the one after its last along x, y and z, within the cells")


def observation_to_json(
    boxes: Mapping[str, Array],
    regions: Array,
    views: Sequence[tuple[Array, float]],
    known: float,
    cells: tuple[int, ...],
    unknown: NDArray[np.int64],
) -> dict[str, Any]:
    """What a sensed scene carries: boxes by name (6,), regions (n², 4), each view's T_world_camera and the share known after it.

    cells (3,): into how many cells the cabinet's depth, width and height are divided; unknown (B, 6): boxes that fill what nobody has seen
    after the last view, which tells of them: their first cell and the one after their last, along each.
    """
    seen: list[dict[str, Any]] = [{"T_world_camera": _pose(T), "known": float(share)} for T, share in views]
    if seen:
        seen[-1]["unknown"] = {"cells": [int(n) for n in cells], "boxes": [[int(i) for i in row] for row in unknown]}
    return {
        "objects": [{"name": name, "box": _numbers(box)} for name, box in boxes.items()],
        "regions": [_numbers(row) for row in regions],
        "views": seen,
        "known": float(known),
    }


def _check_overlaps(scene: Scene, node: Node) -> None:
    """Raises InputError when two objects, or an object and a wall, overlap by more than the tolerance: the deepest is named."""
    for contact in overlapping((*scene.cabinet.walls(), *scene.objects), OVERLAP_TOLERANCE_M):
        a, b = sorted((contact.a, contact.b), key=lambda name: name in WALLS)
        if a in WALLS:  # walls meet each other at the edges
            continue
        i = next(i for i, body in enumerate(scene.objects) if body.name == a)
        what = f"the cabinet's wall {b!r}" if b in WALLS else repr(b)
        raise node.items()[i].error(f"{a!r} overlaps {what} by {1000 * contact.depth_m:.1f} mm; move one of them")


# Plans --------------------------------------------------------------------------------------------------------------------------------


def plan_to_json(plan: Plan) -> dict[str, Any]:
    """A plan as schema/plan.schema.json has it."""
    return {
        "schema": PLAN,
        "scene": plan.scene,
        "policy": plan.policy,
        "rule": plan.rule,
        "success": bool(plan.success),
        "reason": _blocked_to_json(plan.reason),
        "moves": [
            {
                "object": m.object,
                "region": int(m.region),
                "T_world_from": _pose(m.T_world_from),
                "T_world_to": _pose(m.T_world_to),
                "done": bool(m.done),
                "reason": _blocked_to_json(m.reason),
            }
            for m in plan.moves
        ],
        "motions": [
            {
                "stage": m.stage,
                "joint_names": list(m.joint_names),
                "q": [_numbers(row) for row in m.q],
                "t_s": _numbers(m.t_s),
                "held": None if m.held is None else {"body": m.held.body, "T_hand_body": _pose(m.held.T_hand_body)},
                "may_touch": [list(pair) for pair in m.allowed_contacts],
            }
            for m in plan.motions
        ],
        "planning_time_s": float(plan.planning_time_s),
        "motion_time_s": float(plan.motion_time_s),
        "hand_travel_m": float(plan.hand_travel_m),
        "return": float(plan.value),
        "verified": bool(plan.verified),
    }


def plan_from_json(document: Any, where: str = "plan") -> Plan:
    """The inverse of `plan_to_json`, checked. Raises InputError that begins with `where`."""
    return plan_from_node(Node(document, where))


def plan_from_node(node: Node) -> Plan:
    _expect(node, "plan")
    words = ("scene", "policy", "rule", "success", "reason", "moves", "motions")
    f = node.record((*words, "planning_time_s", "motion_time_s", "hand_travel_m", "return", "verified"), extra=True)
    return Plan(
        scene=f["scene"].text(),
        policy=f["policy"].text(),
        rule=f["rule"].text(RULES),
        success=f["success"].flag(),
        reason=_blocked(f["reason"]),
        moves=tuple(_move(m) for m in f["moves"].items()),
        motions=tuple(_motion(m) for m in f["motions"].items()),
        planning_time_s=f["planning_time_s"].number(least=0),
        motion_time_s=f["motion_time_s"].number(least=0),
        hand_travel_m=f["hand_travel_m"].number(least=0),
        value=f["return"].number(),
        verified=f["verified"].flag(),
    )


def _move(node: Node) -> Move:
    f = node.record(("object", "region", "T_world_from", "T_world_to", "done", "reason"), extra=True)
    poses = (f["T_world_from"].pose(), f["T_world_to"].pose())
    return Move(f["object"].text(), f["region"].integer(least=0), *poses, f["done"].flag(), _blocked(f["reason"]))


def _motion(node: Node) -> Motion:
    f = node.record(("stage", "joint_names", "q", "t_s", "held", "may_touch"), extra=True)
    names = tuple(name.text() for name in f["joint_names"].items(least=1))
    q = f["q"].matrix(len(names))
    t_s = f["t_s"].vector(len(q))
    if (t_s[1:] < t_s[:-1]).any() or t_s[0] < 0:
        raise f["t_s"].error("runs backwards; times start at 0 or later and never decrease")
    held = None
    if f["held"].value is not None:
        h = f["held"].record(("body", "T_hand_body"), extra=True)
        held = Held(h["body"].text(), h["T_hand_body"].pose())
    pairs = []
    for pair in f["may_touch"].items():
        if len(two := [name.text() for name in pair.items(least=2)]) > 2:
            raise pair.error(f"holds {len(two)} names, and 2 are needed")
        pairs.append((two[0], two[1]))
    return Motion(f["stage"].text(STAGES), names, q, t_s, held, tuple(pairs))


def _blocked(node: Node) -> Blocked | None:
    if node.value is None:
        return None
    if isinstance(node.value, str):
        return Blocked(node.text())
    f = node.record(("stage",), ("link", "body", "depth_m", "detail"), extra=True)
    words = {key: f[key].text() for key in ("link", "body", "detail") if key in f and f[key].value is not None}
    depth = f["depth_m"].number() if "depth_m" in f and f["depth_m"].value is not None else None
    return Blocked(f["stage"].text(), words.get("link"), words.get("body"), depth, words.get("detail"))


def _blocked_to_json(why: Blocked | None) -> dict[str, Any] | None:
    if why is None:
        return None
    depth = None if why.depth_m is None else float(why.depth_m)
    return _without_none({"stage": why.stage, "link": why.link, "body": why.body, "depth_m": depth, "detail": why.detail})


# What both have in common ---------------------------------------------------------------------------------------------------------------


def kind_and_version(node: Node) -> tuple[str, int]:
    """What a document says it is: ("scene", 1)."""
    if not isinstance(node.value, dict) or "schema" not in node.value:
        node.record(("schema",), tuple(node.value) if isinstance(node.value, dict) else ())
    schema = node.at("schema")
    found = re.fullmatch(r"retrieve/(scene|plan)@(\d+)", schema.text())
    if found is None:
        raise schema.error(f"{schema.value!r} is unknown; this program reads {SCENE} and {PLAN}")
    return found[1], int(found[2])


def _expect(node: Node, kind: str) -> None:
    """Raises InputError when the document is of another kind or version."""
    found, version = kind_and_version(node)
    schema = node.at("schema")
    if found != kind:
        advice = {"plan": "plans go to `retrieve report` and `retrieve show`", "scene": "scenes go to `retrieve plan` and `retrieve show`"}
        raise schema.error(f"this is a {found}, and a {kind} is expected; {advice[found]}")
    if version != 1:
        advice_v = "too new: update the program" if version > 1 else "too old: write the file again"
        raise schema.error(f"{schema.value!r} is {advice_v}; this program reads {SCENE if kind == 'scene' else PLAN}")


def _pose(T_a_b: Array) -> dict[str, list[float]]:
    return {"p": _numbers(T_a_b[:3, 3]), "q_wxyz": _numbers(wxyz_from_rotation(T_a_b[:3, :3]))}


def _numbers(values: Array) -> list[float]:
    return [float(v) for v in values]


def _without_none(fields: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in fields.items() if value is not None}


def _relative(file: str | None, folder: Path) -> str | None:
    """A path as a file in `folder` should say it: relative when it lies inside."""
    if file is None:
        return None
    path, at = Path(file).resolve(), folder.resolve()
    return path.relative_to(at).as_posix() if path.is_relative_to(at) else str(path)
