"""What an execution asks of the driver and of the grippers: the interfaces alone."""

from typing import Protocol

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.planning.trajectory import Trajectory


class Driver(Protocol):
    """What is asked of the controller's driver; see `DriverProcess`."""

    @property
    def status(self) -> DriverStatus:
        """Its state."""
        ...

    @property
    def feedback(self) -> JointFeedback | None:
        """Of the robot."""
        ...

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """Run a trajectory."""
        ...

    def hold(self, number: int) -> None:
        """Brake along the path."""
        ...

    def resume(self, number: int) -> None:
        """Go on along the path."""
        ...

    def stop(self, reason: str) -> None:
        """Hold, then leave trajectory mode."""
        ...

    def set_override(self, value: float) -> object:
        """Share of the planned speed."""
        ...


class GripperReport(Protocol):
    """What grippers report."""

    @property
    def command(self) -> int:
        """Number of the last command that both have finished."""
        ...

    @property
    def closed(self) -> tuple[bool, bool]:
        """Whether they are closed, right and left."""
        ...

    @property
    def holding(self) -> tuple[bool | None, bool | None]:
        """Whether there is cloth between the blades; None where nothing can tell."""
        ...

    @property
    def reason(self) -> str:
        """Why they do not answer or work; empty if they do."""
        ...


class Grippers(Protocol):
    """What is asked of the grippers."""

    @property
    def status(self) -> GripperReport:
        """Their report."""
        ...

    def command(self, number: int, closed: tuple[bool, bool]) -> None:
        """Close or open."""
        ...

    def poll(self, now: float) -> None:
        """Go on; never waits."""
        ...
