"""A survey: looking around a cabinet until nothing that could be seen is in the way of a plan.

A recording is planned on without another look, so it has to show more than a first idea: after the views that reveal most, those are taken
that reveal what the arm would sweep on its ways to the target and to the objects that may have to be moved (`planning.sensing.focus`),
through gaps between what stands there (`planning.sensing.aimed_views`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from perception.belief import TARGET
from planning.sensing.belief_state import BeliefState
from planning.sensing.focus import wanted
from planning.sensing.look_around import Limits
from planning.sensing.world import World

RECORDING = Limits(share=0.995, least=0.001, views=24, travel=0.003)
"""Of a recording that is to be planned on."""
CLOSER = Limits(share=1.0, least=0.0002, views=7, travel=0.0)
"""Of one round of looks at what is in the way: the view where the arm stands already and six more; how far the arm goes is no matter."""
ROUNDS = 8
"""After so many rounds the rest can't be seen, or is of little use."""


def survey(mind: BeliefState, world: World, limits: Limits, on_step: Callable[[str], None] = lambda _: None) -> str:
    """Look around within `limits`, then closer at what is in the way of grasps, and say why it ended; `mind` has the frames and the map.

    limits.views bounds all views together. The bodies are those that the first look around showed.
    Raises: NoSurfaces when the frames show nothing but noise.
    """
    reason = mind.look(world, limits, None, on_step).reason
    mind.understand()
    target = mind.empty_scene.target or TARGET
    if mind.empty_scene.grasp is None or mind.belief.body(target) is None:
        return reason
    others = [b.name for b in mind.belief.bodies if b.name != target]
    aimed = True
    for _ in range(ROUNDS):
        left = limits.views - len(mind.frames)
        if left < 1:
            return f"{limits.views} views were taken"
        focus = wanted(mind.empty_scene, mind.robot, replace(mind.belief, voxels=mind.voxels), others)
        if not focus.any():
            return "nothing that was not seen is in the way of any grasp"
        before = len(mind.frames)
        looked = mind.look(world, replace(CLOSER, views=min(CLOSER.views, left + 1)), focus, on_step, aimed=aimed)
        del mind.frames[before]  # the same view as the last one
        shown = len(looked.frames) > 1
        if not shown and not aimed:
            return looked.reason
        aimed = shown  # what no aimed view shows, one of those for the whole cabinet may
    all_views = len(mind.frames) >= limits.views
    return f"{limits.views} views were taken" if all_views else f"{ROUNDS} rounds of closer looks were taken"
