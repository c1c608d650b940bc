"""The robot controller's messages: ROS-Industrial simple_message with Motoman's extensions.

A message consists of its length (of what follows), type, kind of communication and reply code, each
a little-endian int32, and a body of int32 and float32. Joints always fill ten slots; rad, rad/s, s.
Decoded numbers may be not finite; encoding refuses those. Every name of the protocol can be
imported from here.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeAlias

from unwrinkle.hardware.motoros.codes import (
    IO_RESULTS,
    SUBCODES,
    Command,
    CommType,
    IoResult,
    MessageType,
    ReplyCode,
    Result,
    Subcode,
    describe,
)
from unwrinkle.hardware.motoros.frames import Framer, Message, WireError, body_of, pack, ping
from unwrinkle.hardware.motoros.numbers import (
    IoReply,
    ReadIo,
    ReadIoGroup,
    ReadIoGroupReply,
    ReadIoReply,
    RobotStatusBody,
    WriteIo,
    WriteIoGroup,
    WriteIoGroupReply,
    WriteIoReply,
)

__all__ = [
    "FEEDBACK_SLOTS",
    "IO_RESULTS",
    "SLOTS",
    "SUBCODES",
    "CommType",
    "Command",
    "FeedbackBody",
    "Framer",
    "GroupPoint",
    "IoReply",
    "IoResult",
    "Joints",
    "Message",
    "MessageType",
    "MotionControl",
    "MotionReply",
    "MultiFeedback",
    "MultiPoint",
    "ReadIo",
    "ReadIoGroup",
    "ReadIoGroupReply",
    "ReadIoReply",
    "ReplyCode",
    "Result",
    "RobotStatusBody",
    "Subcode",
    "TrajectoryPoint",
    "WireError",
    "WriteIo",
    "WriteIoGroup",
    "WriteIoGroupReply",
    "WriteIoReply",
    "describe",
    "ping",
]

#: Joint slots of a group in a message; slots without a joint are 0.
SLOTS = 10
#: Group slots of a MultiFeedback, whether used or not.
FEEDBACK_SLOTS = 4
#: Values of the joints of one group, (10,).
Joints: TypeAlias = tuple[float, ...]

_ZEROS: Joints = (0.0,) * SLOTS
_TIME, _POSITION, _VELOCITY, _ACCELERATION = 1, 2, 4, 8
_BLOCK = "2i31f"  # group, valid fields, time, three times ten joints
_BLOCK_SIZE = 132


def _slots(values: Sequence[float] | None) -> Joints | None:
    """Return ten numbers, 0 for the joints that are missing."""
    if values is None:
        return None
    if len(values) > SLOTS:
        raise WireError("body", f"{len(values)} joints in a group; a message holds {SLOTS}")
    return tuple(map(float, values)) + (0.0,) * (SLOTS - len(values))


def _fields(time: float | None, *joints: Joints | None) -> tuple[int, tuple[float, ...]]:
    """Return the bits of the fields that are given, and the numbers of all fields."""
    valid = sum(1 << bit for bit, value in enumerate((time, *joints)) if value is not None)
    numbers: tuple[float, ...] = (0.0 if time is None else time,)
    for values in joints:
        numbers += _ZEROS if values is None else values
    return valid, numbers


def _read_fields(
    valid: int, numbers: tuple[float, ...]
) -> tuple[float | None, Joints | None, Joints | None, Joints | None]:
    """Return time, positions, velocities and accelerations; None where the bit is not set."""
    if not 0 <= valid <= 15:
        raise WireError("valid", f"the bits {valid} of valid fields; 0 to 15 have a meaning")
    return (
        numbers[0] if valid & _TIME else None,
        numbers[1:11] if valid & _POSITION else None,
        numbers[11:21] if valid & _VELOCITY else None,
        numbers[21:31] if valid & _ACCELERATION else None,
    )


@dataclass(frozen=True)
class _Joints:
    """Joint values of one group; a field that is not given is None.

    Attributes:
        group: number of the control group.
        time: s.
        positions, velocities, accelerations: (10,) rad, rad/s, rad/s^2; fewer are filled up with 0.
    """

    group: int
    time: float | None
    positions: Joints | None
    velocities: Joints | None = None
    accelerations: Joints | None = None

    def __post_init__(self) -> None:
        """Fill up to ten joint slots."""
        for name in ("positions", "velocities", "accelerations"):
            object.__setattr__(self, name, _slots(getattr(self, name)))

    @property
    def valid(self) -> int:
        """Bits of the fields that are given: 1 time, 2 positions, 4 velocities, 8 accelerations."""
        return _fields(self.time, self.positions, self.velocities, self.accelerations)[0]

    def block(self) -> bytes:
        """Return the group's 132 bytes."""
        valid, numbers = _fields(self.time, self.positions, self.velocities, self.accelerations)
        return pack("<" + _BLOCK, (self.group, valid), numbers)

    @classmethod
    def of_block(cls, block: bytes) -> Self:
        """Decode a group's 132 bytes."""
        group, valid, *numbers = struct.unpack("<" + _BLOCK, block)
        return cls(group, *_read_fields(valid, tuple(numbers)))


@dataclass(frozen=True)
class GroupPoint(_Joints):
    """Trajectory point of one group; its time counts from the trajectory's begin."""


@dataclass(frozen=True)
class FeedbackBody(_Joints):
    """Measured joints of one group; the time is the controller's clock."""

    def to_message(self, comm: int = CommType.TOPIC, reply: int = ReplyCode.INVALID) -> Message:
        """Return the message."""
        return Message(MessageType.JOINT_FEEDBACK, comm, reply, self.block())

    @classmethod
    def of(cls, message: Message) -> Self:
        """Decode a message.

        Raises:
            WireError: another type or length, or unknown fields.
        """
        return cls.of_block(body_of(message, MessageType.JOINT_FEEDBACK))


@dataclass(frozen=True)
class TrajectoryPoint:
    """Trajectory point of one group in a message of its own.

    Attributes:
        group: number of the control group.
        sequence: 0 for a trajectory's first point, then 1, 2, ...
        time: from the trajectory's begin, s; this and the joints are None where not given.
        positions, velocities, accelerations: (10,) rad, rad/s, rad/s^2; fewer are filled up with 0.
    """

    group: int
    sequence: int
    time: float | None
    positions: Joints | None
    velocities: Joints | None
    accelerations: Joints | None = None

    def __post_init__(self) -> None:
        """Fill up to ten joint slots."""
        for name in ("positions", "velocities", "accelerations"):
            object.__setattr__(self, name, _slots(getattr(self, name)))

    @property
    def point(self) -> GroupPoint:
        """The group's point without its sequence number."""
        return GroupPoint(
            self.group, self.time, self.positions, self.velocities, self.accelerations
        )

    @property
    def valid(self) -> int:
        """Bits of the fields that are given: 1 time, 2 positions, 4 velocities, 8 accelerations."""
        return self.point.valid

    def to_message(self, comm: int = CommType.REQUEST, reply: int = ReplyCode.INVALID) -> Message:
        """Return the message."""
        block = self.point.block()
        body = block[:4] + pack("<i", (self.sequence,)) + block[4:]
        return Message(MessageType.JOINT_TRAJ_PT_FULL, comm, reply, body)

    @classmethod
    def of(cls, message: Message) -> Self:
        """Decode a message.

        Raises:
            WireError: another type or length, or unknown fields.
        """
        body = body_of(message, MessageType.JOINT_TRAJ_PT_FULL)
        group, sequence, valid, *numbers = struct.unpack("<3i31f", body)
        return cls(group, sequence, *_read_fields(valid, tuple(numbers)))


@dataclass(frozen=True)
class MultiPoint:
    """Trajectory point of several groups in one message.

    Attributes:
        sequence: 0 for a trajectory's first point, then 1, 2, ...
        groups: 1 to 4.
    """

    sequence: int
    groups: tuple[GroupPoint, ...]

    def to_message(
        self,
        comm: int = CommType.REQUEST,
        reply: int = ReplyCode.INVALID,
        *,
        four_slots: bool = False,
    ) -> Message:
        """Return the message; with `four_slots` its body always has four group slots."""
        body = _count(len(self.groups)) + pack("<i", (self.sequence,))
        body += b"".join(group.block() for group in self.groups)
        if four_slots:
            body = body.ljust(8 + FEEDBACK_SLOTS * _BLOCK_SIZE, b"\0")
        return Message(MessageType.JOINT_TRAJ_PT_FULL_EX, comm, reply, body)

    @classmethod
    def of(cls, message: Message) -> Self:
        """Decode a message.

        Raises:
            WireError: another type or length, or an impossible number of groups.
        """
        body = body_of(message, MessageType.JOINT_TRAJ_PT_FULL_EX)
        count, sequence = struct.unpack_from("<2i", body)
        if len(body) not in (8 + _BLOCK_SIZE * count, 8 + _BLOCK_SIZE * FEEDBACK_SLOTS):
            raise WireError("groups", f"{count} groups in a body of {len(body)} bytes")
        return cls(sequence, tuple(map(GroupPoint.of_block, _blocks(body, 8, count))))


@dataclass(frozen=True)
class MultiFeedback:
    """Measured joints of all groups; four slots on the wire, unused ones are 0."""

    groups: tuple[FeedbackBody, ...]

    def to_message(self, comm: int = CommType.TOPIC, reply: int = ReplyCode.INVALID) -> Message:
        """Return the message."""
        body = _count(len(self.groups)) + b"".join(group.block() for group in self.groups)
        body = body.ljust(4 + FEEDBACK_SLOTS * _BLOCK_SIZE, b"\0")
        return Message(MessageType.JOINT_FEEDBACK_EX, comm, reply, body)

    @classmethod
    def of(cls, message: Message) -> Self:
        """Decode a message.

        Raises:
            WireError: another type or length, or an impossible number of groups.
        """
        body = body_of(message, MessageType.JOINT_FEEDBACK_EX)
        (count,) = struct.unpack_from("<i", body)
        return cls(tuple(map(FeedbackBody.of_block, _blocks(body, 4, count))))


def _count(count: int) -> bytes:
    if not 1 <= count <= FEEDBACK_SLOTS:
        raise WireError("groups", f"{count} groups; a message holds 1 to {FEEDBACK_SLOTS}")
    return pack("<i", (count,))


def _blocks(body: bytes, start: int, count: int) -> list[bytes]:
    _count(count)
    return [
        body[k : k + _BLOCK_SIZE] for k in range(start, start + count * _BLOCK_SIZE, _BLOCK_SIZE)
    ]


@dataclass(frozen=True)
class MotionControl:
    """Command to the motion server.

    Attributes:
        group: number of the control group, -1 for all.
        sequence: the sender's own; the reply repeats it.
        command: a `Command`.
        data: (10,) numbers that go with it.
    """

    group: int
    sequence: int
    command: int
    data: Joints = _ZEROS

    def __post_init__(self) -> None:
        """Fill up to ten numbers."""
        object.__setattr__(self, "data", _slots(self.data))

    def to_message(self, comm: int = CommType.REQUEST, reply: int = ReplyCode.INVALID) -> Message:
        """Return the message."""
        body = pack("<3i10f", (self.group, self.sequence, self.command), self.data)
        return Message(MessageType.MOTION_CTRL, comm, reply, body)

    @classmethod
    def of(cls, message: Message) -> Self:
        """Decode a message.

        Raises:
            WireError: another type or length.
        """
        body = body_of(message, MessageType.MOTION_CTRL)
        group, sequence, command, *data = struct.unpack("<3i10f", body)
        return cls(group, sequence, command, tuple(data))


@dataclass(frozen=True)
class MotionReply:
    """Reply to a command or a trajectory point; see `describe`.

    Attributes:
        group, sequence: of the request; -1 for a request of an unknown type.
        command: the `Command` of the request, or the `MessageType` of the point.
        result: a `Result`.
        subcode: a `Subcode`, or a count.
        data: (10,) numbers that go with it.
    """

    group: int
    sequence: int
    command: int
    result: int
    subcode: int = 0
    data: Joints = _ZEROS

    def __post_init__(self) -> None:
        """Fill up to ten numbers."""
        object.__setattr__(self, "data", _slots(self.data))

    def to_message(self, comm: int = CommType.REPLY, reply: int = ReplyCode.SUCCESS) -> Message:
        """Return the message."""
        integers = (self.group, self.sequence, self.command, self.result, self.subcode)
        return Message(MessageType.MOTION_REPLY, comm, reply, pack("<5i10f", integers, self.data))

    @classmethod
    def of(cls, message: Message) -> Self:
        """Decode a message.

        Raises:
            WireError: another type or length.
        """
        body = body_of(message, MessageType.MOTION_REPLY)
        group, sequence, command, result, subcode, *data = struct.unpack("<5i10f", body)
        return cls(group, sequence, command, result, subcode, tuple(data))
