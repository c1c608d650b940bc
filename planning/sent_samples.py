"""Rounding of a trajectory to what the controller receives: whole milliseconds, positions and
velocities as float32.

Every controller profile carries positions (rad) and velocities (rad/s) as float32, and truncates
point times to whole milliseconds (MotoROS 1.9.12, `MotionServer.c:2094`). The driver sends (ms +
0.4) / 1000 as float32, which truncates to the same ms.
"""

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.planning.trajectory import Trajectory

#: Milliseconds in a second.
MILLISECONDS = 1000.0
#: A time counts as a whole millisecond if it differs from one by at most this, s.
WHOLE = 1e-9
#: Longest trajectory, s: from 8192 s on, (ms + 0.4) / 1000 as float32 no longer truncates to the
#: ms.
LONGEST = 8000.0


def whole_milliseconds(times: Array) -> Array:
    """Round times to whole milliseconds, s: the floats nearest to k / 1000."""
    return np.asarray(np.rint(np.asarray(times, dtype=float) * MILLISECONDS) / MILLISECONDS)


def whole_millisecond(time: float) -> float:
    """Round one time to a whole millisecond, s: the float nearest to k / 1000."""
    return round(MILLISECONDS * time) / MILLISECONDS


def as_float32(values: Array) -> Array:
    """Round values to float32 and return them as float64.

    Raises:
        InputError: a value is beyond the range of float32.
    """
    with np.errstate(over="ignore", under="ignore"):
        rounded = np.asarray(values, dtype=np.float32).astype(float)
    if not np.isfinite(rounded).all():
        raise InputError("a value of the trajectory is beyond the range of float32")
    return rounded


def as_sent(trajectory: Trajectory) -> Trajectory:
    """Round a trajectory as the controller does; a rounded one is returned unchanged in value.

    Samples at whole milliseconds keep their positions and velocities, apart from the rounding to
    float32. If a time is no whole millisecond, the cubic is resampled at the nearest whole
    milliseconds, one per sample; the last sample falls on or after the end (by less than a
    millisecond) and keeps the end's position and velocity.

    Args:
        trajectory: to be sent.

    Returns:
        Times k / 1000 s; positions in rad and velocities in rad/s, each the float64 of a float32.

    Raises:
        InputError: it lasts longer than `LONGEST`, or a value is beyond the range of float32.
    """
    if not trajectory.duration <= LONGEST:
        raise InputError(
            f"the trajectory takes {trajectory.duration:.6g} s; the controller's clock represents "
            f"at most {LONGEST:g} s"
        )
    times = whole_milliseconds(trajectory.times)
    positions, velocities = trajectory.positions, trajectory.velocities
    if not (np.abs(times - trajectory.times).max() <= WHOLE and np.all(np.diff(times) > 0.0)):
        times, positions, velocities = _resampled(trajectory)
    return Trajectory(times, as_float32(positions), as_float32(velocities))


def _resampled(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Resample the cubic at whole milliseconds; the first and the last sample keep their values."""
    end = max(1.0, np.ceil((trajectory.duration - WHOLE) * MILLISECONDS))
    steps = np.unique(np.append(np.rint(trajectory.times[:-1] * MILLISECONDS), end))
    times = steps[steps <= end] / MILLISECONDS
    inner = np.minimum(times, trajectory.duration)
    as_float32(trajectory.velocities)  # refuses values whose cubic would overflow
    with np.errstate(all="ignore"):
        path = trajectory.interpolant()
        positions, velocities = path(inner), path.derivative()(inner)
    positions[[0, -1]] = trajectory.positions[[0, -1]]
    velocities[[0, -1]] = trajectory.velocities[[0, -1]]
    return times, positions, velocities
