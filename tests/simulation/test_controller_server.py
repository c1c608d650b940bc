"""The virtual controller on real sockets: connections, timing, garbage, and every fault that it commits."""

import socket
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.wire import (
    Command,
    FeedbackBody,
    Framer,
    Message,
    MotionControl,
    MotionReply,
    ReadIo,
)
from unwrinkle.models.errors import HardwareError
from unwrinkle.simulation.controller_server import ControllerServer, ServerFault

READY = MotionControl(-1, 5, Command.CHECK_MOTION_READY).to_message()
Client = Any
Maker = Callable[..., Client]


def _stamps(messages: list[Message]) -> list[float]:
    return [FeedbackBody.of(m).time or 0.0 for m in messages if m.type == 15][::3]


# ---------------------------------------------------------------- connections


def test_feedback_comes_every_25_ms_and_never_in_a_burst(controller_client: Maker) -> None:
    client = controller_client()
    assert [m.type for m in client.read("state")] == [15, 15, 15, 2017, 13]
    count = 0
    for _ in range(250):
        client.poll(0.004)
        count += len(client.read("state"))
    assert count == 40 * 5
    client.poll(0.9)
    assert len(client.read("state")) == 5
    for _ in range(6):
        client.poll(0.004)
    assert client.read("state") == []
    client.poll(0.004)
    assert len(client.read("state")) == 5


def test_a_late_poll_makes_up_one_second_at_most(controller_client: Maker) -> None:
    client = controller_client()
    client.poll(0.5)
    assert client.controller.time == pytest.approx(0.5)
    client.poll(7.0)
    assert client.controller.time == pytest.approx(1.5)
    client.poll(0.004)
    assert client.controller.time == pytest.approx(1.504)
    client.poll(-5.0)
    assert client.controller.time == pytest.approx(1.504)


def test_points_over_the_wire_move_the_axes(controller_client: Maker) -> None:
    client = controller_client()
    client.start()
    for sequence in range(31):
        assert client.move(sequence, step=0.02) == [(0, 0)] * 3
    for _ in range(20):
        client.poll(0.004)
    # Every point is run, and what follows its end is braking.
    assert client.controller.positions.min() > 0.1 * 0.6**2 - 1e-6
    assert [len(points) for points in client.controller.received] == [31, 31, 31]
    reached = [q for _, q, _ in client.controller.trace]
    assert np.abs(np.diff(reached, axis=0)).max() < 0.2 * 0.6 * 0.004 * 1.01


def test_what_comes_while_trajectory_mode_starts_is_answered_after_it(
    controller_client: Maker,
) -> None:
    client = controller_client()
    start = MotionControl(-1, 3, Command.START_TRAJ_MODE).to_message()
    client.links["motion"].send(start.encode() + READY.encode())
    client.poll()
    client.send("motion", READY)
    taken = client.server.motion[0].received
    client.poll(0.004)
    assert client.server.motion[0].received == taken  # the rest waits in the system
    replies: list[Message] = []
    for _ in range(150):
        client.server.poll(client.now)
        client.now += 0.004
        replies += client.read("motion")
    told = [MotionReply.of(reply) for reply in replies]
    assert [(t.command, t.result) for t in told] == [
        (Command.START_TRAJ_MODE, 0),
        (Command.CHECK_MOTION_READY, 0),
        (Command.CHECK_MOTION_READY, 0),
    ]


def test_a_second_motion_connection_replaces_the_first_only_at_rest(
    controller_client: Maker,
) -> None:
    client = controller_client()
    client.start()
    first = client.links["motion"]
    client.connect("motion")
    client.poll()
    assert len(client.server.motion) == 1
    first.wait(2.0)
    first.receive()
    assert first.closed
    assert client.move(0) == [(0, 0)] * 3
    client.move(1)
    second = client.links["motion"]
    third = client.connect("motion")
    client.server.poll(client.now)
    third.wait(2.0)
    third.receive()
    assert third.closed
    client.links["motion"] = second
    assert client.controller.moving and not second.wait(0.0)


def test_four_clients_of_feedback_and_one_of_outputs(controller_client: Maker) -> None:
    client = controller_client()
    for name, most in (("state", 4), ("io", 1)):
        links = [client.links[name], *(client.connect(name) for _ in range(4))]
        client.server.poll(client.now)
        assert len(client.server.links[name]) == most
        for link in links[most:]:
            link.wait(2.0)
            link.receive()
            assert link.closed
        assert not any(link.closed for link in links[:most])
        client.links[name] = links[0]
        for link in links[1:]:
            link.close()


def test_the_end_of_the_motion_connection_stops_the_axes(controller_client: Maker) -> None:
    client = controller_client()
    client.start()
    for sequence in range(20):
        client.move(sequence)
    client.poll(0.2)
    assert client.controller.velocities.all()
    client.links["motion"].close()
    for _ in range(100):
        client.server.poll(client.now)
        client.now += 0.004
    assert client.controller.queued == (0, 0, 0)
    assert not client.controller.moving and client.controller.positions.max() < 0.01
    assert client.server.motion == []


def test_disconnect_is_answered_and_ends_the_connection(controller_client: Maker) -> None:
    client = controller_client()
    client.send("motion", MotionControl(-1, 9, Command.DISCONNECT).to_message())
    client.poll()
    link = client.links["motion"]
    link.wait(2.0)
    (reply,) = Framer().feed(link.receive())
    assert MotionReply.of(reply).result == 0
    link.wait(2.0)
    link.receive()
    assert link.closed and client.server.motion == []


@pytest.mark.parametrize("name", ["motion", "state", "io"])
def test_garbage_ends_its_own_connection_alone(controller_client: Maker, name: str) -> None:
    client = controller_client()
    client.read("state")
    client.links[name].send(b"\xff" * 300)
    client.poll()
    assert list(client.server.rejected) == [(name, "length")]
    link = client.links.pop(name)
    link.wait(2.0)
    link.receive()
    assert link.closed
    client.poll(0.025)
    for other in client.links:
        assert client.server.links[other]
        if other == "state":
            assert len(client.read("state")) == 5
    client.connect(name)
    client.poll()
    assert len(client.server.links[name]) == 1


def test_what_a_new_client_has_sent_already_is_answered_at_once(
    controller_client: Maker,
) -> None:
    client = controller_client()
    for name in ("motion", "io"):
        client.links[name].close()
    client.poll()
    for name, message in (("motion", READY), ("io", ReadIo(10010).to_message())):
        client.connect(name)
        client.send(name, message)
    client.server.poll(client.now)
    assert len(client.read("motion")) == len(client.read("io")) == 1


def test_a_client_that_never_reads_is_given_up(controller_client: Maker) -> None:
    client = controller_client(ServerFault("tiny_buffers"))
    flood = ReadIo(10010).to_message().encode() * 3000
    for _ in range(300):
        client.links["io"].send(flood)
        client.server.poll(client.now)
        if not client.server.io or client.links["io"].closed:
            break
    assert client.server.io == []


def test_a_port_that_is_taken_is_named(controller_client: Maker) -> None:
    client = controller_client()
    taken = client.server.ports[0]
    with pytest.raises(HardwareError, match=f"127.0.0.1:{taken} .motion."):
        ControllerServer(client.controller, ports=(taken, 0, 0))
    client.server.close()
    client.server.close()
    with socket.socket() as free, pytest.raises(OSError, match="refused"):
        free.connect(("127.0.0.1", taken))
