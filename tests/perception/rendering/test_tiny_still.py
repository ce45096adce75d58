"""The still that compiles all that drawing needs is a picture."""

from __future__ import annotations

import numpy as np

from perception.rendering.tiny_still import tiny_still


def test_a_tiny_still_shows_something() -> None:
    still = tiny_still()
    assert still.shape == (24, 32, 3)
    assert still.dtype == np.uint8
    assert still.std() > 10.0, "solids, shadows and lines"
    assert np.array_equal(still, tiny_still())
