"""The motion connection: one request under way, stops that wait for an answer and no longer,
leaving within a bound.
"""

import select
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from unwrinkle.hardware.motoros.messages import (
    Command,
    Framer,
    Message,
    MessageType,
    MotionControl,
    MotionReply,
    Result,
    Subcode,
    TrajectoryPoint,
)
from unwrinkle.hardware.motoros.motion_channel import (
    LEAVE_TIMEOUT_S,
    STOP_PATIENCE_S,
    Asked,
    MotionChannel,
    StopAndClose,
    stop_and_leave,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.errors import OverdueError, ProtocolError

POINT = TrajectoryPoint(0, 0, 0.0, (0.0,) * 6, (0.0,) * 6).to_message()


class Peer:
    """The other end of a link; the test reads and answers."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            ours = socket.create_connection(listener.getsockname())
            self.socket, _ = listener.accept()
        self.link = TcpLink(ours, "peer")
        self.socket.setblocking(False)
        self._framer = Framer()

    def heard(self) -> list[Message]:
        select.select([self.socket], [], [], 0.02)
        try:
            return self._framer.feed(self.socket.recv(1 << 16))
        except BlockingIOError:
            return []

    def commands(self) -> list[int]:
        return [
            MotionControl.of(m).command for m in self.heard() if m.type == MessageType.MOTION_CTRL
        ]

    def say(self, data: bytes) -> None:
        self.socket.sendall(data)
        self.link.wait(1.0)

    def answer(self, message: Message, result: int = Result.SUCCESS, subcode: int = 0) -> None:
        if message.type == MessageType.MOTION_CTRL:
            asked = MotionControl.of(message)
            reply = MotionReply(asked.group, asked.sequence, asked.command, result, subcode)
        else:
            point = TrajectoryPoint.of(message)
            reply = MotionReply(point.group, point.sequence, message.type, result, subcode)
        self.socket.sendall(reply.to_message().encode())


def polled(channel: MotionChannel, now: float) -> list[tuple[Asked, MotionReply]]:
    """Take the answers that are on their way, then send what waits."""
    channel._link.wait(0.02)
    answers = channel.poll(now)
    channel.send_next(now)
    return answers


@pytest.fixture
def peer() -> Iterator[Peer]:
    peer = Peer()
    yield peer
    peer.link.close()
    peer.socket.close()


def test_the_next_request_waits_for_the_answer(peer: Peer) -> None:
    channel = MotionChannel(peer.link, 0.5)
    channel.control(Command.CHECK_MOTION_READY, 1.0)
    channel.point(POINT, 0, 0, 1.0)
    (first,) = peer.heard()
    assert first.type == MessageType.MOTION_CTRL and not channel.quiet
    assert polled(channel, 1.1) == [] and peer.heard() == []
    peer.answer(first)
    ((asked, reply),) = polled(channel, 1.2)
    assert (asked.what, asked.sent, reply.result) == (Command.CHECK_MOTION_READY, 1.0, 0)
    (second,) = peer.heard()
    assert second.type == MessageType.JOINT_TRAJ_PT_FULL
    peer.answer(second)
    ((asked, _),) = polled(channel, 1.3)
    assert asked.sent == 1.2 and channel.quiet  # its time begins when it is sent


def test_an_answer_alone_sends_nothing(peer: Peer) -> None:
    channel = MotionChannel(peer.link, 0.5)
    channel.point(POINT, 0, 0, 1.0)
    channel.point(POINT, 1, 0, 1.0)
    (first,) = peer.heard()
    peer.answer(first)
    peer.link.wait(1.0)
    assert len(channel.poll(1.2)) == 1
    assert peer.heard() == []  # whoever asks judges first whether it is late
    channel.stop(1.2)
    assert peer.commands() == [Command.STOP_MOTION]


def test_time_that_a_request_waits_is_not_its_answers(peer: Peer) -> None:
    channel = MotionChannel(peer.link, 0.5)
    channel.control(Command.START_TRAJ_MODE, 1.0, timeout=8.0)
    channel.control(Command.CHECK_MOTION_READY, 1.0)
    (start,) = peer.heard()
    assert polled(channel, 5.0) == []
    peer.answer(start)
    polled(channel, 5.1)
    assert polled(channel, 5.5) == []
    with pytest.raises(OverdueError, match="command 200101") as overdue:
        polled(channel, 5.7)
    assert overdue.value.allowed == pytest.approx(0.5)
    assert overdue.value.waited > 0.5


def test_a_stop_drops_what_waits_and_follows_the_answer(peer: Peer) -> None:
    channel = MotionChannel(peer.link, 0.5)
    for sequence in range(3):
        channel.point(POINT, 0, sequence, 1.0)
    (point,) = peer.heard()
    channel.stop(1.01)
    assert peer.heard() == []
    peer.answer(point)
    polled(channel, 1.02)
    assert peer.commands() == [Command.STOP_MOTION]
    assert polled(channel, 1.03) == [] and peer.heard() == []


def test_a_stop_does_not_wait_for_ever(peer: Peer) -> None:
    channel = MotionChannel(peer.link, 0.5)
    channel.point(POINT, 0, 0, 1.0)
    (point,) = peer.heard()
    channel.stop(1.0)
    polled(channel, 1.0 + 0.9 * STOP_PATIENCE_S)
    assert peer.heard() == []
    polled(channel, 1.0 + 1.1 * STOP_PATIENCE_S)
    (stop,) = peer.heard()
    assert MotionControl.of(stop).command == Command.STOP_MOTION
    peer.answer(point)
    peer.answer(stop)
    assert [asked.what for asked, _ in polled(channel, 1.2)] == [14, Command.STOP_MOTION]


def test_the_previous_reply_once_more_means_an_unknown_command(peer: Peer) -> None:
    channel = MotionChannel(peer.link, 0.5)
    channel.control(Command.CHECK_MOTION_READY, 1.0)
    (ready,) = peer.heard()
    peer.answer(ready)
    polled(channel, 1.0)
    channel.control(Command.CHECK_SYNCHRO, 1.1)
    peer.heard()
    peer.answer(ready)
    ((asked, reply),) = polled(channel, 1.2)
    assert asked.what == Command.CHECK_SYNCHRO
    assert (reply.result, reply.subcode) == (Result.INVALID, Subcode.INVALID_COMMAND)
    # Of any other command it is no answer.
    channel.control(Command.RESET_ALARM, 1.3)
    peer.heard()
    peer.answer(ready)
    with pytest.raises(ProtocolError, match="200114"):
        polled(channel, 1.4)


@pytest.mark.parametrize("answers", [True, False])
def test_a_connection_that_is_given_up_is_stopped_before_it_is_closed(
    peer: Peer, answers: bool
) -> None:
    parting = StopAndClose(peer.link, 1.0, waiting=True)
    assert not parting.poll(1.01) and peer.heard() == []
    peer.say(b"what is no message")
    assert not parting.poll(1.02)
    assert peer.commands() == [Command.STOP_MOTION]
    assert not parting.poll(1.03) and not peer.link.closed
    if answers:
        peer.say(b"whatever it is")
        assert parting.poll(1.04)
    assert parting.poll(1.03 + 1.1 * LEAVE_TIMEOUT_S) and peer.link.closed


def serve(peer: Peer, results: Callable[[int], int | None]) -> tuple[list[int], threading.Thread]:
    """Answer commands in a thread until the connection ends; those that came."""
    came: list[int] = []

    def run() -> None:
        peer.socket.setblocking(True)
        peer.socket.settimeout(2.0)
        framer = Framer()
        while True:
            try:
                data = peer.socket.recv(4096)
            except OSError:
                return
            if not data:
                return
            for message in framer.feed(data):
                came.append(MotionControl.of(message).command)
                if came[-1] == Command.DISCONNECT:
                    peer.socket.close()
                    return
                result = results(came[-1])
                if result is not None:
                    peer.answer(message, result)

    thread = threading.Thread(target=run)
    thread.start()
    return came, thread


STOP, LEAVE, END = Command.STOP_MOTION, Command.STOP_TRAJ_MODE, Command.DISCONNECT


def test_leaving_asks_one_thing_after_the_other(peer: Peer) -> None:
    came, thread = serve(peer, lambda _: Result.SUCCESS)
    stop_and_leave(peer.link, waiting=False, moving=False, mode=True)
    thread.join()
    assert came == [LEAVE, END] and peer.link.closed


def test_queues_that_are_not_empty_are_emptied_first(peer: Peer) -> None:
    refused = [Result.FAILURE, Result.SUCCESS]
    came, thread = serve(peer, lambda c: refused.pop(0) if c == LEAVE else Result.SUCCESS)
    stop_and_leave(peer.link, waiting=False, moving=False, mode=True)
    thread.join()
    assert came == [LEAVE, STOP, LEAVE, END]


def test_abandoning_sends_a_stop_alone(peer: Peer) -> None:
    came, thread = serve(peer, lambda _: Result.SUCCESS)
    stop_and_leave(peer.link, waiting=False, moving=True, mode=False)
    peer.link.close()
    thread.join()
    assert came == [STOP]


def test_leaving_a_silent_controller_is_bounded(peer: Peer) -> None:
    came, thread = serve(peer, lambda _: None)
    begin = time.monotonic()
    stop_and_leave(peer.link, waiting=True, moving=True, mode=True)
    took = time.monotonic() - begin
    peer.link.close()
    thread.join()
    assert came == [STOP]  # more would be read together with it
    assert took < STOP_PATIENCE_S + LEAVE_TIMEOUT_S + 0.5
