"""How to plan, as the options of `retrieve plan` say it; checked before the first scene is read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kinematics.errors import InputError, blame, choose
from retrieve_cli.own_policy import is_own, own_policy
from retrieve_cli.sense import parse_box
from retrieve_cli.terminal import say

if TYPE_CHECKING:
    from planning.motion.settings import MotionSettings
    from planning.motion.trajectory import Pace

UNSEEN = ("solid", "free")


@dataclass(frozen=True)
class Job:
    """How to plan: what a worker needs besides the scene."""

    policy: str | None = None  # None: the networks where the robot has some, else the look ahead alone
    rule: str = "deep"
    seed: int = 0
    iterations: int | None = None
    time_budget_s: float | None = None
    max_moves: int = 5
    model: str | None = None
    sense: bool = False
    noise: bool = False
    by: Literal["mask", "geometry"] = "mask"
    target_box: str | None = None
    smallest_mm: float = 40.0
    fail_fast: bool = False
    speed: float = 1.0
    hand_speed: float = 1.0
    slow_below_mm: float = 0.0
    limits: str | None = None
    unseen: str = "solid"
    clearance_mm: float = 5.0
    clearance_least_mm: float = 0.5
    max_tilt_deg: float = 30.0
    grasp: str = "given"
    world: str | None = None


def pace(job: Job) -> Pace:
    """Raises: ValueError for an invalid pace."""
    from planning.motion.trajectory import Pace

    return Pace(job.speed, job.hand_speed, job.slow_below_mm / 1000)


def check(job: Job) -> None:
    """Raises: InputError for options that do not go together, or a model or limits that can't be read."""
    from kinematics.robots.limits import read_tables
    from planning.learning.networks.model import once_loaded
    from planning.policies import NETWORKS, POLICIES

    if is_own(job.policy):
        own_policy(job.policy)
    elif job.policy is not None:
        choose("policy", job.policy, POLICIES)
    if job.model is not None and job.policy is not None and job.policy not in NETWORKS:
        raise InputError(f"plan: --model: the policy {job.policy} asks no network; {', '.join(NETWORKS)} do")
    if job.model is not None:
        with blame("plan: --model"):
            once_loaded(job.model)
    if job.iterations is not None and job.time_budget_s is not None:
        raise InputError("plan: --iterations and --time-budget-s exclude each other: give one budget")
    if job.time_budget_s is not None:
        say("a budget in seconds: the plans depend on this machine's speed and can't be repeated bit by bit")
    for_sensing = {
        "--noise": job.noise,
        "--by": job.by != Job.by,
        "--target-box": job.target_box is not None,
        "--smallest": job.smallest_mm != Job.smallest_mm,
    }
    for option, given in for_sensing.items():
        if given and not job.sense:
            raise InputError(f"plan: {option} is for --sense: without it nothing is looked at")
    if job.target_box is not None:
        parse_box(job.target_box, "plan")
    with blame("plan"):
        pace(job)
    if job.limits is not None:
        with blame("plan: --limits"):
            read_tables(Path(job.limits))
    choose("way to take unseen space (--unseen)", job.unseen, UNSEEN)
    if job.unseen == "free":
        say("space that no frame has shown is taken for free, on your word: the plans are only as safe as that")
    motion_settings(job)


def motion_settings(job: Job) -> MotionSettings:
    """What --clearance, --clearance-least and --max-tilt mean for motions. Raises: InputError for values that can't be kept."""
    from kinematics.collision.edge_problem import MARGIN_M
    from planning.motion.settings import ClearanceSettings, MotionSettings

    def clearance(mm: float) -> float:
        """In metres; what is no more than every certified motion keeps is nothing to ask for."""
        return 0.0 if 0 < mm <= 1000 * MARGIN_M else mm / 1000

    with blame("plan: --clearance, --clearance-least"):
        clearances = ClearanceSettings(wanted_m=clearance(job.clearance_mm), least_m=clearance(job.clearance_least_mm))
    with blame("plan: --max-tilt"):
        return MotionSettings(clearances, max_tilt_deg=job.max_tilt_deg)
