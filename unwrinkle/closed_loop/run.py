"""Run the closed loop: advance the diagram period by period and call the watchers.

Every run ends at rest.
"""

import gc
import logging
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from unwrinkle.closed_loop.setup import Loop
from unwrinkle.closed_loop.station_view import StationView
from unwrinkle.flattening.state import RunStatus, SupervisorState
from unwrinkle.models.errors import UnwrinkleError
from unwrinkle.planning.arrival import ARRIVED_SPEED_RAD_S
from unwrinkle.systems.diagram import supervisor_state

#: Maximum time for the arms to come to rest at the end of a run, s on the station's clock.
LAST_REST = 5.0

_log = logging.getLogger(__name__)


@dataclass
class Seconds:
    """Wall-clock time of the current look and its action, by the supervisor's state.

    Attributes:
        look: number of the look.
        by_mode: time in each state, s.
    """

    look: int = 0
    by_mode: dict[str, float] = field(default_factory=dict)

    def of(self, *modes: str) -> float:
        """Return the total of some states, s."""
        return sum(self.by_mode.get(mode, 0.0) for mode in modes)


class Watcher(Protocol):
    """Observer of a run."""

    def update(
        self, before: SupervisorState, now: SupervisorState, station: StationView, seconds: Seconds
    ) -> None:
        """Process one feedback period.

        Args:
            before: the supervisor's state before it; the same object as `now` if nothing has
                changed.
            now: the supervisor's state after it.
            station: the station after it.
            seconds: times of the look that `before` belongs to, up to now.
        """


@dataclass(frozen=True)
class RunEnding:
    """Result of a run.

    Attributes:
        status: flat, stopped, fault or interrupted.
        reason: one sentence.
        supervisor_state: the supervisor's last state.
        duration: wall-clock time, s.
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
            loop: loop to run.
            watchers: observers, called in order after every period.
        """
        self._loop, self._watchers = loop, watchers
        self._period = loop.station.cell.scenario.station.feedback_period
        self._simulator = Simulator(loop.diagram)
        self._seconds = Seconds()
        self._steps = 0
        self._due = time.monotonic()
        context = self._simulator.get_mutable_context()
        self._interrupt = loop.diagram.GetInputPort("interrupt")
        self._interrupt.FixValue(context, [0.0])
        self.station = StationView(loop.station, context)

    @property
    def context(self) -> Context:
        """Return the diagram's context."""
        return self._simulator.get_mutable_context()

    @property
    def supervisor_state(self) -> SupervisorState:
        """Return the supervisor's state."""
        return supervisor_state(self._loop.diagram, self.context)

    def run(self, interrupted: Callable[[], bool] = lambda: False) -> RunEnding:
        """Run until the loop ends, and leave the arms at rest.

        Args:
            interrupted: called in every period; a true value holds the motion and ends the run.

        Raises:
            Exception: an error of a watcher or the station, after the arms have come to rest.
        """
        clock = time.perf_counter()
        self._simulator.Initialize()
        with ExitStack() as on_error:
            on_error.callback(self._bring_to_rest)
            while not self.supervisor_state.over:
                if interrupted():
                    self._interrupt.FixValue(self.context, [1.0])
                self._period_on()
            on_error.pop_all()
        self._rest()
        now = self.supervisor_state
        return RunEnding(now.status, now.reason, now, time.perf_counter() - clock)

    def _period_on(self) -> None:
        before = self.supervisor_state
        clock = time.perf_counter()
        self._advance()
        now = self.supervisor_state
        mode, spent = before.mode, time.perf_counter() - clock
        if before.action.look != self._seconds.look:
            if self._loop.station.real:
                gc.collect()  # the arms are at rest here, see `garbage`
            self._seconds = Seconds(before.action.look)
        by_mode = self._seconds.by_mode
        by_mode[mode] = by_mode.get(mode, 0.0) + spent
        for watcher in self._watchers:
            watcher.update(before, now, self.station, self._seconds)

    def _advance(self) -> None:
        self._steps += 1  # a multiple of the period has no accumulated error of rounding
        self._simulator.AdvanceTo(self._steps * self._period)
        if self._loop.station.real:
            self._await_due()

    def _await_due(self) -> None:
        """Wait for the next period of real time; time lost in computing is not made up."""
        now = time.monotonic()
        self._due = max(self._due + self._period, now)
        time.sleep(self._due - now)

    def _rest(self) -> None:
        """Advance until the arms have come to rest after a fault or an interrupt."""
        for _ in range(round(LAST_REST / self._period)):
            if np.abs(self.station.velocities).max() <= ARRIVED_SPEED_RAD_S:
                return
            self._advance()
        _log.error("the arms did not come to rest within %g s", LAST_REST)

    def _bring_to_rest(self) -> None:
        """Hold after an error outside the supervisor.

        A second error is ignored, so that the first one is raised.
        """
        with suppress(Exception, KeyboardInterrupt):
            self._interrupt.FixValue(self.context, [1.0])
            for _ in range(round(LAST_REST / self._period)):
                if self.supervisor_state.over:
                    break
                self._advance()
            self._rest()


def failure(error: BaseException) -> tuple[str, str]:
    """Return the status and reason of a run that an exception ended."""
    text = " ".join(str(error).split())
    if isinstance(error, UnwrinkleError):
        return RunStatus.FAULTED, text
    return RunStatus.FAULTED, f"{type(error).__name__}: {text}"
