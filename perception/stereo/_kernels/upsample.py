"""Bilinear upsampling of a disparity surface and its mask from cells to pixels."""

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Grid
from unwrinkle.models.compiled import njit
from unwrinkle.perception._parallel import parallel_rows
from unwrinkle.perception.stereo._kernels.normal_equations import upsample_row


def upsample_cells(
    disparity: Grid, good: NDArray[np.bool_], cell: int, shape: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Upsample to disparity (h, w) float32, 0 in cells that are not good, and mask (h, w) bool.

    Args:
        disparity: (rows, columns) at the cells' centres, pixels.
        good: (rows, columns) bool, valid cells.
        cell: side of a cell, pixels.
        shape: (h, w), at most (rows, columns) * cell.
    """
    full, mask = np.empty(shape, np.float32), np.empty(shape, np.bool_)
    flags = good.view(np.uint8), mask.view(np.uint8)
    parallel_rows(_upsample, -(-shape[0] // cell), disparity, flags[0], cell, full, flags[1])
    return full, mask


@njit(nogil=True, fastmath=True)
def _cut_row(row: Grid, keep: Grid, full: Grid) -> None:
    for x in range(full.size):
        full[x] = row[x] * keep[x]


@njit(nogil=True)
def _upsample(
    first: int,
    last: int,
    disparity: Grid,
    good: NDArray[np.uint8],
    cell: int,
    full: NDArray[np.float32],
    mask: NDArray[np.uint8],
) -> None:
    columns, width = disparity.shape[1], full.shape[1]
    line, row = np.empty(columns + 2, np.float32), np.empty(columns * cell, np.float32)
    keep, cut = np.empty(columns * cell, np.float32), np.empty(columns * cell, np.uint8)
    for i in range(first, last):
        for j in range(cell):
            keep[j::cell] = good[i]
            cut[j::cell] = good[i]
        for y in range(i * cell, min((i + 1) * cell, full.shape[0])):
            upsample_row(y, disparity, np.float32(1.0), cell, line, row)
            _cut_row(row, keep, full[y])
            mask[y] = cut[:width]
