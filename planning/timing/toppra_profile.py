"""The fastest speed along a curved path without a jerk limit, by toppra.

Joint velocity and the speed of the tool centre points bound ds/dt; joint acceleration bounds q'
d2s/dt2 + q'' (ds/dt)^2, at both ends of every grid interval (toppra's interpolation scheme).
toppra: H. Pham, Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization Based on
Reachability Analysis", IEEE Transactions on Robotics 34(3), 2018.

toppra works with absolute tolerances: time is measured in a unit in which the speed and
acceleration of s are about 1, and each axis in units of its acceleration limit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import NoVerifiedPlanError
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits

_GRIDPOINTS = 100
_UNLIMITED = 1e8  # greatest speed of s that is given to toppra as a bound, in its unit of time


@dataclass(frozen=True)
class LimitInTheWay:
    """The limit that decides how fast a path can be.

    Attributes:
        quantity: velocity, acceleration, jerk or tip speed.
        joint: index of the axis; None for the speed of the tool centre points.
        place: path parameter, 0 to 1.
    """

    quantity: str
    joint: int | None
    place: float

    def described(self, axes: Sequence[str] | None = None) -> str:
        """Say which limit of which axis, and where.

        Axes (n,) are the axes' names, numbers are used without them.
        """
        where = f"at {100.0 * self.place:.0f} % of the path"
        if self.joint is None:
            return f"the speed limit of the tool centre points {where}"
        axis = f"axis {self.joint + 1}" if axes is None else axes[self.joint]
        return f"the {self.quantity} limit of {axis} {where}"


class PathTimingError(NoVerifiedPlanError):
    """A path cannot be timed within its limits, or takes too long.

    Attributes:
        limit: which joint's limit is in the way, and where.
        effect: what the limit does to the timing, and what to try; continues the description of the
            limit.
        path: index of the path, where several are timed at once.
    """

    def __init__(self, limit: LimitInTheWay, effect: str, path: int = 0) -> None:
        """Carry the limit, and say what it does."""
        super().__init__(f"{limit.described()} {effect}")
        self.limit, self.effect, self.path = limit, effect, path

    def named(self, path: str, axes: Sequence[str]) -> "PathTimingError":
        """The same error, whose message has the names of the path and of the axes (n,)."""
        named = PathTimingError(self.limit, self.effect, self.path)
        named.args = (f"the {path} cannot be timed: {self.limit.described(axes)} {self.effect}",)
        return named


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """Speed of the path parameter at grid points; its second time derivative is constant between
    them.

    Attributes:
        s: (N+1,) path parameter, from 0 to 1.
        speed: (N+1,) ds/dt, 1/s; zero at both ends.
    """

    s: Array
    speed: Array

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        self.s.setflags(write=False)
        self.speed.setflags(write=False)

    @property
    def steps(self) -> Array:
        """Times of the grid intervals (N,), s."""
        return np.asarray(2.0 * np.diff(self.s) / (self.speed[1:] + self.speed[:-1]))

    @property
    def duration(self) -> float:
        """From rest to rest, s."""
        return float(np.sum(self.steps))

    @property
    def second(self) -> Array:
        """Second time derivative of s in the grid intervals (N,), 1/s^2."""
        return np.asarray(np.diff(self.speed) / self.steps)

    def squared_speed(self, s: Array) -> Array:
        """(ds/dt)^2 at path parameters (M,), 1/s^2.

        Exact, as it is linear in s between grid points.
        """
        return np.asarray(np.interp(s, self.s, self.speed**2))


def time_optimal_profile(
    path: JointPath, limits: PathLimits, gridpoints: int = _GRIDPOINTS
) -> SpeedProfile:
    """Find the fastest speed along a path from rest to rest under velocity, acceleration and tip
    speed limits.

    Args:
        path: the path.
        limits: jerk is not bounded, though its limit must be positive too: the smoothing stage
            needs it.
        gridpoints: intervals of toppra's backward and forward passes.

    Raises:
        PathTimingError: a limit is not positive and finite, or toppra finds no profile; with the
            joint and the place.
    """
    _refuse_limits(path, limits)
    s = np.linspace(0.0, 1.0, gridpoints + 1)
    rate = np.abs(path.spline(s, nu=1))
    per_speed = np.max(rate / limits.velocity, axis=1)
    if limits.tip_speed is not None and path.tip_rate is not None:
        per_speed = np.maximum(per_speed, path.tip_rate(s) / limits.tip_speed)
    unit = max(float(per_speed.max()), float(np.sqrt(np.max(rate / limits.acceleration))))  # s
    cap = unit / np.maximum(per_speed, unit / _UNLIMITED)
    # Imported here: toppra loads pyplot, which takes longer than timing a motion.
    from unwrinkle.planning.timing.toppra_problem import controllable_profile

    speed, controllable = controllable_profile(path, limits.acceleration * unit**2, cap, s)
    if speed is None or not np.isfinite(speed).all() or not np.all(speed[1:] + speed[:-1] > 0.0):
        raise _no_profile(path, limits, s, controllable, speed)
    return SpeedProfile(s, np.asarray(speed) / unit)


def deciding_limit(path: JointPath, limits: PathLimits, profile: SpeedProfile) -> LimitInTheWay:
    """Find the limit that a path's fastest profile keeps to for the longest time, and the middle of
    that time.

    Args:
        path: the path.
        limits: for which the profile was made.
        profile: of `time_optimal_profile`.
    """
    middle = 0.5 * (profile.s[1:] + profile.s[:-1])
    squared = profile.squared_speed(middle)[:, None]
    q1, q2 = path.spline(middle, nu=1), path.spline(middle, nu=2)
    speed = np.abs(q1) * np.sqrt(squared) / limits.velocity
    acceleration = np.abs(q2 * squared + q1 * profile.second[:, None]) / limits.acceleration
    tip = np.zeros((len(middle), 1))
    if limits.tip_speed is not None and path.tip_rate is not None:
        tip = path.tip_rate(middle)[:, None] * np.sqrt(squared) / limits.tip_speed
    nearest = np.argmax(np.hstack([speed, acceleration, tip]), axis=1)
    n, steps = q1.shape[1], profile.steps
    time = np.bincount(nearest, weights=steps, minlength=2 * n + 1)
    kind = int(np.argmax(time))
    passed = np.cumsum(np.where(nearest == kind, steps, 0.0))
    place = float(middle[np.searchsorted(passed, 0.5 * passed[-1])])
    if kind == 2 * n:
        return LimitInTheWay("tip speed", None, place)
    return LimitInTheWay("velocity" if kind < n else "acceleration", kind % n, place)


def _refuse_limits(path: JointPath, limits: PathLimits) -> None:
    """Refuse limits that are not positive, finite numbers.

    Raises:
        PathTimingError: with the axis, and the place where it moves most.
    """
    s = np.linspace(0.0, 1.0, _GRIDPOINTS + 1)
    for quantity in ("velocity", "acceleration", "jerk"):
        values = getattr(limits, quantity)
        wrong = np.flatnonzero(~((values > 0.0) & np.isfinite(values)))
        if len(wrong):
            joint = int(wrong[0])
            place = float(s[np.argmax(np.abs(path.spline(s, nu=1)[:, joint]))])
            raise PathTimingError(
                LimitInTheWay(quantity, joint, place),
                f"is {values[joint]:g}; give positive, finite limits",
            )
    if limits.tip_speed is not None and not limits.tip_speed > 0.0:
        place = 0.0 if path.tip_rate is None else float(s[np.argmax(path.tip_rate(s))])
        raise PathTimingError(
            LimitInTheWay("tip speed", None, place),
            f"is {limits.tip_speed:g} m/s; give positive limits",
        )


def _no_profile(
    path: JointPath, limits: PathLimits, s: Array, controllable: Array, speed: Array | None
) -> PathTimingError:
    """Name the joint and the place where toppra found no speed.

    Acceleration alone can leave none there.
    """
    failed = np.flatnonzero(~np.isfinite(controllable).all(axis=1))
    if len(failed):
        index = int(failed[-1])  # toppra's first pass runs backwards
    elif speed is None:
        index = 0
    else:
        index = int(np.flatnonzero(~(speed[1:] + speed[:-1] > 0.0))[0])
    share = np.maximum(np.abs(path.spline(s[index], nu=1)), np.abs(path.spline(s[index], nu=2)))
    limit = LimitInTheWay(
        "acceleration", int(np.argmax(share / limits.acceleration)), float(s[index])
    )
    return PathTimingError(
        limit, "leaves no speed there; move the target, so that the path bends less"
    )
