"""Driver of a pan-tilt unit (PTU-D46) on a serial port: whole steps, the unit's own limits, and
when it is at rest.
"""

import logging
import re
from collections import deque
from math import inf, isfinite, pi

from unwrinkle.hardware.pan_tilt.base import PanTiltState, PanTiltStatus
from unwrinkle.hardware.pan_tilt.serial_port import SerialPort
from unwrinkle.hardware.steady_clock import SteadyClock
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import PanTiltSite

_log = logging.getLogger(__name__)


STARTING, READY, MOVING, SETTLING, FAULT = PanTiltState

#: One second of arc, rad.
ARC_SECOND = pi / (180.0 * 3600.0)

#: Limit of attempts per request.
_ATTEMPTS = 3
#: Silence of the line before a request is repeated after an invalid reply or none, s.
_QUIET_S = 0.05
#: Limit of bytes on a line that does not become silent.
_MOST_NOISE = 1 << 12
#: Between two reads of the position at rest, s.
_HEARTBEAT_S = 1.0
#: Largest relative difference of the unit's resolution and the calibration's.
_RESOLUTION_TOLERANCE = 1e-3
#: Longest line that is stored, characters.
_MOST_LINE = 256

#: Letters of the axes in commands.
_AXES = ("P", "T")
#: Names of the axes for messages.
_NAMES = {"P": "pan", "T": "tilt"}
_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")
_LIMIT_HIT = re.compile(r"!([PT])(?![A-Za-z])")
# Requests at the start: terse replies, no echo, position control, immediate execution; then
# resolutions and limits.
_SETUP = ("FT", "ED", "CI", "I")
_FACTS = ("PR", "TR", "PN", "PX", "TN", "TX")
_WHOLE = re.compile(r"[+-]?\d+")
_MEANINGS = {
    "maximum": "it is above its largest position",
    "minimum": "it is below its smallest position",
    "illegal": "it does not understand the command",
    "value": "the value is out of range",
}
_REFUSALS = tuple(_MEANINGS)


class PanTiltDriver:
    """Drives one unit by `poll`, with one request on the line at a time.

    A request without a valid reply is sent three times; commands name absolute positions, so
    repeating one is harmless. The driver never resets the unit, since a reset moves it to its
    stops.
    """

    def __init__(
        self, port: SerialPort, site: PanTiltSite, expected_step: float | None, name: str
    ) -> None:
        """Prepare; the first `poll` begins.

        Args:
            port: of the unit.
            site: times.
            expected_step: angle of a position in the head's calibration, rad; None accepts what the
                unit reports.
            name: of the unit, for messages, as "left pan-tilt unit (/dev/ttyUSB0)".
        """
        self.name = name
        self._port, self._site, self._expected = port, site, expected_step
        self._line = bytearray()
        self._clock, self._now = SteadyClock(), 0.0
        self._begin()
        self._number, self._reason = 0, ""

    def _begin(self) -> None:
        self._state = STARTING
        self._facts: dict[str, float] = {}
        self._requests = deque([*_SETUP, *_FACTS])
        self._asked, self._asked_at, self._attempts = "", 0.0, 0
        self._quiet_until: float | None = -inf
        self._noise = 0
        self._position: list[int | None] = [None, None]
        self._read: list[int | None] = [None, None]
        self._goal: list[int] | None = None
        self._since = 0.0
        self._moving_since = 0.0
        self._next_look = 0.0
        self._fault = ""
        self._pending: tuple[float, float] | None = None

    @property
    def status(self) -> PanTiltStatus:
        """State as of the last poll."""
        pan, tilt = (
            0.0 if position is None else position * self._step(axis)
            for axis, position in zip(_AXES, self._position, strict=True)
        )
        still = self._state == READY and self._pending is None
        return PanTiltStatus(self._state, self._number, still, pan, tilt, self._reason)

    @property
    def steps(self) -> tuple[float, float]:
        """Angle of one position of pan and tilt, rad; 0 before the unit has reported it."""
        return self._step("P"), self._step("T")

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lower and upper limit of pan and tilt, rad; 0 before the unit has reported them."""
        pan, tilt = (
            (
                self._facts.get(a + "N", 0) * self._step(a),
                self._facts.get(a + "X", 0) * self._step(a),
            )
            for a in _AXES
        )
        return pan, tilt

    def goto(self, number: int, pan: float, tilt: float) -> None:
        """Go to angles, rad, in whole steps; `status` reports the result.

        Beyond the limits, or in a fault, the command is refused and nothing is sent; a motion under
        way goes on. While the unit is starting, the command waits for its limits.

        Args:
            number: counts up; one that is not above the last command's changes nothing.
            pan, tilt: rad.
        """
        if number <= self._number:
            return
        self._number, self._pending = number, None
        if self._state == FAULT:
            self._reason = f"{self._fault}; it has to be restarted before it moves"
            return
        self._reason = ""
        if self._state == STARTING:
            self._pending = (pan, tilt)
        else:
            self._accept(pan, tilt)

    def restart(self) -> None:
        """Leave a fault: read the unit's resolution and limits again; nothing moves."""
        self._begin()
        self._reason = ""

    def close(self) -> None:
        """Close the port; nothing is sent."""
        self._port.close()

    def poll(self, now: float) -> None:
        """Read, decide and write without waiting.

        Args:
            now: of any clock, s.
        """
        now = self._now = self._clock.at(now)
        if self._state == FAULT:
            return
        try:
            data = self._port.read()
            if self._quiet_until is not None:
                self._await_silence(data, self._quiet_until)
            else:
                self._receive(data)
                if self._asked and now - self._asked_at > self._site.reply_timeout:
                    self._again("no answer")
            self._progress()
            self._ask()
        except HardwareError as error:
            self._fail(str(error))

    def _await_silence(self, data: bytes, until: float) -> None:
        self._noise += len(data)
        if self._noise > _MOST_NOISE:
            self._fail(f"its line is never quiet: {self._noise} bytes came unasked")
        elif data or until == -inf:
            self._quiet_until = self._now + _QUIET_S
        elif self._now >= until:
            self._quiet_until, self._noise = None, 0

    def _receive(self, data: bytes) -> None:
        for byte in data:
            if byte in b"\r\n":
                line = self._line.decode("ascii", "replace").strip()
                self._line.clear()
                if line:
                    self._take(line)
                if self._quiet_until is not None or self._state == FAULT:
                    return
            elif len(self._line) < _MOST_LINE:
                self._line.append(byte)

    def _take(self, line: str) -> None:
        """Process one line: a reply, with an echo or noise before it."""
        for axis in _LIMIT_HIT.findall(line):
            self._limit_hit(axis)
        line = _LIMIT_HIT.sub("", line)
        marks = [place for mark in "*!" if (place := line.find(mark)) >= 0]
        if not marks or not self._asked or self._state == FAULT:
            return  # an echo, noise, or a reply without a request
        mark, text = line[min(marks)], line[min(marks) + 1 :].strip()
        if mark == "!":
            self._refused(text)
        elif self._asked in _FACTS or self._asked in ("PP", "TP"):
            pattern = _NUMBER if self._asked in ("PR", "TR") else _WHOLE
            if pattern.fullmatch(text):
                self._answered(float(text))
            else:
                self._again(f"an answer that is no number: {text[:40]!r}")
        elif text and self._state != STARTING:
            self._again(f"an answer that is none: {text[:40]!r}")
        else:
            self._answered(0.0)

    def _ask(self) -> None:
        if self._asked or self._state == FAULT or self._quiet_until is not None:
            return
        if self._requests:
            self._asked = self._requests.popleft()
            self._asked_at = self._now
            self._line.clear()  # bytes before the request are not its reply
            self._port.write(self._asked.encode("ascii") + b"\r")

    def _again(self, why: str) -> None:
        """Repeat the request once the line is silent: a late reply must not be taken for the next
        one.
        """
        question, self._asked = self._asked, ""
        self._attempts += 1
        if self._attempts >= _ATTEMPTS:
            self._fail(
                f"{why} to {question} in {_ATTEMPTS} attempts of {self._site.reply_timeout:g} s; "
                f"is it switched on, is its cable in, and does it run at {self._site.baud} baud?"
            )
            return
        _log.debug("%s: %s to %s; asking again", self.name, why, question)
        self._requests.appendleft(question)
        self._line.clear()
        self._quiet_until = self._now + _QUIET_S

    def _answered(self, value: float) -> None:
        question, self._asked, self._attempts = self._asked, "", 0
        if question in _FACTS:
            self._facts[question] = value
            if question == _FACTS[-1]:
                self._introduced()
        elif question in ("PP", "TP"):
            axis = _AXES.index(question[0])
            self._read[axis] = round(value)

    def _introduced(self) -> None:
        for axis in _AXES:
            step, lower, upper = self._step(axis), self._facts[axis + "N"], self._facts[axis + "X"]
            if not step > 0.0 or not lower <= upper:
                self._fail(
                    f"it reports a resolution of {step:g} rad and {_NAMES[axis]} limits {lower:g} "
                    f"to {upper:g}, which cannot be"
                )
                return
            if (
                self._expected is not None
                and abs(step / self._expected - 1.0) > _RESOLUTION_TOLERANCE
            ):
                self._fail(
                    f"its {_NAMES[axis]} resolution is {step / ARC_SECOND:.4f} seconds of arc per "
                    f"position, the head's file expects {self._expected / ARC_SECOND:.4f}; set the "
                    "unit's step mode (WP, WT), or calibrate the head anew"
                )
                return

    def _refused(self, text: str) -> None:
        question, self._asked = self._asked, ""
        motion = question[:2] in ("PP", "TP") and len(question) > 2
        if not motion or not text.lower().startswith(_REFUSALS):
            # On a disturbed line a valid command may arrive as an illegal one, and noise may look
            # like a refusal.
            self._asked = question
            self._again(f"the refusal '{text[:60]}'")
            return
        self._attempts = 0
        self._requests.clear()
        self._goal = None
        self._reason = (
            f"{self.name} refuses {_NAMES[question[0]]} position {question[2:]}: "
            f"{_in_plain_words(text)}"
        )

    def _limit_hit(self, axis: str) -> None:
        if self._state == STARTING:
            return  # from an earlier reset
        self._fail(
            f"its {_NAMES[axis]} axis has hit its stop and has lost count of its position; clear "
            "its way, reset it by hand (command R, which moves it), then restart it"
        )

    def _progress(self) -> None:
        if self._state == FAULT or self._asked or self._requests:
            return
        read = self._read
        if read[0] is not None and read[1] is not None:
            self._stands(read[0], read[1])
            self._read = [None, None]
        if self._state == FAULT:
            return
        if self._state == SETTLING and self._now - self._since >= self._site.settle:
            self._state = READY
            self._next_look = self._now + _HEARTBEAT_S
        if self._state != READY or self._now >= self._next_look:
            self._requests.extend(("PP", "TP"))

    def _stands(self, pan: int, tilt: int) -> None:
        """Process the positions of both axes; detect whether the unit has come to rest."""
        same = self._position == [pan, tilt]
        self._position = [pan, tilt]
        if self._state == STARTING:
            self._state, self._moving_since = MOVING, self._now
            if self._pending is not None:
                self._accept(*self._pending)
            return
        there = same and (self._goal is None or self._goal == [pan, tilt])
        if self._state == MOVING:
            if there:
                self._state, self._since = SETTLING, self._now
            elif self._now - self._moving_since > self._site.motion_timeout:
                goal = self._goal or [pan, tilt]
                self._fail(
                    f"it has not come to rest at {goal[0]}, {goal[1]} (pan, tilt positions) within "
                    f"{self._site.motion_timeout:g} s; it stands at {pan}, {tilt}; is its way "
                    "clear?"
                )
        elif not there:
            # It is turned from outside, or an axis coasts: not at rest before its position is
            # constant again.
            self._goal, self._state, self._moving_since = None, MOVING, self._now
        else:
            self._next_look = self._now + _HEARTBEAT_S

    def _accept(self, pan: float, tilt: float) -> None:
        self._pending = None
        wanted: list[int] = []
        for axis, angle in zip(_AXES, (pan, tilt), strict=True):
            reason = self._beyond(axis, angle)
            if reason:
                self._reason = reason
                return
            wanted.append(round(angle / self._step(axis)))
        # A request under way is answered first; its reply describes the time before this motion.
        self._read = [None, None]
        self._requests = deque(f"{a}P{w}" for a, w in zip(_AXES, wanted, strict=True))
        self._goal, self._state, self._moving_since = wanted, MOVING, self._now

    def _beyond(self, axis: str, angle: float) -> str:
        step, (lower, upper) = self._step(axis), self.limits[_AXES.index(axis)]
        if not isfinite(angle):
            return f"{self.name}: {_NAMES[axis]} is {angle}; give a finite angle in radians"
        if not lower - 0.5 * step <= angle <= upper + 0.5 * step:
            over = max(lower - angle, angle - upper)
            return (
                f"{self.name}: {_NAMES[axis]} {angle:.4f} rad is beyond its limits {lower:.4f} to "
                f"{upper:.4f} by {over:.4f}; angles are in radians, look elsewhere"
            )
        return ""

    def _step(self, axis: str) -> float:
        return self._facts.get(axis + "R", 0.0) * ARC_SECOND

    def _fail(self, reason: str) -> None:
        self._fault = f"{self.name}: {reason}"
        self._state, self._reason = FAULT, self._fault
        self._requests.clear()
        self._asked, self._pending = "", None
        _log.warning("%s", self._reason)


def _in_plain_words(text: str) -> str:
    word = next(word for word in _REFUSALS if text.lower().startswith(word))
    return f"{_MEANINGS[word]} ('{text[:80]}')"
