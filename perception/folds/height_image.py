"""A garment's heights on a coarse grid without holes, for the search for folds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from unwrinkle.models.arrays import Mask
from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap

Floats = NDArray[np.float32]
Points = NDArray[np.float64]

#: Width of the table around the garment that is kept, metres.
_MARGIN_M = 0.03

#: Least share of a cell's area that is garment.
_LEAST_SHARE = 0.5

#: Readings that are averaged along either side of a cell, at least.
_READINGS = 4


@dataclass(frozen=True, eq=False)
class HeightImage:
    """Heights above the table around a garment. Column j lies at x = origin[0] + j * resolution.

    Attributes:
        height: (ny, nx) metres, 0 outside the garment; its holes take the nearest reading.
        garment: (ny, nx) the garment's mask.
        seen: (ny, nx) cells of the garment with readings.
        resolution: side of a cell, metres.
        origin: (2,) world x, y of the centre of cell [0, 0].
    """

    height: Floats
    garment: Mask
    seen: Mask
    resolution: float
    origin: Points

    @cached_property
    def area(self) -> float:
        """Area of the garment seen from above, m^2."""
        return float(np.count_nonzero(self.garment)) * self.resolution**2

    @cached_property
    def unseen(self) -> float:
        """Share of the garment without readings."""
        count = np.count_nonzero(self.garment)
        return float(np.count_nonzero(self.garment & ~self.seen)) / max(1, int(count))

    @cached_property
    def depth(self) -> Floats:
        """Distance (ny, nx) of the garment's cells from its outline, metres."""
        framed = np.pad(self.garment.astype(np.uint8), 1)
        inside = cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(inside, dtype=np.float32)[1:-1, 1:-1] * np.float32(self.resolution)

    def smoothed(self, sigma: float) -> Floats:
        """Return the Gaussian mean within the garment, metres; 0 outside."""
        cells = sigma / self.resolution
        inside = self.garment.astype(np.float32)
        weight = cv2.GaussianBlur(inside, (0, 0), cells, borderType=cv2.BORDER_CONSTANT)
        total = cv2.GaussianBlur(
            self.height * inside, (0, 0), cells, borderType=cv2.BORDER_CONSTANT
        )
        return np.asarray(np.where(self.garment, total / np.maximum(weight, 1e-6), 0.0), np.float32)

    def surface_area(self, sigma: float) -> float:
        """Return the area of the smoothed surface in space, m^2."""
        z = self.smoothed(sigma)
        # Outside the garment the surface goes on level, so that its rim adds no slope.
        rows, columns = ndimage.distance_transform_edt(
            ~self.garment, return_distances=False, return_indices=True
        )
        zy, zx = np.gradient(z[rows, columns], self.resolution)
        slopes = np.sqrt(1.0 + zx * zx + zy * zy)[self.garment]
        return float(slopes.sum()) * self.resolution**2

    def world(self, cells: Points) -> Points:
        """Return the world x, y, metres, of (column, row) points (..., 2)."""
        return self.origin + self.resolution * np.asarray(cells, dtype=float)

    def cells(self, points: Points) -> Points:
        """Return the fractional (column, row) of world points (..., 2), metres."""
        return (np.asarray(points, dtype=float) - self.origin) / self.resolution


def height_image(range_map: RangeMap, cell: float) -> HeightImage:
    """Average a range map's readings in square cells, and fill the garment's holes.

    Args:
        range_map: height above the table, with the garment's mask.
        cell: side of a cell, metres; the nearest multiple of the range map's is taken.

    Raises:
        InputError: there is no garment, or nothing of it was measured.
    """
    size = max(1, round(cell / range_map.resolution))
    resolution = size * range_map.resolution
    window = [_extent(np.asarray(range_map.garment.any(axis=axis))) for axis in (1, 0)]
    margin = size * max(1, round(_MARGIN_M / resolution))
    first = np.array([ends[0] for ends in window]) - margin
    last = np.array([ends[1] for ends in window]) + margin + 1
    ny, nx = (-(-(last - first) // size)).tolist()
    stride = max(1, size // _READINGS)  # of finer maps not every reading is averaged
    offset = first + (size % stride + stride - 1) // 2
    rows, columns = (
        start + stride * np.arange(count * size // stride)
        for start, count in zip(offset, (ny, nx), strict=True)
    )
    row_ok, column_ok = (
        (index >= 0) & (index < length)
        for index, length in zip((rows, columns), range_map.shape, strict=True)
    )
    taken = np.ix_(rows[row_ok], columns[column_ok])
    put = np.ix_(row_ok, column_ok)

    def binned(values: NDArray[Any]) -> Floats:
        whole = np.zeros((len(rows), len(columns)), dtype=np.float32)
        whole[put] = values
        return np.asarray(cv2.resize(whole, (nx, ny), interpolation=cv2.INTER_AREA), np.float32)

    inside = range_map.garment[taken]
    on = inside & range_map.valid[taken]
    share, counted = binned(inside), binned(on)
    total = binned(np.where(on, range_map.height[taken], np.float32(0.0)))
    garment = share > _LEAST_SHARE
    seen = garment & (counted > 0.25 * share)
    if not seen.any():
        raise InputError("range map: nothing of the garment was measured; look again")
    height = np.where(seen, total / np.maximum(counted, 1e-6), 0.0).astype(np.float32)
    beside = ndimage.distance_transform_edt(~seen, return_distances=False, return_indices=True)
    height = np.where(garment & ~seen, height[beside[0], beside[1]], height)
    origin = range_map.origin + range_map.resolution * (first[::-1] + 0.5 * (size - 1))
    return HeightImage(height, garment, seen, resolution, origin)


def _extent(occupied: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the first and the last index that is occupied.

    Raises:
        InputError: none is.
    """
    where = np.flatnonzero(occupied)
    if not len(where):
        raise InputError("range map: no garment in it; look again")
    return int(where[0]), int(where[-1])
