"""Drake system of the grippers' driver."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from unwrinkle.flattening.station_messages import GripperCommand, GripperStatus
from unwrinkle.hardware.grippers.base import Grippers
from unwrinkle.hardware.run_log.protocol import NoLog, RunLogger
from unwrinkle.systems.abstract_state import set_state_value, state_value
from unwrinkle.systems.station.drivers.device_clock import Clock, diagram_time


class GripperDriverSystem(LeafSystem):
    """Pass commands to the driver of both grippers.

    Inputs: `command`. Outputs: `status`; for a gripper that does not measure its opening, the
    opening is that of an open gripper or 0.
    """

    def __init__(
        self,
        grippers: Grippers,
        opening: float,
        *,
        period: float,
        clock: Clock = diagram_time,
        open_first: bool = False,
        log: RunLogger | None = None,
    ) -> None:
        """Wrap a driver.

        Args:
            grippers: driver of the grippers, polled here.
            opening: opening of an open gripper, m.
            period: polling period, s.
            clock: function that gives the driver's time.
            open_first: whether to open both grippers first, since plans start with open grippers.
            log: run log of the commands.
        """
        super().__init__()
        self.set_name("gripper driver")
        self._grippers, self._open, self._clock = grippers, opening, clock
        self._sent = 0
        self._log: RunLogger = log or NoLog()
        self._before = int(open_first)
        if open_first:
            grippers.command(1, (False, False))
        self._command = self.DeclareAbstractInputPort("command", Value(GripperCommand()))
        first = GripperStatus(opening=(opening, opening))
        self._state = self.DeclareAbstractState(Value(first))
        self.DeclareAbstractOutputPort(
            "status",
            lambda: Value(GripperStatus()),
            self._shown(lambda context: state_value(context, self._state)),
            {self.abstract_state_ticket(self._state)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _shown(self, read: Callable[[Context], Any]) -> Callable[[Context, Any], None]:
        return lambda context, output: output.set_value(read(context))

    def _update(self, context: Context, state: State) -> None:
        command: GripperCommand = self._command.Eval(context)
        if command.number > self._sent:
            self._sent = command.number
            self._grippers.command(command.number + self._before, command.closed)
            closed = [bool(c) for c in command.closed]
            text = ", ".join("close" if c else "open" for c in closed) + " (right, left)"
            with suppress(
                OSError
            ):  # the controller's driver ends a motion whose log cannot be written
                self._log.event(self._clock(context.get_time()), "gripper", text, closed=closed)
        self._grippers.poll(self._clock(context.get_time()))
        report = self._grippers.status
        right, left = report.closed
        opening = report.opening or (self._open * (not right), self._open * (not left))
        # Without a sensor a closed gripper is assumed to hold cloth: the next look shows the
        # effect.
        held_right, held_left = (
            c if h is None else h for c, h in zip(report.closed, report.holding, strict=True)
        )
        done = max(report.command - self._before, 0)
        status = GripperStatus(done, opening, report.closed, (held_right, held_left), report.reason)
        set_state_value(state, self._state, status)
