"""Links, objects and obstacles are told apart by their names, as the allowed contacts of a plan do."""

from __future__ import annotations

from collections.abc import Sequence

from kinematics.mount import MOUNT, mount
from kinematics.robots.robot import Robot
from kinematics.scene import WALLS, Body, Scene


def check_names(robot: Robot, scene: Scene, obstacles: Sequence[Body] = ()) -> None:
    """Make sure that links and bodies can be told apart by their names, as the allowed contacts of a plan do.

    obstacles: more that stands still, besides what the scene has; several may have one name, unless it is a link's or an object's.
    Raises: ValueError that says which name to change.
    """
    links, under, obstacles = set(robot.tree.names), mount(scene), (*scene.obstacles, *obstacles)
    if under is not None and any(body.name == MOUNT for body in (*obstacles, *scene.objects)):
        raise ValueError(f"{MOUNT!r} is what the robot stands on; call the body something else, or say robot.mount false")
    objects = [body.name for body in scene.objects]
    for i, name in enumerate(objects):
        if name in links:
            raise ValueError(f"object {name!r} has the name of a link of the robot {robot.name}; call the object something else")
        if name in WALLS or name in objects[:i] or any(body.name == name for body in obstacles):
            other = "a wall of the cabinet" if name in WALLS else "another object" if name in objects[:i] else "an obstacle"
            raise ValueError(f"object {name!r} has the name of {other}; call it something else")
    for body in obstacles:
        if body.name in links or body.name in WALLS:
            other = "a wall of the cabinet" if body.name in WALLS else f"a link of the robot {robot.name}"
            raise ValueError(f"obstacle {body.name!r} has the name of {other}; call it something else")
