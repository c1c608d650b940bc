"""Averaging of scattered heights into a metric grid aligned with the world axes."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

#: Least bilinear weight of a measured cell.
_MIN_WEIGHT = 0.15

#: Limit of a grid's size, cells.
_MAX_CELLS = 40_000_000


@dataclass(frozen=True)
class Grid:
    """Metric grid; cell (i, j) is at x = x_first + j * resolution, y = y_first + i * resolution."""

    x_first: float
    y_first: float
    nx: int
    ny: int
    resolution: float

    @staticmethod
    def over(x: NDArray[Any], y: NDArray[Any], resolution: float, margin: float) -> "Grid":
        """Return the smallest grid over points (n,), metres; cells lie at multiples of resolution.

        Raises:
            ValueError: the grid would have over 40 million cells.
        """
        low_x, low_y = (
            int(np.floor((float(values.min()) - margin) / resolution)) for values in (x, y)
        )
        high_x, high_y = (
            int(np.ceil((float(values.max()) + margin) / resolution)) for values in (x, y)
        )
        nx, ny = high_x - low_x + 1, high_y - low_y + 1
        if nx * ny > _MAX_CELLS:
            raise ValueError(f"a grid of {nx} x {ny} cells is too large")
        return Grid(low_x * resolution, low_y * resolution, nx, ny, resolution)


def average(
    x: NDArray[np.floating[Any]],
    y: NDArray[np.floating[Any]],
    values: NDArray[np.floating[Any]],
    grid: Grid,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Average scattered values into the grid with bilinear weights.

    Each point contributes to the four cells around it. The plain mean of the points in a cell would
    be biased on slopes.

    Args:
        x, y: (n,) metres. Points outside the grid are ignored.
        values: (n,) or (n, k).
        grid: output grid.

    Returns:
        Averages (ny, nx) or (ny, nx, k), 0 in cells without data, and the mask (ny, nx) of cells
        with data; single empty cells between measured ones are filled from them.
    """
    columns = (np.asarray(x, dtype=float) - grid.x_first) / grid.resolution
    rows = (np.asarray(y, dtype=float) - grid.y_first) / grid.resolution
    inside = (columns >= 0) & (columns < grid.nx - 1) & (rows >= 0) & (rows < grid.ny - 1)
    columns, rows = columns[inside], rows[inside]
    flat = np.asarray(values, dtype=float)[inside].reshape(columns.size, -1)
    left, top = columns.astype(np.intp), rows.astype(np.intp)
    right_share, low_share = columns - left, rows - top
    size = grid.nx * grid.ny
    weight = np.zeros(size)
    total = np.zeros((flat.shape[1], size))
    for down in (0, 1):
        for aside in (0, 1):
            share = np.where(down, low_share, 1.0 - low_share)
            share = share * np.where(aside, right_share, 1.0 - right_share)
            index = (top + down) * grid.nx + left + aside
            weight += np.bincount(index, share, minlength=size)
            for k in range(flat.shape[1]):
                total[k] += np.bincount(index, share * flat[:, k], minlength=size)
    averages, enough = filled_averages(
        weight.reshape(grid.ny, grid.nx), total.reshape(-1, grid.ny, grid.nx)
    )
    return (averages[0] if np.ndim(values) == 1 else np.moveaxis(averages, 0, -1)), enough


def filled_averages(
    weights: NDArray[np.float64], totals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Divide weighted sums by their weights and fill single empty cells between measured ones.

    Args:
        weights: (ny, nx) sums of weights.
        totals: (k, ny, nx) sums of weight times value.

    Returns:
        Averages (k, ny, nx), 0 in cells without data, and the mask (ny, nx) of cells with data.
    """
    measured = weights > _MIN_WEIGHT
    # A cell with measured neighbours on both sides is a gap of the sampling, not a hole.
    spread = cv2.GaussianBlur(weights, (5, 5), 0.8)
    gap = ~measured & (_closed(measured) > 0) & (spread > 0.02)
    averages = np.zeros(totals.shape)
    for k, layer in enumerate(totals):
        averages[k][measured] = layer[measured] / weights[measured]
        averages[k][gap] = cv2.GaussianBlur(layer, (5, 5), 0.8)[gap] / spread[gap]
    return averages, measured | gap


def _closed(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return np.asarray(closed, dtype=np.uint8)
