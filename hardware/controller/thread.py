"""The controller's driver in a thread of its own, on a real clock."""

import logging
import select
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller_state import (
    FAULT,
    HOLDING,
    RUNNING,
    STARTING,
    STOPPING,
    DriverStatus,
    JointFeedback,
)
from unwrinkle.models.errors import HardwareError
from unwrinkle.planning.trajectory import Trajectory

_logger = logging.getLogger(__name__)

#: Longest wait for rest when leaving, s; a hold takes well under a second, at most several.
LEAVING = 8.0
#: The thread ends within this, s.
_END = 2.0


class DriverThread:
    """Polls a driver until it is closed; every method may be called from any thread.

    As a context manager it connects at the start; at the end, however that comes, it holds, waits for rest and
    disconnects. An exception in the loop stops the robot at once and latches a fault with the exception's text.
    """

    def __init__(
        self,
        driver: ControllerDriver,
        period: float = 0.002,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Poll a driver once each period, s."""
        self._driver = driver
        self._period = period
        self._clock = clock
        self._changed = threading.Condition(threading.RLock())
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    # What it tells

    @property
    def status(self) -> DriverStatus:
        """Newest status."""
        with self._changed:
            return self._driver.status

    @property
    def feedback(self) -> JointFeedback | None:
        """Newest set of feedback; None before the first."""
        with self._changed:
            return self._driver.feedback

    @property
    def inputs(self) -> dict[int, int | None]:
        """See the driver."""
        with self._changed:
            return self._driver.inputs

    @property
    def outputs_written(self) -> dict[int, int | None]:
        """See the driver."""
        with self._changed:
            return self._driver.outputs_written

    @property
    def io_problem(self) -> str:
        """See the driver."""
        with self._changed:
            return self._driver.io_problem

    # Its life

    def start(self) -> None:
        """Connect, and poll from now on; a second time changes nothing.

        Raises:
            HardwareError: the robot is in use, or nobody answers.
        """
        if self._thread is not None:
            return
        with self._changed:
            self._driver.connect()
        self._end.clear()
        self._thread = threading.Thread(target=self._loop, name="controller driver", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hold, wait for rest (bounded), leave trajectory mode, disconnect; a second time changes nothing."""
        if self._thread is not None:
            moving = (STARTING, RUNNING, HOLDING, STOPPING)
            if self.status.state in moving and self._thread.is_alive():
                with self._changed:
                    self._driver.hold(self._driver.status.command + 1)
                self.wait(lambda status: status.state not in moving, LEAVING)
            # A fault may still be braking along the path.
            if self.status.state == FAULT:
                self.wait(lambda _: not self._driver.braking, LEAVING)
            self._end.set()
            self._thread.join(_END)
            self._thread = None
        with self._changed:
            self._driver.close()
            self._changed.notify_all()

    def __enter__(self) -> Self:
        """Connect and poll."""
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Hold, wait for rest, disconnect."""
        self.close()

    def wait(self, predicate: Callable[[DriverStatus], bool], timeout: float) -> bool:
        """Wait until the status fulfils something, at most so long (s, of real time); whether it does."""
        end = time.monotonic() + timeout
        with self._changed:
            while not predicate(self._driver.status):
                left = end - time.monotonic()
                if left <= 0.0:
                    return False
                self._changed.wait(min(left, 0.1))
            return True

    # Commands

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """See the driver."""
        with self._changed:
            self._driver.run(number, trajectory, name)

    def hold(self, number: int) -> None:
        """See the driver."""
        with self._changed:
            self._driver.hold(number)

    def resume(self, number: int) -> None:
        """See the driver."""
        with self._changed:
            self._driver.resume(number)

    def stop(self, reason: str) -> None:
        """See the driver: hold, then leave trajectory mode."""
        with self._changed:
            self._driver.stop(reason)

    def reset(self) -> None:
        """See the driver."""
        with self._changed:
            self._driver.reset()

    def fail(self, text: str) -> None:
        """See the driver: stop at once, latch a fault."""
        with self._changed:
            self._driver.fail(text)

    def pause(self, reason: str) -> None:
        """See the driver."""
        with self._changed:
            self._driver.pause(reason)

    def set_override(self, value: float) -> None:
        """See the driver."""
        with self._changed:
            self._driver.set_override(value)

    def write_output(self, address: int, value: int) -> None:
        """See the driver."""
        with self._changed:
            self._driver.write_output(address, value)

    def read_input(self, address: int) -> None:
        """See the driver."""
        with self._changed:
            self._driver.read_input(address)

    # The loop

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
        """Wait for a period, or until the controller says something: the next point waits for its answer."""
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
