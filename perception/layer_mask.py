"""Where cloth lies on other cloth."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class LayerMask:
    """Cells where layers of cloth lie on each other.

    Column j lies at world x = origin[0] + j * resolution, row i at y = origin[1] + i * resolution.

    Attributes:
        mask: (ny, nx) bool.
        origin: (2,) world x, y of the centre of cell [0, 0], metres.
        resolution: side of a cell, metres.
    """

    mask: NDArray[np.bool_]
    origin: NDArray[np.float64]
    resolution: float

    def at(self, points: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """Return whether layers lie on each other at world points (..., 2), metres."""
        cells = np.rint((np.asarray(points, dtype=float) - self.origin) / self.resolution)
        columns, rows = np.moveaxis(cells.astype(int), -1, 0)
        ny, nx = self.mask.shape
        within = (columns >= 0) & (columns < nx) & (rows >= 0) & (rows < ny)
        return within & self.mask[rows.clip(0, ny - 1), columns.clip(0, nx - 1)]
