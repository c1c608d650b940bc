"""Disparity updates from the normal equations of cells: windowed steps and plate-fit weights."""

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Grid
from unwrinkle.models.compiled import njit
from unwrinkle.perception._parallel import parallel_map, parallel_rows
from unwrinkle.perception.stereo._kernels.normal_equations import CellSums

#: Variance of the difference of both images after rectification and the spline, fraction of a grey
#: level's variance. Measured on matched renders.
DIFFERENCE_NOISE = 0.74

#: Variance of the gradient after rectification and the spline, fraction of a grey level's variance.
GRADIENT_NOISE = 0.156

#: Side of the square over which the brightness of both images is equalised, cells.
_BRIGHTNESS_WINDOW = 21

#: Side of the square over which the texture's share of the squared gradient is estimated, cells.
_TEXTURE_WINDOW = 7

#: Lower bound of that share.
_MIN_TEXTURE_SHARE = 0.1

#: Misfit above which a cell's weight is reduced.
_MISFIT_KNEE = 1.8

#: Lower bound of the noise-corrected squared gradient of a windowed step, fraction of the raw one.
_MIN_GRADIENT_FRACTION = 0.4

#: Damping of a windowed step in weakly textured areas, squared grey levels per pixel squared.
_STEP_DAMPING = 0.03


def gauss(values: Grid, sigma: float) -> Grid:
    """Return the Gaussian mean; sigma in cells."""
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma, borderType=cv2.BORDER_REFLECT_101))


def box(values: Grid, side: int) -> Grid:
    """Return the mean over a square of `side` cells."""
    return np.asarray(cv2.boxFilter(values, -1, (side, side), borderType=cv2.BORDER_REFLECT_101))


def window_step(sums: CellSums, variance: Grid, window: float) -> Grid:
    """Return the disparity change (rows, columns) float32, pixels of the current image, within +-1.

    Least squares of disparity and brightness offset over a Gaussian window (Lucas and Kanade).

    Args:
        sums: normal equations of the cells.
        variance: of a grey level of the current image.
        window: sigma of the window, cells.
    """
    fields = (sums.gg, sums.ge, sums.g, sums.e, sums.n)
    gg, ge, g, e, n = parallel_map(lambda field: gauss(field, window), fields)
    step = np.empty_like(gg)
    parallel_rows(_steps, len(gg), gg, ge, g, e, n, variance, step)
    return step


def weigh(
    sums: CellSums, variance: Grid, side: int, out: NDArray[np.float32]
) -> tuple[Grid, Grid, Grid]:
    """Return weight and pull of each cell for `Plate.fit`, pixels of the current image, and misfit.

    Args:
        sums: normal equations of the cells.
        variance: of a grey level of the current image.
        side: side of the square over which the misfit is averaged, cells. Too small a square would
            give low weight to cells whose disparity still needs correction, because that error also
            raises the misfit.
        out: (3, rows, columns) float32 buffer for the result.
    """
    wanted = [
        (sums.e, _BRIGHTNESS_WINDOW),
        (sums.g, _BRIGHTNESS_WINDOW),
        (sums.n, _BRIGHTNESS_WINDOW),
        (sums.n, _TEXTURE_WINDOW),
        (sums.gg, _TEXTURE_WINDOW),
    ]
    if side > 1:
        wanted += [(sums.ee, side), (sums.e, side), (sums.n, side)]
    mean_e, mean_g, many, near, steep, *fit = parallel_map(lambda field: box(*field), wanted)
    fit = fit or [sums.ee, sums.e, sums.n]
    many = np.maximum(many, np.float32(1e-3))
    means = (mean_e / many, mean_g / many)
    # Only the texture's share of gg constrains the disparity; the rest is the gradient of noise.
    own = np.float32(GRADIENT_NOISE) * variance * near
    share = np.float32(1.0) - own / np.maximum(steep, np.float32(1e-3))
    fields = (sums.gg, sums.ge, sums.g, sums.e, sums.n)
    parallel_rows(_weigh, len(share), variance, fields, tuple(fit), means, share, out)
    weight, pull, misfit = out
    return weight, pull, misfit


@njit(nogil=True, fastmath=True)
def _step_row(gg: Grid, ge: Grid, g: Grid, e: Grid, n: Grid, variance: Grid, step: Grid) -> None:
    one, little = np.float32(1.0), np.float32(1e-3)
    own, least = np.float32(GRADIENT_NOISE), np.float32(_MIN_GRADIENT_FRACTION)
    dull = np.float32(_STEP_DAMPING)
    for x in range(gg.size):
        many = max(n[x], little)
        over = gg[x] - g[x] * g[x] / many
        # The gradient of noise adds to the denominator and would shorten the step.
        over = max(over - own * variance[x] * many, least * over)
        change = (ge[x] - g[x] * e[x] / many) / (over + dull * many)
        step[x] = min(max(change, -one), one)


@njit(nogil=True)
def _steps(
    first: int,
    last: int,
    gg: Grid,
    ge: Grid,
    g: Grid,
    e: Grid,
    n: Grid,
    variance: Grid,
    step: Grid,
) -> None:
    for y in range(first, last):
        _step_row(gg[y], ge[y], g[y], e[y], n[y], variance[y], step[y])


@njit(nogil=True, fastmath=True)
def _weigh_row(
    variance: Grid,
    sums: tuple[Grid, Grid, Grid, Grid, Grid],
    fit: tuple[Grid, Grid, Grid],
    means: tuple[Grid, Grid],
    share: Grid,
    weight: Grid,
    pull: Grid,
    misfit: Grid,
) -> None:
    gg, ge, g, e, n = sums
    ees, es, ns = fit
    mean_e, mean_g = means
    one, two, zero = np.float32(1.0), np.float32(2.0), np.float32(0.0)
    fits, least, noise = (
        np.float32(_MISFIT_KNEE),
        np.float32(_MIN_TEXTURE_SHARE),
        np.float32(DIFFERENCE_NOISE),
    )
    for x in range(gg.size):
        expected = noise * variance[x]
        left = ees[x] + mean_e[x] * (mean_e[x] * ns[x] - two * es[x])
        over = left / (max(ns[x], one) * expected)
        part = min(max(share[x], least), one)
        trust = part / (expected * (one + max(over - fits, zero)))
        # Both means are over the same window; otherwise a low-frequency gradient shortens the step.
        weight[x] = (gg[x] + mean_g[x] * (mean_g[x] * n[x] - two * g[x])) * trust * part
        joint = ge[x] - mean_e[x] * g[x] - mean_g[x] * (e[x] - mean_e[x] * n[x])
        pull[x] = -joint * trust
        misfit[x] = over


@njit(nogil=True)
def _weigh(
    first: int,
    last: int,
    variance: Grid,
    sums: tuple[Grid, Grid, Grid, Grid, Grid],
    fit: tuple[Grid, Grid, Grid],
    means: tuple[Grid, Grid],
    share: Grid,
    out: NDArray[np.float32],
) -> None:
    gg, ge, g, e, n = sums
    ees, es, ns = fit
    mean_e, mean_g = means
    for y in range(first, last):
        row = (gg[y], ge[y], g[y], e[y], n[y])
        fits = (ees[y], es[y], ns[y])
        _weigh_row(
            variance[y],
            row,
            fits,
            (mean_e[y], mean_g[y]),
            share[y],
            out[0, y],
            out[1, y],
            out[2, y],
        )
