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
    weights = np.zeros((_ACCUMULATORS, grid.ny, grid.nx), np.float32)
    totals = np.zeros((_ACCUMULATORS, grid.ny, grid.nx), np.float32)
    _splat(
        disparity.disparity,
        disparity.valid,
        np.array([camera.fx, camera.cx, camera.cy, rectification.baseline]),
        rectification.shift - offset,
        to_cells,
        starts,
        np.array(band),
        weights,
        totals,
    )
    averages, enough = filled_averages(
        weights.sum(axis=0, dtype=np.float64), totals.sum(axis=0, dtype=np.float64)[None]
    )
    return averages[0], enough


@njit(parallel=True)
def _splat(disparity, valid, intrinsics, shift, to_cells, starts, band, weights, totals):  # type: ignore[no-untyped-def]
    height, width = disparity.shape
    parts, ny, nx = weights.shape
    focal, cx, cy, baseline = intrinsics
    share = (height + parts - 1) // parts
    for part in numba.prange(parts):
        for v in range(part * share, min(height, (part + 1) * share)):
            y = (v - cy) / focal
            for u in range(width):
                if not valid[v, u]:
                    continue
                over = disparity[v, u] - shift
                if over <= 0.0:
                    continue
                z = focal * baseline / over
                x = (u - cx) / focal
                column = (to_cells[0, 0] * x + to_cells[0, 1] * y + to_cells[0, 2]) * z + starts[0]
                row = (to_cells[1, 0] * x + to_cells[1, 1] * y + to_cells[1, 2]) * z + starts[1]
                if not (column >= 0.0 and column < nx - 1 and row >= 0.0 and row < ny - 1):
                    continue
                tall = (to_cells[2, 0] * x + to_cells[2, 1] * y + to_cells[2, 2]) * z + starts[2]
                if tall < band[0] or tall > band[1]:
                    continue
                j, i = int(column), int(row)
                right, low = column - j, row - i
                for di in range(2):
                    for dj in range(2):
                        weight = (right if dj else 1.0 - right) * (low if di else 1.0 - low)
                        weights[part, i + di, j + dj] += weight
                        totals[part, i + di, j + dj] += weight * tall
