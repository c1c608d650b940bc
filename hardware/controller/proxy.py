"""The commands and reports of a `ControllerDriver` that is polled elsewhere: in a thread, or in
another process.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.planning.trajectory import Trajectory

#: Commands of the driver that a proxy passes on.
COMMANDS = (
    "run",
    "hold",
    "resume",
    "stop",
    "reset",
    "fail",
    "set_override",
    "write_output",
    "read_input",
)
#: Longest wait for rest when a driver is closed, s; a hold takes well under a second, at most
#: several.
LONGEST_CLOSE_S = 8.0


@dataclass(frozen=True, eq=False)
class DriverReport:
    """What a driver reports at one time; see `ControllerDriver`."""

    status: DriverStatus = field(default_factory=DriverStatus)
    feedback: JointFeedback | None = None
    inputs: dict[int, int | None] = field(default_factory=dict)
    outputs_written: dict[int, int | None] = field(default_factory=dict)
    io_problem: str = ""


class DriverProxy(ABC):
    """Commands a driver from any thread.

    As a context manager it connects at the start; at the end, also after an exception, it holds,
    waits for rest and disconnects.
    """

    @abstractmethod
    def start(self) -> None:
        """Connect, and have the driver polled from now on; a second call changes nothing.

        Raises:
            HardwareError: the robot is in use, or a server does not answer.
        """

    @abstractmethod
    def close(self) -> None:
        """Hold, wait for rest (bounded), leave trajectory mode, disconnect; a second call changes
        nothing.
        """

    @abstractmethod
    def report(self) -> DriverReport:
        """Return what the driver reports now."""

    @abstractmethod
    def wait(self, predicate: Callable[[DriverStatus], bool], timeout: float) -> bool:
        """Wait at most `timeout`, s of real time, until the status fulfils `predicate`; return
        whether it does.
        """

    @abstractmethod
    def _call(self, command: str, *arguments: object) -> None:
        """Call a command of the driver, one of `COMMANDS`."""

    def __enter__(self) -> Self:
        """Connect."""
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Hold, wait for rest, disconnect."""
        self.close()

    @property
    def status(self) -> DriverStatus:
        """Newest status."""
        return self.report().status

    @property
    def feedback(self) -> JointFeedback | None:
        """Newest complete set of joint feedback; None before the first."""
        return self.report().feedback

    @property
    def inputs(self) -> dict[int, int | None]:
        """Last values read of inputs, by address; None where unknown."""
        return self.report().inputs

    @property
    def outputs_written(self) -> dict[int, int | None]:
        """Last values that the controller has acknowledged for outputs, by address; None where it
        has not.
        """
        return self.report().outputs_written

    @property
    def io_problem(self) -> str:
        """Last refusal on the I/O connection; empty if there is none."""
        return self.report().io_problem

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """Run a trajectory from where the robot rests."""
        self._call("run", number, trajectory, name)

    def hold(self, number: int) -> None:
        """Brake along the path."""
        self._call("hold", number)

    def resume(self, number: int) -> None:
        """Go on along the path after a hold."""
        self._call("resume", number)

    def stop(self, reason: str) -> None:
        """Brake along the path, then leave trajectory mode."""
        self._call("stop", reason)

    def reset(self) -> None:
        """Leave a latched fault."""
        self._call("reset")

    def fail(self, text: str) -> None:
        """Stop at once and latch a fault."""
        self._call("fail", text)

    def set_override(self, value: float) -> None:
        """Run at a share of the planned speed, 0 to 1."""
        self._call("set_override", value)

    def write_output(self, address: int, value: int) -> None:
        """Set a digital output to 0 or 1."""
        self._call("write_output", address, value)

    def read_input(self, address: int) -> None:
        """Read a digital input."""
        self._call("read_input", address)
