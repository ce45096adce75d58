"""What an object meets as it is lifted, whatever hand takes it: no grasp that the planner looks at says otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Box, ConvexMesh, Cylinder, box_corners
from kinematics.transforms import rotation_about, transform
from planning.motion.cell.lifts import met_when_lifted
from planning.motion.cell.workcell import Workcell
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.obstruction import Obstruction
from planning.motion.handling.ways import WHOLE_WAY
from planning.motion.search.reaching import LIFT_M

FLOOR_Z = 0.1
CABINET = Cabinet(np.array([0.56, 0.86, 0.5]), transform(p=[0.3, 0.0, FLOOR_Z]), 0.03)


def box(name: str, size_m: tuple[float, float, float], x: float, y: float, z: float, yaw: float = 0.0) -> Body:
    """Its bottom z above the floor."""
    return Body(name, Box(np.array(size_m)), transform(rotation_about((0, 0, 1), yaw), [x, y, FLOOR_Z + z + size_m[2] / 2]))


LOW = box("low", (0.05, 0.05, 0.1), 0.5, 0.0, 0.0)


@pytest.mark.parametrize(("gap_m", "meets"), [(0.001, True), (LIFT_M - 0.0001, True), (LIFT_M + 0.0001, False)])
def test_the_lift_ends_where_the_arms_does(gap_m: float, meets: bool) -> None:
    board = box("board", (0.2, 0.8, 0.01), 0.5, 0.0, 0.1 + gap_m)
    assert met_when_lifted([LOW], [board]) == ({"low": ("board",)} if meets else {})
    assert met_when_lifted([LOW, board], []) == ({"low": ("board",)} if meets else {})


def test_the_floor_and_what_stands_beside_are_not_met_and_what_it_is_in_is() -> None:
    beside, through = box("beside", (0.05, 0.05, 0.3), 0.551, 0.0, 0.0), box("through", (0.02, 0.02, 0.3), 0.49, 0.02, 0.0)
    assert met_when_lifted([LOW, beside], CABINET.walls()) == {}
    assert met_when_lifted([LOW, beside, through], CABINET.walls()) == {"low": ("through",), "through": ("low",)}
    tall = box("tall", (0.05, 0.05, 0.49), 0.5, 0.0, 0.0)
    assert met_when_lifted([tall], CABINET.walls()) == {"tall": ("ceiling",)}
    assert met_when_lifted([tall], CABINET.walls()[:1]) == {}


def test_what_is_thin_enough_to_lie_between_two_waypoints_is_left_to_the_arms_check() -> None:
    """A lid of 2 mm above a plate of 4 mm, which the lift has below it or above at each waypoint: whole edges are the arm's matter."""
    thin, lid = box("thin", (0.05, 0.05, 0.004), 0.5, 0.0, 0.0), box("lid", (0.2, 0.2, 0.002), 0.5, 0.0, 0.006)
    assert met_when_lifted([thin], [lid]) == {}


def test_a_mesh_is_met_where_it_has_a_part() -> None:
    """A table with one leg."""
    top, leg = (box_corners(np.array(half)) for half in ([0.1, 0.1, 0.005], [0.01, 0.01, 0.06]))
    table = ConvexMesh((top + np.array([0.0, 0.0, 0.13]), leg + np.array([0.09, 0.09, 0.06])))
    assert met_when_lifted([LOW], [Body("table", table, transform(p=[0.5, 0.0, FLOOR_Z]))]) == {}
    assert met_when_lifted([LOW], [Body("table", table, transform(p=[0.5, 0.0, FLOOR_Z - 0.01]))]) == {"low": ("table",)}
    assert met_when_lifted([LOW], [Body("table", table, transform(p=[0.58, 0.08, FLOOR_Z - 0.06]))]) == {"low": ("table",)}


def test_no_grasp_says_otherwise(ur5e: Robot) -> None:
    """Objects among others that hang over them at random: where one is met, it blocks each way of every hand."""
    rng, met = np.random.default_rng(48001), 0
    for n in range(12):
        low = Body("low", Cylinder(0.025, 0.1), transform(p=[0.5, 0.0, FLOOR_Z + 0.05])) if n % 2 else LOW
        at = rng.uniform((0.45, -0.05, 0.095, 0.0), (0.55, 0.05, 0.13, 3.0), (2, 4))
        over = [box(f"over_{i}", (0.04, 0.04, 0.02), *row) for i, row in enumerate(at)]
        scene = Scene("lifts", RobotRef(np.eye(4), "ur5e"), CABINET, (low, *over), "over_0", None)
        cell = Workcell(ur5e, scene, iterations=0, time_budget_s=None)
        ways = Obstruction(cell, lambda name, T, scene=scene: sampled_grasps(ur5e, scene, name, T))
        for other in over:
            if other.name in met_when_lifted(scene.objects, cell.walls).get("low", ()):
                here = {"low": low.T_world_body, other.name: other.T_world_body}
                spots = {name: ways.spots.at(name, T) for name, T in here.items()}
                assert not ways.free(spots["low"], spots[other.name], WHOLE_WAY)
                met += 1
    assert met >= 8
