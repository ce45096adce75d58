"""`retrieve warmup`: compiles ahead and derives what the named robots need, so that no later command waits for it."""

from __future__ import annotations

from time import perf_counter

from kinematics.errors import InputError, blame, choose
from retrieve_cli.terminal import announce_first_run, progress, say


def run(*, robots: list[str]) -> None:
    """Warm up for some robots, by default for every named one whose package is installed. Raises InputError for unknown ones."""
    from kinematics.robots.named import installed, named_robots

    table = named_robots()
    wanted = [choose("robot", name, table) for name in robots] or [name for name in table if installed(name)]
    for name in wanted:
        if not installed(name):
            raise InputError(f"warmup: the package of {name} ({table[name]['distribution']}) is not installed")
    announce_first_run()
    _compile()
    _draw()
    with progress("robots", len(wanted)) as advance:
        for name in wanted:
            began = perf_counter()
            with blame(f"warmup: {name}"):
                warm(name)
            say(f"{name}: ready after {perf_counter() - began:.0f} s")
            advance()


def _compile() -> None:
    """Compile what every plan needs, from the front of the list; a second process does so from its end."""
    from planning.compiling.ahead import compile_now, known, waiting

    began, left = perf_counter(), waiting()
    with progress("compiling", len(known())) as advance:
        for ahead in known():
            if wrong := compile_now(ahead):
                say(f"warmup: {wrong}")
            advance()
    say(f"compiled: {len(left)} of {len(known())} functions, in {perf_counter() - began:.0f} s; the others were in the cache")


def _draw() -> None:
    from perception.rendering.tiny_still import tiny_still

    began = perf_counter()
    tiny_still()
    say(f"drawing: ready after {perf_counter() - began:.0f} s")


def warm(name: str) -> None:
    """Cover a robot, generate a scene for it, plan and verify it, and look at it: all that is compiled or derived once is used."""
    from kinematics.robots.load import load, to_ref
    from perception.rendering.synthetic_camera import synthetic_camera
    from planning.library import plan_scene
    from planning.scenes.generation import generate, load_spec

    say(f"{name}: meshes and sphere covers")
    robot = load(name, on_step=say)
    say(f"{name}: a scene")
    scene = generate(load_spec("paper"), robot, to_ref(robot), 0, 0)
    say(f"{name}: a plan")
    plan_scene(scene, robot=robot)
    synthetic_camera(robot, scene, scene.poses())(scene.robot.T_world_base @ robot.link_poses(robot.home)["hand"], robot.home)
