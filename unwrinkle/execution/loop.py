"""Keeps an execution going until it has ended: operator, signals, page and executor, in turn; whatever fails ends in a stop."""

import signal
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import FrameType
from typing import Any, Protocol, Self

from unwrinkle.execution.controls import Controls, Instruction, carry_out
from unwrinkle.execution.executor import ExecutionResult, PlanExecutor
from unwrinkle.models.errors import InputError

#: s between two rounds.
PERIOD = 0.02
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


class Page(Protocol):
    """A page that shows the execution."""

    @property
    def closed(self) -> bool:
        """Whether it was open in a browser, and is no more."""
        ...

    def update(self, now: float, text: str) -> Sequence[Instruction]:
        """Show where the robot is; what was said by buttons since."""
        ...


class Interrupts:
    """While it is open, signals that would end the program end its block instead; armed, they are only noted.

    Attributes:
        armed: whether the robot may be in motion, so that it has to be brought to rest first.
        name: of the first that came while armed; empty if none.
        number: of that signal; 0 if none.
    """

    def __init__(self) -> None:
        """Nothing came yet."""
        self.armed = False
        self.name = ""
        self.number = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        """Take the signals; only a program's main thread can."""
        if threading.current_thread() is threading.main_thread():
            for name in _SIGNALS:
                number = getattr(signal, name)
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the signals as they were."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if not self.armed:
            if number == signal.SIGINT:
                raise KeyboardInterrupt
            raise SystemExit(128 + number)
        if not self.name:
            self.name, self.number = signal.Signals(number).name, number


def run_to_the_end(
    executor: PlanExecutor,
    controls: Controls,
    interrupts: Interrupts,
    *,
    page: Page | None = None,
    tell: Callable[[str], None] = lambda text: None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> ExecutionResult:
    """Run an execution to its end.

    Args:
        executor: of the plan.
        controls: what the operator says.
        interrupts: signals that came.
        page: that shows it; None for none.
        tell: takes what the operator should read, where it changes.
        clock: monotonic, s.
        sleep: waits for a time, s.

    Returns:
        How it ended.

    Raises:
        Exception: what went wrong here, once the robot has been brought to rest.
    """
    loop = _Loop(executor, controls, interrupts, page, tell, clock())
    problem: Exception | None = None
    while executor.result is None:
        try:
            loop.round(clock())
        except Exception as error:
            if problem is not None:
                raise
            problem = error
            executor.stop(f"{type(error).__name__}: {error}")
        sleep(PERIOD)
    if problem is not None:
        raise problem
    return executor.result


class _Loop:
    def __init__(
        self,
        executor: PlanExecutor,
        controls: Controls,
        interrupts: Interrupts,
        page: Page | None,
        tell: Callable[[str], None],
        begin: float,
    ) -> None:
        self._executor, self._controls, self._interrupts = executor, controls, interrupts
        self._page, self._read_by_operator, self._begin = page, tell, begin
        self._waiting: list[Instruction] = []
        self._told = ""
        self._page_closed = False

    def round(self, now: float) -> None:
        executor = self._executor
        if self._interrupts.name:
            executor.stop(f"{self._interrupts.name} received")
        try:
            said = list(self._controls.read())
        except InputError as error:
            # Whoever says what is not understood may have wanted it to stop.
            executor.hold(f"held: {error}")
            said = []
        if self._page is not None:
            said += self._page.update(now, self._text())
            if self._page.closed and not self._page_closed:
                executor.hold("held: the page was closed; r or resume goes on")
            self._page_closed = self._page.closed
        self._waiting += said
        due = [i for i in self._waiting if i.at is None or now - self._begin >= i.at]
        self._waiting = [i for i in self._waiting if i not in due]
        for instruction in due:
            refused = carry_out(instruction, executor, now)
            if refused:
                self._tell(f"refused: {refused}")
        executor.poll(now)
        text = self._text()
        if text != self._told:
            self._told = text
            self._tell(text)

    def _tell(self, text: str) -> None:
        with suppress(OSError):  # a terminal that is gone keeps nothing from stopping
            self._read_by_operator(text)

    def _text(self) -> str:
        executor = self._executor
        if executor.result is not None:
            return f"{executor.result.outcome} {executor.result.reason}".strip()
        held = f", {executor.held}" if executor.held else ""
        if held and "goes on" not in held:
            held += "; r or resume goes on, s or stop ends it"
        return f"{executor.step} at {executor.speed:.0%}{held}"
