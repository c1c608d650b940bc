"""Whether points that were sent keep the limits as the controller will run them.

Exact extremes of their cubics.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.planning.trajectory import SampledCubic

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

    Position, velocity and acceleration are the exact extremes of the cubics between points as the
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
        cubic = SampledCubic(stream.times - stream.times[0], stream.positions, stream.velocities)
        seen = cubic.extremes()
        found += _beyond("position", i, seen.upper - limits.upper[i], limits.upper[i])
        found += _beyond("position", i, limits.lower[i] - seen.lower, limits.lower[i])
        for what, values, most in (
            ("velocity", seen.speed, limits.velocity[i]),
            ("acceleration", seen.acceleration, limits.acceleration[i]),
            ("jerk", seen.jerk, limits.jerk[i]),
        ):
            found += _beyond(what, i, values - most, most)
    return found


def _beyond(what: str, axes: NDArray[np.intp], over: Array, limit: Array) -> list[str]:
    excess = over - _RELATIVE * np.abs(limit)
    return [
        f"{what} of axis {axes[k]} is {over[k]:.3g} beyond its limit (rad, s)"
        for k in np.flatnonzero(excess > 0.0)
    ]
