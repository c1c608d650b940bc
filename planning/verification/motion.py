"""The motion that is verified: cubic pieces with exact extremes, and gripper strokes between
segments.

Between two samples the controller runs the cubic Hermite interpolant of positions and velocities.
Its acceleration is linear and its jerk constant, so the extremes of every derivative follow in
closed form. The verification has its own cubic on purpose: it does not rely on the one of planner
and driver.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.planning.plan import FlatteningPlan, Segment

#: Columns of a leg: the robot's axes, then the driven blades of the right and the left gripper.
JOINTS = 15
_BLADES = 2


@dataclass(frozen=True, eq=False)
class Leg:
    """One part of the plan's motion: a segment, or a gripper stroke while the arms rest.

    Attributes:
        name: of the segment, or `grippers`.
        times: (n,) on the plan's clock, s.
        positions: (n, 15) rad, and m for the blades.
        velocities: (n, 15).
        held: whether a gripper is closed in all or part of it.
        contact: interval on the plan's clock in which fingers may touch the working table, or None.
    """

    name: str
    times: Array
    positions: Array
    velocities: Array
    held: bool
    contact: tuple[float, float] | None

    @cached_property
    def step(self) -> Array:
        """Lengths of the intervals, (n-1, 1), s."""
        return np.diff(self.times)[:, None]

    @cached_property
    def acceleration(self) -> tuple[Array, Array]:
        """Acceleration at the start and at the end of every interval, (n-1, 15) each.

        Linear in between.
        """
        h = self.step
        chord = np.diff(self.positions, axis=0) / h
        v0, v1 = self.velocities[:-1], self.velocities[1:]
        return (6.0 * chord - 4.0 * v0 - 2.0 * v1) / h, (-6.0 * chord + 2.0 * v0 + 4.0 * v1) / h

    @cached_property
    def jerk(self) -> Array:
        """Constant jerk of every interval, (n-1, 15)."""
        begin, end = self.acceleration
        return (end - begin) / self.step

    @cached_property
    def greatest_velocity(self) -> Array:
        """Greatest absolute velocity in every interval, (n-1, 15).

        Exact: at an end, or where acceleration is 0.
        """
        begin, end = self.acceleration
        v0, v1 = self.velocities[:-1], self.velocities[1:]
        inside = begin * end < 0.0
        root = np.where(inside, begin / np.where(inside, begin - end, 1.0), 0.0) * self.step
        middle = v0 + 0.5 * begin * root
        return np.maximum(np.maximum(np.abs(v0), np.abs(v1)), np.abs(middle))

    @cached_property
    def greatest_acceleration(self) -> Array:
        """Greatest absolute acceleration in every interval, (n-1, 15).

        Exact: at one of its ends.
        """
        begin, end = self.acceleration
        return np.maximum(np.abs(begin), np.abs(end))

    def position_extremes(self) -> tuple[Array, Array]:
        """Least and greatest position in every interval, (n-1, 15) each.

        Exact: at an end, or where velocity is 0.
        """
        low = np.minimum(self.positions[:-1], self.positions[1:])
        high = np.maximum(self.positions[:-1], self.positions[1:])
        begin, _ = self.acceleration
        v0, h = self.velocities[:-1], self.step
        # v(t) = v0 + begin t + jerk t^2 / 2; roots in the form without cancellation.
        half = 0.5 * self.jerk
        discriminant = begin**2 - 4.0 * half * v0
        root = np.sqrt(np.maximum(discriminant, 0.0))
        q = -0.5 * (begin + np.where(begin < 0.0, -root, root))
        with np.errstate(divide="ignore", invalid="ignore"):
            candidates = (q / half, v0 / q)
        for t in candidates:
            valid = (discriminant >= 0.0) & np.isfinite(t) & (t > 0.0) & (t < h)
            t = np.where(valid, t, 0.0)
            p = self.positions[:-1] + t * (v0 + t * (0.5 * begin + t * self.jerk / 6.0))
            low, high = np.minimum(low, p), np.maximum(high, p)
        return low, high

    def at(self, time: float) -> Array:
        """Return the positions (15,) at a time inside the leg, s on the plan's clock."""
        i = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.step) - 1))
        t = time - self.times[i]
        begin = self.acceleration[0][i]
        return self.positions[i] + t * (
            self.velocities[i] + t * (0.5 * begin + t * self.jerk[i] / 6.0)
        )

    def at_times(self, times: Array) -> "Leg":
        """Resample the same motion at increasing times (m,) in the leg, s on the plan's clock."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.step) - 1)
        t = (times - self.times[i])[:, None]
        begin, jerk, v = self.acceleration[0][i], self.jerk[i], self.velocities[i]
        positions = self.positions[i] + t * (v + t * (0.5 * begin + t * jerk / 6.0))
        velocities = v + t * (begin + 0.5 * t * jerk)
        return Leg(self.name, times, positions, velocities, self.held, self.contact)


def legs(plan: FlatteningPlan, opening: float) -> tuple[Leg, ...]:
    """List the segments of a plan and the gripper strokes between them, in order.

    Args:
        plan: any plan; the names and the order of its segments are checked elsewhere.
        opening: distance of the open blades, m.
    """
    result: list[Leg] = []
    before: Segment | None = None
    for segment in plan.segments:
        if before is not None:
            result.append(_stroke(before, segment, opening))
        samples = segment.trajectory
        count = len(samples.times)
        blades = np.tile(_blades(segment.closed, opening), (count, 1))
        begin, end = (segment.start + time for time in segment.contact)
        result.append(
            Leg(
                segment.name,
                segment.start + samples.times,
                np.hstack([samples.positions, blades]),
                np.hstack([samples.velocities, np.zeros((count, _BLADES))]),
                any(segment.closed),
                (begin, end) if end > begin else None,
            )
        )
        before = segment
    return tuple(result)


def _stroke(before: Segment, after: Segment, opening: float) -> Leg:
    # Constant speed of the blades: clearances depend on the path, not on its timing.
    duration = max(after.start - before.end, 1e-3)
    times = before.end + np.array([0.0, duration])
    blades = np.array([_blades(before.closed, opening), _blades(after.closed, opening)])
    rest = before.trajectory.positions[-1]
    positions = np.hstack([np.tile(rest, (2, 1)), blades])
    rate = np.concatenate([np.zeros(JOINTS - _BLADES), (blades[1] - blades[0]) / duration])
    touching = (
        before.contact[1] >= before.trajectory.duration - 1e-6
        and before.contact[1] > before.contact[0]
        and after.contact[0] <= 1e-6
        and after.contact[1] > after.contact[0]
    )
    return Leg(
        "grippers",
        times,
        positions,
        np.tile(rate, (2, 1)),
        any(before.closed) or any(after.closed),
        (times[0], times[1]) if touching else None,
    )


def _blades(closed: tuple[bool, bool], opening: float) -> Array:
    return np.array([0.0 if state else opening for state in closed])
