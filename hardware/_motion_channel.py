"""The motion connection: what was asked, and the answer to each, in order."""

from collections import deque
from dataclasses import dataclass

from unwrinkle.hardware.link import TcpLink
from unwrinkle.hardware.wire import (
    Framer,
    Message,
    MessageType,
    MotionControl,
    MotionReply,
    WireError,
)
from unwrinkle.models.errors import HardwareError

ALL_GROUPS = -1


@dataclass(frozen=True)
class Asked:
    """Something that an answer is due to.

    Attributes:
        what: a `Command`, or the `MessageType` of a trajectory point.
        group: its group; -1 for all.
        sequence: its number.
        sent: when, s.
        deadline: when the answer is overdue, s.
    """

    what: int
    group: int
    sequence: int
    sent: float
    deadline: float


class MotionChannel:
    """Requests go out, replies come in, in the same order; anything else is an error."""

    def __init__(self, link: TcpLink, reply_timeout: float) -> None:
        """Speak over a link; an answer is due within reply_timeout (s) unless more is allowed."""
        self._link = link
        self._timeout = reply_timeout
        self._framer = Framer()
        self._asked: deque[Asked] = deque()
        self._sequence = 0
        self.used = float("-inf")  # when something was sent last

    @property
    def open(self) -> bool:
        """Whether something can be sent."""
        return not self._link.closed

    @property
    def quiet(self) -> bool:
        """Whether every answer has come."""
        return not self._asked

    def control(self, command: int, now: float, timeout: float | None = None) -> Asked:
        """Send a command to all groups."""
        self._sequence += 1
        message = MotionControl(ALL_GROUPS, self._sequence, command).to_message()
        return self._ask(message, command, ALL_GROUPS, self._sequence, now, timeout)

    def point(self, message: Message, group: int, sequence: int, now: float) -> Asked:
        """Send a trajectory point."""
        return self._ask(message, message.type, group, sequence, now, None)

    def poll(self, now: float) -> list[tuple[Asked, MotionReply]]:
        """What has been answered.

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

    def _ask(
        self,
        message: Message,
        what: int,
        group: int,
        sequence: int,
        now: float,
        timeout: float | None,
    ) -> Asked:
        wait = self._timeout if timeout is None else timeout
        asked = Asked(what, group, sequence, now, now + wait)
        self._link.send(message.encode())
        self._asked.append(asked)
        self.used = now
        return asked

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
        unread = reply.sequence == -1 and reply.result != 0
        multi = asked.what == MessageType.JOINT_TRAJ_PT_FULL_EX
        if not unread and (
            reply.sequence != asked.sequence
            or reply.command != asked.what
            or not (multi or reply.group == asked.group)
        ):
            raise HardwareError(
                f"the controller answers command {reply.command}, group {reply.group}, sequence {reply.sequence} "
                f"where {_words(asked)} was due"
            )
        return asked, reply


def _words(asked: Asked) -> str:
    kind = (
        "point"
        if asked.what in (MessageType.JOINT_TRAJ_PT_FULL, MessageType.JOINT_TRAJ_PT_FULL_EX)
        else f"command {asked.what}, sequence"
    )
    return f"{kind} {asked.sequence} (group {asked.group})"
