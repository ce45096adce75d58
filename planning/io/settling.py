"""Pose noise is no mistake: what stands a little in the floor, in a wall or in its neighbour is lifted or parted, and it is told.

What touches something is parted by a little more than motions must keep, too: a hand lifts nothing out of a touch, and poses that are told
to the millimetre touch often. What stands on an object or an obstacle is lifted by as much; on the floor it may touch.

What is invalid is refused in a message that names the object, the amount and the likely cause: an object that floats, stands outside
the cabinet or deep in something, sizes or positions in millimetres. Objects that a camera saw (source "seen") are left as they were fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.collision.fcl_solids import Contact, Solid, depth, gap, overlapping, shape_solids
from kinematics.scene import WALLS, Body, Cabinet, Scene, Settlement
from kinematics.shapes import ConvexMesh, bounds
from kinematics.transforms import Array, apply, inverse, transform
from perception.objects.settle import GAP_M

NOISE_M = 0.002
"""So much overlap, or air below an object, is noise of its pose."""
LEAST_M = 5e-5
"""Less than this is left as it is."""
WEDGED_M = 0.001
"""So much overlap is left where there is no room to part two objects."""
ROUNDS = 100
ROOM_ROUNDS = 30
ROOM_M = GAP_M
"""Things that are nearer are parted, for no motion can be certified between them; what stands may have a gap of 1 mm, says the verdict."""
HUGE_M, TINY_M, FAR_M = 5.0, 0.002, 20.0
"""What is longer or shorter than this, or further from the cabinet, is no object in it: units were confused."""
ROOMY_M, TIGHT_M, THICK_M = 10.0, 0.02, 1.0
"""What is larger or smaller than this inside, or has thicker walls, is no cabinet before an arm."""


class Unsettled(ValueError):
    """A scene that is invalid. body: the object that is to blame; None: the cabinet."""

    def __init__(self, body: str | None, message: str) -> None:
        super().__init__(message)
        self.body = body


@dataclass(frozen=True, eq=False)
class _Moved:
    """How far an object was moved in the cabinet's frame (3,), and why."""

    by: Array
    reasons: tuple[str, ...] = ()


def settle(scene: Scene, noise_m: float = NOISE_M) -> Scene:
    """The scene with its objects standing free of each other and on something; `Scene.settled` says what was moved.

    noise_m: how much is taken for noise. The target moves last, for x_g is told for where it stands, and goes along where it touches.
    Raises: Unsettled for what is invalid.
    """
    _check_cabinet(scene.cabinet)
    for body in scene.objects:
        _check_units(scene, body)
        if body.source == "given":
            _check_inside(scene, body, noise_m)
    moved: dict[str, _Moved] = {}
    objects = {b.name: b for b in scene.objects}
    for body in scene.objects:
        if body.source == "given":
            _stand(scene, objects, body, noise_m, moved)
    if _close(scene, objects):
        _part(scene, objects, noise_m, moved)
        if noise_m >= ROOM_M:
            scene = _make_room(scene, objects, noise_m, moved)
    if not moved:
        return scene
    R = scene.cabinet.T_world_cabinet[:3, :3]
    settled = tuple(Settlement(name, R @ m.by, "; ".join(dict.fromkeys(m.reasons))) for name, m in moved.items())
    return replace(scene, objects=tuple(objects[b.name] for b in scene.objects), settled=settled)


# What is invalid --------------------------------------------------------------------------------------------------------------------------


def _check_cabinet(cabinet: Cabinet) -> None:
    for size, what in zip(cabinet.size_m, ("deep", "wide", "high")):
        if size > ROOMY_M:
            raise Unsettled(None, f"the cabinet is {size:.4g} m {what}: are its sizes in centimetres or millimetres? they are metres")
        if size < TIGHT_M:
            raise Unsettled(None, f"the cabinet is {1000 * size:.3g} mm {what}: are its sizes metres?")
    if cabinet.wall_m > THICK_M:
        raise Unsettled(None, f"the cabinet's walls are {cabinet.wall_m:.4g} m thick: is wall_m in millimetres? it is metres")


def _check_units(scene: Scene, body: Body) -> None:
    low, high = bounds(body.shape, body.T_world_body)
    longest, away = float(2 * body.shape.half.max()), float(np.linalg.norm((low + high) / 2 - scene.cabinet.T_world_cabinet[:3, 3]))
    mesh = isinstance(body.shape, ConvexMesh)
    if longest > HUGE_M:
        cause = 'is the mesh in millimetres? "scale": 0.001' if mesh else "are its sizes in millimetres? they are metres"
        raise Unsettled(body.name, f"{body.name!r} is {longest:.4g} m long: {cause}")
    if longest < TINY_M:
        cause = "is its scale right, or applied twice?" if mesh else "are its sizes metres?"
        raise Unsettled(body.name, f"{body.name!r} is {1000 * longest:.3g} mm long: {cause}")
    if away > FAR_M:
        raise Unsettled(body.name, f"{body.name!r} is {away:.4g} m away from the cabinet: is its position in millimetres? it is metres")


def _check_inside(scene: Scene, body: Body, noise_m: float) -> None:
    """An object's middle must be in the cabinet."""
    corners, size = _bounds(scene, body), scene.cabinet.size_m
    middle = (corners[0] + corners[1]) / 2
    low, high = np.array([0.0, -size[1] / 2, 0.0]), np.array([size[0], size[1] / 2, size[2]])
    words = (("in front of", "behind"), ("to the right of", "to the left of"), ("below", "above"))
    below, above = low - middle, middle - high
    k = int(np.argmax(np.maximum(below, above)))
    amount, where = (float(below[k]), words[k][0]) if below[k] > above[k] else (float(above[k]), words[k][1])
    if amount <= noise_m:
        return
    told = np.sum(bounds(body.shape, body.T_world_body), axis=0) / 2
    meant = bool(((told > low) & (told < high)).all())
    cause = "; is its pose told in the cabinet's frame? poses are in the world" if meant else ""
    raise Unsettled(body.name, f"{body.name!r} stands outside: its middle is {1000 * amount:.0f} mm {where} the cabinet{cause}")


# Lifting and parting ----------------------------------------------------------------------------------------------------------------------


def _stand(scene: Scene, objects: dict[str, Body], body: Body, noise_m: float, moved: dict[str, _Moved]) -> None:
    """Put an object onto the floor that it stands a little in or above. Raises Unsettled when it is deep in the floor, or floats."""
    low, high = _bounds(scene, body)
    height = float(low[2])
    if abs(height) <= LEAST_M:
        return
    if height < -noise_m:
        half = (high[2] - low[2]) / 2
        cause = "; is its position that of its bottom? a shape's origin is its middle" if abs(height + half) <= noise_m else "; move it up"
        raise Unsettled(body.name, f"{body.name!r} overlaps the cabinet's wall 'floor' by {-1000 * height:.1f} mm{cause}")
    if height > 0 and _carried(scene, objects, body, noise_m):
        return
    if height > noise_m:
        below = _below(scene, objects, body, height)
        near = "" if below is None else f", {1000 * below[1]:.1f} mm above {below[0]!r}"
        raise Unsettled(
            body.name, f"{body.name!r} floats {1000 * height:.1f} mm above the floor{near}, and nothing carries it; move it down"
        )
    why = f"it stood {-1000 * height:.1f} mm in the floor" if height < 0 else f"it floated {1000 * height:.1f} mm above the floor"
    _move(scene, objects, body.name, np.array([0.0, 0.0, -height]), why, moved)


def _below(scene: Scene, objects: Mapping[str, Body], body: Body, height_m: float) -> tuple[str, float] | None:
    """What an object that floats would come to stand on if it were lowered, above the floor, and how far below it that is."""
    T, solids = scene.cabinet.T_world_cabinet, [s.move(body.T_world_body) for s in shape_solids(body.name, body.shape)]
    found = []
    for other in (*objects.values(), *scene.obstacles):
        if other.name != body.name:
            still = [s.move(other.T_world_body) for s in shape_solids(other.name, other.shape)]
            away = min(gap(a, b, height_m) for a in solids for b in still)
            down = T @ transform(p=[0.0, 0.0, -away - LEAST_M]) @ inverse(T)
            if away < height_m and overlapping([other, replace(body, T_world_body=down @ body.T_world_body)], 0.0):
                found.append((other.name, away))
    return min(found, key=lambda near: near[1], default=None)


def _carried(scene: Scene, objects: Mapping[str, Body], body: Body, noise_m: float) -> bool:
    """Whether an object stands on another, or on an obstacle: lowered by the noise it is deeper in it."""
    others = [b for b in (*objects.values(), *scene.obstacles) if b.name != body.name]
    T = scene.cabinet.T_world_cabinet
    down = T @ transform(p=[0.0, 0.0, -noise_m - LEAST_M]) @ inverse(T)

    def deepest(b: Body) -> float:
        return max((c.depth_m for c in overlapping([*others, b], 0.0) if b.name in (c.a, c.b)), default=0.0)

    return deepest(replace(body, T_world_body=down @ body.T_world_body)) > deepest(body) + LEAST_M / 2


def _part(scene: Scene, objects: dict[str, Body], noise_m: float, moved: dict[str, _Moved]) -> None:
    """Part what overlaps a little. Raises Unsettled for what overlaps by more than noise, or can't be parted."""
    contacts = _contacts(scene, objects)
    for _ in range(ROUNDS):
        if not contacts:
            return
        if contacts[0].depth_m > noise_m and not moved.keys() & {contacts[0].a, contacts[0].b}:
            raise _overlap(scene, contacts[0])
        for contact in contacts:
            _part_two(scene, objects, contact, moved)
        contacts = _contacts(scene, objects)
    if contacts and contacts[0].depth_m > WEDGED_M:
        raise _overlap(scene, contacts[0], ": there is no room to part them")


def _make_room(scene: Scene, objects: dict[str, Body], noise_m: float, moved: dict[str, _Moved]) -> Scene:
    """Part what touches, or nearly does, in groups of neighbours: all of a group, or none where there is no room for all, or where one
    would go further than its pose may be wrong. Where the target gives way its grasps do, too: in the scene that comes back."""
    for group in _groups(_close(scene, objects)):
        trial, shifts = dict(objects), dict[str, _Moved]()
        for _ in range(ROOM_ROUNDS):
            close = [c for c in _close(scene, trial) if {c.a, c.b} & group and c.b != "ceiling"]
            if not close:
                break
            for contact in close:
                _part_two(scene, trial, contact, shifts, room_m=ROOM_M)
        if close or any(np.linalg.norm(m.by[:2]) > noise_m for m in shifts.values()):
            continue
        for name, m in shifts.items():
            _move(scene, objects, name, m.by, moved[name].reasons[-1] if name in moved else m.reasons[0], moved)
            if name == scene.target:
                scene = _with_grasps_moved(scene, scene.cabinet.T_world_cabinet[:3, :3] @ m.by)
    return scene


def _with_grasps_moved(scene: Scene, by_m: Array) -> Scene:
    """The scene with the target's grasps moved by (3,) in the world."""
    T = transform(p=by_m)
    grasp = scene.grasp and replace(scene.grasp, T_world_hand=T @ scene.grasp.T_world_hand)
    return replace(scene, grasp=grasp, grasps=tuple((replace(g, T_world_hand=T @ g.T_world_hand), score) for g, score in scene.grasps))


def _close(scene: Scene, objects: Mapping[str, Body]) -> list[Contact]:
    """What overlaps or touches, or nearly does; but for the floor, which what stands on it may touch."""
    return _contacts(scene, objects, LEAST_M - ROOM_M, but="floor")


def _groups(contacts: Sequence[Contact]) -> list[set[str]]:
    """The names of neighbours that hang together by contacts."""
    groups = list[set[str]]()
    for contact in contacts:
        touched = [group for group in groups if group & {contact.a, contact.b}]
        groups = [group for group in groups if group not in touched] + [set[str]().union({contact.a, contact.b}, *touched)]
    return groups


def _contacts(scene: Scene, objects: Mapping[str, Body], tolerance_m: float = LEAST_M, but: str | None = None) -> list[Contact]:
    """What overlaps by more than the tolerance, deepest first, the object first; below 0: or is apart by less. Fixtures among themselves
    are no concern, nor what a camera saw, nor the fixture `but`."""
    still = {b.name for b in scene.fixtures()}
    skip = still | {b.name for b in objects.values() if b.source == "seen"}
    found = []
    for c in overlapping([*(b for b in scene.fixtures() if b.name != but), *objects.values()], tolerance_m):
        a, b = (c.a, c.b) if c.a not in still else (c.b, c.a)
        if a not in skip and not (b in skip and b not in still):
            found.append(Contact(a, b, c.depth_m))
    return found


def _part_two(scene: Scene, objects: dict[str, Body], contact: Contact, moved: dict[str, _Moved], *, room_m: float = 0.0) -> None:
    """Move an object out of another, or both by half, along the shortest level way; or up, where that is much shorter. room_m: how far
    apart they are to be."""
    body = objects[contact.a]
    other = objects.get(contact.b) or next(b for b in scene.fixtures() if b.name == contact.b)
    way = _shortest_way(scene, other, body, room_m)
    share = 1.0 if contact.b not in objects else 0.0 if contact.a == scene.target else 1.0 if contact.b == scene.target else 0.5
    if abs(way[2]) > 0:  # one stands on the other: the upper one is lifted
        share = 1.0 if way[2] > 0 or contact.b not in objects else 0.0
    for name, by, neighbour in ((contact.a, share * way, contact.b), (contact.b, (share - 1) * way, contact.a)):
        if np.abs(by).max() > 0:
            _move(scene, objects, name, by, _why(neighbour, contact.depth_m), moved)


def _why(neighbour: str, depth_m: float) -> str:
    """Why an object gives way to a neighbour."""
    if abs(depth_m) <= LEAST_M:
        return f"it touched {neighbour}"
    return f"it overlapped {neighbour} by {1000 * depth_m:.1f} mm" if depth_m > 0 else f"it stood {-1000 * depth_m:.1f} mm from {neighbour}"


def _shortest_way(scene: Scene, still: Body, body: Body, room_m: float) -> Array:
    """The shortest shift (3,) in the cabinet's frame that takes `body` out of `still`, and room_m away: level, or straight up or down."""
    T_cabinet = inverse(scene.cabinet.T_world_cabinet)
    best: tuple[float, Array] = (np.inf, np.zeros(3))
    for a in (s.move(T_cabinet @ still.T_world_body) for s in shape_solids(still.name, still.shape)):
        for b in (s.move(T_cabinet @ body.T_world_body) for s in shape_solids(body.name, body.shape)):
            if (depth(a, b) is not None) if room_m == 0 else gap(a, b, room_m) < room_m:
                best = min(best, _way_out(a, b), key=lambda way: way[0])
    length, along = best
    return np.asarray((length + room_m + LEAST_M / 10) * along) if np.isfinite(length) else np.zeros(3)


def _way_out(still: Solid, solid: Solid) -> tuple[float, Array]:
    """How far, and along which direction (3,), a solid must move to be beside, above or below another."""
    normals = np.concatenate([still.normals @ still.T[:3, :3].T, -solid.normals @ solid.T[:3, :3].T])
    flat = normals[:, :2][np.linalg.norm(normals[:, :2], axis=1) > 0.1]
    level = np.c_[flat / np.linalg.norm(flat, axis=1)[:, None], np.zeros(len(flat))]
    ways = np.concatenate([level, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    lengths = (apply(still.T, still.vertices) @ ways.T).max(0) - (apply(solid.T, solid.vertices) @ ways.T).min(0)
    best = int(np.argmin(lengths))
    return float(lengths[best]), ways[best]


def _move(scene: Scene, objects: dict[str, Body], name: str, by: Array, why: str, moved: dict[str, _Moved]) -> None:
    """Move an object by (3,) in the cabinet's frame, and note it."""
    T = objects[name].T_world_body.copy()
    T[:3, 3] += scene.cabinet.T_world_cabinet[:3, :3] @ by
    objects[name] = replace(objects[name], T_world_body=T)
    before = moved.get(name, _Moved(np.zeros(3)))
    moved[name] = _Moved(before.by + by, (*before.reasons, why))


def _overlap(scene: Scene, contact: Contact, more: str = "; move one of them") -> Unsettled:
    obstacles: Sequence[str] = [b.name for b in scene.obstacles]
    what = "the cabinet's wall " if contact.b in WALLS else "the obstacle " if contact.b in obstacles else ""
    return Unsettled(contact.a, f"{contact.a!r} overlaps {what}{contact.b!r} by {1000 * contact.depth_m:.1f} mm{more}")


def _bounds(scene: Scene, body: Body) -> tuple[Array, Array]:
    """The tightest box (3,), (3,) around a body along the cabinet's axes, in the cabinet's frame."""
    return bounds(body.shape, inverse(scene.cabinet.T_world_cabinet) @ body.T_world_body)
