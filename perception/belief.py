"""What is believed of a scene after looking at it: an upright solid and a box for every object, the floor's regions with their flags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from kinematics.scene import Body, Scene, object_box
from kinematics.transforms import Array, apply, inverse
from perception.frames import Frame
from perception.fusion import prepare
from perception.grouping import told_apart
from perception.observation import Observation
from perception.segment import grown, match, object_pixels, standing_boxes
from perception.solids import standing_solids
from perception.voxels import UNKNOWN, Voxels

FLAG_SHARE, FLAG_HEIGHT_M = 0.95, 0.05  # a region counts as observed when so much of the space up to this height over it is known
POINT_M = 0.03  # the grasp stands for a box of this size where no target box is given


@dataclass(frozen=True, eq=False)
class Belief:
    """bodies: upright solids, to plan with. boxes: name to the paper's box (6,), centre and size, grown into what is hidden."""

    bodies: tuple[Body, ...]
    boxes: Mapping[str, Array]
    voxels: Voxels

    def body(self, name: str) -> Body | None:
        return next((b for b in self.bodies if b.name == name), None)


def believe(
    blank: Scene,
    frames: Sequence[Frame],
    voxels: Voxels,
    *,
    by: Literal["mask", "geometry"] = "mask",
    target_box: Array | None = None,
    tracked: Mapping[str, Body] | None = None,
) -> Belief:
    """Find the objects in the frames.

    by: see `perception.segment`. target_box (6,): where the target is, centre and size in the world; by geometry, without it, the target is
    what the scene's grasp reaches for. tracked: objects that the arm has moved, where they stand now; the frames are not asked about them.
    """
    tracked = tracked or {}
    views = prepare([_without(f, tracked) for f in frames] if by == "mask" else list(frames), blank.cabinet)
    views = views if by == "mask" else told_apart(views)
    shown = object_pixels(views)
    solids = standing_solids(views, shown, blank.cabinet)
    boxes = {name: grown(box, voxels) for name, box in standing_boxes(views, shown, solids, blank.cabinet).items()}
    if target_box is not None or by == "geometry":
        wanted = np.append(blank.grasp.T_world_hand[:3, 3], [POINT_M] * 3) if target_box is None else target_box
        chosen = match(boxes, wanted)
        names = {chosen: blank.target, blank.target: chosen} if chosen is not None else {blank.target: f"{blank.target}_other"}
        solids = tuple(replace(b, name=names.get(b.name, b.name) or b.name) for b in solids)
        boxes = {names.get(n, n) or n: b for n, b in boxes.items()}
    bodies = [*solids, *tracked.values()]
    return Belief(tuple(bodies), {**boxes, **{n: object_box(b) for n, b in tracked.items()}}, voxels)


def _without(frame: Frame, names: Mapping[str, Body]) -> Frame:
    """The frame without the pixels of some objects."""
    if frame.instance is None or not (gone := [i for i, n in enumerate(frame.names) if n in names]):
        return frame
    hit = np.isin(frame.instance, gone)
    return replace(frame, depth=np.where(hit, np.float32(0), frame.depth), instance=np.where(hit, np.int32(-1), frame.instance))


def observation(blank: Scene, q: Array, belief: Belief) -> Observation:
    """What policies and networks are given."""
    return Observation(
        blank.robot.T_world_base[:3, 3],
        blank.cabinet,
        q,
        blank.grasp,
        blank.target,
        blank.approaches,
        belief.boxes,
        region_flags(blank, belief),
    )


def region_flags(blank: Scene, belief: Belief) -> Array:
    """The floor's regions (n², 4): x, y, z of the cell's centre in the world, and 1 where the space over it is known or an object's."""
    voxels, n = belief.voxels, blank.regions_n
    dark = voxels.state == UNKNOWN
    for body in belief.bodies:
        dark &= ~voxels.touched(body)
    low = dark[:, :, : max(1, round(FLAG_HEIGHT_M / voxels.step[2]))].mean(2)
    regions = blank.regions()
    centres = apply(inverse(voxels.T_world_grid), regions)[:, :2]
    half = blank.cabinet.size_m[:2] / n / 2
    first = np.clip(np.floor((centres - half) / voxels.step[:2] + 1e-9), 0, None).astype(int)
    last = np.minimum(np.ceil((centres + half) / voxels.step[:2] - 1e-9).astype(int), low.shape)
    unseen = np.array([low[a[0] : b[0], a[1] : b[1]].mean() for a, b in zip(first, last)])
    return np.column_stack([regions, (unseen <= 1 - FLAG_SHARE).astype(float)])
