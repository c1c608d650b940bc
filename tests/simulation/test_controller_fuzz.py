"""Ten thousand seeded streams of bytes into the server's three ports: no crash, nothing obeyed that cannot be."""

import gc
import itertools
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.wire import (
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
from unwrinkle.simulation.virtual_controller import GROUP_AXES, VirtualController

LOWER, UPPER, VELOCITY = -2.0, 2.5, 3.0
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
    """Nothing was taken that a robot must not run."""
    for points, axes in zip(controller.received, GROUP_AXES, strict=True):
        for point in points:
            numbers = np.array([point.time, *point.positions, *point.velocities])
            assert np.isfinite(numbers).all() and 0.0 <= point.time < 14400.0
            assert len(point.positions) == len(axes)
            assert min(point.positions) >= LOWER - 1e-4 and max(point.positions) <= UPPER + 1e-4
            assert max(map(abs, point.velocities)) <= VELOCITY * 1.011
        points.clear()
    before = None
    for _, q, v in controller.trace:
        assert np.isfinite(q).all() and (q >= LOWER - 0.5).all() and (q <= UPPER + 0.5).all()
        assert (np.abs(v) <= VELOCITY * 1.011).all()
        # No jump: a period's way, and the 30 pulses that a first point may be off.
        assert before is None or np.abs(q - before).max() <= VELOCITY * 0.004 * 1.02 + 1.1e-3
        before = q
    controller.trace.clear()


@pytest.mark.slow
@pytest.mark.parametrize("name", PORTS)
def test_ten_thousand_streams_of_garbage(controller_client: Maker, name: str) -> None:
    client = controller_client(keep=2000, servo_time=0.0, job_time=0.004)
    client.start()
    random = np.random.default_rng(PORTS.index(name))
    accepted = 0
    for number in range(3400):
        controller = client.controller
        if name == "motion":
            controller.servo = controller.trajectory_mode = True
            controller.clear_alarm()
        _send(
            client,
            name,
            _stream(random, number % 4, client.controller.positions),
            list(random.integers(0, 10**6, number % 3)),
        )
        if number % 50 == 0:
            accepted += sum(map(len, controller.received))
            _check(controller)
    _check(client.controller)
    rejected = {reason for port, reason in client.server.rejected if port == name}
    assert rejected >= {"length", "type", "comm"}
    assert {port for port, _ in client.server.rejected} == {name}
    assert accepted > 100 if name == "motion" else accepted == 0, accepted
    if name != "motion":
        assert not client.controller.positions.any()


def test_random_bytes_move_nothing(controller_client: Maker) -> None:
    client = controller_client(servo_time=0.0, job_time=0.004)
    client.start()
    assert client.move(0) == [(0, 0)] * 3
    random = np.random.default_rng(8)
    for number in range(300):
        head = np.array([int(random.integers(0, 600)), 14], "<i4").tobytes()
        data = random.bytes(160) if number % 2 else head + random.bytes(160)
        _send(client, "motion", data, [number])
    assert [len(points) for points in client.controller.received] == [1, 1, 1]
    assert not client.controller.positions.any() and not client.controller.moving


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
    assert client.server.motion and not client.server.rejected
