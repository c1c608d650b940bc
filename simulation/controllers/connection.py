"""One client of the virtual controller's server."""

from collections import deque

from unwrinkle.hardware.motoros.messages import Message
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.simulation.controllers.reads import Unread


class Connection:
    """A link with its unanswered messages and its unsent bytes.

    Attributes:
        link: to the client.
        waiting: messages that are not answered yet.
        rest: of a read that a fault has cut; the next read returns it.
        since: time of the first byte of a read that a fault coalesces, s; None before that.
        credit: bytes that a slow reader may read now.
    """

    def __init__(self, link: TcpLink) -> None:
        """Use a link to a client."""
        self.link = link
        self.waiting: deque[Message | Unread] = deque()
        self.rest = b""
        self.since: float | None = None
        self.credit = 0.0
        self._pieces = bytearray()

    def send(self, data: bytes, split: bool) -> None:
        """Send bytes; if `split`, queue them for single writes at later calls of `flush`."""
        if split or self._pieces:
            self._pieces += data
        else:
            self.link.send(data)

    def flush(self, split: bool) -> None:
        """Send queued bytes: all, or with `split` half of them in single writes."""
        if self._pieces:
            count = max(len(self._pieces) // 2, 64) if split else len(self._pieces)
            for index in range(min(count, len(self._pieces))):
                self.link.send(bytes(self._pieces[index : index + 1]))
            del self._pieces[:count]
        self.link.flush()
