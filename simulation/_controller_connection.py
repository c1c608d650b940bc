"""One client of the virtual controller's server."""

from collections import deque

from unwrinkle.hardware.link import TcpLink
from unwrinkle.hardware.wire import Framer, Message


class Connection:
    """A link with what came on it and what waits to be written.

    Attributes:
        link: to the client.
        framer: of what it sends.
        waiting: its messages that are not answered yet.
    """

    def __init__(self, link: TcpLink, framer: Framer) -> None:
        """Serve a link."""
        self.link = link
        self.framer = framer
        self.waiting: deque[Message] = deque()
        self._pieces = bytearray()

    def send(self, data: bytes, split: bool) -> None:
        """Send now; if split, in single bytes, the last ones at a later `flush`."""
        if split or self._pieces:
            self._pieces += data
        else:
            self.link.send(data)

    def flush(self, split: bool) -> None:
        """Send what waits: all, or if split half of it in single bytes."""
        if self._pieces:
            count = max(len(self._pieces) // 2, 64) if split else len(self._pieces)
            for index in range(min(count, len(self._pieces))):
                self.link.send(bytes(self._pieces[index : index + 1]))
            del self._pieces[:count]
        self.link.flush()
