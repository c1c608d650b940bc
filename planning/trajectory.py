"""The sampled cubic that planning, drivers and simulation share, and the trajectory of the robot's
axes made of it.

A controller interpolates cubically between the samples that it is sent, so positions between
samples, and extremes of speed, acceleration and jerk, are those of the Hermite cubics. The
verification computes them in its own way on purpose (`planning.verification`).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError

AXES = 13
#: Excess over a limit that is rounding, relative to the limit.
LIMIT_ROUNDING = 1e-6
#: Largest speed of an axis at the ends of a trajectory from rest to rest, rad/s.
REST_SPEED_RAD_S = 1e-6


@dataclass(frozen=True, eq=False)
class Extremes:
    """Exact extremes of sampled cubics, (A,) each.

    Attributes:
        lower, upper: lowest and highest position, rad.
        speed: rad/s.
        acceleration: rad/s^2.
        jerk: rad/s^3.
    """

    lower: Array
    upper: Array
    speed: Array
    acceleration: Array
    jerk: Array


@dataclass(frozen=True, eq=False)
class SampledCubic:
    """Samples of A axes on one clock, with a Hermite cubic between two of them.

    Attributes:
        times: (N,) s, from 0, strictly increasing, N >= 2.
        positions: (N, A) rad.
        velocities: (N, A) rad/s.

    Raises:
        InputError: shapes disagree, or finite times do not start at 0 or increase. Values that are
            not finite are accepted; see `finite`.
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
                f"sampled cubic: times {self.times.shape} and positions {shape} must be (N,) and "
                "(N, A), N >= 2"
            )
        if self.velocities.shape != shape:
            raise InputError(
                f"sampled cubic: velocities {self.velocities.shape}, positions {shape}"
            )
        if np.isfinite(self.times).all() and not _increases_from_zero(self.times):
            raise InputError("sampled cubic: times must start at 0 and increase")

    @property
    def duration(self) -> float:
        """Time of the last sample, s."""
        return float(self.times[-1])

    @property
    def finite(self) -> bool:
        """Whether every number is finite."""
        return all(
            bool(np.isfinite(a).all()) for a in (self.times, self.positions, self.velocities)
        )

    @property
    def rests_at_ends(self) -> bool:
        """Whether every axis is at rest at the first and the last sample."""
        return bool(np.abs(self.velocities[[0, -1]]).max() <= REST_SPEED_RAD_S)

    def at(self, t: float | Array) -> tuple[Array, Array]:
        """Return positions, rad, and velocities, rad/s, (..., A) each, at times t (...) from 0 to
        `duration`, s.
        """
        return self._spline(t), self._spline(t, 1)

    def derivatives(self, t: float | Array) -> tuple[Array, Array, Array]:
        """Return velocities, rad/s, accelerations, rad/s^2, and jerks, rad/s^3, (..., A) each, at
        times t (...), s.
        """
        return self._spline(t, 1), self._spline(t, 2), self._spline(t, 3)

    def extremes(self) -> Extremes:
        """Return the exact extremes of the cubics, closed form."""
        a, b, c, _ = self._spline.c
        step = np.diff(self.times)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(b * b - 3.0 * a * c)
            q = -(b + np.where(b >= 0.0, root, -root))  # the form without cancellation
            turning_points = (q / (3.0 * a), c / q)
        lower, upper = self.positions.min(axis=0), self.positions.max(axis=0)
        for u in turning_points:
            u = np.where((u > 0.0) & (u < step), u, 0.0)
            value = ((a * u + b) * u + c) * u + self.positions[:-1]
            lower, upper = (
                np.minimum(lower, value.min(axis=0)),
                np.maximum(upper, value.max(axis=0)),
            )
        return Extremes(lower, upper, *rate_extremes(self.times, self.positions, self.velocities))

    def interpolant(self) -> CubicHermiteSpline:
        """Return the cubics as scipy's spline: positions (..., A), rad, of time, s."""
        return self._spline

    @cached_property
    def _spline(self) -> CubicHermiteSpline:
        return CubicHermiteSpline(self.times, self.positions, self.velocities)


@dataclass(frozen=True, eq=False)
class Trajectory(SampledCubic):
    """Samples of turn-table, right arm and left arm, as they are sent to the controller.

    Attributes:
        times: (N,) s, from 0, strictly increasing, N >= 2.
        positions: (N, 13) rad.
        velocities: (N, 13) rad/s.

    Raises:
        InputError: a shape does not fit, a value is not finite, or time does not increase.
    """

    def __post_init__(self) -> None:
        """Check and freeze the arrays."""
        count = np.size(self.times)
        shapes = {"times": (count,), "positions": (count, AXES), "velocities": (count, AXES)}
        for name, shape in shapes.items():
            value = np.array(getattr(self, name), dtype=float)
            if value.shape != shape or count < 2:
                raise InputError(f"trajectory {name} have shape {value.shape}, expected {shape}")
            bad = np.argwhere(~np.isfinite(value))
            if len(bad):
                where = ", ".join(str(i) for i in bad[0])
                raise InputError(f"trajectory {name}[{where}] is not a finite number")
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if not _increases_from_zero(self.times):
            raise InputError("trajectory times must start at 0 and increase")


def rate_extremes(times: Array, positions: Array, velocities: Array) -> tuple[Array, Array, Array]:
    """Return the greatest speed, acceleration and jerk of the cubics through samples, exactly.

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
    half_jerk = 3.0 * (v0 + v1 - 2.0 * slope) / step**2
    begin = 2.0 * (3.0 * slope - 2.0 * v0 - v1) / step  # acceleration
    end = begin + 2.0 * half_jerk * step
    speed = np.abs(velocities).max(axis=0)
    inside = begin * end < 0.0  # the speed has an extreme within the piece
    if inside.any():
        turning = v0 - 0.25 * begin**2 / np.where(inside, half_jerk, 1.0)
        speed = np.maximum(speed, np.abs(np.where(inside, turning, 0.0)).max(axis=0))
    acceleration = np.maximum(np.abs(begin), np.abs(end)).max(axis=0)
    return speed, acceleration, 2.0 * np.abs(half_jerk).max(axis=0)


def hermite_positions(times: Array, positions: Array, velocities: Array, t: Array) -> Array:
    """Return the positions (n, A) of the cubics through samples at times t (n,), from the Hermite
    basis.

    For samples that change from call to call, where the coefficients of scipy's spline would be
    computed in vain.

    Args:
        times: (N,) s, increasing, N >= 2.
        positions: (N, A) rad.
        velocities: (N, A) rad/s.
        t: s, within the samples' times.
    """
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    h = (times[i + 1] - times[i])[:, None]
    x = (t - times[i])[:, None] / h
    value: Array = (
        positions[i] * (1.0 + 2.0 * x) * (1.0 - x) ** 2
        + positions[i + 1] * x**2 * (3.0 - 2.0 * x)
        + h * x * (1.0 - x) * (velocities[i] * (1.0 - x) - velocities[i + 1] * x)
    )
    return value


def _increases_from_zero(times: Array) -> bool:
    return bool(times[0] == 0.0 and (np.diff(times) > 0.0).all())
