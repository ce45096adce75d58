"""Names of links, walls and objects live in one space in a plan's `may_touch`: they are kept apart, or refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Handmade

from kinematics.robots.load import forget, load, to_ref
from kinematics.robots.names import check_names
from kinematics.robots.robot import Robot
from kinematics.scene import WALLS, Body, Cabinet, Grasp, RobotRef, Scene
from kinematics.shapes import Box
from kinematics.transforms import transform
from planning.io.scene_documents import scene_from_json
from planning.motion.checking.verify import verify
from planning.motion.pick_place import Motions
from planning.scenes.generation import generate, load_spec


def with_name(scene: Scene, old: str, new: str) -> Scene:
    """The scene with another name for one of its objects."""
    objects = tuple(replace(b, name=new) if b.name == old else b for b in scene.objects)
    return replace(scene, objects=objects, target=new if scene.target == old else scene.target)


@pytest.fixture
def toy_scene() -> Scene:
    box = Body("box_0", Box(np.array([0.05, 0.05, 0.1])), transform(p=[0.5, 0, 0.05]))
    cabinet = Cabinet(np.array([0.4, 0.6, 0.5]), transform(p=[0.3, 0, 0]), 0.03)
    return Scene("toy", RobotRef(np.eye(4), urdf="toy.urdf"), cabinet, (box,), "box_0", Grasp(np.eye(4), 0.05))


def test_every_link_is_refused_as_an_objects_name(ur5e: Robot, handmade: Handmade) -> None:
    """Also those without geometry, and those at the hand, which a held object would be mixed up with."""
    scene = scene_from_json(handmade.scene)
    for link in ur5e.tree.names:
        for old in ("can", "box"):
            other = with_name(scene, old, link)
            for asked in (lambda s: Motions(ur5e, s), lambda s: verify(ur5e, s, [])):
                with pytest.raises(ValueError, match=f"object '{link}' has the name of a link of the robot ur5e; call the object"):
                    asked(other)


def test_names_of_bodies_are_apart(ur5e: Robot, toy_scene: Scene) -> None:
    twins = replace(toy_scene, objects=toy_scene.objects * 2)
    with pytest.raises(ValueError, match="object 'box_0' has the name of another object"):
        check_names(ur5e, twins)
    for wall in WALLS:
        with pytest.raises(ValueError, match=f"object '{wall}' has the name of a wall"):
            check_names(ur5e, with_name(toy_scene, "box_0", wall))
    post = Body("post", Box(np.ones(3)), np.eye(4))
    check_names(ur5e, toy_scene, [post, post])  # what was not seen consists of many boxes of one name
    for name, other in (("box_0", "an obstacle"), ("left", "a wall"), ("forearm_link", "a link of the robot ur5e")):
        with pytest.raises(ValueError, match=f"{name!r} has the name of {other}"):
            check_names(ur5e, toy_scene, [post, replace(post, name=name)])


def test_links_called_like_walls_get_other_names(toy_urdf: Callable[..., Path]) -> None:
    """A URDF can't be told to rename its links, so the robot does it: in its tree, its hulls, its URDF and what an SRDF says of them."""
    plain = load(str(toy_urdf()), "tcp")
    file = toy_urdf(("left_finger", "left"), ('"post"', '"floor"'), ('"sled"', '"floor_link"'))
    file.with_suffix(".srdf").write_text('<robot name="toy"><disable_collisions link1="base" link2="left"/></robot>')
    forget()
    robot = load(str(file), "tcp")
    assert not {*robot.tree.names, *(h.link for h in robot.hulls), *robot.fingers, *robot.pads} & set(WALLS)
    assert {"left_link", "floor_link", "floor_link_link"} < set(robot.tree.names)
    assert frozenset(("base", "left_link")) in robot.skip
    assert 'name="left"' not in robot.urdf
    q = np.array([0.3, 0.1, 0.2, 0.01])
    old = {"left_finger": "left_link", "post": "floor_link_link", "sled": "floor_link"}
    for link, T in plain.link_poses(q).items():
        np.testing.assert_array_equal(robot.link_poses(q)[old.get(link, link)], T)


def test_generated_names_avoid_the_links(ur5e: Robot) -> None:
    """A robot that has links called like generated objects gets scenes all the same, and they differ in nothing but the names."""
    ref, spec = to_ref(ur5e), load_spec("paper")
    usual = generate(spec, ur5e, ref, 3, 0)
    clash = usual.objects[0].name
    old = next(h.link for h in ur5e.hulls if h.link in ur5e.fingers - ur5e.pads)
    tree = replace(ur5e.tree, names=tuple(clash if n == old else n for n in ur5e.tree.names))
    hulls = tuple(replace(h, link=clash) if h.link == old else h for h in ur5e.hulls)
    skip = frozenset(frozenset(clash if n == old else n for n in pair) for pair in ur5e.skip)
    fingers = frozenset(clash if n == old else n for n in ur5e.fingers)
    urdf = ur5e.urdf.replace(f'"{old}"', f'"{clash}"')
    renamed = generate(spec, replace(ur5e, urdf=urdf, tree=tree, hulls=hulls, skip=skip, fingers=fingers), ref, 3, 0)
    assert [b.name for b in renamed.objects] == [f"{clash}_object", *(b.name for b in usual.objects[1:])]
    for a, b in zip(usual.objects, renamed.objects):
        np.testing.assert_array_equal(a.T_world_body, b.T_world_body)
