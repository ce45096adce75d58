"""Whether two pads hold a body: both touch it, face it within the friction cone, and overlap it enough. All in closed form.

A pad's face is a window that looks at the body. How near the body comes within the window is the gap; what of it comes almost as near is
the patch of contact. A hold needs a line between both patches that lies in both friction cones (two-finger force closure: Nguyen,
Constructing force-closure grasps, 1988), and patches too wide to be an edge that the body would turn about.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array, cross, inverse
from planning.verdict import polygons
from planning.verdict.cup import cup_faults
from planning.verdict.faults import Fault, Settings
from planning.verdict.hand import Pad
from planning.verdict.polyhedra import Polyhedron, Window, nearest_in_window, section_below

SLACK_M = 1e-9  # that a corner may be elsewhere by another order of sums
PATCH_M = 0.001  # what comes within so much of the nearest point belongs to the patch: rubber gives way


@dataclass(frozen=True, eq=False)
class Touch:
    """One pad at a body: gap_m along the face's normal, negative where the body is that deep in the pad; the normal (3,) of the contact,
    from the pad into the body; the patch's corners (N, 3) on the pad's face, both in the frame that was asked for; and how wide it is."""

    gap_m: float
    normal: Array
    patch: Array
    width_m: float


def touch(pad: Pad, T_frame_face: Array, body: Sequence[Polyhedron], T_frame_body: Array) -> Touch | None:
    """How a pad is at a body of convex parts; None when no part lies before the pad's face.

    T_frame_face, T_frame_body (4, 4): both in one frame, in which the answer is given.
    """
    T_face_body = inverse(T_frame_face) @ T_frame_body
    seen, least = list[tuple[float, int, Array, Polyhedron]](), np.inf
    for lowest, i in _over(body, T_face_body, pad.window):
        if lowest > least + PATCH_M:
            break  # what is left is neither the nearest nor in the patch
        part = body[i].moved(T_face_body)
        near = nearest_in_window(part, pad.window)
        if near is not None and part.high[2] > 0:
            seen.append((near[0], i, near[1], part))
            least = min(least, near[0])
    if not seen:
        return None
    gap, _, normal, _ = min(seen, key=lambda s: s[:2])
    reached = [section_below(part, gap + PATCH_M) for z, _, _, part in seen if z <= gap + PATCH_M]
    patch = polygons.clip(polygons.hull(np.concatenate(reached)), pad.window.corners)
    R, p = T_frame_face[:3, :3], T_frame_face[:3, 3]
    return Touch(gap, R @ -normal, patch @ R[:, :2].T + p, polygons.least_width(polygons.hull(patch)))


def _over(body: Sequence[Polyhedron], T_face_body: Array, window: Window) -> list[tuple[float, int]]:
    """The numbers of a body's parts that may be over a window, by how low their lowest corners are."""
    if len(body) == 1:
        return [(-np.inf, 0)]
    corners, starts = _corners(tuple(body))
    at = corners @ T_face_body[:3, :3].T + T_face_body[:3, 3]
    low, high = np.minimum.reduceat(at, starts) - SLACK_M, np.maximum.reduceat(at, starts) + SLACK_M
    beside = (high[:, :2] < window.corners.min(0)) | (low[:, :2] > window.corners.max(0))
    near = ~beside.any(1) & (high[:, 2] > 0.0)
    return [(float(low[i, 2]), int(i)) for i in np.argsort(low[:, 2], kind="stable") if near[i]]


@lru_cache(maxsize=64)
def _corners(body: tuple[Polyhedron, ...]) -> tuple[Array, NDArray[np.int64]]:
    """The corners (V, 3) of all parts, one part's after the other's, and where each part's begin (P,)."""
    counts = [len(part.vertices) for part in body]
    return np.concatenate([part.vertices for part in body]), np.cumsum([0, *counts[:-1]])


def touch_of(
    pads: Sequence[Pad], T_frame_faces: Sequence[Array], body: Sequence[Polyhedron], T_frame_body: Array
) -> tuple[Pad, Touch] | None:
    """How the faces of one side are at a body: as the nearest of them is, with the patches of all that are about as near."""
    seen = [(pad, t) for pad, T in zip(pads, T_frame_faces) if (t := touch(pad, T, body, T_frame_body)) is not None]
    if not seen:
        return None
    pad, nearest = min(seen, key=lambda s: s[1].gap_m)
    if len(seen) == 1:
        return pad, nearest
    patch = np.concatenate([t.patch for _, t in seen if t.gap_m <= nearest.gap_m + PATCH_M])
    flat = polygons.hull(np.stack([patch @ axis for axis in _across(nearest.normal)], -1))
    return pad, Touch(nearest.gap_m, nearest.normal, patch, polygons.least_width(flat))


def hold_faults(
    pads: Sequence[Pad],
    T_hand_faces: Sequence[Array],
    body: Sequence[Polyhedron],
    T_hand_body: Array,
    name: str,
    stage: str,
    settings: Settings,
) -> list[Fault]:
    """What keeps the pads of two sides, or a cup, from holding a body; nothing when they do.

    T_hand_faces, T_hand_body (4, 4): in the hand's frame.
    """
    if len(pads) == 1:
        return cup_faults(pads[0], T_hand_faces[0], body, T_hand_body, name, stage, settings)
    sides = [[(pad, T) for pad, T in zip(pads, T_hand_faces) if pad.side == side] for side in dict.fromkeys(pad.side for pad in pads)]
    touches = [touch_of([pad for pad, _ in side], [T for _, T in side], body, T_hand_body) for side in sides]
    links = tuple(dict.fromkeys(pad.link for pad in pads))
    missed = [min(beside(pad, T, body, T_hand_body) for pad, T in side) for side, t in zip(sides, touches) if t is None]
    if missed:
        amount = max(missed)
        return [Fault(stage, (*links, name), f"the pads close {1000 * amount:.1f} mm beside {name}", amount)]
    faults, found = list[Fault](), [t for t in touches if t is not None]
    for pad, t in found:
        if t.gap_m > settings.gap_m:
            faults.append(Fault(stage, (pad.link, name), f"{pad.link} stops {1000 * t.gap_m:.1f} mm before {name}", t.gap_m))
        elif t.gap_m < -settings.depth_m:
            faults.append(Fault(stage, (pad.link, name), f"{pad.link} is {-1000 * t.gap_m:.1f} mm inside {name}", -t.gap_m))
        elif t.width_m < settings.overlap_m:
            faults.append(Fault(stage, (pad.link, name), f"{pad.link} meets {name} in a strip {1000 * t.width_m:.1f} mm wide", t.width_m))
    if not faults and (angle := slip_angle(*(t for _, t in found))) > (cone := float(np.arctan(settings.mu))):
        detail = f"{name} slips: the pads press {np.degrees(angle):.0f}° off, and friction {settings.mu:g} holds {np.degrees(cone):.0f}°"
        faults.append(Fault(stage, (*links, name), detail, angle))
    return faults


def slip_angle(a: Touch, b: Touch) -> float:
    """How far, in rad, the line between two contacts is from their normals, the larger of both; along the best line between the patches."""
    across = a.normal - b.normal
    across = across / max(float(np.linalg.norm(across)), 1e-12)
    u, v = _across(across)
    flat_a, flat_b = (polygons.hull(np.stack([t.patch @ u, t.patch @ v], -1)) for t in (a, b))
    p, q = polygons.nearest(flat_a, flat_b)
    apart = float((b.patch.mean(0) - a.patch.mean(0)) @ across)
    line = (q[0] - p[0]) * u + (q[1] - p[1]) * v + apart * across
    line /= max(float(np.linalg.norm(line)), 1e-12)
    return float(max(np.arccos(np.clip(a.normal @ line, -1, 1)), np.arccos(np.clip(-b.normal @ line, -1, 1))))


def beside(pad: Pad, T_frame_face: Array, body: Sequence[Polyhedron], T_frame_body: Array) -> float:
    """About how far a body is from a pad's face, in m: between the face's corners and middle, and the body's corners and planes."""
    outline = pad.window.corners
    corners = np.c_[np.concatenate([outline, [outline.mean(0)]]), np.zeros(len(outline) + 1)]
    points = corners @ T_frame_face[:3, :3].T + T_frame_face[:3, 3]
    out = np.inf
    for part in (p.moved(T_frame_body) for p in body):
        beyond = float((points @ part.planes[:, :3].T - part.planes[:, 3]).max(1).min())
        apart = np.maximum(np.maximum(part.low - points, points - part.high), 0)
        out = min(out, max(beyond, float(np.linalg.norm(apart, axis=1).min()), 0.0))
    return out


def _across(z: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) that make a frame with z (3,)."""
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return x, cross(z, x)
