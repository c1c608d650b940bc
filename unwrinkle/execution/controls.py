"""Instructions of the operator during an execution.

They are keys of a terminal, or lines of a file or pipe.
"""

import os
import select
import stat
import sys
import termios
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from unwrinkle.execution.executor import PlanExecutor
from unwrinkle.models.errors import InputError

HOLD = "hold"
RESUME = "resume"
STOP = "stop"
SPEED = "speed"
ALIVE = "alive"
WORDS = (HOLD, RESUME, STOP, SPEED, ALIVE)
KEYS = "h hold, r resume, s stop, + and - speed, 1 to 9 and 0 speed 10 to 90 and 100 %"
DEAD_MAN_KEY = "keep the space bar pressed; the robot holds when it is released"
#: Change of the speed by the keys + and -, share of the planned speed.
_SPEED_STEP = 0.05
#: Maximum number of bytes per read.
_CHUNK = 4096
#: Maximum length of a command line, characters.
_LONGEST = 200


@dataclass(frozen=True)
class Instruction:
    """One instruction of the operator.

    Attributes:
        word: hold, resume, stop, speed or alive.
        value: for `speed`: share of the planned speed; for the keys + and -, the change of it.
        change: whether the value is a change.
        at: time after the start at which it takes effect, s; None for at once.
    """

    word: str
    value: float = 0.0
    change: bool = False
    at: float | None = None


def parse_instruction(line: str) -> Instruction | None:
    """Parse a line `[@TIME] WORD [VALUE]`, TIME in s after the start.

    An empty line or a comment gives None.

    Raises:
        InputError: the word is unknown, or its number is missing or wrong.
    """
    parts = line.split("#", 1)[0].split()
    if not parts:
        return None
    at = None
    if parts[0].startswith("@"):
        at = _number(parts.pop(0)[1:], line)
    word = parts.pop(0) if parts else ""
    if word not in WORDS or len(parts) != (word == SPEED):
        raise InputError(
            f"'{line.strip()[:60]}' is no command; give hold, resume, stop, speed SHARE or alive, "
            "with @TIME in front to delay it"
        )
    return Instruction(word, _number(parts[0], line) if parts else 0.0, at=at)


def parse_key(key: str) -> Instruction | None:
    """Return the instruction of a key; None for any other key."""
    words = {"h": HOLD, "r": RESUME, "s": STOP, " ": ALIVE}
    if key in words:
        return Instruction(words[key])
    if key in "+-" and key:
        return Instruction(SPEED, _SPEED_STEP if key == "+" else -_SPEED_STEP, change=True)
    if key.isascii() and key.isdigit():
        return Instruction(SPEED, (int(key) or 10) / 10.0)
    return None


def carry_out(instruction: Instruction, executor: PlanExecutor) -> str:
    """Carry out an instruction.

    Returns:
        Why it was refused; empty if it was carried out.
    """
    try:
        if instruction.word == HOLD:
            executor.hold()
        elif instruction.word == RESUME:
            executor.resume()
        elif instruction.word == STOP:
            executor.stop()
        elif instruction.word == ALIVE:
            executor.alive()
        elif instruction.change:
            executor.set_speed(round(executor.speed + instruction.value, 4))
        else:
            executor.set_speed(instruction.value)
    except InputError as error:
        return str(error)
    return ""


class OperatorControls(Protocol):
    """Source of instructions."""

    def read(self) -> Sequence[Instruction]:
        """Return the instructions since the last call, without waiting.

        Raises:
            InputError: a line is no instruction.
        """
        ...


class NoControls:
    """Source without instructions."""

    def read(self) -> Sequence[Instruction]:
        """Return no instruction."""
        return ()


class KeyControls:
    """Keys of a terminal in character mode; see `terminal_keys`."""

    def __init__(self, descriptor: int) -> None:
        """Read from a file descriptor."""
        self._descriptor = descriptor

    def read(self) -> Sequence[Instruction]:
        """Return the instructions of the pressed keys."""
        data = _available(self._descriptor)
        instructions = (parse_key(key) for key in (data or b"").decode("ascii", "replace"))
        return [instruction for instruction in instructions if instruction is not None]


class LineControls:
    """Lines of a file, a pipe or standard input, as they arrive.

    Attributes:
        ended: whether the end of the input was reached.
    """

    def __init__(self, descriptor: int) -> None:
        """Read from a file descriptor."""
        self._descriptor = descriptor
        self._rest = b""
        self.ended = False

    def read(self) -> Sequence[Instruction]:
        """Return the instructions of the lines that have arrived.

        Raises:
            InputError: a line is no instruction.
        """
        data = None if self.ended else _available(self._descriptor)
        if data == b"":
            self.ended = True
            data = b"\n"
        *lines, self._rest = (self._rest + (data or b"")).split(b"\n")
        if len(self._rest) > _LONGEST:
            raise InputError(f"a command line has more than {_LONGEST} characters")
        instructions = (parse_instruction(line.decode("utf-8", "replace")) for line in lines)
        return [instruction for instruction in instructions if instruction is not None]


def _available(descriptor: int) -> bytes | None:
    """Read available bytes without waiting; None if there are none, b"" at the end of the input."""
    if not select.select([descriptor], [], [], 0.0)[0]:
        return None
    with suppress(BlockingIOError):
        return os.read(descriptor, _CHUNK)
    return None


@contextmanager
def open_controls(commands: str | None) -> Iterator[OperatorControls]:
    """Yield the controls: lines of a file or of standard input (`-`), or the terminal's keys.

    Raises:
        InputError: the file cannot be read.
    """
    if commands == "-":
        yield LineControls(sys.stdin.fileno())
    elif commands is not None:
        try:
            path = Path(commands)
            # A named pipe is also opened for writing: otherwise it reports its end whenever no
            # writer is connected.
            pipe = stat.S_ISFIFO(path.stat().st_mode)
            mode = os.O_RDWR if pipe else os.O_RDONLY
            descriptor = os.open(path, mode | os.O_NONBLOCK)
        except OSError as error:
            raise InputError(f"{commands}: cannot be read ({error.strerror or error})") from None
        try:
            yield LineControls(descriptor)
        finally:
            os.close(descriptor)
    else:
        with terminal_keys() as controls:
            yield controls


@contextmanager
def terminal_keys() -> Iterator[OperatorControls]:
    """Yield the keys of the terminal one by one, without echo, while the block runs.

    Without a terminal there are none.
    """
    try:
        descriptor = sys.stdin.fileno()
        before = termios.tcgetattr(descriptor)
    except (OSError, ValueError, termios.error):
        yield NoControls()
        return
    try:
        tty.setcbreak(descriptor)
        yield KeyControls(descriptor)
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _number(text: str, line: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"'{line.strip()[:60]}': '{text}' is no number") from None
