"""Images of a recording: depths and masks, as files of several kinds hold them."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.git_lfs import refuse_pointer

MOST_PIXELS = 50_000_000
DEPTH_FILES = (".png", ".tif", ".tiff", ".npy")


def read_depth(folder: Path, image: int) -> NDArray[Any]:
    """Depths (H, W) as an image's file has them, whole numbers or floating-point ones: image 7 is 000007.png, .tif, .tiff or .npy.

    Raises: ValueError with the file.
    """
    file = next((f for ending in DEPTH_FILES if (f := folder / f"{image:06d}{ending}").is_file()), folder / f"{image:06d}.png")
    if file.suffix != ".npy":
        return read_grey(file, None)
    refuse_pointer(file, "image")
    try:
        depth = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError) as e:
        raise ValueError(f"{file}: is no array of NumPy that can be read: {e}") from e
    if depth.ndim != 2 or depth.dtype.kind not in "uif" or depth.dtype == np.uint8 or depth.size > MOST_PIXELS:
        raise ValueError(f"{file}: holds {depth.dtype} of shape {depth.shape}: expected are depths of shape (rows, columns)")
    return np.asarray(depth)


def read_grey(file: Path, shape: tuple[int, ...] | None, *, numbers: bool = False) -> NDArray[Any]:
    """A grey image (H, W); of 16 bits or of floating-point numbers, and of any size, when no shape is given: a depth image.

    A mask's colours count as their brightest channel, and how opaque a pixel is not at all. numbers: colours can't be meant.

    Raises: ValueError with the file.
    """
    from PIL import Image

    if not file.is_file():
        what = "a PNG of 16 bits" if shape is None else f"a mask of {shape[1]} × {shape[0]} pixels"
        raise ValueError(f"{file}: no such file; expected is {what}")
    refuse_pointer(file, "image")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # we have a limit of our own
            with Image.open(file) as opened:
                if opened.width * opened.height > MOST_PIXELS:
                    raise ValueError(f"{file}: has {opened.width} × {opened.height} pixels, and at most {MOST_PIXELS} can be used")
                image = np.asarray(opened)
    except (OSError, SyntaxError, Image.DecompressionBombError) as e:
        raise ValueError(f"{file}: is no image that can be read: {e}") from e
    if image.ndim == 3 and shape is not None:
        colours = image[..., : image.shape[2] - 1 + image.shape[2] % 2]  # two and four channels have one that says how opaque a pixel is
        if numbers and (colours != colours[..., :1]).any():
            raise ValueError(f"{file}: its pixels are colours: expected is one channel, whose numbers say which object a pixel shows")
        image = colours.max(2)
    if image.ndim != 2 or (shape is None and image.dtype not in (np.uint16, np.int32, np.float32)):
        raise ValueError(f"{file}: is no grey image of 16 bits, or of floating-point numbers (TIFF), as depth images are")
    if shape is not None and image.shape != shape:
        raise ValueError(f"{file}: has {image.shape[1]} × {image.shape[0]} pixels, the depth image {shape[1]} × {shape[0]}")
    return image
