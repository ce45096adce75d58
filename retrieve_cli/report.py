"""`retrieve report`: Table I of plans beside the paper's, and what explains it; on the terminal or in the forms of `reporting`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from kinematics.errors import InputError
from planning import metrics
from planning.episodes import Episode
from planning.io.files import read_known, read_plans
from planning.io.outputs import refuse_input, write_text
from planning.policies import LOOK_AHEAD
from retrieve_cli import terminal
from retrieve_cli.reporting.forms import WRITERS, to_json, to_terminal
from retrieve_cli.reporting.tables import Report, name


def run(*, plans: Sequence[Path], scenes: Sequence[Path], out: Sequence[Path], as_json: bool) -> int | None:
    """Report on plans from files, or from stdin if none is named; to the files `out`, or to stdout.

    scenes: those that the plans were made for; they tell how many objects there were.
    """
    for file in out:
        if file.suffix.lower() not in WRITERS:
            ending = repr(file.suffix.lower() or "none")
            raise InputError(f"{file}: the ending says the form, and {ending} is not one of {', '.join(WRITERS)}")
        refuse_input(file, *plans, *scenes)
    sources: Sequence[Path | None] = plans or [None]
    if any(str(s) == "-" for s in scenes) and any(s is None or str(s) == "-" for s in sources):
        raise InputError("report: plans and scenes can't both come from stdin; give one of them as a file")
    objects, refused = count_objects(scenes)
    episodes = []
    for source in sources:
        for where, plan in read_plans(source):
            if scenes and plan.scene not in objects and plan.scene not in refused:
                raise InputError(f"{where}: none of the {len(objects)} scenes in {' '.join(map(str, scenes))} is {plan.scene}")
            episodes.append(Episode.of(plan))
    report = collect(episodes, objects)
    for remark in report.remarks:
        terminal.say(f"note: {remark}")
    for file in out:
        write_text(file, WRITERS[file.suffix.lower()](report))
        terminal.say(f"wrote {file}")
    if as_json:
        print(to_json(report), end="")
    elif not out:
        to_terminal(report)
    return None


def count_objects(scenes: Sequence[Path]) -> tuple[dict[str, int], set[str]]:
    """How many objects each scene of some files has, the target among them; and which scenes are invalid. Raises: InputError for two
    scenes of one name that differ."""
    found, refused = dict[str, int](), set[str]()
    for file in scenes:
        known, wrong = read_known(file, "report", on_mesh=terminal.mesh_progress)
        refused |= wrong.keys()
        for where, scene in known:
            if found.setdefault(scene.id, len(scene.objects)) != len(scene.objects):
                raise InputError(f"{where}: another scene is called {scene.id}, too; report on them one after the other")
    return found, refused


def collect(episodes: Sequence[Episode], objects: Mapping[str, int] | None = None) -> Report:
    """The report on these episodes. objects: how many each scene has."""
    rows, pairs = metrics.rows(episodes, objects), metrics.pairs(episodes)
    remarks = []
    for r in rows:
        if r.repeated:
            remarks.append(f"{name(r)}: {r.repeated} plans are for scenes already counted; all are counted, but not compared in pairs")
        if r.unverified:
            remarks.append(f"{name(r)}: {r.unverified} of the successes were not verified")
    ahead = {policy for policy in LOOK_AHEAD if len({r.rule for r in rows if r.policy == policy}) > 1}
    if ahead:
        remarks.append(f"{', '.join(sorted(ahead))}: what they propose was tried while they chose, so all rules come to the same")
    return Report(rows, pairs, metrics.headlines(pairs), remarks)
