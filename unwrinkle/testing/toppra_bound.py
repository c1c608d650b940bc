"""Compute the least duration of a motion without a jerk limit, by toppra, to compare with."""

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits
from unwrinkle.planning.timing.toppra_profile import SpeedProfile, time_optimal_profile

_GRIDPOINTS = 200  # twice the planner's


def jerk_free_time(path: JointPath, limits: Limits, tip_speed: float | None = None) -> float:
    """Compute the least duration of a path from rest to rest without a jerk limit, s (toppra).

    Args:
        path: the path.
        limits: full limits, without any margin.
        tip_speed: limit of the tool centre points' speed, m/s, if the path has a `tip_rate`.
    """
    return jerk_free_profile(path, limits, tip_speed).duration


def jerk_free_profile(
    path: JointPath, limits: Limits, tip_speed: float | None = None
) -> SpeedProfile:
    """Find the fastest profile of a path; arguments as of `jerk_free_time`."""
    bounds = PathLimits(limits.velocity, limits.acceleration, limits.jerk, tip_speed)
    return time_optimal_profile(path, bounds, _GRIDPOINTS)


def jerk_free_line_time(start: Array, goal: Array, limits: Limits) -> float:
    """Compute the same for a straight joint line: the trapezoid of speed, s."""
    distance = np.abs(np.asarray(goal) - np.asarray(start))
    if distance.max() < 1e-12:
        return 0.0
    with np.errstate(divide="ignore"):
        speed = float(np.min(limits.velocity / distance))
        acceleration = float(np.min(limits.acceleration / distance))
    if speed * speed >= acceleration:
        return 2.0 / float(np.sqrt(acceleration))
    return 1.0 / speed + speed / acceleration
