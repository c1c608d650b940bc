"""One change of the rate along a path: a quintic in time, and the points to send for it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware._sent_cubics import CubicPath, StreamLimits

Array = NDArray[np.float64]

_GRID = np.linspace(0.0, 1.0, 129)
_POWERS = _GRID[:, None] ** np.arange(6)
#: Places (of the duration) at which durations are sieved, and how much of a limit passes.
_SIEVE = np.linspace(0.0, 1.0, 21)[:, None] ** np.arange(6)
_SIEVE_ROOM = 1.03
_ROUNDING = 1e-9
_SHORTEST = 1e-3  # a point nearer than this to the one before adds nothing but rounding, s
_ITERATIONS = 40


@dataclass(frozen=True)
class RateState:
    """Where a path's clock is: stream time (s), s, rate ds/dt and the rate's two derivatives (1/s, 1/s^2)."""

    time: float
    s: float
    rate: float
    slope: float
    bend: float


@dataclass(frozen=True, eq=False)
class RateChange:
    """Points of a change of rate, behind the one where it begins.

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
        """Of the clock at point i."""
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
        """Points up to the first knot behind the change; up to rest for a target of 0; or up to the path's end.

        Args:
            path: along which.
            start: where the clock is.
            target: rate at the end.
            duration: of the change, s.
            widest: greatest distance of points, s.

        Returns:
            None if the rate would leave 0 to 1.
        """
        c = _quintic(start, target, duration)
        rate = _POWERS @ c
        if rate.min() < -_ROUNDING or rate.max() > 1.0 + _ROUNDING:
            return None
        nodes, indices = _nodes(path, start, target, duration, c)
        tau, s, index = _filled(nodes, indices, widest, start, target, duration, c)
        if not len(tau):
            return None
        moving = tau < duration * (1.0 - _ROUNDING)
        x = np.where(moving, tau / duration, 1.0)
        rates = np.where(moving, np.clip(_value(c, x), 0.0, 1.0), target)
        d = c[1:] * np.arange(1, 6)
        e = d[1:] * np.arange(1, 5)
        slopes = np.where(moving, _value(d, x) / duration, 0.0)
        bends = np.where(moving, _value(e, x) / duration**2, 0.0)
        at_knot = np.flatnonzero(index >= 0)
        s[at_knot] = path.knots[index[at_knot]]
        positions, velocities = path.at(s)
        positions[at_knot], velocities[at_knot] = path.knots_(index[at_knot])
        velocities *= rates[:, None]
        return cls(start.time + tau, s, rates, slopes, bends, positions, velocities)


def plausible(
    path: CubicPath, start: RateState, target: float, times: Array, limits: StreamLimits
) -> Array:
    """Those of the durations (n,) whose motion keeps the limits, roughly, at some places: a quick sieve.

    The limits are widened by a few percent, so that what passes has to be tried in full.
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
    q1, q2, q3 = path.derivatives(np.minimum(s, path.end))
    for value, most in (
        (q1 * r, limits.velocity),
        (q2 * r**2 + q1 * f, limits.acceleration),
        (q3 * r**3 + 3.0 * q2 * r * f + q1 * g, limits.jerk),
    ):
        ok &= (np.abs(value) <= _SIEVE_ROOM * most).all(axis=(1, 2))
    return times[ok]


def _quintic(start: RateState, target: float, duration: float) -> Array:
    """Coefficients in x = t / duration, constant first, that end in (target, 0, 0)."""
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
    """Way in s from the start of the change to x."""
    integral: Array = x * _value(c / np.arange(1, 7), x) * duration
    return integral


def _nodes(
    path: CubicPath, start: RateState, target: float, duration: float, c: Array
) -> tuple[Array, NDArray[np.intp]]:
    """Times since the start (n,) of the path's knots, and of the end; index of the knot, -1 for none."""
    whole = float(_travel(c, duration, np.ones(1))[0])
    end = start.s + whole
    knots = path.knots
    first = int(np.searchsorted(knots, start.s, side="right"))
    stop = int(np.searchsorted(knots, end, side="left"))
    index = np.arange(first, stop, dtype=np.intp)
    tau = duration * _inverse(c, duration, knots[first:stop] - start.s)
    if target > 0.0 and stop < len(knots):
        tau = np.append(tau, duration + (knots[stop] - end) / target)
        index = np.append(index, stop)
    elif target == 0.0 and stop < len(knots):
        tau = np.append(tau, duration)
        index = np.append(index, -1)
    # The last one stays, whatever stands before it.
    gaps = np.diff(tau, prepend=0.0)
    keep = gaps >= _SHORTEST
    if len(keep):
        keep[-1] = True
        if len(keep) > 1 and gaps[-1] < _SHORTEST:
            keep[-2] = False
    return tau[keep], index[keep]


def _inverse(c: Array, duration: float, way: Array) -> Array:
    """x at which so much way (n,) has been gone: Newton's steps within a shrinking bracket."""
    if not len(way):
        return way
    table = _travel(c, duration, _GRID)
    place = np.clip(np.searchsorted(table, way), 1, len(_GRID) - 1)
    low, high = _GRID[place - 1], _GRID[place]
    x = 0.5 * (low + high)
    for _ in range(_ITERATIONS):
        miss = _travel(c, duration, x) - way
        if np.abs(miss).max() < 1e-14:
            break
        low, high = np.where(miss < 0.0, x, low), np.where(miss < 0.0, high, x)
        slope = _value(c, x) * duration
        with np.errstate(divide="ignore", invalid="ignore"):
            step = x - miss / slope
        x = np.where((step > low) & (step < high), step, 0.5 * (low + high))
    return x


def _filled(
    nodes: Array,
    indices: NDArray[np.intp],
    widest: float,
    start: RateState,
    target: float,
    duration: float,
    c: Array,
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Times, s and knot indices with equal parts between nodes that are farther apart than the widest distance."""
    gaps = np.diff(nodes, prepend=0.0)
    counts = np.maximum(np.ceil(gaps / widest - _ROUNDING), 1).astype(np.intp)
    last = np.cumsum(counts) - 1  # place of each node among all points
    total = int(counts.sum())
    owner = np.repeat(np.arange(len(nodes)), counts)
    back = last[owner] - np.arange(total)
    tau = nodes[owner] - back * (gaps / counts)[owner]
    index = np.where(back == 0, indices[owner], -1)
    inside = np.minimum(tau / duration, 1.0)
    s = start.s + _travel(c, duration, inside) + np.maximum(tau - duration, 0.0) * target
    return tau, s, index
