"""Motions given to the world, and what became of them: a transfer that stops half-way is planned anew from where the arm is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.scene import State
from kinematics.transforms import Array
from planning.motion.pick_place import Motions
from planning.plan import Blocked, Motion
from planning.sensing.world import Truth, World, configuration, part_done


@dataclass(frozen=True, eq=False)
class Driven:
    """What became of motions that were to be carried out: as they were, for the record; where the arm is, q (J,); why it stopped, None when
    all is done. released: the object that was put down, if one was; holding: whether one is in the hand."""

    motions: tuple[Motion, ...]
    q: Array
    why: Blocked | None = None
    released: str | None = None
    holding: bool = False


def carry_out(
    world: World,
    known: Truth,
    motions: Motions,
    state: State,
    planned: Sequence[Motion],
    names: Mapping[str, str],
    rng: np.random.Generator,
    on_step: Callable[[str], None],
    *,
    most_stops: int,
) -> Driven:
    """Carry motions out; a transfer that stops half-way is planned anew from where the arm is, and gone on with."""
    done, left, before = list[Motion](), list(planned), known.poses_now(state.poses)
    for _ in range(most_stops + 1):
        stopped = world.execute(left)
        if stopped is None:
            return Driven(known.recorded([*done, *left], names, before), left[-1].q[-1], None, released_by([*done, *left]), False)
        q, at = configuration(motions.robot, world.where()), left[stopped.motion]
        if at.held is not None:  # fingers that were told to go on until they meet it keep pressing: for the plan they are where it was seen
            q[motions.robot.gripper_joint] = at.q[0, motions.robot.gripper_joint]
        on_step(f"{at.stage} stopped: {stopped.why}")
        done += [*left[: stopped.motion], part_done(at, q)]
        why = Blocked(at.stage, body=at.held.body if at.held else None, detail=f"the execution stopped: {stopped.why}")
        across = motions.across_again(state, at, q, rng) if at.held is not None and at.stage == "transfer" else why
        if isinstance(across, Blocked):
            break
        left = [across, *left[stopped.motion + 1 :]]
    return Driven(known.recorded(done, names, before), q, why, released_by(done), at.held is not None)


def released_by(motions: Sequence[Motion]) -> str | None:
    """The object that the motions put down, None when they put none down."""
    held = [m.held.body for m in motions if m.held]
    return held[-1] if held and motions[-1].stage in ("release", "retreat") else None
