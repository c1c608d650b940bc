"""How the firmware cuts the bytes of one read into messages: by each type's size, not by the length
word.
"""

import struct
from dataclasses import dataclass

from unwrinkle.hardware.motoros.messages import Message, MessageType, Subcode
from unwrinkle.simulation.controllers.settings import Firmware

_HEADER = struct.Struct("<4i")
_SIZES = {
    MessageType.PING: 0,
    MessageType.ROBOT_STATUS: 28,
    MessageType.JOINT_TRAJ_PT_FULL: 136,
    MessageType.JOINT_FEEDBACK: 132,
    MessageType.MOTION_CTRL: 52,
    MessageType.MOTION_REPLY: 60,
    MessageType.JOINT_FEEDBACK_EX: 532,
    MessageType.READ_IO_BIT: 4,
    MessageType.WRITE_IO_BIT: 8,
    MessageType.READ_IO_GROUP: 4,
    MessageType.WRITE_IO_GROUP: 8,
    MessageType.GET_DH_PARAMETERS: 0,
    MessageType.SELECT_TOOL: 12,
}
#: Types that the firmware of 2013 knows.
_OLD = (
    MessageType.ROBOT_STATUS,
    MessageType.JOINT_TRAJ_PT_FULL,
    MessageType.JOINT_FEEDBACK,
    MessageType.MOTION_CTRL,
    MessageType.MOTION_REPLY,
)
#: Bytes of one group in a message for several groups.
_EX_BLOCK = 132
#: Group slots of such a message.
_EX_SLOTS = 4


@dataclass(frozen=True)
class Unread:
    """Bytes that are answered as invalid and dropped.

    Attributes:
        head: their first bytes, read as a header; the reply repeats some of it.
        subcode: of the reply.
        name: "size" or "type", for the record.
    """

    head: Message
    subcode: int
    name: str


def read_messages(data: bytes, firmware: str) -> list[Message | Unread]:
    """Return the messages of one read, in order.

    MotoROS 1.9.12 accepts complete messages that came together; a part of one is answered and
    dropped. The firmware of 2013 accepts a read that is exactly one message, and drops any other.
    """
    found: list[Message | Unread] = []
    while data:
        head = _head(data)
        size = _size(data, head) if len(data) >= _HEADER.size else None
        if firmware == Firmware.OF_2013:
            known = size is not None and head.type in _OLD
            whole = known and len(data) == size
            found.append(_message(data, head, len(data)) if whole else Unread(head, 0, "size"))
            return found
        if len(data) < _HEADER.size:
            found.append(Unread(head, Subcode.INVALID_SIZE, "size"))
            return found
        if size is None:
            found.append(Unread(head, Subcode.INVALID_TYPE, "type"))
            return found
        if len(data) < size:
            found.append(Unread(head, Subcode.INVALID_SIZE, "size"))
            return found
        full = _HEADER.size + 8 + _EX_BLOCK * _EX_SLOTS
        if head.type == MessageType.JOINT_TRAJ_PT_FULL_EX and len(data) == full:
            size = full  # four slots, used or not
        found.append(_message(data, head, size))
        data = data[size:]
    return found


def _head(data: bytes) -> Message:
    _, kind, comm, reply = _HEADER.unpack(data[: _HEADER.size].ljust(_HEADER.size, b"\0"))
    return Message(kind, comm, reply, data[_HEADER.size :])


def _message(data: bytes, head: Message, size: int) -> Message:
    return Message(head.type, head.comm, head.reply, data[_HEADER.size : size])


def _size(data: bytes, head: Message) -> int | None:
    """Return the size of the message that begins here, bytes, with its length word; None for an
    unknown type.
    """
    if head.type == MessageType.JOINT_TRAJ_PT_FULL_EX:
        count = struct.unpack_from("<i", data, _HEADER.size)[0] if len(data) >= 20 else _EX_SLOTS
        # An impossible count counts as an incomplete message.
        return _HEADER.size + 8 + _EX_BLOCK * (count if 0 <= count <= _EX_SLOTS else 1 << 20)
    try:
        return _HEADER.size + _SIZES[MessageType(head.type)]
    except (KeyError, ValueError):
        return None
