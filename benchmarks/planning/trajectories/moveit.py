"""Waypoint-wise ruckig as MoveIt 2's RuckigSmoothing does it, re-implemented from its behaviour.

Follows MoveIt 2's main branch as it has been since March 2023 (pull requests 1990 and 2051):

* the waypoints come from a time parameterisation (TOTG, resampled to 0.1 s by default) with velocities and accelerations;
* from each waypoint to the next a ruckig motion, time-synchronised, between the waypoints' full states, clamped to the limits;
* where ruckig refuses, a factor (one for the whole trajectory, times 1.1 at each refusal, until it reaches 10) stretches
  that segment's duration, divides the velocity at its end, and sets the acceleration there to the
  difference quotient; with the mitigation of overshoot, which is off by default, the same where a
  motion goes beyond its target by over 0.01 rad;
* only the last segment takes ruckig's own duration: what is sent are the waypoints, not ruckig's motion between them
  (issue 2556); the controller interpolates. Versions before that demanded that ruckig reach the
  waypoint within one step.

Where the factor runs out, MoveIt reports success if ruckig's last answer was one, overshoot or not.
"""

import dataclasses as dc
from dataclasses import dataclass

import numpy as np
import ruckig
from scipy.interpolate import BPoly

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits

_FACTOR, _LARGEST = 1.1, 10.0
_OVERSHOOT = 0.01  # rad
_CHECK = 0.01  # s


@dataclass(frozen=True, eq=False)
class Waypoints:
    """Waypoints and the time from each to the next.

    Attributes:
        durations: (M,) s.
        positions: (M+1, n) rad.
        velocities: (M+1, n).
        accelerations: (M+1, n).
    """

    durations: Array
    positions: Array
    velocities: Array
    accelerations: Array

    def quintic(self) -> BPoly:
        """What a controller runs between full states: fifth-order polynomials."""
        times = np.concatenate([[0.0], np.cumsum(self.durations)])
        states = np.stack([self.positions, self.velocities, self.accelerations], axis=1)
        return BPoly.from_derivatives(times, list(states))


@dataclass(frozen=True, eq=False)
class Smoothed:
    """What the smoothing gave.

    Attributes:
        waypoints: as sent.
        motions: ruckig's from each waypoint to the next; fewer where it is incomplete.
        factor: by which the last stretched segment was stretched.
        reported: MoveIt's failure, or None where it reports success.
        incomplete: why not every segment has a motion, or None.
    """

    waypoints: Waypoints
    motions: list[ruckig.Trajectory]
    factor: float
    reported: str | None
    incomplete: str | None


def smooth(given: Waypoints, limits: Limits, *, mitigate: bool) -> Smoothed:
    """Run the smoothing on waypoints under limits, with or without mitigation of overshoot."""
    now = Waypoints(*(getattr(given, f.name).copy() for f in dc.fields(given)))
    count, factor, i = len(given.durations), 1.0, 0
    motions: list[ruckig.Trajectory] = []
    refusal: str | None = None
    while factor < _LARGEST and i < count:
        motion, refusal = _motion(now, i, limits)
        overshoots = mitigate and motion is not None and _overshoots(motion, now, i)
        if motion is not None and not overshoots:
            motions.append(motion)
            i += 1
            continue
        factor *= _FACTOR
        now.durations[i] = factor * given.durations[i]
        now.velocities[i + 1] /= factor
        change = now.velocities[i + 1] - now.velocities[i]
        now.accelerations[i + 1] = change / now.durations[i]
    if i == count:
        now.durations[-1] = motions[-1].duration
        return Smoothed(now, motions, factor, None, None)
    cause = refusal or f"overshoot of more than {_OVERSHOOT} rad"
    text = f"stretched {_LARGEST:.0f} times without success: {cause}"
    return Smoothed(now, motions, factor, None if refusal is None else text, text)


def _motion(now: Waypoints, i: int, limits: Limits) -> tuple[ruckig.Trajectory | None, str | None]:
    """ruckig's motion from waypoint i to the next, or its refusal."""
    n = len(limits.velocity)
    v = np.clip(now.velocities[i : i + 2], -limits.velocity, limits.velocity)
    a = np.clip(now.accelerations[i : i + 2], -limits.acceleration, limits.acceleration)
    request, motion = ruckig.InputParameter(n), ruckig.Trajectory(n)
    request.current_position, request.target_position = map(list, now.positions[i : i + 2])
    request.current_velocity, request.target_velocity = map(list, v)
    request.current_acceleration, request.target_acceleration = map(list, a)
    request.max_velocity = list(limits.velocity)
    request.max_acceleration = list(limits.acceleration)
    request.max_jerk = list(limits.jerk)
    try:
        result = ruckig.Ruckig(n).calculate(request, motion)
    except ruckig.RuckigError as error:
        return None, f"ruckig refuses ({_cause(str(error))})"
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        return None, f"ruckig says {result}"
    return motion, None


def _cause(text: str) -> str:
    """The kind of a refusal, without its numbers."""
    for words in ("target", "current"):
        for kind in ("acceleration", "velocity"):
            if f"{words} {kind}" in text:
                return f"{words} {kind} beyond what the limits allow"
    return text.partition(":")[0]


def _overshoots(motion: ruckig.Trajectory, now: Waypoints, i: int) -> bool:
    """Whether an axis is on the far side of its target by more than the threshold, at steps of the
    check's period.
    """
    start, goal = now.positions[i], now.positions[i + 1]
    for t in np.arange(_CHECK, motion.duration, _CHECK):
        error = np.array(motion.at_time(float(t))[0]) - goal
        if np.any((error * (start - goal) < 0.0) & (np.abs(error) > _OVERSHOOT)):
            return True
    return False
