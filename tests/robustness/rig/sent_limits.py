"""Check that points that were sent keep the limits as the controller will run them.

The judge is scipy's piecewise polynomials, which share no code with the drivers.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PPoly

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits

#: Of a limit: rounding of this reckoning.
_RELATIVE = 1e-6


@dataclass(frozen=True, eq=False)
class SentPoints:
    """Points of one stream, from its point 0 on, as a controller accepted them.

    Attributes:
        axes: (A,) indices among the thirteen.
        clock: (N,) when they were accepted, s.
        times: (N,) on the stream's clock, whole ms as the controller takes them, in s.
        positions, velocities: (N, A) rad and rad/s.
    """

    axes: NDArray[np.intp]
    clock: Array
    times: Array
    positions: Array
    velocities: Array


def limit_violations(streams: Sequence[SentPoints], limits: Limits) -> list[str]:
    """What goes beyond a limit in points that were sent; empty if nothing does.

    Position, velocity and acceleration are extremes of the cubics between the points as the
    controller has them, in float32 and whole milliseconds; jerk is constant on each.

    Args:
        streams: of any groups.
        limits: of the thirteen axes.
    """
    found = []
    for stream in streams:
        i = stream.axes
        numbers = (stream.times, stream.positions, stream.velocities)
        if not all(np.isfinite(values).all() for values in numbers):
            found.append(f"axes {i.tolist()}: a number that is not finite was sent")
            continue
        if len(stream.times) < 2:
            continue
        steps = np.diff(stream.times)
        if not (steps > 0.0).all():
            found.append(f"axes {i.tolist()}: time does not increase")
            continue
        for k, axis in enumerate(i):
            seen = _extremes(stream.times, stream.positions[:, k], stream.velocities[:, k])
            found += _beyond(
                "position", axis, seen.highest - limits.upper[axis], limits.upper[axis]
            )
            found += _beyond("position", axis, limits.lower[axis] - seen.lowest, limits.lower[axis])
            for what, value, most in (
                ("velocity", seen.speed, limits.velocity[axis]),
                ("acceleration", seen.acceleration, limits.acceleration[axis]),
                ("jerk", seen.jerk, limits.jerk[axis]),
            ):
                found += _beyond(what, axis, value - most, most)
    return found


@dataclass(frozen=True)
class _AxisExtremes:
    lowest: float
    highest: float
    speed: float
    acceleration: float
    jerk: float


def _extremes(times: Array, positions: Array, velocities: Array) -> _AxisExtremes:
    """Extremes of one axis over the cubics between its points; scipy finds the roots."""
    cubic = CubicHermiteSpline(times - times[0], positions, velocities)
    velocity, acceleration, jerk = (cubic.derivative(order) for order in (1, 2, 3))
    at_rest, steepest = (_roots(each) for each in (velocity, acceleration))
    places, speeds = cubic(at_rest), velocity(steepest)
    ends = acceleration.c[0] * np.diff(cubic.x) + acceleration.c[1]  # its two ends: it may jump
    return _AxisExtremes(
        lowest=float(min(positions.min(), places.min(initial=np.inf))),
        highest=float(max(positions.max(), places.max(initial=-np.inf))),
        speed=float(np.abs(np.concatenate([velocities, speeds])).max()),
        acceleration=float(np.abs(np.concatenate([acceleration.c[1], ends])).max()),
        jerk=float(np.abs(jerk.c[0]).max()),
    )


def _roots(curve: PPoly) -> Array:
    """Roots of a piecewise polynomial; a piece that is zero throughout has none to speak of."""
    roots = np.asarray(curve.roots(discontinuity=False, extrapolate=False), dtype=float)
    return roots[np.isfinite(roots)]


def _beyond(what: str, axis: int, over: float, limit: float) -> list[str]:
    if over <= _RELATIVE * abs(limit):
        return []
    return [f"{what} of axis {axis} is {over:.3g} beyond its limit (rad, s)"]
