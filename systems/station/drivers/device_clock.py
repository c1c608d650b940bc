"""Which clock a device goes by: virtual ones by the diagram's, real ones by the computer's own."""

import time
from collections.abc import Callable

#: From the diagram's time to the device's, s.
Clock = Callable[[float], float]


def diagram_time(now: float) -> float:
    """The diagram's time itself, s."""
    return now


def own_time(now: float = 0.0) -> float:
    """The computer's monotonic clock, s, whatever the diagram's says."""
    return time.monotonic()
