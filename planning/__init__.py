"""What to do: scenes, grasps, motions, policies, and the retrieval loop that joins them; in a few functions, `planning.library`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinematics.lazy_imports import lazily

if TYPE_CHECKING:
    from planning.library import load_robot, plan_scene, read_plans, read_scenes, verify_plan, write_plans, write_scenes
    from planning.motion.pick_place import Motions
    from planning.plan import Blocked, Motion, Move, Plan
    from planning.policies import POLICIES, make_policy
    from planning.retrieval import Policy, retrieve
    from planning.rules import Rule
    from planning.verdict import Fault, judge

__all__ = [
    "POLICIES",
    "Blocked",
    "Fault",
    "Motion",
    "Motions",
    "Move",
    "Plan",
    "Policy",
    "Rule",
    "judge",
    "load_robot",
    "make_policy",
    "plan_scene",
    "read_plans",
    "read_scenes",
    "retrieve",
    "verify_plan",
    "write_plans",
    "write_scenes",
]

_WHERE = {
    "Blocked": "planning.plan",
    "Fault": "planning.verdict",
    "Motion": "planning.plan",
    "Motions": "planning.motion.pick_place",
    "Move": "planning.plan",
    "POLICIES": "planning.policies",
    "Plan": "planning.plan",
    "Policy": "planning.retrieval",
    "Rule": "planning.rules",
    "judge": "planning.verdict",
    "load_robot": "planning.library",
    "make_policy": "planning.policies",
    "plan_scene": "planning.library",
    "read_plans": "planning.library",
    "read_scenes": "planning.library",
    "retrieve": "planning.retrieval",
    "verify_plan": "planning.library",
    "write_plans": "planning.library",
    "write_scenes": "planning.library",
}

__getattr__ = lazily(__name__, _WHERE)
