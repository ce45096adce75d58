"""`retrieve scene`: a scene file from words, from a YAML of the same words, from a folder of meshes, or from what was observed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.errors import InputError, blame, did_you_mean
from kinematics.git_lfs import refuse_pointer
from planning.io.results import scene_writer
from retrieve_cli.terminal import announce_first_run, mesh_progress, say, say_of_base, say_what_was_read

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot
    from kinematics.scene import Scene
    from planning.scenes.words import Words

YAML_KEYS = (
    "id", "cabinet", "at", "wall_m", "objects", "obstacles", "target", "robot", "hand_frame", "gripper_joint", "base", "q_start",
    "approaches", "payload_kg",
)  # fmt: skip
LISTS = {"objects": "- can:0.03x0.12@0.6,0", "obstacles": "- table:box:1.6x1.2x0.04@-0.5,0,top=0", "approaches": "- horizontal"}
"""Words that are lists of texts, each with an example."""
NUMBERS = ("wall_m", "payload_kg")
MOST_RAD = 1000.0  # no joint is further from 0


def run(
    *,
    source: Path | None,
    words: dict[str, Any],
    n: int,
    count: int,
    scale: float,
    seed: int,
    grasp: bool,
    png: Path | None,
    out: Path | None,
) -> None:
    """Write the scene, or the n scenes of a folder of meshes; say what was made, and draw the first one where `png` says.

    source: a YAML file, a folder of meshes or a file of observed scenes; words: the options, which come before what the YAML says.
    grasp: propose x_g for the target. count, scale, seed: for a folder of meshes.
    """
    if png is not None and png.suffix.lower() != ".png":
        raise InputError(f"scene: {png}: a still is a PNG file; give it a name that ends in .png")
    announce_first_run()
    first: Scene | None = None
    with scene_writer(out) as write:
        for where, scene in _scenes(source, words, n, count, scale, seed):
            with blame(where):
                done = _with_grasp(where, scene) if grasp and scene.grasp is None and scene.target is not None else scene
            _describe(where, done)
            _tell_start(where, done)
            write(done)
            first = first or done
    if png is not None and first is not None:
        from retrieve_cli.show import draw_png

        draw_png(first, png)


def _scenes(source: Path | None, words: dict[str, Any], n: int, count: int, scale: float, seed: int) -> Iterator[tuple[str, Scene]]:
    """Where each scene comes from, and the scene. Raises InputError."""
    from planning.io.files import read_scenes
    from planning.io.scene_documents import mesh_loader
    from planning.scenes.sources import NoRoom, from_observation, mesh_files, random_scene
    from planning.scenes.words import scene_from_words

    if source is not None and source.is_dir():
        with blame(f"scene: {source}"):
            made, load, files = _words(words, "scene"), mesh_loader(Path.cwd(), mesh_progress), mesh_files(source)
            failed = 0
            for index in range(n):
                try:
                    scene = random_scene(made, files, count, scale, load, seed, index, say)
                except NoRoom as e:
                    failed += 1
                    if failed == n:  # none of them could be made
                        raise
                    say(f"scene {index} was not made: {e}")
                else:
                    yield f"scene {index}", scene
    elif source is not None and source.suffix.lower() in (".yaml", ".yml"):
        made = replace(_words({**_read_yaml(source), **words}, str(source)), where=lambda word: _from_yaml(source, word, words))
        yield str(source), _settled(scene_from_words(made, mesh_loader(source.resolve().parent, mesh_progress), say), str(source))
    elif source is not None:
        for where, scene in read_scenes(source, "scene"):
            with blame(where):
                yield where, from_observation(scene)
    else:
        if not words.get("objects"):
            raise InputError("scene: name at least one object: --object can:0.03x0.12@0.6,0; or give a YAML file, or a folder of meshes")
        yield "scene", _settled(scene_from_words(_words(words, "scene"), mesh_loader(Path.cwd(), mesh_progress), say), "scene")


def _from_yaml(file: Path, word: str, options: dict[str, Any]) -> str:
    """Where a word is from: the file, unless an option says it instead."""
    key = f"{word}s" if word in ("object", "obstacle") else word
    return f"--{word}" if key in options else f"{file}: {word}"


def _words(said: dict[str, Any], where: str) -> Words:
    """The words with the robot that they name, standing at its usual place unless they say where. Raises InputError."""
    from kinematics.robots.load import to_ref
    from kinematics.robots.start import start_q
    from planning.scenes.words import Words

    robot = _load(said, where)
    plain = {
        key: said[key] for key in ("id", "cabinet", "at", "wall_m", "objects", "obstacles", "target", "base", "approaches") if key in said
    }
    ref = to_ref(robot, said.get("hand_frame"))
    if "payload_kg" in said:
        ref = replace(ref, payload_kg=float(said["payload_kg"]))
    if "q_start" in said:
        ref = replace(ref, q_start=_joint_values(said["q_start"], where))
        with blame(where):
            start_q(robot, ref)
    return Words(**plain, robot=ref)


def _joint_values(text: str, where: str) -> dict[str, float]:
    """What JOINT=Q,JOINT=Q says. Raises InputError."""
    values = dict[str, float]()
    for word in text.split(","):
        name, equals, number = word.partition("=")
        try:
            values[name.strip()] = float(number)
        except ValueError:
            equals = ""
        if not equals or not abs(values[name.strip()]) < MOST_RAD:
            raise InputError(f"{where}: --q-start: {word.strip()!r} is no joint's value; write JOINT=1.57,JOINT=0")
    return values


def _load(said: dict[str, Any], where: str) -> Robot:
    from kinematics.robots.load import load

    with blame(where):
        return load(said.get("robot") or "ur5e", said.get("hand_frame"), said.get("gripper_joint"), on_step=say)


def _settled(scene: Scene, where: str) -> Scene:
    """The scene with its objects standing free. Raises InputError for an invalid one."""
    from planning.io.settling import settle

    with blame(where):
        done = settle(scene)
    say_what_was_read(where, done)
    return done


def _with_grasp(where: str, scene: Scene) -> Scene:
    """The scene with x_g proposed; without it, which is said, where no grasp can be used."""
    from kinematics.robots.load import from_ref
    from planning.target_grasps.allowed import lies_flat
    from planning.target_grasps.proposals import propose, with_grasps
    from retrieve_cli.grasp import tell

    robot = from_ref(scene.robot, on_step=say)
    found = propose(robot, scene)
    if not found.grasps:
        least, most = 1000 * robot.opening.width_m[0], 1000 * robot.opening.max_m
        apart = f"two of its sides have to face each other, {least:.0f} to {most:.0f} mm apart; turn it"
        sides = lies_flat(robot, scene) or apart
        why = "an obstacle, a wall or the distance keeps the arm from it" if found.beyond_reach else f"{sides} (up=…, yaw=…)"
        say(
            f"{where}: no grasp of {scene.target} can be used ({found}), and the scene is written without one: {why}; "
            "retrieve grasp --from FILE takes grasps from elsewhere"
        )
        return scene
    tell(where, scene, found)
    return with_grasps(scene, found)


def _tell_start(where: str, scene: Scene) -> None:
    """Say it when no plan can begin where the scene's robot is, and what stands through its base."""
    if scene.robot.q_start is None and not scene.obstacles:
        return
    from kinematics.robots.load import from_ref
    from planning.motion.pick_place import Motions

    with blame(where):
        robot = from_ref(scene.robot, on_step=say)
        say_of_base(robot, scene)
        blocked = None if scene.robot.q_start is None else Motions(robot, scene, target_grasps=()).start_blocked()
    if blocked is not None:
        say(f"{where}: no plan can begin where the arm is: {blocked.in_words()}; --q-start says where it is, in rad (or m)")


def _describe(where: str, scene: Scene) -> None:
    """What was made, a line a body, on stderr."""
    import numpy as np

    from kinematics.scene import object_box
    from kinematics.transforms import inverse

    size = " × ".join(f"{v:g}" for v in scene.cabinet.size_m)
    say(f"{where}: {scene.id!r}, a cabinet of {size} m, robot {scene.robot.name or scene.robot.urdf}, target {scene.target}")
    for kind, bodies in (("object", scene.objects), ("obstacle", scene.obstacles)):
        for body in bodies:
            box = object_box(body)
            low = (inverse(scene.cabinet.T_world_cabinet) @ np.append(box[:3], 1.0))[2] - box[5] / 2
            middle, sides = ", ".join(f"{v:.3f}" for v in box[:3]), " × ".join(f"{1000 * v:.0f}" for v in box[3:])
            stands = " on the floor" if kind == "object" and abs(low) < 1e-3 else ""
            say(f"  {kind} {body.name}: {sides} mm, middle at {middle}{stands}")


def _read_yaml(file: Path) -> dict[str, Any]:
    """What a YAML file of words says. Raises InputError."""
    import yaml

    try:
        refuse_pointer(file, "YAML")
        said = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as e:
        raise InputError(f"{file}: {(e.strerror or str(e)).lower()}") from e
    except (yaml.YAMLError, UnicodeDecodeError) as e:
        raise InputError(f"{file}: is no YAML: {' '.join(str(e).split())}") from e
    except ValueError as e:
        raise InputError(str(e)) from e
    if not isinstance(said, dict):
        raise InputError(f"{file}: words like `objects:` and `target:` are expected (retrieve schema words)")
    for key, value in said.items():
        if key not in YAML_KEYS:
            raise InputError(f"{file}: unknown word {key!r}{did_you_mean(str(key), YAML_KEYS)}; the words are {', '.join(YAML_KEYS)}")
        if key in LISTS and not (isinstance(value, list) and all(isinstance(v, str) for v in value)):
            raise InputError(f"{file}: {key}: a list of texts is expected, a line each: {LISTS[key]}")
        if key in NUMBERS and (isinstance(value, bool) or not isinstance(value, int | float) or value <= 0):
            raise InputError(f"{file}: {key}: {value!r} is no positive {'length' if key == 'wall_m' else 'number'}")
        if key not in (*LISTS, *NUMBERS) and not isinstance(value, str):
            raise InputError(f"{file}: {key}: {value!r} is no text; {_as_text(key, value)}")
    return said


def _as_text(key: str, value: Any) -> str:
    """How a word of a YAML is written as text, where it is a list, a mapping, or a number."""
    match value:
        case dict():
            return f"write {key}: {','.join(f'{k}={v}' for k, v in value.items())}"
        case list():
            return f"write {key}: {('x' if key == 'cabinet' else ',').join(map(str, value))}"
        case _:
            return "write it in quotes"


def given(**options: Any) -> dict[str, Any]:
    """The options that were given."""
    return {key: value for key, value in options.items() if value not in (None, [], ())}
