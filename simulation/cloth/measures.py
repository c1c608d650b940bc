"""Shape measures of a simulated cloth: coverage, height, overstretch."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.compiled import njit
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.state import ClothState

#: Resolution of the height map for the covered area, m.
RASTER = 1e-3

#: Number of springs over which the stretch of a yarn is measured; that of a single one is noisy.
SPAN = 5


@dataclass(frozen=True)
class TruthMeasures:
    """Shape measures of a garment in one state.

    Attributes:
        coverage: area covered, seen from above, as a fraction of the flat garment's.
        height: height of its highest point above the flat garment, m.
        above_5mm: fraction of the covered area more than 5 mm above the flat garment.
        overstretch: largest relative elongation of a piece of yarn.
    """

    coverage: float
    height: float
    above_5mm: float
    overstretch: float

    def to_json(self) -> dict[str, Any]:
        """Return the measures by name."""
        return asdict(self)


def measure(cloth: Cloth, state: ClothState) -> TruthMeasures:
    """Compute all measures of a state."""
    heights, _ = height_map(cloth, state, RASTER)
    covered = heights[np.isfinite(heights)]
    return TruthMeasures(
        coverage=covered.size * RASTER**2 / cloth.outline.area,
        height=largest_height(cloth, state),
        above_5mm=float((covered > 5e-3).mean()),
        overstretch=overstretch(cloth, state),
    )


def coverage(cloth: Cloth, state: ClothState) -> float:
    """Return the area covered, seen from above, as a fraction of the flat garment's area."""
    heights, _ = height_map(cloth, state, RASTER)
    return float(np.isfinite(heights).sum()) * RASTER**2 / cloth.outline.area


def height_map(
    cloth: Cloth, state: ClothState, resolution: float
) -> tuple[NDArray[np.float64], tuple[float, float]]:
    """Compute the height map of a cloth seen from above.

    Args:
        cloth: the cloth.
        state: its state.
        resolution: side of a cell, m.

    Returns:
        Height (ny, nx) of the uppermost layer above the flat cloth, m, NaN where there is no cloth,
        and the world x, y of the centre of its first cell, m. x grows along columns, y along rows.

    Raises:
        InputError: the resolution is out of range.
    """
    if not (np.isfinite(resolution) and 1e-4 <= resolution <= 0.1):
        raise InputError(f"height map: resolution {resolution:g} m; give 0.0001 to 0.1")
    vertices = cloth.vertices(state)
    origin = np.floor(vertices[:, :2].min(axis=0) / resolution) * resolution
    nx, ny = np.ceil((vertices[:, :2].max(axis=0) - origin) / resolution).astype(int) + 1
    heights = np.full((ny, nx), -np.inf)
    local = vertices - np.array([*origin, cloth.flat_height])
    local[:, :2] /= resolution
    _rasterise(local, cloth.triangles, heights)
    heights[np.isneginf(heights)] = np.nan
    return heights, (float(origin[0]), float(origin[1]))


def largest_height(cloth: Cloth, state: ClothState) -> float:
    """Return the height of the cloth's highest point above the flat cloth, m."""
    return float(cloth.vertices(state)[:, 2].max()) - cloth.flat_height


def overstretch(cloth: Cloth, state: ClothState) -> float:
    """Return the largest relative elongation of five consecutive springs of a yarn; at least 0."""
    grid = state.positions.reshape(3, *cloth.shape)
    mask = cloth.outline.mask
    worst = 0.0
    for axis in (0, 1):
        if mask.shape[axis] <= SPAN:
            continue
        length = np.moveaxis(np.linalg.norm(np.diff(grid, axis=axis + 1), axis=0), axis, 0)
        cut = np.moveaxis(mask, axis, 0)
        joined = cut[1:] & cut[:-1]
        window = np.lib.stride_tricks.sliding_window_view
        whole = window(joined, SPAN, axis=0).all(axis=-1)
        sums = window(length, SPAN, axis=0).sum(axis=-1)[whole]
        if sums.size:
            worst = max(worst, float(sums.max()) / (SPAN * cloth.outline.spacing) - 1.0)
    return worst


@njit()
def _rasterise(
    vertices: NDArray[np.float64], triangles: NDArray[np.intp], heights: NDArray[np.float64]
) -> None:
    """Raise each cell whose centre is under a triangle to the triangle's height; x, y in cells."""
    for t in range(triangles.shape[0]):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-12:
            continue
        low_x = max(0, int(np.ceil(min(a[0], b[0], c[0]))))
        low_y = max(0, int(np.ceil(min(a[1], b[1], c[1]))))
        high_x = min(heights.shape[1] - 1, int(np.floor(max(a[0], b[0], c[0]))))
        high_y = min(heights.shape[0] - 1, int(np.floor(max(a[1], b[1], c[1]))))
        for y in range(low_y, high_y + 1):
            for x in range(low_x, high_x + 1):
                v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
                w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
                if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
                    z = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
                    heights[y, x] = max(heights[y, x], z)
