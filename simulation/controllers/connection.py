"""One client of the virtual controller's server."""

from collections import deque

from unwrinkle.hardware.motoros.link import TcpLink
from unwrinkle.hardware.motoros.wire import Message
from unwrinkle.simulation.controllers.reads import Unread


class Connection:
    """A link with what came on it and what waits to be written.

    Attributes:
        link: to the client.
        waiting: its messages that are not answered yet.
        rest: of a read that a fault has cut, which the next read brings.
        since: when the first byte came of what a fault puts together, s; None while none has come.
        credit: bytes that a slow reader may read by now.
    """

    def __init__(self, link: TcpLink) -> None:
        """Serve a link."""
        self.link = link
        self.waiting: deque[Message | Unread] = deque()
        self.rest = b""
        self.since: float | None = None
        self.credit = 0.0
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
