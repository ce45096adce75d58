"""The independent verdict: what a plan says, judged from scene and plan alone; and whether a grasp is valid at all."""

from planning.verdict.faults import Fault, Settings
from planning.verdict.grasp import closes_askew, judge_grasp, judge_hold
from planning.verdict.judge import Verdict, examine, judge, judge_motions, remarks

__all__ = ["Fault", "Settings", "Verdict", "closes_askew", "examine", "judge", "judge_grasp", "judge_hold", "judge_motions", "remarks"]
