"""Time parameterisation of curved paths: toppra's profile without a jerk limit, then the smoothing
stage that bounds jerk.

| smoothing | law of motion | motion time over toppra's |
|---|---|---|
| `optimal` | interior-point programme over the squared path speed | least |
| `ruckig` | one-axis ruckig motions of the path parameter, in sections | longer |
"""

from unwrinkle.models.scenario import Smoothing
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits, TimedPath
from unwrinkle.planning.timing.optimal_smoothing import smooth_optimally
from unwrinkle.planning.timing.ruckig_smoothing import smooth_by_ruckig
from unwrinkle.planning.timing.toppra_profile import PathTimingError, time_optimal_profile


def time_paths(
    paths: list[JointPath], limits: list[PathLimits], smoothing: Smoothing = Smoothing.OPTIMAL
) -> list[TimedPath]:
    """Time several paths, each from rest to rest within its limits.

    Args:
        paths: all with the same number of axes.
        limits: for each.
        smoothing: how jerk is bounded.

    Returns:
        For each path its law of motion, whose limits hold on a dense grid.

    Raises:
        PathTimingError: a path cannot be timed; the error has the joint and the place.
    """
    timed, profiles = [], []
    for i, (path, limit) in enumerate(zip(paths, limits, strict=True)):
        try:
            profiles.append(time_optimal_profile(path, limit))
            if smoothing is Smoothing.RUCKIG:
                timed.append(smooth_by_ruckig(path, limit, profiles[i]))
        except PathTimingError as error:
            error.path = i
            raise
    return timed if smoothing is Smoothing.RUCKIG else smooth_optimally(paths, limits, profiles)
