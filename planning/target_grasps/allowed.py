"""With which grasps the target may be taken: the scene's x_g, the best of its list, or any that the sampler finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import chain

from kinematics.errors import InputError
from kinematics.robots.robot import Robot
from kinematics.scene import Grasp, Scene
from kinematics.shapes import ConvexMesh, Cylinder, bounds, is_level
from planning.grasping.candidates import height_over_lying
from planning.grasping.hand_poses import height_of, lowest_of
from planning.grasping.sampling import USUAL, Sampling
from planning.motion.handling.object_grasps import sampled_grasps
from planning.verdict import judge_grasp


class GraspChoice(StrEnum):
    """Which grasps of the target are tried."""

    GIVEN = "given"  # the scene's x_g, and no other
    ANY = "any"  # x_g, and all that are sampled on the target where it stands, with the scene's approaches
    LIST = "list"  # x_g and the scene's alternatives, the best first


@dataclass(frozen=True, eq=False)
class TargetGrasps:
    """first: the best in front. more: others that are found when asked for, by how densely they are sampled; None where there are none.
    Only the usual ones are judged one by one: of a dense sample's tens of thousands the hand alone rules out most, and as for what is moved
    out of the way the finished plan is judged."""

    first: tuple[Grasp, ...]
    more: Callable[[Sampling], Iterator[Grasp]] | None = None

    def representative(self) -> Grasp | None:
        """The grasp that stands for all of them where one x_g is asked for: the first that there is."""
        return next(chain(self.first, self.more(USUAL) if self.more else ()), None)


def check_choice(scene: Scene, choice: GraspChoice) -> None:
    """Raises: InputError for a scene without the grasp or the list that was chosen."""
    if choice is GraspChoice.GIVEN:
        _ = scene.x_g
    if choice is GraspChoice.LIST and not scene.grasps:
        raise InputError(f"scene {scene.id} has no list of grasps: retrieve grasp proposes one, or plan with --grasp given or any")


def target_grasps(robot: Robot, scene: Scene, choice: GraspChoice) -> TargetGrasps | str:
    """The valid grasps of a choice (`planning.verdict.judge_grasp`), or why there is none, in words.

    Raises: InputError for a scene without a target, or without the grasp or the list that was chosen.
    """
    target = scene.target_body
    check_choice(scene, choice)
    if choice is GraspChoice.GIVEN:
        wrong = judge_grasp(robot, scene, scene.x_g)
        return wrong if wrong is not None else TargetGrasps((scene.x_g,))
    known: tuple[Grasp, ...] = () if scene.grasp is None else (scene.grasp,)
    if choice is GraspChoice.LIST:
        known += tuple(grasp for grasp, _ in scene.grasps)
    judged = [(grasp, judge_grasp(robot, scene, grasp)) for grasp in known]
    good = tuple(grasp for grasp, wrong in judged if wrong is None)
    if choice is GraspChoice.LIST:
        return TargetGrasps(good) if good else f"none of the {len(judged)} that are listed is valid; the first: {judged[0][1]}"

    def more(sampling: Sampling) -> Iterator[Grasp]:
        found = sampled_grasps(robot, scene, target.name, target.T_world_body, sampling=sampling)
        if isinstance(target.shape, ConvexMesh) or sampling is not USUAL:
            return found  # those on a mesh were judged
        return (grasp for grasp in found if judge_grasp(robot, scene, grasp) is None)

    grasps = TargetGrasps(good, more)
    if grasps.representative() is not None:
        return grasps
    return f"no grasp that is sampled on {target.name} is valid: {_why_none(robot, scene)}"


def _why_none(robot: Robot, scene: Scene) -> str:
    """What is wrong with the most natural grasp that is sampled on the target, or why the sampler finds none."""
    target = scene.target_body
    first = next(sampled_grasps(robot, scene, target.name, target.T_world_body), None)
    if first is not None:
        return f"the first: {judge_grasp(robot, scene, first)}"
    size = " × ".join(f"{2000 * half:.0f}" for half in target.shape.half)
    approaches = "/".join(scene.approaches)
    if robot.opening.cup_m:
        cup = f"the cup, {1000 * robot.opening.cup_m:.0f} mm across"
        return f"it measures {size} mm, and {cup}, finds no flat face of it that is larger ({approaches})"
    if robot.opening.round_only and not isinstance(target.shape, Cylinder):
        return "the fingers turn as they open and take round objects only"
    if flat := lies_flat(robot, scene):
        return f"{flat} ({approaches})"
    opens = f"the fingers, which open {1000 * robot.opening.max_m:.0f} mm"
    return f"it measures {size} mm, and {opens}, find no two faces of it to close on ({approaches})"


def lies_flat(robot: Robot, scene: Scene) -> str | None:
    """That the target is too low for the fingers as it lies, in words, for the hand meets the floor first; None where it is not."""
    floor_z, lowest = float(scene.cabinet.T_world_cabinet[2, 3]), lowest_of(robot)
    shape, T = scene.target_body.shape, scene.target_body.T_world_body
    low, high = (float(corner[2]) for corner in bounds(shape, T))
    rooms = [(kind, lowest(kind, pitch)) for kind in scene.approaches for pitch in USUAL.pitches[kind]]
    if isinstance(shape, Cylinder) and is_level(T):
        heights = [height_over_lying((low + high) / 2, shape.radius_m, floor_z + room) for _, room in rooms]
    else:
        heights = [height_of(kind, low, high, floor_z + room, 0.5) for kind, room in rooms]
    if robot.opening.cup_m or any(z is not None for z in heights):
        return None
    least = 1000 * min(room for _, room in rooms)
    return f"it lies {1000 * (high - low):.0f} mm high, and the middle of the pads stays {least:.0f} mm above the floor: stand it up"
