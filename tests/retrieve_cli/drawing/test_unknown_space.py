"""What `retrieve show` draws of a sensed scene: boxes, views, unseen regions; and nothing for a scene that was not sensed."""

from __future__ import annotations

import base64
import re
from dataclasses import replace

import documents
import numpy as np
import pytest
import umsgpack

from kinematics.robots.load import from_ref
from kinematics.scene import Scene
from kinematics.transforms import apply, inverse, transform, wxyz_from_rotation
from perception.camera import look_at
from planning.io.scene_documents import scene_from_json
from retrieve_cli.drawing.page import page
from retrieve_cli.drawing.picture import Film
from retrieve_cli.drawing.still import items, seen_lines
from retrieve_cli.drawing.unknown_space import (
    INSET_M,
    UNKNOWN_ALPHA,
    observed_boxes,
    told,
    unknown_space,
    unseen_regions,
    view_poses,
    view_pyramids,
)

EYE = look_at(np.array([0.1, 0.2, 0.5]), np.array([0.6, 0.0, 0.2]))


@pytest.fixture(scope="module")
def sensed() -> Scene:
    """Two boxes, one of a stranger; one view; every third region unseen."""
    scene = scene_from_json(documents.observed())
    views = [{"T_world_camera": {"p": EYE[:3, 3].tolist(), "q_wxyz": wxyz_from_rotation(EYE[:3, :3]).tolist()}, "known": 0.4}]
    boxes = [{"name": scene.target, "box": [0.5, 0.1, 0.2, 0.04, 0.06, 0.2]}, {"name": "object_7", "box": [0.6, 0, 0.2, 0.1, 0.1, 0.2]}]
    regions = [[*map(float, p), float(i % 3 != 0)] for i, p in enumerate(scene.regions())]
    return replace(scene, observation={"objects": boxes, "regions": regions, "views": views, "known": 0.4})


def seen_paths(html: str) -> set[str]:
    """What the page's commands draw below /seen."""
    commands = [umsgpack.unpackb(base64.b64decode(c)) for c in re.findall(r'^"([A-Za-z0-9+/=]+)",?$', html, re.MULTILINE)]
    assert commands
    return {c["path"] for c in commands if c.get("path", "").startswith("/seen")}


def test_a_box_is_drawn_where_it_was_observed(sensed: Scene) -> None:
    boxes = observed_boxes(Film(from_ref(sensed.robot), sensed))
    assert list(boxes) == [sensed.target, "object_7"]
    points = np.concatenate(boxes[sensed.target][1])
    assert points.min(0) == pytest.approx([0.48, 0.07, 0.1])
    assert points.max(0) == pytest.approx([0.52, 0.13, 0.3])
    assert boxes[sensed.target][0] != boxes["object_7"][0]


def test_a_view_is_a_pyramid_that_opens_to_where_it_looks(sensed: Scene) -> None:
    (T,) = view_poses(sensed)
    assert np.allclose(T, EYE)
    (edges,) = view_pyramids(sensed)
    own = apply(inverse(EYE), np.concatenate(edges))
    assert (own[:, 2] >= -1e-9).all()
    assert own[:, 2].max() == pytest.approx(0.05)
    assert np.linalg.norm(own, axis=1).min() < 1e-9
    assert own[:, 1].min() < -own[:, 1].max()  # the tick is above, which is -y


def test_unseen_regions_are_crossed_out_within_their_cells(sensed: Scene) -> None:
    strokes = unseen_regions(sensed)
    unknown_space = sensed.regions()[::3]
    assert len(strokes) == 2 * len(unknown_space)
    half = np.asarray(sensed.cabinet.size_m[:2]) / sensed.regions_n / 2
    for i, centre in enumerate(unknown_space):
        for stroke in strokes[2 * i : 2 * i + 2]:
            assert np.allclose(stroke.mean(0)[:2], centre[:2])
            assert (np.abs(stroke[:, :2] - centre[:2]) < half).all()


def test_they_turn_with_the_cabinet(sensed: Scene) -> None:
    T = transform(p=[0.1, 0.2, 0.0]) @ np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    turned = replace(sensed, cabinet=replace(sensed.cabinet, T_world_cabinet=T @ sensed.cabinet.T_world_cabinet))
    centres = turned.regions()
    regions = [[*map(float, p), float(i % 3 != 0)] for i, p in enumerate(centres)]
    turned = replace(turned, observation={**sensed.observation, "regions": regions})
    for a, b in zip(unseen_regions(sensed), unseen_regions(turned)):
        assert np.allclose(apply(T, a), b)


def test_the_page_and_the_still_hold_them(sensed: Scene) -> None:
    film = Film(from_ref(sensed.robot), sensed)
    html = page(film)
    assert seen_paths(html) == {f"/seen/boxes/{sensed.target}", "/seen/boxes/object_7", "/seen/views/0", "/seen/unseen regions"}
    assert "40 % of the cabinet known after 1 view<" in html
    assert len(seen_lines(film)) == 2 * 6 + 6 + len(unseen_regions(sensed))


def test_a_scene_that_was_not_sensed_has_none() -> None:
    scene = scene_from_json(documents.scene())
    film = Film(from_ref(scene.robot), scene)
    assert seen_lines(film) == []
    assert told(scene) == ""
    assert seen_paths(page(film)) == set()


def test_unknown_space_is_a_closed_surface_around_the_cells(sensed: Scene) -> None:
    """Its volume by the divergence theorem is the cells', which also says that every face looks outwards."""
    boxes = [[0, 0, 0, 2, 3, 4], [5, 5, 5, 7, 6, 6], [1, 1, 3, 4, 2, 6]]
    last = {**sensed.observation["views"][-1], "unknown": {"cells": [10, 12, 8], "boxes": boxes}}
    scene = replace(sensed, observation={**sensed.observation, "views": [last]})
    which = np.zeros((10, 12, 8), bool)
    for x0, y0, z0, x1, y1, z1 in boxes:
        which[x0:x1, y0:y1, z0:z1] = True
    mesh = unknown_space(scene)
    assert mesh is not None
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6
    cell = np.prod((np.asarray(scene.cabinet.size_m) - 2 * INSET_M) / which.shape)
    assert volume == pytest.approx(which.sum() * cell)
    local = apply(inverse(scene.cabinet.T_world_cabinet), mesh.vertices)
    assert (local > np.array([0, -scene.cabinet.size_m[1] / 2, 0])).all()
    assert (local < np.array([1, 0.5, 1]) * scene.cabinet.size_m).all()
    film = Film(from_ref(scene.robot), scene)
    assert "/seen/unknown" in seen_paths(page(film))
    assert sum(item.alpha == UNKNOWN_ALPHA for item in items(film, film.state_at(0.0))) == 1
    assert unknown_space(sensed) is None
