"""Running the loop: the diagram moves on period by period, while others watch; whatever happens ends at rest."""

import gc
import logging
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from types import FrameType
from typing import Protocol

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from unwrinkle.closed_loop.setup import Loop
from unwrinkle.closed_loop.station_view import StationView
from unwrinkle.flattening.state import RunStatus, SupervisorState
from unwrinkle.models.errors import UnwrinkleError
from unwrinkle.systems.diagram import supervisor_state

#: Most time that the arms are given to come to rest once a run is over, on the station's clock, s.
LAST_REST = 5.0
_REST_SPEED = 2e-3  # rad/s

_log = logging.getLogger(__name__)


@dataclass
class Seconds:
    """Wall clock that the current look and its action have taken, by the supervisor's state.

    Attributes:
        look: number of the look.
        by_mode: s.
    """

    look: int = 0
    by_mode: dict[str, float] = field(default_factory=dict)

    def of(self, *modes: str) -> float:
        """Sum over some states, s."""
        return sum(self.by_mode.get(mode, 0.0) for mode in modes)


class Watcher(Protocol):
    """Whoever wants to know how the run goes."""

    def update(
        self, before: SupervisorState, now: SupervisorState, station: StationView, seconds: Seconds
    ) -> None:
        """Take note of one feedback period.

        Args:
            before: the supervisor's state before it; `now` is the same object where nothing has changed.
            now: after it.
            station: after it.
            seconds: of the look that `before` belongs to, up to now.
        """


@dataclass(frozen=True)
class Ending:
    """How a run ended.

    Attributes:
        status: flat, stopped, fault or interrupted.
        reason: in words.
        supervisor_state: the supervisor's last state.
        duration: wall clock, s.
    """

    status: str
    reason: str
    supervisor_state: SupervisorState
    duration: float


class FlatteningRun:
    """One run of a loop."""

    def __init__(self, loop: Loop, watchers: tuple[Watcher, ...] = ()) -> None:
        """Prepare the simulator.

        Args:
            loop: what to run.
            watchers: are told of every period, in order.
        """
        self._loop, self._watchers = loop, watchers
        self._period = loop.cell.scenario.station.feedback_period
        self._simulator = Simulator(loop.diagram)
        self._seconds = Seconds()
        self._steps = 0
        self._due = time.monotonic()
        context = self._simulator.get_mutable_context()
        self._interrupt = loop.diagram.GetInputPort("interrupt")
        self._interrupt.FixValue(context, [0.0])
        self.station = StationView(loop.station, context, loop.cloth)

    @property
    def context(self) -> Context:
        """The diagram's."""
        return self._simulator.get_mutable_context()

    @property
    def supervisor_state(self) -> SupervisorState:
        """The supervisor's state."""
        return supervisor_state(self._loop.diagram, self.context)

    def run(self, interrupted: Callable[[], bool] = lambda: False) -> Ending:
        """Run until the loop ends, and leave the arms at rest.

        Args:
            interrupted: asked in every period; once it says yes, what moves is held and the run ends.

        Raises:
            Exception: what a watcher or the station raised, after the arms were brought to rest.
        """
        clock = time.perf_counter()
        self._simulator.Initialize()
        try:
            while not self.supervisor_state.over:
                if interrupted():
                    self._interrupt.FixValue(self.context, [1.0])
                self._period_on()
        except BaseException:
            self._bring_to_rest()
            raise
        self._rest()
        now = self.supervisor_state
        return Ending(now.status, now.reason, now, time.perf_counter() - clock)

    def _period_on(self) -> None:
        before = self.supervisor_state
        clock = time.perf_counter()
        self._advance()
        now = self.supervisor_state
        mode, spent = before.mode, time.perf_counter() - clock
        if before.action.look != self._seconds.look:
            if self._loop.real:
                gc.collect()  # the arms rest now, see `garbage`
            self._seconds = Seconds(before.action.look)
        by_mode = self._seconds.by_mode
        by_mode[mode] = by_mode.get(mode, 0.0) + spent
        for watcher in self._watchers:
            watcher.update(before, now, self.station, self._seconds)

    def _advance(self) -> None:
        self._steps += 1  # times are multiples of the period, not sums of it
        self._simulator.AdvanceTo(self._steps * self._period)
        if self._loop.real:
            self._await_due()

    def _await_due(self) -> None:
        """Let real devices have their time; what was lost with computing is not made up."""
        now = time.monotonic()
        self._due = max(self._due + self._period, now)
        time.sleep(self._due - now)

    def _rest(self) -> None:
        """Let the braking that a fault or an interrupt began come to its end."""
        for _ in range(round(LAST_REST / self._period)):
            if np.abs(self.station.velocities).max() < _REST_SPEED:
                return
            self._advance()
        _log.error("the arms did not come to rest within %g s", LAST_REST)

    def _bring_to_rest(self) -> None:
        """Hold, after something went wrong outside the supervisor; what fails again cannot be helped."""
        with suppress(Exception, KeyboardInterrupt):
            self._interrupt.FixValue(self.context, [1.0])
            for _ in range(round(LAST_REST / self._period)):
                if self.supervisor_state.over:
                    break
                self._advance()
            self._rest()


def failure(error: BaseException) -> tuple[str, str]:
    """Status and reason of a run that an exception ended."""
    text = " ".join(str(error).split())
    if isinstance(error, UnwrinkleError):
        return RunStatus.FAULTED, text
    return RunStatus.FAULTED, f"{type(error).__name__}: {text}"


class Interrupts:
    """Whether SIGINT or SIGTERM came; the first asks for a quiet end, a second SIGINT ends at once."""

    def __init__(self) -> None:
        """None came yet."""
        self.name = ""

    def __call__(self) -> bool:
        """Whether one came."""
        return bool(self.name)

    def note(self, number: int, frame: FrameType | None) -> None:
        """Take a signal.

        Raises:
            KeyboardInterrupt: it is the second one.
        """
        if self.name:
            raise KeyboardInterrupt
        self.name = signal.Signals(number).name


@contextmanager
def caught_interrupts() -> Iterator[Interrupts]:
    """Note SIGINT and SIGTERM instead of being ended by them."""
    interrupts = Interrupts()
    before = {
        number: signal.signal(number, interrupts.note) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
