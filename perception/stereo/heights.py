"""Heights above a plane from disparities, averaged on a metric grid."""

import numba
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.compiled import njit
from unwrinkle.perception.height_grid import Grid, filled_averages
from unwrinkle.perception.stereo.matching import Disparity
from unwrinkle.perception.stereo.rectification import Rectification

#: Accumulators, one per thread; more would cost memory.
_ACCUMULATORS = 2


def heights_on_grid(
    disparity: Disparity,
    rectification: Rectification,
    X_WC: Pose,
    plane_C: tuple[NDArray[np.float64], float],
    grid: Grid,
    *,
    offset: float = 0.0,
    band: tuple[float, float] = (-np.inf, np.inf),
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Average the heights of all valid pixels into a grid with bilinear weights.

    Args:
        disparity: of the rectified pair.
        rectification: geometry of the pair; C is the rectified left camera.
        X_WC: (4, 4) pose of C in the world.
        plane_C: unit normal (3,) towards the camera and distance, metres, of the plane in C; the
            height of p is n . p + distance.
        grid: output grid.
        offset: added to every disparity, pixels.
        band: least and largest accepted height, metres.

    Returns:
        Heights (ny, nx), metres, 0 in cells without data, and the mask (ny, nx) of cells with data.
    """
    camera = rectification.camera
    normal, distance = plane_C
    to_cells = np.array(
        [
            (X_WC[0, :3] / grid.resolution),
            (X_WC[1, :3] / grid.resolution),
            normal,
        ]
    )
    starts = np.array(
        [
            (X_WC[0, 3] - grid.x_first) / grid.resolution,
            (X_WC[1, 3] - grid.y_first) / grid.resolution,
            distance,
        ]
    )
    # The sum of the weights and that of the weighted heights lie side by side in memory.
    sums = np.zeros((_ACCUMULATORS, grid.ny, grid.nx, 2), np.float32)
    _splat(
        disparity.disparity,
        disparity.valid,
        np.array([camera.fx, camera.cx, camera.cy, rectification.baseline]),
        rectification.shift - offset,
        to_cells,
        starts,
        np.array(band),
        sums,
    )
    weights, totals = np.moveaxis(sums.sum(axis=0, dtype=np.float64), -1, 0)
    averages, enough = filled_averages(weights, totals[None])
    return averages[0], enough


@njit(parallel=True)
def _splat(disparity, valid, intrinsics, shift, to_cells, starts, band, sums):  # type: ignore[no-untyped-def]
    height, width = disparity.shape
    parts, ny, nx, _ = sums.shape
    focal, cx, cy, baseline = intrinsics
    scale, low_end, high_end = focal * baseline, band[0], band[1]
    per_column = to_cells[:, 0] / focal
    share = (height + parts - 1) // parts
    for part in numba.prange(parts):
        # Scalars, since the compiler cannot know that writing the sums leaves the arrays alone.
        a_u, b_u, c_u = per_column[0], per_column[1], per_column[2]
        a_0, b_0, c_0 = starts[0], starts[1], starts[2]
        for v in range(part * share, min(height, (part + 1) * share)):
            y = (v - cy) / focal
            a_v = to_cells[0, 1] * y + to_cells[0, 2] - a_u * cx
            b_v = to_cells[1, 1] * y + to_cells[1, 2] - b_u * cx
            c_v = to_cells[2, 1] * y + to_cells[2, 2] - c_u * cx
            for u in range(width):
                if not valid[v, u]:
                    continue
                over = disparity[v, u] - shift
                if over <= 0.0:
                    continue
                z = scale / over
                column = (a_u * u + a_v) * z + a_0
                row = (b_u * u + b_v) * z + b_0
                if not (column >= 0.0 and column < nx - 1 and row >= 0.0 and row < ny - 1):
                    continue
                tall = (c_u * u + c_v) * z + c_0
                if tall < low_end or tall > high_end:
                    continue
                j, i = int(column), int(row)
                right, low = column - j, row - i
                for di in range(2):
                    for dj in range(2):
                        weight = (right if dj else 1.0 - right) * (low if di else 1.0 - low)
                        sums[part, i + di, j + dj, 0] += weight
                        sums[part, i + di, j + dj, 1] += weight * tall
