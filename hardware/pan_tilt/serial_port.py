"""One serial port that never blocks: bytes out are queued, bytes in are taken as they come."""

import select
import time
from typing import Any, Protocol

from unwrinkle.models.errors import HardwareError

#: Most bytes that wait for a device that does not take them, before the port is given up.
MOST_WAITING = 1 << 14
_CHUNK = 1 << 12


class SerialPort(Protocol):
    """What a driver needs of a serial port; failures are a HardwareError that names the device."""

    def read(self) -> bytes:
        """What has come; empty if nothing. Never waits."""
        ...

    def write(self, data: bytes) -> None:
        """Queue bytes and send what can be sent. Never waits."""
        ...

    def close(self) -> None:
        """Close; a second time changes nothing."""
        ...


class SerialLink:
    """A device on a serial port, by pyserial.

    Attributes:
        device: its name, as /dev/ttyUSB0.
        sent: bytes that the system has taken.
        received: bytes that have come, whether `read` has handed them out yet or not.
    """

    def __init__(self, handle: Any, device: str) -> None:
        """Take over an open `serial.Serial` whose timeouts are 0."""
        self._handle = handle
        self._waiting = bytearray()
        self._came = bytearray()
        self._closed = False
        self.device = device
        self.sent = 0
        self.received = 0

    def fileno(self) -> int:
        """For `select`."""
        return int(self._handle.fileno())

    def read(self) -> bytes:
        """What has come; empty if nothing.

        Raises:
            HardwareError: the port is closed, or the device is gone.
        """
        self._take()
        data = bytes(self._came)
        self._came.clear()
        return data

    def write(self, data: bytes) -> None:
        """Queue bytes and send what can be sent.

        Raises:
            HardwareError: the port is closed, the device is gone, or it takes nothing any more.
        """
        self._check_open()
        self._waiting += data
        self.flush()
        if len(self._waiting) > MOST_WAITING:
            raise HardwareError(
                f"{self.device} takes nothing: {len(self._waiting)} bytes wait; check its cable"
            )

    def flush(self) -> None:
        """Send what waits, as far as the system takes it.

        Raises:
            HardwareError: the device is gone.
        """
        if not self._waiting:
            return
        try:
            count = self._handle.write(bytes(self._waiting)) or 0
        except OSError as error:
            raise self._gone(error) from None
        self.sent += count
        del self._waiting[:count]

    def fill(self, total: int, deadline: float) -> bool:
        """Wait until `received` is at least `total`, for at most so long (s); whether it is."""
        end = time.monotonic() + deadline
        self._take()
        while self.received < total:
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            select.select([self], [], [], left)
            self._take()
        return True

    def close(self) -> None:
        """Close; a second time changes nothing."""
        if not self._closed:
            self._closed = True
            self._handle.close()

    def _take(self) -> None:
        self._check_open()
        self.flush()
        try:
            data = self._handle.read(_CHUNK)
        except OSError as error:
            raise self._gone(error) from None
        self.received += len(data)
        self._came += data

    def _check_open(self) -> None:
        if self._closed:
            raise HardwareError(f"{self.device} was closed by this side")

    def _gone(self, error: OSError) -> HardwareError:
        return HardwareError(
            f"{self.device} is gone: {error.strerror or error}; plug it in again and start anew"
        )


def open_serial(device: str, baud: int) -> SerialLink:
    """Open a serial port with eight data bits, no parity, one stop bit and no handshake.

    The port is taken for this process alone.

    Args:
        device: as /dev/ttyUSB0.
        baud: bits per second.

    Raises:
        HardwareError: there is no such device, it is taken, or it may not be used.
    """
    import serial

    try:
        handle = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError) as error:
        raise HardwareError(
            f"cannot open serial port {device} at {baud} baud: {error}; is the device plugged in, "
            "may this user open it, and does no other program hold it?"
        ) from None
    return SerialLink(handle, device)
