"""Straight joint lines from rest to rest, timed by ruckig so that all axes keep to the line."""

import numpy as np
import ruckig
from numpy.typing import NDArray

from unwrinkle.models.errors import NoSafePlanError
from unwrinkle.models.limits import Limits

Array = NDArray[np.float64]


def time_line(
    start: Array,
    goal: Array,
    limits: Limits,
    margin: float,
    period: float,
    longest: float = np.inf,
) -> tuple[Array, Array, Array, float]:
    """Samples of the fastest jerk-limited motion along a straight joint line.

    Args:
        start: (n,) rad, at rest.
        goal: (n,) rad, at rest.
        limits: of the axes.
        margin: fraction of every limit that is left unused.
        period: of the samples, s; the motion is slowed by less than one period so that its end falls on a sample.
        longest: s; a motion that takes longer is refused before it is sampled.

    Returns:
        Times (N,), positions and velocities (N, n), and the duration before that slowing, s.

    Raises:
        NoSafePlanError: ruckig finds no motion (limits that are not positive, say), or one that takes too long.
    """
    n = len(start)
    distance = float(np.abs(goal - start).max())
    if distance < 1e-12:
        return np.zeros(1), start[None].copy(), np.zeros((1, n)), 0.0
    generator = ruckig.Ruckig(n)
    request, motion = ruckig.InputParameter(n), ruckig.Trajectory(n)
    request.current_position, request.target_position = list(start), list(goal)
    keep = 1.0 - margin
    request.max_velocity = list(keep * limits.velocity)
    request.max_acceleration = list(keep * limits.acceleration)
    request.max_jerk = list(keep * limits.jerk)
    request.synchronization = ruckig.Synchronization.Phase  # Time would leave the line
    try:
        result = generator.calculate(request, motion)
    except ruckig.RuckigError as error:
        cause = str(error).partition(" input:")[0]  # the rest repeats every number of the question
        raise NoSafePlanError(f"no jerk-limited motion along a joint line: {cause}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise NoSafePlanError(f"no jerk-limited motion along a joint line: ruckig says {result}")
    if motion.duration > longest:
        raise NoSafePlanError(
            f"a transit would take {motion.duration:.0f} s, at most {longest:.0f} s are allowed; check "
            "the limits and the speed"
        )
    count = max(1, int(np.ceil(motion.duration / period - 1e-9)))
    stretch = count * period / motion.duration
    t = period * np.arange(count + 1, dtype=float)
    states = [motion.at_time(float(min(x / stretch, motion.duration))) for x in t]
    q = np.array([state[0] for state in states])
    v = np.array([state[1] for state in states]) / stretch
    q[0], q[-1] = start, goal
    v[0] = v[-1] = 0.0
    return t, q, v, float(motion.duration)
