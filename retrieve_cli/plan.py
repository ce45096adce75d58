"""`retrieve plan`: moves and motions that take the target out, or the reason why there are none."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.errors import InputError
from planning.io.files import SceneLine, read_plans, read_scene_lines
from planning.io.outputs import is_special, place_for, refuse_input
from planning.io.results import plan_writer
from planning.plan import SCENE, Plan
from retrieve_cli.engine import map_ordered
from retrieve_cli.errors import DONE, UNSOLVED
from retrieve_cli.own_code import code_digest
from retrieve_cli.own_limits import digest
from retrieve_cli.own_policy import is_own
from retrieve_cli.plan_job import Job, check
from retrieve_cli.plan_line import Answer, plan_line
from retrieve_cli.robot_options import NO_OPTIONS, RobotOptions, overridden
from retrieve_cli.show import check_page
from retrieve_cli.story import story
from retrieve_cli.terminal import announce_first_run, mesh_progress, on_terminal, progress, say, say_what_was_read
from retrieve_cli.version import version

if TYPE_CHECKING:
    from kinematics.scene import Scene


def run(
    job: Job,
    *,
    scenes: Path | None,
    out: Path | None,
    robot: RobotOptions = NO_OPTIONS,
    html: Path | None = None,
    strict: bool = False,
    workers: int | None = None,
    engine: str = "local",
    address: str | None = None,
    resume: bool = False,
    pose_noise_mm: float = 2.0,
    quiet: bool = False,
) -> int:
    """Plan every scene; 1 when `strict` and some scene is unsolved.

    An invalid scene gets a plan that failed at stage `scene`; with `fail_fast`, or when there is no other scene, it is an error.
    """
    check(job)
    _check_world(job, html, one_worker=(workers or 1) == 1 and engine == "local")
    refuse_input(out, scenes)
    if html is not None:
        check_page(html, "plan")
        if not is_special(html):
            place_for(html)
    announce_first_run()
    asked = {
        **asdict(replace(job, fail_fast=False, model=None, limits=None)),
        "command": "plan",
        "version": version(),
        "robot": robot,
        "networks": _digest(job.model),
        "limits": digest(job.limits),
        "code of --policy": code_digest(job.policy) if is_own(job.policy) else None,
        "code of --world": code_digest(job.world),
        "pose_noise_mm": pose_noise_mm,
    }
    tell, picture = not quiet and on_terminal(out), _Picture(html)

    def lines() -> Iterator[SceneLine]:
        for line in read_scene_lines(scenes, noise_m=pose_noise_mm / 1000, on_mesh=mesh_progress):
            if line.scene is not None:
                say_what_was_read(line.where, line.scene)
            line = overridden(line, robot)
            picture.asked(line)
            yield line

    unsolved = 0
    with (
        plan_writer(out, asked=asked, resume=resume, tell=say) as write,
        progress("plans", file=scenes, done=write.kept, out=out) as advance,
    ):
        left = write.left(lines(), key=lambda line: line.key)
        for answer in _meant(map_ordered(partial(plan_line, job), left, workers=workers, engine=engine, address=address), write.kept > 0):
            write(answer.plan)
            unsolved += not answer.plan.success
            _say_answer(answer, tell=tell)
            picture.answered(answer)
            advance()
    if strict and write.kept:
        unsolved += sum(not plan.success for _, plan in islice(read_plans(out), write.kept))
    picture.draw(out, some_kept=write.kept > 0)  # the plans are written by now, whatever becomes of their picture
    return UNSOLVED if strict and unsolved else DONE


def _check_world(job: Job, html: Path | None, *, one_worker: bool) -> None:
    """Raises: InputError for what can't go with a real world."""
    if job.world is not None and not (job.sense and one_worker):
        raise InputError("plan: --world goes with --sense, and with one worker: there is one arm")
    if job.world is not None and html is not None:
        raise InputError("plan: --html draws what is known of a scene, and of a real world that is nothing; leave it out with --world")


def _say_answer(answer: Answer, *, tell: bool) -> None:
    """Say what is wrong with a line, or if asked for, what its plan does."""
    if answer.error:
        say(f"{answer.error} (its plan says so)")
    elif tell and answer.scene is not None:
        for words in story(answer.scene, answer.plan):
            say(words)


class _Picture:
    """The first plan that can be drawn, with its scene, for an HTML page; nothing where none is asked for."""

    def __init__(self, html: Path | None) -> None:
        self.html = html
        self._found: list[tuple[Scene, Plan]] = []
        self._lines: list[SceneLine] = []  # until a plan is found

    def asked(self, line: SceneLine) -> None:
        """A line was read."""
        if self.html is not None and not self._found:
            self._lines.append(line)

    def answered(self, answer: Answer) -> None:
        """A plan was made."""
        if not answer.error and not self._found and answer.scene is not None:
            self._found.append((answer.scene, answer.plan))

    def draw(self, out: Path | None, *, some_kept: bool) -> None:
        """Write the page. some_kept: whether some of the plans in `out` are an earlier call's, which may be the first to draw."""
        if self.html is None:
            return
        if some_kept:
            kept = zip(self._lines, read_plans(out))
            drawable = ((line.scene, plan) for line, (_, plan) in kept if line.scene is not None and not _refused(plan))
            self._found = list(islice(drawable, 1))
        if self._found:
            from retrieve_cli.show import write_html

            write_html(*self._found[0], self.html)


def _meant(answers: Iterable[Answer], some: bool) -> Iterator[Answer]:
    """The answers, those about invalid lines held back until there is another one; some: there was one before.

    Raises: InputError, the first complaint, when there is no other line at all.
    """
    refused: list[Answer] = []
    for answer in answers:
        if answer.error and not some:
            refused.append(answer)
            continue
        some = True
        yield from (*refused, answer)
        refused.clear()
    if refused:
        after = "line" if len(refused) == 2 else f"{len(refused) - 1} lines"
        more = f"; nor can the {after} after it" if len(refused) > 1 else ""
        raise InputError(refused[0].error + more)


def _refused(plan: Plan) -> bool:
    """Whether a plan says that its scene is invalid."""
    return plan.reason is not None and plan.reason.stage == SCENE


def _digest(model: str | None) -> str | None:
    """A hash of a model folder's files."""
    if model is None:
        return None
    digest = hashlib.sha256()
    for file in sorted(Path(model).glob("*")):
        if file.is_file():
            digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]
