"""Faults of the virtual controller's feedback: values, messages, their order and their time."""

import struct
from collections import deque
from math import pi

import numpy as np

from unwrinkle.hardware.motoros.messages import FeedbackBody, Message, MessageType, MultiFeedback
from unwrinkle.models.arrays import Array
from unwrinkle.simulation.controllers.faults.kinds import Faults, ServerFault


class FeedbackFaults:
    """Applies the active faults to feedback."""

    def __init__(self, faults: Faults) -> None:
        """Apply the active ones of `faults`."""
        self._faults = faults
        self._frozen: Array | None = None
        self._held: list[Message] | None = None
        self._late: deque[tuple[float, list[Message]]] = deque()

    def measured(self, positions: Array, velocities: Array, now: float) -> tuple[Array, Array]:
        """Return positions, rad, and velocities, rad/s, (13,), as the feedback states them."""
        q, v = positions.copy(), velocities
        active = self._faults.active
        if "freeze" in active:
            self._frozen = q if self._frozen is None else self._frozen
            q, v = self._frozen.copy(), np.zeros_like(v)
        else:
            self._frozen = None
        if fault := active.get("offset"):
            q[fault.axis] += fault.value * min(self._faults.age(fault, now), 1.0)
        if fault := active.get("jump"):
            q[fault.axis] += fault.value
        if fault := active.get("wrap"):
            q[fault.axis] += 2.0 * pi
        if "degrees" in active:
            q, v = np.degrees(q), np.degrees(v)
        return q, v

    def messages(self, messages: list[Message], places: list[tuple[int, int]]) -> list[Message]:
        """Return the messages as they are sent; `places` are group and slot of each axis."""
        if fault := self._faults.active.get("groups"):
            return [_with_groups(message, fault) for message in messages if _kept(message, fault)]
        if fault := self._faults.active.get("nan"):
            return [_with_nan(message, *places[fault.axis]) for message in messages]
        return messages

    def due(self, new: list[Message], now: float) -> list[Message]:
        """Return the messages to send now, given a new set of feedback."""
        active = self._faults.active
        sets = [new, new] if "duplicate" in active else [new]
        if "reorder" in active:
            held, self._held = self._held, new if self._held is None else None
            sets = [] if held is None else [new, held]
        delay = active["delay"].value if "delay" in active else 0.0
        self._late.extend((now + delay, one) for one in sets)
        ready: list[Message] = []
        while self._late and self._late[0][0] <= now + 1e-9:
            ready += self._late.popleft()[1]
        return ready


def _kept(message: Message, fault: ServerFault) -> bool:
    if fault.value or message.type != MessageType.JOINT_FEEDBACK:
        return True
    return FeedbackBody.of(message).group != 2


def _with_groups(message: Message, fault: ServerFault) -> Message:
    if message.type == MessageType.JOINT_FEEDBACK_EX:
        groups = MultiFeedback.of(message).groups
        if not fault.value:
            return MultiFeedback(groups[:2]).to_message()
        return MultiFeedback((_extra(groups[0], fault), *groups[1:])).to_message()
    if fault.value and message.type == MessageType.JOINT_FEEDBACK:
        body = FeedbackBody.of(message)
        return _extra(body, fault).to_message() if body.group == 0 else message
    return message


def _extra(body: FeedbackBody, fault: ServerFault) -> FeedbackBody:
    """Return feedback with a value for a joint that the group does not have."""
    assert body.positions is not None
    slot = max(fault.axis, 6) if fault.axis < 10 else 9
    positions = list(body.positions)
    positions[slot] = fault.value
    return FeedbackBody(body.group, body.time, tuple(positions), body.velocities)


def _with_nan(message: Message, group: int, slot: int) -> Message:
    """Return a message with NaN in its bytes, which the encoder refuses."""
    if message.type == MessageType.JOINT_FEEDBACK:
        if FeedbackBody.of(message).group != group:
            return message
        start = 0
    elif message.type == MessageType.JOINT_FEEDBACK_EX:
        start = 4 + 132 * group
    else:
        return message
    body = bytearray(message.body)
    struct.pack_into("<f", body, start + 12 + 4 * slot, float("nan"))
    return Message(message.type, message.comm, message.reply, bytes(body))
