"""The virtual controller's servos, inputs and outputs, unknown messages, and settings that cannot
be.
"""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.hardware.motoros.messages import (
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
    ReplyCode,
    Result,
    Subcode,
    WriteIo,
    WriteIoGroup,
    WriteIoGroupReply,
    WriteIoReply,
    ping,
)
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import ControllerSite
from unwrinkle.simulation.controllers.controller import VirtualController, VirtualControllerSettings

pytestmark = pytest.mark.alone

LIMITS = (np.full(13, -2.0), np.full(13, 2.5), np.full(13, 3.0))


def make() -> VirtualController:
    return VirtualController(VirtualControllerSettings(), np.zeros(13), LIMITS)


def ask(controller: VirtualController, command: int, group: int = -1) -> tuple[int, int]:
    (reply,) = controller.handle_motion(MotionControl(group, 4, command).to_message())
    told = MotionReply.of(reply)
    return told.result, told.subcode


def io(
    controller: VirtualController, body: ReadIo | WriteIo | ReadIoGroup | WriteIoGroup
) -> Message:
    (reply,) = controller.handle_io(body.to_message())
    return reply


def test_servos_and_alarms() -> None:
    controller = make()
    assert ask(controller, Command.START_SERVOS) == (Result.SUCCESS, 0)
    assert controller.status.drives_powered == 1
    assert ask(controller, Command.STOP_SERVOS) == (Result.SUCCESS, 0)
    assert controller.status.drives_powered == 0
    controller.pendant.raise_alarm(1, lasting=True)
    assert ask(controller, Command.RESET_ALARM) == (Result.FAILURE, 0)
    assert ask(controller, Command.START_SERVOS) == (Result.FAILURE, 0)
    assert not controller.pendant.servo
    controller.pendant.clear_alarm()
    assert ask(controller, Command.RESET_ALARM) == (Result.SUCCESS, 0)


def test_unknown_types_are_answered_as_such() -> None:
    controller = make()
    (reply,) = controller.handle_motion(Message(77, 2, 0, b"\0" * 12))
    told = MotionReply.of(reply)
    assert (told.group, told.sequence, told.command) == (-1, -1, 77)
    assert (told.result, told.subcode) == (Result.INVALID, Subcode.INVALID_TYPE)
    assert reply.reply == ReplyCode.SUCCESS
    assert controller.handle_motion(ping()) == [ping(CommType.REPLY, 1)]


@pytest.mark.parametrize("comm", [CommType.TOPIC, 0, 9])
def test_the_kind_of_communication_is_not_looked_at(comm: int) -> None:
    controller = make()
    message = MotionControl(0, 3, Command.START_SERVOS).to_message(comm=comm)
    (reply,) = controller.handle_motion(message)
    assert MotionReply.of(reply).result == Result.SUCCESS and controller.pendant.servo


@pytest.mark.parametrize(
    "message",
    [ping(), Message(77, 2, 0, b""), MotionControl(0, 1, Command.STOP_MOTION).to_message()],
)
def test_the_port_for_inputs_and_outputs_knows_nothing_else(message: Message) -> None:
    (reply,) = make().handle_io(message)
    # Typed and sized as a motion reply, result and sub-code in front: 76 bytes.
    assert (reply.type, reply.comm, reply.reply) == (MessageType.MOTION_REPLY, 3, 1)
    assert len(reply.encode()) == 4 + 12 + 60
    assert reply.body[:8] == np.array([Result.INVALID, Subcode.INVALID_TYPE], "<i4").tobytes()
    assert IoReply(Result.INVALID, Subcode.INVALID_TYPE).to_message().body == reply.body[:8]


def test_bits_and_groups_are_written_and_read() -> None:
    controller = make()
    reply = io(controller, WriteIo(10011, 1))
    assert WriteIoReply.of(reply).result == 0 and reply.reply == ReplyCode.SUCCESS
    assert ReadIoReply.of(io(controller, ReadIo(10011))) == ReadIoReply(1, 0)
    assert ReadIoGroupReply.of(io(controller, ReadIoGroup(1001))) == ReadIoGroupReply(2, 0)
    assert WriteIoGroupReply.of(io(controller, WriteIoGroup(1001, 0b101))).result == 0
    assert [controller.outputs[10010 + bit] for bit in range(8)] == [1, 0, 1, 0, 0, 0, 0, 0]
    controller.inputs[25012] = 1
    assert ReadIoReply.of(io(controller, ReadIo(25012))) == ReadIoReply(1, 0)


@pytest.mark.parametrize(
    ("first", "last"),
    [
        (10, 2567),
        (10010, 12567),
        (20010, 22567),
        (25010, 27567),
        (30010, 32567),
        (35010, 37567),
        (40010, 41607),
        (50010, 52007),
        (60010, 60647),
        (70010, 79997),
        (80010, 80647),
        (82010, 82207),
    ],
)
def test_addresses_of_a_dx100(first: int, last: int) -> None:
    controller = make()
    writable = first in (10010, 25010, 60010)
    for address, good in ((first, True), (last, True), (first - 1, False), (last + 1, False)):
        reply = io(controller, ReadIo(address))
        assert ReadIoReply.of(reply) == ReadIoReply(0, 0 if good else 1001), address
        assert reply.reply == (ReplyCode.SUCCESS if good else ReplyCode.FAILURE)
        reply = io(controller, WriteIo(address, 1))
        written = good and writable
        assert WriteIoReply.of(reply).result == (0 if written else 1002), address
        assert ReadIoReply.of(io(controller, ReadIo(address))).value == int(written)
    assert ReadIoGroupReply.of(io(controller, ReadIoGroup(first // 10))).result == 0
    assert ReadIoGroupReply.of(io(controller, ReadIoGroup(last // 10 + 1))).result == 1001


def test_values_and_bits_that_cannot_be() -> None:
    controller = make()
    assert WriteIoReply.of(io(controller, WriteIo(10018, 1))).result == 1002
    assert WriteIoReply.of(io(controller, WriteIo(10018, 2))).result == 1002  # the address first
    assert WriteIoReply.of(io(controller, WriteIo(10010, 2))).result == 1003
    assert WriteIoReply.of(io(controller, WriteIo(10010, -1))).result == 1003
    assert WriteIoGroupReply.of(io(controller, WriteIoGroup(1001, 256))).result == 1003
    assert WriteIoGroupReply.of(io(controller, WriteIoGroup(1, 1))).result == 1002
    assert not controller.outputs and not controller.inputs


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"accepts": "x"}, "accepts 'x'"),
        ({"firmware": "1.0"}, "firmware '1.0'"),
        ({"period": 0.0}, "period must be positive"),
        ({"period": 0.0045}, "whole milliseconds"),
        ({"speed_cap": 0.0}, "speed_cap"),
        ({"delay": -0.1}, "delay is -0.1"),
        ({"delay": np.nan}, "delay is nan"),
        ({"moved": ("r1", "r3")}, "unknown groups: r3"),
        ({"pulses_per_radian": (1.0,) * 6}, "needs 7 positive"),
        ({"pulses_per_radian": (0.0,) * 7}, "needs 7 positive"),
        ({"depth": 0}, "depth and keep"),
    ],
)
def test_settings_that_cannot_be_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        dc.replace(VirtualControllerSettings(), **changes)


def test_settings_are_those_of_a_site() -> None:
    site = ControllerSite()
    site.profile, site.groups_moved, site.speed_cap = "ex", ["r1", "r2"], 0.3
    site.start_pulses = 10.0
    settings = VirtualControllerSettings.of_site(site)
    assert (settings.accepts, settings.moved, settings.speed_cap) == ("ex", ("r1", "r2"), 0.3)
    assert settings.start_pulses == 10.0
    assert settings.pulses_per_radian == tuple(site.pulses_per_radian)


def test_starts_and_keys_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match="start needs 13"):
        VirtualController(VirtualControllerSettings(), np.zeros(12), LIMITS)
    with pytest.raises(InputError, match="lower needs 13"):
        VirtualController(VirtualControllerSettings(), np.zeros(13), (np.nan, *LIMITS[1:]))
    with pytest.raises(InputError, match="mode 'x'"):
        make().pendant.set_mode("x")
