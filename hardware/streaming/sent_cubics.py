"""The cubics that the controller runs between the points it is sent: their extremes, and the path made of them."""

import dataclasses as dc
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.limits import Limits
from unwrinkle.planning.trajectory import AXES, Trajectory

#: Greatest speed, acceleration and jerk, (13,) each.
Extremes = tuple[Array, Array, Array]

_RELATIVE = 1e-6  # of a limit: rounding, no excess
_TINY = 1e-7  # of a millisecond: rounding
_SAME = 1e-9  # s


def ceil_ms(time: float) -> float:
    """The first whole millisecond not before a time, s."""
    return ceil(1e3 * time - _TINY) / 1e3


@dataclass(frozen=True, eq=False)
class StreamLimits:
    """Limits of the motion that is sent; each (13,).

    Attributes:
        velocity: rad/s.
        acceleration: rad/s^2.
        jerk: rad/s^3.

    Raises:
        InputError: not thirteen positive numbers each.
    """

    velocity: Array
    acceleration: Array
    jerk: Array

    def __post_init__(self) -> None:
        """Check and freeze."""
        for item in dc.fields(self):
            value = np.array(getattr(self, item.name), dtype=float)
            if value.shape != (AXES,) or not (np.isfinite(value).all() and value.min() > 0.0):
                raise InputError(
                    f"limits of the stream: {item.name} needs {AXES} positive numbers, got {value}"
                )
            value.setflags(write=False)
            object.__setattr__(self, item.name, value)

    @classmethod
    def of(cls, limits: Limits) -> "StreamLimits":
        """Those of the robot."""
        return cls(limits.velocity, limits.acceleration, limits.jerk)

    def widened(self, own: Extremes) -> "StreamLimits":
        """The same, but at least what a trajectory uses by itself."""
        bounds = (self.velocity, self.acceleration, self.jerk)
        return StreamLimits(*(np.maximum(a, b) for a, b in zip(bounds, own, strict=True)))

    def keeps(self, values: Extremes) -> bool:
        """Whether extremes keep the limits."""
        bounds = (self.velocity, self.acceleration, self.jerk)
        return all(
            bool((value <= bound * (1.0 + _RELATIVE)).all())
            for value, bound in zip(values, bounds, strict=True)
        )


def extremes(times: Array, positions: Array, velocities: Array) -> Extremes:
    """Greatest speed, acceleration and jerk of the cubics through samples, exactly.

    Args:
        times: (N,) s, increasing.
        positions: (N, A) rad.
        velocities: (N, A) rad/s.

    Returns:
        (A,) each: rad/s, rad/s^2, rad/s^3.
    """
    step = np.diff(times)[:, None]
    slope = np.diff(positions, axis=0) / step
    v0, v1 = velocities[:-1], velocities[1:]
    half_jerk = 3.0 * (v0 + v1 - 2.0 * slope) / step**2  # 3 a of the cubic
    begin = 2.0 * (3.0 * slope - 2.0 * v0 - v1) / step  # acceleration
    end = begin + 2.0 * half_jerk * step
    speed = np.abs(velocities).max(axis=0)
    inside = begin * end < 0.0  # the speed turns within
    if inside.any():
        turning = v0 - 0.25 * begin**2 / np.where(inside, half_jerk, 1.0)
        speed = np.maximum(speed, np.abs(np.where(inside, turning, 0.0)).max(axis=0))
    acceleration = np.maximum(np.abs(begin), np.abs(end)).max(axis=0)
    return speed, acceleration, 2.0 * np.abs(half_jerk).max(axis=0)


class CubicPath:
    """A trajectory as a path q(s), s being its own time.

    Attributes:
        knots: (N,) s.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        """Take a trajectory's samples."""
        self.knots = trajectory.times
        self._positions = trajectory.positions
        self._slopes = trajectory.velocities
        spline = CubicHermiteSpline(self.knots, self._positions, self._slopes)
        self._coefficients: Array = np.ascontiguousarray(np.moveaxis(spline.c, 0, 1))

    @property
    def end(self) -> float:
        """s of the last knot."""
        return float(self.knots[-1])

    def knot(self, index: int) -> tuple[Array, Array]:
        """The trajectory's own sample: positions and slopes, (13,)."""
        return self._positions[index], self._slopes[index]

    def knot_before(self, s: float) -> float:
        """s of the last knot that is not beyond s."""
        index = int(np.searchsorted(self.knots, s + _SAME, side="right")) - 1
        return float(self.knots[max(index, 0)])

    def has_knot(self, s: float) -> bool:
        """Whether the trajectory has a sample of its own at s."""
        return bool(np.abs(self.knots - s).min() < _SAME)

    def knot_after(self, s: float) -> tuple[int, float]:
        """Index and s of the first knot behind s; the last one if there is none."""
        index = min(int(np.searchsorted(self.knots, s, side="right")), len(self.knots) - 1)
        return index, float(self.knots[index])

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        """First to third derivative by s, (..., 13), at s (...)."""
        piece = self._piece(s)
        u = (s - self.knots[piece])[..., None]
        c = self._coefficients[piece]
        a, b, v = c[..., 0, :], c[..., 1, :], c[..., 2, :]
        return (3.0 * a * u + 2.0 * b) * u + v, 6.0 * a * u + 2.0 * b, 6.0 * a

    def at(self, s: float | Array) -> tuple[Array, Array]:
        """Position and slope dq/ds, (..., 13), at s (...)."""
        piece = self._piece(s)
        u = np.asarray(s - self.knots[piece])[..., None]
        c = self._coefficients[piece]
        a, b, v, q = c[..., 0, :], c[..., 1, :], c[..., 2, :], c[..., 3, :]
        return ((a * u + b) * u + v) * u + q, (3.0 * a * u + 2.0 * b) * u + v

    def _piece(self, s: float | Array) -> NDArray[np.intp]:
        """Index of the cubic at s."""
        return np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
