"""The sums over cells against a plain computation of the same, pixel by pixel."""

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.perception.stereo._kernels.normal_equations import cell_sums
from unwrinkle.perception.stereo._kernels.upsample import upsample_cells


def b_spline(t: NDArray[np.float64]) -> NDArray[np.float64]:
    t = np.abs(t)
    inside = (4.0 - 6.0 * t**2 + 3.0 * t**3) / 6.0
    return np.where(t < 1.0, inside, np.where(t < 2.0, (2.0 - t) ** 3 / 6.0, 0.0))


def spline_at(row: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(b_spline(x[:, None] - np.arange(row.size)) @ row)


@pytest.mark.parametrize("cell", [1, 2, 4])
def test_sums_are_those_of_the_plain_computation(cell: int) -> None:
    rng = np.random.default_rng(cell)
    rows, columns = 10, 24
    left, right = rng.integers(1, 256, (2, rows * cell, columns * cell), dtype=np.uint8)
    left[4 * cell : 5 * cell, 8 * cell : 9 * cell] = 0
    disparity = rng.uniform(-3.0, 3.0, (rows, columns)).astype(np.float32)
    scale = 0.7
    got = cell_sums(left, right, disparity, cell, scale)
    good = np.ones((rows, columns), bool)
    full, _ = upsample_cells(disparity, good, cell, left.shape)
    x = np.arange(left.shape[1])
    for y in range(0, left.shape[0], max(1, cell - 1)):
        i = y // cell
        within = y - i * cell
        places = x - scale * full[y].astype(float)
        value, step = spline_at(right[y].astype(float), places), 1e-5
        slope = spline_at(right[y].astype(float), places + step) - value
        smooth = spline_at(left[y].astype(float), x.astype(float))
        rise = spline_at(left[y].astype(float), x + step) - smooth
        inside = (places >= 1) & (places <= left.shape[1] - 3) & (x > 0) & (x < x[-1])
        on = inside & (left[y] > 0)
        error, gradient = (smooth - value) * on, 0.5 * (slope + rise) / step * on
        terms = {
            "gg": gradient**2,
            "ge": gradient * error,
            "g": gradient,
            "e": error,
            "ee": error**2,
            "n": on * 1.0,
            "s": (0.5 * (smooth + value) - 128.0) * on,
            "dd": ((rise - slope) / step * on) ** 2,
        }
        if cell > 1:
            # The other rows of the cell, so that one row is compared: what they add is left out.
            others = left.copy(), right.copy()
            keep = np.zeros(left.shape[0], bool)
            keep[y] = True
            others[0][~keep], others[1][~keep] = 0, 0
            got = cell_sums(*others, disparity, cell, scale)
            assert within < cell
        for name, plain in terms.items():
            expected = plain.reshape(columns, cell).sum(axis=1)
            np.testing.assert_allclose(
                getattr(got, name)[i], expected, rtol=2e-3, atol=0.5, err_msg=name
            )


@pytest.mark.parametrize("cell", [1, 2, 4])
def test_spreading_a_slope_keeps_pixel_centres(cell: int) -> None:
    rows, columns = 20, 30
    y, x = np.mgrid[: rows * cell, : columns * cell].astype(float)
    slope = 0.3 * x - 0.2 * y + 4.0
    centres = slope.reshape(rows, cell, columns, cell).mean(axis=(1, 3)).astype(np.float32)
    good = np.ones((rows, columns), bool)
    good[5, 7] = False
    shape = rows * cell - (cell - 1), columns * cell - (cell - 1)
    full, mask = upsample_cells(centres, good, cell, shape)
    inner = (slice(cell, -cell), slice(cell, -cell))
    error = np.where(mask, full - slope[: shape[0], : shape[1]], 0.0)
    np.testing.assert_allclose(error[inner], 0.0, atol=1e-4)
    assert (~mask).sum() == cell**2 and not full[~mask].any()
    assert not mask[5 * cell, 7 * cell]
