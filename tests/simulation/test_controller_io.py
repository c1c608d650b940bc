"""The virtual controller's servos, inputs and outputs, unknown messages, and settings that cannot be."""

import numpy as np
import pytest

from unwrinkle.hardware.wire import (
    Command,
    CommType,
    IoReply,
    Message,
    MessageType,
    MotionControl,
    MotionReply,
    ReadIo,
    ReadIoGroup,
    ReadIoGroupReply,
    ReadIoReply,
    Result,
    Subcode,
    WriteIo,
    WriteIoGroup,
    WriteIoReply,
    ping,
)
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.virtual_controller import VirtualController, VirtualControllerSettings

LIMITS = (np.full(13, -2.0), np.full(13, 2.5), np.full(13, 3.0))


def make() -> VirtualController:
    return VirtualController(VirtualControllerSettings(), np.zeros(13), LIMITS)


def ask(controller: VirtualController, command: int, group: int = -1) -> tuple[int, int]:
    (reply,) = controller.handle_motion(MotionControl(group, 4, command).to_message())
    told = MotionReply.of(reply)
    return told.result, told.subcode


def test_servos_alarms_and_groups_of_commands() -> None:
    controller = make()
    assert ask(controller, Command.START_SERVOS) == (Result.SUCCESS, 0)
    assert controller.status.drives_powered == 1
    assert ask(controller, Command.STOP_SERVOS) == (Result.SUCCESS, 0)
    assert controller.status.drives_powered == 0
    controller.raise_alarm(1, lasting=True)
    assert ask(controller, Command.RESET_ALARM) == (Result.FAILURE, 0)
    assert ask(controller, Command.START_SERVOS) == (Result.NOT_READY, Subcode.NOT_READY_ALARM)
    assert not controller.servo
    controller.clear_alarm()
    assert ask(controller, Command.RESET_ALARM) == (Result.SUCCESS, 0)
    assert ask(controller, Command.CHECK_QUEUE_COUNT, 3) == (Result.INVALID, Subcode.INVALID_GROUP)
    assert ask(controller, 200199) == (Result.INVALID, Subcode.INVALID_COMMAND)
    assert ask(controller, Command.DISCONNECT) == (Result.SUCCESS, 0)


def test_unknown_messages_are_answered_as_such() -> None:
    controller = make()
    for kind in (MessageType.SELECT_TOOL, 77):
        (reply,) = controller.handle_motion(Message(kind, 2, 0, b"\0" * 12))
        told = MotionReply.of(reply)
        assert (told.group, told.sequence) == (-1, -1)
        assert (told.result, told.subcode) == (Result.INVALID, Subcode.INVALID_TYPE)
    (reply,) = controller.handle_motion(MotionControl(0, 0, 200101).to_message(comm=CommType.TOPIC))
    assert MotionReply.of(reply).subcode == Subcode.INVALID_HEADER
    assert controller.handle_motion(ping()) == [ping(CommType.REPLY, 1)]


def test_inputs_and_outputs() -> None:
    controller = make()

    def io(body: ReadIo | WriteIo | ReadIoGroup | WriteIoGroup) -> Message:
        (reply,) = controller.handle_io(body.to_message())
        return reply

    assert WriteIoReply.of(io(WriteIo(10011, 1))).result == 0
    assert ReadIoReply.of(io(ReadIo(10011))) == ReadIoReply(1, 0)
    assert ReadIoGroupReply.of(io(ReadIoGroup(1001))) == ReadIoGroupReply(2, 0)
    io(WriteIoGroup(1001, 0b101))
    assert controller.outputs[10010] == 1 and controller.outputs[10011] == 0
    controller.inputs[25012] = 1
    assert ReadIoReply.of(io(ReadIo(25012))) == ReadIoReply(1, 0)
    assert WriteIoReply.of(io(WriteIo(25012, 1))).result == 1002
    assert WriteIoReply.of(io(WriteIo(10018, 1))).result == 1002
    assert WriteIoReply.of(io(WriteIo(10010, 2))).result == 1003
    assert ReadIoReply.of(io(ReadIo(9))).result == 1001
    (reply,) = controller.handle_io(Message(MessageType.READ_M_REGISTER, 2, 0, b"\0" * 4))
    assert IoReply.of(reply) == IoReply(Result.INVALID, Subcode.INVALID_TYPE)


def test_settings_and_starts_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match="accepts 'x'"):
        VirtualControllerSettings(accepts="x")
    with pytest.raises(InputError, match="period"):
        VirtualControllerSettings(period=0.0)
    with pytest.raises(InputError, match="start needs 13"):
        VirtualController(VirtualControllerSettings(), np.zeros(12), LIMITS)
    with pytest.raises(InputError, match="mode 'x'"):
        make().set_mode("x")
