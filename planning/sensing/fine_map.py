"""The map with finer voxels that the loop makes once something has to be moved, and where it says that something may hide.

The loop's own map has voxels of 1 cm, too coarse to tell a slit from a place where a thing could be. So all that was seen and moved is
kept, and put into finer voxels once that is needed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.scene import Body, Cabinet
from perception.mapping.voxels import FREE, UNKNOWN, VOXEL_M, ClearRays, Voxels, unknown_voxels
from planning.sensing import hiding_places
from planning.sensing.unknown_space import BODY_MARGIN_M, grown_to_blocks, skin


@dataclass(frozen=True, eq=False)
class Moved:
    """An object that was put down elsewhere: as it stood, and as it stands now."""

    before: Body
    after: Body

    def marked_in(self, voxels: Voxels) -> Voxels:
        """The map with the room that it took free, and that where it stands its own."""
        left = voxels.touched(self.before, BODY_MARGIN_M) | skin(voxels, [self.before])
        return voxels.marked(left, FREE).marked(voxels.touched(self.after), UNKNOWN)


class FineMap:
    """What was seen and moved, in the order in which it happened; a map of it is made when it is asked for."""

    def __init__(self, cabinet: Cabinet) -> None:
        self.voxels = unknown_voxels(cabinet, hiding_places.VOXEL_M)
        self._new = list[ClearRays | Moved]()

    def add(self, *news: ClearRays | Moved) -> None:
        """Remember what happened."""
        self._new += news

    def hiding_places(
        self, coarse: Voxels, may_hide: NDArray[np.bool_], bodies: Sequence[Body], complete: Collection[str], smallest_m: float
    ) -> NDArray[np.bool_]:
        """The fine voxels (X, Y, Z) in which something may be that nobody has seen, see `planning.sensing.hiding_places`.

        coarse: the loop's own map, of which `may_hide` (X, Y, Z) are the voxels that come into question.
        """
        self._update(_refined(coarse.state == FREE, coarse, self.voxels))
        places = hiding_places.hiding_places(self.voxels, bodies, complete, hiding_places.smallest(bodies, smallest_m))
        return places & _refined(may_hide, coarse, self.voxels)

    def _update(self, known_free: NDArray[np.bool_]) -> None:
        """Put what is new into the map; what is known to be free need not be found out again."""
        voxels = self.voxels.marked(known_free, FREE)
        for it in self._new:
            voxels = it.marked_in(voxels) if isinstance(it, Moved) else voxels.after(it)
        self.voxels = voxels.marked(known_free, FREE)
        self._new.clear()

    def boxes(self, places: NDArray[np.bool_], bodies: Sequence[Body]) -> tuple[Body, ...]:
        """Obstacles that fill such places (X, Y, Z), and a little more away from the bodies."""
        return self.voxels.boxes(grown_to_blocks(self.voxels, places, bodies, round(VOXEL_M / hiding_places.VOXEL_M)))


def _refined(which: NDArray[np.bool_], coarse: Voxels, fine: Voxels) -> NDArray[np.bool_]:
    """The voxels (X, Y, Z) of a fine map whose middles are in marked voxels of a coarser one of the same cabinet."""
    at = (((np.arange(n) + 0.5) * a / b).astype(int) for n, a, b in zip(fine.state.shape, fine.step, coarse.step))
    return np.asarray(which[np.ix_(*at)])


def coarsened(which: NDArray[np.bool_], fine: Voxels, coarse: Voxels) -> NDArray[np.bool_]:
    """The voxels (X, Y, Z) of a coarse map that hold the middle of a marked voxel of a finer one of the same cabinet."""
    out = np.zeros(coarse.state.shape, bool)
    out[tuple(((np.argwhere(which) + 0.5) * fine.step / coarse.step).astype(int).T)] = True
    return out
