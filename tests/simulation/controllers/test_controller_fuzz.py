"""Ten thousand seeded streams of bytes into the server's three ports.

No crash, nothing obeyed that is no message.
"""

import gc
import itertools
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.motoros.messages import (
    Command,
    GroupPoint,
    Message,
    MessageType,
    MotionControl,
    MultiPoint,
    ReadIo,
    ReadIoGroup,
    RobotStatusBody,
    TrajectoryPoint,
    WriteIo,
    WriteIoGroup,
    ping,
)
from unwrinkle.simulation.controllers.controller import (
    GROUP_AXES,
    VirtualController,
    VirtualControllerSettings,
)
from unwrinkle.simulation.controllers.reads import read_messages

pytestmark = pytest.mark.alone

VELOCITY = 3.0
PORTS = ("motion", "state", "io")
Client = Any
Maker = Callable[..., Client]


def _point(random: np.random.Generator, here: np.ndarray, group: int, sequence: int) -> GroupPoint:
    """A point that may be good, may be far away, too fast or too early; the axes stand `here`."""
    axes = GROUP_AXES[group % 3]
    size = random.choice([len(axes), 1, 10], p=[0.9, 0.05, 0.05])
    scale = random.choice([0.0, 1e-3, 0.1, 10.0], p=[0.6, 0.2, 0.1, 0.1])
    q, v = (random.normal(0.0, s, size) for s in (scale, random.choice([0.0, 0.3, 9.0])))
    q = (*(here[list(axes)] + q[: len(axes)])[:size], *q[len(axes) :])
    time = (
        None
        if random.random() < 0.05
        else float(random.choice([0.1 * sequence, 0.0, 2e4], p=[0.8, 0.1, 0.1]))
    )
    return GroupPoint(group, time, tuple(q), tuple(v))


def _valid(random: np.random.Generator, here: np.ndarray) -> Message:
    """A valid message of any type, not always for this port."""
    group = int(random.choice([-1, 0, 1, 2, 3], p=[0.05, 0.3, 0.3, 0.3, 0.05]))
    sequence = int(random.choice([0, 0, 1, 2, 3, -1]))
    match int(random.integers(0, 9)):
        case 0 | 1 | 2:
            p = _point(random, here, group, sequence)
            return TrajectoryPoint(group, sequence, p.time, p.positions, p.velocities).to_message()
        case 3:
            groups = tuple(
                _point(random, here, g, sequence) for g in range(int(random.integers(1, 5)))
            )
            return MultiPoint(sequence, groups).to_message(four_slots=bool(random.integers(0, 2)))
        case 4:
            codes = [int(code) for code in Command if code != Command.DISCONNECT]
            return MotionControl(group, 1, int(random.choice([*codes, 0, -5]))).to_message()
        case 5:
            address = int(random.choice([10010, 25010, 0, -1, 2**31 - 1]))
            body = (ReadIo(address), WriteIo(address, 1), ReadIoGroup(address), ping())
            chosen = body[int(random.integers(0, 4))]
            return chosen if isinstance(chosen, Message) else chosen.to_message()
        case 6:
            return WriteIoGroup(int(random.integers(0, 2000)), 255).to_message()
        case 7:
            return RobotStatusBody(1, 1, 1, 1, 1, 1, 1).to_message()
    kind = int(random.choice([2012, 2013, 2018, 2020, 3000, 7]))
    size = 4 if kind in (2012, 2013) else 12
    return Message(kind, int(random.integers(1, 4)), 0, random.bytes(size))


def _stream(random: np.random.Generator, kind: int, here: np.ndarray) -> bytes:
    if kind == 0:
        return random.bytes(int(random.integers(1, 200)))
    data = bytearray(
        b"".join(_valid(random, here).encode() for _ in range(int(random.integers(1, 5))))
    )
    if kind == 1:
        for place in random.integers(0, len(data), int(random.integers(1, 5))):
            data[place] = random.integers(0, 256)
    elif kind == 2:
        data += random.bytes(40)
    return bytes(data)


def _send(client: Client, name: str, data: bytes, cuts: list[int]) -> None:
    """Send a stream in pieces with polls between; connect anew where the server has hung up."""
    if not client.server.links[name] or client.links[name].closed:
        client.links[name].close()
        client.connect(name)
        client.server.poll(client.now)
    edges = [0, *sorted(cut % len(data) for cut in cuts), len(data)]
    for begin, end in itertools.pairwise(edges):
        client.links[name].send(data[begin:end])
        client.poll(0.004)
    client.links[name].receive()
    client.links["state"].receive()


def _check(controller: VirtualController) -> None:
    """What was taken is no more than the firmware takes, and what is told of it can be sent.

    Positions, the speed between points, times that go back and numbers that are not finite are
    taken by a real controller too. A speed whose whole rad/s are above the limit is not, nor are
    joints of another group.
    """
    for points, axes in zip(controller.received, GROUP_AXES, strict=True):
        for point in points:
            assert len(point.positions) == len(point.velocities) == len(axes)
            assert not (np.trunc(np.abs(point.velocities)) > VELOCITY).any()
        points.clear()
    assert len(controller.audit.findings) <= 1000
    for _, q, v in controller.trace:
        assert np.isfinite(q).all() and np.isfinite(v).all()
    controller.trace.clear()
    for message in controller.feedback():
        message.encode()


@pytest.mark.slow
@pytest.mark.parametrize("firmware", ["1.9.12", "2013"])
@pytest.mark.parametrize("name", PORTS)
def test_ten_thousand_streams_of_garbage(
    controller_client: Maker, name: str, firmware: str
) -> None:
    client = controller_client(keep=2000, servo_time=0.0, job_time=0.004, firmware=firmware)
    client.start()
    random = np.random.default_rng(PORTS.index(name))
    accepted = 0
    controller = client.controller
    for number in range(1700):
        if name == "motion":
            controller.pendant.servo = controller.pendant.trajectory_mode = True
            controller.pendant.clear_alarm()
        _send(
            client,
            name,
            _stream(random, number % 4, controller.positions),
            list(random.integers(0, 10**6, number % 3)),
        )
        if number % 50 == 0:
            accepted += sum(map(len, controller.received))
            _check(controller)
    _check(controller)
    rejected = {reason for port, reason in client.server.rejected if port == name}
    if name == "state":  # of which nothing is read
        assert not client.server.rejected
    else:
        assert rejected >= ({"size"} if firmware == "2013" else {"size", "type"})
        assert {port for port, _ in client.server.rejected} == {name}
    assert accepted > 50 if name == "motion" else accepted == 0, accepted
    if name != "motion":
        assert not controller.positions.any()


def test_random_bytes_move_nothing(controller_client: Maker) -> None:
    for firmware in ("1.9.12", "2013"):
        client = controller_client(servo_time=0.0, job_time=0.004, firmware=firmware)
        client.start()
        assert client.move(0) == [(0, 0)] * 3
        random = np.random.default_rng(8)
        for number in range(300):
            # Every second one is long enough, and says that it is a point.
            kind = int(random.choice([14, 2001, 2016]))
            head = np.array([int(random.integers(0, 600)), kind], "<i4").tobytes()
            data = random.bytes(160) if number % 2 else head + random.bytes(144)
            _send(client, "motion", data, [number] if number % 3 == 0 else [])
        assert [len(points) for points in client.controller.received] == [1, 1, 1]
        assert not client.controller.positions.any() and not client.controller.moving
        assert client.controller.pendant.trajectory_mode and len(client.server.motion) == 1


def test_what_is_taken_of_a_damaged_point_is_what_its_bytes_say() -> None:
    random = np.random.default_rng(11)
    settings = VirtualControllerSettings(servo_time=0.0, job_time=0.0)
    limits = (np.full(13, -2.0), np.full(13, 2.5), np.full(13, VELOCITY))
    first = TrajectoryPoint(1, 0, 4e-4, (0.0,) * 6, (0.0,) * 6).to_message()
    good = TrajectoryPoint(1, 1, 0.0204, (0.1,) * 6, (0.2,) * 6).to_message().encode()
    taken = 0
    for _ in range(400):
        controller = VirtualController(settings, np.zeros(13), limits)
        controller.handle_motion(MotionControl(-1, 0, Command.START_TRAJ_MODE).to_message())
        controller.advance()
        controller.handle_motion(first)
        data = bytearray(good)
        data[int(random.integers(0, len(data)))] ^= 1 << int(random.integers(0, 8))
        for message in read_messages(bytes(data), "1.9.12"):
            controller.handle_motion(message)
        for _ in range(10):
            controller.advance()
        group = int.from_bytes(data[16:20], "little")
        found = [list(points) for points in controller.received]
        del found[1][0]
        assert not any(points for number, points in enumerate(found) if number != group)
        for point in itertools.chain(*found):
            taken += 1
            assert data[4:8] == good[4:8] and point.sequence > 0
            said, size = np.frombuffer(data[16 + 16 :], "<f4"), len(GROUP_AXES[group])
            np.testing.assert_array_equal(point.positions, said[:size])
            np.testing.assert_array_equal(point.velocities, said[10 : 10 + size])
        _check(controller)
    assert 200 < taken < 400  # most single bits are not seen by the firmware


def test_garbage_fills_no_memory(controller_client: Maker) -> None:
    client = controller_client(keep=5)
    client.start()
    random = np.random.default_rng(9)
    sizes = []
    tracemalloc.start()
    try:
        for number in range(600):
            port = PORTS[number % 3]
            _send(client, port, _stream(random, number % 4, client.controller.positions), [number])
            if number % 2 == 0:  # a message that never becomes whole
                client.links[port].send(np.array([1000, 3000, 2, 0], "<i4").tobytes())
            if number in (200, 599):
                client.server.events.clear()  # these two hold a thousand each
                client.server.rejected.clear()
                gc.collect()
                sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert sizes[1] - sizes[0] < 40_000
    assert len(client.controller.messages) <= 5


def test_unknown_types_are_answered_not_obeyed(controller_client: Maker) -> None:
    client = controller_client()
    for kind in (0, 3, 999, 65535):
        (reply,) = client.ask(Message(kind, 2, 0, b"\1" * 100))
        assert reply.type == MessageType.MOTION_REPLY
    assert list(client.server.rejected) == [("motion", "type")] * 4
    assert len(client.server.motion) == 1
