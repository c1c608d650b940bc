"""The motion connection: one request at a time, the next one is sent when the reply has come.

The firmware of 2013 executes neither of two messages that it reads together, not even a stop, and
newer firmware may lose the second one.
"""

import dataclasses as dc
import time
from collections import deque
from dataclasses import dataclass

from unwrinkle.hardware.motoros.messages import (
    Command,
    Framer,
    Message,
    MessageType,
    MotionControl,
    MotionReply,
    Result,
    Subcode,
    WireError,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.errors import ConnectionLostError, OverdueError, ProtocolError

#: Group number of a command to all control groups.
ALL_GROUPS = -1
#: Longest wait of a stop for the reply to the request before it; then the stop is sent anyway, s.
STOP_PATIENCE_S = 0.1
#: Longest wait for each reply when the connection is left, s.
LEAVE_TIMEOUT_S = 0.25


@dataclass(frozen=True)
class Asked:
    """A request that a reply is due to.

    Attributes:
        what: a `Command`, or the `MessageType` of a trajectory point.
        group: control group; -1 for all.
        sequence: number of the request.
        sent: when it was sent, s; infinite while it waits.
        deadline: when its reply is overdue, s.
    """

    what: int
    group: int
    sequence: int
    sent: float = float("inf")
    deadline: float = float("inf")


@dataclass(frozen=True)
class _Waiting:
    asked: Asked
    data: bytes
    patience: float  # longest wait for the reply, s


class MotionChannel:
    """Sends requests one at a time and matches replies to them; any other message is an error.

    Attributes:
        used: when the last request was sent, s.
    """

    def __init__(self, link: TcpLink, reply_timeout: float) -> None:
        """Use a link; a reply is due within reply_timeout, s, unless a request allows more."""
        self._link = link
        self._timeout = reply_timeout
        self._framer = Framer()
        self._asked: deque[Asked] = deque()
        self._waiting: deque[_Waiting] = deque()
        self._stop_due: float | None = None  # when a stop is sent without the reply before it, s
        self._sequence = 0
        self.used = float("-inf")

    @property
    def open(self) -> bool:
        """Whether requests can be sent."""
        return not self._link.closed

    @property
    def quiet(self) -> bool:
        """Whether every reply has come and no request waits."""
        return not self._asked and not self._waiting

    def control(self, command: int, now: float, timeout: float | None = None) -> int:
        """Queue a command to all groups; return its sequence number."""
        self._sequence += 1
        message = MotionControl(ALL_GROUPS, self._sequence, command).to_message()
        self._queue(message, Asked(command, ALL_GROUPS, self._sequence), now, timeout)
        return self._sequence

    def point(self, message: Message, group: int, sequence: int, now: float) -> None:
        """Queue a trajectory point."""
        self._queue(message, Asked(message.type, group, sequence), now, None)

    def stop(self, now: float) -> None:
        """Drop all queued requests and send STOP_MOTION next."""
        self._waiting.clear()
        self._stop_due = now + STOP_PATIENCE_S
        self.control(Command.STOP_MOTION, now)

    def poll(self, now: float) -> list[tuple[Asked, MotionReply]]:
        """Return the requests that have been answered, with their replies; `send_next` sends the
        next one.

        Raises:
            ConnectionLostError: the connection has ended.
            OverdueError: a reply is overdue.
            ProtocolError: a message is not the reply to a request.
        """
        answers: list[tuple[Asked, MotionReply]] = []
        data = self._link.receive()
        if data:
            try:
                messages = self._framer.feed(data)
            except WireError as error:
                raise ProtocolError(
                    f"the controller sends garbage on the motion connection ({error.name}: {error})"
                ) from None
            answers = [answer for message in messages if (answer := self._match(message))]
        if self._link.closed:
            raise ConnectionLostError(f"the motion connection has ended: {self._link.closed}")
        if self._asked and now > self._asked[0].deadline:
            first = self._asked[0]
            waited, allowed = now - first.sent, first.deadline - first.sent
            raise OverdueError(
                f"the controller has not answered {_label(first)} for {waited:.2f} s, at most "
                f"{allowed:.2f} s; is its connection alive?",
                waited,
                allowed,
            )
        self._link.flush()
        return answers

    def send_next(self, now: float) -> None:
        """Send the next request if its turn has come; call it after the driver has checked that it
        is not late.
        """
        self._send(now)

    def _queue(self, message: Message, asked: Asked, now: float, timeout: float | None) -> None:
        wait = self._timeout if timeout is None else timeout
        self._waiting.append(_Waiting(asked, message.encode(), wait))
        self._send(now)

    def _send(self, now: float) -> None:
        """Send the next request if the last reply has come, or a stop has waited long enough."""
        overdue = self._stop_due is not None and now >= self._stop_due
        if not self._waiting or (self._asked and not overdue):
            return
        self._stop_due = None
        waiting = self._waiting.popleft()
        self._link.send(waiting.data)
        self._asked.append(dc.replace(waiting.asked, sent=now, deadline=now + waiting.patience))
        self.used = now

    def _match(self, message: Message) -> tuple[Asked, MotionReply] | None:
        if message.type == MessageType.PING:
            return None
        try:
            reply = MotionReply.of(message)
        except WireError as error:
            raise ProtocolError(
                f"what the controller sends on the motion connection is no answer: {error}"
            ) from None
        if not self._asked:
            raise ProtocolError(
                f"the controller answers (command {reply.command}, sequence {reply.sequence}) what "
                "was not asked"
            )
        asked = self._asked.popleft()
        # The controller replies with group and sequence -1 to a message that it could not read.
        unread = reply.sequence == -1 and reply.result != Result.SUCCESS
        multi = asked.what == MessageType.JOINT_TRAJ_PT_FULL_EX
        if not unread and (
            reply.sequence != asked.sequence
            or reply.command != asked.what
            or not (multi or reply.group == asked.group)
        ):
            if asked.what == Command.CHECK_SYNCHRO and reply.command != asked.what:
                # MotoROS repeats its last reply to a command that it does not know.
                unknown = dc.replace(reply, result=Result.INVALID, subcode=Subcode.INVALID_COMMAND)
                return asked, unknown
            raise ProtocolError(
                f"the controller answers command {reply.command}, group {reply.group}, sequence "
                f"{reply.sequence} where {_label(asked)} was due"
            )
        return asked, reply


class StopAndClose:
    """Ends a motion connection whose replies cannot be trusted: a stop of all groups, its reply,
    the end.

    Without the stop the controller would keep the content of its queues and run it at the next
    connection.
    """

    def __init__(self, link: TcpLink, now: float, *, waiting: bool) -> None:
        """Begin at `now`, s; `waiting`: a reply to an earlier request is due."""
        self._link = link
        self._due = now + (STOP_PATIENCE_S if waiting else 0.0)
        self._end: float | None = None

    def poll(self, now: float) -> bool:
        """Send and receive what is due; return whether the connection has ended."""
        heard = bool(self._link.receive())
        if self._end is None:
            if heard or now >= self._due:
                self._link.send(_control(Command.STOP_MOTION))
                self._end = now + LEAVE_TIMEOUT_S
        elif heard or now >= self._end:
            self._link.close("stopped and left")
        self._link.flush()
        return bool(self._link.closed)


def stop_and_leave(link: TcpLink, *, waiting: bool, moving: bool, mode: bool) -> None:
    """Empty the queues and leave trajectory mode; blocks for about a second at most and does not
    close the link.

    Args:
        link: of the motion connection.
        waiting: a reply to an earlier request is due.
        moving: motion may be queued, so that a stop is sent first.
        mode: trajectory mode was started and is to be left.
    """
    framer = Framer()
    if waiting:
        _next_reply(link, framer, STOP_PATIENCE_S)
    steps = [Command.STOP_MOTION] * moving + [Command.STOP_TRAJ_MODE] * mode
    stopped = moving
    while steps:
        command = steps.pop(0)
        link.send(_control(command))
        reply = _next_reply(link, framer, LEAVE_TIMEOUT_S)
        if reply is None:
            return  # without a reply, further messages might be read together with this one
        if command == Command.STOP_TRAJ_MODE and reply.result != Result.SUCCESS and not stopped:
            steps, stopped = [Command.STOP_MOTION, Command.STOP_TRAJ_MODE], True
    if mode:
        # DISCONNECT is not answered. A reply to a closed socket would make the system drop what was
        # sent: wait for the end.
        link.send(_control(Command.DISCONNECT))
        end = time.monotonic() + LEAVE_TIMEOUT_S
        while not link.closed and (left := end - time.monotonic()) > 0.0:
            if link.wait(left):
                link.receive()


def request_stop(link: TcpLink, most: float) -> MotionReply | None:
    """Send STOP_MOTION over a link without other requests; return the reply, None if none comes
    within `most`, s.
    """
    link.send(_control(Command.STOP_MOTION))
    return _next_reply(link, Framer(), most)


def _control(command: int) -> bytes:
    return MotionControl(ALL_GROUPS, 0, command).to_message().encode()


def _next_reply(link: TcpLink, framer: Framer, most: float) -> MotionReply | None:
    """Return the next motion reply; None if none comes within `most`, s of real time."""
    link.drain(most)
    end = time.monotonic() + most
    while not link.closed and (left := end - time.monotonic()) > 0.0:
        if not link.wait(left):
            break
        try:
            for message in framer.feed(link.receive()):
                if message.type == MessageType.MOTION_REPLY:
                    return MotionReply.of(message)
        except WireError:
            return None
    return None


def _label(asked: Asked) -> str:
    kind = (
        "point"
        if asked.what in (MessageType.JOINT_TRAJ_PT_FULL, MessageType.JOINT_TRAJ_PT_FULL_EX)
        else f"command {asked.what}, sequence"
    )
    return f"{kind} {asked.sequence} (group {asked.group})"
