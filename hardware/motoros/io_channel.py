"""The connection for digital inputs and outputs: one request at a time, values by address."""

from collections import deque

from unwrinkle.hardware.motoros.messages import (
    IO_RESULTS,
    Framer,
    IoResult,
    Message,
    MessageType,
    ReadIo,
    ReadIoReply,
    WireError,
    WriteIo,
    WriteIoReply,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.errors import (
    ConnectionLostError,
    HardwareError,
    OverdueError,
    ProtocolError,
)

#: Limit of queued requests.
_MOST_QUEUED = 256


class IoChannel:
    """Reads inputs and writes outputs.

    Attributes:
        inputs: last value read of each address; None where it cannot be read, or has not been read
            yet.
        written: last value acknowledged for each output; None where it was refused, or is not
            answered yet.
        problem: last refusal, for the user; empty if there was none.
    """

    def __init__(self, link: TcpLink, reply_timeout: float) -> None:
        """Use a link; a reply is due within reply_timeout, s."""
        self._link = link
        self._timeout = reply_timeout
        self._framer = Framer()
        self._waiting: deque[tuple[int, int | None]] = deque()
        self._asked: tuple[int, int | None, float] | None = None
        self.inputs: dict[int, int | None] = {}
        self.written: dict[int, int | None] = {}
        self.problem = ""

    def read(self, address: int) -> None:
        """Queue a read of an input, unless one is queued already."""
        self.inputs.setdefault(address, None)
        self._queue((address, None))

    def write(self, address: int, value: int) -> None:
        """Queue a write of an output, 0 or 1."""
        self.written[address] = None
        self._queue((address, value))

    def poll(self, now: float) -> None:
        """Read replies, and send the next request.

        Raises:
            ConnectionLostError: the connection has ended.
            OverdueError: a reply is overdue.
            ProtocolError: a message is not the reply to a request.
        """
        data = self._link.receive()
        if data:
            try:
                for message in self._framer.feed(data):
                    self._take(message)
            except WireError as error:
                raise ProtocolError(
                    f"the controller sends garbage on the I/O connection ({error.name}: {error})"
                ) from None
        if self._link.closed:
            raise ConnectionLostError(f"the I/O connection has ended: {self._link.closed}")
        if self._asked is not None and now - self._asked[2] > self._timeout:
            waited = now - self._asked[2]
            raise OverdueError(
                f"the controller has not answered about input or output {self._asked[0]} for "
                f"{waited:.2f} s, at most {self._timeout:g} s",
                waited,
                self._timeout,
            )
        if self._asked is None and self._waiting:
            address, value = self._waiting.popleft()
            body = ReadIo(address) if value is None else WriteIo(address, value)
            self._link.send(body.to_message().encode())
            self._asked = (address, value, now)
        self._link.flush()

    def _queue(self, item: tuple[int, int | None]) -> None:
        if item in self._waiting:
            if item[1] is None:
                return
            self._waiting.remove(item)  # the order of writes counts
        if len(self._waiting) >= _MOST_QUEUED:
            raise HardwareError(
                f"{_MOST_QUEUED} inputs and outputs wait for the controller's answers; ask for "
                "fewer"
            )
        self._waiting.append(item)

    def _take(self, message: Message) -> None:
        if self._asked is None:
            raise WireError("type", f"a message of type {message.type} without a request")
        address, value, _ = self._asked
        self._asked = None
        if message.type == MessageType.IO_CTRL_REPLY:
            self._refused(address, value, IoResult.READ_FAILURE)
        elif value is None:
            read = ReadIoReply.of(message)
            if read.result == IoResult.OK:
                self.inputs[address] = read.value
            else:
                self._refused(address, value, read.result)
        else:
            result = WriteIoReply.of(message).result
            if result == IoResult.OK:
                self.written[address] = value
            else:
                self._refused(address, value, result)

    def _refused(self, address: int, value: int | None, result: int) -> None:
        what = "read" if value is None else "written"
        (self.inputs if value is None else self.written)[address] = None
        text = IO_RESULTS.get(result, f"result {result}")
        self.problem = f"{address} cannot be {what}: {text}"
