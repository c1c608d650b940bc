"""The motion connection: one request under way, its answer awaited before the next is sent.

The firmware of 2013 executes nothing of two messages that it reads together, a stop included, and newer ones may lose
the second: so whatever waits is sent when the answer before has come.
"""

import dataclasses as dc
import time
from collections import deque
from dataclasses import dataclass

from unwrinkle.hardware.motoros.link import TcpLink
from unwrinkle.hardware.motoros.wire import (
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
from unwrinkle.models.errors import HardwareError

ALL_GROUPS = -1
#: A stop waits so long for the answer to what was asked before; then it is sent all the same, s.
PATIENCE = 0.1
#: Leaving waits so long for each answer, s.
LEAVING = 0.25


@dataclass(frozen=True)
class Asked:
    """Something that an answer is due to.

    Attributes:
        what: a `Command`, or the `MessageType` of a trajectory point.
        group: its group; -1 for all.
        sequence: its number.
        sent: when it was sent, s; infinite while it waits.
        deadline: when the answer is overdue, s.
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
    patience: float  # for the answer, s


class MotionChannel:
    """Requests go out one at a time, replies come in; anything else is an error.

    Attributes:
        used: when something was sent last, s.
    """

    def __init__(self, link: TcpLink, reply_timeout: float) -> None:
        """Speak over a link; an answer is due within reply_timeout (s) unless more is allowed."""
        self._link = link
        self._timeout = reply_timeout
        self._framer = Framer()
        self._asked: deque[Asked] = deque()
        self._waiting: deque[_Waiting] = deque()
        self._stop_due: float | None = None  # when a stop is sent whatever was answered
        self._sequence = 0
        self.used = float("-inf")

    @property
    def open(self) -> bool:
        """Whether something can be sent."""
        return not self._link.closed

    @property
    def quiet(self) -> bool:
        """Whether every answer has come, and nothing waits."""
        return not self._asked and not self._waiting

    def control(self, command: int, now: float, timeout: float | None = None) -> int:
        """Send a command to all groups once its turn has come; its sequence number."""
        self._sequence += 1
        message = MotionControl(ALL_GROUPS, self._sequence, command).to_message()
        self._queue(message, Asked(command, ALL_GROUPS, self._sequence), now, timeout)
        return self._sequence

    def point(self, message: Message, group: int, sequence: int, now: float) -> None:
        """Send a trajectory point once its turn has come."""
        self._queue(message, Asked(message.type, group, sequence), now, None)

    def stop(self, now: float) -> None:
        """Send STOP_MOTION before all that waits, which is dropped: a stop ends what it was for."""
        self._waiting.clear()
        self._stop_due = now + PATIENCE
        self.control(Command.STOP_MOTION, now)

    def poll(self, now: float) -> list[tuple[Asked, MotionReply]]:
        """What has been answered; what waits is sent by `send_next`.

        Raises:
            HardwareError: the connection has ended, an answer is overdue, or is none to what was asked.
        """
        answers: list[tuple[Asked, MotionReply]] = []
        data = self._link.receive()
        if data:
            try:
                messages = self._framer.feed(data)
            except WireError as error:
                raise HardwareError(
                    f"the controller sends garbage on the motion connection ({error.name}: {error})"
                ) from None
            answers = [answer for message in messages if (answer := self._match(message))]
        if self._link.closed:
            raise HardwareError(f"the motion connection has ended: {self._link.closed}")
        if self._asked and now > self._asked[0].deadline:
            first = self._asked[0]
            raise HardwareError(
                f"the controller has not answered {_words(first)} for {now - first.sent:.2f} s, at most "
                f"{first.deadline - first.sent:.2f} s; is its connection alive?"
            )
        self._link.flush()
        return answers

    def send_next(self, now: float) -> None:
        """Send what waits if its turn has come: after whoever asks has judged that it is not late."""
        self._send(now)

    def _queue(self, message: Message, asked: Asked, now: float, timeout: float | None) -> None:
        wait = self._timeout if timeout is None else timeout
        self._waiting.append(_Waiting(asked, message.encode(), wait))
        self._send(now)

    def _send(self, now: float) -> None:
        """Send the next request if its turn has come."""
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
            raise HardwareError(
                f"what the controller sends on the motion connection is no answer: {error}"
            ) from None
        if not self._asked:
            raise HardwareError(
                f"the controller answers (command {reply.command}, sequence {reply.sequence}) what was not asked"
            )
        asked = self._asked.popleft()
        # What the controller could not read it answers with group and sequence -1.
        unread = reply.sequence == -1 and reply.result != Result.SUCCESS
        multi = asked.what == MessageType.JOINT_TRAJ_PT_FULL_EX
        if not unread and (
            reply.sequence != asked.sequence
            or reply.command != asked.what
            or not (multi or reply.group == asked.group)
        ):
            if asked.what == Command.CHECK_SYNCHRO and reply.command != asked.what:
                # MotoROS answers a command that it does not know with the reply before, once more.
                unknown = dc.replace(reply, result=Result.INVALID, subcode=Subcode.INVALID_COMMAND)
                return asked, unknown
            raise HardwareError(
                f"the controller answers command {reply.command}, group {reply.group}, sequence {reply.sequence} "
                f"where {_words(asked)} was due"
            )
        return asked, reply


class StopAndPart:
    """Ends a motion connection whose answers cannot be trusted any more: a stop of all groups, its answer, the end.

    Without the stop the controller would keep what is in its queues, and run it at the next connection.
    """

    def __init__(self, link: TcpLink, now: float, *, waiting: bool) -> None:
        """Begin now (s); `waiting`: an answer is due to what was asked before."""
        self._link = link
        self._due = now + (PATIENCE if waiting else 0.0)
        self._end: float | None = None

    def poll(self, now: float) -> bool:
        """Go on; whether the connection has ended."""
        heard = bool(self._link.receive())
        if self._end is None:
            if heard or now >= self._due:
                self._link.send(_control(Command.STOP_MOTION))
                self._end = now + LEAVING
        elif heard or now >= self._end:
            self._link.close("stopped and left")
        self._link.flush()
        return bool(self._link.closed)


def stop_and_leave(link: TcpLink, *, waiting: bool, moving: bool, mode: bool) -> None:
    """Leave a motion connection; blocks for at most about a second, and ends with the connection as it is.

    Args:
        link: to be left; it is not closed here.
        waiting: an answer is due to what was asked before.
        moving: something may be in the queues, so that they have to be emptied first.
        mode: trajectory mode was started over it, and is to be left.
    """
    framer = Framer()
    if waiting:
        _heard(link, framer, PATIENCE)
    steps = [Command.STOP_MOTION] * moving + [Command.STOP_TRAJ_MODE] * mode
    stopped = moving
    while steps:
        command = steps.pop(0)
        link.send(_control(command))
        reply = _heard(link, framer, LEAVING)
        if reply is None:
            return  # nobody answers; more would not be read as messages of their own
        if command == Command.STOP_TRAJ_MODE and reply.result != Result.SUCCESS and not stopped:
            steps, stopped = [Command.STOP_MOTION, Command.STOP_TRAJ_MODE], True
    if mode:
        # It is not answered; an answer that finds nobody would make the system drop what was sent, so wait for the end.
        link.send(_control(Command.DISCONNECT))
        end = time.monotonic() + LEAVING
        while not link.closed and (left := end - time.monotonic()) > 0.0:
            if link.wait(left):
                link.receive()


def ask_to_stop(link: TcpLink, most: float) -> MotionReply | None:
    """Send STOP_MOTION over a link on which nothing else is under way; its answer within so long (s), None without one."""
    link.send(_control(Command.STOP_MOTION))
    return _heard(link, Framer(), most)


def _control(command: int) -> bytes:
    return MotionControl(ALL_GROUPS, 0, command).to_message().encode()


def _heard(link: TcpLink, framer: Framer, most: float) -> MotionReply | None:
    """The next motion reply within so long, s of real time; None if none comes."""
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


def _words(asked: Asked) -> str:
    kind = (
        "point"
        if asked.what in (MessageType.JOINT_TRAJ_PT_FULL, MessageType.JOINT_TRAJ_PT_FULL_EX)
        else f"command {asked.what}, sequence"
    )
    return f"{kind} {asked.sequence} (group {asked.group})"
