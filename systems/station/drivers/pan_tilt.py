"""Drake system of the drivers of the head's two pan-tilt units."""

from collections.abc import Callable

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from unwrinkle.flattening.station_messages import HeadCommand
from unwrinkle.hardware.pan_tilt.base import PanTilt
from unwrinkle.models.arrays import Array
from unwrinkle.systems.abstract_state import set_state_value, state_value
from unwrinkle.systems.station.drivers.device_clock import Clock, diagram_time
from unwrinkle.systems.station.head import HeadStatus


class PanTiltDriverSystem(LeafSystem):
    """Pass head commands to both units' drivers.

    Inputs: `command` (`HeadCommand`). Outputs: `status` (`HeadStatus`), `position` (4,) as reported
    by the units: left pan, tilt, right pan, tilt, rad.
    """

    def __init__(
        self,
        left: PanTilt,
        right: PanTilt,
        *,
        period: float,
        poll: Callable[[float], None] | None = None,
        clock: Clock = diagram_time,
    ) -> None:
        """Wrap two drivers.

        Args:
            left, right: drivers of the left and the right unit.
            period: polling period, s.
            poll: function that advances both drivers to a time, s; if left out, their own `poll`.
            clock: function that gives the drivers' time.
        """
        super().__init__()
        self.set_name("pan-tilt driver")
        self._units = (left, right)
        self._poll, self._clock = poll or self._poll_both, clock
        self._sent = 0
        self._command = self.DeclareAbstractInputPort("command", Value(HeadCommand()))
        first = HeadStatus(0, True, self._angles())
        self._state = self.DeclareAbstractState(Value(first))
        tickets = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "status",
            lambda: Value(first),
            lambda context, output: output.set_value(state_value(context, self._state)),
            tickets,
        )
        self.DeclareVectorOutputPort("position", BasicVector(4), self._position, tickets)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _poll_both(self, now: float) -> None:
        for unit in self._units:
            unit.poll(now)

    def _angles(self) -> Array:
        return np.array([angle for u in self._units for angle in (u.status.pan, u.status.tilt)])

    def _update(self, context: Context, state: State) -> None:
        command: HeadCommand = self._command.Eval(context)
        if command.number > self._sent:
            self._sent = command.number
            for unit, angles in zip(
                self._units, (command.gaze.left, command.gaze.right), strict=True
            ):
                unit.goto(command.number, *angles)
        self._poll(self._clock(context.get_time()))
        statuses = [unit.status for unit in self._units]
        number = min(status.number for status in statuses)
        reason = "; ".join(status.reason for status in statuses if status.reason)
        still = all(status.still for status in statuses) and number == self._sent
        set_state_value(state, self._state, HeadStatus(number, still, self._angles(), reason))

    def _position(self, context: Context, output: BasicVector) -> None:
        status: HeadStatus = state_value(context, self._state)
        output.SetFromVector(status.angles)
