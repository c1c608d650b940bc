"""The virtual grippers on a CAN bus answer byte for byte."""

from collections.abc import Iterator
from itertools import count

import can
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.simulation.devices.can_gripper import VirtualCanGrippers

_CHANNELS = count()


@pytest.fixture
def buses() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    channel = f"virtual grippers {next(_CHANNELS)}"
    with (
        can.Bus(interface="virtual", channel=channel) as near,
        can.Bus(interface="virtual", channel=channel) as far,
    ):
        yield near, far


def send(bus: can.BusABC, identifier: int, data: bytes) -> None:
    bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


def test_position_reply_is_as_the_protocol_says(buses: tuple[can.BusABC, can.BusABC]) -> None:
    near, far = buses
    grippers = VirtualCanGrippers(far, cloth=(False, False), steps=1000)
    grippers.poll(0.0)
    send(near, 0x201, b"\x02\x0f\xa0")  # to 40.00 %, big-endian
    grippers.poll(0.0)
    grippers.poll(1.0)
    send(near, 0x201, b"\x0d")
    grippers.poll(1.0)
    reply = near.recv(timeout=0.0)
    assert reply is not None
    assert reply.arbitration_id == 0x201
    assert bytes(reply.data) == b"\x0d\x0f\xa0\x01\x90\x02"
    assert grippers.positions == (4000.0, 0.0)


def test_it_says_that_it_moves_and_stops_at_cloth(buses: tuple[can.BusABC, can.BusABC]) -> None:
    near, far = buses
    grippers = VirtualCanGrippers(far, stroke_time=0.5, thickness=200)
    bits = []
    send(near, 0x200, b"\x13")
    for now in (0.0, 0.25, 0.6):
        send(near, 0x200, b"\x0d")
        grippers.poll(now)
        reply = near.recv(timeout=0.0)
        assert reply is not None
        bits.append(reply.data[5])
    assert bits == [0x22, 0x22, 0x02]
    assert grippers.positions == (0.0, 9800.0)
    send(near, 0x200, b"\x0f")
    send(near, 0x200, b"\x14")
    grippers.poll(0.7)
    grippers.poll(0.8)
    assert grippers.positions == (0.0, 9800.0)


def test_other_frames_move_nothing(buses: tuple[can.BusABC, can.BusABC]) -> None:
    near, far = buses
    grippers = VirtualCanGrippers(far)
    for identifier, data in (
        (0x202, b"\x13"),
        (0x401, b"\x13"),
        (0x201, b""),
        (0x201, b"\x02\x01"),
    ):
        send(near, identifier, data)
    grippers.poll(0.0)
    grippers.poll(5.0)
    assert grippers.positions == (0.0, 0.0)
    assert near.recv(timeout=0.0) is None


def test_unknown_faults_are_refused(buses: tuple[can.BusABC, can.BusABC]) -> None:
    with pytest.raises(InputError, match="'slow' is unknown"):
        VirtualCanGrippers(buses[1], faults=("slow",))
