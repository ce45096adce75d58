"""Where a gripper's hand frame is, measured: y the way its fingers close, z from the wrist to their tips, the origin between the pads."""

from __future__ import annotations

import numpy as np

from kinematics.robots.hands.find_gripper import THREE, Motors, rigid
from kinematics.robots.hands.hand_model import Model, NoGripper
from kinematics.robots.hands.hull_sections import cross_section
from kinematics.robots.tree import FIXED, SLIDES, TURNS
from kinematics.transforms import Array, inverse, transform

PAD_M, PAD_SHARE = 0.015, 0.35
"""The hand frame is so far behind the finger tips, or by that share of the fingers' length, whichever is less."""
SNAP = np.cos(np.radians(30))
"""An approach that leads as near as that along the wrist's axis, or an axis of the palm's frame, is meant to be along it."""
TOWARD, NEARLY = np.cos(np.radians(60)), 0.7
"""A camera or a motor at a palm's side draws its middle away. So of all axes that lead as near as that the one is meant along which the
fingers reach furthest beyond the palm, if along none that is nearer they reach so large a share of that."""
FLAT = np.cos(np.radians(3))
LEAST_M = 0.003
UPPER_M, ROUND = 0.02, 5.5
"""A hand that reaches so much further (m) to one side, square to the way that two fingers close, is held with that side up (its camera,
mostly) if the last joint turns it so far (rad)."""
HOOK_M = 0.002
"""So much of a fixed jaw's tip may stand before its face: more is a hook, past which nothing comes in along that face."""


def hand_frame(model: Model, motors: Motors) -> Array:
    """T_palm_hand (4, 4), in the frame of the link `motors.palm`. Raises: NoGripper when the fingers don't close on anything."""
    half = _at(model, motors, 0.5)
    y = _closing(model, motors)
    if len(motors.branches) == 1:
        y = _along_pad(model, motors, y, half)
    z = _approach(model, motors, y, half)
    R = np.stack([np.cross(y, z), y, z], -1)
    p = _between(model, motors, R, half)
    return transform(R * [-1.0, -1.0, 1.0] if _is_upside_down(model, motors, R, p) else R, p)


def _is_upside_down(model: Model, motors: Motors, R: Array, p: Array) -> bool:
    """Whether the hand reaches further to where x leads from than to where it leads, which is up as things are held, and the arm can turn
    it round; of two fingers, which are alike: which of them is the first is the URDF's order."""
    wrist = motors.palm
    if len(motors.branches) != 2 or model.tree.kind[wrist] != TURNS or abs(model.tree.axis[wrist] @ R[:, 2]) < SNAP:
        return False
    joint = int(model.tree.q_index[wrist])
    x = (model.points(rigid(model, wrist), model.rest, wrist) - p) @ R[:, 0]
    return bool(model.upper[joint] - model.lower[joint] > ROUND) and len(x) > 0 and -float(x.min()) > float(x.max()) + UPPER_M


def _at(model: Model, motors: Motors, opening: float) -> Array:
    """Joints (J,) with the fingers at a share of their way from closed to open."""
    low, high = motors.limits
    first = low + (high - low) * (opening if motors.opens_upwards else 1 - opening)
    q = model.rest.copy()
    q[motors.first] = first
    for j, (rate, offset) in motors.followers.items():
        q[j] = rate * first + offset
    return q


def _closing(model: Model, motors: Motors) -> Array:
    """The way (3,) that the first finger opens against the other, square to the joints' axis where they turn."""
    shut, wide = _at(model, motors, 0.05), _at(model, motors, 0.25)
    moved = []
    for finger in motors.branches:
        before, after = (model.points(finger, q, motors.palm) for q in (shut, wide))
        tips = slice(None)
        if len(motors.branches) == 1:  # a jaw's tip tells the way, not what lies at its hinge
            reach = np.linalg.norm(before - _origin(model, motors, finger[0], shut), axis=1)
            tips = reach > 0.6 * reach.max()
        moved.append((after - before)[tips].mean(0))
    way = moved[0] - moved[1] if len(moved) > 1 else moved[0]
    axis = _axis(model, motors)
    if axis is not None:
        way = way - (way @ axis) * axis
    size = float(np.linalg.norm(way))
    if size < 1e-5:
        names = ", ".join(model.joints[j] for j in (motors.first, *motors.followers))
        raise NoGripper(f"no gripper that can be used: the joints {names} don't move fingers against each other")
    return np.asarray(way / size)


def _along_pad(model: Model, motors: Motors, y: Array, q: Array) -> Array:
    """The way a jaw closes, square to the largest face of what it closes on that looks that way, if there is one; past which things come
    in, if there is one: nothing further out stands before it."""
    poses, axis = model.tree.poses(q), _axis(model, motors)
    fixed = {model.tree.names[i] for i in rigid(model, motors.palm)}
    jaw = model.points(motors.branches[0], q, motors.palm)
    out = np.cross(axis, y) if axis is not None else np.zeros(3)
    out = out if (jaw - _origin(model, motors, motors.branches[0][0], q)).mean(0) @ out > 0 else -out
    placed = [(hull, inverse(poses[motors.palm]) @ poses[model.tree.index[hull.link]]) for hull in model.hulls if hull.link in fixed]
    best, found = (False, 0.0), y
    for hull, T in placed:
        corners = (hull.vertices @ T[:3, :3].T + T[:3, 3])[hull.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        middle = corners.mean(1)
        normal *= np.sign(np.einsum("ij,ij->i", normal, middle - corners.mean((0, 1))))[:, None]
        area = np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
        seen = (normal @ y / area > SNAP) & (middle @ out > np.quantile(jaw @ out, 0.4))
        points = np.concatenate([other.vertices for other, _ in placed if other.link == hull.link]) @ T[:3, :3].T + T[:3, 3]
        for k in np.flatnonzero(seen):
            same = seen & (normal @ normal[k] / area / area[k] > FLAT)
            ahead = points[points @ out > middle[k] @ out]
            free = bool((ahead @ normal[k] / area[k] < middle[k] @ normal[k] / area[k] + HOOK_M).all())
            if (free, area[same].sum()) > best:
                best, found = (free, float(area[same].sum())), normal[same].sum(0)
    if axis is not None:
        found = found - (found @ axis) * axis
    return np.asarray(found / np.linalg.norm(found))


def _axis(model: Model, motors: Motors) -> Array | None:
    """The axis (3,) about which the fingers turn, in the palm's frame; None where they slide. Two that go together may be askew, each to
    its side: theirs is the mean, so that what is held touches both."""
    closing = {motors.first, *motors.followers}  # a finger may stand on a motor that spreads it
    links = [i for i in motors.branches[0] if model.tree.kind[i] != FIXED and int(model.tree.q_index[i]) in closing]
    links = [i for i in links if not set(model.tree.path(i)[:-1]) & set(links)]
    first = links[0]
    if model.tree.kind[first] == SLIDES:
        return None
    poses = model.tree.poses(_at(model, motors, 0.5))
    links = links if motors.kind == THREE else [first]
    axes = np.array([(inverse(poses[motors.palm]) @ poses[i])[:3, :3] @ model.tree.axis[i] for i in links])
    if len(axes) == 1:
        return np.asarray(axes[0])
    axis = (axes * np.sign(axes @ axes[0])[:, None]).mean(0)
    return np.asarray(axis / np.linalg.norm(axis))


def _origin(model: Model, motors: Motors, link: int, q: Array) -> Array:
    poses = model.tree.poses(q)
    return np.asarray((inverse(poses[motors.palm]) @ poses[link])[:3, 3])


def _approach(model: Model, motors: Motors, y: Array, q: Array) -> Array:
    """From the wrist to the finger tips, square to y: along the axis of the fingers' hinges' plane, or the wrist's axis, if it is near."""
    fingers = np.concatenate([model.points(f, q, motors.palm) for f in motors.branches])
    roots = np.array([_origin(model, motors, f[0], q) for f in motors.branches])
    poses = model.tree.poses(q)
    axis = _axis(model, motors)
    if axis is not None:
        far = fingers - roots.mean(0)
        z = np.cross(axis, y)
        reach = far @ z
        return np.asarray(z if reach.max() > -reach.min() else -z)
    carriers = sorted({int(model.tree.parent[f[0]]) for f in motors.branches})
    behind = model.points(carriers, q, motors.palm)
    behind = behind if len(behind) else model.points(rigid(model, motors.palm), q, motors.palm)
    z = fingers.mean(0) - (behind.mean(0) if len(behind) else 0.0)
    z = z - (z @ y) * y
    if np.linalg.norm(z) < LEAST_M:
        z = np.linalg.svd((fingers - fingers.mean(0)) - np.outer((fingers - fingers.mean(0)) @ y, y))[2][0]
    z /= np.linalg.norm(z)
    wrist_axis = model.tree.axis[motors.palm] if model.tree.kind[motors.palm] != FIXED else np.array([0.0, 0.0, 1.0])
    frames = list[Array]()
    for link in [*carriers, *rigid(model, motors.palm), *(i for f in motors.branches for i in f)]:
        frames += list((inverse(poses[motors.palm]) @ poses[link])[:3, :3].T)
    ways = [z]
    for candidate in [*frames[: 3 * len(carriers)], wrist_axis, *frames[3 * len(carriers) :]]:
        flat = candidate - (candidate @ y) * y
        size = np.linalg.norm(flat)
        if size > 0.95 and abs(flat @ z) / size > TOWARD:
            ways.append(flat / size * np.sign(flat @ z))
    beyond = [float((fingers @ way).max() - (behind @ way).max(initial=-np.inf)) for way in ways]
    furthest = int(np.argmax(beyond))
    for way, reach in zip(ways[1:], beyond[1:]):
        if way @ z > SNAP and reach >= NEARLY * beyond[furthest]:
            return np.asarray(way)
    return np.asarray(ways[furthest])


def _between(model: Model, motors: Motors, R: Array, q: Array) -> Array:
    """The middle (3,) between the pads: half-way across, near the tips, in the middle of what both fingers have there."""
    sides = [model.points(f, q, motors.palm) @ R for f in motors.branches]
    if len(sides) == 1:
        fixed = model.points(rigid(model, motors.palm), q, motors.palm) @ R
        pad = _facing(fixed, sides[0])
        if not len(pad):
            raise NoGripper(f"no gripper that can be used: the jaw {model.tree.names[motors.branches[0][0]]!r} closes on nothing")
        sides.append(pad)
    tip = min(float(side[:, 2].max()) for side in sides)
    root = max(float(np.quantile(side[:, 2], 0.02)) for side in sides)
    z = tip - min(PAD_M, PAD_SHARE * max(tip - root, LEAST_M))
    near = [side[side[:, 2] > tip - 2 * PAD_M] for side in sides]
    ranges = [(float(side[:, 0].min()), float(side[:, 0].max())) for side in near if len(side)]
    low, high = max(r[0] for r in ranges), min(r[1] for r in ranges)
    x = (low + high) / 2
    inner = _inner(model, motors, R, q, x, z)
    return np.asarray(R @ np.array([x, inner, z]))


def _facing(fixed: Array, jaw: Array) -> Array:
    """Of the points (V, 3) of what a jaw is hinged to, those that lie as far out as its tip."""
    if not len(fixed):
        return fixed
    reach = jaw[:, 2].max() - 0.3 * np.ptp(jaw[:, 2])
    return np.asarray(fixed[fixed[:, 2] > min(reach, fixed[:, 2].max() - LEAST_M)])


def _inner(model: Model, motors: Motors, R: Array, q: Array, x: float, z: float) -> float:
    """The middle, along y, of the gap between both sides at one place: half-way between the inner faces."""
    poses, names = model.tree.poses(q), model.tree.names
    back = transform(R.T) @ inverse(poses[motors.palm])
    first = {names[i] for i in motors.branches[0]}
    second = {names[i] for i in (motors.branches[1] if len(motors.branches) > 1 else rigid(model, motors.palm))}
    heights = z + np.linspace(-0.01, 0.01, 21)
    plus, minus = [np.inf], [-np.inf]
    for hull in model.hulls:
        if hull.link in first | second:
            T = back @ poses[model.tree.index[hull.link]]
            points = hull.vertices @ T[:3, :3].T + T[:3, 3]
            # of three fingers two stand beside the middle, where nothing crosses them
            places = [x] if motors.kind != THREE else np.linspace(points[:, 0].min(), points[:, 0].max(), 5)[1:-1]
            for place in places:
                low, high = cross_section(points - [place, 0.0, 0.0], hull.faces, heights)
                if np.isfinite(low).any():
                    (plus if hull.link in first else minus).append(float(np.nanmin(low) if hull.link in first else np.nanmax(high)))
    if not (np.isfinite(min(plus)) and np.isfinite(max(minus))):
        raise NoGripper(f"no gripper that can be used: nothing faces {names[motors.branches[0][0]]!r} between the finger tips")
    return float(min(plus) + max(minus)) / 2
