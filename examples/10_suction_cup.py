"""A UR5e with a suction cup: the maker's arm, and one link more. Writes its URDF; from then on it is a robot like any other.

    python examples/10_suction_cup.py [FOLDER]          FOLDER: where the file goes, by default `out`
    retrieve robots out/ur5e_cup.urdf
    retrieve gen --robot out/ur5e_cup.urdf --fit -n 3 -o out/cup_scenes.jsonl
    retrieve plan out/cup_scenes.jsonl --policy lookahead -o out/cup_plans.jsonl

The link is called a cup, so nothing has to be said: its face is where its geometry ends. In plans the joint `suction` says when the vacuum
is on.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from lxml import etree

from kinematics.robots.files import urdf
from kinematics.robots.named import locate, named_robots
from kinematics.transforms import transform

RADIUS_M, LENGTH_M = 0.015, 0.12


def with_cup() -> etree._Element:
    """The arm of the named robot `ur5e`, without its gripper, with a rod that ends in a cup on its flange."""
    arm = locate(named_robots()["ur5e"], "file")
    if arm is None:
        raise SystemExit("the UR5e comes with the package airo-models: pip install airo-models")
    root, _ = urdf.read(arm)
    cup = etree.SubElement(root, "link", name="suction_cup")
    for kind in ("visual", "collision"):
        geometry = etree.SubElement(etree.SubElement(cup, kind), "geometry")
        etree.SubElement(geometry, "cylinder", radius=str(RADIUS_M), length=str(LENGTH_M))
    urdf.add_fixed_joint(root, "flange_to_cup", "tool0", "suction_cup", transform(p=np.array([0.0, 0.0, LENGTH_M / 2])))
    return root


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "ur5e_cup.urdf"
    file.write_text(urdf.to_string(with_cup()))
    print(file)
