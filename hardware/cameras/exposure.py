"""One exposure at a time, in a thread of its own, with a deadline and a limit of attempts."""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from unwrinkle.hardware.steady_clock import SteadyClock
from unwrinkle.models.errors import HardwareError

_log = logging.getLogger(__name__)

T = TypeVar("T")

#: Longest wait of `close` for an attempt that hangs, s.
_LONGEST_JOIN_S = 1.0


@dataclass(frozen=True, eq=False)
class Outcome(Generic[T]):
    """Result of an exposure: its number, and either what was taken or why nothing was."""

    number: int
    taken: T | None
    reason: str = ""


@dataclass(eq=False)
class _Attempt(Generic[T]):
    """One call of `grab` in its thread."""

    cancel: threading.Event
    finished: threading.Event
    taken: T | None = None
    problem: str = ""
    thread: threading.Thread | None = None


class Exposer(Generic[T]):
    """Calls a function that may hang, fail, or return an unusable result; its own methods do not
    wait for it.

    Calls are never concurrent: one that exceeds its deadline is asked to end, and the next attempt
    waits for that, for as long as an attempt may take.
    """

    def __init__(
        self,
        grab: Callable[[threading.Event], T],
        check: Callable[[T], str],
        *,
        timeout: float,
        attempts: int,
        what: str,
    ) -> None:
        """Prepare; nothing is called before `start`.

        Args:
            grab: exposes; it should end when its event is set. Raises HardwareError.
            check: returns why a result is unusable; empty if it is usable.
            timeout: of one attempt, s.
            attempts: limit of attempts.
            what: for messages, as "camera pair".
        """
        self._grab, self._check = grab, check
        self._timeout, self._attempts, self._what = timeout, max(attempts, 1), what
        self._clock = SteadyClock()
        self._number = self._tried = 0
        self._attempt: _Attempt[T] | None = None
        self._hanging: _Attempt[T] | None = None
        self._began: float | None = None
        self._queued = self._closed = False
        self._problem = ""
        self.outcome: Outcome[T] | None = None

    def start(self, number: int) -> None:
        """Begin an exposure; one under way is cancelled and has no outcome."""
        self._give_up()
        self._number, self._tried = number, 0
        self.outcome = None
        self._try("")

    def poll(self, now: float) -> None:
        """Check whether the exposure is done, overdue or to be repeated; `now` of any clock, s."""
        now = self._clock.at(now)
        if self._began is None:
            self._began = now
        overdue = now - self._began > self._timeout
        if self._queued:
            self._launch()
            if self._queued and overdue:
                self._end(
                    f"{self._problem}the exposure before still hangs; switch the device off and on"
                )
        elif self._attempt is not None:
            self._look(self._attempt, overdue)

    def wait(self, deadline: float) -> bool:
        """Wait at most `deadline`, s, for something that `poll` has to process; return whether
        there is, or all is done.
        """
        attempt = self._hanging if self._queued else self._attempt
        return attempt is None or attempt.finished.wait(deadline)

    def close(self) -> None:
        """Cancel the exposure under way, and wait briefly for its end."""
        self._closed, self._queued = True, False
        self._give_up()
        if self._hanging is not None and self._hanging.thread is not None:
            self._hanging.thread.join(_LONGEST_JOIN_S)

    def _look(self, attempt: _Attempt[T], overdue: bool) -> None:
        if attempt.finished.is_set():
            self._attempt = None
            problem = attempt.problem
            if not problem and attempt.taken is not None:
                problem = self._check(attempt.taken)
            if problem:
                self._try(problem)
            else:
                self.outcome = Outcome(self._number, attempt.taken)
        elif overdue:
            self._give_up()
            self._try(f"nothing came within {self._timeout:g} s")

    def _give_up(self) -> None:
        if self._attempt is not None:
            self._attempt.cancel.set()
            self._hanging, self._attempt = self._attempt, None

    def _try(self, problem: str) -> None:
        """Queue an attempt; at the limit of attempts, end with the last one's problem."""
        if problem:
            _log.warning("%s: attempt %d: %s", self._what, self._tried, problem)
        if self._closed or self._tried >= self._attempts:
            self._end(problem or "closed by this side")
            return
        self._problem = problem and f"{problem}; "
        self._queued, self._began = True, None
        self._launch()

    def _end(self, problem: str) -> None:
        self._queued = False
        count = max(self._tried, 1)
        self.outcome = Outcome(
            self._number,
            None,
            f"{self._what}: no picture in {count} attempt{'s' * (count > 1)}: {problem}",
        )

    def _launch(self) -> None:
        """Begin the queued attempt, unless the one before still hangs."""
        if self._hanging is not None and not self._hanging.finished.is_set():
            return
        self._hanging, self._queued, self._began = None, False, None
        self._tried += 1
        attempt: _Attempt[T] = _Attempt(threading.Event(), threading.Event())
        attempt.thread = threading.Thread(
            target=self._run, args=(attempt,), name=f"{self._what} exposure", daemon=True
        )
        self._attempt = attempt
        attempt.thread.start()

    def _run(self, attempt: _Attempt[T]) -> None:
        try:
            attempt.taken = self._grab(attempt.cancel)
        except HardwareError as error:
            attempt.problem = str(error)
        except Exception as error:  # noqa: BLE001  must not end the station
            _log.exception("%s", self._what)
            attempt.problem = f"{type(error).__name__}: {error}"
        finally:
            attempt.finished.set()
