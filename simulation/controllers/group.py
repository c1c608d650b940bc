"""One control group of the virtual controller: points become increments, increments move the axes.

It behaves as MotoROS 1.9.12 does (ros-industrial/motoman, MotionServer.c, read and not copied): a point's time is cut
to whole milliseconds, increments are those of one interpolation period of a cubic, parts of a period are put together
when they are run, and what was taken is only worked into the queue at the next period: until then the group is busy.
Positions, speeds between points, numbers that are not finite and the order of sequence numbers are not checked.
"""

from collections import deque
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware.motoros.wire import GroupPoint, Subcode
from unwrinkle.models.arrays import Array

#: Trajectories of four hours and more are refused.
LONGEST = 14400.0
# A queue that runs out slower than this runs out at rest, rad/s.
_AT_REST = 1e-4
# As far as 32-bit pulses reach, rad.
_FARTHEST = 1e5


@dataclass(frozen=True, eq=False)
class Axes:
    """What a group's axes can do, each (A,).

    Attributes:
        indices: among the robot's axes.
        velocity: above which a point's speed, cut to whole rad/s, is refused.
        braking: of servos whose commands have ended, rad/s^2.
        start: most that the first point may lie off, rad.
        moved: whether the firmware sends the group's increments to the servos.
    """

    indices: NDArray[np.int64]
    velocity: Array
    braking: Array
    start: Array
    moved: bool = True


@dataclass(frozen=True, eq=False)
class _Point:
    """A point as the firmware keeps it: time in whole ms, positions and velocities (A,)."""

    time: int
    positions: Array
    velocities: Array


@dataclass(frozen=True, eq=False)
class _Increment:
    """What the axes move within one period, or a part of it: its end in ms, way and speed at the end (A,)."""

    end: int
    way: Array
    velocities: Array


class ControlGroup:
    """Takes points, makes increments of one interpolation period, and moves its axes.

    Attributes:
        axes: what they can do.
        positions, velocities: (A,) commanded now, rad and rad/s.
        underruns: how often the queue ran out in motion.
    """

    def __init__(self, axes: Axes, start: Array, period: int, depth: int) -> None:
        """Stand at start (A,); the period of interpolation is in ms, the queue holds `depth` increments."""
        self.axes = axes
        self._period, self._depth = period, depth
        self.positions = start.copy()
        self.velocities = np.zeros_like(start)
        self.underruns = 0
        self._queue: deque[_Increment] = deque()
        self._run = 0  # time up to which increments were run, ms
        self._pending: _Point | None = None  # taken, not wholly in the queue yet
        self._from: _Point | None = None  # where the pending point's cubic begins
        self._at = _Point(0, start.copy(), np.zeros_like(start))  # of the last increment made
        self._leftover = 0  # of a period that the last increment has begun, ms
        self._made = start.copy()  # positions up to which increments were made
        self._jammed = False  # its queue is read no more
        self._braking = True  # the queue was emptied, or has run out

    @property
    def count(self) -> int:
        """Increments that wait."""
        return len(self._queue)

    @property
    def ahead(self) -> float:
        """Motion that waits in the queue, s."""
        return 1e-3 * (self._queue[-1].end - self._run) if self._queue else 0.0

    @property
    def busy(self) -> bool:
        """Whether the point before is not wholly in the queue yet."""
        return self._pending is not None

    @property
    def moving(self) -> bool:
        """Whether increments wait or an axis moves."""
        return bool(self._queue) or self.busy or bool(self.velocities.any())

    def first(self, point: GroupPoint) -> int:
        """Take a trajectory's first point; why it is refused, a `Subcode`, else 0."""
        start = self._read(point)
        self._at, self._leftover, self._run = start, 0, start.time
        self._made = self.positions.copy()
        if (np.abs(start.positions - self.positions) > self.axes.start).any():
            return Subcode.INVALID_START
        return self._too_fast(start)

    def add(self, point: GroupPoint) -> int:
        """Take a further point; why it is refused, a `Subcode`, else 0. It must not be busy."""
        found = self._read(point)
        if subcode := self._too_fast(found):
            return subcode
        self._pending = found
        return 0

    def clear(self) -> None:
        """Empty the queue; the axes brake if they move."""
        self._queue.clear()
        self._pending = self._from = None
        self._jammed = False
        self._braking = True

    def rebase(self) -> None:
        """Reckon the next increment from where the axes are commanded to stand."""
        self._made = self.positions.copy()

    def forget(self) -> None:
        """Drop the point that is not in the queue yet; the queue stays."""
        self._pending = self._from = None

    def work(self) -> None:
        """Put the point that was taken into the queue, as far as it has room."""
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
        """Move on by one interpolation period; `playing`: increments are run."""
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
        elif (
            way.any()
        ):  # its pulses are missed, and no more are read until they are made up for: never
            self._jammed = True

    def _read(self, point: GroupPoint) -> _Point:
        assert point.time is not None and point.positions is not None
        assert point.velocities is not None
        size = len(self.positions)
        # Of a float32, with no rounding before the cut; what is no number becomes 0, as a processor's conversion may.
        scaled = 1000.0 * float(np.float32(point.time))
        time = int(scaled) if isfinite(scaled) else 0
        # Pulses are 32-bit numbers: what is no number, or beyond them, becomes the least or the greatest.
        positions = np.nan_to_num(np.array(point.positions[:size]), nan=-_FARTHEST)
        velocities = np.nan_to_num(np.array(point.velocities[:size]))
        kept = np.clip((positions, velocities), -_FARTHEST, _FARTHEST)
        return _Point(time, kept[0], kept[1])

    def _too_fast(self, point: _Point) -> int:
        # Its abs is that of integers: 1.99 rad/s counts as 1.
        over = np.trunc(np.abs(point.velocities)) > self.axes.velocity
        return Subcode.INVALID_SPEED if over.any() else 0

    def _next(self, start: _Point, end: _Point) -> _Increment:
        """The next increment of the cubic from a point to the pending one."""
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
        """Slow down as servos do whose commands have ended."""
        if not self.velocities.any():
            return
        if not self._braking and np.abs(self.velocities).max() > _AT_REST:
            self.underruns += 1
        self._braking = True
        step = 1e-3 * self._period
        speed = np.maximum(np.abs(self.velocities) - self.axes.braking * step, 0.0)
        after = np.copysign(speed, self.velocities)
        self.positions = self.positions + 0.5 * step * (self.velocities + after)
        self.velocities = np.where(speed > 0.0, after, 0.0)


def _cubic(start: _Point, end: _Point, time: int) -> tuple[Array, Array]:
    """Positions and velocities of the cubic between two points at a time in ms."""
    step = 1e-3 * (end.time - start.time)
    u = 1e-3 * (time - start.time)
    slope = (end.positions - start.positions) / step
    b = (3.0 * slope - 2.0 * start.velocities - end.velocities) / step
    a = (start.velocities + end.velocities - 2.0 * slope) / step**2
    return (
        ((a * u + b) * u + start.velocities) * u + start.positions,
        (3.0 * a * u + 2.0 * b) * u + start.velocities,
    )
