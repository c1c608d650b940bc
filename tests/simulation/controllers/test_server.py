"""The virtual controller on real sockets.

Connections and their end, timing, and what a read brings.
"""

import socket
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.motoros.messages import (
    Command,
    Framer,
    GroupPoint,
    Message,
    MotionControl,
    MotionReply,
    MultiPoint,
    ReadIo,
    RobotStatusBody,
    ping,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.errors import HardwareError
from unwrinkle.simulation.controllers.server import ControllerServer, ServerFault

pytestmark = pytest.mark.alone

READY = MotionControl(-1, 5, Command.CHECK_MOTION_READY).to_message()
Client = Any
Maker = Callable[..., Client]


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


def _gone(link: TcpLink) -> bool:
    """Whether the server has hung up."""
    link.wait(2.0)
    link.receive()
    return bool(link.closed)


def test_a_second_motion_connection_replaces_the_first_only_if_nothing_waits(
    controller_client: Maker,
) -> None:
    client = controller_client()
    client.start()
    first = client.links["motion"]
    client.connect("motion")
    client.poll()
    assert len(client.server.motion) == 1 and _gone(first)
    assert client.move(0) == client.move(1) == [(0, 0)] * 3
    client.poll(0.004)
    assert any(client.controller.queued)
    second = client.links["motion"]
    third = client.connect("motion")
    client.server.poll(client.now)
    assert _gone(third)
    client.links["motion"] = second
    assert client.ask(READY) and not second.closed


def test_the_firmware_of_2013_keeps_the_older_connection(controller_client: Maker) -> None:
    client = controller_client(firmware="2013")
    first = client.links["motion"]
    second = client.connect("motion")
    client.server.poll(client.now)
    assert _gone(second) and not first.wait(0.0)


@pytest.mark.parametrize(("name", "most"), [("state", 4), ("io", 1)])
def test_further_clients_take_the_place_of_the_oldest_unless_in_motion(
    controller_client: Maker, name: str, most: int
) -> None:
    client = controller_client()
    client.start()
    links = [client.links[name], *(client.connect(name) for _ in range(most))]
    client.server.poll(client.now)
    assert len(client.server.links[name]) == most
    assert any(_gone(links[0]) for _ in range(5))  # after what has come before
    assert not any(link.closed for link in links[1:])
    client.move(0)
    client.move(1)
    client.poll(0.004)
    assert any(client.controller.queued)
    late = client.connect(name)
    client.server.poll(client.now)
    assert _gone(late) and len(client.server.links[name]) == most


def _lose_motion(client: Client, *, seconds: float = 0.5) -> None:
    """Stream half a second of the ramp, lose the connection in motion and wait."""
    client.start()
    for sequence in range(26):
        assert client.move(sequence) == [(0, 0)] * 3
    client.poll(0.1)
    assert client.controller.velocities.all()
    client.links["motion"].close()
    for _ in range(round(seconds / 0.004)):
        client.server.poll(client.now)
        client.now += 0.004


def test_the_queue_outlives_the_motion_connection_and_runs_at_the_next(
    controller_client: Maker,
) -> None:
    client = controller_client()
    _lose_motion(client)
    still, left = client.controller.positions, client.controller.queued
    assert client.server.motion == [] and min(left) > 0
    assert not client.controller.velocities.any()
    client.read("state")
    client.poll(0.025)
    status = RobotStatusBody.of(client.read("state")[-1])
    assert (status.in_motion, status.motion_possible) == (1, 1)
    assert client.controller.queued == left
    client.connect("motion")  # and not one byte is sent
    client.poll(0.004)
    client.poll(0.07)
    assert (client.controller.positions > still + 1e-3).all()
    client.poll(1.0)
    assert client.controller.queued == (0, 0, 0)
    assert any("queues are not empty" in text for _, text in client.server.events)


def test_a_stop_as_the_first_bytes_moves_nothing(controller_client: Maker) -> None:
    client = controller_client()
    _lose_motion(client)
    still = client.controller.positions
    client.connect("motion")
    client.send("motion", MotionControl(-1, 5, Command.STOP_MOTION).to_message())
    client.server.poll(client.now)
    for _ in range(100):
        client.poll(0.004)
    assert MotionReply.of(client.read("motion")[0]).result == 0
    assert np.array_equal(client.controller.positions, still)
    assert client.controller.status.in_motion == 0


def test_a_connection_that_the_controller_loses_keeps_its_queue_too(
    controller_client: Maker,
) -> None:
    client = controller_client(ServerFault("close_motion", points=20))
    client.start()
    for sequence in range(20):
        client.move(sequence)
    client.poll(0.004)
    assert client.server.motion == []
    waiting = client.controller.queued
    for _ in range(100):
        client.server.poll(client.now)
        client.now += 0.004
    ran = np.subtract(waiting, client.controller.queued) * 0.004
    assert ((ran > 0.03) & (ran < 0.06)).all()


def test_disconnect_ends_the_connection_without_a_reply(controller_client: Maker) -> None:
    client = controller_client()
    client.send("motion", MotionControl(-1, 9, Command.DISCONNECT).to_message())
    client.poll()
    link = client.links["motion"]
    link.wait(2.0)
    assert link.receive() == b"" and link.closed and client.server.motion == []


def test_disconnect_is_answered_by_the_firmware_of_2013_and_ends_the_connection(
    controller_client: Maker,
) -> None:
    client = controller_client(firmware="2013")
    client.send("motion", MotionControl(-1, 9, Command.DISCONNECT).to_message())
    client.poll()
    link = client.links["motion"]
    link.wait(2.0)
    (reply,) = Framer().feed(link.receive())
    assert MotionReply.of(reply).result == 0
    assert _gone(link) and client.server.motion == []


@pytest.mark.parametrize("firmware", ["1.9.12", "2013"])
def test_disconnect_is_refused_while_increments_wait(
    controller_client: Maker, firmware: str
) -> None:
    client = controller_client(firmware=firmware)
    client.start()
    client.move(0)
    client.move(1)
    client.poll(0.004)
    (reply,) = client.ask(MotionControl(-1, 9, Command.DISCONNECT).to_message())
    told = MotionReply.of(reply)
    assert (told.sequence, told.result, told.subcode) == (9, 2, 0)
    assert client.ask(READY) and client.server.motion


# ---------------------------------------------------------------- reads


def _answers(client: Client, data: bytes, name: str = "motion") -> list[tuple[int, int]]:
    """Send bytes in one piece; results and sub-codes of the answers."""
    client.links[name].send(data)
    client.poll()
    replies = client.read(name)
    if name == "io":
        return [tuple(np.frombuffer(reply.body[:8], "<i4").tolist()) for reply in replies]
    return [(told.result, told.subcode) for told in map(MotionReply.of, replies)]


def test_single_bytes_are_each_answered_and_the_message_is_lost(controller_client: Maker) -> None:
    client = controller_client()
    data = MotionControl(-1, 5, Command.START_SERVOS).to_message().encode()
    for name in ("motion", "io"):
        for byte in range(len(data)):
            assert _answers(client, data[byte : byte + 1], name) == [(3, 3001)]
    assert not client.controller.pendant.servo
    assert set(client.server.rejected) == {("motion", "size"), ("io", "size")}
    assert len(client.server.rejected) == 2 * len(data)


@pytest.mark.parametrize("place", [4, 15, 16, 20, 50, 67])
def test_each_piece_of_a_message_is_answered_as_if_it_were_one(
    controller_client: Maker, place: int
) -> None:
    client = controller_client()
    data = MotionControl(-1, 5, Command.START_SERVOS).to_message().encode()
    answers = _answers(client, data[:place]) + _answers(client, data[place:])
    # What is long enough for a header is taken for one, of a type that is not there.
    assert answers == [(3, 3001), (3, 3003) if len(data) - place >= 16 else (3, 3001)]
    assert not client.controller.pendant.servo
    assert _answers(client, READY.encode()) == [(2, 5006)]


def test_a_reply_to_a_piece_repeats_the_sequence_and_not_the_group(
    controller_client: Maker,
) -> None:
    data = MotionControl(2, 41, Command.STOP_MOTION).to_message().encode()
    for firmware, expected in (("1.9.12", (0, 41, 200111)), ("2013", (2, 41, 200111))):
        client = controller_client(firmware=firmware)
        client.links["motion"].send(data[:40])
        client.poll()
        (reply,) = client.read("motion")
        told = MotionReply.of(reply)
        assert (told.group, told.sequence, told.command) == expected
        assert (told.result, told.subcode) == (3, 3001 if firmware == "1.9.12" else 0)


@pytest.mark.parametrize("length", [0, 5, -1, 2**31 - 1])
def test_the_length_word_is_not_looked_at(controller_client: Maker, length: int) -> None:
    client = controller_client()
    data = READY.encode()
    wrong = np.array([length], "<i4").tobytes() + data[4:]
    assert _answers(client, wrong) == [(2, 5006)]
    client.links["io"].send(
        np.array([length], "<i4").tobytes() + ReadIo(10010).to_message().encode()[4:]
    )
    client.poll()
    assert len(client.read("io")) == 1


@pytest.mark.parametrize("name", ["motion", "io"])
def test_big_endian_and_unknown_types_are_answered_and_the_connection_kept(
    controller_client: Maker, name: str
) -> None:
    client = controller_client()
    message = READY if name == "motion" else ReadIo(10010).to_message()
    big = np.frombuffer(message.encode(), "<i4").astype(">i4").tobytes()
    unknown = np.array([64, 999, 2, 0] + [0] * 13, "<i4").tobytes()
    for data in (big, unknown, b"\xff" * 300):
        assert _answers(client, data, name) == [(3, 3003)]  # once for all of the read
    assert len(_answers(client, message.encode(), name)) == 1
    assert len(client.server.links[name]) == 1


def test_messages_that_come_together_are_taken_one_by_one_and_noted(
    controller_client: Maker,
) -> None:
    client = controller_client()
    servos = MotionControl(-1, 5, Command.START_SERVOS).to_message().encode()
    assert _answers(client, servos + READY.encode()) == [(0, 0), (2, 5008)]
    (finding,) = client.controller.audit.findings
    assert finding.startswith("2 messages in one read")


def test_a_read_brings_no_more_than_the_longest_message(controller_client: Maker) -> None:
    client = controller_client()
    client.start()
    whole = b"".join(
        MultiPoint(0, (GroupPoint(group, 4e-4, (0.0,), (0.0,)),))
        .to_message(four_slots=True)
        .encode()
        for group in (0, 1)
    )
    assert len(whole) == 2 * 552
    assert _answers(client, whole) == [(0, 0)] * 2
    assert not client.controller.audit.findings  # not in one read


def test_points_for_all_groups_may_have_empty_slots(controller_client: Maker) -> None:
    client = controller_client()
    client.start()
    block = GroupPoint(0, 4e-4, (0.0,) * 6, (0.0,) * 6)
    for four_slots in (False, True):
        message = MultiPoint(0, (block,)).to_message(four_slots=four_slots)
        assert _answers(client, message.encode()) == [(0, 0)]
    assert len(client.controller.received[0]) == 2


@pytest.mark.parametrize("count", [5, 1000, 2**31 - 1])
def test_more_groups_than_there_is_room_for_are_a_message_that_is_not_whole(
    controller_client: Maker, count: int
) -> None:
    client = controller_client()
    client.start()
    data = bytearray(MultiPoint(0, (GroupPoint(0, 0.0, (0.0,), (0.0,)),) * 4).to_message().encode())
    data[16:20] = count.to_bytes(4, "little")
    assert _answers(client, bytes(data)) == [(3, 3001)]
    assert not client.controller.received[0]


def test_the_firmware_of_2013_takes_a_read_that_is_one_message(controller_client: Maker) -> None:
    client = controller_client(firmware="2013", accepts="groups")
    client.start()
    client.move(0)
    client.move(1)
    client.poll(0.004)
    commands = (Command.STOP_MOTION, Command.STOP_TRAJ_MODE, Command.DISCONNECT)
    together = b"".join(MotionControl(-1, 1, c).to_message().encode() for c in commands)
    assert set(_answers(client, together)) == {(3, 0)}
    # Not one of them was obeyed, and nothing of it is left.
    assert min(client.controller.queued) > 0 and client.controller.pendant.trajectory_mode
    assert client.server.motion
    assert _answers(client, READY.encode()) == [(0, 0)]
    assert _answers(client, READY.encode()[:-1]) == [(3, 0)]
    assert _answers(client, READY.encode() + b"\0") == [(3, 0)]
    assert _answers(client, ping().encode()) == [(3, 0)]
    whole = MultiPoint(2, (GroupPoint(0, 0.0, (0.0,), (0.0,)),)).to_message().encode()
    assert set(_answers(client, whole)) == {(3, 0)}  # longer than its room of 152 bytes


def test_what_comes_on_the_state_port_is_not_read(controller_client: Maker) -> None:
    client = controller_client()
    client.read("state")
    client.links["state"].send(b"\xff" * 300 + READY.encode())
    client.poll(0.025)
    assert [m.type for m in client.read("state")] == [15, 15, 15, 2017, 13]
    assert not client.server.rejected and not client.controller.messages


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
