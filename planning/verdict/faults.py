"""What the verdict hands out, `planning.plan.Fault`, and how strict it is, `Settings`."""

from __future__ import annotations

from dataclasses import dataclass

from planning.plan import SCENE, Fault

__all__ = ["MOVES", "PLAN", "SCENE", "Fault", "Settings"]

PLAN, MOVES = "plan", "moves"
"""Stages of faults that belong to no motion: of the plan's figures, of its list of moves; and `SCENE`, of the scene itself."""


@dataclass(frozen=True)
class Settings:
    """What is asked of a plan.

    mu: friction of pads on objects. gap_m, depth_m: how far a pad may stay away from what it holds, and how deep it may press into it.
    overlap_m: how wide the patch of contact is at least, in its narrowest direction. stands_m: how far what stands may be above its
    support. pose_m, pose_rad: how far poses may differ that should be the same. step_m: no point moves further between two looks for
    contacts. max_tilt_deg: how far a carried object may lean from how it stood; None: any way up. contact: whether contacts are looked
    for, and clearances measured; without, all else is judged. cup_rad: how askew a suction cup may be on what it holds.
    """

    mu: float = 0.5
    gap_m: float = 0.0005
    depth_m: float = 0.001
    overlap_m: float = 0.003
    stands_m: float = 0.001
    pose_m: float = 0.001
    pose_rad: float = 0.001
    step_m: float = 0.002
    max_tilt_deg: float | None = None
    contact: bool = True
    cup_rad: float = 0.07
