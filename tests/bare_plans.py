"""Plans without motions, to count."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planning.episodes import Episode
from planning.plan import Blocked, Move, Plan


def move(done: bool = True, stage: str | None = None, name: str = "a", detail: str | None = None) -> Move:
    return Move(name, 0, np.eye(4), np.eye(4), done, None if stage is None else Blocked(stage, detail=detail))


def failed(stage: str, name: str = "a", detail: str | None = None) -> Move:
    return move(False, stage, name, detail)


def plan(
    scene: str = "s",
    policy: str = "random",
    rule: str = "deep",
    *,
    success: bool = True,
    moves: Sequence[Move] = (),
    reason: Any = None,
    **more: Any,
) -> Plan:
    given = {"planning_time_s": 0.5, "motion_time_s": 2.0, "hand_travel_m": 3.0, "value": -4.0, "verified": True, **more}
    return Plan(scene, policy, rule, success, reason, tuple(moves), (), **given)


def episode(scene: str, policy: str = "random", rule: str = "deep", *, success: bool = True, moved: int = 1, **more: Any) -> Episode:
    """One with `moved` moves; a failure is told as a failed retrieval."""
    return Episode.of(
        plan(scene, policy, rule, success=success, moves=[move()] * moved, reason=None if success else Blocked("transfer"), **more)
    )
