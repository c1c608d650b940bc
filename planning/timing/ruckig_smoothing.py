"""Smoothing by ruckig: one-axis jerk-limited motions of the path parameter, under constant bounds
in sections of the path.

toppra's profile, bounded by a share of the jerk limit where the path bends sharply, is cut at its
minima. Each section has constant bounds on ds/dt and its two derivatives, and a state-to-state
ruckig motion between junction speeds, which are lowered until every section has one. Sections in
which the joints or the tool centre points break a limit on a check are slowed, and all is repeated.
Where that does not settle, the whole path is one section, from rest to rest. What a finer check
finds left is slowed away: a motion k times slower has velocities, accelerations and jerks k, k^2
and k^3 times smaller.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import ruckig
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits, TimedPath
from unwrinkle.planning.timing.toppra_profile import (
    PathTimingError,
    SpeedProfile,
    deciding_limit,
)

_JERK = 0.4  # share of the jerk limit that the path's third derivative alone may use
_JUNCTION = 0.97  # of the profile's speed
_ROUNDS = 25
_COARSE, _FINE = 1.0 / 300.0, 1.0 / 2400.0  # steps of the checks, of the profile's duration
_TOLERANCE = 1e-3  # of the coarse check, relative; the fine one has none
_CLEAR = 0.93  # a minimum of speed below this share of what surrounds it is a cut
_AROUND = 0.12  # of the path, to either side


@dataclass(frozen=True, eq=False)
class PhasedLaw:
    """Path parameter over time in phases of constant third derivative.

    Attributes:
        ends: (M,) time at the end of each phase, s.
        states: (M, 4) path parameter and its first, second and third derivative by time at each
            phase's begin.
    """

    ends: Array
    states: Array

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        self.ends.setflags(write=False)
        self.states.setflags(write=False)

    @classmethod
    def joined(cls, begins: list[float], motions: list[ruckig.Trajectory]) -> "PhasedLaw":
        """Join ruckig's one-axis motions, each from 0.

        `begins` are the path parameters at which they begin.
        """
        durations, states = [], []
        for begin, motion in zip(begins, motions, strict=True):
            phases = motion.profiles[0][0]
            durations.append(phases.t)
            p = begin + np.array(phases.p[:7])
            states.append(np.stack([p, phases.v[:7], phases.a[:7], phases.j], axis=1))
        steps, rows = np.concatenate(durations), np.concatenate(states)
        lasting = steps > 0.0
        return cls(np.cumsum(steps[lasting]), rows[lasting])

    @property
    def duration(self) -> float:
        """Of all phases, s."""
        return float(self.ends[-1])

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the path parameter and its rate, 1/s, at times (N,), s."""
        index = np.minimum(np.searchsorted(self.ends, times), len(self.ends) - 1)
        starts = np.concatenate([[0.0], self.ends[:-1]])
        s, rate, _ = _moved(self.states[index], times - starts[index])
        return np.clip(s, 0.0, 1.0), rate

    def slowed(self, factor: float) -> "PhasedLaw":
        """The same motion, that takes a factor longer."""
        return PhasedLaw(factor * self.ends, self.states / factor ** np.arange(4.0))

    def worst(self, path: JointPath, limits: PathLimits, step: float) -> Array:
        """By how much each phase (M,) must be slowed for every limit to hold, checked at most
        `step` apart and at its ends.
        """
        durations = np.diff(self.ends, prepend=0.0)
        counts = np.maximum(np.ceil(durations / step).astype(int), 4) + 1
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        phase = np.repeat(np.arange(len(counts)), counts)
        share = (np.arange(counts.sum()) - first[phase]) / (counts[phase] - 1)
        states = self.states[phase]
        s, v, a = _moved(states, share * durations[phase])
        s = np.clip(s, 0.0, 1.0)
        ratio = np.zeros(len(s))
        if limits.tip_speed is not None and path.tip_rate is not None:
            ratio = path.tip_rate(s) * v / limits.tip_speed
        q1, q2, q3 = (path.spline(s, nu=k) for k in (1, 2, 3))
        v, a, j = v[:, None], a[:, None], states[:, 3:]
        joints = np.maximum.reduce(
            [
                np.abs(q1 * v) / limits.velocity,
                np.sqrt(np.abs(q2 * v**2 + q1 * a) / limits.acceleration),
                np.cbrt(np.abs(q3 * v**3 + 3.0 * q2 * v * a + q1 * j) / limits.jerk),
            ]
        )
        return np.asarray(np.maximum.reduceat(np.maximum(ratio, joints.max(axis=1)), first))


def _moved(states: Array, dt: Array) -> tuple[Array, Array, Array]:
    """Path parameter, rate and second derivative (N,), a time (N,) after states (N, 4), at constant
    third derivative.
    """
    s, v, a, j = states.T
    return (
        s + dt * (v + dt * (a / 2.0 + dt * j / 6.0)),
        v + dt * (a + dt * j / 2.0),
        a + dt * j,
    )


def smooth_by_ruckig(path: JointPath, limits: PathLimits, profile: SpeedProfile) -> TimedPath:
    """Find a jerk-limited law along a path from rest to rest, by ruckig on the path parameter.

    Args:
        path: the path.
        limits: they hold at times 1/2400 of the profile's duration apart.
        profile: toppra's, of the same path and limits.

    Raises:
        PathTimingError: ruckig finds no motion even for the whole path at once.
    """
    unit = profile.duration  # of time; ruckig works with absolute tolerances
    scaled = PathLimits(
        unit * limits.velocity,
        unit**2 * limits.acceleration,
        unit**3 * limits.jerk,
        None if limits.tip_speed is None else unit * limits.tip_speed,
    )
    fastest = SpeedProfile(profile.s, unit * profile.speed)
    law = _sectioned(path, scaled, fastest) or _as_one(path, scaled, fastest)
    slower = max(1.0, float(law.worst(path, scaled, _FINE).max()))
    return TimedPath(path, law.slowed(slower * unit))


def _sectioned(path: JointPath, limits: PathLimits, profile: SpeedProfile) -> PhasedLaw | None:
    """Sections that nearly hold every limit, or None where the rounds do not settle."""
    s = profile.s
    third = np.max(np.abs(path.spline(s, nu=3)) / limits.jerk, axis=1)
    with np.errstate(divide="ignore"):
        speed = np.minimum(profile.speed, np.cbrt(_JERK / third))
    cuts = _minima(speed)
    sections = [_Section.over(path, limits, s, speed, a, b) for a, b in pairwise(cuts)]
    begins = [section.begin for section in sections]
    junctions = _JUNCTION * speed[cuts]
    junctions[[0, -1]] = 0.0
    slow = np.ones(len(sections))
    for _ in range(_ROUNDS):
        allowed = junctions.copy()
        allowed[1:-1] *= np.minimum(slow[:-1], slow[1:])
        speeds = _reachable(sections, slow, allowed)
        motions = [
            x.motion(k, *v)
            for x, k, v in zip(sections, slow, pairwise(speeds.tolist()), strict=True)
        ]
        found = [motion for motion in motions if motion is not None]
        if len(found) < len(motions) or speeds[0] != 0.0 or speeds[-1] != 0.0:
            junctions[1:-1] *= 0.7
            continue
        laws = [PhasedLaw.joined([x], [m]) for x, m in zip(begins, found, strict=True)]
        worst = np.array([law.worst(path, limits, _COARSE).max() for law in laws])
        if worst.max() <= 1.0 + _TOLERANCE:
            return PhasedLaw.joined(begins, found)
        slow /= np.where(worst > 1.0 + _TOLERANCE, np.minimum(worst, 1.35), 1.0)
    return None


def _as_one(path: JointPath, limits: PathLimits, profile: SpeedProfile) -> PhasedLaw:
    """The whole path as one section.

    Raises:
        PathTimingError: ruckig refuses the bounds.
    """
    whole = _Section.over(path, limits, profile.s, profile.speed, 0, len(profile.s) - 1)
    motion = whole.motion(1.0, 0.0, 0.0)
    if motion is None:
        raise PathTimingError(
            deciding_limit(path, limits, profile),
            "leaves ruckig no motion along the path; check the limits",
        )
    return PhasedLaw.joined([0.0], [motion])


def _minima(speed: Array) -> NDArray[np.intp]:
    """Indices of the ends and of the clear local minima."""
    reach = round(_AROUND * (len(speed) - 1))
    inner = [
        i
        for i in range(2, len(speed) - 2)
        if speed[i] < speed[i - 1]
        and speed[i] <= speed[i + 1]
        and speed[i]
        < _CLEAR * min(speed[max(0, i - reach) : i].max(), speed[i : i + reach + 1].max())
    ]
    return np.array([0, *inner, len(speed) - 1])


@dataclass(frozen=True)
class _Section:
    """A part of the path, with constant bounds on the speed, acceleration and jerk of the path
    parameter.
    """

    begin: float
    length: float
    speed: float
    acceleration: float
    jerk: float

    @classmethod
    def over(
        cls, path: JointPath, limits: PathLimits, s: Array, speed: Array, first: int, last: int
    ) -> "_Section":
        """Bounds that hold for the joints over the section as far as the path's first derivative
        goes.
        """
        rate = np.abs(path.spline(np.linspace(s[first], s[last], 40), nu=1)).max(axis=0)
        with np.errstate(divide="ignore"):
            acceleration, jerk = limits.acceleration / rate, limits.jerk / rate
        return cls(
            float(s[first]),
            float(s[last] - s[first]),
            float(speed[first : last + 1].max()),
            float(acceleration.min()),
            float(jerk.min()),
        )

    def motion(self, slow: float, start: float, end: float) -> ruckig.Trajectory | None:
        """State-to-state motion between two speeds, or None where there is none that moves forwards
        only.
        """
        request, motion = ruckig.InputParameter(1), ruckig.Trajectory(1)
        request.current_position, request.target_position = [0.0], [self.length]
        request.current_velocity, request.target_velocity = [start], [end]
        request.max_velocity = [max(self.speed * slow, start, end) * 1.0001]
        request.max_acceleration = [self.acceleration * slow**2]
        request.max_jerk = [self.jerk * slow**3]
        try:
            if ruckig.Ruckig(1).calculate(request, motion) < 0:
                return None
        except ruckig.RuckigError:
            return None
        extrema, phases = motion.position_extrema[0], motion.profiles[0][0]
        if phases.brake.duration > 0.0 or phases.accel.duration > 0.0:
            return None  # these would be more than the seven phases
        forwards = extrema.min >= -1e-7 and extrema.max <= self.length + 1e-7
        return motion if forwards else None


def _reachable(sections: list[_Section], slow: Array, allowed: Array) -> Array:
    """Junction speeds up to the allowed ones such that every section has a motion.

    Forwards and backwards to a fixed point.
    """
    speeds = allowed.copy()
    for _ in range(6):
        before = speeds.copy()
        for i, section in enumerate(sections):
            speeds[i + 1] = _greatest(section, slow[i], speeds[i], None, speeds[i + 1])
        for i in reversed(range(len(sections))):
            speeds[i] = _greatest(sections[i], slow[i], None, speeds[i + 1], speeds[i])
        if np.allclose(before, speeds):
            break
    return speeds


def _greatest(
    section: _Section, slow: float, start: float | None, end: float | None, most: float
) -> float:
    """Greatest speed up to `most`, in the place of the one that is None, for which there is a
    motion; by bisection.
    """

    def possible(speed: float) -> bool:
        motion = section.motion(
            slow, speed if start is None else start, speed if end is None else end
        )
        return motion is not None

    if possible(most):
        return most
    low, high = 0.0, most
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if possible(middle) else (low, middle)
    return low
