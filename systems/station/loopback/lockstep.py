"""Synchronise both ends of a real connection on one simulated clock.

Neither advances before all sent bytes arrived.
"""

import array
import fcntl
import select
import termios
import time
from collections.abc import Callable

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.hardware.pan_tilt.driver import PanTiltDriver
from unwrinkle.hardware.pan_tilt.serial_port import SerialLink, fill
from unwrinkle.models.errors import HardwareError
from unwrinkle.simulation.controllers.server import ControllerServer
from unwrinkle.simulation.devices.serial_pan_tilt import PtyPort

#: Maximum time for the operating system to deliver sent bytes, s; it takes microseconds.
DELIVERY_TIMEOUT = 5.0
#: Maximum number of requests that are answered within one step of the clock: the controller answers
#: in about 1 ms.
MAX_REQUESTS_PER_STEP = 12


class ControllerLockstep:
    """Synchronise the controller's driver with the virtual controller's server, over TCP."""

    def __init__(self, driver: ControllerDriver, server: ControllerServer) -> None:
        """Couple the two ends."""
        self._driver, self._server = driver, server

    def poll_driver(self, now: float) -> None:
        """Advance the driver to a time, s, and let the server answer its requests."""
        for _ in range(MAX_REQUESTS_PER_STEP):
            self._await_server()
            before = self._asked()
            self._driver.poll(now)
            if self._asked() == before:
                break
            self._await_driver()
            self._server.answer()

    def poll_server(self, now: float, poll: Callable[[], None]) -> None:
        """Advance the server (by calling `poll`) with all that the driver has sent."""
        self._await_driver()
        poll()

    def _asked(self) -> tuple[str, int]:
        """Return a value that changes with every request on the motion connection."""
        link = self._driver.links.get("motion")
        return ("", 0) if link is None else (link.closed, link.sent)

    def _await_server(self) -> None:
        for name, link in self._driver.links.items():
            peers = self._server.links[name]
            if peers:
                _await(link, peers[-1].sent)

    def _await_driver(self) -> None:
        for name, link in self._driver.links.items():
            peers = self._server.links[name]
            if peers and not link.closed:
                _await(peers[-1], link.sent)


class PanTiltLockstep:
    """Synchronise a pan-tilt unit's driver with the virtual unit, over a pseudo-terminal."""

    def __init__(self, driver: PanTiltDriver, line: SerialLink, port: PtyPort) -> None:
        """Couple the two ends of a line."""
        self._driver, self._line, self._port = driver, line, port

    def poll(self, now: float) -> None:
        """Advance the driver to a time, s.

        All that it sends is available at the unit's next poll.
        """
        if not fill(self._line, self._port.sent, DELIVERY_TIMEOUT):
            raise HardwareError(
                f"{self._line.device}: bytes of the virtual pan-tilt unit did not arrive within "
                f"{DELIVERY_TIMEOUT:g} s"
            )
        self._driver.poll(now)
        if not fill(self._port, self._line.sent, DELIVERY_TIMEOUT):
            raise HardwareError(
                f"{self._line.device}: bytes of the driver did not arrive within "
                f"{DELIVERY_TIMEOUT:g} s"
            )


def _await(link: TcpLink, total: int) -> None:
    """Wait until a link has received, read or not, as many bytes as its peer has sent."""
    end = time.monotonic() + DELIVERY_TIMEOUT
    while not link.closed and link.received + _waiting(link) < total:
        if time.monotonic() > end:
            raise HardwareError(
                f"{link.name}: sent bytes did not arrive within {DELIVERY_TIMEOUT:g} s"
            )
        select.select([link], [], [], 0.001)


def _waiting(link: TcpLink) -> int:
    """Return the number of bytes that have arrived and were not read."""
    count = array.array("i", [0])
    fcntl.ioctl(link.fileno(), termios.FIONREAD, count)
    return count[0]
