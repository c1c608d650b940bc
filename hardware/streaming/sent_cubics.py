"""Limits of the motion that is sent, and a trajectory as the path that speed override, hold and
resume follow.
"""

import dataclasses as dc
from dataclasses import dataclass
from math import ceil

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.limits import Limits
from unwrinkle.planning.trajectory import AXES, LIMIT_ROUNDING, Trajectory

#: Greatest speed, rad/s, acceleration, rad/s^2, and jerk, rad/s^3, (13,) each; see `rate_extremes`.
RateExtremes = tuple[Array, Array, Array]

#: Fraction of a millisecond that is rounding.
_MILLISECOND_ROUNDING = 1e-7
#: Difference of two times that are the same, s.
_SAME_TIME_S = 1e-9


def ceil_ms(time: float) -> float:
    """Return the first whole millisecond not before a time, s."""
    return ceil(1e3 * time - _MILLISECOND_ROUNDING) / 1e3


@dataclass(frozen=True, eq=False)
class StreamLimits:
    """Limits of the motion that is sent; each (13,).

    Attributes:
        velocity: rad/s.
        acceleration: rad/s^2.
        jerk: rad/s^3.

    Raises:
        InputError: not thirteen positive numbers each.
    """

    velocity: Array
    acceleration: Array
    jerk: Array

    def __post_init__(self) -> None:
        """Check and freeze."""
        for item in dc.fields(self):
            value = np.array(getattr(self, item.name), dtype=float)
            if value.shape != (AXES,) or not (np.isfinite(value).all() and value.min() > 0.0):
                raise InputError(
                    f"limits of the stream: {item.name} needs {AXES} positive numbers, got {value}"
                )
            value.setflags(write=False)
            object.__setattr__(self, item.name, value)

    @classmethod
    def of(cls, limits: Limits) -> "StreamLimits":
        """Return the robot's limits."""
        return cls(limits.velocity, limits.acceleration, limits.jerk)

    def widened(self, own: RateExtremes) -> "StreamLimits":
        """Return limits that are at least the extremes of a trajectory itself."""
        bounds = (self.velocity, self.acceleration, self.jerk)
        return StreamLimits(*(np.maximum(a, b) for a, b in zip(bounds, own, strict=True)))

    def keeps(self, values: RateExtremes) -> bool:
        """Return whether extremes are within the limits."""
        bounds = (self.velocity, self.acceleration, self.jerk)
        return all(
            bool((value <= bound * (1.0 + LIMIT_ROUNDING)).all())
            for value, bound in zip(values, bounds, strict=True)
        )


class CubicPath:
    """A trajectory as a path q(s) of its own clock s, with a search of its samples (knots).

    Attributes:
        curve: q(s).
        knots: (N,) s of the samples.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        """Use a trajectory as a path."""
        self.curve = trajectory
        self.knots = trajectory.times

    @property
    def end(self) -> float:
        """The last knot, s."""
        return float(self.knots[-1])

    def knot(self, index: int) -> tuple[Array, Array]:
        """Return the trajectory's own sample: positions and slopes dq/ds, (13,) each."""
        return self.curve.positions[index], self.curve.velocities[index]

    def knot_before(self, s: float) -> float:
        """Return the last knot that is not beyond s."""
        index = int(np.searchsorted(self.knots, s + _SAME_TIME_S, side="right")) - 1
        return float(self.knots[max(index, 0)])

    def has_knot(self, s: float) -> bool:
        """Return whether there is a knot at s."""
        return bool(np.abs(self.knots - s).min() < _SAME_TIME_S)

    def knot_after(self, s: float) -> tuple[int, float]:
        """Return index and s of the first knot beyond s; of the last one if there is none."""
        index = min(int(np.searchsorted(self.knots, s, side="right")), len(self.knots) - 1)
        return index, float(self.knots[index])
