"""Flying pixels: single readings far from all of their neighbours, as at edges and by interference.

One reading some metres off moves a Gaussian mean of heights by centimetres over its whole width, so
these readings are removed before any smoothing. A reading stays if a quarter of the readings in its
window agree with it; folds, edges and thin objects do.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

#: Half width of the window, pixels.
_HALF = 2

#: Least difference that is examined: a length, metres, and multiples of the sensor's noise.
_MIN_DIFFERENCE_M = 0.012
_NOISES = 12.0

#: Least fraction of the window's readings that agree with a reading that stays, and the least
#: number of readings in its window.
_MIN_AGREEING = 0.25
_MIN_READINGS = 4


def without_flying_pixels(
    depth: NDArray[np.float32], depth_noise: float
) -> tuple[NDArray[np.float32], float]:
    """Remove flying pixels from a depth image.

    Args:
        depth: (h, w) metres, 0 for no reading.
        depth_noise: standard deviation of a reading, metres.

    Returns:
        The image with 0 in their place, and their fraction of the readings; the image itself if
        there are none.
    """
    tolerance = max(_MIN_DIFFERENCE_M, _NOISES * depth_noise)
    seen = depth > 0.0
    # The median of a window with holes leans towards 0; what it flags is looked at in detail.
    middle = np.asarray(cv2.medianBlur(depth, 2 * _HALF + 1))
    rows, columns = np.nonzero(seen & (np.abs(depth - middle) > tolerance))
    if rows.size == 0:
        return depth, 0.0
    framed = np.pad(depth, _HALF)
    own = depth[rows, columns]
    agreeing, readings = np.zeros(rows.size, np.intp), np.zeros(rows.size, np.intp)
    for down in range(2 * _HALF + 1):
        for across in range(2 * _HALF + 1):
            if (down, across) == (_HALF, _HALF):
                continue
            other = framed[rows + down, columns + across]
            readings += other > 0.0
            agreeing += np.abs(other - own) < tolerance  # 0 is far from any reading
    lone: NDArray[Any] = (agreeing < _MIN_AGREEING * readings) | (readings < _MIN_READINGS)
    if not lone.any():
        return depth, 0.0
    cleaned = depth.copy()
    cleaned[rows[lone], columns[lone]] = 0.0
    return cleaned, float(np.count_nonzero(lone) / np.count_nonzero(seen))
