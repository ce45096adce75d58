"""`retrieve robots`: the named robots, and their joined, cleaned URDFs for other programs."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from kinematics.errors import InputError, blame, choose
from planning.io.outputs import write_text
from retrieve_cli.terminal import show


def run(*, name: str | None, urdf: Path | None, as_json: bool) -> None:
    """List the robots, or tell about one; write its URDF when asked."""
    from kinematics.robots.robot import installed, load, named_robots

    table = named_robots()
    if name is not None:
        choose("robot", name, table)
    elif urdf is not None:
        raise InputError("robots: say which robot's URDF to write, e.g. retrieve robots ur5e --urdf ur5e.urdf")
    if urdf is not None and name is not None:
        with blame("robots"):
            text = load(name).urdf
        if str(urdf) == "-":
            sys.stdout.write(text)
        else:
            write_text(urdf, text)
        return
    rows = []
    for robot in [name] if name else table:
        row: dict[str, object] = {"name": robot, "title": table[robot]["title"], "package": table[robot]["distribution"]}
        row["installed"] = installed(robot)
        if row["installed"]:
            arm = load(robot)
            row |= {"joints": list(arm.joint_names), "opening_m": round(arm.opening.max_m, 4), "camera": arm.has_camera}
            if name:
                row |= {"home": [round(float(q), 4) for q in arm.home], "links": list(dict.fromkeys(h.link for h in arm.hulls))}
        else:
            row["install"] = f"pip install 'retrieve[{table[robot]['extra']}]'" if "extra" in table[robot] else None
        rows.append(row)
    if as_json:
        json.dump(rows[0] if name else rows, sys.stdout, indent=2)
        print()
        return
    from rich.table import Table

    view = Table("robot", "what it is", "joints", "opening", "package", header_style="bold", box=None, pad_edge=False)
    for row in rows:
        joints = row.get("joints")
        view.add_row(
            str(row["name"]),
            str(row["title"]),
            str(len(joints)) if isinstance(joints, list) else "–",
            f"{1000 * float(str(row['opening_m'])):.0f} mm" if "opening_m" in row else "–",
            str(row["package"]) if row["installed"] else f"missing: {row['install']}",
        )
    lines = []
    if name and rows[0]["installed"]:
        lines = [f"{what}: {', '.join(str(x) for x in rows[0][what])}" for what in ("joints", "links")]  # type: ignore[attr-defined]
        lines.append(f"write its URDF: retrieve robots {name} --urdf {name}.urdf")
    show(view, *lines)
