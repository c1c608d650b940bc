"""Coarse-to-fine refinement of an initial disparity to a sub-pixel surface on a grid of cells.

On the coarser images windowed Lucas-Kanade steps converge to a fraction of a pixel. On the finest a
thin plate is fitted to the normal equations of all pixels, each weighted by the sensor noise and by
the misfit of its cell.
"""

from dataclasses import dataclass
from math import ceil, floor

import cv2
import numpy as np

from unwrinkle.models.arrays import Grid, Image
from unwrinkle.perception.stereo._kernels.cell_sums import weigh, window_step
from unwrinkle.perception.stereo._kernels.normal_equations import CellSums, cell_sums
from unwrinkle.perception.stereo._kernels.plate_fit import Plate
from unwrinkle.perception.stereo._kernels.sgm_init import coarse_disparity

#: Least image size, pixels, and reduction of the initial images; cells are half as many pixels.
_SCALES = ((1.4e6, 8), (0.6e6, 4), (0.42e6, 2))

#: Sigmas of the windows on the coarsest image, pixels of the full image.
_FIRST_WINDOWS = (6.0, 6.0)

#: Sigmas of the windows on the other images, pixels of the full image.
_WINDOWS = (4.8,)

#: Stiffness of the plate, cells^2 / pixel^2, by the side of a cell, pixels.
STIFFNESS = {1: 100.0, 2: 50.0, 4: 200.0}

#: Solver iterations of each fit, by the side of a cell, pixels. Weak texture needs many in the last
#: fit: with 15 in each, plain cloth has a fifth more error and the time is the same.
_ITERATIONS = {1: (15,) * 4, 2: (10, 10, 10, 40), 4: (10, 10, 10, 40)}

#: Creases of the successive fits on the finest image, pixels per cell^2.
_CREASES = (0.3, 0.2, 0.12)

#: Stiffness per mean weight of the fit before the finest ones: after the initial disparity alone,
#: and after windowed steps.
_COARSE_STIFFNESS = (1.0, 3.0)

#: Crease of that fit, pixels per cell^2.
_COARSE_CREASE = 0.3

#: Side of the square over which the misfit is averaged, cells, by the side of a cell, pixels.
_MISFIT_WINDOWS = {1: 5, 2: 3, 4: 1}

#: Limit of the change in one fit, pixels of the current image.
_MAX_CHANGE_PX = 1.5

#: Variance of rounding to whole grey levels.
_ROUNDING_VARIANCE = 1.0 / 12.0


@dataclass(frozen=True, eq=False)
class DisparitySurface:
    """Disparity surface on cells with the data of its last fit; arrays (rows, columns) float32.

    Attributes:
        disparity: at the cells' centres, pixels.
        cell: side of a cell, pixels.
        sums: normal equations of the last fit.
        weight: of the data in the last fit, 1 / pixel^2.
        variance: of a grey level of the left image, grey levels^2.
        misfit: mean squared difference of the images over its expectation from noise; about 1 for
            a match.
    """

    disparity: Grid
    cell: int
    sums: CellSums
    weight: Grid
    variance: Grid
    misfit: Grid


def scale_for(shape: tuple[int, ...]) -> int:
    """Return the reduction of the images for the initial disparity."""
    return next((scale for least, scale in _SCALES if shape[0] * shape[1] >= least), 1)


def refine_disparity(
    left: Image, right: Image, lowest: int, highest: int, gain: float, read: float
) -> DisparitySurface:
    """Compute the disparity surface of a rectified pair whose sides are multiples of its scale.

    Args:
        left, right: (h, w) uint8; 0 marks unseen pixels.
        lowest, highest: range of the initial disparity, pixels.
        gain, read: noise model, variance gain * I + read^2 of a grey level I.
    """
    scale = scale_for(left.shape)
    cell = max(1, scale // 2)
    lefts, rights = _pyramid(left, scale), _pyramid(right, scale)
    low, high = floor(lowest / scale), ceil(highest / scale)
    guess = coarse_disparity(lefts[scale], rights[scale], low, high, quick=scale > 1)
    disparity = guess * np.float32(scale)
    if scale > cell:
        disparity = _doubled(disparity)
    grey = lefts[cell].astype(np.float32)
    variance = np.float32(gain) * grey + np.float32(read**2 + _ROUNDING_VARIANCE)
    plate = Plate(disparity.shape)
    room = np.empty((12, *disparity.shape), dtype=np.float32)
    # Small images have a sub-pixel initial disparity, whose edges windowed steps would blur.
    factor = cell
    while True:
        pair, share = (lefts[factor], rights[factor]), variance / np.float32(factor**2)
        windows = _FIRST_WINDOWS if factor == cell else _WINDOWS
        for window in windows if factor > 1 or scale == 2 else ():
            sums = cell_sums(*pair, disparity, cell // factor, 1.0 / factor, room[:9])
            step = window_step(sums, share, window / cell)
            disparity = cv2.medianBlur(disparity - np.float32(factor) * step, 5)
        if factor == min(2, cell):
            sums = cell_sums(*pair, disparity, cell // factor, 1.0 / factor, room[:9])
            data = weigh(sums, share, _MISFIT_WINDOWS[cell // factor], room[9:])
            stiffness = _COARSE_STIFFNESS[scale > 1] * max(1e-3, float(data[0].mean()))
            scaled, crease = disparity / np.float32(factor), _COARSE_CREASE / factor
            change = _bent(plate, scaled, data, stiffness, crease, _ITERATIONS[cell][0])
            disparity = disparity + np.float32(factor) * change
        if factor <= 2:
            break
        factor //= 2
    for crease, iterations in zip(_CREASES, _ITERATIONS[cell][1:], strict=True):
        sums = cell_sums(left, right, disparity, cell, 1.0, room[:9])
        data = weigh(sums, variance, _MISFIT_WINDOWS[cell], room[9:])
        disparity = disparity + _bent(plate, disparity, data, STIFFNESS[cell], crease, iterations)
    return DisparitySurface(disparity, cell, sums, data[0], variance, data[2])


def _pyramid(image: Image, scale: int) -> dict[int, Image]:
    images = {1: image}
    factor = 1
    while factor < scale:
        half = cv2.resize(images[factor], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        factor *= 2
        images[factor] = np.asarray(half, dtype=np.uint8)
    return images


def _doubled(values: Grid) -> Grid:
    size = values.shape[1] * 2, values.shape[0] * 2
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR))


def _bent(
    plate: Plate,
    disparity: Grid,
    data: tuple[Grid, Grid, Grid],
    stiffness: float,
    crease: float,
    iterations: int,
) -> Grid:
    weight, pull, _ = data
    change = plate.fit(
        disparity, weight, pull, stiffness=stiffness, crease=crease, iterations=iterations
    )
    return np.clip(change, -_MAX_CHANGE_PX, _MAX_CHANGE_PX)
