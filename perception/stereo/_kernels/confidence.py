"""Confidence test and expected error of a disparity surface.

Three tests, each over thousands of pixels. The grey levels and gradients of both images must
correlate (normalised correlation, independent of the noise model), which noise and wrong matches do
not. The squared difference of the images must be explained by the sensor's noise, with a tolerance
proportional to texture for registration errors of some tenths of a pixel. At disparity steps that
the cells cannot resolve, the limits are tighter.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Grid
from unwrinkle.perception._parallel import parallel_map
from unwrinkle.perception.stereo._kernels.cell_sums import DIFFERENCE_NOISE, box, gauss
from unwrinkle.perception.stereo._kernels.refine import STIFFNESS, DisparitySurface

#: Least fraction of a cell's pixels that both cameras see.
_MIN_SEEN_FRACTION = 0.5

#: Side of the correlation window, cells, by the side of a cell, pixels.
_WINDOW_CELLS = {1: 25, 2: 17, 4: 13}

#: Least normalised correlation of the grey levels.
_MIN_CORRELATION = 0.3

#: Least normalised correlation of the gradients.
_MIN_GRADIENT_CORRELATION = 0.06

#: Least covariance of the grey levels, squared grey levels.
_MIN_COVARIANCE = 0.05

#: Largest misfit (chi-square per pixel) explained by sensor noise and errors of its model.
_MAX_MISFIT = 1.3

#: Tolerated squared registration error, px^2.
_REGISTRATION_ERROR_PX2 = 0.6

#: Outlier clip of a cell's misfit, multiples of the limit.
_MISFIT_CLIP = 4.0

#: Second difference of the disparity, pixels per cell^2, of a step that cells cannot resolve.
_STEP_BEND = 1.5

#: Largest misfit at a step.
_MAX_STEP_MISFIT = 1.2

#: Tolerated squared registration error at a step, px^2.
_STEP_REGISTRATION_ERROR_PX2 = 0.1

#: Lower bound of the estimated noise variance, fraction of the noise model's.
_MIN_NOISE_FRACTION = 0.02

#: Quantile of the misfit from which the noise variance is estimated.
_NOISE_QUANTILE = 0.1

#: Misfit at that quantile if the images differ by the modelled noise alone.
_NOISE_QUANTILE_MISFIT = 0.92

#: Sigma of the Gaussian mean of the misfit, cells.
_SMOOTHING_CELLS = 2.0

#: The same at a step.
_STEP_SMOOTHING_CELLS = 0.8


def confident_cells(surface: DisparitySurface, lowest: float, highest: float) -> NDArray[np.bool_]:
    """Return the mask (rows, columns) of cells in range that pass the confidence tests."""
    d, sums = surface.disparity, surface.sums
    seen = sums.n > _MIN_SEEN_FRACTION * surface.cell**2
    good = seen & (d > lowest - 1) & (d < highest + 1)
    side = _WINDOW_CELLS[surface.cell]
    fields = (sums.n, sums.s, sums.ss, sums.e, sums.ee, sums.gg, sums.dd)
    n, s, ss, e, ee, gg, dd = parallel_map(lambda field: box(field, side), fields)
    n = np.maximum(n, np.float32(1e-3))
    # Of s = (l + r) / 2 and e = l - r: l r = s s - e e / 4, (l l + r r) / 2 = s s + e e / 4.
    both, apart = ss / n - (s / n) ** 2, 0.25 * (ee / n - (e / n) ** 2)
    good &= both - apart > _MIN_CORRELATION * (both + apart) + _MIN_COVARIANCE
    texture, power = (gg - 0.25 * dd) / n, (gg + 0.25 * dd) / n
    good &= texture > _MIN_GRADIENT_CORRELATION * power
    if not good.any():
        return good
    misfit = _mean_where(surface.misfit, seen, _SMOOTHING_CELLS)
    quiet = float(np.quantile(misfit[good], _NOISE_QUANTILE)) / _NOISE_QUANTILE_MISFIT
    quiet = min(1.0, max(_MIN_NOISE_FRACTION, quiet))
    expected = np.float32(DIFFERENCE_NOISE) * surface.variance
    beside = np.float32(_REGISTRATION_ERROR_PX2) * np.maximum(texture, np.float32(0.0)) / expected
    allowed = beside + np.float32(_MAX_MISFIT * quiet)
    # Clip outliers, so that a few cells on an edge do not reject many cells beside it.
    misfit = _mean_where(np.minimum(surface.misfit, _MISFIT_CLIP * allowed), seen, _SMOOTHING_CELLS)
    good &= misfit < allowed
    step = _largest_bend(d) > _STEP_BEND
    if step.any():
        misfit = _mean_where(surface.misfit, seen, _STEP_SMOOTHING_CELLS)
        excess = (misfit - np.float32(_MAX_STEP_MISFIT * quiet)) * expected
        good &= ~step | (excess < np.float32(_STEP_REGISTRATION_ERROR_PX2) * texture)
    return good


def disparity_sigma(surface: DisparitySurface) -> Grid:
    """Return the standard deviation (rows, columns) float32, pixels, that noise alone causes.

    The posterior variance of a thin plate is 1 / (8 sqrt(weight * stiffness)) where the weight
    varies slowly (value of the plate's Green's function at the origin).
    """
    weight = np.maximum(gauss(surface.weight, _SMOOTHING_CELLS), np.float32(1e-6))
    return np.asarray((64.0 * STIFFNESS[surface.cell] * weight) ** -0.25, dtype=np.float32)


def _mean_where(values: Grid, mask: NDArray[np.bool_], sigma: float) -> Grid:
    share = mask.astype(np.float32)
    mean = gauss(values * share, sigma) / np.maximum(gauss(share, sigma), np.float32(1e-3))
    return np.asarray(mean, dtype=np.float32)


def _largest_bend(d: Grid) -> Grid:
    bend = np.zeros_like(d)
    bend[1:-1] = np.abs(d[:-2] - 2.0 * d[1:-1] + d[2:])
    along = np.abs(d[:, :-2] - 2.0 * d[:, 1:-1] + d[:, 2:])
    np.maximum(bend[:, 1:-1], along, out=bend[:, 1:-1])
    return np.asarray(cv2.dilate(bend, np.ones((3, 3), np.uint8)), dtype=np.float32)
