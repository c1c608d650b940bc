"""A virtual pan-tilt unit with the PTU-D46's ASCII protocol, also on a pseudo-terminal."""

import os
import tty
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from unwrinkle.models.errors import InputError

#: Faults of a unit. silent: no replies. noise: random bytes between replies. garbage: random bytes
#: in place of replies. error: every command is refused. stuck: the motors do not turn. limit:
#: reports once that the pan axis has hit its limit.
FAULTS = ("silent", "noise", "garbage", "error", "stuck", "limit")

#: Input-buffer limit, bytes.
_MOST_INPUT = 1 << 12
_AXES = ("P", "T")
_NAMES = {"P": "Pan", "T": "Tilt"}


@dataclass(frozen=True)
class UnitSettings:
    """Properties of a unit.

    Attributes:
        resolution: angle of a position, seconds of arc, pan and tilt.
        pan, tilt: lowest and highest position.
        speeds: lowest and highest target speed, positions/s.
        speed: target speed, positions/s.
        acceleration: positions/s^2.
        echo: whether it echoes commands, as after power-on.
        verbose: whether it replies in sentences, as after power-on.
    """

    resolution: tuple[float, float] = (185.1428, 185.1428)
    pan: tuple[int, int] = (-3090, 3090)
    tilt: tuple[int, int] = (-907, 604)
    speeds: tuple[int, int] = (31, 2902)
    speed: int = 1000
    acceleration: int = 2000
    echo: bool = True
    verbose: bool = True


class Mechanics(Protocol):
    """Motion of the unit's axes."""

    def command(self, pan_steps: int, tilt_steps: int) -> None:
        """Set the goal; the command's time is that of the last call of `position`."""
        ...

    def position(self, now: float) -> tuple[int, int]:
        """Return pan and tilt at a time, s; steps."""
        ...


class SteppedMechanics:
    """Axes with a trapezoidal speed profile; a new command begins at rest."""

    def __init__(self, speed: float, acceleration: float) -> None:
        """Stand at zero.

        Args:
            speed: of both axes, steps/s.
            acceleration: of both axes, steps/s^2.
        """
        self.speed = [speed, speed]
        self.acceleration = [acceleration, acceleration]
        self._now = 0.0
        self._begin = [0.0, 0.0]
        self._origin = [0.0, 0.0]
        self._goal = [0, 0]

    def command(self, pan_steps: int, tilt_steps: int) -> None:
        """Set the goal; an axis that is on its way there already goes on."""
        for axis, goal in enumerate((pan_steps, tilt_steps)):
            if goal != self._goal[axis]:
                self._origin[axis] = self._at(axis, self._now)
                self._goal[axis] = goal
                self._begin[axis] = self._now

    def position(self, now: float) -> tuple[int, int]:
        """Return pan and tilt at a time, s; steps."""
        self._now = now
        return round(self._at(0, now)), round(self._at(1, now))

    def _at(self, axis: int, now: float) -> float:
        way = self._goal[axis] - self._origin[axis]
        length, acceleration = abs(way), self.acceleration[axis]
        if length == 0.0:
            return float(self._goal[axis])
        peak = min(self.speed[axis], float(np.sqrt(length * acceleration)))
        ramp = peak / acceleration
        whole = length / peak + ramp
        t = max(now - self._begin[axis], 0.0)
        left = whole - t
        if left <= 0.0:
            return float(self._goal[axis])
        if t < ramp:
            done = 0.5 * acceleration * t * t
        elif left < ramp:
            done = length - 0.5 * acceleration * left * left
        else:
            done = peak * (t - 0.5 * ramp)
        return self._origin[axis] + float(np.copysign(done, way))


class VirtualSerialPanTilt:
    """The unit at its serial line: bytes in, bytes out, on any clock.

    Attributes:
        faults: of `FAULTS`; may be changed at any time.
        commands: commands received, as "PP100", newest last; the last 1000.
    """

    def __init__(
        self,
        settings: UnitSettings | None = None,
        *,
        mechanics: Mechanics | None = None,
        faults: tuple[str, ...] = (),
        seed: int = 0,
    ) -> None:
        """Switch the unit on, at zero.

        Args:
            settings: of the unit.
            mechanics: motion of its axes; None is `SteppedMechanics`.
            faults: of `FAULTS`.
            seed: of noise.

        Raises:
            InputError: an unknown fault, limits that do not contain zero, or a resolution that is
                not positive.
        """
        self._settings = settings or UnitSettings()
        s = self._settings
        for name in faults:
            if name not in FAULTS:
                raise InputError(
                    f"virtual pan-tilt unit: fault '{name}' is unknown; known: {', '.join(FAULTS)}"
                )
        if not (s.pan[0] <= 0 <= s.pan[1] and s.tilt[0] <= 0 <= s.tilt[1]):
            raise InputError(f"virtual pan-tilt unit: limits {s.pan}, {s.tilt} must hold zero")
        if not min(s.resolution) > 0.0:
            raise InputError(f"virtual pan-tilt unit: resolution {s.resolution} must be positive")
        self._own = SteppedMechanics(s.speed, s.acceleration)
        self._mechanics = mechanics or self._own
        self.faults = set(faults)
        self.commands: list[str] = []
        self._rng = np.random.default_rng(seed)
        self._input = ""
        self._echo, self._verbose, self._immediate = s.echo, s.verbose, True
        self._goal = list(self._mechanics.position(0.0))
        self._slaved = list(self._goal)
        self._awaiting = ""
        self._frozen: tuple[int, int] | None = None

    @property
    def goal(self) -> tuple[int, int]:
        """Commanded pan and tilt, steps."""
        return self._goal[0], self._goal[1]

    def receive(self, data: bytes, now: float) -> bytes:
        """Process bytes written to the unit, and return the bytes that it writes by now.

        Args:
            data: any part of commands; may be empty.
            now: s.
        """
        position = self._position(now)
        if "silent" in self.faults:
            return b""
        out = bytearray(data) if self._echo else bytearray()
        if "limit" in self.faults:
            self.faults.discard("limit")
            out += b"!P\r\n"
        self._input += data.decode("ascii", "replace")
        if self._awaiting and position == self.goal:
            self._answer(out, self._awaiting)
            self._awaiting = ""
        while not self._awaiting:
            word, delimiter, rest = _first_word(self._input)
            if not delimiter:
                break
            self._input = rest
            if word:
                self._obey(word.upper(), self._position(now), out)
        if len(self._input) > _MOST_INPUT:
            self._input = ""
            out += b"! Illegal command\r\n"
        return bytes(out)

    def _position(self, now: float) -> tuple[int, int]:
        position = self._mechanics.position(now)
        if "stuck" not in self.faults:
            self._frozen = None
            return position
        self._frozen = self._frozen or position
        return self._frozen

    def _answer(self, out: bytearray, text: str) -> None:
        def noise() -> bytes:
            return bytes(self._rng.integers(0, 256, 12, dtype=np.uint8)) + b"\r"

        if "garbage" in self.faults:
            out += noise()
            return
        if "noise" in self.faults:
            out += noise()
        out += text.encode("ascii") + b"\r\n"

    def _obey(self, word: str, position: tuple[int, int], out: bytearray) -> None:
        if "error" in self.faults:
            self._answer(out, "! Illegal command")
            return
        self.commands = [*self.commands[-999:], word]
        if word in ("A", "R"):
            goal = self._slaved if word == "A" else [0, 0]
            self._awaiting = "*" if word == "A" else "!T!T!P!P*"
            if not self._immediate or word == "R":
                self._go(goal)
            if position == self.goal:
                self._answer(out, self._awaiting)
                self._awaiting = ""
            return
        self._answer(out, self._reply(word, position))

    def _reply(self, word: str, position: tuple[int, int]) -> str:
        switches = {"FT": ("_verbose", False), "FV": ("_verbose", True), "ED": ("_echo", False)}
        switches |= {"EE": ("_echo", True), "I": ("_immediate", True), "S": ("_immediate", False)}
        if word in switches:
            setattr(self, *switches[word])
            return "*"
        if word in ("CI", "LE"):
            return "*"
        if word == "V":
            return "* Virtual pan-tilt unit, protocol of the PTU-D46"
        if word in ("H", "HP", "HT"):
            here = [
                p if word in ("H", "H" + a) else g
                for a, p, g in zip(_AXES, position, self._goal, strict=True)
            ]
            self._go(here)
            return "*"
        if len(word) < 2 or word[0] not in _AXES:
            return "! Illegal command"
        return self._axis_reply(word, position)

    def _axis_reply(self, word: str, position: tuple[int, int]) -> str:
        axis, what, argument = _AXES.index(word[0]), word[1], word[2:]
        s, name = self._settings, _NAMES[word[0]]
        limits = (s.pan, s.tilt)[axis]
        if not argument:
            answers: dict[str, tuple[str, float]] = {
                "P": (f"Current {name} position is", position[axis]),
                "O": (f"Target {name} position is", self._goal[axis]),
                "R": ("", s.resolution[axis]),
                "N": (f"Minimum {name} position is", limits[0]),
                "X": (f"Maximum {name} position is", limits[1]),
                "S": (f"Target {name} speed is", self._own.speed[axis]),
                "A": (f"{name} acceleration is", self._own.acceleration[axis]),
                "L": (f"Minimum {name} speed is", s.speeds[0]),
                "U": (f"Maximum {name} speed is", s.speeds[1]),
            }
            if what not in answers:
                return "! Illegal command"
            text, value = answers[what]
            number = f"{value:.4f}" if what == "R" else f"{round(value)}"
            return f"* {text} {number}" if self._verbose and text else f"* {number}"
        try:
            value = int(argument)
        except ValueError:
            return "! Illegal argument"
        if what in ("P", "O"):
            wanted = value + (position[axis] if what == "O" else 0)
            if wanted > limits[1]:
                return f"! Maximum allowable {name} position is {limits[1]}"
            if wanted < limits[0]:
                return f"! Minimum allowable {name} position is {limits[0]}"
            self._slaved[axis] = wanted
            if self._immediate:
                goal = list(self._goal)
                goal[axis] = wanted
                self._go(goal)
            return "*"
        if what == "S":
            if not s.speeds[0] <= value <= s.speeds[1]:
                return "! Value out of range"
            self._own.speed[axis] = value
            return "*"
        if what == "A":
            if not 0 < value <= 200000:
                return "! Value out of range"
            self._own.acceleration[axis] = value
            return "*"
        return "! Illegal command"

    def _go(self, goal: list[int]) -> None:
        self._goal, self._slaved = list(goal), list(goal)
        self._mechanics.command(goal[0], goal[1])


class PtyPort:
    """A pseudo-terminal: a driver opens `device` as a serial port, this end belongs to the unit.

    Attributes:
        device: that a driver opens.
        sent: bytes written to the driver.
        received: bytes received from it.
    """

    def __init__(self) -> None:
        """Open a pseudo-terminal."""
        self._unit, self._line = os.openpty()
        tty.setraw(self._line)
        os.set_blocking(self._unit, False)
        self.device = os.ttyname(self._line)
        self._waiting = bytearray()
        self._came = bytearray()
        self.sent = 0
        self.received = 0

    def fileno(self) -> int:
        """Return the file descriptor, for `select`."""
        return self._unit

    def poll(self, core: VirtualSerialPanTilt, now: float) -> None:
        """Pass received bytes to the unit, and write its replies, without waiting."""
        self.take()
        data = bytes(self._came)
        self._came.clear()
        self._waiting += core.receive(data, now)
        self._flush()

    def close(self) -> None:
        """Close both ends; a second call changes nothing."""
        for end in (self._unit, self._line):
            if end >= 0:
                os.close(end)
        self._unit = self._line = -1

    def take(self) -> None:
        """Move the received bytes to the buffer without waiting."""
        with suppress(BlockingIOError):
            data = os.read(self._unit, _MOST_INPUT)
            self.received += len(data)
            self._came += data

    def _flush(self) -> None:
        # A driver that never reads loses bytes, as on a real line.
        with suppress(BlockingIOError):
            count = os.write(self._unit, self._waiting) if self._waiting else 0
            self.sent += count
            del self._waiting[:count]
        del self._waiting[:-_MOST_INPUT]


def _first_word(text: str) -> tuple[str, str, str]:
    """Return the first word, its delimiter (empty while there is none yet), and the rest."""
    for index, letter in enumerate(text):
        if letter in " \r\n":
            return text[:index], letter, text[index + 1 :]
    return text, "", ""
