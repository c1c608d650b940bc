"""How fast a path could be without a jerk limit: toppra's optimum, as the yardstick of the timing."""

import logging

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.planning.timing.path_timing import JointPath

logging.getLogger("toppra").setLevel(logging.ERROR)


def jerk_free_time(
    path: JointPath, limits: Limits, tip_speed: float | None = None, gridpoints: int = 200
) -> float:
    """Least duration of a path from rest to rest under velocity and acceleration limits alone, s (toppra).

    Args:
        path: the path.
        limits: full limits, without any margin.
        tip_speed: limit of the tool centre points' speed, m/s, if the path has a `tip_rate`.
        gridpoints: of toppra's backward and forward passes.
    """
    s, speed = jerk_free_profile(path, limits, tip_speed, gridpoints)
    return float(np.sum(2.0 * np.diff(s) / (speed[1:] + speed[:-1])))


def jerk_free_profile(
    path: JointPath, limits: Limits, tip_speed: float | None = None, gridpoints: int = 200
) -> tuple[Array, Array]:
    """The path parameter at the grid points and the fastest ds/dt there, 1/s, both (gridpoints + 1,); ds^2/dt^2 is constant between.

    Args:
        path: the path.
        limits: of velocity and acceleration.
        tip_speed: as in `jerk_free_time`.
        gridpoints: as in `jerk_free_time`.
    """
    s = np.linspace(0.0, 1.0, gridpoints + 1)
    constraints = [
        toppra.constraint.JointVelocityConstraint(
            np.column_stack([-limits.velocity, limits.velocity])
        ),
        toppra.constraint.JointAccelerationConstraint(
            np.column_stack([-limits.acceleration, limits.acceleration]),
            discretization_scheme=toppra.constraint.DiscretizationType.Interpolation,
        ),
    ]
    if tip_speed is not None and path.tip_rate is not None:
        rate = np.maximum(path.tip_rate(s), 1e-12)
        constraints.append(SpeedCap(s, tip_speed / rate, len(limits.velocity)))
    problem = toppra.algorithm.TOPPRA(
        constraints,
        toppra.SplineInterpolator(s, path.spline(s)),
        gridpoints=s,
        parametrizer="ParametrizeConstAccel",
    )
    _, speed, _ = problem.compute_parameterization(0.0, 0.0)
    return s, np.asarray(speed)


def jerk_free_line_time(start: Array, goal: Array, limits: Limits) -> float:
    """The same for a straight joint line: the trapezoid of speed, s."""
    distance = np.abs(np.asarray(goal) - np.asarray(start))
    if distance.max() < 1e-12:
        return 0.0
    with np.errstate(divide="ignore"):
        speed = float(np.min(limits.velocity / distance))
        acceleration = float(np.min(limits.acceleration / distance))
    if speed * speed >= acceleration:
        return 2.0 / float(np.sqrt(acceleration))
    return 1.0 / speed + speed / acceleration


class SpeedCap(toppra.constraint.LinearConstraint):
    """An upper bound on ds/dt along the path."""

    def __init__(self, s: Array, cap: Array, dof: int) -> None:
        """Take the bounds cap (M,), 1/s, at path parameters s (M,), of a path with `dof` axes."""
        super().__init__()
        self._s, self._cap = s, cap
        self.dof = dof
        self.discretization_type = toppra.constraint.DiscretizationType.Collocation
        self.n_extra_vars = 0
        self.identical = False

    def compute_constraint_params(self, path, gridpoints, *_):  # type: ignore[no-untyped-def]
        """What toppra asks of a constraint: here only bounds on the squared speed."""
        cap = np.interp(gridpoints, self._s, self._cap)
        bound = np.column_stack([np.zeros(len(cap)), cap**2])
        return None, None, None, None, None, None, bound
