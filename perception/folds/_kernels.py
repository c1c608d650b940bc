"""Compiled kernel of the search for steps."""

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.compiled import njit


@njit(nogil=True)
def steepest_steps(
    first: int,
    last: int,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    directions: NDArray[np.int64],
    height: NDArray[np.float32],
    garment: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    weights: NDArray[np.float64],
    spread: int,
    least_weight: float,
    step: NDArray[np.float32],
    chosen: NDArray[np.int64],
) -> None:
    """Find, for the cells [first, last), the direction with the largest step, and that step.

    Args:
        first, last: range of the cells.
        rows, columns: (n,) cells.
        directions: (n,) number of the direction around which is searched.
        height: (ny, nx) metres.
        garment: (ny, nx) 1 on the garment.
        offsets: (directions, samples, 2) row and column offsets of the window ahead; the window
            behind is its mirror image.
        weights: (samples,) that sum to 1.
        spread: directions to both sides that are tried.
        least_weight: share of each window that must lie on the garment.
        step, chosen: (n,) results; step 0 where no window lies on the garment.
    """
    ny, nx = height.shape
    count = offsets.shape[0]
    for n in range(first, last):
        best = 0.0
        for k in range(-spread, spread + 1):
            d = (directions[n] + k) % count
            up = up_weight = down = down_weight = 0.0
            for s in range(weights.shape[0]):
                dr, dc = offsets[d, s, 0], offsets[d, s, 1]
                r, c = rows[n] + dr, columns[n] + dc
                if 0 <= r < ny and 0 <= c < nx and garment[r, c]:
                    up += weights[s] * height[r, c]
                    up_weight += weights[s]
                r, c = rows[n] - dr, columns[n] - dc
                if 0 <= r < ny and 0 <= c < nx and garment[r, c]:
                    down += weights[s] * height[r, c]
                    down_weight += weights[s]
            if up_weight < least_weight or down_weight < least_weight:
                continue
            difference = up / up_weight - down / down_weight
            if difference > best:
                best = difference
                chosen[n] = d
        step[n] = best
