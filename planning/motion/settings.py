"""What may be chosen about motions: how far they keep from everything, how upright things are carried, how paths are sought."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from kinematics.scene import Body
from planning.motion.search.rrt_connect import RRTConnectSettings
from planning.motion.search.shortcut import ShortcutSettings
from planning.motion.smoothing.quicken import QuickenSettings


@dataclass(frozen=True)
class ClearanceSettings:
    """How far motions keep from everything that they may not touch, in metres.

    wanted_m: preferred; between_m: what else is tried before the least; least_m: what nothing may fall short of, 0 where the certificate's
    fraction of a millimetre will do. own_m: the most that is asked for between the robot's own links, and what it holds. Unseen space may
    be passed at no distance. iterations: of a search at any but the least clearance.
    """

    wanted_m: float = 0.005
    between_m: tuple[float, ...] = (0.003, 0.002, 0.001)
    least_m: float = 0.0
    own_m: float = 0.002
    iterations: int = 500

    def __post_init__(self) -> None:
        """Raises ValueError for lengths that are no clearances, or a least one above the wanted one."""
        if not 0 <= self.least_m <= self.wanted_m <= MOST_WANTED_M:
            most, least, wanted = (1000 * m for m in (MOST_WANTED_M, self.least_m, self.wanted_m))
            raise ValueError(f"the wanted clearance, {wanted:g} mm, must lie between the least, {least:g} mm, and {most:g} mm")

    @cached_property
    def levels_m(self) -> tuple[float, ...]:
        """The clearances that are tried, falling from the wanted one to the least."""
        between = sorted((c for c in self.between_m if self.least_m < c < self.wanted_m), reverse=True)
        return tuple(dict.fromkeys((self.wanted_m, *between, self.least_m)))

    @property
    def ends_m(self) -> float:
        """What is preferred near the ends of a way, which may have to be nearer to things than its middle: the next to the wanted."""
        return self.levels_m[:2][-1]

    @property
    def opening_m(self) -> float:
        """What fingers that open on the way keep, or they open before: the next to the least, for how they move is known to a millimetre or
        two only, and they keep that besides."""
        return self.levels_m[-2:][0]

    @cached_property
    def grades_m(self) -> tuple[tuple[float, float], ...]:
        """The clearances that a way may have, of its middle and of what is near its ends, falling."""
        return tuple(dict.fromkeys((m, ends) for m in self.levels_m for ends in (min(m, self.ends_m), self.least_m)))


MOST_WANTED_M = 0.1
MOST_TILT_DEG, LEAST_TILT_DEG = 180.0, 1.0
"""Half a turn is no limit; a limit below one degree leaves the arm no room for a certified motion."""


def tilt_limit_deg(body: Body, max_tilt_deg: float) -> float:
    """How far a body may lean while it is carried: as far as it says itself, else max_tilt_deg."""
    return max_tilt_deg if body.max_tilt_deg is None else body.max_tilt_deg


@dataclass(frozen=True)
class QuickestSettings:
    """How hard quick ways are sought. looks: how many shortest paths are looked at. planned: how many ways that are not straight are
    planned for each move. again: how often those that are used at last are planned anew; quickened: so many of them, those that promise
    most, are made quicker, and the quickest is kept. gain_s: what is to be hoped for from a move, or from planning a way anew, for it to
    be looked at further. iterations: of each search for a way. metre_s, target_metre_s: what a metre of the hand's way counts, in
    seconds, of the moves before the target and of the target's own; so the arm turns over, where it has to, on its way to the target
    rather than to another object. tight_s: what it counts that a way has less than 3 mm of clearance."""

    looks: int = 500
    planned: int = 20
    again: int = 4
    quickened: int = 2
    gain_s: float = 0.05
    iterations: int = 400
    metre_s: float = 1.5
    target_metre_s: float = 0.4
    tight_s: float = 2.0


@dataclass(frozen=True)
class PatienceSettings:
    """How long a way to carry something is sought after others have failed, in iterations.

    share: what a search that failed from a pick leaves the next one from there, in the same state. failed: so much may a scene's failed
    searches cost; from then on, and always at least, a search has `least`. Of the searches that succeed, by spec, 90 % need at most 40 to
    380 iterations, 95 % 300 to 900, 99 % 300 to 2,200.
    """

    share: float = 0.5
    failed: int = 300_000
    least: int = 250


@dataclass(frozen=True)
class MotionSettings:
    """All that may be chosen about motions.

    max_tilt_deg: how far what is carried may lean from how it stood, where the object itself does not say; 180 frees it. rrt, shortcuts: of
    each search for a path; patience: with those that fail. quicken, quickest: of how the moves of a whole plan are made quick at last.
    """

    clearance: ClearanceSettings = field(default_factory=ClearanceSettings)
    max_tilt_deg: float = 30.0
    rrt: RRTConnectSettings = field(default_factory=RRTConnectSettings)
    shortcuts: ShortcutSettings = field(default_factory=lambda: ShortcutSettings(tries=20))
    patience: PatienceSettings = field(default_factory=PatienceSettings)
    quicken: QuickenSettings = field(default_factory=QuickenSettings)
    quickest: QuickestSettings = field(default_factory=QuickestSettings)

    @cached_property
    def unshortened(self) -> MotionSettings:
        """The same without random shortcuts, for ways that are made quicker anyway."""
        return replace(self, shortcuts=replace(self.shortcuts, tries=0))

    def __post_init__(self) -> None:
        """Raises ValueError for a tilt that is none, or too narrow."""
        if not LEAST_TILT_DEG <= self.max_tilt_deg <= MOST_TILT_DEG:
            raise ValueError(f"the largest tilt, {self.max_tilt_deg:g}°, must lie between {LEAST_TILT_DEG:g}° and {MOST_TILT_DEG:g}°")


UNCONSTRAINED = MotionSettings(ClearanceSettings(wanted_m=0.0), max_tilt_deg=MOST_TILT_DEG)
"""Motions touch nothing, and no more is asked of them."""
DEFAULTS = MotionSettings()
