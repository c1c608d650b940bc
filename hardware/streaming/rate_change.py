"""A change of the rate along a path: a quintic in time, and the points to send for it."""

from dataclasses import dataclass

import numpy as np

from unwrinkle.hardware.streaming.sent_cubics import CubicPath, StreamLimits, ceil_ms
from unwrinkle.models.arrays import Array
from unwrinkle.planning.sent_samples import as_float32

_POWERS = np.linspace(0.0, 1.0, 129)[:, None] ** np.arange(7)
#: Coefficients of x^3 (1 - x)^3, which is 0 at both ends together with its first two derivatives.
_BUMP = np.array([0.0, 0.0, 0.0, 1.0, -3.0, 3.0, -1.0])
#: Its integral from 0 to 1.
_BUMP_AREA = 1.0 / 140.0
#: Powers of the places, in shares of the duration, at which durations are sieved.
_SIEVE = np.linspace(0.0, 1.0, 21)[:, None] ** np.arange(6)
#: Share of a limit that passes the sieve.
_SIEVE_ROOM = 1.03
#: Difference that is rounding: of rates, and of times, s.
_ROUNDING = 1e-9
#: Bisections for the time at which a change reaches the path's end.
_BISECTIONS = 40


@dataclass(frozen=True)
class RateState:
    """State of a path's clock: stream time, s; path time s, s; rate ds/dt; the rate's derivatives,
    1/s and 1/s^2.
    """

    time: float
    s: float
    rate: float
    slope: float
    bend: float


@dataclass(frozen=True, eq=False)
class RateChange:
    """Points of a change of rate, without the point where it begins.

    Attributes:
        times: (n,) s, on the stream's clock.
        s: (n,) on the trajectory's clock.
        rates, slopes, bends: (n,) the rate and its derivatives.
        positions, velocities: (n, 13) rad, rad/s.
    """

    times: Array
    s: Array
    rates: Array
    slopes: Array
    bends: Array
    positions: Array
    velocities: Array

    def state(self, i: int) -> RateState:
        """Return the state of the clock at point i."""
        return RateState(
            float(self.times[i]),
            float(self.s[i]),
            float(self.rates[i]),
            float(self.slopes[i]),
            float(self.bends[i]),
        )

    @classmethod
    def make(
        cls, path: CubicPath, start: RateState, target: float, duration: float, widest: float
    ) -> "RateChange | None":
        """Compute the points up to the end of the change, or up to the path's end if that comes
        first.

        A change to the full rate ends at one of the path's own knots, so that from there on the
        points are the trajectory's own samples again.

        Args:
            path: to run.
            start: state of the clock, at a whole ms.
            target: rate at the end, 0 to 1.
            duration: of the change, s, whole ms.
            widest: greatest time between points, s.

        Returns:
            None if the rate would leave 0 to 1, or no knot can be reached.
        """
        c = np.append(_quintic(start, target, duration), 0.0)
        end = start.s + float(_travel(c, duration, np.ones(1))[0])
        knot = None
        if target == 1.0 and end < path.end:
            knot = path.knot_before(end)
            if not knot > start.s:
                return None
            c += (knot - end) / (duration * _BUMP_AREA) * _BUMP
        rate = _POWERS @ c
        if rate.min() < -_ROUNDING or rate.max() > 1.0 + _ROUNDING:
            return None
        tau, s = _points(path.end, start.s, duration, c, widest)
        if knot is not None:
            s[-1] = knot
        ends = s >= path.end
        moving = tau < duration * (1.0 - _ROUNDING)
        x = np.where(moving, np.minimum(tau / duration, 1.0), 1.0)
        rates = np.where(moving, np.clip(_value(c, x), 0.0, 1.0), target)
        d = c[1:] * np.arange(1.0, len(c))
        e = d[1:] * np.arange(1.0, len(d))
        slopes = np.where(moving, _value(d, x) / duration, 0.0)
        bends = np.where(moving, _value(e, x) / duration**2, 0.0)
        positions, velocities = path.curve.at(s)
        velocities *= rates[:, None]
        if ends[-1]:  # the path's own end is rest
            positions[-1], velocities[-1] = path.knot(len(path.knots) - 1)
        return cls(
            start.time + tau, s, rates, slopes, bends, as_float32(positions), as_float32(velocities)
        )


def plausible(
    path: CubicPath, start: RateState, target: float, times: Array, limits: StreamLimits
) -> Array:
    """Return the durations of `times` (n,), s, whose motion about keeps the limits at some places:
    a quick sieve.

    The limits are widened by a few percent, so durations that pass have to be checked in full.
    """
    c = np.array([_quintic(start, target, float(duration)) for duration in times])
    d = c[:, 1:] * np.arange(1, 6)
    e = d[:, 1:] * np.arange(1, 5)
    duration = times[:, None]
    rate, slope = c @ _SIEVE.T, d @ _SIEVE[:, :5].T / duration
    bend = e @ _SIEVE[:, :4].T / duration**2
    s = start.s + (c / np.arange(1, 7)) @ (_SIEVE * _SIEVE[:, 1:2]).T * duration
    ok = (rate.min(axis=1) >= -_ROUNDING) & (rate.max(axis=1) <= 1.0 + _ROUNDING)
    inside = s < path.end
    r, f, g = (np.where(inside, a, 0.0)[..., None] for a in (rate, slope, bend))
    q1, q2, q3 = path.curve.derivatives(np.minimum(s, path.end))
    for value, most in (
        (q1 * r, limits.velocity),
        (q2 * r**2 + q1 * f, limits.acceleration),
        (q3 * r**3 + 3.0 * q2 * r * f + q1 * g, limits.jerk),
    ):
        ok &= (np.abs(value) <= _SIEVE_ROOM * most).all(axis=(1, 2))
    return times[ok]


def _quintic(start: RateState, target: float, duration: float) -> Array:
    """Return coefficients in x = t / duration, constant first, of a rate that ends in (target, 0,
    0).
    """
    r, d, e = start.rate, start.slope * duration, 0.5 * start.bend * duration**2
    gap = target - r
    return np.array(
        [
            r,
            d,
            e,
            10.0 * gap - 6.0 * d - 3.0 * e,
            -15.0 * gap + 8.0 * d + 3.0 * e,
            6.0 * gap - 3.0 * d - e,
        ]
    )


def _value(c: Array, x: Array) -> Array:
    value = np.full_like(x, c[-1])
    for coefficient in c[-2::-1]:
        value = value * x + coefficient
    return value


def _travel(c: Array, duration: float, x: Array) -> Array:
    """Return the path time from the start of the change to x, s."""
    integral: Array = x * _value(c / np.arange(1.0, len(c) + 1.0), x) * duration
    return integral


def _points(
    end: float, begin: float, duration: float, c: Array, widest: float
) -> tuple[Array, Array]:
    """Return times since the start, whole ms, and path times of the points, (n,) s each; the last
    may be the path's end.
    """
    count = max(1, int(np.ceil(duration / widest - _ROUNDING)))
    tau = np.unique(np.round(1e3 * duration * np.arange(1, count + 1) / count)) / 1e3
    s = begin + _travel(c, duration, tau / duration)
    inside = s < end - _ROUNDING
    if inside.all():
        return tau, s
    last = int(np.argmin(inside))  # the first point beyond the path's end
    low, high = (tau[last - 1] if last else 0.0), tau[last]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        way = float(_travel(c, duration, np.array([middle / duration]))[0])
        low, high = (middle, high) if begin + way < end else (low, middle)
    at_end = max(ceil_ms(high), 1e-3)
    before = tau[:last] < at_end - 0.5e-3
    return np.append(tau[:last][before], at_end), np.append(s[:last][before], end)
