"""Image files as the sensor's pixels: no display orientation, 8 bits, the same scale for a pair.

A camera that looks down writes any orientation into the EXIF data of its files. A calibration
belongs to the sensor's pixels, so the orientation is ignored everywhere. Industrial cameras store
10, 12 or 14 bits in 16 without shifting them; the unused bits are found from the largest value.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

#: Numbers of bits that cameras store in 16.
_DEPTHS = (8, 10, 12, 14, 16)

_FLAGS = cv2.IMREAD_IGNORE_ORIENTATION | cv2.IMREAD_ANYDEPTH


def decoded_images(
    encoded: Sequence[NDArray[np.uint8]], *, grey: bool = False
) -> list[NDArray[np.uint8] | None]:
    """Decode image files of one camera or of a pair.

    Args:
        encoded: (n,) bytes of each file. Their values are scaled alike, by the largest of all.
        grey: return grey levels (h, w) instead of RGB.

    Returns:
        For each file (h, w, 3) uint8 RGB, or (h, w) uint8; None where it is no image.
    """
    flags = _FLAGS | (cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR_RGB)
    raw = [cv2.imdecode(data, flags) if data.size else None for data in encoded]
    deep: list[NDArray[Any]] = [
        image for image in raw if image is not None and image.dtype == np.uint16
    ]
    shift = _bits(deep) - 8 if deep else 0
    return [None if image is None else _eight_bits(np.asarray(image), shift) for image in raw]


def _bits(images: Sequence[NDArray[Any]]) -> int:
    """Return the number of bits that 16-bit images use."""
    largest = max(int(image.max(initial=0)) for image in images)
    return next(bits for bits in _DEPTHS if largest < 1 << bits)


def _eight_bits(image: NDArray[Any], shift: int) -> NDArray[np.uint8]:
    if image.dtype == np.uint16:
        return np.asarray(image >> shift, dtype=np.uint8)
    if image.dtype != np.uint8:  # float images, which no camera writes
        return np.asarray(np.clip(255.0 * np.nan_to_num(image), 0.0, 255.0), dtype=np.uint8)
    return np.asarray(image, dtype=np.uint8)
