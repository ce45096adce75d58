"""What is asked of the loop that looks: how it sees, how it decides and moves, and how often it tries again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from planning.motion.pick_place import ITERATIONS
from planning.motion.settings import DEFAULTS, MotionSettings
from planning.motion.trajectory import FULL, Pace
from planning.rules import MAX_MOVES, Rule
from planning.sensing.hiding_places import SMALLEST_M
from planning.sensing.look_around import Limits
from planning.target_grasps.allowed import GraspChoice

_FIRST, _AFTER_MOVE = Limits(0.99, 0.001, 10), Limits(1.0, 0.0004, 5, 0.001)
_WHEN_STUCK, _ONCE = Limits(1.0, 0.0004, 3, 0.0), Limits(1.0, 1.0, 1)


@dataclass(frozen=True)
class SensingSettings:
    """How the loop sees, how much it looks before it acts, and how often it tries again.

    by: how objects are told apart; None: by masks, if the frames have some. noise_1m_m: of the camera's depth at one metre.
    smallest_m: no object is slimmer; once the target can't be taken at once, unseen space into which nothing of this size fits is taken for
    free (0: never), and a note says so.
    first, after_move: the first look around and those after a move, which show what the object hid. when_stuck: when nothing works with
    what is known, the current view and two of what is in the way, at most `patience` times in a row, aimed at no more than `most_hidden`
    objects besides the target; once: one picture, where a step is lost without a move. most_stops: executions that may end half-way.
    """

    by: Literal["mask", "geometry"] | None = "mask"
    noise_1m_m: float = 0.0
    smallest_m: float = SMALLEST_M
    first: Limits = _FIRST
    after_move: Limits = _AFTER_MOVE
    when_stuck: Limits = _WHEN_STUCK
    once: Limits = _ONCE
    patience: int = 4
    most_hidden: int = 2
    most_stops: int = 3


@dataclass(frozen=True)
class LoopSettings:
    """How the loop decides and moves; each as `planning.library.plan_scene` has it.

    pace: how fast the arm is driven. grasp: with which grasps the target may be taken, x_g being what is looked for.
    """

    rule: Rule = Rule.DEEP
    max_moves: int = MAX_MOVES
    iterations: int = ITERATIONS
    time_budget_s: float | None = None
    motion: MotionSettings = DEFAULTS
    pace: Pace = FULL
    grasp: GraspChoice = GraspChoice.GIVEN


SENSING, LOOP = SensingSettings(), LoopSettings()
