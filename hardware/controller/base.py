"""Interface of the controller's driver: commands that return at once, and what it reports.

`ControllerDriver` implements it in the process that polls it, `DriverProcess` passes it on to
another process; a program uses either through this interface.
"""

from typing import Protocol

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.planning.trajectory import Trajectory


class DigitalIo(Protocol):
    """Digital inputs and outputs of the robot's controller."""

    @property
    def inputs(self) -> dict[int, int | None]:
        """Last values read of inputs, by address; None where unknown."""
        ...

    @property
    def outputs_written(self) -> dict[int, int | None]:
        """Last values that the controller has acknowledged for outputs, by address; None where it
        has not.
        """
        ...

    @property
    def io_problem(self) -> str:
        """Last refusal on the I/O connection, for the user; empty if there is none."""
        ...

    def write_output(self, address: int, value: int) -> None:
        """Set a digital output to 0 or 1."""
        ...

    def read_input(self, address: int) -> None:
        """Read a digital input; `inputs` gets its value."""
        ...


class Driver(DigitalIo, Protocol):
    """Driver of all axes. `status` reports how a command ended."""

    @property
    def status(self) -> DriverStatus:
        """Newest status."""
        ...

    @property
    def feedback(self) -> JointFeedback | None:
        """Newest complete set of joint feedback; None before the first."""
        ...

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """Run a trajectory from where the robot rests.

        Args:
            number: counts up with every command; a number seen before changes nothing.
            trajectory: of all axes, from rest to rest.
            name: for messages.
        """
        ...

    def hold(self, number: int) -> None:
        """Brake along the path to rest; `number` counts up with every command."""
        ...

    def resume(self, number: int) -> None:
        """Go on along the path after a hold; `number` counts up with every command."""
        ...

    def stop(self, reason: str) -> None:
        """Brake along the path, then leave trajectory mode."""
        ...

    def reset(self) -> None:
        """Leave a latched fault."""
        ...

    def fail(self, text: str) -> None:
        """Stop at once and latch a fault, for a failure outside the driver."""
        ...

    def set_override(self, value: float) -> None:
        """Run at a share of the planned speed, 0 to 1."""
        ...
