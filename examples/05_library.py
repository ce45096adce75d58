"""The library from Python: load a robot, read a scene, plan it, verify it, write the plan.

python examples/05_library.py [SCENES.jsonl]
"""

import sys
from pathlib import Path

from planning import load_robot, plan_scene, read_scenes, verify_plan, write_plans

file = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("02_plum_behind_cylinders.jsonl")
print(load_robot("ur5e").title)
for scene in read_scenes(file):
    plan = plan_scene(scene, policy="local", seed=0)
    print(f"{scene.id}: " + ("solved" if plan.success else f"not solved, {plan.reason}") + f" with {len(plan.moves)} moves")
    print("faults:", *verify_plan(scene, plan) or ["none"])
    write_plans([plan], "plan.jsonl")
