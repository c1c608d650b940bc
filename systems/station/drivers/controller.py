"""Drake system of the controller's driver.

Each command is sent once, feedback is passed to the outputs.
"""

import dataclasses as dc
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from unwrinkle.flattening.station_messages import ControllerStatus, TrajectoryCommand
from unwrinkle.hardware import controller_state
from unwrinkle.hardware.controller.base import Driver
from unwrinkle.models.arrays import Array
from unwrinkle.models.shared import Shared
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.systems.abstract_state import set_state_value, state_value

#: Modes at the station's port, which has no resume: a held motion has ended, and so has one that is
#: being stopped.
STATES = {
    **controller_state.MOTION_MODES,
    controller_state.HELD: MotionMode.IDLE,
    controller_state.STOPPING: MotionMode.IDLE,
}


@dataclass(frozen=True, eq=False)
class _FeedbackState(Shared):
    """Last status and feedback of the driver.

    Positions (13,) are in rad, velocities (13,) in rad/s; `number` is that of the running
    trajectory.
    """

    status: ControllerStatus
    positions: Array
    velocities: Array
    number: int = 0


class ControllerDriverSystem(LeafSystem):
    """Pass trajectories to the driver of the axes.

    Inputs: `trajectory`, `speed_override` (1,; 1 if left unconnected). Outputs: `status`
    (`ControllerStatus`), `position` and `velocity` (13,) of the last feedback, `number` (1,) of the
    running trajectory, 0 at rest; all updated at the feedback period.
    """

    def __init__(
        self,
        driver: Driver,
        first: Array,
        *,
        period: float,
        feedback_period: float,
        poll: Callable[[float], None] | None = None,
    ) -> None:
        """Wrap a connected driver.

        Args:
            driver: driver of the axes.
            first: (13,) positions of the axes until the first feedback, rad.
            period: period at which commands are passed on, s.
            feedback_period: period of the outputs, s.
            poll: function that advances the driver to a time of the diagram, s; None if another
                process does.
        """
        super().__init__()
        self.set_name("controller driver")
        self._driver, self._poll = driver, poll
        self._sent = 0
        self._speed = 1.0
        self._command = self.DeclareAbstractInputPort("trajectory", Value(TrajectoryCommand()))
        self._override = self.DeclareVectorInputPort("speed_override", BasicVector(1))
        start = _FeedbackState(ControllerStatus(), first, np.zeros(len(first)))
        self._state = self.DeclareAbstractState(Value(start))
        tickets = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "status",
            lambda: Value(ControllerStatus()),
            lambda context, output: output.set_value(self._now(context).status),
            tickets,
        )
        for name, size, read in (
            ("position", len(first), lambda now: now.positions),
            ("velocity", len(first), lambda now: now.velocities),
            ("number", 1, lambda now: [now.number]),
        ):
            self.DeclareVectorOutputPort(name, BasicVector(size), self._reader(read), tickets)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._drive)
        self.DeclarePeriodicUnrestrictedUpdateEvent(feedback_period, 0.0, self._report)

    def _now(self, context: Context) -> _FeedbackState:
        snapshot: _FeedbackState = state_value(context, self._state)
        return snapshot

    def _reader(
        self, read: Callable[[_FeedbackState], Array | list[int]]
    ) -> Callable[[Context, BasicVector], None]:
        return lambda context, output: output.SetFromVector(read(self._now(context)))

    def _drive(self, context: Context, state: State) -> EventStatus:
        if self._override.HasValue(context):
            speed = float(self._override.Eval(context)[0])
            if speed != self._speed:
                self._speed = speed
                self._driver.set_override(speed)
        command: TrajectoryCommand = self._command.Eval(context)
        if command.number > self._sent:
            self._sent = command.number
            if command.trajectory is None:
                self._driver.hold(command.number)
            else:
                self._driver.run(command.number, command.trajectory, command.name)
        if self._poll is not None:
            self._poll(context.get_time())
        return EventStatus.DidNothing()  # the context has not changed

    def _report(self, context: Context, state: State) -> None:
        before, now = self._now(context), self._driver.status
        status = ControllerStatus(
            state=STATES[now.state],
            command=now.command,
            completed=now.completed,
            progress=now.progress,
            reason=now.reason,
        )
        running = status.state in (MotionMode.RUNNING, MotionMode.HOLDING)
        snapshot = dc.replace(before, status=status, number=now.command if running else 0)
        feedback = self._driver.feedback
        if feedback is not None:
            snapshot = dc.replace(
                snapshot, positions=feedback.positions, velocities=feedback.velocities
            )
        set_state_value(state, self._state, snapshot)
