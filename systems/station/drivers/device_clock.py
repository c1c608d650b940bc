"""Clocks of devices: the diagram's time for virtual ones, the computer's for real ones."""

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
