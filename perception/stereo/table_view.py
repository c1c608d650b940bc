"""The table seen from straight above: the garment's mask, colour and the level of the table on one grid."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models import InputError
from unwrinkle.models.arrays import Pose
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.segmentation import segment
from unwrinkle.perception.height_grid import Grid
from unwrinkle.perception.sensor import NoiseProfile

_COARSE = 0.002  # metres; the garment is sought on cells of about this size
_HALF_SEEN = 0.5
_AWAY = 0.012  # metres from the garment that the table's level is taken at
_CLIP = 3.0
_SAMPLES = 60_000
_LEAST_TABLE = 0.03  # share of the cells


@dataclass(frozen=True, eq=False)
class TableView:
    """Heights over a table's grid, and the camera whose picture goes with them.

    Attributes:
        grid: over the table, aligned with the world.
        height: (ny, nx) metres above the table as the camera's pose has it.
        valid: (ny, nx) bool, where there is a height.
        table_height: world z of the table.
        camera: without distortion.
        X_WC: (4, 4) its pose.
        name: for messages.
    """

    grid: Grid
    height: NDArray[np.float64]
    valid: NDArray[np.bool_]
    table_height: float
    camera: Camera
    X_WC: Pose
    name: str

    def colour(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The camera's picture (h, w, 3) laid over the cells, (ny, nx, 3)."""
        columns, rows = self._pixels
        return np.asarray(cv2.remap(picture, columns, rows, cv2.INTER_LINEAR), dtype=np.uint8)

    def garment(
        self, colour: NDArray[np.uint8], profile: NoiseProfile, seed: int
    ) -> NDArray[np.bool_]:
        """Find the garment, (ny, nx) bool.

        Args:
            colour: (ny, nx, 3) of the cells.
            profile: noise of the heights.
            seed: of GrabCut.

        Raises:
            InputError: there is none.
        """
        size = self._coarse_size
        weight = cv2.resize(self.valid.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        total = cv2.resize(self.height, size, interpolation=cv2.INTER_AREA)
        seen = weight > _HALF_SEEN
        height = np.divide(total, weight, out=np.zeros_like(total), where=seen)
        small = np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), np.uint8)
        try:
            found = segment(height, seen, profile, colour=small, seed=seed)
        except InputError as error:
            raise type(error)(str(error).replace("capture:", f"{self.name}:", 1)) from None
        full = (self.grid.nx, self.grid.ny)
        mask = cv2.resize(found.garment.astype(np.float32), full, interpolation=cv2.INTER_LINEAR)
        return np.asarray(mask) > 0.5

    def levelled(self, garment: NDArray[np.bool_]) -> tuple[NDArray[np.float64], float]:
        """Heights (ny, nx) above the plane fitted to the bare table, and that plane's RMS, metres.

        Raises:
            InputError: too little of the table is bare to know its level.
        """
        radius = round(_AWAY / self.grid.resolution)
        square = np.ones((2 * radius + 1,) * 2, np.uint8)
        away = np.asarray(cv2.dilate(garment.astype(np.uint8), square)) == 0
        rows, columns = np.nonzero(self.valid & away)
        if rows.size < _LEAST_TABLE * garment.size:
            raise InputError(
                f"{self.name}: only {rows.size / garment.size:.1%} of the table is bare and seen, "
                f"at least {_LEAST_TABLE:.0%} are needed to know its level; move the garment"
            )
        step = max(1, rows.size // _SAMPLES)
        rows, columns = rows[::step], columns[::step]
        terms = np.column_stack([columns, rows, np.ones(rows.size)]).astype(float)
        z = self.height[rows, columns]
        keep = np.ones(rows.size, dtype=bool)
        for _ in range(5):
            plane = np.linalg.lstsq(terms[keep], z[keep], rcond=None)[0]
            error = z - terms @ plane
            spread = float(np.sqrt(np.mean(error[keep] ** 2)))
            middle = float(np.median(np.abs(error)))
            keep = np.abs(error) <= _CLIP * max(min(spread, 2.0 * middle), 1e-6)
        i, j = np.arange(self.grid.ny)[:, None], np.arange(self.grid.nx)
        level = plane[0] * j + plane[1] * i + plane[2]
        return np.where(self.valid, self.height - level, 0.0), spread

    @property
    def _coarse_size(self) -> tuple[int, int]:
        factor = min(1.0, self.grid.resolution / _COARSE)
        return max(2, round(self.grid.nx * factor)), max(2, round(self.grid.ny * factor))

    @cached_property
    def _pixels(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Columns and rows (ny, nx) of the pixels that look at the cells."""
        grid = self.grid
        x = grid.x_first + grid.resolution * np.arange(grid.nx) - self.X_WC[0, 3]
        y = (grid.y_first + grid.resolution * np.arange(grid.ny) - self.X_WC[1, 3])[:, None]
        z = self.table_height + self.height - self.X_WC[2, 3]
        R_WC = self.X_WC[:3, :3]
        seen = [R_WC[0, k] * x + R_WC[1, k] * y + R_WC[2, k] * z for k in range(3)]
        columns = self.camera.fx * seen[0] / seen[2] + self.camera.cx
        rows = self.camera.fy * seen[1] / seen[2] + self.camera.cy
        return columns.astype(np.float32), rows.astype(np.float32)
