"""The trajectory that is sent: samples of thirteen axes on one clock, cubic in between."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError

AXES = 13


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Samples of turn-table, right arm and left arm. The controller interpolates cubically between them.

    Attributes:
        times: (N,) s, from 0, strictly increasing, N >= 2.
        positions: (N, 13) rad.
        velocities: (N, 13) rad/s.

    Raises:
        InputError: a shape does not fit, a value is not finite, or time does not increase.
    """

    times: Array
    positions: Array
    velocities: Array

    def __post_init__(self) -> None:
        """Check and freeze the arrays."""
        count = np.size(self.times)
        shapes = {"times": (count,), "positions": (count, AXES), "velocities": (count, AXES)}
        for name, shape in shapes.items():
            value = np.array(getattr(self, name), dtype=float)
            if value.shape != shape or count < 2:
                raise InputError(f"trajectory {name} have shape {value.shape}, expected {shape}")
            bad = np.argwhere(~np.isfinite(value))
            if len(bad):
                where = ", ".join(str(i) for i in bad[0])
                raise InputError(f"trajectory {name}[{where}] is not a finite number")
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if self.times[0] != 0.0 or not np.all(np.diff(self.times) > 0.0):
            raise InputError("trajectory times must start at 0 and increase")

    @property
    def duration(self) -> float:
        """Time of the last sample, s."""
        return float(self.times[-1])

    def interpolant(self) -> CubicHermiteSpline:
        """The cubic between samples, as the controller runs it: positions (..., 13) of time in s."""
        return CubicHermiteSpline(self.times, self.positions, self.velocities)
