"""A control group of the virtual controller: points become increments, increments move the axes.

It behaves as MotoROS 1.9.12 (ros-industrial/motoman, MotionServer.c, read and not copied): a
point's time is cut to whole milliseconds, an increment is one interpolation period of a cubic,
parts of a period are run together, and an accepted point enters the queue in the next period: until
then the group is busy. Positions, speeds between points, numbers that are not finite and the order
of sequence numbers are not checked.
"""

from collections import deque
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware.motoros.messages import GroupPoint, Subcode
from unwrinkle.models.arrays import Array

#: Times of points from here on are refused, s.
LONGEST_TIME_S = 14400.0
#: Largest speed at which a queue that runs out is no underrun, rad/s.
_REST_SPEED_RAD_S = 1e-4
#: Range of 32-bit pulses, rad.
_PULSE_RANGE_RAD = 1e5


@dataclass(frozen=True, eq=False)
class Axes:
    """Limits of a group's axes, (A,) each.

    Attributes:
        indices: among the robot's axes.
        velocity: greatest speed of a point, cut to whole rad/s, that is not refused, rad/s.
        braking: deceleration of servos without commands, rad/s^2.
        start: largest distance of the first point, rad.
        moved: whether the firmware sends the group's increments to the servos.
    """

    indices: NDArray[np.int64]
    velocity: Array
    braking: Array
    start: Array
    moved: bool = True


@dataclass(frozen=True, eq=False)
class _Point:
    """A point as the firmware stores it: time, whole ms, positions, rad, and velocities, rad/s,
    (A,).
    """

    time: int
    positions: Array
    velocities: Array


@dataclass(frozen=True, eq=False)
class _Increment:
    """Motion of the axes within one period or a part of it: its end, ms, way, rad, and velocities
    at the end, rad/s, (A,).
    """

    end: int
    way: Array
    velocities: Array


class ControlGroup:
    """Accepts points, converts them to increments of one interpolation period, and moves its axes.

    Attributes:
        axes: limits.
        positions, velocities: (A,) commanded now, rad and rad/s.
        underruns: number of times that the queue ran out during motion.
    """

    def __init__(self, axes: Axes, start: Array, period: int, depth: int) -> None:
        """Begin at rest.

        Args:
            axes: limits.
            start: (A,) positions, rad.
            period: of interpolation, ms.
            depth: increments that the queue holds.
        """
        self.axes = axes
        self._period, self._depth = period, depth
        self.positions = start.copy()
        self.velocities = np.zeros_like(start)
        self.underruns = 0
        self._queue: deque[_Increment] = deque()
        self._run = 0  # time up to which increments have been run, ms
        self._pending: _Point | None = None  # accepted, not completely in the queue yet
        self._from: _Point | None = None  # begin of the pending point's cubic
        self._at = _Point(0, start.copy(), np.zeros_like(start))  # end of the last increment made
        self._leftover = 0  # rest of a period that the last increment has begun, ms
        self._made = start.copy()  # positions up to which increments have been made
        self._jammed = False  # the queue is not read any more
        self._braking = True  # the queue was emptied, or has run out

    @property
    def count(self) -> int:
        """Queued increments."""
        return len(self._queue)

    @property
    def ahead(self) -> float:
        """Duration of the queued motion, s."""
        return 1e-3 * (self._queue[-1].end - self._run) if self._queue else 0.0

    @property
    def busy(self) -> bool:
        """Whether the last point is not completely in the queue yet."""
        return self._pending is not None

    @property
    def moving(self) -> bool:
        """Whether increments are queued or an axis moves."""
        return bool(self._queue) or self.busy or bool(self.velocities.any())

    def first(self, point: GroupPoint) -> int:
        """Process a trajectory's first point; return the `Subcode` of a refusal, else 0."""
        start = self._read(point)
        self._at, self._leftover, self._run = start, 0, start.time
        self._made = self.positions.copy()
        if (np.abs(start.positions - self.positions) > self.axes.start).any():
            return Subcode.INVALID_START
        return self._too_fast(start)

    def add(self, point: GroupPoint) -> int:
        """Process a further point; return the `Subcode` of a refusal, else 0. The group must not be
        busy.
        """
        found = self._read(point)
        if subcode := self._too_fast(found):
            return subcode
        self._pending = found
        return 0

    def clear(self) -> None:
        """Empty the queue; moving axes brake."""
        self._queue.clear()
        self._pending = self._from = None
        self._jammed = False
        self._braking = True

    def rebase(self) -> None:
        """Compute the next increment from the commanded positions."""
        self._made = self.positions.copy()

    def forget(self) -> None:
        """Drop the point that is not in the queue yet; the queue stays."""
        self._pending = self._from = None

    def work(self) -> None:
        """Convert the accepted point to queued increments, as far as the queue has room."""
        if self._pending is None:
            return
        end = self._pending
        if self._from is None:
            self._from = self._at
        while self._at.time < end.time:
            if len(self._queue) >= self._depth:
                return
            self._queue.append(self._next(self._from, end))
        self._pending = self._from = None

    def advance(self, playing: bool) -> None:
        """Simulate one interpolation period; `playing`: queued increments are run."""
        if not playing or self._jammed or not self._queue:
            self._brake()
            return
        taken = self._queue.popleft()
        way, before, self._run = taken.way, self._run, taken.end
        # Parts of one period are run together.
        while self._queue and before <= self._queue[0].end <= before + self._period:
            taken = self._queue.popleft()
            way, self._run = way + taken.way, taken.end
        self._braking = False
        if self.axes.moved:
            self.positions = self.positions + way
            self.velocities = taken.velocities.copy()
        elif way.any():  # the firmware waits for ever for the pulses that the group does not move
            self._jammed = True

    def _read(self, point: GroupPoint) -> _Point:
        assert point.time is not None and point.positions is not None
        assert point.velocities is not None
        size = len(self.positions)
        # From float32, cut without rounding; NaN becomes 0, as the conversion of a processor may
        # give.
        scaled = 1000.0 * float(np.float32(point.time))
        time = int(scaled) if isfinite(scaled) else 0
        # Pulses are 32-bit numbers: NaN becomes the least one, values beyond their range the least
        # or the greatest.
        positions = np.nan_to_num(np.array(point.positions[:size]), nan=-_PULSE_RANGE_RAD)
        velocities = np.nan_to_num(np.array(point.velocities[:size]))
        kept = np.clip((positions, velocities), -_PULSE_RANGE_RAD, _PULSE_RANGE_RAD)
        return _Point(time, kept[0], kept[1])

    def _too_fast(self, point: _Point) -> int:
        # The firmware uses the abs of integers: 1.99 rad/s counts as 1.
        over = np.trunc(np.abs(point.velocities)) > self.axes.velocity
        return Subcode.INVALID_SPEED if over.any() else 0

    def _next(self, start: _Point, end: _Point) -> _Increment:
        """Return the next increment of the cubic between two points."""
        step = self._leftover or self._period
        time = self._at.time + step
        if time < end.time:
            self._leftover = 0
            positions, velocities = _cubic(start, end, time)
            self._at = _Point(time, positions, velocities)
        else:
            if time > end.time:
                self._leftover = time - end.time
            self._at = end
        way = self._at.positions - self._made
        self._made = self._at.positions
        return _Increment(self._at.time, way, self._at.velocities)

    def _brake(self) -> None:
        """Decelerate as servos without commands do."""
        if not self.velocities.any():
            return
        if not self._braking and np.abs(self.velocities).max() > _REST_SPEED_RAD_S:
            self.underruns += 1
        self._braking = True
        step = 1e-3 * self._period
        speed = np.maximum(np.abs(self.velocities) - self.axes.braking * step, 0.0)
        after = np.copysign(speed, self.velocities)
        self.positions = self.positions + 0.5 * step * (self.velocities + after)
        self.velocities = np.where(speed > 0.0, after, 0.0)


def _cubic(start: _Point, end: _Point, time: int) -> tuple[Array, Array]:
    """Return positions, rad, and velocities, rad/s, (A,), of the cubic between two points at a
    time, ms.
    """
    step = 1e-3 * (end.time - start.time)
    u = 1e-3 * (time - start.time)
    slope = (end.positions - start.positions) / step
    b = (3.0 * slope - 2.0 * start.velocities - end.velocities) / step
    a = (start.velocities + end.velocities - 2.0 * slope) / step**2
    return (
        ((a * u + b) * u + start.velocities) * u + start.positions,
        (3.0 * a * u + 2.0 * b) * u + start.velocities,
    )
