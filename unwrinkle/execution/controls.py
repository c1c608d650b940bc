"""What an operator can say while a plan is executed: keys of a terminal, or lines of a file or pipe."""

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

HOLD, RESUME, STOP, SPEED, ALIVE = "hold", "resume", "stop", "speed", "alive"
WORDS = (HOLD, RESUME, STOP, SPEED, ALIVE)
KEYS = "h hold, r resume, s stop, + and - speed, 1 to 9 and 0 speed 10 to 90 and 100 %"
DEAD_MAN_KEY = "keep the space bar pressed: released, the robot holds"
#: Steps of the keys + and -.
_STEP = 0.05
_CHUNK = 4096
#: A line longer than this is no command.
_LONGEST = 200


@dataclass(frozen=True)
class Instruction:
    """One thing said.

    Attributes:
        word: hold, resume, stop, speed or alive.
        value: of `speed`: share of the planned speed; of a key + or -, the change.
        change: whether the value is a change.
        at: s after the begin at which it counts; None at once.
    """

    word: str
    value: float = 0.0
    change: bool = False
    at: float | None = None


def parse_instruction(line: str) -> Instruction | None:
    """Read a line: `[@TIME] WORD [VALUE]`, TIME in s after the begin; None for an empty one or a comment.

    Raises:
        InputError: it is none of the known words, or its number is missing or wrong.
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
            f"'{line.strip()[:60]}' is no command; known: hold, resume, stop, speed SHARE, alive, each with @TIME "
            "before it where it shall wait"
        )
    return Instruction(word, _number(parts[0], line) if parts else 0.0, at=at)


def parse_key(key: str) -> Instruction | None:
    """What a key means; None for any other."""
    words = {"h": HOLD, "r": RESUME, "s": STOP, " ": ALIVE}
    if key in words:
        return Instruction(words[key])
    if key in "+-" and key:
        return Instruction(SPEED, _STEP if key == "+" else -_STEP, change=True)
    if key.isascii() and key.isdigit():
        return Instruction(SPEED, (int(key) or 10) / 10.0)
    return None


def carry_out(instruction: Instruction, executor: PlanExecutor, now: float) -> str:
    """Do what was said.

    Returns:
        Why it was refused; empty if it was done.
    """
    try:
        if instruction.word == HOLD:
            executor.hold()
        elif instruction.word == RESUME:
            executor.resume()
        elif instruction.word == STOP:
            executor.stop()
        elif instruction.word == ALIVE:
            executor.alive(now)
        elif instruction.change:
            executor.set_speed(round(executor.speed + instruction.value, 4))
        else:
            executor.set_speed(instruction.value)
    except InputError as error:
        return str(error)
    return ""


class Controls(Protocol):
    """Where instructions come from."""

    def read(self) -> Sequence[Instruction]:
        """What was said since the last time; never waits.

        Raises:
            InputError: something was said that is none.
        """
        ...


class NoControls:
    """Nobody says anything."""

    def read(self) -> Sequence[Instruction]:
        """Nothing."""
        return ()


class KeyControls:
    """Keys of a terminal that was set to give them at once; see `terminal_keys`."""

    def __init__(self, descriptor: int) -> None:
        """Read from a descriptor."""
        self._descriptor = descriptor

    def read(self) -> Sequence[Instruction]:
        """What the keys that were pressed mean."""
        data = _available(self._descriptor)
        said = (parse_key(key) for key in (data or b"").decode("ascii", "replace"))
        return [instruction for instruction in said if instruction is not None]


class LineControls:
    """Lines of a file, a pipe or standard input, as they come.

    Attributes:
        ended: whether no more will come.
    """

    def __init__(self, descriptor: int) -> None:
        """Read from a descriptor."""
        self._descriptor = descriptor
        self._rest = b""
        self.ended = False

    def read(self) -> Sequence[Instruction]:
        """What the lines that have come say.

        Raises:
            InputError: one says nothing that is known.
        """
        data = None if self.ended else _available(self._descriptor)
        if data == b"":
            self.ended = True
            data = b"\n"
        *lines, self._rest = (self._rest + (data or b"")).split(b"\n")
        if len(self._rest) > _LONGEST:
            raise InputError(f"a command has more than {_LONGEST} characters")
        said = (parse_instruction(line.decode("utf-8", "replace")) for line in lines)
        return [instruction for instruction in said if instruction is not None]


def _available(descriptor: int) -> bytes | None:
    """What can be read without waiting; None if nothing, b"" at the end."""
    if not select.select([descriptor], [], [], 0.0)[0]:
        return None
    with suppress(BlockingIOError):
        return os.read(descriptor, _CHUNK)
    return None


@contextmanager
def open_controls(commands: str | None) -> Iterator[Controls]:
    """Give the controls: a file, `-` for standard input's lines, else the terminal's keys if there is one.

    Raises:
        InputError: the file cannot be read.
    """
    if commands == "-":
        yield LineControls(sys.stdin.fileno())
    elif commands is not None:
        try:
            path = Path(commands)
            # A named pipe is also opened for writing: else it ends before and after each who writes.
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
def terminal_keys() -> Iterator[Controls]:
    """Give the keys of the terminal one by one, unechoed, while the body runs; none where there is no terminal."""
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
