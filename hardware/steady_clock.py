"""A monotonic time made from any clock."""


class SteadyClock:
    """Sums the forward steps of another clock; a step back counts as zero."""

    def __init__(self) -> None:
        """Start at 0 s."""
        self.now = 0.0
        self._last: float | None = None

    def at(self, now: float) -> float:
        """Return the steady time, s, when the other clock shows `now`, s."""
        if self._last is not None:
            self.now += max(now - self._last, 0.0)
        self._last = now
        return self.now
