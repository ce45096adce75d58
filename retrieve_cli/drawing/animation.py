"""A film as clips of meshcat's viewer: one a joint, and two an object that is moved. Keys are in seconds."""

from __future__ import annotations

import numpy as np

from kinematics.robots.tree import FIXED, SLIDES
from kinematics.transforms import Array, wxyz_from_rotation
from retrieve_cli.drawing.picture import Film, frame_times, held_by
from retrieve_cli.drawing.three import Command

MOST_TURN = 1.5
"""Radians between two keys at most: the viewer takes the shorter way round."""
FRAME_S = 0.02
"""Seconds between two keys at most: the viewer goes straight from the one to the other."""


def link_paths(film: Film) -> dict[int, str]:
    """Every link's path in the viewer's tree."""
    tree = film.robot.tree
    return {i: "/robot/" + "/".join(tree.names[k] for k in tree.path(i)) for i in range(len(tree.names))}


def clips_of(film: Film) -> list[Command]:
    """One clip a joint, and two an object that is moved: where it stands, and when it is seen there or in the hand. Keys are in seconds."""
    if not film.stretches:
        return []
    tree, nodes = film.robot.tree, link_paths(film)
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
