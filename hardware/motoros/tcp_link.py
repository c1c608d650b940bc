"""A TCP connection that never blocks: bytes to send are queued, received bytes are returned as they
come.
"""

import errno
import select
import socket
import time
from contextlib import suppress

from unwrinkle.models.errors import ConnectionLostError

#: Send-buffer limit, bytes; the connection is closed beyond it.
SEND_LIMIT_BYTES = 1 << 20
#: Bytes that one call receives at most.
_CHUNK = 1 << 16
#: Errors of a socket that is not ready.
_NOT_READY = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR)


class TcpLink:
    """A connected socket.

    Attributes:
        name: of the peer, for messages.
        sent: bytes handed to the operating system.
        received: bytes received.
        closed: why the connection has ended; empty while it is open.
    """

    def __init__(self, connection: socket.socket, name: str) -> None:
        """Use a connected socket, which the link closes."""
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._socket = connection
        self._waiting = bytearray()
        self.name = name
        self.sent = 0
        self.received = 0
        self.closed = ""

    @classmethod
    def connect(cls, host: str, port: int, deadline: float, name: str) -> "TcpLink":
        """Connect as a client.

        Args:
            host, port: of the server.
            deadline: longest wait, s.
            name: of the peer, for messages.

        Raises:
            ConnectionLostError: the server does not answer; the message names host and port.
        """
        try:
            connection = socket.create_connection((host, port), timeout=deadline)
        except OSError as error:
            reason = (
                "no answer" if isinstance(error, TimeoutError) else (error.strerror or str(error))
            )
            raise ConnectionLostError(
                f"{name}: cannot connect to {host}:{port} within {deadline:g} s: {reason}; is it "
                "on, and are address and port right?"
            ) from None
        return cls(connection, name)

    @property
    def waiting(self) -> int:
        """Bytes that the peer has no room for yet."""
        return len(self._waiting)

    def fileno(self) -> int:
        """Return the file descriptor, for `select`."""
        return self._socket.fileno()

    def send(self, data: bytes) -> None:
        """Queue bytes and send as many as possible; a peer that never reads closes the link."""
        if self.closed:
            return
        self._waiting += data
        self.flush()
        if len(self._waiting) > SEND_LIMIT_BYTES:
            self.close(f"does not read: {len(self._waiting)} bytes wait")

    def flush(self) -> None:
        """Send as many queued bytes as possible."""
        while self._waiting and not self.closed:
            try:
                count = self._socket.send(self._waiting)
            except OSError as error:
                if error.errno not in _NOT_READY:
                    self.close(error.strerror or str(error))
                return
            self.sent += count
            del self._waiting[:count]

    def receive(self, most: int = _CHUNK) -> bytes:
        """Return at most `most` received bytes; empty if there are none."""
        if self.closed:
            return b""
        try:
            data = self._socket.recv(most)
        except OSError as error:
            if error.errno not in _NOT_READY:
                self.close(error.strerror or str(error))
            return b""
        if not data:
            self.close("closed by the peer")
        self.received += len(data)
        return data

    def wait(self, deadline: float) -> bool:
        """Wait at most `deadline`, s, until something can be read; return whether it can."""
        if self.closed:
            return False
        return bool(select.select([self], [], [], max(deadline, 0.0))[0])

    def drain(self, deadline: float) -> bool:
        """Send all queued bytes within `deadline`, s; return whether all are sent."""
        end = time.monotonic() + deadline
        while self._waiting and not self.closed:
            left = end - time.monotonic()
            if left <= 0.0:
                break
            select.select([], [self], [], left)
            self.flush()
        return not self._waiting and not self.closed

    def close(self, reason: str = "closed by this side") -> None:
        """Close; a second call changes nothing."""
        if self.closed:
            return
        self.closed = reason
        self._waiting.clear()
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
