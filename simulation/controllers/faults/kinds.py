"""Faults that can be injected into the virtual controller's server."""

import struct
from dataclasses import dataclass
from math import inf, isnan

import numpy as np

from unwrinkle.models.errors import InputError

#: Effect of each kind of fault while it is active.
KINDS: dict[str, str] = {
    "close_motion": "closes the motion connection once",
    "close_state": "closes the state connections once",
    "close_all": "closes every connection once",
    "silent": "keeps the connections, but answers and sends nothing",
    "silent_motion": "answers nothing on the motion connection",
    "silent_state": "sends no feedback",
    "split": "writes single bytes, the rest of a message at the next poll",
    "garbage": "sends random bytes before each message (value 1: motion, else state)",
    "wrong_length": "states a wrong length (value 1: motion, else state)",
    "huge_length": "states a length of 2 GiB (value 1: motion, else state)",
    "wrong_type": "states an unknown type (value 1: motion, else state)",
    "wrong_sequence": "motion replies carry another sequence number",
    "duplicate": "sends each set of feedback twice",
    "reorder": "swaps sets of feedback in pairs: the older comes last",
    "delay": "sends feedback late by value, s",
    "freeze": "feedback stays where it was; its stamps go on",
    "offset": "feedback of axis moves off by value, rad, within a second",
    "jump": "feedback of axis is off by value, rad, at once",
    "wrap": "feedback of axis is off by a turn",
    "nan": "feedback of axis is not a number",
    "degrees": "feedback is in degrees",
    "groups": "feedback lacks the last group; with a value: slot axis of the first group is that",
    "busy": "answers busy to every point",
    "not_ready": "answers not ready, with the sub-code value, to points, starts and checks",
    "start_mismatch": "refuses every first point for its position",
    "slow": "has read no more than value bytes a poll, 16 if 0, before it reads again",
    "coalesce": "reads at once what comes within value, s, of the first byte",
    "cut": (
        "a read of the motion connection ends after value bytes, 20 if 0; the next one brings "
        "the rest"
    ),
    "tiny_buffers": "the sockets' buffers are as small as the system allows, from the beginning",
    "e_stop": "the emergency stop is pressed; at the end it is released",
    "e_stop_released": "the emergency stop is pressed and released after value, s",
    "teach": "the pendant's key is turned to teach; at the end to play",
    "remote_off": "remote is turned off; at the end on",
    "servo_off": "the servos are switched off",
    "alarm": "an alarm with the code value; at the end it is cleared",
    "hold": "the pendant's hold is pressed; at the end it is released",
    "lost_outputs": "writing an output is acknowledged, but nothing is set",
    "no_close": "network inputs read 0: no gripper says that it is closed or holds",
}


@dataclass(frozen=True)
class ServerFault:
    """One fault, from a time or a count of points until a time.

    Attributes:
        kind: one of `KINDS`.
        at: begin, s after the server's first poll.
        points: begin once this many points were accepted, in place of `at`.
        until: end, s after the server's first poll.
        value: magnitude, see `KINDS`.
        axis: of the thirteen.

    Raises:
        InputError: the kind is unknown, or a number is invalid.
    """

    kind: str
    at: float = 0.0
    points: int | None = None
    until: float = inf
    value: float = 0.0
    axis: int = 0

    def __post_init__(self) -> None:
        """Check the values."""
        if self.kind not in KINDS:
            raise InputError(f"fault '{self.kind}' is unknown; known: {', '.join(KINDS)}")
        if isnan(self.at) or isnan(self.until) or isnan(self.value):
            raise InputError(f"fault {self.kind}: its times and value must be numbers")
        if not 0 <= self.axis < 13:
            raise InputError(f"fault {self.kind}: axis {self.axis}; 0 to 12")

    @classmethod
    def parse(cls, text: str) -> "ServerFault":
        """Read KIND[=VALUE][@BEGIN[-END]], times in s.

        Raises:
            InputError: the text has another form, or an invalid value.
        """
        head, _, times = text.partition("@")
        kind, _, value = head.partition("=")
        begin, _, end = times.partition("-")
        try:
            numbers = float(begin or 0.0), float(end or inf), float(value or 0.0)
        except ValueError:
            raise InputError(
                f"fault '{text}': write KIND[=VALUE][@BEGIN[-END]] with times in s, as e_stop@5"
            ) from None
        return cls(kind, at=numbers[0], until=numbers[1], value=numbers[2])


class Faults:
    """Keeps track of the active faults.

    Attributes:
        active: active faults by kind.
    """

    def __init__(self, faults: tuple[ServerFault, ...]) -> None:
        """Prepare; no fault is active before the first `update`."""
        self._faults = list(faults)
        self._begun: dict[int, float] = {}
        self._ended: set[int] = set()
        self.active: dict[str, ServerFault] = {}

    def add(self, fault: ServerFault) -> None:
        """Add a fault."""
        self._faults.append(fault)

    def update(self, now: float, points: int) -> tuple[list[ServerFault], list[ServerFault]]:
        """Return the faults that begin and those that end at a time, s, and a count of accepted
        points.
        """
        now += 1e-9  # rounding of the clock
        begun, ended = [], []
        for number, fault in enumerate(self._faults):
            due = now >= fault.at if fault.points is None else points >= fault.points
            if number not in self._begun and due and now < fault.until:
                self._begun[number] = now
                self.active[fault.kind] = fault
                begun.append(fault)
            elif number in self._begun and number not in self._ended and now >= fault.until:
                self._ended.add(number)
                if self.active.get(fault.kind) is fault:
                    del self.active[fault.kind]
                ended.append(fault)
        return begun, ended

    def any_of(self, *kinds: str) -> ServerFault | None:
        """Return the first active fault of these kinds; None if there is none."""
        return next((self.active[kind] for kind in kinds if kind in self.active), None)

    def age(self, fault: ServerFault, now: float) -> float:
        """Return for how long a fault has been active, s."""
        return max(now - self._begun.get(self._faults.index(fault), now), 0.0)


def corrupted(data: bytes, faults: Faults, motion: bool, random: np.random.Generator) -> bytes:
    """Return a message's bytes with the active faults: garbage before them, a wrong length or a
    wrong type.
    """
    for kind in ("garbage", "wrong_length", "huge_length", "wrong_type"):
        fault = faults.active.get(kind)
        if fault is None or (fault.value == 1.0) != motion:
            continue
        if kind == "garbage":
            data = random.bytes(64) + data
        elif kind == "wrong_length":
            data = struct.pack("<i", len(data) + 5) + data[4:]
        elif kind == "huge_length":
            data = struct.pack("<i", 0x7FFFFFFF) + data[4:]
        else:
            data = data[:4] + struct.pack("<i", 9999) + data[8:]
    return data
