"""Virtual devices of the loopback station.

They connect the protocols of the real devices, as their public sources have them, with the
simulated machines.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, floor

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from unwrinkle.flattening.station_messages import GripperCommand, GripperStatus, HeadCommand
from unwrinkle.models.arrays import Array
from unwrinkle.models.shared import Shared
from unwrinkle.models.site import GripperSite
from unwrinkle.perception.stereo.head import Gaze, PanTiltUnit
from unwrinkle.simulation.controllers.controller import VirtualController
from unwrinkle.simulation.devices.serial_pan_tilt import PtyPort, UnitSettings, VirtualSerialPanTilt
from unwrinkle.systems.abstract_state import set_state_value, state_value
from unwrinkle.systems.station.head import HeadStatus


@dataclass(frozen=True, eq=False)
class _Axes(Shared):
    """Commanded positions (13,) rad, velocities (13,) rad/s, and grippers."""

    positions: Array
    velocities: Array
    jaws: GripperCommand


class VirtualControllerSystem(LeafSystem):
    """Run the virtual controller with its server.

    Its joints drive the plant, its outputs the grippers.

    Inputs: `position` and `velocity` (13,) of the plant; `number` (1,) of the running trajectory,
    for the log; `grippers` (`GripperStatus`), which sets the controller's inputs. Outputs:
    `desired` (26,) for the servos, in the order of `connect_servos`; `reference` (14,) for the
    motion log; `gripper_command` for the grippers.
    """

    def __init__(
        self,
        controller: VirtualController,
        grippers: GripperSite,
        poll: Callable[[float, Array, Array], None],
        *,
        period: float,
    ) -> None:
        """Connect the virtual controller to the plant.

        Args:
            controller: virtual controller of the server.
            grippers: addresses of the outputs that close the grippers and of the inputs that report
                them.
            poll: function that advances the server to a time (s) with the plant's positions and
                velocities.
            period: interpolation period, s.
        """
        super().__init__()
        self.set_name("virtual controller")
        self._controller, self._grippers, self._poll = controller, grippers, poll
        self._position = self.DeclareVectorInputPort("position", BasicVector(13))
        self._velocity = self.DeclareVectorInputPort("velocity", BasicVector(13))
        self._number = self.DeclareVectorInputPort("number", BasicVector(1))
        self._status = self.DeclareAbstractInputPort("grippers", Value(GripperStatus()))
        self._state = self.DeclareAbstractState(Value(self._axes(GripperCommand())))
        tickets = {self.abstract_state_ticket(self._state)}
        self.DeclareVectorOutputPort("desired", BasicVector(26), self._desired, tickets)
        self.DeclareVectorOutputPort("reference", BasicVector(14), self._reference)
        self.DeclareAbstractOutputPort(
            "gripper_command",
            lambda: Value(GripperCommand()),
            lambda context, output: output.set_value(self._now(context).jaws),
            tickets,
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _now(self, context: Context) -> _Axes:
        axes: _Axes = state_value(context, self._state)
        return axes

    def _axes(self, jaws: GripperCommand) -> _Axes:
        controller = self._controller
        return _Axes(controller.axis_positions, controller.axis_velocities, jaws)

    def _update(self, context: Context, state: State) -> None:
        self._set_inputs(self._status.Eval(context))
        self._poll(context.get_time(), self._position.Eval(context), self._velocity.Eval(context))
        jaws, closed = self._now(context).jaws, self._commanded()
        if closed != jaws.closed:
            jaws = GripperCommand(jaws.number + 1, closed)
        set_state_value(state, self._state, self._axes(jaws))

    def _set_inputs(self, status: GripperStatus) -> None:
        site, inputs = self._grippers, self._controller.inputs
        for addresses, bits in (
            (site.closed_input, status.closed),
            (site.holding_input, status.holding),
        ):
            inputs.update({a: int(b) for a, b in zip(addresses, bits, strict=True) if a})

    def _commanded(self) -> tuple[bool, bool]:
        site, outputs = self._grippers, self._controller.outputs
        right, left = (
            bool(outputs.get(address, int(inverted))) != inverted
            for address, inverted in zip(site.close_output, site.inverted, strict=True)
        )
        return right, left

    def _desired(self, context: Context, output: BasicVector) -> None:
        q, v = self._now(context).positions, self._now(context).velocities
        desired = (q[:1], v[:1], q[1:7], v[1:7], q[7:], v[7:])
        output.SetFromVector(np.concatenate(desired))

    def _reference(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.append(self._now(context).positions, self._number.Eval(context)))


def unit_settings(unit: PanTiltUnit) -> UnitSettings:
    """Return settings of a virtual unit with the step and limits of a calibrated unit."""
    arcseconds = float(np.degrees(unit.step)) * 3600.0
    pan, tilt = (
        (ceil(low / unit.step - 1e-9), floor(high / unit.step + 1e-9))
        for low, high in (unit.pan, unit.tilt)
    )
    return UnitSettings(resolution=(arcseconds, arcseconds), pan=pan, tilt=tilt)


class _Mechanics:
    """Motors of a virtual pan-tilt unit in steps, driven by the simulated head."""

    def __init__(self, position: tuple[int, int]) -> None:
        self.at = position
        self.goal: tuple[int, int] | None = None

    def command(self, pan_steps: int, tilt_steps: int) -> None:
        self.goal = (pan_steps, tilt_steps)

    def position(self, now: float) -> tuple[int, int]:
        return self.at


class VirtualPanTiltSystem(LeafSystem):
    """Run two virtual pan-tilt units on pseudo-terminals.

    Their motors are those of the simulated head.

    Inputs: `status` (`HeadStatus`) of the head's mechanics. Outputs: `command` (`HeadCommand`) for
    the mechanics.

    Attributes:
        ports: pseudo-terminals of the units, left and right.
        units: virtual units at these ports, left and right.
    """

    def __init__(
        self,
        steps: Sequence[float],
        start: Array,
        make: Callable[[_Mechanics], VirtualSerialPanTilt],
        *,
        period: float,
    ) -> None:
        """Open both pseudo-terminals.

        Args:
            steps: angle of one step of the left and the right unit, rad.
            start: (4,) initial angles: left pan, tilt, right pan, tilt, rad.
            make: function that builds a unit with given mechanics.
            period: polling period, s.
        """
        super().__init__()
        self.set_name("virtual pan-tilt units")
        self._steps = np.repeat(np.asarray(steps, dtype=float), 2)
        at = np.rint(start / self._steps).astype(int)
        self._motors = [_Mechanics((at[0], at[1])), _Mechanics((at[2], at[3]))]
        self.units = [make(motor) for motor in self._motors]
        self.ports = [PtyPort(), PtyPort()]
        self._goal = at
        self._status = self.DeclareAbstractInputPort("status", Value(HeadStatus(0, True, start)))
        self._state = self.DeclareAbstractState(Value(HeadCommand()))
        self.DeclareAbstractOutputPort(
            "command",
            lambda: Value(HeadCommand()),
            lambda context, output: output.set_value(state_value(context, self._state)),
            {self.abstract_state_ticket(self._state)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def poll(self, now: float) -> None:
        """Answer the commands that have arrived."""
        for port, unit in zip(self.ports, self.units, strict=True):
            port.poll(unit, now)

    def close(self) -> None:
        """Close both pseudo-terminals."""
        for port in self.ports:
            port.close()

    def _update(self, context: Context, state: State) -> None:
        status: HeadStatus = self._status.Eval(context)
        at = np.rint(status.angles / self._steps).astype(int)
        for number, motor in enumerate(self._motors):
            motor.at = (int(at[2 * number]), int(at[2 * number + 1]))
        self.poll(context.get_time())
        if all(motor.goal is None for motor in self._motors):
            return
        for number, motor in enumerate(self._motors):
            if motor.goal is not None:
                self._goal[2 * number : 2 * number + 2] = motor.goal
                motor.goal = None
        command: HeadCommand = state_value(context, self._state)
        gaze = Gaze(*(float(angle) for angle in self._goal * self._steps))
        set_state_value(state, self._state, HeadCommand(command.number + 1, gaze))
