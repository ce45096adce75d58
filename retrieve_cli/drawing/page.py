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
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinematics.robots.tree import FIXED, SLIDES
from kinematics.shapes import Box, Cylinder, Shape, box_corners, convex_parts
from kinematics.transforms import Array, transform, wxyz_from_rotation
from perception.rendering.colours import TARGET_COLOUR, WALL_COLOUR
from retrieve_cli.drawing.cell import OBSTACLE_ALPHA, OBSTACLE_COLOUR, grasp_lines, target_box_lines
from retrieve_cli.drawing.page_html import PAGE
from retrieve_cli.drawing.picture import (
    EMPTY_COLOUR,
    FLOOR_COLOUR,
    GRID_COLOUR,
    HALF_HEIGHT,
    HALF_WIDTH,
    Film,
    best_view,
    footprint,
    frame_times,
    front_edges,
    grid,
    ground,
    held_by,
    outline,
    ring,
)
from retrieve_cli.drawing.plots import clearance_plot, joint_plots
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
from retrieve_cli.drawing.visuals import visuals

if TYPE_CHECKING:
    from perception.rendering.raycast import Mesh

Colour = tuple[float, float, float]
Command = dict[str, Any]
Int = NDArray[np.int64]
MOST_TURN = 1.5
"""Radians between two keys at most: the viewer takes the shorter way round."""
FRAME_S = 0.02
"""Seconds between two keys at most: the viewer goes straight from the one to the other."""


def page(film: Film, *, plots: bool = False) -> str:
    """The whole HTML document. plots: whether it shows the joints over time, too. Raises: ValueError for plots of what has none."""
    import umsgpack  # type: ignore[import-untyped]

    commands = [*_setting(film), *_objects(film), *_seen(film), *_arm(film), *_plan(film)]
    packed = [base64.b64encode(umsgpack.packb(c)).decode() for c in commands]
    tracks = _animation(film)
    if tracks:
        animation = {"type": "set_animation", "path": "", "animations": tracks, "options": {"play": False, "repetitions": 1}}
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
    commands = [
        *(_property(path, "visible", False) for path in ("/Background", "/Grid", "/Axes")),  # the page has its own background
    ]
    for wall in scene.cabinet.walls():
        floor = wall.name == "floor"
        commands += _solid(f"/cabinet/{wall.name}", wall.shape, FLOOR_COLOUR if floor else WALL_COLOUR, 1.0 if floor else 0.10)
        commands.append(_place(f"/cabinet/{wall.name}", wall.T_world_body))
        commands.append(_lines(f"/cabinet/edges/{wall.name}", outline(wall.shape), (0.50, 0.57, 0.66), 0.55))
        commands.append(_place(f"/cabinet/edges/{wall.name}", wall.T_world_body))
    for body in scene.obstacles:
        path = f"/obstacles/{body.name}"
        commands += [*_solid(path, film.look(body.shape), OBSTACLE_COLOUR, OBSTACLE_ALPHA), _place(path, body.T_world_body)]
        commands += [_lines(f"{path}/edges", film.outline(body.shape), OBSTACLE_COLOUR, 0.8)]
    commands.append(_lines("/cabinet/front", [front_edges(scene.cabinet)], (0.35, 0.40, 0.47)))
    commands.append(_lines("/regions", grid(scene.cabinet, scene.regions_n), GRID_COLOUR, 0.8))
    return commands


def _objects(film: Film) -> list[Command]:
    """The standing objects, the target's marks and its grasps."""
    scene = film.scene
    commands = [_lines(f"/grasps/{k}", [line], colour, 0.9, through=True) for k, (colour, line) in enumerate(grasp_lines(film))]
    if edges := target_box_lines(scene):
        commands.append(_lines("/target box", edges, TARGET_COLOUR, 0.9, through=True))
    for body in scene.objects:
        path = f"/objects/{body.name}"
        commands += [*_solid(path, film.look(body.shape), film.colours[body.name]), _place(path, body.T_world_body)]
        if body.name == scene.target:
            commands += _target_marks(film, path, body.shape)
    if film.target is None:
        return commands
    (T, radius), colour = ring(scene.cabinet, film.target), film.colours[film.target.name]
    commands += [
        _mesh("/target/ring", *_annulus(radius - 0.0035, radius + 0.0015), colour, basic=True),
        _mesh("/target/ring seen through", *_annulus(radius - 0.0035, radius + 0.0015), colour, 0.28, through=True),
        _place("/target", T),
    ]
    return commands


def _target_marks(film: Film, path: str, shape: Shape) -> list[Command]:
    """The target's edges, and a ghost of it that shines through whatever hides it."""
    colour = film.colours[film.scene.target_name]
    ghosts = _solid(f"{path}/seen through", film.look(shape), colour, 0.25, through=True)
    return [_lines(f"{path}/outline", film.outline(shape), (0.6 * colour[0], 0.6 * colour[1], 0.6 * colour[2])), *ghosts]


def _seen(film: Film) -> list[Command]:
    """What a sensed scene knows: observed boxes, views, and the regions that nobody has seen."""
    commands = [_lines(f"/seen/boxes/{name}", edges, colour, 0.9, through=True) for name, (colour, edges) in observed_boxes(film).items()]
    commands += [_lines(f"/seen/views/{i}", edges, VIEW_COLOUR) for i, edges in enumerate(view_pyramids(film.scene))]
    if (unknown := unknown_space(film.scene)) is not None:
        middle = unknown.vertices.mean(0)  # the numbers are packed as shares of the largest
        surface = _mesh("/seen/unknown", *_flat(unknown.vertices - middle, unknown.faces), UNSEEN_COLOUR, UNKNOWN_ALPHA, basic=True)
        commands += [surface, _place("/seen/unknown", transform(p=middle))]
    unseen = unseen_regions(film.scene)
    return commands + ([_lines("/seen/unseen regions", unseen, UNSEEN_COLOUR)] if unseen else [])


def _arm(film: Film) -> list[Command]:
    """The arm's links, each hanging on the one before, and the objects that it will hold."""
    robot, scene = film.robot, film.scene
    q = film.state_at(0.0).q
    commands = [_place("/robot", scene.robot.T_world_base)]
    nodes = _nodes(film)
    for i in sorted({i for name in (*(p.link for p in visuals(robot)), "hand") for i in robot.tree.path(robot.tree.index[name])}):
        commands.append(_place(nodes[i], film.robot.tree.local(i, q)))
    for k, piece in enumerate(visuals(robot)):
        path = f"{nodes[robot.tree.index[piece.link]]}/look {k}"
        commands.append(_mesh(path, *_creased(piece.vertices, piece.faces), piece.colour, shine=40))
    for k, held in enumerate(held_by(film)):
        path, shape = f"{nodes[robot.tree.index['hand']]}/held {k} {held.body}", scene.body(held.body).shape
        commands += [
            *_solid(path, film.look(shape), film.colours[held.body]),
            _place(path, held.T_hand_body),
            _property(path, "visible", False),
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
        commands.append(_mesh(path, *_tube(way.points, 0.0022 if way.held else 0.0012), colour, basic=True))
    for body in film.destinations():
        commands.append(_lines(f"/destinations/{body.name}", [footprint(film.scene.cabinet, body)], film.colours[body.name]))
    return commands


def _nodes(film: Film) -> dict[int, str]:
    """Every link's path in the viewer's tree."""
    tree = film.robot.tree
    return {i: "/robot/" + "/".join(tree.names[k] for k in tree.path(i)) for i in range(len(tree.names))}


def _solid(path: str, shape: Shape | Mesh, colour: Colour, opacity: float = 1.0, *, through: bool = False) -> list[Command]:
    from perception.rendering.raycast import Mesh

    match shape:
        case Box():
            return [_mesh(path, *_flat(*_hull(box_corners(shape.half))), colour, opacity, through=through)]
        case Cylinder():
            return [_mesh(path, *_cylinder_mesh(shape.radius_m, shape.height_m), colour, opacity, through=through)]
        case Mesh():
            return [_mesh(path, *_creased(shape.vertices, shape.faces), colour, opacity, through=through)]
        case _:
            parts = [_creased(*_hull(part)) for part in convex_parts(shape)]
            return [_mesh(f"{path}/part {k}", *part, colour, opacity, through=through) for k, part in enumerate(parts)]


def _mesh(
    path: str,
    vertices: Array,
    normals: Array,
    faces: Int,
    colour: Colour,
    opacity: float = 1.0,
    *,
    shine: float = 12,
    basic: bool = False,
    through: bool = False,
) -> Command:
    """Triangles: vertices (V, 3) are packed as 16-bit shares of the largest coordinate, normals (V, 3) as bytes.

    basic: one even colour without light; through: drawn over everything in front of it.
    """
    size = float(np.abs(vertices).max())
    small = len(vertices) < 2**16
    material: Command = {"type": "MeshBasicMaterial" if basic or through else "MeshPhongMaterial", "color": _hex(colour), "side": 2}
    material |= {} if basic or through else {"shininess": shine, "specular": 0x1A1A1A}
    material |= {"transparent": True, "opacity": opacity, "depthWrite": False} if opacity < 1 else {}
    material |= {"depthTest": False} if through else {}
    geometry = {
        "attributes": {
            "position": _packed(np.round(vertices / size * 32767).astype("<i2"), "Int16Array", 3),
            "normal": _packed(np.round(normals * 127).astype("i1"), "Int8Array", 3),
        },
        "index": _packed(faces.astype("<u2" if small else "<u4"), "Uint16Array" if small else "Uint32Array", 1),
    }
    return _object(path, "Mesh", geometry, material, [*np.diag([size, size, size, 1.0]).ravel()])


def _lines(path: str, polylines: list[Array], colour: Colour, opacity: float = 1.0, *, through: bool = False) -> Command:
    """Lines of one pixel through points (N, 3)."""
    pairs = np.concatenate([np.zeros((0, 3)), *(np.stack([p[:-1], p[1:]], 1).reshape(-1, 3) for p in polylines)]).astype("<f4")
    material: Command = {"type": "LineBasicMaterial", "color": _hex(colour)}
    material |= {"transparent": True, "opacity": opacity} if opacity < 1 else {}
    material |= {"depthTest": False} if through else {}
    return _object(path, "LineSegments", {"attributes": {"position": _packed(pairs, "Float32Array", 3)}}, material, [*np.eye(4).ravel()])


def _object(path: str, kind: str, geometry: Command, material: Command, matrix: list[float]) -> Command:
    ids = {"geometry": f"g {path}", "material": f"m {path}"}
    return {
        "type": "set_object",
        "path": path,
        "object": {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [{"uuid": ids["geometry"], "type": "BufferGeometry", "data": geometry}],
            "materials": [{"uuid": ids["material"], **material}],
            "object": {"uuid": f"o {path}", "type": kind, **ids, "matrix": [float(x) for x in matrix]},
        },
    }


def _packed(values: Any, kind: str, items: int) -> Command:
    """An array as meshcat's viewer unpacks it: an extension type for each kind of number."""
    import umsgpack

    code = {"Int8Array": 0x11, "Int16Array": 0x13, "Uint16Array": 0x14, "Uint32Array": 0x16, "Float32Array": 0x17}[kind]
    data = umsgpack.Ext(code, np.ascontiguousarray(values).tobytes())
    return {"itemSize": items, "type": kind, "array": data, "normalized": kind in ("Int8Array", "Int16Array")}


def _place(path: str, T: Array) -> Command:
    return {"type": "set_transform", "path": path, "matrix": [float(x) for x in T.T.ravel()]}


def _property(path: str, name: str, value: Any) -> Command:
    return {"type": "set_property", "path": path, "property": name, "value": value}


def _hex(colour: Colour) -> int:
    r, g, b = (round(255 * c) for c in colour)
    return r << 16 | g << 8 | b


# Triangles --------------------------------------------------------------------------------------------------------------------------------


def _flat(vertices: Array, faces: Int) -> tuple[Array, Array, Int]:
    """Vertices, normals and faces of a mesh (vertices (V, 3), faces (F, 3)) whose faces are flat."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-18)
    return corners.reshape(-1, 3), np.repeat(normals, 3, 0), np.arange(3 * len(corners)).reshape(-1, 3)


def _creased(vertices: Array, faces: Int, crease_rad: float = 0.6) -> tuple[Array, Array, Int]:
    """Vertices, normals and faces of a mesh, smooth but for edges sharper than a crease: there each side has vertices of its own."""
    from perception.rendering.raycast import Mesh, surfaces
    from perception.rendering.smooth_normals import corner_normals

    normals = corner_normals(surfaces([Mesh(vertices, faces)], np.eye(4)[None]), np.array([crease_rad])).reshape(-1, 3)
    leaning = np.round(normals * 60).astype(np.int64) + 60
    keys = ((faces.ravel() * 121 + leaning[:, 0]) * 121 + leaning[:, 1]) * 121 + leaning[:, 2]
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    return vertices[faces.ravel()[first]], normals[first], number.reshape(-1, 3)


def _hull(points: Array) -> tuple[Array, Int]:
    """Vertices and faces, counter-clockwise from outside, of the convex hull of points (N, 3)."""
    from perception.rendering.raycast import hull_faces

    return hull_faces(points)


def _cylinder_mesh(radius: float, height: float, sides: int = 64) -> tuple[Array, Array, Int]:
    angle = 2 * np.pi * np.arange(sides) / sides
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], -1)
    low, top = np.array([0, 0, -height / 2]), np.array([0, 0, height / 2])
    i = np.arange(sides)
    j = (i + 1) % sides
    wall = np.concatenate([np.stack([i, j, j + sides], -1), np.stack([i, j + sides, i + sides], -1)])
    caps = [np.stack([np.full(sides, 4 * sides), 2 * sides + j, 2 * sides + i], -1)]
    caps.append(np.stack([np.full(sides, 4 * sides + 1), 3 * sides + i, 3 * sides + j], -1))
    vertices = np.concatenate([radius * out + low, radius * out + top, radius * out + low, radius * out + top, [low, top]])
    down, up = np.array([0, 0, -1.0]), np.array([0, 0, 1.0])
    normals = np.concatenate([out, out, np.tile(down, (sides, 1)), np.tile(up, (sides, 1)), [down, up]])
    return vertices, normals, np.concatenate([wall, *caps])


def _annulus(inner: float, outer: float, sides: int = 96) -> tuple[Array, Array, Int]:
    angle = 2 * np.pi * np.arange(sides) / sides
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], -1)
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = np.concatenate([np.stack([i, i + sides, j + sides], -1), np.stack([i, j + sides, j], -1)])
    return np.concatenate([inner * rim, outer * rim]), np.tile([0, 0, 1.0], (2 * sides, 1)), faces


def _tube(points: Array, radius: float, sides: int = 6) -> tuple[Array, Array, Int]:
    """A tube around a polyline (N, 3)."""
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    tangent = np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]])
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    side[np.linalg.norm(side, axis=1) < 0.05] = [1.0, 0.0, 0.0]
    other = np.cross(side, tangent)
    for v in (side, other):
        v /= np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)
    angle = 2 * np.pi * np.arange(sides) / sides
    out = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None]
    n = len(points)
    start = (np.arange(n - 1) * sides)[:, None]
    i = np.arange(sides)
    j = (i + 1) % sides
    quads = [np.stack([start + i, start + j, start + j + sides], -1), np.stack([start + i, start + j + sides, start + i + sides], -1)]
    return (points[:, None] + radius * out).reshape(-1, 3), out.reshape(-1, 3), np.concatenate([q.reshape(-1, 3) for q in quads])


# Animation --------------------------------------------------------------------------------------------------------------------------------


def _animation(film: Film) -> list[Command]:
    """One clip a joint, and two an object that is moved: where it stands, and when it is seen there or in the hand. Keys are in seconds."""
    if not film.stretches:
        return []
    tree, nodes = film.robot.tree, _nodes(film)
    times, q = _keys(film)
    clips = []
    for i in range(len(tree.names)):
        values = q[:, tree.q_index[i]]
        if tree.kind[i] == FIXED or np.ptp(values) < 1e-9:
            continue
        keep = _needed(times, values)
        poses = [tree.local(i, row) for row in q[keep]]
        if tree.kind[i] == SLIDES:
            track = _track("position", "vector3", times[keep], [T[:3, 3] for T in poses])
        else:
            track = _track("quaternion", "quaternion", times[keep], [_xyzw(T) for T in poses])
        clips.append(_clip(nodes[i], [track]))
    return clips + _turns(film, nodes[tree.index["hand"]])


def _keys(film: Film) -> tuple[Array, Array]:
    """Times (N,) and configurations (N, J) of the whole film, near enough for every joint."""
    times, rows = [np.zeros(1)], [film.full(film.stretches[0].motion)[:1]]
    for s in film.stretches:
        t = frame_times(s.motion, MOST_TURN, FRAME_S)[1:]
        times.append(s.start_s + t)
        rows.append(film.full(s.motion, t))
    return np.concatenate(times), np.concatenate(rows)


def _needed(times: Array, values: Array) -> Array:
    """Which keys (N,) a joint needs: not those in the middle of a rest."""
    still = np.abs(np.diff(values)) < 1e-9
    keep = np.ones(len(values), bool)
    keep[1:-1] = ~(still[:-1] & still[1:])
    keep[1:] &= np.diff(times) > 0
    return keep


def _turns(film: Film, hand: str) -> list[Command]:
    """Clips that show every moved object either where it stands or in the hand."""
    end = film.length_s
    clips = []
    stands: dict[str, list[tuple[float, bool, Array]]] = {}
    ways = held_by(film)
    shown: list[list[tuple[float, bool]]] = [[(0.0, False)] for _ in ways]
    for s in film.stretches:
        for name, T in film.scene.poses().items():
            T = s.poses.get(name, T)
            stands.setdefault(name, []).append((s.start_s, name in s.poses, T))
        for k, way in enumerate(ways):
            held = s.motion.held
            same = held is not None and held.body == way.body and bool(np.abs(held.T_hand_body - way.T_hand_body).max() < 1e-9)
            shown[k].append((s.start_s, same))
    for name, rows in stands.items():
        if all(seen for _, seen, _ in rows):
            continue
        poses = [(t, T) for t, seen, T in rows if seen]
        changes = [p for i, p in enumerate(poses) if i == 0 or np.abs(p[1] - poses[i - 1][1]).max() > 1e-9]
        keys = changes[:1]
        for t, T in changes[1:]:
            keys += [(t - 0.001, keys[-1][1]), (t, T)]  # it jumps while it is not seen here
        times = np.array([t for t, _ in keys])
        tracks = [
            _track("position", "vector3", times, [T[:3, 3] for _, T in keys]),
            _track("quaternion", "quaternion", times, [_xyzw(T) for _, T in keys]),
            _visible([(t, seen) for t, seen, _ in rows], end),
        ]
        clips.append(_clip(f"/objects/{name}", tracks))
    for k, way in enumerate(ways):
        clips.append(_clip(f"{hand}/held {k} {way.body}", [_visible(shown[k], end)]))
    return clips


def _visible(rows: list[tuple[float, bool]], end: float) -> Command:
    changes = [r for i, r in enumerate(rows) if i == 0 or r[1] != rows[i - 1][1]]
    changes = [*changes, (end, changes[-1][1])]
    return {"name": ".visible", "type": "bool", "keys": [{"time": float(t), "value": bool(v)} for t, v in changes]}


def _track(name: str, kind: str, times: Array, values: list[Array]) -> Command:
    return {
        "name": f".{name}",
        "type": kind,
        "keys": [{"time": float(t), "value": [float(x) for x in v]} for t, v in zip(times, values)],
    }


def _clip(path: str, tracks: list[Command]) -> Command:
    return {"path": path, "clip": {"fps": 1, "name": "plan", "tracks": tracks}}


def _xyzw(T: Array) -> Array:
    return np.roll(wxyz_from_rotation(T[:3, :3]), -1)


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
        "colours": {name: f"#{_hex(c):06x}" for name, c in film.colours.items()},
        "target": film.scene.target,
    }


def _rounded(p: Array) -> list[float]:
    return [round(float(x), 4) for x in p]


def _caption(film: Film) -> str:
    """The card: what is asked, how it ended, and the moves."""
    scene, plan = film.scene, film.plan
    others = len(scene.objects) - (film.target is not None)
    swatch = "" if scene.target is None else f'<i style="background:#{_hex(film.colours[scene.target]):06x}"></i>'
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
        f'<li><i style="background:#{_hex(film.colours[m.object]):06x}"></i>{escape(m.object)} <span>to region {m.region}</span></li>'
        for m in done
    ]
    if plan.success:
        rows.append(f"<li>{swatch}{escape(target)} <span>out of the cabinet</span></li>")
    tries = f"<br>{failed} attempts failed" if failed > 1 else "<br>1 attempt failed" if failed else ""
    numbers = f"{film.length_s:.1f} s of motion · hand travels {plan.hand_travel_m:.1f} m{tries}"
    return f"{head}<p>{line}</p>{result}<ol>{''.join(rows)}</ol><p>{numbers}</p>"


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
        colour = _hex(film.colours.get(s.motion.held.body, EMPTY_COLOUR)) if s.motion.held else None
        if colour is not None:
            left, width = 100 * s.start_s / film.length_s, 100 * (s.end_s - s.start_s) / film.length_s
            marks.append(f'<s style="left:{left:.2f}%;width:{width:.2f}%;background:#{colour:06x}"></s>')
    return (
        '<div id="bar"><button id="play" aria-label="Play or pause" title="Play or pause (space)"></button>'
        f'<div id="line">{"".join(marks)}<input id="time" type="range" min="0" max="{film.length_s:.3f}" step="0.001" value="0" '
        'aria-label="Time"></div><output id="clock"></output><output id="stage"></output>'
        '<button id="speed" title="Speed">1×</button></div>'
    )
