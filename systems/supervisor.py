"""Supervisor of the closed loop: the only system of the diagram with a state machine."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from unwrinkle.flattening.execution.state import ExecutionState
from unwrinkle.flattening.messages import Analysed, Perceived, Planned, PlanRequest, Verified
from unwrinkle.flattening.policy import PolicyState
from unwrinkle.flattening.state import Action, SupervisorSettings, SupervisorState
from unwrinkle.flattening.state_machine import Approve, GazeAt, StateMachine
from unwrinkle.flattening.station_messages import (
    ControllerStatus,
    GripperCommand,
    GripperStatus,
    HeadCommand,
    TrajectoryCommand,
)
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.perception.gaze.vergence import quantised
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.planning.trajectory import AXES

#: Abstract inputs by name, each with a factory of an example value.
_ABSTRACT_INPUTS: dict[str, Callable[[], Any]] = {
    "range_map": Perceived,
    "analysis": Analysed,
    "plan": Planned,
    "verdict": Verified,
    "controller.status": ControllerStatus,
    "gripper.status": GripperStatus,
}
#: Sizes of the vector inputs by name.
_VECTOR_INPUTS = {
    "joints.position_measured": AXES,
    "joints.velocity_measured": AXES,
    "exposed": 1,
    "interrupt": 1,
}


class FlatteningSupervisorSystem(LeafSystem):
    """Run the closed loop: look, perceive, plan, verify, execute, and look again.

    Inputs: `range_map`, `analysis`, `plan`, `verdict` (see `flattening.messages`), `exposed`
    (number of the last exposure), `joints.position_measured`, `joints.velocity_measured`,
    `controller.status`, `gripper.status` (see `flattening.station_messages`), and `interrupt`,
    vector (1,): a value above 0.5 holds the motion and ends the run; it may be left unconnected. An
    input is evaluated only in the state that needs it, so that nothing else is computed.

    Outputs: `trajectory`, `gripper.command`, `head.command`, `speed_override`, `request`
    (`PlanRequest`), and `state` (`SupervisorState`) for recorders. They depend on the state alone,
    which changes once per feedback period.

    A trajectory is sent only if its plan has a passing verdict with the same content hash, and
    starts where the robot rests. Faults latch: the state machine cannot leave `fault`.
    """

    def __init__(
        self,
        cell: Cell,
        head: StereoHead,
        *,
        settings: SupervisorSettings | None = None,
        policy_state: PolicyState | None = None,
        approve: Approve | None = None,
    ) -> None:
        """Declare the ports.

        Args:
            cell: Robot and cell; its scenario holds the policy's rules, the feedback period and the
                garment's place.
            head: Stereo head that is commanded.
            settings: Deadlines and tolerances; the defaults if left out.
            policy_state: State of the policy of a resumed run, with the number of its looks.
            approve: Callback that asks the operator about each verified plan; None approves every
                plan.
        """
        super().__init__()
        settings = settings or SupervisorSettings()
        policy_state = policy_state or PolicyState()
        scenario = cell.scenario
        x, y = scenario.garment_centre
        first = SupervisorState(
            policy_state=policy_state,
            head=HeadCommand(policy_state.looks),
            centre=(float(x), float(y), cell.table.height),
            action=Action(look=policy_state.looks + 1, policy_state=policy_state),
            execution=ExecutionState(speed=settings.speed),
        )
        self._first_look = policy_state.looks
        self._state_machine = StateMachine(scenario.loop, settings, _gaze_at(head), approve)
        self._state = self.DeclareAbstractState(AbstractValue.Make(first))
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            scenario.station.feedback_period, 0.0, self._update
        )
        for name, example in _ABSTRACT_INPUTS.items():
            self.DeclareAbstractInputPort(name, AbstractValue.Make(example()))
        for name, size in _VECTOR_INPUTS.items():
            self.DeclareVectorInputPort(name, size)
        ticket = {self.abstract_state_ticket(self._state)}
        outputs: dict[str, tuple[Any, Callable[[SupervisorState], Any]]] = {
            "trajectory": (TrajectoryCommand(), lambda now: now.trajectory),
            "gripper.command": (GripperCommand(), lambda now: now.execution.gripper),
            "head.command": (HeadCommand(), self._head_command),
            "request": (PlanRequest(), lambda now: now.request),
            "state": (first, lambda now: now),
        }
        for name, (example, part) in outputs.items():
            self.DeclareAbstractOutputPort(
                name, _allocator(example), self._reader(part), prerequisites_of_calc=ticket
            )
        self.DeclareVectorOutputPort("speed_override", 1, self._speed_override, ticket)

    def supervisor_state(self, context: Context) -> SupervisorState:
        """Return the supervisor's state; `context` is that of this system."""
        found: SupervisorState = context.get_abstract_state(self._state).get_value()
        return found

    def _head_command(self, now: SupervisorState) -> HeadCommand:
        """Return the head's command; number 0 before the first look, also in a resumed run."""
        return now.head if now.head.number > self._first_look else replace(now.head, number=0)

    def _reader(
        self, part: Callable[[SupervisorState], Any]
    ) -> Callable[[Context, AbstractValue], None]:
        def read(context: Context, output: AbstractValue) -> None:
            output.set_value(part(self.supervisor_state(context)))

        return read

    def _speed_override(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self.supervisor_state(context).execution.speed)

    def _update(self, context: Context, state: State) -> None:
        now = self.supervisor_state(context)
        following = self._state_machine.next(now, _Ports(self, context))
        if following is not now:
            state.get_mutable_abstract_state(self._state).set_value(following)


class _Ports:
    """Feedback at the supervisor's input ports, evaluated on demand."""

    def __init__(self, system: LeafSystem, context: Context) -> None:
        self._system, self._context = system, context

    def _of(self, name: str) -> Any:
        return self._system.GetInputPort(name).Eval(self._context)

    @property
    def time(self) -> float:
        return float(self._context.get_time())

    @property
    def interrupted(self) -> bool:
        port = self._system.GetInputPort("interrupt")
        return port.HasValue(self._context) and bool(port.Eval(self._context)[0] > 0.5)

    def exposed(self) -> int:
        return round(float(self._of("exposed")[0]))

    def perceived(self) -> Perceived:
        found: Perceived = self._of("range_map")
        return found

    def analysed(self) -> Analysed:
        found: Analysed = self._of("analysis")
        return found

    def planned(self) -> Planned:
        found: Planned = self._of("plan")
        return found

    def verified(self) -> Verified:
        found: Verified = self._of("verdict")
        return found

    def positions(self) -> Array:
        return np.array(self._of("joints.position_measured"), dtype=float)

    def velocities(self) -> Array:
        return np.array(self._of("joints.velocity_measured"), dtype=float)

    def controller(self) -> ControllerStatus:
        found: ControllerStatus = self._of("controller.status")
        return found

    def grippers(self) -> GripperStatus:
        found: GripperStatus = self._of("gripper.status")
        return found


def _allocator(example: Any) -> Callable[[], AbstractValue]:
    return lambda: AbstractValue.Make(example)


def _gaze_at(head: StereoHead) -> GazeAt:
    def gaze_at(p_WQ: Array, ext_axis: float) -> Gaze:
        return quantised(head, head.gaze_at(p_WQ, ext_axis))

    return gaze_at
