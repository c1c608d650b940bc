"""A virtual pan-tilt unit: whole steps, limits, and a repeatability error that its report does not
show.
"""

from math import ceil, floor

import numpy as np

from unwrinkle.models.errors import InputError

#: ASSUMED, since no source states it: repeatability of the motors, standard deviation in steps.
REPEATABILITY = 0.25


class VirtualPanTilt:
    """A pan-tilt unit as its driver sees it: positions are whole steps, zero is straight ahead.

    Each axis comes to rest with a random error, drawn again for each motion, that its reported
    position does not show.
    """

    def __init__(
        self,
        step: float,
        pan: tuple[float, float],
        tilt: tuple[float, float],
        *,
        repeatability: float = REPEATABILITY,
        seed: int,
    ) -> None:
        """Start at zero.

        Args:
            step: angle of one step, radians.
            pan, tilt: lower and upper limit, radians.
            repeatability: standard deviation of an axis' rest position, steps; errors are cut at
                three times this.
            seed: of those errors.

        Raises:
            InputError: a step that is not positive, limits that do not contain zero, or a
                repeatability not within 0 to 10 steps.
        """
        if not step > 0.0 or not 0.0 <= repeatability <= 10.0:
            raise InputError(
                f"virtual pan-tilt unit: step {step} must be positive, repeatability "
                f"{repeatability} steps 0 to 10"
            )
        self.step = step
        self._limits = {"pan": _in_steps(pan, step, "pan"), "tilt": _in_steps(tilt, step, "tilt")}
        self._repeatability = repeatability
        self._rng = np.random.default_rng(seed)
        self._position = [0, 0]
        self._rest = [0.0, 0.0]

    @property
    def limits(self) -> dict[str, tuple[int, int]]:
        """Lowest and highest position of "pan" and "tilt", steps."""
        return dict(self._limits)

    @property
    def position(self) -> tuple[int, int]:
        """Pan and tilt as the unit reports them, steps."""
        return self._position[0], self._position[1]

    @property
    def true_angles(self) -> tuple[float, float]:
        """True pan and tilt, with the repeatability error, radians."""
        pan, tilt = (p + r for p, r in zip(self._position, self._rest, strict=True))
        return self.step * pan, self.step * tilt

    def move(self, pan: int, tilt: int) -> None:
        """Go to absolute positions in steps; an axis that is there already does not move.

        Raises:
            InputError: not a whole number, or beyond the limits; neither axis has moved then.
        """
        wanted = (("pan", pan), ("tilt", tilt))
        for axis, value in wanted:
            if not isinstance(value, int | np.integer) or isinstance(value, bool):
                raise InputError(
                    f"virtual pan-tilt unit: {axis} position {value!r} must be whole steps of "
                    f"{self.step:.6f} rad"
                )
            lower, upper = self._limits[axis]
            if not lower <= value <= upper:
                over = max(lower - value, value - upper)
                raise InputError(
                    f"virtual pan-tilt unit: {axis} position {value} is beyond its limits {lower} "
                    f"to {upper} by {over} steps; look elsewhere"
                )
        for index, (_, value) in enumerate(wanted):
            if int(value) != self._position[index]:
                error = self._repeatability * float(self._rng.standard_normal())
                most = 3.0 * self._repeatability
                self._rest[index] = min(max(error, -most), most)
                self._position[index] = int(value)


def _in_steps(limits: tuple[float, float], step: float, axis: str) -> tuple[int, int]:
    lower, upper = limits
    if not lower <= 0.0 <= upper:
        raise InputError(
            f"virtual pan-tilt unit: {axis} limits {lower} to {upper} rad must have zero between"
        )
    # A limit that is a whole number of steps is one in spite of rounding.
    return ceil(lower / step - 1e-9), floor(upper / step + 1e-9)
