"""Objects from views: fused points, told apart by masks or by geometry alone, and one axis-aligned box an object (paper, section III-B).

Points live in the cabinet's frame until the boxes are taken, which are aligned with the world's axes. Everything stands on
the floor, or on something that does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from kinematics.scene import Body, Cabinet, object_box
from kinematics.transforms import Array, inverse
from perception.frames import Frame
from perception.mapping.hidden_layers import hidden_layers
from perception.objects.clustering import CELL_M, cluster_instances
from perception.objects.fit import standing_solids
from perception.objects.instance_points import count_instances, take_points
from perception.objects.prepared_frames import PreparedFrames, prepare
from perception.objects.supports import base_heights

if TYPE_CHECKING:
    from perception.mapping.voxels import Voxels

Int = NDArray[np.int64]
BEFORE_M = 0.02
"""What ends further before the cabinet's open side than this stands before it, and is none of its objects."""
FEWEST_PIXELS = 20
"""What fewer pixels show is no object but noise."""
GROWN_M = 0.06
"""A box grows into hidden space until it is as large as that, or as the longer of its seen sides."""


def segment(
    frames: Sequence[Frame], cabinet: Cabinet, voxels: Voxels | None = None, *, by: Literal["mask", "geometry"] = "mask"
) -> dict[str, Array]:
    """The objects that the frames show, all of one and the same moment: name to centre and size (6,) of a box in the world.

    The box is the tightest around the object's points, down to the floor, or around the solid that fits them best if they are noisy; with
    a map it is `grown` into what nobody has seen.
    by: "mask" trusts the frames' instances and takes their names; "geometry" finds objects itself and calls them object_0, object_1, …
    from the front to the back. Raises: ValueError when masks are asked for and a frame has none, for depths without surfaces, where
    geometry alone must decide, and for another word.
    """
    if by not in ("mask", "geometry"):
        raise ValueError(f"objects can be told apart by mask or by geometry, not by {by!r}")
    views = prepare(frames if by == "mask" else [replace(f, instance=None, names=()) for f in frames], cabinet)
    views = views if by == "mask" else cluster_instances(views)
    shown = object_pixels(views)
    bases = base_heights({name: points for name, (points, _) in shown.items()})
    boxes = standing_boxes(views, shown, standing_solids(views, shown, bases, cabinet) if views.axial > 0 else (), bases, cabinet)
    return boxes if voxels is None else {name: grown(box, voxels) for name, box in boxes.items()}


def object_points(views: PreparedFrames) -> dict[str, Array]:
    """The points (N, 3) of each instance in the cabinet's frame, from all frames; stray ones are dropped, and what shows too little.

    Raises: ValueError when a frame has no instances.
    """
    return {name: points for name, (points, _) in object_pixels(views).items()}


def object_pixels(views: PreparedFrames) -> dict[str, tuple[Array, Int]]:
    """The same, and for each point the frame and the pixel (N, 2) that show it; pixels are counted row by row."""
    sizes, instances = dict[str, int](), []
    for i, (frame, inside) in enumerate(zip(views.frames, views.inside)):
        if frame.instance is None:
            raise ValueError(f"frame {i} has no mask: objects can't be told apart by masks, only by geometry")
        instances.append(np.ascontiguousarray(frame.instance, np.int32))
        counts = np.zeros(len(frame.names), np.int64)
        count_instances(inside, instances[-1], counts)
        for name, n in zip(frame.names, counts.tolist()):
            if n:
                sizes[name] = sizes.get(name, 0) + n
    ends = np.cumsum([0, *sizes.values()])
    free, number = ends[:-1].copy(), {name: k for k, name in enumerate(sizes)}
    cloud, pixels = np.empty((ends[-1], 3)), np.empty((ends[-1], 2), np.int64)
    for i, (frame, inside, points, instance) in enumerate(zip(views.frames, views.inside, views.points, instances)):
        places = np.array([number.get(name, -1) for name in frame.names], np.int64)
        take_points(i, inside, instance, points, places, free, cloud, pixels)
    out = {}
    for name, first, end in zip(sizes, ends, ends[1:]):
        dense = lie_densely(cloud[first:end])
        if np.count_nonzero(dense) >= FEWEST_PIXELS and cloud[first:end, 0][dense].max() > -BEFORE_M:
            out[name] = (cloud[first:end][dense], pixels[first:end][dense])
    return out


def lie_densely(points: Array, share: float = 0.03) -> NDArray[np.bool_]:
    """Which (N,) points (N, 3) lie densely: in whose 3 × 3 × 3 cells around are at least `share` of the cloud's usual number, and three.

    Pixels at a silhouette may measure a depth between the object and what is behind it; those lie thinly in the air.
    """
    if len(points) < FEWEST_PIXELS:
        return np.zeros(len(points), bool)
    columns = points.T.copy()  # a row a coordinate: far quicker to reduce
    cell = np.floor((columns - columns.min(1, keepdims=True)) / CELL_M).astype(np.int64)
    shape = cell.max(1) + 1
    flat = np.ravel_multi_index(tuple(cell), shape)
    count = np.bincount(flat, minlength=int(np.prod(shape))).reshape(shape)
    around = ndimage.uniform_filter(count.astype(np.float32), 3, mode="constant").ravel()[flat] * 27
    return np.asarray(around >= max(3.0, share * float(np.median(around))) - 0.5)


def standing_boxes(
    views: PreparedFrames, shown: Mapping[str, tuple[Array, Int]], solids: Sequence[Body], bases: Mapping[str, float], cabinet: Cabinet
) -> dict[str, Array]:
    """The box (6,) in the world of each object; of noisy pixels that of its solid. bases: see `standing_solids`."""
    if views.axial > 0:
        return {body.name: object_box(body) for body in solids}
    return {name: standing_box(points, cabinet, bases[name]) for name, (points, _) in shown.items()}


def standing_box(points: Array, cabinet: Cabinet, base_m: float = 0.0) -> Array:
    """Centre and size (6,) of the tightest box in the world around points (N, 3) of the cabinet and their feet, base_m over its floor."""
    R, columns = cabinet.T_world_cabinet[:3, :3], points.T.copy()
    above, feet = R @ columns, R[:, :2] @ columns[:2] + base_m * R[:, 2:]
    origin = cabinet.T_world_cabinet[:3, 3]
    low = np.minimum(above.min(1), feet.min(1)) + origin
    high = np.maximum(above.max(1), feet.max(1)) + origin
    return np.concatenate([(low + high) / 2, high - low])


def grown(box: Array, voxels: Voxels) -> Array:
    """A box (6,) of the world, extended into the unknown space beside and above it.

    A side gives way layer by layer, a voxel each, until a fifth of the layer is free, half of it is somebody else's surface, or a wall
    comes. Things are taken for upright and about as deep as wide: along x and y the box grows no further than its longer seen side, or
    GROWN_M if that is more, to both sides alike where both are hidden; upwards by GROWN_M at most. One or two layers are only the map's
    own coarseness and no reason to grow.
    """
    low, high = box[:3] - box[3:] / 2, box[:3] + box[3:] / 2
    step = float(voxels.step.max())
    widest, T_grid_world = max(float(box[3:5].max()), GROWN_M), inverse(voxels.T_world_grid)
    for axis in range(3):
        room = widest - box[3 + axis] if axis < 2 else GROWN_M
        layers = int(np.ceil(max(room, 0.0) / step))
        runs = [
            0.0 if axis == 2 and side < 0 else step * hidden_layers(voxels.state, voxels.step, T_grid_world, low, high, axis, side, layers)
            for side in (-1, 1)
        ]
        first = min(runs[0], max(room / 2, room - runs[1]))
        low[axis] -= max(first, 0.0)
        high[axis] += max(min(runs[1], room - first), 0.0)
    return np.concatenate([(low + high) / 2, high - low])


def iou(a: Array, b: Array) -> float:
    """The volume that two boxes (6,) share, of the volume of both."""
    low = np.maximum(a[:3] - a[3:] / 2, b[:3] - b[3:] / 2)
    high = np.minimum(a[:3] + a[3:] / 2, b[:3] + b[3:] / 2)
    common = float(np.prod(np.clip(high - low, 0, None)))
    return common / max(float(np.prod(a[3:]) + np.prod(b[3:])) - common, 1e-12)


def match(boxes: Mapping[str, Array], box: Array) -> str | None:
    """The name of the box that has most in common with `box` (6,), by volume; None when none touches it."""
    best = max(boxes, key=lambda name: iou(boxes[name], box), default=None)
    return best if best is not None and iou(boxes[best], box) > 0 else None
