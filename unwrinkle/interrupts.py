"""Signals that end a motion: recorded, so that the arms come to rest first."""

import signal
import threading
from types import FrameType
from typing import Any, Self

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


class StopSignals:
    """Catch signals that would end the program, while the block runs.

    They end the block; while `armed`, they are only recorded.

    Attributes:
        armed: whether the robot may be moving and must be brought to rest first.
        name: name of the first signal while armed; empty if there was none.
        number: number of that signal; 0 if there was none.
    """

    def __init__(self, *, armed: bool = False, second_raises: bool = False) -> None:
        """Start without a signal.

        Args:
            armed: see the attribute.
            second_raises: whether a second signal while armed raises KeyboardInterrupt: for a block
                whose computations last longer than a motion.
        """
        self.armed = armed
        self.name = ""
        self.number = 0
        self._second_raises = second_raises
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        """Install the signal handlers; only the main thread of a program can."""
        if threading.current_thread() is threading.main_thread():
            for name in _SIGNALS:
                number = getattr(signal, name)
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the signal handlers."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if not self.armed:
            if number == signal.SIGINT:
                raise KeyboardInterrupt
            raise SystemExit(128 + number)
        if self.name and self._second_raises:
            raise KeyboardInterrupt
        if not self.name:
            self.name, self.number = signal.Signals(number).name, number
