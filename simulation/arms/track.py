"""Samples of any number of axes with cubics in between, as a robot's controller interpolates them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError


@dataclass(frozen=True, eq=False)
class Track:
    """Samples of A axes with a cubic in between, as a controller interpolates them.

    Attributes:
        times: (N,) s, from 0, increasing, N >= 2.
        positions: (N, A) rad.
        velocities: (N, A) rad/s.

    Raises:
        InputError: shapes disagree, or time does not start at 0 or increase. Values that are not
            finite are left to the player, which refuses them with a reason.
    """

    times: Array
    positions: Array
    velocities: Array

    def __post_init__(self) -> None:
        """Check shapes, copy and freeze."""
        for name in ("times", "positions", "velocities"):
            value = np.array(getattr(self, name), dtype=float)
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        count = self.times.size
        shape = self.positions.shape
        if count < 2 or self.times.shape != (count,) or len(shape) != 2 or shape[0] != count:
            raise InputError(
                f"track: times {self.times.shape} and positions {shape} must be (N,) and (N, A), N >= 2"
            )
        if self.velocities.shape != shape:
            raise InputError(f"track: velocities {self.velocities.shape}, positions {shape}")
        if np.isfinite(self.times).all() and not (
            self.times[0] == 0.0 and (np.diff(self.times) > 0.0).all()
        ):
            raise InputError("track: times must start at 0 and increase")

    @property
    def duration(self) -> float:
        """Time of the last sample, s."""
        return float(self.times[-1])

    @property
    def finite(self) -> bool:
        """Whether every number in it is finite."""
        return all(
            bool(np.isfinite(a).all()) for a in (self.times, self.positions, self.velocities)
        )

    @cached_property
    def _coefficients(self) -> Array:
        """(4, N - 1, A), cubic first."""
        return np.asarray(CubicHermiteSpline(self.times, self.positions, self.velocities).c)

    def at(self, s: float) -> tuple[Array, Array, Array]:
        """Position, first and second derivative by s, each (A,), at a clock time within the track."""
        piece = int(np.searchsorted(self.times, s, side="right")) - 1
        piece = min(max(piece, 0), len(self.times) - 2)
        a, b, c, d = self._coefficients[:, piece]
        u = s - self.times[piece]
        return ((a * u + b) * u + c) * u + d, (3.0 * a * u + 2.0 * b) * u + c, 6.0 * a * u + 2.0 * b

    def extremes(self) -> tuple[Array, Array, Array, Array]:
        """Lowest and highest position, highest speed and acceleration (A,), cubics between samples included."""
        a, b, c, _ = self._coefficients
        step = np.diff(self.times)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            turning = [np.where(a == 0.0, np.nan, -b / (3.0 * a))]  # of the velocity
            root = np.sqrt(b * b - 3.0 * a * c)
            # Where the position turns; the form that does not cancel.
            q = -(b + np.where(b >= 0.0, root, -root))
            stops = [q / (3.0 * a), c / q]
        peak = np.abs(self.velocities).max(axis=0)
        for u in turning:
            inside = (u > 0.0) & (u < step)
            u = np.where(inside, u, 0.0)
            peak = np.maximum(peak, np.abs((3.0 * a * u + 2.0 * b) * u + c).max(axis=0))
        low, high = self.positions.min(axis=0), self.positions.max(axis=0)
        for u in stops:
            u = np.where((u > 0.0) & (u < step), u, 0.0)
            value = ((a * u + b) * u + c) * u + self.positions[:-1]
            low, high = np.minimum(low, value.min(axis=0)), np.maximum(high, value.max(axis=0))
        ends = np.maximum(np.abs(2.0 * b), np.abs(6.0 * a * step + 2.0 * b))
        return low, high, peak, ends.max(axis=0)
