"""The controller's driver as a program has it: polled elsewhere, by a `DriverLoop`.

The commands are those of the protocol `Driver`, passed on by name.
"""

import functools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from unwrinkle.hardware.controller.base import DigitalIo, Driver
from unwrinkle.hardware.controller.driver import QUEUE_KEPT
from unwrinkle.hardware.controller_state import FAULT, OFFLINE, DriverStatus, JointFeedback
from unwrinkle.hardware.message_pipe import MessagePipe
from unwrinkle.models.errors import ConnectionLostError, HardwareError, OverdueError

#: Commands that are passed on: the methods of the protocol.
COMMANDS = frozenset(
    name
    for part in (DigitalIo, Driver)
    for name, value in vars(part).items()
    if callable(value) and not name.startswith("_")
)
#: Request that ends the loop.
CLOSE = "close"
#: Longest wait for a report, s.
_LONGEST_ANSWER_S = 3.0
#: Longest wait for the report after a close request, s.
LONGEST_CLOSE_ANSWER_S = 16.0
#: Between two reports while waiting, s.
_WAIT_PERIOD_S = 0.01

_Arguments = ParamSpec("_Arguments")
_Value = TypeVar("_Value")


@dataclass(frozen=True, eq=False)
class DriverReport:
    """What a driver reports at one time; see `Driver`."""

    status: DriverStatus = field(default_factory=DriverStatus)
    feedback: JointFeedback | None = None
    inputs: dict[int, int | None] = field(default_factory=dict)
    outputs_written: dict[int, int | None] = field(default_factory=dict)
    io_problem: str = ""

    @classmethod
    def of(cls, driver: Driver) -> "DriverReport":
        """Return what a driver reports now."""
        return cls(
            driver.status,
            driver.feedback,
            driver.inputs,
            driver.outputs_written,
            driver.io_problem,
        )


def _command(
    method: Callable[Concatenate[Any, _Arguments], None],
) -> Callable[Concatenate["DriverProxy", _Arguments], None]:
    """Return a method that has a command of the protocol called by the loop."""

    @functools.wraps(method)
    def pass_on(
        proxy: "DriverProxy", /, *arguments: _Arguments.args, **named: _Arguments.kwargs
    ) -> None:
        proxy.ask(method.__name__, arguments, named)

    return pass_on


class _Reported(Generic[_Value]):
    """Property with one value of a new report."""

    def __init__(self, read: Callable[[DriverReport], _Value]) -> None:
        self._read = read

    def __get__(self, proxy: "DriverProxy", kind: type["DriverProxy"]) -> _Value:
        return self._read(proxy.ask())


class DriverProxy:
    """A driver at the other end of a message pipe; it satisfies `Driver`.

    While the robot moves, a method has to be called at least every `driver_loop.LONGEST_SILENCE_S`
    seconds (`wait` does so): otherwise the program is taken to hang, and the robot is held.
    """

    status = _Reported(lambda report: report.status)
    feedback = _Reported(lambda report: report.feedback)
    inputs = _Reported(lambda report: report.inputs)
    outputs_written = _Reported(lambda report: report.outputs_written)
    io_problem = _Reported(lambda report: report.io_problem)

    run = _command(Driver.run)
    hold = _command(Driver.hold)
    resume = _command(Driver.resume)
    stop = _command(Driver.stop)
    reset = _command(Driver.reset)
    fail = _command(Driver.fail)
    set_override = _command(Driver.set_override)
    write_output = _command(Driver.write_output)
    read_input = _command(Driver.read_input)

    def __init__(self, pipe: MessagePipe | None = None) -> None:
        """Use a pipe to a loop that runs; without one the driver is offline."""
        self._lock = threading.RLock()
        self._pipe = pipe
        self._last = DriverReport()

    def wait(self, predicate: Callable[[DriverStatus], bool], timeout: float) -> bool:
        """Wait at most `timeout`, s of real time, until the status fulfils `predicate`; return
        whether it does.
        """
        end = time.monotonic() + timeout
        while not predicate(self.status):
            if time.monotonic() > end:
                return False
            time.sleep(_WAIT_PERIOD_S)
        return True

    def close(self) -> None:
        """Hold, wait for rest (bounded), leave trajectory mode, disconnect; a second call changes
        nothing.
        """
        with self._lock:
            if self._pipe is not None:
                self._request((CLOSE, (), {}), LONGEST_CLOSE_ANSWER_S)
            self._end()
            self._last = DriverReport(DriverStatus(state=OFFLINE), self._last.feedback)

    def ask(
        self, name: str = "", arguments: tuple[Any, ...] = (), named: dict[str, Any] | None = None
    ) -> DriverReport:
        """Have a command called, if one is named, and return the report that follows.

        A loop that has ended is a fault. The feedback is the same object until a newer set has
        come.
        """
        with self._lock:
            if self._pipe is None:
                return self._last
            problem = self._request((name, arguments, named or {}), _LONGEST_ANSWER_S)
            if problem is not None:
                self._end()
                status = DriverStatus(
                    state=FAULT,
                    command=self._last.status.command,
                    completed=self._last.status.completed,
                    reason=f"{problem}; {self._left_behind()}",
                )
                self._last = DriverReport(status, self._last.feedback)
            return self._last

    def _request(self, message: object, longest: float) -> HardwareError | None:
        """Send a message and keep the report that answers it; return why there is none."""
        assert self._pipe is not None
        try:
            self._pipe.send(message)
            answer = self._pipe.receive(longest)
        except TimeoutError:
            text = f"the driver's process did not answer within {longest:g} s"
            return OverdueError(text, longest, longest)
        except (OSError, EOFError):
            return ConnectionLostError("the driver's process has ended")
        if isinstance(answer, HardwareError):
            return answer
        before, now = self._last.feedback, answer.feedback
        if before is not None and now is not None and before.count == now.count:
            answer = replace(answer, feedback=before)
        self._last = answer
        return None

    def _end(self) -> None:
        """Close the pipe: the loop then holds and disconnects by itself."""
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None

    def _left_behind(self) -> str:
        """Return the state in which an ended loop has left the controller, for the user."""
        return QUEUE_KEPT
