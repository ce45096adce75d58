"""Which of many hands may hold a mesh: the lines along which they close are crossed with it all at once.

What is said here is said a little too freely, by `SLACK_M`: a hand that may hold it is asked again, line by line (`mesh_grasps`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Body
from kinematics.shapes import ConvexMesh
from kinematics.transforms import Array
from planning.grasping.candidates import Candidate
from planning.grasping.hand_poses import fit_boxes
from planning.grasping.line_contacts import planes_of_parts
from planning.grasping.through_parts import through_all

SLACK_M = 1e-9
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Sieve:
    """What is asked of hands.

    besides: how far beside its line each may close, in shares of how far the body reaches there; shares: of how far it is set back.
    friction_angle: between the line and the surface's normals at most, rad; spare_m: by how much the gripper opens wider than the body.
    """

    besides: tuple[float, ...]
    shares: tuple[float, ...]
    friction_angle: float
    spare_m: float

    def passes(self, body: Body, opening: Opening, hands: Sequence[Candidate]) -> list[bool]:
        """Which of the hands may hold a body that is a mesh."""
        out, alike = np.zeros(len(hands), bool), dict[tuple[float, float, float], list[int]]()
        for i, c in enumerate(hands):
            alike.setdefault((c.extent[2], c.back_m, c.room_m), []).append(i)
        for rows in alike.values():
            out[rows] = self._pass_alike(body, opening, [hands[i] for i in rows])
        return list(map(bool, out))

    def _pass_alike(self, body: Body, opening: Opening, hands: Sequence[Candidate]) -> Flags:
        """The same (N,) for hands of one pitch; in between every hand stands for B lines beside each other, N · B rows."""
        N, B, first = len(hands), len(self.besides), hands[0]
        u, R, extents = (np.repeat([getattr(c, name) for c in hands], B, 0) for name in ("u", "R", "extent"))
        level = np.stack([-u[:, 1], u[:, 0], np.zeros(N * B)], -1)
        beside = np.tile(self.besides, N) * (np.abs(level @ body.T_world_body[:3, :3]) @ body.shape.half)
        points = np.repeat([c.point for c in hands], B, 0) + beside[:, None] * level
        width, good = self._crossed(body, opening, points, u)
        holds = good if 0.0 in self.shares else np.zeros(N * B, bool)
        reach = extents[:, 0] + beside * np.sign((level * R[:, :, 2]).sum(1))
        along, up, back = fit_boxes(reach, extents[:, 1], first.extent[2], width, opening, first.back_m, first.room_m)
        moves = -along[:, None] * R[:, :, 2] + np.stack([back * R[:, 1, 1], -back * R[:, 0, 1], up], -1)
        for share in (share for share in self.shares if share):
            some = ~holds & (width > 0.0)
            holds[some] = self._crossed(body, opening, points[some] + share * moves[some], u[some])[1]
        return np.asarray(holds.reshape(N, B).any(1))

    def _crossed(self, body: Body, opening: Opening, points: Array, u: Array) -> tuple[Array, Flags]:
        """How wide (L,) the body is along lines through points (L, 3) along u (L, 3), 0 where they miss; whether pads may close there."""
        assert isinstance(body.shape, ConvexMesh)
        R, met = body.T_world_body[:3, :3], np.empty((len(points), 4))
        o, d = np.ascontiguousarray((points - body.T_world_body[:3, 3]) @ R), np.ascontiguousarray(u @ R)
        through_all(*planes_of_parts(body.shape), o, d, met)
        some, faces = met[:, 0] < met[:, 1], met[:, 2:].min(1) >= np.cos(self.friction_angle) - SLACK_M
        width = np.where(some, met[:, 1] - met[:, 0], 0.0)
        return width, some & faces & (width + self.spare_m <= opening.max_m + SLACK_M)
