"""Speed override, hold and resume along a trajectory's own path: only the rate of the path's clock
changes.

The trajectory is q(s), cubic between its knots s_k. The points sent are q(s) at times t with
velocities q'(s) r, where r = ds/dt is the rate. The controller accepts whole milliseconds and
float32 numbers, so each point's time is a whole millisecond, and its values are those of the path
at that time, rounded once. At r = 1 the points are the trajectory's own samples, also after a
change of rate, which ends at one of them. A change of rate follows a polynomial r(t) that ends with
r' = r'' = 0. Its duration is the shortest one at which velocity, acceleration and jerk of the
cubics between the points sent keep their limits. Rates just below 1 are run at
`HIGHEST_REDUCED_RATE`: their points lie beside the trajectory's samples, where interpolation and
rounding use some percent of the limits.
"""

from dataclasses import dataclass

import numpy as np

from unwrinkle.hardware.streaming.rate_change import RateChange, RateState, plausible
from unwrinkle.hardware.streaming.sent_cubics import CubicPath, StreamLimits, ceil_ms
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.planning.sent_samples import as_float32, whole_millisecond
from unwrinkle.planning.trajectory import Trajectory, rate_extremes

#: Difference of two times that is rounding, s.
_ROUNDING_S = 1e-9
#: Durations of a change of rate that are tried, s.
_DURATIONS_S = np.unique(np.round(np.geomspace(0.06, 6.0, 45), 3))
#: Rates between this one and 1 are run at this one.
HIGHEST_REDUCED_RATE = 0.97
#: A braking under way is replaced by one that takes at most this share of the time that is left.
_SHORTER_BRAKING_SHARE = 0.88
#: A braking is not replaced if less time is left, s.
_LEAST_BRAKING_LEFT_S = 0.12
#: Points between two searches for a shorter braking: a search takes some milliseconds, and points
#: are due meanwhile.
_POINTS_PER_SEARCH = 4


@dataclass(frozen=True, eq=False)
class Sample:
    """A point as it is sent.

    Attributes:
        time: on the stream's clock, s, from 0 in whole ms; this clock stops while the path rests.
        positions: (13,) rad, on the path, rounded to float32.
        velocities: (13,) rad/s, rounded to float32.
        s: time on the trajectory's own clock, s.
        rate: ds/dt at the point.
    """

    time: float
    positions: Array
    velocities: Array
    s: float
    rate: float


class PathClock:
    """Runs a trajectory at a rate that may change, and produces the points to send.

    Attributes:
        trajectory: to run.
        last: point produced last; None before the first.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        limits: StreamLimits,
        step: float = 0.008,
        rate: float = 1.0,
        longest: float = 0.04,
    ) -> None:
        """Start at rest at the trajectory's first sample.

        Args:
            trajectory: from rest to rest.
            limits: of changes of rate; extremes of the trajectory itself at rate 1 are allowed,
                too.
            step: nominal time between points, s. Points that are not the trajectory's own samples
                are at least twice as far apart, or as far as those: rounding closer points to
                float32 would change the jerk by some percent of its limit.
            rate: at the start, 0 to 1.
            longest: greatest time between points at a constant rate, s.

        Raises:
            InputError: the trajectory does not start and end at rest, or the rate is not within 0
                to 1.
        """
        if not trajectory.rests_at_ends:
            raise InputError(
                "the trajectory does not start and end at rest; plan it from rest to rest"
            )
        self.trajectory = trajectory
        self._path = CubicPath(trajectory)
        own = rate_extremes(trajectory.times, trajectory.positions, trajectory.velocities)
        self._limits = limits.widened(own)
        self._step = step
        self._wide = min(max(2.0 * step, float(np.median(np.diff(trajectory.times)))), longest)
        self._longest = longest
        self._target = _checked(rate)
        self._pending: float | None = None
        self._change: RateChange | None = None
        self._next = 0  # index among the points of the change
        self._anchor = (0.0, 0.0)  # stream time and s from which the rate is constant
        self._state = RateState(0.0, 0.0, self._target, 0.0, 0.0)
        self.last: Sample | None = None

    @property
    def target(self) -> float:
        """Commanded rate."""
        return self._target if self._pending is None else self._pending

    @property
    def done(self) -> bool:
        """Whether the path's last point has been produced."""
        return self.last is not None and self.last.s >= self.trajectory.duration

    @property
    def at_rest(self) -> bool:
        """Whether the last point produced is one of rest: at the start, at the end, or after a
        hold.
        """
        if self.last is None or self.done:
            return True
        return self._change is None and self._target == 0.0

    def set_rate(self, target: float) -> None:
        """Change to another rate, from the last point produced on; 0 is a hold.

        Where no change of rate keeps the limits from there, it begins at a later point; at the
        latest, the path comes to rest at its end.

        Raises:
            InputError: the rate is not within 0 to 1.
        """
        target = _checked(target)
        if target == self.target:
            return
        self._pending = target
        self._begin(_DURATIONS_S)

    def next_until(self, time: float, most: int | None = None) -> list[Sample]:
        """Return the next points up to a stream time, s, at most `most` of them."""
        points: list[Sample] = []
        while len(points) != most and (sample := self._produce(time)) is not None:
            self.last = sample
            points.append(sample)
            if self._pending is not None:
                self._begin(_DURATIONS_S)
            elif (
                self._change is not None
                and self._target == 0.0
                and self._next % _POINTS_PER_SEARCH == 0
            ):
                self._shorten()
        return points

    def remaining(self) -> Trajectory:
        """Return the rest of the path, from rest where a hold ended, at the full rate.

        Raises:
            InputError: the path is not at rest, or at its end.
        """
        if not self.at_rest or self.done:
            raise InputError("what remains of a path can be had while it rests before its end")
        if self.last is None or self.last.s == 0.0:
            return self.trajectory
        rest = PathClock(self.trajectory, self._limits, self._step, longest=self._longest)
        rest.last = self.last
        rest._target = 0.0
        rest._state = RateState(0.0, self.last.s, 0.0, 0.0, 0.0)
        rest.set_rate(1.0)
        points = [self.last, *rest.next_until(np.inf)]
        return Trajectory(
            np.array([0.0] + [point.time for point in points[1:]]),
            np.array([point.positions for point in points]),
            np.array([point.velocities for point in points]),
        )

    # Producing points

    def _produce(self, time: float) -> Sample | None:
        """Return the next point, if it is due by the stream time, s."""
        if self.last is None:
            q, slope = self._path.knot(0)
            return Sample(0.0, as_float32(q), as_float32(slope), 0.0, self._target)
        if self.done:
            return None
        if self._change is not None:
            return self._changing(self._change, time)
        if self._target == 0.0:
            return None
        return self._constant(time)

    def _changing(self, change: RateChange, time: float) -> Sample | None:
        i = self._next
        if change.times[i] > time + _ROUNDING_S:
            return None
        self._next += 1
        self._state = change.state(i)
        sample = Sample(
            float(change.times[i]),
            change.positions[i],
            change.velocities[i],
            self._state.s,
            self._state.rate,
        )
        if self._next == len(change.times):
            self._change = None
            self._settle(sample.time, sample.s)
        return sample

    def _settle(self, time: float, s: float) -> None:
        """Keep the rate constant from here on."""
        self._anchor = (time, s)
        self._state = RateState(time, s, self._target, 0.0, 0.0)

    def _constant(self, time: float) -> Sample | None:
        """Return the next point at a constant rate: the trajectory's own samples at the full rate,
        else even steps.
        """
        rate, state = self._target, self._state
        knot, at_knot = self._path.knot_after(state.s + _ROUNDING_S)
        left = (self._path.end - state.s) / rate
        if rate == 1.0 and self._path.has_knot(state.s):
            gap = at_knot - state.s
            steps = gap / max(1, int(np.ceil(gap / self._longest - _ROUNDING_S)))
        else:
            steps = min(max(self._wide, self._step / rate), self._longest)
            if left < 2.0 * steps:  # two even ones, then the last
                steps = left if left <= steps else 0.5 * left
        when = whole_millisecond(state.time + max(steps, 1e-3))
        s = self._anchor[1] + (when - self._anchor[0]) * rate
        if s > self._path.end - 0.5e-3 * rate:  # less than half a millisecond would be left
            when = max(ceil_ms(state.time + left), whole_millisecond(state.time + 1e-3))
            knot, s = len(self._path.knots) - 1, self._path.end
        elif abs(s - at_knot) < _ROUNDING_S:
            s = at_knot
        if when > time + _ROUNDING_S:
            return None
        self._state = RateState(when, s, rate, 0.0, 0.0)
        q, slope = self._path.knot(knot) if s == self._path.knots[knot] else self._path.curve.at(s)
        return Sample(when, as_float32(q), as_float32(slope * rate), s, rate)

    # Changing the rate

    def _begin(self, times: Array) -> None:
        """Begin the pending change of rate, if one keeps the limits from here."""
        assert self._pending is not None
        target = self._pending
        if self.last is None or self.last.s == 0.0:  # at rest there, so any rate may begin
            self._target, self._pending, self._change = target, None, None
            self._settle(0.0, 0.0)
            return
        if self.done:
            self._pending = None
            return
        if self._change is None and self._target == target:  # taken back before it began
            self._pending = None
            return
        change = self._shortest(target, times)
        if change is not None:
            self._target, self._pending = target, None
            self._change, self._next = change, 0

    def _shorten(self) -> None:
        """Replace a braking by a shorter one, if there is one: where it began, the path itself may
        have used up a limit.
        """
        assert self._change is not None
        left = float(self._change.times[-1]) - self._state.time
        if left < _LEAST_BRAKING_LEFT_S:
            return
        change = self._shortest(0.0, _DURATIONS_S[_SHORTER_BRAKING_SHARE * left > _DURATIONS_S])
        if change is not None:
            self._change, self._next = change, 0

    def _shortest(self, target: float, times: Array) -> RateChange | None:
        for duration in plausible(self._path, self._state, target, times, self._limits):
            change = RateChange.make(self._path, self._state, target, float(duration), self._wide)
            if change is not None and self._keeps(change):
                return change
        return None

    def _keeps(self, change: RateChange) -> bool:
        assert self.last is not None
        times = np.concatenate([[self.last.time], change.times])
        positions = np.vstack([self.last.positions, change.positions])
        velocities = np.vstack([self.last.velocities, change.velocities])
        return self._limits.keeps(rate_extremes(times, positions, velocities))


def _checked(rate: float) -> float:
    if not 0.0 <= rate <= 1.0:
        raise InputError(f"rate along the path is {rate}; give 0 to 1")
    return HIGHEST_REDUCED_RATE if HIGHEST_REDUCED_RATE < rate < 1.0 else float(rate)
