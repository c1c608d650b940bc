"""Other ways to match a rectified pair, for the table of `unwrinkle bench stereo`.

Each takes (left, right, lowest, highest) as `unwrinkle.perception.stereo.matching.match` does and
returns a `Disparity`. Settings are those that the measurements behind the design used.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Image
from unwrinkle.perception.stereo.matching import Disparity, match

Method = Callable[[Image, Image, int, int], Disparity]


def ours(left: Image, right: Image, lowest: int, highest: int) -> Disparity:
    """The matcher of this package."""
    return match(left, right, lowest, highest)


def sgbm(
    left: Image,
    right: Image,
    lowest: int,
    highest: int,
    *,
    mode: int = cv2.STEREO_SGBM_MODE_SGBM_3WAY,
) -> Disparity:
    """OpenCV's semi-global block matching at full resolution, sub-pixel by its parabola.

    `mode` HH4 keeps the whole cost volume in memory: for small images only.
    """
    count = -(-(highest - lowest + 1) // 16) * 16
    before, after = max(0, lowest + count), max(0, -lowest)
    # OpenCV leaves out columns whose search would leave the image; the border gives it room.
    padded = [
        cv2.copyMakeBorder(image, 0, 0, before, after, cv2.BORDER_REPLICATE)
        for image in (left, right)
    ]
    block = 5
    matcher = cv2.StereoSGBM_create(
        minDisparity=lowest,
        numDisparities=count,
        blockSize=block,
        P1=8 * block**2,
        P2=32 * block**2,
        disp12MaxDiff=1,
        preFilterCap=31,
        uniquenessRatio=5,
        speckleWindowSize=100,
        speckleRange=2,
        mode=mode,
    )
    sixteenths = matcher.compute(*padded)[:, before : before + left.shape[1]]
    valid = sixteenths >= lowest * 16
    disparity = np.where(valid, sixteenths / 16.0, 0.0).astype(np.float32)
    return Disparity(disparity, valid)


def sgbm_half(left: Image, right: Image, lowest: int, highest: int) -> Disparity:
    """The same at half resolution, enlarged."""
    small = [_half(image) for image in (left, right)]
    found = sgbm(small[0], small[1], lowest // 2, -(-highest // 2))
    disparity, valid = _enlarged(found.disparity, found.valid, left.shape)
    return Disparity(disparity, valid)


def dis_half(left: Image, right: Image, lowest: int, highest: int) -> Disparity:
    """OpenCV's dense inverse search (Kroeger 2016, medium) at half resolution, enlarged.

    It takes no range: the right image is shifted by the range's middle. It says nothing about
    where it is valid; vertical flow of over two pixels and results outside the range are left out.
    """
    first, second = (_half(image) for image in (left, right))
    middle = round(0.25 * (lowest + highest))
    shift = np.array([[1.0, 0.0, middle], [0.0, 1.0, 0.0]])
    second = np.asarray(
        cv2.warpAffine(
            second,
            shift,
            second.shape[::-1],
            flags=cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        dtype=np.uint8,
    )
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(first, second, None)
    disparity = np.asarray(middle - flow[..., 0], dtype=np.float32)
    valid = (np.abs(flow[..., 1]) < 2.0) & (2.0 * disparity > lowest) & (2.0 * disparity < highest)
    return Disparity(*_enlarged(disparity, valid, left.shape))


METHODS: dict[str, Method] = {
    "ours": ours,
    "SGBM 3WAY, full resolution": sgbm,
    "SGBM 3WAY, half resolution": sgbm_half,
    "DIS medium, half resolution": dis_half,
}


def _half(image: Image) -> Image:
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return np.asarray(half, dtype=np.uint8)


def _enlarged(
    disparity: NDArray[np.float32], valid: NDArray[np.bool_], shape: tuple[int, ...]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    h, w = shape
    # Pixel centres keep their place: (x + 0.5) / 2 - 0.5. Sides may be odd, so no plain resize.
    places = np.array([[0.5, 0.0, -0.25], [0.0, 0.5, -0.25]])
    how = {"dsize": (w, h), "borderMode": cv2.BORDER_REPLICATE}
    inverse = cv2.WARP_INVERSE_MAP
    full = cv2.warpAffine(2.0 * disparity, places, flags=cv2.INTER_LINEAR | inverse, **how)
    share = cv2.warpAffine(
        valid.astype(np.float32), places, flags=cv2.INTER_LINEAR | inverse, **how
    )
    mask = np.asarray(share > 0.999)
    return np.where(mask, full, np.float32(0.0)).astype(np.float32), mask
