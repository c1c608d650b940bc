"""Ways to time a seven-pose path under velocity, acceleration and jerk limits: ours, and what
others do.

Every method gets the same five curves, stops at the same places, gets the same margin below the
limits, and returns samples at a period with positions and velocities, between which the controller
runs cubics.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import ruckig
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from benchmarks.planning.trajectories.moveit import Smoothed, Waypoints, smooth
from benchmarks.planning.trajectories.paths import LINES, Piece
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.models.scenario import Smoothing
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits, TimedPath
from unwrinkle.planning.timing.optimal_smoothing import smooth_optimally
from unwrinkle.planning.timing.path_timing import time_paths
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.testing.toppra_bound import jerk_free_profile

Samples = tuple[Array, Array, Array]  # times (N,), positions and velocities (N, 13)
States = tuple[Array, Array, Array]  # positions, velocities, accelerations (N, 13)

#: Period of the samples, s, as the planner sends them.
PERIOD = 0.008
#: Period of the tracking, s; half of the above, which is in its favour.
TRACKING_PERIOD = 0.004

_RESAMPLE = 0.1  # s between the waypoints that MoveIt's time parameterisation leaves by default
_LONGEST = 10.0  # times toppra's duration, after which tracking is given up


@dataclass(frozen=True)
class Failure:
    """Why a method gave nothing for a piece."""

    reason: str


class Law:
    """toppra's fastest law along a path without a jerk limit.

    Constant second derivative of s between grid points.
    """

    def __init__(self, path: JointPath, limits: Limits, tip_speed: float | None) -> None:
        """Run toppra on a path."""
        self._path = path
        profile = jerk_free_profile(path, limits, tip_speed)
        self._s, self._speed, self._second = profile.s, profile.speed, profile.second
        self._times = np.concatenate([[0.0], np.cumsum(profile.steps)])

    @property
    def duration(self) -> float:
        """Time at the end, s."""
        return float(self._times[-1])

    def motion(self, times: Array) -> tuple[Array, Array]:
        """Joint positions and velocities (N, n) at times (N,), s."""
        q, v, _ = self.at(times)
        return q, v

    def at(self, times: Array) -> States:
        """Joint positions, velocities and accelerations (N, n) at times (N,), s.

        Beyond the end at rest there.
        """
        inside = np.clip(times, 0.0, self.duration)
        i = np.clip(
            np.searchsorted(self._times, inside, side="right") - 1, 0, len(self._second) - 1
        )
        dt = inside - self._times[i]
        s = self._s[i] + dt * (self._speed[i] + 0.5 * dt * self._second[i])
        speed, second = self._speed[i] + dt * self._second[i], self._second[i].copy()
        over = times > self.duration
        s, speed[over], second[over] = np.clip(s, 0.0, 1.0), 0.0, 0.0
        q, q1, q2 = (self._path.spline(s, nu=k) for k in range(3))
        return q, q1 * speed[:, None], q2 * speed[:, None] ** 2 + q1 * second[:, None]


@dataclass(frozen=True, eq=False)
class Problem:
    """The five pieces of a path and the limits they are timed for (less a margin already)."""

    pieces: tuple[Piece, ...]
    limits: Limits

    @cached_property
    def paths(self) -> tuple[JointPath, ...]:
        """The curves."""
        return tuple(piece.path() for piece in self.pieces)

    def tip_speed(self, index: int) -> float | None:
        """Cap of the tool centre points' speed in a piece, m/s, or None."""
        return self.limits.tip_speed_holding if self.pieces[index].holding else None

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """toppra's law of every piece."""
        return tuple(Law(path, self.limits, self.tip_speed(i)) for i, path in enumerate(self.paths))


Result = list[Samples | Failure]
Timing = Callable[[list[JointPath], list[PathLimits]], list[TimedPath]]


def toppra_alone(problem: Problem) -> Result:
    """toppra (ParametrizeConstAccel) sampled: no jerk limit at all."""
    return [_sampled(law.duration, law.motion) for law in problem.laws]


def moveit_sent(problem: Problem, *, mitigate: bool = False) -> Result:
    """MoveIt 2: what leaves it, waypoints with durations, velocities and accelerations, run as
    quintics by ros2_control.
    """
    results: Result = []
    for smoothed in _moveit(problem, mitigate):
        if smoothed.reported is not None:
            results.append(Failure(smoothed.reported))
            continue
        spline = smoothed.waypoints.quintic()
        motion = partial(_spline_state, spline, spline.derivative())
        results.append(_sampled(float(spline.x[-1]), motion))
    return results


def moveit_motion(problem: Problem) -> Result:
    """The same waypoints, but run as the very motions that ruckig found between them, each as long
    as ruckig makes it.
    """
    results: Result = []
    for smoothed in _moveit(problem, False):
        if smoothed.incomplete is not None:
            results.append(Failure(smoothed.incomplete))
            continue
        chain = _Chain(smoothed.motions)
        results.append(_sampled(chain.duration, partial(_chain_state, chain)))
    return results


def _moveit(problem: Problem, mitigate: bool) -> Iterator[Smoothed]:
    """What MoveIt 2's smoothing makes of waypoints of toppra's law, spaced as its time
    parameterisation leaves them.
    """
    for law in problem.laws:
        count = int(np.ceil(law.duration / _RESAMPLE - 1e-9))
        times = _RESAMPLE * np.arange(count, dtype=float)
        times = np.append(times, law.duration)
        yield smooth(Waypoints(np.diff(times), *law.at(times)), problem.limits, mitigate=mitigate)


def tracking(problem: Problem) -> Result:
    """13-axis ruckig, online: every cycle towards the position, velocity and acceleration of
    toppra's law one cycle ahead.
    """
    return [_tracked(law, problem.limits) for law in problem.laws]


def _tracked(law: Law, limits: Limits) -> Samples | Failure:
    n, period = len(limits.velocity), TRACKING_PERIOD
    count = int(_LONGEST * law.duration / period)
    targets = law.at(period * np.arange(1, count + 1, dtype=float))
    generator = ruckig.Ruckig(n, period)
    request, output = ruckig.InputParameter(n), ruckig.OutputParameter(n)
    request.current_position = list(law.at(np.zeros(1))[0][0])
    request.max_velocity = list(limits.velocity)
    request.max_acceleration = list(limits.acceleration)
    request.max_jerk = list(limits.jerk)
    positions, velocities = [request.current_position], [np.zeros(n)]
    for k in range(count):
        q, v, a = (x[k] for x in targets)
        v = np.clip(v, -limits.velocity, limits.velocity)
        a = np.clip(a, -limits.acceleration, limits.acceleration)
        # ruckig refuses a target that can only be reached from beyond the speed limit.
        beyond = (a * v < 0.0) & (np.abs(v) + a**2 / (2.0 * limits.jerk) > limits.velocity)
        a = np.where(beyond, 0.0, a)
        request.target_position, request.target_velocity = list(q), list(v)
        request.target_acceleration = list(a)
        try:
            result = generator.update(request, output)
        except ruckig.RuckigError as error:
            return Failure(f"ruckig refuses a cycle: {_short(error)}")
        positions.append(list(output.new_position))
        velocities.append(np.array(output.new_velocity))
        output.pass_to_input(request)
        if result == ruckig.Result.Finished and period * (k + 1) >= law.duration:
            t = period * np.arange(k + 2, dtype=float)
            return t, np.array(positions), np.array(velocities)
    return Failure(f"not at rest at the goal after {_LONGEST:.0f} times toppra's duration")


def planned(problem: Problem, timing: Timing) -> Result:
    """The planner's: ruckig along joint lines, one of its timings along curves."""
    limits = problem.limits
    curved = [i for i in range(len(problem.pieces)) if i not in LINES]
    timed = timing(
        [problem.paths[i] for i in curved],
        [
            PathLimits(limits.velocity, limits.acceleration, limits.jerk, problem.tip_speed(i))
            for i in curved
        ],
    )
    laws = dict(zip(curved, timed, strict=True))
    return [
        laws[i].sample(PERIOD) if i in laws else _line(problem, i)
        for i in range(len(problem.pieces))
    ]


def _line(problem: Problem, index: int) -> Samples:
    q = problem.pieces[index].q
    return time_line(q[0], q[-1], problem.limits, 0.0, PERIOD)[:3]


class _Chain:
    """ruckig's motions one after the other."""

    def __init__(self, motions: list[ruckig.Trajectory]) -> None:
        self._motions = motions
        self._ends = np.cumsum([motion.duration for motion in motions])
        self.duration = float(self._ends[-1])

    def at(self, times: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """Index of the motion (N,), and its positions and velocities (N, n), at times (N,), s."""
        index = np.minimum(np.searchsorted(self._ends, times), len(self._ends) - 1)
        local = times - np.concatenate([[0.0], self._ends])[index]
        states = []
        for k, t in zip(index, local, strict=True):
            motion = self._motions[k]
            states.append(motion.at_time(float(np.clip(t, 0.0, motion.duration)))[:2])
        positions, velocities = (np.array([state[i] for state in states]) for i in (0, 1))
        return index, positions, velocities


def _chain_state(chain: _Chain, times: Array) -> tuple[Array, Array]:
    _, q, v = chain.at(times)
    return q, v


def _spline_state(spline: BPoly, rate: BPoly, times: Array) -> tuple[Array, Array]:
    return spline(times), rate(times)


def _sampled(duration: float, state: Callable[[Array], tuple[Array, Array]]) -> Samples:
    """Samples at the period of a motion.

    Slowed by less than one period, as the planner does, so that the end falls on one.
    """
    count = max(1, int(np.ceil(duration / PERIOD - 1e-9)))
    stretch = count * PERIOD / duration
    t = PERIOD * np.arange(count + 1, dtype=float)
    q, v = state(np.minimum(t / stretch, duration))
    v = v / stretch
    v[0] = v[-1] = 0.0
    return t, q, v


def _short(error: Exception) -> str:
    """ruckig's message without the numbers of the question."""
    return str(error).partition(" input:")[0].partition(":")[0]


#: By key: what the page calls it, and the method.
METHODS: dict[str, tuple[str, Callable[[Problem], Result]]] = {
    "toppra": ("toppra alone", toppra_alone),
    "moveit_sent": ("MoveIt 2, waypoints as sent", moveit_sent),
    "moveit_mitigated": (
        "MoveIt 2, with overshoot mitigation",
        lambda problem: moveit_sent(problem, mitigate=True),
    ),
    "moveit_motion": ("MoveIt 2, ruckig's motion through them", moveit_motion),
    "tracking": ("13-axis ruckig tracking", tracking),
    "ruckig": (
        "ours, `ruckig`",
        lambda problem: planned(problem, partial(time_paths, smoothing=Smoothing.RUCKIG)),
    ),
    "without_start": (
        "ours, `optimal` without toppra's start",
        lambda problem: planned(problem, smooth_optimally),
    ),
    "ours": ("ours, `optimal`", lambda problem: planned(problem, time_paths)),
}
