"""The controller's driver polled by a thread of its own, on a real clock."""

import logging
import select
import threading
import time
from collections.abc import Callable

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller.proxy import LONGEST_CLOSE_S, DriverProxy, DriverReport
from unwrinkle.hardware.controller_state import (
    FAULT,
    HOLDING,
    RUNNING,
    STARTING,
    STOPPING,
    DriverStatus,
)
from unwrinkle.models.errors import HardwareError

_logger = logging.getLogger(__name__)

#: Longest wait for the thread's end, s.
_LONGEST_JOIN_S = 2.0


class DriverThread(DriverProxy):
    """Polls a driver until it is closed.

    An exception in the loop stops the robot at once and latches a fault with the exception's text.
    """

    def __init__(
        self,
        driver: ControllerDriver,
        period: float = 0.002,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare to poll a driver.

        Args:
            driver: polled by this thread alone from `start` on.
            period: longest time between two polls, s; replies of the controller are read at once.
            clock: monotonic, s.
        """
        self._driver = driver
        self._period = period
        self._clock = clock
        self._changed = threading.Condition(threading.RLock())
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    def report(self) -> DriverReport:
        """Return what the driver reports now."""
        with self._changed:
            driver = self._driver
            return DriverReport(
                driver.status,
                driver.feedback,
                driver.inputs,
                driver.outputs_written,
                driver.io_problem,
            )

    def start(self) -> None:
        """Connect, and poll from now on; a second call changes nothing.

        Raises:
            HardwareError: the robot is in use, or a server does not answer.
        """
        if self._thread is not None:
            return
        with self._changed:
            self._driver.connect()
        self._end.clear()
        self._thread = threading.Thread(target=self._loop, name="controller driver", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hold, wait for rest (bounded), leave trajectory mode, disconnect; a second call changes
        nothing.
        """
        if self._thread is not None:
            moving = (STARTING, RUNNING, HOLDING, STOPPING)
            if self.status.state in moving and self._thread.is_alive():
                with self._changed:
                    self._driver.hold(self._driver.status.command + 1)
                self.wait(lambda status: status.state not in moving, LONGEST_CLOSE_S)
            # A fault may still be braking along the path.
            if self.status.state == FAULT:
                self.wait(lambda _: not self._driver.braking, LONGEST_CLOSE_S)
            self._end.set()
            self._thread.join(_LONGEST_JOIN_S)
            self._thread = None
        with self._changed:
            self._driver.close()
            self._changed.notify_all()

    def wait(self, predicate: Callable[[DriverStatus], bool], timeout: float) -> bool:
        """Wait at most `timeout`, s of real time, until the status fulfils `predicate`; return
        whether it does.
        """
        end = time.monotonic() + timeout
        with self._changed:
            while not predicate(self._driver.status):
                left = end - time.monotonic()
                if left <= 0.0:
                    return False
                self._changed.wait(min(left, 0.1))
            return True

    def pause(self, reason: str) -> None:
        """Brake along the path, if a trajectory runs; see `ControllerDriver.pause`."""
        with self._changed:
            self._driver.pause(reason)

    def _call(self, command: str, *arguments: object) -> None:
        with self._changed:
            getattr(self._driver, command)(*arguments)

    def _loop(self) -> None:
        failed = False
        while not self._end.is_set():
            with self._changed:
                try:
                    self._driver.poll(self._clock())
                except Exception as error:
                    _logger.exception("the driver's loop failed")
                    if failed:  # even after the fault was latched
                        self._driver.abandon(f"the driver's loop failed again: {_words(error)}")
                        self._changed.notify_all()
                        return
                    failed = True
                    self._fail(error)
                self._changed.notify_all()
            self._pause()

    def _pause(self) -> None:
        """Wait for a period, or until the controller sends something: the next point waits for its
        reply.
        """
        links = [link for link in self._driver.links.values() if not link.closed]
        try:
            if links:
                select.select(links, [], [], self._period)
                return
        except (OSError, ValueError):  # closed meanwhile
            pass
        self._end.wait(self._period)

    def _fail(self, error: Exception) -> None:
        try:
            self._driver.fail(f"the driver's loop failed: {_words(error)}")
        except Exception:
            _logger.exception("the driver could not latch its fault")


def _words(error: Exception) -> str:
    if isinstance(error, HardwareError):
        return str(error)
    return f"{type(error).__name__}: {error}"
