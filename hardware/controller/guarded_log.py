"""A run log whose failure is a state that the driver reads, instead of an exception in the middle
of a poll.
"""

from collections.abc import Callable
from typing import Any

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.hardware.run_log.protocol import NoLog, RunLogger
from unwrinkle.models.arrays import Array


class GuardedLog:
    """Writes to a run log; after the first error nothing more is written.

    Attributes:
        problem: why the log cannot be written; empty while it can.
    """

    def __init__(self, log: RunLogger | None) -> None:
        """Write to `log`; None writes nothing."""
        self._log: RunLogger = log or NoLog()
        self._last_status: DriverStatus | None = None
        self.problem = ""

    def commanded(
        self, now: float, number: int, sequence: int, time: float, q: Array, v: Array
    ) -> None:
        """Record a point that is sent; see `RunLogger.commanded`."""
        self._write(self._log.commanded, now, number, sequence, time, q, v)

    def measured(self, now: float, feedback: JointFeedback) -> None:
        """Record a set of joint feedback."""
        self._write(self._log.measured, now, feedback)

    def event(self, now: float, kind: str, text: str, **data: object) -> None:
        """Record an event; see `RunLogger.event`."""
        self._write(self._log.event, now, kind, text, **data)

    def status(self, now: float, status: DriverStatus) -> None:
        """Record the status if state, commands, reason, override or robot status changed."""
        if self._last_status is None or _key(status) != _key(self._last_status):
            self._last_status = status
            self._write(self._log.status, now, status)

    def _write(self, write: Callable[..., None], *values: object, **data: Any) -> None:
        if self.problem:
            return
        try:
            write(*values, **data)
        except OSError as error:
            self.problem = (
                f"the log cannot be written: {error.strerror or error}; is its disk full?"
            )


def _key(status: DriverStatus) -> tuple[object, ...]:
    return (
        status.state,
        status.command,
        status.completed,
        status.reason,
        status.override,
        status.robot,
    )
