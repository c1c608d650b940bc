"""Joint limits of the interpolated motion: every extreme in closed form."""

from collections.abc import Sequence

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.verdict import Findings

#: Relative tolerance for rounding.
TOLERANCE = 1e-9
#: A motion whose jerk keeps within J, sampled exactly, gives cubic pieces whose acceleration at an
#: end of an interval of length h is off by e = -1/h * integral of j(s) (3 s^2 / h - 2 s) ds over
#: the interval, hence |e| <= 8/27 J h.
JUMP_FACTOR = 8.0 / 27.0

_UNITS = {"velocity": "rad/s", "acceleration": "rad/s²", "jerk": "rad/s³"}


def check_limits(legs: Sequence[Leg], limits: Limits, axes: Sequence[str], found: Findings) -> None:
    """Check position, velocity, acceleration, jerk and jumps of acceleration of every axis in every
    interval.

    Args:
        legs: the motion; gripper strokes are skipped.
        limits: at the plan's speed.
        axes: names of the robot's axes.
        found: receives the checks `position`, `velocity`, `acceleration`, `jerk`,
            `acceleration_jump`.
    """
    moving = [leg for leg in legs if leg.name != "grippers"]
    _check_positions(moving, limits, axes, found)
    for name in ("velocity", "acceleration", "jerk"):
        values = [np.abs(_derivative(leg, name))[:, : len(axes)] for leg in moving]
        limit = getattr(limits, name)
        _check_ratios(name, moving, values, [limit] * len(moving), axes, found)
    jumps, allowed = zip(*(_jumps(leg, limits.jerk) for leg in moving), strict=True)
    _check_ratios("acceleration_jump", moving, jumps, allowed, axes, found)


def _derivative(leg: Leg, name: str) -> Array:
    if name == "velocity":
        return leg.greatest_velocity
    return leg.greatest_acceleration if name == "acceleration" else leg.jerk


def _jumps(leg: Leg, jerk: Array) -> tuple[Array, Array]:
    """Return the jumps of acceleration at every sample, (n, axes), rad/s^2, and their limits.

    The arms rest before and after.
    """
    count = len(jerk)
    begin, end = (a[:, :count] for a in leg.acceleration)
    rest = np.zeros((1, count))
    steps = np.vstack([[[0.0]], leg.step, [[0.0]]])
    jumps = np.abs(np.vstack([begin, rest]) - np.vstack([rest, end]))
    return jumps, JUMP_FACTOR * jerk * (steps[:-1] + steps[1:])


def _check_positions(
    legs: Sequence[Leg], limits: Limits, axes: Sequence[str], found: Findings
) -> None:
    worst = (np.inf, 0.0, 0.0, "", 0.0)
    for axis, name in enumerate(axes):
        lower, upper = limits.lower[axis], limits.upper[axis]
        nearest = (np.inf, 0.0, 0.0, name, 0.0)
        for leg in legs:
            low, high = (p[:, axis] for p in leg.position_extremes())
            i, j = int(np.argmin(low)), int(np.argmax(high))
            nearest = min(
                nearest,
                (float(low[i] - lower), float(low[i]), float(lower), name, float(leg.times[i])),
                (float(upper - high[j]), float(high[j]), float(upper), name, float(leg.times[j])),
                key=_margin,
            )
        margin, value, limit, _, time = nearest
        if not margin >= -TOLERANCE:
            found.fail(
                "position",
                f"{name} reaches {value:.4f} rad at {time:.3f} s, beyond its limit {limit:.4f} rad "
                f"by {-margin:.2g} rad",
                time,
            )
        worst = min(worst, nearest, key=_margin)
    margin, value, limit, name, time = worst
    found.check("position", value, limit, margin, "rad", name, time)


def _margin(row: tuple[float, float, float, str, float]) -> float:
    # What is no number is the worst: no comparison with it is true.
    return -np.inf if np.isnan(row[0]) else row[0]


def _ratio(row: tuple[float, float, float, str, float]) -> float:
    return np.inf if np.isnan(row[0]) else row[0]


def _check_ratios(
    name: str,
    legs: Sequence[Leg],
    values: Sequence[Array],
    limits: Sequence[Array],
    axes: Sequence[str],
    found: Findings,
) -> None:
    worst = (-1.0, 0.0, 0.0, "", 0.0)
    for axis, label in enumerate(axes):
        greatest = (-1.0, 0.0, 0.0, label, 0.0)
        for leg, v, bound in zip(legs, values, limits, strict=True):
            allowed = np.broadcast_to(bound, v.shape)[:, axis]
            i = int(np.argmax(v[:, axis] / allowed))  # the first NaN, where there is one
            value, limit = float(v[i, axis]), float(allowed[i])
            row = (float(v[i, axis] / allowed[i]), value, limit, label, float(leg.times[i]))
            greatest = max(greatest, row, key=_ratio)
        ratio, value, limit, _, time = greatest
        if not ratio <= 1.0 + TOLERANCE:
            unit = _UNITS.get(name, "rad/s²")
            found.fail(
                name,
                f"{name.replace('_', ' ')} of {label} is {value:.4g} {unit} at {time:.3f} s, "
                f"{ratio:.4f} times its limit {limit:.4g} {unit}",
                time,
            )
        worst = max(worst, greatest, key=_ratio)
    ratio, _, _, label, time = worst
    found.check(name, ratio, 1.0, 1.0 - ratio, "", label, time)
