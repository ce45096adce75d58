"""What a sensed scene knows, as lines to draw: the observed boxes, the views as small pyramids, the regions that nobody has seen.

Everything comes from the scene's `observation`, the truth is drawn beside it; so a box that misses its object can be seen to do so.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kinematics.scene import Scene
from kinematics.shapes import Box
from kinematics.transforms import Array, apply, rotation_from_wxyz, transform
from retrieve_cli.picture import Colour, Film, outline

VIEW_COLOUR: Colour = (0.25, 0.36, 0.58)
UNSEEN_COLOUR: Colour = (0.62, 0.30, 0.40)
STRANGER_COLOUR: Colour = (0.30, 0.34, 0.40)
"""Of an observed box that bears no object's name."""
PYRAMID_M = 0.05
SPREAD = (0.69, 0.40)
"""Tangents of half a RealSense's angles of view."""


def observed_boxes(film: Film) -> dict[str, tuple[Colour, list[Array]]]:
    """By name: the colour, and the edges (N, 3) of each observed box in the world; nothing for a scene that was not sensed."""
    out = {}
    for entry in _entries(film.scene, "objects"):
        box = np.asarray(entry["box"], float)
        r, g, b = film.colours.get(entry["name"], STRANGER_COLOUR)
        out[str(entry["name"])] = ((0.75 * r, 0.75 * g, 0.75 * b), [line + box[:3] for line in outline(Box(box[3:]))])
    return out


def view_pyramids(scene: Scene) -> list[list[Array]]:
    """For each view its edges (N, 3): from the camera to the corners of a small picture, and round it, with a tick that says what is up."""
    x, y = PYRAMID_M * SPREAD[0], PYRAMID_M * SPREAD[1]
    corners = np.array([[-x, -y, PYRAMID_M], [x, -y, PYRAMID_M], [x, y, PYRAMID_M], [-x, y, PYRAMID_M], [-x, -y, PYRAMID_M]])
    tick = np.array([[-0.3 * x, -1.1 * y, PYRAMID_M], [0, -1.6 * y, PYRAMID_M], [0.3 * x, -1.1 * y, PYRAMID_M]])
    edges = [corners, tick, *(np.array([[0, 0, 0], c]) for c in corners[:4])]
    return [[apply(T, edge) for edge in edges] for T in view_poses(scene)]


def view_poses(scene: Scene) -> list[Array]:
    """T_world_camera (4, 4) of each view, in order."""
    return [_pose(entry["T_world_camera"]) for entry in _entries(scene, "views")]


def unseen_regions(scene: Scene) -> list[Array]:
    """A cross (2, 3) + (2, 3) on the floor in every region whose flag says that it was not observed."""
    rows = np.array(_entries(scene, "regions"), float).reshape(-1, 4)
    cell = 0.3 * np.asarray(scene.cabinet.size_m[:2]) / max(round(np.sqrt(len(rows))), 1)
    R = scene.cabinet.T_world_cabinet[:3, :3]
    strokes = [np.array([[-sx, -sy, 0.0015], [sx, sy, 0.0015]]) @ R.T for sx, sy in ((cell[0], cell[1]), (cell[0], -cell[1]))]
    return [row[:3] + stroke for row in rows if row[3] < 0.5 for stroke in strokes]


def told(scene: Scene) -> str:
    """What was seen, in words: "96 % of the cabinet known after 5 views"; empty for a scene that was not sensed."""
    if scene.observation is None:
        return ""
    views = len(_entries(scene, "views"))
    return f"{100 * float(_known(scene)):.0f} % of the cabinet known after {views} view{'s' if views != 1 else ''}"


def _known(scene: Scene) -> Any:
    return scene.observation["known"] if scene.observation else 0.0


def _entries(scene: Scene, field: str) -> list[Any]:
    entries = scene.observation[field] if scene.observation else []
    assert isinstance(entries, list)
    return entries


def _pose(pose: Mapping[str, Any]) -> Array:
    return transform(rotation_from_wxyz(pose["q_wxyz"]), pose["p"])
