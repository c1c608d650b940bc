"""Drake system of the arms' controller.

The trajectory player runs at the plant's period, the status is updated at the feedback period.
"""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from unwrinkle.flattening.station_messages import ControllerStatus, TrajectoryCommand
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.simulation.arms.trajectory_player import (
    PlayerLimits,
    PlayerSettings,
    PlayerState,
    TrajectoryPlayer,
)
from unwrinkle.systems.abstract_state import set_state_value, state_value


class ArmControllerSystem(LeafSystem):
    """Run trajectories on the axes.

    Inputs: `trajectory`, `speed_override` (1,; 1 if left unconnected), `position` and `velocity`
    (13,). Outputs: `status`, updated at the feedback period; `desired` (26,) for the servos, in the
    order of `connect_servos`; `reference` (14,): reference positions of the axes and the number of
    the running trajectory, 0 at rest.
    """

    def __init__(
        self,
        cell: Cell,
        start: Array,
        *,
        step: float,
        feedback_period: float,
        settings: PlayerSettings | None = None,
    ) -> None:
        """Start at rest at `start` (13,), rad.

        `step` and `feedback_period` are the two update periods, s.
        """
        super().__init__()
        self.set_name("controller")
        # A plan may be made for any speed up to the catalogue's: the controller refuses only more
        # than that.
        catalogue = cell.with_speed(1.0).limits
        limits = PlayerLimits(
            catalogue.lower, catalogue.upper, catalogue.velocity, catalogue.acceleration
        )
        self._player = TrajectoryPlayer(limits, tuple(cell.robot.axes), settings)
        self._step = step
        self._command = self.DeclareAbstractInputPort("trajectory", Value(TrajectoryCommand()))
        self._override = self.DeclareVectorInputPort("speed_override", BasicVector(1))
        self._position = self.DeclareVectorInputPort("position", BasicVector(13))
        self._velocity = self.DeclareVectorInputPort("velocity", BasicVector(13))
        self._state = self.DeclareAbstractState(Value(self._player.at_rest(start)))
        self._status = self.DeclareAbstractState(Value(ControllerStatus()))
        states = {self.abstract_state_ticket(self._state)}
        self.DeclareVectorOutputPort("desired", BasicVector(26), self._desired, states)
        self.DeclareVectorOutputPort("reference", BasicVector(14), self._reference, states)
        self.DeclareAbstractOutputPort(
            "status",
            lambda: Value(ControllerStatus()),
            lambda context, output: output.set_value(state_value(context, self._status)),
            {self.abstract_state_ticket(self._status)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(step, 0.0, self._advance)
        self.DeclarePeriodicUnrestrictedUpdateEvent(feedback_period, 0.0, self._report)

    def player_state(self, context: Context) -> PlayerState:
        """Return the player's state; `context` is that of this system."""
        state: PlayerState = state_value(context, self._state)
        return state

    def _advance(self, context: Context, state: State) -> None:
        now = self.player_state(context)
        position = self._position.Eval(context)
        command: TrajectoryCommand = self._command.Eval(context)
        if command.number > now.command:
            now = self._player.accept(
                now, command.number, command.trajectory, position, command.name
            )
        if now.trajectory is not None:
            override = 1.0
            if self._override.HasValue(context):
                override = float(self._override.Eval(context)[0])
            velocity = self._velocity.Eval(context)
            now = self._player.advance(now, self._step, override, position, velocity)
        set_state_value(state, self._state, now)

    def _report(self, context: Context, state: State) -> None:
        now: PlayerState = state.get_abstract_state(int(self._state)).get_value()
        status = ControllerStatus(
            state=now.mode,
            command=now.command,
            completed=now.completed,
            progress=now.s if now.trajectory is not None else 0.0,
            reason=now.reason,
        )
        set_state_value(state, self._status, status)

    def _desired(self, context: Context, output: BasicVector) -> None:
        # The servos reach the reference one step of the plant later.
        q, v = self._player.reference(self.player_state(context), self._step)
        desired = (q[:1], v[:1], q[1:7], v[1:7], q[7:], v[7:])
        output.SetFromVector(np.concatenate(desired))

    def _reference(self, context: Context, output: BasicVector) -> None:
        now = self.player_state(context)
        number = now.number if now.trajectory is not None else 0
        output.SetFromVector(np.append(self._player.reference(now)[0], number))
