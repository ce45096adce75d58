"""Small documents that the tests of files, report and command line share: a valid scene and a valid plan, made anew for each test."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

SCHEMAS = Path(__file__).resolve().parents[1] / "planning" / "io" / "schema"


def pose(*p: float, q_wxyz: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)) -> dict[str, Any]:
    return {"p": list(p), "q_wxyz": list(q_wxyz)}


def scene(scene_id: str = "0-000007") -> dict[str, Any]:
    return {
        "schema": "retrieve/scene@1",
        "id": scene_id,
        "seed": [0, 7],
        "robot": {"name": "ur5e", "T_world_base": pose(0.0, 0.0, 0.0)},
        "cabinet": {"size_m": [0.56, 0.86, 0.5], "T_world_cabinet": pose(0.3, 0.0, 0.1), "wall_m": 0.03},
        "regions": {"n": 10},
        "approaches": ["horizontal"],
        "objects": [
            {"name": "box_0", "shape": {"type": "box", "size_m": [0.05, 0.06, 0.1]}, "T_world_object": pose(0.5, 0.0, 0.15)},
            {"name": "can_1", "shape": {"type": "cylinder", "radius_m": 0.03, "height_m": 0.12}, "T_world_object": pose(0.6, 0.1, 0.16)},
            {"name": "box_2", "shape": {"type": "box", "size_m": [0.04, 0.04, 0.2]}, "T_world_object": pose(0.45, -0.2, 0.2)},
        ],
        "target": "can_1",
        "grasp": {"T_world_hand": pose(0.6, 0.1, 0.172, q_wxyz=(0.5, 0.5, 0.5, 0.5)), "width_m": 0.06},
    }


def cell(scene_id: str = "0-000007") -> dict[str, Any]:
    """A scene that uses every field of version 2 that goes with a target."""
    document = scene(scene_id)
    document["schema"] = "retrieve/scene@2"
    document["robot"] |= {
        "q_start": {"shoulder_pan_joint": 0.5},
        "home": {"shoulder_lift_joint": -2.0, "elbow_joint": 1.5},
        "T_link_hand": pose(0.0, 0.0, 0.01, q_wxyz=(0.5, 0.5, 0.5, 0.5)),
        "gripper_joints": ["finger_joint"],
        "mount": True,
    }
    document["objects"][0] |= {"max_tilt_deg": 30.0, "source": "seen"}
    table = {"type": "box", "size_m": [0.8, 1.2, 0.05]}
    document["obstacles"] = [{"name": "table", "shape": table, "T_world_object": pose(0.0, 0.0, -0.025)}]
    document["grasps"] = [{**document["grasp"], "score": 0.9}, {**document["grasp"], "width_m": 0.058, "score": -0.1}]
    return document


def observed(scene_id: str = "0-000007") -> dict[str, Any]:
    observation = {
        "objects": [{"name": "box_0", "box": [0.5, 0.0, 0.15, 0.05, 0.06, 0.1]}],
        "regions": [[0.32, -0.4, 0.1, 1.0], [0.32, -0.3, 0.1, 0.0]],
        "views": [{"T_world_camera": pose(0.1, 0.0, 0.4), "known": 0.61}],
        "known": 0.61,
    }
    return {**scene(scene_id), "observation": observation}


def timed_plan(**words: Any) -> dict[str, Any]:
    """A plan of version 2: its first motion turns two joints from rest to rest, its second one closes the fingers."""
    document = {**plan(**words), "schema": "retrieve/plan@2", "duration_s": 0.75}
    for motion in document["motions"]:
        motion.update({rows: [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] for rows in ("qd", "qdd")})
    wide, tight = {"value": 0.1, "command_m": 0.08, "force_N": None}, {"value": 0.4, "command_m": 0.05, "force_N": 40.0}
    document["motions"][0]["gripper"] = {"joint": "finger", "before": wide, "after": tight}
    return document


def plan(scene_id: str = "0-000007", policy: str = "random", rule: str = "deep", success: bool = True, moved: int = 1) -> dict[str, Any]:
    why = {"stage": "transfer", "link": "forearm", "body": "box_2", "depth_m": 0.004}
    move = {"object": "box_0", "T_world_from": pose(0.5, 0.0, 0.15), "T_world_to": pose(0.4, 0.2, 0.15)}
    names = ["shoulder", "elbow", "finger"]
    return {
        "schema": "retrieve/plan@1",
        "scene": scene_id,
        "policy": policy,
        "rule": rule,
        "success": success,
        "reason": None if success else {"stage": "moves", "detail": "5 objects were moved"},
        "moves": [
            {**move, "region": 3, "done": False, "reason": why},
            *({**move, "region": 17 + i, "done": True, "reason": None} for i in range(moved)),
        ],
        "motions": [
            {
                "stage": "transit",
                "joint_names": names,
                "q": [[0.1, -1.2, 0.0], [0.30000000000000004, -1.1, 0.0]],
                "t_s": [0.0, 0.5],
                "held": None,
                "may_touch": [],
            },
            {
                "stage": "transfer",
                "joint_names": names,
                "q": [[0.30000000000000004, -1.1, 0.0], [0.4, -1.0, 0.0]],
                "t_s": [0.0, 0.25],
                "held": {"body": "box_0", "T_hand_body": pose(0.0, 0.0, 0.02)},
                "may_touch": [["left_pad", "box_0"], ["right_pad", "box_0"]],
            },
        ],
        "planning_time_s": 0.0004,
        "motion_time_s": 0.2,
        "hand_travel_m": 1.5,
        "return": -0.75,
        "verified": success,
    }


def lines(*documents: Any) -> str:
    return "".join(json.dumps(d) + "\n" for d in documents)
