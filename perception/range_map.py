"""Range map: height above the table on a metric grid aligned with the world axes."""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive, save_archive

_FORMAT = "unwrinkle.range_map"
_VERSION = 1


@dataclass(frozen=True, eq=False)
class RangeMap:
    """Height above the table plane on a metric grid.

    Column j lies at world x = origin[0] + j * resolution, row i at world
    y = origin[1] + i * resolution. World frame W: the robot's base on the floor, z up.

    Attributes:
        height: (ny, nx) float32, metres above the table plane; 0 where not valid, never NaN.
        valid: (ny, nx) bool, cells with a measurement.
        garment: (ny, nx) bool, the garment's mask; it may include cells that are not valid.
        resolution: metres per cell along both axes.
        origin: (2,) world x, y of the centre of cell [0, 0].
        table_height: world z of the table plane.
        sensor: name of the noise profile: "stereo", "stereo-head", "xtion" or "tof".
        colour: (ny, nx, 3) uint8 RGB, or None.
        mask_by: data that decided what is garment: "colour", "aligned colour", "depth", or "" if
            that is not known.

    Raises:
        InputError: shapes disagree, a number is not finite, or the resolution is not positive.
    """

    height: NDArray[np.float32]
    valid: NDArray[np.bool_]
    garment: NDArray[np.bool_]
    resolution: float
    origin: NDArray[np.float64]
    table_height: float
    sensor: str
    colour: NDArray[np.uint8] | None = None
    mask_by: str = ""

    def __post_init__(self) -> None:
        """Check the fields, copy the arrays and make them read-only."""
        height = np.array(self.height, dtype=np.float32)
        valid = np.array(self.valid)
        garment = np.array(self.garment)
        origin = np.array(self.origin, dtype=np.float64)
        if height.ndim != 2 or min(height.shape) < 2:
            raise InputError(f"range map: height has shape {height.shape}, wanted (ny, nx)")
        for name, mask in (("valid", valid), ("garment", garment)):
            if mask.shape != height.shape or mask.dtype != np.bool_:
                raise InputError(
                    f"range map: {name} is {mask.dtype} {mask.shape}, wanted bool {height.shape}"
                )
        if origin.shape != (2,) or not np.isfinite(origin).all():
            raise InputError(f"range map: origin {origin} must be two finite numbers")
        if not (isfinite(self.resolution) and self.resolution > 0.0):
            raise InputError(f"range map: resolution {self.resolution} must be positive")
        if not isfinite(self.table_height):
            raise InputError(f"range map: table height {self.table_height} must be finite")
        height[~valid] = 0.0
        if not np.isfinite(height).all():
            raise InputError("range map: height has NaN or infinite cells that are marked valid")
        colour = self.colour
        if colour is not None:
            colour = np.array(colour)
            if colour.shape != (*height.shape, 3) or colour.dtype != np.uint8:
                raise InputError(
                    f"range map: colour is {colour.dtype} {colour.shape}, "
                    f"wanted uint8 {(*height.shape, 3)}"
                )
            colour.setflags(write=False)
        for array in (height, valid, garment, origin):
            array.setflags(write=False)
        object.__setattr__(self, "height", height)
        object.__setattr__(self, "valid", valid)
        object.__setattr__(self, "garment", garment)
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "colour", colour)
        object.__setattr__(self, "resolution", float(self.resolution))
        object.__setattr__(self, "table_height", float(self.table_height))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, (ny, nx)."""
        return self.height.shape

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """World x_min, x_max, y_min, y_max of the grid's outer cell edges, metres."""
        ny, nx = self.shape
        half = 0.5 * self.resolution
        x, y = self.origin
        return (
            float(x - half),
            float(x + (nx - 0.5) * self.resolution),
            float(y - half),
            float(y + (ny - 0.5) * self.resolution),
        )

    def world_from_cell(self, cells: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return the world x, y, metres, of fractional (column, row) points (..., 2)."""
        return self.origin + self.resolution * np.asarray(cells, dtype=np.float64)

    def cell_from_world(self, points: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return the fractional (column, row) of world points (..., 2), metres."""
        return (np.asarray(points, dtype=np.float64) - self.origin) / self.resolution

    def save(self, path: str | Path) -> None:
        """Write one `.npz` with a JSON header, atomically."""
        arrays: dict[str, NDArray[Any]] = {
            "height": self.height,
            "valid": self.valid,
            "garment": self.garment,
            "origin": self.origin,
        }
        if self.colour is not None:
            arrays["colour"] = self.colour
        header = {
            "format": _FORMAT,
            "version": _VERSION,
            "resolution": self.resolution,
            "table_height": self.table_height,
            "sensor": self.sensor,
            "mask_by": self.mask_by,
        }
        save_archive(path, header, arrays)

    @staticmethod
    def load(path: str | Path) -> "RangeMap":
        """Read what `save` wrote.

        Raises:
            InputError: missing, truncated, pickled, of another kind or version, or inconsistent.
        """
        header, arrays = load_archive(path, "height|valid|garment|origin|colour")
        if header.get("format") != _FORMAT:
            raise InputError(f"{path}: is no range map; was it written by another command?")
        if header.get("version") != _VERSION:
            raise InputError(
                f"{path}: range map of version {header.get('version')}, this program reads "
                f"{_VERSION}; analyse the capture again"
            )
        try:
            return RangeMap(
                height=arrays["height"],
                valid=arrays["valid"],
                garment=arrays["garment"],
                resolution=float(header["resolution"]),
                origin=arrays["origin"],
                table_height=float(header["table_height"]),
                sensor=str(header["sensor"]),
                colour=arrays.get("colour"),
                mask_by=str(header.get("mask_by", "")),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: range map lacks or spoils {error}; write it again") from None
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
