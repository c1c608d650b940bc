"""The first guess of a disparity: semi-global matching (Hirschmueller 2008) of small images."""

import cv2
import numpy as np
from numpy.typing import NDArray

_BLOCK = 5
_UNIQUE = 5  # per cent by which the best must beat the next
_SPECKLE = 100  # pixels
_FILL = (5, 15, 45, 135)


def coarse_disparity(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    lowest: int,
    highest: int,
    *,
    quick: bool,
) -> NDArray[np.float32]:
    """Return disparities (h, w) float32, pixels, everywhere.

    What fails the left-right check, is ambiguous or a speckle is filled from around it.

    Args:
        left, right: (h, w) uint8 rectified images.
        lowest, highest: range of the search, pixels, negative to positive.
        quick: costs along three directions instead of four, on all processors.
    """
    count = -(-(highest - lowest + 1) // 16) * 16
    before, after = max(0, lowest + count), max(0, -lowest)
    # OpenCV leaves out columns whose search would leave the image; the border gives it room.
    padded = [
        cv2.copyMakeBorder(image, 0, 0, before, after, cv2.BORDER_REPLICATE)
        for image in (left, right)
    ]
    matcher = cv2.StereoSGBM_create(
        minDisparity=lowest,
        numDisparities=count,
        blockSize=_BLOCK,
        P1=8 * _BLOCK**2,
        P2=32 * _BLOCK**2,
        disp12MaxDiff=1,
        preFilterCap=31,
        uniquenessRatio=_UNIQUE,
        speckleWindowSize=_SPECKLE,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY if quick else cv2.STEREO_SGBM_MODE_HH4,
    )
    sixteenths = matcher.compute(*padded)[:, before : before + left.shape[1]]
    measured = sixteenths >= lowest * 16
    disparity = sixteenths.astype(np.float32) / np.float32(16.0)
    return _filled(disparity, measured, 0.5 * (lowest + highest))


def _filled(
    disparity: NDArray[np.float32], measured: NDArray[np.bool_], otherwise: float
) -> NDArray[np.float32]:
    """Means over ever wider windows where nothing was measured, then a median."""
    known = np.where(measured, disparity, np.float32(0.0))
    weight = measured.astype(np.float32)
    missing = (~measured).astype(np.uint8)
    result = known.copy()
    for size in _FILL:
        if not missing.any():
            break
        share = cv2.boxFilter(weight, -1, (size, size))
        mean = cv2.boxFilter(known, -1, (size, size)) / np.maximum(share, np.float32(1e-6))
        here = (missing > 0) & (share > 0.02)
        result[here] = mean[here]
        missing[here] = 0
    result[missing > 0] = np.median(disparity[measured]) if measured.any() else otherwise
    return np.asarray(cv2.medianBlur(result, 5), dtype=np.float32)
