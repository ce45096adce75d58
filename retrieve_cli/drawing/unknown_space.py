"""What a sensed scene knows, as lines to draw: the observed boxes, the views as small pyramids, the regions that nobody has seen.

Everything comes from the scene's `observation`, the truth is drawn beside it; so a box that misses its object can be seen to do so.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Scene
from kinematics.shapes import Box
from kinematics.transforms import Array, apply, rotation_from_wxyz, transform
from perception.rendering.colours import Colour
from perception.rendering.surfaces import Mesh
from retrieve_cli.drawing.outlines import outline
from retrieve_cli.drawing.picture import Film

VIEW_COLOUR: Colour = (0.25, 0.36, 0.58)
UNSEEN_COLOUR: Colour = (0.62, 0.30, 0.40)
STRANGER_COLOUR: Colour = (0.30, 0.34, 0.40)
"""Of an observed box that bears no object's name."""
UNKNOWN_ALPHA = 0.28
INSET_M = 0.002  # keeps what lies at a wall off it, so that the two don't flicker
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


def unknown_space(scene: Scene) -> Mesh | None:
    """The surface of the space that nobody has seen, in the world; None when there is none, or nobody has written it down.

    Faces between two unknown cells are left out, and those side by side are one: so it can be drawn see-through.
    """
    views = scene.observation["views"] if scene.observation else None
    unknown = views[-1].get("unknown") if isinstance(views, list) and views else None
    if not isinstance(unknown, Mapping) or not unknown["boxes"]:
        return None
    cells = np.array(unknown["cells"])
    which = np.zeros(cells, bool)
    for x0, y0, z0, x1, y1, z1 in unknown["boxes"]:
        which[x0:x1, y0:y1, z0:z1] = True
    corners = np.concatenate([_faces(which, axis, side) for axis in range(3) for side in (0, 1)])
    size = np.asarray(scene.cabinet.size_m)
    points = corners.reshape(-1, 3) / cells * (size - 2 * INSET_M) + INSET_M - np.array([0.0, size[1] / 2, 0.0])
    first = 4 * np.arange(len(corners))[:, None]
    triangles = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    return Mesh(apply(scene.cabinet.T_world_cabinet, points), triangles)


def _faces(which: NDArray[np.bool_], axis: int, side: int) -> Array:
    """The faces (F, 4, 3) on one side of the cells marked in `which` (X, Y, Z), in cells, counter-clockwise from outside.

    Those in a row are one; it is the beginnings and the ends of rows that are looked for.
    """
    turned = np.moveaxis(which, axis, 0)
    beside = np.zeros_like(turned)
    if side:
        beside[:-1] = turned[1:]
    else:
        beside[1:] = turned[:-1]
    open_ = np.pad(turned & ~beside, ((0, 0), (0, 0), (1, 1))).astype(np.int8)
    change = np.diff(open_, axis=2)
    begin, end = np.argwhere(change == 1), np.argwhere(change == -1)  # in the same order, a begin and its end
    out = np.empty((len(begin), 4, 3))
    out[..., 0] = begin[:, :1] + side
    out[:, [0, 3], 1], out[:, [1, 2], 1] = begin[:, 1:2], begin[:, 1:2] + 1
    out[:, [0, 1], 2], out[:, [2, 3], 2] = begin[:, 2:], end[:, 2:]
    flipped = (axis == 1) != (side == 0)  # moving axis 1 to the front mirrors
    return np.moveaxis(out[:, ::-1] if flipped else out, 2, 0)[[[0, 1, 2], [1, 0, 2], [1, 2, 0]][axis]].transpose(1, 2, 0)


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
