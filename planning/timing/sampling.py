"""Samples of a timed motion whose limits still hold once they are rounded to what the controller
takes.
"""

from typing import Protocol

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import NoVerifiedPlanError
from unwrinkle.models.limits import Limits
from unwrinkle.planning.sent_samples import MILLISECONDS, as_float32

Samples = tuple[Array, Array, Array]  # times (N,), positions and velocities (N, n)

#: Limits are kept by this share after rounding, so that no further rounding (of clocks, say) can
#: break them.
_ROOM = 1e-6
#: Rounding does not shrink with the motion: slowing settles after a few rounds and some per cent,
#: or never.
_ROUNDS, _SLOWEST = 12, 1.5


class Timed(Protocol):
    """A motion from rest to rest that can be sampled."""

    @property
    def duration(self) -> float:
        """Of the fastest law found, s."""

    def sample(self, period: float, slower: float = 1.0) -> Samples:
        """Samples at a period in s, of the law run slower by at least a factor."""


def sampling_period(at_full_speed: float, speed: float) -> float:
    """Period of a plan's samples, a whole number of milliseconds, s.

    Rounding a position by e shows as a jerk of about 12 e / period^3, and the jerk limit is
    proportional to the speed: a period that grows as speed^(-1/3) costs the same share of it at
    every speed. It grows in whole multiples, so that every point falls on a tick of the
    controller's clock where it does at full speed.

    Args:
        at_full_speed: period at catalogue speed, s.
        speed: fraction of the catalogue velocity, acceleration and jerk.
    """
    multiple = np.ceil(speed ** (-1.0 / 3.0) - 1e-9)
    return float(max(1.0, np.rint(MILLISECONDS * at_full_speed)) * multiple / MILLISECONDS)


def sample_within(motion: Timed, period: float, limits: Limits) -> Samples:
    """Samples on whole periods; velocity, acceleration and jerk of the cubics between them, as
    sent, keep the limits.

    Args:
        motion: from rest to rest.
        period: a whole number of milliseconds, s.
        limits: full ones, without any margin.

    Raises:
        NoVerifiedPlanError: the limits are so low that rounding alone breaks them.
    """
    slower = 1.0
    for _ in range(_ROUNDS):
        samples = motion.sample(period, slower)
        t, q, v = samples
        ratios = sent_ratios(t, as_float32(q), as_float32(v), limits)
        needed = max(ratios[0], ratios[1] ** (1.0 / 2.0), ratios[2] ** (1.0 / 3.0))
        if needed <= 1.0 - _ROOM:
            return samples
        duration = needed / (1.0 - 2.0 * _ROOM) * float(t[-1])
        if not duration <= _SLOWEST * motion.duration + _ROUNDS * period:
            break
        slower = duration / motion.duration
    raise NoVerifiedPlanError(
        f"positions sent as float32 every {MILLISECONDS * period:.0f} ms break the limits by "
        "rounding alone; raise the speed, or the sample time of the planner's settings"
    )


def sent_ratios(t: Array, q: Array, v: Array, limits: Limits) -> tuple[float, float, float]:
    """Greatest velocity, acceleration and jerk of the cubics between samples over their limits.

    Args:
        t: (N,) s.
        q: (N, n) rad.
        v: (N, n) rad/s.
        limits: of the n axes.
    """
    h = np.diff(t)[:, None]
    chord = np.diff(q, axis=0) / h
    begin = (6.0 * chord - 4.0 * v[:-1] - 2.0 * v[1:]) / h
    end = (2.0 * v[:-1] + 4.0 * v[1:] - 6.0 * chord) / h
    # Acceleration is linear: velocity is greatest at an end, or where acceleration passes zero.
    turns = begin * end < 0.0
    share = np.where(turns, begin / np.where(turns, begin - end, 1.0), 0.0)
    middle = v[:-1] + 0.5 * begin * share * h
    velocity = max(_worst(v, limits.velocity), _worst(middle, limits.velocity))
    acceleration = max(_worst(begin, limits.acceleration), _worst(end, limits.acceleration))
    return velocity, acceleration, _worst((end - begin) / h, limits.jerk)


def _worst(values: Array, limit: Array) -> float:
    return float((np.abs(values) / limit).max())
