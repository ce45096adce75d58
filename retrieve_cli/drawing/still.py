"""Shaded stills of a scene or a plan: PNG, no display needed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from kinematics.scene import State
from kinematics.transforms import Array, apply
from perception.rendering.colours import TARGET_COLOUR, WALL_COLOUR
from perception.rendering.lighting import Studio
from perception.rendering.polylines import Polyline
from perception.rendering.shading import Image, Item, shade
from planning.io.outputs import replacing
from retrieve_cli.drawing.cell import OBSTACLE_ALPHA, OBSTACLE_COLOUR, grasp_lines, target_box_lines
from retrieve_cli.drawing.outlines import GRID_COLOUR, circle, footprint, front_edges, grid, ring, silhouette
from retrieve_cli.drawing.picture import EMPTY_COLOUR, FLOOR_COLOUR, Film, ground
from retrieve_cli.drawing.unknown_space import (
    UNKNOWN_ALPHA,
    UNSEEN_COLOUR,
    VIEW_COLOUR,
    observed_boxes,
    unknown_space,
    unseen_regions,
    view_pyramids,
)
from retrieve_cli.drawing.view import ASPECT, HALF_WIDTH, best_view
from retrieve_cli.drawing.visuals import visuals

WIDTH_PX = 1280


def write_png(film: Film, out: Path, *, camera: str = "side") -> None:
    """Write the still that tells most: from the side the beginning, with the hand's path and where moved objects go; or what the camera on
    the hand sees of the target. Raises InputError when `out` can't be written.
    """
    with replacing(out) as part:
        image = side_view(film) if camera == "side" else hand_view(film, time_of_best_sight(film))
        _save(image, part)


def save(image: Image, out: Path) -> None:
    """Write a PNG file, beside its name first. Raises InputError like `outputs.replacing`."""
    with replacing(out) as part:
        _save(image, part)


def _save(image: Image, file: Path) -> None:
    from PIL import Image as Pillow

    Pillow.fromarray(image).save(file, format="PNG")


def time_of_best_sight(film: Film) -> float:
    """When the hand's camera sees most of the target, all of it and upright if it ever does, before the hand takes it."""
    from perception.camera import realsense_d435i
    from perception.rendering.raycast import raycast
    from perception.rendering.surfaces import moved, surfaces

    camera, small = film.robot.tree.index["camera"], realsense_d435i(160, 120)
    taken = next((s.start_s for s in film.stretches if s.motion.held and s.motion.held.body == film.scene.target), film.length_s)
    if film.target is None:
        return 0.0
    names = [b.name for b in film.scene.objects]
    packed = surfaces([b.shape for b in film.scene.objects], np.array([b.T_world_body for b in film.scene.objects]))
    best, best_s = -1.0, 0.0
    for time in np.arange(0.0, taken, 0.2) if film.stretches else ():
        state = film.state_at(float(time))
        poses = {b.name: b.T_world_body for b in film.bodies(state)}
        links = film.link_poses(state.q)
        seen = raycast(moved(packed, np.array([poses[n] for n in names])), links[camera], small).instance
        mine = seen == names.index(film.target.name)
        cut = mine[0].any() or mine[-1].any() or mine[:, 0].any() or mine[:, -1].any()
        upright = max(0.0, -float(links[camera][2, 1]))
        worth = float(mine.sum()) * (0.2 if cut else 1.0) * (0.3 + 0.7 * upright)
        if worth > best:
            best, best_s = worth, float(time)
    return best_s


def time_of_best_carry(film: Film, T_world_camera: Array) -> tuple[float, int]:
    """When a camera sees most of an object that is carried out of the way, and in which move that is. There must be one."""
    from perception.camera import pinhole
    from perception.rendering.raycast import raycast
    from perception.rendering.surfaces import surfaces

    small = pinhole(320, round(320 / ASPECT), 2 * float(np.arctan(HALF_WIDTH)))
    best, when = -1, (0.0, 0)
    carrying = [s for s in film.stretches if s.motion.stage == "transfer" and s.move < len(film.done)]
    for s in carrying:
        for share in (0.2, 0.5, 0.8):
            time = s.start_s + share * (s.end_s - s.start_s)
            state = film.state_at(time)
            bodies, links = film.bodies(state), film.link_poses(state.q)
            arm = [links[film.robot.tree.index[h.link]] for h in film.robot.hulls]
            poses = np.array([*(b.T_world_body for b in bodies), *arm])
            solids = surfaces([*(b.shape for b in bodies), *(h.vertices for h in film.robot.hulls)], poses)
            seen = int((raycast(solids, T_world_camera, small).instance == len(bodies) - 1).sum())
            if seen > best:
                best, when = seen, (time, s.move)
    return when


def side_view(film: Film, time_s: float = 0.0, T_world_camera: Array | None = None, *, move: int | None = None) -> Image:
    """A still (H, W, 3) from the side, as the camera at T_world_camera sees it, or from where most of the target is seen.

    move: draw the path of this move only, as `Stretch` counts them.
    """
    from perception.camera import pinhole

    state = film.state_at(time_s)
    intrinsics = pinhole(WIDTH_PX, round(WIDTH_PX / ASPECT), 2 * float(np.arctan(HALF_WIDTH * 1.06)))
    T = best_view(film) if T_world_camera is None else T_world_camera
    lines = [*marks(film, state, T), *seen_lines(film), *plan_lines(film, move)]
    return shade(items(film, state), T, intrinsics, lines, studio=_studio(film))


def hand_view(film: Film, time_s: float = 0.0) -> Image:
    """What the camera on the hand sees (H, W, 3)."""
    from perception.camera import realsense_d435i

    state = film.state_at(time_s)
    T = film.link_poses(state.q)[film.robot.tree.index["camera"]]
    drawn = items(film, state, without="camera")
    return shade(drawn, T, realsense_d435i(WIDTH_PX, WIDTH_PX * 3 // 4), marks(film, state, T), studio=_studio(film))


def items(film: Film, state: State, without: str = "") -> list[Item]:
    """The solids: cabinet, obstacles, objects and arm, but for one link."""
    from perception.rendering.surfaces import Mesh

    scene = film.scene
    walls = scene.cabinet.walls()
    out = [Item(w.shape, w.T_world_body, WALL_COLOUR, alpha=0.13, gloss=0.0) for w in walls if w.name != "floor"]
    out += [Item(w.shape, w.T_world_body, FLOOR_COLOUR, gloss=0.0) for w in walls if w.name == "floor"]
    out += [Item(film.look(b.shape), b.T_world_body, OBSTACLE_COLOUR, alpha=OBSTACLE_ALPHA, gloss=0.0) for b in scene.obstacles]
    out += [Item(film.look(b.shape), b.T_world_body, film.colours[b.name], gloss=0.15) for b in film.bodies(state)]
    if (unknown := unknown_space(scene)) is not None:
        out.append(Item(unknown, np.eye(4), UNSEEN_COLOUR, alpha=UNKNOWN_ALPHA, gloss=0.0))
    links = film.link_poses(state.q)
    for piece in visuals(film.robot):
        if piece.link != without:
            T = links[film.robot.tree.index[piece.link]]
            out.append(Item(Mesh(piece.vertices, piece.faces), T, piece.colour, gloss=0.3))
    return out


def marks(film: Film, state: State, T_world_camera: Array) -> list[Polyline]:
    """The regions' grid, the front's rim, the target's grasps, and the ring and outline that mark it, also through what hides it."""
    scene = film.scene
    lines = [Polyline(g, GRID_COLOUR, 1.0, hidden=0.0, halo_px=0.0) for g in grid(scene.cabinet, scene.regions_n, -0.0025)]
    lines.append(Polyline(front_edges(scene.cabinet), (0.42, 0.47, 0.54), 2.0, hidden=0.0, halo_px=0.0))
    lines += [Polyline(p, TARGET_COLOUR, 2.5, hidden=0.6, halo_px=0.0) for p in target_box_lines(scene)]
    lines += [Polyline(p, colour, 3.0, hidden=0.6, halo_px=1.0) for colour, p in grasp_lines(film)]
    if film.target is None:
        return lines
    target = film.colours[film.target.name]
    T, radius = ring(scene.cabinet, film.target)
    lines.append(Polyline(apply(T, circle(radius)), target, 3.5, hidden=0.45, halo_px=0.0))
    for body in film.bodies(state):
        if body.name == scene.target:
            lines += [
                Polyline(apply(body.T_world_body, p), _darker(target), 2.0, hidden=0.0, halo_px=0.0) for p in film.outline(body.shape)
            ]
            lines += [Polyline(loop, target, 2.5, hidden=0.75, halo_px=0.0) for loop in silhouette(film.as_drawn(body), T_world_camera)]
    return lines


def seen_lines(film: Film) -> list[Polyline]:
    """Observed boxes, views and unseen regions of a sensed scene."""
    lines = [Polyline(p, UNSEEN_COLOUR, 1.6, hidden=0.0, halo_px=0.0) for p in unseen_regions(film.scene)]
    for colour, edges in observed_boxes(film).values():
        lines += [Polyline(p, colour, 1.8, hidden=0.35, halo_px=0.0) for p in edges]
    return lines + [Polyline(p, VIEW_COLOUR, 1.8, hidden=0.25, halo_px=0.0) for edges in view_pyramids(film.scene) for p in edges]


def plan_lines(film: Film, move: int | None = None) -> list[Polyline]:
    """The hand's path and the outlines of moved objects where they will stand; of one move only, if asked."""
    lines = []
    goals = film.destinations() if move is None else []
    if move is not None and move < len(film.done):
        goals = [replace(film.scene.body(film.done[move].object), T_world_body=film.done[move].T_world_to)]
    for body in goals:
        colour = film.colours[body.name]
        lines += [Polyline(apply(body.T_world_body, p), colour, 1.6, hidden=0.5, halo_px=0.0) for p in film.outline(body.shape)]
        lines.append(Polyline(footprint(film.scene.cabinet, body), colour, 3.5, hidden=0.35, halo_px=0.0))
    ways = sorted((w for w in film.path() if move is None or w.move == move), key=lambda w: w.held is not None)  # carried ones on top
    for way in ways:
        colour, width = (film.colours[way.held], 4.0) if way.held else (EMPTY_COLOUR, 2.0)
        lines.append(Polyline(way.points, colour, width, hidden=0.3, halo_px=1.5))
    return lines


def _studio(film: Film) -> Studio:
    """A third more lights than usual: the arm's shadows fall on a white floor, where bands would show."""
    return Studio(ground_z=ground(film), key_lights=32, sky_lights=128)


def _darker(colour: tuple[float, float, float]) -> tuple[float, float, float]:
    return (0.72 * colour[0], 0.72 * colour[1], 0.72 * colour[2])
