"""The controller's driver behind the station's ports: commands go to it once, its feedback comes back."""

import dataclasses as dc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from unwrinkle.flattening.station_messages import ControllerStatus, TrajectoryCommand
from unwrinkle.hardware import controller_state
from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.models.arrays import Array
from unwrinkle.models.shared import Shared
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.systems.abstract_state import set_state_value, state_value

#: The driver's states in the words of the station's port.
STATES = {
    controller_state.OFFLINE: MotionMode.FAULT,
    controller_state.CONNECTING: MotionMode.IDLE,
    controller_state.READY: MotionMode.IDLE,
    controller_state.STARTING: MotionMode.RUNNING,
    controller_state.RUNNING: MotionMode.RUNNING,
    controller_state.HOLDING: MotionMode.HOLDING,
    controller_state.HELD: MotionMode.IDLE,
    controller_state.STOPPING: MotionMode.IDLE,
    controller_state.FAULT: MotionMode.FAULT,
}


class MotionDriver(Protocol):
    """What drives the arms: the driver itself, polled by the diagram, or one that another process polls."""

    @property
    def status(self) -> DriverStatus:
        """Of the driver."""

    @property
    def feedback(self) -> JointFeedback | None:
        """The last whole set; None before the first."""

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """Run a trajectory from where the robot rests."""

    def hold(self, number: int) -> None:
        """Brake along the path."""

    def set_override(self, value: float) -> object:
        """Share of the planned speed, 0 to 1."""
        ...


@dataclass(frozen=True, eq=False)
class _Snapshot(Shared):
    status: ControllerStatus
    positions: Array
    velocities: Array
    number: int = 0


class ControllerDriverSystem(LeafSystem):
    """The driver of the axes.

    Inputs: `trajectory`, `speed_override` (1,; one if left open).
    Outputs: `status` (`ControllerStatus`), `position` and `velocity` (13,) of the last feedback, `number` (1,) of the
    trajectory that runs, 0 at rest; all renewed at the feedback period.
    """

    def __init__(
        self,
        driver: MotionDriver,
        first: Array,
        *,
        period: float,
        feedback_period: float,
        poll: Callable[[float], None] | None = None,
    ) -> None:
        """Wrap a driver that is connected.

        Args:
            driver: of the axes.
            first: (13,) where they are, until feedback says so, rad.
            period: of passing commands on, s.
            feedback_period: of the outputs, s.
            poll: moves the driver on to a time of the diagram, s; None where another process does it.
        """
        super().__init__()
        self.set_name("controller driver")
        self._driver, self._poll = driver, poll
        self._sent = 0
        self._speed = 1.0
        self._command = self.DeclareAbstractInputPort("trajectory", Value(TrajectoryCommand()))
        self._override = self.DeclareVectorInputPort("speed_override", BasicVector(1))
        start = _Snapshot(ControllerStatus(), first, np.zeros(len(first)))
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

    def _now(self, context: Context) -> _Snapshot:
        snapshot: _Snapshot = state_value(context, self._state)
        return snapshot

    def _reader(
        self, read: Callable[[_Snapshot], Array | list[int]]
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
        return EventStatus.DidNothing()  # nothing in the context has changed

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
