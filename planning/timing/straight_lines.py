"""Straight joint lines from rest to rest.

One scalar runs along the line, so that no axis can leave it.
"""

from dataclasses import dataclass

import numpy as np
import ruckig

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import NoVerifiedPlanError
from unwrinkle.models.limits import Limits
from unwrinkle.planning.timing.sampling import sample_within

_SHORTEST = 1e-12  # rad; a line with less motion takes no time


@dataclass(frozen=True, eq=False)
class TimedLine:
    """A straight joint line with its law of motion.

    Attributes:
        start: (n,) rad.
        goal: (n,) rad.
        law: ruckig's motion of the axis that moves furthest, rad.
    """

    start: Array
    goal: Array
    law: ruckig.Trajectory

    @property
    def duration(self) -> float:
        """Of the fastest motion along the line, s."""
        return float(self.law.duration)

    def sample(self, period: float, slower: float = 1.0) -> tuple[Array, Array, Array]:
        """Times (N,), positions and velocities (N, n) at a period, all on the line, the first and
        last at rest.

        Args:
            period: s.
            slower: factor on the duration, at least 1; what is left to the next whole period is
                added.
        """
        count = max(1, int(np.ceil(self.duration * slower / period - 1e-9)))
        stretch = count * period / self.duration
        t = period * np.arange(count + 1, dtype=float)
        states = [self.law.at_time(min(float(x) / stretch, self.duration)) for x in t]
        way = self.goal - self.start
        length = float(np.abs(way).max())
        along = np.clip([state[0][0] for state in states], 0.0, length) / length
        rate = np.array([state[1][0] for state in states]) / (length * stretch)
        q = self.start + along[:, None] * way
        v = rate[:, None] * way
        q[0], q[-1] = self.start, self.goal
        v[0] = v[-1] = 0.0
        return t, q, v


def time_line(
    start: Array,
    goal: Array,
    limits: Limits,
    margin: float,
    period: float,
    longest: float = np.inf,
) -> tuple[Array, Array, Array, float]:
    """Samples of the fastest jerk-limited motion along a straight joint line.

    The line q = start + s (goal - start), s in [0, 1], is run by one scalar under the tightest of
    all axes' limits (limit / `|goal - start|`). Ruckig's own synchronisation of several axes keeps
    to the line only where no other axis' limit is in the way, and says nothing where it does not.

    Args:
        start: (n,) rad, at rest.
        goal: (n,) rad, at rest.
        limits: of the axes.
        margin: fraction of every limit that is left unused.
        period: of the samples, a whole number of milliseconds, s; the motion is slowed so that its
            end falls on a sample, and until the full limits hold for the samples as they are sent.
        longest: s; a motion that takes longer is refused before it is sampled.

    Returns:
        Times (N,), positions and velocities (N, n), and the duration before that slowing, s.

    Raises:
        NoVerifiedPlanError: ruckig finds no motion (limits that are not positive, say), or one that
            takes too long.
    """
    way = np.abs(goal - start)
    if float(way.max()) < _SHORTEST:
        return np.zeros(1), start[None].copy(), np.zeros((1, len(start))), 0.0
    line = _timed(start, goal, limits, margin)
    if not line.duration <= longest:
        raise NoVerifiedPlanError(
            f"a transit would take {line.duration:.0f} s, at most {longest:.0f} s are allowed; "
            "check the limits and the speed"
        )
    return *sample_within(line, period, limits), line.duration


def _timed(start: Array, goal: Array, limits: Limits, margin: float) -> TimedLine:
    """The line with ruckig's motion of the axis that moves furthest, in rad, under all axes'
    limits.
    """
    way = np.abs(goal - start)
    length = float(way.max())
    share = way / length
    moving = share > 0.0

    def tightest(limit: Array) -> float:
        return (1.0 - margin) * float(np.min(limit[moving] / share[moving]))

    request, law = ruckig.InputParameter(1), ruckig.Trajectory(1)
    request.current_position, request.target_position = [0.0], [length]
    request.max_velocity = [tightest(limits.velocity)]
    request.max_acceleration = [tightest(limits.acceleration)]
    request.max_jerk = [tightest(limits.jerk)]
    try:
        result = ruckig.Ruckig(1).calculate(request, law)
    except ruckig.RuckigError as error:
        cause = str(error).partition(" input:")[0]  # the rest repeats every number of the question
        raise NoVerifiedPlanError(f"no jerk-limited motion on a joint line: {cause}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise NoVerifiedPlanError(
            f"no jerk-limited motion along a joint line: ruckig says {result}"
        )
    return TimedLine(start, goal, law)
