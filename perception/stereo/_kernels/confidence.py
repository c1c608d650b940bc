"""Which cells of a disparity surface to believe: seen, alike in both images, explained by noise.

Three tests over thousands of pixels each. Grey levels and gradients of both images must go
together (normalised correlation, which needs no model of the noise): bare noise and wrong matches
do not. What differs must be explained by the sensor's noise, but for a share that grows with
texture, since rows of a real pair are some tenths of a pixel off. Where the surface has a step that
its cells cannot follow, the images must fit closely.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Grid
from unwrinkle.perception._parallel import parallel_map
from unwrinkle.perception.stereo._kernels.cell_sums import DIFFERENCE_NOISE, box, gauss
from unwrinkle.perception.stereo._kernels.refine import STIFFNESS, DisparitySurface

_SEEN = 0.5  # of a cell's pixels
_WINDOWS = {1: 25, 2: 17, 4: 13}  # cells of so many pixels -> side of the square, cells
_ALIKE, _GRADIENTS_ALIKE = 0.3, 0.06  # least correlations
_FLAT = 0.05  # grey levels^2 of variance below which nothing is alike
_OVER_NOISE = 1.3  # misfit that noise and weak wrongs of the noise model explain
_OFF = 0.6  # square of the pixels by which the images may be off beside it
_WORST = 4.0  # times what is allowed that a cell may bring in
_STEP = 1.5  # pixels per cell^2: a bend that cells of 4 pixels do not follow ...
_STEP_MISFIT, _STEP_OFF = 1.2, 0.1  # ... unless it fits the images so well
_QUIETEST = 0.02  # least share of the noise model's variance that the images may show
_MATCHED = 0.1  # share of cells that shows the noise, and what misfit it has with noise alone
_MATCHED_MISFIT = 0.92
_NEAR, _NEAREST = 2.0, 0.8  # cells, Gaussian of the misfit, and at a step


def confident_cells(surface: DisparitySurface, lowest: float, highest: float) -> NDArray[np.bool_]:
    """Return the cells (rows, columns) bool whose disparity lies in the range and fits the images."""
    d, sums = surface.disparity, surface.sums
    seen = sums.n > _SEEN * surface.cell**2
    good = seen & (d > lowest - 1) & (d < highest + 1)
    side = _WINDOWS[surface.cell]
    fields = (sums.n, sums.s, sums.ss, sums.e, sums.ee, sums.gg, sums.dd)
    n, s, ss, e, ee, gg, dd = parallel_map(lambda field: box(field, side), fields)
    n = np.maximum(n, np.float32(1e-3))
    # Of s = (l + r) / 2 and e = l - r: l r = s s - e e / 4, (l l + r r) / 2 = s s + e e / 4.
    both, apart = ss / n - (s / n) ** 2, 0.25 * (ee / n - (e / n) ** 2)
    good &= both - apart > _ALIKE * (both + apart) + _FLAT
    texture, power = (gg - 0.25 * dd) / n, (gg + 0.25 * dd) / n
    good &= texture > _GRADIENTS_ALIKE * power
    if not good.any():
        return good
    misfit = _mean_where(surface.misfit, seen, _NEAR)
    quiet = float(np.quantile(misfit[good], _MATCHED)) / _MATCHED_MISFIT
    quiet = min(1.0, max(_QUIETEST, quiet))
    expected = np.float32(DIFFERENCE_NOISE) * surface.variance
    beside = np.float32(_OFF) * np.maximum(texture, np.float32(0.0)) / expected
    allowed = beside + np.float32(_OVER_NOISE * quiet)
    # A few cells on an edge must not condemn many beside it.
    misfit = _mean_where(np.minimum(surface.misfit, _WORST * allowed), seen, _NEAR)
    good &= misfit < allowed
    step = _largest_bend(d) > _STEP
    if step.any():
        misfit = _mean_where(surface.misfit, seen, _NEAREST)
        excess = (misfit - np.float32(_STEP_MISFIT * quiet)) * expected
        good &= ~step | (excess < np.float32(_STEP_OFF) * texture)
    return good


def disparity_sigma(surface: DisparitySurface) -> Grid:
    """Return the expected standard deviation (rows, columns) float32, pixels, from noise alone.

    A point's posterior variance under a thin plate is 1 / (8 sqrt(weight * stiffness)) where the
    weight varies slowly (the value of its Green's function at the origin).
    """
    weight = np.maximum(gauss(surface.weight, _NEAR), np.float32(1e-6))
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
