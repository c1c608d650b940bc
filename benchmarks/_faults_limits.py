"""Whether points that were sent keep the limits as the controller will run them: exact extremes of their cubics."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.limits import Limits
from unwrinkle.simulation.track import Track

Array = NDArray[np.float64]

#: Spacing of float32 numbers, relative: what the wire rounds positions, velocities and times to.
_FLOAT32 = 2.0**-23
#: Of a limit: what verified samples may use by themselves.
_RELATIVE = 1e-3


@dataclass(frozen=True, eq=False)
class SentPoints:
    """Points of one stream, from its point 0 on, as a controller accepted them.

    Attributes:
        axes: (A,) indices among the thirteen.
        clock: (N,) when they were accepted, s.
        times: (N,) on the stream's clock, s.
        positions, velocities: (N, A) rad and rad/s.
    """

    axes: NDArray[np.intp]
    clock: Array
    times: Array
    positions: Array
    velocities: Array


def limit_violations(streams: Sequence[SentPoints], limits: Limits) -> list[str]:
    """What goes beyond a limit in points that were sent; empty if nothing does.

    Position, velocity and acceleration are the exact extremes of the cubics between points; jerk is constant on each.
    What the wire's float32 can add is allowed for, interval by interval.

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
        track = Track(stream.times - stream.times[0], stream.positions, stream.velocities)
        low, high, speed, _ = track.extremes()
        room = _FLOAT32 * np.pi
        found += _beyond("position", i, high - limits.upper[i], room, 0.0 * room)
        found += _beyond("position", i, limits.lower[i] - low, room, 0.0 * room)
        h = steps[:, None]
        slope = np.diff(stream.positions, axis=0) / h
        v0, v1 = stream.velocities[:-1], stream.velocities[1:]
        jerk = np.abs(6.0 * (v0 + v1 - 2.0 * slope) / h**2)
        begin = np.abs(2.0 * (3.0 * slope - 2.0 * v0 - v1) / h)
        end = np.abs(2.0 * (v0 + 2.0 * v1 - 3.0 * slope) / h)
        acceleration = np.maximum(begin, end)
        # Rounding of both positions, both times (times velocity) and both velocities of an interval.
        peak = np.maximum(np.abs(v0), np.abs(v1))
        shift = _FLOAT32 * (
            np.maximum(np.abs(stream.positions[:-1]), np.abs(stream.positions[1:]))
            + stream.times[1:, None] * peak
        )
        spoilt = _FLOAT32 * peak
        v_room = (1.5 * shift / h + spoilt).max(axis=0)
        a_room = 6.0 * shift / h**2 + 6.0 * spoilt / h
        j_room = 12.0 * shift / h**3 + 12.0 * spoilt / h**2
        limit = limits.velocity[i]
        found += _beyond("velocity", i, speed - limit, v_room, limit)
        limit = limits.acceleration[i]
        found += _beyond("acceleration", i, (acceleration - a_room).max(axis=0) - limit, 0.0, limit)
        limit = limits.jerk[i]
        found += _beyond("jerk", i, (jerk - j_room).max(axis=0) - limit, 0.0, limit)
    return found


def _beyond(
    what: str, axes: NDArray[np.intp], over: Array, room: Array | float, limit: Array | float
) -> list[str]:
    excess = over - room - _RELATIVE * np.abs(limit)
    return [
        f"{what} of axis {axes[k]} is {over[k]:.3g} beyond its limit (rad, s)"
        for k in np.flatnonzero(excess > 0.0)
    ]
