"""Rules for clients that the firmware does not enforce: the virtual controller records violations
of them.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from unwrinkle.hardware.motoros.messages import GroupPoint
from unwrinkle.models.arrays import Array

#: Excess over a position limit that is rounding of float32, rad.
_POSITION_ROUNDING_RAD = 1e-5
#: Excess over a velocity limit that is rounding, relative.
_SPEED_ROUNDING = 1e-5
#: Fraction of a millisecond that a time must have, so that its truncation is not a matter of
#: rounding.
_FRACTION = (0.1, 0.9)
#: Places in a cubic at which it is checked, in shares of its duration.
_PLACES = np.linspace(0.0, 1.0, 33)[:, None]


@dataclass(frozen=True, eq=False)
class _Last:
    sequence: int
    time: int
    positions: Array
    velocities: Array


@dataclass(frozen=True, eq=False)
class AuditLimits:
    """Limits of one group's axes: positions, rad, and velocities, rad/s, (A,) each."""

    lower: Array
    upper: Array
    velocity: Array


@dataclass
class Audit:
    """Violations of the rules.

    Attributes:
        findings: one sentence each, in order; the newest thousand.
    """

    findings: deque[str] = field(default_factory=lambda: deque(maxlen=1000))
    _last: dict[int, _Last] = field(default_factory=dict)

    def several(self, count: int) -> None:
        """Record that `count` messages came in one read: only one request may be under way."""
        self.findings.append(f"{count} messages in one read; one request at a time")

    def stopped(self) -> None:
        """Require a trajectory's first point next, after a stop."""
        self._last.clear()

    def point(self, point: GroupPoint, sequence: int, limits: AuditLimits) -> None:
        """Check a point that the controller has accepted."""
        assert point.time is not None and point.positions is not None
        assert point.velocities is not None
        size = len(limits.lower)
        numbers = np.array((point.positions, point.velocities))
        label = f"group {point.group}, point {sequence}"
        if not (np.isfinite(numbers).all() and np.isfinite(point.time)):
            self.findings.append(f"{label}: not finite")
            return
        if numbers[:, size:].any():
            self.findings.append(f"{label}: values of joints that the group does not have")
        fraction = 1e3 * point.time % 1.0
        if not _FRACTION[0] < fraction < _FRACTION[1]:
            self.findings.append(f"{label}: {point.time:.6f} s is not sent as a whole millisecond")
        q, v = numbers[0, :size], numbers[1, :size]
        now = _Last(sequence, int(1000.0 * point.time), q, v)
        self._values(label, q, v, limits)
        last = self._last.get(point.group)
        if sequence != 0 and (last is None or sequence != last.sequence + 1):
            self.findings.append(f"{label}: follows {'none' if last is None else last.sequence}")
        elif sequence != 0 and last is not None:
            self._between(label, last, now, limits)
        self._last[point.group] = now

    def _values(self, label: str, q: Array, v: Array, limits: AuditLimits) -> None:
        if (
            (q < limits.lower - _POSITION_ROUNDING_RAD)
            | (q > limits.upper + _POSITION_ROUNDING_RAD)
        ).any():
            self.findings.append(f"{label}: a position beyond its limit")
        if (np.abs(v) > limits.velocity * (1.0 + _SPEED_ROUNDING)).any():
            self.findings.append(f"{label}: a velocity beyond its limit")

    def _between(self, label: str, last: _Last, now: _Last, limits: AuditLimits) -> None:
        step = 1e-3 * (now.time - last.time)
        if step <= 0.0:
            self.findings.append(f"{label}: its time does not increase")
            return
        u = _PLACES
        dq, v0, v1 = now.positions - last.positions, last.velocities, now.velocities
        q = (
            last.positions
            + dq * u**2 * (3.0 - 2.0 * u)
            + step * u * (1.0 - u) * (v0 * (1.0 - u) - v1 * u)
        )
        v = (
            6.0 * u * (1.0 - u) * dq / step
            + v0 * (1.0 - 4.0 * u + 3.0 * u**2)
            + v1 * u * (3.0 * u - 2.0)
        )
        if (
            (q < limits.lower - _POSITION_ROUNDING_RAD)
            | (q > limits.upper + _POSITION_ROUNDING_RAD)
        ).any():
            self.findings.append(f"{label}: the cubic before it leaves a position limit")
        # Speeds of float32 positions a few ms apart are rounded, rad/s.
        room = limits.velocity * (1.0 + _SPEED_ROUNDING) + 1e-6 / step
        if (np.abs(v) > room).any():
            self.findings.append(f"{label}: the cubic before it exceeds a velocity limit")
