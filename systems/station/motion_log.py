"""Measured motion of the simulated robot, for the run's log."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Context
from pydrake.systems.primitives import VectorLogSink

from unwrinkle.models.arrays import Array


@dataclass(frozen=True, eq=False)
class StationMotion:
    """Measured motion, one row per step of the plant.

    Attributes:
        number: number of the trajectory; 0 at rest.
        times: (N,) s on the station's clock.
        measured: (N, 13) positions of the axes, rad.
        velocities: (N, 13) rad/s.
        reference: (N, 13) reference positions of the controller at the same instants, rad.
        openings: (N, 2) openings of the grippers, m.
        head: (N, 4) true angles of the pan-tilt units, rad.
    """

    number: int
    times: Array
    measured: Array
    velocities: Array
    reference: Array
    openings: Array
    head: Array

    @property
    def following_error(self) -> float:
        """Return the largest distance of an axis from its reference, rad; 0 for an empty motion."""
        return float(np.abs(self.measured - self.reference).max(initial=0.0))


class MotionLog:
    """Read the station's log; available as `station.motion_log`."""

    def __init__(self, sink: VectorLogSink) -> None:
        """Read rows of position 13, velocity 13, reference 13, number, opening 2, head 4."""
        self._sink = sink

    def between(self, context: Context, begin: float, end: float = np.inf) -> StationMotion:
        """Return the motion in an interval of the station's clock, s.

        `context` is that of the root diagram.
        """
        log = self._sink.FindLog(context)
        times = np.asarray(log.sample_times())
        first, last = np.searchsorted(times, [begin, end], side="left")
        return _motion(times[first:last], np.asarray(log.data()).T[first:last])

    def last(self, context: Context) -> StationMotion:
        """Return the motion of the last trajectory, from its start until now or its end.

        It is empty before the first trajectory.
        """
        log = self._sink.FindLog(context)
        times, rows = np.asarray(log.sample_times()), np.asarray(log.data()).T
        numbers = rows[:, 39]
        running = np.flatnonzero(numbers > 0.0)
        if len(running) == 0:
            return _motion(times[:0], rows[:0])
        own = running[numbers[running] == numbers[running[-1]]]
        return _motion(times[own], rows[own])

    def clear(self, context: Any) -> None:
        """Delete the logged motion; `context` is that of the root diagram, mutable."""
        self._sink.FindMutableLog(context).Clear()


def _motion(times: Array, rows: Array) -> StationMotion:
    parts = np.split(rows, [13, 26, 39, 40, 42], axis=1)
    measured, velocities, reference, numbers, openings, head = (part.copy() for part in parts)
    number = int(numbers[-1, 0]) if len(numbers) else 0
    return StationMotion(number, times.copy(), measured, velocities, reference, openings, head)
