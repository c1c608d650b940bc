"""Poll operator, signals, page and executor in turn until an execution has ended.

Every error ends in a stop.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Protocol

from unwrinkle.execution.controls import Instruction, OperatorControls, carry_out
from unwrinkle.execution.executor import PlanExecutor
from unwrinkle.flattening.execution.state import ExecutionResult
from unwrinkle.interrupts import StopSignals
from unwrinkle.models.errors import InputError

#: Period of the loop, s.
PERIOD = 0.02


class Page(Protocol):
    """Page that shows the execution."""

    @property
    def closed(self) -> bool:
        """Return whether the page was open in a browser and is no longer."""
        ...

    def update(self, now: float, text: str) -> Sequence[Instruction]:
        """Show the robot's posture; return the instructions of its buttons since the last call."""
        ...


def run_to_the_end(
    executor: PlanExecutor,
    controls: OperatorControls,
    interrupts: StopSignals,
    *,
    page: Page | None = None,
    tell: Callable[[str], None] = lambda text: None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> ExecutionResult:
    """Run an execution to its end.

    Args:
        executor: executor of the plan.
        controls: instructions of the operator.
        interrupts: signals that end the execution.
        page: page that shows the execution; None for none.
        tell: function that displays a message to the operator when it changes.
        clock: monotonic clock, s.
        sleep: function that waits for a time, s.

    Returns:
        How it ended.

    Raises:
        Exception: an error of this loop, after the robot has come to rest.
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
        controls: OperatorControls,
        interrupts: StopSignals,
        page: Page | None,
        tell: Callable[[str], None],
        begin: float,
    ) -> None:
        self._executor, self._controls, self._interrupts = executor, controls, interrupts
        self._page, self._display, self._begin = page, tell, begin
        self._waiting: list[Instruction] = []
        self._displayed = ""
        self._page_closed = False

    def round(self, now: float) -> None:
        executor = self._executor
        if self._interrupts.name:
            executor.stop(f"{self._interrupts.name} received")
        try:
            instructions = list(self._controls.read())
        except InputError as error:
            # A line that cannot be parsed may have been meant as a stop.
            executor.hold(f"held: {error}")
            instructions = []
        if self._page is not None:
            instructions += self._page.update(now, self._text())
            if self._page.closed and not self._page_closed:
                executor.hold("held: the page was closed")
            self._page_closed = self._page.closed
        self._waiting += instructions
        due = [i for i in self._waiting if i.at is None or now - self._begin >= i.at]
        self._waiting = [i for i in self._waiting if i not in due]
        for instruction in due:
            refused = carry_out(instruction, executor)
            if refused:
                self._tell(f"refused: {refused}")
        executor.poll(now)
        text = self._text()
        if text != self._displayed:
            self._displayed = text
            self._tell(text)

    def _tell(self, text: str) -> None:
        with suppress(OSError):  # a closed terminal must not prevent a stop
            self._display(text)

    def _text(self) -> str:
        executor = self._executor
        if executor.result is not None:
            return f"{executor.result.outcome} {executor.result.reason}".strip()
        held = f", {executor.held}; r or resume goes on, s or stop ends it" if executor.held else ""
        return f"{executor.step} at {executor.speed:.0%}{held}"
