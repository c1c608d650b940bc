"""The loop that polls the controller's driver and carries out what its proxy requests."""

import contextlib
import logging
import select
import time
from collections.abc import Callable

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller.proxy import CLOSE, COMMANDS, DriverReport
from unwrinkle.hardware.controller_state import FAULT, HOLDING, RUNNING, STARTING, STOPPING
from unwrinkle.hardware.message_pipe import MessagePipe
from unwrinkle.models.errors import HardwareError

_logger = logging.getLogger(__name__)

#: Longest time between two polls, s; replies of the controller are read at once.
_PERIOD_S = 0.002
#: A program that requests nothing for this long while its robot moves is taken to hang, and the
#: robot is held, s.
LONGEST_SILENCE_S = 2.0
#: Longest wait for rest at the end, s; a hold takes well under a second, at most several.
LONGEST_CLOSE_S = 8.0

_MOVING = (STARTING, RUNNING, HOLDING, STOPPING)


class DriverLoop:
    """Polls a driver in this thread, from connecting to disconnecting.

    An exception in a poll stops the robot at once and latches a fault with the exception's text; a
    second one closes the connections.
    """

    def __init__(
        self,
        driver: ControllerDriver,
        pipe: MessagePipe,
        wait: Callable[[], float] | None = None,
    ) -> None:
        """Prepare; nothing is connected before `run`.

        Args:
            driver: polled by this loop alone.
            pipe: to the driver's proxy.
            wait: lets a period pass, at most, and returns the time of a monotonic clock, s; if left
                out, it waits for the controller and the proxy, in real time.
        """
        self._driver, self._pipe = driver, pipe
        self._wait = wait or self._wait_for_bytes
        self._failed = self._abandoned = False

    def run(self, ended: Callable[[], bool] = lambda: False) -> None:
        """Connect, and poll until the proxy closes or has died, or `ended` returns True; then hold,
        wait for rest (bounded), leave trajectory mode and disconnect.
        """
        try:
            self._driver.connect()
        except HardwareError as error:
            self._send(error)
            return
        self._send(DriverReport.of(self._driver))
        asked = False
        try:
            asked = self._serve(ended)
        finally:
            try:
                self._come_to_rest()
            finally:
                self._driver.close()
        if asked:
            self._send(DriverReport())

    def _serve(self, ended: Callable[[], bool]) -> bool:
        """Poll until the end; return whether the proxy asked for it."""
        now = heard = self._wait()
        while not ended():
            try:
                while request := self._received():
                    heard = now
                    name, arguments, named = request
                    if name == CLOSE:
                        return True
                    if name in COMMANDS:
                        try:
                            getattr(self._driver, name)(*arguments, **named)
                        except HardwareError as error:
                            self._driver.fail(str(error))
                    self._pipe.send(DriverReport.of(self._driver))
            except (EOFError, OSError):
                return False
            if now - heard > LONGEST_SILENCE_S:
                heard = now
                text = f"the program has said nothing for {LONGEST_SILENCE_S:g} s; does it hang?"
                self._driver.pause(text)
            self._poll(now)
            now = self._wait()
        return False

    def _received(self) -> tuple[str, tuple[object, ...], dict[str, object]] | None:
        """Return the next request; None if none has come."""
        try:
            request: tuple[str, tuple[object, ...], dict[str, object]] = self._pipe.receive()
        except TimeoutError:
            return None
        return request

    def _send(self, answer: object) -> None:
        with contextlib.suppress(OSError):
            self._pipe.send(answer)

    def _poll(self, now: float) -> None:
        if self._abandoned:
            return
        try:
            self._driver.poll(now)
        except Exception as error:
            _logger.exception("the driver's loop failed")
            text = str(error) if isinstance(error, HardwareError) else _named(error)
            if self._failed:  # even after the fault was latched
                self._driver.abandon(f"the driver's loop failed again: {text}")
                self._abandoned = True
                return
            self._failed = True
            try:
                self._driver.fail(f"the driver's loop failed: {text}")
            except Exception:
                _logger.exception("the driver could not latch its fault")

    def _come_to_rest(self) -> None:
        """Hold a motion, and poll until the robot rests; a fault may brake along the path."""
        driver = self._driver
        if driver.status.state in _MOVING and not self._abandoned:
            driver.hold(driver.status.command + 1)
        self._poll_while(lambda: driver.status.state in _MOVING)
        self._poll_while(lambda: driver.status.state == FAULT and driver.braking)

    def _poll_while(self, condition: Callable[[], bool]) -> None:
        """Poll while a condition holds, for at most `LONGEST_CLOSE_S`."""
        now = self._wait()
        end = now + LONGEST_CLOSE_S
        while now < end and not self._abandoned and condition():
            self._poll(now)
            now = self._wait()

    def _wait_for_bytes(self) -> float:
        """Wait for a period, or until the controller or the proxy sends something: the next point
        waits for its reply.
        """
        ends = [link.fileno() for link in self._driver.links.values() if not link.closed]
        try:
            select.select([self._pipe.fileno(), *ends], [], [], _PERIOD_S)
        except (OSError, ValueError):  # closed meanwhile
            time.sleep(_PERIOD_S)
        return time.monotonic()


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
