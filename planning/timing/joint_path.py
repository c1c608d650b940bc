"""Curved paths through joint space, the limits along them, and paths with a law of motion."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError

_SHORTEST = 1e-9  # rad; a path with less motion cannot be timed


@dataclass(frozen=True)
class PathLimits:
    """Limits along a path: joint velocity, acceleration, jerk (n,), and optionally the speed of the
    tool centre points, m/s.
    """

    velocity: Array
    acceleration: Array
    jerk: Array
    tip_speed: float | None = None


@dataclass(frozen=True, eq=False)
class JointPath:
    """A geometric path through joint space.

    Attributes:
        spline: quintic spline (n axes) over s in [0, 1].
        tip_rate: for s (M,), the greater of the two tool centre points' `|dp/ds|`, m; None where it
            does not matter.
    """

    spline: BSpline
    tip_rate: CubicSpline | None = None

    @classmethod
    def through(cls, points: Array, tips: Array | None = None) -> "JointPath":
        """A path through points (N, n) at equal steps of s, N >= 8.

        Args:
            points: configurations, rad.
            tips: (N, 2, 3) tool centre points there, m, where their speed is to be limited.

        Raises:
            InputError: the path has no length, or a number in it is not finite.
        """
        if not np.isfinite(points).all():
            raise InputError(f"a path of {len(points)} points has numbers that are not finite")
        if np.ptp(points, axis=0).max() < _SHORTEST:
            raise InputError(f"a path of {len(points)} points has no length to be timed")
        s = np.linspace(0.0, 1.0, len(points))
        spline = make_interp_spline(s, points, k=5)
        if tips is None:
            return cls(spline)
        fine = np.linspace(0.0, 1.0, 4 * len(points))
        rate = make_interp_spline(s, tips.reshape(len(tips), -1), k=5).derivative()(fine)
        speed = np.linalg.norm(rate.reshape(len(fine), 2, 3), axis=2).max(axis=1)
        return cls(spline, CubicSpline(fine, speed))


class PathLaw(Protocol):
    """Path parameter as a function of time, from rest at 0 to rest at 1."""

    @property
    def duration(self) -> float:
        """Time at which the end is reached, s."""

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the path parameter and its rate, 1/s, at times (N,) in [0, duration].

        (N,) each.
        """


@dataclass(frozen=True, eq=False)
class TimedPath:
    """A path with its law of motion, from rest to rest.

    Attributes:
        path: the path.
        law: the path parameter over time.
    """

    path: JointPath
    law: PathLaw

    @property
    def duration(self) -> float:
        """Of the law, s."""
        return self.law.duration

    def sample(self, period: float, slower: float = 1.0) -> tuple[Array, Array, Array]:
        """Times (N,), positions and velocities (N, n) at a period, the first and last at rest.

        Args:
            period: s; the law is slowed by less than one period in all, so that the end falls on a
                sample.
            slower: further factor on the duration, at least 1.
        """
        count = max(1, int(np.ceil(self.duration * slower / period - 1e-9)))
        stretch = count * period / self.duration
        t = period * np.arange(count + 1, dtype=float)
        s, rate = self.law.at(t / stretch)
        q = self.path.spline(s)
        v = self.path.spline(s, nu=1) * (rate / stretch)[:, None]
        v[0] = v[-1] = 0.0
        return t, q, v
