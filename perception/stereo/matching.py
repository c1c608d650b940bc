"""Dense sub-pixel matching of rectified image pairs, from 0.3 to 16 megapixels.

Semi-global matching of reduced images gives the initial disparity. It is refined, coarse to fine,
on a grid of square cells (4 x 4 pixels at 16 megapixels): windowed Lucas-Kanade steps converge to a
fraction of a pixel, then a thin plate with discontinuities is fitted to the normal equations of all
pixels, each weighted by the sensor's noise (`_kernels.normal_equations`, `_kernels.plate_fit`).
"""

from dataclasses import dataclass
from math import isfinite
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Image
from unwrinkle.models.errors import InputError
from unwrinkle.perception.stereo._kernels.confidence import confident_cells, disparity_sigma
from unwrinkle.perception.stereo._kernels.refine import refine_disparity, scale_for
from unwrinkle.perception.stereo._kernels.upsample import upsample_cells

#: Least width and height of an image, pixels.
_MIN_SIDE_PX = 64


@dataclass(frozen=True)
class ImageNoise:
    """Image noise model: variance gain * I + read^2 of a grey level I, in grey levels squared."""

    gain: float = 0.35
    read: float = 1.2

    def __post_init__(self) -> None:
        """Check the parameters.

        Raises:
            InputError: a parameter is negative or not finite, or both are 0.
        """
        if not (isfinite(self.gain) and isfinite(self.read)) or min(self.gain, self.read) < 0.0:
            raise InputError(f"image noise {self}: gain and read must be 0 or more")
        if self.gain == self.read == 0.0:
            raise InputError("image noise: gain and read are both 0; no camera is without noise")


@dataclass(frozen=True, eq=False)
class Disparity:
    """Disparity image with its validity and expected error.

    Attributes:
        disparity: (h, w) float32, u_left - u_right in pixels; 0 where not valid.
        valid: (h, w) bool.
        cell_sigma: (rows, columns) float32, expected standard deviation of the disparity from image
            noise, pixels, for each cell; None if unknown.
        cell: side of a cell, pixels.
    """

    disparity: NDArray[np.float32]
    valid: NDArray[np.bool_]
    cell_sigma: NDArray[np.float32] | None = None
    cell: int = 1

    @property
    def sigma(self) -> NDArray[np.float32] | None:
        """Expected standard deviation (h, w) float32, pixels, or None if unknown."""
        if self.cell_sigma is None:
            return None
        h, w = self.disparity.shape
        return self.cell_sigma.repeat(self.cell, axis=0).repeat(self.cell, axis=1)[:h, :w]

    @property
    def valid_fraction(self) -> float:
        """Fraction of valid pixels."""
        return float(np.count_nonzero(self.valid)) / self.valid.size


def match(
    left: Image,
    right: Image,
    lowest: int,
    highest: int,
    *,
    noise: ImageNoise | None = None,
    check: bool = True,
) -> Disparity:
    """Match a rectified pair; return the disparity of the left image.

    Args:
        left, right: (h, w) uint8 grey, rectified; 0 outside a camera's view.
        lowest, highest: range of the search, pixels, negative to positive.
        noise: of both images; None for that of the Glasgow head's cameras.
        check: False marks all pixels valid, without the confidence test; for comparisons with
            another method on that method's mask.

    Raises:
        InputError: the shapes differ or are too small, the type is not uint8, or the range is
            empty.
    """
    left, right = _checked(left, right, lowest, highest)
    noise = noise or ImageNoise()
    return _run(left, right, lowest, highest, noise, check)


def _checked(left: Any, right: Any, lowest: float, highest: float) -> tuple[Image, Image]:
    left, right = np.asarray(left), np.asarray(right)
    if left.shape != right.shape or left.ndim != 2:
        raise InputError(
            f"stereo pair: images have shapes {left.shape} and {right.shape}, wanted the same "
            "(rows, columns)"
        )
    if left.dtype != np.uint8 or right.dtype != np.uint8:
        raise InputError(f"stereo pair: images are {left.dtype} and {right.dtype}, wanted uint8")
    if min(left.shape) < _MIN_SIDE_PX:
        raise InputError(
            f"stereo pair: images have shape {left.shape}, at least {_MIN_SIDE_PX} pixels wanted"
        )
    if not lowest < highest or max(-lowest, highest) > left.shape[1]:
        raise InputError(
            f"stereo pair: search from {lowest} to {highest} pixels of disparity is empty or "
            f"exceeds the image's width {left.shape[1]}; does the region lie before the cameras?"
        )
    return left, right


def _run(
    left: Image, right: Image, lowest: int, highest: int, noise: ImageNoise, check: bool
) -> Disparity:
    height, width = left.shape
    scale = scale_for(left.shape)
    below, aside = -height % scale, -width % scale
    if below or aside:
        left, right = (
            np.asarray(cv2.copyMakeBorder(image, 0, below, 0, aside, cv2.BORDER_REPLICATE))
            for image in (left, right)
        )
    surface = refine_disparity(left, right, lowest, highest, noise.gain, noise.read)
    good = np.ones(surface.disparity.shape, dtype=bool)
    if check:
        good = confident_cells(surface, lowest, highest)
    disparity, valid = upsample_cells(surface.disparity, good, surface.cell, (height, width))
    sigma = disparity_sigma(surface)
    for array in (disparity, valid, sigma):
        array.setflags(write=False)
    return Disparity(disparity, valid, sigma, surface.cell)
