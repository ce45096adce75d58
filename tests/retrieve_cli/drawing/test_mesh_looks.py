"""Meshes are drawn as they are, and as the parts that stand for them on demand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from kinematics.meshes.decomposition import Decomposition
from kinematics.meshes.load import load_mesh
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh
from kinematics.transforms import transform
from retrieve_cli.drawing.meshes import look_of
from retrieve_cli.drawing.page import _objects
from retrieve_cli.drawing.picture import Film

CUP = np.array([[0, 0], [0.04, 0], [0.04, 0.09], [0.034, 0.09], [0.034, 0.008], [0, 0.008]])


def test_a_cup_is_one_solid_or_one_for_each_part(ur5e: Robot, tmp_path: Path) -> None:
    trimesh.creation.revolve(CUP, sections=8).export(tmp_path / "cup.stl")
    cup = load_mesh(tmp_path / "cup.stl", how=Decomposition(parts=6, cells=6, offsets=2))
    body = Body("cup", cup, transform(p=[0.5, 0, 0.1]))
    scene = Scene(
        "s", RobotRef(np.eye(4), "ur5e"), Cabinet(np.array([0.5, 0.8, 0.5]), transform(p=[0.3, 0, 0.1]), 0.03), (body,), None, None
    )
    paths = [[c["path"] for c in _objects(Film(ur5e, scene, None, shown)) if c["type"] == "set_object"] for shown in (False, True)]
    assert paths == [["/objects/cup"], [f"/objects/cup/part {k}" for k in range(len(cup.parts))]]
    assert Film(ur5e, scene).outline(cup) == []
    assert len(Film(ur5e, scene, None, True).outline(cup)) > 10


def test_what_has_no_file_is_drawn_as_its_parts() -> None:
    box, gone = Box(np.ones(3)), ConvexMesh((np.eye(3),), "nowhere.stl")
    assert look_of(box) is box
    assert look_of(gone) is gone
