"""What a scene has besides cabinet, objects and arm, as pictures: obstacles, grasps of the target, and the box that a target is in."""

from __future__ import annotations

import numpy as np

from kinematics.scene import Grasp, Scene
from kinematics.shapes import Box
from kinematics.transforms import Array, apply
from perception.rendering.colours import TARGET_COLOUR, Colour
from retrieve_cli.drawing.outlines import outline
from retrieve_cli.drawing.picture import Film

OBSTACLE_COLOUR: Colour = (0.55, 0.50, 0.45)
OBSTACLE_ALPHA = 0.55
OTHER_GRASP_COLOUR: Colour = (0.35, 0.45, 0.60)
MOST_GRASPS = 8
"""So many of the alternatives are drawn, the best of them."""
FINGER_M, STEM_M = 0.045, 0.035


def grasp_lines(film: Film) -> list[tuple[Colour, Array]]:
    """x_g and the best alternatives as little forks, each a colour and polylines (N, 3) in the world; none for a film that moves.

    x_g comes last, so that it is drawn over the others.
    """
    if film.plan is not None:
        return []
    scene = film.scene
    others = [grasp for grasp, _ in scene.grasps if scene.grasp is None or not same_grasp(grasp, scene.grasp)][:MOST_GRASPS]
    lines = [(OTHER_GRASP_COLOUR, line) for grasp in reversed(others) for line in fork(grasp)]
    if scene.grasp is not None:
        lines += [(TARGET_COLOUR, line) for line in fork(scene.grasp)]
    return lines


def same_grasp(a: Grasp, b: Grasp) -> bool:
    """Whether two grasps are one, to the digits that files keep."""
    return bool(np.abs(a.T_world_hand - b.T_world_hand).max() < 1e-9)


def fork(grasp: Grasp) -> list[Array]:
    """A grasp as two fingers at its width, the palm between them and a stem, polylines (N, 3) in the world."""
    half = grasp.width_m / 2 + 0.003
    fingers = np.array([[0, -half, 0.008], [0, -half, -FINGER_M], [0, half, -FINGER_M], [0, half, 0.008]])
    stem = np.array([[0, 0, -FINGER_M], [0, 0, -FINGER_M - STEM_M]])
    return [apply(grasp.T_world_hand, fingers), apply(grasp.T_world_hand, stem)]


def target_box_lines(scene: Scene) -> list[Array]:
    """The edges (N, 3) of the box that the target is in; none where the target has a name."""
    if scene.target_box is None:
        return []
    return [line + scene.target_box[:3] for line in outline(Box(scene.target_box[3:]))]
