"""`retrieve verify`: plans from anywhere, judged from their scenes alone; one line a plan."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.errors import InputError, blame
from planning.io.files import read_known, read_plans
from retrieve_cli.engine import map_ordered
from retrieve_cli.errors import DONE, UNSOLVED
from retrieve_cli.own_limits import with_limits
from retrieve_cli.robot_options import RobotOptions, other_robot
from retrieve_cli.terminal import announce_first_run, mesh_progress, progress, say

if TYPE_CHECKING:
    from kinematics.scene import Scene
    from planning.plan import Fault, Plan
    from planning.verdict import Settings, Verdict

Item = tuple[str, "Scene | None", "Plan", "Scene | None"]


def run(
    *,
    scenes: Path,
    plans: Path | None,
    as_json: bool,
    mu: float,
    max_tilt_deg: float | None,
    robot: RobotOptions,
    workers: int | None = None,
    pose_noise_mm: float = 2.0,
    seen: Path | None = None,
    limits: Path | None = None,
) -> int:
    """Judge every plan; 1 when one of them is false. seen: the scenes that they were made for, where `scenes` says what was true.
    limits: of speed, by which they were made."""
    from planning.verdict import Settings

    if str(scenes) == "-" and (plans is None or str(plans) == "-"):
        raise InputError("verify: scenes and plans can't both come from stdin; give one of them as a file")
    announce_first_run()
    known, refused = by_id(scenes, pose_noise_mm / 1000)
    believed, _ = ({}, {}) if seen is None else by_id(seen, pose_noise_mm / 1000)

    def items() -> Any:
        for where, plan in read_plans(plans, "verify"):
            if plan.scene in refused and plan.scene not in known:
                if plan.motions:
                    raise InputError(f"{where}: its scene is invalid: {refused[plan.scene]}")
                yield where, None, plan, None
                continue
            if plan.scene not in known:
                raise InputError(f"{where}: none of the {len(known)} scenes in {scenes} is {plan.scene}")
            scene = known[plan.scene]
            if seen is not None and plan.scene not in believed:
                raise InputError(f"{where}: none of the {len(believed)} scenes in --seen {seen} is {plan.scene}")
            if seen is None and (strange := moved_strangers(scene, plan)):
                say(f"{where}: scene {scene.id} has no {', '.join(strange)}; if it was planned on what was seen, --seen FILE says on what")
            if robot.given:
                scene = replace(scene, robot=other_robot(scene.robot, robot, where))
            yield where, scene, plan, believed.get(plan.scene)

    wrong = 0
    settings = Settings(mu=mu, max_tilt_deg=max_tilt_deg)
    with progress("plans", file=plans) as advance:
        judge = partial(judged, settings, as_json, None if limits is None else str(limits))
        for line, false in map_ordered(judge, items(), workers=workers):
            print(line, flush=True)
            wrong += false
            advance()
    return UNSOLVED if wrong else DONE


def by_id(file: Path, noise_m: float) -> tuple[Mapping[str, Scene], Mapping[str, str]]:
    """The scenes of a file by their ids, settled as they were for planning; and what is wrong with those that are invalid. Raises:
    InputError for two of one id that differ."""
    from planning.io.scene_documents import scene_to_json

    scenes, refused = read_known(file, "verify", noise_m=noise_m, on_mesh=mesh_progress)
    found: dict[str, Scene] = {}
    for where, scene in scenes:
        if scene.id in found and scene_to_json(found[scene.id]) != scene_to_json(scene):
            raise InputError(f"{where}: another scene is called {scene.id}, too, and plans say no more; verify them one after the other")
        found[scene.id] = scene
    return found, refused


def moved_strangers(scene: Scene, plan: Plan) -> list[str]:
    """What a plan carries or moves that is not in a scene."""
    named = [m.object for m in plan.moves] + [m.held.body for m in plan.motions if m.held is not None]
    return [name for name in dict.fromkeys(named) if name not in scene.poses()]


def judged(settings: Settings, as_json: bool, limits: str | None, item: Item) -> tuple[str, bool]:
    """What is printed of a plan, and whether it is false. Raises: InputError, see `examined`."""
    where, _, plan, _ = item
    verdict = examined(settings, limits, item)
    return (to_json(plan, verdict) if as_json else f"{where}: {in_words(plan, verdict)}"), verdict.verified is False


def examined(settings: Settings, limits: str | None, item: Item) -> Verdict:
    """The verdict on a plan; one without motions may be of an invalid scene: None. Raises: InputError when the scene's robot can't be
    loaded."""
    from kinematics.robots.load import from_ref
    from planning.sensing.on_truth import judge_on_truth
    from planning.verdict import Verdict, examine, remarks

    where, scene, plan, seen = item
    if scene is None:
        return Verdict((), (), None)
    with blame(where):
        arm = with_limits(from_ref(scene.robot, on_step=say), limits)
        if seen is None or not plan.motions:
            verdict = examine(scene, plan, arm, settings)
            return replace(verdict, notes=(*verdict.notes, *remarks(scene, plan)))
        faults = judge_on_truth(arm, scene, seen, plan, settings)
        return Verdict(faults, (), not faults)


def in_words(plan: Plan, verdict: Verdict) -> str:
    """The verdict in one line."""
    notes = "".join(f"; note: {note.detail}" for note in verdict.notes)
    if verdict.verified is None:
        return f"{plan.scene}: null: it has no motions to verify{notes}"
    if verdict.verified:
        return f"{plan.scene}: true{notes}"
    more = f" (and {len(verdict.faults) - 1} more)" if len(verdict.faults) > 1 else ""
    return f"{plan.scene}: false: {verdict.faults[0]}{more}{notes}"


def to_json(plan: Plan, verdict: Verdict) -> str:
    """The verdict as a line of JSON."""
    from planning.io.plan_documents import fault_to_json

    def told(faults: tuple[Fault, ...]) -> list[dict[str, Any]]:
        return [fault_to_json(fault) for fault in faults]

    document = {"scene": plan.scene, "policy": plan.policy, "rule": plan.rule, "verified": verdict.verified}
    return json.dumps({**document, "faults": told(verdict.faults), "notes": told(verdict.notes)}, ensure_ascii=False, allow_nan=False)
