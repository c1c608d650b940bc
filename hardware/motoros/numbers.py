"""Messages whose bodies consist of integers: the robot's status, inputs and outputs."""

import struct
from dataclasses import astuple, dataclass, fields
from typing import ClassVar, Self

from unwrinkle.hardware.motoros.codes import CommType, MessageType, ReplyCode
from unwrinkle.hardware.motoros.frames import Message, body_of, pack


@dataclass(frozen=True)
class _Numbers:
    """A body of integers, in the order of its fields."""

    kind: ClassVar[int]
    comm: ClassVar[int]

    def to_message(self, comm: int | None = None, reply: int = ReplyCode.INVALID) -> Message:
        """Return the message; `comm` None is the type's usual kind of communication."""
        values = astuple(self)
        body = pack(f"<{len(values)}i", values)
        return Message(self.kind, self.comm if comm is None else comm, reply, body)

    @classmethod
    def of(cls, message: Message) -> Self:
        """Decode a message.

        Raises:
            WireError: another type or length.
        """
        return cls(*struct.unpack(f"<{len(fields(cls))}i", body_of(message, cls.kind)))


@dataclass(frozen=True)
class RobotStatusBody(_Numbers):
    """State of the robot: 1 yes, 0 no, -1 unknown; mode 1 teach, 2 play, -1 unknown."""

    kind: ClassVar[int] = MessageType.ROBOT_STATUS
    comm: ClassVar[int] = CommType.TOPIC

    drives_powered: int
    e_stopped: int
    error_code: int
    in_error: int
    in_motion: int
    mode: int
    motion_possible: int


@dataclass(frozen=True)
class ReadIo(_Numbers):
    """Read one input or output."""

    kind: ClassVar[int] = MessageType.READ_IO_BIT
    comm: ClassVar[int] = CommType.REQUEST

    address: int


@dataclass(frozen=True)
class ReadIoReply(_Numbers):
    """Value that was read; the result is an `IoResult`."""

    kind: ClassVar[int] = MessageType.READ_IO_BIT_REPLY
    comm: ClassVar[int] = CommType.REPLY

    value: int
    result: int


@dataclass(frozen=True)
class WriteIo(_Numbers):
    """Write one output, 0 or 1."""

    kind: ClassVar[int] = MessageType.WRITE_IO_BIT
    comm: ClassVar[int] = CommType.REQUEST

    address: int
    value: int


@dataclass(frozen=True)
class WriteIoReply(_Numbers):
    """Result of a write, an `IoResult`."""

    kind: ClassVar[int] = MessageType.WRITE_IO_BIT_REPLY
    comm: ClassVar[int] = CommType.REPLY

    result: int


@dataclass(frozen=True)
class ReadIoGroup(_Numbers):
    """Read eight inputs or outputs; the address is that of the bits divided by 10."""

    kind: ClassVar[int] = MessageType.READ_IO_GROUP
    comm: ClassVar[int] = CommType.REQUEST

    address: int


@dataclass(frozen=True)
class ReadIoGroupReply(_Numbers):
    """Value of eight bits, and an `IoResult`."""

    kind: ClassVar[int] = MessageType.READ_IO_GROUP_REPLY
    comm: ClassVar[int] = CommType.REPLY

    value: int
    result: int


@dataclass(frozen=True)
class WriteIoGroup(_Numbers):
    """Write eight outputs."""

    kind: ClassVar[int] = MessageType.WRITE_IO_GROUP
    comm: ClassVar[int] = CommType.REQUEST

    address: int
    value: int


@dataclass(frozen=True)
class WriteIoGroupReply(_Numbers):
    """Result of a group write, an `IoResult`."""

    kind: ClassVar[int] = MessageType.WRITE_IO_GROUP_REPLY
    comm: ClassVar[int] = CommType.REPLY

    result: int


@dataclass(frozen=True)
class IoReply(_Numbers):
    """Reply to a message that the I/O server does not accept."""

    kind: ClassVar[int] = MessageType.IO_CTRL_REPLY
    comm: ClassVar[int] = CommType.REPLY

    result: int
    subcode: int
