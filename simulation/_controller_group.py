"""One control group of the virtual controller: its queue of increments, cubic interpolation, braking."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware.wire import GroupPoint, Subcode

Array = NDArray[np.float64]

#: Trajectories of four hours and more are refused.
LONGEST = 14400.0
# Rounding, no excess: of float32 positions and of planned speeds, relative; and of float32 times, s.
_POSITION, _SPEED, _TIME = 1e-5, 1e-2, 1e-5
# A queue that runs out slower than this runs out at rest, rad/s.
_AT_REST = 1e-4


@dataclass(frozen=True, eq=False)
class Axes:
    """What a group's axes can do, each (A,).

    Attributes:
        indices: among the robot's axes.
        lower, upper: positions, rad.
        velocity: rad/s.
        braking: of servos whose commands have ended, rad/s^2.
        start: most that the first point may lie off, rad.
    """

    indices: NDArray[np.int64]
    lower: Array
    upper: Array
    velocity: Array
    braking: Array
    start: Array


class _Cubic:
    """From one point to the next."""

    def __init__(self, t: float, q: Array, v: Array, t1: float, q1: Array, v1: Array) -> None:
        step = t1 - t
        slope = (q1 - q) / step
        self.begin, self.end, self._step = t, t1, step
        self._q, self._v, self.q1, self.v1 = q, v, q1, v1
        self._b = (3.0 * slope - 2.0 * v - v1) / step
        self._a = (v + v1 - 2.0 * slope) / step**2

    def at(self, t: float) -> tuple[Array, Array]:
        """Positions and velocities."""
        if t >= self.end:
            return self.q1, self.v1
        u = t - self.begin
        return (
            ((self._a * u + self._b) * u + self._v) * u + self._q,
            (3.0 * self._a * u + 2.0 * self._b) * u + self._v,
        )

    def peak_speed(self) -> Array:
        """Greatest speed of each axis."""
        peak = np.maximum(np.abs(self._v), np.abs(self.v1))
        with np.errstate(divide="ignore", invalid="ignore"):
            u = -self._b / (3.0 * self._a)
        u = np.where((u > 0.0) & (u < self._step), u, 0.0)
        return np.maximum(peak, np.abs((3.0 * self._a * u + 2.0 * self._b) * u + self._v))

    def within(self, lower: Array, upper: Array) -> bool:
        """Whether it stays in these positions."""
        third = self._step / 3.0
        hull = np.stack(
            [self._q, self._q + third * self._v, self.q1 - third * self.v1, self.q1]
        )  # of Bézier: the cubic lies inside
        if not ((hull < lower) | (hull > upper)).any():
            return True
        u = np.linspace(0.0, self._step, 65)[:, None]
        q = ((self._a * u + self._b) * u + self._v) * u + self._q
        return not ((q < lower) | (q > upper)).any()


class ControlGroup:
    """Takes points, makes increments of one interpolation period, and moves its axes.

    Attributes:
        axes: what they can do.
        positions, velocities: (A,) commanded now, rad and rad/s.
        sequence: of the point that is expected next.
        underruns: how often the queue ran out in motion.
    """

    def __init__(self, axes: Axes, start: Array, period: float, depth: int) -> None:
        """Stand at start (A,)."""
        self.axes = axes
        self._period, self._depth = period, depth
        self.positions = start.copy()
        self.velocities = np.zeros_like(start)
        self.sequence = 0
        self.underruns = 0
        self._queue: deque[tuple[Array, Array]] = deque()
        self._offset = np.zeros_like(start)
        self._last: tuple[float, Array, Array] | None = None
        self._cubic: _Cubic | None = None
        self._origin, self._ticks = 0.0, 1
        self._braking = False

    @property
    def count(self) -> int:
        """Increments that wait."""
        return len(self._queue)

    @property
    def busy(self) -> bool:
        """Whether the point before is not wholly in the queue yet."""
        return self._cubic is not None and self._next <= self._cubic.end + _TIME

    @property
    def moving(self) -> bool:
        """Whether increments wait or an axis moves."""
        return bool(self._queue) or self._rest_of_cubic or bool(self.velocities.any())

    @property
    def _next(self) -> float:
        return self._origin + self._ticks * self._period

    @property
    def _rest_of_cubic(self) -> bool:
        """Whether the last point lies between two increments and nothing follows it."""
        if self._cubic is None:
            return False
        return self._cubic.end > self._next - self._period + _TIME

    def problem(self, point: GroupPoint, sequence: int) -> int:
        """Why a point cannot be taken, a `Subcode`; 0 if it can."""
        if point.time is None or point.positions is None or point.velocities is None:
            return Subcode.INVALID_INSUFFICIENT
        if sequence != 0 and (sequence != self.sequence or self._last is None):
            return Subcode.INVALID_SEQUENCE
        size = len(self.positions)
        numbers = np.array((point.positions, point.velocities, point.accelerations or (0.0,) * 10))
        if not np.isfinite(numbers).all() or numbers[:, size:].any():
            return Subcode.INVALID_DATA
        if not 0.0 <= point.time < LONGEST:
            return Subcode.INVALID_TIME
        q, v = numbers[0, :size], numbers[1, :size]
        limits = self.axes
        if ((q < limits.lower - _POSITION) | (q > limits.upper + _POSITION)).any():
            return Subcode.INVALID_POSITION
        if (np.abs(v) > limits.velocity * (1.0 + _SPEED)).any():
            return Subcode.INVALID_SPEED
        if sequence == 0:
            off = np.abs(q - self.positions) > limits.start
            return Subcode.INVALID_START if off.any() else 0
        assert self._last is not None
        if point.time <= self._last[0]:
            return Subcode.INVALID_TIME
        cubic = _Cubic(*self._last, point.time, q, v)
        if (cubic.peak_speed() > limits.velocity * (1.0 + _SPEED)).any():
            return Subcode.INVALID_SPEED
        if not cubic.within(limits.lower - _POSITION, limits.upper + _POSITION):
            return Subcode.INVALID_POSITION
        return 0

    def add(self, point: GroupPoint, sequence: int) -> None:
        """Take a point that has no `problem`."""
        assert point.time is not None and point.positions is not None
        assert point.velocities is not None
        size = len(self.positions)
        t, q, v = point.time, np.array(point.positions[:size]), np.array(point.velocities[:size])
        if sequence == 0:
            self.clear()
            self._offset = np.zeros(size)
            self._origin, self._ticks = t, 1
        else:
            assert self._last is not None
            if not self._queue and not self._rest_of_cubic:
                self._origin, self._ticks = self._last[0], 1
            self._cubic = _Cubic(*self._last, t, q, v)
        self._last = (t, q, v)
        self.sequence = sequence + 1
        self._fill()

    def clear(self) -> None:
        """Empty the queue; the axes brake if they move, and a point 0 has to come next."""
        self._queue.clear()
        self._cubic, self._last = None, None
        self.sequence = 0
        self._braking = True

    def advance(self) -> None:
        """Move on by one interpolation period."""
        if self._queue:
            q, v = self._queue.popleft()
            self._fill()
        elif self._cubic is not None and self._rest_of_cubic:
            q, v = self._cubic.q1, self._cubic.v1
            self._cubic = None
        else:
            self._brake()
            return
        self._braking = False
        self.positions = q + self._offset
        self.velocities = v.copy()

    def _fill(self) -> None:
        """Put increments into the queue as far as it and the points go."""
        while len(self._queue) < self._depth and self._cubic is not None and self.busy:
            self._queue.append(self._cubic.at(self._next))
            self._ticks += 1

    def _brake(self) -> None:
        """Slow down as servos do whose commands have ended."""
        if not self.velocities.any():
            return
        if not self._braking and np.abs(self.velocities).max() > _AT_REST:
            self.underruns += 1
        self._braking = True
        step = self._period
        speed = np.maximum(np.abs(self.velocities) - self.axes.braking * step, 0.0)
        after = np.copysign(speed, self.velocities)
        way = 0.5 * step * (self.velocities + after)
        self.velocities = np.where(speed > 0.0, after, 0.0)
        self.positions = self.positions + way
        # Increments that still come are added to where the axes stand.
        self._offset = self._offset + way
