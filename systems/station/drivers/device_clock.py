"""Clocks of devices: virtual devices use the diagram's time, real ones the computer's monotonic clock."""

import time
from collections.abc import Callable

#: Function from the diagram's time to the device's time, s.
Clock = Callable[[float], float]


def diagram_time(now: float) -> float:
    """Return the diagram's time, s."""
    return now


def own_time(now: float = 0.0) -> float:
    """Return the computer's monotonic clock, s; the argument is ignored."""
    return time.monotonic()
