"""One self-contained page with meshcat's viewer in it: the scene in 3D and the whole plan as an animation with play controls.

The viewer is meshcat's own script from its package, fed with the commands that its server would send: packed messages, one an object,
property or animation (https://github.com/meshcat-dev/meshcat). Writing them into the page ourselves needs no server process.

Links hang on each other as in the URDF, and each joint is one track with keys at the plan's waypoints: between them the viewer turns the
joint evenly, which is just what the plan says. A held object is drawn a second time, fixed to the hand, and the two take turns to be seen.
"""

from __future__ import annotations

import base64
import importlib.util
import json
import re
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.shapes import Shape
from kinematics.transforms import Array, transform
from perception.rendering.colours import TARGET_COLOUR, WALL_COLOUR
from retrieve_cli.drawing.animation import clips_of, link_paths
from retrieve_cli.drawing.cell import OBSTACLE_ALPHA, OBSTACLE_COLOUR, grasp_lines, target_box_lines
from retrieve_cli.drawing.outlines import GRID_COLOUR, footprint, front_edges, grid, outline, ring
from retrieve_cli.drawing.page_html import PAGE
from retrieve_cli.drawing.picture import EMPTY_COLOUR, FLOOR_COLOUR, Film, ground, held_by
from retrieve_cli.drawing.plots import clearance_plot, joint_plots
from retrieve_cli.drawing.three import Command, annulus, creased, flat, hex_colour, hide, lines, mesh, place, solid, tube
from retrieve_cli.drawing.unknown_space import (
    UNKNOWN_ALPHA,
    UNSEEN_COLOUR,
    VIEW_COLOUR,
    observed_boxes,
    told,
    unknown_space,
    unseen_regions,
    view_pyramids,
)
from retrieve_cli.drawing.view import HALF_HEIGHT, HALF_WIDTH, best_view
from retrieve_cli.drawing.visuals import visuals


def page(film: Film, *, plots: bool = False) -> str:
    """The whole HTML document. plots: whether it shows the joints over time, too. Raises: ValueError for plots of what has none."""
    import umsgpack  # type: ignore[import-untyped]

    commands = [*_setting(film), *_objects(film), *_seen(film), *_arm(film), *_plan(film)]
    packed = [base64.b64encode(umsgpack.packb(c)).decode() for c in commands]
    clips = clips_of(film)
    if clips:
        animation = {"type": "set_animation", "path": "", "animations": clips, "options": {"play": False, "repetitions": 1}}
        packed.append(base64.b64encode(umsgpack.packb(animation)).decode())
    script = _viewer()
    parts = {
        "TITLE": escape(f"{film.scene.id}: {'plan' if film.plan else 'scene'}"),
        "CAPTION": _caption(film),
        "PLOTS": _plots(film, joints=plots),
        "CONTROLS": _controls(film),
        "SETTINGS": in_script(_settings(film)),
        "COMMANDS": ",\n".join(f'"{c}"' for c in packed),
        "MESHCAT": script.replace("</script", "<\\/script"),
    }
    return re.sub(f"@({'|'.join(parts)})@", lambda found: parts[found[1]], PAGE)  # all at once: nothing in a part is replaced


def in_script(value: Any) -> str:
    """A value as JSON that may stand in a page's script: no name in it can end the script, or begin a comment."""
    text = json.dumps(value)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _viewer() -> str:
    """meshcat's viewer script, found without importing meshcat: that would load its server and warn of its age."""
    place = importlib.util.find_spec("meshcat")
    assert place, "meshcat is a dependency"
    assert place.origin
    return (Path(place.origin).parent / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")


# Commands ---------------------------------------------------------------------------------------------------------------------------------


def _setting(film: Film) -> list[Command]:
    """Background, cabinet, grid and obstacles."""
    scene = film.scene
    commands = [hide(path) for path in ("/Background", "/Grid", "/Axes")]  # the page has its own background
    for wall in scene.cabinet.walls():
        floor = wall.name == "floor"
        commands += solid(f"/cabinet/{wall.name}", wall.shape, FLOOR_COLOUR if floor else WALL_COLOUR, 1.0 if floor else 0.10)
        commands.append(place(f"/cabinet/{wall.name}", wall.T_world_body))
        commands.append(lines(f"/cabinet/edges/{wall.name}", outline(wall.shape), (0.50, 0.57, 0.66), 0.55))
        commands.append(place(f"/cabinet/edges/{wall.name}", wall.T_world_body))
    for body in scene.obstacles:
        path = f"/obstacles/{body.name}"
        commands += [*solid(path, film.look(body.shape), OBSTACLE_COLOUR, OBSTACLE_ALPHA), place(path, body.T_world_body)]
        commands += [lines(f"{path}/edges", film.outline(body.shape), OBSTACLE_COLOUR, 0.8)]
    commands.append(lines("/cabinet/front", [front_edges(scene.cabinet)], (0.35, 0.40, 0.47)))
    commands.append(lines("/regions", grid(scene.cabinet, scene.regions_n), GRID_COLOUR, 0.8))
    return commands


def _objects(film: Film) -> list[Command]:
    """The standing objects, the target's marks and its grasps."""
    scene = film.scene
    commands = [lines(f"/grasps/{k}", [line], colour, 0.9, through=True) for k, (colour, line) in enumerate(grasp_lines(film))]
    if edges := target_box_lines(scene):
        commands.append(lines("/target box", edges, TARGET_COLOUR, 0.9, through=True))
    for body in scene.objects:
        path = f"/objects/{body.name}"
        commands += [*solid(path, film.look(body.shape), film.colours[body.name]), place(path, body.T_world_body)]
        if body.name == scene.target:
            commands += _target_marks(film, path, body.shape)
    if film.target is None:
        return commands
    (T, radius), colour = ring(scene.cabinet, film.target), film.colours[film.target.name]
    commands += [
        mesh("/target/ring", *annulus(radius - 0.0035, radius + 0.0015), colour, basic=True),
        mesh("/target/ring seen through", *annulus(radius - 0.0035, radius + 0.0015), colour, 0.28, through=True),
        place("/target", T),
    ]
    return commands


def _target_marks(film: Film, path: str, shape: Shape) -> list[Command]:
    """The target's edges, and a ghost of it that shines through whatever hides it."""
    colour = film.colours[film.scene.target_name]
    ghosts = solid(f"{path}/seen through", film.look(shape), colour, 0.25, through=True)
    return [lines(f"{path}/outline", film.outline(shape), (0.6 * colour[0], 0.6 * colour[1], 0.6 * colour[2])), *ghosts]


def _seen(film: Film) -> list[Command]:
    """What a sensed scene knows: observed boxes, views, and the regions that nobody has seen."""
    commands = [lines(f"/seen/boxes/{name}", edges, colour, 0.9, through=True) for name, (colour, edges) in observed_boxes(film).items()]
    commands += [lines(f"/seen/views/{i}", edges, VIEW_COLOUR) for i, edges in enumerate(view_pyramids(film.scene))]
    if (unknown := unknown_space(film.scene)) is not None:
        middle = unknown.vertices.mean(0)  # the numbers are packed as shares of the largest
        surface = mesh("/seen/unknown", *flat(unknown.vertices - middle, unknown.faces), UNSEEN_COLOUR, UNKNOWN_ALPHA, basic=True)
        commands += [surface, place("/seen/unknown", transform(p=middle))]
    unseen = unseen_regions(film.scene)
    return commands + ([lines("/seen/unseen regions", unseen, UNSEEN_COLOUR)] if unseen else [])


def _arm(film: Film) -> list[Command]:
    """The arm's links, each hanging on the one before, and the objects that it will hold."""
    robot, scene = film.robot, film.scene
    q = film.state_at(0.0).q
    commands = [place("/robot", scene.robot.T_world_base)]
    nodes = link_paths(film)
    for i in sorted({i for name in (*(p.link for p in visuals(robot)), "hand") for i in robot.tree.path(robot.tree.index[name])}):
        commands.append(place(nodes[i], film.robot.tree.local(i, q)))
    for k, piece in enumerate(visuals(robot)):
        path = f"{nodes[robot.tree.index[piece.link]]}/look {k}"
        commands.append(mesh(path, *creased(piece.vertices, piece.faces), piece.colour, shine=40))
    for k, held in enumerate(held_by(film)):
        path, shape = f"{nodes[robot.tree.index['hand']]}/held {k} {held.body}", scene.body(held.body).shape
        commands += [
            *solid(path, film.look(shape), film.colours[held.body]),
            place(path, held.T_hand_body),
            hide(path),
        ]
        if held.body == scene.target:
            commands += _target_marks(film, path, shape)
    return commands


def _plan(film: Film) -> list[Command]:
    """The hand's path as tubes, and where moved objects will stand."""
    commands = []
    for k, way in enumerate(film.path()):
        path = f"/hand path/{k} {way.held or 'empty'}"
        colour = film.colours[way.held] if way.held else EMPTY_COLOUR
        commands.append(mesh(path, *tube(way.points, 0.0022 if way.held else 0.0012), colour, basic=True))
    for body in film.destinations():
        commands.append(lines(f"/destinations/{body.name}", [footprint(film.scene.cabinet, body)], film.colours[body.name]))
    return commands


# Words ------------------------------------------------------------------------------------------------------------------------------------


def _settings(film: Film) -> Command:
    """What the page's own script needs: the camera, the floor, and the film's chapters."""
    T = best_view(film)
    points = film.film_points()
    focus = T[:3, 3] + T[:3, 2] * float(np.median((points - T[:3, 3]) @ T[:3, 2]))
    return {
        "eye": _rounded(T[:3, 3]),
        "focus": _rounded(focus),
        "halfWidth": HALF_WIDTH,
        "halfHeight": HALF_HEIGHT,
        "ground": round(ground(film), 4),
        "length": round(film.length_s, 3),
        "stages": [{"t": round(s.start_s, 3), "stage": s.motion.stage, "about": s.about, "move": s.move} for s in film.stretches],
        "colours": {name: f"#{hex_colour(c):06x}" for name, c in film.colours.items()},
        "target": film.scene.target,
    }


def _rounded(p: Array) -> list[float]:
    return [round(float(x), 4) for x in p]


def _caption(film: Film) -> str:
    """The card: what is asked, how it ended, and the moves."""
    scene, plan = film.scene, film.plan
    others = len(scene.objects) - (film.target is not None)
    swatch = "" if scene.target is None else f'<i style="background:#{hex_colour(film.colours[scene.target]):06x}"></i>'
    target = "what is in the box" if scene.target is None else scene.target
    head = f"<h1>Take out {swatch}<b>{escape(target)}</b></h1>"
    behind = f"{others} other objects" if others != 1 else "1 other object"
    robot = escape(scene.robot.name or scene.robot.urdf or "")
    line = f"scene {escape(scene.id)} · {robot} · {behind}"
    line += f"<br>{known}" if (known := told(scene)) else ""
    if plan is None:
        return f"{head}<p>{line}</p>"
    done = film.done
    failed = len(plan.moves) - len(done)
    line += f" · {escape(plan.policy)}, {escape(plan.rule)}"
    moved = f"after {len(done)} moves" if len(done) > 1 else "after 1 move" if done else "at once"
    if plan.success:
        how = "every motion verified" if plan.verified else "not verified"
        result = f'<p class="good">Retrieved {moved}, {how}</p>'
    else:
        result = f'<p class="bad">Not retrieved: {escape(str(plan.reason))}</p>'
    rows = [
        f'<li><i style="background:#{hex_colour(film.colours[m.object]):06x}"></i>{escape(m.object)} <span>to region {m.region}</span></li>'
        for m in done
    ]
    if plan.success:
        rows.append(f"<li>{swatch}{escape(target)} <span>out of the cabinet</span></li>")
    tries = f"<br>{failed} attempts failed" if failed > 1 else "<br>1 attempt failed" if failed else ""
    numbers = f"{film.length_s:.1f} s of motion · hand travels {plan.hand_travel_m:.1f} m{tries}"
    notes = "".join(f"<br>{escape(note.detail)}" for note in plan.notes)
    return f"{head}<p>{line}</p>{result}<ol>{''.join(rows)}</ol><p>{numbers}{notes}</p>"


def _plots(film: Film, *, joints: bool) -> str:
    """The card over the time line: the clearance over time, the joints above it if asked for."""
    rows = (joint_plots(film) if joints else "") + clearance_plot(film)
    return f'<div id="plots">{rows}<div id="cursor"></div></div>' if rows else ""


def _controls(film: Film) -> str:
    """The bar with play, time line and speed; nothing for a scene that stands still."""
    if not film.stretches:
        return ""
    marks = []
    for s in film.stretches:
        colour = hex_colour(film.colours.get(s.motion.held.body, EMPTY_COLOUR)) if s.motion.held else None
        if colour is not None:
            left, width = 100 * s.start_s / film.length_s, 100 * (s.end_s - s.start_s) / film.length_s
            marks.append(f'<s style="left:{left:.2f}%;width:{width:.2f}%;background:#{colour:06x}"></s>')
    return (
        '<div id="bar"><button id="play" aria-label="Play or pause" title="Play or pause (space)"></button>'
        f'<div id="line">{"".join(marks)}<input id="time" type="range" min="0" max="{film.length_s:.3f}" step="0.001" value="0" '
        'aria-label="Time"></div><output id="clock"></output><output id="stage"></output>'
        '<button id="speed" title="Speed">1×</button></div>'
    )
