"""The usual way to bound jerk on a path, as a yardstick: toppra's speed profile, then one-axis ruckig on the path parameter.

toppra runs with 0.8 of the acceleration and a speed cap from the path's third derivative. Its profile is cut at the minima of
speed; each section gets constant bounds on ds/dt and its two derivatives, and a state-to-state ruckig motion between junction
speeds, which are lowered until every section has one. Sections whose joint limits fail on a dense check are slowed, and all
is repeated.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import ruckig
import toppra
import toppra.algorithm
import toppra.constraint
from numpy.typing import NDArray

from unwrinkle.benchmarks._toppra_bound import SpeedCap
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.planning.timing.path_timing import JointPath

_GRID = 100
_ACCELERATION, _JERK = 0.8, 0.4  # shares of the limits that the profile is made for
_JUNCTION = 0.97
_ROUNDS = 25
_CHECK = 0.002  # s


def sectioned_ruckig_time(
    path: JointPath, limits: Limits, tip_speed: float | None = None
) -> float | None:
    """Duration of a path from rest to rest, s; None if no set of sections was found to hold the limits."""
    found = sectioned_ruckig(path, limits, tip_speed)
    return None if found is None else float(sum(motion.duration for _, motion in found))


def sectioned_ruckig(
    path: JointPath, limits: Limits, tip_speed: float | None = None
) -> list[tuple[float, ruckig.Trajectory]] | None:
    """Sections of the motion: the path parameter at each one's begin, and its one-axis motion from 0; None as above."""
    s, speed = _profile(path, limits, tip_speed)
    cuts = _minima(speed)
    sections = [_Section.over(path, limits, s, speed, a, b) for a, b in pairwise(cuts)]
    junctions = _JUNCTION * speed[cuts]
    junctions[[0, -1]] = 0.0
    slow = np.ones(len(sections))
    for _ in range(_ROUNDS):
        wanted = junctions.copy()
        wanted[1:-1] *= np.minimum(slow[:-1], slow[1:])
        speeds = _reachable(sections, slow, wanted)
        motions = [
            x.motion(k, *v)
            for x, k, v in zip(sections, slow, pairwise(speeds.tolist()), strict=True)
        ]
        found = [motion for motion in motions if motion is not None]
        if len(found) < len(motions) or speeds[0] != 0.0 or speeds[-1] != 0.0:
            junctions[1:-1] *= 0.7
            continue
        worst = np.array(
            [x.worst(m, path, limits, tip_speed) for x, m in zip(sections, found, strict=True)]
        )
        if worst.max() <= 1.001:
            return [(x.begin, motion) for x, motion in zip(sections, found, strict=True)]
        slow /= np.where(worst > 1.001, np.minimum(worst, 1.35), 1.0)
    return None


def _profile(path: JointPath, limits: Limits, tip_speed: float | None) -> tuple[Array, Array]:
    """Grid and toppra's ds/dt on it."""
    s = np.linspace(0.0, 1.0, _GRID + 1)
    third = np.abs(path.spline(s, nu=3)) / limits.jerk
    cap = (_JERK / np.maximum(third.max(axis=1), 1e-9)) ** (1.0 / 3.0)
    if tip_speed is not None and path.tip_rate is not None:
        cap = np.minimum(cap, tip_speed / np.maximum(path.tip_rate(s), 1e-12))
    problem = toppra.algorithm.TOPPRA(
        [
            toppra.constraint.JointVelocityConstraint(
                np.column_stack([-limits.velocity, limits.velocity])
            ),
            toppra.constraint.JointAccelerationConstraint(
                _ACCELERATION * np.column_stack([-limits.acceleration, limits.acceleration]),
                discretization_scheme=toppra.constraint.DiscretizationType.Interpolation,
            ),
            SpeedCap(s, cap, len(limits.velocity)),
        ],
        toppra.SplineInterpolator(s, path.spline(s)),
        gridpoints=s,
        parametrizer="ParametrizeConstAccel",
    )
    _, speed, _ = problem.compute_parameterization(0.0, 0.0)
    return s, np.asarray(speed)


def _minima(speed: Array) -> NDArray[np.intp]:
    """Indices of the ends and of the clear local minima."""
    inner = [
        i
        for i in range(2, len(speed) - 2)
        if speed[i] < speed[i - 1]
        and speed[i] <= speed[i + 1]
        and speed[i] < 0.93 * min(speed[max(0, i - 12) : i].max(), speed[i : i + 13].max())
    ]
    return np.array([0, *inner, len(speed) - 1])


@dataclass(frozen=True)
class _Section:
    begin: float
    length: float
    speed: float
    acceleration: float
    jerk: float

    @classmethod
    def over(
        cls, path: JointPath, limits: Limits, s: Array, speed: Array, first: int, last: int
    ) -> "_Section":
        """Bounds that hold for the joints over the section as far as the path's first derivative goes."""
        rate = np.abs(path.spline(np.linspace(s[first], s[last], 40), nu=1)).max(axis=0)
        rate = np.maximum(rate, 1e-9)
        return cls(
            float(s[first]),
            float(s[last] - s[first]),
            float(speed[first : last + 1].max()),
            float((limits.acceleration / rate).min()),
            float((limits.jerk / rate).min()),
        )

    def motion(self, slow: float, start: float, end: float) -> ruckig.Trajectory | None:
        """State-to-state motion between two speeds, or None where there is none that moves forwards only."""
        request, motion = ruckig.InputParameter(1), ruckig.Trajectory(1)
        request.current_position, request.target_position = [0.0], [self.length]
        request.current_velocity, request.target_velocity = [start], [end]
        request.max_velocity = [max(self.speed * slow, start, end) * 1.0001 + 1e-9]
        request.max_acceleration = [self.acceleration * slow**2]
        request.max_jerk = [self.jerk * slow**3]
        try:
            if ruckig.Ruckig(1).calculate(request, motion) < 0:
                return None
        except ruckig.RuckigError:
            return None
        extrema = motion.position_extrema[0]
        forwards = extrema.min >= -1e-7 and extrema.max <= self.length + 1e-7
        return motion if forwards else None

    def worst(
        self,
        motion: ruckig.Trajectory,
        path: JointPath,
        limits: Limits,
        tip_speed: float | None,
    ) -> float:
        """By how much the section must be slowed for every joint limit to hold on a dense check."""
        count = max(8, int(motion.duration / _CHECK))
        times = np.linspace(0.0, motion.duration, count + 1)
        states = np.array([[x[0] for x in motion.at_time(float(t))[:3]] for t in times])
        s, v, a = np.clip(self.begin + states[:, 0], 0.0, 1.0), states[:, 1], states[:, 2]
        j = np.gradient(a, times[1])
        q1, q2, q3 = (path.spline(s, nu=k) for k in (1, 2, 3))
        v, a, j = v[:, None], a[:, None], j[:, None]
        ratios = [
            np.abs(q1 * v) / limits.velocity,
            np.sqrt(np.abs(q2 * v**2 + q1 * a) / limits.acceleration),
            np.cbrt(np.abs(q3 * v**3 + 3.0 * q2 * v * a + q1 * j) / limits.jerk),
        ]
        worst = max(float(ratio.max()) for ratio in ratios)
        if tip_speed is not None and path.tip_rate is not None:
            worst = max(worst, float((path.tip_rate(s) * v[:, 0]).max()) / tip_speed)
        return worst


def _reachable(sections: list[_Section], slow: Array, wanted: Array) -> Array:
    """Junction speeds at most as wanted such that every section has a motion; forwards and backwards to a fixed point."""
    speeds = wanted.copy()
    for _ in range(6):
        before = speeds.copy()
        for i, section in enumerate(sections):
            speeds[i + 1] = _greatest(
                lambda v, x=section, k=slow[i], u=speeds[i]: x.motion(k, u, v), speeds[i + 1]
            )
        for i in reversed(range(len(sections))):
            speeds[i] = _greatest(
                lambda v, x=sections[i], k=slow[i], u=speeds[i + 1]: x.motion(k, v, u), speeds[i]
            )
        if np.allclose(before, speeds):
            break
    return speeds


def _greatest(motion, most: float) -> float:  # type: ignore[no-untyped-def]
    """Greatest speed up to `most` for which there is a motion, by bisection."""
    if motion(most) is not None:
        return most
    low, high = 0.0, most
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if motion(middle) is None else (middle, high)
    return low
