"""`retrieve demo`: find one hard scene, plan it, and leave the scene, the plan, a page and pictures of it in a folder."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.errors import InputError, blame
from planning.io.files import read_scenes
from planning.io.outputs import write_text
from planning.io.results import plan_writer, scene_writer
from retrieve_cli.terminal import announce_first_run, progress, say

if TYPE_CHECKING:
    from collections.abc import Callable

    from kinematics.scene import Scene
    from perception.rendering.shading import Image
    from retrieve_cli.drawing.picture import Film

ROBOT, SPEC, POLICY = "ur5e", "paper", "neural"
LOOKS, MOST_LOOKS = 24, 60
"""Scenes that are tried for one in which two different objects must move; and for one with any move at all."""
CALM_M = 1.5
"""How far the hand may travel for each object, so that the film is easy to follow."""


def run(*, out: Path, seed: int) -> None:
    """Write scene.jsonl, plan.jsonl, plan.html, before.png, during.png, after.png and hand.png into `out`, and tell the story."""
    folder = _folder(out)
    announce_first_run(drawing=True)
    with blame("demo"):
        film = _hard_scene(seed, folder / "scene.jsonl")
    _tell(film)
    assert film.plan is not None
    with plan_writer(folder / "plan.jsonl") as write:
        write(film.plan)
    say("\ndrawing")
    _draw(film, folder)
    say(f"  {folder / 'plan.html'}: the whole plan in 3D, with play controls; open it in a browser")
    say(f"  {folder / 'before.png'}, during.png, after.png; hand.png is what the camera on the hand sees")
    file = shlex.quote(str(folder / "scene.jsonl"))
    say(f"\nagain, from the scene alone: retrieve plan {file} --policy {POLICY} --seed {seed} | retrieve report")


def _folder(out: Path) -> Path:
    """Raises InputError when it can't be made."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except FileExistsError as e:
        raise InputError(f"{out}: is a file, not a folder; name another one with --out") from e
    return out


def _hard_scene(seed: int, file: Path) -> Film:
    """The first scene of a seed in which two different objects are moved, each once and not far; else the first with any move.

    It is left in `file`, and planned as it is read from there: so `retrieve plan` makes the same plan of it, to the last bit.

    Raises: ValueError when there is none.
    """
    from kinematics.robots.load import load, to_ref
    from planning.library import plan_scene
    from planning.scenes.generation import generate, load_spec
    from retrieve_cli.drawing.picture import Film

    arm = load(ROBOT, on_step=say)
    spec, ref = load_spec(SPEC), to_ref(arm)
    say("looking for a scene in which two objects or more are in the way")
    kept = None
    with progress("scenes", LOOKS, out=file) as step:
        for index in range(MOST_LOOKS):
            scene = _through(file, generate(spec, arm, ref, seed, index))
            plan = plan_scene(scene, POLICY, robot=arm, seed=seed)
            step()
            moved = [m.object for m in plan.moves if m.done]
            if not (plan.success and plan.verified and moved):
                pass
            elif len(set(moved)) == len(moved) >= 2 and plan.hand_travel_m < CALM_M * (len(moved) + 1):
                say(f"scene {scene.id} it is; those before were too easy, too long or unsolved" if index else f"scene {scene.id} it is")
                return Film(arm, scene, plan)
            elif kept is None or len(moved) < len(kept[1].moves):
                kept = scene, plan, file.read_text(encoding="utf-8")
            if kept and index + 1 >= LOOKS:
                say(f"scene {kept[0].id} will do: none of {LOOKS} was better")
                write_text(file, kept[2])
                return Film(arm, *kept[:2])
    raise ValueError(f"none of {MOST_LOOKS} scenes was solved by moving something; try another --seed")


def _through(file: Path, scene: Scene) -> Scene:
    with scene_writer(file) as write:
        write(scene)
    return next(read_scenes(file))[1]


def _tell(film: Film) -> None:
    """The story: what is in the way, each move, and the times."""
    import numpy as np

    scene, plan = film.scene, film.plan
    assert plan is not None
    say(f"\n{scene.target_name} is wanted; {len(scene.objects) - 1} other objects stand in the cabinet")
    for number, move in enumerate(film.done):
        say(f"  {scene.target_name} is {'still ' if number else ''}blocked: {plan.target_blocked[number].in_words()}")
        seconds = sum(s.end_s - s.start_s for s in film.stretches if s.move == number)
        far = 100 * float(np.linalg.norm(move.T_world_to[:3, 3] - move.T_world_from[:3, 3]))
        say(f"  {number + 1}. {move.object} moves {far:.0f} cm away, to region {move.region} ({seconds:.1f} s)")
    seconds = sum(s.end_s - s.start_s for s in film.stretches if s.move == len(film.done))
    say(f"  {len(film.done) + 1}. {scene.target_name} comes out ({seconds:.1f} s)")
    failed = len(plan.moves) - len(film.done)
    tries = f"; {failed} other attempts failed" if failed > 1 else "; 1 other attempt failed" if failed else ""
    say(f"planned in {plan.planning_time_s + plan.motion_time_s:.1f} s{tries}; every motion was verified")
    say(f"the arm moves for {film.length_s:.1f} s, its hand {plan.hand_travel_m:.1f} m")


def _draw(film: Film, folder: Path) -> None:
    from retrieve_cli.drawing.page import page
    from retrieve_cli.drawing.still import hand_view, save, side_view, time_of_best_carry, time_of_best_sight
    from retrieve_cli.drawing.view import best_view

    camera = best_view(film)
    time_s, move = time_of_best_carry(film, camera)
    pictures: dict[str, Callable[[], Image]] = {
        "before": lambda: side_view(film, 0.0, camera),
        "during": lambda: side_view(film, time_s, camera, move=move),
        "after": lambda: side_view(film, film.length_s, camera, move=len(film.done)),
        "hand": lambda: hand_view(film, time_of_best_sight(film)),
    }
    with progress("pictures", 1 + len(pictures)) as step:
        write_text(folder / "plan.html", page(film))
        step()
        for name, draw in pictures.items():
            save(draw(), folder / f"{name}.png")
            step()
