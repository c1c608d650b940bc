"""Encoding of messages, and the framer that cuts a byte stream into messages."""

import struct
from dataclasses import dataclass

from unwrinkle.hardware.motoros.codes import CommType, MessageType, ReplyCode
from unwrinkle.models.errors import ProtocolError

_HEADER = struct.Struct("<4i")
_GREATEST: float = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]  # of a float32

# Body lengths of each type; None: any.
_SIZES: dict[int, tuple[int, ...] | None] = {
    MessageType.PING: (0,),
    MessageType.ROBOT_STATUS: (28,),
    MessageType.JOINT_TRAJ_PT_FULL: (136,),
    MessageType.JOINT_FEEDBACK: (132,),
    MessageType.MOTION_CTRL: (52,),
    MessageType.MOTION_REPLY: (60,),
    MessageType.READ_IO_BIT: (4,),
    MessageType.READ_IO_BIT_REPLY: (8,),
    MessageType.WRITE_IO_BIT: (8,),
    MessageType.WRITE_IO_BIT_REPLY: (4,),
    MessageType.READ_IO_GROUP: (4,),
    MessageType.READ_IO_GROUP_REPLY: (8,),
    MessageType.WRITE_IO_GROUP: (8,),
    MessageType.WRITE_IO_GROUP_REPLY: (4,),
    MessageType.IO_CTRL_REPLY: (8,),
    MessageType.READ_M_REGISTER: (4, 8),
    MessageType.WRITE_M_REGISTER: (4, 8),
    MessageType.JOINT_TRAJ_PT_FULL_EX: (140, 272, 404, 536),
    MessageType.JOINT_FEEDBACK_EX: (532,),
    MessageType.SELECT_TOOL: (12,),
    MessageType.GET_DH_PARAMETERS: None,
}


class WireError(ProtocolError):
    """Bytes that are not a message, or a message that cannot be encoded.

    Attributes:
        name: "length", "type", "comm", "reply" (of a stream); "body", "valid", "groups" (of a
            body); "not finite", "integer" (of a message to send).
        messages: complete messages before the invalid bytes.
    """

    def __init__(self, name: str, text: str, messages: tuple["Message", ...] = ()) -> None:
        """State the reason `name`, and a text for the user."""
        super().__init__(text)
        self.name = name
        self.messages = messages

    def __reduce__(self) -> tuple[type["WireError"], tuple[str, str, tuple["Message", ...]]]:
        """Pickle with all data."""
        return type(self), (self.name, str(self), self.messages)


@dataclass(frozen=True)
class Message:
    """A message; its numbers are of `MessageType`, `CommType` and `ReplyCode`, or unknown."""

    type: int
    comm: int
    reply: int
    body: bytes = b""

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        head = _HEADER.pack(12 + len(self.body), self.type, self.comm, self.reply)
        return head + self.body


def ping(comm: int = CommType.REQUEST, reply: int = ReplyCode.INVALID) -> Message:
    """Return a request for a sign of life, or the reply to one."""
    return Message(MessageType.PING, comm, reply)


class Framer:
    """Cuts a byte stream into messages, however it is split; after invalid bytes every call raises.

    It buffers at most `most` bytes, and the bytes of one call.
    """

    def __init__(self, most: int = 4096, lenient: bool = False) -> None:
        """Refuse messages of more than `most` bytes after their length.

        Args:
            most: bytes.
            lenient: accept unknown types, as a server does that answers them.
        """
        self._most = most
        self._lenient = lenient
        self._kept = bytearray()
        self._broken: tuple[str, str] | None = None

    @property
    def waiting(self) -> int:
        """Buffered bytes of an incomplete message."""
        return len(self._kept)

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that these bytes complete.

        Raises:
            WireError: these bytes, or earlier ones, are not a message. The connection has to be
                closed; the error carries the complete messages before the invalid bytes.
        """
        if self._broken is not None:
            raise WireError(*self._broken)
        self._kept += data
        messages: list[Message] = []
        start = 0
        while (end := self._end(start, messages)) is not None:
            _, kind, comm, reply = _HEADER.unpack_from(self._kept, start)
            messages.append(Message(kind, comm, reply, bytes(self._kept[start + 16 : end])))
            start = end
        del self._kept[:start]
        return messages

    def _end(self, start: int, messages: list[Message]) -> int | None:
        """Return the end of the message that begins at `start`; None if it is incomplete."""
        words = struct.unpack_from(f"<{min((len(self._kept) - start) // 4, 4)}i", self._kept, start)
        problem = self._problem(words) if words else None
        if problem is not None:
            self._broken = problem
            self._kept.clear()
            raise WireError(*problem, tuple(messages))
        if len(words) < 4 or len(self._kept) < start + 4 + words[0]:
            return None
        return int(start + 4 + words[0])

    def _problem(self, words: tuple[int, ...]) -> tuple[str, str] | None:
        """Check the words of a header that are there: length, type, comm, reply; return name and
        text of an error.
        """
        length = words[0]
        if not 12 <= length <= self._most:
            return "length", f"a message of {length} bytes; 12 to {self._most} are possible"
        if len(words) > 1:
            kind = words[1]
            if kind not in _SIZES and not (self._lenient and 0 <= kind < 65536):
                return "type", f"a message of the unknown type {kind}"
            sizes = _SIZES.get(kind)
            if sizes is not None and length - 12 not in sizes:
                allowed = " or ".join(str(size + 12) for size in sizes)
                return "length", f"a message of type {kind} with {length} bytes; it has {allowed}"
        if len(words) > 2 and words[2] not in (1, 2, 3):
            return "comm", f"a message of the unknown kind of communication {words[2]}"
        if len(words) > 3 and words[3] not in (0, 1, 2):
            return "reply", f"a message with the unknown reply code {words[3]}"
        return None


def pack(layout: str, integers: tuple[int, ...], numbers: tuple[float, ...] = ()) -> bytes:
    """Encode integers, then numbers.

    Raises:
        WireError: a number is not finite or beyond a float32, an integer beyond an int32.
    """
    for number in numbers:
        if not abs(number) <= _GREATEST:
            raise WireError("not finite", f"{number} cannot be sent; every number has to be finite")
    try:
        return struct.pack(layout, *integers, *numbers)
    except struct.error:
        raise WireError("integer", f"{integers} do not fit into a message's integers") from None


def body_of(message: Message, kind: int) -> bytes:
    """Return a message's body.

    Raises:
        WireError: another type or length.
    """
    if message.type != kind:
        raise WireError("type", f"a message of type {message.type} where {kind} is expected")
    sizes = _SIZES[kind]
    if sizes is not None and len(message.body) not in sizes:
        raise WireError("body", f"a body of {len(message.body)} bytes in type {kind}")
    return message.body
