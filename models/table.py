"""The working table: where its top is and how large it is."""

from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array, Mask
from unwrinkle.models.errors import InputError


@dataclass(frozen=True)
class Table:
    """Top of the working table: a level rectangle along the world's x and y axes.

    Attributes:
        centre: world x, y of its centre, m.
        size: extent along world x and y, m.
        height: world z, m; the floor is at 0.
    """

    centre: tuple[float, float]
    size: tuple[float, float]
    height: float

    def __post_init__(self) -> None:
        """Refuse numbers that no table has.

        Raises:
            InputError: a number is missing or not finite, or a size or the height is not positive.
        """
        values = np.array([*self.centre, *self.size, self.height], dtype=float)
        if values.shape != (5,) or not np.isfinite(values).all() or values[2:].min() <= 0.0:
            raise InputError(
                f"{self}: give centre (x, y), size (x, y) and height in metres, the last three "
                "above 0"
            )

    @property
    def top_centre(self) -> Array:
        """Centre (3,) of the top in the world, m."""
        return np.array([*self.centre, self.height])

    def outside(self, points: Array, inset: float = 0.0) -> Mask:
        """Find the points (..., 2) outside the top, less a rim of width `inset`, m.

        Returns:
            (...,) bool.
        """
        half = 0.5 * np.asarray(self.size) - inset
        return np.asarray(np.any(np.abs(np.asarray(points) - self.centre) > half, axis=-1))

    def overhang(self, point: Array, inset: float = 0.0) -> float:
        """Measure how far (x, y) lies outside the top, less a rim of width `inset`, m.

        0 if inside.
        """
        half = 0.5 * np.asarray(self.size) - inset
        beyond = np.abs(np.asarray(point) - np.asarray(self.centre)) - half
        return float(np.hypot(*np.maximum(beyond, 0.0)))
