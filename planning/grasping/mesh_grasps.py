"""Grasps of two fingers on meshes: squarely about their middle, less squarely beside it, by a wall with one finger in a hole, by a rim.

What was found of a mesh at a pose is remembered. So objects that stand alike are best asked about at the same pose, wherever they stand:
see `planning.motion.handling.object_grasps`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import islice, product

import numpy as np

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Body, Grasp
from kinematics.shapes import ConvexMesh, bounds
from kinematics.transforms import Array, rotation_about, transform
from planning.grasping.antipodal import FRICTION_ANGLE, MESH_FRICTION_ANGLE, SPARE_M, antipodal, crossed, skew
from planning.grasping.candidates import Candidate, half_along
from planning.grasping.hand_poses import STAY, STEEP, level_across
from planning.grasping.line_contacts import Contact, line_stretches, stretch_at
from planning.grasping.many_lines import Sieve
from planning.grasping.pads import Pad, under_pads

SET_BACKS = (1.0, 0.5, 0.0)  # shares of how far a mesh, taken for a box, is set back: the first that holds; what is round needs less
BESIDE = (0.2, -0.2, 0.4, -0.4, 0.6, -0.6)  # where meshes are crossed beside their middle: shares of how far they reach there
BELOW_RIM_M = 0.006  # so far below a rim it is seen how its wall leans, and so much further down the pads reach
MOST_LEAN = np.radians(50)  # of a hand that leans as a wall does
SQUARELY = Sieve((0.0,), SET_BACKS[:1], FRICTION_ANGLE, SPARE_M)
OBLIQUELY = Sieve((0.0, *BESIDE), SET_BACKS, MESH_FRICTION_ANGLE, SPARE_M)
AT_ONCE = 128  # so many hands are sifted together


def mesh_grasps(body: Body, opening: Opening, hands: Sequence[Candidate], pad: Pad | None) -> Iterator[Grasp]:
    """The grasps of a body that is a mesh by hands, those that hold it squarely first. pad: see `finger_grasps.sample_grasps`."""
    assert isinstance(body.shape, ConvexMesh)
    known, left = _memory(body.shape, body.T_world_body.tobytes(), opening, pad), []

    def squarely(c: Candidate) -> list[Grasp]:
        grasp = antipodal(body, opening, crossed(body, c.point, c.u, 0.0, known.hits), c, pad, FRICTION_ANGLE)
        return [] if grasp is None else [grasp]

    def obliquely(c: Candidate) -> list[Grasp]:
        grasp = _less_squarely(body, opening, c, pad, known.hits)
        return [] if grasp is None else [grasp]

    for c, grasps in known.of("squarely", hands, lambda new: SQUARELY.passes(body, opening, new), squarely):
        yield from grasps
        if not grasps:
            left.append(c)
    for _, grasps in known.of("obliquely", left, lambda new: OBLIQUELY.passes(body, opening, new), obliquely):
        yield from grasps
    if len(body.shape.parts) > 1:
        for _, grasps in known.of("walls", hands, all_of, lambda c: _by_walls(body, opening, c, pad, known.walls)):
            yield from grasps
        if pad is not None:
            yield from _by_rims(body.shape, body.T_world_body, opening, hands, pad)


def all_of(hands: Sequence[Candidate]) -> list[bool]:
    """None is sifted out."""
    return [True] * len(hands)


class _Memory:
    """What was found of a mesh at one pose, by one gripper. hits, walls: where lines cross it, see `crossed` and `_by_walls`."""

    def __init__(self) -> None:
        self.hits: dict[tuple[float, float, float], Contact | None] = {}
        self.walls: dict[tuple[float, float, float], list[Contact]] = {}
        self._grasps: dict[tuple[str, object], list[Grasp]] = {}

    def of(
        self,
        way: str,
        hands: Iterable[Candidate],
        sift: Callable[[Sequence[Candidate]], Sequence[bool]],
        find: Callable[[Candidate], Iterable[Grasp]],
    ) -> Iterator[tuple[Candidate, list[Grasp]]]:
        """The grasps of each hand in one way of holding, found once; sift: which of some hands are worth asking about."""
        rest = iter(hands)
        while some := list(islice(rest, AT_ONCE)):
            keys = [(way, c.key) for c in some]
            new = [(key, c) for key, c in zip(keys, some) if key not in self._grasps]
            self._grasps |= {key: [] for (key, _), worth in zip(new, sift([c for _, c in new]) if new else []) if not worth}
            for key, c in zip(keys, some):
                if key not in self._grasps:
                    self._grasps[key] = list(find(c))
                yield c, self._grasps[key]


@lru_cache(maxsize=64)
def _memory(shape: ConvexMesh, T: bytes, opening: Opening, pad: Pad | None) -> _Memory:
    return _Memory()


def _less_squarely(
    body: Body, opening: Opening, c: Candidate, pad: Pad | None, hits: dict[tuple[float, float, float], Contact | None]
) -> Grasp | None:
    """A mesh's grasp by a candidate that does not meet it squarely in its middle: beside it, or set back less."""
    reach, above, pitch = c.extent
    level = level_across(c.u)
    wide = half_along(body, level)
    lines = [(beside, crossed(body, c.point, c.u, beside, hits)) for beside in (share * wide for share in (0.0, *BESIDE))]
    for (beside, hit), share in product(sorted(lines, key=lambda line: skew(line[1], c.u)), SET_BACKS):
        around = (reach + beside * float(np.sign(level @ c.R[:, 2])), above, pitch)
        there = c._replace(point=c.point + beside * level, extent=around)
        grasp = antipodal(body, opening, hit, there, pad, MESH_FRICTION_ANGLE, share)
        if grasp is not None:
            return grasp
    return None


def _by_walls(
    body: Body, opening: Opening, c: Candidate, pad: Pad | None, walls: dict[tuple[float, float, float], list[Contact]]
) -> Iterator[Grasp]:
    """A mesh's grasps by the stretches of a candidate's line that holes part. walls: what was found of each line, remembered."""
    line = (float(c.u[0]), float(c.point[2]), 0.0)
    if line not in walls:
        walls[line] = line_stretches(body.shape, body.T_world_body, c.point, c.u)
    for hit in walls[line] if len(walls[line]) > 1 else []:
        shares = SET_BACKS if c.fit(body, hit.leave - hit.enter, opening) != STAY else SET_BACKS[:1]
        found = (antipodal(body, opening, hit, c, pad, MESH_FRICTION_ANGLE, share, wall=True) for share in shares)
        yield from islice((grasp for grasp in found if grasp is not None), 1)


def _by_rims(shape: ConvexMesh, T: Array, opening: Opening, candidates: Sequence[Candidate], pad: Pad) -> Iterator[Grasp]:
    """Grasps of a mesh at pose T (4, 4) from above, by walls that lean outwards, as a bowl's do: the hand leans as the wall does, and the
    pads' ends close on its rim."""
    top = float(bounds(shape, T)[1][2]) - BELOW_RIM_M
    asked = set[tuple[float, ...]]()
    for c in (c for c in candidates if c.extent[2] > STEEP):
        if (key := (*c.u.tolist(), *c.R[:, 0].tolist())) in asked:
            continue
        asked.add(key)
        rims = line_stretches(shape, T, np.array([*c.point[:2], top]), c.u)
        for rim in rims if len(rims) > 1 else []:
            across = rim.leave_normal - rim.enter_normal
            lean = float(np.arctan2(across[2], across @ c.u))
            if not MESH_FRICTION_ANGLE / 4 < abs(lean) < MOST_LEAN:
                continue
            turn = rotation_about((c.u[1], -c.u[0], 0.0), lean)
            point, u, R = np.array([*c.point[:2], top]) + (rim.enter + rim.leave) / 2 * c.u, turn @ c.u, turn @ c.R
            hit = stretch_at(shape, T, point, u)
            if hit is None or skew(hit, u) > MESH_FRICTION_ANGLE:
                continue
            point = point - (pad.high_z_m - BELOW_RIM_M) * R[:, 2]
            enter, leave = under_pads(shape, T, hit, point, u, R, pad, wall=True)
            if (width := leave - enter) + SPARE_M <= opening.max_m:
                yield Grasp(transform(R, opening.hand_position(point + 0.5 * (enter + leave) * u, R, width)), float(width))
