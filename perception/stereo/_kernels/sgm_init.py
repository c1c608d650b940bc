"""Initial disparity: semi-global matching (Hirschmueller 2008) of reduced images."""

import cv2
import numpy as np
from numpy.typing import NDArray

#: Side of the matching block, pixels.
_BLOCK = 5

#: Least margin of the best cost to the second best, per cent.
_UNIQUENESS_PERCENT = 5

#: Size up to which a component is speckle, pixels.
_SPECKLE_SIZE = 100

#: Sides of the successive windows of the hole filling, pixels.
_FILL_WINDOWS = (5, 15, 45, 135)


def coarse_disparity(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    lowest: int,
    highest: int,
    *,
    quick: bool,
) -> NDArray[np.float32]:
    """Compute a dense disparity (h, w) float32, pixels.

    Pixels that fail the left-right check, are ambiguous or belong to speckle are filled from their
    surroundings.

    Args:
        left, right: (h, w) uint8 rectified images.
        lowest, highest: range of the search, pixels, negative to positive.
        quick: aggregate costs along three directions instead of four, in parallel.
    """
    count = -(-(highest - lowest + 1) // 16) * 16
    before, after = max(0, lowest + count), max(0, -lowest)
    # OpenCV skips columns whose search range leaves the image; pad them.
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
        uniquenessRatio=_UNIQUENESS_PERCENT,
        speckleWindowSize=_SPECKLE_SIZE,
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
    """Fill unmeasured pixels by means over increasingly wide windows; then median-filter."""
    known = np.where(measured, disparity, np.float32(0.0))
    weight = measured.astype(np.float32)
    missing = (~measured).astype(np.uint8)
    result = known.copy()
    for size in _FILL_WINDOWS:
        if not missing.any():
            break
        share = cv2.boxFilter(weight, -1, (size, size))
        mean = cv2.boxFilter(known, -1, (size, size)) / np.maximum(share, np.float32(1e-6))
        here = (missing > 0) & (share > 0.02)
        result[here] = mean[here]
        missing[here] = 0
    result[missing > 0] = np.median(disparity[measured]) if measured.any() else otherwise
    return np.asarray(cv2.medianBlur(result, 5), dtype=np.float32)
