"""The colours of pictures: what stands for what, and sRGB to linear light and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinematics.transforms import Array

Colour = tuple[float, float, float]
Float32 = NDArray[np.float32]

TARGET_COLOUR: Colour = (0.91, 0.27, 0.10)
PALETTE: tuple[Colour, ...] = (
    (0.18, 0.42, 0.70),
    (0.95, 0.78, 0.27),
    (0.16, 0.58, 0.48),
    (0.51, 0.36, 0.63),
    (0.47, 0.75, 0.90),
    (0.55, 0.60, 0.22),
    (0.86, 0.62, 0.76),
    (0.13, 0.24, 0.42),
    (0.72, 0.85, 0.62),
    (0.48, 0.40, 0.36),
)
"""Ten colours that differ in lightness as well as in hue, after Okabe and Ito and P. Tol, without the reds that mark the target."""
WALL_COLOUR: Colour = (0.62, 0.70, 0.80)


def linear(srgb: Array) -> Array:
    """Linear light of sRGB values, 0 to 1 (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def roll_off(x: Float32) -> Float32:
    """Linear up to 0.8, then ever slower towards 1."""
    over = np.maximum(x - 0.8, 0)
    return np.asarray(np.minimum(x, 0.8) + 0.2 * over / (over + 0.2), np.float32)


def encode(x: Float32) -> Float32:
    """The sRGB values of linear light, 0 to 1: the inverse of `linear`."""
    return np.asarray(np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055), np.float32)
