"""Two ends of real connections on one simulated clock: neither moves on before it has all that the other sent."""

import array
import fcntl
import select
import termios
import time
from collections.abc import Callable

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.motoros.link import TcpLink
from unwrinkle.hardware.pan_tilt.driver import PanTiltDriver
from unwrinkle.hardware.pan_tilt.serial_port import SerialLink, fill
from unwrinkle.models.errors import HardwareError
from unwrinkle.simulation.controllers.server import ControllerServer
from unwrinkle.simulation.devices.serial_pan_tilt import PtyPort

#: The system itself delivers what was sent within this, s; it takes microseconds.
DEADLINE = 5.0
#: Requests of the driver that are answered within one step of the clock: the controller's answer takes about a millisecond.
MOST_ANSWERS = 12


class ControllerLockstep:
    """The controller's driver and the virtual controller's server, over TCP."""

    def __init__(self, driver: ControllerDriver, server: ControllerServer) -> None:
        """Couple two ends."""
        self._driver, self._server = driver, server

    def poll_driver(self, now: float) -> None:
        """Let the driver move on to a time, s, with all that the server has sent, and have what it asks answered."""
        for _ in range(MOST_ANSWERS):
            self._await_server()
            before = self._asked()
            self._driver.poll(now)
            if self._asked() == before:
                break
            self._await_driver()
            self._server.answer()

    def poll_server(self, now: float, poll: Callable[[], None]) -> None:
        """Let the server move on (`poll` does) with all that the driver has sent."""
        self._await_driver()
        poll()

    def _asked(self) -> tuple[str, int]:
        """What changes with every request on the motion connection."""
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
    """A pan-tilt unit's driver and the virtual unit, over a pseudo-terminal."""

    def __init__(self, driver: PanTiltDriver, line: SerialLink, port: PtyPort) -> None:
        """Couple two ends of a line."""
        self._driver, self._line, self._port = driver, line, port

    def poll(self, now: float) -> None:
        """Let the driver move on to a time, s; all it sends is there for the unit's next poll."""
        if not fill(self._line, self._port.sent, DEADLINE):
            raise HardwareError(f"{self._line.device}: the line lost what the unit sent")
        self._driver.poll(now)
        if not fill(self._port, self._line.sent, DEADLINE):
            raise HardwareError(f"{self._line.device}: the line lost what the driver sent")


def _await(link: TcpLink, total: int) -> None:
    """Wait until a link has, read or waiting to be read, as many bytes as its peer has sent."""
    end = time.monotonic() + DEADLINE
    while not link.closed and link.received + _waiting(link) < total:
        if time.monotonic() > end:
            raise HardwareError(f"{link.name}: what was sent did not arrive in {DEADLINE:g} s")
        select.select([link], [], [], 0.001)


def _waiting(link: TcpLink) -> int:
    """Bytes that have come and were not read."""
    count = array.array("i", [0])
    fcntl.ioctl(link.fileno(), termios.FIONREAD, count)
    return count[0]
