"""Faults of the virtual controller's replies and of its pendant."""

from collections.abc import Callable

from unwrinkle.hardware.motoros.messages import (
    Command,
    IoResult,
    Message,
    MessageType,
    MotionControl,
    MotionReply,
    MultiPoint,
    ReadIo,
    ReadIoReply,
    ReplyCode,
    Result,
    Subcode,
    TrajectoryPoint,
    WireError,
    WriteIo,
    WriteIoReply,
)
from unwrinkle.simulation.controllers.faults.kinds import Faults, ServerFault
from unwrinkle.simulation.controllers.pendant import Pendant, PendantMode

#: First and last address of network inputs.
_NETWORK_INPUTS = (25010, 27567)


def motion_fault(faults: Faults, message: Message) -> list[Message]:
    """Return the replies of a fault on the motion connection in place of the controller's; empty if
    there is none.
    """
    if not faults.any_of("busy", "not_ready", "start_mismatch"):
        return []
    try:
        if message.type == MessageType.MOTION_CTRL:
            asked = MotionControl.of(message)
            group, sequence, command = asked.group, asked.sequence, asked.command
        elif message.type == MessageType.JOINT_TRAJ_PT_FULL:
            point = TrajectoryPoint.of(message)
            group, sequence, command = point.group, point.sequence, message.type
        elif message.type == MessageType.JOINT_TRAJ_PT_FULL_EX:
            group, sequence, command = -1, MultiPoint.of(message).sequence, message.type
        else:
            return []
    except WireError:
        return []
    is_point = message.type != MessageType.MOTION_CTRL
    checks = (Command.START_TRAJ_MODE, Command.CHECK_MOTION_READY)
    result, subcode = -1, 0
    if is_point and faults.any_of("busy"):
        result = Result.BUSY
    elif (fault := faults.any_of("not_ready")) and (is_point or command in checks):
        ready = command == Command.CHECK_MOTION_READY
        result = Result.FAILURE if ready else Result.NOT_READY
        subcode = int(fault.value) or Subcode.NOT_READY_UNSPECIFIED
    elif is_point and sequence == 0 and faults.any_of("start_mismatch"):
        result, subcode = Result.INVALID, Subcode.INVALID_START
    if result < 0:
        return []
    answer = MotionReply(group, sequence, command, result, subcode)
    return [answer.to_message(reply=ReplyCode.SUCCESS)]


def io_fault(faults: Faults, message: Message) -> list[Message]:
    """Return the replies of a fault on the I/O connection in place of the controller's; empty if
    there is none.
    """
    try:
        if message.type == MessageType.WRITE_IO_BIT and faults.any_of("lost_outputs"):
            WriteIo.of(message)
            return [WriteIoReply(IoResult.OK).to_message(reply=ReplyCode.SUCCESS)]
        if message.type == MessageType.READ_IO_BIT and faults.any_of("no_close"):
            low, high = _NETWORK_INPUTS
            if low <= ReadIo.of(message).address <= high:
                return [ReadIoReply(0, IoResult.OK).to_message(reply=ReplyCode.SUCCESS)]
    except WireError:
        pass
    return []


def with_wrong_sequence(reply: Message) -> Message:
    """Return a motion reply with another sequence number."""
    original = MotionReply.of(reply)
    wrong = MotionReply(
        original.group,
        original.sequence + 7,
        original.command,
        original.result,
        original.subcode,
        original.data,
    )
    return wrong.to_message(reply=reply.reply)


_BEGIN: dict[str, Callable[[Pendant, ServerFault], None]] = {
    "e_stop": lambda pendant, _: pendant.press_e_stop(),
    "e_stop_released": lambda pendant, _: pendant.press_e_stop(),
    "teach": lambda pendant, _: pendant.set_mode(PendantMode.TEACH),
    "remote_off": lambda pendant, _: pendant.set_remote(False),
    "servo_off": lambda pendant, _: pendant.switch_servo_off(),
    "alarm": lambda pendant, fault: pendant.raise_alarm(int(fault.value) or 4000, lasting=True),
    "hold": lambda pendant, _: pendant.press_hold(),
}
_END: dict[str, Callable[[Pendant], None]] = {
    "e_stop": lambda pendant: pendant.release_e_stop(),
    "teach": lambda pendant: pendant.set_mode(PendantMode.PLAY),
    "remote_off": lambda pendant: pendant.set_remote(True),
    "alarm": lambda pendant: pendant.clear_alarm(),
    "hold": lambda pendant: pendant.release_hold(),
}


def begin_on_pendant(pendant: Pendant, fault: ServerFault) -> None:
    """Apply the begin of a fault to the pendant."""
    if fault.kind in _BEGIN:
        _BEGIN[fault.kind](pendant, fault)


def end_on_pendant(pendant: Pendant, fault: ServerFault) -> None:
    """Apply the end of a fault to the pendant."""
    if fault.kind in _END:
        _END[fault.kind](pendant)
