"""What stands on another, flush with it on some sides, and what is one body that steps in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from photographs import CABINET, best_matches, box, can, lifted, photograph, placed, without_masks

from kinematics.scene import Body
from perception.camera import DepthNoise, realsense_d435i
from perception.objects.patches import Cells, surface_cells
from perception.objects.prepared_frames import prepare
from perception.objects.segment import segment
from perception.objects.stacked import stacks_divided

STACKS = {
    "flush on two sides": (box("low", 0.25, 0.0, [0.11, 0.10, 0.08]), lifted(box("up", 0.24, 0.01, [0.09, 0.08, 0.07]), 0.08)),
    "a can on a can": (can("low", 0.25, 0.0, 0.045, 0.08), lifted(can("up", 0.242, 0.0, 0.037, 0.09), 0.08)),
    "a can on a box": (box("low", 0.25, 0.0, [0.10, 0.08, 0.09]), lifted(can("up", 0.241, 0.0, 0.04, 0.08), 0.09)),
}
SINGLE = {
    "a jar": (can("low", 0.25, 0.0, 0.045, 0.12), lifted(can("up", 0.25, 0.0, 0.036, 0.03), 0.12)),
    "a bottle whose neck stands in a corner": (box("low", 0.25, 0.0, [0.08, 0.06, 0.12]), lifted(can("up", 0.23, 0.01, 0.018, 0.05), 0.12)),
    "a box": (box("low", 0.25, 0.0, [0.10, 0.08, 0.18]),),
    "a low step": (box("low", 0.25, 0.0, [0.10, 0.08, 0.02]), lifted(box("up", 0.24, 0.0, [0.08, 0.08, 0.12]), 0.02)),
}


def cells_of(bodies: Sequence[Body]) -> Cells:
    return surface_cells(prepare(without_masks(photograph(placed(bodies, CABINET))), CABINET))


@pytest.mark.parametrize("noise", [None, DepthNoise()], ids=["clean", "noise"])
@pytest.mark.parametrize("case", STACKS)
def test_what_is_flush_in_part_with_what_carries_it_is_another_body(case: str, noise: DepthNoise | None) -> None:
    bodies = placed(STACKS[case], CABINET)
    frames = photograph(bodies, CABINET, noise, camera=realsense_d435i(640, 480))
    boxes = segment(without_masks(frames), CABINET, by="geometry")
    assert len(boxes) == 2
    assert min(best_matches(bodies, boxes)) > 0.85


@pytest.mark.parametrize("case", SINGLE)
def test_what_steps_in_all_around_or_by_little_stays_one(case: str) -> None:
    cells = cells_of(SINGLE[case])
    assert not stacks_divided(cells, np.zeros(len(cells.points), np.int64)).any()


def test_what_is_divided_joins_what_goes_on_above_it() -> None:
    """Of a body on another, whose lower part the other had: it is not a third one."""
    cells = cells_of(STACKS["flush on two sides"])
    above = cells.points[:, 2] > 0.12
    label = stacks_divided(cells, above.astype(np.int64))
    assert label.max() == 1
    assert np.mean((label == 1) == (cells.points[:, 2] > 0.082)) > 0.98


def test_of_nothing_there_is_nothing() -> None:
    cells = cells_of(())
    assert len(stacks_divided(cells, np.zeros(0, np.int64))) == 0
