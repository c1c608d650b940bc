"""Digital inputs and outputs of the virtual controller."""

import struct

from unwrinkle.hardware.motoros.messages import (
    CommType,
    IoResult,
    Message,
    MessageType,
    ReadIo,
    ReadIoGroup,
    ReadIoGroupReply,
    ReadIoReply,
    ReplyCode,
    Result,
    Subcode,
    WireError,
    WriteIo,
    WriteIoGroup,
    WriteIoGroupReply,
    WriteIoReply,
)

# First and last addresses of a DX100; the last digit is a bit, 0 to 7.
_OUTPUTS = (10010, 12567)
_NETWORK_INPUTS = (25010, 27567)
_PANEL = (60010, 60647)
_WRITABLE = (_OUTPUTS, _NETWORK_INPUTS, _PANEL)
_READABLE = (
    *_WRITABLE,
    (10, 2567),
    (20010, 22567),
    (30010, 32567),
    (35010, 37567),
    (40010, 41607),
    (50010, 52007),
    (70010, 79997),
    (80010, 80647),
    (82010, 82207),
)


def _known(address: int, ranges: tuple[tuple[int, int], ...]) -> bool:
    return address % 10 <= 7 and any(low <= address <= high for low, high in ranges)


class InputsAndOutputs:
    """Digital inputs and outputs, and the replies of the I/O connection.

    Attributes:
        inputs, outputs: 0 or 1 by address; 0 if missing.
    """

    def __init__(self) -> None:
        """Begin with everything off."""
        self.inputs: dict[int, int] = {}
        self.outputs: dict[int, int] = {}

    def answer(self, message: Message) -> list[Message]:
        """Return the reply to a message."""
        try:
            if message.type == MessageType.READ_IO_BIT:
                return [self._read(ReadIo.of(message).address)]
            if message.type == MessageType.WRITE_IO_BIT:
                return [self._write(WriteIo.of(message))]
            if message.type == MessageType.READ_IO_GROUP:
                return [self._read_group(ReadIoGroup.of(message).address)]
            if message.type == MessageType.WRITE_IO_GROUP:
                return [self._write_group(WriteIoGroup.of(message))]
        except WireError:
            return [self.refusal(Subcode.INVALID_SIZE)]
        return [self.refusal(Subcode.INVALID_TYPE)]

    @staticmethod
    def refusal(subcode: int) -> Message:
        """Return the reply to bytes that are not a message: a motion reply by type and size, result
        and sub-code first.
        """
        body = struct.pack("<2i", Result.INVALID, subcode).ljust(60, b"\0")
        return Message(MessageType.MOTION_REPLY, CommType.REPLY, ReplyCode.SUCCESS, body)

    def _read(self, address: int) -> Message:
        if not _known(address, _READABLE):
            return ReadIoReply(0, IoResult.READ_ADDRESS).to_message(reply=ReplyCode.FAILURE)
        return ReadIoReply(self._value(address), IoResult.OK).to_message(reply=ReplyCode.SUCCESS)

    def _bits(self, address: int) -> dict[int, int]:
        return self.outputs if _known(address, (_OUTPUTS,)) else self.inputs

    def _value(self, address: int) -> int:
        return int(bool(self._bits(address).get(address, 0)))

    def _write(self, asked: WriteIo) -> Message:
        result = IoResult.OK
        if not _known(asked.address, _WRITABLE):
            result = IoResult.WRITE_ADDRESS
        elif asked.value not in (0, 1):
            result = IoResult.WRITE_VALUE
        else:
            self._bits(asked.address)[asked.address] = asked.value
        return WriteIoReply(result).to_message(reply=_code(result))

    def _read_group(self, group: int) -> Message:
        if not _known(10 * group, _READABLE):
            return ReadIoGroupReply(0, IoResult.READ_ADDRESS).to_message(reply=ReplyCode.FAILURE)
        value = sum(self._value(10 * group + bit) << bit for bit in range(8))
        return ReadIoGroupReply(value, IoResult.OK).to_message(reply=ReplyCode.SUCCESS)

    def _write_group(self, asked: WriteIoGroup) -> Message:
        result = IoResult.OK
        if not _known(10 * asked.address, _WRITABLE):
            result = IoResult.WRITE_ADDRESS
        elif not 0 <= asked.value <= 255:
            result = IoResult.WRITE_VALUE
        else:
            for bit in range(8):
                self._bits(10 * asked.address)[10 * asked.address + bit] = asked.value >> bit & 1
        return WriteIoGroupReply(result).to_message(reply=_code(result))


def _code(result: int) -> int:
    return ReplyCode.SUCCESS if result == IoResult.OK else ReplyCode.FAILURE
