"""Orthographic view of the table: heights, colour, garment mask and levelling on one grid."""

import logging
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InsufficientViewError, SeveralGarmentsError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.pieces import refuse_other_pieces
from unwrinkle.perception.depth.segmentation import segment
from unwrinkle.perception.height_grid import Grid
from unwrinkle.perception.sensor import NoiseProfile

_log = logging.getLogger(__name__)

#: Approximate cell size for the segmentation of the garment, metres.
_COARSE_CELL_M = 0.002

#: Least fraction of measured cells in a coarse cell.
_MIN_MEASURED_FRACTION = 0.5

#: Distance from the garment of the cells that the table's plane is fitted to, metres.
_GARMENT_CLEARANCE_M = 0.012

#: Outlier limit of that fit, multiples of the robust spread.
_OUTLIER_CLIP = 3.0

#: Limit of the cells in that fit.
_MAX_FIT_CELLS = 60_000

#: Least fraction of bare table cells.
_MIN_TABLE_FRACTION = 0.03


@dataclass(frozen=True, eq=False)
class TableView:
    """Heights on a grid over the table, with the camera that they were measured from.

    Attributes:
        grid: over the table, aligned with the world.
        height: (ny, nx) heights above the table by the camera's pose, metres.
        valid: (ny, nx) bool, cells with a height.
        table_height: world z of the table, metres.
        camera: pinhole camera without distortion.
        X_WC: (4, 4) pose of the camera in the world.
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
        """Project the camera's image (h, w, 3) onto the cells; return (ny, nx, 3)."""
        columns, rows = self._pixels
        return np.asarray(cv2.remap(picture, columns, rows, cv2.INTER_LINEAR), dtype=np.uint8)

    def garment(
        self, colour: NDArray[np.uint8], profile: NoiseProfile, seed: int
    ) -> NDArray[np.bool_]:
        """Segment the garment; return its mask (ny, nx).

        Args:
            colour: (ny, nx, 3) colour of the cells.
            profile: noise of the heights.
            seed: of GrabCut.

        Raises:
            NoGarmentError: there is no garment on the table.
        """
        size = self._coarse_size
        weight = cv2.resize(self.valid.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        total = cv2.resize(self.height, size, interpolation=cv2.INTER_AREA)
        seen = weight > _MIN_MEASURED_FRACTION
        height = np.divide(total, weight, out=np.zeros_like(total), where=seen)
        small = np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), np.uint8)
        found = segment(height, seen, profile, colour=small, seed=seed, name=self.name)
        pixel = self.grid.resolution * self.grid.nx / size[0]
        try:
            refuse_other_pieces(found.garment, found.raised, pixel, self.name)
        except SeveralGarmentsError as error:
            # A garment of the loop may be seen in parts; the largest one is pulled.
            _log.warning("%s. The first one is taken", error)
        full = (self.grid.nx, self.grid.ny)
        mask = cv2.resize(found.garment.astype(np.float32), full, interpolation=cv2.INTER_LINEAR)
        return np.asarray(mask) > 0.5

    def levelled(self, garment: NDArray[np.bool_]) -> tuple[NDArray[np.float64], float]:
        """Return the heights (ny, nx) above a plane fitted to the bare table, and its RMS, metres.

        Raises:
            InsufficientViewError: too little bare table is measured.
        """
        radius = round(_GARMENT_CLEARANCE_M / self.grid.resolution)
        square = np.ones((2 * radius + 1,) * 2, np.uint8)
        away = np.asarray(cv2.dilate(garment.astype(np.uint8), square)) == 0
        rows, columns = np.nonzero(self.valid & away)
        if rows.size < _MIN_TABLE_FRACTION * garment.size:
            raise InsufficientViewError(
                f"{self.name}: only {rows.size / garment.size:.1%} of the table is bare and seen, "
                f"at least {_MIN_TABLE_FRACTION:.0%} are needed to know its level; move the garment"
            )
        step = max(1, rows.size // _MAX_FIT_CELLS)
        rows, columns = rows[::step], columns[::step]
        terms = np.column_stack([columns, rows, np.ones(rows.size)]).astype(float)
        z = self.height[rows, columns]
        keep = np.ones(rows.size, dtype=bool)
        for _ in range(5):
            plane = np.linalg.lstsq(terms[keep], z[keep], rcond=None)[0]
            error = z - terms @ plane
            spread = float(np.sqrt(np.mean(error[keep] ** 2)))
            middle = float(np.median(np.abs(error)))
            keep = np.abs(error) <= _OUTLIER_CLIP * max(min(spread, 2.0 * middle), 1e-6)
        i, j = np.arange(self.grid.ny)[:, None], np.arange(self.grid.nx)
        level = plane[0] * j + plane[1] * i + plane[2]
        return np.where(self.valid, self.height - level, 0.0), spread

    @property
    def _coarse_size(self) -> tuple[int, int]:
        factor = min(1.0, self.grid.resolution / _COARSE_CELL_M)
        return max(2, round(self.grid.nx * factor)), max(2, round(self.grid.ny * factor))

    @cached_property
    def _pixels(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Columns and rows (ny, nx) of the cells in the camera's image, pixels."""
        grid = self.grid
        x = grid.x_first + grid.resolution * np.arange(grid.nx) - self.X_WC[0, 3]
        y = (grid.y_first + grid.resolution * np.arange(grid.ny) - self.X_WC[1, 3])[:, None]
        z = self.table_height + self.height - self.X_WC[2, 3]
        R_WC = self.X_WC[:3, :3]
        seen = [R_WC[0, k] * x + R_WC[1, k] * y + R_WC[2, k] * z for k in range(3)]
        columns = self.camera.fx * seen[0] / seen[2] + self.camera.cx
        rows = self.camera.fy * seen[1] / seen[2] + self.camera.cy
        return columns.astype(np.float32), rows.astype(np.float32)
