"""A plan that was made on what was seen, as it is on the truth: under true names, with each object where it truly is in the hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Scene
from planning.plan import Plan
from planning.sensing.world import SimulatedWorld
from planning.verdict import Fault, Settings, judge_motions


def on_truth(robot: Robot, truth: Scene, seen: Scene, made: Plan) -> Plan:
    """The plan for `seen`, with bodies that were seen, as one for `truth`: what was seen is the true object that stands nearest, and the
    fingers close on what is there (`SimulatedWorld.recorded`). Poses and figures are as the plan says them.

    Raises: ValueError when it moves a body that is not in `seen`.
    """
    world = SimulatedWorld(robot, truth, np.random.default_rng(0), None, "geometry")
    names = world.names(seen.objects)
    if strange := [m.held.body for m in made.motions if m.held is not None and m.held.body not in names]:
        raise ValueError(f"the plan carries {strange[0]!r}, which is not among what was seen in {seen.id}")
    motions = world.recorded(made.motions, names, truth.poses())
    moves = tuple(replace(m, object=names.get(m.object, m.object)) for m in made.moves)
    return replace(made, motions=motions, moves=moves)


def judge_on_truth(robot: Robot, truth: Scene, seen: Scene, made: Plan, settings: Settings | None = None) -> tuple[Fault, ...]:
    """What is wrong with the motions of a plan for `seen` when they are carried out on `truth`, and when it takes out another object than
    the target; nothing where they hold. Raises: ValueError, see `on_truth`."""
    done = on_truth(robot, truth, seen, made)
    faults = judge_motions(truth, done.motions, robot, settings or Settings())
    taken = next((m.held.body for m in reversed(done.motions) if m.held is not None), None)
    if made.success and truth.target is not None and taken != truth.target:
        faults = (*faults, Fault("plan", (str(taken),), f"it takes out {taken}, and the target is {truth.target}"))
    return faults
