"""How much the scenes that labels are taken of differ. Apart from `states`, so that whoever only hands it on need not import that."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Variety:
    """How much scenes differ beyond their spec: so that l_r and the cabinet's size mean something to a network.

    base_m: the base stands up to this far from its place, along each axis. cabinet_share: the cabinet's inner sizes are up to this share
    larger or smaller. regions_n: least and most rows of cells; None leaves them to the spec.
    """

    base_m: float = 0.05
    cabinet_share: float = 0.15
    regions_n: tuple[int, int] | None = (8, 12)
