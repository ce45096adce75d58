"""What is believed of a scene after looking at it: an upright solid and a box for every object, the floor's regions with their flags."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Literal

import numpy as np

from kinematics.scene import Body, Cabinet, Scene, object_box
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, apply, inverse
from perception.camera import points_in_camera
from perception.frames import Frame
from perception.mapping.voxels import UNKNOWN, Voxels
from perception.objects.clustering import cluster_instances
from perception.objects.fit import standing_solids
from perception.objects.prepared_frames import PreparedFrames, ReadyFrame, prepare
from perception.objects.segment import grown, iou, match, object_pixels, object_points, standing_box, standing_boxes
from perception.objects.settle import settled
from perception.objects.supports import base_heights
from perception.objects.tops import seen_top
from perception.observation import Observation

FLAG_SHARE, FLAG_HEIGHT_M = 0.95, 0.05  # a region counts as observed when so much of the space up to this height over it is known
SPOT_M = 0.005  # what is this near to where an object stands is the object
SAME = 0.1  # boxes with so much of their union in common are of one object
TARGET = "target"
POINT_M = 0.03  # the grasp stands for a box of this size where no target box is given


@dataclass(frozen=True, eq=False)
class Belief:
    """bodies: upright solids, settled on one another, to plan with. boxes: name to the paper's box (6,), centre and size, grown into
    what is hidden.

    frames: those that it comes from, and whose pixels are which object's. seen_tops: name to the share of the top face that was seen.
    """

    bodies: tuple[Body, ...]
    boxes: Mapping[str, Array]
    voxels: Voxels
    frames: tuple[Frame, ...] = ()
    seen_tops: Mapping[str, float] = field(default_factory=dict)

    def body(self, name: str) -> Body | None:
        """The believed body of a name; None where there is none."""
        return next((b for b in self.bodies if b.name == name), None)


def believe(
    empty_scene: Scene,
    frames: Sequence[Frame],
    voxels: Voxels,
    *,
    by: Literal["mask", "geometry"] = "mask",
    target_box: Array | None = None,
    tracked: Mapping[str, Body] | None = None,
    before: Sequence[Body] = (),
    kept: dict[Frame, ReadyFrame] | None = None,
) -> Belief:
    """Find the objects in the frames.

    by: see `perception.objects.segment`. target_box (6,): where the target is, centre and size in the world, by default the scene's; by
    geometry, without one, the target is what the scene's grasp reaches for. A target that has no name is called TARGET. tracked: objects
    that the arm has moved, where they stand now; the frames are not asked about them. before: what was believed last; by geometry, an
    object found where one was keeps its name. kept: frames made ready, from one belief to the next, see `prepare`.
    """
    tracked = tracked or {}
    views = prepare([without_objects(f, tracked) for f in frames] if by == "mask" else list(frames), empty_scene.cabinet, kept)
    views = views if by == "mask" else cluster_instances(views)
    if by == "geometry":
        views = _named_as_before(views, empty_scene.cabinet, tracked, before)
    shown = object_pixels(views)
    bases = base_heights({name: points for name, (points, _) in shown.items()})
    solids = settled(standing_solids(views, shown, bases, empty_scene.cabinet), float(empty_scene.cabinet.T_world_cabinet[2, 3]))
    tops = {b.name: seen_top(b, apply(empty_scene.cabinet.T_world_cabinet, shown[b.name][0])) for b in solids}
    boxes = {name: grown(box, voxels) for name, box in standing_boxes(views, shown, solids, bases, empty_scene.cabinet).items()}
    wanted = _wanted(empty_scene, by, target_box)
    if wanted is not None:
        chosen = match({b.name: object_box(b) for b in solids}, wanted)
        target = empty_scene.target or TARGET
        names = {chosen: target, target: chosen} if chosen is not None else {target: f"{target}_other"}
        solids = tuple(replace(b, name=names.get(b.name, b.name) or b.name) for b in solids)
        boxes = {names.get(n, n) or n: b for n, b in boxes.items()}
        tops = {names.get(n, n) or n: share for n, share in tops.items()}
        views = _renamed(views, {n: names.get(n, n) or n for n in shown})
    bodies = [*solids, *tracked.values()]
    return Belief(tuple(bodies), {**boxes, **{n: object_box(b) for n, b in tracked.items()}}, voxels, views.frames, tops)


def _wanted(empty_scene: Scene, by: str, target_box: Array | None) -> Array | None:
    """Where the target is said to be (6,), None when masks name it, or nobody has said anything."""
    if target_box is not None:
        return target_box
    if empty_scene.target_box is not None:
        return empty_scene.target_box
    if by == "geometry" and empty_scene.grasp is not None:
        return np.append(empty_scene.grasp.T_world_hand[:3, 3], [POINT_M] * 3)
    return None


def _named_as_before(views: PreparedFrames, cabinet: Cabinet, tracked: Mapping[str, Body], before: Sequence[Body]) -> PreparedFrames:
    """The views with the names that objects had before, by how much of their boxes is common, and new names for the others.

    What little is found on the very spot of a tracked object is a remainder of it, and gets no name.
    """
    found = {name: standing_box(points, cabinet) for name, points in object_points(views).items()}
    known = {b.name: object_box(b) for b in before if b.name not in tracked}
    names: dict[str, str] = {}
    pairs = sorted(((iou(a, b), x, y) for x, a in found.items() for y, b in known.items()), key=lambda pair: -pair[0])
    for common, x, y in pairs:
        if common > SAME and x not in names and y not in names.values():
            names[x] = y
    free = (name for i in count() if (name := f"object_{i}") not in known and name not in tracked)
    fragments = {n for n, a in found.items() if any(_on_the_spot(a, object_box(b)) for b in tracked.values())}
    names = {n: names.get(n) or next(free) for n in found if n not in fragments}
    return _renamed(views, names)


def _on_the_spot(a: Array, b: Array) -> bool:
    """Whether the middle of one box (6,) is over the floor that another covers."""
    return bool((np.abs(a[:2] - b[:2]) < b[3:5] / 2).all())


def _renamed(views: PreparedFrames, names: Mapping[str, str]) -> PreparedFrames:
    """The views with other names for their instances; those that get none are nobody's."""
    frames = []
    for f in views.frames:
        assert f.instance is not None
        nobody = np.isin(f.instance, [i for i, n in enumerate(f.names) if n not in names])
        frames.append(replace(f, instance=np.where(nobody, np.int32(-1), f.instance), names=tuple(names.get(n, "") for n in f.names)))
    return replace(views, frames=tuple(frames))


def without_objects(frame: Frame, names: Collection[str]) -> Frame:
    """The frame without the pixels of some objects, whose instances it tells."""
    if frame.instance is None or not (gone := [i for i, n in enumerate(frame.names) if n in names]):
        return frame
    hit = np.isin(frame.instance, gone)
    if not hit.any():
        return frame
    return replace(frame, depth=np.where(hit, np.float32(0), frame.depth), instance=np.where(hit, np.int32(-1), frame.instance))


def without_bodies(frame: Frame, bodies: Sequence[Body], axial: float) -> Frame:
    """The frame without the pixels that show these upright bodies, where they are known to stand; axial: the depth's noise at 1 m, see
    `perception.pixels`.
    """
    if not bodies:
        return frame
    points = points_in_camera(frame.depth, frame.intrinsics) @ frame.T_world_camera[:3, :3].T + frame.T_world_camera[:3, 3]
    margin = SPOT_M + 3 * axial * np.asarray(frame.depth, float) ** 2
    hit = np.zeros(frame.depth.shape, bool)
    for body in bodies:
        local = np.abs((points - body.T_world_body[:3, 3]) @ body.T_world_body[:3, :3])
        if isinstance(body.shape, Cylinder):
            off = np.hypot(local[..., 0], local[..., 1])
            hit |= (off < body.shape.radius_m + margin) & (local[..., 2] < body.shape.height_m / 2 + margin)
        elif isinstance(body.shape, Box):
            hit |= (local < body.shape.half + margin[..., None]).all(-1)
    return replace(frame, depth=np.where(hit, np.float32(0), frame.depth))


def observation(empty_scene: Scene, q: Array, belief: Belief) -> Observation:
    """What policies and networks are given."""
    return Observation(
        empty_scene.robot.T_world_base[:3, 3],
        empty_scene.cabinet,
        q,
        empty_scene.x_g,
        empty_scene.target_name,
        empty_scene.approaches,
        belief.boxes,
        region_flags(empty_scene, belief),
    )


def region_flags(empty_scene: Scene, belief: Belief) -> Array:
    """The floor's regions (n², 4): x, y, z of the cell's centre in the world, and 1 where the space over it is known or an object's."""
    voxels, n = belief.voxels, empty_scene.regions_n
    dark = voxels.state == UNKNOWN
    for body in belief.bodies:
        dark &= ~voxels.touched(body)
    low = dark[:, :, : max(1, round(FLAG_HEIGHT_M / voxels.step[2]))].mean(2)
    regions = empty_scene.regions()
    centres = apply(inverse(voxels.T_world_grid), regions)[:, :2]
    half = empty_scene.cabinet.size_m[:2] / n / 2
    first = np.clip(np.floor((centres - half) / voxels.step[:2] + 1e-9), 0, None).astype(int)
    last = np.minimum(np.ceil((centres + half) / voxels.step[:2] - 1e-9).astype(int), low.shape)
    unseen = np.array([low[a[0] : b[0], a[1] : b[1]].mean() for a, b in zip(first, last)])
    return np.column_stack([regions, (unseen <= 1 - FLAG_SHARE).astype(float)])
