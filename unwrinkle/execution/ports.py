"""Interfaces of the driver and the grippers that an execution uses."""

from typing import Protocol

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.planning.trajectory import Trajectory


class ExecutionDriver(Protocol):
    """Driver of the controller; see `DriverProcess`."""

    @property
    def status(self) -> DriverStatus:
        """Return the driver's state."""
        ...

    @property
    def feedback(self) -> JointFeedback | None:
        """Return the robot's last feedback; None before the first."""
        ...

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """Run a trajectory."""
        ...

    def hold(self, number: int) -> None:
        """Brake along the path."""
        ...

    def resume(self, number: int) -> None:
        """Continue along the path after a hold."""
        ...

    def stop(self, reason: str) -> None:
        """Hold, then leave trajectory mode."""
        ...

    def set_override(self, value: float) -> object:
        """Set the share of the planned speed."""
        ...


class ExecutionGripperReport(Protocol):
    """Report of the grippers."""

    @property
    def command(self) -> int:
        """Return the number of the last command that both grippers have finished."""
        ...

    @property
    def closed(self) -> tuple[bool, bool]:
        """Return whether the right and the left gripper are closed."""
        ...

    @property
    def holding(self) -> tuple[bool | None, bool | None]:
        """Return whether cloth is between the blades, right and left; None without a sensor."""
        ...

    @property
    def reason(self) -> str:
        """Return why the grippers do not answer or work; empty if they do."""
        ...


class ExecutionGrippers(Protocol):
    """Driver of both grippers."""

    @property
    def status(self) -> ExecutionGripperReport:
        """Return the grippers' report."""
        ...

    def command(self, number: int, closed: tuple[bool, bool]) -> None:
        """Close or open the right and the left gripper."""
        ...

    def poll(self, now: float) -> None:
        """Advance to a time, s; never waits."""
        ...
