"""Scenes from words stand as they say, and a wrong word is told; meshes stand upright; folders and observations become scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from documents import observed

from kinematics.collision.fcl_solids import apart
from kinematics.errors import InputError
from kinematics.scene import Body, Scene
from kinematics.shapes import ConvexMesh, bounds
from kinematics.transforms import rotation_about
from planning.io.scene_documents import mesh_loader, scene_from_json, scene_to_json
from planning.io.settling import settle
from planning.scenes import sources
from planning.scenes.right_way_up import AXES, turned_up, upright_axis
from planning.scenes.sources import NoRoom, from_observation, mesh_files, random_scene
from planning.scenes.words import Words, scene_from_words

TABLE = "table:box:0.8x1.2x0.04@-0.1,0,top=0"


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    """A bottle that stands along its y axis, and a block; in millimetres."""
    bottle = trimesh.creation.revolve(np.array([[0, 0], [30, 0], [30, 90], [10, 120], [10, 150], [0, 150]], float), sections=24)
    bottle.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    bottle.export(tmp_path / "bottle.stl")
    trimesh.creation.box((40, 60, 90)).export(tmp_path / "block.obj")
    return tmp_path


def made(*objects: str, folder: Path = Path(), said: Callable[[str], object] = lambda _: None, **words: object) -> Scene:
    return scene_from_words(Words(objects=objects, **words), mesh_loader(folder), lambda line: said(line) and None)  # type: ignore[arg-type]


def low(body: Body) -> float:
    return float(bounds(body.shape, body.T_world_body)[0][2])


def test_objects_stand_on_the_floor_where_they_are_said_to() -> None:
    scene = made("box:0.06x0.08x0.15@0.5,0.1,yaw=30", "can:0.03x0.12@0.4,-0.1,name=soup,tilt=20,mass=0.4", "box:0.02x0.02x0.02@0.7,0,0.3",
                 target="soup", obstacles=(TABLE,), at="0.3,0,0.25")  # fmt: skip
    box, can, up = scene.objects
    assert [b.name for b in scene.objects] == ["box", "soup", "box_2"]
    assert (low(box), low(can), low(up)) == pytest.approx((0.25, 0.25, 0.3))
    np.testing.assert_allclose(box.T_world_body[:3, :3], rotation_about((0, 0, 1), np.pi / 6), atol=1e-12)
    np.testing.assert_allclose(can.T_world_body[:3, 3], [0.4, -0.1, 0.31])
    assert (can.max_tilt_deg, can.mass_kg, box.mass_kg, scene.target) == (20.0, 0.4, None, "soup")
    (table,) = scene.obstacles
    assert (table.name, bounds(table.shape, table.T_world_body)[1][2]) == ("table", pytest.approx(0.0))
    again = scene_from_json(scene_to_json(replace(scene, objects=scene.objects[:2])))
    assert [b.name for b in again.objects] == ["box", "soup"]


def test_a_mesh_stands_up_and_says_so(meshes: Path) -> None:
    said: list[str] = []
    scene = made("bottle.stl@0.5,0,scale=0.001", folder=meshes, said=said.append)
    (bottle,) = scene.objects
    size = np.ptp(bounds(bottle.shape, bottle.T_world_body), axis=0)
    assert size == pytest.approx([0.06, 0.06, 0.15], abs=2e-3)
    assert low(bottle) == pytest.approx(0.1)
    assert len(said) == 1
    assert said[0].startswith("bottle: its y axis is taken to point up")
    lying = made("bottle.stl@0.5,0,scale=0.001,up=x", folder=meshes).objects[0]
    assert np.ptp(bounds(lying.shape, lying.T_world_body), axis=0)[2] == pytest.approx(0.06, abs=2e-3)
    assert settle(scene).target == "bottle"
    with pytest.raises(ValueError, match="is it in millimetres"):
        settle(made("bottle.stl@0.5,0", folder=meshes))


def test_an_obstacle_is_not_laid_down(tmp_path: Path) -> None:
    """A post or a door is fixed, and stands as its file has it, however slim it is."""
    trimesh.creation.box((0.02, 0.8, 0.5)).export(tmp_path / "door.stl")
    said: list[str] = []
    doors = ("door:door.stl@0.2,0.45,0.4", "lid:door.stl@0.2,-0.45,0.4,up=x")
    door, lid = made("box:0.06x0.06x0.16@0.5,0", folder=tmp_path, said=said.append, target="box", obstacles=doors).obstacles
    assert np.ptp(bounds(door.shape, door.T_world_body), axis=0) == pytest.approx([0.02, 0.8, 0.5], abs=1e-6)
    assert np.ptp(bounds(lid.shape, lid.T_world_body), axis=0)[2] == pytest.approx(0.02, abs=1e-6)
    assert said == ["door: its z axis is taken to point up (say up=-z or another axis to turn it)"]


def test_every_axis_can_be_turned_up() -> None:
    for axis in AXES.values():
        R = turned_up(np.array(axis, float))
        np.testing.assert_allclose(R @ np.array(axis, float), [0, 0, 1], atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
    cone = ConvexMesh((np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 6, 20)] + [[0, 0, 2.0]]),))
    for name, axis in AXES.items():
        turned = ConvexMesh((cone.parts[0] @ turned_up(np.array(axis, float)),))
        assert upright_axis(turned) == (name, True)


def test_what_stands_on_a_foot_is_not_turned_on_its_wider_rim() -> None:
    """A bowl, and a drill whose heavy end is over its battery but not the middle of its box; and a ball, which stands surely on no side."""
    ring = [(r * np.cos(a), r * np.sin(a), z) for r, z in ((0.025, 0.0), (0.06, 0.05)) for a in np.linspace(0, 6, 20)]
    battery, body, nose = (
        np.array([[x, y, z] for x in xs for y in (-0.03, 0.03) for z in zs])
        for xs, zs in (((-0.08, 0.02), (0.0, 0.1)), ((-0.08, 0.02), (0.1, 0.2)), ((0.02, 0.2), (0.18, 0.2)))
    )
    assert upright_axis(ConvexMesh((battery, body, nose))) == ("z", True)
    for axis in ("z", "y"):
        assert upright_axis(ConvexMesh((np.array(ring) @ turned_up(np.array(AXES[axis], float)),))) == (axis, True)
    lens = np.random.default_rng(0).normal(size=(200, 3))
    ball = ConvexMesh((lens / np.linalg.norm(lens, axis=1, keepdims=True),))
    assert not upright_axis(ball)[1]


WRONG = [
    ({"objects": ["box:0.06x0.08@0.5,0"]}, "--object box:0.06x0.08@0.5,0: box 0.06x0.08: 3 lengths in metres with x between them"),
    ({"objects": ["bxo:0.1x0.1x0.1@0.5,0"]}, "'bxo:0.1x0.1x0.1' is no shape: box:DXxDYxDZ, can:RADIUSxHEIGHT, or a mesh file"),
    ({"objects": ["box:0.1x0.1x0.1"]}, "say where it stands: box:0.1x0.1x0.1@x,y"),
    ({"objects": ["box:0.1x0.1x0.1@0.5"]}, "its place is x,y or x,y,z"),
    ({"objects": ["box:0.1x0.1x-1@0.5,0"]}, "-1 is not positive"),
    ({"objects": ["box:0.1x0.1x1e-5@0.5,0"]}, "1e-05 is below 0.0001 m"),
    ({"cabinet": "560x860x500"}, "--cabinet 560x860x500: 860 is beyond 100 m; are these millimetres?"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,a"]}, "'a' is no number"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,0,jaw=3"]}, "unknown key 'jaw' (did you mean 'yaw'?)"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,0,name=floor"]}, "the name 'floor' is taken"),
    ({"objects": ["mug.stl@0.5,0"]}, "--object mug.stl@0.5,0: mesh file"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,0", "can:0.03x0.1@0.7,0"]}, "--target is missing: say which object is wanted, e.g. box (the"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,0"], "target": "bx"}, "--target bx: is not among the objects (box) (did you mean 'box'?)"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,0"], "obstacles": ["box:1x1x1"]}, "an obstacle is NAME:SHAPE@x,y,z"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,0,mass=-1"]}, "mass=-1 is negative"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,0"], "obstacles": ["post:box:1x1x1@2,0,mass=1"]}, "mass is a key of objects; an obstacle stays"),
    ({"objects": ["box:0.1x0.1x0.1@0.5,0"], "obstacles": ["post:box:1x1x1@2,0,name=a"]}, "an obstacle's name comes first"),
    ({"cabinet": "0.5x0.5"}, "--cabinet 0.5x0.5: 3 lengths in metres"),
    ({"at": "0.3,0"}, "--at 0.3,0: a place is x,y,z[,yaw=degrees]"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "says"), WRONG, ids=[says[:40] for _, says in WRONG])
def test_a_wrong_word_is_told(words: dict[str, object], says: str) -> None:
    with pytest.raises(InputError) as caught:
        scene_from_words(Words(**words), mesh_loader(Path()))  # type: ignore[arg-type]
    assert says in str(caught.value)


def test_a_folder_of_meshes_at_random(meshes: Path) -> None:
    """The same scene for the same seed, its objects apart, within the cabinet and upright."""
    files, load = mesh_files(meshes), mesh_loader(meshes)
    scene = random_scene(Words(), files, 5, 0.001, load, 3, 1)
    assert scene.id == "3-000001"
    assert scene.target in {b.name for b in scene.objects}
    assert len({b.name for b in scene.objects}) == 5
    for i, body in enumerate(scene.objects):
        assert apart(body, [*scene.objects[:i], *scene.fixtures()[1:]], 0.0099)
        assert low(body) == pytest.approx(0.1, abs=1e-9)
    assert settle(scene) is scene
    again = random_scene(Words(), files, 5, 0.001, load, 3, 1)
    for a, b in zip(scene.objects, again.objects, strict=True):
        np.testing.assert_array_equal(a.T_world_body, b.T_world_body)
    with pytest.raises(NoRoom, match=r"meshes fit into the cabinet, and .* found no room in the last of 5 arrangements: ask for fewer"):
        random_scene(Words(cabinet="0.2x0.2x0.2"), files, 9, 0.001, load, 0, 0)


@pytest.mark.parametrize("failing", [1, 4, 5])
def test_what_finds_no_room_is_drawn_again_so_often(meshes: Path, monkeypatch: pytest.MonkeyPatch, failing: int) -> None:
    """Other meshes at other places; the scenes that fit at once are as they were."""
    files, load, drawn = mesh_files(meshes), mesh_loader(meshes), list[tuple[Path, ...]]()
    first, arranged = random_scene(Words(), files, 5, 0.001, load, 3, 1), sources._arranged

    def without_room(words: Words, empty: Scene, some: list[Path], *more: Any) -> tuple[list[Body], Path | None]:
        drawn.append(tuple(some))
        bodies, left = arranged(words, empty, some, *more)
        return (bodies[:-1], some[-1]) if len(drawn) <= failing else (bodies, left)

    monkeypatch.setattr(sources, "_arranged", without_room)
    if failing == sources.ARRANGEMENTS:
        with pytest.raises(NoRoom, match="4 of 5 meshes fit into the cabinet"):
            random_scene(Words(), files, 5, 0.001, load, 3, 1)
    else:
        scene = random_scene(Words(), files, 5, 0.001, load, 3, 1)
        assert len(scene.objects) == 5
        assert not np.array_equal(scene.objects[0].T_world_body, first.objects[0].T_world_body)
    assert len(drawn) == min(failing + 1, sources.ARRANGEMENTS)


def test_what_was_observed_becomes_a_scene() -> None:
    sensed = scene_from_json(observed())
    seen = from_observation(sensed)
    assert [(b.name, b.source) for b in seen.objects] == [("box_0", "seen")]
    np.testing.assert_allclose(seen.objects[0].T_world_body[:3, 3], [0.5, 0.0, 0.15])
    assert seen.target == "can_1"  # it was not seen yet
    assert scene_to_json(scene_from_json(scene_to_json(seen))) == scene_to_json(seen)
    with pytest.raises(ValueError, match="was not sensed"):
        from_observation(seen)
