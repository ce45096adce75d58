"""A scene out of recorded frames: the bodies that planning needs, and the space that nobody has seen as obstacles.

Nothing is known of such a scene but what the frames show: its objects bear the source "seen", and `retrieve plan` takes for solid what the
observation says to be unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.collision.fcl_solids import overlapping
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, Grasp, Scene, State, object_box
from kinematics.shapes import convex_parts
from kinematics.transforms import Array, apply
from perception.belief import POINT_M, TARGET, Belief
from perception.camera import cloud
from perception.frames import Frame
from perception.mapping.voxels import VOXEL_M, Voxels, unknown_voxels
from perception.objects.pieces import upright_pieces
from perception.objects.prepared_frames import prepare
from perception.objects.segment import object_points
from perception.objects.settle import MOST_M, settled
from planning.grasping.finger_grasps import sample_grasps
from planning.grasping.marginal_grasps import lacks_m
from planning.grasping.pads import pad_of
from planning.motion.pick_place import Motions
from planning.sensing import hiding_places
from planning.sensing.unknown_space import grown_to_blocks, unknown_boxes
from planning.verdict import judge_grasp

DEEP_M = MOST_M
"""Seen solids that overlap by more are not what they seem."""
TRIED, KEPT = 80, 5
"""So many grasps of a target are looked at, and so many kept, where the scene has none."""
NEAR_PX = 6
"""A pixel that measured nothing is as far as the nearest one, up to so many columns and rows away."""


def fused(scene: Scene, frames: Sequence[Frame], noise_1m_m: float, voxel_m: float = VOXEL_M) -> tuple[Voxels, list[float]]:
    """The map that frames give, and the share of it known after each."""
    voxels, shares = unknown_voxels(scene.cabinet, voxel_m), []
    for f in frames:
        voxels = voxels.fuse(f.depth, f.intrinsics, f.T_world_camera, own=f.arm, noise_1m_m=noise_1m_m)
        shares.append(voxels.known)
    return voxels, shares


def seen_bodies(belief: Belief, scene: Scene) -> tuple[tuple[Body, ...], tuple[Body, ...]]:
    """The believed objects as a scene's own; and pieces of those that nothing simple describes, as obstacles.

    A thing whose solid is deep in another's is no box or cylinder, a drill perhaps: nobody could pick it by that solid, nor what lies in
    it. It is cut into upright pieces, which stand still.
    """
    floor_z = float(scene.cabinet.T_world_cabinet[2, 3])
    bodies = belief.bodies
    points = object_points(prepare(belief.frames, scene.cabinet)) if _too_deep(bodies) else {}
    points.pop(scene.target or TARGET, None)  # what is wanted is taken for one thing
    T, pieces = scene.cabinet.T_world_cabinet, list[Body]()
    while (rough := _too_deep(bodies, points)) is not None:
        base = float(object_box(rough)[2] - object_box(rough)[5] / 2) - floor_z
        cut = upright_pieces(rough.name, points.pop(rough.name), max(base, 0.0))
        if len(cut) > 1:
            pieces += [replace(b, T_world_body=T @ b.T_world_body) for b in cut]
            bodies = tuple(b for b in bodies if b is not rough)
    together = settled([*bodies, *pieces], floor_z)
    return tuple(replace(b, source="seen") for b in together[: len(bodies)]), together[len(bodies) :]


def _too_deep(bodies: Sequence[Body], among: Mapping[str, Array] | None = None) -> Body | None:
    """Of the bodies that overlap deeply the one that is least like its solid: the largest; of those named in `among`, if given."""
    names = {n for contact in overlapping(tuple(bodies), DEEP_M) for n in (contact.a, contact.b)}
    deep = [b for b in bodies if b.name in names and (among is None or b.name in among)]
    return max(deep, key=lambda b: float(np.prod(object_box(b)[3:])), default=None)


def may_hide(
    scene: Scene, frames: Sequence[Frame], noise_1m_m: float, belief: Belief, bodies: Sequence[Body], pieces: Sequence[Body], given_m: float
) -> tuple[Voxels, NDArray[np.bool_]]:
    """A map of what the frames have not shown, and which of its voxels (X, Y, Z) may hold an object, see `hiding_places`.

    given_m: how slim an object may be. A body whose top was not seen, and a piece of something rough, may reach further than is known.
    """
    voxels, _ = fused(scene, frames, noise_1m_m, hiding_places.VOXEL_M)
    complete = {name for name, share in belief.seen_tops.items() if share >= hiding_places.COMPLETE}
    together = [*bodies, *pieces]
    least = hiding_places.smallest(bodies, given_m)
    places = hiding_places.hiding_places(voxels, together, complete, least)
    return voxels, grown_to_blocks(voxels, places, together, round(VOXEL_M / hiding_places.VOXEL_M))


def seen_scene(scene: Scene, bodies: Sequence[Body], pieces: Sequence[Body], observation: Mapping[str, Any]) -> Scene:
    """The scene with what was seen: objects, obstacles, observation, and the target's name if it is among the objects."""
    target = scene.target or TARGET
    found = any(b.name == target for b in bodies)
    return replace(
        scene,
        objects=tuple(bodies),
        obstacles=(*scene.obstacles, *pieces),
        observation=dict(observation),
        target=target if found else scene.target,
        target_box=None if found else scene.target_box,
    )


def box_at_pixel(frames: Sequence[Frame], frame: int, u: int, v: int) -> Array:
    """A small box (6,) in the world around the point that a pixel, column u and row v, of one frame shows.

    Raises: ValueError for a frame or a pixel that is not there, or one around which nothing was measured.
    """
    if not 0 <= frame < len(frames):
        raise ValueError(f"there is no frame {frame}; there are {len(frames)}, from 0 on")
    f = frames[frame]
    height, width = f.depth.shape
    if not (0 <= u < width and 0 <= v < height):
        raise ValueError(f"frame {frame} has no pixel {u}, {v}: it is {width} × {height}")
    rows, columns = np.nonzero(f.depth > 0)
    off = np.maximum(np.abs(rows - v), np.abs(columns - u))
    if not len(off) or off.min() > NEAR_PX:
        raise ValueError(f"frame {frame} measured nothing at pixel {u}, {v} or beside it")
    k = int(np.argmin(off))
    single = np.zeros_like(f.depth)
    single[rows[k], columns[k]] = f.depth[rows[k], columns[k]]
    return np.concatenate([cloud(single, f.intrinsics, f.T_world_camera)[0], [POINT_M] * 3])


def with_grasp(robot: Robot, scene: Scene) -> Scene:
    """The seen scene with grasps that hold the seen target: its own x_g, or that closed on what was seen, or else the most natural ones.

    Unchanged when the target was not found, or nothing holds it.
    """
    target = next((b for b in scene.objects if b.name == scene.target), None)
    if target is None:
        return scene
    if scene.grasp is not None:
        for grasp in (scene.grasp, _closed_on(target, scene.grasp)):
            at_sides = lacks_m(target, robot.opening, pad_of(robot), grasp) == 0.0
            if at_sides and judge_grasp(robot, scene, grasp) is None:
                return replace(scene, grasp=grasp)
    floor_z, base = float(scene.cabinet.T_world_cabinet[2, 3]), scene.robot.T_world_base[:2, 3]
    toward = float(np.arctan2(*(target.T_world_body[:2, 3] - base)[::-1]))
    approaches = [a for a in APPROACHES if a in scene.approaches]
    among = Motions(robot, scene, obstacles=unknown_boxes(scene), target_grasps=())
    alone = Motions(robot, replace(scene, objects=(target,), obstacles=()), target_grasps=())
    found: list[tuple[int, Grasp]] = []
    for grasp in islice(sample_grasps(target, robot.opening, approaches, floor_z, toward, pad=pad_of(robot)), TRIED):
        if judge_grasp(robot, scene, grasp) is None:
            reached = [bool(m.picks(State(m.start().q, m.scene.poses()), target.name, [grasp])[0]) for m in (among, alone)]
            if any(reached):
                found.append((0 if reached[0] else 1, grasp))
        if sum(rank == 0 for rank, _ in found) >= KEPT:
            break
    ranked = [g for _, g in sorted(found, key=lambda pair: pair[0])][:KEPT]
    return replace(scene, grasp=ranked[0], grasps=tuple((g, 1 / (k + 2)) for k, g in enumerate(ranked[1:]))) if ranked else scene


def _closed_on(target: Body, grasp: Grasp) -> Grasp:
    """The grasp with its hand in the middle between the target's sides, and just as wide as it."""
    T = grasp.T_world_hand.copy()
    corners = np.concatenate([apply(target.T_world_body, part) for part in convex_parts(target.shape)])
    along = (corners - T[:3, 3]) @ T[:3, 1]
    T[:3, 3] += T[:3, 1] * (along.min() + along.max()) / 2
    return Grasp(T, float(np.ptp(along)))
