"""What a gripper's fingers leave free, measured on its links' hulls: the tables of an `Opening`."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.chain import Int
from kinematics.robots.hands.free_depth import free_depth, free_depths
from kinematics.robots.hands.hull_sections import HEIGHTS_M, Sections
from kinematics.robots.hands.opening import Opening
from kinematics.robots.tree import FIXED, TURNS, LinkHull, Tree
from kinematics.transforms import Array, inverse

PAD_M = 0.008  # a finger link that stays within 8 mm of being the innermost one is a pad
_STEP_M = 0.001
MOST_SLANT = np.radians(20)
"""Where fingers that turn touch what is round further from the way they close, it slips: friction of 0.5 holds 26.6°. Fingers whose tips
turn further than that as they open are flat against each other nowhere else, and take what is round."""
HALF_TURN = np.pi + 1e-6
"""Fingers that may turn further are told with limits that are not theirs: they pass through each other."""
TIP_M = 0.005  # links of fingers that end so near to the furthest of them are their tips
ROWS, ASIDE_M = 13, 0.08
"""In how many rows, and how far from the middle at most, hands of three fingers are looked at along the hand's x."""
ACROSS_M = (-0.012, -0.006, 0.0, 0.006, 0.012)
"""Where a jaw and what it closes on are looked at, along the hand's x."""
_BETWEEN = np.abs(HEIGHTS_M) <= 0.015  # the hand frame's origin lies between the pads


def measure(
    tree: Tree, hulls: tuple[LinkHull, ...], fingers: frozenset[str], gripper: int, limits: tuple[float, float], rest: Array, name: str
) -> tuple[Opening, frozenset[str]]:
    """Tabulate the opening over the gripper joint's limits, the other joints at rest (J,), and find the pads among the links of the hand.

    Raises: NotClosing when the fingers don't close along the hand frame's y; name: the robot's, for that message.
    """
    mover = max(i for i in tree.path(tree.index["hand"]) if tree.kind[i] != FIXED)
    hand = [hull for hull in hulls if mover in tree.path(tree.index[hull.link])]
    values = np.linspace(*limits, 33)
    places = _placed(tree, hand, rest, gripper, values)
    jaw = _jaw_side(tree, gripper, places, fingers)
    looked = _look(tree, places, fingers, gripper, jaw, _tips_turn(tree, places[0], fingers, gripper, limits, rest))
    profiles, widths, middles, usable, hinged = looked.profiles, looked.widths, looked.middles, looked.usable, looked.hinged
    if not usable:
        words = (
            f"nothing faces {', '.join(sorted(fingers))} along the hand frame's y axis, however far they open: does collision geometry "
            "overlap? Or name another frame with --hand-frame, a link between the pads, z along the approach and y the way they close, or "
            "other joints with --gripper-joint"
        )
        raise NotClosing(f"robot {name}: {words}{_too_far(tree, gripper, limits)}", sorted(fingers))
    if max(widths[i] for i in usable) - min(widths[i] for i in usable) < LEAST_WAY_M:
        words = "the gripper joint opens the fingers by less than 5 mm along the hand frame's y axis"
        raise NotClosing(f"robot {name}: {words}{_too_far(tree, gripper, limits)}", sorted(fingers))
    wide = [i for i in usable if widths[i] > 0.4 * max(widths[k] for k in usable)]  # when they are closed, the knuckles are innermost too
    if jaw:
        pads = _inmost(profiles, fingers, jaw, wide) | _inmost(profiles, frozenset(h.link for h in hand) - fingers, -jaw, wide)
    elif hinged:  # which of a finger's links touches what is round depends on how thick that is
        pads = frozenset(f for f in fingers if min(_off_round(profiles[i].links[f], widths[i]) for i in wide) < PAD_M)
    else:
        inner = [p.links for p in profiles]
        pads = frozenset(f for f in fingers if max(np.min(inner[i][f][_BETWEEN], initial=np.inf) - widths[i] / 2 for i in wide) < PAD_M)
    pad_z = [0.0 if hinged else _pad_z(profiles[i], widths[i], jaw) for i in usable]
    feet = not jaw and not hinged  # of what turns, the pads stand askew
    depth = [free_depth(_centred(places[i], middles[i]), pads, widths[i], z, feet=feet) for i, z in zip(usable, pad_z)]
    there = [_width_at_origin(profiles[i]) for i in usable]
    if min(depth) < SHALLOW_M and all(z < 0.0 and w - widths[i] < TAPER_M for i, z, w in zip(usable, pad_z, there)):
        depth, pad_z = [deep - z for deep, z in zip(depth, pad_z)], [0.0] * len(usable)  # nearer to the tips, at the hand frame
        widths = tuple(dict(zip(usable, there)).get(i, w) for i, w in enumerate(widths))
    order = np.argsort([widths[i] for i in usable], kind="stable")
    columns = (values[usable], [widths[i] for i in usable], pad_z, depth, [middles[i] for i in usable])
    table = np.stack([np.asarray(c, float) for c in columns])[:, order]
    kept = np.concatenate([[True], np.diff(table[1]) > 1e-6])
    value, width, z, deep, y = table[:, kept]
    at = [(usable[k], pad_z[k]) for k in order[kept]]
    tilted = np.array([free_depths(_centred(places[i], middles[i]), pads, widths[i], middle, feet=feet) for i, middle in at])
    return Opening(value, width, z, deep, y, jaw, hinged, tilted_m=tilted), pads


LEAST_WAY_M = 0.005
SHALLOW_M, TAPER_M = 0.015, 0.003
"""Where there is less room than that behind the pads' middle, objects are held nearer to the tips, if the pads are hardly further apart."""
_Placed = list[tuple[str, Array, Int]]
"""Hulls in the hand's frame: link, vertices (V, 3), faces (F, 3)."""


def _too_far(tree: Tree, gripper: int, limits: tuple[float, float]) -> str:
    """What is said of a gripper's joint whose limits are none that fingers have; nothing of others."""
    if not (tree.kind[tree.q_index == gripper] == TURNS).any() or limits[1] - limits[0] <= HALF_TURN:
        return ""
    most = np.degrees(limits[1] - limits[0])
    return f"; its joint's limits are {most:.0f}° apart, and no finger turns so far: give the URDF those between which they close"


class NotClosing(ValueError):
    """The fingers don't close along the hand frame's y: the message, and the fingers' links."""

    def __init__(self, message: str, fingers: list[str]) -> None:
        super().__init__(message)
        self.fingers = fingers


def _placed(tree: Tree, hand: Sequence[LinkHull], rest: Array, gripper: int, values: Array) -> list[_Placed]:
    """The hand's hulls in its frame with the gripper's joint at each of some values.

    Of those that stand still there are the same arrays each time.
    """
    known, places = dict[tuple[int, bytes], Array](), list[_Placed]()
    for value in values:
        q = rest.copy()
        q[gripper] = value
        poses = tree.poses(q)
        T_hand = inverse(poses[tree.index["hand"]])
        placed: _Placed = []
        for i, hull in enumerate(hand):
            T = T_hand @ poses[tree.index[hull.link]]
            if (i, T.tobytes()) not in known:
                known[i, T.tobytes()] = hull.vertices @ T[:3, :3].T + T[:3, 3]
            placed.append((hull.link, known[i, T.tobytes()], hull.faces))
        places.append(placed)
    return places


@dataclass(frozen=True, eq=False)
class _Profile:
    """What the line x = 0 crosses at each of HEIGHTS_M (Z,). links: how near to y = 0 each link comes, inf where it is not crossed;
    sides: the nearest of the fingers on either side. Of a jaw that moves alone both are signed: what lies behind y = 0 is negative."""

    links: dict[str, Array]
    sides: dict[int, Array]


def _profile(placed: _Placed, fingers: frozenset[str], sections: Sections, across: Sequence[float] = (0.0,)) -> _Profile:
    """across: where the lines are along x, besides x = 0 as well."""
    links, sides = dict[str, Array](), {side: np.full(len(HEIGHTS_M), np.inf) for side in (1, -1)}
    for (link, vertices, faces), x in itertools.product(placed, across):
        low, high = sections.at(vertices, faces, x)
        gap = np.where(np.isnan(low), np.inf, np.maximum(0.0, np.maximum(low, -high)))
        links[link] = np.minimum(links.get(link, np.inf), gap)
        if link in fingers and np.isfinite(low).any():
            side = 1 if np.nanmean(low + high) > 0 else -1
            sides[side] = np.minimum(sides[side], gap)
    return _Profile(links, sides)


@dataclass(frozen=True, eq=False)
class _Look:
    """What is between the fingers at each of the gripper's values (V): profiles, widths and the pads' middles along y. usable: at which
    they hold something. hinged: whether they turn far, so that they hold what is round."""

    profiles: list[_Profile]
    widths: Sequence[float]
    middles: Sequence[float]
    usable: list[int]
    hinged: bool


def _look(tree: Tree, places: Sequence[_Placed], fingers: frozenset[str], gripper: int, jaw: int, turn: float) -> _Look:
    """places (V): the hand's hulls at each value; jaw: see `_jaw_side`; turn: see `_tips_turn`."""
    sections = Sections()
    profiles = [_profile(placed, fingers, sections) for placed in places]
    unmet = any(all(np.isinf(p.sides[side]).all() for p in profiles) for side in (1, -1))
    split = not jaw and (unmet or _stand_in_three(tree, gripper, places[0]))
    if split:  # of three fingers two are beside the middle
        wide_m = max(float(np.abs(v[:, 0]).max()) for link, v, _ in places[0] if link in fingers)
        across = [float(x) for x in np.linspace(-min(wide_m, ASIDE_M), min(wide_m, ASIDE_M), ROWS)]
        profiles = [_profile(placed, fingers, sections, across) for placed in places]
    if jaw:
        furthest = max((float(n) for p in profiles if np.isfinite(n := min(p.sides[s][_BETWEEN].min() for s in (1, -1)))), default=0.0)
        profiles = [_jaw_profile(placed, fingers, jaw, furthest, sections) for placed in places]
    turns = any(tree.kind[i] == TURNS and tree.q_index[i] == gripper for i in range(len(tree.names)))
    swings = turns and not jaw and (split or turn > MOST_SLANT)
    hinged = swings or (turns and bool(jaw))
    widths, middles = zip(*(_round_width(p, jaw or 1) if hinged else _width(p, jaw) for p in profiles))
    usable = [i for i, w in enumerate(widths) if np.isfinite(w) and w >= 0.0]
    if swings:  # fingers that turn far look at the tips of what they close on, or past it
        usable = [i for i in usable if _slant(profiles[i], widths[i], middles[i]) <= MOST_SLANT]
    complete = bool(jaw) or split or turns or len(usable) == len(widths)  # on hinges, tips may face each other no more when wide open
    return _Look(profiles, widths, middles, usable if complete and len(usable) > 1 else [], hinged)


def _tips_turn(tree: Tree, placed: _Placed, fingers: frozenset[str], gripper: int, limits: tuple[float, float], rest: Array) -> float:
    """How far, in rad, the fingers' outermost links turn in the hand on the gripper's way from one end to the other, the least of them: 0
    on a linkage that keeps one parallel."""
    ends = {link: float(vertices[:, 2].max()) for link, vertices, _ in placed if link in fingers}
    tips = [tree.index[link] for link, end in ends.items() if end > max(ends.values()) - TIP_M]
    R = []
    for value in np.linspace(*limits, 9):  # both ends of a whole turn look the same way
        q = rest.copy()
        q[gripper] = value
        poses = tree.poses(q)
        R.append([poses[tree.index["hand"]][:3, :3].T @ poses[tip][:3, :3] for tip in tips])
    cosines = [min((np.trace(first.T @ later) - 1) / 2 for later in more) for first, *more in zip(*R)]
    return float(np.arccos(np.clip(max(cosines, default=1.0), -1.0, 1.0)))


def _roots(tree: Tree, gripper: int) -> list[int]:
    """The links that the gripper's joint moves on what it does not move."""
    moving = {i for i in range(len(tree.names)) if tree.kind[i] != FIXED and tree.q_index[i] == gripper}
    return [i for i in sorted(moving) if not set(tree.path(int(tree.parent[i]))) & moving]


def _stand_in_three(tree: Tree, gripper: int, placed: _Placed) -> bool:
    """Whether the gripper's joint moves three fingers, two of them beside each other on one side."""
    roots = _roots(tree, gripper)
    if len(roots) != 3:
        return False
    of = [np.concatenate([np.zeros((0, 3)), *(v for link, v, _ in placed if i in tree.path(tree.index[link]))]) for i in roots]
    if not all(len(points) for points in of):
        return False
    x, y = (np.array([points[:, axis].mean() for points in of]) for axis in (0, 1))
    pair = np.flatnonzero(np.sign(y) == np.sign(np.sign(y).sum()))
    return len(pair) == 2 and abs(float(x[pair[0]] - x[pair[1]])) > LEAST_WAY_M


def _jaw_side(tree: Tree, gripper: int, places: Sequence[_Placed], fingers: frozenset[str]) -> int:
    """On which side along y a jaw is that moves alone, 1 or -1; 0 where the gripper's joint moves several fingers."""
    if len(_roots(tree, gripper)) != 1:
        return 0
    furthest = max((np.concatenate([v for link, v, _ in placed if link in fingers]).mean(0)[1] for placed in places), key=abs)
    return 1 if furthest > 0 else -1


def _jaw_profile(placed: _Placed, fingers: frozenset[str], jaw: int, furthest: float, sections: Sections) -> _Profile:
    """The same for a jaw that moves alone, never further than that from y = 0: the other side is what it closes on, and stands still."""
    links, sides = dict[str, Array](), {side: np.full(len(HEIGHTS_M), np.inf) for side in (1, -1)}
    for link, vertices, faces in placed:
        side = jaw if link in fingers else -jaw
        for x in ACROSS_M:  # what is round stands upright between them, whatever ribs they have
            low, high = sections.at(vertices, faces, x)
            inner = np.where(np.isnan(low), np.inf, low if side > 0 else -high)
            if link not in fingers:
                inner = np.where(-inner < furthest, inner, np.inf)  # what lies beyond the jaw is not what it closes on
            links[link] = np.minimum(links.get(link, np.inf), inner)
            sides[side] = np.minimum(sides[side], inner)
    return _Profile(links, sides)


def _round_width(profile: _Profile, jaw: int) -> tuple[float, float]:
    """How thick an upright cylinder about the hand's x is that both sides just touch, its axis at the hand frame's z; and where along y."""
    if not (np.isfinite(profile.sides[1][_BETWEEN]).any() and np.isfinite(profile.sides[-1][_BETWEEN]).any()):
        return np.nan, 0.0

    def room(radius: float) -> tuple[float, float]:
        """From where to where along the jaw's side the cylinder's axis may be."""
        thick = np.sqrt(np.maximum(radius**2 - HEIGHTS_M**2, 0.0))
        over = np.abs(HEIGHTS_M) < radius
        fixed, moving = profile.sides[-jaw][over], profile.sides[jaw][over]
        return float((thick[over] - fixed).max(initial=-np.inf)), float((moving - thick[over]).min(initial=np.inf))

    small, large = 0.001, 0.15
    if room(small)[0] > room(small)[1]:
        return np.nan, 0.0
    for _ in range(30):
        radius = (small + large) / 2
        small, large = (radius, large) if room(radius)[0] <= room(radius)[1] else (small, radius)
    return 2 * small, jaw * sum(room(small)) / 2


def _off_round(gaps: Array, width: float) -> float:
    """How far what is so near to y = 0 at the heights HEIGHTS_M (Z,) is from an upright cylinder of this width about the hand's x."""
    over = np.abs(HEIGHTS_M) < width / 2
    return float(np.min(gaps[over] - np.sqrt((width / 2) ** 2 - HEIGHTS_M[over] ** 2), initial=np.inf))


def _slant(profile: _Profile, width: float, middle: float) -> float:
    """How far, in rad, from the y axis the sides touch an upright cylinder of this width, its axis at y = middle; the larger of both."""
    over = np.abs(HEIGHTS_M) < width / 2
    z, out = HEIGHTS_M[over], np.sqrt((width / 2) ** 2 - HEIGHTS_M[over] ** 2)
    at = [z[int(np.argmin(profile.sides[side][over] - side * middle - out))] for side in (1, -1)]
    return float(np.arcsin(max(0.0, max(np.abs(at)) - _STEP_M) / (width / 2)))


def _width(profile: _Profile, jaw: int) -> tuple[float, float]:
    """How far the pads are apart, and where their middle is along y; nan where they don't face each other."""
    width = (profile.sides[1] + profile.sides[-1])[_BETWEEN]
    if not np.isfinite(width).any():
        return np.nan, 0.0
    at = int(np.argmin(np.where(np.isfinite(width), width, np.inf)))
    plus, minus = (float(profile.sides[side][_BETWEEN][at]) for side in (1, -1))
    return float(width[at]), (plus - minus) / 2 if jaw else 0.0


def _pad_z(profile: _Profile, width: float, jaw: int) -> float:
    """The middle of the pads along the hand's z."""
    z = HEIGHTS_M[(np.abs(profile.sides[1] + profile.sides[-1] - width) <= 0.0005) & (HEIGHTS_M > -0.04)]
    return float(z[np.abs(z) <= 0.015].mean() if jaw else z.mean())


def _width_at_origin(profile: _Profile) -> float:
    """How far the pads are apart where the hand frame is; inf where they don't reach."""
    return float((profile.sides[1] + profile.sides[-1])[np.argmin(np.abs(HEIGHTS_M))])


def _inmost(profiles: Sequence[_Profile], links: frozenset[str], side: int, wide: Sequence[int]) -> frozenset[str]:
    """Those of some links that are always among the nearest on a side."""

    def behind(link: str, p: _Profile) -> float:
        return float(np.min(p.links[link][_BETWEEN]) - np.min(p.sides[side][_BETWEEN]))

    return frozenset(link for link in links if max(behind(link, profiles[i]) for i in wide) < PAD_M)


def _centred(placed: _Placed, middle: float) -> _Placed:
    """The same with the pads' middle at y = 0."""
    if middle == 0.0:
        return placed
    return [(link, vertices - [0.0, middle, 0.0], faces) for link, vertices, faces in placed]
