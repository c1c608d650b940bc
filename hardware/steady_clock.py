"""A time that never goes backward, whatever clock the polls come with."""


class SteadyClock:
    """Adds up the steps forward of another clock; a step back counts as none."""

    def __init__(self) -> None:
        """Begin at 0."""
        self.now = 0.0
        self._last: float | None = None

    def at(self, now: float) -> float:
        """The steady time, s, when the other clock shows `now`, s."""
        if self._last is not None:
            self.now += max(now - self._last, 0.0)
        self._last = now
        return self.now
