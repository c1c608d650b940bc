"""Pickled messages over a socket, between a program and a process that it has started."""

import pickle
import select
import socket
import struct
import time
from typing import Any

_HEADER = struct.Struct("!Q")
#: Bytes per read.
_CHUNK = 1 << 16


class MessagePipe:
    """One end. A message that has only partly come does not block the reader."""

    def __init__(self, end: socket.socket) -> None:
        """Use one socket of a pair."""
        self._socket = end
        self._data = bytearray()

    def fileno(self) -> int:
        """Return the socket's descriptor, for `select`."""
        return self._socket.fileno()

    def send(self, message: object) -> None:
        """Send a message.

        Raises:
            OSError: the other end is closed.
        """
        body = pickle.dumps(message)
        self._socket.sendall(_HEADER.pack(len(body)) + body)

    def receive(self, longest: float = 0.0) -> Any:
        """Return the next message; wait for it at most `longest`, s.

        Raises:
            TimeoutError: no complete message has come.
            EOFError: the other end is closed.
        """
        end = time.monotonic() + longest
        while True:
            if len(self._data) >= _HEADER.size:
                last = _HEADER.size + _HEADER.unpack_from(self._data)[0]
                if len(self._data) >= last:
                    body = bytes(self._data[_HEADER.size : last])
                    del self._data[:last]
                    return pickle.loads(body)
            left = max(end - time.monotonic(), 0.0)
            if not select.select([self._socket], [], [], left)[0]:
                raise TimeoutError
            try:
                chunk = self._socket.recv(_CHUNK)
            except OSError:
                chunk = b""
            if not chunk:
                raise EOFError
            self._data += chunk

    def close(self) -> None:
        """Close this end; the other end then reads EOFError."""
        self._socket.close()
