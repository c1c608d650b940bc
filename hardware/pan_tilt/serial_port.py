"""A serial port that never blocks: bytes to send are queued, received bytes are returned as they
come.
"""

import select
import time
from typing import Any, Protocol

from unwrinkle.models.errors import ConnectionLostError

#: Send-buffer limit, bytes; beyond it the device is taken to accept nothing.
SEND_LIMIT_BYTES = 1 << 14
#: Bytes that one call receives at most.
_CHUNK = 1 << 12


class SerialPort(Protocol):
    """The part of a serial port that a driver uses; failures are a HardwareError that names the
    device.
    """

    def read(self) -> bytes:
        """Return the received bytes without waiting; empty if there are none."""
        ...

    def write(self, data: bytes) -> None:
        """Queue bytes and send as many as possible without waiting."""
        ...

    def close(self) -> None:
        """Close; a second call changes nothing."""
        ...


class BufferedPort(Protocol):
    """An end of a serial line that counts what it has received."""

    received: int

    def fileno(self) -> int:
        """Return the file descriptor, for `select`."""
        ...

    def take(self) -> None:
        """Move the received bytes to the buffer without waiting."""
        ...


def fill(port: BufferedPort, total: int, deadline: float) -> bool:
    """Wait at most `deadline`, s, for `total` received bytes; return whether they have come."""
    end = time.monotonic() + deadline
    port.take()
    while port.received < total:
        left = end - time.monotonic()
        if left <= 0.0:
            return False
        select.select([port], [], [], left)
        port.take()
    return True


class SerialLink:
    """A device on a serial port, by pyserial.

    Attributes:
        device: its name, as /dev/ttyUSB0.
        sent: bytes handed to the operating system.
        received: bytes received, whether `read` has returned them yet or not.
    """

    def __init__(self, handle: Any, device: str) -> None:
        """Use an open `serial.Serial` with timeouts of 0, which the link closes."""
        self._handle = handle
        self._waiting = bytearray()
        self._came = bytearray()
        self._closed = False
        self.device = device
        self.sent = 0
        self.received = 0

    def fileno(self) -> int:
        """Return the file descriptor, for `select`."""
        return int(self._handle.fileno())

    def read(self) -> bytes:
        """Return the received bytes; empty if there are none.

        Raises:
            ConnectionLostError: the port is closed, or the device is gone.
        """
        self.take()
        data = bytes(self._came)
        self._came.clear()
        return data

    def write(self, data: bytes) -> None:
        """Queue bytes and send as many as possible.

        Raises:
            ConnectionLostError: the port is closed, the device is gone, or it accepts nothing any
                more.
        """
        self._check_open()
        self._waiting += data
        self.flush()
        if len(self._waiting) > SEND_LIMIT_BYTES:
            raise ConnectionLostError(
                f"{self.device} takes nothing: {len(self._waiting)} bytes wait; check its cable"
            )

    def flush(self) -> None:
        """Send as many queued bytes as possible.

        Raises:
            ConnectionLostError: the device is gone.
        """
        if not self._waiting:
            return
        try:
            count = self._handle.write(bytes(self._waiting)) or 0
        except OSError as error:
            raise self._gone(error) from None
        self.sent += count
        del self._waiting[:count]

    def close(self) -> None:
        """Close; a second call changes nothing."""
        if not self._closed:
            self._closed = True
            self._handle.close()

    def take(self) -> None:
        """Move the received bytes to the buffer, and send queued ones, without waiting.

        Raises:
            ConnectionLostError: the port is closed, or the device is gone.
        """
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
            raise ConnectionLostError(f"{self.device} was closed by this side")

    def _gone(self, error: OSError) -> ConnectionLostError:
        return ConnectionLostError(
            f"{self.device} is gone: {error.strerror or error}; plug it in again and start anew"
        )


def open_serial(device: str, baud: int) -> SerialLink:
    """Open a serial port with eight data bits, no parity, one stop bit and no handshake.

    No other process can open it meanwhile.

    Args:
        device: as /dev/ttyUSB0.
        baud: bits per second.

    Raises:
        ConnectionLostError: there is no such device, it is in use, or this user may not open it.
    """
    import serial

    try:
        handle = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError) as error:
        raise ConnectionLostError(
            f"cannot open serial port {device} at {baud} baud: {error}; is the device plugged in, "
            "may this user open it, and does no other program hold it?"
        ) from None
    return SerialLink(handle, device)
