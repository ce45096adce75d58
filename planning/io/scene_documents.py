"""Scenes to JSON documents and back: the field names of docs/formats.md, and every check that a scene must pass.

A scene that uses nothing of version 2 is written as version 1. Paths inside a file (meshes, URDFs) are relative to its folder; in memory
they are absolute.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from kinematics.errors import blame, did_you_mean
from kinematics.scene import APPROACHES, WALLS, Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape
from planning.io.checked import LARGEST_M, SMALLEST_M, Node
from planning.io.documents import expect, numbers, pose_to_json, relative, without_none
from planning.io.observation_documents import observation_from_node
from planning.io.settling import NOISE_M, Unsettled, settle

SCENE_1, SCENE_2 = "retrieve/scene@1", "retrieve/scene@2"
SOURCES = ("given", "seen")

MOST_LEAN_DEG = 15
"""By how much a cabinet may lean: objects are to stand on its floor without sliding, and upright for the hand."""
MOST_REGIONS, MOST_BODIES = 100, 500
"""Rows of the floor's grid; objects, and obstacles."""

LoadMesh = Callable[[str, float], ConvexMesh]
OnMesh = Callable[[str, float], None]
"""Told how much of taking a mesh apart is done: its path, and a share."""


def mesh_loader(folder: Path, on_mesh: OnMesh = lambda *_: None) -> LoadMesh:
    """Reads the meshes of one file, each once."""

    @cache
    def load(file: str, scale: float) -> ConvexMesh:
        from kinematics.meshes.load import load_mesh  # brings trimesh and scipy, which scenes without meshes do not need

        path = (folder / file).resolve()
        return load_mesh(path, scale, str(path), on_share=lambda share: on_mesh(str(path), share))

    return load


# Writing --------------------------------------------------------------------------------------------------------------------------------


def scene_to_json(scene: Scene, folder: Path | None = None) -> dict[str, Any]:
    """A scene as schema/scene.schema.json has it. Files inside `folder` (default: the current one) are written relative to it."""
    at = folder or Path.cwd()
    cabinet = scene.cabinet
    second = _second_version(scene, at)
    robot_2 = _robot_second_version(scene.robot)
    objects = [_body_to_json(b, at) for b in scene.objects]
    is_second = bool(second or robot_2 or not objects or any(map(_says_more, scene.objects)))
    document: dict[str, Any] = {
        "schema": SCENE_2 if is_second else SCENE_1,
        "id": scene.id,
        "seed": [int(s) for s in scene.seed] or None,
        "robot": {**_robot_to_json(scene.robot, at), **robot_2},
        "cabinet": {
            "size_m": numbers(cabinet.size_m),
            "T_world_cabinet": pose_to_json(cabinet.T_world_cabinet),
            "wall_m": float(cabinet.wall_m),
        },
        "regions": {"n": int(scene.regions_n)},
        "approaches": list(scene.approaches),
        "objects": objects,
        "target": scene.target,
        "grasp": None if scene.grasp is None else _grasp_to_json(scene.grasp),
        "observation": scene.observation,
    }
    return {**without_none(document), **second}


def _second_version(scene: Scene, folder: Path) -> dict[str, Any]:
    """The fields that only version 2 has, or that only there are null; none when the scene can be said in version 1."""
    fields: dict[str, Any] = {}
    if scene.obstacles:
        fields["obstacles"] = [_body_to_json(b, folder) for b in scene.obstacles]
    if scene.target is None or scene.target not in scene.poses():
        fields["target"] = scene.target
    if scene.target_box is not None:
        fields["target_box"] = numbers(scene.target_box)
    if scene.grasp is None:
        fields["grasp"] = None
    if scene.grasps:
        fields["grasps"] = [{**_grasp_to_json(grasp), "score": float(score)} for grasp, score in scene.grasps]
    return fields


def _robot_to_json(ref: RobotRef, folder: Path) -> dict[str, Any]:
    return without_none({
        "name": ref.name,
        "urdf": relative(ref.urdf, folder),
        "hand_frame": ref.hand_frame,
        "gripper_joint": ref.gripper_joint,
        "T_world_base": pose_to_json(ref.T_world_base),
    })  # fmt: skip


def _robot_second_version(ref: RobotRef) -> dict[str, Any]:
    return without_none({
        "q_start": None if ref.q_start is None else {name: float(q) for name, q in ref.q_start.items()},
        "home": None if ref.home is None else {name: float(q) for name, q in ref.home.items()},
        "T_link_hand": None if ref.T_link_hand is None else pose_to_json(ref.T_link_hand),
        "gripper_joints": list(ref.gripper_joints) or None,
        "mount": ref.mount,
        "payload_kg": ref.payload_kg,
    })  # fmt: skip


def _says_more(body: Body) -> bool:
    """Whether there is more to say of an object than the first version of scenes can."""
    return body.source != "given" or any(more is not None for more in (body.max_tilt_deg, body.sides_m, body.mass_kg))


def _body_to_json(body: Body, folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = {
        "name": body.name,
        "shape": _shape_to_json(body.shape, folder),
        "T_world_object": pose_to_json(body.T_world_body),
    }
    if body.max_tilt_deg is not None:
        document["max_tilt_deg"] = float(body.max_tilt_deg)
    if body.source != "given":
        document["source"] = body.source
    if body.sides_m is not None:
        document["sides_m"] = [float(height) for height in body.sides_m]
    if body.mass_kg is not None:
        document["mass_kg"] = float(body.mass_kg)
    return document


def _shape_to_json(shape: Shape, folder: Path) -> dict[str, Any]:
    match shape:
        case Box():
            return {"type": "box", "size_m": numbers(shape.size_m)}
        case Cylinder():
            return {"type": "cylinder", "radius_m": float(shape.radius_m), "height_m": float(shape.height_m)}
        case ConvexMesh():
            if not shape.file:
                raise ValueError("a mesh that was not read from a file can't be written into a scene")
            return {"type": "mesh", "file": relative(shape.file, folder), "scale": float(shape.scale)}


def _grasp_to_json(grasp: Grasp) -> dict[str, Any]:
    return {"T_world_hand": pose_to_json(grasp.T_world_hand), "width_m": float(grasp.width_m)}


# Reading --------------------------------------------------------------------------------------------------------------------------------


def scene_from_json(document: Any, where: str = "scene", folder: Path | None = None) -> Scene:
    """The inverse of `scene_to_json`, checked. Raises InputError that begins with `where`."""
    at = (folder or Path.cwd()).resolve()
    return scene_from_node(Node(document, where), at, mesh_loader(at))


def scene_from_node(node: Node, folder: Path, load: LoadMesh, noise_m: float = NOISE_M) -> Scene:
    """A scene of either version, checked, its objects settled (see `planning.io.settling`).

    load: reads meshes by their path in the file and their scale. noise_m: how much overlap is taken for noise of the objects' poses.
    Raises: InputError.
    """
    second = expect(node, "scene") >= 2
    of_first = () if second else ("target", "grasp")  # which version 2 may leave out, or say to be null
    f = _fields(
        node, second, ("schema", "id", "robot", "cabinet", "regions", "objects", *of_first), ("seed", "approaches", "observation"),
        ("target", "grasp", "obstacles", "grasps", "target_box"),
    )  # fmt: skip
    if empty := [name for name in ("objects", *of_first) if not second and f[name].value in (None, [])]:
        raise f[empty[0]].error(f'is empty, which came with version 2: write "schema": "{SCENE_2}"')
    objects = _bodies(f["objects"], load, second, WALLS, least=0)
    taken = (*WALLS, *(b.name for b in objects))
    obstacles = _bodies(f["obstacles"], load, second, taken, least=0, still=True) if "obstacles" in f else ()
    scene = Scene(
        id=f["id"].text(),
        robot=_robot(f["robot"], folder, second),
        cabinet=_cabinet(f["cabinet"]),
        objects=objects,
        target=_target(f["target"], objects, second) if "target" in f else None,
        grasp=_grasp(f["grasp"]) if "grasp" in f and not (second and f["grasp"].value is None) else None,
        regions_n=f["regions"].record(("n",))["n"].integer(least=1, most=MOST_REGIONS),
        approaches=tuple(a.text(APPROACHES) for a in f["approaches"].items(least=1)) if "approaches" in f else APPROACHES,
        seed=tuple(s.integer() for s in f["seed"].items()) if "seed" in f else (),
        observation=observation_from_node(f["observation"]) if "observation" in f else None,
        obstacles=obstacles,
        grasps=tuple(_ranked_grasp(g) for g in f["grasps"].items()) if "grasps" in f else (),
        target_box=_target_box(f["target_box"]) if "target_box" in f else None,
    )
    if scene.target is not None and scene.target_box is not None:
        raise f["target_box"].error("stands beside a target that is named; it is for a target of null")
    try:
        return settle(scene, noise_m)
    except Unsettled as e:
        at = next((i for i, body in enumerate(objects) if body.name == e.body), None)
        raise (f["cabinet"] if at is None else f["objects"].items()[at]).error(str(e)) from e


def _fields(node: Node, second: bool, required: Sequence[str], optional: Sequence[str], of_second: Sequence[str]) -> dict[str, Node]:
    """The fields of an object that has more of them in version 2."""
    later = [name for name in of_second if name not in required and isinstance(node.value, dict) and name in node.value]
    if later and not second:
        raise node.error(f'the field {later[0]!r} came with version 2: write "schema": "{SCENE_2}"')
    return node.record(required, (*optional, *of_second) if second else optional)


def _cabinet(node: Node) -> Cabinet:
    """A cabinet whose floor things can stand on; most others have quaternions in another order."""
    f = node.record(("size_m", "T_world_cabinet", "wall_m"))
    pose = f["T_world_cabinet"]
    cabinet = Cabinet(f["size_m"].vector(3, positive=True, lengths=True), pose.pose(), f["wall_m"].length())
    if cabinet.lean_deg > MOST_LEAN_DEG:
        raise pose.error(
            f"leans by {cabinet.lean_deg:.0f}° (its z points up, to {MOST_LEAN_DEG}°), and nothing stands on such a floor; is q_wxyz told "
            "in the order x, y, z, w?"
        )
    return cabinet


def _target(node: Node, objects: Sequence[Body], second: bool) -> str | None:
    """A target's name; in version 2 it may be unknown, or the name of what was not seen yet."""
    if second and node.value is None:
        return None
    target, names = node.text(), [b.name for b in objects]
    unseen = second and all(b.source == "seen" for b in objects)
    if target not in names and not unseen:
        raise node.error(f"{target!r} is not among the objects ({', '.join(names)}){did_you_mean(target, names)}")
    return target


def _target_box(node: Node) -> Any:
    box = node.vector(6, lengths=True)
    if (box[3:] <= 0).any():
        raise node.error("its size is not positive; a box is [cx, cy, cz, dx, dy, dz], centre and size in metres")
    return box


def _grasp(node: Node) -> Grasp:
    f = node.record(("T_world_hand", "width_m"))
    return Grasp(f["T_world_hand"].pose(), f["width_m"].number(least=0, most=LARGEST_M))


def _ranked_grasp(node: Node) -> tuple[Grasp, float]:
    f = node.record(("T_world_hand", "width_m", "score"))
    return Grasp(f["T_world_hand"].pose(), f["width_m"].number(least=0, most=LARGEST_M)), f["score"].number()


START_WORDS = ("q", "q0", "qpos", "start", "q_now", "q_current", "joints", "joint_positions", "configuration")
"""What others call the place where the arm is now."""


def _robot(node: Node, folder: Path, second: bool) -> RobotRef:
    if isinstance(node.value, dict) and (word := next((w for w in START_WORDS if w in node.value), None)) is not None:
        schema = "" if second else f' and "schema": "{SCENE_2}"'
        example = '"q_start": {"shoulder_pan_joint": 0.0, …}'
        raise node.error(f"unknown field {word!r}; where the arm is now is said by joint name, with {example}{schema}")
    f = _fields(
        node, second, ("T_world_base",), ("name", "urdf", "hand_frame", "gripper_joint"),
        ("q_start", "home", "T_link_hand", "gripper_joints", "mount", "payload_kg"),
    )  # fmt: skip
    if ("name" in f) == ("urdf" in f):
        raise node.error(
            "must say either 'name' (a named robot) or 'urdf' (a file), " + ("not both" if "name" in f else "and says neither")
        )
    name, urdf, hand, joint = (f[key].text() if key in f else None for key in ("name", "urdf", "hand_frame", "gripper_joint"))
    if urdf is not None and not (folder / urdf).is_file():
        raise f["urdf"].error(f"the file {folder / urdf} does not exist; the path is relative to the scene file")
    return RobotRef(
        f["T_world_base"].pose(),
        name,
        str((folder / urdf).resolve()) if urdf else None,
        hand,
        joint,
        q_start=_joint_values(f["q_start"]) if "q_start" in f else None,
        home=_joint_values(f["home"]) if "home" in f else None,
        T_link_hand=f["T_link_hand"].pose() if "T_link_hand" in f else None,
        gripper_joints=tuple(j.text() for j in f["gripper_joints"].items(least=1)) if "gripper_joints" in f else (),
        mount=f["mount"].flag() if "mount" in f else None,
        payload_kg=f["payload_kg"].number(least=0) if "payload_kg" in f else None,
    )


def _joint_values(node: Node) -> Mapping[str, float]:
    """Values by joint name; which joints there are is known when the robot is loaded."""
    if not isinstance(node.value, dict):
        raise node.error('values stand by joint name, in rad or m: {"shoulder_pan_joint": 0.0, …}')
    return {name: joint.number() for name, joint in node.record((), tuple(node.value)).items()}


def _bodies(node: Node, load: LoadMesh, second: bool, taken: Collection[str], *, least: int, still: bool = False) -> tuple[Body, ...]:
    """Objects, or obstacles (`still`). taken: names that stand for something else."""
    bodies: dict[str, Body] = {}
    for item in node.items(least=least, most=MOST_BODIES):
        more = () if still else ("max_tilt_deg", "source", "sides_m", "mass_kg")
        f = _fields(item, second, ("name", "shape", "T_world_object"), (), more)
        name = f["name"].text()
        if name in bodies:
            raise f["name"].error(f"{name!r} is the name of an {'obstacle' if still else 'object'} before it; each needs its own")
        if name in taken:
            what = "a wall of the cabinet" if name in WALLS else "an object"
            raise f["name"].error(f"{name!r} is {what}; choose another name")
        bodies[name] = Body(
            name,
            _shape(f["shape"], load),
            f["T_world_object"].pose(),
            f["max_tilt_deg"].number(least=0, most=180) if "max_tilt_deg" in f else None,
            "seen" if "source" in f and f["source"].text(SOURCES) == "seen" else "given",
            _heights(f["sides_m"]) if "sides_m" in f else None,
            f["mass_kg"].number(least=0) if "mass_kg" in f else None,
        )
    return tuple(bodies.values())


def _heights(node: Node) -> tuple[float, float]:
    """From a height to a larger one, m."""
    low, high = (float(v) for v in node.vector(2, lengths=True))
    if not 0 <= low < high:
        raise node.error(f"[{low:g}, {high:g}] is not from a height above the object's bottom to a larger one")
    return low, high


def _shape(node: Node, load: LoadMesh) -> Shape:
    fields = {"box": ("size_m",), "cylinder": ("radius_m", "height_m"), "mesh": ("file",)}
    kind = node.record(("type",), tuple(node.value) if isinstance(node.value, dict) else ())["type"].text(fields)
    f = node.record(("type", *fields[kind]), ("scale",) if kind == "mesh" else ())
    if kind == "box":
        return Box(f["size_m"].vector(3, positive=True, lengths=True))
    if kind == "cylinder":
        return Cylinder(f["radius_m"].length(), f["height_m"].length())
    file, scale = f["file"].text(), f["scale"].number(positive=True) if "scale" in f else 1.0
    with blame(f"{node.where}: {f['file'].path}"):
        mesh = load(file, scale)
    extent = 2 * mesh.half
    if extent.min() < SMALLEST_M or extent.max() > LARGEST_M:
        size = " × ".join(f"{x:.3g}" for x in extent)
        raise node.error(f"the mesh is {size} m large at scale {scale:g}, and {SMALLEST_M:g} to {LARGEST_M:g} m are allowed")
    return mesh
