"""Image patches of small screenshots, equal to those of the model's processor but faster to compute."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from webgym.study.model import MERGE, PATCH

FRAMES = 2
"""A picture counts as two frames of a video."""


def to_patches(png: bytes) -> NDArray[np.uint8]:
    """A screenshot cut into patches in the order of the vision tower.

    Args:
        png: a picture whose sides are multiples of a cell.

    Returns:
        (patches, 3 x patch side squared), uint8.
    """
    with Image.open(io.BytesIO(png)) as picture:
        pixels = np.asarray(picture.convert("RGB"))
    rows, columns = pixels.shape[0] // PATCH, pixels.shape[1] // PATCH
    blocks = pixels.reshape(rows // MERGE, MERGE, PATCH, columns // MERGE, MERGE, PATCH, 3)
    ordered = blocks.transpose(0, 3, 1, 4, 6, 2, 5)
    return np.ascontiguousarray(ordered.reshape(rows * columns, 3 * PATCH * PATCH))


def to_pixel_values(patches: NDArray[np.uint8]) -> NDArray[np.float32]:
    """What the vision tower reads: colours from -1 to 1, the frame twice.

    Args:
        patches: (patches, 3 x patch side squared), as :func:`to_patches` made them.

    Returns:
        (patches, 3 x frames x patch side squared), float32.
    """
    colours = patches.astype(np.float32).reshape(len(patches), 3, 1, PATCH * PATCH) / 127.5 - 1.0
    return np.repeat(colours, FRAMES, axis=2).reshape(len(patches), -1)
