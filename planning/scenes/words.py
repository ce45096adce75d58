"""A scene from words: "can:0.03x0.12@0.4,-0.1,yaw=30" stands on the floor, without a quaternion anywhere.

    SHAPE@x,y[,z][,key=value…]      box:DXxDYxDZ   can:RADIUSxHEIGHT (or cylinder:)   FILE.stl

Lengths are metres in the world, angles degrees. z is the height of the bottom, by default the cabinet's floor. Keys are name, yaw, scale,
up (the axis of a mesh's frame that points up: z, -y, …), tilt (how far it may lean while it is carried), mass (in kg) and, for an
obstacle, top: the height of its top. An obstacle is NAME:SHAPE@….
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from kinematics.errors import InputError, blame, did_you_mean
from kinematics.names import free_name
from kinematics.scene import APPROACHES, WALLS, Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, bounds
from kinematics.transforms import Array, rotation_about, transform
from planning.io.checked import LARGEST_M, SMALLEST_M
from planning.io.scene_documents import LoadMesh
from planning.scenes.right_way_up import AXES, turned_up, upright_axis

MESHES = (".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".dae", ".3mf")
KEYS = ("name", "yaw", "scale", "up", "tilt", "mass", "top", "z")
UP = (0.0, 0.0, 1.0)
Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Words:
    """A scene in words. at: the cabinet's front edge, x,y,z[,yaw=degrees]; base: where the robot stands, the same way. where: how messages
    say where a word is from: "object", "obstacle", "cabinet", "at", "base" or "target"."""

    cabinet: str = "0.56x0.86x0.5"
    at: str = "0.3,0,0.1"
    wall_m: float = 0.03
    objects: Sequence[str] = ()
    obstacles: Sequence[str] = ()
    target: str | None = None
    id: str = "scene"
    robot: RobotRef = field(default_factory=lambda: RobotRef(np.eye(4), "ur5e"))
    base: str | None = None
    approaches: Sequence[str] = APPROACHES
    where: Callable[[str], str] = "--{}".format


def scene_from_words(words: Words, load: LoadMesh, say: Say = lambda _: None) -> Scene:
    """The scene, without a grasp yet. load: reads meshes; say: told what was guessed. Raises: InputError that names the word."""
    where = words.where
    size = np.array(_lengths(words.cabinet, 3, where("cabinet")))
    T_cabinet = parse_place(words.at, where("at"))
    cabinet = Cabinet(size, T_cabinet, words.wall_m)
    robot = words.robot if words.base is None else replace(words.robot, T_world_base=parse_place(words.base, where("base")))
    objects: list[Body] = []
    for word in words.objects:
        taken = {*WALLS, *(b.name for b in objects)}
        objects.append(parse_object(word, f"{where('object')} {word}", cabinet, load, say, taken))
    names = [b.name for b in objects]
    obstacles: list[Body] = []
    for word in words.obstacles:
        taken = {*WALLS, *names, *(b.name for b in obstacles)}
        obstacles.append(parse_obstacle(word, f"{where('obstacle')} {word}", load, say, taken))
    return Scene(
        words.id, robot, cabinet, tuple(objects), _target(words.target, names, where("target")), None, approaches=tuple(words.approaches),
        obstacles=tuple(obstacles),
    )  # fmt: skip


def parse_object(word: str, where: str, cabinet: Cabinet, load: LoadMesh, say: Say, taken: Collection[str]) -> Body:
    """An object from its words, standing on the cabinet's floor unless they say z. taken: names that others have."""
    shape_word, _, place = word.partition("@")
    if not place:
        raise InputError(f"{where}: say where it stands: {shape_word}@x,y in metres, in the world")
    numbers, keys = _place_words(place, where)
    if not 2 <= len(numbers) <= 3 or "top" in keys:
        raise InputError(f"{where}: its place is x,y or x,y,z, and z is the height of its bottom")
    shape, kind = _shape(shape_word, keys, load, where)
    floor = cabinet.T_world_cabinet[2, 3]
    low = numbers[2] if len(numbers) == 3 else _number(keys["z"], f"{where}: z") if "z" in keys else floor
    tilt = _number(keys["tilt"], f"{where}: tilt") if "tilt" in keys else None
    mass = _number(keys["mass"], f"{where}: mass") if "mass" in keys else None
    if mass is not None and mass < 0:
        raise InputError(f"{where}: mass={mass:g} is negative")
    name = _name(keys.get("name"), kind, taken, where)
    return replace(_standing(name, shape, (numbers[0], numbers[1], low), keys, where, say), max_tilt_deg=tilt, mass_kg=mass)


def parse_obstacle(word: str, where: str, load: LoadMesh, say: Say, taken: Collection[str]) -> Body:
    """An obstacle from its words, NAME:SHAPE@x,y,z or NAME:SHAPE@x,y,top=HEIGHT; its bottom is at height 0 where neither is said."""
    name, _, rest = word.partition(":")
    shape_word, _, place = rest.partition("@")
    if not rest or not place:
        raise InputError(f"{where}: an obstacle is NAME:SHAPE@x,y,z, e.g. table:box:0.8x1.2x0.04@-0.1,0,top=0")
    numbers, keys = _place_words(place, where)
    if not 2 <= len(numbers) <= 3:
        raise InputError(f"{where}: its place is x,y or x,y,z, and z is the height of its bottom")
    if wrong := next((key for key in ("name", "tilt", "mass") if key in keys), None):
        raise InputError(
            f"{where}: {wrong} is a key of objects; " + ("an obstacle's name comes first" if wrong == "name" else "an obstacle stays")
        )
    shape, _ = _shape(shape_word, keys, load, where)
    low = numbers[2] if len(numbers) == 3 else _number(keys["z"], f"{where}: z") if "z" in keys else 0.0
    body = _standing(_name(name, name, taken, where), shape, (numbers[0], numbers[1], low), keys, where, say, fixed=True)
    if "top" in keys:
        shift = _number(keys["top"], f"{where}: top") - bounds(body.shape, body.T_world_body)[1][2]
        body = replace(body, T_world_body=transform(p=[0.0, 0.0, shift]) @ body.T_world_body)
    return body


def parse_place(word: str, where: str) -> Array:
    """The pose (4, 4) of x,y,z[,yaw=degrees]. Raises InputError."""
    numbers, keys = _place_words(word, f"{where} {word}")
    if len(numbers) != 3 or set(keys) - {"yaw"}:
        raise InputError(f"{where} {word}: a place is x,y,z[,yaw=degrees], metres in the world")
    yaw = np.radians(_number(keys.get("yaw", "0"), f"{where}: yaw"))
    return transform(rotation_about(UP, float(yaw)), numbers)


def _standing(
    name: str, shape: Shape, place: tuple[float, float, float], keys: Mapping[str, str], where: str, say: Say, *, fixed: bool = False
) -> Body:
    """A body with the middle of its box over x, y and its bottom at z. fixed: it is held by more than its weight, as a post or a door is,
    and stands as its file has it."""
    R = rotation_about(UP, float(np.radians(_number(keys.get("yaw", "0"), f"{where}: yaw"))))
    if isinstance(shape, ConvexMesh) or "up" in keys:
        axis, stands = keys.get("up", "z"), True
        if isinstance(shape, ConvexMesh) and "up" not in keys and not fixed:
            axis, stands = upright_axis(shape)
        if axis not in AXES:
            raise InputError(f"{where}: up={axis}: the axes are {', '.join(AXES)}")
        if "up" not in keys:
            falls = "" if stands else "; it does not stand surely on any side: level the mesh in its file"
            say(f"{name}: its {axis} axis is taken to point up (say up={'-' if axis == 'z' else ''}z or another axis to turn it){falls}")
        R = R @ turned_up(np.array(AXES[axis], float))
    low, high = bounds(shape, transform(R))
    middle = (low + high) / 2
    return Body(name, shape, transform(R, [place[0] - middle[0], place[1] - middle[1], place[2] - low[2]]))


def _shape(word: str, keys: Mapping[str, str], load: LoadMesh, where: str) -> tuple[Shape, str]:
    """A shape and the name that a body of it gets."""
    kind, _, sizes = word.partition(":")
    if kind == "box":
        return Box(np.array(_lengths(sizes, 3, f"{where}: box"))), "box"
    if kind in ("can", "cylinder"):
        radius, height = _lengths(sizes, 2, f"{where}: {kind}")
        return Cylinder(radius, height), "can"
    if not word.lower().endswith(MESHES):
        near = did_you_mean(kind, ("box", "can", "cylinder"))
        raise InputError(f"{where}: {word!r} is no shape: box:DXxDYxDZ, can:RADIUSxHEIGHT, or a mesh file ({', '.join(MESHES)}){near}")
    scale = _number(keys.get("scale", "1"), f"{where}: scale")
    if scale <= 0:
        raise InputError(f"{where}: scale={scale:g} is not positive")
    with blame(where):
        return load(word, scale), Path(word).stem


def _place_words(text: str, where: str) -> tuple[list[float], dict[str, str]]:
    """The numbers at the beginning, and what is said by keys after them."""
    numbers, keys = list[float](), dict[str, str]()
    for part in text.split(","):
        key, equals, value = part.partition("=")
        if equals:
            if key not in KEYS:
                raise InputError(f"{where}: unknown key {key!r}{did_you_mean(key, KEYS)}; the keys are {', '.join(KEYS)}")
            keys[key] = value
        elif keys:
            raise InputError(f"{where}: {part!r} stands after a key; numbers come first")
        else:
            numbers.append(_number(part, where))
    return numbers, keys


def _lengths(text: str, n: int, where: str) -> list[float]:
    """n lengths with x between them, in the bounds of what a scene file may say."""
    parts = text.split("x")
    if len(parts) != n:
        raise InputError(f"{where} {text}: {n} lengths in metres with x between them are needed, e.g. {'x'.join(['0.1'] * n)}")
    lengths = [_number(part, f"{where} {text}") for part in parts]
    if min(lengths) <= 0:
        raise InputError(f"{where} {text}: {min(lengths):g} is not positive")
    if max(lengths) > LARGEST_M:
        raise InputError(f"{where} {text}: {max(lengths):g} is beyond {LARGEST_M:g} m; are these millimetres?")
    if min(lengths) < SMALLEST_M:
        raise InputError(f"{where} {text}: {min(lengths):g} is below {SMALLEST_M:g} m")
    return lengths


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError as e:
        raise InputError(f"{where}: {text!r} is no number") from e
    if not np.isfinite(value):
        raise InputError(f"{where}: {text} is not finite")
    return value


def _name(asked: str | None, kind: str, taken: Collection[str], where: str) -> str:
    """The name that was asked for, or the kind's with a number when it is taken."""
    if asked is not None:
        if not asked or asked in taken:
            raise InputError(f"{where}: the name {asked!r} is {'taken' if asked else 'empty'}; choose another")
        return asked
    return free_name(kind, taken, 2)


def _target(asked: str | None, names: Sequence[str], where: str) -> str | None:
    if asked is not None and asked not in names:
        raise InputError(f"{where} {asked}: is not among the objects ({', '.join(names) or 'there are none'}){did_you_mean(asked, names)}")
    if asked is None and len(names) == 1:
        return names[0]
    if asked is None and names:
        raise InputError(f"{where} is missing: say which object is wanted, e.g. {names[0]} (the objects: {', '.join(names)})")
    return asked
